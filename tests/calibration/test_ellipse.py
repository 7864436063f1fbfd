"""Ma's calibration in the levelled plane, against readings made from known iron, and the misprints of Ma (4)-(12)."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.calibration import UPPER, ellipsoid
from fg_nav.calibration.ellipsoid import UNKNOWN_UT, Ellipse, calibrate_on_loop, fit_ellipse
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


def turned(angle):
    return yaw_rotation(angle)[:2, :2]


def read(heading, eta=ETA, tau=TAU, noise_uT=0.0, seed=0):
    """Levelled readings (F, 2) of a foot with these headings: x axis forward, so north lies `heading` to the left."""
    field = HORIZONTAL * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    long_axis = np.array([np.cos(eta), np.sin(eta)])
    soft = np.eye(2) + (1 / tau - 1) * np.outer(long_axis, long_axis)
    return field @ soft.T + OFFSET + noise_uT * np.random.default_rng(seed).standard_normal(field.shape)


def footfalls(level_R_body_, vertical=-43.0, heading=ROUND, readings=None):
    """Footfalls of a foot that stands with this tilt, its iron, or its readings (F, 2), given in levelled axes."""
    readings = read(heading) if readings is None else readings
    level = np.column_stack([readings, np.full(len(heading), vertical)])
    nav_R_body = np.stack([yaw_rotation(np.pi / 2 - angle) for angle in heading]) @ level_R_body_
    n = len(heading)
    ones = np.ones(n)
    measured = level @ level_R_body_, 9.8 * nav_R_body[:, 2], nav_R_body
    return FootfallField(np.arange(n), ones, *measured, np.full(n, 9), ones, ones, ones, np.ones((n, 3)))


@pytest.mark.parametrize(("eta", "tau"), [(0.973, 0.896), (-1.2, 0.7), (0.0, 0.95), (1.5, 0.5)])
@pytest.mark.parametrize("method", [fit_ellipse, find_ellipse_by_extremes])
def test_what_was_put_in_comes_out(method, eta, tau):
    found = method(read(np.arange(3600) * 2 * np.pi / 3600, eta=eta, tau=tau))
    assert found.offset_uT == pytest.approx(OFFSET, abs=1e-3)
    assert half_turn(found.eta_rad - eta) == pytest.approx(0.0, abs=2e-3)
    assert (found.tau, found.radius_uT) == pytest.approx((tau, HORIZONTAL), rel=1e-4)


def test_eq_6_needs_the_full_round_and_eq_7_the_centre():
    """Extremes are wrong as soon as an end of the ellipse is missing, and about the origin those of the offset."""
    part = read(np.deg2rad(np.linspace(50.0, 330.0, 80)))
    assert np.abs(find_ellipse_by_extremes(part).offset_uT - OFFSET).max() > 1.0
    assert fit_ellipse(part).offset_uT == pytest.approx(OFFSET, abs=1e-3)
    whole = read(np.linspace(0, 2 * np.pi, 3600))
    ratios = [np.divide(*np.quantile(np.linalg.norm(whole - centre, axis=1), [0, 1])) for centre in (OFFSET, 0.0)]
    assert ratios[0] == pytest.approx(TAU, abs=1e-4)
    assert abs(ratios[1] - TAU) > 0.5


def test_a_turned_and_shifted_sensor_turns_and_shifts_the_ellipse():
    readings = read(ROUND, noise_uT=0.3, seed=1)
    one, other = fit_ellipse(readings), fit_ellipse(readings @ turned(0.7).T + [3.0, -40.0])
    assert other.offset_uT == pytest.approx(turned(0.7) @ one.offset_uT + [3.0, -40.0], abs=1e-4)
    assert half_turn(other.eta_rad - one.eta_rad - 0.7) == pytest.approx(0.0, abs=1e-4)
    assert (other.tau, other.residual_uT) == pytest.approx((one.tau, one.residual_uT), rel=1e-5)


@pytest.mark.parametrize("heading", [ROUND, np.linspace(0.0, np.deg2rad(280.0), 60)], ids=["round", "a gap of 80 deg"])
def test_errors_are_as_large_as_their_sigmas(heading):
    errors = []
    for seed in range(120):
        found = fit_ellipse(read(heading, noise_uT=0.3, seed=seed))
        error = [*(found.offset_uT - OFFSET), half_turn(found.eta_rad - ETA), found.tau - TAU]
        errors.append(error / found.sigma)
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    assert (rms > 0.8).all(), rms
    assert (rms < 1.25).all(), rms


def test_wild_footfalls_do_not_matter_and_are_counted_and_nan_is_left_out():
    readings = read(ROUND, noise_uT=0.3, seed=2)
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
        readings = read(ROUND, tau=tau, noise_uT=0.3, seed=3)
        found, _ = calibrate_on_loop(footfalls(np.eye(3), vertical=0.0, readings=readings))
        sigmas.append(found.sigma[2])  # what it does to the field, (1 - tau) eta, stays as well known
        assert (1 - found.tau) * found.sigma[2] == pytest.approx(0.3 / HORIZONTAL * np.sqrt(2 / 86), rel=0.3)
    assert sigmas[0] < 0.04 < sigmas[1] < 0.3 < sigmas[2]
    assert "eta of the long axis is not known" in found.notes[-1]
    exact = fit_ellipse(read(ROUND, tau=1.0))
    assert exact.tau == pytest.approx(1.0, abs=1e-9)
    assert np.isfinite(exact.in_body(np.array([0.0, 0.0, 1.0])).covariance).all()


def test_walking_the_same_circle_again_does_not_average_the_floor_away():
    """Iron in the floor, the same at each heading: sixty circles tell no more of the offset than six."""
    sigmas = []
    for circles in (6, 60):
        heading = np.arange(14 * circles) * 2 * np.pi / 14
        floor = 1.0 * np.cos(3 * heading)[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1)
        noise = 0.1 * np.random.default_rng(7).standard_normal((len(heading), 2))
        sigmas.append(fit_ellipse(read(heading) + floor + noise).sigma[:2])
    assert sigmas[1] == pytest.approx(sigmas[0], rel=0.1)
    white = fit_ellipse(read(heading, noise_uT=0.7, seed=8))
    assert (sigmas[1] > 4 * white.sigma[:2]).all()


def test_headings_that_do_not_go_round_are_refused_and_the_missing_arc_is_named():
    for start_deg in (0.0, 100.0, 250.0):
        heading = np.deg2rad(start_deg + np.linspace(0.0, 240.0, 60))
        with pytest.raises(CalibrationError, match=r"from \d+ to \d+ deg") as refusal:
            fit_ellipse(read(heading, noise_uT=0.05, seed=4))
        words = str(refusal.value).split()
        first, last = float(words[words.index("from") + 1]), float(words[words.index("from") + 3])
        assert first == pytest.approx((start_deg + 240.0) % 360.0, abs=5.0)
        assert last == pytest.approx(start_deg % 360.0, abs=5.0)


def test_what_is_no_ellipse_is_refused():
    for readings, words in (
        (read(ROUND[:6]), "6 footfalls with"),
        (read(ROUND[:1]), "1 footfall with"),
        (0.01 * read(ROUND), "strong over the ground"),
        (np.column_stack([np.arange(20.0), np.arange(20.0)]), "no ellipse|lie on no"),
        (np.zeros((20, 2)), "lie on no"),
        (read(ROUND, noise_uT=6.0, seed=5), "open by"),
    ):
        with pytest.raises(CalibrationError, match=words):
            calibrate_on_loop(footfalls(np.eye(3), heading=ROUND[: len(readings)], readings=readings))
    with pytest.raises(CalibrationError, match="x axis stands upright"):
        calibrate_on_loop(footfalls(np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])))
    with pytest.raises(CalibrationError, match="covariance of a magnetometer calibration"):
        find_ellipse_as_printed(read(ROUND)).in_body(np.array([0.0, 0.0, 1.0]))


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
    noisy = read(ROUND, noise_uT=0.3, seed=6)
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
    for seed in range(60):
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
        readings = np.vstack([read(np.linspace(0, 2 * np.pi, 3600)), read(np.array([ETA + farther]))])
        readings[-1] += 1e-3 * (readings[-1] - OFFSET)
        printed, ours = find_ellipse_as_printed(readings), find_ellipse_by_extremes(readings)
        assert half_turn(ours.eta_rad - ETA) == pytest.approx(0.0, abs=5e-3)
        assert printed.eta_rad == pytest.approx(-ETA if mirrored else ETA, abs=5e-3)
        assert np.std(np.linalg.norm(ours.correct(readings), axis=1)) < 0.01
        assert (np.std(np.linalg.norm(printed.correct(readings), axis=1)) > 0.5) == mirrored


def test_eq_9_to_12_are_our_correction():
    """Corrected readings point where the field does."""
    found = fit_ellipse(read(ROUND))
    c, s = np.cos(found.eta_rad), np.sin(found.eta_rad)
    R = np.array([[c, s], [-s, c]])
    assert pytest.approx(np.array([[0.562, 0.827], [-0.827, 0.562]]), abs=1e-3) == R  # Table 1
    corrected = found.correct(read(ROUND))
    assert corrected == pytest.approx((read(ROUND) - found.offset_uT) @ R.T * [found.tau, 1.0] @ R)
    assert corrected == pytest.approx(HORIZONTAL * np.stack([np.cos(ROUND), np.sin(ROUND)], axis=1), abs=1e-6)
