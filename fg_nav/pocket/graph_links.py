"""From samples to links: what the samples between two nodes say, reduced to a few numbers.

A link begins at node k, a sample's stamp, and ends at node k + 1. By the gyroscope alone, with a bias b0, the body at
sample t is turned against that at the node by dR_t, and to first order dR_t(b0 + d) = dR_t Exp(J_t d)
(`factors.rotation`). In the body frame at the node, t running over the samples of the link,

    rotation   dR, J        over all of it
    field      z_t = dR_t y_t = u + [u]x K_t d + n,    K_t = dR_t J_t:   means z and K, and how many
               and what the change within the link says of d once u is eliminated: rows A d = r
               (`factors.swing_field`, nothing is said of u there; it needs no field that keeps still outside the link)
    force      v = sum dR_t Jl(w h) f_t h, the velocity gained, m/s; a change of bias adds -sum [v_t]x K_t d

Strengths |y_t| need no attitude at all: their mean shows where the field does not keep still (`graph_field`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from factors.rotation import left_jacobian, relative_rotations, rotation_exp, skew
from factors.swing_field import square_root, swing_field_quadratics
from fg_nav.arrays import Floats, Ints


@dataclass(frozen=True)
class Links:
    """K links, one behind the other; frames and symbols as above.

    `start_s` (K,) and `h` (K,) s; `turn` (K, 3, 3) and `per_bias` (K, 3, 3) s, dR and J; `push` (K, 3) m/s and
    its change by the bias `push_per_bias` (K, 3, 3) m;
    `count` (K,) fields; `field` (K, 3) uT and `lever` (K, 3, 3) s, the means z and K, zero where there is none;
    `strength` (K,) uT, mean |y|, NaN where there is none; `swing` (K, 3, 4) rows A and r; `bias` (3,) rad/s, b0.
    """

    start_s: Floats
    h: Floats
    turn: Floats
    per_bias: Floats
    push: Floats
    push_per_bias: Floats
    count: Floats
    field: Floats
    lever: Floats
    strength: Floats
    swing: Floats
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


def links_between(
    node: Ints, t: Floats, acc: Floats, gyr: Floats, mag: Floats | None, sigma_uT: float, bias: Floats
) -> Links:
    """Reduce samples to links.

    Parameters
    ----------
    node : (K + 1,) samples at which the nodes are; a sample belongs to the link that begins at or before it.
    t, acc, gyr : stamps (N,) s, specific forces and rates (N, 3), to be held until the next stamp.
    mag : (N, 3) uT, NaN or all zeros where there is none; None without a magnetometer.
    sigma_uT : white error of a field sample.
    bias : (3,) rad/s, b0.
    """
    part = slice(node[0], node[-1])
    periods = np.diff(t)[part]
    segment = np.repeat(np.arange(len(node) - 1), np.diff(node))
    theta = (gyr[part] - bias) * periods[:, None]
    R, J = relative_rotations(gyr[part], periods, segment, bias)
    last = node[1:] - 1 - node[0]
    turn, per_bias = _over_all(R[last], J[last], theta[last], periods[last])
    pushes = np.einsum("nij,njk,nk->ni", R, left_jacobian(theta), acc[part] * periods[:, None])
    fields_there = _fields(mag, part, len(periods))
    count, z, lever, strength = _means(R, J, fields_there, segment, len(node) - 1)
    quadratics = swing_field_quadratics(R, J, fields_there, segment, sigma_uT)
    A, r = square_root(quadratics.information, quadratics.vector)
    return Links(
        start_s=t[node[:-1]],
        h=np.diff(t[node]),
        turn=turn,
        per_bias=per_bias,
        push=np.add.reduceat(pushes, node[:-1] - node[0]),
        push_per_bias=np.add.reduceat(-skew(pushes) @ R @ J, node[:-1] - node[0]),
        count=count,
        field=z,
        lever=lever,
        strength=strength,
        swing=np.concatenate([A, r[:, :, None]], axis=2),
        bias=bias,
    )


def _fields(mag: Floats | None, part: slice, samples: int) -> Floats:
    """Fields (T, 3) of a part, NaN where there is none; all zeros is a logger's way to say so."""
    if mag is None:
        return np.full((samples, 3), np.nan)
    return np.where((mag[part] != 0.0).any(axis=1, keepdims=True), mag[part], np.nan)


def _over_all(R: Floats, J: Floats, theta: Floats, h: Floats) -> tuple[Floats, Floats]:
    """Rotation over a whole link and its derivative, from those to its last sample and the turn in that one."""
    back = rotation_exp(-theta)
    return R @ rotation_exp(theta), back @ J - left_jacobian(-theta) * h[:, None, None]


def _means(R: Floats, J: Floats, y: Floats, segment: Ints, links: int) -> tuple[Floats, Floats, Floats, Floats]:
    there = np.isfinite(y).all(axis=1)
    index = segment[there]
    count = np.bincount(index, minlength=links).astype(np.float64)
    share = 1.0 / np.maximum(count, 1.0)

    def mean(x: Floats) -> Floats:
        flat = x.reshape(len(x), math.prod(x.shape[1:]))
        sums = np.stack([np.bincount(index, column, minlength=links) for column in flat.T], axis=1)
        return np.asarray((sums * share[:, None]).reshape(links, *x.shape[1:]))

    z = mean(np.einsum("nij,nj->ni", R[there], y[there]))
    strength = np.where(count > 0, mean(np.linalg.norm(y[there], axis=1)[:, None])[:, 0], np.nan)
    return count, z, mean(R[there] @ J[there]), strength
