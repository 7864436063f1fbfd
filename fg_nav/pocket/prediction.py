"""The prediction stage: attitude and bias over one sample (Eq. 3-11), with the Earth's rate taken off (Eq. 26-27).

With R = nav_R_body, a rate w held for h seconds, the Earth's rate W in nav, and Jr the right Jacobian of the rotations,

    theta = (w - b - R^T W) h,    A = Exp(theta)                                     (Eq. 3, 5, 6, 26)
    R' = R A                                                                         (Eq. 4)
    b' = c b,    c = exp(-h / t_B), or 1                                             (Eq. 10)

A bias too high by db turns A by -Jr h db in the body at the end. Errors (`fg_nav.pocket.belief`) move by

    dphi' = (I - h [W]) dphi - R' Jr h db,    db' = c db

and, in Euler angles with dphi = E e, by E'^-1 (I - h [W]) E and E'^-1 R' Jr h. Noise enters at the end of the step: the
gyroscope's turns the attitude by the same about all axes, and the bias walks by sigma_n of Eq. 24 a sample.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from fg_nav.arrays import Floats
from fg_nav.mechanisation import cross_matrix, right_jacobian, rotate_in_body
from fg_nav.pocket.belief import Belief, Chain, PocketState
from fg_nav.pocket.difference import lengthen
from fg_nav.pocket.euler import axes, inverse_axes


@njit(cache=True)
def predict(state: PocketState, chain: Chain, rate: Floats, h: float, belief: Belief) -> None:
    """Move state and chain over a sample of `rate` (3,) rad/s held for `h` seconds."""
    R, bias, P = state
    before = axes(R) if belief.euler else np.eye(3)
    theta = (rate - bias - R.T @ belief.earth_rate) * h
    rotate_in_body(R, theta[0], theta[1], theta[2])
    per_bias = -h * right_jacobian(theta)
    lengthen(chain, theta, per_bias, h)
    after = inverse_axes(R) if belief.euler else np.eye(3)
    decay = np.exp(-h * belief.bias_decay_per_s)
    bias *= decay
    F = np.zeros((6, 6))
    F[:3, :3] = after @ (np.eye(3) - h * cross_matrix(belief.earth_rate)) @ before
    F[:3, 3:] = after @ (R @ per_bias)
    for i in range(3, 6):
        F[i, i] = decay
    P[:] = F @ P @ F.T
    P[:3, :3] += belief.gyr_density * h * (after @ after.T)
    for i in range(3, 6):
        P[i, i] += belief.bias_density * h
