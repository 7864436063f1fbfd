"""The scripts on the online mode run, and their figures are what they say."""

import json
from functools import partial

import numpy as np
import pytest

from fg_nav.errors import SimulationError
from tests.scripts import load_script
from tests.simulated import PERSON, straight_walk

fuzz = load_script("online_fuzz")
benchmark = load_script("benchmark_online")
limits = load_script("online_limits")
listeners = load_script("online_listeners")
kills = load_script("online_kills")


def test_the_fuzz_draws_walks_and_finds_no_fault(capsys, monkeypatch):
    monkeypatch.setattr(fuzz, "draw_course", partial(fuzz.draw_course, parts=3))
    fuzz.main(["--seeds", "2", "--first", "101"])
    assert "of 3 figures are as asked" in capsys.readouterr().out


def test_the_fuzz_names_what_fails(capsys, monkeypatch):
    def broken(*_: object) -> None:
        raise ValueError("broken on purpose")

    monkeypatch.setattr(fuzz.OnlineNavigator, "push", broken)
    monkeypatch.setattr(fuzz, "draw_course", partial(fuzz.draw_course, parts=1))
    fuzz.main(["--seeds", "1", "--first", "101"])
    said = capsys.readouterr().out
    assert "broken on purpose" in said
    assert "missed: fuzz, exceptions" in said


def test_every_defect_leaves_rows_to_walk_on():
    recording = straight_walk(PERSON, strides=10).recording
    rows = np.column_stack([recording.t, recording.acc, recording.gyr, np.ones((len(recording), 3))])
    for name, defect in fuzz.DEFECTS.items():
        spoiled = defect(rows.copy(), np.random.default_rng(1))
        assert spoiled.shape[1] == 10, name
        assert len(spoiled) > len(rows) // 4, name
        assert not np.array_equal(spoiled, rows, equal_nan=True), name


@pytest.mark.parametrize("lag", [[], ["--lag", "20"]], ids=["whole", "lag"])
def test_the_cost_of_a_footfall_is_printed(lag: list[str], capsys, monkeypatch) -> None:
    monkeypatch.setattr(benchmark, "EARLY", slice(5, 20))
    monkeypatch.setattr(benchmark, "EVERY", 20)
    benchmark.main(["--minutes", "0.6", *lag])
    printed = capsys.readouterr().out
    assert "0 to 20" in printed
    assert "memory at the end over that at half" in printed


def test_a_walk_that_is_too_short_for_a_trend_is_refused() -> None:
    with pytest.raises(SimulationError, match="too few for a trend"):
        benchmark.measure_online(1.0, None, 100.0)


def test_what_a_source_may_send_is_measured_with_what_is_lost(monkeypatch):
    """With rows that are taken away the loss shows."""
    rows = limits.draw_walk(0.5, 400.0)
    assert len(rows) == 200
    assert all(figure.measured > 0 for figure in limits.measure_reading(rows))
    monkeypatch.setattr(
        limits, "stream_text", lambda pieces: limits.Streamed(rows[:: 1 + (len(pieces) > 2)], 3, 90.0, "")
    )
    missing = [figure for figure in limits.measure_rubbish(rows, 1) if figure.name == "rows missing"]
    assert [figure.measured for figure in missing] == [100] * 4
    assert {figure.mark for figure in missing} == {"missed"}


@pytest.mark.parametrize("at_once", [1, 4, 450])
def test_datagrams_hold_whole_rows_and_no_more_than_they_can(at_once):
    rows = limits.draw_walk(3.0, 400.0)
    datagrams = limits.cut_datagrams(limits.make_text(rows), at_once)
    assert max(map(len, datagrams)) <= limits.MAX_DATAGRAM
    reader = limits.RowReader("datagrams")
    assert np.array_equal(np.concatenate([reader.read(datagram) for datagram in datagrams]), rows, equal_nan=True)


def test_listeners_that_misbehave_are_measured(capsys):
    listeners.main(["--clients", "5", "--seconds", "1", "--crowds", "readers"])
    said = capsys.readouterr().out
    assert "lines arrive, 99 % (ms)" in said
    assert "of 3 figures are as asked" in said


def test_lines_of_a_walk_that_was_killed_are_compared_wherever_they_were_told():
    lines = [{"kind": "now", "stance": k, "t": k, "stance_t": k} for k in range(3)]
    lines += [{"kind": "smoothed", "position_m": [k, 0.5], "position_sigma_m": [0.5, 0.5]} for k in range(3)]
    text = "\n".join(map(json.dumps, lines))
    whole = list(kills.read_lines(text))
    told = list(kills.read_lines(text + '\n{"kind": "now", "sta'))
    assert kills.compare_lines(whole, told) == (0, 0, 0.0)
    assert kills.compare_lines(whole, [*told, *told[1:3]]) == (0, 2, 0.0)
    assert kills.compare_lines(whole, [*told[1:5], {**told[5], "position_m": [2, 0.75]}]) == (1, 0, 0.5)
    assert kills.compare_lines(whole, told[:4]) == (0, 0, np.inf)


def test_a_command_that_does_not_end_is_killed():
    assert kills.run_for(["sh", "-c", "echo told; exec sleep 60"], 0.2) == ("told\n", False)
    assert kills.run_for(["echo", "told"], 60.0) == ("told\n", True)
