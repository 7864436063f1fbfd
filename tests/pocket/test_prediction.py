"""The prediction against finite differences of itself, and against rotations that are known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.lab.reproduce.munoz_diaz2017.as_printed import swap_turn
from fg_nav.pocket.filter import (
    PocketParameters,
    PocketState,
    build_model,
    create_reference,
    predict_field,
    predict_state,
    set_reference,
)

H = 0.01
RATE = np.array([0.4, -3.1, 0.9])
BIAS = np.array([0.02, -0.03, 0.01])
QUIET = PocketParameters(latitude_deg=48.0)
KINDS = ("rotation", "returning", "on a faster Earth")


def quiet_model(parameters):
    """Without noise; a bias that returns to zero does so within a second."""
    model = build_model(parameters)
    decay = 1.0 if parameters.bias_returns_to_zero else 0.0
    return model._replace(gyr_density=0.0, bias_density=0.0, bias_decay_per_s=decay)


def state_with(error, P=None):
    """State whose estimate is off by `error` (6,) from a fixed truth."""
    R = Rotation.from_rotvec(error[:3]).as_matrix() @ Rotation.from_euler("ZYX", [2.0, -0.7, 0.3]).as_matrix()
    return PocketState(R, BIAS + error[3:], np.zeros((6, 6)) if P is None else P)


def error_between(state, truth):
    attitude = Rotation.from_matrix(state.nav_R_body @ truth.nav_R_body.T).as_rotvec()
    return np.concatenate([attitude, state.gyro_bias - truth.gyro_bias])


def moved(state, model):
    predict_state(state, create_reference(), RATE, H, model)
    return state


@pytest.mark.parametrize("kind", KINDS)
def test_errors_move_as_finite_differences_say(kind):
    model = quiet_model(replace(QUIET, bias_returns_to_zero=kind == "returning"))
    if kind == "on a faster Earth":
        model = model._replace(earth_rate=1e3 * model.earth_rate)
    step = 1e-6
    for axis in range(6):
        ends = [moved(state_with(sign * step * np.eye(6)[axis]), model) for sign in (1, -1)]
        column = error_between(*ends) / (2 * step)
        start = state_with(np.zeros(6), np.outer(np.eye(6)[axis], np.eye(6)[axis]))
        # without noise P' is the column of F times itself
        assert np.allclose(moved(start, model).P, np.outer(column, column), atol=2e-5 if "Earth" in kind else 1e-8)


def test_the_attitude_turns_by_the_rate_less_bias_and_earth():
    state = state_with(np.zeros(6))
    before = state.nav_R_body.copy()
    earth = 7.29e-5 * np.array([0.0, np.cos(np.radians(48)), np.sin(np.radians(48))])
    turned = Rotation.from_rotvec((RATE - BIAS - before.T @ earth) * H).as_matrix()
    assert np.allclose(moved(state, quiet_model(QUIET)).nav_R_body, before @ turned, rtol=0.0, atol=1e-13)


def test_the_bias_walks_by_the_printed_steps_whatever_the_rate():
    """MD (24), (25): sigma_n = B / sqrt(t_B f) a sample."""
    state = moved(state_with(np.zeros(6)), build_model(PocketParameters()))
    assert state.P[3, 3] == pytest.approx(np.radians(10 / 3600) ** 2 / (200.0 / H))


@pytest.mark.parametrize("printed", [False, True])
def test_what_the_reference_predicts_hangs_on_the_bias_as_finite_differences_say(printed):
    rates = np.random.default_rng(4).normal(0.0, 3.0, (12, 3))

    def expected(bias):
        state, reference = PocketState(np.eye(3), bias.copy(), np.zeros((6, 6))), create_reference()
        set_reference(reference, np.array([12.0, -20.0, -40.0]))
        for rate in rates:
            predict_state(state, reference, rate, H, quiet_model(replace(QUIET, latitude_deg=None)))
        assert reference.age[0] == pytest.approx(0.12)
        used = swap_turn(reference) if printed else reference
        return predict_field(used), used.per_bias

    field, per_bias = expected(BIAS)
    for axis in np.eye(3):
        found = (expected(BIAS + 1e-6 * axis)[0] - expected(BIAS - 1e-6 * axis)[0]) / 2e-6
        assert np.allclose(np.cross(field, per_bias @ axis), found, atol=1e-6)
