"""Where the pocket's filter begins: level by the first second, its heading given or the compass's (2.1, Figure 1).

The mean specific force of the first second levels the sensor; biases are zero. The paper has the yaw at zero, so that
all headings are relative to it; here the heading of the body's x axis is given, zero if nothing is said, or that of the
magnetometer over the same second. What the sensor moved meanwhile is added to the doubt of the tilt.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import EstimationError
from fg_nav.frames import levelled
from fg_nav.magnetic.compass import compute_field_heading, compute_true_heading
from fg_nav.pocket.parameters import PocketParameters
from fg_nav.recording import Recording
from fg_nav.start import LEAST_FORCE_M_S2

GAUGE_SIGMA = 1e-4
"""Doubt of a heading that is zero by definition, rad: a trace keeps P invertible."""


@dataclass(frozen=True)
class PocketStart:
    """Attitude `nav_R_body` (3, 3) at the first sample, and its doubts, rad."""

    nav_R_body: Floats
    tilt_sigma: float
    heading_sigma: float = GAUGE_SIGMA


def level_start(
    recording: Recording,
    parameters: PocketParameters = PocketParameters(),
    heading: float = 0.0,
    heading_sigma: float = GAUGE_SIGMA,
) -> PocketStart:
    """Begin level, with a heading of the body's x axis in rad clockwise from north.

    Where the x axis is vertical the heading is that of no axis in particular (`fg_nav.frames.levelled`).

    Raises
    ------
    EstimationError
        If the specific force vanishes.
    """
    acc = recording.acc[_first(recording, parameters)]
    force = acc.mean(axis=0)
    strength = float(np.linalg.norm(force))
    if strength < LEAST_FORCE_M_S2:
        raise EstimationError(
            f"the mean specific force of the first {parameters.still_s:g} s is {strength:.2f} m/s^2, so there is no "
            "up: accelerations must include gravity."
        )
    moved = float(np.linalg.norm(acc.std(axis=0))) / strength
    return PocketStart(
        levelled(force, heading), float(np.hypot(np.radians(parameters.tilt_sigma_deg), moved)), heading_sigma
    )


def compass_start(
    recording: Recording,
    parameters: PocketParameters = PocketParameters(),
    declination: float = 0.0,
    heading_sigma: float = float(np.radians(10.0)),
) -> PocketStart:
    """Begin level, with the heading of the first second's field; `declination` rad, east positive.

    A compass is off by some 10 deg (one sigma) outdoors near houses and cars.

    Raises
    ------
    EstimationError
        If the specific force vanishes, or there is no magnetometer in the first second.
    """
    start = level_start(recording, parameters, 0.0, heading_sigma)
    mag = None if recording.mag is None else recording.mag[_first(recording, parameters)]
    if mag is None or not np.isfinite(mag).all(axis=1).any():
        raise EstimationError(
            f"there is no magnetometer in the first {parameters.still_s:g} s to begin with: give the heading."
        )
    east, north, up = start.nav_R_body @ np.nanmean(mag, axis=0)
    # levelled with heading 0 the axis that tells the heading points north: x is ahead, and y to its left is west
    heading = compute_field_heading(np.array([north, -east, up]))
    return level_start(recording, parameters, float(compute_true_heading(heading, declination)), heading_sigma)


def field_noise_uT(recording: Recording, least_uT: float = PocketParameters().mag_sigma_uT) -> float:
    """White error of the magnetometer, uT an axis and sample, from the quietest tenth of the seconds.

    By second differences, of variance 6 sigma^2, in which a thigh that swings leaves 0.1 uT or less at 100 Hz where it
    turns back. Nothing below `least_uT` is believed.
    """
    mag = np.zeros((0, 3)) if recording.mag is None else recording.mag[np.isfinite(recording.mag).all(axis=1)]
    second = np.diff(mag, n=2, axis=0)
    rate = len(mag) / (recording.t[-1] - recording.t[0])
    blocks = np.array_split(second, max(int(len(second) / max(rate, 4.0)), 1))
    scatter = [float(np.sqrt((block**2).mean() / 6.0)) for block in blocks if len(block) > 1]
    return max(float(np.percentile(scatter, 10)), least_uT) if scatter else least_uT


def _first(recording: Recording, parameters: PocketParameters) -> slice:
    return slice(0, int(np.searchsorted(recording.t, recording.t[0] + parameters.still_s)))
