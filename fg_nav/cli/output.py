"""What the verbs answer, printed: for people, as JSON for scripts (`--json`), or not at all (`--quiet`)."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from fg_nav.commands import Answer


@contextmanager
def answering(as_json: bool, quiet: bool) -> Iterator[Callable[[Answer], None]]:
    """Keep quiet while a verb works, if that was asked for; yields what prints its answer."""
    from fg_nav.report.terminal import hush

    with hush(quiet):
        yield lambda answer: _print_answer(answer, as_json, quiet)


def _print_answer(answer: Answer, as_json: bool, quiet: bool) -> None:
    if as_json:
        from fg_nav.text import to_json

        typer.echo(json.dumps(to_json(answer.content), indent=2, allow_nan=False))
    elif not quiet:
        answer.show()
    if answer.failure is not None:
        raise answer.failure
