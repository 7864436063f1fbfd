"""The field over a swing: its rotations by integration, its quadratic against the full problem, and its statistics."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import B
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from fg_nav.factors.rotation import relative_rotations
from fg_nav.factors.swing_field import (
    chi_square_at,
    has_moved_too_far,
    least_chi_square,
    square_root,
    swing_field_factor,
    swing_field_quadratics,
)
from tests.factors.attitudes import values_of

SIGMA = 0.5
BIAS = np.radians([0.1, -0.15, 0.25])  # 0.3 deg/s
FIELD = np.array([15.0, -14.0, -43.0])
PERIOD = 0.01


def swinging(rng, samples=300, size=4.0):
    """Rates (T, 3) rad/s of a sensor that swings about all its axes."""
    t = PERIOD * np.arange(samples)
    rates = np.zeros((samples, 3))
    for frequency in (0.6, 1.1, 1.9):
        rates += size * rng.normal(0.0, 0.3, 3) * np.sin(2 * np.pi * frequency * t[:, None] + rng.uniform(0, 6.3, 3))
    return rates


def attitudes(rates):
    """Rotations to the first sample's frame, multiplied sample by sample."""
    out = [np.eye(3)]
    for turn in Rotation.from_rotvec(rates[:-1] * PERIOD).as_matrix():
        out.append(out[-1] @ turn)
    return np.array(out)


def measured(rates, rng, u=FIELD, sigma=SIGMA, drift=None):
    """Fields that the sensor sees, turning with the true rates; `drift` (T, 3) uT moves the field meanwhile."""
    field = u + (np.zeros((len(rates), 3)) if drift is None else drift)
    return np.einsum("tba,tb->ta", attitudes(rates), field) + rng.normal(0.0, sigma, (len(rates), 3))


def quadratics(gyro, fields, bias, segment=None, **noise):
    """Quadratics about a bias from what the gyro says."""
    segment = np.zeros(len(gyro), dtype=np.int64) if segment is None else segment
    R, J = relative_rotations(gyro, np.full(len(gyro), PERIOD), segment, bias)
    return swing_field_quadratics(R, J, fields, segment, **({"sigma_uT": SIGMA} | noise))


def solved(gyro, fields, rounds=3, **noise):
    """Bias found, and its quadratics in the last round."""
    bias = np.zeros(3)
    for _ in range(rounds):
        q = quadratics(gyro, fields, bias, **noise)
        bias = bias + np.linalg.solve(q.information[0], q.vector[0])
    return bias, q


@given(seed=st.integers(0, 999), size=st.sampled_from([0.0, 1.0, 10.0]))
@settings(max_examples=10, deadline=None)
def test_the_rotations_are_those_of_integration_sample_by_sample(seed, size):
    rates = swinging(np.random.default_rng(seed), 70, size)
    R, J = relative_rotations(rates + BIAS, np.full(70, PERIOD), np.zeros(70, dtype=np.int64), BIAS)
    np.testing.assert_allclose(R, attitudes(rates), atol=1e-12)
    np.testing.assert_array_equal(R[0], np.eye(3))
    np.testing.assert_array_equal(J[0], 0.0)


@given(seed=st.integers(0, 999), size=st.sampled_from([0.0, 1.0, 10.0]))
@settings(max_examples=10, deadline=None)
def test_the_bias_jacobians_are_the_derivatives_on_the_manifold(seed, size):
    rates, period, one = swinging(np.random.default_rng(seed), 70, size), np.full(70, PERIOD), np.zeros(70, dtype=int)
    _, J = relative_rotations(rates, period, one, BIAS)
    h = 1e-4
    for k, d in enumerate(h * np.eye(3)):
        there, back = (relative_rotations(rates, period, one, BIAS + s * d)[0] for s in (1, -1))
        turn = Rotation.from_matrix(np.swapaxes(back, 1, 2) @ there).as_rotvec() / (2 * h)
        np.testing.assert_allclose(J[:, :, k], turn, atol=1e-7)


def test_stretches_together_are_each_by_itself():
    rng = np.random.default_rng(2)
    lengths = [40, 1, 7, 100]
    segment = np.repeat(np.arange(4), lengths)
    gyro = swinging(rng, len(segment)) + BIAS
    fields = rng.normal(0.0, 30.0, (len(segment), 3))
    fields[::3] = np.nan
    fields[40] = np.nan  # the only sample of stretch 1
    bias = rng.normal(0.0, 0.01, (4, 3))
    q = quadratics(gyro, fields, bias, segment)
    for s in range(4):
        mine = segment == s
        alone = quadratics(gyro[mine], fields[mine], bias[s])
        for name in ("information", "vector", "chi_square", "samples", "body_field", "reach_s"):
            np.testing.assert_allclose(getattr(q, name)[s], getattr(alone, name)[0], rtol=1e-8, atol=1e-8)
    assert q.samples.tolist() == [np.isfinite(fields[segment == s]).all(axis=1).sum() for s in range(4)]
    assert q.samples[1] == 0
    assert not q.information[1].any()


@given(seed=st.integers(0, 999), drift_sigma=st.sampled_from([0.0, 0.3, 2.0, 100.0]))
@settings(max_examples=12, deadline=None)
def test_it_is_the_full_problem_in_field_drift_and_bias_with_field_and_drift_eliminated(seed, drift_sigma):
    """Least squares in (u, g, b) with residuals y - dR(b)^T (u + g s), its Jacobian by finite differences."""
    rng = np.random.default_rng(seed)
    rates = swinging(rng, 60)
    gyro, one, period = rates + BIAS, np.zeros(60, dtype=np.int64), np.full(60, PERIOD)
    fields = measured(rates, rng)
    fields[::4] = np.nan
    used = np.isfinite(fields[:, 0])
    s = np.linspace(-0.5, 0.5, used.sum())[:, None]
    q = quadratics(gyro, fields, BIAS, drift_uT=drift_sigma)

    def residuals(unknown):
        R, _ = relative_rotations(gyro, period, one, BIAS + unknown[6:])
        e = fields[used] - np.einsum("tba,tb->ta", R[used], unknown[:3] + s * unknown[3:6])
        return np.concatenate([e.ravel() / SIGMA, unknown[3:6] / max(drift_sigma, 1e-9)])

    at = np.concatenate([q.body_field[0], np.zeros(6)])
    steps = np.repeat([1e-4, 1e-4, 1e-5], 3)
    jacobian = np.transpose(
        [(residuals(at + d) - residuals(at - d)) / (2 * h) for d, h in zip(np.diag(steps), steps, strict=True)]
    )
    normal, right = jacobian.T @ jacobian, -jacobian.T @ residuals(at)
    back = np.linalg.solve(normal[:6, :6], np.column_stack([normal[:6, 6:], right[:6]]))
    by_hand = normal[6:, 6:] - normal[6:, :6] @ back[:, :3]
    size = np.trace(by_hand)
    np.testing.assert_allclose(q.information[0], by_hand, rtol=1e-5, atol=1e-5 * size)
    np.testing.assert_allclose(q.vector[0], right[6:] - normal[6:, :6] @ back[:, 3], rtol=1e-5, atol=1e-5 * size**0.5)
    assert q.chi_square[0] == pytest.approx((residuals(at) ** 2).sum() - right[:6] @ back[:, 3], rel=1e-6)


def nees_of(seeds, size=4.0, drift_sigma=0.0, **noise):
    """Normalised squared errors of the bias, and the errors (seeds, 3), from 3 s of swinging at 0.5 uT."""
    nees, off = np.zeros(seeds), np.zeros((seeds, 3))
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        rates = swinging(rng, size=size)
        drift = np.linspace(0.0, 1.0, 300)[:, None] * rng.normal(0.0, drift_sigma, 3)
        bias, q = solved(rates + BIAS, measured(rates, rng, drift=drift), **noise)
        off[seed] = bias - BIAS
        nees[seed] = off[seed] @ q.information[0] @ off[seed]
    return nees, off


def test_the_bias_is_found_within_its_sigma():
    nees, _ = nees_of(150)
    low, high = chi2.ppf([0.001, 0.999], 3 * 150)
    assert low < nees.sum() < high


def minute(rng):
    """Bias error (3,) and its squared normalised size after twenty swings of 3 s, each from another heading."""
    segment = np.repeat(np.arange(20), 300)
    rates = np.concatenate([swinging(rng) for _ in range(20)])
    u = Rotation.from_rotvec(rng.uniform(-np.pi, np.pi, (20, 1)) * [0.0, 0.0, 1.0]).apply(FIELD)
    fields = np.concatenate([measured(rates[segment == s], rng, u[s]) for s in range(20)])
    bias = np.zeros(3)
    for _ in range(3):
        q = quadratics(rates + BIAS, fields, bias, segment)
        joined = q.information.sum(axis=0)
        bias = bias + np.linalg.solve(joined, q.vector.sum(axis=0))
    return bias - BIAS, (bias - BIAS) @ joined @ (bias - BIAS)


def test_after_a_minute_the_bias_is_known_to_a_fiftieth_of_a_degree_a_second():
    off, nees = zip(*(minute(np.random.default_rng(seed)) for seed in range(20)), strict=True)
    assert np.degrees(np.abs(off)).max() < 0.06
    assert np.degrees(np.median(np.abs(off), axis=0)).max() < 0.02
    assert sum(nees) < chi2.ppf(0.999, 60)


def test_a_drift_that_is_in_the_model_leaves_the_sigma_honest():
    low, high = chi2.ppf([0.001, 0.999], 3 * 100)
    assert low < nees_of(100, drift_sigma=2.0, drift_uT=2.0)[0].sum() < high
    assert np.median(nees_of(20, drift_sigma=2.0)[0]) > 50.0  # left out, it is 3 on average


def test_turning_about_the_field_alone_the_bias_along_it_is_not_seen():
    rng = np.random.default_rng(4)
    along = FIELD / np.linalg.norm(FIELD)
    rates = 2.0 * np.sin(0.05 * np.arange(300))[:, None] * along
    q = quadratics(rates, measured(rates, rng, sigma=0.0), np.zeros(3))
    values, axes = np.linalg.eigh(q.information[0])
    assert values[0] < 1e-9 * values[1]
    assert abs(axes[:, 0] @ along) == pytest.approx(1.0, abs=1e-9)
    A, b = square_root(q.information, q.vector)
    assert (np.abs(A[0]).sum(axis=1) == 0).tolist() == [True, False, False]
    assert b[0, 0] == 0.0
    turning = quadratics(swinging(rng), measured(swinging(rng), rng), np.zeros(3))
    assert np.linalg.eigvalsh(turning.information[0])[0] > 1e-3 * values[1]


def test_a_quasi_static_swing_has_the_chi_square_of_its_degrees_of_freedom():
    statistic, freedom = np.zeros(60), 3 * 299 - 3
    for seed in range(60):
        rng = np.random.default_rng(seed)
        rates = swinging(rng)
        q = quadratics(rates + BIAS, measured(rates, rng), BIAS)
        least, counted = least_chi_square(q)
        assert counted[0] == freedom
        statistic[seed] = least[0]
    low, high = chi2.ppf([0.001, 0.999], 60 * freedom)
    assert low < statistic.sum() < high


def drifting(shape, drift):
    """Squared pull on the bias in sigmas, least chi-square and that at the true bias over their 99.9 % points."""
    pull, least, known = [], [], []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        rates = swinging(rng)
        fields = measured(rates, rng, drift=shape[:, None] * np.array(drift))
        bias, q = solved(rates + BIAS, fields)
        pull.append((bias - BIAS) @ q.information[0] @ (bias - BIAS))
        own, freedom = least_chi_square(q)
        least.append(own[0] / chi2.ppf(0.999, freedom[0]))
        at_truth = chi_square_at(quadratics(rates + BIAS, fields, BIAS), np.zeros(3))
        known.append(at_truth[0] / chi2.ppf(0.999, 3 * 299))
    return np.array(pull), np.array(least), np.array(known)


ALONG = 2.0 * FIELD / np.linalg.norm(FIELD)
EVENLY, THERE_AND_BACK = np.linspace(0.0, 1.0, 300), np.sin(np.linspace(0.0, np.pi, 300))


def test_a_field_that_comes_and_goes_pulls_the_bias_and_the_least_chi_square_tells():
    pull, least, known = drifting(THERE_AND_BACK, [3.0, 4.0, 0.0])
    assert np.median(pull) > 100.0  # 3 on average without
    assert (least > 1.0).all()
    assert (known > 1.0).all()


def test_a_field_that_grows_does_not_pull_the_bias_and_is_seen_all_the_same():
    pull, least, _ = drifting(EVENLY, ALONG)
    assert np.median(pull) < 5.0
    assert (least > 1.0).all()


def test_a_field_that_drifts_evenly_across_itself_is_seen_only_with_a_bias_known_from_elsewhere():
    pull, least, known = drifting(EVENLY, np.cross(ALONG, [0.6, 0.8, 0.0]))
    assert np.median(pull) > 100.0
    assert np.mean(least > 1.0) < 0.2  # a gate on this alone lets it pass
    assert (known > 1.0).all()


def test_the_quadratic_is_the_cost_and_least_is_its_least():
    rng = np.random.default_rng(3)
    rates = swinging(rng)
    q = quadratics(rates + BIAS, measured(rates, rng), np.zeros(3))
    best = np.linalg.solve(q.information[0], q.vector[0])
    assert chi_square_at(q, best)[0] == pytest.approx(least_chi_square(q)[0][0])
    for d in 1e-3 * np.eye(3):
        assert chi_square_at(q, best + d)[0] > chi_square_at(q, best)[0]


def test_inflation_widens_sigma_by_its_factor():
    rng = np.random.default_rng(3)
    rates = swinging(rng)
    fields = measured(rates, rng)
    plain, wide = quadratics(rates, fields, BIAS), quadratics(rates, fields, BIAS, inflation=3.0)
    for name in ("information", "vector", "chi_square"):
        np.testing.assert_allclose(getattr(plain, name), 9.0 * getattr(wide, name), rtol=1e-12)


def test_held_samples_left_out_are_the_same_as_never_there():
    rng = np.random.default_rng(6)
    rates = swinging(rng)
    fields = measured(rates, rng)
    fields[np.arange(300) % 4 != 1] = np.nan
    R, J = relative_rotations(rates, np.full(300, PERIOD), np.zeros(300, dtype=np.int64), BIAS)
    new = slice(1, 300, 4)
    thin = swing_field_quadratics(R[new], J[new], fields[new], np.zeros(75, dtype=np.int64), SIGMA)
    np.testing.assert_allclose(quadratics(rates, fields, BIAS).information, thin.information, rtol=1e-12)


def bias_at(gyro):
    return gtsam.imuBias.ConstantBias(np.array([0.3, -0.2, 0.1]), gyro)


def test_as_a_factor_it_pulls_the_gyro_bias_and_leaves_the_accelerometer_alone():
    rng = np.random.default_rng(1)
    segment = np.repeat(np.arange(3), 100)
    rates = np.concatenate([swinging(rng, 100) for _ in range(3)])
    fields = np.concatenate([measured(rates[segment == s], rng) for s in range(3)])
    start = np.radians([0.05, 0.05, 0.05])
    q = quadratics(rates + BIAS, fields, start, segment)
    factor = swing_field_factor(B(0), q, bias_at(start))
    graph = gtsam.NonlinearFactorGraph()
    graph.push_back(factor)
    for d in (np.zeros(3), np.array([1e-3, -2e-3, 5e-4])):
        H, eta = graph.linearize(values_of({B(0): bias_at(start + d)})).hessian()
        np.testing.assert_array_equal(H[:3], 0.0)
        np.testing.assert_allclose(H[3:, 3:], q.information.sum(axis=0), rtol=1e-9, atol=1e-6)
        expected = (q.vector - np.einsum("sab,b->sa", q.information, d)).sum(axis=0)
        np.testing.assert_allclose(eta[3:], expected, rtol=1e-8, atol=1e-4)
    there, here = (factor.error(values_of({B(0): bias_at(start + d)})) for d in (np.array([1e-3, -2e-3, 5e-4]), 0.0))
    change = 0.5 * (chi_square_at(q, np.array([1e-3, -2e-3, 5e-4])) - q.chi_square).sum()
    assert there - here == pytest.approx(change, rel=1e-9)


def test_a_solver_that_makes_it_anew_when_the_bias_has_moved_finds_the_bias():
    rng = np.random.default_rng(1)
    rates, far = swinging(rng), np.radians([4.0, -5.0, 3.0])
    fields, bias, made = measured(rates, rng), np.zeros(3), 0
    for _ in range(6):
        q = quadratics(rates + far, fields, bias)
        graph = gtsam.NonlinearFactorGraph()
        graph.push_back(swing_field_factor(B(0), q, bias_at(bias)))
        graph.addPriorConstantBias(B(0), bias_at(np.zeros(3)), gtsam.noiseModel.Isotropic.Sigma(6, 1.0))
        step = graph.linearize(values_of({B(0): bias_at(bias)})).optimize().at(B(0))[3:]
        bias, made = bias + step, made + 1
        if not has_moved_too_far(q, step).any():
            break
    assert made in (2, 3, 4)
    assert (bias - far) @ q.information[0] @ (bias - far) < chi2.ppf(0.999, 3)


@pytest.mark.parametrize("duration", [1.0, 2.5])
def test_moved_too_far_is_a_twentieth_of_a_radian_at_the_end(duration):
    samples = round(duration / PERIOD) + 1
    still = np.zeros((samples, 3))
    q = quadratics(still, measured(still, np.random.default_rng(0)), np.zeros(3))
    assert q.reach_s[0] == pytest.approx(duration)
    assert not has_moved_too_far(q, np.array([0.049 / duration, 0.0, 0.0]))[0]
    assert has_moved_too_far(q, np.array([0.0, 0.0, 0.051 / duration]))[0]
