"""Walks in closed form with a magnetometer, in a field that is the Earth's unless given otherwise."""

import numpy as np
from scipy.spatial.transform import Rotation

from fg_nav.frames import compute_heading, wrap_angle
from fg_nav.magnetic import average_footfall_field
from fg_nav.recording import Recording
from tests.ekf.motion import Walk

NAV_FIELD = np.array([0.0, 21.0, -43.0])
RATE = 100.0

SWAY_DEG, SWAY_HZ = 0.01, 1.0
"""Angle of the standing foot about each axis, rms: two seconds of it show the bias to 0.04 deg/s, as real feet do."""


def walked(walk, turned_deg=None, gyro_bias_deg_s=0.0, from_s=0.0):
    """Recording, stances, field and the true headings (N,).

    The field points north, turned by `turned_deg` (t) clockwise; the gyro is biased about up from `from_s` on. The foot
    sways while it stands at the start, whole periods.
    """
    inertial, stances = walk.recording(RATE)
    t, attitude = inertial.t, walk.attitude(inertial.t)
    turned = np.zeros(len(t)) if turned_deg is None else turned_deg(t)
    field = Rotation.from_euler("z", -turned[:, None], degrees=True).apply(NAV_FIELD)
    bias = np.where(t >= from_s, np.radians(gyro_bias_deg_s), 0.0)
    turn = 2 * np.pi * SWAY_HZ
    sway = np.where(t < walk.rest_s, -np.radians(SWAY_DEG) * np.sqrt(2.0) * turn * np.sin(turn * t), 0.0)
    recording = Recording(
        t=t,
        acc=inertial.acc,
        gyr=inertial.gyr + attitude[:, 2] * bias[:, None] + sway[:, None],
        mag=np.einsum("nji,nj->ni", attitude, field),
    )
    headings = compute_heading(attitude)
    return recording, stances, average_footfall_field(recording, stances, float(headings[0])), headings


def off_deg(solution, headings):
    """Heading errors (N,) in degrees."""
    return np.degrees(wrap_angle(compute_heading(solution.nav_R_body) - headings))


STRAIGHT = Walk(strides=60, turn=0.0, pitch=0.3)
