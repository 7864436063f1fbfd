"""How rough the field of a walk is, from its deviations at the footfalls.

At footfall k the field deviates from the walk's mean by e_k over the ground, uT an axis, and in potential by phi_k,
uT m. What lies within a stride of the footfall is its own; what a larger object does is alike for metres; what a
corridor or a wing does, for tens of them. Along the path, with s_kj the way between two footfalls,

    cov(e_k, e_j) = white^2 [k = j] + across^2 exp(-s_kj / length) + regional^2 exp(-s_kj / 60 m).

The variance of e is that of the walk, deviations clipped at 4 robust sigmas. How much of it is alike, and for how long,
fits the walk's own covariances at 1 to 32 strides by least squares, weighted by their pairs, with an assumption that is
worth `ASSUMED_PAIRS`. Only the deviation along the mean field counts, which no heading hides; before the field has
shown the heading, its level strength. The potential, of `POTENTIAL_PER_FIELD_M` times the spread, has no white part,

    x_k = a_k x_{k-1} + w_k,    a_k = exp(-distance_k / length),    sd(w_k) = sigma sqrt(1 - a_k^2).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fg_nav.arrays import Bools, Floats

REGIONAL_LENGTH_M = 60.0  # For how long a region is alike: a corridor, a wing.
MAD_TO_SIGMA = 1.4826  # Median absolute deviation to standard deviation, of a normal distribution.
CLIP_SIGMAS = 4.0  # Beyond which a deviation counts as if it were there: an outlier shall not set the scale.
MIN_STEP_M = 0.2  # Shorter moves are no strides.
LAGS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)  # Footfalls apart whose deviations are compared.
LENGTHS_M = np.geomspace(1.5, 6.0, 12)  # Correlation lengths that are tried, of what is alike for metres.

ASSUMED_PAIRS, ASSUMED_SHARE, ASSUMED_LENGTH_M, REGIONAL_SHARE = 20.0, 0.3, 3.0, 0.1
"""Share of the variance that is alike for metres, and its length, and in regions, before the walk has shown it, and how
many pairs of footfalls at each distance that is worth: feet on six floors have 0.1 to 0.5, 2 to 6 m, 0.05 to 0.15."""

INDEPENDENT_M = 2.0  # Of the way from which on pairs of footfalls are others.
MIN_SIGMA_UT = 0.2  # Spread of the field below which a walk's differences are the magnetometer's.
MIN_REGIONAL_UT = 0.01  # Of a region: keeps the equations well conditioned where the field is the same everywhere.

POTENTIAL_PER_FIELD_M, POTENTIAL_LENGTH_M = 3.0, 12.0
"""Spread of the potential over that of the field at the footfalls, the reach of a building's steel, and its length.
Along 8 real walks of 35 to 117 m whose path is known it is 2.6 to 3.8 m, and changes over five strides by as much as
its spread."""


@dataclass(frozen=True)
class Roughness:
    """Of a deviation along the path: spread `sigma` (its unit) and correlation length, m."""

    sigma: float
    length_m: float

    def left(self, distance_m: Floats) -> Floats:
        """Share a of a deviation that is left after a distance."""
        return np.exp(-distance_m / self.length_m)

    def innovation(self, distance_m: Floats) -> Floats:
        """Standard deviation of what is new after a distance; never none at all."""
        return self.sigma * np.sqrt(1.0 - np.minimum(self.left(distance_m), 1.0 - MIN_INNOVATION) ** 2)


@dataclass(frozen=True)
class FieldRoughness:
    """Of a walk: potential (uT m), deviation across the field alike for metres, of regions, and white part (uT)."""

    potential: Roughness
    across: Roughness
    regional: Roughness
    white_uT: float


MIN_INNOVATION = 1e-6
"""Of a deviation that is new at a footfall on the same spot: keeps the equations well conditioned. Of a potential it is
less than the noise of a line integral, so that standing shows nothing of it."""


MIN_TELESCOPING = 0.01
"""Of the potential's variance, where no share of it telescopes: keeps the equations well conditioned."""


def split_potential(potential: Roughness, lost_share: float, distance_m: Floats) -> tuple[Roughness, Floats]:
    """Split the changes of a potential over strides (...) of these lengths, m, of whose variance a share is lost.

    Returns what telescopes, and the noise (...) of each integral that does not, uT m (`path_noise`). It grows with the
    stride: pieces of a standing have none, and do not show whether the integrals of a walk telescope.
    """
    variance = 2.0 * potential.sigma**2 * (1.0 - potential.left(distance_m))
    telescoping = max(1.0 - lost_share, MIN_TELESCOPING)
    return replace(potential, sigma=potential.sigma * np.sqrt(telescoping)), np.sqrt(lost_share * variance)


def robust_sigma(values: Floats) -> float:
    """Spread about zero without the tails."""
    return MAD_TO_SIGMA * float(np.median(np.abs(values)))


def deviate_along(nav_field: Floats, reference: Floats) -> Floats:
    """(F,) uT of fields (F, 3) along a horizontal one (F, 2), about its median: no heading hides it to first order."""
    along = (nav_field[:, :2] * reference).sum(axis=1) / np.linalg.norm(reference, axis=1)
    return np.asarray(along - np.nanmedian(along))


def measure_roughness(deviation: Floats, seen: Bools, distance_m: Floats) -> FieldRoughness:
    """Measure the roughness of a walk's field.

    Parameters
    ----------
    deviation : (F,) uT along the mean field: that across it, which turns the compass, is alike, but a heading hides it.
    seen : (F,) footfalls with a field.
    distance_m : (F-1,) from footfall to footfall.
    """
    x, variance = _clip(deviation, seen)
    beyond_sensor = max(variance - MIN_SIGMA_UT**2, MIN_REGIONAL_UT**2)
    across, regional = _fit_covariance(x, variance, seen, distance_m)
    alike = float(np.sqrt(beyond_sensor / variance))
    white_uT = float(np.sqrt(max(variance - across.sigma**2 - regional.sigma**2, 0.0)))
    across, regional = (replace(one, sigma=max(alike * one.sigma, MIN_REGIONAL_UT)) for one in (across, regional))
    potential = Roughness(POTENTIAL_PER_FIELD_M * float(np.sqrt(variance)), POTENTIAL_LENGTH_M)
    return FieldRoughness(potential, across, regional, alike * white_uT)


def _clip(deviation: Floats, seen: Bools) -> tuple[Floats, float]:
    """Return deviations (F,) without their outliers, zero where they are not seen, and their variance."""
    x = np.where(seen, deviation, 0.0)
    if not seen.any():
        return x, MIN_SIGMA_UT**2
    limit = CLIP_SIGMAS * max(robust_sigma(x[seen]), MIN_SIGMA_UT)
    x = np.clip(x, -limit, limit)
    return x, max(float(np.mean(x[seen] ** 2)), MIN_SIGMA_UT**2)


def _fit_covariance(x: Floats, variance: float, seen: Bools, distance_m: Floats) -> tuple[Roughness, Roughness]:
    """Fit what of the variance of deviations (F,) is alike along the path for metres, and in regions."""
    walked, count, apart, alike = np.append(0.0, np.cumsum(distance_m)), [], [], []
    for lag in LAGS:
        between = walked[lag:] - walked[:-lag]
        pair = seen[lag:] & seen[:-lag] & (between > MIN_STEP_M) & (between < REGIONAL_LENGTH_M)
        if pair.any():
            count.append(float(pair.sum()))
            apart.append(float(between[pair].mean()))
            alike.append(float(np.mean(x[lag:][pair] * x[:-lag][pair])))
    d = np.array(apart)
    # Pairs that overlap show one covariance: their number falls with the distance.
    n = np.array(count) / (1.0 + d / INDEPENDENT_M) + ASSUMED_PAIRS
    assumed = ASSUMED_SHARE * np.exp(-d / ASSUMED_LENGTH_M) + REGIONAL_SHARE * np.exp(-d / REGIONAL_LENGTH_M)
    c = np.array(alike) + ASSUMED_PAIRS / n * (assumed * variance - np.array(alike))
    # Least squares of two shares that are none below zero: both, or either alone.
    fits = []
    for length_m in LENGTHS_M:
        shares = np.stack([np.exp(-d / length_m), np.exp(-d / REGIONAL_LENGTH_M)], axis=1)
        normal, right = shares.T @ (n[:, None] * shares) + 1e-9 * np.eye(2), shares.T @ (n * c)
        both, alone = np.linalg.solve(normal, right), np.diag(np.maximum(right, 0.0) / np.diagonal(normal))
        some = [both] if both.min() >= 0.0 else alone
        fits += [(float(n @ (c - shares @ found) ** 2), float(length_m), found) for found in some]
    _, length_m, found = min(fits, key=lambda one: one[0])
    found = found * min(1.0, variance / max(float(found.sum()), MIN_SIGMA_UT**2))
    return Roughness(float(np.sqrt(found[0])), length_m), Roughness(float(np.sqrt(found[1])), REGIONAL_LENGTH_M)
