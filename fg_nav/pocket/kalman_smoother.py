"""A Kalman smoother over nodes half a second apart: samples preintegrated to links, filtered forward, smoothed back.

Nodes. Each node k has an attitude R_k and y_k = (b, S, m, E, v, p, u): bias b of the gyroscope, rad/s, and its scale
and misalignment S (9,), row by row, so that it measures w + b + S w; the local field m and that of the region E, both
in nav, uT; and of the level motion the velocity v of the sensor, m/s, its displacement p from its place on the body, m,
and the velocity u of the body that wears it. The correction x = (phi, dy), R <- Exp(phi) R, is truth less estimate.

Links. A link begins at node k, a sample's stamp, and ends at node k + 1. By the gyroscope alone the body at sample t is
rotated against that at the node by dR_t, and with errors c = (b, S), to first order, by

    dR_t Exp(J_t c),     J_t+1 = Exp(-w h) J_t - Jr(w h) h [1, w_x 1, w_y 1, w_z 1].

In the body frame at the node, u its field and t running over the samples of the link,

    rotation   dR, J        over all of it
    field      z_t = dR_t y_t = u + [u]x K_t c + n,    K_t = dR_t J_t:   means z and K, and their number
    force      s = sum dR_t Jl(w h) f_t h, the delta velocity, and r, its sum over the rest of the link, the delta
               position; c adds -sum [s_t]x K_t c
    rest       mean and spread of the rates, and the spread of the force

Strengths |y_t| need no attitude at all: their mean shows where the field changes (`iterated_smoother`).

A sensor at rest shows its bias: rate and force are quiet, and the mean rates of the last links agree but for noise. A
standing thigh is quiet too, but it sways by a few tenths of a degree in a second, and its means disagree.

Between nodes

    R_k+1 = Exp(-W h) R_k dR_k(c_k)       (+ gyroscope)      b_k+1 = e b_k (+ walk),    S_k+1 = S_k
    m_k+1 = m_k (+ a step)                                   E_k+1 = E_k
    v_k+1 = v_k + R_k s_k(c_k) - g h      (+ accelerometer)  u_k+1 = a u_k (+ a step)
    p_k+1 = p_k + (v_k - u_k) h + R_k r_k(c_k) - g h^2 / 2

of v, u and p the two level parts. And at a node, each if there is one,

    field     m_k - R_k (z - [z]x K c_k)          is the noise of a mean of n, the calibration's error, and the mean of
                                                  the field's walk since
    region    m_k - E_k                           is the deviation of a place (`iterated_smoother`)
    swing     p_k                                 is as large as a leg or an arm swings (`iterated_smoother`)
    rest      b_k + R_k^T W - w_k, and v_k        are zero but for noise

A Kalman filter forward and the smoother of Rauch, Tung and Striebel back solve them exactly, with all marginals: the
Gauss-Newton step of the whole factor graph, iterated in `iterated_smoother`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.ekf.update import update_component, update_row
from fg_nav.mechanisation import (
    cross_matrix,
    multiply,
    right_jacobian,
    rotate_in_body,
    rotation_about,
    rotation_vector,
    transpose,
)
from fg_nav.system.compiled import njit

# Where the parts of x begin; y lacks the first.
ATTITUDE, BIAS, SCALE, FIELD, REGION, VELOCITY, SWING, BODY, SIZE = 0, 3, 6, 15, 18, 21, 23, 25, 27
SENSOR = FIELD - BIAS  # Errors of a gyroscope: bias, scale and misalignment.
NODE_S = 0.5  # From node to node, s: a bias of 1 deg/s is off by 0.5 deg then, and a walker goes 0.6 m.
REST_LINKS = 6  # So many links alike, the one to come and those before it, are a rest: 2 s.
REST_RATE_DEG_S = 2.0  # At rest the mean rate is below this about each axis, deg/s, but for a worse sensor ...
REST_SPREAD_DEG_S = 1.0  # ... the spread of the rate is below this, deg/s: ten times the noise of MD Table 2 ...
REST_SPREAD_M_S2 = 0.25  # ... that of the force below this, m/s^2: a MEMS sensor's is 0.02 to 0.1 ...
REST_APART_DEG_S = 0.05  # ... and means of 0.5 s agree to this, deg/s rms an axis: noise leaves 0.014, a thigh 0.2.
REST_SIGMA_DEG_S = 0.03  # Error of such a mean as an observation of the bias, deg/s.


class Links(NamedTuple):
    """K links, one after the other; frames and symbols as above."""

    start_s: Floats  # (K,).
    h: Floats  # (K,) s.
    turn: Floats  # (K, 3, 3) dR.
    per_sensor: Floats  # (K, 3, 12) J.
    delta_v: Floats  # (K, 3) m/s.
    delta_v_per_sensor: Floats  # (K, 3, 12) its derivative by the errors.
    delta_p: Floats  # (K, 3) m.
    delta_p_per_sensor: Floats  # (K, 3, 12) likewise.
    n_fields: Floats  # (K,).
    field: Floats  # (K, 3) uT, the mean z; zero where there is none.
    lever: Floats  # (K, 3, 12) the mean K; zero where there is none.
    strength: Floats  # (K,) uT, mean |y|; NaN where there is none.
    rate: Floats  # (K, 3) rad/s, the mean as measured.
    rate_spread: Floats  # (K,) rad/s, root of the summed variances of three axes.
    force_spread: Floats  # (K,) m/s^2, likewise.

    def slice(self, first: int, last: int | None = None) -> Links:
        """Return those from number `first` to before `last`."""
        return Links(*(column[first:last] for column in self))

    def append(self, later: Links) -> Links:
        """Return these and later ones."""
        return Links(*(np.concatenate(pair) for pair in zip(self, later, strict=True)))


class Rests(NamedTuple):
    """Of N nodes: `rate` (N, 3) rad/s, zero where there is no rest, and `variance` (N,) of it an axis, inf there."""

    rate: Floats
    variance: Floats


def place_nodes(t: Floats, node_s: float = NODE_S) -> Ints:
    """Samples at which nodes are: every `node_s` seconds, and the last; (K + 1,), never fewer than two."""
    every = np.searchsorted(t, np.arange(t[0], t[-1], node_s) - 1e-6)
    return np.unique(np.append(every, len(t) - 1)).astype(np.int64)


def preintegrate_links(node: Ints, t: Floats, acc: Floats, gyr: Floats, mag: Floats | None) -> Links:
    """Preintegrate rate, force and field, each held until the next stamp, between samples `node` (K + 1,) to K links.

    A sample belongs to the link that begins at or before it; `mag` (N, 3) uT is NaN or all zeros where there is none.
    """
    one, three, per_sensor = (), (3,), (3, SENSOR)
    shapes = (
        *((3, 3), per_sensor, three, per_sensor, three, per_sensor),  # rotation and force
        *(one, three, per_sensor, one),  # field
        *(three, one, one),  # rest
    )
    links = Links(t[node[:-1]], np.diff(t[node]), *(np.zeros((len(node) - 1, *shape)) for shape in shapes))
    field = np.zeros((len(t), 3)) if mag is None else mag
    field = np.where((field != 0.0).any(axis=1, keepdims=True), field, np.nan)
    acc, gyr, field = (np.ascontiguousarray(x, dtype=np.float64) for x in (acc, gyr, field))
    _fill_links(node, np.diff(t), acc, gyr, field, links)
    return links


def detect_rests(links: Links) -> Rests:
    """Return rate (K + 1, 3) and variance, infinite without a rest, at each node; causal but for the link after it."""
    slow = np.abs(links.rate).max(axis=1) < np.radians(REST_RATE_DEG_S)
    quiet = slow & (links.rate_spread < np.radians(REST_SPREAD_DEG_S)) & (links.force_spread < REST_SPREAD_M_S2)
    count = len(links.h)
    variance, rate = np.full(count + 1, np.inf), np.zeros((count + 1, 3))
    if count >= REST_LINKS:
        at = np.arange(REST_LINKS - 1, count)
        last = np.stack([links.rate[at - i] for i in range(REST_LINKS)])
        rests = np.all([quiet[at - i] for i in range(REST_LINKS)], axis=0)
        apart = last.var(axis=0, ddof=1).mean(axis=1)
        rests &= apart < np.radians(REST_APART_DEG_S) ** 2
        variance[at] = np.where(rests, np.radians(REST_SIGMA_DEG_S) ** 2, np.inf)
        rate[at] = np.where(rests[:, None], last[0], 0.0)
    return Rests(rate, variance)


@njit(cache=True)
def _fill_links(node: Ints, periods: Floats, acc: Floats, gyr: Floats, mag: Floats, links: Links) -> None:
    """Write all but times of K blank links, in place."""
    theta = np.empty(3)
    for k in range(len(node) - 1):
        R, J = np.eye(3), np.zeros((3, SENSOR))
        field, lever = links.field[k], links.lever[k]
        for i in range(node[k], node[k + 1]):
            h = periods[i]
            for axis in range(3):
                theta[axis] = gyr[i, axis] * h
            by_turn = right_jacobian(theta)
            K = multiply(R, J)
            # sums of the field
            if np.isfinite(mag[i, 0]) and np.isfinite(mag[i, 1]) and np.isfinite(mag[i, 2]):
                square = 0.0
                for axis in range(3):
                    square += mag[i, axis] ** 2
                    for column in range(3):
                        field[axis] += R[axis, column] * mag[i, column]
                    for column in range(SENSOR):
                        lever[axis, column] += K[axis, column]
                links.n_fields[k] += 1.0
                links.strength[k] += np.sqrt(square)
            # delta velocity and delta position
            _add_force(R, K, by_turn, acc[i], h, k, links)
            # rotation, and its derivative
            J = multiply(transpose(rotation_about(theta)), J)
            for axis in range(3):
                for row in range(3):
                    J[axis, row] -= by_turn[axis, row] * h
                    for column in range(3):
                        J[axis, 3 + 3 * row + column] -= by_turn[axis, row] * theta[column]
            rotate_in_body(R, theta[0], theta[1], theta[2])
        # means of the link
        links.turn[k], links.per_sensor[k] = R, J
        count = links.n_fields[k]
        for axis in range(3):
            for column in range(SENSOR):
                lever[axis, column] /= max(count, 1.0)
            field[axis] /= max(count, 1.0)
        links.strength[k] = links.strength[k] / count if count > 0 else np.nan
        links.rate_spread[k] = _measure_spread(gyr, node[k], node[k + 1], links.rate[k])
        links.force_spread[k] = _measure_spread(acc, node[k], node[k + 1], theta)


@njit(cache=True)
def _add_force(R: Floats, K: Floats, by_turn: Floats, acc: Floats, h: float, k: int, links: Links) -> None:
    """Add force `acc` (3,) m/s^2 held for `h` s, in place, to deltas and derivatives; `by_turn` (3, 3) is Jr (w h)."""
    gained, delta_v, delta_p = np.zeros(3), links.delta_v[k], links.delta_p[k]
    delta_v_per_sensor, delta_p_per_sensor = links.delta_v_per_sensor[k], links.delta_p_per_sensor[k]
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


# the smoother


class Nodes(NamedTuple):
    """N nodes: `R` (N, 3, 3), and `y` (N, 24)."""

    R: Floats
    y: Floats

    @property
    def b(self) -> Floats:
        """Bias (N, 3) rad/s."""
        return self.y[:, :3]


class RobustVariances(NamedTuple):
    """Variances of the t-distributed terms, over K links and at K + 1 nodes."""

    step: Floats  # (K,) uT^2, of the field.
    deviation: Floats  # (K + 1,) uT^2, of the field from the region's.
    pace: Floats  # (K,) (m/s)^2, of steps of the body's velocity.
    swing: Floats  # (K + 1,) m^2.


class Noise(NamedTuple):
    """Noises in SI units as variances per second, but where a unit is named."""

    gyr: float
    bias: float
    bias_decay: float  # 1/s.
    mag: float  # uT^2 a sample.
    mag_left: float  # uT^2 a node.
    acc: float
    rest_velocity: float  # (m/s)^2.
    pace_decay: float  # 1/s, of u.
    earth_rate: Floats  # (3,) rad/s in nav.


class Smoothed(NamedTuple):
    """Of each node, given all; `ahead` predicted from the nodes before."""

    x: Floats  # (N, 27).
    P: Floats  # (N, 27, 27).
    x_ahead: Floats
    P_ahead: Floats
    square: RobustVariances  # Expected squares of the terms, of all their axes.
    swing_nis: Floats  # (N,) normalized innovations squared, of two each.
    field_nis: Floats  # (N,), of three each.


@njit(cache=True)
def smooth_nodes(
    nodes: Nodes, links: Links, variances: RobustVariances, rests: Rests, noise: Noise, x0: Floats, P0: Floats
) -> Smoothed:
    """Linearize about `nodes`, filter forward and smooth back; `x0` (27,), `P0` (27, 27): prior of first node."""
    n = len(nodes.y)
    x, x_ahead = np.zeros((n, SIZE)), np.zeros((n, SIZE))
    P, P_ahead = np.zeros((n, SIZE, SIZE)), np.zeros((n, SIZE, SIZE))
    square = RobustVariances(np.zeros(n - 1), np.zeros(n), np.zeros(n - 1), np.zeros(n))
    out = Smoothed(x, P, x_ahead, P_ahead, square, np.full(n, np.nan), np.full(n, np.nan))
    F = np.zeros((n - 1, SIZE, SIZE))
    x_ahead[0], P_ahead[0] = x0, P0
    for k in range(n):
        # update by the measurements at the node
        x[k], P[k] = x_ahead[k], P_ahead[k]
        _update_node(k, nodes, links, variances, rests, noise, out)
        # predict the next node
        if k < n - 1:
            offset, variance = linearize_transition(k, nodes, links, variances, noise, F[k])
            P_ahead[k + 1] = multiply(multiply(F[k], P[k]), transpose(F[k]))
            for i in range(SIZE):
                x_ahead[k + 1, i] = offset[i]
                for j in range(SIZE):
                    x_ahead[k + 1, i] += F[k, i, j] * x[k, j]
                P_ahead[k + 1, i, i] += variance[i]
    _smooth_backward(nodes, F, out)
    return out


@njit(cache=True)
def _apply(A: Floats, x: Floats) -> Floats:
    """A x."""
    out = np.zeros(len(A))
    for i in range(len(A)):
        for j in range(len(x)):
            out[i] += A[i, j] * x[j]
    return out


@njit(cache=True)
def linearize_transition(
    k: int, nodes: Nodes, links: Links, variances: RobustVariances, noise: Noise, F: Floats
) -> tuple[Floats, Floats]:
    """Write F (27, 27) of x_k+1 = F x_k + offset + noise; return the offset (27,) and the noise variances (27,)."""
    # attitude by the link, and its misclosure
    h = links.h[k]
    y, then, c = nodes.y[k], nodes.y[k + 1], nodes.y[k, :SENSOR]
    back, earth = np.empty(3), cross_matrix(noise.earth_rate)
    for i in range(3):
        back[i] = -noise.earth_rate[i] * h
    turned = multiply(multiply(rotation_about(back), nodes.R[k]), links.turn[k])
    predicted = multiply(turned, rotation_about(_apply(links.per_sensor[k], c)))
    by_sensor = multiply(predicted, links.per_sensor[k])
    left = rotation_vector(multiply(nodes.R[k + 1], transpose(predicted)))
    offset, variance = np.zeros(SIZE), np.zeros(SIZE)
    for i in range(3):
        offset[i] = -left[i]
        for j in range(3):
            F[i, ATTITUDE + j] = (1.0 if i == j else 0.0) - h * earth[i, j]
        for j in range(SENSOR):
            F[i, BIAS + j] = by_sensor[i, j]
    # bias, scale and fields
    for i in range(3, SIZE):
        F[i, i] = 1.0
    for i in range(BIAS, BIAS + 3):
        F[i, i] = np.exp(-h * noise.bias_decay)
        variance[i - BIAS] = noise.gyr * h
        variance[i] = noise.bias * h
        variance[FIELD + i - BIAS] = variances.step[k]
    # level motion
    gained = _apply_force(nodes.R[k], links.delta_v[k], links.delta_v_per_sensor[k], c, F[VELOCITY:SWING])
    gone = _apply_force(nodes.R[k], links.delta_p[k], links.delta_p_per_sensor[k], c, F[SWING:BODY])
    for i in range(2):
        F[SWING + i, VELOCITY + i], F[SWING + i, BODY + i] = h, -h
        F[BODY + i, BODY + i] = np.exp(-h * noise.pace_decay)
        variance[VELOCITY + i] = noise.acc * h
        variance[SWING + i] = noise.acc * h**3 / 3.0
        variance[BODY + i] = variances.pace[k]
    # offset of the linear parts
    for i in range(3, SIZE):
        offset[i] = -then[i - 3]
        for j in range(3, SIZE):
            offset[i] += F[i, j] * y[j - 3]
    # velocity and swing depend on the attitude: their offset is the predicted value, not the linear part
    for i in range(2):
        offset[VELOCITY + i] = y[VELOCITY - 3 + i] + gained[i] - then[VELOCITY - 3 + i]
        path = h * (y[VELOCITY - 3 + i] - y[BODY - 3 + i]) + gone[i]
        offset[SWING + i] = y[SWING - 3 + i] + path - then[SWING - 3 + i]
    return offset, variance


@njit(cache=True)
def _apply_force(R: Floats, delta: Floats, per_sensor: Floats, c: Floats, F: Floats) -> Floats:
    """Return `delta` (3,) velocity or position in nav, sensor errors `c` corrected; write its two level rows of F."""
    change, by_sensor = _apply(per_sensor, c), multiply(R, per_sensor)
    for i in range(3):
        change[i] += delta[i]
    out = _apply(R, change)
    cross = cross_matrix(out)
    for i in range(2):
        for j in range(3):
            F[i, ATTITUDE + j] = -cross[i, j]
        for j in range(SENSOR):
            F[i, BIAS + j] = by_sensor[i, j]
    return out


@njit(cache=True)
def _update_node(
    k: int, nodes: Nodes, links: Links, variances: RobustVariances, rests: Rests, noise: Noise, out: Smoothed
) -> None:
    """Update x and P of `out`, in place, by swing, rest and field at node k, and store the NIS."""
    x, P, H, y = out.x[k], out.P[k], np.zeros((3, SIZE)), nodes.y[k]
    # the swing
    nis = 0.0
    for i in range(2):
        nis += update_component(P, x, SWING + i, -y[SWING - 3 + i], variances.swing[k]) ** 2
    out.swing_nis[k] = nis
    # at rest the rate is the bias, and the velocity zero
    if np.isfinite(rests.variance[k]):
        earth = _apply(transpose(nodes.R[k]), noise.earth_rate)
        for i in range(3):
            update_component(P, x, BIAS + i, rests.rate[k, i] - earth[i] - y[i], rests.variance[k])
        for i in range(2):
            update_component(P, x, VELOCITY + i, -y[VELOCITY - 3 + i], noise.rest_velocity)
    # the field of the link that begins here, and its deviation from the region's
    if k < len(links.h) and links.n_fields[k] > 0:
        z = linearize_field(k, nodes, links, H)
        nis = 0.0
        variance = noise.mag / links.n_fields[k] + noise.mag_left + variances.step[k] / 3.0
        for row in range(3):
            nis += update_row(P, x, H[row], z[row], variance) ** 2
        out.field_nis[k] = nis
        for row in range(3):
            H[row] = 0.0
            H[row, FIELD + row], H[row, REGION + row] = 1.0, -1.0
            update_row(P, x, H[row], y[REGION - 3 + row] - y[FIELD - 3 + row], variances.deviation[k])


@njit(cache=True)
def linearize_field(k: int, nodes: Nodes, links: Links, H: Floats) -> Floats:
    """Write H (3, 27) of the field at node k, in nav; return the measurement z (3,) uT, z = H x + noise."""
    R, z = nodes.R[k], links.field[k]
    less = multiply(cross_matrix(z), links.lever[k])
    change = _apply(less, nodes.y[k, :SENSOR])
    for i in range(3):
        change[i] = z[i] - change[i]
    observed, by_sensor = _apply(R, change), multiply(R, less)
    cross = cross_matrix(observed)  # it changes by phi x observed
    for i in range(3):
        H[i] = 0.0
        for j in range(3):
            H[i, ATTITUDE + j] = cross[i, j]
        for j in range(SENSOR):
            H[i, BIAS + j] = by_sensor[i, j]
        H[i, FIELD + i] = 1.0
        observed[i] -= nodes.y[k, FIELD - 3 + i]
    return observed


@njit(cache=True)
def _smooth_backward(nodes: Nodes, F: Floats, out: Smoothed) -> None:
    """RTS pass, in place: smoothed x and P, and the expected squares by which Student's t reweights."""
    n, gained = len(out.x), np.empty((SIZE, SIZE))
    for k in range(n - 1, -1, -1):
        x, P = out.x[k], out.P[k]
        if k < n - 1:
            # correct by the next node
            G = _smoother_gain(multiply(P, transpose(F[k])), out.P_ahead[k + 1])
            for i in range(SIZE):
                for j in range(SIZE):
                    x[i] += G[i, j] * (out.x[k + 1, j] - out.x_ahead[k + 1, j])
                    gained[i, j] = out.P[k + 1, i, j] - out.P_ahead[k + 1, i, j]
            change = multiply(multiply(G, gained), transpose(G))
            for i in range(SIZE):
                for j in range(i + 1):
                    P[i, j] = P[j, i] = (P[i, j] + change[i, j] + P[j, i] + change[j, i]) / 2
            # expected squares of the steps of field and body
            for i in range(FIELD, FIELD + 3):
                out.square.step[k] += _expect_step(k, i, nodes, F[k], out, G)
            for i in range(BODY, BODY + 2):
                out.square.pace[k] += _expect_step(k, i, nodes, F[k], out, G)
        # of the local field less the region's, and of the swing
        for i in range(3):
            m, e = FIELD + i, REGION + i
            off = nodes.y[k, m - 3] + x[m] - nodes.y[k, e - 3] - x[e]
            out.square.deviation[k] += off**2 + max(P[m, m] + P[e, e] - 2 * P[m, e], 0.0)
        for i in range(SWING, BODY):
            out.square.swing[k] += (nodes.y[k, i - 3] + x[i]) ** 2 + P[i, i]


@njit(cache=True)
def _expect_step(k: int, i: int, nodes: Nodes, F: Floats, out: Smoothed, G: Floats) -> float:
    """Expected square of a step after node k of part `i` of x, which otherwise only decays."""
    e, then, between = F[i, i], out.P[k + 1], 0.0
    for j in range(SIZE):
        between += then[i, j] * G[i, j]  # covariance of x_k+1 with x_k
    step = nodes.y[k + 1, i - 3] + out.x[k + 1, i] - e * (nodes.y[k, i - 3] + out.x[k, i])
    return float(step**2 + max(e**2 * out.P[k, i, i] + then[i, i] - 2 * e * between, 0.0))


@njit(cache=True)
def _smoother_gain(A: Floats, P: Floats) -> Floats:
    """Gain A P^-1; P is scaled to unit diagonal first, as its mixed units make it ill-conditioned."""
    scale, scaled, right = np.empty(SIZE), np.empty((SIZE, SIZE)), np.empty((SIZE, SIZE))
    for i in range(SIZE):
        scale[i] = 1.0 / np.sqrt(P[i, i])
    for i in range(SIZE):
        for j in range(SIZE):
            scaled[i, j] = P[i, j] * scale[i] * scale[j]
            right[j, i] = A[i, j] * scale[j]
    solved, G = np.linalg.solve(scaled, right), np.empty((SIZE, SIZE))
    for i in range(SIZE):
        for j in range(SIZE):
            G[i, j] = solved[j, i] * scale[j]
    return G
