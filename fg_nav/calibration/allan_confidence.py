"""How sure an overlapping Allan variance is: the covariance of its values at several averaging times, exactly.

With theta the integral of the reading y, in samples, and

    z_m(i) = theta(i + 2m) - 2 theta(i + m) + theta(i),    AVAR(m) = mean of z_m(i)^2 / (2 m^2) over M_m = n + 1 - 2m,

z is normal with mean 0, so (Isserlis)

    cov(AVAR(m), AVAR(m')) = sum_u count(u) R_mm'(u)^2 / (2 m^2 m'^2 M_m M_m')

where R_mm'(u) is the covariance of z_m(i) and z_m'(i + u) and count(u) how many pairs lie u apart. R follows from what
theta is, by its generalised covariance G (second differences forget all the rest):

    white N           G(t) = -N^2 |t| / 2
    flicker B         G(t) = B^2 t^2 ln|t| / (2 pi)
    random walk K     G(t) = K^2 |t|^3 / 12

    R_mm'(u) = sum_ab c_a c_b G(u + b m' - a m),    c = 1, -2, 1.

R is a sum over the three, so the covariance is a quadratic form in (N^2, B^2, K^2): its nine matrices are worked out
once for a length and a set of averaging times. R changes fast only near the instants at which the two differences meet;
there every lag is summed, between them lags are spaced out.

This replaces the tables of equivalent degrees of freedom by noise type (Riley, NIST SP 1065, 2008, section 5.4): no
type has to be guessed, and mixtures and the correlation between averaging times are in it.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import combinations_with_replacement

import numpy as np

from fg_nav.arrays import Floats, Ints

_COEFFICIENT = np.array([1.0, -2.0, 1.0])
_EVERY_LAG = 24
"""Every lag is summed within this many samples of a meeting."""
_GROWTH = 1.08
"""Beyond, each lag is this many times as far from the meeting as the one before: with both, 4e-4 off the whole sum."""


@lru_cache(maxsize=16)
def covariance_products(count: int, factors: tuple[int, ...]) -> Floats:
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
    growing = _EVERY_LAG * _GROWTH ** np.arange(1 + np.ceil(np.log(farthest / _EVERY_LAG + 1) / np.log(_GROWTH)))
    away = np.unique(np.concatenate([np.arange(_EVERY_LAG), np.round(growing)])).astype(np.int64)
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
