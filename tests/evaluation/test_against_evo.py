"""Alignment and rmse against evo (GPLv3, a tool outside the package; skipped where it is not installed)."""

import numpy as np
import pytest

from fg_nav.evaluation import evaluate, fit_scale
from fg_nav.truth import TrajectoryTruth
from tests.evaluation.walks import solution, winding_path

trajectory = pytest.importorskip("evo.core.trajectory", reason="evo is not installed: pip install 'fg-nav[checks]'")
metrics = pytest.importorskip("evo.core.metrics")

RNG = np.random.default_rng(3)
TRUTH = winding_path(RNG)
ESTIMATE = 0.97 * winding_path(np.random.default_rng(3)) @ np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]).T
ESTIMATE += 0.1 * RNG.standard_normal(ESTIMATE.shape)
T = np.linspace(0.0, 20.0, len(TRUTH))
OURS = solution(T, ESTIMATE)


def evo_path(position):
    quaternions_wxyz = np.tile([1.0, 0.0, 0.0, 0.0], (len(position), 1))
    return trajectory.PoseTrajectory3D(position, quaternions_wxyz, T)


def evo_errors(estimate, truth, fit):
    moved, reference = evo_path(estimate), evo_path(truth)
    scale = fit(moved, reference)
    ape = metrics.APE(metrics.PoseRelation.translation_part)
    ape.process_data((reference, moved))
    return (
        ape.get_statistic(metrics.StatisticsType.rmse),
        ape.get_statistic(metrics.StatisticsType.max),
        scale,
    )


def fit(correct_scale):
    return lambda moved, reference: moved.align(reference, correct_scale=correct_scale)[2]


@pytest.mark.parametrize(("mode", "how"), [("se3", fit(False)), ("none", lambda moved, reference: None)])
def test_errors_in_three_dimensions(mode, how):
    ours = evaluate(OURS, TrajectoryTruth(T, TRUTH), mode)
    rmse, largest, _ = evo_errors(ESTIMATE, TRUTH, how)
    assert (ours.rmse_3d_m, ours.max_error_m) == pytest.approx((rmse, largest), rel=1e-9)


def test_yaw_and_scale_are_those_of_the_paths_seen_from_above():
    flat = [1.0, 1.0, 0.0]
    rmse, _, _ = evo_errors(ESTIMATE * flat, TRUTH * flat, fit(False))
    assert evaluate(OURS, TrajectoryTruth(T, TRUTH), "yaw").rmse_2d_m == pytest.approx(rmse, rel=1e-9)
    _, _, scale = evo_errors(ESTIMATE * flat, TRUTH * flat, fit(True))
    assert fit_scale(ESTIMATE, TRUTH) == pytest.approx(scale, rel=1e-9)
    assert scale > 1.01
