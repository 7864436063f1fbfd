"""The figures on real recordings that the project promises."""

import numpy as np
import pytest

from fg_nav.detection.stance import Stances
from fg_nav.ekf import run_iez
from fg_nav.evaluation import evaluate
from fg_nav.io import read
from fg_nav.lab.consistency import compute_stance_nees
from fg_nav.lab.pyshoe import read_pyshoe_labels
from tests.real_data import DATA, needs_data

PYSHOE = {"mean": (0.079, 0.131), "median": (0.055, 0.087)}
"""Rmse in m, horizontal and in space, of PyShoe's own EKF on these trials with the same labels."""


@pytest.fixture(scope="module")
def vicon():
    """Horizontal rmse, rmse in space, scale, and median NEES over its expectation, of each trial."""
    rows = []
    for path in sorted((DATA / "vicon").glob("*.mat")):
        recording = read(path)
        stances = Stances.from_mask(read_pyshoe_labels(path, "shoe"))
        solution = run_iez(recording, stances)
        metrics = evaluate(solution, recording.truth)
        nees = compute_stance_nees(solution.stances, recording.truth).median_ratio
        rows.append((metrics.rmse_2d_m, metrics.rmse_3d_m, metrics.scale, nees))
    return np.array(rows)


@needs_data
def test_no_worse_than_pyshoe(vicon):
    assert len(vicon) == 28
    assert np.all(vicon[:, :2].mean(axis=0) <= PYSHOE["mean"])
    assert np.all(np.median(vicon[:, :2], axis=0) <= PYSHOE["median"])


@needs_data
def test_the_claimed_sigmas_mean_something(vicon):
    assert 0.6 < np.median(vicon[:, 3]) < 1.6
    assert np.median(vicon[:, 2]) == pytest.approx(1.0, abs=0.015)
