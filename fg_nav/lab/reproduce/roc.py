"""How well a field detector separates quasi-static fields from the rest: ROC curve, and bands over walks.

What is true: `fg_nav.lab.field_survey`.

ROC. A detector declares a signal where its statistic is below a threshold; the signal is the quasi-static field, as in
Ma 2018, Figure 8:

    P_D  = P(statistic < threshold | signal),      P_FA = P(statistic < threshold | no signal),
    area = P(statistic of a signal < statistic of another) + P(they are equal) / 2      (Mann and Whitney).

The curve goes through one point for each distinct value of the statistic, so ties make one sloping stroke. Cases
without a statistic do not count.

Bands. Neighbouring stances share their field and their window; walks of different seeds share nothing. So each band is
a jackknife over walks: with a_w the figure without walk w, all on the scale of the logit,

    sigma^2 = (W - 1) / W sum_w (a_w - mean a)^2,        band = a +- t_{W-1} sigma.

With ten walks, where a percentile bootstrap is too narrow, it covers what it claims; of one walk it is the figure.

References: Fawcett, An introduction to ROC analysis, Pattern Recognition Letters 27 (2006); Efron and Tibshirani, An
Introduction to the Bootstrap (1993), chapter 11.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import expit, logit
from scipy.stats import t as student_t

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.errors import EvaluationError
from fg_nav.lab.reproduce.results import Spread

LEVEL = 0.9  # Probability of a band.


@dataclass(frozen=True)
class Roc:
    """A detector's cases, counted: `make_roc` makes one."""

    statistic: Floats  # (T,) its distinct values, rising.
    signals: Ints  # (W, T) how many of a walk's cases have that value or less,
    others: Ints  # and the same of cases without a signal.

    @property
    def n_walks(self) -> int:
        """How many walks."""
        return len(self.signals)

    @property
    def p_d(self) -> Floats:
        """(T + 1,) probability of detection along the curve, from 0 to 1; all walks together."""
        return np.asarray(_compute_shares(self.signals.sum(axis=0, keepdims=True))[0])

    @property
    def p_fa(self) -> Floats:
        """(T + 1,) probability of false alarm along the curve."""
        return np.asarray(_compute_shares(self.others.sum(axis=0, keepdims=True))[0])

    @property
    def area(self) -> float:
        """Area under the curve: 0.5 is guessing, 1 is never wrong."""
        return float(np.trapezoid(self.p_d, self.p_fa))

    def at(self, threshold: float) -> tuple[float, float]:
        """P_D and P_FA with this threshold."""
        k = int(np.searchsorted(self.statistic, threshold, side="left"))  # how many distinct values are below
        return float(self.p_d[k]), float(self.p_fa[k])

    def area_band(self) -> Spread:
        """Area under the curve with its band."""
        fewest = min(self.signals[:, -1].sum(), self.others[:, -1].sum())
        p_d, p_fa = (_compute_shares(_leave_one_out(counts)) for counts in (self.signals, self.others))
        return _find_band(self.area, np.asarray(np.trapezoid(p_d, p_fa, axis=1)), fewest)

    def band_at(self, threshold: float) -> tuple[Spread, Spread]:
        """P_D and P_FA with this threshold, each with its band."""
        k = int(np.searchsorted(self.statistic, threshold, side="left"))
        p_d, p_fa = (
            _find_band(value, _compute_shares(_leave_one_out(counts))[:, k], counts[:, -1].sum())
            for value, counts in zip(self.at(threshold), (self.signals, self.others), strict=True)
        )
        return p_d, p_fa


def make_roc(statistic: Floats, signal: Bools, walk: Ints | None = None) -> Roc:
    """Count the cases of a detector.

    `statistic` (M,) is small where the detector sees a signal, `signal` (M,) True where there truly is one, and `walk`
    (M,) which walk a case is of, by any numbers; None for one walk. Cases whose statistic is not finite are left out,
    and a walk that has no other is none. Raises `EvaluationError` without a case, or without one of each kind.
    """
    judged = np.isfinite(statistic)
    kind = signal[judged]
    if not len(kind):
        raise EvaluationError(f"none of the {len(statistic)} cases has a statistic: without one there is no ROC.")
    if kind.all() or not kind.any():
        words = "are all signals" if kind.all() else "have no signal among them"
        raise EvaluationError(f"the {len(kind)} judged cases {words}: a ROC needs both kinds, try another limit.")
    numbers = np.zeros(len(statistic), dtype=np.int64) if walk is None else walk
    walks, row = np.unique(numbers[judged], return_inverse=True)
    values, column = np.unique(statistic[judged], return_inverse=True)
    counts = np.zeros((2, len(walks), len(values)), dtype=np.int64)
    np.add.at(counts, (kind.astype(np.int64), row, column), 1)
    others, signals = np.cumsum(counts, axis=2)
    return Roc(values, signals, others)


def _leave_one_out(counts: Ints) -> Ints:
    """(W, T) of all walks but one, each time another."""
    return np.asarray(counts.sum(axis=0, keepdims=True) - counts)


def _compute_shares(counts: Ints) -> Floats:
    """(B, T + 1) shares along the curve, from 0, of counts (B, T) up to each value; NaN where there is nothing."""
    with np.errstate(invalid="ignore"):
        return np.pad(counts / counts[:, -1:], ((0, 0), (1, 0)))


def _find_band(value: float, left_out: Floats, cases: int) -> Spread:
    """Band of a share, from the same with each walk left out (W,); half a case off 0 and 1."""
    walks, edge = len(left_out), 0.5 / (cases + 1)
    if walks < 2:
        return Spread(value, value, value, walks)
    near, far = (logit(np.clip(share, edge, 1 - edge)) for share in (value, left_out))
    reach = student_t.ppf((1 + LEVEL) / 2, walks - 1) * np.sqrt((walks - 1) * np.var(far))
    if not np.isfinite(reach):
        return Spread(value, 0.0, 1.0, walks)
    return Spread(value, min(float(expit(near - reach)), value), max(float(expit(near + reach)), value), walks)
