"""Scenario files and settings with numbers without end, lists in lists and absurd values: one sentence each."""

from __future__ import annotations

import pytest

from fg_nav.errors import SimulationError
from fg_nav.lab.simulation.scenario_file import parse_scenario

COURSE = "[course]\npoints_m = [[0, 0], [0, 25], [40, 25]]\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (COURSE + "laps = " + "9" * 5000, "number too long or a list too deep"),
        ("a = " + "[" * 1000 + "]" * 1000 + "\n" + COURSE, "number too long or a list too deep"),
        (COURSE + "[sensor]\nrate_hz = " + "[" * 1000 + "]" * 1000, "number too long or a list too deep"),
        (COURSE + f"[sensor{'.a' * 3000}]\nb = 1", "number too long or a list too deep"),
        (COURSE + "laps = " + "9" * 4000, "course.laps cannot be 999.*: give less than or equal to 1000000"),
        (COURSE + "strides = 0", "course.strides cannot be 0"),
        (COURSE + "rest_s = 1e99", "course.rest_s cannot be 1e.99: give less than or equal to 86400"),
    ],
    ids=["digits", "lists", "lists in the sensor", "tables", "laps", "strides", "rest"],
)
def test_absurd_scenarios(text: str, words: str) -> None:
    assert parse_scenario("mine.toml", COURSE).name == "mine"
    with pytest.raises(SimulationError, match=words) as caught:
        parse_scenario("mine.toml", text)
    assert len(str(caught.value)) < 300
