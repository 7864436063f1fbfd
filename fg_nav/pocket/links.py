"""From samples to links: the samples between two nodes, preintegrated.

A link begins at node k, a sample's stamp, and ends at node k + 1. The gyroscope's errors are

    c = (b, S):   it measures  w + b + S w,

b its bias and S (3, 3) its scale and misalignment, row by row. By the gyroscope alone, with a bias b0 and no S, the
body at sample t is rotated against that at the node by dR_t, and to first order

    dR_t(c0 + d) = dR_t Exp(J_t d),     J_t+1 = Exp(-w h) J_t - Jr(w h) h [1, w_x 1, w_y 1, w_z 1],

the columns put in the order of c. In the body frame at the node, t running over the samples of the link,

    rotation   dR, J        over all of it
    field      z_t = dR_t y_t = u + [u]x K_t d + n,    K_t = dR_t J_t:   means z and K, and their number
    force      s = sum dR_t Jl(w h) f_t h, the delta velocity, and its sum over the rest of the link, the delta
               position; d adds -sum [s_t]x K_t d
    rest       mean and spread of the rates, and the spread of the force

Strengths |y_t| need no attitude at all: their mean shows where the field changes (`iterated_smoother`).

A sensor at rest shows its bias: rate and force are quiet, and the mean rates of the last links agree but for noise. A
standing thigh is quiet too, but it sways by a few tenths of a degree in a second, and its means disagree.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.mechanisation import multiply, right_jacobian, rotate_in_body, rotation_about, transpose
from fg_nav.system.compiled import njit

SENSOR = 12  # Errors of a gyroscope: bias, scale and misalignment.
NODE_S = 0.5  # From node to node, s: a bias of 1 deg/s is off by 0.5 deg then, and a walker goes 0.6 m.
REST_LINKS = 6  # So many links alike, the one to come and those before it, are a rest: 2 s.
REST_RATE_DEG_S = 2.0  # At rest the mean rate is below this about each axis, deg/s, but for a worse sensor ...
REST_SPREAD_DEG_S = 1.0  # ... the spread of the rate is below this, deg/s: ten times the noise of MD Table 2 ...
REST_SPREAD_M_S2 = 0.25  # ... that of the force below this, m/s^2: a MEMS sensor's is 0.02 to 0.1 ...
REST_APART_DEG_S = 0.05  # ... and means of 0.5 s agree to this, deg/s rms an axis: noise leaves 0.014, a thigh 0.2.
REST_SIGMA_DEG_S = 0.03  # Error of such a mean as an observation of the bias, deg/s.


@dataclass(frozen=True)
class Links:
    """K links, one after the other; frames and symbols as above.

    `start_s` (K,) and `h` (K,) s; `turn` (K, 3, 3) and `per_sensor` (K, 3, 12), dR and J; `delta_v` (K, 3) m/s and
    `delta_p` (K, 3) m, and their derivatives by the errors, `delta_v_per_sensor` and `delta_p_per_sensor` (K, 3, 12);
    `count` (K,) fields; `field` (K, 3) uT and `lever` (K, 3, 12), the means z and K, zero where there is none;
    `strength` (K,) uT, mean |y|, NaN where there is none; `rate` (K, 3) rad/s, the mean as measured, and `rate_spread`
    (K,) rad/s and `force_spread` (K,) m/s^2, roots of the summed variances of three axes; `bias` (3,) rad/s, b0.
    """

    start_s: Floats
    h: Floats
    turn: Floats
    per_sensor: Floats
    delta_v: Floats
    delta_v_per_sensor: Floats
    delta_p: Floats
    delta_p_per_sensor: Floats
    count: Floats
    field: Floats
    lever: Floats
    strength: Floats
    rate: Floats
    rate_spread: Floats
    force_spread: Floats
    bias: Floats

    def __len__(self) -> int:
        return len(self.h)

    def slice(self, first: int, last: int) -> Links:
        """Return those from number `first` to before `last`."""
        part = {f.name: getattr(self, f.name)[first:last] for f in fields(self) if f.name != "bias"}
        return Links(**part, bias=self.bias)

    def append(self, later: Links) -> Links:
        """Return these and later ones, made with the same bias."""
        names = [f.name for f in fields(self) if f.name != "bias"]
        joined = {name: np.concatenate([getattr(self, name), getattr(later, name)]) for name in names}
        return Links(**joined, bias=self.bias)


class Rests(NamedTuple):
    """Of N nodes: `rate` (N, 3) rad/s, zero where there is no rest, and `variance` (N,) of it an axis, inf there."""

    rate: Floats
    variance: Floats


def place_nodes(t: Floats, node_s: float = NODE_S) -> Ints:
    """Samples at which nodes are: every `node_s` seconds, and the last; (K + 1,), never fewer than two."""
    every = np.searchsorted(t, np.arange(t[0], t[-1], node_s) - 1e-6)
    return np.unique(np.append(every, len(t) - 1)).astype(np.int64)


def preintegrate_links(node: Ints, t: Floats, acc: Floats, gyr: Floats, mag: Floats | None, bias: Floats) -> Links:
    """Preintegrate rate, force and field between nodes to K links.

    Parameters
    ----------
    node : (K + 1,) samples at which the nodes are; a sample belongs to the link that begins at or before it.
    t, acc, gyr : stamps (N,) s, specific forces and rates (N, 3), each held until the next stamp.
    mag : (N, 3) uT, NaN or all zeros where there is none; None without a magnetometer.
    bias : (3,) rad/s, b0.
    """
    blank = {name: np.zeros((len(node) - 1, *shape)) for name, shape in _SHAPES.items()}
    field = np.zeros((len(t), 3)) if mag is None else mag
    field = np.where((field != 0.0).any(axis=1, keepdims=True), field, np.nan)
    samples = [np.ascontiguousarray(x, dtype=np.float64) for x in (acc, gyr, field)]
    inputs: list[Floats] = [np.diff(t), *samples, np.asarray(bias), *blank.values()]
    _fill_links(node, *inputs)
    return Links(start_s=t[node[:-1]], h=np.diff(t[node]), bias=np.asarray(bias), **blank)


def detect_rests(links: Links) -> Rests:
    """Return rate (K + 1, 3) and variance, infinite without a rest, at each node; causal but for the link after it."""
    slow = np.abs(links.rate).max(axis=1) < np.radians(REST_RATE_DEG_S)
    quiet = slow & (links.rate_spread < np.radians(REST_SPREAD_DEG_S)) & (links.force_spread < REST_SPREAD_M_S2)
    variance, rate = np.full(len(links) + 1, np.inf), np.zeros((len(links) + 1, 3))
    if len(links) >= REST_LINKS:
        at = np.arange(REST_LINKS - 1, len(links))
        last = np.stack([links.rate[at - i] for i in range(REST_LINKS)])
        rests = np.all([quiet[at - i] for i in range(REST_LINKS)], axis=0)
        apart = last.var(axis=0, ddof=1).mean(axis=1)
        rests &= apart < np.radians(REST_APART_DEG_S) ** 2
        variance[at] = np.where(rests, np.radians(REST_SIGMA_DEG_S) ** 2, np.inf)
        rate[at] = np.where(rests[:, None], last[0], 0.0)
    return Rests(rate, variance)


# What `_fill_links` writes, in its order, for each link.
_SHAPES: dict[str, tuple[int, ...]] = {
    "turn": (3, 3),
    "per_sensor": (3, SENSOR),
    "delta_v": (3,),
    "delta_v_per_sensor": (3, SENSOR),
    "delta_p": (3,),
    "delta_p_per_sensor": (3, SENSOR),
    "count": (),
    "field": (3,),
    "lever": (3, SENSOR),
    "strength": (),
    "rate": (3,),
    "rate_spread": (),
    "force_spread": (),
}


@njit(cache=True)
def _fill_links(
    node: Ints,
    periods: Floats,
    acc: Floats,
    gyr: Floats,
    mag: Floats,
    bias: Floats,
    turn: Floats,
    per_sensor: Floats,
    delta_v: Floats,
    delta_v_per_sensor: Floats,
    delta_p: Floats,
    delta_p_per_sensor: Floats,
    count: Floats,
    field: Floats,
    lever: Floats,
    strength: Floats,
    rate: Floats,
    rate_spread: Floats,
    force_spread: Floats,
) -> None:
    """Write the preintegrated arrays of all K links, in place: `turn` and all after it, in the order of `_SHAPES`."""
    theta = np.empty(3)
    for k in range(len(node) - 1):
        R, J = np.eye(3), np.zeros((3, SENSOR))
        for i in range(node[k], node[k + 1]):
            h = periods[i]
            for axis in range(3):
                theta[axis] = (gyr[i, axis] - bias[axis]) * h
            by_turn = right_jacobian(theta)
            K = multiply(R, J)
            # sums of the field
            if np.isfinite(mag[i, 0]) and np.isfinite(mag[i, 1]) and np.isfinite(mag[i, 2]):
                square = 0.0
                for axis in range(3):
                    square += mag[i, axis] ** 2
                    for column in range(3):
                        field[k, axis] += R[axis, column] * mag[i, column]
                    for column in range(SENSOR):
                        lever[k, axis, column] += K[axis, column]
                count[k] += 1.0
                strength[k] += np.sqrt(square)
            # delta velocity and delta position
            _add_force(R, K, by_turn, acc[i], h, delta_v[k], delta_v_per_sensor[k], delta_p[k], delta_p_per_sensor[k])
            # rotation, and its derivative
            J = multiply(transpose(rotation_about(theta)), J)
            for axis in range(3):
                for row in range(3):
                    J[axis, row] -= by_turn[axis, row] * h
                    for column in range(3):
                        J[axis, 3 + 3 * row + column] -= by_turn[axis, row] * theta[column]
            rotate_in_body(R, theta[0], theta[1], theta[2])
        # means of the link
        for axis in range(3):
            for column in range(3):
                turn[k, axis, column] = R[axis, column]
            for column in range(SENSOR):
                per_sensor[k, axis, column] = J[axis, column]
                lever[k, axis, column] /= max(count[k], 1.0)
            field[k, axis] /= max(count[k], 1.0)
        strength[k] = strength[k] / count[k] if count[k] > 0 else np.nan
        rate_spread[k] = _measure_spread(gyr, node[k], node[k + 1], rate[k])
        force_spread[k] = _measure_spread(acc, node[k], node[k + 1], theta)


@njit(cache=True)
def _add_force(
    R: Floats,
    K: Floats,
    by_turn: Floats,
    acc: Floats,
    h: float,
    delta_v: Floats,
    delta_v_per_sensor: Floats,
    delta_p: Floats,
    delta_p_per_sensor: Floats,
) -> None:
    """Add force `acc` (3,) m/s^2 held for `h` s, in place, to deltas and derivatives; `by_turn` (3, 3) is Jr (w h)."""
    gained = np.zeros(3)
    for axis in range(3):
        mean = by_turn[0, axis] * acc[0] + by_turn[1, axis] * acc[1] + by_turn[2, axis] * acc[2]  # Jl is Jr^T
        for row in range(3):
            gained[row] += R[row, axis] * mean * h
    for axis in range(3):
        delta_p[axis] += delta_v[axis] * h + gained[axis] * (h / 2)
        delta_v[axis] += gained[axis]
        left, right = (axis + 1) % 3, (axis + 2) % 3
        for column in range(SENSOR):
            changed = gained[right] * K[left, column] - gained[left] * K[right, column]
            delta_p_per_sensor[axis, column] += delta_v_per_sensor[axis, column] * h + changed * (h / 2)
            delta_v_per_sensor[axis, column] += changed


@njit(cache=True)
def _measure_spread(x: Floats, first: int, stop: int, mean: Floats) -> float:
    """Write the mean (3,) of samples first <= i < stop of x (N, 3); return the rms distance from that mean."""
    square = 0.0
    for axis in range(3):
        total = 0.0
        for i in range(first, stop):
            total += x[i, axis]
        mean[axis] = total / (stop - first)
        for i in range(first, stop):
            square += (x[i, axis] - mean[axis]) ** 2
    return float(np.sqrt(square / (stop - first)))
