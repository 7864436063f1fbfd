"""The start: level, heading given or the compass's, in any position."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.errors import EstimationError
from fg_nav.frames import compute_heading
from fg_nav.pocket import compass_start, level_start
from fg_nav.pocket.filter import estimate_field_noise_uT
from tests.pocket.leg import resting, walking


@pytest.mark.parametrize("angles", [(0.3, 0.1, -0.2), (2.0, -1.2, 3.0), (-1.0, -np.pi / 2, 0.0)])
def test_a_sensor_at_rest_is_levelled_and_the_compass_finds_north(angles):
    leg = resting(5.0, angles=angles)
    start = compass_start(leg.recording())
    assert np.allclose(start.nav_R_body, leg.attitude[0], atol=1e-6)
    assert start.heading_sigma == pytest.approx(np.radians(10.0))  # a compass near houses


def test_heading_given_declination_and_tilt_of_the_start():
    rest, moving = resting(5.0).recording(), walking(10.0, still_s=0.0).recording()
    there, here = (compute_heading(compass_start(rest, declination=d).nav_R_body) for d in (0.1, 0.0))
    assert there - here == pytest.approx(0.1)
    level = level_start(rest, heading=1.2)
    assert compute_heading(level.nav_R_body) == pytest.approx(1.2)
    assert level_start(moving).tilt_sigma > 5 * level.tilt_sigma


def test_the_noise_of_the_magnetometer_is_estimated_at_rest_and_while_the_leg_swings():
    rng = np.random.default_rng(4)
    for leg in (resting(30.0), walking(30.0)):
        for sigma_uT in (0.05, 0.5):
            recording = leg.recording(sigma=(0.0, 0.0, sigma_uT), seed=rng.integers(1000))
            assert 0.85 * sigma_uT < estimate_field_noise_uT(recording) < 1.3 * np.hypot(sigma_uT, 0.1)
    exact = resting(5.0).recording()  # of which the sigma has a floor
    assert estimate_field_noise_uT(exact) == estimate_field_noise_uT(replace(exact, mag=None)) == 0.015


def test_without_gravity_or_a_field_it_is_said():
    recording = resting(5.0).recording(field=None)
    with pytest.raises(EstimationError, match="no magnetometer in the first 1 s to begin with: give the heading"):
        compass_start(recording)
    object.__setattr__(recording, "acc", 0.01 * recording.acc)
    with pytest.raises(EstimationError, match=r"is 0.10 m/s\^2, so there is no up"):
        level_start(recording)
