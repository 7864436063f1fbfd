"""Do gyroscope and accelerometer in a trouser pocket have the same, right-handed axes? What strides of a thigh show.

A thigh never stands, so no stride begins or ends at rest. But over a stride, of period T, a person's velocity changes
little: the mean of the specific force, each sample turned into the axes at the begin of the stride, is gravity,

    f_k(M) = | 1/T int R_M(t) y_a dt |,    R_M the integral of the rate M y_w,        of stride k
    z_k(M) = ((f_k - g) / s_g)^2

With a gyroscope that is negated the force is turned twice away instead of back; its mean is off by 0.4 to 1.4 m/s^2
of three real thighs and three simulated ones; with the own axes by 0.2 at most. M are the 48 matrices of `handedness`,
and so are the odds. Some fit by chance as well as the own axes, such as one turned about the thigh; they are believed
only where most strides speak for them.

A stride is the period of the rate about its main axis, by its autocorrelation in windows of `WINDOW_S`.
"""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.detection.handedness import AXES, MOST_STRIDES, NO_EVIDENCE, AxesEvidence, score_strides
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.mechanisation import integrate_strides
from fg_nav.recording import MAX_GAP_S

WINDOW_S = 6.0
"""Five strides."""

STRIDE_S = 0.8, 1.6
"""From running to a slow walk."""

LEAST_RAD_S, REGULAR = 0.5, 0.45
"""Standard deviation of the rate of who walks, and the autocorrelation at a period."""

FORCE_M_S2 = 0.2
"""s_g: an accelerometer's scale of 2 %, or as much as the velocity changes by."""

LOOKED_WINDOWS = 100
"""Ten minutes."""


def measure_swing_axes(t: Floats, acc: Floats, gyr: Floats) -> AxesEvidence:
    """Compare the axes of acc (N, 3) m/s^2 and gyr (N, 3) rad/s of a thigh, at stamps (N,) s, stride by stride."""
    start, stop = _find_strides(t, gyr)
    if not len(start):
        return NO_EVIDENCE
    h, took = np.diff(t, append=2 * t[-1] - t[-2]), (t[stop] - t[start])[:, None]
    force = np.column_stack([_integrate(acc, gyr @ M.T, h, start, stop) for M in AXES]) / took
    return AxesEvidence(score_strides(((force - GRAVITY_M_S2) / FORCE_M_S2) ** 2), force[:, 0])


def _integrate(acc: Floats, gyr: Floats, h: Floats, start: Ints, stop: Ints) -> Floats:
    """Integral (K,) m/s of the force over strides, in the axes at their beginnings."""
    attitude = np.tile(np.eye(3), (len(start), 1, 1))
    return np.asarray(
        np.linalg.norm(integrate_strides(acc, gyr, h, start, stop, attitude, np.zeros((len(start), 3)), 0.0), axis=1)
    )


def _find_strides(t: Floats, gyr: Floats) -> tuple[Ints, Ints]:
    """First sample (K,) of strides and of the next ones, at most `MOST_STRIDES`, in windows without a gap."""
    period_s = float(np.median(np.diff(t)))
    length = round(WINDOW_S / period_s)
    strides = [
        (at, at + lag)
        for first in range(0, min(len(t) - length + 2, LOOKED_WINDOWS * length), length)
        for lag in [_find_lag(t[first : first + length], gyr[first : first + length], period_s)]
        if lag
        for at in range(first, min(first + length, len(t)) - lag, lag)
    ]
    found = np.array(strides, dtype=np.int64).reshape(-1, 2)
    kept = np.unique(np.linspace(0, len(found) - 1, min(MOST_STRIDES, len(found))).round().astype(int))
    return found[kept, 0].copy(), found[kept, 1].copy()


def _find_lag(t: Floats, gyr: Floats, period_s: float) -> int:
    """Samples of a stride in a window; 0 where nobody walks evenly, or samples are missing."""
    swing = gyr - gyr.mean(axis=0)
    swing = swing @ np.linalg.eigh(swing.T @ swing)[1][:, -1]
    power = float(swing @ swing)
    if np.diff(t).max() > MAX_GAP_S or power < LEAST_RAD_S**2 * len(swing):
        return 0
    lags = np.arange(*(round(limit / period_s) for limit in STRIDE_S))
    alike = np.array([swing[lag:] @ swing[:-lag] for lag in lags]) / power
    return int(lags[alike.argmax()]) if alike.max(initial=0.0) > REGULAR else 0
