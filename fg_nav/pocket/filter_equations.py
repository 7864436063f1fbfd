"""The equations of Munoz Diaz et al. (2017): state, prediction, and the two updates, compiled.

State, MD (1): R = nav_R_body and the gyro bias b. The error is estimate minus truth, in this order:

======= ========== ==================================================================================
0       attitude   a small rotation in nav, R_estimate = Exp(dphi) R_true; or of the Euler angles, rad
3       bias       gyro bias, rad/s, body
======= ========== ==================================================================================

Prediction over a sample: a rate w held for h seconds, the Earth's rate W in nav, Jr the right Jacobian of SO(3),

    theta = (w - b - R^T W) h,    A = Exp(theta)                                     MD (2), (3), (5), (6), (26)
    R' = R A                                                                         MD (4)
    b' = c b,    c = exp(-h / t_B), or 1                                             MD (10)

A bias too high by db turns A by -Jr h db in the body at the end, so that errors propagate as

    dphi' = (I - h [W]) dphi - R' Jr h db,    db' = c db                             MD (7)-(9), (11)

and, in Euler angles with dphi = E e, by E'^-1 (I - h [W]) E and E'^-1 R' Jr h. Noise enters at the end of the step: the
gyroscope's rotates the attitude by the same about all axes, and the bias walks by sigma_n of MD (24) a sample.

Reference of the field: while the body rotates by A = A_1 A_2 ... since the last field mu that was measured, a field
that does not change in nav becomes, in the body,

    A^T mu                                                                           MD (15), read with MD (4)

A depends on the gyro bias: each A_i is rotated by -Jr h db at its end, and so with S as A is A Exp(S db),

    A <- A A_i,    S <- A_i^T S - Jr h.

With a magnetometer slower than the gyroscope A spans several samples; in MD it spans one. When an update in between
changes the bias, A is rotated along.

Absolute gravity update, of a specific force a that is gravity alone
    in nav       u = R a / |a| is up but for the tilt: (u_x, u_y) = (dphi_y, -dphi_x), each with variance s^2 / |a|^2.
                 A mean over T is T / 2 old: with a + (T / 2) b x a for a, u gains (T / 2) R (db x a) / |a|
    in angles    roll and pitch of MD (12), (13), innovations MD (14); the accelerometer's noise through them has the
                 variances s^2 / (a_y^2 + a_z^2) and s^2 / |a|^2, and no covariance. The same to first order.

Differential magnetic field update, of the field m measured now, against m' = A^T mu predicted
    z = m' - m,    H = [0, [m'] S]                                                   MD (15), (16)
    N = 2 s_m^2 I + q [m'] [m']^T,    q = variance of the gyroscope's angle since then
Along m' H is zero, for no rotation changes a strength; and N is 2 s_m^2 + q |m'|^2 across it. So it is two rows: with
u, v and m' / |m'| a right-handed set, |m'| v^T S and -|m'| u^T S about u and v. The noise of each field enters two
differences, once with either sign; the filter takes them as independent, as MD does.

What MD prints that does not work, and what must stand there
========= ============================================ ============================================================
MD        printed                                      read
========= ============================================ ============================================================
(10) (11) b = c b + n, about zero                      right for the part that wanders, but a turn-on bias of 0.1
                                                       deg/s is no draw from it (B / sqrt(2) = 0.002) and fades with
                                                       t_B: c = 1 (`bias_returns_to_zero`)
(12)      roll = arctan(a_y / a_z)                     both signs: atan2, or a sensor upside down is turned by pi
                                                       (`arctangent_as_printed`)
(14)      innovations of angles                        wrapped to +-pi; not said, done in both
(15)      mu = A mu, and so -A S for S                 A^T mu: by MD (4), A rotates from the body now to the body before
                                                       (`difference_as_printed`)
(16)      "the covariance of mu-bar"                   that of the difference: the new sample has noise too
(1) (7)   Euler angles                                 fine until the pitch is +-90 deg, a thigh lying level when
(14)                                                   its wearer sits (`euler_state`)
========= ============================================ ============================================================

MD (21)'s (r_c / r) in place of its square concerns the field (`fg_nav.lab.simulation`).

MD's Euler angles: roll, pitch and yaw, rad, and their small errors as a rotation.

    nav_R_body = Rz(yaw) Ry(pitch) Rx(roll)         nav East-North-Up, so yaw is that of the x axis, counter-clockwise
                                                    from east: pi / 2 - heading
    gravity at rest = g (-sin pitch, sin roll cos pitch, cos roll cos pitch)                          MD (12), (13)

Errors e of the angles, estimate minus truth, turn about the axes of the three rotations,

    dphi = E e,    E = [nav_R_body e_x,  Rz(yaw) e_y,  e_z],    det E = cos pitch,

with R_estimate = Exp(dphi) R_true. At a pitch of +-90 deg roll and yaw turn about the same axis: E has no inverse.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.ekf.measurements import wrap_angle
from fg_nav.ekf.update import rotate_in_nav, update_component, update_row
from fg_nav.mechanisation import cross_matrix, multiply, right_jacobian, rotate_in_body, transpose
from fg_nav.pocket.parameters import (
    GYR_DENSITY_DEG,
    PocketParameters,
    compute_bias_decay,
    compute_bias_walk,
    compute_earth_rate,
)
from fg_nav.system.compiled import njit

ATTITUDE, GYRO_BIAS, SIZE = 0, 3, 6
MAX_DIFFERENCE_S = 0.25  # Fields farther apart than the shortest difference and this, s, are not compared: a gap.
MIN_COSINE = float(np.sin(np.radians(1.0)))  # Within a degree of a pitch of +-90 deg roll and yaw are not usable.


class PocketState(NamedTuple):
    """State of the filter: `nav_R_body` (3, 3), `gyro_bias` (3,) rad/s and `P` (6, 6), changed in place."""

    nav_R_body: Floats
    gyro_bias: Floats
    P: Floats


class FieldReference(NamedTuple):
    """The last field that was measured, propagated to now, changed in place.

    `field` (3,) uT; `turn` (3, 3), A, from the body now to the body then; `per_bias` (3, 3) s, S: with a bias higher by
    db, A is A Exp(S db); `age` (1,) s, NaN where no field was measured yet.
    """

    field: Floats
    turn: Floats
    per_bias: Floats
    age: Floats


class FilterModel(NamedTuple):
    """The parameters in SI units, variances in place of sigmas; `earth_rate` (3,) rad/s in nav.

    `gravity_age_s` is half the window over which the specific force is averaged.
    """

    gyr_density: float
    bias_density: float
    bias_decay_per_s: float
    earth_rate: Floats
    acc_variance: float
    gravity_age_s: float
    mag_variance: float
    shortest_s: float
    longest_s: float
    euler: bool
    printed_difference: bool
    printed_arctangent: bool


def build_model(p: PocketParameters) -> FilterModel:
    """Return noise densities, gates and switches of the compiled filter, in rad, m/s^2 and uT."""
    return FilterModel(
        gyr_density=float(np.radians(GYR_DENSITY_DEG)) ** 2,
        bias_density=compute_bias_walk() ** 2,
        bias_decay_per_s=compute_bias_decay(p.bias_returns_to_zero),
        earth_rate=compute_earth_rate(p.latitude_deg),
        acc_variance=p.acc_sigma_m_s2**2,
        gravity_age_s=p.gravity_window_s / 2.0,
        mag_variance=p.mag_sigma_uT**2,
        shortest_s=p.shortest_difference_s,
        longest_s=p.shortest_difference_s + MAX_DIFFERENCE_S,
        euler=p.euler_state,
        printed_difference=p.difference_as_printed,
        printed_arctangent=p.arctangent_as_printed,
    )


# Euler angles: MD (12), (13)


@njit(cache=True)
def angles_of_rotation(nav_R_body: Floats) -> Floats:
    """Roll, pitch, yaw (3,) rad."""
    R = nav_R_body
    pitch = np.arctan2(-R[2, 0], np.hypot(R[2, 1], R[2, 2]))
    return np.array([np.arctan2(R[2, 1], R[2, 2]), pitch, np.arctan2(R[1, 0], R[0, 0])])


@njit(cache=True)
def rotation_of_angles(angles: Floats) -> Floats:
    """Return nav_R_body (3, 3) from Euler angles roll, pitch, yaw (3,) rad."""
    cr, sr = np.cos(angles[0]), np.sin(angles[0])
    cp, sp = np.cos(angles[1]), np.sin(angles[1])
    cy, sy = np.cos(angles[2]), np.sin(angles[2])
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


@njit(cache=True)
def error_axes(nav_R_body: Floats) -> Floats:
    """E (3, 3): from errors of the angles to the rotation in nav."""
    x, y = nav_R_body[0, 0], nav_R_body[1, 0]
    cosine = np.hypot(x, y)
    return np.array([[x, -y / cosine, 0.0], [y, x / cosine, 0.0], [nav_R_body[2, 0], 0.0, 1.0]])


@njit(cache=True)
def inverse_error_axes(nav_R_body: Floats) -> Floats:
    """E^-1 (3, 3): from a small rotation in nav to errors of the angles."""
    x, y, sine = nav_R_body[0, 0], nav_R_body[1, 0], -nav_R_body[2, 0]
    square = x * x + y * y
    cosine = np.sqrt(square)
    return np.array(
        [[x / square, y / square, 0.0], [-y / cosine, x / cosine, 0.0], [sine * x / square, sine * y / square, 1.0]]
    )


@njit(cache=True)
def is_degenerate(nav_R_body: Floats) -> bool:
    """Whether the x axis is within a degree of vertical, where Euler angles end."""
    return bool(nav_R_body[0, 0] ** 2 + nav_R_body[1, 0] ** 2 < MIN_COSINE**2)


@njit(cache=True)
def angles_of_up(force: Floats) -> tuple[float, float]:
    """Roll and pitch, rad, of a specific force (3,) of gravity alone, MD (12), (13), in all quadrants."""
    roll = np.arctan2(force[1], force[2])
    return roll, np.arctan2(-force[0], np.hypot(force[1], force[2]))


@njit(cache=True)
def roll_as_printed(force: Floats) -> float:
    """Roll, rad within +-pi/2, of a specific force (3,) by MD (12) as printed."""
    return float(np.arctan(force[1] / force[2])) if force[2] != 0.0 else float(np.sign(force[1]) * np.pi / 2)


# prediction: MD (3)-(11), (26)


@njit(cache=True)
def predict_state(state: PocketState, reference: FieldReference, rate: Floats, h: float, model: FilterModel) -> None:
    """Propagate state, covariance and field reference, in place, over angular `rate` (3,) rad/s held for `h` s."""
    R, bias, P = state
    before = error_axes(R) if model.euler else np.eye(3)
    # attitude, bias and reference
    theta, earth, decay = np.empty(3), model.earth_rate, np.exp(-h * model.bias_decay_per_s)
    for i in range(3):
        turned = R[0, i] * earth[0] + R[1, i] * earth[1] + R[2, i] * earth[2]
        theta[i] = (rate[i] - bias[i] - turned) * h
    rotate_in_body(R, theta[0], theta[1], theta[2])
    per_bias, level = right_jacobian(theta), cross_matrix(earth)
    for i in range(3):
        bias[i] *= decay
        for j in range(3):
            per_bias[i, j] *= -h
            level[i, j] = (1.0 if i == j else 0.0) - h * level[i, j]
    propagate_reference(reference, theta, per_bias, h)
    # transition of the errors
    after = inverse_error_axes(R) if model.euler else np.eye(3)
    by_attitude = multiply(multiply(after, level), before)
    by_bias, noise = multiply(after, multiply(R, per_bias)), multiply(after, transpose(after))
    F = np.zeros((SIZE, SIZE))
    for i in range(3):
        F[GYRO_BIAS + i, GYRO_BIAS + i] = decay
        for j in range(3):
            F[i, j], F[i, GYRO_BIAS + j] = by_attitude[i, j], by_bias[i, j]
    # covariance
    moved = multiply(multiply(F, P), transpose(F))
    for i in range(SIZE):
        for j in range(SIZE):
            P[i, j] = moved[i, j]
    for i in range(3):
        P[GYRO_BIAS + i, GYRO_BIAS + i] += model.bias_density * h
        for j in range(3):
            P[i, j] += model.gyr_density * h * noise[i, j]


# reference of the field: MD (15)


def create_reference() -> FieldReference:
    """Return the reference before the first field."""
    return FieldReference(np.zeros(3), np.eye(3), np.zeros((3, 3)), np.full(1, np.nan))


@njit(cache=True)
def set_reference(reference: FieldReference, field: Floats) -> None:
    """Start again from a field (3,) uT just measured."""
    for i in range(3):
        reference.field[i] = field[i]
        for j in range(3):
            reference.turn[i, j] = 1.0 if i == j else 0.0
            reference.per_bias[i, j] = 0.0
    reference.age[0] = 0.0


@njit(cache=True)
def propagate_reference(reference: FieldReference, theta: Floats, per_bias: Floats, h: float) -> None:
    """Propagate the field reference, in place, by `theta` (3,) rad in `h` s; `per_bias` (3, 3) s: d theta / d bias."""
    S = transpose(reference.per_bias)
    rotate_in_body(S, theta[0], theta[1], theta[2])  # S^T A_i is (A_i^T S)^T
    for i in range(3):
        for j in range(3):
            reference.per_bias[i, j] = S[j, i] + per_bias[i, j]
    rotate_in_body(reference.turn, theta[0], theta[1], theta[2])
    reference.age[0] += h


@njit(cache=True)
def predict_field(reference: FieldReference, printed: bool) -> tuple[Floats, Floats]:
    """Predicted body field m' (3,) uT, and G (3, 3) s: a bias higher by db moves the prediction by m' x (G db)."""
    A, S, field, per_bias = reference.turn, reference.per_bias, np.zeros(3), np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            if printed:
                field[i] += A[i, j] * reference.field[j]
                for k in range(3):
                    per_bias[i, j] -= A[i, k] * S[k, j]
            else:
                field[i] += A[j, i] * reference.field[j]
                per_bias[i, j] = S[i, j]
    return field, per_bias


@njit(cache=True)
def shift_reference_bias(reference: FieldReference, change: Floats) -> None:
    """Rotate A along with a change (3,) rad/s of the bias."""
    theta = np.zeros(3)
    for i in range(3):
        for j in range(3):
            theta[i] += reference.per_bias[i, j] * change[j]
    rotate_in_body(reference.turn, theta[0], theta[1], theta[2])


# absolute gravity update: MD (12)-(14)


@njit(cache=True)
def update_gravity(state: PocketState, reference: FieldReference, force: Floats, model: FilterModel) -> float:
    """Update roll and pitch by a specific force (3,) m/s^2 of gravity alone; return the NIS, two degrees of freedom."""
    R, b, age = state.nav_R_body, state.gyro_bias, model.gravity_age_s
    square, x = 0.0, np.zeros(SIZE)
    # the force is `age` old: as it is in the body now
    up = np.empty(3)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        square += force[i] ** 2
        up[i] = force[i] + age * (b[j] * force[k] - b[k] * force[j])
    if model.euler:
        roll, pitch = angles_of_up(up)
        if model.printed_arctangent:
            roll = roll_as_printed(up)
        angles = angles_of_rotation(R)
        across = max(up[1] ** 2 + up[2] ** 2, 1e-12 * square)
        first = update_component(state.P, x, ATTITUDE, wrap_angle(angles[0] - roll), model.acc_variance / across)
        second = update_component(state.P, x, ATTITUDE + 1, angles[1] - pitch, model.acc_variance / square)
    else:
        z, h = np.zeros(2), np.zeros((2, SIZE))
        h[0, ATTITUDE + 1], h[1, ATTITUDE] = 1.0, -1.0
        for i in range(3):
            up[i] /= np.sqrt(square)
        for row in range(2):  # R (db x up), row by row: r . (db x up) = db . (up x r)
            for i in range(3):
                j, k = (i + 1) % 3, (i + 2) % 3
                h[row, GYRO_BIAS + i] = age * (up[j] * R[row, k] - up[k] * R[row, j])
                z[row] += R[row, i] * up[i]
        first = update_row(state.P, x, h[0], z[0], model.acc_variance / square)
        second = update_row(state.P, x, h[1], z[1], model.acc_variance / square)
    inject_error(state, reference, x, model.euler)
    return first**2 + second**2


# differential magnetic field update: MD (15), (16)


@njit(cache=True)
def update_field(state: PocketState, reference: FieldReference, field: Floats, model: FilterModel) -> float:
    """Update by a body field (3,) uT, across the predicted one; return the NIS, two degrees of freedom."""
    expected, per_bias = predict_field(reference, model.printed_difference)
    strength = np.sqrt(expected[0] ** 2 + expected[1] ** 2 + expected[2] ** 2)
    for i in range(3):
        expected[i] /= strength
    across = _span_across(expected)
    variance = 2.0 * model.mag_variance + model.gyr_density * reference.age[0] * strength**2
    x, h, z = np.zeros(SIZE), np.zeros((2, SIZE)), np.zeros(2)
    for i in range(3):
        for j in range(3):
            h[0, GYRO_BIAS + i] -= strength * across[1, j] * per_bias[j, i]
            h[1, GYRO_BIAS + i] += strength * across[0, j] * per_bias[j, i]
        for row in range(2):
            z[row] -= across[row, i] * field[i]
    first = update_row(state.P, x, h[0], z[0], variance)
    second = update_row(state.P, x, h[1], z[1], variance)
    inject_error(state, reference, x, model.euler)
    return first**2 + second**2


@njit(cache=True)
def _span_across(along: Floats) -> Floats:
    """Unit vectors u, v (2, 3) across `along` (3,), such that u, v, along are right-handed."""
    least = 0
    for i in range(1, 3):
        if abs(along[i]) < abs(along[least]):
            least = i
    j, k, out = (least + 1) % 3, (least + 2) % 3, np.zeros((2, 3))
    length = np.sqrt(along[j] ** 2 + along[k] ** 2)
    out[0, j], out[0, k] = -along[k] / length, along[j] / length  # of the axis it is least along, and it
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out[1, i] = along[j] * out[0, k] - along[k] * out[0, j]
    return out


@njit(cache=True)
def inject_error(state: PocketState, reference: FieldReference, x: Floats, euler: bool) -> None:
    """Subtract error `x` (6,), attitude rad and bias rad/s, from the state; correct the reference for the new bias."""
    if euler:
        angles = angles_of_rotation(state.nav_R_body)
        for i in range(3):
            angles[i] -= x[i]
        R = rotation_of_angles(angles)
        for i in range(3):
            for j in range(3):
                state.nav_R_body[i, j] = R[i, j]
    else:
        rotate_in_nav(state.nav_R_body, -x[0], -x[1], -x[2])
    change = np.empty(3)
    for i in range(3):
        change[i] = -x[GYRO_BIAS + i]
        state.gyro_bias[i] += change[i]
    shift_reference_bias(reference, change)
