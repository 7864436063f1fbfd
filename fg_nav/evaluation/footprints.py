"""Which stance stands on which surveyed footprint.

Footprints carry a stride number n and no time; stance k = n + offset. Where the detector found as many
stances as the walk has, offset is 0 throughout. Where it found D more (or fewer), the offset must go from 0
to D somewhere: an extra stance shifts all later numbers up, a missed one shifts them down. The places are
unknown, so D single shifts are put, one after the other, where they make the rigid fit best without losing a
footprint that need not be lost. Nothing else is adjustable, and what was done is said in `notes`: an
off-by-one at the first stride would otherwise read as an error of one stride length everywhere.

A footprint without a stance (the missed one itself, or one beyond the last stance) cannot be scored; it is
counted.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import EvaluationError
from fg_nav.evaluation.alignment import align
from fg_nav.recording import FootprintTruth

MIN_FOOTPRINTS = 3
"""Two footprints can nearly always be fitted by a rotation and a shift: they test only their distance."""

MISSED = -1
"""In place of a stance index: this footprint has no stance."""


@dataclass(frozen=True)
class FootprintMatch:
    """`stance` (M,) is the stance index of each footprint, or `MISSED`; `notes` say what was assumed."""

    stance: Ints
    notes: tuple[str, ...]

    @property
    def found(self) -> Ints:
        """Rows of the footprints that have a stance."""
        return np.flatnonzero(self.stance != MISSED)


def match_footprints(stance_xy: Floats, truth: FootprintTruth) -> FootprintMatch:
    """Match stances at `stance_xy` (K, 2) m, in any frame, with surveyed footprints by stride number.

    Raises
    ------
    EvaluationError
        Where fewer than `MIN_FOOTPRINTS` footprints have a stance.
    """
    surplus = 0 if truth.stride_count is None else len(stance_xy) - 1 - truth.stride_count
    stance, notes = truth.stride.astype(np.int64), []
    for _ in range(abs(surplus)):
        options = list(_shifted(stance, int(np.sign(surplus))))
        stance = min(options, key=lambda option: _misfit(option, stance_xy, truth.xy))
    if surplus:
        notes.append(_surplus_note(surplus, len(stance_xy)))
    stance = np.where(stance < len(stance_xy), stance, MISSED)
    match = FootprintMatch(stance, tuple(notes + _missed_note(stance, truth)))
    if len(match.found) < MIN_FOOTPRINTS:
        raise EvaluationError(
            f"only {len(match.found)} of {len(stance)} surveyed footprints have a stance "
            f"({len(stance_xy)} stances were found), and {MIN_FOOTPRINTS} are needed: check the detection."
        )
    return match


def _shifted(stance: Ints, step: int) -> Iterator[Ints]:
    """All ways to shift the stances of a tail of the footprints by one; two footprints never share a stance.

    Where they would, the missed stance was that of the earlier footprint (another row covers the later one).
    """
    rows = np.arange(len(stance))
    for first in range(len(stance) + 1):
        option = np.where((rows >= first) & (stance != MISSED), stance + step, stance)
        before = np.flatnonzero((rows < first) & (stance != MISSED))
        after = np.flatnonzero((rows >= first) & (stance != MISSED))
        if len(before) and len(after) and option[before[-1]] == option[after[0]]:
            option[before[-1]] = MISSED
        yield option


def _misfit(stance: Ints, stance_xy: Floats, xy: Floats) -> tuple[int, float]:
    """Footprints without a stance, then mean square distance in m^2: losing a footprint must not pay."""
    use = (stance != MISSED) & (stance < len(stance_xy))
    lost = int(np.count_nonzero(~use))
    if lost == len(use):
        return lost, float("inf")
    p, q = in_space(stance_xy[stance[use]]), in_space(xy[use])
    return lost, float(np.mean(np.sum((align(p, q).apply(p) - q) ** 2, axis=1)))


def in_space(xy: Floats) -> Floats:
    """Points (M, 2) on the ground as (M, 3) at height zero."""
    return np.column_stack([xy[:, :2], np.zeros(len(xy))])


def _surplus_note(surplus: int, stances: int) -> str:
    kind = "more" if surplus > 0 else "fewer"
    return (
        f"{stances} stances are {abs(surplus)} {kind} than the walk has: stride numbers were shifted at "
        f"{abs(surplus)} place{'s' if abs(surplus) > 1 else ''}, where that fits the footprints best"
    )


def _missed_note(stance: Ints, truth: FootprintTruth) -> list[str]:
    missed = truth.stride[stance == MISSED]
    if not len(missed):
        return []
    return [f"no stance for footprint{'s' if len(missed) > 1 else ''} {', '.join(map(str, missed))}: not scored"]
