"""Gyro errors: the sensitivity by preintegrating corrected samples, the variable by finding simulated errors."""

from dataclasses import dataclass

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import B, S, V, X
from hypothesis import given, settings
from hypothesis import strategies as st

from fg_nav.factors.gyro_errors import (
    G_SENSITIVITY,
    G_SENSITIVITY_DIAGONAL,
    GYRO_MATRIX,
    GYRO_SCALE,
    corrected_rate,
    gyro_error_factor,
    gyro_error_prior,
    gyro_error_sensitivity,
    with_gyro_errors,
)
from tests.factors.derivatives import jacobians, moved, residual

GRAVITY = 9.81
NO_BIAS = gtsam.imuBias.ConstantBias()
RATE_DENSITY = 2e-4
FORCE_DENSITY = 2e-3
SURVEY = 1e-3
LENGTH = 180
seeds = st.integers(0, 10_000)


def preintegration_noise():
    params = gtsam.PreintegrationParams.MakeSharedU(GRAVITY)
    params.setGyroscopeCovariance(np.eye(3) * RATE_DENSITY**2)
    params.setAccelerometerCovariance(np.eye(3) * FORCE_DENSITY**2)
    params.setIntegrationCovariance(np.eye(3) * 1e-4**2)
    return params


PARAMS = preintegration_noise()


def preintegrated(rate, force, period):
    measurement = gtsam.PreintegratedImuMeasurementsG(PARAMS, NO_BIAS)
    for w, f, h in zip(rate, force, period, strict=True):
        measurement.integrateMeasurement(f, w, h)
    return measurement


def foot_like(rng, n=180, rate_hz=200.0):
    """Rates up to 8 rad/s, forces some m/s^2 about gravity, as smooth as a swinging foot's, at uneven times."""
    period = (1.0 + 0.2 * rng.uniform(-1, 1, n)) / rate_hz
    t = np.cumsum(period)[:, None]

    def wave(size):
        return size * np.sin(2 * np.pi * rng.uniform(0.5, 2.5, 3) * t + rng.uniform(0, 6, 3)) * rng.uniform(0.2, 1, 3)

    return wave(8.0), np.array([1.0, -0.5, GRAVITY]) + wave(10.0), period


def corrected(rate, force, errors, rest_force=0.0):
    matrix, g = errors[:9].reshape(3, 3), errors[9:].reshape(3, 3)
    return rate - rate @ matrix.T - (force - rest_force) @ g.T


def one(i):
    return np.array([i], dtype=np.intp)


@given(seed=seeds, first=st.integers(0, 60), length=st.integers(20, 120), resting=st.booleans())
@settings(max_examples=12, deadline=None)
def test_it_is_the_derivative_of_preintegrating_corrected_samples(seed, first, length, resting):
    rng = np.random.default_rng(seed)
    rate, force, period = foot_like(rng)
    rest_force = np.array([0.3, -2.0, 9.0]) * resting
    part = slice(first, first + length)
    D = gyro_error_sensitivity(rate, force, period, one(first), one(first + length), rest_force)[0]

    def end(errors):
        return preintegrated(corrected(rate, force, errors, rest_force)[part], force[part], period[part]).deltaXij()

    here, step = end(np.zeros(18)), 1e-5
    numeric = np.transpose(
        [
            (here.localCoordinates(end(step * e)) - here.localCoordinates(end(-step * e))) / (2 * step)
            for e in np.eye(18)
        ]
    )
    size = np.repeat(np.abs(numeric).reshape(3, -1).max(axis=1), 3)[:, None]
    np.testing.assert_allclose(D / size, numeric / size, atol=3e-4 + length**-2.0)


def test_intervals_do_not_know_of_each_other():
    rate, force, period = foot_like(np.random.default_rng(5), n=400)
    start, stop = np.array([3, 90, 91, 300]), np.array([90, 91, 260, 400])
    together = gyro_error_sensitivity(rate, force, period, start, stop)
    for D, i, j in zip(together, start, stop, strict=True):
        alone = gyro_error_sensitivity(rate[i:j], force[i:j], period[i:j], one(0), one(j - i))[0]
        np.testing.assert_allclose(D, alone, atol=1e-9)


def test_in_a_turn_on_the_spot_it_is_the_angle_turned():
    n, h = 100, 0.01
    rate, force = np.tile([0.0, 0.0, 1.5], (n, 1)), np.tile([0.0, 0.0, GRAVITY], (n, 1))
    D = gyro_error_sensitivity(rate, force, np.full(n, h), one(0), one(n))[0]
    np.testing.assert_allclose(D[2, GYRO_SCALE], [0.0, 0.0, -1.5], atol=1e-12)
    np.testing.assert_allclose(D[2, G_SENSITIVITY_DIAGONAL], [0.0, 0.0, -GRAVITY], atol=1e-12)


def test_at_the_force_of_rest_the_g_sensitivity_does_nothing():
    n, force = 50, np.array([0.5, -1.0, 9.7])
    rate = np.tile([0.2, 0.1, 0.0], (n, 1))
    D = gyro_error_sensitivity(rate, np.tile(force, (n, 1)), np.full(n, 0.005), one(0), one(n), force)[0]
    np.testing.assert_array_equal(D[:, G_SENSITIVITY], 0.0)
    assert np.abs(D[:, GYRO_MATRIX]).max() > 0.0


def chain(rate, force, period, cuts, rate_shown):
    """True states at the cuts, and inertial factors between them from what the gyroscope shows."""
    values, factors = gtsam.Values(), []
    state = gtsam.NavState(gtsam.Pose3(gtsam.Rot3.RzRyRx(0.1, -0.2, 0.7), np.array([1.0, 2, 3])), np.array([0.3, 0, 0]))
    values.insert(B(0), NO_BIAS)
    for k, (i, j) in enumerate(zip([0, *cuts[:-1]], cuts, strict=True)):
        insert_state(values, k, state)
        state = preintegrated(rate[i:j], force[i:j], period[i:j]).predict(state, NO_BIAS)
        shown = preintegrated(rate_shown[i:j], force[i:j], period[i:j])
        factors.append(gtsam.GalileanImuFactor(X(k), V(k), X(k + 1), V(k + 1), B(0), shown))
    insert_state(values, len(cuts), state)
    return values, factors


def insert_state(values, k, state):
    values.insert(X(k), state.pose())
    values.insert(V(k), state.velocity())


@given(seed=seeds)
@settings(max_examples=8, deadline=None)
def test_the_block_is_what_corrected_samples_would_do_to_the_residual(seed):
    rng = np.random.default_rng(seed)
    rate, force, period = foot_like(rng, n=150)
    D = gyro_error_sensitivity(rate, force, period, one(0), one(150))[0]
    errors = rng.normal(0, 1, 18) * np.repeat([3e-3, 3e-5], 9)
    values, (native,) = chain(rate, force, period, [150], rate)
    values = moved(values, X(1), rng.normal(0, 1e-3, 6))
    values.insert(S(0), errors)
    _, (again,) = chain(rate, force, period, [150], corrected(rate, force, errors))
    change = residual(again, values) - residual(native, values)
    added = residual(gyro_error_factor(native, S(0), D), values) - residual(native, values)
    assert np.linalg.norm(added - change) < 0.02 * np.linalg.norm(change)


@given(seed=seeds)
@settings(max_examples=8, deadline=None)
def test_jacobians_are_the_derivatives_on_the_manifold(seed):
    rng = np.random.default_rng(seed)
    rate, force, period = foot_like(rng, n=60)
    D = gyro_error_sensitivity(rate, force, period, one(0), one(60))[0][:, GYRO_MATRIX]
    values, (native,) = chain(rate, force, period, [60], rate)
    for key in (X(0), X(1)):
        values = moved(values, key, rng.normal(0, 1e-4, 6))
    values.insert(S(0), rng.normal(0, 1e-4, 9))
    factor = gyro_error_factor(native, S(0), D)
    stated = jacobians(factor, values)
    for key, H in stated.items():
        for i, e in enumerate(np.eye(H.shape[1])):
            step = 1e-6
            ahead, behind = (residual(factor, moved(values, key, sign * step * e)) for sign in (1, -1))
            assert np.linalg.norm((ahead - behind) / (2 * step) - H[:, i]) < 2e-3 * np.linalg.norm(H) + 1e-6


def test_the_linear_form_is_the_factor_linearised():
    rng = np.random.default_rng(3)
    rate, force, period = foot_like(rng, n=60)
    D = gyro_error_sensitivity(rate, force, period, one(0), one(60))[0][:, GYRO_SCALE]
    values, (native,) = chain(rate, force, period, [60], rate)
    values.insert(S(0), np.array([0.01, -0.02, 0.005]))
    end = values.atPose3(X(1)).rotation().matrix()
    linear = with_gyro_errors(native.linearize(values), end, S(0), D, values.atVector(S(0)))
    factor = gyro_error_factor(native, S(0), D)
    assert linear.keys() == factor.keys() == [X(0), V(0), X(1), V(1), B(0), S(0)]
    np.testing.assert_array_equal(linear.augmentedJacobian(), factor.linearize(values).augmentedJacobian())
    assert 0.5 * (linear.jacobian()[1] ** 2).sum() == pytest.approx(factor.error(values))


def optimised(graph, values, rounds=4):
    for _ in range(rounds):
        values = values.retract(graph.linearize(values).optimize())
    return values


@dataclass(frozen=True)
class Walk:
    """Twelve swings, what the sensors showed, and what was surveyed: the first `known` + 1 states."""

    truth: gtsam.Values
    rate: np.ndarray
    force: np.ndarray
    period: np.ndarray
    cuts: np.ndarray
    surveys: gtsam.NonlinearFactorGraph

    def graph(self, columns, sigma, taken_off):
        """Inertial factors from samples off which these errors were taken, priors, and surveys."""
        whole = np.zeros(18)
        whole[columns] = taken_off
        rate = corrected_rate(self.rate, self.force, whole)
        D = gyro_error_sensitivity(rate, self.force, self.period, self.cuts - LENGTH, self.cuts)[:, :, columns]
        graph = gtsam.NonlinearFactorGraph(self.surveys)
        for k, D_ in enumerate(D):
            part = slice(LENGTH * k, LENGTH * (k + 1))
            shown = preintegrated(rate[part], self.force[part], self.period[part])
            factor = gtsam.GalileanImuFactor(X(k), V(k), X(k + 1), V(k + 1), B(0), shown)
            graph.push_back(gyro_error_factor(factor, S(0), D_, taken_off))
        graph.push_back(gyro_error_prior(S(0), np.full(len(columns), sigma)))
        return graph


def walk(rng, errors, columns, known):
    swings = 12
    rate, force, period = foot_like(rng, LENGTH * swings)
    rate[:, 2] += 1.0  # which also turns
    cuts = LENGTH * np.arange(1, swings + 1)
    truth, _ = chain(rate, force, period, cuts, rate)
    whole = np.zeros(18)
    whole[columns] = errors
    white = rng.normal(size=(2, *rate.shape)) / np.sqrt(period)[:, None]
    shown = rate + rate @ whole[:9].reshape(3, 3).T + force @ whole[9:].reshape(3, 3).T + RATE_DENSITY * white[0]
    return Walk(truth, shown, force + FORCE_DENSITY * white[1], period, cuts, surveys(rng, truth, known))


def surveys(rng, truth, known):
    graph = gtsam.NonlinearFactorGraph()
    for k in range(known + 1):
        pose, velocity = truth.atPose3(X(k)).retract(rng.normal(0, SURVEY, 6)), truth.atVector(V(k))
        graph.addPriorPose3(X(k), pose, gtsam.noiseModel.Isotropic.Sigma(6, SURVEY))
        graph.addPriorVector(V(k), velocity + rng.normal(0, SURVEY, 3), gtsam.noiseModel.Isotropic.Sigma(3, SURVEY))
    graph.addPriorConstantBias(B(0), NO_BIAS, gtsam.noiseModel.Isotropic.Sigma(6, 1e-6))
    return graph


def solved(w, columns, sigma, passes=2):
    """Values after taking the errors found off the samples as often as there are further passes, and the graph."""
    values = gtsam.Values(w.truth)
    values.insert(S(0), np.zeros(len(columns)))
    for _ in range(passes):
        graph = w.graph(columns, sigma, values.atVector(S(0)))
        for _ in range(4):
            values = values.retract(graph.linearize(values).optimize())
    return values, graph


@pytest.mark.parametrize(
    ("columns", "sigma"), [(GYRO_SCALE, 0.01), (GYRO_MATRIX, 0.01), ([*GYRO_SCALE, *G_SENSITIVITY], 0.001)]
)
def test_simulated_errors_are_found_within_their_sigma(columns, sigma):
    """Normalised square error over seeds: n on average if the errors are drawn from the prior."""
    nees, seen = [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        errors = rng.normal(0.0, sigma, len(columns))
        values, graph = solved(walk(rng, errors, columns, known=12), columns, sigma)
        covariance = gtsam.Marginals(graph, values).marginalCovariance(S(0))
        apart = values.atVector(S(0)) - errors
        nees.append(apart @ np.linalg.solve(covariance, apart))
        seen.append(np.sqrt(np.diag(covariance)) / sigma)
    n = len(columns)
    assert np.mean(nees) == pytest.approx(n, abs=3.5 * np.sqrt(2 * n / len(nees)))
    assert np.median(seen) < 0.2


def heading_error_deg(values, truth, k):
    return abs(np.degrees(truth.atPose3(X(k)).rotation().between(values.atPose3(X(k)).rotation()).yaw()))


def test_the_heading_after_more_turns_is_right_once_the_scale_is_known():
    with_it, without = [], []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        w = walk(rng, rng.choice([-1, 1]) * np.full(3, 0.01), GYRO_SCALE, known=6)
        for sigma, found in ((0.02, with_it), (1e-9, without)):
            found.append(heading_error_deg(solved(w, GYRO_SCALE, sigma, passes=1)[0], w.truth, 12))
    assert np.median(without) > 1.0
    assert np.median(with_it) < 0.1 * np.median(without)


def test_known_errors_come_off_the_samples():
    rng = np.random.default_rng(0)
    rate, force, _ = foot_like(rng)
    errors, rest_force = rng.normal(0, 0.02, 18), np.array([0.0, 0.0, GRAVITY])
    shown = rate @ (np.eye(3) + errors[:9].reshape(3, 3)).T + (force - rest_force) @ errors[9:].reshape(3, 3).T
    np.testing.assert_allclose(corrected_rate(shown, force, errors, rest_force), rate, atol=1e-12)
