"""What a detector says of the field at each footfall: whether to trust it, by how much, and why."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Bools, Floats

QUASI_STATIC, DISTURBED, UNKNOWN = "quasi-static", "disturbed", "none"
"""Verdicts in words; `none` where the field was not judged."""


class OverThreshold:
    """What a statistic (F,) over its threshold says by itself; NaN where there is none."""

    statistic: Floats

    @property
    def judged(self) -> Bools:
        """(F,) True where there was enough to judge by."""
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
    reason : (F,) what the verdict rests on, in words.
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
