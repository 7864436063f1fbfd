"""From samples to links: what the samples between two nodes say, reduced to a few numbers.

A link begins at node k, a sample's stamp, and ends at node k + 1. The gyroscope's errors are

    c = (b, S):   what it says is  w + b + S w,

b its bias and S (3, 3) its scale and misalignment, row by row. By the gyroscope alone, with a bias b0 and no S, the
body at sample t is turned against that at the node by dR_t, and to first order

    dR_t(c0 + d) = dR_t Exp(J_t d),     J_t+1 = Exp(-w h) J_t - Jr(w h) h [1, w_x 1, w_y 1, w_z 1],

the columns put in the order of c. In the body frame at the node, t running over the samples of the link,

    rotation   dR, J        over all of it
    field      z_t = dR_t y_t = u + [u]x K_t d + n,    K_t = dR_t J_t:   means z and K, and how many
    force      s = sum dR_t Jl(w h) f_t h, the velocity gained, and its sum over what is left of the link, how far it
               takes the body; d adds -sum [s_t]x K_t d
    rest       mean and spread of the rates, and the spread of the force

Strengths |y_t| need no attitude at all: their mean shows where the field does not keep still (`graph_field`).
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numba import njit

from fg_nav.arrays import Floats, Ints
from fg_nav.mechanisation import cross_matrix, right_jacobian, rotation_about

SENSOR = 12
"""Errors of a gyroscope: bias, scale and misalignment."""


@dataclass(frozen=True)
class Links:
    """K links, one behind the other; frames and symbols as above.

    `start_s` (K,) and `h` (K,) s; `turn` (K, 3, 3) and `per_sensor` (K, 3, 12), dR and J; `push` (K, 3) m/s and
    `shift` (K, 3) m, velocity gained and way gone by it, and their change by the errors, `push_per_sensor` and
    `shift_per_sensor` (K, 3, 12); `count` (K,) fields; `field` (K, 3) uT and `lever` (K, 3, 12), the means z and K,
    zero where there is none; `strength` (K,) uT, mean |y|, NaN where there is none; `rate` (K, 3) rad/s, the mean as it
    is said, and `rate_spread` (K,) rad/s and `force_spread` (K,) m/s^2, roots of the summed variances of three axes;
    `bias` (3,) rad/s, b0.
    """

    start_s: Floats
    h: Floats
    turn: Floats
    per_sensor: Floats
    push: Floats
    push_per_sensor: Floats
    shift: Floats
    shift_per_sensor: Floats
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

    def part(self, first: int, last: int) -> Links:
        """Return those from the one numbered `first` to before `last`."""
        kept = {f.name: getattr(self, f.name)[first:last] for f in fields(self) if f.name != "bias"}
        return Links(**kept, bias=self.bias)

    def then(self, later: Links) -> Links:
        """Return these and later ones, made with the same bias."""
        names = [f.name for f in fields(self) if f.name != "bias"]
        joined = {name: np.concatenate([getattr(self, name), getattr(later, name)]) for name in names}
        return Links(**joined, bias=self.bias)


def node_samples(t: Floats, node_s: float) -> Ints:
    """Samples at which nodes are: every `node_s` seconds, and the last; (K + 1,), never fewer than two."""
    every = np.searchsorted(t, np.arange(t[0], t[-1], node_s) - 1e-6)
    return np.unique(np.append(every, len(t) - 1)).astype(np.int64)


def links_between(node: Ints, t: Floats, acc: Floats, gyr: Floats, mag: Floats | None, bias: Floats) -> Links:
    """Reduce samples to links.

    Parameters
    ----------
    node : (K + 1,) samples at which the nodes are; a sample belongs to the link that begins at or before it.
    t, acc, gyr : stamps (N,) s, specific forces and rates (N, 3), to be held until the next stamp.
    mag : (N, 3) uT, NaN or all zeros where there is none; None without a magnetometer.
    bias : (3,) rad/s, b0.
    """
    blank = {name: np.zeros((len(node) - 1, *shape)) for name, shape in _SHAPES.items()}
    samples = [np.ascontiguousarray(x, dtype=np.float64) for x in (acc, gyr, _fields(mag, len(t)))]
    given: list[Floats] = [np.diff(t), *samples, np.asarray(bias), *blank.values()]
    _fill(node, *given)
    return Links(start_s=t[node[:-1]], h=np.diff(t[node]), bias=np.asarray(bias), **blank)


_SHAPES: dict[str, tuple[int, ...]] = {
    "turn": (3, 3),
    "per_sensor": (3, SENSOR),
    "push": (3,),
    "push_per_sensor": (3, SENSOR),
    "shift": (3,),
    "shift_per_sensor": (3, SENSOR),
    "count": (),
    "field": (3,),
    "lever": (3, SENSOR),
    "strength": (),
    "rate": (3,),
    "rate_spread": (),
    "force_spread": (),
}
"""Of what is written by `_fill`, in its order, a link."""


def _fields(mag: Floats | None, samples: int) -> Floats:
    """Fields (N, 3), NaN where there is none; all zeros is a logger's way to say so."""
    if mag is None:
        return np.full((samples, 3), np.nan)
    return np.where((mag != 0.0).any(axis=1, keepdims=True), mag, np.nan)


@njit(cache=True)
def _fill(
    node: Ints,
    periods: Floats,
    acc: Floats,
    gyr: Floats,
    mag: Floats,
    bias: Floats,
    turn: Floats,
    per_sensor: Floats,
    push: Floats,
    push_per_sensor: Floats,
    shift: Floats,
    shift_per_sensor: Floats,
    count: Floats,
    field: Floats,
    lever: Floats,
    strength: Floats,
    rate: Floats,
    rate_spread: Floats,
    force_spread: Floats,
) -> None:
    """Write the arrays of all links."""
    for k in range(len(node) - 1):
        R, J = np.eye(3), np.zeros((3, SENSOR))
        for i in range(node[k], node[k + 1]):
            h, w = periods[i], gyr[i] - bias
            K = R @ J
            if np.isfinite(mag[i]).all():
                count[k] += 1.0
                field[k] += R @ mag[i]
                lever[k] += K
                strength[k] += np.sqrt((mag[i] ** 2).sum())
            gained = R @ (right_jacobian(-w * h) @ acc[i]) * h
            changed = -cross_matrix(gained) @ K
            shift[k] += push[k] * h + gained * (h / 2)
            shift_per_sensor[k] += push_per_sensor[k] * h + changed * (h / 2)
            push[k] += gained
            push_per_sensor[k] += changed
            E = rotation_about(w * h)
            J = E.T @ J - _per_error(w, h)
            R = R @ E
        turn[k], per_sensor[k] = R, J
        if count[k] > 0:
            field[k] /= count[k]
            lever[k] /= count[k]
            strength[k] /= count[k]
        else:
            strength[k] = np.nan
        part = slice(node[k], node[k + 1])
        rate[k], rate_spread[k] = _mean_and_spread(gyr[part])
        force_spread[k] = _mean_and_spread(acc[part])[1]


@njit(cache=True)
def _per_error(w: Floats, h: float) -> Floats:
    """Derivative (3, 12) of the turn in a sample by the errors, but for the sign."""
    by_rate = right_jacobian(w * h) * h
    out = np.empty((3, SENSOR))
    out[:, :3] = by_rate
    for row in range(3):
        for column in range(3):
            out[:, 3 + 3 * row + column] = by_rate[:, row] * w[column]
    return out


@njit(cache=True)
def _mean_and_spread(x: Floats) -> tuple[Floats, float]:
    mean = np.zeros(3)
    for i in range(len(x)):
        mean += x[i]
    mean /= len(x)
    square = 0.0
    for i in range(len(x)):
        square += ((x[i] - mean) ** 2).sum()
    return mean, np.sqrt(square / len(x))
