"""Orientation and gyro bias of a sensor in a trouser pocket: an iterated Kalman smoother.

    nodes      every half second: attitude, gyro bias, the local field, and that of the region       (kalman_smoother)
    links      the gyroscope, preintegrated with its derivative by the bias; the field's means       (kalman_smoother)
    variances  of field, place, pace and swing, t-distributed, by IRLS
    fixed lag  the smoother of the last seconds, online and as the first estimate of the batch

MD compares each field with the last one, and loses nearly all information: the noise of a difference does not grow
with the time over which the bias turns it. Here a field is compared with all measurements of it: with a noise of s uT a
sample, n samples a second and a field of H uT across, the bias is known after T seconds to

    s / H sqrt(12 / (n T^3))                                          (least squares of a straight line)

and, by turns of body and walk, so are the biases about all axes, as far as the gyroscope's own noise allows. The
direction of the field is not observable, for iron may be near. But that of the region is constant, and its mean keeps
the heading, relative to that at the start.

Each round linearizes all nodes again, recomputes the robust weights, and solves exactly. The first estimate is that of
the fixed-lag smoother: by the gyroscope alone, 0.1 deg/s are a full turn in an hour.

Field. Its step in nav from node to node is heavy-tailed: iron comes suddenly, and between is little. Its variance is

    v = q^2 h / w,     w = (nu + 3) / (nu + e^2 / (q^2 h))

with w the weight of a t-distribution of nu degrees of freedom, and e^2 the expected square of the step given all else
(expectation maximization, Lange et al. 1989). The least variance, which is the first too, comes from the field's
strength, which needs no attitude: where it spreads over a window T by more than noise does, by s^2, a random walk of
the field that spreads its strength so has q^2 >= 6 s^2 / T. A field that turns at the same strength is detected by the
weights alone. A magnetometer whose iron is not calibrated changes its strength with the attitude: little weight.

The deviation of a place's field from the region's is heavy-tailed too, of standard deviation a, and constant over a
time tau: a node that stands for h seconds counts with 2 tau / h times the variance.

Up. The level velocity v of the sensor follows the force, rotated by the attitude: a tilt a, rad, lets it grow by g a t.
But the sensor stays within a swing s of its place on the body, and the body keeps its velocity u, which walks within a
walker's speed. So over a long time the mean force is up, and over a short one it is not. u changes seldom, and then
quickly (start, stop, corner): its steps are t-distributed, v = q^2 h / w with w = (nu + 2) / (nu + e^2 / (q^2 h)),
e^2 the expected square of both level parts. So are the swings p.

Fixed lag. The nodes of the last seconds are smoothed again whenever there are new ones. Older nodes are marginalized
into a prior of the first node of the window, as they were linearized and weighted then: the same forward pass as over
all nodes, but for weights that only later data could correct.

Reference: Lange, Little, Taylor (1989), "Robust statistical modeling using the t distribution".
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import EstimationError
from fg_nav.factors.rotation import relative_rotations, rotation_exp, unskew
from fg_nav.pocket.filter import (
    GYR_DENSITY_DEG,
    compute_bias_decay,
    compute_bias_walk,
    compute_earth_rate,
)
from fg_nav.pocket.kalman_smoother import (
    ATTITUDE,
    BIAS,
    FIELD,
    NODE_S,
    REGION,
    REST_LINKS,
    SCALE,
    SENSOR,
    SIZE,
    VELOCITY,
    Links,
    Nodes,
    Noise,
    Rests,
    RobustVariances,
    Smoothed,
    detect_rests,
    place_nodes,
    preintegrate_links,
    smooth_nodes,
)
from fg_nav.pocket.track import STORED_EVERY_S, PocketStart, PocketTrack, level_start
from fg_nav.recording import Recording

MAX_ROUNDS = 20  # Each with new weights ...
ENOUGH_DEG_S = 1e-4  # ... which end when no bias moves by more, deg/s.
LAG_S = 10.0  # Lag of the online smoother, s: nodes within it are linearized and weighted again.
ACC_DENSITY_M_S2 = 0.05  # Of the force, m/s^2/sqrt(Hz): noise of 0.002, and a bias of 0.05 that turns with the body.
REST_SIGMA_M_S = 0.05  # Velocity of a sensor at rest, m/s.
PACE_M_S = 1.4  # Velocity of the body, m/s an axis: a walker.
FIELD_PRIOR_UT = 60.0  # Prior sigma of the local field, uT an axis: more than the Earth's.
GAP_TURN_DEG_S = 100.0  # Where samples are missing, a thigh may have turned at this rate, deg/s: the rms of its swing
GAP_TILT_DEG = 30.0  # ... but its tilt by no more than this, half of a swing, deg ...
GAP_TURN_DEG = 100.0  # ... and its heading by no more than this, deg: about the sigma of an unknown one.
FIELD_WALK_UT = 0.03  # Least walk of the local field, uT/sqrt(s): 0.2 uT in 50 m, or 0.1 deg/sqrt(s) of heading.
FIELD_FREEDOM = 2.0  # Degrees of freedom of the t-distribution of a step of the field: low, for iron comes suddenly.
FIELD_WINDOW_S = 3.0  # Window of the strength's spread, s.
FIELD_FALSE_ALARM = 0.01  # Rate at which noise alone exceeds the limit of that spread.
FIELD_DEVIATION_UT = 0.3  # Deviation of the local field from the region's, uT an axis: outdoors, some metres from iron.
FIELD_PLACE_S = 10.0  # The deviation is constant for so long, s: as many metres. Nodes within it are not independent.
PACE_WALK_M_S = 0.05  # Walk of the body's velocity at an even pace, m/s/sqrt(s): simulated walkers', by tilt's NEES.
PACE_FREEDOM = 2.0  # Degrees of freedom of the t-distribution of its steps: seldom and sudden.
SWING_M = 0.3  # Swing of the sensor from its place on the body, m an axis: a thigh 0.2, an arm 0.4.
SWING_FREEDOM = 5.0  # Degrees of freedom of its t-distribution.


@dataclass(frozen=True)
class PocketSmootherParameters:
    """Of `smooth_pocket` and `OnlinePocket`: errors of the sensors, which differ from one to the next.

    `gyr_scale_sigma`: of scale and misalignment, a fraction of the rate: a sensor calibrated by its maker, 0.1 deg of
    axes. Assumed; chosen with the BROAD trials in view (docs/pocket.md). 0.01 for a bare chip.
    """

    gyro_bias_sigma_deg_s: float = 0.3  # Prior sigma of the bias: a MEMS sensor's is 0.1 to 0.5.
    gyr_scale_sigma: float = 0.002
    bias_returns_to_zero: bool = False  # AR(1) as in MD (10); otherwise a random walk of the same steps.
    latitude_deg: float | None = None  # North, to remove the Earth's rate; None to leave it.
    mag_sigma_uT: float = 0.5  # White error of the magnetometer, an axis and sample: a MEMS one's at 100 Hz.
    mag_left_uT: float = 0.5  # Error left by its calibration, an axis: 1 % of the field, different at each attitude.


def smooth_pocket(
    recording: Recording,
    parameters: PocketSmootherParameters = PocketSmootherParameters(),
    start: PocketStart | None = None,
    progress: Callable[[float], None] | None = None,
) -> PocketTrack:
    """Estimate orientation and gyro bias of a sensor in a trouser pocket from all of a recording.

    Where there is no field the gyroscope and gravity are used alone. Both NIS are of two degrees of freedom, predicted
    at a node; a field's, of three, is scaled to that.

    Parameters
    ----------
    start : attitude at the first sample; level with heading 0 if None.
    progress : called with the share that is done.

    Raises `EstimationError` if it cannot be levelled, or the solution diverges to infinity.
    """
    start = level_start(recording) if start is None else start
    node = place_nodes(recording.t)
    acc, gyr = recording.integrable
    links = preintegrate_links(node, recording.t, acc, gyr, recording.mag)
    noise, prior = build_noise(parameters), build_prior(start, links, parameters)
    nodes, variances = initialize_nodes(links, start, parameters)
    walk, rests = estimate_field_walk(links, parameters.mag_sigma_uT), detect_rests(links)
    for done in range(MAX_ROUNDS):
        # linearize and solve
        nodes, smoothed = iterate_once(prior, nodes, links, variances, rests, noise)
        change = float(np.degrees(np.abs(smoothed.x[:, BIAS : BIAS + 3]).max()))
        if not np.isfinite(change):
            raise EstimationError(
                "the smoother of the pocket diverged to infinity: check the samples of the recording."
            )
        # recompute the robust weights
        variances = reweigh_variances(walk, links, smoothed.square)
        if progress is not None:
            progress((done + 1) / MAX_ROUNDS)
        if change < ENOUGH_DEG_S:
            break
    # bias and sigmas linear between the nodes, attitudes by the gyroscope
    t, at = recording.t, recording.t[node]
    every = max(round(STORED_EVERY_S * (len(node) - 1) / (at[-1] - at[0])), 1)
    sigma = np.sqrt(smoothed.P[:, range(6), range(6)])
    gravity_nis, field_nis = scatter_nis(node, smoothed.swing_nis, smoothed.field_nis, len(t))
    return PocketTrack(
        t=t,
        nav_R_body=_join_attitudes(recording, node, nodes),
        gyro_bias=np.stack([np.interp(t, at, column) for column in nodes.b.T], axis=1),
        sigma=np.stack([np.interp(t, at, column) for column in sigma.T], axis=1),
        covariance_sample=node[::every],
        covariance=np.ascontiguousarray(smoothed.P[::every, :6, :6]),
        gravity_nis=gravity_nis,
        field_nis=field_nis,
    )


def _join_attitudes(recording: Recording, node: Ints, nodes: Nodes) -> Floats:
    """Attitudes (N, 3, 3) at the samples: strapdown from each node, misclosure at the next spread over the link."""
    gyr, periods = recording.integrable[1], recording.periods_s
    segment = np.append(np.repeat(np.arange(len(node) - 1), np.diff(node)), len(node) - 1)
    # propagate from each node
    R, _ = relative_rotations(gyr, periods, segment, nodes.b)
    # misclosure at the next one
    last = node[1:] - 1
    at_end = nodes.R[:-1] @ R[last] @ rotation_exp((gyr[last] - nodes.b[:-1]) * periods[last, None])
    misclosure = unskew(nodes.R[1:] @ np.swapaxes(at_end, 1, 2))
    axis = np.concatenate([misclosure, np.zeros((1, 3))])
    # spread it over time
    share = (recording.t - recording.t[node[segment]]) / np.append(np.diff(recording.t[node]), 1.0)[segment]
    return np.asarray(rotation_exp(axis[segment] * share[:, None]) @ nodes.R[segment] @ R)


def scatter_nis(node: Ints, swing: Floats, field: Floats, samples: int) -> Floats:
    """(2, samples) NIS at nodes (K,), NaN between; a field's, of three degrees of freedom, scaled to two."""
    out = np.full((2, samples), np.nan)
    out[:, node] = swing, field * (2.0 / 3.0)
    return out


# one round


class Prior(NamedTuple):
    """Prior of one node: its estimate, and the covariance `P` (27, 27) of x."""

    R: Floats
    y: Floats
    P: Floats


def build_noise(p: PocketSmootherParameters) -> Noise:
    """Return the noise densities of the compiled smoother."""
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
    )


def build_prior(start: PocketStart, links: Links | None, p: PocketSmootherParameters) -> Prior:
    """Prior of the first node: start attitude, zero bias, scale error and velocities, and the first field, wide."""
    R = np.asarray(start.nav_R_body, dtype=np.float64)
    # both fields of the state are the first that was read, as the start attitude turns it
    field_nav = np.zeros(3)
    if links is not None and links.n_fields.any():
        field_nav = R @ links.field[int(np.argmax(links.n_fields > 0))]
    y = np.zeros(SIZE - 3)  # the state behind the attitude, which is R
    y[FIELD - 3 : REGION - 3] = y[REGION - 3 : VELOCITY - 3] = field_nav
    # sigmas of attitude, bias, scale (3, 3) and both fields; then of velocity, swing and the body's velocity, (2,)
    parts = [start.tilt_sigma, np.radians(p.gyro_bias_sigma_deg_s), p.gyr_scale_sigma, FIELD_PRIOR_UT]
    sigma = np.append(np.repeat(parts, [3, 3, 9, 6]), np.repeat([PACE_M_S, SWING_M, PACE_M_S], 2))
    sigma[ATTITUDE + 2] = start.heading_sigma
    return Prior(R, y, np.diag(sigma**2))


def propagate_gap(known: Prior, gap_s: float) -> Prior:
    """Prior of the first node after `gap_s` s without samples, from that of the last node before.

    Attitude variance grows, local field and motion are reset; bias, scale and the regional field are kept, so that the
    compass finds the heading again.
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


def predict_nodes(known: Prior, links: Links) -> Nodes:
    """Initial K + 1 nodes: attitudes by strapdown from the prior, all other states constant."""
    by_errors = rotation_exp(links.per_sensor @ known.y[:SENSOR])
    R = [known.R]
    for turn, by_error in zip(links.turn, by_errors, strict=True):
        R.append(R[-1] @ turn @ by_error)
    return Nodes(np.array(R), np.tile(known.y, (len(R), 1)))


def inject_correction(nodes: Nodes, x: Floats) -> Nodes:
    """Nodes corrected by x (N, 27)."""
    return Nodes(rotation_exp(x[:, ATTITUDE : ATTITUDE + 3]) @ nodes.R, nodes.y + x[:, ATTITUDE + 3 :])


def iterate_once(
    prior: Prior, nodes: Nodes, links: Links, variances: RobustVariances, rests: Rests, noise: Noise
) -> tuple[Nodes, Smoothed]:
    """One Gauss-Newton round: the nodes after it, and the linear solution about those before."""
    offset = np.concatenate([unskew(prior.R @ nodes.R[0].T), prior.y - nodes.y[0]])
    smoothed = smooth_nodes(nodes, links, variances, rests, noise, offset, np.ascontiguousarray(prior.P))
    return inject_correction(nodes, smoothed.x), smoothed


# variances of t-distributed terms


def initialize_variances(walk: Floats, links: Links) -> RobustVariances:
    """Variances before the first reweighting; `walk` (K,) uT/sqrt(s) by `estimate_field_walk`."""
    # the field deviation is correlated over `FIELD_PLACE_S`: weight a node by the time of its link
    scale = 2.0 * FIELD_PLACE_S / np.maximum(np.append(links.h, 0.0), 1e-3 * NODE_S)
    return RobustVariances(
        walk**2 * links.h,
        scale * FIELD_DEVIATION_UT**2,
        PACE_WALK_M_S**2 * links.h,
        np.full(len(links.h) + 1, SWING_M**2),
    )


def reweigh_variances(walk: Floats, links: Links, square: RobustVariances) -> RobustVariances:
    """Variances of the next round: expectation step of Student's t, by the expected squares of the last smoothing."""
    least = initialize_variances(walk, links)
    heavier = (FIELD_FREEDOM + square.deviation / FIELD_DEVIATION_UT**2) / (FIELD_FREEDOM + 3.0)
    return RobustVariances(
        _weigh(least.step, square.step, FIELD_FREEDOM, 3),
        least.deviation * heavier,
        _weigh(least.pace, square.pace, PACE_FREEDOM, 2),
        _weigh(least.swing, square.swing, SWING_FREEDOM, 2),
    )


def estimate_field_walk(links: Links, mag_sigma_uT: float) -> Floats:
    """Random walk (K,) uT/sqrt(s) of the field about each link's end, by that of its strength; min. `FIELD_WALK_UT`."""
    reach = max(round(FIELD_WINDOW_S / NODE_S / 2), 1)
    variance = mag_sigma_uT**2 / np.maximum(links.n_fields, 1.0)
    weight = np.where(np.isfinite(links.strength), 1.0, 0.0)
    S = np.nan_to_num(links.strength)
    level = float(np.median(S[weight > 0])) if weight.any() else 0.0
    # moments of the strength over the 2 `reach` links about the end of each
    moments = np.array([np.ones(len(S)), S - level, (S - level) ** 2, variance]) * weight
    total, k = np.pad(np.cumsum(moments, axis=1), ((0, 0), (1, 0))), np.arange(len(S))
    sums = total[:, np.minimum(k + reach + 1, len(S))] - total[:, np.maximum(k - reach + 1, 0)]
    n, first, second, noise = sums
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


# fixed lag


class FixedLagSmoother:
    """Nodes of the last `LAG_S`, and the prior that older ones leave of the first of them."""

    nodes: Nodes  # Of the last round.
    smoothed: Smoothed  # Of the last round.
    variances: RobustVariances  # For the next round.

    def __init__(self, prior: Prior, links: Links, parameters: PocketSmootherParameters) -> None:
        self._mag_sigma_uT = parameters.mag_sigma_uT
        self._noise = build_noise(parameters)
        self._prior = prior
        self._links, self._past = links, 0  # number of links that have left the window and are still needed
        self.nodes = predict_nodes(self._prior, links)
        self._linearized = self.nodes
        self.variances = initialize_variances(estimate_field_walk(links, self._mag_sigma_uT), links)
        self._iterate()

    @property
    def last(self) -> Prior:
        """Estimate and covariance of the last node."""
        return Prior(self.nodes.R[-1], self.nodes.y[-1], self.smoothed.P[-1])

    def extend(self, new: Links) -> int:
        """Add links and smooth; return how many nodes left the window, from its oldest on."""
        # predict the new nodes
        self._links = self._links.append(new)
        more = predict_nodes(self.last, new)
        self.nodes = Nodes(*(np.concatenate([x, y[1:]]) for x, y in zip(self.nodes, more, strict=True)))
        left = self._marginalize()
        # variances of the last round where there was one; the last node began no link
        old, links = self.variances, self._links.slice(self._past)
        first = initialize_variances(estimate_field_walk(self._links, self._mag_sigma_uT)[self._past :], links)
        stay = len(old.step) - left
        for now, before, count in zip(first, old, (stay, stay, stay, stay + 1), strict=True):
            now[:count] = before[left : left + count]
        self.variances = first
        self._iterate()
        return left

    def _iterate(self) -> None:
        links = self._links.slice(self._past)
        rests = Rests(*(of_node[self._past :] for of_node in detect_rests(self._links)))
        self._linearized = self.nodes
        self.nodes, self.smoothed = iterate_once(self._prior, self.nodes, links, self.variances, rests, self._noise)
        walk = estimate_field_walk(self._links, self._mag_sigma_uT)[self._past :]
        self.variances = reweigh_variances(walk, links, self.smoothed.square)

    def _marginalize(self) -> int:
        """Marginalize nodes older than the lag into the prior; return their number. Links needed for rests are kept."""
        links = self._links
        oldest = links.start_s[-1] + links.h[-1] - LAG_S
        left = int(np.searchsorted(links.start_s[self._past :], oldest - 1e-6))
        left = min(left, len(self.smoothed.x_ahead) - 1)
        if left:
            before = Nodes(*(part[: left + 1] for part in self._linearized))
            ahead = inject_correction(before, self.smoothed.x_ahead[: left + 1])
            self._prior = Prior(ahead.R[left], ahead.y[left], self.smoothed.P_ahead[left])
            self.nodes = Nodes(*(part[left:] for part in self.nodes))
        self._past += left
        reach = int(np.ceil(FIELD_WINDOW_S / NODE_S)) + REST_LINKS
        useless = max(self._past - reach, 0)
        self._links = links.slice(useless)
        self._past -= useless
        return left


def initialize_nodes(links: Links, start: PocketStart, p: PocketSmootherParameters) -> tuple[Nodes, RobustVariances]:
    """Initial nodes and variances of all links, by a fixed-lag smoother: each as it left the window, or at the end."""
    every = max(round(LAG_S / 2 / NODE_S), 1)
    window = FixedLagSmoother(build_prior(start, links, p), links.slice(0, every), p)
    nodes: list[Nodes] = []
    variances: list[RobustVariances] = []
    for first in range(every, len(links.h), every):
        old_nodes, old_variances = window.nodes, window.variances
        left = window.extend(links.slice(first, first + every))
        nodes.append(Nodes(*(x[:left] for x in old_nodes)))
        variances.append(RobustVariances(*(x[:left] for x in old_variances)))
    nodes.append(window.nodes)
    variances.append(window.variances)
    return (
        Nodes(*(np.concatenate(x) for x in zip(*nodes, strict=True))),
        RobustVariances(*(np.concatenate(x) for x in zip(*variances, strict=True))),
    )
