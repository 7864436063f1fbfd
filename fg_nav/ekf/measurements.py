"""Measurements of a standing foot: its velocity, and at each footfall compass, direction of up and course.

Velocity. The sole is still, the sensor is not: the foot rolls from heel to toe, and the sensor is at a lever l from the
point about which it rolls. With the angular rate w, both in nav,

    v = w x l + noise,    l = (0, 0, height) + unknown part.

v = 0 makes strides too short, in the median by 2 % on motion-captured walks. The height is the mean lever, or the lever
is given in the body frame (`fg_nav.detection.rest`). The unknown part is noise, constant for a while, of
density sigma |w| sqrt(2 tau), with a small floor at rest. A foot whose specific force f is not gravity has begun to
move: the velocity has the further standard deviation unsteady | |f| - g |, again as a density. H leaves out how
attitude and gyro bias enter through w x l: the lever times a hundredth of a radian.

Attitude. The error dphi is a rotation in nav, R_estimate = Exp(dphi) R_true (`fg_nav.ekf.covariance`), so that a vector
v of nav appears to the estimate as v + dphi x v.

=========== ================================== =========================================== ============================
measured    residual z                          row of H                                    source
=========== ================================== =========================================== ============================
velocity    v - w x l                           identity on dv                              Ma (34), AIEZ (29), (30)
field b     atan2(-b_e, b_n) + declination      (-b_e b_u, -b_n b_u, H^2) / H^2 on dphi     Ma (34)-(36), AIEZ (25)
heading     the compass's less the estimate's   (0, 0, 1) on dphi                           the same
force f     (-f_n, f_e) / |f|                   (1, 0, 0) and (0, 1, 0) on dphi             AIEZ (19)-(22)
course      mean course before less this one    (0, 0, 1) on dphi                           AIEZ (27), (28)
=========== ================================== =========================================== ============================

with H^2 = b_e^2 + b_n^2. The heading is clockwise and dphi_u counter-clockwise: an estimate turned too far to the left
has north to its right. The first two entries of the field's row are the effect of a wrong tilt on the inclined field.
The papers level the field by the accelerometer instead, which leaves a stance's tilt errors in the compass. Misprints
corrected here, AIEZ (26), (32) too: docs/equations.md.

References: Foxlin (2005), "Pedestrian tracking with shoe-mounted inertial sensors". Velocity not zero, error not white:
Nilsson, Skog, Handel (2012), "A note on the limitations of ZUPTs and the implications on sensor error modeling". The
rolling lever is ours.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.ekf.covariance import ATTITUDE, SIZE, VELOCITY
from fg_nav.ekf.update import update_component_traced, update_row_traced
from fg_nav.mechanisation import NavState
from fg_nav.system.compiled import njit

COMPASS, TILT, COURSE, AGREEMENT = 0, 1, 2, 3
"""Columns of the standardized innovations. TILT is the root of half its NIS; AGREEMENT is the innovation by which the
compass is tested, written where it is rejected, too."""

MIN_STRIDE_M = 0.3  # A shorter displacement has no course: the foot was only shifted.


class StanceNoise(NamedTuple):
    """Squared density of the velocity in stance, growing with rate and force, and the lever."""

    floor: float  # (m/s)^2 s
    rolling: float  # m^2 s, times the squared rate
    unsteady: float  # s^3, times the square of the force's excess over gravity
    height: float  # m, lever straight up
    lever: Floats  # (3,) m, lever in the body frame
    gravity: float  # m/s^2


@njit(cache=True)
def update_in_stance(
    state: NavState, P: Floats, x: Floats, acc: Floats, gyr: Floats, h: float, stance: StanceNoise, traces: Floats
) -> float:
    """Update `x` and `P` by the velocity in stance over `h` s; write `traces` (3, 17), east first; return the NIS."""
    w, v, expected, square, force = np.empty(3), np.empty(3), np.empty(3), 0.0, 0.0
    for axis in range(3):
        w[axis] = gyr[axis] - state.gyro_bias[axis]
        square += w[axis] ** 2
        force += acc[axis] ** 2
    # velocity of a sensor at the lever: R (w x l) + (R w) x (0, 0, height)
    lever = stance.lever
    v[0] = w[1] * lever[2] - w[2] * lever[1]
    v[1] = w[2] * lever[0] - w[0] * lever[2]
    v[2] = w[0] * lever[1] - w[1] * lever[0]
    for axis in range(3):
        expected[axis] = _component(state.nav_R_body, axis, v)
    expected[0] += _component(state.nav_R_body, 1, w) * stance.height
    expected[1] -= _component(state.nav_R_body, 0, w) * stance.height
    variance = (stance.floor + stance.rolling * square) / h
    if stance.unsteady > 0.0:
        variance += stance.unsteady * (np.sqrt(force) - stance.gravity) ** 2 / h
    nis = 0.0
    for axis in range(3):
        z = state.velocity[axis] - expected[axis]
        nis += update_component_traced(P, x, VELOCITY + axis, z, variance, traces[axis]) ** 2
    return nis


class PseudoMeasurements(NamedTuple):
    """Measurements of the attitude at K footfalls, one row each, in the body frame of the stillest sample of each.

    A variance of NaN leaves a row out.
    """

    body_field: Floats  # (K, 3) uT, mean over the stance
    body_force: Floats  # (K, 3) m/s^2, mean specific force over the stance
    compass_heading: Floats  # (K,) rad clockwise from magnetic north, levelled by the force; NaN: by the attitude
    compass_variance: Floats  # (K,) rad^2, of the heading of the field
    compass_limit: Floats  # (K,) the compass is used where z^2 < limit (var dphi_u + agreement); inf: always
    tilt_variance: Floats  # (K,) rad^2, of the direction of up by the force
    course_variance: Floats  # (K,) rad^2, of the course staying straight (HDR), used where the compass is not
    course_limit: float = 0.0  # rad, a change of course beyond this is a curve
    course_strides: int = 0  # footfalls before, whose mean course is the reference
    curve_is_zero: bool = False  # measure a change of zero in a curve, AIEZ (28) as printed; False: no measurement
    course_by_path: bool = False  # a course is that of the stride; False: the heading of the standing foot
    agreement: float = 1.0  # rad^2, variance of a right compass against the true heading
    use_own_variance: bool = True  # count var dphi_u in that test; False: the agreement alone, as printed
    declination: float = 0.0  # rad, of magnetic north, clockwise from the north of nav


def make_pseudo_measurements(footfalls: int) -> PseudoMeasurements:
    """Pseudo-measurements of which none is used."""
    vectors, nothing = np.full((footfalls, 3), np.nan), np.full(footfalls, np.nan)
    return PseudoMeasurements(vectors, vectors, nothing, nothing, np.full(footfalls, np.inf), nothing, nothing)


@njit(cache=True)
def update_at_footfall(
    nav_R_body: Floats,
    P: Floats,
    x: Floats,
    k: int,
    direction: float,
    before: Floats,
    pseudo: PseudoMeasurements,
    considered: Floats,
    innovation: Floats,
    traces: Floats,
) -> None:
    """Update the error `x` (15,) and `P` by the pseudo-measurements of footfall `k`.

    `direction` is the course, rad, and `before` (k,) those at the footfalls before, NaN where there is none
    (`compute_direction`). `considered` (15,) is the error of one sigma of a considered (Schmidt) state that P does not
    contain yet: the first compass that is used adds it to P and sets it to zero. `innovation` (4,) is written where a
    row was used, and `traces` (3, 32) have the updates in their order, tilt about east and north before the heading.
    """
    if np.isfinite(pseudo.tilt_variance[k]):
        east, north, up = _rotate(nav_R_body, pseudo.body_force[k])
        strength = np.sqrt(east * east + north * north + up * up)
        first = update_component_traced(P, x, ATTITUDE, -north / strength, pseudo.tilt_variance[k], traces[0])
        second = update_component_traced(P, x, ATTITUDE + 1, east / strength, pseudo.tilt_variance[k], traces[1])
        innovation[TILT] = np.sqrt((first * first + second * second) / 2)
    if np.isfinite(pseudo.compass_variance[k]):
        _update_by_compass(nav_R_body, P, x, k, pseudo, considered, innovation, traces[2])
    compass_used = np.isfinite(innovation[COMPASS])
    if not compass_used and np.isfinite(pseudo.course_variance[k]) and k >= pseudo.course_strides:
        change = compute_turn(direction, before[k - pseudo.course_strides : k])
        straight = abs(change) <= pseudo.course_limit
        if straight or pseudo.curve_is_zero:
            z, variance = -change if straight else 0.0, pseudo.course_variance[k]
            innovation[COURSE] = update_component_traced(P, x, ATTITUDE + 2, z, variance, traces[2])


@njit(cache=True)
def _update_by_compass(
    nav_R_body: Floats,
    P: Floats,
    x: Floats,
    k: int,
    pseudo: PseudoMeasurements,
    considered: Floats,
    innovation: Floats,
    trace: Floats,
) -> None:
    """Test the compass of footfall `k`; if it passes, add `considered` to `P`, set that to zero, and update."""
    h = np.zeros(SIZE)
    h[ATTITUDE + 2] = 1.0
    if np.isfinite(pseudo.compass_heading[k]):
        difference = pseudo.compass_heading[k] - compute_heading(nav_R_body)
    else:
        east, north, up = _rotate(nav_R_body, pseudo.body_field[k])
        difference = np.arctan2(-east, north)
        level = east * east + north * north
        h[ATTITUDE], h[ATTITUDE + 1] = -east * up / level, -north * up / level
    z = wrap_angle(difference + pseudo.declination)
    own = P[ATTITUDE + 2, ATTITUDE + 2] + considered[ATTITUDE + 2] ** 2 if pseudo.use_own_variance else 0.0
    innovation[AGREEMENT] = z / np.sqrt(own + pseudo.agreement)
    if innovation[AGREEMENT] ** 2 < pseudo.compass_limit[k]:
        for i in range(SIZE):
            for j in range(SIZE):
                P[i, j] += considered[i] * considered[j]
        for i in range(SIZE):
            considered[i] = 0.0
        innovation[COMPASS] = update_row_traced(P, x, h, z, pseudo.compass_variance[k], trace)


@njit(cache=True)
def _component(nav_R_body: Floats, axis: int, v: Floats) -> float:
    """Component along an axis of nav of a vector (3,) in the body frame."""
    return float(nav_R_body[axis, 0] * v[0] + nav_R_body[axis, 1] * v[1] + nav_R_body[axis, 2] * v[2])


@njit(cache=True)
def _rotate(nav_R_body: Floats, v: Floats) -> tuple[float, float, float]:
    """East, north and up of a vector (3,) in the body frame."""
    return _component(nav_R_body, 0, v), _component(nav_R_body, 1, v), _component(nav_R_body, 2, v)


@njit(cache=True)
def compute_turn(direction: float, before: Floats) -> float:
    """How far a direction is clockwise of the mean of those `before` (n,), rad: the left side of AIEZ (27), wrapped."""
    total = 0.0
    for k in range(len(before)):
        total += wrap_angle(direction - before[k])
    return total / len(before)


@njit(cache=True)
def compute_direction(nav_R_body: Floats, step: Floats, by_path: bool) -> float:
    """Heading (rad) of the standing foot, or of the stride `step` (3,) m to it: NaN for less than a stride."""
    if not by_path:
        return compute_heading(nav_R_body)
    length = np.sqrt(step[0] ** 2 + step[1] ** 2)
    return float(np.arctan2(step[0], step[1])) if length > MIN_STRIDE_M else np.nan


@njit(cache=True)
def compute_heading(nav_R_body: Floats) -> float:
    """Heading of the body's x axis, rad clockwise from north."""
    return float(np.arctan2(nav_R_body[0, 0], nav_R_body[1, 0]))


@njit(cache=True)
def wrap_angle(angle: float) -> float:
    """An angle in rad from -pi to below pi; `fg_nav.frames.wrap_angle` in compiled code."""
    return (angle + np.pi) % (2 * np.pi) - np.pi
