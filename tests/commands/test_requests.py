"""Options of the verbs: where each applies, and the one sentence of each misfit."""

from dataclasses import fields
from pathlib import Path

import pytest

from fg_nav.commands.requests import REQUESTS
from fg_nav.commands.shared import APPLIES
from tests.command_line import FgNav


def test_what_applies_somewhere_is_an_option() -> None:
    assert APPLIES.keys() <= {item.name for request in REQUESTS for item in fields(request)}


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
        ("stream a.csv --mount pocket --gate aiez", "--gate is for --mount foot or feet: leave --gate out."),
        ("stream a.csv --step-constant 0.8", "--step-constant is for --mount pocket: add that, or leave"),
        ("stream a.csv --lag 60 --polish", "--polish"),
        ("stream a.csv --silence 0", "--silence"),
        ("stream a.csv --heading nan", "nan"),
        ("stream a.csv --resume", "--record"),
        ("stream a.csv --columns t,ax", "--columns lacks"),
        ("stream no-such-file", "no-such-file"),
        ("stream ftp://here:1", "ftp://here:1"),
        ("stream tcp://127.0.0.1", "tcp://127.0.0.1"),
        ("stream tcp://no.such.host.invalid:1", "no.such.host.invalid"),
        ("stream udp://:99999", "udp://:99999"),
        ("stream a.csv --mount feet", "takes two sources"),
        ("stream a.csv a.csv --mount feet", "is named twice"),
        ("stream a.csv b.csv --mount feet --lag 60", "--lag is for --mount foot"),
        ("stream a.csv b.csv --mount feet --record r.csv", "--record is for --mount foot"),
        ("stream a.csv b.csv --mount feet --calibration one.json", "--calibration A,B"),
        ("run a.csv --clock-offset 1", "is for --mount feet: add that"),
        ("run a.csv b.csv --mount feet --fixes f.csv", "--fixes"),
        ("run a.csv b.csv --mount feet --truth t.tum", "A,B"),
        ("run a.csv b.csv --mount feet --method iez", "one of smoother, inertial"),
        ("run a.csv --places p --no-mag", "--no-mag"),
        ("run a.csv b.csv --save-places two", "--save-places is of one recording"),
        ("run a.csv --mag-axes=y,x,z --no-mag", "--mag-axes"),
        ("stream a.csv b.csv", "a second source is for --mount feet: add that, or leave a second source out."),
    ],
)
def test_a_misfit_is_refused_in_one_sentence(fg_nav: FgNav, words: str, said: str) -> None:
    assert fg_nav(*words.split()).refused(said)
    assert not list(Path().iterdir())
