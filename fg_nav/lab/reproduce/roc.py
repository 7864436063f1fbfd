"""How well a field detector separates quasi-static fields from the rest: what is true, ROC curve, and bands over walks.

True. A detector looks at the N steps between the N + 1 stances up to the one it judges. The field of such a window is
truly quasi-static if it is the same at all of its stances, up to a limit: with b_i the true field there, in nav,

    change_k = max |b_i - b_j|    over all pairs    k - N <= i < j <= k.

All pairs, and not the steps alone: a compass that was used over the window is off by the whole change. With horizontal
strength H its heading changes by asin(limit / H) at most. Static is not right: a field can differ from the Earth's and
stay so (`measure_compass_deviation`).

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

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.special import expit, logit
from scipy.stats import t as student_t

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.errors import EvaluationError
from fg_nav.frames import wrap_angle
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


# --- what is true ----------------------------------------------------------------------------------------------------


def measure_field_change(nav_field: Floats, window: int) -> Floats:
    """Largest change (F,) uT of the true field's vector over the window of each stance; NaN before a whole window.

    `nav_field` (F, 3) uT is true, in nav, at the footfalls; `window` is N, the steps in it. Raises `EvaluationError`
    for a window of no step, or a walk that is shorter than one window.
    """
    _check_window(nav_field, window)
    return _find_largest(nav_field, window, lambda a, b: np.linalg.norm(a - b, axis=1))


def measure_compass_deviation(nav_field: Floats, earth_field: Floats) -> Floats:
    """Error (F,) rad of the heading that a perfect compass shows in `nav_field` (F, 3) uT, clockwise.

    `earth_field` (3,) or (F, 3) is the field without what deviates it.
    """
    return wrap_angle(_bearing(earth_field) - _bearing(nav_field))


def measure_course_change(position: Floats, window: int) -> Floats:
    """Largest difference (F,) rad between the directions of any two of a window's N steps; NaN before the first.

    `position` (F, 3) m, true, at the footfalls. Raises `EvaluationError` as `measure_field_change`.
    """
    _check_window(position, window)
    course = _bearing(np.diff(position, axis=0))
    change = _find_largest(course, window - 1, lambda a, b: np.abs(wrap_angle(a - b)))
    return np.concatenate([[np.nan], change])


def _check_window(of_stances: Floats, window: int) -> None:
    if window < 1 or len(of_stances) <= window:
        raise EvaluationError(
            f"a window of {window} steps cannot be laid over {len(of_stances)} stances: "
            f"it needs one step, and {window + 1} stances."
        )


def _bearing(vector: Floats) -> Floats:
    """Direction (...,) rad over the ground of (..., 3), clockwise from north."""
    return np.asarray(np.arctan2(vector[..., 0], vector[..., 1]))


def _find_largest(values: Floats, window: int, distance: Callable[[Floats, Floats], Floats]) -> Floats:
    """Largest distance (F,) between any two of the `window` + 1 values up to each; NaN before."""
    count = len(values) - window
    largest = np.zeros(count)
    for a, b in combinations([values[lag : lag + count] for lag in range(window + 1)], 2):
        largest = np.maximum(largest, distance(a, b))
    return np.concatenate([np.full(window, np.nan), largest])
