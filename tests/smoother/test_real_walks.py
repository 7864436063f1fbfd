"""Real walks, a few of the many: loose bounds that a broken smoother does not meet.

The promised figures over all of them are printed by `scripts/measure.py real-walks`.
"""

import numpy as np
import pytest

from fg_nav.evaluation import evaluate
from fg_nav.lab.consistency import compute_stance_nees
from fg_nav.smoother import smooth
from fg_nav.solution import Solution
from tests.real_data import needs_data
from tests.smoother.walks import Walk, gdin, openshoe, vicon

WALKING = ("2017-11-22-11-26-05", "2017-11-22-11-37-47", "2018-02-09-11-19-39")

pytestmark = needs_data


def smoothed(walk: Walk) -> Solution:
    return smooth(walk.recording, walk.stances)


@pytest.mark.parametrize("trial", WALKING)
def test_a_walk_with_motion_capture(trial: str) -> None:
    walk = vicon(trial)
    found = smoothed(walk)
    metrics = evaluate(found, walk.recording.truth)
    assert metrics.rmse_2d_m < 0.07
    assert metrics.rmse_3d_m < 0.15
    assert metrics.scale == pytest.approx(1.0, abs=0.02)
    assert 1 / 10 < compute_stance_nees(found.stances, walk.recording.truth).median_ratio < 5


@pytest.mark.parametrize(("number", "metres"), [(18, 0.15), (24, 0.35), (36, 0.35)])
def test_a_walk_over_surveyed_footprints(number: int, metres: float) -> None:
    walk = gdin(number)
    found = smoothed(walk)
    metrics = evaluate(found, walk.recording.truth)
    assert metrics.rmse_2d_m < metres
    assert abs(metrics.strides_detected - metrics.strides_true) <= 1
    assert metrics.scale == pytest.approx(1.0, abs=0.02)
    assert np.diff(found.stances.heading_sigma).min() > 0


def test_a_loop_closes() -> None:
    metrics = evaluate(smoothed(openshoe(7)))
    assert metrics.closure_percent < 1.0
    assert 70 < metrics.distance_m < 85
