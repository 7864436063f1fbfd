"""Which footfalls stand in a quasi-static field: a detector (`fg_nav.magnetic.detectors`) put to a walk.

Footfalls without a field are passed over: a window holds the last footfalls that have one, but none that passes over
more strides than it looks at, for that would compare places far apart. The first footfalls, before which there are too
few, are not judged.

A verdict rests on its footfall and those before it. The inertial headings do not: their gyro bias is that of the
longest rest, wherever it lies in the recording (`fg_nav.magnetic.attitude`). An estimator that has better attitudes
replaces `nav_R_body` in the footfall field and has it judged again.
"""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.errors import MagneticError
from fg_nav.frames import wrap
from fg_nav.magnetic.channels import Channel
from fg_nav.magnetic.detectors import Detector
from fg_nav.magnetic.footfall_field import FootfallField
from fg_nav.magnetic.presets import DEFAULT, DETECTORS
from fg_nav.magnetic.verdicts import FieldVerdicts
from fg_nav.wording import counted

__all__ = ["DEFAULT", "DETECTORS", "Detector", "detector_named", "judge"]

NO_FIELD, TOO_LITTLE = "no field was measured at this footfall", "too little of the field was measured at this footfall"
"""Reasons; the second where a mean could be taken, and not what else a detector asks for."""


def detector_named(name: str) -> Detector:
    """Return the detector of this name; raises `MagneticError` for any other name."""
    if name not in DETECTORS:
        raise MagneticError(f"there is no detector '{name}': choose one of {', '.join(DETECTORS)}.")
    return DETECTORS[name]


def judge(field: FootfallField, detector: Detector | str = DEFAULT) -> FieldVerdicts:
    """Judge the field at each footfall by it and those before it.

    Who judges one footfall after the other needs no more than the last `Detector.rows` that have a field; with a
    heading offset, which remembers what it was laid on, all of them.

    Parameters
    ----------
    field : at F footfalls, in order of time.
    detector : or its name in `DETECTORS`.

    Raises
    ------
    MagneticError
        For a name that is none, or a detector whose threshold cannot be told.
    """
    chosen = detector_named(detector) if isinstance(detector, str) else detector
    threshold = chosen.threshold
    values = np.stack([channel.values(field) for channel in chosen.channels], axis=1)
    sigmas = np.stack([channel.sigmas(field) for channel in chosen.channels], axis=1)
    measured = np.flatnonzero(np.isfinite(values + sigmas).all(axis=1))
    values, sigmas = _unwrapped(values[measured], chosen), sigmas[measured]
    whole = _whole(measured, chosen)
    _lay(values, sigmas, field.t[measured], whole, chosen, threshold)
    ends = np.flatnonzero(whole)
    windows = _windows(values, ends, chosen.rows)
    parts = chosen.parts(windows / _windows(sigmas, ends, chosen.rows)) / threshold
    statistic = np.full(len(field), np.nan)
    statistic[measured[ends]] = parts.sum(axis=1)
    reasons = _reasons_not_to(field, measured, chosen)
    for k, reason in zip(ends, _reasons(windows, parts, measured, ends, chosen), strict=True):
        reasons[measured[k]] = reason
    return FieldVerdicts(chosen.name, statistic, threshold, tuple(reasons))


def _unwrapped(values: Floats, detector: Detector) -> Floats:
    """The values (M, C) without whole turns between neighbours, in place."""
    angles = [c for c, channel in enumerate(detector.channels) if channel.signal.angle and channel.signal.value]
    values[:, angles] = np.unwrap(values[:, angles], axis=0)
    return values


def _whole(measured: Ints, detector: Detector) -> Bools:
    """(M,) True where the window that ends there has all its footfalls and they are near enough to each other."""
    whole = np.zeros(len(measured), dtype=bool)
    strides = detector.rows - 1
    whole[strides:] = measured[strides:] - measured[: max(len(measured) - strides, 0)] <= 2 * strides
    whole[: detector.spent] = False
    return whole


def _windows(values: Floats, ends: Ints, rows: int) -> Floats:
    """(E, C, rows) the values (M, C) of as many footfalls up to each end."""
    return np.swapaxes(values[ends[:, None] + np.arange(1 - rows, 1)], 1, 2)


def _lay(values: Floats, sigmas: Floats, t: Floats, whole: Bools, detector: Detector, threshold: float) -> None:
    """Take the laid inertial heading off the heading offset, and put its doubt on the sigma; both in place."""
    column, laying = detector.offset_column, detector.laying
    if column is None:
        return
    difference, noise = values[:, column].copy(), detector.channels[column].sigma ** 2
    first = min(laying.first, len(values))
    laid = _circular_mean(difference[:first]) if first else 0.0
    variance = noise / first if first else 0.0
    for k in range(len(values)):
        if k >= max(first, 1):
            variance += laying.drift**2 * (t[k] - t[k - 1])
        values[k, column] = wrap(difference[k] - laid)
        if laying.in_test:
            sigmas[k, column] = np.sqrt(noise + variance)
        window = slice(k + 1 - detector.rows, k + 1)
        if whole[k] and detector.statistic((values[window] / sigmas[window]).T) < threshold:
            gain = variance / (variance + noise)
            laid, variance = laid + gain * values[k, column], (1.0 - gain) * variance


def _circular_mean(angle: Floats) -> float:
    return float(np.arctan2(np.sin(angle).mean(), np.cos(angle).mean()))


def _reasons_not_to(field: FootfallField, measured: Ints, detector: Detector) -> list[str]:
    """(F,) in words, why a footfall is not judged."""
    there = np.isfinite(field.strength)
    reasons = [TOO_LITTLE if known else NO_FIELD for known in there]
    for k, footfall in enumerate(measured):
        reasons[footfall] = f"over {counted(detector.rows - 1, 'stride')} there are too many footfalls without a field"
        if k < detector.rows - 1:
            reasons[footfall] = f"fewer than {counted(detector.rows, 'footfall')} with a field so far"
        if k < detector.spent:
            reasons[footfall] = "here the inertial heading is laid on the compass"
    return reasons


def _reasons(windows: Floats, parts: Floats, measured: Ints, ends: Ints, detector: Detector) -> list[str]:
    """(E,) in words, what each verdict rests on: the channel that says most first, the others beside it."""
    strides = measured[ends] - measured[ends + 1 - detector.rows]
    told = zip(*(_told(windows[:, c], channel) for c, channel in enumerate(detector.channels)), strict=True)
    reasons = []
    for each, part, count in zip(told, parts, strides, strict=True):
        first, *others = (each[c] for c in np.argsort(-part, kind="stable"))
        beside = f" ({', '.join(others)})" if others else ""
        over = f"over {counted(int(count), 'stride')}" if count else "this stance"
        reasons.append(f"{over}: {first}{beside}; {part.sum():.2g} times the threshold")
    return reasons


def _told(values: Floats, channel: Channel) -> list[str]:
    """(E,) in words, what a channel says in each window (E, rows)."""
    signal = channel.signal
    number = np.ptp(values, axis=1) if signal.value else values[:, -1]
    words = f"{channel.name} changes by" if signal.value else channel.name
    return [f"{words} {each:.2g} {signal.unit}" for each in number * signal.scale]
