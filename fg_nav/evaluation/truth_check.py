"""Can a truth be that of a walk at all? Judged before the walk is solved, by what a person on foot cannot do.

    moves too fast      over a second, or a stride, than a person runs: another unit, or a wrong row
    hardly moves        degrees of latitude in place of m, a constant, another clock
    too many strides    than fit into the recording

A truth in feet or in km passes here: `evaluate` compares its size with that of the path.
"""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import EvaluationError
from fg_nav.truth import FootprintTruth, TrajectoryTruth, Truth

MAX_M_S = 12.5  # A person on foot over a second: the fastest sprint is 12.4 m/s.
MAX_STRIDE_M = 5.0  # From a footprint to the next of the same foot, in a sprint.
MIN_EXTENT_M = 0.05  # Over ground; a foot moves by more where one walks on the spot, and 5 km are 0.05 degrees.
MAX_STRIDES_PER_S = 3.0  # Of one foot, in a sprint.

_UNITS = {"cm": 100.0, "mm": 1000.0}
_USUAL_M_S, _USUAL_STRIDE_M, _TIMES_USUAL = 1.5, 1.3, 4.0
"""The fastest second of a walk and its longest stride; those of a given walk are within so many times of it."""

_WINDOW_S = 1.0


def check_truth(truth: Truth, t: Floats) -> None:
    """Raise `EvaluationError` if a truth cannot be that of a walk with samples at `t` (N,) s."""
    if isinstance(truth, FootprintTruth):
        _check_footprints(truth, float(t[-1] - t[0]))
    else:
        _check_path(truth, t)


def _check_path(truth: TrajectoryTruth, t: Floats) -> None:
    inside = np.isfinite(truth.position).all(axis=1) & (truth.t >= t[0]) & (truth.t <= t[-1])
    stamps, position = truth.t[inside], truth.position[inside]
    if len(stamps) < 2:
        return  # that they share no time is said where they are compared
    first, speed = _measure_speeds(stamps, position)
    if speed.max() > MAX_M_S:
        at = f"{speed.max():.3g} m/s from {stamps[first[np.argmax(speed)]]:.3f} s on"
        what = _explain_size(speed, MAX_M_S, _USUAL_M_S)
        raise EvaluationError(f"the truth moves at {at}, faster than anyone runs: {what}.")
    extent = _measure_extent(position[:, :2])
    if extent < MIN_EXTENT_M:
        raise EvaluationError(
            f"the truth moves by {extent:.2g} m over ground in the {stamps[-1] - stamps[0]:.3g} s that it shares with "
            "the recording: give places in m, not degrees, and stamps in s of the recording's clock."
        )


def _measure_speeds(t: Floats, position: Floats) -> tuple[Ints, Floats]:
    """Mean speeds (M,) m/s over a second or the next longer step, and the rows (M,) where they begin."""
    last = np.searchsorted(t, t + _WINDOW_S)
    first = np.flatnonzero(last < len(t))
    first, last = (first, last[first]) if len(first) else (np.array([0]), np.array([len(t) - 1]))
    return first, _measure_distances(position[last], position[first]) / np.maximum(t[last] - t[first], _WINDOW_S)


def _measure_distances(one: Floats, other: Floats) -> Floats:
    """Distances (M,) m; of absurd numbers the largest there is."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(np.nan_to_num(np.linalg.norm(one - other, axis=1), nan=np.inf))


def _check_footprints(truth: FootprintTruth, duration_s: float) -> None:
    strides = max(truth.stride_count or 0, int(truth.stride.max(initial=0)))
    most = MAX_STRIDES_PER_S * (duration_s + 1.0)
    if strides > most:
        raise EvaluationError(
            f"the truth counts {strides} strides, and in {duration_s:.1f} s a foot makes at most {most:.0f}: check "
            "that it is of this recording."
        )
    if len(truth.stride) < 2:
        return  # too few to compare is said where they are compared
    apart = _measure_distances(truth.xy[1:], truth.xy[:-1]) / np.diff(truth.stride)
    if apart.max() > MAX_STRIDE_M:
        stride = truth.stride[np.argmax(apart) + 1]
        raise EvaluationError(
            f"the footprints up to stride {stride} are {apart.max():.3g} m a stride apart, farther than anyone runs: "
            f"{_explain_size(apart, MAX_STRIDE_M, _USUAL_STRIDE_M)}."
        )
    extent = _measure_extent(truth.xy)
    if extent < MIN_EXTENT_M:
        raise EvaluationError(f"the footprints lie within {extent:.2g} m: give their places in m, not degrees.")


def _measure_extent(position: Floats) -> float:
    return float(np.linalg.norm(np.ptp(position, axis=0)))


def _explain_size(sizes: Floats, most: float, usual: float) -> str:
    """What to do about speeds or strides beyond the most there can be: another unit, if many are, else a wrong row."""
    largest = float(sizes.max())
    far = {unit: abs(float(np.log(largest / factor / usual))) for unit, factor in _UNITS.items()}
    unit = min(far, key=lambda unit: far[unit])
    if np.percentile(sizes, 75) > most and far[unit] < np.log(_TIMES_USUAL):
        return f"it seems to be in {unit}, divide by {_UNITS[unit]:.0f}"
    return "correct that row, and give places in m"
