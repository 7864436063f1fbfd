"""What keeps up upright: a sensor that is worn does not run away from the body, nor the body from its place.

The level velocity v of the sensor is what the force says, turned by the attitude: a tilt a, rad, lets it grow by g a t.
But the sensor stays within a swing s of its place on the body, and the body goes on as it went: its velocity u walks,
within a walker's speed. So on the mean over a long time the force is up, and over a short one it is not. u changes
seldom, and then quickly (a start, a stop, a corner): its steps are t-distributed,

    v = q^2 h / w,     w = (nu + 2) / (nu + e^2 / (q^2 h))

as those of the field (`graph_field`), e^2 the expected square of both level parts. So are the swings p.

A sensor that lies at rest shows its bias: rate and force are quiet, and the means of the rate over the last links are
alike, but for noise. A standing thigh is quiet too, but it sways by a few tenths of a degree in a second, and its means
are apart: it is not taken for one at rest.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.pocket.graph_links import Links
from fg_nav.pocket.graph_parameters import PocketGraphParameters

REST_LINKS = 6
"""So many links alike, that to come and those before it, are a rest: 2 s."""


class Rests(NamedTuple):
    """Of N nodes: `rate` (N, 3) rad/s, zero where there is no rest, and `variance` (N,) of it an axis, inf there."""

    rate: Floats
    variance: Floats

    def after(self, first: int) -> Rests:
        """Return those of the nodes from `first` on."""
        return Rests(self.rate[first:], self.variance[first:])


def rests_of(links: Links, p: PocketGraphParameters) -> Rests:
    """Rests at the K + 1 nodes of links, by the link behind each node and those before it."""
    slow = np.abs(links.rate).max(axis=1) < np.radians(p.rest_rate_deg_s)
    quiet = slow & (links.rate_spread < np.radians(p.rest_spread_deg_s)) & (links.force_spread < p.rest_spread_m_s2)
    variance, rate = np.full(len(links) + 1, np.inf), np.zeros((len(links) + 1, 3))
    if len(links) >= REST_LINKS:
        at = np.arange(REST_LINKS - 1, len(links))
        last = np.stack([links.rate[at - i] for i in range(REST_LINKS)])
        rests = np.all([quiet[at - i] for i in range(REST_LINKS)], axis=0)
        apart = last.var(axis=0, ddof=1).mean(axis=1)
        rests &= apart < np.radians(p.rest_apart_deg_s) ** 2
        variance[at] = np.where(rests, np.radians(p.rest_sigma_deg_s) ** 2, np.inf)
        rate[at] = np.where(rests[:, None], last[0], 0.0)
    return Rests(rate, variance)


def pace_variance(h: Floats, square: Floats | None, p: PocketGraphParameters) -> Floats:
    """Variance (K,) (m/s)^2 of each step of the body's velocity, from the expected squares of the last round."""
    return _heavier(p.pace_walk_m_s**2 * h, square, p.pace_freedom)


def swing_variance(nodes: int, square: Floats | None, p: PocketGraphParameters) -> Floats:
    """Variance (N,) m^2 of how far the sensor is from its place, an axis."""
    return _heavier(np.full(nodes, p.swing_m**2), square, p.swing_freedom)


def _heavier(least: Floats, square: Floats | None, freedom: float) -> Floats:
    """Variances of two axes together that are t-distributed."""
    return least if square is None else np.asarray(least * (freedom + square / least) / (freedom + 2.0))
