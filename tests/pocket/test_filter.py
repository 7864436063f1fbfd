"""The filter on a leg that swings by hand: what it sees, what it cannot, and what it does not hang on."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from fg_nav.errors import EstimationError
from fg_nav.lab.reproduce.munoz_diaz2017.as_printed import Misprints, estimate_as_printed
from fg_nav.pocket import PocketParameters, estimate_pocket
from fg_nav.pocket import filter as defaults
from tests.pocket.leg import BIAS, Leg, error_deg_s, moved_field, resting, start_of, walking

WIDE = PocketParameters(gyro_bias_sigma_deg_s=0.5, acc_sigma_m_s2=0.05)
GRAVITY_ALONE = replace(WIDE, field_update=False)
FIELD_ALONE = replace(WIDE, gravity_update=False)
NOISE = (np.radians(0.1), 0.03, 0.015)
RIGHT = Misprints(False, False, False)


@pytest.fixture(scope="module")
def walk():
    return walking(60.0)


@pytest.fixture(scope="module")
def noisy(walk):
    return walk.recording(sigma=NOISE)


@pytest.fixture(scope="module")
def steady(walk):
    """With noise of the magnetometer alone."""
    return walk.recording(sigma=(0, 0, 0.015))


def tilt_deg(track, leg):
    cosine = np.einsum("ni,ni->n", track.nav_R_body[:, 2], leg.attitude[:-1, 2])
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def test_gravity_shows_the_level_biases_and_not_the_upright_one():
    leg = resting(180.0)
    track = estimate_pocket(leg.recording(field=None, sigma=NOISE), WIDE)
    R, covariance = track.nav_R_body[-1], track.covariance[-1, 3:, 3:]
    left, upright = R @ error_deg_s(track), (R @ np.degrees(BIAS))[2]
    sigma = np.degrees(np.sqrt(np.diag(R @ covariance @ R.T)))
    assert max(*np.abs(left[:2]), *sigma[:2]) < 0.01
    assert sigma[2] > 0.48
    assert abs(left[2] + upright) < 0.3 * sigma[2]  # nothing learnt
    assert not track.field_used.any()


def test_the_field_shows_all_three_to_a_leg_that_swings(walk, steady):
    track = estimate_pocket(steady, FIELD_ALONE, start_of(walk))
    assert np.abs(error_deg_s(track)).max() < 0.02
    assert np.isnan(track.gravity_nis).all()
    assert track.field_used[60:].all()


def test_angles_find_what_rotations_find(noisy):
    parameters = replace(WIDE, gravity_window_s=0.0)
    free = estimate_pocket(noisy, parameters)
    same, angles = (estimate_as_printed(noisy, parameters, misprints=RIGHT._replace(angles=e)) for e in (False, True))
    assert np.array_equal(same.gyro_bias, free.gyro_bias)
    assert np.degrees(np.abs(free.gyro_bias - angles.gyro_bias)[500:]).max() < 2e-3
    assert np.allclose(free.sigma[500:], angles.sigma[500:], rtol=0.05)


@pytest.mark.parametrize("facing", [0.0, np.pi / 2])
def test_the_turn_of_the_earth_is_a_bias_unless_removed(facing, monkeypatch):
    """At rest, heading known: gravity shows the level part of what is left, which is the Earth's to the north."""
    earth = 7.29e-5 * np.array([0.0, np.cos(np.radians(48.0)), np.sin(np.radians(48.0))])
    leg = resting(300.0, angles=(facing, 0.1, -0.2))
    recording = leg.recording(bias=np.zeros(3), field=None, nav_rate=earth)
    monkeypatch.setattr(defaults, "BIAS_INSTABILITY_DEG_H", 0.1)
    for latitude, expected in ((48.0, np.zeros(2)), (None, earth[:2])):
        quiet = replace(GRAVITY_ALONE, acc_sigma_m_s2=0.01, latitude_deg=latitude)
        track = estimate_pocket(recording, quiet, start_of(leg, tilt_sigma=1e-3))
        assert np.allclose((track.nav_R_body[-1] @ track.gyro_bias[-1])[:2], expected, atol=4e-6)


def test_a_slower_magnetometer_is_used_where_it_has_samples_and_not_across_a_gap(walk, steady):
    mag = steady.mag.copy()
    mag[np.arange(len(mag)) % 4 != 1] = np.nan
    mag[3000:3030] = np.nan
    track, there = estimate_pocket(replace(steady, mag=mag), FIELD_ALONE, start_of(walk)), np.isfinite(mag[:, 0])
    assert not track.field_used[~there].any()
    first = np.flatnonzero(there)[np.flatnonzero(there) > 3000][0]
    assert not track.field_used[first]
    assert np.delete(track.field_used, first)[np.delete(there, first)][15:].all()
    assert np.abs(error_deg_s(track)).max() < 0.02


def test_farther_apart_differences_learn_sooner(steady):
    """The noise of a difference is the same however long the bias had to turn it."""
    near, far = (estimate_pocket(steady, replace(FIELD_ALONE, shortest_difference_s=s)) for s in (0.0, 0.25))
    assert far.sigma[2000, 5] < near.sigma[2000, 5] / 3
    assert np.abs(error_deg_s(far)).max() < 0.02
    assert far.field_used.sum() == pytest.approx(len(far.t) / 25, rel=0.05)
    sixty = walking(20.0, rate_hz=60.0).recording()  # whose period does not divide the difference
    used = estimate_pocket(sixty, replace(FIELD_ALONE, shortest_difference_s=0.26)).field_used
    assert np.array_equal(np.diff(np.flatnonzero(used)), np.full(used.sum() - 1, 16))


def test_a_disturbance_is_left_out_unless_not_gated(walk, steady):
    bump = 8.0 * np.exp(-(((steady.t - 30.0) / 0.6) ** 2))
    passed = moved_field(steady, walk, np.outer(bump, [1.0, 0.0, 0.5]))
    gated, open_ = (estimate_pocket(passed, replace(FIELD_ALONE, field_gated=gate)) for gate in (True, False))
    assert not gated.field_used[2920:3080].any()
    assert open_.field_used[1:].all()
    worst = [np.degrees(np.abs(track.gyro_bias[2500:3500] - BIAS)).max() for track in (gated, open_)]
    assert worst[1] > 3 * worst[0]


def test_a_thigh_that_lies_level_ends_the_angles_and_not_the_filter():
    """A walker who sits down for ten seconds, the thigh lying level, and gets up: pitch through -90 deg."""
    leg = walking(20.0, curves=False)
    both = Rotation.concatenate([Rotation.from_matrix(leg.attitude[-1]), Rotation.from_euler("Y", -np.pi / 2)])
    down = Slerp([0.0, 1.0], both)(np.linspace(0.0, 1.0, 100)).as_matrix()
    seated = np.concatenate([down, np.tile(down[-1], (1000, 1, 1)), down[::-1]])
    leg = Leg(np.concatenate([leg.attitude, seated, leg.attitude[-1] @ leg.attitude[0].T @ leg.attitude]), leg.h)
    recording = leg.recording(sigma=NOISE)
    assert np.abs(leg.attitude[:, 2, 0]).max() > 0.9998
    track = estimate_pocket(recording, WIDE)
    assert tilt_deg(track, leg)[500:].max() < 1.5
    assert np.abs(error_deg_s(track)).max() < 0.03
    with pytest.raises(EstimationError, match=r"x axis is vertical at 2\d\.\d+ s, where the paper's Euler angles end"):
        estimate_as_printed(recording, WIDE, misprints=Misprints(difference=False, arctangent=False))


def test_the_filter_as_printed_is_led_astray(noisy):
    """MD (15): the field is turned the wrong way, and the leg's own turn is taken for bias."""
    assert np.abs(error_deg_s(estimate_pocket(noisy))).max() < 0.1
    for printed in (estimate_as_printed(noisy), estimate_as_printed(noisy, WIDE, misprints=Misprints(angles=False))):
        assert np.abs(error_deg_s(printed)).max() > 1.0


def test_the_printed_model_pulls_a_constant_bias_to_zero(noisy, monkeypatch):
    """MD (10): with a stationary deviation of B / sqrt(2) = 0.002 deg/s, 0.1 deg/s is no bias it allows."""
    monkeypatch.setattr(defaults, "BIAS_TIME_S", 10.0)
    kept, pulled = (estimate_pocket(noisy, replace(WIDE, bias_returns_to_zero=printed)) for printed in (False, True))
    assert np.abs(error_deg_s(kept)[2]) < 0.02
    assert np.abs(error_deg_s(pulled)[2]) > 0.08


def test_the_printed_roll_turns_over_a_sensor_worn_upside_down():
    """The start levels it right; each gravity update of MD (12) then asks for half a turn of roll."""
    leg = resting(20.0, angles=(0.0, 0.1, np.pi - 1e-4))  # roll is on both sides of half a turn
    recording, parameters = leg.recording(field=None), replace(GRAVITY_ALONE, gravity_window_s=0.0)
    right, printed = (
        tilt_deg(estimate_as_printed(recording, parameters, misprints=Misprints(arctangent=p)), leg)[-1]
        for p in (False, True)
    )
    assert right < 0.1
    assert printed > 90.0


def test_the_sampling_rate_does_not_change_the_gyroscope_s_part():
    """Noises of the gyroscope are densities: without a field, half the samples give the same sigmas."""
    fine, coarse = (
        estimate_pocket(walking(20.0, rate_hz=f).recording(field=None), GRAVITY_ALONE) for f in (100.0, 50.0)
    )
    assert np.allclose(fine.sigma[::2][50:], coarse.sigma[50:], rtol=0.02)


def test_parameters_that_cannot_be_are_refused():
    absurd = {"mag_sigma_uT": 0.0, "gravity_window_s": np.nan, "latitude_deg": 500.0, "shortest_difference_s": -0.1}
    for name, value in absurd.items():
        with pytest.raises(EstimationError, match=f"{name} of .* (cannot be|is none): give"):
            PocketParameters(**{name: value})
