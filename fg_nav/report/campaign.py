"""A campaign on a terminal: how far it is and how long it will take; at the end, what came of it."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from statistics import median

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

from fg_nav.evaluation.walked import AS_STARTED, BEST_YAW, CLOSURE
from fg_nav.lab.campaign.command import Done
from fg_nav.lab.campaign.kept import Result, code_sum
from fg_nav.lab.campaign.pace import Standing
from fg_nav.lab.campaign.parcel import KILLED
from fg_nav.lab.campaign.table import TABLES
from fg_nav.report.terminal import console, ruled_table
from fg_nav.wording import counted

MOST_REASONS = 10
"""Of failures, that are printed."""


@contextmanager
def shown() -> Iterator[Callable[[Standing], None]]:
    """Show a bar on standard error while the block runs, on a terminal only; yields what is to be told the standing."""
    errors = Console(stderr=True)
    columns = (TextColumn("{task.description}", markup=False), BarColumn())
    visible = sys.stderr.isatty() and not errors.is_dumb_terminal
    with Progress(*columns, console=errors, transient=True, disable=not visible) as bars:
        task = bars.add_task("looking at what is there", total=None)
        yield lambda now: bars.update(task, description=in_words(now), total=now.total, completed=now.done)


def in_words(now: Standing) -> str:
    """How far it is, in one line."""
    left = "time left not known yet" if now.left_s is None else f"about {duration(now.left_s)} left"
    workers = counted(now.workers, "worker") if now.workers else "no workers yet"
    return f"{now.done} of {now.total} results, {workers}, {left}"


def duration(seconds: float) -> str:
    """A time that nobody needs to the second."""
    minutes, s = divmod(round(seconds), 60)
    hours, m = divmod(minutes, 60)
    return f"{hours} h {m:02d} min" if hours else f"{m} min {s:02d} s" if m else f"{s} s"


def remark(words: str) -> None:
    """Tell on standard error what a user would want to know."""
    print(f"note: {words}", file=sys.stderr)  # noqa: T201


def print_campaign(done: Done, place: Path) -> None:
    """Print medians by case and method, what failed, and where the tables are."""
    out = console()
    cases: dict[tuple[str, ...], list[Result]] = {}
    for result in done.results:
        key = result.key
        cases.setdefault((key.group, key.field, key.magnetometer, key.method), []).append(result)
    table = ruled_table("case", "walks", "failed", "end error (m)", "rmse (m)")
    for case, some in cases.items():
        table.add_row(", ".join(case), str(len(some)), str(sum(bool(one.failed) for one in some)), *_medians(some))
    out.print(table)
    out.print(
        "medians over the walks that did not fail; as started, or by the best yaw, or the closure without a truth"
    )
    for note in _notes(done):
        out.print(f"note: {note}", soft_wrap=True)
    out.print(f"files: {place} ({', '.join(TABLES)})", soft_wrap=True)


def _medians(some: Sequence[Result]) -> tuple[str, str]:
    first = [_first(one.errors) for one in some if not one.failed]
    return tuple(_median([getattr(one, name) for one in first]) for name in ("end_m", "rmse_m"))  # type: ignore[return-value]


def _first(errors: Mapping[str, object]) -> object:
    return next(errors[mode] for mode in (AS_STARTED, BEST_YAW, CLOSURE) if mode in errors)


def _median(values: Sequence[float | None]) -> str:
    known = [value for value in values if value is not None]
    return f"{median(known):.3f}" if known else "-"


def _notes(done: Done) -> Iterator[str]:
    yield f"{counted(len(done.results), 'result')}, {done.joined} of them from before"
    other = sum(one.code != code_sum() for one in done.results)
    if other:
        yield f"{counted(other, 'result')} made by other code or libraries: --renew makes them anew"
    yield from _of_failures([one for one in done.results if one.failed])


def _of_failures(failures: Sequence[Result]) -> Iterator[str]:
    for one in failures[:MOST_REASONS]:
        key = one.key
        yield f"failed: {', '.join((key.group, key.field, key.walk, key.magnetometer, key.method))}: {one.failed}"
    if len(failures) > MOST_REASONS:
        yield f"and {len(failures) - MOST_REASONS} more failed: see the column `failed`"
    if failures:
        fewer = ", with fewer --workers for memory" if any(one.failed == KILLED for one in failures) else ""
        yield f"{counted(len(failures), 'result')} failed: --retry makes them anew{fewer}"
