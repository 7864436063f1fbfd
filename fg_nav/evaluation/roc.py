"""How well a detector tells signal from the rest: ROC curve, area under it, and bands over walks.

A detector declares a signal where its statistic is below a threshold. Of the field detectors the signal is the
quasi-static field, and this is Ma's convention (2018, Figure 8):

    P_D  = P(statistic < threshold | signal),      P_FA = P(statistic < threshold | no signal),
    area = P(statistic of a signal < statistic of another) + P(they are equal) / 2      (Mann and Whitney).

The curve goes through one point for each distinct value of the statistic, so that ties make one sloping stroke and the
area under it is exactly that of Mann and Whitney. Cases without a statistic count neither way.

Bands. Neighbouring stances share their field and their window; walks of different seeds share nothing. So walks are
what is independent, and each band is a jackknife over them: with a_w the figure without walk w, all on the scale of
the logit, which keeps a share between 0 and 1,

    sigma^2 = (W - 1) / W sum_w (a_w - mean a)^2,        band = a +- t_{W-1} sigma.

It draws nothing at random, and with ten walks, where a percentile bootstrap is too narrow, it covers what it claims.

References: Fawcett, An introduction to ROC analysis, Pattern Recognition Letters 27 (2006); Efron and Tibshirani, An
Introduction to the Bootstrap (1993), chapter 11.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student_t

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.errors import EvaluationError

LEVEL = 0.9
"""Of bands, where nothing else is said."""


@dataclass(frozen=True)
class Band:
    """A figure, and between which two values it lies with a given probability; 0 and 1 where nothing is known."""

    value: float
    low: float
    high: float

    def __contains__(self, truth: float) -> bool:
        return self.low <= truth <= self.high


@dataclass(frozen=True)
class Roc:
    """A detector's cases, counted: `roc_of` makes one.

    Attributes
    ----------
    statistic : (T,) its distinct values, rising.
    signals, others : (W, T) how many of a walk's cases have that value or less.
    """

    statistic: Floats
    signals: Ints
    others: Ints

    @property
    def n_walks(self) -> int:
        """How many walks."""
        return len(self.signals)

    @property
    def prevalence(self) -> float:
        """Share of the cases that are signals."""
        signals, others = self.signals[:, -1].sum(), self.others[:, -1].sum()
        return float(signals / (signals + others))

    @property
    def p_d(self) -> Floats:
        """(T + 1,) probability of detection along the curve, from 0 to 1; all walks together."""
        return np.asarray(_shares(_together(self.signals))[0])

    @property
    def p_fa(self) -> Floats:
        """(T + 1,) probability of false alarm along the curve."""
        return np.asarray(_shares(_together(self.others))[0])

    @property
    def area(self) -> float:
        """Area under the curve: 0.5 is guessing, 1 is never wrong."""
        return float(_areas(_together(self.signals), _together(self.others))[0])

    def at(self, threshold: float) -> tuple[float, float]:
        """P_D and P_FA with this threshold."""
        k = self._below(threshold)
        return float(self.p_d[k]), float(self.p_fa[k])

    @property
    def knee(self) -> tuple[float, float, float]:
        """Statistic, P_D and P_FA where P_D - P_FA is largest: beyond it P_FA grows faster than P_D."""
        k = max(int(np.argmax(self.p_d - self.p_fa)), 1)
        return float(self.statistic[k - 1]), float(self.p_d[k]), float(self.p_fa[k])

    def p_d_at(self, p_fa: Floats) -> Floats:
        """P_D where the curve has these false-alarm probabilities."""
        return np.asarray(np.interp(p_fa, self.p_fa, self.p_d))

    def area_band(self, level: float = LEVEL) -> Band:
        """Area under the curve with its band.

        Raises
        ------
        EvaluationError
            With one walk only, here as in all bands.
        """
        fewest = min(self.signals[:, -1].sum(), self.others[:, -1].sum())
        left_out = _areas(_one_left_out(self.signals), _one_left_out(self.others))
        return _one(_jackknife(np.array([self.area]), left_out[:, None], fewest, level))

    def band_at(self, threshold: float, level: float = LEVEL) -> tuple[Band, Band]:
        """P_D and P_FA with this threshold, each with its band."""
        k = self._below(threshold)
        found = []
        for counts in (self.signals, self.others):
            share, left_out = _shares(_together(counts))[0, [k]], _shares(_one_left_out(counts))[:, [k]]
            found.append(_one(_jackknife(share, left_out, counts[:, -1].sum(), level)))
        return found[0], found[1]

    def curve_band(self, p_fa: Floats, level: float = LEVEL) -> tuple[Floats, Floats]:
        """Between which two values P_D lies at each of these false-alarm probabilities (G,)."""
        p_d, other = (_shares(_one_left_out(counts)) for counts in (self.signals, self.others))
        whole = [np.isfinite(d).all() and np.isfinite(f).all() for d, f in zip(p_d, other, strict=True)]
        left_out = [
            np.interp(p_fa, f, d) if usable else np.full(len(p_fa), np.nan)
            for d, f, usable in zip(p_d, other, whole, strict=True)
        ]
        _, low, high = _jackknife(self.p_d_at(p_fa), np.array(left_out), self.signals[:, -1].sum(), level)
        return low, high

    def _below(self, threshold: float) -> int:
        """Index along the curve: how many distinct values are below the threshold."""
        return int(np.searchsorted(self.statistic, threshold, side="left"))


def roc_of(statistic: Floats, signal: Bools, walk: Ints | None = None) -> Roc:
    """Count the cases of a detector.

    Parameters
    ----------
    statistic : (M,), small where the detector sees a signal; cases where it is not finite are left out.
    signal : (M,) True where there truly is one.
    walk : (M,) which walk a case is of, by any numbers; None for one walk. A walk of which no case has a statistic is
        none.

    Raises
    ------
    EvaluationError
        Where there is no case with a statistic, or none of one kind.
    """
    judged = np.isfinite(statistic)
    _check(signal[judged], len(statistic))
    numbers = np.zeros(len(statistic), dtype=np.int64) if walk is None else walk
    walks, row = np.unique(numbers[judged], return_inverse=True)
    values, column = np.unique(statistic[judged], return_inverse=True)
    kinds = [_counted(row, column, signal[judged] == kind, (len(walks), len(values))) for kind in (True, False)]
    return Roc(values, *kinds)


def _check(signal: Bools, cases: int) -> None:
    if not len(signal):
        raise EvaluationError(f"none of the {cases} cases has a statistic: without one there is no ROC.")
    if signal.all() or not signal.any():
        kind = "are all signals" if signal.all() else "have no signal among them"
        raise EvaluationError(f"the {len(signal)} judged cases {kind}: a ROC needs both kinds, try another limit.")


def _counted(walk: Ints, column: Ints, chosen: Bools, shape: tuple[int, int]) -> Ints:
    """(W, T) cases of a walk up to each value."""
    flat = np.bincount(walk[chosen] * shape[1] + column[chosen], minlength=shape[0] * shape[1])
    return np.asarray(np.cumsum(flat.reshape(shape), axis=1), dtype=np.int64)


def _together(counts: Ints) -> Ints:
    """(1, T) of all walks."""
    return np.asarray(counts.sum(axis=0, keepdims=True))


def _one_left_out(counts: Ints) -> Ints:
    """(W, T) of all walks but one, each time another."""
    if len(counts) < 2:
        raise EvaluationError("a band over walks needs two walks or more, and there is one: simulate more seeds.")
    return np.asarray(_together(counts) - counts)


def _shares(counts: Ints) -> Floats:
    """(B, T + 1) shares along the curve, from 0, of counts (B, T) up to each value; NaN where there is nothing."""
    with np.errstate(invalid="ignore"):
        return np.pad(counts / counts[:, -1:], ((0, 0), (1, 0)))


def _areas(signals: Ints, others: Ints) -> Floats:
    """(B,) areas under the curves of counts (B, T)."""
    return np.asarray(np.trapezoid(_shares(signals), _shares(others), axis=1))


def _jackknife(value: Floats, left_out: Floats, cases: int, level: float) -> tuple[Floats, Floats, Floats]:
    """Shares (G,) with low and high, from the same with each walk left out (W, G); half a case off 0 and 1."""
    walks, edge = len(left_out), 0.5 / (cases + 1)
    near, far = (_logit(np.clip(share, edge, 1 - edge)) for share in (value, left_out))
    sigma = np.sqrt((walks - 1) * np.var(far, axis=0))
    reach = student_t.ppf((1 + level) / 2, walks - 1) * sigma
    low, high = _share(near - reach), _share(near + reach)
    return value, np.fmin(np.nan_to_num(low, nan=0.0), value), np.fmax(np.nan_to_num(high, nan=1.0), value)


def _one(found: tuple[Floats, Floats, Floats]) -> Band:
    value, low, high = (float(part[0]) for part in found)
    return Band(value, low, high)


def _logit(share: Floats) -> Floats:
    return np.asarray(np.log(share / (1 - share)))


def _share(logit: Floats) -> Floats:
    return np.asarray(1 / (1 + np.exp(-logit)))
