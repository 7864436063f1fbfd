"""How long a user waits: the least of the repeats is judged, by the time of the processor."""

import sys

from tests.scripts import load_script

startup = load_script("startup")
harness = load_script("harness")


def test_the_least_time_of_the_processor_is_judged():
    spent = [dict.fromkeys(startup.LIMITS_S, harness.Time(wall, cpu)) for wall, cpu in ((9.0, 2.0), (1.0, 4.0))]
    figures = startup.judge_times(spent)
    assert [(figure.measured, figure.mark) for figure in figures] == [
        *[(2.0, "missed"), (1.0, "")],
        *[(2.0, "ok"), (1.0, "")] * 2,
    ]


def test_a_command_is_timed_in_a_process_of_its_own(monkeypatch):
    monkeypatch.setattr(sys, "executable", "true")
    time = startup.time_command({}, "--help")
    assert 0.0 <= time.cpu < 1.0
    assert time.wall > 0.0
