"""Verdicts on the magnetic field: of each footfall by a detector, of each sample by the scatter of its strength.

Footfalls. Detectors, their model and the place to add one: `fg_nav.magnetic.detectors`. A window holds the last
footfalls that have a field, but none that spans more strides than twice its length, which would compare places far
apart. The first footfalls, with too few before them, are not judged. A verdict uses its footfall and those before it.
The inertial headings do not: their gyro bias is that of the longest rest of the recording
(`fg_nav.magnetic.footfall_field`). An estimator with better attitudes replaces `nav_R_body` in the footfall field and
has it judged again.

Samples, for a sensor that never stands, as in a pocket. MD (16) is gated by a detector of the paper's reference 26,
which was not available. This one is ours, on the one signal that an unknown attitude leaves: the strength |B|. Over a
window that ends at the sample, of n samples of |B| with standard deviation sigma,

    T = sum (|B| - mean)^2 / sigma^2      is chi squared with n - 1 degrees of freedom in a static field.

The rate d|B|/dt alone vanishes where the strength is greatest, in the midst of a disturbance; the scatter does not.
If the strength changes evenly by the least change that matters across the window, T is noncentral with

    lambda = (matters / sigma)^2 sum_j (j/(n - 1) - 1/2)^2 = (matters / sigma)^2 n (n + 1) / (12 (n - 1)),

and the threshold is its quantile at the false-alarm rate: the share of such changes that pass. A field that turns and
keeps its strength is not detected, and an uncalibrated magnetometer is disturbed by its own turning. Only measured
samples count, not the NaN rows of a slow magnetometer. At the beginning, and after a gap, the window is shorter, and is
judged as if all of a change had to happen in it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from scipy.special import chndtrix

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.errors import MagneticError
from fg_nav.frames import average_angles, wrap_angle
from fg_nav.magnetic.detectors import (
    ALIGNMENT_FOOTFALLS,
    DEFAULT,
    DETECTORS,
    FALSE_ALARM_RATE,
    HEADING_DRIFT,
    TUNED,
    Detector,
    find_own_detectors,
)
from fg_nav.magnetic.footfall_field import FootfallField
from fg_nav.recording import Recording
from fg_nav.text import format_count, format_ratio

__all__ = ["DEFAULT", "DETECTORS", "GATES", "NO_GATE", "Detector", "FieldVerdicts", "find_detector", "judge_field"]

NO_GATE = "none"  # The gate that weighs all footfalls alike.
HARD = ":hard"  # Suffix of a gate, the papers' switch: the compass is used at its full weight or not at all.
GATES = (*DETECTORS, NO_GATE, *(name + HARD for name in DETECTORS))  # Weights of the compass at a footfall, by name.
PRIOR_COUNT = 2.0  # Weight of the walk's own spread against one footfall's statistic, in changes of the field.

NO_FIELD, TOO_LITTLE = "no field was measured at this footfall", "too little of the field was measured at this footfall"
QUASI_STATIC, DISTURBED, UNKNOWN = "quasi-static", "disturbed", "none"  # Verdicts; `none` where there is none.
WINDOW_S = 1.0  # Of samples: a walker passes a lamp or a car in one to three seconds.
MIN_SAMPLES = 3  # Of the field in a window that is judged.
SIGMA_UT = 0.15  # Of one sample of |B|: noise, 0.11 on the simulated MTw, and the residual of a calibration in a turn.
MATTERS_UT = 0.5  # Least change over the window to be rejected: across a field of 48 uT a turn of half a degree.
SETTINGS: Mapping[str, float] = MappingProxyType(
    {
        "window_s": WINDOW_S,
        "sigma_uT": SIGMA_UT,
        "matters_uT": MATTERS_UT,
        "false_alarm_rate": FALSE_ALARM_RATE,
    }
)  # For a file of results.


class OverThreshold:
    """Verdicts by a statistic (F,) over its threshold: below 1 the field passes; NaN where there is none."""

    statistic: Floats

    @property
    def judged(self) -> Bools:
        """(F,) True where there was enough of the field to judge it."""
        return np.isfinite(self.statistic)

    @property
    def quasi_static(self) -> Bools:
        """(F,) True where the field passes; never where it was not judged."""
        with np.errstate(invalid="ignore"):
            return np.asarray(self.statistic < 1.0)


@dataclass(frozen=True)
class FieldVerdicts(OverThreshold):
    """Verdicts on the field, one a footfall.

    Attributes
    ----------
    detector : its name.
    statistic : (F,) of the detector, over its threshold.
    threshold : of the statistic, in the detector's own units.
    reason : (F,) of the verdict, in words.
    """

    detector: str
    statistic: Floats
    threshold: float
    reason: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.statistic)

    @property
    def coverage(self) -> float:
        """Share of all footfalls whose field passes."""
        return float(self.quasi_static.mean()) if len(self) else 0.0

    @property
    def words(self) -> tuple[str, ...]:
        """(F,) the verdicts as they stand in `strides.csv`."""
        passed = np.where(self.quasi_static, QUASI_STATIC, DISTURBED)
        return tuple(str(word) for word in np.where(self.judged, passed, UNKNOWN))


def find_detector(name: str) -> Detector:
    """Return the detector of this name, known or of another package; raises `MagneticError` for any other name."""
    found = DETECTORS.get(name) or find_own_detectors().get(name)
    if found is None:
        known = ", ".join((*DETECTORS, *find_own_detectors()))
        raise MagneticError(f"there is no detector '{name}': choose one of {known}.")
    return found


def find_gate(gate: str) -> Detector:
    """Return the detector of a gate, hard or not, which is the one of the filter of that name."""
    name = gate.removesuffix(HARD)
    return TUNED.get(name) or find_detector(name)


def choose_gate(name: str | None) -> str:
    """Return the gate that was asked for, or the default; raises `MagneticError` if there is none of this name."""
    if name is not None and name not in GATES and name.removesuffix(HARD) not in find_own_detectors():
        known = ", ".join((*GATES, *find_own_detectors()))
        raise MagneticError(f"there is no gate '{name}': choose one of {known}.")
    return DEFAULT if name is None else name


def apply_gate(field: FootfallField, gate: str) -> FieldVerdicts:
    """Judge the field by the gate of this name, one of `GATES`; raises `MagneticError` as `find_detector`."""
    if gate != NO_GATE:
        return judge_field(field, find_gate(gate))
    seen = np.isfinite(field.strength)
    reasons = tuple("there is no gate" if one else NO_FIELD for one in seen)
    return FieldVerdicts(NO_GATE, np.where(seen, 0.0, np.nan), np.inf, reasons)


def weigh_statistic(verdicts: FieldVerdicts, gate: str) -> Floats:
    """Variance (F,) of the compass at each footfall over that of the whole walk, by the statistic of the gate.

    The statistic T sums n squared changes of the field, and is v chi squared for a field of variance v. So T over its
    median estimates v relative to the walk; with a prior worth `PRIOR_COUNT` changes the posterior mean is

        (PRIOR_COUNT + n T / median T) / (PRIOR_COUNT + n).

    A hard gate has 1 where it passes the field and infinity elsewhere; without a gate all are 1.
    """
    if gate.endswith(HARD):
        return np.where(verdicts.quasi_static, 1.0, np.inf)
    judged = verdicts.judged
    if gate == NO_GATE or not judged.any() or not (middle := float(np.median(verdicts.statistic[judged]))) > 0.0:
        return np.ones(len(verdicts))
    detector = find_gate(gate)
    count = detector.window * len(detector.channels)
    ratio = np.where(judged, verdicts.statistic / middle, 1.0)
    return np.asarray((PRIOR_COUNT + count * ratio) / (PRIOR_COUNT + count))


def count_needed(gate: str) -> int | None:
    """Latest footfalls that a verdict of this gate depends on; None for all so far, which align a heading offset."""
    if gate == NO_GATE:
        return 1
    detector = find_gate(gate)
    return detector.max_strides + 1 if detector.offset_column is None else None


def judge_field(field: FootfallField, detector: Detector | str = DEFAULT) -> FieldVerdicts:
    """Judge the field at each footfall by it and those before it.

    One footfall after the other, the latest (`count_needed`) are enough; with a heading offset, whose alignment depends
    on earlier verdicts, all of them are needed.

    Parameters
    ----------
    field : at F footfalls, in order of time.
    detector : or its name in `DETECTORS`.

    Raises `MagneticError` for a name that is none, or a detector without a threshold.
    """
    chosen = find_detector(detector) if isinstance(detector, str) else detector
    threshold = chosen.threshold
    values = np.stack([channel.values(field) for channel in chosen.channels], axis=1)
    sigmas = np.stack([channel.sigmas(field) for channel in chosen.channels], axis=1)
    # the footfalls that have a field, without whole turns between neighbours
    measured = np.flatnonzero(np.isfinite(values + sigmas).all(axis=1))
    values, sigmas = values[measured], sigmas[measured]
    angles = [c for c, channel in enumerate(chosen.channels) if channel.signal.angle and channel.signal.value]
    values[:, angles] = np.unwrap(values[:, angles], axis=0)
    # those whose window has all its footfalls, near enough to each other
    strides = chosen.rows - 1
    complete = np.zeros(len(measured), dtype=np.bool_)
    complete[strides:] = measured[strides:] - measured[: max(len(measured) - strides, 0)] <= chosen.max_strides
    if chosen.offset_column is not None:
        complete[:ALIGNMENT_FOOTFALLS] = False
        _align_heading(values, sigmas, field.t[measured], complete, chosen, threshold)
    # one statistic a window, over the threshold
    ends = np.flatnonzero(complete)
    rows = ends[:, None] + np.arange(-strides, 1)
    windows = np.swapaxes(values[rows], 1, 2)
    parts = chosen.compute_parts(windows / np.swapaxes(sigmas[rows], 1, 2)) / threshold
    statistic = np.full(len(field), np.nan)
    statistic[measured[ends]] = parts.sum(axis=1)
    # reasons, first why a footfall is not judged
    reasons = [TOO_LITTLE if known else NO_FIELD for known in np.isfinite(field.strength)]
    for n, footfall in enumerate(measured):
        reasons[footfall] = f"over {format_count(strides, 'stride')} there are too many footfalls without a field"
        if n < strides:
            reasons[footfall] = f"fewer than {format_count(chosen.rows, 'footfall')} with a field so far"
        if chosen.offset_column is not None and n < ALIGNMENT_FOOTFALLS:
            reasons[footfall] = "here the inertial heading is aligned with the compass"
    for end, reason in zip(ends, _explain_verdicts(windows, parts, measured, ends, chosen), strict=True):
        reasons[measured[end]] = reason
    return FieldVerdicts(chosen.name, statistic, threshold, tuple(reasons))


def _align_heading(
    values: Floats, sigmas: Floats, t: Floats, complete: Bools, detector: Detector, threshold: float
) -> None:
    """Subtract the alignment (scalar Kalman filter) from the heading offset, and add its variance; both in place."""
    column, first = detector.offset_column, min(ALIGNMENT_FOOTFALLS, len(values))
    if column is None or not first:
        return
    difference, noise = values[:, column].copy(), detector.channels[column].sigma ** 2
    alignment, variance = average_angles(difference[:first]), noise / first
    for k in range(len(values)):
        # predict: the inertial heading drifts
        if k >= first:
            variance += HEADING_DRIFT**2 * (t[k] - t[k - 1])
        values[k, column] = wrap_angle(difference[k] - alignment)
        if detector.counts_drift:
            sigmas[k, column] = np.sqrt(noise + variance)
        # update where the field passes
        window = slice(k + 1 - detector.rows, k + 1)
        if complete[k] and detector.compute_statistic((values[window] / sigmas[window]).T) < threshold:
            gain = variance / (variance + noise)
            alignment, variance = alignment + gain * values[k, column], (1.0 - gain) * variance


def _explain_verdicts(windows: Floats, parts: Floats, measured: Ints, ends: Ints, detector: Detector) -> list[str]:
    """Reasons (E,) of the verdicts at footfalls `ends`: channel of the largest part of T, the others in brackets."""
    described = []
    for values, channel in zip(np.swapaxes(windows, 0, 1), detector.channels, strict=True):
        signal = channel.signal
        number = (np.ptp(values, axis=1) if signal.value else values[:, -1]) * signal.scale
        words = f"{channel.name} changes by" if signal.value else channel.name
        described.append([f"{words} {each:.2g} {signal.unit}" for each in number])
    strides = measured[ends] - measured[ends + 1 - detector.rows]
    reasons = []
    for each, part, count in zip(zip(*described, strict=True), parts, strides, strict=True):
        first, *others = (each[c] for c in np.argsort(-part, kind="stable"))
        rest = f" ({', '.join(others)})" if others else ""
        over = f"over {format_count(int(count), 'stride')}" if count else "this stance"
        reasons.append(f"{over}: {first}{rest}; {format_ratio(part.sum())} times the threshold")
    return reasons


@dataclass(frozen=True)
class Disturbance(OverThreshold):
    """Verdicts on each of N samples.

    Attributes
    ----------
    statistic : (N,) over its threshold; NaN where there were too few samples of the field.
    """

    statistic: Floats


def find_sample_threshold(count: int) -> float:
    """Threshold of the statistic of a sample with `count` samples in its window."""
    noncentrality = (MATTERS_UT / SIGMA_UT) ** 2 * count * (count + 1) / (12 * (count - 1))
    return float(chndtrix(FALSE_ALARM_RATE, count - 1, noncentrality))


def judge_samples(recording: Recording) -> Disturbance:
    """Judge the field at each sample by the window that ends there.

    Raises `MagneticError` without a magnetometer, or if no window has enough samples of the field.
    """
    if recording.mag is None:
        raise MagneticError("the recording has no magnetometer, so nothing is known of the field: record with one.")
    t, strength = recording.t, np.linalg.norm(recording.mag, axis=1)
    fresh = np.isfinite(strength)
    value = np.where(fresh, strength - (np.median(strength[fresh]) if fresh.any() else 0.0), 0.0)
    # sums over the window that ends at each sample
    begin = np.searchsorted(t, t - WINDOW_S, side="right")
    totals = (np.concatenate([[0.0], np.cumsum(x)]) for x in (fresh.astype(np.float64), value, value**2))
    samples, total, squares = (x[1:] - x[begin] for x in totals)
    scatter = np.maximum(squares - total**2 / np.maximum(samples, 1.0), 0.0)
    count = np.rint(samples).astype(np.int64)
    if not (count >= MIN_SAMPLES).any():
        raise MagneticError(
            f"no {WINDOW_S:g} s of the recording have {MIN_SAMPLES} samples of the field: record it faster."
        )
    threshold = np.full(count.max() + 1, np.nan)
    for n in np.unique(count[count >= MIN_SAMPLES]):
        threshold[n] = find_sample_threshold(int(n))
    return Disturbance(scatter / SIGMA_UT**2 / threshold[count])
