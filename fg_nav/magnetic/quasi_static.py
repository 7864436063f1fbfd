"""Which footfalls stand in a quasi-static field: a detector (`fg_nav.magnetic.detectors`) put to a walk.

Footfalls without a field are passed over: a window holds the last footfalls that have one. The first, before which
there are too few, are not judged.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import MagneticError
from fg_nav.frames import wrap
from fg_nav.magnetic.channels import SIGNALS, Channel
from fg_nav.magnetic.detectors import Detector, Laying
from fg_nav.magnetic.footfall_field import FootfallField
from fg_nav.magnetic.presets import DEFAULT, DETECTORS
from fg_nav.magnetic.verdicts import FieldVerdicts
from fg_nav.wording import counted

__all__ = ["DEFAULT", "DETECTORS", "SIGNALS", "Channel", "Detector", "Laying", "detector_named", "judge"]


def detector_named(name: str) -> Detector:
    """Return the detector of this name; raises `MagneticError` for any other name."""
    if name not in DETECTORS:
        raise MagneticError(f"there is no detector '{name}': choose one of {', '.join(DETECTORS)}.")
    return DETECTORS[name]


def judge(field: FootfallField, detector: Detector | str = DEFAULT) -> FieldVerdicts:
    """Judge the field at each footfall by it and those before it.

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
    measured = np.flatnonzero(np.isfinite(values).all(axis=1) & np.isfinite(sigmas).all(axis=1))
    values, sigmas = values[measured], sigmas[measured]
    first = _lay(values, sigmas, field.t[measured], chosen, threshold)
    windows = _windows(_unwrapped(values, chosen) / sigmas, chosen.rows)
    statistic = np.full(len(field), np.nan)
    ends = measured[chosen.rows - 1 :]
    statistic[ends] = chosen.statistic(windows) / threshold
    statistic[measured[:first]] = np.nan
    return FieldVerdicts(
        chosen.name, statistic, threshold, _reasons(len(field), measured, values, windows, statistic, chosen)
    )


def _unwrapped(values: Floats, detector: Detector) -> Floats:
    angles = [c for c, channel in enumerate(detector.channels) if channel.signal.angle and channel.signal.value]
    out = values.copy()
    out[:, angles] = np.unwrap(values[:, angles], axis=0)
    return out


def _windows(standardised: Floats, rows: int) -> Floats:
    """(M, C, rows), one for each footfall before which there are enough."""
    if len(standardised) < rows:
        return np.empty((0, standardised.shape[1], rows))
    return np.asarray(sliding_window_view(standardised, rows, axis=0))


def _lay(values: Floats, sigmas: Floats, t: Floats, detector: Detector, threshold: float) -> int:
    """Take the laid inertial heading off the heading offset, in place; returns how many footfalls were spent on it."""
    column, laying = detector.offset_column, detector.laying
    if column is None:
        return 0
    difference, noise = values[:, column].copy(), detector.channels[column].sigma ** 2
    first = min(laying.first, len(values))
    laid = _circular_mean(difference[:first]) if first else 0.0
    variance = noise / first if first else 0.0
    for k in range(len(values)):
        if k > 0:
            variance += laying.drift**2 * (t[k] - t[k - 1]) if k >= first else 0.0
        values[k, column] = wrap(difference[k] - laid)
        if laying.in_test:
            sigmas[k, column] = np.sqrt(noise + variance)
        if k >= max(first, detector.rows - 1) and _passes(values, sigmas, k, detector, threshold):
            gain = variance / (variance + noise)
            laid, variance = laid + gain * values[k, column], (1.0 - gain) * variance
    return first


def _passes(values: Floats, sigmas: Floats, k: int, detector: Detector, threshold: float) -> bool:
    window = slice(k + 1 - detector.rows, k + 1)
    standardised = _unwrapped(values[window], detector) / sigmas[window]
    return bool(detector.statistic(standardised.T) < threshold)


def _circular_mean(angle: Floats) -> float:
    return float(np.arctan2(np.sin(angle).mean(), np.cos(angle).mean()))


def _reasons(
    count: int, measured: Ints, values: Floats, windows: Floats, statistic: Floats, detector: Detector
) -> tuple[str, ...]:
    """(F,) in words."""
    reasons = ["no field was measured at this footfall"] * count
    for k, footfall in enumerate(measured):
        reasons[footfall] = f"fewer than {counted(detector.rows, 'footfall')} with a field so far"
        if np.isfinite(statistic[footfall]):
            start = k + 1 - detector.rows
            reasons[footfall] = _reason(values[start : k + 1], windows[start], statistic[footfall], detector)
        elif _spent(k, detector):
            reasons[footfall] = "here the inertial heading is laid on the compass"
    return tuple(reasons)


def _spent(k: int, detector: Detector) -> bool:
    """Whether footfall k only begins the offset between compass and inertial heading."""
    return detector.offset_column is not None and k < detector.laying.first


def _reason(values: Floats, window: Floats, statistic: float, detector: Detector) -> str:
    """The channel that says most first, the others beside it."""
    parts = _parts(window, detector)
    told = [_told(values[:, c], channel) for c, channel in enumerate(detector.channels)]
    order = np.argsort(-parts, kind="stable")
    beside = f" ({', '.join(told[c] for c in order[1:])})" if len(order) > 1 else ""
    over = "this stance" if detector.rows == 1 else f"over {counted(detector.rows - 1, 'stride')}"
    return f"{over}: {told[order[0]]}{beside}; {statistic:.2g} times the threshold"


def _parts(window: Floats, detector: Detector) -> Floats:
    """(C,) what each channel alone would make of the statistic."""
    parts = np.zeros(len(detector.channels))
    for c in range(len(parts)):
        alone = np.zeros_like(window)
        alone[c] = window[c]
        parts[c] = detector.statistic(alone)
    return parts


def _told(values: Floats, channel: Channel) -> str:
    signal = channel.signal
    if signal.value:
        change = np.ptp(np.unwrap(values) if signal.angle else values) * signal.scale
        return f"{channel.name} changes by {change:.2g} {signal.unit}"
    return f"{channel.name} {values[-1] * signal.scale:.2g} {signal.unit}"
