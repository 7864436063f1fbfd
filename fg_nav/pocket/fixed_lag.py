"""One round of the iterated Kalman smoother, and the fixed-lag smoother made of it, for batch and online alike.

The nodes of the last seconds are smoothed again whenever there are new ones. Older nodes are marginalized: they leave
what they say of the first node of the window, as they were linearized and weighted then. That is the same forward pass
as over all nodes, from the first on: an estimate at the end uses all the past, and but for weights that only later
data could correct it is that of the batch solution of the data so far.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.factors.rotation import rotation_exp, unskew
from fg_nav.pocket.kalman_smoother import (
    ATTITUDE,
    BIAS,
    FIELD,
    REGION,
    SCALE,
    SIZE,
    VELOCITY,
    Inputs,
    Nodes,
    Noise,
    Smoothed,
    smooth_nodes,
)
from fg_nav.pocket.links import NODE_S, REST_LINKS, Links, Rests, detect_rests
from fg_nav.pocket.parameters import (
    GYR_DENSITY_DEG,
    PocketSmootherParameters,
    compute_bias_decay,
    compute_bias_walk,
    compute_earth_rate,
)
from fg_nav.pocket.robust_variances import (
    FIELD_WINDOW_S,
    PACE_WALK_M_S,
    SWING_M,
    RobustVariances,
    estimate_field_walk,
    initialize_variances,
    reweigh_variances,
)
from fg_nav.pocket.track import PocketStart

ACC_DENSITY_M_S2 = 0.05
"""Error of the force, m/s^2/sqrt(Hz): white noise of 0.002, and a bias of 0.05 that the body rotates in a second."""

REST_SIGMA_M_S = 0.05  # Velocity of a sensor at rest, m/s.
PACE_M_S = 1.4  # Velocity of the body, m/s an axis: a walker.
FIELD_PRIOR_UT = 60.0  # Prior sigma of the local field, uT an axis: more than the Earth's.
GAP_TURN_DEG_S = 100.0  # Where samples are missing, a thigh may have turned at this rate, deg/s: the rms of its swing
GAP_TILT_DEG = 30.0  # ... but its tilt by no more than this, half of a swing, deg ...
GAP_TURN_DEG = 100.0  # ... and its heading by no more than this, deg: about the sigma of an unknown one.
LAG_S = 10.0  # Lag of the online smoother, s: nodes within it are linearized and weighted again.


class Prior(NamedTuple):
    """Prior of one node: its estimate, and the covariance `P` (27, 27) of x."""

    R: Floats
    y: Floats
    P: Floats


def build_noise(p: PocketSmootherParameters, bias: Floats) -> Noise:
    """Convert parameters for the compiled pass; `bias` (3,) rad/s is that of the links."""
    return Noise(
        gyr=float(np.radians(GYR_DENSITY_DEG)) ** 2,
        bias=compute_bias_walk() ** 2,
        bias_decay=compute_bias_decay(p.bias_returns_to_zero),
        mag=p.mag_sigma_uT**2,
        mag_left=p.mag_left_uT**2,
        acc=ACC_DENSITY_M_S2**2,
        rest_velocity=REST_SIGMA_M_S**2,
        pace_decay=0.5 * (PACE_WALK_M_S / PACE_M_S) ** 2,
        earth_rate=compute_earth_rate(p.latitude_deg),
        bias0=bias,
    )


def build_prior(start: PocketStart, links: Links | None, p: PocketSmootherParameters) -> Prior:
    """Prior of the first node: the start, no errors, the first field with a wide sigma, and no velocity."""
    R = np.asarray(start.nav_R_body, dtype=np.float64)
    m = np.zeros(3)
    if links is not None and links.count.any():
        m = R @ links.field[int(np.argmax(links.count > 0))]
    y = np.zeros(SIZE - 3)
    y[FIELD - 3 : REGION - 3] = y[REGION - 3 : VELOCITY - 3] = m
    parts = [start.tilt_sigma, np.radians(p.gyro_bias_sigma_deg_s), p.gyr_scale_sigma, FIELD_PRIOR_UT]
    sigma = np.append(np.repeat(parts, [3, 3, 9, 6]), np.repeat([PACE_M_S, SWING_M, PACE_M_S], 2))
    sigma[ATTITUDE + 2] = start.heading_sigma
    return Prior(R, y, np.diag(sigma**2))


def propagate_gap(known: Prior, gap_s: float) -> Prior:
    """Prior of a node `gap_s` s after this one, with no sample between.

    The attitude may have turned, the local field is a new one, and of the motion nothing remains; bias, scale and the
    region's field hold, and so the heading is found again.
    """
    P, y = known.P.copy(), known.y.copy()
    lost = np.r_[FIELD:REGION, VELOCITY:SIZE]
    P[lost, :] = P[:, lost] = 0.0
    sigma = np.repeat([FIELD_PRIOR_UT, PACE_M_S, SWING_M, PACE_M_S], [3, 2, 2, 2])
    P[lost, lost] = sigma**2
    turned = np.radians(np.minimum(GAP_TURN_DEG_S * gap_s, [GAP_TILT_DEG, GAP_TILT_DEG, GAP_TURN_DEG]))
    P[range(ATTITUDE, ATTITUDE + 3), range(ATTITUDE, ATTITUDE + 3)] += turned**2
    P[range(BIAS, SCALE), range(BIAS, SCALE)] += compute_bias_walk() ** 2 * gap_s
    y[FIELD - 3 : REGION - 3] = y[REGION - 3 : VELOCITY - 3]
    y[VELOCITY - 3 :] = 0.0
    return Prior(known.R, y, P)


def assemble_inputs(links: Links, variances: RobustVariances, rests: Rests) -> Inputs:
    """Collect what the compiled pass needs."""
    return Inputs(
        h=links.h,
        turn=links.turn,
        per_sensor=links.per_sensor,
        delta_v=links.delta_v,
        delta_v_per_sensor=links.delta_v_per_sensor,
        delta_p=links.delta_p,
        delta_p_per_sensor=links.delta_p_per_sensor,
        walk=variances.step,
        pace=variances.pace,
        deviation=variances.deviation,
        field=_pad_last(links.field),
        lever=_pad_last(links.lever),
        samples=_pad_last(links.count),
        swing=variances.swing,
        rate=rests.rate,
        rest=rests.variance,
    )


def predict_nodes(known: Prior, links: Links, noise: Noise) -> Nodes:
    """Nodes (K + 1) by the gyroscope alone from the first; all else stays as at the first."""
    nodes = len(links) + 1
    errors = known.y[: FIELD - 3].copy()
    errors[:3] -= noise.bias0
    by_errors = rotation_exp(links.per_sensor @ errors)
    R = np.empty((nodes, 3, 3))
    R[0] = known.R
    for k in range(len(links)):
        R[k + 1] = R[k] @ links.turn[k] @ by_errors[k]
    return Nodes(R, np.tile(known.y, (nodes, 1)))


def inject_correction(nodes: Nodes, x: Floats) -> Nodes:
    """Nodes corrected by x (N, 27)."""
    return Nodes(rotation_exp(x[:, ATTITUDE : ATTITUDE + 3]) @ nodes.R, nodes.y + x[:, ATTITUDE + 3 :])


def iterate_once(prior: Prior, nodes: Nodes, noise: Noise, inputs: Inputs) -> tuple[Nodes, Smoothed]:
    """One Gauss-Newton round: the nodes after it, and the linear solution about those before."""
    offset = np.concatenate([unskew(prior.R @ nodes.R[0].T), prior.y - nodes.y[0]])
    smoothed = smooth_nodes(nodes, inputs, noise, offset, np.ascontiguousarray(prior.P))
    return inject_correction(nodes, smoothed.x), smoothed


class FixedLagSmoother:
    """Nodes of the last `LAG_S`, and the prior that older ones leave of the first of them.

    Attributes
    ----------
    nodes, smoothed, variances : of the last round; the variances are those for the next one.
    """

    nodes: Nodes
    smoothed: Smoothed
    variances: RobustVariances

    def __init__(self, prior: Prior, links: Links, parameters: PocketSmootherParameters) -> None:
        self._p = parameters
        self._noise = build_noise(parameters, links.bias)
        self._prior = prior
        self._links, self._past = links, 0
        self.nodes = predict_nodes(self._prior, links, self._noise)
        self._linearized = self.nodes
        self.variances = initialize_variances(self._estimate_walk(), links)
        self._iterate()

    @property
    def last(self) -> Prior:
        """Estimate and covariance of the last node."""
        return _node_prior(self.nodes, -1, self.smoothed.P[-1])

    def extend(self, new: Links) -> int:
        """Add links and smooth; returns how many of the earlier nodes have left the window."""
        # predict the new nodes
        self._links = self._links.append(new)
        more = predict_nodes(_node_prior(self.nodes, -1), new, self._noise)
        self.nodes = Nodes(*(np.concatenate([x, y[1:]]) for x, y in zip(self.nodes, more, strict=True)))
        # marginalize the oldest
        left = self._marginalize()
        # variances of the last round go on
        self.variances = self._extend_variances(self.variances, left)
        self._iterate()
        return left

    def _estimate_walk(self) -> Floats:
        return estimate_field_walk(self._links, self._p.mag_sigma_uT)[self._past :]

    def _iterate(self) -> None:
        walk = self._estimate_walk()
        links = self._links.slice(self._past, len(self._links))
        rests = detect_rests(self._links).drop_before(self._past)
        self._linearized = self.nodes
        inputs = assemble_inputs(links, self.variances, rests)
        self.nodes, self.smoothed = iterate_once(self._prior, self.nodes, self._noise, inputs)
        self.variances = reweigh_variances(walk, links, self.smoothed)

    def _extend_variances(self, old: RobustVariances, left: int) -> RobustVariances:
        """Variances of the last round where there was one, initial ones for new nodes; the last one began no link."""
        links = self._links.slice(self._past, len(self._links))
        new = initialize_variances(self._estimate_walk(), links)
        stay = len(old.step) - left
        return RobustVariances(
            np.concatenate([old.step[left:], new.step[stay:]]),
            np.concatenate([old.deviation[left:-1], new.deviation[stay:]]),
            np.concatenate([old.pace[left:], new.pace[stay:]]),
            np.concatenate([old.swing[left:], new.swing[stay + 1 :]]),
        )

    def _marginalize(self) -> int:
        """Drop nodes older than the lag, but keep the links that rests and the spread of strength still reach."""
        links = self._links
        oldest = links.start_s[-1] + links.h[-1] - LAG_S
        left = int(np.searchsorted(links.start_s[self._past :], oldest - 1e-6))
        left = min(left, len(self.smoothed.x_ahead) - 1)
        if left:
            before = Nodes(*(part[: left + 1] for part in self._linearized))
            ahead = inject_correction(before, self.smoothed.x_ahead[: left + 1])
            self._prior = _node_prior(ahead, left, self.smoothed.P_ahead[left])
            self.nodes = Nodes(*(part[left:] for part in self.nodes))
        self._past += left
        reach = int(np.ceil(FIELD_WINDOW_S / NODE_S)) + REST_LINKS
        useless = max(self._past - reach, 0)
        self._links = links.slice(useless, len(links))
        self._past -= useless
        return left


def initialize_nodes(links: Links, start: PocketStart, p: PocketSmootherParameters) -> tuple[Nodes, RobustVariances]:
    """Nodes and variances of all links as they left the window of a fixed-lag smoother, and as they are at the end."""
    every = max(round(LAG_S / 2 / NODE_S), 1)
    window = FixedLagSmoother(build_prior(start, links, p), links.slice(0, every), p)
    nodes: list[Nodes] = []
    variances: list[RobustVariances] = []
    for first in range(every, len(links), every):
        old_nodes, old_variances = window.nodes, window.variances
        left = window.extend(links.slice(first, min(first + every, len(links))))
        nodes.append(Nodes(*(x[:left] for x in old_nodes)))
        variances.append(RobustVariances(*(x[:left] for x in old_variances)))
    nodes.append(window.nodes)
    variances.append(window.variances)
    return (
        Nodes(*(np.concatenate(x) for x in zip(*nodes, strict=True))),
        RobustVariances(*(np.concatenate(x) for x in zip(*variances, strict=True))),
    )


def _node_prior(nodes: Nodes, k: int, P: Floats = np.zeros((SIZE, SIZE))) -> Prior:
    return Prior(nodes.R[k], nodes.y[k], P)


def _pad_last(x: Floats) -> Floats:
    """Of links, for nodes: the last node begins none."""
    return np.concatenate([x, np.zeros((1, *x.shape[1:]))])
