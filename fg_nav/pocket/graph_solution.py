"""The graph from its links on, for batch and online alike: what is known at first, and one round of Gauss-Newton."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.factors.rotation import rotation_exp, unskew
from fg_nav.pocket.belief import earth_rate
from fg_nav.pocket.graph_chain import (
    BIAS,
    FIELD,
    REGION,
    SCALE,
    SIZE,
    TURN,
    VELOCITY,
    Beliefs,
    Factors,
    Nodes,
    Solved,
    solve,
)
from fg_nav.pocket.graph_field import deviation_variance, step_variance
from fg_nav.pocket.graph_links import Links
from fg_nav.pocket.graph_motion import Rests, pace_variance, swing_variance
from fg_nav.pocket.graph_parameters import PocketGraphParameters
from fg_nav.pocket.start import PocketStart


class Prior(NamedTuple):
    """What is known of one node: its estimate, and the covariance `P` (27, 27) of x."""

    R: Floats
    y: Floats
    P: Floats


class Weighed(NamedTuple):
    """What the robust factors have to go by.

    Variances of steps (K,) and of deviations (K + 1,) of the field, uT^2; of steps of the body's velocity (K,),
    (m/s)^2; and of swings (K + 1,), m^2.
    """

    step: Floats
    deviation: Floats
    pace: Floats
    swing: Floats


def beliefs_of(p: PocketGraphParameters, bias: Floats) -> Beliefs:
    """Parameters as the pass needs them; `bias` (3,) rad/s is that of the links."""
    return Beliefs(
        gyr=float(np.radians(p.gyr_density_deg)) ** 2,
        bias=float(np.radians(p.bias_walk_deg_s)) ** 2,
        bias_decay=1.0 / p.bias_time_s if p.bias_returns_to_zero else 0.0,
        mag=p.mag_sigma_uT**2,
        mag_left=p.mag_left_uT**2,
        acc=p.acc_density_m_s2**2,
        rest_velocity=p.rest_sigma_m_s**2,
        pace_decay=0.5 * (p.pace_walk_m_s / p.pace_m_s) ** 2,
        earth_rate=earth_rate(p.latitude_deg),
        bias0=bias,
    )


def prior_of(start: PocketStart, links: Links | None, p: PocketGraphParameters) -> Prior:
    """What is known at the first node: the start, no errors, a field as first seen, give or take all, and no speed."""
    R = np.asarray(start.nav_R_body, dtype=np.float64)
    m = np.zeros(3)
    if links is not None and links.count.any():
        m = R @ links.field[int(np.argmax(links.count > 0))]
    y = np.zeros(SIZE - 3)
    y[FIELD - 3 : REGION - 3] = y[REGION - 3 : VELOCITY - 3] = m
    parts = [start.tilt_sigma, np.radians(p.gyro_bias_sigma_deg_s), p.gyr_scale_sigma, p.field_prior_uT]
    sigma = np.append(np.repeat(parts, [3, 3, 9, 6]), np.repeat([p.pace_m_s, p.swing_m, p.pace_m_s], 2))
    sigma[TURN + 2] = start.heading_sigma
    return Prior(R, y, np.diag(sigma**2))


def after_gap(known: Prior, gap_s: float, p: PocketGraphParameters) -> Prior:
    """What is known of a node `gap_s` s after this one, with no sample between.

    The attitude may have turned, the local field is another, and of the motion nothing is left; bias, scale and the
    region's field hold, and so the heading is found again.
    """
    P, y = known.P.copy(), known.y.copy()
    lost = np.r_[FIELD:REGION, VELOCITY:SIZE]
    P[lost, :] = P[:, lost] = 0.0
    sigma = np.repeat([p.field_prior_uT, p.pace_m_s, p.swing_m, p.pace_m_s], [3, 2, 2, 2])
    P[lost, lost] = sigma**2
    turned = np.radians(np.minimum(p.gap_turn_deg_s * gap_s, [p.gap_tilt_deg, p.gap_tilt_deg, p.gap_turn_deg]))
    P[range(TURN, TURN + 3), range(TURN, TURN + 3)] += turned**2
    P[range(BIAS, SCALE), range(BIAS, SCALE)] += np.radians(p.bias_walk_deg_s) ** 2 * gap_s
    y[FIELD - 3 : REGION - 3] = y[REGION - 3 : VELOCITY - 3]
    y[VELOCITY - 3 :] = 0.0
    return Prior(known.R, y, P)


def factors_of(links: Links, p: PocketGraphParameters, weighed: Weighed, rests: Rests) -> Factors:
    """Everything for the compiled pass."""
    return Factors(
        h=links.h,
        turn=links.turn,
        per_sensor=links.per_sensor,
        push=links.push,
        push_per_sensor=links.push_per_sensor,
        shift=links.shift,
        shift_per_sensor=links.shift_per_sensor,
        walk=weighed.step,
        pace=weighed.pace,
        deviation=weighed.deviation,
        field=_with_last(links.field),
        lever=_with_last(links.lever),
        samples=_with_last(links.count),
        swing=weighed.swing,
        rate=rests.rate,
        rest=rests.variance,
    )


def predicted(known: Prior, links: Links, beliefs: Beliefs) -> Nodes:
    """Nodes (K + 1) by the gyroscope alone from what is known of the first; the first's velocities are all's."""
    nodes = len(links) + 1
    errors = known.y[: FIELD - 3].copy()
    errors[:3] -= beliefs.bias0
    by_errors = rotation_exp(links.per_sensor @ errors)
    R = np.empty((nodes, 3, 3))
    R[0] = known.R
    for k in range(len(links)):
        R[k + 1] = R[k] @ links.turn[k] @ by_errors[k]
    return Nodes(R, np.tile(known.y, (nodes, 1)))


def moved(nodes: Nodes, x: Floats) -> Nodes:
    """Nodes changed by x (N, 27)."""
    return Nodes(rotation_exp(x[:, TURN : TURN + 3]) @ nodes.R, nodes.y + x[:, TURN + 3 :])


def solve_round(prior: Prior, nodes: Nodes, links: Links, beliefs: Beliefs, factors: Factors) -> tuple[Nodes, Solved]:
    """One step of Gauss-Newton: the nodes after it, and the linear solution about those before."""
    solved = solve(nodes, factors, beliefs, _offset(prior, nodes), np.ascontiguousarray(prior.P))
    return moved(nodes, solved.x), solved


def unweighed(walk: Floats, links: Links, p: PocketGraphParameters) -> Weighed:
    """Weights before the first round."""
    return Weighed(
        step_variance(walk, links.h, None, p),
        deviation_variance(_with_last(links.h), None, p),
        pace_variance(links.h, None, p),
        swing_variance(len(links) + 1, None, p),
    )


def reweighed(walk: Floats, links: Links, solved: Solved, p: PocketGraphParameters) -> Weighed:
    """Weights after a round."""
    return Weighed(
        step_variance(walk, links.h, solved.step_square, p),
        deviation_variance(_with_last(links.h), solved.deviation_square, p),
        pace_variance(links.h, solved.pace_square, p),
        swing_variance(len(links) + 1, solved.swing_square, p),
    )


def _offset(prior: Prior, nodes: Nodes) -> Floats:
    """Return x (27,) from the first of the nodes to the prior."""
    return np.concatenate([unskew(prior.R @ nodes.R[0].T), prior.y - nodes.y[0]])


def _with_last(x: Floats) -> Floats:
    """Of links, for nodes: the last node begins none."""
    return np.concatenate([x, np.zeros((1, *x.shape[1:]))])
