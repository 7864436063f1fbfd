"""The stance intervals of a walk: when the foot stands, found once and shared by every estimator.

An interval `k` covers the samples `start[k] <= i < stop[k]`. Intervals are disjoint and in order. A footfall is
all that happens between two swings: mostly one interval, several where a standing foot fidgets. Footfalls are
what a walk is counted in, and results have one row for each.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.errors import DetectionError


@dataclass(frozen=True)
class Stances:
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


def find_runs(mask: Bools) -> tuple[Ints, Ints]:
    """First sample (K,) and sample after the last (K,) of each run of True in an (N,) mask."""
    edges = np.diff(np.concatenate(([False], mask, [False])).astype(np.int8))
    return np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
