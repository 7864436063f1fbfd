"""Quasi-static footfalls: a detector applied to a walk, and its verdicts.

The detectors, their model and the place to add one are in `fg_nav.magnetic.detectors`.

A window holds the last footfalls that have a field, but none that spans more strides than twice its length, for that
would compare places far apart. The first footfalls, before which there are too few, are not judged.

A verdict uses its footfall and those before it. The inertial headings do not: their gyro bias is that of the longest
rest, wherever it lies in the recording (`fg_nav.magnetic.footfall_field`). An estimator that has better attitudes
replaces `nav_R_body` in the footfall field and has it judged again.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.errors import MagneticError
from fg_nav.frames import wrap_angle
from fg_nav.magnetic.detectors import DEFAULT, DETECTORS, HEADING_DRIFT, TUNED, Channel, Detector
from fg_nav.magnetic.footfall_field import FootfallField
from fg_nav.text import format_count, format_ratio

__all__ = ["DEFAULT", "DETECTORS", "GATES", "NO_GATE", "Detector", "FieldVerdicts", "find_detector", "judge_field"]

NO_GATE = "none"  # The gate that weighs all footfalls alike.
HARD = ":hard"  # Behind the name of a gate: the papers' switch. The compass is used at its full weight or not at all.
GATES = (*DETECTORS, NO_GATE, *(name + HARD for name in DETECTORS))  # Names of what weighs the compass at a footfall.

NO_FIELD, TOO_LITTLE = "no field was measured at this footfall", "too little of the field was measured at this footfall"
"""Reasons; the second where a mean could be taken, and not what else a detector asks for."""

QUASI_STATIC, DISTURBED, UNKNOWN = "quasi-static", "disturbed", "none"
"""Verdicts in words; `none` where the field was not judged."""


class OverThreshold:
    """Verdicts of a statistic (F,) over its threshold; NaN where there is none."""

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
    statistic : (F,) the detector's statistic over its threshold: below 1 the field passes; NaN where there is none.
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
    """Return the detector of this name; raises `MagneticError` for any other name."""
    if name not in DETECTORS:
        raise MagneticError(f"there is no detector '{name}': choose one of {', '.join(DETECTORS)}.")
    return DETECTORS[name]


def find_gate(gate: str) -> Detector:
    """Return the detector of a gate, hard or not, which is the one of the filter of that name."""
    name = gate.removesuffix(HARD)
    find_detector(name)
    return TUNED[name]


def choose_gate(name: str | None, use_magnetometer: bool = True) -> str:
    """Return the gate that was asked for, or the default; raises `MagneticError` if it cannot be."""
    if name is not None and name not in GATES:
        raise MagneticError(f"there is no gate '{name}': choose one of {', '.join(GATES)}.")
    if name is not None and not use_magnetometer:
        raise MagneticError("--no-mag leaves --gate nothing to judge: give one of them.")
    return DEFAULT if name is None else name


def apply_gate(field: FootfallField, gate: str) -> FieldVerdicts:
    """Judge the field by the gate of this name, one of `GATES`; raises `MagneticError` as `find_detector`."""
    if gate != NO_GATE:
        return judge_field(field, find_gate(gate))
    seen = np.isfinite(field.strength)
    reasons = tuple("there is no gate" if one else NO_FIELD for one in seen)
    return FieldVerdicts(NO_GATE, np.where(seen, 0.0, np.nan), np.inf, reasons)


PRIOR_COUNT = 2.0
"""Of the walk's own spread against one footfall's statistic, in changes of the field: its weight never hangs on one."""


def weigh_statistic(verdicts: FieldVerdicts, gate: str) -> Floats:
    """Variance (F,) of the compass at each footfall over that of the whole walk's, by the statistic of the gate.

    A statistic T is a sum of n squares of changes of the field; under a spread v it is v chi squared. So T over its
    median is the variance at the footfall over the walk's, and with the walk's worth `PRIOR_COUNT` changes its
    posterior mean is

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
    return _longest_span(detector) + 1 if detector.offset_column is None else None


def judge_field(field: FootfallField, detector: Detector | str = DEFAULT) -> FieldVerdicts:
    """Judge the field at each footfall by it and those before it.

    One footfall after the other, the latest (`count_needed`) are enough; with a heading offset, whose alignment depends
    on earlier verdicts, all of them are needed.

    Parameters
    ----------
    field : at F footfalls, in order of time.
    detector : or its name in `DETECTORS`.

    Raises
    ------
    MagneticError
        For a name that is none, or a detector without a threshold.
    """
    chosen = find_detector(detector) if isinstance(detector, str) else detector
    threshold = chosen.threshold
    values = np.stack([channel.values(field) for channel in chosen.channels], axis=1)
    sigmas = np.stack([channel.sigmas(field) for channel in chosen.channels], axis=1)
    measured = np.flatnonzero(np.isfinite(values + sigmas).all(axis=1))
    # the footfalls that have a field, and those whose window is complete
    values, sigmas = _unwrap_angles(values[measured], chosen), sigmas[measured]
    complete = _find_complete(measured, chosen)
    _align_heading(values, sigmas, field.t[measured], complete, chosen, threshold)
    # one statistic a window, over the threshold
    ends = np.flatnonzero(complete)
    windows = _cut_windows(values, ends, chosen.rows)
    parts = chosen.compute_parts(windows / _cut_windows(sigmas, ends, chosen.rows)) / threshold
    statistic = np.full(len(field), np.nan)
    statistic[measured[ends]] = parts.sum(axis=1)
    reasons = _explain_missing(field, measured, chosen)
    for k, reason in zip(ends, _explain_verdicts(windows, parts, measured, ends, chosen), strict=True):
        reasons[measured[k]] = reason
    return FieldVerdicts(chosen.name, statistic, threshold, tuple(reasons))


def _unwrap_angles(values: Floats, detector: Detector) -> Floats:
    """The values (M, C) without whole turns between neighbours, in place."""
    angles = [c for c, channel in enumerate(detector.channels) if channel.signal.angle and channel.signal.value]
    values[:, angles] = np.unwrap(values[:, angles], axis=0)
    return values


def _find_complete(measured: Ints, detector: Detector) -> Bools:
    """(M,) True where the window that ends there has all its footfalls and they are near enough to each other."""
    complete = np.zeros(len(measured), dtype=bool)
    strides = detector.rows - 1
    span = measured[strides:] - measured[: max(len(measured) - strides, 0)]
    complete[strides:] = span <= _longest_span(detector)
    complete[: detector.alignment_footfalls] = False
    return complete


def _longest_span(detector: Detector) -> int:
    """Strides that a window may span, those without a field included."""
    return 2 * (detector.rows - 1)


def _cut_windows(values: Floats, ends: Ints, rows: int) -> Floats:
    """(E, C, rows) the values (M, C) of as many footfalls up to each end."""
    return np.swapaxes(values[ends[:, None] + np.arange(1 - rows, 1)], 1, 2)


def _align_heading(
    values: Floats, sigmas: Floats, t: Floats, complete: Bools, detector: Detector, threshold: float
) -> None:
    """Subtract the alignment from the heading offset, and add its variance to the sigma; both in place."""
    column, first = detector.offset_column, detector.alignment_footfalls
    if column is None or not len(values):
        return
    difference, noise = values[:, column].copy(), detector.channels[column].sigma ** 2
    first = min(first, len(values))
    alignment, variance = _compute_circular_mean(difference[:first]), noise / first
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


def _compute_circular_mean(angle: Floats) -> float:
    return float(np.arctan2(np.sin(angle).mean(), np.cos(angle).mean()))


def _explain_missing(field: FootfallField, measured: Ints, detector: Detector) -> list[str]:
    """(F,) in words, why a footfall is not judged."""
    there = np.isfinite(field.strength)
    reasons = [TOO_LITTLE if known else NO_FIELD for known in there]
    for k, footfall in enumerate(measured):
        reasons[footfall] = (
            f"over {format_count(detector.rows - 1, 'stride')} there are too many footfalls without a field"
        )
        if k < detector.rows - 1:
            reasons[footfall] = f"fewer than {format_count(detector.rows, 'footfall')} with a field so far"
        if k < detector.alignment_footfalls:
            reasons[footfall] = "here the inertial heading is aligned with the compass"
    return reasons


def _explain_verdicts(windows: Floats, parts: Floats, measured: Ints, ends: Ints, detector: Detector) -> list[str]:
    """(E,) in words, the reason of each verdict: the channel with the largest part first, the others in brackets."""
    strides = measured[ends] - measured[ends + 1 - detector.rows]
    channels = zip(
        *(_describe_channel(windows[:, c], channel) for c, channel in enumerate(detector.channels)), strict=True
    )
    reasons = []
    for each, part, count in zip(channels, parts, strides, strict=True):
        first, *others = (each[c] for c in np.argsort(-part, kind="stable"))
        rest = f" ({', '.join(others)})" if others else ""
        over = f"over {format_count(int(count), 'stride')}" if count else "this stance"
        reasons.append(f"{over}: {first}{rest}; {format_ratio(part.sum())} times the threshold")
    return reasons


def _describe_channel(values: Floats, channel: Channel) -> list[str]:
    """(E,) in words, the change of a channel in each window (E, rows)."""
    signal = channel.signal
    number = np.ptp(values, axis=1) if signal.value else values[:, -1]
    words = f"{channel.name} changes by" if signal.value else channel.name
    return [f"{words} {each:.2g} {signal.unit}" for each in number * signal.scale]
