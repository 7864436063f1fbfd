"""From a recording to its stances.

Four statistics of stillness over a sliding window, small where the foot stands. Over a window of W samples, with y_a
the specific force, y_w the angular rate and a bar for the window's mean:

==== ===================================================== ==================
SHOE (1/W) sum |y_a - g ybar_a/|ybar_a||^2/s_a^2 + |y_w|^2/s_w^2    6 W - 2
ARE  (1/W) sum |y_w|^2 / s_w^2                                        3 W
MV   (1/W) sum |y_a - ybar_a|^2 / s_a^2                               3 W - 3
MAG  (1/W) sum (|y_a| - g)^2 / s_a^2                                  W
==== ===================================================== ==================

The last column is the number of degrees of freedom f: for a sensor at perfect rest with white noise s_a
(m/s^2) and s_w (rad/s), W times the statistic is chi-square with f. So a threshold has a meaning: the rate at
which it would call a sensor at rest a moving one (`threshold_at_rest`). A foot in stance is not at rest, it rolls
and trembles far above sensor noise: by default each footfall has its own threshold on SHOE, found from the recording
(`fg_nav.detection.footfalls`). With a threshold or a false-alarm rate, any of the four cuts the recording at that one
level. Either way, intervals with no swing between them are one footfall.

Source: Skog, Handel, Nilsson, Rantakokko (2010), "Zero-velocity detection - an algorithm evaluation", IEEE TBME.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.special import chdtri

from fg_nav.arrays import Floats, Ints
from fg_nav.detection.footfalls import SWING_RATE_RAD_S, find_footfalls
from fg_nav.errors import DetectionError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.recording import Recording
from fg_nav.samples.gaps import cross_holes
from fg_nav.stances import Stances, find_runs
from fg_nav.system.spilled import measure_rows

ACC_NOISE_M_S2 = 0.02  # s_a, of a sample of a sensor at rest; data sheets and the recordings at rest have 0.01 to 0.03.
GYR_NOISE_DEG_S = 0.2  # s_w, likewise; data sheets and the recordings at rest have 0.1 to 0.4.
WINDOW_S = 0.05  # Length of the sliding window.
MIN_S = 0.015  # Shorter stances are dropped; those of running last 50 ms and more.


def shoe(acc: Floats, gyr: Floats, window: int) -> Floats:
    """Stance hypothesis optimal estimation (the GLRT): (N,) from `acc` (N, 3) m/s^2 and `gyr` (N, 3) rad/s."""
    strength = np.linalg.norm(_mean(acc, window), axis=1)
    g = GRAVITY_M_S2
    # sum |y - g ybar/|ybar||^2 = sum |y|^2 - 2 g W |ybar| + g^2 W, and rounding must not make it negative
    off_gravity: Floats = np.maximum(_mean((acc**2).sum(axis=1), window) - 2 * g * strength + g * g, 0.0)
    return off_gravity / ACC_NOISE_M_S2**2 + are(acc, gyr, window)


def are(acc: Floats, gyr: Floats, window: int) -> Floats:
    """Angular rate energy (N,); `acc` is not used."""
    energy: Floats = np.maximum(_mean((gyr**2).sum(axis=1), window), 0.0)
    return energy / float(np.radians(GYR_NOISE_DEG_S)) ** 2


def mv(acc: Floats, gyr: Floats, window: int) -> Floats:
    """Moving variance of the specific force (N,); `gyr` is not used."""
    spread: Floats = np.maximum(_mean((acc**2).sum(axis=1), window) - (_mean(acc, window) ** 2).sum(axis=1), 0.0)
    return spread / ACC_NOISE_M_S2**2


def mag(acc: Floats, gyr: Floats, window: int) -> Floats:
    """Magnitude of the specific force against gravity (N,); `gyr` is not used."""
    off_gravity = np.linalg.norm(acc, axis=1) - GRAVITY_M_S2
    spread: Floats = np.maximum(_mean(off_gravity**2, window), 0.0)
    return spread / ACC_NOISE_M_S2**2


Statistic = Callable[[Floats, Floats, int], Floats]

STATISTICS: dict[str, Statistic] = {"shoe": shoe, "are": are, "mv": mv, "mag": mag}

_DEGREES_OF_FREEDOM: dict[str, Callable[[int], int]] = {
    "shoe": lambda window: 6 * window - 2,
    "are": lambda window: 3 * window,
    "mv": lambda window: 3 * window - 3,
    "mag": lambda window: window,
}


def threshold_at_rest(detector: str, window: int, false_alarm_rate: float) -> float:
    """Threshold which a sensor at perfect rest exceeds with this probability a sample."""
    return float(chdtri(_DEGREES_OF_FREEDOM[detector](window), false_alarm_rate) / window)


def _mean(samples: Floats, window: int) -> Floats:
    """Centered sliding mean along the first axis; the ends repeat the outermost sample."""
    return np.asarray(uniform_filter1d(samples, window, axis=0, mode="nearest"))


@dataclass(frozen=True)
class StanceParameters:
    """How stances are found."""

    detector: str = "shoe"
    """shoe, are, mv or mag (`fg_nav.detection.stance`)."""
    threshold: float | None = None
    """One threshold for the whole recording, in the statistic's units; None: automatic, each footfall its own."""
    false_alarm_rate: float | None = None
    """In place of a threshold: the probability a sample that a sensor at perfect rest is called moving."""


def detect_stances(recording: Recording, parameters: StanceParameters = StanceParameters()) -> Stances:
    """Find when the foot stands.

    Raises `DetectionError` for an unknown detector, an automatic threshold with another detector than SHOE, a threshold
    that makes no sense, or if no stance is found.

    Examples
    --------
    >>> stances = fg_nav.detect_stances(fg_nav.read("walk.csv"))
    >>> stances.n_footfalls
    17
    """
    statistic = _compute_statistic(recording, parameters)
    one = _choose_threshold(recording, parameters)
    found = _detect_footfalls(recording, statistic, parameters) if one is None else _cut_below(statistic, one)
    start, stop, threshold = _drop_short(recording.t, *found)
    if len(start) == 0:
        raise DetectionError(_explain_no_stance(recording, statistic, parameters.detector, one))
    footfall = _number_footfalls(recording, start, stop)
    relative = statistic / _spread_threshold(len(recording), start, stop, threshold)
    return Stances(
        start, stop, footfall, len(recording), parameters.detector, float(np.median(threshold)), statistic=relative
    )


def _compute_statistic(recording: Recording, p: StanceParameters) -> Floats:
    if p.detector not in STATISTICS:
        raise DetectionError(f"there is no stance detector '{p.detector}': choose one of {', '.join(STATISTICS)}.")
    return STATISTICS[p.detector](recording.acc, recording.gyr, _window(recording))


def _window(recording: Recording) -> int:
    return max(3, round(WINDOW_S / recording.period_s))


def _detect_footfalls(recording: Recording, statistic: Floats, p: StanceParameters) -> tuple[Ints, Ints, Floats]:
    if p.detector != "shoe":
        raise DetectionError(
            f"the automatic threshold works on shoe: give {p.detector} a threshold or a false-alarm rate."
        )
    level = np.log10(statistic + 1e-3)
    start, stop, threshold = find_footfalls(recording.t, recording.acc, recording.gyr, level)
    return start, stop, 10.0**threshold


def _choose_threshold(recording: Recording, p: StanceParameters) -> float | None:
    """Threshold for the whole recording; None if it shall be automatic."""
    if p.threshold is not None and p.false_alarm_rate is not None:
        raise DetectionError("a threshold and a false-alarm rate are given: choose one of them.")
    if p.false_alarm_rate is None:
        return p.threshold
    if not 0 < p.false_alarm_rate < 1:
        raise DetectionError(f"the false-alarm rate is {p.false_alarm_rate:g}: give a probability between 0 and 1.")
    return threshold_at_rest(p.detector, _window(recording), p.false_alarm_rate)


def _cut_below(statistic: Floats, threshold: float) -> tuple[Ints, Ints, Floats]:
    start, stop = find_runs(statistic < threshold)
    return start, stop, np.full(len(start), threshold)


def _drop_short(t: Floats, start: Ints, stop: Ints, threshold: Floats) -> tuple[Ints, Ints, Floats]:
    keep = t[stop - 1] - t[start] >= MIN_S
    return start[keep], stop[keep], threshold[keep]


def _number_footfalls(recording: Recording, start: Ints, stop: Ints) -> Ints:
    """Number (K,) of the footfall of each interval: a new one after each swing, and behind each hole."""
    rate = measure_rows(recording.gyr)
    between = np.stack([stop[:-1], start[1:]], axis=1).ravel()
    peak = np.maximum.reduceat(rate, between)[::2] if len(between) else np.empty(0)
    unseen = cross_holes(recording.t, np.append(start, stop[-1] - 1)) if len(start) else np.empty(0, dtype=np.bool_)
    return np.concatenate([[0], np.cumsum((peak > SWING_RATE_RAD_S) | unseen[:-1])])


def _spread_threshold(n: int, start: Ints, stop: Ints, threshold: Floats) -> Floats:
    """Threshold (N,) of the nearest interval."""
    edges = (stop[:-1] + start[1:]) // 2
    return np.repeat(threshold, np.diff(np.concatenate([[0], edges, [n]])))


def _explain_no_stance(recording: Recording, statistic: Floats, detector: str, threshold: float | None) -> str:
    i = int(np.argmin(statistic))
    if threshold is not None:
        return (
            f"no stance was found in {recording.duration_s:.1f} s: even at its stillest, at {recording.t[i]:.3f} s, "
            f"{detector} is {statistic[i]:.3g} and the threshold {threshold:.3g}; raise it, or leave it automatic."
        )
    rate = np.degrees(np.linalg.norm(recording.gyr[i]))
    return (
        f"no stance was found in {recording.duration_s:.1f} s: even at its stillest, at {recording.t[i]:.3f} s, the "
        f"sensor turns at {rate:.0f} deg/s with a specific force of {np.linalg.norm(recording.acc[i]):.1f} m/s^2; is "
        "it on a foot, and are the units right?"
    )
