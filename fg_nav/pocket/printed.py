"""What the paper prints that does not do what it is meant to, and what must stand there.

========= ============================================ ============================================================
Eq.       printed                                      read
========= ============================================ ============================================================
10, 11    b = c b + n, about zero                      right for the part that wanders, but a turn-on bias of 0.1
                                                       deg/s is no draw from it (B / sqrt(2) = 0.002) and fades with
                                                       t_B: c = 1 (`bias_returns_to_zero`)
12        roll = arctan(a_y / a_z)                     both signs: atan2, or a sensor upside down is turned by pi
                                                       (`arctangent_as_printed`)
14        innovations of angles                        wrapped to +-pi; not said, done in both
15        mu = A mu                                    A^T mu: with Eq. 4, A turns from the body now to the body before
                                                       (`difference_as_printed`)
16        "the covariance of mu-bar"                   that of the difference: the new sample has noise too
1, 7, 14  Euler angles                                 fine until the pitch is +-90 deg, a thigh lying level when
                                                       somebody sits (`euler_state`)
========= ============================================ ============================================================

Eq. 21's (r_c / r) in place of its square is the field's affair (`fg_nav.lab.simulation`). This module has what the
kernel needs of the printed equations.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from fg_nav.arrays import Floats


@njit(cache=True)
def printed_roll(force: Floats) -> float:
    """Roll, rad within +-pi/2, of a specific force (3,) by Eq. 12 as printed."""
    return float(np.arctan(force[1] / force[2])) if force[2] != 0.0 else float(np.sign(force[1]) * np.pi / 2)


@njit(cache=True)
def printed_field(turn: Floats, field: Floats) -> Floats:
    """Field (3,) expected after `turn` (3, 3), A, by Eq. 15 as printed."""
    return turn @ field
