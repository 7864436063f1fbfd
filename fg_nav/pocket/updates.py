"""The update stage: absolute gravity and the differential magnetic field (Eq. 12-16).

A measurement says z = H x + n of the error x, estimate minus truth, taken in one row after the other
(`fg_nav.ekf.update`); x is then taken off the state.

Absolute gravity update, of a specific force a that is gravity alone
    in nav       u = R a / |a| is up but for the tilt: (u_x, u_y) = (dphi_y, -dphi_x), each with variance s^2 / |a|^2.
                 A mean over W (`gravity`) is W / 2 old: with a + (W / 2) b x a for a, u gains (W / 2) R (db x a) / |a|
    in angles    roll and pitch of Eq. 12, 13; the accelerometer's noise through them has the variances
                 s^2 / (a_y^2 + a_z^2) and s^2 / |a|^2, and no covariance. The same to first order.

Differential magnetic field update, of the field m measured now, against m' = A^T mu expected (`difference`)
    z = m' - m,    H = [0, [m'] S]                                                  (Eq. 15, 16)
    R = 2 s_m^2 I + q [m'] [m']^T,    q = variance of the gyroscope's angle since then
Along m' H is zero, for no turn changes a strength; and R is 2 s_m^2 + q |m'|^2 across it. So it is two rows: with u, v
and m' / |m'| a right-handed set, |m'| v^T S and -|m'| u^T S about u and v. The noise of each field enters two
differences, once with either sign, which the filter does not know: it believes them independent, as the paper does.
With Eq. 15 as printed, m' = A mu, and -A S in place of S.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from fg_nav.arrays import Floats
from fg_nav.ekf.attitude_updates import wrap_angle
from fg_nav.ekf.update import rotate_in_nav, update_component, update_row
from fg_nav.pocket.belief import ATTITUDE, GYRO_BIAS, SIZE, Belief, Chain, PocketState
from fg_nav.pocket.difference import rebias
from fg_nav.pocket.euler import angles_of, levelling_angles, rotation_of
from fg_nav.pocket.printed import printed_field, printed_roll


@njit(cache=True)
def absolute_gravity(state: PocketState, chain: Chain, force: Floats, belief: Belief) -> float:
    """Correct by a specific force (3,) m/s^2 that is gravity alone (Eq. 12-14); returns the NIS, of two."""
    square = (force**2).sum()
    force = force + belief.gravity_age_s * np.cross(state.gyro_bias, force)
    x = np.zeros(SIZE)
    if belief.euler:
        first, second = _by_angles(state, x, force, square, belief)
    else:
        first, second = _by_up(state, x, force / np.sqrt(square), belief.acc_variance / square, belief.gravity_age_s)
    take_off(state, chain, x, belief.euler)
    return first**2 + second**2


@njit(cache=True)
def _by_up(state: PocketState, x: Floats, body_up: Floats, variance: float, age: float) -> tuple[float, float]:
    R = state.nav_R_body
    up = R @ body_up
    h = np.zeros((2, SIZE))
    h[0, ATTITUDE + 1], h[1, ATTITUDE] = 1.0, -1.0
    for row in range(2):  # R (db x up), row by row: r . (db x up) = db . (up x r)
        h[row, GYRO_BIAS:] = age * np.cross(body_up, R[row])
    first = update_row(state.P, x, h[0], up[0], variance)
    return first, update_row(state.P, x, h[1], up[1], variance)


@njit(cache=True)
def _by_angles(state: PocketState, x: Floats, force: Floats, square: float, belief: Belief) -> tuple[float, float]:
    roll, pitch = levelling_angles(force)
    if belief.printed_arctangent:
        roll = printed_roll(force)
    angles = angles_of(state.nav_R_body)
    beside = max(force[1] ** 2 + force[2] ** 2, 1e-12 * square)
    first = update_component(state.P, x, ATTITUDE, wrap_angle(angles[0] - roll), belief.acc_variance / beside)
    second = update_component(state.P, x, ATTITUDE + 1, angles[1] - pitch, belief.acc_variance / square)
    return first, second


@njit(cache=True)
def expected_field(chain: Chain, printed: bool) -> tuple[Floats, Floats]:
    """Field (3,) uT expected now, m', and G (3, 3) s so that a bias higher by db moves it by m' x (G db)."""
    if printed:
        return printed_field(chain.turn, chain.field), -(chain.turn @ chain.per_bias)
    return chain.turn.T @ chain.field, chain.per_bias.copy()


@njit(cache=True)
def differential_field(state: PocketState, chain: Chain, field: Floats, belief: Belief) -> float:
    """Correct by a field (3,) uT in the body, against the last one (Eq. 15, 16); returns the NIS, of two."""
    expected, per_bias = expected_field(chain, belief.printed_difference)
    strength = np.sqrt((expected**2).sum())
    u, v = _across(expected / strength)
    variance = 2.0 * belief.mag_variance + belief.gyr_density * chain.age[0] * strength**2
    x, h = np.zeros(SIZE), np.zeros(SIZE)
    h[GYRO_BIAS:] = -strength * (v @ per_bias)
    first = update_row(state.P, x, h, -(u * field).sum(), variance)
    h[GYRO_BIAS:] = strength * (u @ per_bias)
    second = update_row(state.P, x, h, -(v * field).sum(), variance)
    take_off(state, chain, x, belief.euler)
    return first**2 + second**2


@njit(cache=True)
def _across(along: Floats) -> tuple[Floats, Floats]:
    """Two unit vectors u, v so that u, v, along (3,) are a right-handed set."""
    other = np.zeros(3)
    other[np.argmin(np.abs(along))] = 1.0
    u = np.cross(other, along)
    u /= np.sqrt((u**2).sum())
    return u, np.cross(along, u)


@njit(cache=True)
def take_off(state: PocketState, chain: Chain, x: Floats, euler: bool) -> None:
    """Take the estimated error `x` (6,) off the state, and turn the chain along with the bias."""
    if euler:
        state.nav_R_body[:] = rotation_of(angles_of(state.nav_R_body) - x[:GYRO_BIAS])
    else:
        rotate_in_nav(state.nav_R_body, -x[0], -x[1], -x[2])
    change = -x[GYRO_BIAS:]
    state.gyro_bias[:] += change
    rebias(chain, change)
