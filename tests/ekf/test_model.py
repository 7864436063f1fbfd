"""Covariance, corrections and measurements: the motion itself, dense algebra, the textbook, differences, Monte Carlo.

In Monte Carlo truth and estimate start apart by a draw from P, the biases walk, the samples have the densities of the
filter and what is measured has its noise. Then the errors are chi-square with as many degrees of freedom as components,
within the bounds of the number of runs (Bar-Shalom et al. 2001, 5.4).
"""

from dataclasses import replace

import numpy as np
import pytest
from numba import njit
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from fg_nav.ekf.core import ACC_BIAS_SIGMA, ACC_BIAS_WALK, make_noise_models
from fg_nav.ekf.covariance import VELOCITY, Densities, add_body_noise, propagate_columns, propagate_covariance
from fg_nav.ekf.measurements import (
    AGREEMENT,
    COMPASS,
    COURSE,
    TILT,
    compute_direction,
    compute_heading,
    make_pseudo_measurements,
    update_at_footfall,
    update_in_stance,
)
from fg_nav.ekf.presets import FACTOR_SPACING_S, FORCE_SHARE, MATCHED
from fg_nav.ekf.update import INNOVATION, ROW, inject_error, rotate_in_nav, update_component, update_row
from fg_nav.mechanisation import NavState, cross_matrix, strapdown
from fg_nav.smoother import strides
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.smoother.strides import VELOCITY_SIGMA, place_nodes
from tests.ekf.motion import Walk, error_of, random_covariance, random_state, with_error

H = 0.005


def step(state, acc=np.zeros(3), gyr=np.zeros(3)):
    turn, push = np.empty((3, 3)), np.empty(3)
    strapdown(state, acc, gyr, H, 9.8, turn, push)
    return turn, push


def transition(turn, push):
    F = np.eye(15)
    propagate_columns(F, 15, turn, push, H)
    return F


@pytest.mark.parametrize("steps", [1, 60])
def test_transition_is_the_derivative_of_the_motion(steps):
    rng, truth = np.random.default_rng(steps), random_state(steps)
    acc, gyr = 10 * rng.standard_normal((steps, 3)), 4 * rng.standard_normal((steps, 3))
    F, moved = np.eye(15), NavState(*(part.copy() for part in truth))
    for f, w in zip(acc, gyr, strict=True):
        F = transition(*step(moved, f, w)) @ F
    numerical = np.empty((15, 15))
    for k in range(15):
        column = []
        for sign in (1, -1):
            other = with_error(truth, sign * 1e-5 * np.eye(15)[k])
            for f, w in zip(acc, gyr, strict=True):
                step(other, f, w)
            column.append(error_of(other, moved))
        numerical[:, k] = (column[0] - column[1]) / 2e-5
    # the mean of an integrand's ends for its integral: good to the square of the period
    scale = np.abs(numerical).max(axis=1, keepdims=True)
    np.testing.assert_allclose(F / scale, numerical / scale, atol=3e-3)
    np.testing.assert_allclose(F[6:9, 9:12], numerical[6:9, 9:12], atol=1e-8)
    np.testing.assert_allclose(F[3:6, 12:], numerical[3:6, 12:], atol=1e-8)


def test_the_printed_transition_is_ours_to_second_order_in_the_period():
    """Ma (31), AIEZ (2), of (dphi, dw, dr, dv, da), in which dw and da are still to be taken off rate and force."""
    ours = np.array([6, 7, 8, 9, 10, 11, 0, 1, 2, 3, 4, 5, 12, 13, 14])
    sign = np.where(np.isin(np.arange(15), [3, 4, 5, 12, 13, 14]), -1.0, 1.0)
    acc, gyr, state = np.array([3.0, -5.0, 9.0]), np.array([0.5, -1.0, 0.3]), random_state(2)
    R, printed = state.nav_R_body.copy(), np.eye(15)
    F = transition(*step(state, acc, gyr))[np.ix_(ours, ours)] * np.outer(sign, sign)
    printed[0:3, 3:6] = printed[9:12, 12:15] = H * R
    printed[6:9, 9:12] = H * np.eye(3)
    printed[9:12, 0:3] = -H * cross_matrix(R @ acc)
    np.testing.assert_allclose(F, printed, atol=2.0 * H**2 * np.linalg.norm(acc))


def test_propagation_is_the_dense_product():
    rng, P = np.random.default_rng(5), random_covariance(5)
    turn, push = step(random_state(5), 10 * rng.standard_normal(3), 4 * rng.standard_normal(3))
    F = transition(turn, push)
    expected = F @ P @ F.T + np.diag(np.repeat([0.0, 1.0, 2.0, 3.0, 4.0], 3)) * H
    propagate_covariance(P, turn, push, H, Densities(1.0, 2.0, 3.0, 4.0))
    np.testing.assert_allclose(P, expected, rtol=1e-12, atol=1e-12)
    assert np.array_equal(P, P.T)


def test_an_uncertain_axis_spreads_in_the_body_frame_only():
    state = random_state(8, gyro_bias=0.0)
    R, P = state.nav_R_body.copy(), np.zeros((15, 15))
    turn, _ = step(state)
    add_body_noise(P, 6, turn, np.array([0.0, 2.0, 0.0]))
    np.testing.assert_allclose(R.T @ P[6:9, 6:9] @ R, np.diag([0, (2.0 * H) ** 2, 0]), atol=1e-18)
    assert np.array_equal(P, P.T)
    assert np.count_nonzero(P) == np.count_nonzero(P[6:9, 6:9])


# corrections


def test_rows_in_turn_are_the_textbook_update_and_a_component_is_a_unit_row():
    rng, P, unit = np.random.default_rng(1), random_covariance(1), np.eye(15)
    x, H = rng.standard_normal(15), np.vstack([rng.standard_normal((4, 15)), unit[4]])
    z, r = rng.standard_normal(5), rng.uniform(0.1, 2.0, 5)
    S = H @ P @ H.T + np.diag(r)
    K = P @ H.T @ np.linalg.inv(S)
    innovation, joseph = z - H @ x, unit - K @ H
    P_book, x_book = joseph @ P @ joseph.T + K @ np.diag(r) @ K.T, x + K @ innovation
    nis = sum(update_row(P, x, H[k], z[k], r[k]) ** 2 for k in range(4))
    nis += update_component(P, x, 4, z[4], r[4]) ** 2
    np.testing.assert_allclose(P, P_book, atol=1e-10)
    np.testing.assert_allclose(x, x_book, atol=1e-10)
    assert nis == pytest.approx(innovation @ np.linalg.solve(S, innovation))
    assert np.array_equal(P, P.T)


def test_a_sharp_measurement_of_a_vague_state_leaves_a_positive_covariance():
    rng, P, x = np.random.default_rng(3), 1e8 * random_covariance(3), np.zeros(15)
    for _ in range(50):
        for k in range(3):
            update_component(P, x, 3 + k, rng.standard_normal(), 1e-8)
            update_row(P, x, rng.standard_normal(15), rng.standard_normal(), 1e-8)
    assert np.all(np.diag(P) > 0)
    assert np.linalg.eigvalsh(P).min() > -1e-9 * np.linalg.eigvalsh(P).max()


def test_taking_off_the_error_gives_the_truth_and_the_other_sign_doubles_it():
    """C <- (I - [dphi]) C for errors as estimate minus truth; the (I + [dphi]) C of one paper is wrong."""
    truth, error = random_state(5), 0.3 * np.random.default_rng(5).standard_normal(15)
    estimate, other, x = with_error(truth, error), with_error(truth, error), error.copy()
    inject_error(estimate, x)
    for ours, theirs in zip(estimate, truth, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-14)
    assert not x.any()
    inject_error(other, -error)
    np.testing.assert_allclose(error_of(other, truth), 2 * error)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.05, 0.0999, 0.1001, 2.0])
def test_turning_is_the_exact_rotation(angle):
    R, axis = random_state(7).nav_R_body, np.array([0.6, -0.64, 0.48])
    expected = Rotation.from_rotvec(angle * axis).as_matrix() @ R
    rotate_in_nav(R, *(angle * axis))
    np.testing.assert_allclose(R, expected, atol=1e-14)


# Monte Carlo

RUNS = 200
RATE = 100.0
DENSITY = Densities(0.02**2, np.radians(0.05) ** 2, np.radians(0.01) ** 2, 0.003**2)
STANCE_VARIANCE = 0.01**2
PRIOR = np.repeat([1e-3, 0.02, 0.01, np.radians(0.2), 0.03], 3)
SURE = 0.999  # Two-sided probability of the bounds: one seed is fixed, so this is how lucky the seed may be.


@njit
def navigate(truth, estimate, P, acc, gyr, stands, h, noise, density, variance):
    """Move truth and estimate over the same walk; returns the NIS of each correction."""
    x, turn, push = np.zeros(15), np.empty((3, 3)), np.empty(3)
    nis = np.full(len(acc), np.nan)
    for i in range(len(acc)):
        if stands[i]:
            nis[i] = 0.0
            for k in range(3):
                measured = truth.velocity[k] + np.sqrt(variance) * noise[i, k]
                nis[i] += update_component(P, x, VELOCITY + k, estimate.velocity[k] - measured, variance) ** 2
            inject_error(estimate, x)
        # the sensor reads what moves the truth, its biases, and white noise
        force, rate = acc[i] + truth.acc_bias, gyr[i] + truth.gyro_bias
        strapdown(truth, force, rate, h, 9.80665, turn, push)
        force = force + np.sqrt(density.acc / h) * noise[i, 3:6]
        rate = rate + np.sqrt(density.gyr / h) * noise[i, 6:9]
        strapdown(estimate, force, rate, h, 9.80665, turn, push)
        propagate_covariance(P, turn, push, h, density)
        truth.gyro_bias[:] += np.sqrt(density.gyro_bias * h) * noise[i, 9:12]
        truth.acc_bias[:] += np.sqrt(density.acc_bias * h) * noise[i, 12:15]
    return nis


def bounds(dof, draws):
    """Of the mean of `draws` independent chi-square numbers."""
    return chi2.ppf([(1 - SURE) / 2, (1 + SURE) / 2], dof * draws) / draws


def test_errors_are_as_large_as_the_filter_claims():
    walk, rng = Walk(strides=8, rest_s=1.0), np.random.default_rng(11)
    recording, stances = walk.recording(RATE)
    parts = [slice(k, k + 3) for k in range(0, 15, 3)] + [slice(0, 15)]
    nees, nis = [], []
    for _ in range(RUNS):
        estimate = NavState(np.zeros(3), np.zeros(3), walk.attitude(np.zeros(1))[0].copy(), *np.zeros((2, 3)))
        truth = with_error(estimate, -PRIOR * rng.standard_normal(15))
        P, noise = np.diag(PRIOR**2), rng.standard_normal((len(recording), 15))
        samples = recording.acc, recording.gyr, stances.mask
        scores = navigate(truth, estimate, P, *samples, 1 / RATE, noise, DENSITY, STANCE_VARIANCE)
        nis.append(np.nanmean(scores))
        e = error_of(estimate, truth)
        nees.append([e[p] @ np.linalg.solve(P[p, p], e[p]) for p in parts])
    for part, mean in zip(parts, np.mean(nees, axis=0), strict=True):
        low, high = bounds(part.stop - part.start, RUNS)
        assert low < mean < high
    low, high = bounds(3, RUNS * int(np.count_nonzero(stances.mask)))
    assert low < np.mean(nis) < high


NAV_FIELD = np.array([2.0, 21.0, -43.0])  # uT, with a declination of its own.
DECLINATION = np.arctan2(NAV_FIELD[0], NAV_FIELD[1])
FORCE = np.array([0.0, 0.0, 9.81])
SURE_BUT_OF_HEADING = np.diag(np.append(np.full(8, 1e-12), np.ones(7)))


def upright(seed):
    """A state tilted by up to a quarter of a turn, with any heading."""
    rng = np.random.default_rng(seed)
    tilt = Rotation.from_euler("xy", rng.uniform(-0.8, 0.8, 2))
    return random_state(seed, (Rotation.from_euler("z", rng.uniform(-np.pi, np.pi)) * tilt).as_matrix())


def measure_at(truth, by_force=False, **used):
    """PseudoMeasurements of one footfall, as a perfect sensor in this state has it."""
    R = truth.nav_R_body
    pseudo = make_pseudo_measurements(1)._replace(
        body_field=(R.T @ NAV_FIELD)[None], body_force=(R.T @ FORCE)[None], declination=DECLINATION
    )
    if by_force:
        used["compass_heading"] = compute_heading(R) - DECLINATION
    each = {name: np.array([value]) for name, value in used.items() if name.startswith(("compass", "tilt"))}
    return pseudo._replace(**(used | each))


def course_of(footfalls, sigma, limit_deg=180.0, strides=1):
    return make_pseudo_measurements(footfalls)._replace(
        course_variance=np.full(footfalls, sigma**2), course_limit=float(np.radians(limit_deg)), course_strides=strides
    )


def update_at(state, pseudo, P, before=(), k=0, direction=None, considered=None):
    """Returns x, P, innovation and traces after the footfall."""
    x, P, innovation, traces = np.zeros(15), P.copy(), np.full(4, np.nan), np.zeros((3, 32))
    direction = compute_heading(state.nav_R_body) if direction is None else direction
    given = pseudo, np.zeros(15) if considered is None else considered, innovation, traces
    update_at_footfall(state.nav_R_body, P, x, k, direction, np.array(before, dtype=float), *given)
    return x, P, innovation, traces


@pytest.mark.parametrize(
    ("rows", "used"),
    [
        ([2], {"compass_variance": 0.01}),
        ([2], {"compass_variance": 0.01, "by_force": True}),
        ([0, 1], {"tilt_variance": 0.01}),
    ],
    ids=["compass", "compass by the force", "tilt"],
)
@pytest.mark.parametrize("seed", range(4))
def test_the_rows_of_compass_and_tilt_are_the_derivatives_of_their_residuals(rows, used, seed):
    truth, step = upright(seed), 1e-6
    pseudo = measure_at(truth, **used)
    for component in range(15):
        plus, minus = (
            update_at(with_error(truth, sign * step * np.eye(15)[component]), pseudo, np.eye(15))[3] for sign in (1, -1)
        )
        if "by_force" in used and component in (6, 7):
            continue  # a heading is not independent of tilt: the row leaves that out, and the tilt is small in a stance
        slope = (plus[rows, INNOVATION] - minus[rows, INNOVATION]) / (2 * step)
        np.testing.assert_allclose(slope, plus[rows, ROW + component], atol=1e-5)


@pytest.mark.parametrize("heading_deg", [0.0, 90.0, 179.9, -179.9, 180.0])
@pytest.mark.parametrize("error_deg", [-4.0, 4.0, -179.0, 179.0])
def test_compass_and_course_take_off_an_error_across_south_the_shorter_way(heading_deg, error_deg):
    heading = np.radians(heading_deg)
    truth = random_state(1, Rotation.from_euler("z", np.pi / 2 - heading).as_matrix())
    before = (heading + np.radians([-1.0, 1.0]) + np.pi) % (2 * np.pi) - np.pi
    for pseudo, known in (
        (measure_at(truth, compass_variance=1e-8), ()),
        (measure_at(truth, compass_variance=1e-8, by_force=True), ()),
        (course_of(3, 1e-4, limit_deg=6.0, strides=2), before),
    ):
        if len(known) == 0 or abs(error_deg) < 90.0:  # half a turn is a curve
            estimate = with_error(truth, np.radians(error_deg) * np.eye(15)[8])
            x, *_ = update_at(estimate, pseudo, SURE_BUT_OF_HEADING, known, len(known))
            assert np.degrees(x[8]) == pytest.approx(error_deg, abs=0.01)
            inject_error(estimate, x)
            assert np.abs(error_of(estimate, truth)[8]) < np.radians(0.01)


@pytest.mark.parametrize(("change_deg", "used"), [(0.0, True), (3.9, True), (4.1, False), (-3.9, True), (-4.1, False)])
def test_a_curve_says_nothing(change_deg, used):
    P, before = random_covariance(3), [0.5 - np.radians(change_deg)] * 2
    x, after, innovation, _ = update_at(upright(3), course_of(3, 0.1, 4.0, 2), P, before, k=2, direction=0.5)
    assert np.isfinite(innovation[COURSE]) == used
    if not used:
        assert not x.any()
        np.testing.assert_array_equal(after, P)


def test_a_foot_that_is_shifted_about_has_no_course():
    assert np.isnan(compute_direction(np.eye(3), np.array([0.1, 0.2, 1.0]), True))
    assert compute_direction(np.eye(3), np.array([1.0, 0.0, 0.0]), True) == pytest.approx(np.pi / 2)
    assert compute_direction(np.eye(3), np.array([0.0, 1.0, 0.0]), False) == pytest.approx(np.pi / 2)
    for before, direction in (([np.nan, 0.5], 0.5), ([0.5, 0.5], np.nan)):
        _, _, innovation, _ = update_at(upright(4), course_of(3, 0.1, 60.0, 2), np.eye(15), before, 2, direction)
        assert np.isnan(innovation[COURSE])


@pytest.mark.parametrize(("limit", "used"), [(6.0, True), (3.0, False)])
def test_a_considered_variance_counts_in_the_test_and_enters_with_the_compass(limit, used):
    """40 deg off with a sigma of 20 deg set considered and 10 deg of the compass: z^2 / S = 1600 / 500."""
    truth, square = upright(4), np.radians(10.0) ** 2
    pseudo = measure_at(truth, compass_variance=square, compass_limit=limit, agreement=square)
    P, considered = 1e-6 * np.eye(15), np.zeros(15)
    considered[[0, 8]] = 5.0, np.radians(20.0)
    estimate = with_error(truth, np.radians(40.0) * np.eye(15)[8])
    x, after, innovation, _ = update_at(estimate, pseudo, P, considered=considered)
    assert innovation[AGREEMENT] == pytest.approx(np.sqrt(3.2), rel=1e-2)
    assert np.isfinite(innovation[COMPASS]) == used
    assert np.any(considered) != used
    if used:
        assert x[8] == pytest.approx(np.radians(40.0) * 400 / 500, rel=1e-2)
        assert x[0] == pytest.approx(5.0 * x[8] / np.radians(20.0), rel=1e-2)
    else:
        np.testing.assert_array_equal(after, P)


@pytest.mark.parametrize(
    ("off_deg", "own_deg", "use_own_variance", "used"),
    [(4.0, 0.1, True, True), (6.0, 0.1, True, False), (6.0, 5.0, True, True), (6.0, 5.0, False, False)],
)
def test_the_compass_is_tested_against_the_heading_and_its_variance(off_deg, own_deg, use_own_variance, used):
    """Agreement to 2.5 deg and a limit of 4: two sigma, 5 deg where the heading is sure."""
    truth, P = upright(6), np.eye(15) * 1e-4
    test = {"compass_limit": 4.0, "agreement": np.radians(2.5) ** 2, "use_own_variance": use_own_variance}
    P[8, 8] = np.radians(own_deg) ** 2
    estimate = with_error(truth, np.radians(off_deg) * np.eye(15)[8])
    _, after, innovation, _ = update_at(estimate, measure_at(truth, compass_variance=0.01, **test), P)
    assert np.isfinite(innovation[COMPASS]) == (innovation[AGREEMENT] ** 2 < 4.0) == used
    assert used == (after[8, 8] < P[8, 8])


TIMES, FOOTFALLS = 300, 12
SIGMA = np.radians([0.5, 0.5, 4.0])
COMPASS_SIGMA, TILT_SIGMA, COURSE_SIGMA = np.radians([5.0, 1.0, 2.0])


def drawn_state(rng, sigma):
    """Truth, estimate and P of a foot whose attitude is as unsure as this."""
    truth, P = upright(int(rng.integers(1 << 30))), np.eye(15) * 1e-12
    P[6:9, 6:9] = np.diag(np.square(sigma))
    return truth, with_error(truth, np.sqrt(np.diag(P)) * rng.standard_normal(15)), P


def test_attitude_errors_and_innovations_are_as_large_as_claimed():
    rng, missed, nees, squares = np.random.default_rng(8), np.radians([0.1, 0.1, 0.5]), [], []
    for _ in range(TIMES):
        truth, estimate, P = drawn_state(rng, SIGMA)
        for _ in range(FOOTFALLS):
            turned = Rotation.from_rotvec(missed * rng.standard_normal(3)).as_matrix()
            truth.nav_R_body[:] = turned @ truth.nav_R_body  # what the gyro missed
            P[6:9, 6:9] += np.diag(missed**2)
            pseudo = measure_at(truth, compass_variance=COMPASS_SIGMA**2, tilt_variance=TILT_SIGMA**2)
            tilt, north = TILT_SIGMA * rng.standard_normal(3) * [1, 1, 0], COMPASS_SIGMA * rng.standard_normal()
            for given, rotvec, vector in (
                (pseudo.body_force, tilt, FORCE),
                (pseudo.body_field, [0.0, 0.0, north], NAV_FIELD),
            ):
                given[0] = truth.nav_R_body.T @ Rotation.from_rotvec(rotvec).as_matrix() @ vector
            x, P, innovation, _ = update_at(estimate, pseudo, P)
            inject_error(estimate, x)
            squares.append(innovation**2)
        e = error_of(estimate, truth)[6:9]
        nees.append(e @ np.linalg.solve(P[6:9, 6:9], e))
    mean = np.mean(squares, axis=0)
    for found, dof, draws in (
        (np.mean(nees), 3, TIMES),
        (mean[COMPASS], 1, len(squares)),
        (2 * mean[TILT], 2, len(squares)),
    ):
        low, high = bounds(dof, draws)
        assert low < found < high


def test_a_course_known_from_elsewhere_is_used_with_its_sigma():
    """The update itself; a filter holds its heading against its own earlier ones, which HDR takes for known."""
    rng, scores, squares = np.random.default_rng(9), [], []
    for _ in range(TIMES):
        truth, estimate, P = drawn_state(rng, [1e-6, 1e-6, SIGMA[2]])
        truth.nav_R_body[:] = Rotation.from_euler("z", rng.uniform(-np.pi, np.pi)).as_matrix()
        estimate = with_error(truth, SIGMA[2] * rng.standard_normal() * np.eye(15)[8])
        for _ in range(FOOTFALLS):
            seen = compute_heading(truth.nav_R_body) + COURSE_SIGMA * rng.standard_normal()
            x, P, innovation, _ = update_at(estimate, course_of(2, COURSE_SIGMA), P, [seen], 1)
            inject_error(estimate, x)
            squares.append(innovation[COURSE] ** 2)
        scores.append(error_of(estimate, truth)[8] ** 2 / P[8, 8])
    for values in (scores, squares):
        low, high = bounds(1, len(values))
        assert low < np.mean(values) < high


# velocity in stance, and the fair opponent: the same beliefs as the factor graph


def velocity_nis(velocity=np.zeros(3), R=np.eye(3), acc=(0.0, 0.0, 9.80665), gyr=np.zeros(3), **changed):
    state = NavState(np.zeros(3), velocity, R, np.zeros(3), np.zeros(3))
    _, noise = make_noise_models(replace(MATCHED, **changed))
    P, traces = 1e-8 * np.eye(15), np.empty((3, 17))
    return update_in_stance(state, P, np.zeros(15), np.array(acc), gyr, 0.005, noise, traces), noise


def test_the_lever_gives_the_velocity_that_the_foot_has():
    """v = R (w x l) of a foot that is turned every way: no innovation is left, and with the sign turned much is."""
    R = Walk().attitude(np.array([2.3]))[0]
    w, lever = np.random.default_rng(3).standard_normal(3), np.array([0.02, -0.04, 0.09])
    right, wrong = (
        velocity_nis(R @ np.cross(w, lever), R, gyr=w, rolling_lever_m=tuple((s * lever).tolist()), roll_sigma_m=0.0)[0]
        for s in (1, -1)
    )
    assert right == pytest.approx(0.0, abs=1e-20)
    assert wrong > 10.0


def test_a_foot_that_rolls_has_the_velocity_of_its_height_and_a_sigma_that_grows_with_its_rate():
    """v = (R w) x (0, 0, height), upright in nav however the sensor sits; the rest of the lever is noise."""
    R, w, height = Rotation.from_rotvec([0.3, -0.8, 2.0]).as_matrix(), np.array([0.5, -0.7, 0.9]), 0.07
    moved = np.cross(R @ w, [0.0, 0.0, height])
    nis, noise = velocity_nis(moved, R, gyr=w, roll_height_m=height, rolling_lever_m=None)
    assert nis == pytest.approx(0.0, abs=1e-20)
    off = np.array([0.02, 0.01, -0.01])
    for rate in (w, 2.0 * w):
        v = off + np.cross(R @ rate, [0.0, 0.0, height])
        nis, _ = velocity_nis(v, R, gyr=rate, roll_height_m=height, rolling_lever_m=None)
        assert nis == pytest.approx(off @ off / ((noise.floor + noise.rolling * rate @ rate) / 0.005 + 1e-8))


def test_a_foot_that_is_pushed_has_a_larger_sigma():
    (still, noise), (up, _), (down, _) = (
        velocity_nis(np.array([0.02, 0.0, 0.0]), acc=(0.0, 0.0, 9.80665 + push), rolling_lever_m=(0.0, 0.0, 0.0))
        for push in (0.0, 1.0, -1.0)
    )
    assert up == pytest.approx(still * noise.floor / (noise.floor + noise.unsteady), rel=0.02)
    assert down == pytest.approx(up)


def test_it_assumes_what_the_graph_assumes_and_a_stance_carries_the_information_of_its_factors():
    """Of a stance as long as those of the simulated walks: sum of 1 / sigma^2 over factors, and over samples."""
    there = SmootherParameters()
    same = "acc_density gyr_relative_density saturated_share roll_sigma_m unsteady_s gravity rest tilt_sigma_deg"
    for name in (*same.split(), "gyro_bias_sigma_deg_s", "gyro_bias_walk_deg_s"):
        assert getattr(MATCHED, name) == getattr(there, name), name
    assert MATCHED.gyr_density_deg == there.gyr_density_deg_s
    assert MATCHED.acc_relative_density == FORCE_SHARE * there.acc_relative_density
    assert MATCHED.tilt_sigma_rest_deg == there.tilt_sigma_deg
    assert (strides.ACC_BIAS_SIGMA, strides.ACC_BIAS_WALK) == (ACC_BIAS_SIGMA, ACC_BIAS_WALK)
    recording, stances = Walk(strides=10, stance_s=0.24).recording(200.0)
    information = np.count_nonzero(place_nodes(recording, stances, there).interval > 0) / VELOCITY_SIGMA**2
    _, noise = make_noise_models(MATCHED)
    samples = np.count_nonzero(stances.mask[stances.start[1] :])
    assert samples * recording.period_s / noise.floor == pytest.approx(information, rel=0.1)
    assert noise.rolling / noise.floor == pytest.approx((there.roll_sigma_m / VELOCITY_SIGMA) ** 2)
    assert noise.unsteady / noise.floor == pytest.approx((there.unsteady_s / VELOCITY_SIGMA) ** 2)
    assert FACTOR_SPACING_S == 0.08
