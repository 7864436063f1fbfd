"""The scripts that measure what lost samples and clipped peaks cost."""

import numpy as np
import pytest

from tests.real_data import DATA, needs_data
from tests.scripts import load_script

script = load_script("sample_errors")


def test_a_gap_in_a_swing_is_bridged_better_than_by_a_line_and_that_better_than_by_the_last_sample(
    capsys: pytest.CaptureFixture[str],
) -> None:
    script.main(["gaps", "--mount", "heel", "--strides", "40"])
    rows = [line.split() for line in capsys.readouterr().out.splitlines() if line[:1].isdigit()]
    assert [row[1] for row in rows] == ["held", "interpolated", "learned"] * 4
    yaw, tilt, velocity = (np.array([float(row[k]) for row in rows]).reshape(4, 3) for k in (2, 4, 5))
    for error in (yaw, tilt, velocity):
        assert (error[:, 1] < error[:, 0]).all()
        assert (error[:, 2] < error[:, 1] / 1.5).all()
    over_sigma = np.array([float(row[-1]) for row in rows[2::3]])
    assert (over_sigma > 0.4).all()
    assert (over_sigma < 1.5).all()


def test_samples_are_lost_one_gap_at_a_time() -> None:
    before, kept = script.draw_gaps(1000, 3, np.random.default_rng(1))
    assert kept.sum() == 1000 - 3 * len(before)
    np.testing.assert_array_equal(np.flatnonzero(~kept).reshape(-1, 3)[:, 0], before + 1)
    assert np.diff(before).min() > script.APART // 2


@needs_data
def test_a_real_walk(capsys: pytest.CaptureFixture[str]) -> None:
    assert DATA is not None
    script.main(["gaps", str(DATA / "gdin/own/SensorConnectData_33.csv")])
    rows = [line.split() for line in capsys.readouterr().out.splitlines() if line.startswith("SensorConnect")]
    held, line, learned, over_sigma = np.array([[float(cell) for cell in row[2:]] for row in rows]).T
    assert (line < held).all()
    assert (learned < 0.7 * line).all()
    assert (over_sigma < 1.5).all()


def test_a_clipped_peak_is_mostly_given_back_and_the_rest_is_as_its_sigma_says(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Of angles and of changes of velocity, the more the deeper the cut; the sigma of deep cuts is that of a guess."""
    script.main(["peaks", "--strides", "20", "--rate", "200"])
    rows = [line.split() for line in capsys.readouterr().out.splitlines() if line.startswith("simulated")]
    hidden, left, over_sigma = np.array([[float(cell) for cell in row[-3:]] for row in rows]).reshape(2, -1, 3).T
    assert (np.diff(hidden, axis=0) > 0).all()
    assert (left < 0.6 * hidden).all()
    assert (over_sigma > 0.3).all()
    assert (over_sigma < 2.5).all()


def test_a_peak_is_cut_on_either_side_and_each_counts() -> None:
    rate = 5.0 * np.sin(np.linspace(0.0, 4 * np.pi, 400))
    cut = np.clip(rate, -4.0, 4.0)
    assert script.median_peak(np.abs(rate)) == pytest.approx(5.0, rel=1e-3)
    missed = script.missed_of_peaks(rate, cut, cut, 0.01)
    assert len(missed) == 4
    assert missed.sum() == pytest.approx(0.0, abs=1e-9)
    assert np.abs(missed).sum() == pytest.approx(np.abs(rate - cut).sum() * 0.01)
