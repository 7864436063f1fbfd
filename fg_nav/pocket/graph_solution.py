"""The graph from its links on, for batch and online alike: what is known at first, and one round of Gauss-Newton."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from factors.rotation import rotation_exp, unskew
from fg_nav.arrays import Floats
from fg_nav.pocket.belief import earth_rate
from fg_nav.pocket.graph_chain import BIAS, FIELD, REGION, TURN, Beliefs, Factors, Nodes, Solved, solve
from fg_nav.pocket.graph_field import deviation_variance, force_weight, step_variance
from fg_nav.pocket.graph_links import Links
from fg_nav.pocket.graph_parameters import PocketGraphParameters
from fg_nav.pocket.gravity_force import Gravity
from fg_nav.pocket.start import PocketStart


class Prior(NamedTuple):
    """What is known of one node: its estimate, and the covariance `P` (12, 12) of x."""

    R: Floats
    b: Floats
    m: Floats
    E: Floats
    P: Floats


@dataclass(frozen=True)
class Weighed:
    """What the robust factors have to go by.

    Variances of steps (K,) and of deviations (K + 1,), uT^2, and factors on the variances of forces (K + 1,).
    """

    step: Floats
    deviation: Floats
    force: Floats


def beliefs_of(p: PocketGraphParameters, bias: Floats) -> Beliefs:
    """Parameters as the pass needs them; `bias` (3,) rad/s is that of the links."""
    return Beliefs(
        gyr=float(np.radians(p.gyr_density_deg)) ** 2,
        bias=float(np.radians(p.bias_walk_deg_s)) ** 2,
        bias_decay=1.0 / p.bias_time_s if p.bias_returns_to_zero else 0.0,
        mag=p.mag_sigma_uT**2,
        earth_rate=earth_rate(p.latitude_deg),
        bias0=bias,
    )


def prior_of(start: PocketStart, links: Links, p: PocketGraphParameters) -> Prior:
    """What is known at the first node: the start, no bias, and a field as first seen, give or take all of it."""
    R = np.asarray(start.nav_R_body, dtype=np.float64)
    seen = np.flatnonzero(links.count)
    m = R @ links.field[seen[0]] if len(seen) else np.zeros(3)
    bias = np.radians(p.gyro_bias_sigma_deg_s)
    sigma = np.repeat([start.tilt_sigma, bias, p.field_prior_uT, p.field_prior_uT], 3)
    sigma[TURN + 2] = start.heading_sigma
    return Prior(R, np.zeros(3), m, m, np.diag(sigma**2))


def factors_of(links: Links, p: PocketGraphParameters, weighed: Weighed, gravity: Gravity) -> Factors:
    """Everything for the compiled pass."""
    return Factors(
        h=links.h,
        turn=links.turn,
        per_bias=links.per_bias,
        walk=weighed.step,
        still=np.minimum(p.field_walk_uT**2 * links.h / weighed.step, 1.0),
        deviation=weighed.deviation,
        field=_with_last(links.field),
        lever=_with_last(links.lever),
        swing=_with_last(links.swing),
        samples=_with_last(links.count),
        force=gravity.up,
        force_age=gravity.per_bias,
        force_variance=gravity.variance * weighed.force,
    )


def predicted(known: Prior, links: Links, beliefs: Beliefs) -> Nodes:
    """Nodes (K + 1) by the gyroscope alone from what is known of the first."""
    nodes = len(links) + 1
    by_bias = rotation_exp(links.per_bias @ (known.b - beliefs.bias0))
    R = np.empty((nodes, 3, 3))
    R[0] = known.R
    for k in range(len(links)):
        R[k + 1] = R[k] @ links.turn[k] @ by_bias[k]
    return Nodes(R, *(np.tile(v, (nodes, 1)) for v in (known.b, known.m, known.E)))


def moved(nodes: Nodes, x: Floats) -> Nodes:
    """Nodes changed by x (N, 12)."""
    return Nodes(
        rotation_exp(x[:, TURN : TURN + 3]) @ nodes.R,
        nodes.b + x[:, BIAS : BIAS + 3],
        nodes.m + x[:, FIELD : FIELD + 3],
        nodes.E + x[:, REGION : REGION + 3],
    )


def solve_round(prior: Prior, nodes: Nodes, links: Links, beliefs: Beliefs, factors: Factors) -> tuple[Nodes, Solved]:
    """One step of Gauss-Newton: the nodes after it, and the linear solution about those before."""
    solved = solve(nodes, factors, beliefs, _offset(prior, nodes), np.ascontiguousarray(prior.P))
    return moved(nodes, solved.x), solved


def unweighed(walk: Floats, links: Links, p: PocketGraphParameters) -> Weighed:
    """Weights before the first round."""
    return Weighed(
        step_variance(walk, links.h, None, p), deviation_variance(_with_last(links.h), None, p), np.ones(len(links) + 1)
    )


def reweighed(walk: Floats, links: Links, solved: Solved, gravity: Gravity, p: PocketGraphParameters) -> Weighed:
    """Weights after a round."""
    used = np.isfinite(gravity.variance)
    force = np.ones(len(used))
    force[used] = force_weight(solved.force_square[used], gravity.variance[used], p)
    return Weighed(
        step_variance(walk, links.h, solved.step_square, p),
        deviation_variance(_with_last(links.h), solved.deviation_square, p),
        force,
    )


def _offset(prior: Prior, nodes: Nodes) -> Floats:
    """Return x (12,) from the first of the nodes to the prior."""
    turn = unskew(prior.R @ nodes.R[0].T)
    return np.concatenate([turn, prior.b - nodes.b[0], prior.m - nodes.m[0], prior.E - nodes.E[0]])


def _with_last(x: Floats) -> Floats:
    """Of links, for nodes: the last node begins none."""
    return np.concatenate([x, np.zeros((1, *x.shape[1:]))])
