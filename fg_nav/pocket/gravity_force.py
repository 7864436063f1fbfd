"""Up by the mean specific force of the last strides, made of links: the window of `fg_nav.pocket.gravity` by nodes.

    f_k = sum over the links j before node k of  w_j A_jk^T s_j / h_j,     A_jk = dR_j dR_j+1 ... dR_k-1,

s_j the velocity gained in link j, in the body's frame at its node, w a raised cosine over the window. A bias higher by
d makes A_jk to be A_jk Exp(C_jk d), and with S_j d what it adds to s_j, the mean changes by

    sum  w_j / h_j ([A_jk^T s_j]x C_jk + A_jk^T S_j) d,     C_jk = C_j+1,k + A_j+1,k^T J_j

which is about that of a turn by half the window's time.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from fg_nav.arrays import Floats
from fg_nav.pocket.graph_links import Links
from fg_nav.pocket.graph_parameters import PocketGraphParameters


@njit(cache=True)
def mean_forces(
    turn: Floats, per_bias: Floats, push: Floats, push_per_bias: Floats, h: Floats, window_s: float
) -> tuple[Floats, Floats]:
    """Mean force (K + 1, 3) m/s^2 in the body at each node, NaN at first, and (K + 1, 3, 3) its change by the bias."""
    links = len(h)
    force = np.full((links + 1, 3), np.nan)
    change = np.zeros((links + 1, 3, 3))
    for k in range(1, links + 1):
        A, C, age, total = np.eye(3), np.zeros((3, 3)), 0.0, 0.0
        f, df = np.zeros(3), np.zeros((3, 3))
        for j in range(k - 1, -1, -1):
            if age + h[j] > window_s + 1e-3:
                break
            # A from the body at node k to that at node j; with the bias it is A Exp(C d)
            C = C + A.T @ per_bias[j]
            A = turn[j] @ A
            w = _weight(age, age + h[j], window_s)
            part = A.T @ push[j] * (w / h[j])
            f += part
            df += np.array([[0.0, -part[2], part[1]], [part[2], 0.0, -part[0]], [-part[1], part[0], 0.0]]) @ C
            df += A.T @ push_per_bias[j] * (w / h[j])
            age, total = age + h[j], total + w
        if age > window_s - 0.5 * h[k - 1] - 1e-3:
            force[k], change[k] = f / total, df / total
    return force, change


@njit(cache=True)
def _weight(young: float, old: float, window_s: float) -> float:
    """Integral of 1 - cos(2 pi age / window) over ages."""
    c = window_s / (2 * np.pi)
    return float((old - young) - c * (np.sin(old / c) - np.sin(young / c)))


class Gravity(NamedTuple):
    """Up as the force has it at N nodes.

    `up` (N, 3) unit vectors in the body, `per_bias` (N, 3, 3) s how they change with the bias, and `variance` (N,) of
    their level parts, infinite where there is none.
    """

    up: Floats
    per_bias: Floats
    variance: Floats

    def after(self, first: int) -> Gravity:
        """Return that of the nodes from `first` on."""
        return Gravity(self.up[first:], self.per_bias[first:], self.variance[first:])


def gravity_of(links: Links, p: PocketGraphParameters, skipped: int = 0) -> Gravity:
    """Up at the K + 1 nodes of links, taken every half of a window, counted from `skipped` links before the first."""
    force, change = mean_forces(
        links.turn, links.per_bias, links.push, links.push_per_bias, links.h, p.gravity_window_s
    )
    strength = np.linalg.norm(force, axis=1)
    every = max(round(p.gravity_window_s / 2 / p.node_s), 1)
    taken = (np.arange(len(force)) + skipped) % every == 0
    alone = taken & (np.abs(strength - p.gravity) < p.zero_acceleration_m_s2)  # not NaN
    share = np.divide(1.0, strength, out=np.zeros(len(force)), where=alone)
    variance = np.where(alone, (p.acc_sigma_m_s2 * share) ** 2, np.inf)
    up = np.where(alone[:, None], force, 0.0) * share[:, None]
    return Gravity(up, change * share[:, None, None], variance)
