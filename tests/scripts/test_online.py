"""The scripts on the online mode run, and their figures are what they say."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from fg_nav.pipeline import prepare_walk
from fg_nav.walk import Options
from fg_nav.walk import Walk as PreparedWalk
from tests.online.walks import short_walk
from tests.scripts import load_script

online_accuracy = load_script("online_accuracy")
honesty = load_script("online_honesty")
losses = load_script("online_losses")


def test_what_a_loss_leaves_is_within_its_sigmas(capsys):
    (fate,) = losses.walk_on(101, ["3"], unseeing=True)
    assert all(line.error_m < 3.0 * line.sigma_m for line in fate.lines)
    assert 2.0 < fate.lines[0].sigma_m < 15.0
    losses.print_fates([fate])
    assert "3 s lost, 1 walks" in capsys.readouterr().out


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
