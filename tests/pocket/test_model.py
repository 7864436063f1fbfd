"""Prediction and updates of the filter: finite differences, the textbook's matrix form, known rotations, and NEES."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from fg_nav.lab.reproduce.munoz_diaz2017.as_printed import rotation_of_angles, swap_turn
from fg_nav.mechanisation import cross_matrix, right_jacobian
from fg_nav.pocket.filter import (
    FilterInputs,
    PocketParameters,
    PocketState,
    allocate_track,
    build_model,
    create_reference,
    initialize_state,
    predict_field,
    predict_state,
    propagate_reference,
    run_filter,
    set_reference,
    update_field,
    update_gravity,
)
from fg_nav.pocket.track import PocketStart
from tests.pocket.leg import MUNICH, walking

H = 0.01
RATE = np.array([0.4, -3.1, 0.9])
BIAS = np.array([0.02, -0.03, 0.01])
EARTH = 7.29e-5 * np.array([0.0, np.cos(np.radians(48)), np.sin(np.radians(48))])
TRUTH = rotation_of_angles(np.array([0.4, -0.6, 1.1]))
FORCE = 9.8 * TRUTH[2]
TILTED = Rotation.from_rotvec([0.001, -0.002, 0.3]).as_matrix() @ TRUTH


def quiet_model(latitude_deg=48.0, decay_per_s=0.0, faster=1.0):
    """Without noise, on an Earth that turns faster."""
    model = build_model(PocketParameters(latitude_deg=latitude_deg))
    earth = faster * model.earth_rate
    return model._replace(gyr_density=0.0, bias_density=0.0, bias_decay_per_s=decay_per_s, earth_rate=earth)


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


@pytest.mark.parametrize("model", [quiet_model(), quiet_model(decay_per_s=1.0), quiet_model(faster=1e3)])
def test_errors_move_as_finite_differences_say(model):
    step = 1e-6
    for axis in np.eye(6):
        ends = [moved(state_with(sign * step * axis), model) for sign in (1, -1)]
        column = error_between(*ends) / (2 * step)
        # without noise P' is the column of F times itself
        found = moved(state_with(np.zeros(6), np.outer(axis, axis)), model).P
        assert np.allclose(found, np.outer(column, column), atol=2e-5 if model.earth_rate[1] > 1e-2 else 1e-8)


@pytest.mark.parametrize("hemisphere", [1, -1])
def test_the_attitude_turns_by_the_rate_less_bias_and_earth_and_the_bias_walks_as_printed(hemisphere):
    """The Earth turns eastward: about north, and about up in the northern hemisphere. MD (24): B / sqrt(t_B f)."""
    state = state_with(np.zeros(6))
    before = state.nav_R_body.copy()
    turned = Rotation.from_rotvec((RATE - BIAS - before.T @ (EARTH * [0, 1, hemisphere])) * H).as_matrix()
    after = moved(state, quiet_model(hemisphere * 48.0)).nav_R_body
    assert np.allclose(after, before @ turned, rtol=0.0, atol=1e-13)
    walked = moved(state_with(np.zeros(6)), build_model(PocketParameters())).P
    grown = np.radians(0.01) ** 2 * H, np.radians(10 / 3600) ** 2 / (200.0 / H)
    assert np.diag(walked) == pytest.approx(np.repeat(grown, 3))
    printed = moved(state_with(np.zeros(6)), build_model(PocketParameters(bias_returns_to_zero=True)))
    assert printed.gyro_bias == pytest.approx(BIAS * np.exp(-H / 200.0), rel=1e-9)  # MD (10)


@pytest.mark.parametrize("printed", [False, True])
def test_what_the_reference_predicts_hangs_on_the_bias_as_finite_differences_say(printed):
    rates = np.random.default_rng(4).normal(0.0, 3.0, (12, 3))

    def expected(bias):
        state, reference = PocketState(np.eye(3), bias.copy(), np.zeros((6, 6))), create_reference()
        set_reference(reference, np.array([12.0, -20.0, -40.0]))
        for rate in rates:
            predict_state(state, reference, rate, H, quiet_model(None))
        assert reference.age[0] == pytest.approx(0.12)
        used = swap_turn(reference) if printed else reference
        return predict_field(used), used.per_bias

    field, per_bias = expected(BIAS)
    for axis in np.eye(3):
        found = (expected(BIAS + 1e-6 * axis)[0] - expected(BIAS - 1e-6 * axis)[0]) / 2e-6
        assert np.allclose(np.cross(field, per_bias @ axis), found, atol=1e-6)


# updates


def some_covariance(seed=0):
    root = np.random.default_rng(seed).normal(size=(6, 6))
    return 1e-4 * (root @ root.T + np.eye(6))


def textbook(P, H, R, z):
    """State correction and covariance of z = H x + n."""
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    return K @ z, (np.eye(6) - K @ H) @ P


@pytest.mark.parametrize("window", [0.0, 1.0])
def test_gravity_corrects_as_the_textbook_with_finite_differences(window):
    bias, P = np.array([1e-3, 2e-3, -1e-3]), some_covariance()

    def horizontal(x):
        """What of the specific force is level, in the estimate's nav; a mean is half a window old."""
        body = Rotation.from_rotvec((bias + x[3:]) * window / 2).as_matrix() @ (FORCE / 9.8)
        return (Rotation.from_rotvec(x[:3]).as_matrix() @ TILTED @ body)[:2]

    rows = np.array([(horizontal(1e-6 * e) - horizontal(-1e-6 * e)) / 2e-6 for e in np.eye(6)]).T
    x, after = textbook(P, rows, (0.2 / 9.8) ** 2 * np.eye(2), horizontal(np.zeros(6)))
    state = PocketState(TILTED.copy(), bias.copy(), P.copy())
    model = build_model(PocketParameters(gravity_window_s=window, acc_sigma_m_s2=0.2))
    update_gravity(state, create_reference(), FORCE, model)
    assert np.allclose(state.P, after, atol=3e-3 * after.max())
    assert np.allclose(state.gyro_bias - bias, -x[3:], atol=2e-2 * np.abs(x[3:]).max())
    assert np.allclose(state.nav_R_body, Rotation.from_rotvec(-x[:3]).as_matrix() @ TILTED, atol=2e-5)


def test_the_field_corrects_as_the_textbook_in_three_rows():
    """The two rows are the three of MD (16), with all the noise that is in them."""
    model = build_model(PocketParameters())._replace(gyr_density=np.radians(2.0) ** 2)
    state, reference, P = PocketState(TRUTH.copy(), np.zeros(3), np.eye(6)), create_reference(), some_covariance(2)
    set_reference(reference, np.array([12.0, -20.0, -40.0]))
    theta = np.array([0.03, -0.05, 0.02])
    predict_state(state, reference, theta / H, H, model)
    state.P[:] = P
    field = Rotation.from_rotvec(-theta).as_matrix() @ reference.field + np.array([0.02, 0.01, -0.03])
    expected, per_bias = predict_field(reference), reference.per_bias
    cross = cross_matrix(expected)
    R = 2 * 0.015**2 * np.eye(3) + np.radians(2.0) ** 2 * H * cross @ cross.T
    x, after = textbook(P, np.hstack([np.zeros((3, 3)), cross @ per_bias]), R, expected - field)
    update_field(state, reference, field, model)
    assert np.allclose(per_bias, -H * right_jacobian(theta), atol=1e-15)
    assert np.allclose(state.P, after, rtol=1e-9, atol=1e-15)
    assert np.allclose(state.gyro_bias, -x[3:], rtol=1e-9)


def test_the_printed_difference_turns_the_field_the_wrong_way():
    reference, theta = create_reference(), np.array([0.0, 0.05, 0.0])
    set_reference(reference, TRUTH.T @ MUNICH)
    propagate_reference(reference, theta, -H * right_jacobian(theta), H)
    now = (TRUTH @ Rotation.from_rotvec(theta).as_matrix()).T @ MUNICH
    assert np.allclose(predict_field(reference), now, atol=1e-12)
    assert np.linalg.norm(predict_field(swap_turn(reference)) - now) > 3.0  # uT: twice the turn


def test_a_bias_that_moves_between_two_fields_takes_the_chain_along():
    """A slower magnetometer: gravity moves the bias while the field is still waited for."""
    rates = np.random.default_rng(5).normal(0, 2, (5, 3))

    def reference_at(bias):
        reference = create_reference()
        set_reference(reference, np.array([20.0, 5.0, -40.0]))
        for rate in rates:
            theta = (rate - bias) * H
            propagate_reference(reference, theta, -H * right_jacobian(theta), H)
        return reference

    changed, state = reference_at(np.zeros(3)), PocketState(TILTED.copy(), np.zeros(3), some_covariance(3))
    update_gravity(state, changed, FORCE, build_model(PocketParameters(gravity_window_s=0.0, acc_sigma_m_s2=1e-3)))
    size = np.linalg.norm(state.gyro_bias)
    assert size > 1e-4
    assert np.allclose(changed.turn, reference_at(state.gyro_bias).turn, atol=1e-4 * size)


# Monte Carlo: sensors drawn from the filter's own model, whose field takes a step of its noise each sample, so that
# successive differences are independent. A magnetometer's noise is in two, with either sign: there it claims too much

RUNS, SURE = 60, 0.999
PARAMETERS = PocketParameters(gyro_bias_sigma_deg_s=0.3, acc_sigma_m_s2=0.5, gravity_window_s=0.0)
BIAS_WALK = np.radians(200.0 / 3600.0) / np.sqrt(50.0)  # Of a poor sensor: 200 deg/h at 50 s.
MODEL = build_model(PARAMETERS)._replace(bias_density=BIAS_WALK**2)
SIGMA0 = np.array([0.02, 0.02, 0.05, *[np.radians(0.3)] * 3])


def drawn_errors(leg, rng):
    """Error (6,) and covariance at the end of one run with drawn noises."""
    R, h, n = leg.attitude, leg.h, len(leg.attitude) - 1
    bias = SIGMA0[3:] * rng.standard_normal(3) + np.cumsum(BIAS_WALK * np.sqrt(h) * rng.standard_normal((n, 3)), axis=0)
    rate = Rotation.from_matrix(np.swapaxes(R[:-1], 1, 2) @ R[1:]).as_rotvec() / h + bias
    rate += np.sqrt(MODEL.gyr_density / h) * rng.standard_normal((n, 3))
    force = 9.80665 * R[:-1, 2] + PARAMETERS.acc_sigma_m_s2 * rng.standard_normal((n, 3))
    noise = PARAMETERS.mag_sigma_uT * rng.standard_normal((n, 3))
    steps = np.cumsum(np.sqrt(2) * np.einsum("nij,nj->ni", R[:-1], noise), axis=0)
    field = np.einsum("nji,nj->ni", R[:-1], MUNICH + steps)
    always = np.ones(n, dtype=np.bool_)
    wrong = Rotation.from_rotvec(SIGMA0[:3] * rng.standard_normal(3)).as_matrix() @ R[0]
    state = initialize_state(PocketStart(wrong, SIGMA0[0], SIGMA0[2]), PARAMETERS)
    inputs = FilterInputs(np.full(n, h), rate, force, field, always, always, always)
    run_filter(inputs, state, create_reference(), MODEL, allocate_track(h * np.arange(n), n))
    return error_between(state, PocketState(R[n - 1], bias[n - 1], state.P)), state.P


def test_errors_are_what_the_filter_claims():
    leg, rng = walking(15.0, rate_hz=50.0), np.random.default_rng(7)
    runs = [drawn_errors(leg, rng) for _ in range(RUNS)]
    for part in (slice(0, 6), slice(0, 3), slice(3, 6)):  # all, attitude, bias
        nees = np.mean([x[part] @ np.linalg.solve(P[part, part], x[part]) for x, P in runs])
        low, high = chi2.ppf([(1 - SURE) / 2, (1 + SURE) / 2], RUNS * (part.stop - part.start)) / RUNS
        assert low < nees < high
