"""What a footfall says of the attitude: rows of H against differences, and what is left alone."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from fg_nav.ekf.measurements import (
    AGREEMENT,
    COMPASS,
    COURSE,
    TILT,
    compute_direction,
    compute_heading,
    make_pseudo_measurements,
    update_at_footfall,
)
from fg_nav.ekf.update import INNOVATION, ROW, inject_error
from tests.ekf.errors import error_of, random_covariance, random_state, with_error

NAV_FIELD = np.array([2.0, 21.0, -43.0])  # uT, with a declination of its own.

DECLINATION = np.arctan2(NAV_FIELD[0], NAV_FIELD[1])
FORCE = np.array([0.0, 0.0, 9.81])
STEP = 1e-6


def upright(rng):
    """A state tilted by up to a quarter of a turn, with any heading."""
    state = random_state(rng)
    tilt = Rotation.from_euler("xy", rng.uniform(-0.8, 0.8, 2))
    state.nav_R_body[:] = (Rotation.from_euler("z", rng.uniform(-np.pi, np.pi)) * tilt).as_matrix()
    return state


def measure_at(truth, **used):
    """PseudoMeasurements of one footfall, as a perfect sensor in this state has it."""
    R = truth.nav_R_body
    return make_pseudo_measurements(1)._replace(
        body_field=(R.T @ NAV_FIELD)[None], body_force=(R.T @ FORCE)[None], declination=DECLINATION, **used
    )


def update_at(state, pseudo, P, before=(), k=0, direction=None, considered=None):
    """Returns x, P, innovation and traces after the footfall."""
    x, P, innovation, traces = np.zeros(15), P.copy(), np.full(4, np.nan), np.zeros((3, 32))
    direction = compute_heading(state.nav_R_body) if direction is None else direction
    considered = np.zeros(15) if considered is None else considered
    update_at_footfall(
        state.nav_R_body, P, x, k, direction, np.array(before, dtype=float), pseudo, considered, innovation, traces
    )
    return x, P, innovation, traces


@pytest.mark.parametrize("levelled", ["by the attitude", "by the force"])
@pytest.mark.parametrize("seed", range(4))
def test_the_row_of_the_compass_is_the_derivative_of_its_residual(levelled, seed):
    truth = upright(np.random.default_rng(seed))
    pseudo = measure_at(truth, compass_variance=np.array([0.01]))
    if levelled == "by the force":
        pseudo = pseudo._replace(compass_heading=np.array([compute_heading(truth.nav_R_body) - DECLINATION]))
    for component in range(15):
        traces = []
        for sign in (1, -1):
            estimate = with_error(truth, sign * STEP * np.eye(15)[component])
            traces.append(update_at(estimate, pseudo, np.eye(15))[3][2])
        slope = (traces[0][INNOVATION] - traces[1][INNOVATION]) / (2 * STEP)
        if levelled == "by the force" and component in (6, 7):
            # a heading is not independent of tilt: the row leaves that out, and the tilt is small in a stance
            continue
        np.testing.assert_allclose(slope, traces[0][ROW + component], atol=1e-5)


@pytest.mark.parametrize("seed", range(4))
def test_the_rows_of_the_tilt_are_the_derivatives_of_their_residuals(seed):
    truth = upright(np.random.default_rng(seed))
    pseudo = measure_at(truth, tilt_variance=np.array([0.01]))
    for component in range(15):
        traces = [
            update_at(with_error(truth, sign * STEP * np.eye(15)[component]), pseudo, np.eye(15))[3] for sign in (1, -1)
        ]
        for axis in (0, 1):
            slope = (traces[0][axis][INNOVATION] - traces[1][axis][INNOVATION]) / (2 * STEP)
            np.testing.assert_allclose(slope, traces[0][axis][ROW + component], atol=1e-5)


@pytest.mark.parametrize("heading_deg", [0.0, 90.0, 179.9, -179.9, 180.0])
@pytest.mark.parametrize("error_deg", [-4.0, 4.0])
def test_compass_and_course_take_off_an_error_across_south(heading_deg, error_deg):
    truth = random_state(np.random.default_rng(1))
    truth.nav_R_body[:] = Rotation.from_euler("z", np.radians(90.0 - heading_deg)).as_matrix()
    error = np.zeros(15)
    error[8] = np.radians(error_deg)
    compass = measure_at(truth, compass_variance=np.array([1e-8]))
    course = make_pseudo_measurements(3)._replace(course_variance=np.full(3, 1e-8), course_limit=0.1, course_strides=2)
    both = np.radians([heading_deg - 1.0, heading_deg + 1.0])
    for pseudo, before, k in ((compass, (), 0), (course, (both + np.pi) % (2 * np.pi) - np.pi, 2)):
        estimate = with_error(truth, error)
        upright_for_sure = np.diag(np.append(np.full(8, 1e-12), np.ones(7)))
        x, *_ = update_at(estimate, pseudo, upright_for_sure, before, k)
        inject_error(estimate, x)
        assert np.abs(error_of(estimate, truth)[8]) < np.radians(0.01)


@pytest.mark.parametrize("error_deg", [-179.0, 179.0])
def test_a_heading_half_a_turn_off_is_turned_back_the_shorter_way(error_deg):
    truth = random_state(np.random.default_rng(1))
    truth.nav_R_body[:] = Rotation.from_euler("z", 0.3).as_matrix()
    compass, P = measure_at(truth, compass_variance=np.array([1e-8])), np.diag(np.append(np.full(8, 1e-12), np.ones(7)))
    x, *_ = update_at(with_error(truth, np.radians(error_deg) * np.eye(15)[8]), compass, P)
    assert np.degrees(x[8]) == pytest.approx(error_deg, abs=0.01)


@pytest.mark.parametrize(("change_deg", "used"), [(0.0, True), (3.9, True), (4.1, False), (-3.9, True), (-4.1, False)])
def test_a_curve_says_nothing(change_deg, used):
    rng = np.random.default_rng(3)
    state, P = upright(rng), random_covariance(rng)
    before = [0.5 - np.radians(change_deg)] * 2
    pseudo = make_pseudo_measurements(3)._replace(
        course_variance=np.full(3, 0.01), course_limit=float(np.radians(4.0)), course_strides=2
    )
    x, after, innovation, _ = update_at(state, pseudo, P, before, k=2, direction=0.5)
    assert np.isfinite(innovation[COURSE]) == used
    if not used:
        assert not x.any()
        np.testing.assert_array_equal(after, P)


@pytest.mark.parametrize("missing", ["direction", "before"])
def test_a_foot_that_is_shifted_about_has_no_course(missing):
    assert np.isnan(compute_direction(np.eye(3), np.array([0.1, 0.2, 1.0]), True))
    assert compute_direction(np.eye(3), np.array([1.0, 0.0, 0.0]), True) == pytest.approx(np.pi / 2)
    assert compute_direction(np.eye(3), np.array([0.0, 1.0, 0.0]), False) == pytest.approx(np.pi / 2)
    pseudo = make_pseudo_measurements(3)._replace(course_variance=np.full(3, 0.01), course_limit=1.0, course_strides=2)
    before, direction = ([np.nan, 0.5], 0.5) if missing == "before" else ([0.5, 0.5], np.nan)
    _, _, innovation, _ = update_at(random_state(np.random.default_rng(4)), pseudo, np.eye(15), before, 2, direction)
    assert np.isnan(innovation[COURSE])


@pytest.mark.parametrize(("limit", "used"), [(6.0, True), (3.0, False)])
def test_a_considered_variance_counts_in_the_test_and_enters_with_the_compass(limit, used):
    """40 deg off with a sigma of 20 deg set considered and 10 deg of the compass: z^2 / S = 1600 / 500."""
    rng = np.random.default_rng(4)
    truth = upright(rng)
    sigma = np.radians(10.0)
    test = {"compass_variance": np.array([sigma**2]), "compass_limit": np.array([limit]), "agreement": sigma**2}
    estimate = with_error(truth, np.radians(40.0) * np.eye(15)[8])
    P, considered = 1e-6 * np.eye(15), np.zeros(15)
    considered[[0, 8]] = 5.0, np.radians(20.0)
    x, after, innovation, _ = update_at(estimate, measure_at(truth, **test), P, considered=considered)
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
    truth = upright(np.random.default_rng(6))
    pseudo = measure_at(
        truth,
        compass_variance=np.array([0.01]),
        compass_limit=np.array([4.0]),
        agreement=float(np.radians(2.5)) ** 2,
        use_own_variance=use_own_variance,
    )
    error = np.zeros(15)
    error[8] = np.radians(off_deg)
    P = np.eye(15) * 1e-4
    P[8, 8] = np.radians(own_deg) ** 2
    _, after, innovation, _ = update_at(with_error(truth, error), pseudo, P)
    assert np.isfinite(innovation[COMPASS]) == used
    assert (innovation[AGREEMENT] ** 2 < 4.0) == used
    assert used == (after[8, 8] < P[8, 8])


RUNS, FOOTFALLS = 300, 12
SIGMA = np.radians([0.5, 0.5, 4.0])
COMPASS_SIGMA, TILT_SIGMA = np.radians(5.0), np.radians(1.0)
SURE = 0.999


def drawn_from_the_priors():
    """NEES of the attitude (runs,) and squared innovations (runs * footfalls, 4)."""
    rng = np.random.default_rng(8)
    nees, squares = [], []
    for _ in range(RUNS):
        truth, P = upright(rng), np.eye(15) * 1e-12
        P[6:9, 6:9] = np.diag(SIGMA**2)
        estimate = with_error(truth, np.sqrt(np.diag(P)) * rng.standard_normal(15))
        for _ in range(FOOTFALLS):
            turned = rng.standard_normal(3) * np.radians([0.1, 0.1, 0.5])
            truth.nav_R_body[:] = Rotation.from_rotvec(turned).as_matrix() @ truth.nav_R_body  # what the gyro missed
            P[6:9, 6:9] += np.diag(np.radians([0.1, 0.1, 0.5]) ** 2)
            variances = np.array([COMPASS_SIGMA**2]), np.array([TILT_SIGMA**2])
            pseudo = measure_at(truth, compass_variance=variances[0], tilt_variance=variances[1])
            noise = np.array([*(TILT_SIGMA * rng.standard_normal(2)), 0.0])
            tilted = truth.nav_R_body.T @ Rotation.from_rotvec(noise).as_matrix() @ FORCE
            north = Rotation.from_rotvec([0.0, 0.0, COMPASS_SIGMA * rng.standard_normal()]).as_matrix()
            pseudo.body_force[0], pseudo.body_field[0] = tilted, truth.nav_R_body.T @ north @ NAV_FIELD
            x, P, innovation, _ = update_at(estimate, pseudo, P)
            inject_error(estimate, x)
            squares.append(innovation**2)
        e = error_of(estimate, truth)[6:9]
        nees.append(e @ np.linalg.solve(P[6:9, 6:9], e))
    return np.array(nees), np.array(squares)


def bounds(dof, draws):
    return chi2.ppf([(1 - SURE) / 2, (1 + SURE) / 2], dof * draws) / draws


def test_attitude_errors_and_innovations_are_as_large_as_claimed():
    nees, squares = drawn_from_the_priors()
    assert bounds(3, RUNS)[0] < nees.mean() < bounds(3, RUNS)[1]
    low, high = bounds(1, RUNS * FOOTFALLS)
    assert low < squares[:, COMPASS].mean() < high
    low, high = bounds(2, RUNS * FOOTFALLS)
    assert low < 2 * squares[:, TILT].mean() < high


def test_a_course_known_from_elsewhere_is_used_with_its_sigma():
    """The update itself; a filter holds its heading against its own earlier ones, which HDR takes for known."""
    rng, sigma, scores, squares = np.random.default_rng(9), np.radians(2.0), [], []
    pseudo = make_pseudo_measurements(2)._replace(
        course_variance=np.full(2, sigma**2), course_limit=np.pi, course_strides=1
    )
    for _ in range(RUNS):
        truth, P = upright(rng), np.eye(15) * 1e-12
        truth.nav_R_body[:] = Rotation.from_euler("z", rng.uniform(-np.pi, np.pi)).as_matrix()
        P[8, 8] = SIGMA[2] ** 2
        estimate = with_error(truth, np.sqrt(np.diag(P)) * rng.standard_normal(15))
        for _ in range(FOOTFALLS):
            seen = compute_heading(truth.nav_R_body) + sigma * rng.standard_normal()
            x, P, innovation, _ = update_at(estimate, pseudo, P, [seen], 1)
            inject_error(estimate, x)
            squares.append(innovation[COURSE] ** 2)
        scores.append(error_of(estimate, truth)[8] ** 2 / P[8, 8])
    for values in (scores, squares):
        low, high = bounds(1, len(values))
        assert low < np.mean(values) < high
