"""From a recording to its stances, when the foot stands: found once, shared by every estimator.

Four statistics of stillness over a sliding window, small where the foot stands. Over a window of W samples, with y_a
the specific force, y_w the angular rate and a bar for the window's mean:

==== ===================================================== ==================
SHOE (1/W) sum |y_a - g ybar_a/|ybar_a||^2/s_a^2 + |y_w|^2/s_w^2    6 W - 2
ARE  (1/W) sum |y_w|^2 / s_w^2                                        3 W
MV   (1/W) sum |y_a - ybar_a|^2 / s_a^2                               3 W - 3
MAG  (1/W) sum (|y_a| - g)^2 / s_a^2                                  W
==== ===================================================== ==================

The last column is the number of degrees of freedom f: for a sensor at perfect rest with white noise s_a (m/s^2) and s_w
(rad/s), W times the statistic is chi-square with f. So a threshold has a false-alarm rate: that of a sensor at rest
(`threshold_at_rest`). A foot in stance rolls and trembles far above sensor noise: by default each footfall has its own
threshold on SHOE, found from the recording (`fg_nav.detection.footfalls`). With a threshold or a false-alarm rate, any
of the four cuts the recording at that one level. Either way, intervals with no swing between them are one footfall.

Source: Skog, Handel, Nilsson, Rantakokko (2010), "Zero-velocity detection - an algorithm evaluation", IEEE TBME.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.special import chdtri

from fg_nav.arrays import Bools, Brief, Floats, Ints, find_runs
from fg_nav.detection.footfalls import SWING_RATE_RAD_S, find_footfalls
from fg_nav.errors import DetectionError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.recording import Recording
from fg_nav.samples.gaps import cross_holes

ACC_NOISE_M_S2 = 0.02  # s_a, of a sample of a sensor at rest; data sheets and the recordings at rest have 0.01 to 0.03.
GYR_NOISE_DEG_S = 0.2  # s_w, likewise; data sheets and the recordings at rest have 0.1 to 0.4.
WINDOW_S = 0.05  # Length of the sliding window.
MIN_S = 0.015  # Shorter stances are dropped; those of running last 50 ms and more.


@dataclass(frozen=True)
class Stances(Brief):
    """Stance intervals over a recording of `n_samples`.

    ========= ==== ==========================================================================================
    start     (K,) first sample of each interval
    stop      (K,) sample after its last
    footfall  (K,) number of the footfall it belongs to, from 0, never falling
    statistic (N,) the detector's statistic over its threshold (below 1: still), None where unknown
    threshold      of the statistic, in the detector's units; the median where it varies along the walk
    ========= ==== ==========================================================================================

    Raises `DetectionError` for intervals that are not in order, apart and within the samples.

    Examples
    --------
    >>> import numpy as np
    >>> stances = fg_nav.Stances.from_mask(np.array([False, True, True, False, True, True]))
    >>> stances.start.tolist(), stances.stop.tolist(), stances.n_footfalls
    ([1, 4], [3, 6], 2)
    """

    start: Ints
    stop: Ints
    footfall: Ints
    n_samples: int
    detector: str = "given"
    threshold: float = float("nan")
    statistic: Floats | None = None

    def __post_init__(self) -> None:
        ends = np.stack([self.start, self.stop], axis=1).ravel()
        inside = len(ends) == 0 or (ends[0] >= 0 and ends[-1] <= self.n_samples)
        if not inside or (np.diff(ends)[::2] <= 0).any() or (np.diff(ends)[1::2] < 0).any():
            raise DetectionError(
                f"stance intervals must be in order, apart and within the {self.n_samples} samples: check their ends."
            )
        steps = np.diff(self.footfall, prepend=0)
        if len(self.footfall) != len(self.start) or (steps < 0).any() or (steps > 1).any():
            raise DetectionError("footfalls must be numbered from 0, one an interval, in order and without a hole.")

    def __len__(self) -> int:
        return len(self.start)

    @property
    def n_footfalls(self) -> int:
        """Number of footfalls: strides plus one."""
        return int(self.footfall[-1]) + 1 if len(self) else 0

    @property
    def spans(self) -> tuple[Ints, Ints]:
        """First sample (F,) of each footfall, and that behind its last one (F,), over all stances that it has."""
        number = np.arange(self.n_footfalls)
        last = np.searchsorted(self.footfall, number, side="right") - 1
        return self.start[np.searchsorted(self.footfall, number)], self.stop[last]

    @property
    def mask(self) -> Bools:
        """(N,) True where the foot stands."""
        steps = np.zeros(self.n_samples + 1, dtype=np.int64)
        np.add.at(steps, self.start, 1)
        np.add.at(steps, self.stop, -1)
        return np.cumsum(steps[:-1]) > 0

    def stillest(self, gyr: Floats) -> Ints:
        """Index (F,) of the stillest sample of each footfall: least statistic, or without it least `gyr` (N, 3)."""
        unrest = np.linalg.norm(gyr, axis=1) if self.statistic is None else self.statistic
        least = np.full(self.n_footfalls, np.inf)
        sample = np.zeros(self.n_footfalls, dtype=np.int64)
        for start, stop, footfall in zip(self.start, self.stop, self.footfall, strict=True):
            i = start + int(np.argmin(unrest[start:stop]))
            if unrest[i] < least[footfall]:
                least[footfall], sample[footfall] = unrest[i], i
        return sample

    @classmethod
    def from_mask(cls, mask: Bools, detector: str = "given") -> Stances:
        """Cut an (N,) mask into its runs of True, each a footfall of its own."""
        start, stop = find_runs(mask)
        return cls(start, stop, np.arange(len(start)), n_samples=len(mask), detector=detector)


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

_DEGREES_OF_FREEDOM = {"shoe": (6, 2), "are": (3, 0), "mv": (3, 3), "mag": (1, 0)}  # (a, b) of f = a W - b.


def threshold_at_rest(detector: str, window: int, false_alarm_rate: float) -> float:
    """Threshold which a sensor at perfect rest exceeds with this probability a sample."""
    each, fitted = _DEGREES_OF_FREEDOM[detector]
    return float(chdtri(each * window - fitted, false_alarm_rate) / window)


def _mean(samples: Floats, window: int) -> Floats:
    """Centered sliding mean along the first axis; the ends repeat the outermost sample."""
    return np.asarray(uniform_filter1d(samples, window, axis=0, mode="nearest"))


@dataclass(frozen=True)
class StanceParameters:
    """Detector of stances and its threshold."""

    detector: str = "shoe"  # shoe, are, mv or mag.
    threshold: float | None = None  # Of the statistic, for the whole recording; None: automatic, each footfall its own.
    false_alarm_rate: float | None = None  # In its place: the probability that a sample at perfect rest exceeds it.


def detect_stances(recording: Recording, parameters: StanceParameters = StanceParameters()) -> Stances:
    """Find the stances of a foot.

    Raises `DetectionError` for an unknown detector, an automatic threshold with another detector than SHOE, a threshold
    that makes no sense, or if no stance is found.

    Examples
    --------
    >>> stances = fg_nav.detect_stances(fg_nav.read("walk.csv"))
    >>> stances.n_footfalls
    17
    """
    detector, t, window = parameters.detector, recording.t, max(3, round(WINDOW_S / recording.period_s))
    if detector not in STATISTICS:
        raise DetectionError(f"there is no stance detector '{detector}': choose one of {', '.join(STATISTICS)}.")
    statistic = STATISTICS[detector](recording.acc, recording.gyr, window)
    # threshold for the whole recording; None if each footfall gets its own
    fixed, alarms = parameters.threshold, parameters.false_alarm_rate
    if alarms is not None:
        if fixed is not None:
            raise DetectionError("a threshold and a false-alarm rate are given: choose one of them.")
        if not 0 < alarms < 1:
            raise DetectionError(f"the false-alarm rate is {alarms:g}: give a probability between 0 and 1.")
        fixed = threshold_at_rest(detector, window, alarms)
    if fixed is not None:
        start, stop = find_runs(statistic < fixed)
        threshold = np.full(len(start), fixed)
    elif detector == "shoe":
        start, stop, level = find_footfalls(t, recording.acc, recording.gyr, np.log10(statistic + 1e-3))
        threshold = 10.0**level
    else:
        raise DetectionError(
            f"the automatic threshold works on shoe: give {detector} a threshold or a false-alarm rate."
        )
    long = t[stop - 1] - t[start] >= MIN_S
    start, stop, threshold = start[long], stop[long], threshold[long]
    if len(start) == 0:
        raise DetectionError(_explain_no_stance(recording, statistic, detector, fixed))
    # statistic over the threshold of the nearest interval
    n, edges = len(recording), (stop[:-1] + start[1:]) // 2
    relative = statistic / np.repeat(threshold, np.diff(np.concatenate([[0], edges, [n]])))
    # a new footfall after each swing, and behind each hole
    rate = np.linalg.norm(recording.gyr, axis=1)
    between = np.stack([stop[:-1], start[1:]], axis=1).ravel()
    peak = np.maximum.reduceat(rate, between)[::2] if len(between) else np.empty(0)
    unseen = cross_holes(t, np.append(start, stop[-1] - 1))
    footfall = np.concatenate([[0], np.cumsum((peak > SWING_RATE_RAD_S) | unseen[:-1])])
    return Stances(start, stop, footfall, n, detector, float(np.median(threshold)), statistic=relative)


def _explain_no_stance(recording: Recording, statistic: Floats, detector: str, threshold: float | None) -> str:
    """Message for the user: the statistic, or rate and force, at the stillest sample."""
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
