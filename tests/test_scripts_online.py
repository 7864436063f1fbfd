"""The scripts on the online mode run, and their figures are what they say."""

import importlib
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from fg_nav.detection import detect_stances
from fg_nav.errors import SimulationError
from fg_nav.stances import Stances
from tests.simulated import PERSON, straight_walk

SCRIPTS = Path(__file__).parents[1] / "scripts"
sys.path.insert(0, str(SCRIPTS))  # a script finds its neighbours by the folder it was started in
fuzz = importlib.import_module("online_fuzz")
causal = importlib.import_module("causal_stances")
online_accuracy = importlib.import_module("online_accuracy")
online_cost = importlib.import_module("online_cost")


def test_the_fuzz_draws_walks_and_finds_no_fault(capsys):
    fuzz.main(["--seeds", "2", "--first", "101"])
    assert "of 3 figures are as asked" in capsys.readouterr().out


def test_the_fuzz_tells_what_fails(capsys, monkeypatch):
    def broken(*_: object) -> None:
        raise ValueError("broken on purpose")

    monkeypatch.setattr(fuzz.OnlineNavigator, "close", broken)
    fuzz.main(["--seeds", "1", "--first", "101"])
    said = capsys.readouterr().out
    assert "broken on purpose" in said
    assert "short: fuzz, exceptions" in said


def test_every_defect_leaves_rows_to_walk_on():
    recording = straight_walk(PERSON, strides=10).recording
    rows = np.column_stack([recording.t, recording.acc, recording.gyr, np.ones((len(recording), 3))])
    for name, defect in fuzz.DEFECTS.items():
        spoiled = defect(rows.copy(), np.random.default_rng(1))
        assert spoiled.shape[1] == 10, name
        assert len(spoiled) > len(rows) // 4, name
        assert not np.array_equal(spoiled, rows, equal_nan=True), name


def test_missed_and_extra_footfalls_are_counted():
    recording = straight_walk(PERSON, strides=10).recording
    stances = detect_stances(recording)
    assert causal.compared(recording, stances).missed == causal.compared(recording, stances).extra == 0
    fewer = Stances(stances.start[:-2], stances.stop[:-2], stances.footfall[:-2], len(recording))
    assert causal.compared(recording, fewer).extra == 2
    more_mask = stances.mask
    gap = (stances.stop[3] + stances.start[4]) // 2
    more_mask[gap - 2 : gap + 2] = True
    assert causal.compared(recording, Stances.from_mask(more_mask)).missed == 1


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
    assert gap == pytest.approx(0.1)  # the third is the same footfall at another sample, the fourth was not told
    assert found == pytest.approx(0.75)


@pytest.mark.parametrize("lag", [[], ["--lag", "20"]], ids=["whole", "lag"])
def test_the_cost_of_a_footfall_is_printed(lag: list[str], capsys, monkeypatch) -> None:
    monkeypatch.setattr(online_cost, "EARLY", slice(5, 20))
    monkeypatch.setattr(online_cost, "EVERY", 20)
    online_cost.main(["--minutes", "0.6", *lag])
    printed = capsys.readouterr().out
    assert "0 to 20" in printed
    assert "memory at the end over that at half" in printed


def test_a_walk_that_is_too_short_for_a_trend_is_refused() -> None:
    with pytest.raises(SimulationError, match="too few for a trend"):
        online_cost.judged(np.ones(300), np.ones(300), None)
