"""The filter of Munoz Diaz et al. (2017) with its equations as printed, which does not work, and shows why.

What MD prints that does not work, and what must stand there: docs/equations.md, MD (1), (10)-(16). Its Euler
angles are roll, pitch and yaw, rad,

    nav_R_body = Rz(yaw) Ry(pitch) Rx(roll)         nav East-North-Up, so yaw is that of the x axis, counter-clockwise
                                                    from east: pi / 2 - heading
    gravity at rest = g (-sin pitch, sin roll cos pitch, cos roll cos pitch)                          MD (12), (13)

and errors e of the angles, estimate minus truth, turn about the axes of the three rotations,

    dphi = E e,    E = [nav_R_body e_x,  Rz(yaw) e_y,  e_z],    det E = cos pitch,

with R_estimate = Exp(dphi) R_true. At a pitch of +-90 deg roll and yaw turn about the same axis: E has no inverse.
Between the updates the covariance is that of dphi, and during an update that of e. In angles gravity updates roll and
pitch by the innovations MD (14); the accelerometer's noise through them has the variances s^2 / (a_y^2 + a_z^2) and
s^2 / |a|^2, and no covariance.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.ekf.measurements import wrap_angle
from fg_nav.ekf.update import update_component
from fg_nav.errors import EstimationError
from fg_nav.mechanisation import multiply, rotation_vector, transpose
from fg_nav.pocket.filter import (
    GYRO_BIAS,
    SIZE,
    FieldReference,
    FilterInputs,
    FilterModel,
    PocketParameters,
    PocketState,
    allocate_track,
    build_model,
    create_reference,
    initialize_state,
    predict_state,
    prepare_inputs,
    set_reference,
    shift_reference_bias,
    store_state,
    update_field,
    update_gravity,
)
from fg_nav.pocket.track import STORED_EVERY_S, PocketStart, PocketTrack, level_start
from fg_nav.recording import Recording
from fg_nav.system.compiled import njit

MIN_COSINE = float(np.sin(np.radians(1.0)))  # Within a degree of a pitch of +-90 deg roll and yaw are not usable.

# gravity by single samples, with the noise of an accelerometer of 0.003 m/s^2/sqrt(Hz)
PRINTED = PocketParameters(bias_returns_to_zero=True, gravity_window_s=0.0, acc_sigma_m_s2=0.03)


class Misprints(NamedTuple):
    """Which equations are as printed: state in Euler angles, MD (1); MD (15), A mu; with angles MD (12), arctangent."""

    angles: bool = True
    difference: bool = True
    arctangent: bool = True


def estimate_as_printed(
    recording: Recording,
    parameters: PocketParameters = PRINTED,
    start: PocketStart | None = None,
    misprints: Misprints = Misprints(),
) -> PocketTrack:
    """Estimate orientation and gyro bias as `fg_nav.pocket.estimate_pocket`, by the equations as printed.

    Raises `EstimationError` where Euler angles end.
    """
    track = allocate_track(recording.t, max(round(STORED_EVERY_S / recording.period_s), 1))
    state = initialize_state(level_start(recording) if start is None else start, parameters)
    inputs = prepare_inputs(recording, parameters)
    end = run_as_printed(inputs, state, create_reference(), build_model(parameters), misprints, track)
    if end < len(recording):
        raise EstimationError(
            f"the body's x axis is vertical at {recording.t[end]:.3f} s, where the paper's Euler angles end: "
            "use the filter without its misprints."
        )
    return track


@njit(cache=True)
def run_as_printed(
    inputs: FilterInputs,
    state: PocketState,
    reference: FieldReference,
    model: FilterModel,
    misprints: Misprints,
    track: PocketTrack,
) -> int:
    """Filter all samples into a blank `track`; return their number, or the sample at which Euler angles end."""
    for i in range(len(inputs.h)):
        if i > 0:
            predict_state(state, reference, inputs.rate[i - 1], inputs.h[i - 1], model)
        if misprints.angles and is_degenerate(state.nav_R_body):
            return i
        if inputs.gravity[i] and misprints.angles:
            track.gravity_nis[i] = update_gravity_in_angles(
                state, reference, inputs.force[i], model, misprints.arctangent
            )
        elif inputs.gravity[i]:
            track.gravity_nis[i] = update_gravity(state, reference, inputs.force[i], model)
        age = reference.age[0]
        if inputs.fresh[i] and not (inputs.steady[i] and age < model.shortest_s - 1e-9):
            if inputs.steady[i] and age <= model.longest_s + 1e-9:
                used = swap_turn(reference) if misprints.difference else reference
                track.field_nis[i] = (
                    update_field_in_angles(state, used, inputs.field[i], model)
                    if misprints.angles
                    else update_field(state, used, inputs.field[i], model)
                )
            set_reference(reference, inputs.field[i])
        if misprints.angles and is_degenerate(state.nav_R_body):
            return i
        store_state(i, state, track)
    return len(inputs.h)


@njit(cache=True)
def swap_turn(reference: FieldReference) -> FieldReference:
    """Return a reference that predicts A mu, with -A S for S: MD (15) as printed."""
    per_bias = -multiply(reference.turn, reference.per_bias)
    return FieldReference(reference.field, transpose(reference.turn), per_bias, reference.age)


@njit(cache=True)
def update_gravity_in_angles(
    state: PocketState, reference: FieldReference, force: Floats, model: FilterModel, arctangent: bool
) -> float:
    """Update roll and pitch by a specific force (3,) m/s^2 of gravity alone; return the NIS, two degrees of freedom."""
    R, b, P, age = state.nav_R_body, state.gyro_bias, state.P, model.gravity_age_s
    up, x = force + age * np.cross(b, force), np.zeros(SIZE)
    square = force[0] ** 2 + force[1] ** 2 + force[2] ** 2
    roll, pitch = angles_of_up(up)
    if arctangent:  # within +-pi/2, MD (12) as printed
        roll = np.arctan(up[1] / up[2]) if up[2] != 0.0 else np.sign(up[1]) * np.pi / 2
    angles = angles_of_rotation(R)
    across = max(up[1] ** 2 + up[2] ** 2, 1e-12 * square)
    turn_covariance(P, inverse_error_axes(R))
    first = update_component(P, x, 0, wrap_angle(angles[0] - roll), model.acc_variance / across)
    second = update_component(P, x, 1, angles[1] - pitch, model.acc_variance / square)
    inject_angles(state, reference, x)
    return float(first**2 + second**2)


@njit(cache=True)
def update_field_in_angles(state: PocketState, reference: FieldReference, field: Floats, model: FilterModel) -> float:
    """Update by a body field (3,) uT as `update_field`, the correction of the attitude in angles; return the NIS."""
    before, x = state.nav_R_body.copy(), np.zeros(SIZE)
    nis = update_field(state, reference, field, model)
    # the same correction, of the bias done, subtracted from the angles
    to_angles = inverse_error_axes(before)
    turned = rotation_vector(multiply(before, transpose(state.nav_R_body)))
    for i in range(3):
        x[i] = to_angles[i, 0] * turned[0] + to_angles[i, 1] * turned[1] + to_angles[i, 2] * turned[2]
    state.nav_R_body[:, :] = before
    turn_covariance(state.P, to_angles)
    inject_angles(state, reference, x)
    return nis


@njit(cache=True)
def inject_angles(state: PocketState, reference: FieldReference, x: Floats) -> None:
    """Subtract error `x` (6,), angles rad and bias rad/s, from the state with P in angles; P is of rotations after."""
    angles = angles_of_rotation(state.nav_R_body) - x[:GYRO_BIAS]
    state.nav_R_body[:, :] = rotation_of_angles(angles)
    turn_covariance(state.P, error_axes(state.nav_R_body))
    change = -x[GYRO_BIAS:]
    state.gyro_bias[:] += change
    shift_reference_bias(reference, change)


@njit(cache=True)
def turn_covariance(P: Floats, axes: Floats) -> None:
    """Transform the covariance (6, 6), in place, with the attitude's error multiplied by `axes` (3, 3)."""
    G = np.eye(SIZE)
    G[:GYRO_BIAS, :GYRO_BIAS] = axes
    P[:, :] = multiply(multiply(G, P), transpose(G))


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
