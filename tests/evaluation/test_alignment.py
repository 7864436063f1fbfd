import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fg_nav.errors import EvaluationError
from fg_nav.evaluation import MODES, align, fit_scale
from fg_nav.frames import yaw_rotation
from tests.evaluation.walks import winding_path

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
    for axis in axes:
        for angle in (-1e-3, 1e-3):
            turned = Rotation.from_rotvec(angle * axis).as_matrix() @ alignment.truth_R_nav
            p = PATH @ turned.T
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
    assert fit_scale(PATH / 1.02, truth) == pytest.approx(1.02)
    assert fit_scale(PATH[:, :2] / 1.02, truth[:, :2]) == pytest.approx(1.02)
    assert np.isnan(fit_scale(np.zeros((5, 3)), PATH[:5]))


def test_bad_input_is_named():
    with pytest.raises(EvaluationError, match="'sim3' is unknown"):
        align(PATH, PATH, "sim3")
    with pytest.raises(EvaluationError, match="cannot be aligned"):
        align(PATH, PATH[1:])
    broken = PATH.copy()
    broken[17, 1] = np.nan
    with pytest.raises(EvaluationError, match="estimate is not finite at point 17"):
        align(broken, PATH)
