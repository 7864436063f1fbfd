"""The pocket's graph, linear about an estimate, solved from end to end.

Each node k has an attitude R_k and y_k = (b, S, m, E, v, p, u): bias b of the gyroscope, rad/s, and its scale and
misalignment S (9,); the local field m and that of the region E, both in nav, uT; and of the level motion the velocity
v of the sensor, m/s, how far p it is from its place on the body, m, and the velocity u of the body that wears it. The
change asked for, x = (phi, dy) with R <- Exp(phi) R, is what is true less what is estimated. Between nodes, with
c = (b, S),

    R_k+1 = Exp(-W h) R_k dR_k(c_k)       (+ gyroscope)      b_k+1 = e b_k (+ walk),    S_k+1 = S_k
    m_k+1 = m_k (+ a step, `graph_field`)                    E_k+1 = E_k
    v_k+1 = v_k + R_k s_k(c_k) - g h      (+ accelerometer)  u_k+1 = a u_k (+ a step, `graph_motion`)
    p_k+1 = p_k + (v_k - u_k) h + R_k r_k(c_k) - g h^2 / 2

s and r the velocity gained and the way gone by the force (`graph_links`), of v, u and p the two level parts. And at a
node, each if there is one,

    field     m_k - R_k (z - [z]x K (c_k - c0))           is the noise of a mean of n, what the calibration left, and
                                                          the mean of the field's walk since
    region    m_k - E_k                                   is the deviation of a place (`graph_field`)
    swing     p_k                                         is as far as a leg or an arm swings (`graph_motion`)
    rest      b_k + R_k^T W - w_k, and v_k                are next to nothing (`graph_motion`)

As every factor ties a node to itself or the next one, the graph is a chain: one elimination from the first node to the
last (which is a Kalman filter) and one substitution back (Rauch, Tung, Striebel) solve it exactly, with all marginals,
in a time that goes with the number of nodes. That is Gauss-Newton's step on all of the graph, and about its estimate.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from fg_nav.arrays import Floats
from fg_nav.ekf.update import update_component, update_row
from fg_nav.mechanisation import cross_matrix, rotation_about, rotation_vector

TURN, BIAS, SCALE, FIELD, REGION, VELOCITY, PLACE, BODY, SIZE = 0, 3, 6, 15, 18, 21, 23, 25, 27
"""Where x has its parts; y lacks the first."""

SENSOR = slice(BIAS, FIELD)
"""Errors of the gyroscope in x."""


class Nodes(NamedTuple):
    """N nodes: `R` (N, 3, 3), and `y` (N, 24)."""

    R: Floats
    y: Floats

    @property
    def b(self) -> Floats:
        """Bias (N, 3) rad/s."""
        return self.y[:, :3]

    @property
    def m(self) -> Floats:
        """Local field (N, 3) uT in nav."""
        return self.y[:, FIELD - 3 : REGION - 3]


class Factors(NamedTuple):
    """What there is between N nodes and at them, for the compiled pass; symbols above.

    Of links: `h` (N-1,), `turn` (N-1, 3, 3), `per_sensor` (N-1, 3, 12); `push` and `shift` (N-1, 3), with
    `push_per_sensor` and `shift_per_sensor`; `walk` (N-1,) uT^2 and `pace` (N-1,) (m/s)^2, variances of the steps of
    field and body. At nodes: `deviation` (N,) uT^2, the variance m - E counts with; `field` and `lever` (N, ...) with
    `samples` (N,), how many fields are in the mean, 0 for none; `swing` (N,) m^2, the variance of p; `rate` (N, 3)
    rad/s where it rests, with `rest` (N,) (rad/s)^2, inf where it does not.
    """

    h: Floats
    turn: Floats
    per_sensor: Floats
    push: Floats
    push_per_sensor: Floats
    shift: Floats
    shift_per_sensor: Floats
    walk: Floats
    pace: Floats
    deviation: Floats
    field: Floats
    lever: Floats
    samples: Floats
    swing: Floats
    rate: Floats
    rest: Floats


class Beliefs(NamedTuple):
    """Noises in SI units as variances per second, but `mag` and `mag_left`, uT^2 a sample and a node.

    `earth_rate` (3,) rad/s in nav; `bias0` (3,) rad/s, b0; `rest_velocity` (m/s)^2, and `pace_decay` 1/s of u.
    """

    gyr: float
    bias: float
    bias_decay: float
    mag: float
    mag_left: float
    acc: float
    rest_velocity: float
    pace_decay: float
    earth_rate: Floats
    bias0: Floats


class Solved(NamedTuple):
    """Of each node: x (N, 27) and its covariance `P` (N, 27, 27), given all; the same by what came before, `ahead`.

    Expected squares: `step_square` (N-1,) uT^2 of a field's step, `pace_square` (N-1,) (m/s)^2 of the body's,
    `deviation_square` (N,) uT^2 of how far it is from the region's, `swing_square` (N,) m^2 of p. `swing_nis`,
    `field_nis` (N,): normalised innovations squared, of two and three.
    """

    x: Floats
    P: Floats
    x_ahead: Floats
    P_ahead: Floats
    step_square: Floats
    pace_square: Floats
    deviation_square: Floats
    swing_square: Floats
    swing_nis: Floats
    field_nis: Floats


@njit(cache=True)
def solve(nodes: Nodes, factors: Factors, beliefs: Beliefs, x0: Floats, P0: Floats) -> Solved:
    """Solve the chain about an estimate, given `x0` (27,) and `P0` (27, 27) of the first node."""
    n = len(nodes.y)
    out = Solved(
        np.zeros((n, SIZE)),
        np.zeros((n, SIZE, SIZE)),
        np.zeros((n, SIZE)),
        np.zeros((n, SIZE, SIZE)),
        np.zeros(n - 1),
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
    _back(nodes, F, out)
    return out


@njit(cache=True)
def _errors(y: Floats, beliefs: Beliefs) -> Floats:
    """Errors of the gyroscope (12,) less those that the links were made with."""
    c = y[: FIELD - 3].copy()
    c[:3] -= beliefs.bias0
    return c


@njit(cache=True)
def _between(k: int, nodes: Nodes, factors: Factors, beliefs: Beliefs, F: Floats) -> tuple[Floats, Floats]:
    """Write F (27, 27); returns the offset (27,) and the variances (27,) of x_k+1 = F x_k + offset + noise."""
    h = factors.h[k]
    y, then, c = nodes.y[k], nodes.y[k + 1], _errors(nodes.y[k], beliefs)
    turned = rotation_about(-beliefs.earth_rate * h) @ nodes.R[k] @ factors.turn[k]
    predicted = turned @ rotation_about(factors.per_sensor[k] @ c)
    F[: TURN + 3, : TURN + 3] = np.eye(3) - h * cross_matrix(beliefs.earth_rate)
    F[: TURN + 3, BIAS:FIELD] = predicted @ factors.per_sensor[k]
    offset, noise = np.zeros(SIZE), np.zeros(SIZE)
    offset[:3] = -rotation_vector(nodes.R[k + 1] @ predicted.T)
    for i in range(3, SIZE):
        F[i, i] = 1.0
    for i in range(BIAS, BIAS + 3):
        F[i, i] = np.exp(-h * beliefs.bias_decay)
        noise[i - BIAS] = beliefs.gyr * h
        noise[i] = beliefs.bias * h
        noise[FIELD + i - BIAS] = factors.walk[k]
    gained = _of_force(nodes.R[k], factors.push[k], factors.push_per_sensor[k], c, F[VELOCITY:PLACE])
    gone = _of_force(nodes.R[k], factors.shift[k], factors.shift_per_sensor[k], c, F[PLACE:BODY])
    for i in range(2):
        F[PLACE + i, VELOCITY + i], F[PLACE + i, BODY + i] = h, -h
        F[BODY + i, BODY + i] = np.exp(-h * beliefs.pace_decay)
        noise[VELOCITY + i] = beliefs.acc * h
        noise[PLACE + i] = beliefs.acc * h**3 / 3.0
        noise[BODY + i] = factors.pace[k]
    offset[3:] = np.ascontiguousarray(F[3:, 3:]) @ y - then
    # of what is not linear the value is wanted, not its part that the derivatives make
    for i in range(2):
        offset[VELOCITY + i] = y[VELOCITY - 3 + i] + gained[i] - then[VELOCITY - 3 + i]
        way = h * (y[VELOCITY - 3 + i] - y[BODY - 3 + i]) + gone[i]
        offset[PLACE + i] = y[PLACE - 3 + i] + way - then[PLACE - 3 + i]
    return offset, noise


@njit(cache=True)
def _of_force(R: Floats, push: Floats, per_sensor: Floats, c: Floats, F: Floats) -> Floats:
    """What a force does to velocity or place, (3,) in nav; writes the derivatives of its two level parts."""
    out = R @ (push + per_sensor @ c)
    F[:, : TURN + 3] = -cross_matrix(out)[:2]
    F[:, BIAS:FIELD] = (R @ per_sensor)[:2]
    return out


@njit(cache=True)
def _take_in(k: int, nodes: Nodes, factors: Factors, beliefs: Beliefs, out: Solved) -> None:
    """Take what there is at a node into x and P."""
    x, P, H, y = out.x[k], out.P[k], np.zeros((3, SIZE)), nodes.y[k]
    nis = 0.0
    for i in range(2):
        nis += update_component(P, x, PLACE + i, -y[PLACE - 3 + i], factors.swing[k]) ** 2
    out.swing_nis[k] = nis
    if np.isfinite(factors.rest[k]):
        _take_in_rest(k, nodes, factors, beliefs, out)
    if factors.samples[k] > 0:
        z = field_rows(k, nodes, factors, beliefs, H)
        nis = 0.0
        walked = factors.walk[min(k, len(factors.walk) - 1)] / 3.0
        variance = beliefs.mag / factors.samples[k] + beliefs.mag_left + walked
        for row in range(3):
            nis += update_row(P, x, H[row], z[row], variance) ** 2
        out.field_nis[k] = nis
        for row in range(3):
            H[row] = 0.0
            H[row, FIELD + row], H[row, REGION + row] = 1.0, -1.0
            update_row(P, x, H[row], y[REGION - 3 + row] - y[FIELD - 3 + row], factors.deviation[k])


@njit(cache=True)
def _take_in_rest(k: int, nodes: Nodes, factors: Factors, beliefs: Beliefs, out: Solved) -> None:
    """Take in that the sensor rests, which shows its bias and has no velocity."""
    seen = factors.rate[k] - nodes.R[k].T @ beliefs.earth_rate
    for i in range(3):
        update_component(out.P[k], out.x[k], BIAS + i, seen[i] - nodes.y[k, i], factors.rest[k])
    for i in range(2):
        v = nodes.y[k, VELOCITY - 3 + i]
        update_component(out.P[k], out.x[k], VELOCITY + i, -v, beliefs.rest_velocity)


@njit(cache=True)
def field_rows(k: int, nodes: Nodes, factors: Factors, beliefs: Beliefs, H: Floats) -> Floats:
    """Write the rows (3, 27) of a node's field, in nav; returns (3,) so that H x is it but for noise."""
    R, z = nodes.R[k], factors.field[k]
    per_sensor = -cross_matrix(z) @ factors.lever[k]
    seen = R @ (z + per_sensor @ _errors(nodes.y[k], beliefs))
    H[:] = 0.0
    H[:, TURN : TURN + 3] = cross_matrix(seen)  # seen changes by phi x seen
    H[:, BIAS:FIELD] = -R @ per_sensor
    for i in range(3):
        H[i, FIELD + i] = 1.0
    return np.asarray(seen - nodes.y[k, FIELD - 3 : REGION - 3])


@njit(cache=True)
def _back(nodes: Nodes, F: Floats, out: Solved) -> None:
    """Substitute back: x and P given all, and the squares of steps, deviations and swings."""
    n = len(out.x)
    for k in range(n - 1, -1, -1):
        if k < n - 1:
            G = _gain(out.P[k] @ F[k].T, out.P_ahead[k + 1])
            out.x[k] += G @ (out.x[k + 1] - out.x_ahead[k + 1])
            out.P[k] += G @ (out.P[k + 1] - out.P_ahead[k + 1]) @ G.T
            out.P[k] = (out.P[k] + out.P[k].T) / 2
            out.step_square[k] = _step_square(k, FIELD, FIELD + 3, nodes, F[k], out, G)
            out.pace_square[k] = _step_square(k, BODY, BODY + 2, nodes, F[k], out, G)
        out.deviation_square[k] = _deviation_square(k, nodes, out)
        for i in range(PLACE, BODY):
            out.swing_square[k] += (nodes.y[k, i - 3] + out.x[k, i]) ** 2 + out.P[k, i, i]


@njit(cache=True)
def _step_square(k: int, first: int, stop: int, nodes: Nodes, F: Floats, out: Solved, G: Floats) -> float:
    """Expected square of a step after node k, of those parts of x that only decay but for it."""
    now, then = out.P[k], out.P[k + 1]
    between = then @ G.T  # covariance of x_k+1 with x_k
    total = 0.0
    for i in range(first, stop):
        e = F[i, i]
        step = nodes.y[k + 1, i - 3] + out.x[k + 1, i] - e * (nodes.y[k, i - 3] + out.x[k, i])
        total += step**2 + max(e**2 * now[i, i] + then[i, i] - 2 * e * between[i, i], 0.0)
    return total


@njit(cache=True)
def _deviation_square(k: int, nodes: Nodes, out: Solved) -> float:
    """Expected square of how far the local field is from the region's, uT^2."""
    P, total = out.P[k], 0.0
    for i in range(3):
        m, e = FIELD + i, REGION + i
        off = nodes.y[k, m - 3] + out.x[k, m] - nodes.y[k, e - 3] - out.x[k, e]
        total += off**2 + max(P[m, m] + P[e, e] - 2 * P[m, e], 0.0)
    return total


@njit(cache=True)
def _gain(A: Floats, P: Floats) -> Floats:
    """A P^-1, P scaled to a diagonal of ones first: its units differ."""
    scale = 1.0 / np.sqrt(np.diag(P))
    scaled = P * scale.reshape(-1, 1) * scale
    return np.ascontiguousarray(np.linalg.solve(scaled, (A * scale).T).T) * scale
