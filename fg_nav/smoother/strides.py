"""One function turns a stride into factors; a walk is its strides, added one after the other.

Variables: pose X and velocity V at each node; for the footfalls of ten seconds one bias B and one excess S of the
settling of the sole. A stride is a footfall and the swing that led to it. It adds

* inertial factors from the last node of the footfall before, through all nodes of this one;
* at each node a tie of the velocity, V = R (w x l) + settling - S / (duration of the stance) up, with a sigma that
  grows with how fast the foot turns and how far its specific force is from gravity there;
* where a new bias begins, random-walk factors of B and S from those before;
* for each rest in the footfall, what it shows of the gyro bias.

The sole of one walk settles in all its stances alike, by more or by less than expected: what a stride climbs for that
adds up stride by stride, not by the root of their number. Nothing inertial shows it, as a constant vertical velocity
looks like none. So S is a variable, m: known to its prior, but where floors or fixes show the height it is learned, and
all strides between have the profit.

The velocity tie is `factors.rolling_stance_factor`, its residual turned into the body's axes. There are thousands in a
walk, and each costs a call from C++ into Python at every linearisation; `VelocityTies` holds them all, and linearises
them together in numpy.

The first footfall has in place of the swing a prior on the bias, and the gauge: position and heading by definition,
tilt from gravity.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, S, V, X

from fg_nav.arrays import Floats
from fg_nav.detection import Rest
from fg_nav.factors import rolling_stance_jacobian, rolling_stance_residual, zero_rate_factor
from fg_nav.factors.rotation import skew
from fg_nav.recording import Recording
from fg_nav.smoother.nodes import Nodes
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.stances import Stances

UNREST_REACH_S = 0.01
"""On either side of a node, over which rate and specific force are averaged; not beyond the stance."""

Measurements = Iterator[gtsam.PreintegratedImuMeasurementsG]


@dataclass(frozen=True)
class Stride:
    """What a footfall and the swing before it measured.

    Nodes `first <= j < last`, bias `bias` and before the footfall `bias_before`, begun `bias_age_s` ago;
    `measurements` from each node's predecessor to it (none before the very first);
    `body_velocity`, `settling`, `velocity_sigma` (last - first, 3) m/s of the sensor in stance, `sinks_per_m`
    (last - first,) m/s by which it sinks faster for each metre that the sole settles more.
    """

    first: int
    last: int
    bias: int
    bias_before: int
    bias_age_s: float
    measurements: list[gtsam.PreintegratedImuMeasurementsG]
    body_velocity: Floats
    settling: Floats
    velocity_sigma: Floats
    sinks_per_m: Floats
    rests: list[Rest]


STANDS_S = 1.5
"""Nobody walks with stances so long: the foot stands, and its sole has settled."""


def strides_of(
    recording: Recording,
    stances: Stances,
    nodes: Nodes,
    measurements: Measurements,
    gyro_bias: Floats,
    lever: Floats,
    rests: tuple[Rest, ...],
    p: SmootherParameters,
) -> Iterator[Stride]:
    """Yield the strides of a walk in order; `gyro_bias` (3,) rad/s is the one the lever's velocity is taken with."""
    reach = max(1, round(UNREST_REACH_S / recording.period_s))
    rate = _about_nodes(recording.gyr, stances, nodes, reach) - gyro_bias
    off_gravity = np.linalg.norm(recording.acc, axis=1, keepdims=True) - p.gravity
    off_gravity = np.sqrt(_about_nodes(off_gravity**2, stances, nodes, reach)[:, 0])
    body_velocity = np.cross(rate, lever)
    sinks_per_m = _sinking(recording.t, stances, p)[nodes.footfall]
    settling, sigma = _stance_noise(sinks_per_m, rate, off_gravity, p)
    t = recording.t[nodes.sample[nodes.result]]
    begun = t[np.flatnonzero(np.diff(nodes.bias, prepend=-1))]
    rests_of = _by_footfall(rests, nodes)
    for k, (first, last) in enumerate(zip(nodes.first[:-1], nodes.first[1:], strict=True)):
        yield Stride(
            first=first,
            last=last,
            bias=nodes.bias[k],
            bias_before=nodes.bias[max(k - 1, 0)],
            bias_age_s=t[k] - begun[nodes.bias[max(k - 1, 0)]],
            measurements=[next(measurements) for _ in range(max(first, 1), last)],
            body_velocity=body_velocity[first:last],
            settling=settling[first:last],
            velocity_sigma=sigma[first:last],
            sinks_per_m=sinks_per_m[first:last],
            rests=rests_of.get(k, []),
        )


class VelocityTies:
    """The velocity ties of a walk: residual e = V - R u - settling + sinks_per_m S up, over sigma.

    With u = w x l in the body frame, and S the excess of the settling that the footfall's number `sole` has.
    """

    def __init__(self) -> None:
        self._node: list[int] = []
        self._body_velocity: list[Floats] = []
        self._settling: list[Floats] = []
        self._sigma: list[Floats] = []
        self._sole: list[int] = []
        self._sinks_per_m: list[float] = []

    def add(
        self, node: int, body_velocity: Floats, settling: Floats, sigma: Floats, sole: int, sinks_per_m: float
    ) -> None:
        """Add the tie of a node: velocities and sigmas (3,) m/s, excess S(sole), and `sinks_per_m` 1/s."""
        self._node.append(node)
        self._body_velocity.append(body_velocity)
        self._settling.append(settling)
        self._sigma.append(sigma)
        self._sole.append(sole)
        self._sinks_per_m.append(sinks_per_m)

    def error(self, values: gtsam.Values) -> float:
        """Half the sum of squares of the residuals over their sigmas."""
        residual, _ = self._residuals(values)
        return 0.5 * float((residual**2).sum())

    def linearize(self, values: gtsam.Values) -> Iterator[gtsam.JacobianFactor]:
        """Yield the linearised ties: r = R^T e / sigma, dr/dpose = [R^T (R [u]x / sigma) + [r]x, 0], dr/dV = R^T/sigma.

        And dr/dS = sinks_per_m dr/dV up.

        The residual is turned into the body's axes, which leaves its square as it is. In navigation axes a residual
        turns with the heading, and Gauss-Newton, which has no second derivative to set against that, takes it for a
        measurement of the heading: each tie would add one over a radian squared.
        """
        residual, attitude = self._residuals(values)
        weight = attitude.transpose(0, 2, 1) / np.array(self._sigma)[:, None, :]
        turned = np.einsum("kji,kj->ki", attitude, residual)
        by_pose = np.zeros((len(weight), 3, 6))
        by_pose[:, :, :3] = weight @ rolling_stance_jacobian(attitude, np.array(self._body_velocity)) + skew(turned)
        by_excess = weight[:, :, 2:] * np.array(self._sinks_per_m)[:, None, None]
        unit = gtsam.noiseModel.Unit.Create(3)
        for j, k, A, B_, C, b in zip(self._node, self._sole, by_pose, weight, by_excess, -turned, strict=True):
            yield gtsam.JacobianFactor(X(j), A, V(j), B_, S(k), C, b, unit)

    def _residuals(self, values: gtsam.Values) -> tuple[Floats, Floats]:
        """Residuals over sigma (J, 3), and attitudes (J, 3, 3)."""
        attitude = np.array([values.atPose3(X(j)).rotation().matrix() for j in self._node])
        velocity = np.array([values.atVector(V(j)) for j in self._node])
        body_velocity, settling = np.array(self._body_velocity), np.array(self._settling)
        settling[:, 2] -= np.array(self._sinks_per_m) * [values.atVector(S(k))[0] for k in self._sole]
        residual = rolling_stance_residual(attitude, velocity, body_velocity, settling)
        return residual / np.array(self._sigma), attitude


def add_stride(graph: gtsam.NonlinearFactorGraph, ties: VelocityTies, stride: Stride, p: SmootherParameters) -> None:
    """Turn a stride into factors."""
    for j, measurement in enumerate(stride.measurements, start=max(stride.first, 1)):
        bias = B(stride.bias_before if j == stride.first else stride.bias)
        graph.push_back(gtsam.GalileanImuFactor(X(j - 1), V(j - 1), X(j), V(j), bias, measurement))
    for i, j in enumerate(range(stride.first, stride.last)):
        velocity = stride.body_velocity[i], stride.settling[i], stride.velocity_sigma[i]
        ties.add(j, *velocity, stride.bias, float(stride.sinks_per_m[i]))
    if stride.bias != stride.bias_before:
        walk = np.repeat([p.acc_bias_walk, np.radians(p.gyro_bias_walk_deg_s)], 3)
        noise = gtsam.noiseModel.Diagonal.Sigmas(walk * np.sqrt(stride.bias_age_s))
        graph.push_back(gtsam.BetweenFactorConstantBias(B(stride.bias_before), B(stride.bias), NO_CHANGE, noise))
        change = _one_sigma(p.settling_walk_m * np.sqrt(stride.bias_age_s))
        graph.push_back(gtsam.BetweenFactorVector(S(stride.bias_before), S(stride.bias), np.zeros(1), change))
    for rest in stride.rests:
        graph.push_back(zero_rate_factor(B(stride.bias), rest.rate, rest.sigma))


def add_start(graph: gtsam.NonlinearFactorGraph, gyro_bias_sigma: float, p: SmootherParameters) -> None:
    """Add the priors on the bias and on the excess of the settling."""
    graph.addPriorConstantBias(B(0), _bias(np.zeros(3)), _bias_noise(p.acc_bias_sigma, gyro_bias_sigma))
    graph.push_back(gtsam.PriorFactorVector(S(0), np.zeros(1), _one_sigma(p.settling_sigma_m)))


def gauge(nav_R_body: Floats, heading_sigma: float, p: SmootherParameters) -> gtsam.PriorFactorPose3:
    """Fix the gauge at the first node: position zero, this attitude, its heading with a sigma in rad."""
    pose = gtsam.Pose3(gtsam.Rot3(nav_R_body), np.zeros(3))
    tilt = np.radians(p.tilt_sigma_deg)
    nav_rotation = np.diag([tilt, tilt, heading_sigma]) ** 2
    covariance = np.eye(6) * p.gauge_sigma**2
    covariance[:3, :3] = nav_R_body.T @ nav_rotation @ nav_R_body
    return gtsam.PriorFactorPose3(X(0), pose, gtsam.noiseModel.Gaussian.Covariance(covariance))


def gauge_of(nav_R_body: Floats, free: bool, p: SmootherParameters) -> gtsam.PriorFactorPose3:
    """Fix the gauge at an attitude whose heading is free to be found, or is so by definition."""
    return gauge(nav_R_body, np.radians(p.unknown_heading_deg) if free else p.gauge_sigma, p)


NO_CHANGE = gtsam.imuBias.ConstantBias()


def _bias(gyro: Floats) -> gtsam.imuBias.ConstantBias:
    return gtsam.imuBias.ConstantBias(np.zeros(3), gyro)


def _bias_noise(acc_sigma: float, gyro_sigma: float) -> gtsam.noiseModel.Diagonal:
    return gtsam.noiseModel.Diagonal.Sigmas(np.repeat([acc_sigma, gyro_sigma], 3))


def _one_sigma(sigma: float) -> gtsam.noiseModel.Isotropic:
    return gtsam.noiseModel.Isotropic.Sigma(1, sigma)


def _sinking(t: Floats, stances: Stances, p: SmootherParameters) -> Floats:
    """Share (F,) 1/s of its settling by which the sole sinks in each second of a footfall.

    It settles once, though the stance may be in pieces. Who stands has settled: a long stance, or one that begins where
    the one before ended, is taken to settle no more.
    """
    first = np.searchsorted(stances.footfall, np.arange(stances.n_footfalls))
    last = np.append(first[1:], len(stances)) - 1
    duration = t[stances.stop[last] - 1] - t[stances.start[first]]
    continues = np.append(False, stances.start[first[1:]] == stances.stop[last[:-1]])
    sinking = 1.0 / np.maximum(duration, p.settling_time_s)
    return np.where(continues | (duration > STANDS_S), 0.0, sinking)


def _stance_noise(
    sinks_per_m: Floats, rate: Floats, off_gravity: Floats, p: SmootherParameters
) -> tuple[Floats, Floats]:
    """Velocity of the settling sole and sigma of the velocity, (M, 3) m/s, at each node."""
    sinking = p.settling_m * sinks_per_m
    settling = np.zeros((len(rate), 3))
    settling[:, 2] = -sinking
    still = p.velocity_sigma**2 + (p.unsteady_s * off_gravity) ** 2
    rolling = p.roll_sigma_m**2 * (rate**2).sum(axis=1)
    sigma = np.repeat(np.sqrt(still + rolling)[:, None], 3, axis=1)
    sigma[:, 2] = np.hypot(sigma[:, 2], sinking)
    return settling, sigma


def _about_nodes(samples: Floats, stances: Stances, nodes: Nodes, reach: int) -> Floats:
    """Mean (M, d) of the samples (N, d) about each node, as far as its stance goes."""
    first = np.maximum(nodes.sample - reach, stances.start[nodes.interval])
    last = np.minimum(nodes.sample + reach + 1, stances.stop[nodes.interval])
    total = np.concatenate([np.zeros((1, samples.shape[1])), np.cumsum(samples, axis=0)])
    return np.asarray((total[last] - total[first]) / (last - first)[:, None])


def _by_footfall(rests: tuple[Rest, ...], nodes: Nodes) -> dict[int, list[Rest]]:
    """Rests of each footfall, in which or next to which they lie."""
    middles = [(rest.start + rest.stop) // 2 for rest in rests]
    nearest = np.clip(np.searchsorted(nodes.sample, middles), 0, len(nodes) - 1)
    found: dict[int, list[Rest]] = {}
    for rest, footfall in zip(rests, nodes.footfall[nearest], strict=True):
        found.setdefault(int(footfall), []).append(rest)
    return found
