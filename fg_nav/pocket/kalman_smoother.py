"""A Kalman smoother over the nodes: linearized about an estimate, forward and back.

Each node k has an attitude R_k and y_k = (b, S, m, E, v, p, u): bias b of the gyroscope, rad/s, and its scale and
misalignment S (9,); the local field m and that of the region E, both in nav, uT; and of the level motion the velocity
v of the sensor, m/s, its displacement p from its place on the body, m, and the velocity u of the body that wears it.
The correction x = (phi, dy), with R <- Exp(phi) R, is truth less estimate. Between nodes, with c = (b, S),

    R_k+1 = Exp(-W h) R_k dR_k(c_k)       (+ gyroscope)      b_k+1 = e b_k (+ walk),    S_k+1 = S_k
    m_k+1 = m_k (+ a step)                                   E_k+1 = E_k
    v_k+1 = v_k + R_k s_k(c_k) - g h      (+ accelerometer)  u_k+1 = a u_k (+ a step)
    p_k+1 = p_k + (v_k - u_k) h + R_k r_k(c_k) - g h^2 / 2

s and r the delta velocity and delta position of the force (`links`), of v, u and p the two level parts. And at a node,
each if there is one,

    field     m_k - R_k (z - [z]x K (c_k - c0))   is the noise of a mean of n, the calibration's error, and the mean of
                                                  the field's walk since
    region    m_k - E_k                           is the deviation of a place (`iterated_smoother`)
    swing     p_k                                 is as large as a leg or an arm swings (`iterated_smoother`)
    rest      b_k + R_k^T W - w_k, and v_k        are zero but for noise (`links`)

A Kalman filter forward and the smoother of Rauch, Tung and Striebel back solve them exactly, with all marginals: the
Gauss-Newton step of the whole factor graph, iterated in `iterated_smoother`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.ekf.update import update_component, update_row
from fg_nav.mechanisation import cross_matrix, multiply, rotation_about, rotation_vector, transpose
from fg_nav.system.compiled import njit

# Where the parts of x begin; y lacks the first.
ATTITUDE, BIAS, SCALE, FIELD, REGION, VELOCITY, SWING, BODY, SIZE = 0, 3, 6, 15, 18, 21, 23, 25, 27
SENSOR = slice(BIAS, FIELD)  # Errors of the gyroscope in x.


class Nodes(NamedTuple):
    """N nodes: `R` (N, 3, 3), and `y` (N, 24)."""

    R: Floats
    y: Floats

    @property
    def b(self) -> Floats:
        """Bias (N, 3) rad/s."""
        return self.y[:, :3]


class NodeInputs(NamedTuple):
    """Transitions between N nodes and measurements at them, for the compiled pass; symbols above.

    Of links: `h` (N-1,), `turn` (N-1, 3, 3), `per_sensor` (N-1, 3, 12); `delta_v` and `delta_p` (N-1, 3), with
    `delta_v_per_sensor` and `delta_p_per_sensor`; `walk` (N-1,) uT^2 and `pace` (N-1,) (m/s)^2, variances of the steps
    of field and body. At nodes: `deviation` (N,) uT^2, the variance of m - E; `field` and `lever` (N, ...) with
    `samples` (N,), the number of fields in the mean, 0 for none; `swing` (N,) m^2, the variance of p; `rate` (N, 3)
    rad/s where it rests, with `rest` (N,) (rad/s)^2, inf where it does not.
    """

    h: Floats
    turn: Floats
    per_sensor: Floats
    delta_v: Floats
    delta_v_per_sensor: Floats
    delta_p: Floats
    delta_p_per_sensor: Floats
    walk: Floats
    pace: Floats
    deviation: Floats
    field: Floats
    lever: Floats
    samples: Floats
    swing: Floats
    rate: Floats
    rest: Floats


class Noise(NamedTuple):
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


class Smoothed(NamedTuple):
    """Of each node: x (N, 27) and its covariance `P` (N, 27, 27), given all; predicted from the nodes before, `ahead`.

    Expected squares: `step_square` (N-1,) uT^2 of a field's step, `pace_square` (N-1,) (m/s)^2 of the body's,
    `deviation_square` (N,) uT^2 of it less the region's, `swing_square` (N,) m^2 of p. `swing_nis`,
    `field_nis` (N,): normalized innovations squared, of two and three.
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
def smooth_nodes(nodes: Nodes, inputs: NodeInputs, noise: Noise, x0: Floats, P0: Floats) -> Smoothed:
    """Linearize about `nodes`, filter forward and smooth back; `x0` (27,), `P0` (27, 27): prior of first node."""
    n = len(nodes.y)
    x, x_ahead = np.zeros((n, SIZE)), np.zeros((n, SIZE))
    P, P_ahead = np.zeros((n, SIZE, SIZE)), np.zeros((n, SIZE, SIZE))
    step, pace, deviation, swing = np.zeros(n - 1), np.zeros(n - 1), np.zeros(n), np.zeros(n)
    swing_nis, field_nis = np.full(n, np.nan), np.full(n, np.nan)
    out = Smoothed(x, P, x_ahead, P_ahead, step, pace, deviation, swing, swing_nis, field_nis)
    F = np.zeros((n - 1, SIZE, SIZE))
    for i in range(SIZE):
        out.x_ahead[0, i] = x0[i]
        for j in range(SIZE):
            out.P_ahead[0, i, j] = P0[i, j]
    for k in range(n):
        # update by the measurements at the node
        for i in range(SIZE):
            out.x[k, i] = out.x_ahead[k, i]
            for j in range(SIZE):
                out.P[k, i, j] = out.P_ahead[k, i, j]
        _update_node(k, nodes, inputs, noise, out)
        # predict the next node
        if k < n - 1:
            offset, variance = linearize_transition(k, nodes, inputs, noise, F[k])
            moved = multiply(multiply(F[k], out.P[k]), transpose(F[k]))
            for i in range(SIZE):
                out.x_ahead[k + 1, i] = offset[i]
                for j in range(SIZE):
                    out.x_ahead[k + 1, i] += F[k, i, j] * out.x[k, j]
                    out.P_ahead[k + 1, i, j] = moved[i, j]
                out.P_ahead[k + 1, i, i] += variance[i]
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
def _error_change(y: Floats, noise: Noise) -> Floats:
    """Errors of the gyroscope (12,) less those that the links were made with."""
    c = np.empty(FIELD - 3)
    for i in range(FIELD - 3):
        c[i] = y[i] - noise.bias0[i] if i < 3 else y[i]
    return c


@njit(cache=True)
def linearize_transition(k: int, nodes: Nodes, inputs: NodeInputs, noise: Noise, F: Floats) -> tuple[Floats, Floats]:
    """Write F (27, 27) of x_k+1 = F x_k + offset + noise; return the offset (27,) and the noise variances (27,)."""
    # attitude by the link, and its misclosure
    h = inputs.h[k]
    y, then, c = nodes.y[k], nodes.y[k + 1], _error_change(nodes.y[k], noise)
    back, earth = np.empty(3), cross_matrix(noise.earth_rate)
    for i in range(3):
        back[i] = -noise.earth_rate[i] * h
    turned = multiply(multiply(rotation_about(back), nodes.R[k]), inputs.turn[k])
    predicted = multiply(turned, rotation_about(_apply(inputs.per_sensor[k], c)))
    by_sensor = multiply(predicted, inputs.per_sensor[k])
    left = rotation_vector(multiply(nodes.R[k + 1], transpose(predicted)))
    offset, variance = np.zeros(SIZE), np.zeros(SIZE)
    for i in range(3):
        offset[i] = -left[i]
        for j in range(3):
            F[i, ATTITUDE + j] = (1.0 if i == j else 0.0) - h * earth[i, j]
        for j in range(FIELD - BIAS):
            F[i, BIAS + j] = by_sensor[i, j]
    # bias, scale and fields
    for i in range(3, SIZE):
        F[i, i] = 1.0
    for i in range(BIAS, BIAS + 3):
        F[i, i] = np.exp(-h * noise.bias_decay)
        variance[i - BIAS] = noise.gyr * h
        variance[i] = noise.bias * h
        variance[FIELD + i - BIAS] = inputs.walk[k]
    # level motion
    gained = _apply_force(nodes.R[k], inputs.delta_v[k], inputs.delta_v_per_sensor[k], c, F[VELOCITY:SWING])
    gone = _apply_force(nodes.R[k], inputs.delta_p[k], inputs.delta_p_per_sensor[k], c, F[SWING:BODY])
    for i in range(2):
        F[SWING + i, VELOCITY + i], F[SWING + i, BODY + i] = h, -h
        F[BODY + i, BODY + i] = np.exp(-h * noise.pace_decay)
        variance[VELOCITY + i] = noise.acc * h
        variance[SWING + i] = noise.acc * h**3 / 3.0
        variance[BODY + i] = inputs.pace[k]
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
        for j in range(FIELD - BIAS):
            F[i, BIAS + j] = by_sensor[i, j]
    return out


@njit(cache=True)
def _update_node(k: int, nodes: Nodes, inputs: NodeInputs, noise: Noise, out: Smoothed) -> None:
    """Update x and P of `out`, in place, by swing, rest and field at node k, and store the NIS."""
    x, P, H, y = out.x[k], out.P[k], np.zeros((3, SIZE)), nodes.y[k]
    # the swing
    nis = 0.0
    for i in range(2):
        nis += update_component(P, x, SWING + i, -y[SWING - 3 + i], inputs.swing[k]) ** 2
    out.swing_nis[k] = nis
    # at rest the rate is the bias, and the velocity zero
    if np.isfinite(inputs.rest[k]):
        earth = _apply(transpose(nodes.R[k]), noise.earth_rate)
        for i in range(3):
            update_component(P, x, BIAS + i, inputs.rate[k, i] - earth[i] - y[i], inputs.rest[k])
        for i in range(2):
            update_component(P, x, VELOCITY + i, -y[VELOCITY - 3 + i], noise.rest_velocity)
    # the field, and its deviation from the region's
    if inputs.samples[k] > 0:
        z = linearize_field(k, nodes, inputs, noise, H)
        nis = 0.0
        walked = inputs.walk[min(k, len(inputs.walk) - 1)] / 3.0
        variance = noise.mag / inputs.samples[k] + noise.mag_left + walked
        for row in range(3):
            nis += update_row(P, x, H[row], z[row], variance) ** 2
        out.field_nis[k] = nis
        for row in range(3):
            for i in range(SIZE):
                H[row, i] = 0.0
            H[row, FIELD + row], H[row, REGION + row] = 1.0, -1.0
            update_row(P, x, H[row], y[REGION - 3 + row] - y[FIELD - 3 + row], inputs.deviation[k])


@njit(cache=True)
def linearize_field(k: int, nodes: Nodes, inputs: NodeInputs, noise: Noise, H: Floats) -> Floats:
    """Write H (3, 27) of the field at node k, in nav; return the measurement z (3,) uT, z = H x + noise."""
    R, z = nodes.R[k], inputs.field[k]
    less = multiply(cross_matrix(z), inputs.lever[k])
    change = _apply(less, _error_change(nodes.y[k], noise))
    for i in range(3):
        change[i] = z[i] - change[i]
    observed, by_sensor = _apply(R, change), multiply(R, less)
    cross = cross_matrix(observed)  # it changes by phi x observed
    for i in range(3):
        for j in range(SIZE):
            H[i, j] = 0.0
        for j in range(3):
            H[i, ATTITUDE + j] = cross[i, j]
        for j in range(FIELD - BIAS):
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
                out.step_square[k] += _expect_step(k, i, nodes, F[k], out, G)
            for i in range(BODY, BODY + 2):
                out.pace_square[k] += _expect_step(k, i, nodes, F[k], out, G)
        # of the local field less the region's, and of the swing
        for i in range(3):
            m, e = FIELD + i, REGION + i
            off = nodes.y[k, m - 3] + x[m] - nodes.y[k, e - 3] - x[e]
            out.deviation_square[k] += off**2 + max(P[m, m] + P[e, e] - 2 * P[m, e], 0.0)
        for i in range(SWING, BODY):
            out.swing_square[k] += (nodes.y[k, i - 3] + x[i]) ** 2 + P[i, i]


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
