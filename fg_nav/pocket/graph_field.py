"""Where the local field keeps still, and how much it steps where it does not.

The field's step in nav from node to node is heavy-tailed: iron comes suddenly, and between is little. Its variance is

    v = q^2 h / w,     w = (nu + 3) / (nu + e^2 / (q^2 h))

with w the weight of a t-distribution of nu degrees of freedom, and e^2 the expected square of the step given all else
(expectation maximisation, Lange et al. 1989). To begin with, and as the least of it, the field's strength, which needs
no attitude, tells: where it spreads over a window T by more than noise does, by s^2, a random walk of the field that
spreads its strength so has

    q^2 >= 6 s^2 / T.

How far a place's field is from the region's is heavy-tailed too, of standard deviation a, and one and the same over a
time tau: a node that stands for h seconds counts with 2 tau / h times the variance.

A field that turns at the same strength is seen by the weights alone. A magnetometer whose iron is not taken off changes
its strength with the attitude, and so is believed little.

Reference: Lange, Little, Taylor (1989), "Robust statistical modeling using the t distribution".
"""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2

from fg_nav.arrays import Floats
from fg_nav.pocket.graph_links import Links
from fg_nav.pocket.graph_parameters import PocketGraphParameters


def walk_of_strength(links: Links, p: PocketGraphParameters) -> Floats:
    """Random walk (K,) uT/sqrt(s) of the field about the end of each link by its strength, or else `field_walk_uT`."""
    reach = max(round(p.field_window_s / p.node_s / 2), 1)
    variance = p.mag_sigma_uT**2 / np.maximum(links.count, 1.0)
    weight = np.where(np.isfinite(links.strength), 1.0, 0.0)
    S = np.nan_to_num(links.strength)
    level = float(np.median(S[weight > 0])) if weight.any() else 0.0
    n, first, second, noise = (
        _sums(x * weight, reach) for x in (np.ones(len(S)), S - level, (S - level) ** 2, variance)
    )
    free = np.maximum(n - 1, 1.0)
    spread = (second - first**2 / np.maximum(n, 1.0)) / free
    noise /= np.maximum(n, 1.0)
    limit = noise * chi2.isf(p.field_false_alarm, free) / free
    excess = np.where((spread > limit) & (n > 1), spread - noise, 0.0)
    return np.asarray(np.sqrt(p.field_walk_uT**2 + 6.0 * excess / (2 * reach * p.node_s)))


def step_variance(walk: Floats, h: Floats, step_square: Floats | None, p: PocketGraphParameters) -> Floats:
    """Variance (K,) uT^2 of each step, from the expected squares of the last round; None for the first."""
    least = walk**2 * h
    if step_square is None:
        return least
    nu = p.field_freedom
    return np.asarray(least * (nu + step_square / least) / (nu + 3.0))


def deviation_variance(h: Floats, square: Floats | None, p: PocketGraphParameters) -> Floats:
    """Variance (N,) uT^2 with which each node's deviation from the region counts; `h` (N,) s of what it stands for."""
    share = 2.0 * p.field_place_s / np.maximum(h, 1e-3 * p.node_s)
    least = p.field_deviation_uT**2
    nu = p.field_freedom
    heavier = 1.0 if square is None else (nu + square / least) / (nu + 3.0)
    return np.asarray(least * share * heavier)


def _sums(x: Floats, reach: int) -> Floats:
    """Sums (K,) over the 2 `reach` links about the end of each."""
    total = np.concatenate([[0.0], np.cumsum(x)])
    k = np.arange(len(x))
    return np.asarray(total[np.minimum(k + reach + 1, len(x))] - total[np.maximum(k - reach + 1, 0)])
