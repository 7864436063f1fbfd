"""Rests: stretches in which the foot stands so still that the mean angular rate is the gyroscope's bias.

A foot "in stance" still turns at a few deg/s; to believe a rest is to fix a bias, so it must be one: over windows
of `window_s` the smoothed rate and the smoothed specific force keep to a narrow band, sensor noise averaged out.
A standing person sways: over a rest of length T the mean rate is off by a small angle over T.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

from fg_nav.arrays import Bools, Floats
from fg_nav.recording import Recording
from fg_nav.stances import runs


@dataclass(frozen=True)
class RestParameters:
    """What counts as a rest, and how well it shows the bias."""

    window_s: float = 0.8
    """Shortest rest: half the time of a slow stride."""
    smoothing_s: float = 0.2
    """Averages sensor noise, keeps the motion of a foot."""
    rate_band_deg_s: float = 0.8
    """Width of the band in which the smoothed rate stays, per axis."""
    force_band_m_s2: float = 0.25
    """The same of the specific force; a tilt by 1.5 deg fills it."""
    largest_bias_deg_s: float = 10.0
    """A steady rate above this is a motion: a MEMS gyroscope's zero-rate output is within 5 deg/s."""
    sway_deg: float = 0.14
    """Angle by which the foot may have turned from the start of a rest to its end, one sigma."""


@dataclass(frozen=True)
class Rest:
    """Samples `start <= i < stop` of a rest: `rate` (3,) rad/s is the gyro bias to within `sigma` rad/s per axis."""

    start: int
    stop: int
    rate: Floats
    force: Floats
    sigma: float


def find_rests(recording: Recording, parameters: RestParameters = RestParameters()) -> tuple[Rest, ...]:
    """Find the rests of a recording, in order; none where there are none."""
    period = recording.period_s
    half = round(parameters.window_s / (2 * period))
    centre = _steady(recording, parameters)
    rests: list[Rest] = []
    for a, b in zip(*runs(centre), strict=True):
        start = max(a - half, rests[-1].stop if rests else 0)
        stop = min(b + half, len(recording))
        if (stop - start) * period >= 0.9 * parameters.window_s:
            rests += _measured(recording, start, stop, parameters)
    return tuple(rests)


def _steady(recording: Recording, p: RestParameters) -> Bools:
    """(N,) True at the centre of every window that keeps to its bands."""
    smoothing = max(1, round(p.smoothing_s / recording.period_s))
    window = max(2, round((p.window_s - p.smoothing_s) / recording.period_s))
    rate_width = _width(recording.gyr, smoothing, window)
    force_width = _width(recording.acc, smoothing, window)
    return np.asarray((rate_width < np.radians(p.rate_band_deg_s)) & (force_width < p.force_band_m_s2))


def _width(samples: Floats, smoothing: int, window: int) -> Floats:
    """Width (N,) of the band of the smoothed samples (N, 3) in a window, on the widest axis."""
    smooth = uniform_filter1d(samples, smoothing, axis=0, mode="nearest")
    high = maximum_filter1d(smooth, window, axis=0, mode="nearest")
    low = minimum_filter1d(smooth, window, axis=0, mode="nearest")
    return np.asarray((high - low).max(axis=1))


def _measured(recording: Recording, start: int, stop: int, p: RestParameters) -> list[Rest]:
    rate = recording.gyr[start:stop].mean(axis=0)
    if np.abs(rate).max() > np.radians(p.largest_bias_deg_s):
        return []
    sigma = np.radians(p.sway_deg) / (recording.t[stop - 1] - recording.t[start])
    return [Rest(start, stop, rate, recording.acc[start:stop].mean(axis=0), float(sigma))]
