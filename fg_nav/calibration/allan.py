"""Allan deviation of a reading at rest, and the noise that it shows.

    AVAR(tau) = N^2 / tau  +  (2 ln 2 / pi) B^2  +  K^2 tau / 3

======= ============ ==========================================================================================
symbol  unit (of u)  meaning
======= ============ ==========================================================================================
u                    of the reading: rad/s, m/s^2 or uT
tau     s            averaging time
N       u/sqrt(Hz)   white noise: one of sigma a sample at a rate f has N = sigma / sqrt(f)
B       u            flicker: spectral density B^2 / (2 pi |f|). The curve's floor is sqrt(2 ln 2 / pi) B = 0.664 B
K       u/sqrt(s)    random walk: after t seconds its standard deviation is K sqrt(t)
======= ============ ==========================================================================================

Densities are over positive and negative frequencies (IEEE Std 952-1997, annex C): a sheet that counts the positive ones
only prints sqrt(2) N. What sheets call bias instability is mostly the lowest point of the curve; it stands next to B.

The deviation is the overlapping one (Riley, NIST SP 1065, 2008, Eq. 11). The fit is least squares on AVAR, no part
below zero, each averaging time weighted by its variance under the fitted model, and no better than `MODEL_SHARE`: no
sensor keeps to the three laws. A part less than `MIN_SIGMAS` above zero is not seen; the fit is then made without it,
and `limit` says how much of it could be hidden. Filters and held values bend the short end of a curve, a
magnetometer's above all: the fit begins where the laws hold.

Covariance of AVAR at several averaging times, exactly. With theta the integral of the reading y, in samples, and

    z_m(i) = theta(i + 2m) - 2 theta(i + m) + theta(i),    AVAR(m) = mean of z_m(i)^2 / (2 m^2) over M_m = n + 1 - 2m,

z is normal with mean 0, so (Isserlis)

    cov(AVAR(m), AVAR(m')) = sum_u count(u) R_mm'(u)^2 / (2 m^2 m'^2 M_m M_m')
    R_mm'(u) = sum_ab c_a c_b G(u + b m' - a m),    c = 1, -2, 1

where R_mm'(u) is the covariance of z_m(i) and z_m'(i + u), count(u) how many pairs lie u apart, and G the generalized
covariance of theta: -N^2 |t| / 2 of white noise, B^2 t^2 ln|t| / (2 pi) of flicker, K^2 |t|^3 / 12 of a random walk. R
is a sum over the three, so the covariance is a quadratic form in (N^2, B^2, K^2) with nine matrices. It replaces the
tables of equivalent degrees of freedom by noise type (Riley, section 5.4).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations_with_replacement

import numpy as np
from scipy.optimize import nnls
from scipy.stats import chi2

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import CalibrationError

FLOOR = float(np.sqrt(2 * np.log(2) / np.pi))  # Deviation of flicker with B = 1.
ONE_SIDED_95 = 1.645  # Sigmas that a normal error exceeds in one of twenty.
MIN_READINGS = 40  # Fewer make no curve of a decade.


PER_DECADE = 8
"""Averaging times in a decade: their values are as good as independent from some 4 on, and a curve wants more."""

MAX_SHARE = 0.25  # Of the record: the longest averaging time, which is then seen four times.

MODEL_SHARE = 0.03
"""Of AVAR: how closely a sensor follows the three laws (assumed; filters and quantization bend the short end)."""

MIN_SIGMAS = 2.0  # A part is seen if it is this far above zero.

MAX_MISFIT = 2.0
"""A curve that fits worse is bent, by a filter, held values or the mains: its short end is then left out."""

START_COUNT = 4
"""Averaging times at which the fit begins, half a decade, judged on their own: there a filter's end shows."""

START_SHARE = 0.015
"""Of AVAR: how far these may be off, rms, besides twice their statistical sigma; half of `MODEL_SHARE`."""

MIN_TIMES = 8  # Averaging times that a fit is made of at least, a decade.
CONFIDENCE = 0.68  # Of the band about the deviation.

MIN_VARIANCE = 1e-12
"""Of the largest variance: coarse steps of a reading can hide all of its noise at one averaging time."""

ROUNDS = 12  # The weights follow the model: after half as many it stays to a thousandth.

EVERY_LAG, GROWTH = 24, 1.08
"""Covariance: every lag is summed within so many samples of an instant at which the two differences meet; beyond, each
lag is so many times as far from it as the one before: 4e-4 off the whole sum."""


@dataclass(frozen=True)
class AllanCurve:
    """Overlapping Allan deviation.

    Attributes
    ----------
    tau_s : (F,) averaging times.
    factors : (F,) the same in samples.
    deviation : (F,) in the unit of the reading.
    count, period_s : readings that it was made of, and the time between two.
    """

    tau_s: Floats
    factors: Ints
    deviation: Floats
    count: int
    period_s: float


@dataclass(frozen=True)
class NoisePart:
    """N, B or K: `value` and its `sigma` where it is `seen`, else zero; `limit` is not exceeded with 95 per cent."""

    value: float
    sigma: float
    limit: float
    seen: bool


@dataclass(frozen=True)
class NoiseFit:
    """What a curve shows.

    Attributes
    ----------
    white, flicker, walk : N, B and K in the units above.
    low, high : (F,) band about the measured deviation, of `CONFIDENCE`.
    lowest, lowest_tau_s : the curve's lowest point, which sheets call bias instability.
    fitted_from_s : averaging time at which the fit begins.
    misfit : mean square of the residuals in their sigmas, 1 or less where the three laws hold.
    """

    white: NoisePart
    flicker: NoisePart
    walk: NoisePart
    low: Floats
    high: Floats
    lowest: float
    lowest_tau_s: float
    fitted_from_s: float
    misfit: float

    def deviation_at(self, tau_s: Floats) -> Floats:
        """Allan deviation of the fitted model at averaging times (...,) s."""
        N, B, K = self.white.value, self.flicker.value, self.walk.value
        return np.asarray(np.sqrt(N**2 / tau_s + (FLOOR * B) ** 2 + K**2 * tau_s / 3))


def choose_averaging_factors(count: int) -> Ints:
    """Averaging times (F,) in samples, evenly spaced on a logarithmic scale where that leaves whole numbers."""
    longest = max(1.0, MAX_SHARE * count)
    steps = 1 + int(np.log10(longest) * PER_DECADE)
    return np.unique(np.round(np.geomspace(1.0, longest, max(2, steps)))).astype(np.int64)


def compute_allan_curve(readings: Floats, period_s: float, factors: Ints | None = None) -> AllanCurve:
    """Overlapping Allan deviation of evenly sampled readings (n,), in time linear in n for each averaging time.

    Raises `CalibrationError` for too few readings, missing ones, or averaging times that they do not hold twice.
    """
    n = len(readings)
    if not np.isfinite(readings).all():
        raise CalibrationError("readings are missing or not finite: give a stretch without gaps to an Allan deviation.")
    if n < MIN_READINGS:
        raise CalibrationError(f"{n} readings make no Allan deviation: record at least {MIN_READINGS}.")
    chosen = choose_averaging_factors(n) if factors is None else np.asarray(factors, dtype=np.int64)
    if chosen.min() < 1 or 2 * chosen.max() > n:
        raise CalibrationError(f"averages of {chosen.max()} samples do not fit into {n} twice: choose shorter ones.")
    whole = np.concatenate([[0.0], np.cumsum(readings - readings.mean())])
    variance = [np.mean((whole[2 * m :] - 2 * whole[m:-m] + whole[: -2 * m]) ** 2) / (2.0 * m**2) for m in chosen]
    return AllanCurve(np.asarray(chosen * period_s), chosen, np.sqrt(np.array(variance)), n, period_s)


def fit_noise(curve: AllanCurve) -> NoiseFit:
    """Find N, B and K of a curve, from the shortest averaging time on from which the three laws fit it."""
    observed = curve.deviation**2
    if not observed.any():
        return _fit_silence(curve)
    scale, m = float(observed.max()), curve.factors.astype(np.float64)
    laws = np.column_stack([1 / m, np.full(len(m), FLOOR**2), m / 3])  # for a sampling period of 1
    products = compute_covariance_products(curve.count, tuple(int(f) for f in curve.factors))
    whole = _Laws(observed / scale, laws, products)
    first, all_three = _fit_from_start(whole)
    found = _drop_unseen(whole.beginning(first), all_three)
    limit = all_three.value + ONE_SIDED_95 * all_three.sigma
    to_si = scale * np.array([curve.period_s, 1.0, 1.0 / curve.period_s])
    white, flicker, walk = (_part(found, k, float(limit[k]), float(to_si[k])) for k in range(3))
    low, high = _band(curve.deviation, found.value, whole)
    k = int(np.argmin(curve.deviation))
    return NoiseFit(
        white, flicker, walk, low, high, float(curve.deviation[k]), float(curve.tau_s[k]),
        float(curve.tau_s[first]), found.misfit,
    )  # fmt: skip


@dataclass(frozen=True)
class _Laws:
    """Variances (F,) at their averaging times, the three laws there (F, 3), and what their covariance is made of."""

    observed: Floats
    laws: Floats
    products: Floats

    def beginning(self, first: int) -> _Laws:
        """The same without the first so many averaging times."""
        return _Laws(self.observed[first:], self.laws[first:], self.products[:, :, first:, first:])

    def covariance(self, value: Floats) -> Floats:
        """Covariance (F, F) of the variances under N^2, B^2, K^2."""
        return np.asarray(np.einsum("k,l,klij->ij", value, value, self.products))


def _fit_from_start(whole: _Laws) -> tuple[int, _Squares]:
    """Where the fit begins and what it is there: the first place that fits, or the best where none does."""
    tried = []
    for first in range(max(1, len(whole.observed) - MIN_TIMES)):
        found = _Squares.fit(whole.beginning(first), (0, 1, 2))
        if found.misfit < MAX_MISFIT and found.starts_straight:
            return first, found
        tried.append(found)
    first = int(np.argmin([found.misfit for found in tried]))
    return first, tried[first]


def _drop_unseen(whole: _Laws, found: _Squares) -> _Squares:
    """Fit without what is not seen, the least of it first."""
    while len(found.parts) > 1 and found.significance.min() < MIN_SIGMAS:
        least = found.parts[int(np.argmin(found.significance))]
        found = _Squares.fit(whole, tuple(part for part in found.parts if part != least))
    return found


def _fit_silence(curve: AllanCurve) -> NoiseFit:
    """What a reading shows that never changes: nothing, whatever its resolution hides."""
    nothing = NoisePart(0.0, 0.0, 0.0, False)
    none, first_s = curve.deviation, float(curve.tau_s[0])
    return NoiseFit(nothing, nothing, nothing, none, none, 0.0, first_s, first_s, misfit=0.0)


def _part(found: _Squares, k: int, limit: float, to_si: float) -> NoisePart:
    """N, B or K from its square; `limit` of the square is for where it is not seen."""
    square, sigma = float(found.value[k]) * to_si, float(found.sigma[k]) * to_si
    if k not in found.parts or square <= 0.0:
        return NoisePart(0.0, 0.0, float(np.sqrt(max(limit * to_si, 0.0))), False)
    value = float(np.sqrt(square))
    return NoisePart(value, sigma / (2 * value), float(np.sqrt(square + ONE_SIDED_95 * sigma)), True)


@dataclass(frozen=True)
class _Squares:
    """N^2, B^2, K^2 for a sampling period of 1: `value` and `sigma` (3,), zero but for `parts`."""

    parts: tuple[int, ...]
    value: Floats
    sigma: Floats
    misfit: float
    starts_straight: bool

    @property
    def significance(self) -> Floats:
        """Of each of `parts`, in sigmas."""
        chosen = list(self.parts)
        return np.asarray(self.value[chosen] / np.maximum(self.sigma[chosen], 1e-300))

    @classmethod
    def fit(cls, whole: _Laws, parts: tuple[int, ...]) -> _Squares:
        """Least squares on these parts, weighted by what the model itself says, until it stays."""
        chosen, value = list(parts), np.zeros(3)
        X, observed = whole.laws[:, chosen], whole.observed
        weight = 1 / np.maximum(observed, MIN_VARIANCE)
        for _ in range(ROUNDS):
            value[chosen], _ = nnls(weight[:, None] * X, weight * observed)
            model, covariance = whole.laws @ value, whole.covariance(value)
            weight = 1 / np.sqrt(np.diag(covariance) + (MODEL_SHARE * model) ** 2)
        residual = weight * (observed - model)
        misfit = float(residual @ residual / max(1, len(observed) - len(chosen)))
        inverse = np.linalg.pinv(weight[:, None] * X) * weight
        sigma = np.zeros(3)
        sigma[chosen] = np.sqrt(max(1.0, misfit) * np.diag(inverse @ covariance @ inverse.T))
        start = slice(0, START_COUNT)
        allowed = (START_SHARE * model) ** 2 + 4 * np.diag(covariance)
        straight = bool(((observed - model)[start] ** 2 / allowed[start]).mean() < 1.0)
        return cls(parts, value, sigma, misfit, straight)


def _band(deviation: Floats, value: Floats, whole: _Laws) -> tuple[Floats, Floats]:
    """Where the true deviation lies: AVAR is about chi-square with the degrees of freedom that its variance says."""
    freedom = 2 * (whole.laws @ value) ** 2 / np.diag(whole.covariance(value))
    high, low = (chi2.ppf(p, freedom) for p in ((1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2))
    return deviation * np.sqrt(freedom / low), deviation * np.sqrt(freedom / high)


_COEFFICIENT = np.array([1.0, -2.0, 1.0])


@lru_cache(maxsize=16)
def compute_covariance_products(count: int, factors: tuple[int, ...]) -> Floats:
    """Matrices (3, 3, F, F) in which the covariance of the Allan variances is quadratic.

    Parameters
    ----------
    count : readings n.
    factors : m, averaging times in samples.

    Returns
    -------
    P with cov = sum_kl beta_k beta_l P_kl, beta = (N^2, B^2, K^2) for a sampling period of 1.
    """
    size = len(factors)
    products = np.empty((3, 3, size, size))
    for i, j in combinations_with_replacement(range(size), 2):
        products[:, :, i, j] = products[:, :, j, i] = _pair(count, factors[i], factors[j])
    products.flags.writeable = False
    return products


def _pair(count: int, m: int, other: int) -> Floats:
    terms, others = count + 1 - 2 * m, count + 1 - 2 * other
    lag, width = _lags(m, other, count)
    pairs = np.clip(np.minimum(terms, others - lag) - np.maximum(0, -lag), 0, None)
    R = np.stack(_covariances(lag, m, other))
    whole = (R * (width * pairs)) @ R.T
    return np.asarray(whole / (2.0 * float(m) ** 2 * float(other) ** 2 * terms * others))


def _lags(m: int, other: int, count: int) -> tuple[Ints, Floats]:
    """Lags in order, and how many lags each stands for: every one near a meeting, few in between."""
    steps, farthest = [], 2 * (m + other) + 4 * max(m, other)
    growing = EVERY_LAG * GROWTH ** np.arange(1 + np.ceil(np.log(farthest / EVERY_LAG + 1) / np.log(GROWTH)))
    away = np.unique(np.concatenate([np.arange(EVERY_LAG), np.round(growing)])).astype(np.int64)
    for a in range(3):
        for b in range(3):
            steps += [a * m - b * other + away, a * m - b * other - away]
    lag = np.unique(np.concatenate(steps))
    lag = lag[(np.abs(lag) <= farthest) & (np.abs(lag) < count)]
    width = np.empty(len(lag))
    gap = np.diff(lag)
    width[0], width[-1] = 0.5 + gap[0] / 2, 0.5 + gap[-1] / 2
    width[1:-1] = (gap[1:] + gap[:-1]) / 2
    return lag, width


def _covariances(lag: Ints, m: int, other: int) -> tuple[Floats, Floats, Floats]:
    """R_mm'(u) at lags u of white noise, flicker and random walk, of density 1."""
    white, flicker, walk = np.zeros(len(lag)), np.zeros(len(lag)), np.zeros(len(lag))
    for a, left in enumerate(_COEFFICIENT):
        for b, right in enumerate(_COEFFICIENT):
            t = np.abs(lag + b * other - a * m).astype(np.float64)
            white -= left * right * t / 2
            flicker += left * right * t**2 * np.log(np.maximum(t, 1.0)) / (2 * np.pi)
            walk += left * right * t**3 / 12
    apart = (lag <= -2 * other) | (lag >= 2 * m)  # the two differences share no reading: what is left is rounding
    white[apart] = walk[apart] = 0.0
    return white, flicker, walk
