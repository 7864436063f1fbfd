"""Alignment and scale: against motions that are known, and against evo (GPLv3, a tool outside the package)."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fg_nav.errors import EvaluationError
from fg_nav.evaluation import MODES, align, evaluate, fit_scale
from fg_nav.frames import yaw_rotation
from fg_nav.truth import TrajectoryTruth
from tests.evaluation.walks import solution, winding_path

RNG = np.random.default_rng(5)
PATH = winding_path(RNG)
NOISY = PATH + 0.2 * RNG.standard_normal(PATH.shape)


@given(yaw=st.floats(-3.1, 3.1), shift=st.tuples(*[st.floats(-50, 50)] * 3))
@settings(max_examples=50, deadline=None)
def test_yaw_mode_undoes_the_gauge_exactly(yaw, shift):
    truth = PATH @ yaw_rotation(yaw).T + np.array(shift)
    alignment = align(PATH, truth)
    np.testing.assert_allclose(alignment.apply(PATH), truth, atol=1e-9)
    np.testing.assert_allclose(alignment.truth_R_nav, yaw_rotation(yaw), atol=1e-12)


def test_se3_undoes_any_rotation_and_never_reflects_and_yaw_keeps_a_tilt():
    turn = Rotation.from_rotvec([0.4, -1.2, 2.0]).as_matrix()
    np.testing.assert_allclose(align(PATH, PATH @ turn.T + 3.0, "se3").truth_R_nav, turn, atol=1e-12)
    assert np.linalg.det(align(PATH, PATH * [1.0, -1.0, 1.0], "se3").truth_R_nav) == pytest.approx(1.0)
    assert np.abs(align(PATH @ turn.T, PATH, "yaw").apply(PATH @ turn.T) - PATH).max() > 0.1
    for mode in MODES:  # of one point, too
        assert np.linalg.det(align(PATH[:1], NOISY[:1], mode).truth_R_nav) == pytest.approx(1.0)


@pytest.mark.parametrize("mode", ["yaw", "se3"])
def test_no_neighbouring_motion_fits_better(mode):
    alignment = align(PATH, NOISY, mode)
    best = np.sum((alignment.apply(PATH) - NOISY) ** 2)
    axes = np.eye(3) if mode == "se3" else np.eye(3)[2:]
    for rotvec in 1e-3 * np.vstack([axes, -axes]):
        p = PATH @ (Rotation.from_rotvec(rotvec).as_matrix() @ alignment.truth_R_nav).T
        assert np.sum((p - p.mean(0) + NOISY.mean(0) - NOISY) ** 2) > best
    for shift in 1e-3 * np.vstack([np.eye(3), -np.eye(3)]):
        assert np.sum((alignment.apply(PATH) + shift - NOISY) ** 2) > best


def test_none_and_origin():
    assert np.array_equal(align(PATH, NOISY, "none").apply(PATH), PATH)
    moved = align(PATH, NOISY, "origin").apply(PATH)
    np.testing.assert_allclose(moved[0], NOISY[0])
    np.testing.assert_allclose(moved - PATH, np.broadcast_to(NOISY[0] - PATH[0], PATH.shape), atol=1e-12)


def test_scale_is_above_one_for_a_short_estimate_and_blind_to_yaw_shift_and_height():
    truth = PATH @ yaw_rotation(2.0).T + 7.0
    for axes in (2, 3):
        assert fit_scale(PATH[:, :axes] / 1.02, truth[:, :axes]) == pytest.approx(1.02)
    assert np.isnan(fit_scale(np.zeros((5, 3)), PATH[:5]))


def test_bad_input_is_named():
    broken = PATH.copy()
    broken[17, 1] = np.nan
    for arguments, words in (
        ((PATH, PATH, "sim3"), "'sim3' is unknown"),
        ((PATH, PATH[1:]), "cannot be aligned"),
        ((broken, PATH), "estimate is not finite at point 17"),
    ):
        with pytest.raises(EvaluationError, match=words):
            align(*arguments)


def test_errors_and_scale_are_those_of_evo():
    """In space and, of the paths seen from above, by yaw alone; the scale is that of the plane."""
    trajectory = pytest.importorskip("evo.core.trajectory", reason="evo is missing: pip install '.[checks]'")
    metrics = pytest.importorskip("evo.core.metrics")
    estimate, t = 0.97 * NOISY @ np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]).T, np.linspace(0.0, 20.0, len(PATH))

    def theirs(axes, scaled=None):
        """Rmse, largest error and scale; not aligned if `scaled` is None."""
        upright = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1))
        moved, reference = (trajectory.PoseTrajectory3D(path * axes, upright, t) for path in (estimate, PATH))
        scale = None if scaled is None else moved.align(reference, correct_scale=scaled)[2]
        ape = metrics.APE(metrics.PoseRelation.translation_part)
        ape.process_data((reference, moved))
        return *(ape.get_statistic(metrics.StatisticsType[name]) for name in ("rmse", "max")), scale

    ours = {mode: evaluate(solution(t, estimate), TrajectoryTruth(t, PATH), mode) for mode in ("se3", "none", "yaw")}
    for mode, scaled in (("se3", False), ("none", None)):
        found = ours[mode].rmse_3d_m, ours[mode].max_error_m
        assert found == pytest.approx(theirs([1.0, 1.0, 1.0], scaled)[:2], rel=1e-9)
    flat = [1.0, 1.0, 0.0]
    assert ours["yaw"].rmse_2d_m == pytest.approx(theirs(flat, False)[0], rel=1e-9)
    assert fit_scale(estimate, PATH) == pytest.approx(theirs(flat, True)[2], rel=1e-9)
    assert fit_scale(estimate, PATH) > 1.01
