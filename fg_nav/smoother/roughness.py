"""How rough the field of a walk is, from its deviations at the footfalls.

Roughness. At footfall k the field deviates from the walk's mean, across it by delta (uT) and in potential by phi
(uT m). Each is a stationary process along the path, whose spread and correlation length the walk itself shows:

    x_k = a_k x_{k-1} + w_k,    a_k = exp(-distance_k / length),    sd(w_k) = sigma sqrt(1 - a_k^2);
    sigma robust,    rho = sum x_k x_{k-1} / sum x_k^2,    length = -mean distance / ln rho.

A smooth field keeps its deviation for metres, a reinforced floor for less than a stride, and a foot that stands on one
spot sees one and the same deviation for as long as it stands.

White noise. A walk without line integrals cannot tell a slow deviation from a drift of its heading. There the compass
has white noise about one mean field. Footfalls of one region share its deviation, so that N of them in so many regions
have the information of as many footfalls as there are regions:

    e_k = deviation across the mean, less its median,
    sigma^2 = noise^2 + max(robust(e)^2 - noise^2, 0) N / min(N, regions).

Before the field has shown the heading, e drifts with it; then (e_k - e_{k-1}) / sqrt(2) stands for it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.factors.magnetic_field import PHI, across_field

REGIONAL_SHARE = 3.0
"""What rooms and wings of a building do to the compass, as a share of how the field differs from footfall to
footfall, before the walk has shown it: wide, for one who is wrong here on a short walk bends it; nothing in a
homogeneous field."""

REGIONAL_LENGTH_M = 20.0
"""For how long."""

REGIONAL_WEIGHT = 5.0
"""How many regions' worth of evidence this assumption is: a walk through more of them learns its own value."""

MAD_TO_SIGMA = 1.4826
"""Median absolute deviation to standard deviation, of a normal distribution."""

CLIP_SIGMAS = 4.0
"""Beyond which a deviation counts as if it were there: an outlier shall not set the scale."""

LEAST_STEP_M = 0.2
"""Moves that count in the mean distance; shorter ones are no strides."""

MOST_STEP_M = 10.0
"""Longer ones are none either: the walk was not seen there."""

MOST_CORRELATED = 0.98


LEAST_SIGMA_UT = 0.2
"""Spread of the field below which a walk's differences are the magnetometer's."""

LEAST_REGIONAL_UT = 0.01
"""Of a region: keeps the equations well conditioned where the field is the same everywhere."""

POTENTIAL_PER_FIELD_M = 1.5
"""Potential over field before it is measured: the reach of the steel of a building."""

LEAST_POTENTIAL_PER_FIELD_M = 1.0
"""And at least: a smoothed heading takes some of the potential for its own."""


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
        return self.sigma * np.sqrt(1.0 - np.minimum(self.left(distance_m), 1.0 - LEAST_NEW) ** 2)


@dataclass(frozen=True)
class FieldRoughness:
    """Of a walk: potential (uT m), deviation across the field at a footfall, and that of its region (uT)."""

    potential: Roughness
    across: Roughness
    regional: Roughness


LEAST_NEW = 1e-4
"""Of a deviation that is new at a footfall on the same spot: keeps the equations well conditioned."""


LEAST_TELESCOPING = 0.01
"""Of the potential's variance, where no share of it telescopes: keeps the equations well conditioned."""


def split_potential(potential: Roughness, lost_share: float, distance_m: Floats) -> tuple[Roughness, Floats]:
    """Split the changes of a potential over strides (...) of these lengths, m, of whose variance a share is lost.

    Returns what telescopes, and the noise (...) of each integral that does not, uT m (`path_noise`). It grows with the
    stride: pieces of a standing have none, and do not show whether the integrals of a walk telescope.
    """
    variance = 2.0 * potential.sigma**2 * (1.0 - potential.left(distance_m))
    telescoping = max(1.0 - lost_share, LEAST_TELESCOPING)
    return replace(potential, sigma=potential.sigma * np.sqrt(telescoping)), np.sqrt(lost_share * variance)


def robust_sigma(values: Floats) -> float:
    """Spread about zero without the tails."""
    return MAD_TO_SIGMA * float(np.median(np.abs(values)))


def roughness_of(values: Floats, seen: Bools, distance_m: Floats, least_sigma: float) -> Roughness:
    """Measure the roughness.

    Parameters
    ----------
    values : (F,) deviations at the footfalls.
    seen : (F,) where they are known.
    distance_m : (F-1,) from footfall to footfall.
    least_sigma : unit of the values, below which a spread is the sensor's noise.
    """
    if not seen.any():
        return Roughness(least_sigma, NOTHING_KNOWN_M)
    limit = CLIP_SIGMAS * max(robust_sigma(values[seen]), least_sigma)
    x = np.clip(values, -limit, limit)
    strides = seen[1:] & seen[:-1] & (distance_m > LEAST_STEP_M) & (distance_m < MOST_STEP_M)
    variance = float(np.mean(x[seen] ** 2))
    if strides.sum() < FEWEST or variance <= least_sigma**2:
        return Roughness(max(np.sqrt(variance), least_sigma), NOTHING_KNOWN_M)
    rho = float(np.mean(x[1:][strides] * x[:-1][strides])) / variance
    rho = float(np.clip(rho, LEAST_CORRELATED, MOST_CORRELATED))
    return Roughness(float(np.sqrt(variance)), -float(distance_m[strides].mean()) / np.log(rho))


def roughness_of_regions(
    values: Floats, own: Floats, seen: Bools, distance_m: Floats, assumed: Roughness, reach_m: float, weight: float
) -> Roughness:
    """Measure how much whole regions deviate, beginning from an assumption that is worth `weight` regions.

    The walk is cut into pieces as long as a region. The mean of a piece has the variance of its region, and what the
    footfalls' own deviations leave of it: own^2 2 reach / length. A short walk learns little and keeps to what was
    assumed; a long one finds its own.

    Parameters
    ----------
    values : (F, c) deviations at the footfalls, of components that are alike.
    own : (c,) their spreads.
    seen : (F,) where they are known.
    distance_m : (F-1,) from footfall to footfall.
    assumed : before the walk has shown it.
    reach_m : correlation length of the footfalls' own deviations.
    weight : how many regions the assumption is worth.
    """
    place = np.concatenate([[0], np.floor(np.cumsum(distance_m) / assumed.length_m)])
    region = np.unique(place[seen], return_inverse=True)[1]  # those with a footfall, however far apart
    count = np.bincount(region)
    found = []
    for column, sigma in zip(values[seen].T, own, strict=True):
        limit = CLIP_SIGMAS * sigma
        mean = np.bincount(region, np.clip(column, -limit, limit)) / count
        left = sigma**2 * min(1.0, 2.0 * reach_m / assumed.length_m)
        found.append(max(float(np.sum(mean**2 - left)), 0.0))
    variance = (weight * assumed.sigma**2 + np.mean(found)) / (weight + len(count))
    return Roughness(float(np.sqrt(variance)), assumed.length_m)


FEWEST = 5
"""Strides without which a correlation is not measured."""

NOTHING_KNOWN_M = 1.0
"""Correlation length where none is measured: about a stride's."""

LEAST_CORRELATED = 0.02
"""A correlation below is taken for this one: white from stride to stride."""


def field_deviation(nav_field: Floats, reference: Floats) -> Floats:
    """(F, 3) uT of fields (F, 3) across a horizontal one (F, 2), along it, and up."""
    along = (nav_field[:, :2] * reference).sum(axis=1) / np.linalg.norm(reference, axis=1)
    return np.stack([across_field(nav_field, reference), along, nav_field[:, 2]], axis=1)


def usual_deviation(deviation: Floats) -> Floats:
    """(3,) uT, the median of deviations (F, 3) along the mean field and up; none across it."""
    return np.asarray(np.median(deviation, axis=0) * [0.0, 1.0, 1.0])


def measure_roughness(
    deviation: Floats, states: Floats | None, seen: Bools, passed: Bools, distance_m: Floats
) -> FieldRoughness:
    """Measure the roughness of a walk's field.

    Parameters
    ----------
    deviation : (F, 3) uT, across, along and up.
    states : (F, 8) of the round before, which know the potential; None where there was none.
    seen : (F,) footfalls with a field: they show how far the potential reaches.
    passed : (F,) those whose heading is used: they show what it deviates by.
    distance_m : (F-1,) from footfall to footfall.
    """
    deviation = np.nan_to_num(deviation)
    everywhere = roughness_of(deviation[:, 0], seen, distance_m, LEAST_SIGMA_UT)
    across = roughness_of(deviation[:, 0], passed, distance_m, LEAST_SIGMA_UT)
    # Along and up no heading can hide: they stand for the deviation across as well.
    steady = deviation[:, 1:]
    own = np.array([max(robust_sigma(column[passed]), LEAST_SIGMA_UT) for column in steady.T])
    beyond_sensor = np.sqrt(max(across.sigma**2 - LEAST_SIGMA_UT**2, LEAST_REGIONAL_UT**2))
    assumed = Roughness(REGIONAL_SHARE * float(beyond_sensor), REGIONAL_LENGTH_M)
    region = roughness_of_regions(steady, own, passed, distance_m, assumed, across.length_m, REGIONAL_WEIGHT)
    return FieldRoughness(_measure_potential(states, everywhere, distance_m), across, region)


def _measure_potential(states: Floats | None, across: Roughness, distance_m: Floats) -> Roughness:
    if states is None:
        return Roughness(POTENTIAL_PER_FIELD_M * across.sigma, POTENTIAL_PER_FIELD_M)
    phi = states[:, PHI]
    found = roughness_of(phi - np.median(phi), np.ones(len(phi), dtype=bool), distance_m, LEAST_SIGMA_UT)
    return replace(found, sigma=max(found.sigma, LEAST_POTENTIAL_PER_FIELD_M * across.sigma))


NEGLIGIBLE_UT = 1e-3
"""Spread of a deviation that has no part in the heading."""


def neglect_deviation(rough: FieldRoughness) -> FieldRoughness:
    """Return the roughness of a field of which only white noise is known."""
    return replace(
        rough, across=Roughness(NEGLIGIBLE_UT, NOTHING_KNOWN_M), regional=Roughness(NEGLIGIBLE_UT, REGIONAL_LENGTH_M)
    )


def measure_white_noise(across: Floats, passed: Bools, distance_m: Floats, noise_uT: float, drifting: bool) -> float:
    """Sigma of the compass, uT, by the deviations (F,) across the mean of footfalls that passed (F,)."""
    e = across[passed] - np.median(across[passed])
    e = np.diff(e) / np.sqrt(2.0) if drifting and len(e) > 1 else e
    region = np.floor(np.concatenate([[0.0], np.cumsum(distance_m)])[passed] / REGIONAL_LENGTH_M)
    shared = max(robust_sigma(e) ** 2 - noise_uT**2, 0.0) * len(region) / len(np.unique(region))
    return float(np.sqrt(noise_uT**2 + shared))
