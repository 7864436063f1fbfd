"""The scripts on the online mode run, and their figures are what they say."""

import json
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from fg_nav.errors import SimulationError
from fg_nav.pipeline import prepare_walk
from fg_nav.walk import Options
from fg_nav.walk import Walk as PreparedWalk
from tests.online.walks import short_walk
from tests.scripts import load_script
from tests.simulated import PERSON, straight_walk

fuzz = load_script("online_fuzz")
online_accuracy = load_script("online_accuracy")
honesty = load_script("online_honesty")
losses = load_script("online_losses")
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


def test_what_a_loss_leaves_is_within_its_sigmas(capsys):
    (fate,) = losses.walk_on(101, ["3"], unseeing=True)
    assert all(line.error_m < 3.0 * line.sigma_m for line in fate.lines)
    assert 2.0 < fate.lines[0].sigma_m < 15.0
    losses.print_fates([fate])
    assert "3 s lost, 1 walks" in capsys.readouterr().out


def test_every_defect_leaves_rows_to_walk_on():
    recording = straight_walk(PERSON, strides=10).recording
    rows = np.column_stack([recording.t, recording.acc, recording.gyr, np.ones((len(recording), 3))])
    for name, defect in fuzz.DEFECTS.items():
        spoiled = defect(rows.copy(), np.random.default_rng(1))
        assert spoiled.shape[1] == 10, name
        assert len(spoiled) > len(rows) // 4, name
        assert not np.array_equal(spoiled, rows, equal_nan=True), name


def test_the_moment_the_filter_and_the_batch_stand_side_by_side(capsys: pytest.CaptureFixture[str]) -> None:
    online_accuracy.main(["--scenarios", "demo", "--fields", "smooth", "--first", "1", "--seeds", "1"])
    printed = capsys.readouterr().out
    assert "demo, smooth: gap after the polish, most (m)" in printed
    assert "error at the moment over ma2018's, median" in printed


def test_a_gap_is_the_largest_distance_at_the_same_samples() -> None:
    def table(sample: list[int], east: list[float]) -> SimpleNamespace:
        at = np.column_stack([east, np.zeros((len(east), 2))])
        return SimpleNamespace(sample=np.array(sample), t=np.array(sample) / 100.0, position=at)

    gap, found = online_accuracy.gap_between(
        table([0, 100, 203, 500], [0.0, 1.1, 9.0, 3.0]), table([0, 100, 200, 300], [0.0, 1.0, 2.0, 3.0])
    )
    assert gap == pytest.approx(0.1)  # the third is the same footfall at another sample, the fourth was not reported
    assert found == pytest.approx(0.75)


def told_and_known(turn: float, shift: float) -> tuple[SimpleNamespace, SimpleNamespace]:
    """Three lines at samples 0, 2, 4 of a path northward, the last of them turned and shifted east."""
    north = np.arange(5.0)
    path = np.column_stack([np.zeros(5), north, np.zeros(5)])
    attitude = np.tile(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), (5, 1, 1))
    sample = np.array([0, 2, 4])
    told = honesty.Told(sample, sample / 2.0, path[sample], np.zeros(3), np.full((3, 4), 0.5))
    told.position[-1, 0], told.heading[-1] = shift, turn
    return told, SimpleNamespace(position=path, nav_R_body=attitude)


def test_what_was_told_is_divided_by_its_sigma():
    ratio = honesty.divide_by_sigma(*told_and_known(turn=2.0 * np.pi - 0.1, shift=3.0))
    np.testing.assert_allclose(ratio[:2], 0.0, atol=1e-12)
    np.testing.assert_allclose(ratio[2], [6.0, 0.0, 0.0, 0.2], atol=1e-12)


def test_lines_are_compared_with_the_end_and_a_false_footfall_is_added(capsys, tmp_path, monkeypatch):
    recording = replace(short_walk(), truth=None)
    monkeypatch.setattr(
        honesty, "prepare", lambda *_: prepare_walk(PreparedWalk.of(recording, Options(heading_deg=0.0)))
    )
    out = tmp_path / "honesty.json"
    honesty.main(["--sets", "short smooth", "--seeds", "1", "--told", "yes", "--inject", "--json", str(out)])
    printed = capsys.readouterr().out
    assert "short smooth, heading told: off after a false footfall, most (m)" in printed
    row = json.loads(out.read_text())["walks"][0]
    assert row["lines"] >= 10
    assert row["taken_back"] == 0
    assert row["beyond_5"] == 0
    assert 0.0 <= row["injected_turned_back_m"] < 0.2


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
