"""Options of the verbs: where each applies, and the one sentence of each misfit."""

from dataclasses import fields
from pathlib import Path

import pytest
import typer

from fg_nav import cli
from fg_nav.commands.requests import GROUPS, REQUESTS
from fg_nav.commands.shared import APPLIES
from tests.command_line import FgNav


def test_what_applies_somewhere_is_an_option() -> None:
    assert APPLIES.keys() <= {item.name for request in REQUESTS for item in fields(request)}


@pytest.mark.parametrize("verb", ["run", "compare", "stream"])
def test_options_stand_in_groups_one_after_the_other(verb: str) -> None:
    command = typer.main.get_command(cli.app).commands[verb]
    panels = [getattr(one, "rich_help_panel", None) for one in command.params]
    assert [one for one in dict.fromkeys(panels) if one is not None] == list(GROUPS)
    assert panels == sorted(panels, key=lambda panel: (panel is not None, GROUPS.index(panel) if panel else 0))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("run a.csv --sides left,right", "--sides is for --mount feet: add that, or leave --sides out."),
        ("run a.csv b.csv --mount feet --places p", "--places is for --mount foot: leave --places out."),
        ("run a.csv --no-mag --gate qsf", "--gate is for the magnetic field: leave --gate out with --no-mag."),
        ("run a.csv b.csv --truth t.tum", "--truth is of one recording: give the 2 one by one."),
        (
            "run a.csv --method iez --polish",
            "iez makes no use of --polish: leave --polish out, or choose online.",
        ),
        ("compare a.csv --methods qsf,ma2018 --gate qsf", "qsf makes no use of --gate: leave --gate out, or choose"),
        ("inspect a.csv b.csv --barometer p.csv", "--barometer is of one recording: give the 2 one by one."),
        ("stream a.csv --mount pocket --lag 60", "--lag is for --mount foot: leave --lag out."),
        ("stream a.csv b.csv", "a second source is for --mount feet: add that, or leave a second source out."),
    ],
)
def test_a_misfit_is_refused_in_one_sentence(fg_nav: FgNav, words: str, said: str) -> None:
    assert fg_nav(*words.split()).refused(said)
    assert not list(Path().iterdir())
