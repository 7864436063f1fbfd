"""The pocket's graph, linear about an estimate, solved from end to end.

Each node k has an attitude R_k, a gyro bias b_k, the local field m_k and that of the region E_k, both in nav, uT. The
change asked for, x = (phi, db, dm, dE) with R <- Exp(phi) R, is what is true less what is estimated. Between nodes

    R_k+1 = Exp(-W h) R_k dR_k(b_k) (+ gyroscope),    b_k+1 = c b_k (+ walk),
    m_k+1 = m_k (+ a step, `graph_field`),    E_k+1 = E_k

and at a node, each if there is one (`graph_links`)

    field     m_k - R_k (z - [z]x K (b_k - b0))           is the mean of n samples' noise, and of the field's walk since
    swing     A (b_k - b0) - r                            is of variance 1
    region    m_k - E_k                                           is the deviation of a place (`graph_field`)
    gravity   the level parts of R_k f / |f|              are s / |f|, f a mean over a window up to the node

As every factor ties a node to itself or the next one, the graph is a chain: one elimination from the first node to the
last (which is a Kalman filter) and one substitution back (Rauch, Tung, Striebel) solve it exactly, with all marginals,
in a time that goes with the number of nodes. That is Gauss-Newton's step on all of the graph, and about its estimate.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from fg_nav.arrays import Floats
from fg_nav.ekf.update import correct
from fg_nav.mechanisation import rotation_vector

TURN, BIAS, FIELD, REGION, SIZE = 0, 3, 6, 9, 12
"""Where x has its parts."""


class Nodes(NamedTuple):
    """N nodes: `R` (N, 3, 3), and `b` rad/s, `m` and `E` uT, each (N, 3)."""

    R: Floats
    b: Floats
    m: Floats
    E: Floats


class Factors(NamedTuple):
    """What there is between N nodes and at them, for the compiled pass; symbols above.

    Of links: `h` (N-1,), `turn` and `per_bias` (N-1, 3, 3); `walk` (N-1,) uT^2, the variance of a field's step, and
    `still` (N-1,), the least that can be over it. At nodes: `deviation` (N,) uT^2, the variance m - E counts with;
    `field`, `lever` and `swing` (N, ...) with `samples` (N,), how many fields are in the mean, 0 for none; `force`
    (N, 3) unit vectors in the body, `force_age` (N, 3, 3) s how a bias changes them, and `force_variance` (N,), inf
    where there is none.
    """

    h: Floats
    turn: Floats
    per_bias: Floats
    walk: Floats
    still: Floats
    deviation: Floats
    field: Floats
    lever: Floats
    swing: Floats
    samples: Floats
    force: Floats
    force_age: Floats
    force_variance: Floats


class Beliefs(NamedTuple):
    """Noises in SI units as variances per second; `earth_rate` (3,) rad/s in nav; `bias0` (3,) rad/s, b0."""

    gyr: float
    bias: float
    bias_decay: float
    mag: float
    earth_rate: Floats
    bias0: Floats


class Solved(NamedTuple):
    """Of each node: x (N, 12) and its covariance `P` (N, 12, 12), given all; the same by what came before, `ahead`.

    Expected squares: `step_square` (N-1,) uT^2 of a field's step, `deviation_square` (N,) uT^2 of how far it is from
    the region's, `force_square` (N,) of the level parts of up by the force. `force_nis`, `field_nis` (N,): normalised
    innovations squared, of two and three.
    """

    x: Floats
    P: Floats
    x_ahead: Floats
    P_ahead: Floats
    step_square: Floats
    deviation_square: Floats
    force_square: Floats
    force_nis: Floats
    field_nis: Floats


@njit(cache=True)
def solve(nodes: Nodes, factors: Factors, beliefs: Beliefs, x0: Floats, P0: Floats) -> Solved:
    """Solve the chain about an estimate, given `x0` (12,) and `P0` (12, 12) of the first node."""
    n = len(nodes.b)
    out = Solved(
        np.zeros((n, SIZE)),
        np.zeros((n, SIZE, SIZE)),
        np.zeros((n, SIZE)),
        np.zeros((n, SIZE, SIZE)),
        np.zeros(n - 1),
        np.zeros(n),
        np.zeros(n),
        np.full(n, np.nan),
        np.full(n, np.nan),
    )
    F = np.zeros((n - 1, SIZE, SIZE))
    out.x_ahead[0], out.P_ahead[0] = x0, P0
    for k in range(n):
        out.x[k], out.P[k] = out.x_ahead[k], out.P_ahead[k]
        _take_in(k, nodes, factors, beliefs, out)
        if k < n - 1:
            offset, noise = _between(k, nodes, factors, beliefs, F[k])
            out.x_ahead[k + 1] = F[k] @ out.x[k] + offset
            out.P_ahead[k + 1] = F[k] @ out.P[k] @ F[k].T
            for i in range(SIZE):
                out.P_ahead[k + 1, i, i] += noise[i]
    _back(nodes, beliefs, factors, F, out)
    return out


@njit(cache=True)
def _between(k: int, nodes: Nodes, factors: Factors, beliefs: Beliefs, F: Floats) -> tuple[Floats, Floats]:
    """Write F (12, 12); returns the offset (12,) and the variances (12,) of x_k+1 = F x_k + offset + noise."""
    h = factors.h[k]
    turned = _exp(-beliefs.earth_rate * h) @ nodes.R[k] @ factors.turn[k]
    by_bias = factors.per_bias[k] @ (nodes.b[k] - beliefs.bias0)
    predicted = turned @ _exp(by_bias)
    F[: TURN + 3, : TURN + 3] = np.eye(3) - h * _cross(beliefs.earth_rate)
    F[: TURN + 3, BIAS : BIAS + 3] = predicted @ factors.per_bias[k]
    decay = np.exp(-h * beliefs.bias_decay)
    offset, noise = np.zeros(SIZE), np.zeros(SIZE)
    offset[:3] = -rotation_vector(nodes.R[k + 1] @ predicted.T)
    for i in range(3):
        F[BIAS + i, BIAS + i] = decay
        F[FIELD + i, FIELD + i] = 1.0
        F[REGION + i, REGION + i] = 1.0
        offset[BIAS + i] = decay * nodes.b[k, i] - nodes.b[k + 1, i]
        offset[FIELD + i] = nodes.m[k, i] - nodes.m[k + 1, i]
        offset[REGION + i] = nodes.E[k, i] - nodes.E[k + 1, i]
        noise[TURN + i] = beliefs.gyr * h
        noise[BIAS + i] = beliefs.bias * h
        noise[FIELD + i] = factors.walk[k]
    return offset, noise


@njit(cache=True)
def _take_in(k: int, nodes: Nodes, factors: Factors, beliefs: Beliefs, out: Solved) -> None:
    """Take what there is at a node into x and P."""
    x, P, H = out.x[k], out.P[k], np.zeros((3, SIZE))
    if np.isfinite(factors.force_variance[k]):
        z = gravity_rows(k, nodes, factors, beliefs, H)
        first = correct(P, x, H[0], z[0], factors.force_variance[k])
        out.force_nis[k] = first**2 + correct(P, x, H[1], z[1], factors.force_variance[k]) ** 2
    if factors.samples[k] > 0:
        z = field_rows(k, nodes, factors, beliefs, H)
        nis = 0.0
        variance = beliefs.mag / factors.samples[k] + factors.walk[min(k, len(factors.walk) - 1)] / 3.0
        for row in range(3):
            nis += correct(P, x, H[row], z[row], variance) ** 2
        out.field_nis[k] = nis
        for row in range(3):
            H[row] = 0.0
            H[row, FIELD + row], H[row, REGION + row] = 1.0, -1.0
            correct(P, x, H[row], nodes.E[k, row] - nodes.m[k, row], factors.deviation[k])
        still = factors.still[min(k, len(factors.still) - 1)]
        off = nodes.b[k] - beliefs.bias0
        for row in range(3):
            a = factors.swing[k, row, :3]
            if still > 0.0 and (a**2).sum() > 0.0:
                H[row] = 0.0
                H[row, BIAS : BIAS + 3] = a
                correct(P, x, H[row], factors.swing[k, row, 3] - np.dot(a, off), 1.0 / still)


@njit(cache=True)
def field_rows(k: int, nodes: Nodes, factors: Factors, beliefs: Beliefs, H: Floats) -> Floats:
    """Write the rows (3, 12) of a node's field, in nav; returns (3,) so that H x is it but for noise."""
    R, z = nodes.R[k], factors.field[k]
    per_bias = -_cross(z) @ factors.lever[k]
    seen = R @ (z + per_bias @ (nodes.b[k] - beliefs.bias0))
    H[:] = 0.0
    H[:, TURN : TURN + 3] = _cross(seen)  # seen changes by phi x seen
    H[:, BIAS : BIAS + 3] = -R @ per_bias
    for i in range(3):
        H[i, FIELD + i] = 1.0
    return np.asarray(seen - nodes.m[k])


@njit(cache=True)
def gravity_rows(k: int, nodes: Nodes, factors: Factors, beliefs: Beliefs, H: Floats) -> Floats:
    """Write the two rows (3, 12; the third is not used) of a node's force; returns (3,) so that H x is it."""
    R = nodes.R[k]
    up = R @ (factors.force[k] + factors.force_age[k] @ (nodes.b[k] - beliefs.bias0))
    H[:] = 0.0
    H[:, TURN : TURN + 3] = -_cross(up)
    H[:, BIAS : BIAS + 3] = R @ factors.force_age[k]
    return np.asarray(-up)


@njit(cache=True)
def _back(nodes: Nodes, beliefs: Beliefs, factors: Factors, F: Floats, out: Solved) -> None:
    """Substitute back: x and P given all, and the squares of steps and forces."""
    n = len(out.x)
    H = np.zeros((3, SIZE))
    for k in range(n - 1, -1, -1):
        if k < n - 1:
            G = _gain(out.P[k] @ F[k].T, out.P_ahead[k + 1])
            out.x[k] += G @ (out.x[k + 1] - out.x_ahead[k + 1])
            out.P[k] += G @ (out.P[k + 1] - out.P_ahead[k + 1]) @ G.T
            out.P[k] = (out.P[k] + out.P[k].T) / 2
            out.step_square[k] = _step_square(k, nodes, out, G)
        out.deviation_square[k] = _deviation_square(k, nodes, out)
        if np.isfinite(factors.force_variance[k]):
            z = gravity_rows(k, nodes, factors, beliefs, H)
            for row in range(2):
                out.force_square[k] += (z[row] - np.dot(H[row], out.x[k])) ** 2 + np.dot(H[row], out.P[k] @ H[row])


@njit(cache=True)
def _step_square(k: int, nodes: Nodes, out: Solved, G: Floats) -> float:
    """Expected square of the step of the field after node k, uT^2."""
    now, then = out.P[k], out.P[k + 1]
    between = then @ G.T  # covariance of x_k+1 with x_k
    total = 0.0
    for i in range(FIELD, FIELD + 3):
        step = nodes.m[k + 1, i - FIELD] + out.x[k + 1, i] - nodes.m[k, i - FIELD] - out.x[k, i]
        total += step**2 + max(now[i, i] + then[i, i] - 2 * between[i, i], 0.0)
    return total


@njit(cache=True)
def _deviation_square(k: int, nodes: Nodes, out: Solved) -> float:
    """Expected square of how far the local field is from the region's, uT^2."""
    P, total = out.P[k], 0.0
    for i in range(3):
        m, e = FIELD + i, REGION + i
        off = nodes.m[k, i] + out.x[k, m] - nodes.E[k, i] - out.x[k, e]
        total += off**2 + max(P[m, m] + P[e, e] - 2 * P[m, e], 0.0)
    return total


@njit(cache=True)
def _gain(A: Floats, P: Floats) -> Floats:
    """A P^-1, P scaled to a diagonal of ones first: its units differ."""
    scale = 1.0 / np.sqrt(np.diag(P))
    scaled = P * scale.reshape(-1, 1) * scale
    return np.ascontiguousarray(np.linalg.solve(scaled, (A * scale).T).T) * scale


@njit(cache=True)
def _cross(v: Floats) -> Floats:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


@njit(cache=True)
def _exp(v: Floats) -> Floats:
    angle = np.sqrt((v**2).sum())
    K = _cross(v)
    if angle < 1e-6:
        return np.asarray(np.eye(3) + K + K @ K / 2)
    return np.asarray(np.eye(3) + np.sin(angle) / angle * K + (1 - np.cos(angle)) / angle**2 * (K @ K))
