"""Do gyroscope and accelerometer in a trouser pocket have the same, right-handed axes? What strides of a thigh show.

A thigh never stands, so no stride begins or ends at rest. But over a stride, of period T, a person's velocity changes
little: the mean of the specific force, each sample turned into the axes at the begin of the stride, is gravity,

    f_k(M) = | 1/T int R_M(t) y_a dt |,    R_M the integral of the rate M y_w,        of stride k
    l_k(M) = -1/2 ((f_k - g) / s_g)^2
    L(M)   = median_k (l_k(M) - l_k(I))                         log of the odds of M over the axes that were given

With a gyroscope that is negated the force is turned twice away instead of back, and its mean is off. M are the 48
matrices of `handedness`. Scale and bias of the accelerometer are the same in every stride, and so is what wrong axes
leave of an even gait: many strides are one observation, L is their median and does not grow with their number. So
wrong axes are believed where the mean force is off by 1.1 m/s^2, more than sensors are, and suspected from 0.7 on; most
mirrors leave less and are not seen (docs/pocket.md). Several M fit alike, such as one turned about the thigh
besides: which axes are wrong is not said.

A stride is the period of the rate about its main axis, by its autocorrelation in windows of `WINDOW_S`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.detection.handedness import AXES, LOOKED_S, MAX_STRIDES, AxesEvidence
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.mechanisation import integrate_strides
from fg_nav.recording import MAX_GAP_S
from fg_nav.text import format_count

WINDOW_S = 6.0  # Five strides.

STRIDE_S = 0.8, 1.6
"""From a fast walk to a slow one; a run's 0.65 to 0.75 s are not looked at: there was no thigh to try them on."""

MIN_RAD_S = 0.5
"""Standard deviation of the rate about the main axis: a thigh that swings by 7 deg to either side, once in 1.1 s."""

REGULAR = 0.45
"""Autocorrelation at a period: an even gait has what of the window overlaps, 0.87 at 0.8 s and 0.73 at 1.6; so half of
the power and more comes again."""

FORCE_M_S2 = 0.03 * GRAVITY_M_S2  # s_g: an accelerometer's scale of 3 %, or its bias.
MIN_STRIDES = 10  # Fewer are not judged. Walkers change their speed by 0.3 m/s in a stride: of ten, 0.1 m/s^2 is left.


@dataclass(frozen=True)
class SwingEvidence(AxesEvidence):
    """What strides of a thigh say of the axes: all together no more than one observation of the accelerometer."""

    @property
    def log_odds(self) -> Floats:
        """(48,) L of each of `AXES`; 0 of fewer than `MIN_STRIDES`."""
        if self.strides < MIN_STRIDES:
            return np.zeros(len(AXES))
        return np.asarray(np.median(self.scores - self.scores[:, :1], axis=0))

    @property
    def problem(self) -> str:
        """What speaks against the axes, in words."""
        force = np.median(self.gravity) if self.strides else np.nan
        strides = f"{self.speaking} of {format_count(self.strides, 'stride')}"
        return (
            f"gravity turns against the gyroscope in {strides}, the mean force is {force:.1f} m/s^2: "
            "gyroscope and accelerometer do not belong together (mirrored or exchanged axes), or a scale is wrong"
        )


NO_SWINGS = SwingEvidence(np.zeros((0, len(AXES))), np.zeros(0))


def measure_swing_axes(t: Floats, acc: Floats, gyr: Floats) -> SwingEvidence:
    """Compare the axes of acc (N, 3) m/s^2 and gyr (N, 3) rad/s of a thigh, at stamps (N,) s, stride by stride."""
    looked = np.s_[: int(np.searchsorted(t, t[0] + LOOKED_S))]
    t, acc, gyr = t[looked], acc[looked], gyr[looked]
    start, stop = _find_strides(t, gyr)
    if not len(start):
        return NO_SWINGS
    h, took = np.diff(t, append=2 * t[-1] - t[-2]), (t[stop] - t[start])[:, None]
    force = np.column_stack([_integrate(acc, gyr @ M.T, h, start, stop) for M in AXES]) / took
    return SwingEvidence(-0.5 * ((force - GRAVITY_M_S2) / FORCE_M_S2) ** 2, force[:, 0])


def _integrate(acc: Floats, gyr: Floats, h: Floats, start: Ints, stop: Ints) -> Floats:
    """Integral (K,) m/s of the force over strides, in the axes at their beginnings."""
    attitude = np.tile(np.eye(3), (len(start), 1, 1))
    return np.asarray(
        np.linalg.norm(integrate_strides(acc, gyr, h, start, stop, attitude, np.zeros((len(start), 3)), 0.0), axis=1)
    )


def _find_strides(t: Floats, gyr: Floats) -> tuple[Ints, Ints]:
    """First sample (K,) of strides and of the next ones, at most `MAX_STRIDES`, in windows without a gap."""
    period_s = float(np.median(np.diff(t)))
    edges = [np.zeros((0, 2), dtype=np.int64)]
    for begin in np.arange(t[0], t[-1] + 1.5 * period_s - WINDOW_S, WINDOW_S):
        part = slice(*np.searchsorted(t, [begin, begin + WINDOW_S]))
        stride_s = _find_period(t[part], gyr[part], period_s)
        if stride_s:
            bounds = np.arange(begin, min(begin + WINDOW_S, t[-1]), stride_s)
            at = np.searchsorted(t, bounds - 0.5 * period_s)  # stamps are rounded
            edges.append(np.column_stack([at[:-1], at[1:]]))
    found = np.concatenate(edges)
    found = found[found[:, 0] < found[:, 1]]  # none in a hole at the edge of a window
    kept = np.unique(np.linspace(0, len(found) - 1, min(MAX_STRIDES, len(found))).round().astype(int))
    return found[kept, 0].copy(), found[kept, 1].copy()


def _find_period(t: Floats, gyr: Floats, period_s: float) -> float:
    """Period of the strides in a window, s; 0 where nobody walks evenly, or samples are missing for long."""
    if len(t) < 2 or np.diff(t).max() > MAX_GAP_S:
        return 0.0
    swing = gyr - gyr.mean(axis=0)
    swing = swing @ np.linalg.eigh(swing.T @ swing)[1][:, -1]
    swing = np.interp(np.arange(t[0], t[-1] + 0.5 * period_s, period_s), t, swing)  # lost samples shift nothing
    power = float(swing @ swing)
    lags = np.arange(*(round(limit / period_s) for limit in STRIDE_S))
    lags = lags[lags < len(swing)]
    if not len(lags) or power < MIN_RAD_S**2 * len(swing):
        return 0.0
    alike = np.array([swing[lag:] @ swing[:-lag] for lag in lags]) / power
    return float(lags[alike.argmax()] * period_s) if alike.max() > REGULAR else 0.0
