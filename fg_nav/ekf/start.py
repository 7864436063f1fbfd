"""Where a filter begins: attitude and gyro bias from the first footfall, and how far they can be trusted.

The foot stands, so the mean specific force points up and levels the sensor; the heading is given, or zero. If
the first footfall holds a true rest, the slope of the integrated rate is the gyro bias. (The slope of a line,
not the mean rate: a standing foot sways by small angles, and sway is white in the angle.)

A foot in mid-walk turns at 1-3 deg/s even while it "stands", so a rest is believed only over blocks of a
quarter of a second that are quiet and agree with each other, two at least in a row. The uncertainty of the
slope over a time T is what sway of s rms about the line does to it, s sqrt(12) / T: with the least sway
assumed, 0.07 deg/s after one second and 0.007 deg/s after ten.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.errors import EstimationError
from fg_nav.frames import levelled
from fg_nav.recording import Recording
from fg_nav.stances import Stances

BLOCK_S = 0.25
"""Shorter than body sway (about 0.5 Hz), long enough to average sensor noise."""

LEAST_FORCE_M_S2 = 1.0
"""A mean specific force below this has no direction worth the name."""


@dataclass(frozen=True)
class RestParameters:
    """When a stance is a rest, and how still a rest is.

    MEMS gyroscopes are quiet to 0.1 deg/s rms in 100 Hz bandwidth (MPU-9250 data sheet); a standing person
    sways.
    """

    min_s: float = 0.5
    """Shortest rest, s."""
    gyr_std_deg_s: float = 0.5
    """Largest standard deviation of the rate within a block, per axis, deg/s."""
    gyr_spread_deg_s: float = 0.5
    """Largest distance of a block's mean rate from the median block, per axis, deg/s."""
    acc_std_m_s2: float = 0.2
    """Largest standard deviation of the specific force within a block, per axis, m/s^2."""
    sway_deg: float = 0.02
    """Angle by which a resting foot sways at least, deg rms."""


@dataclass(frozen=True)
class Start:
    """Where navigation begins: at sample `row` with this attitude and gyro bias (3,) rad/s.

    `levelled_at_rest` tells whether the first stance held a rest. `gyro_bias_sigma` (3,) is infinite where
    the bias is unknown; `rest` are the samples that showed it, if any.
    """

    row: int
    nav_R_body: Floats
    levelled_at_rest: bool
    gyro_bias: Floats
    gyro_bias_sigma: Floats
    rest: slice | None


def starting_point(
    recording: Recording,
    stances: Stances,
    heading: float = 0.0,
    parameters: RestParameters = RestParameters(),
) -> Start:
    """Level the sensor in its first stance, and take the gyro bias from a rest in the first footfall.

    Parameters
    ----------
    recording, stances
        Of the same length.
    heading : float
        Of the body's x axis at the start, rad clockwise from north.
    parameters : RestParameters

    Raises
    ------
    EstimationError
        Without a stance, on stances of another recording, or where the specific force vanishes.
    """
    _check(recording, stances)
    first = slice(int(stances.start[0]), int(stances.stop[0]))
    quiet = find_rest(recording, first, parameters)
    up = recording.acc[quiet or first].mean(axis=0)
    if np.linalg.norm(up) < LEAST_FORCE_M_S2:
        raise EstimationError(
            f"the mean specific force in the first stance, at {recording.t[first.start]:.3f} s, is "
            f"{np.linalg.norm(up):.2f} m/s^2, so there is no up: accelerations must include gravity."
        )
    footfall = slice(first.start, int(stances.stop[stances.footfall == 0][-1]))
    rest = find_rest(recording, footfall, parameters)
    bias, sigma = _gyro_bias(recording, rest, parameters)
    return Start(first.start, levelled(up, heading), quiet is not None, bias, sigma, rest)


def _check(recording: Recording, stances: Stances) -> None:
    if len(stances) == 0:
        raise EstimationError("there is no stance to start from: check the stance detection.")
    if stances.n_samples != len(recording):
        raise EstimationError(
            f"the stances belong to {stances.n_samples} samples and the recording has {len(recording)}: "
            "detect the stances on this recording."
        )


def find_rest(recording: Recording, within: slice, parameters: RestParameters) -> slice | None:
    """Longest run of blocks that are quiet and agree, as samples; None where none is as long as a rest."""
    block = max(2, round(BLOCK_S / recording.period_s))
    starts = np.arange(within.start, within.stop - block + 1, block)
    if len(starts) == 0:
        return None
    first, count = _longest_run(_quiet(recording, starts, block, parameters))
    if count * block * recording.period_s < parameters.min_s * (1 - 1e-3):
        return None
    return slice(int(starts[first]), int(starts[first]) + count * block)


def _quiet(recording: Recording, starts: Ints, block: int, limits: RestParameters) -> Bools:
    rows = starts[:, None] + np.arange(block)
    rate, force = recording.gyr[rows], recording.acc[rows]
    mean = rate.mean(axis=1)
    away = np.abs(mean - np.median(mean, axis=0)).max(axis=1)
    return np.asarray(
        (rate.std(axis=1).max(axis=1) < np.radians(limits.gyr_std_deg_s))
        & (force.std(axis=1).max(axis=1) < limits.acc_std_m_s2)
        & (away < np.radians(limits.gyr_spread_deg_s))
    )


def _longest_run(mask: Bools) -> tuple[int, int]:
    """First index and length of the longest run of True; length 0 where there is none."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    starts, stops = edges[::2], edges[1::2]
    if len(starts) == 0:
        return 0, 0
    best = int(np.argmax(stops - starts))
    return int(starts[best]), int(stops[best] - starts[best])


def _gyro_bias(recording: Recording, rest: slice | None, parameters: RestParameters) -> tuple[Floats, Floats]:
    """Slope (3,) of the integrated rate over a rest, rad/s, and its standard deviation."""
    if rest is None:
        return np.zeros(3), np.full(3, np.inf)
    t = recording.t[rest] - recording.t[rest.start]
    steps = 0.5 * (recording.gyr[rest][1:] + recording.gyr[rest][:-1]) * np.diff(t)[:, None]
    angle = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    offset, slope = np.polynomial.polynomial.polyfit(t, angle, 1)
    sway = (angle - offset - np.outer(t, slope)).std(axis=0)
    return slope, np.maximum(sway, np.radians(parameters.sway_deg)) * np.sqrt(12.0) / t[-1]
