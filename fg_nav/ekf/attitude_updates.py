"""Corrections of the attitude at a footfall: the compass, the direction of up, and a course that goes on.

The error dphi is a rotation in nav, R_estimate = Exp(dphi) R_true (`fg_nav.ekf.covariance`), so that a vector v of nav
is seen by the estimate as v + dphi x v.

=========== ================================== ==================================================================
measured    residual z                          row of H on dphi
=========== ================================== ==================================================================
field b     atan2(-b_e, b_n) + declination      (-b_e b_u, -b_n b_u, H^2) / H^2,  H^2 = b_e^2 + b_n^2
heading     the compass's, less the estimate's  (0, 0, 1)
force f     (-f_n, f_e) / |f|                   (1, 0, 0) and (0, 1, 0)
course      the mean course before, less this   (0, 0, 1)
=========== ================================== ==================================================================

The heading is clockwise and dphi_u counter-clockwise: an estimate turned too far to the left sees north to its right.
The first two entries of the field's row are what a wrong tilt makes of the inclined field. The papers level the field
by the accelerometer instead and compare headings, which leaves a stance's errors of tilt in the compass (Ma 2018, Eq.
36; Zhang, Eq. 29, which besides takes errors of Euler angles for dphi).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from fg_nav.arrays import Floats
from fg_nav.ekf.covariance import ATTITUDE, SIZE
from fg_nav.ekf.evidence import Evidence
from fg_nav.ekf.update import correct_component_traced, correct_traced

COMPASS, TILT, COURSE, AGREEMENT = 0, 1, 2, 3
"""Columns of the standardised innovations; that of the tilt is the root of half its NIS. By the last the compass is
tested: it stands where the compass was refused, too."""

SHORTEST_STRIDE_M = 0.3
"""Of anything shorter the direction is that of a foot shifted about."""


@njit(cache=True)
def correct_at_footfall(
    nav_R_body: Floats,
    P: Floats,
    x: Floats,
    k: int,
    direction: float,
    before: Floats,
    evidence: Evidence,
    aside: Floats,
    innovation: Floats,
    traces: Floats,
) -> None:
    """Take what footfall `k` says into the error `x` (15,) and `P`.

    `direction` is the course, rad, and `before` (k,) those at the footfalls before, NaN where there is none
    (`direction_at`). `aside` (15,) is a doubt of one sigma that P does not have yet: the first compass that is believed
    puts it in, and sets it to zero. `innovation` (4,) is written where something was said, and `traces` (3, 32) have
    the corrections in their order, tilt about east and north before the heading.
    """
    if np.isfinite(evidence.tilt_variance[k]):
        innovation[TILT] = _correct_tilt(nav_R_body, P, x, evidence.body_force[k], evidence.tilt_variance[k], traces)
    if np.isfinite(evidence.compass_variance[k]):
        _correct_compass(nav_R_body, P, x, k, evidence, aside, innovation, traces[2])
    believed = np.isfinite(innovation[COMPASS])
    if not believed and np.isfinite(evidence.course_variance[k]) and k >= evidence.course_strides:
        turned = turn_since(direction, before[k - evidence.course_strides : k])
        straight = abs(turned) <= evidence.course_limit
        if straight or evidence.curve_is_zero:
            z, variance = -turned if straight else 0.0, evidence.course_variance[k]
            innovation[COURSE] = correct_component_traced(P, x, ATTITUDE + 2, z, variance, traces[2])


@njit(cache=True)
def _correct_compass(
    nav_R_body: Floats,
    P: Floats,
    x: Floats,
    k: int,
    evidence: Evidence,
    aside: Floats,
    innovation: Floats,
    trace: Floats,
) -> None:
    h = np.zeros(SIZE)
    h[ATTITUDE + 2] = 1.0
    if np.isfinite(evidence.compass_heading[k]):
        told = evidence.compass_heading[k] - heading_at(nav_R_body)
    else:
        east, north, up = nav_R_body @ evidence.body_field[k]
        told = np.arctan2(-east, north)
        level = east * east + north * north
        h[ATTITUDE], h[ATTITUDE + 1] = -east * up / level, -north * up / level
    z = wrapped(told + evidence.declination)
    own = P[ATTITUDE + 2, ATTITUDE + 2] + aside[ATTITUDE + 2] ** 2 if evidence.own_doubt else 0.0
    innovation[AGREEMENT] = z / np.sqrt(own + evidence.agreement)
    if innovation[AGREEMENT] ** 2 < evidence.compass_limit[k]:
        P += np.outer(aside, aside)
        aside[:] = 0.0
        innovation[COMPASS] = correct_traced(P, x, h, z, evidence.compass_variance[k], trace)


@njit(cache=True)
def _correct_tilt(nav_R_body: Floats, P: Floats, x: Floats, force: Floats, variance: float, traces: Floats) -> float:
    east, north, up = nav_R_body @ force
    strength = np.sqrt(east * east + north * north + up * up)
    first = correct_component_traced(P, x, ATTITUDE, -north / strength, variance, traces[0])
    second = correct_component_traced(P, x, ATTITUDE + 1, east / strength, variance, traces[1])
    return float(np.sqrt((first * first + second * second) / 2))


@njit(cache=True)
def turn_since(direction: float, before: Floats) -> float:
    """How far a direction is clockwise of the mean of those `before` (n,), rad; all are clockwise from north."""
    total = 0.0
    for earlier in before:
        total += wrapped(direction - earlier)
    return total / len(before)


@njit(cache=True)
def direction_at(nav_R_body: Floats, step: Floats, by_path: bool) -> float:
    """Heading (rad) of the standing foot, or of the stride `step` (3,) m to it: NaN for less than a stride."""
    if not by_path:
        return heading_at(nav_R_body)
    length = np.sqrt(step[0] ** 2 + step[1] ** 2)
    return float(np.arctan2(step[0], step[1])) if length > SHORTEST_STRIDE_M else np.nan


@njit(cache=True)
def heading_at(nav_R_body: Floats) -> float:
    """Heading of the body's x axis, rad clockwise from north."""
    return float(np.arctan2(nav_R_body[0, 0], nav_R_body[1, 0]))


@njit(cache=True)
def wrapped(angle: float) -> float:
    """An angle in rad from -pi to below pi; `fg_nav.frames.wrap` in compiled code."""
    return (angle + np.pi) % (2 * np.pi) - np.pi
