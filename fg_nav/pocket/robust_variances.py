"""IRLS variances: steps of field and pace, deviations and swings are t-distributed.

Field. Its step in nav from node to node is heavy-tailed: iron comes suddenly, and between is little. Its variance is

    v = q^2 h / w,     w = (nu + 3) / (nu + e^2 / (q^2 h))

with w the weight of a t-distribution of nu degrees of freedom, and e^2 the expected square of the step given all else
(expectation maximization, Lange et al. 1989). The first weight, which is the least variance too, comes from the
field's strength, which needs no attitude: where it spreads over a window T by more than noise does, by s^2, a random
walk of the field that spreads its strength so has

    q^2 >= 6 s^2 / T.

The deviation of a place's field from the region's is heavy-tailed too, of standard deviation a, and constant over a
time tau: a node that stands for h seconds counts with 2 tau / h times the variance.

A field that turns at the same strength is detected by the weights alone. A magnetometer whose iron is not calibrated
changes its strength with the attitude, and so gets little weight.

Up. A sensor that is worn does not run away from the body, nor the body from its pace. The level velocity v of the
sensor follows the force, rotated by the attitude: a tilt a, rad, lets it grow by g a t. But the sensor stays within a
swing s of its place on the body, and the body keeps its velocity u, which walks within a walker's speed. So over a long
time the mean force is up, and over a short one it is not. u changes seldom, and then quickly (a start, a stop, a
corner): its steps are t-distributed,

    v = q^2 h / w,     w = (nu + 2) / (nu + e^2 / (q^2 h)),

e^2 the expected square of both level parts. So are the swings p.

Reference: Lange, Little, Taylor (1989), "Robust statistical modeling using the t distribution".
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from fg_nav.arrays import Floats
from fg_nav.pocket.kalman_smoother import Smoothed
from fg_nav.pocket.links import NODE_S, Links

FIELD_WALK_UT = 0.03
"""Random walk of the local field where it seems to hold still, uT/sqrt(s): 0.2 uT in 40 s, or 50 m. Over the strength
of the field across, 0.1 deg/sqrt(s), it is the walk of heading that limits the bias."""

FIELD_FREEDOM = 2.0  # Degrees of freedom of the t-distribution of a step of the field: low, for iron comes suddenly.
FIELD_WINDOW_S = 3.0  # Window of the strength's spread, s.
FIELD_FALSE_ALARM = 0.01  # Rate at which noise alone exceeds the limit of that spread.

FIELD_DEVIATION_UT = 0.3
"""Deviation of the local field from that of the region, uT an axis: outdoors, some meters from iron."""

FIELD_PLACE_S = 10.0  # The deviation is constant for so long, s: as many meters. Nodes within it are not independent.

PACE_WALK_M_S = 0.05
"""Random walk of the body's velocity where it keeps its pace, m/s/sqrt(s): simulated walkers', by the NEES of tilt."""

PACE_FREEDOM = 2.0  # Degrees of freedom of the t-distribution of its steps: seldom and sudden.
SWING_M = 0.3  # Swing of the sensor from its place on the body, m an axis: a thigh 0.2, an arm 0.4.
SWING_FREEDOM = 5.0  # Degrees of freedom of its t-distribution.


class RobustVariances(NamedTuple):
    """Variances of the t-distributed terms.

    Of steps (K,) and of deviations (K + 1,) of the field, uT^2; of steps of the body's velocity (K,), (m/s)^2; and of
    swings (K + 1,), m^2.
    """

    step: Floats
    deviation: Floats
    pace: Floats
    swing: Floats


def initialize_variances(walk: Floats, links: Links) -> RobustVariances:
    """Variances before the first round; `walk` (K,) of `estimate_field_walk`."""
    return RobustVariances(
        walk**2 * links.h,
        _scale_deviation(links) * FIELD_DEVIATION_UT**2,
        PACE_WALK_M_S**2 * links.h,
        np.full(len(links) + 1, SWING_M**2),
    )


def reweigh_variances(walk: Floats, links: Links, smoothed: Smoothed) -> RobustVariances:
    """Variances by the expected squares of the last round."""
    least = initialize_variances(walk, links)
    deviation = FIELD_DEVIATION_UT**2
    heavier = (FIELD_FREEDOM + smoothed.deviation_square / deviation) / (FIELD_FREEDOM + 3.0)
    return RobustVariances(
        _weigh(least.step, smoothed.step_square, FIELD_FREEDOM, 3),
        deviation * _scale_deviation(links) * heavier,
        _weigh(least.pace, smoothed.pace_square, PACE_FREEDOM, 2),
        _weigh(least.swing, smoothed.swing_square, SWING_FREEDOM, 2),
    )


def estimate_field_walk(links: Links, mag_sigma_uT: float) -> Floats:
    """Random walk (K,) uT/sqrt(s) of the field about the end of each link by its strength, at least `FIELD_WALK_UT`."""
    reach = max(round(FIELD_WINDOW_S / NODE_S / 2), 1)
    variance = mag_sigma_uT**2 / np.maximum(links.count, 1.0)
    weight = np.where(np.isfinite(links.strength), 1.0, 0.0)
    S = np.nan_to_num(links.strength)
    level = float(np.median(S[weight > 0])) if weight.any() else 0.0
    # moments of the strength over the window
    n, first, second, noise = (
        _sum_about(x * weight, reach) for x in (np.ones(len(S)), S - level, (S - level) ** 2, variance)
    )
    free = np.maximum(n - 1, 1.0)
    spread = (second - first**2 / np.maximum(n, 1.0)) / free
    noise /= np.maximum(n, 1.0)
    # a spread that noise alone does not explain
    limit = noise * chdtri(free, FIELD_FALSE_ALARM) / free
    excess = np.where((spread > limit) & (n > 1), spread - noise, 0.0)
    return np.asarray(np.sqrt(FIELD_WALK_UT**2 + 6.0 * excess / (2 * reach * NODE_S)))


def _weigh(least: Floats, square: Floats, freedom: float, axes: int) -> Floats:
    """Variances of t-distributed terms of so many axes."""
    return np.asarray(least * (freedom + square / least) / (freedom + axes))


def _scale_deviation(links: Links) -> Floats:
    """By how much (K + 1,) the variance of a node's deviation counts more; the last node stands for no time."""
    h = np.append(links.h, 0.0)
    return np.asarray(2.0 * FIELD_PLACE_S / np.maximum(h, 1e-3 * NODE_S))


def _sum_about(x: Floats, reach: int) -> Floats:
    """Sums (K,) over the 2 `reach` links about the end of each."""
    total = np.concatenate([[0.0], np.cumsum(x)])
    k = np.arange(len(x))
    return np.asarray(total[np.minimum(k + reach + 1, len(x))] - total[np.maximum(k - reach + 1, 0)])
