"""State and beliefs as the compiled pass has them.

The error is estimate minus truth, in this order:

======= ========== ==================================================================================
0       attitude   a small rotation in nav, R_estimate = Exp(dphi) R_true; or of the Euler angles, rad
3       bias       gyro bias, rad/s, body
======= ========== ==================================================================================
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.pocket.paper import EARTH_RATE_RAD_S
from fg_nav.pocket.parameters import PocketParameters

ATTITUDE, GYRO_BIAS, SIZE = 0, 3, 6


class PocketState(NamedTuple):
    """What the filter knows: `nav_R_body` (3, 3), `gyro_bias` (3,) rad/s and `P` (6, 6), changed in place."""

    nav_R_body: Floats
    gyro_bias: Floats
    P: Floats


class Chain(NamedTuple):
    """From the last field that was measured to now, changed in place (`fg_nav.pocket.difference`).

    `field` (3,) uT; `turn` (3, 3), A, from the body now to the body then; `per_bias` (3, 3) s, S: with a bias higher by
    db, A is A Exp(S db); `age` (1,) s, NaN where no field was measured yet.
    """

    field: Floats
    turn: Floats
    per_bias: Floats
    age: Floats


class Belief(NamedTuple):
    """The parameters in SI units, variances in place of sigmas; `earth_rate` (3,) rad/s in nav.

    `gravity_age_s` is half the window of which the specific force is the mean.
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


def belief_of(p: PocketParameters) -> Belief:
    """Parameters as the pass needs them."""
    return Belief(
        gyr_density=float(np.radians(p.gyr_density_deg)) ** 2,
        bias_density=float(np.radians(p.bias_walk_deg_s)) ** 2,
        bias_decay_per_s=1.0 / p.bias_time_s if p.bias_returns_to_zero else 0.0,
        earth_rate=earth_rate(p.latitude_deg),
        acc_variance=p.acc_sigma_m_s2**2,
        gravity_age_s=p.gravity_window_s / 2.0,
        mag_variance=p.mag_sigma_uT**2,
        shortest_s=p.shortest_difference_s,
        longest_s=p.shortest_difference_s + p.longest_difference_s,
        euler=p.euler_state,
        printed_difference=p.difference_as_printed,
        printed_arctangent=p.arctangent_as_printed,
    )


def earth_rate(latitude_deg: float | None) -> Floats:
    """Turn of the Earth (3,) rad/s in nav at a latitude (Eq. 27); zero for None, where it is not taken off."""
    if latitude_deg is None:
        return np.zeros(3)
    latitude = np.radians(latitude_deg)
    return EARTH_RATE_RAD_S * np.array([0.0, np.cos(latitude), np.sin(latitude)])


def blank_chain() -> Chain:
    """Chain before the first field."""
    return Chain(np.zeros(3), np.eye(3), np.zeros((3, 3)), np.full(1, np.nan))
