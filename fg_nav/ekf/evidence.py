"""What the footfalls of a walk say of the attitude: one row each, taken in once, at the stillest sample.

A filter is told which of it to believe by the variances: NaN leaves a row out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Floats


class Evidence(NamedTuple):
    """At K footfalls, in the body frame of the stillest sample of each.

    ================= ====== =========================================================================================
    body_field        (K, 3) uT, mean over the stance
    body_force        (K, 3) m/s^2, mean specific force over the stance
    compass_heading   (K,)   rad clockwise from magnetic north, levelled by the force; NaN to level by the attitude
    compass_variance  (K,)   rad^2, of the heading that the field tells; NaN where it is not to be believed
    compass_limit     (K,)   the compass is believed where z^2 < limit (var dphi_u + agreement); inf to believe it
    tilt_variance     (K,)   rad^2, of the direction of up that the force tells; NaN where it is not
    course_variance   (K,)   rad^2, of the heading going on as it was (HDR), where no compass is believed; NaN without
    course_limit      rad    a change of heading beyond this is a curve and tells nothing
    course_strides    -      footfalls before, whose mean the heading is held against
    curve_is_zero     -      in a curve take a change of zero for measured (Zhang, Eq. 28 as printed); False for nothing
    course_by_path    -      a course is that of the stride; False for the heading of the standing foot
    agreement         rad^2, variance of the compass against the true heading, where it is right
    own_doubt         -      count var dphi_u in that test; False for the agreement alone, as printed
    declination       rad    of magnetic north, clockwise from the north of nav
    ================= ====== =========================================================================================
    """

    body_field: Floats
    body_force: Floats
    compass_heading: Floats
    compass_variance: Floats
    compass_limit: Floats
    tilt_variance: Floats
    course_variance: Floats
    course_limit: float = 0.0
    course_strides: int = 0
    curve_is_zero: bool = False
    course_by_path: bool = False
    agreement: float = 1.0
    own_doubt: bool = True
    declination: float = 0.0


def no_evidence(footfalls: int) -> Evidence:
    """Evidence of which nothing is believed."""
    vectors, nothing = np.full((footfalls, 3), np.nan), np.full(footfalls, np.nan)
    return Evidence(vectors, vectors, nothing, nothing, np.full(footfalls, np.inf), nothing, nothing)
