"""Iron from all headings in a plane and from all directions, against sensors whose iron is known, and Ma (4)-(12)."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import polar

from fg_nav.calibration import UPPER, ellipsoid
from fg_nav.calibration.ellipsoid import (
    UNKNOWN_UT,
    Ellipse,
    calibrate_on_loop,
    fit_constrained_quadric,
    fit_ellipse,
    fit_ellipsoid,
    fit_unit_sphere,
    measure_coverage,
)
from fg_nav.errors import CalibrationError
from fg_nav.frames import yaw_rotation
from fg_nav.lab.reproduce.ma2018 import find_ellipse_as_printed, find_ellipse_by_extremes
from fg_nav.magnetic import FootfallField
from fg_nav.magnetic.footfall_field import compute_field_heading, compute_level_R_body, rotate_to_level

OFFSET, ETA, TAU = np.array([13.795, 7.526]), 0.973, 0.896  # Ma et al. 2018, Table 1
HORIZONTAL = 20.0
ROUND = np.arange(86) * 2 * np.pi * 6 / 86.4  # six circles of 25 deg a stride


def half_turn(angle):
    return (angle + np.pi / 2) % np.pi - np.pi / 2


def read_loop(heading, eta=ETA, tau=TAU, noise_uT=0.0, seed=0):
    """Levelled readings (F, 2) of a foot with these headings: x axis forward, so north lies `heading` to the left."""
    field = HORIZONTAL * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    long_axis = np.array([np.cos(eta), np.sin(eta)])
    soft = np.eye(2) + (1 / tau - 1) * np.outer(long_axis, long_axis)
    return field @ soft.T + OFFSET + noise_uT * np.random.default_rng(seed).standard_normal(field.shape)


def footfalls(level_R_body_, vertical=-43.0, heading=ROUND, readings=None):
    """Footfalls of a foot that stands with this tilt, its iron, or its readings (F, 2), given in levelled axes."""
    readings = read_loop(heading) if readings is None else readings
    level = np.column_stack([readings, np.full(len(heading), vertical)])
    nav_R_body = np.stack([yaw_rotation(np.pi / 2 - angle) for angle in heading]) @ level_R_body_
    n = len(heading)
    ones = np.ones(n)
    measured = level @ level_R_body_, 9.8 * nav_R_body[:, 2], nav_R_body
    return FootfallField(np.arange(n), ones, *measured, np.full(n, 9), ones, ones, ones, np.ones((n, 3)))


@pytest.mark.parametrize(("eta", "tau"), [(0.973, 0.896), (-1.2, 0.7), (0.0, 0.95), (1.5, 0.5)])
@pytest.mark.parametrize("method", [fit_ellipse, find_ellipse_by_extremes])
def test_what_was_put_in_comes_out(method, eta, tau):
    found = method(read_loop(np.arange(3600) * 2 * np.pi / 3600, eta=eta, tau=tau))
    assert found.offset_uT == pytest.approx(OFFSET, abs=1e-3)
    assert half_turn(found.eta_rad - eta) == pytest.approx(0.0, abs=2e-3)
    assert (found.tau, found.radius_uT) == pytest.approx((tau, HORIZONTAL), rel=1e-4)


def test_eq_6_needs_the_full_round_and_eq_7_the_centre():
    """Extremes are wrong as soon as an end of the ellipse is missing, and about the origin those of the offset."""
    part = read_loop(np.deg2rad(np.linspace(50.0, 330.0, 80)))
    assert np.abs(find_ellipse_by_extremes(part).offset_uT - OFFSET).max() > 1.0
    assert fit_ellipse(part).offset_uT == pytest.approx(OFFSET, abs=1e-3)
    whole = read_loop(np.linspace(0, 2 * np.pi, 3600))
    unevenly = read_loop(2 * np.pi * np.linspace(0, 1, 3600) ** 2)
    assert find_ellipse_by_extremes(unevenly).offset_uT == pytest.approx(OFFSET, abs=1e-3)
    ratios = [np.divide(*np.quantile(np.linalg.norm(whole - centre, axis=1), [0, 1])) for centre in (OFFSET, 0.0)]
    assert ratios[0] == pytest.approx(TAU, abs=1e-4)
    assert abs(ratios[1] - TAU) > 0.5


@pytest.mark.parametrize("heading", [ROUND, np.linspace(0.0, np.deg2rad(280.0), 60)], ids=["round", "a gap of 80 deg"])
def test_errors_on_a_loop_are_as_large_as_their_sigmas(heading):
    errors = []
    for seed in range(120):
        found = fit_ellipse(read_loop(heading, noise_uT=0.3, seed=seed))
        error = [*(found.offset_uT - OFFSET), half_turn(found.eta_rad - ETA), found.tau - TAU]
        errors.append(error / found.sigma)
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    assert (rms > 0.8).all(), rms
    assert (rms < 1.25).all(), rms


def test_wild_footfalls_do_not_matter_and_are_counted_and_nan_is_left_out():
    readings = read_loop(ROUND, noise_uT=0.3, seed=2)
    readings[::20] += 0.5 * (readings[::20] - OFFSET)
    assert np.abs(find_ellipse_by_extremes(readings).offset_uT - OFFSET).max() > 1.0  # what the printed method finds
    readings[[3, 43]] = np.nan
    found = fit_ellipse(readings)
    assert np.abs(found.offset_uT - OFFSET).max() < 0.3
    assert abs(found.tau - TAU) < 0.02
    assert found.samples == 79
    assert "5 of 84 footfalls" in found.notes[0]


def test_the_long_axis_of_a_circle_is_not_known_and_its_sigma_says_so():
    sigmas = []
    for tau in (0.8, 0.95, 0.999):
        readings = read_loop(ROUND, tau=tau, noise_uT=0.3, seed=3)
        found, _ = calibrate_on_loop(footfalls(np.eye(3), vertical=0.0, readings=readings))
        sigmas.append(found.sigma[2])  # what it does to the field, (1 - tau) eta, stays as well known
        assert (1 - found.tau) * found.sigma[2] == pytest.approx(0.3 / HORIZONTAL * np.sqrt(2 / 86), rel=0.3)
    assert sigmas[0] < 0.04 < sigmas[1] < 0.3 < sigmas[2]
    assert "eta of the long axis is not known" in found.notes[-1]
    exact = fit_ellipse(read_loop(ROUND, tau=1.0))
    assert exact.tau == pytest.approx(1.0, abs=1e-9)
    assert np.isfinite(exact.in_body(np.array([0.0, 0.0, 1.0])).covariance).all()


def test_walking_the_same_circle_again_does_not_average_the_floor_away():
    """Iron in the floor, the same at each heading: sixty circles tell no more of the offset than six."""
    sigmas = []
    for circles in (6, 60):
        heading = np.arange(14 * circles) * 2 * np.pi / 14
        floor = 1.0 * np.cos(3 * heading)[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1)
        noise = 0.1 * np.random.default_rng(7).standard_normal((len(heading), 2))
        sigmas.append(fit_ellipse(read_loop(heading) + floor + noise).sigma[:2])
    assert sigmas[1] == pytest.approx(sigmas[0], rel=0.1)
    white = fit_ellipse(read_loop(heading, noise_uT=0.7, seed=8))
    assert (sigmas[1] > 4 * white.sigma[:2]).all()


def test_headings_that_do_not_go_round_are_refused_and_the_missing_arc_is_named():
    for start_deg in (0.0, 100.0, 250.0):
        heading = np.deg2rad(start_deg + np.linspace(0.0, 240.0, 60))
        with pytest.raises(CalibrationError, match=r"from \d+ to \d+ deg") as refusal:
            fit_ellipse(read_loop(heading, noise_uT=0.05, seed=4))
        words = str(refusal.value).split()
        first, last = float(words[words.index("from") + 1]), float(words[words.index("from") + 3])
        assert first == pytest.approx((start_deg + 240.0) % 360.0, abs=5.0)
        assert last == pytest.approx(start_deg % 360.0, abs=5.0)


def test_what_is_no_ellipse_is_refused():
    for readings, words in (
        (read_loop(ROUND[:6]), "6 footfalls with"),
        (read_loop(ROUND[:1]), "1 footfall with"),
        (0.01 * read_loop(ROUND), "strong over the ground"),
        (np.column_stack([np.arange(20.0), np.arange(20.0)]), "no ellipse|lie on no"),
        (np.zeros((20, 2)), "lie on no"),
        (read_loop(ROUND, noise_uT=6.0, seed=5), "open by"),
    ):
        with pytest.raises(CalibrationError, match=words):
            calibrate_on_loop(footfalls(np.eye(3), heading=ROUND[: len(readings)], readings=readings))
    with pytest.raises(CalibrationError, match="x axis stands upright"):
        calibrate_on_loop(footfalls(np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])))
    with pytest.raises(CalibrationError, match="covariance of a magnetometer calibration"):
        find_ellipse_as_printed(read_loop(ROUND)).in_body(np.array([0.0, 0.0, 1.0]))


def test_in_the_body_it_corrects_footfalls_at_the_tilt_it_was_found_at():
    R = compute_level_R_body(np.array([-0.4, 0.15, 0.9]))
    ellipse, calibration = calibrate_on_loop(footfalls(R))
    level = rotate_to_level(calibration.correct(footfalls(R).body_field), R[2])
    assert level[:, :2] == pytest.approx(HORIZONTAL * np.stack([np.cos(ROUND), np.sin(ROUND)], axis=1), abs=1e-6)
    assert level[:, 2] == pytest.approx(-43.0)
    assert calibration.strength_uT == pytest.approx(ellipse.radius_uT)
    assert "24 deg" in calibration.notes[-2]  # asin(0.4 / |up|) below level
    elsewhere = compute_level_R_body(np.array([0.0, 0.15, 0.9]))
    wrong = rotate_to_level(calibration.correct(footfalls(elsewhere).body_field), elsewhere[2])
    assert np.abs(compute_field_heading(wrong) - compute_field_heading(level)).max() > np.deg2rad(5.0)


def test_the_covariance_in_the_body_is_that_of_the_ellipse_turned():
    up = np.array([-0.4, 0.15, 0.9])
    noisy = read_loop(ROUND, noise_uT=0.3, seed=6)
    found = fit_ellipse(noisy)

    def parameters(x):
        return Ellipse("", x[:2], x[2], x[3], 1.0, np.eye(4), 0.0, 0).in_body(up).parameters

    middle = np.array([*found.offset_uT, found.eta_rad, found.tau])
    J = np.stack([(parameters(middle + e) - parameters(middle - e)) / 2e-5 for e in 1e-5 * np.eye(4)], axis=1)
    covariance = found.in_body(up).covariance
    vertical = np.append(up / np.linalg.norm(up), np.zeros(6))
    assert vertical @ covariance @ vertical == pytest.approx(UNKNOWN_UT**2)  # of which nothing is known
    seen = covariance - UNKNOWN_UT**2 * np.outer(vertical, vertical)
    assert seen == pytest.approx(J @ found.covariance @ J.T, rel=1e-4, abs=1e-10)
    assert found.in_body(up).parameters[3:] == pytest.approx(found.in_body(up).correction[UPPER])


def test_a_steady_error_of_levelling_is_in_the_covariance_of_a_walk():
    """A tilt of 3 mrad turns 43 uT of vertical field into 0.13 uT of offset, and no footfall shows it."""
    ellipse, _ = calibrate_on_loop(footfalls(np.eye(3)))
    assert ellipse.sigma[:2] == pytest.approx(0.003 * 43.0, rel=1e-3)
    tilted = compute_level_R_body(np.array([0.003, 0.0, 1.0]))
    found = fit_ellipse((footfalls(np.eye(3)).body_field @ tilted.T)[:, :2])
    assert abs(found.offset_uT[0] - OFFSET[0]) == pytest.approx(ellipse.sigma[0], rel=0.1)


BOTH_WAYS = np.concatenate([ROUND[:43], ROUND[43] - ROUND[:43]])


def on_floor(left, right, seed):
    """Footfalls of three circles each way, over floors that shift the readings by so much, uT."""
    field = footfalls(np.eye(3), heading=BOTH_WAYS)
    noise = 0.2 * np.random.default_rng(seed).standard_normal((86, 2))
    shift = np.where(np.arange(86)[:, None] < 43, right, left) + noise
    return replace(field, body_field=field.body_field + np.column_stack([shift, np.zeros(86)]))


def test_circles_to_the_left_and_to_the_right_show_what_the_floor_does(monkeypatch):
    """Its share of the offset, over many floors, is about as large as the sigma says; scatter alone says a sixth."""
    monkeypatch.setattr(ellipsoid, "MAX_SIGMA", 1.0)
    errors, sigmas, growth = [], [], []
    for seed in range(40):
        left, right = np.random.default_rng([seed, 1]).standard_normal((2, 2))
        found, calibration = calibrate_on_loop(on_floor(left, right, seed))
        errors.append(found.offset_uT - OFFSET)
        sigmas.append(found.sigma[:2])
        level = on_floor(0.0, 0.0, seed)  # where circles agree next to nothing changes
        growth.append(calibrate_on_loop(level)[0].sigma[3] / fit_ellipse(level.level_field[:, :2]).sigma[3])
    rms = np.sqrt(np.mean(np.square(errors))), np.sqrt(np.mean(np.square(sigmas)))
    assert rms[0] == pytest.approx(np.sqrt(0.5), rel=0.25)
    assert 0.5 < rms[1] / rms[0] < 1.5
    assert fit_ellipse(on_floor(left, right, 0).level_field[:, :2]).sigma[:2].max() < 0.4 * rms[0]
    assert min(growth) == pytest.approx(1.0)
    assert np.median(growth) < 1.3
    one_way = calibrate_on_loop(footfalls(np.eye(3)))[1]
    for one, is_told in ((one_way, True), (calibration, False)):
        assert any("no full circles both ways" in note for note in one.notes) == is_told


# Ma et al. 2018, equation by equation


def test_eq_8_as_printed_mirrors_the_axis_if_the_farthest_reading_has_negative_x():
    for farther, mirrored in ((0.0, False), (np.pi, True)):
        readings = np.vstack([read_loop(np.linspace(0, 2 * np.pi, 3600)), read_loop(np.array([ETA + farther]))])
        readings[-1] += 1e-3 * (readings[-1] - OFFSET)
        printed, ours = find_ellipse_as_printed(readings), find_ellipse_by_extremes(readings)
        assert half_turn(ours.eta_rad - ETA) == pytest.approx(0.0, abs=5e-3)
        assert printed.eta_rad == pytest.approx(-ETA if mirrored else ETA, abs=5e-3)
        assert np.std(np.linalg.norm(ours.correct(readings), axis=1)) < 0.01
        assert (np.std(np.linalg.norm(printed.correct(readings), axis=1)) > 0.5) == mirrored


def test_eq_9_to_12_are_our_correction():
    found = fit_ellipse(read_loop(ROUND))
    c, s = np.cos(found.eta_rad), np.sin(found.eta_rad)
    R = np.array([[c, s], [-s, c]])
    assert pytest.approx(np.array([[0.562, 0.827], [-0.827, 0.562]]), abs=1e-3) == R  # Table 1
    corrected = found.correct(read_loop(ROUND))
    assert corrected == pytest.approx((read_loop(ROUND) - found.offset_uT) @ R.T * [found.tau, 1.0] @ R)
    assert corrected == pytest.approx(HORIZONTAL * np.stack([np.cos(ROUND), np.sin(ROUND)], axis=1), abs=1e-6)


STRENGTH = 48.0


def directions(rng, count=400, within=None):
    """Unit vectors; within an angle (rad) of the z axis if given."""
    many = rng.standard_normal((count if within is None else 40 * count, 3))
    many /= np.linalg.norm(many, axis=1, keepdims=True)
    return many[:count] if within is None else many[many[:, 2] > np.cos(within)][:count]


def sensor(seed, noise_uT=0.5, count=400, within=None):
    """Readings, hard iron, and the symmetric correction that they can tell."""
    rng = np.random.default_rng(seed)
    hard, soft = 15.0 * rng.standard_normal(3), np.eye(3) + 0.06 * rng.standard_normal((3, 3))
    readings = STRENGTH * directions(rng, count, within) @ soft.T + hard
    return readings + noise_uT * rng.standard_normal(readings.shape), hard, polar(np.linalg.inv(soft))[1]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("within", [None, np.deg2rad(80.0)])
def test_exact_readings_give_the_exact_iron(seed, within):
    readings, hard, C = sensor(seed, noise_uT=0.0, within=within)
    known, unknown = fit_ellipsoid(readings, STRENGTH), fit_ellipsoid(readings)
    scale = np.cbrt(np.linalg.det(C))
    for found, strength, matrix in ((known, STRENGTH, C), (unknown, STRENGTH / scale, C / scale)):
        assert found.hard_iron_uT == pytest.approx(hard, abs=1e-5)
        assert found.correction == pytest.approx(matrix, abs=1e-6)
        assert found.strength_uT == pytest.approx(strength, rel=1e-6)
        assert np.linalg.norm(found.correct(readings), axis=1) == pytest.approx(strength, rel=1e-6)
    assert np.linalg.det(unknown.correction) == pytest.approx(1.0)


def test_with_the_strength_unknown_the_size_of_c_is_no_parameter():
    """Its covariance has no room for a change of the determinant: trace(C^-1 dC) = 0."""
    for strength, expected in ((None, 0.0), (STRENGTH, 0.5 / 20 / STRENGTH)):  # three numbers' worth, if known
        found = fit_ellipsoid(sensor(3)[0], strength)
        by_size = np.linalg.inv(found.correction)[UPPER] * np.where(UPPER[0] == UPPER[1], 1.0, 2.0)
        variance = by_size @ found.covariance[3:, 3:] @ by_size
        assert np.sqrt(max(variance, 0.0)) / 3 == pytest.approx(expected, rel=0.3, abs=1e-7)


@pytest.mark.parametrize(
    ("fit", "strength"), [(fit_ellipsoid, STRENGTH), (fit_ellipsoid, None), (fit_unit_sphere, STRENGTH)]
)
def test_errors_are_as_large_as_their_sigmas(fit, strength):
    errors = []
    for seed in range(60):
        readings, hard, C = sensor(seed)
        C = C / np.cbrt(np.linalg.det(C)) if strength is None else C
        found = fit(readings, strength)
        errors.append((found.parameters - np.concatenate([hard, C[UPPER]])) / found.sigma)
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    assert 0.85 < np.sqrt(np.mean(np.square(rms))) < 1.2
    assert rms.min() > 0.7
    assert rms.max() < 1.4
    assert fit_ellipsoid(sensor(2, count=4000)[0]).residual_uT == pytest.approx(0.5, rel=0.05)


@pytest.mark.parametrize("within", [None, np.deg2rad(90.0)])
def test_wild_readings_do_not_matter_and_are_counted(within, monkeypatch):
    readings, hard, C = sensor(4, within=within)
    wild = readings.copy()
    wild[::25] += 20.0 * np.random.default_rng(5).standard_normal((16, 3))
    wild = np.vstack([wild, np.full((100, 3), np.nan)])  # rows without a field are left out
    found, clean = fit_ellipsoid(wild, STRENGTH), fit_ellipsoid(readings, STRENGTH)
    error = (found.parameters - np.concatenate([hard, C[UPPER]])) / found.sigma
    assert np.abs(error).max() < 4.0
    assert found.sigma == pytest.approx(clean.sigma, rel=0.15)
    assert 380 <= found.samples <= 390
    assert "of all directions covered" in found.notes[0]
    assert f"{400 - found.samples} of 400 readings left out" in found.notes[1]
    monkeypatch.setattr(ellipsoid, "MAX_SIGMA", np.inf)
    monkeypatch.setattr(ellipsoid, "MAX_RESIDUAL", np.inf)
    assert np.abs(fit_unit_sphere(wild, STRENGTH).hard_iron_uT - hard).max() > 0.5  # which the sphere is spoilt by


def test_the_constraint_keeps_to_ellipsoids_where_plain_least_squares_finds_others():
    for seed in range(30):
        readings, _, _ = sensor(seed, noise_uT=1.0, count=100, within=np.deg2rad(35.0))
        assert np.linalg.eigvalsh(fit_constrained_quadric(readings)[1]).min() > 0.0


@pytest.mark.parametrize("strength", [STRENGTH, None])
def test_too_narrow_a_tumbling_is_refused_with_its_weakest_direction(strength, monkeypatch):
    rng = np.random.default_rng(10)
    up, angle = np.sin(np.deg2rad(rng.uniform(-6.0, 6.0, 400))), rng.uniform(0.0, 2 * np.pi, 400)
    flat = np.column_stack([np.sqrt(1 - up**2) * np.cos(angle), np.sqrt(1 - up**2) * np.sin(angle), up])
    readings = STRENGTH * flat + 0.5 * rng.standard_normal((400, 3))
    with pytest.raises(CalibrationError, match=r"weakest along \(.0\.0\d, .0\.0\d, [+-]1\.00\)"):
        fit_ellipsoid(readings, strength)
    readings = sensor(11, within=np.deg2rad(60.0))[0]
    found = fit_ellipsoid(readings, strength)
    monkeypatch.setattr(ellipsoid, "MAX_SIGMA", 0.5 * found.sigma[:3].max() / found.strength_uT)
    with pytest.raises(CalibrationError, match="open"):
        fit_ellipsoid(readings, strength)


BALL = STRENGTH * np.array([[0.0, 0.0, 1.0]]) + 0.3 * np.random.default_rng(5).standard_normal((2000, 3))
Z, ANGLE = np.random.default_rng(4).uniform([[-1.5], [0.0]], [[1.5], [2 * np.pi]], (2, 200))
HYPERBOLOID = 20.0 * np.column_stack([np.sqrt(1 + Z**2) * np.cos(ANGLE), np.sqrt(1 + Z**2) * np.sin(ANGLE), Z])
REFUSED = {
    "few": (np.ones((5, 3)), "5 whole readings"),
    "nan": (np.full((50, 3), np.nan), "0 whole readings"),
    "a place": (np.ones((50, 3)), "no ellipsoid"),
    "a plane": (sensor(0)[0] * [1.0, 1.0, 0.0], "no ellipsoid"),
    "a hyperboloid": (HYPERBOLOID, "no ellipsoid|of all directions covered|not the same everywhere|open"),
    "not turned": (BALL, "was it turned"),  # noise about one reading is a ball, and a ball is an ellipsoid
    "T": (1e-6 * sensor(0)[0], "readings in uT"),
    "small": (0.09 * sensor(0)[0], r"strong, .* readings in uT"),
    "nT": (1e3 * sensor(0)[0], r"strong, .* readings in uT"),
    "a cap": (sensor(0, within=np.deg2rad(25.0))[0], "of all directions covered"),
    "a field each": (sensor(13, noise_uT=4.0, count=4000)[0], "not the same everywhere"),
}


@pytest.mark.parametrize("what", REFUSED)
@pytest.mark.parametrize("fit", [fit_unit_sphere, fit_ellipsoid])
def test_what_is_no_ellipsoid_or_would_calibrate_wrongly_is_refused(fit, what):
    readings, words = REFUSED[what]
    with pytest.raises(CalibrationError, match=words):
        fit(readings)
    for strength in (0.0, -48.0, np.nan, np.inf):
        with pytest.raises(CalibrationError, match="is none"):
            fit(sensor(0)[0], strength)


@pytest.mark.parametrize("strength", [1.0, STRENGTH])
def test_exact_readings_come_to_lie_on_the_sphere(strength):
    readings, hard, C = sensor(0, noise_uT=0.0)
    found = fit_unit_sphere(readings, strength)
    assert found.hard_iron_uT == pytest.approx(hard, abs=1e-6)
    assert found.correction == pytest.approx(C * strength / STRENGTH, abs=1e-8)
    assert np.linalg.norm(found.correct(readings), axis=1) == pytest.approx(strength)
    assert found.strength_uT == strength
    scale, axes = np.linalg.eigh(found.correction)
    assert found.correct(hard + (axes / scale).T) == pytest.approx(axes.T, abs=1e-6)


def test_coverage_of_all_of_half_and_of_a_plane():
    rng = np.random.default_rng(12)
    everywhere = measure_coverage(STRENGTH * directions(rng, 5000))
    half = measure_coverage(directions(rng, 5000, within=np.pi / 2))
    plane = measure_coverage(directions(rng, 5000) * [1.0, 1.0, 1e-6])
    (share, _, weakest_share), (of_half, _, weakest_of_half), (_, across, of_plane) = everywhere, half, plane
    assert (share, weakest_share) == pytest.approx((1.0, 1.0), abs=0.05)
    assert 0.5 < of_half < 0.65  # patches on the rim count
    assert weakest_of_half == pytest.approx(1.0, abs=0.05)  # a half is weak on one side only
    assert of_plane == pytest.approx(0.0, abs=1e-6)
    assert np.abs(across) == pytest.approx([0.0, 0.0, 1.0], abs=1e-6)
