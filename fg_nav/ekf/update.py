"""Update of state and covariance by measurements, one scalar row after the other.

A measurement gives z = h x + n of the error x (estimate minus truth) with independent noises of variance r; Ma (33).
Taken in turn, each row h of H gives Ma (37),

    c = P h^T,  s = h c + r,  K = c / s,  nu = z - h x,   x <- x + K nu,
    P <- (I - K h) P (I - K h)^T + K r K^T                                                  (Joseph)

The Joseph form is evaluated as (P - K c^T) - d K^T with d = (I - K h) P h^T - r K, which is zero but for
rounding: it costs one more product than the short form and keeps P positive. nu / sqrt(s) is the standardized
innovation: for a consistent filter white with unit variance, and the sum of squares over the rows of one H is
its NIS.

Estimated errors are injected into the state ("closed loop", x is zero again afterwards), AIEZ (6), (7):

    p <- p - dp,  v <- v - dv,  b <- b - db,  R <- Exp(-dphi) R  = (I - [dphi]) R + ...

With errors as estimate minus truth this is the one sign that shrinks them, unlike that of Ma (39); Exp stands for the
Cayley form of Ma (38) and AIEZ (6) (docs/equations.md).

An update leaves its `trace` for the backward pass (`fg_nav.ekf.rts`): c, s, nu and, where it is no unit row, h.

References: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation (2001),
5.2.3; Bierman, Factorization Methods for Discrete Sequential Estimation (1977).
"""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.ekf.covariance import ACC_BIAS, ATTITUDE, GYRO_BIAS, POSITION, SIZE, VELOCITY
from fg_nav.mechanisation import NavState, rotation_series
from fg_nav.system.compiled import njit

VARIANCE, INNOVATION, ROW = SIZE, SIZE + 1, SIZE + 2  # Where a trace has s, nu and the first of h; c comes before.


@njit(cache=True)
def update_row(P: Floats, x: Floats, h: Floats, z: float, r: float) -> float:
    """Update `x` (n,) and `P` (n, n) by `z` = `h` x + noise of variance `r`; returns the standardized innovation."""
    return update_row_traced(P, x, h, z, r, np.empty(2 * len(x) + 2))


@njit(cache=True)
def update_row_traced(P: Floats, x: Floats, h: Floats, z: float, r: float, trace: Floats) -> float:
    """`update_row`, which also writes `trace` = (c, s, nu, h) for the backward pass; returns nu / sqrt(s)."""
    n, hc, hx = len(x), 0.0, 0.0
    for i in range(n):
        trace[i] = 0.0
        for j in range(n):
            trace[i] += P[i, j] * h[j]
        trace[n + 2 + i] = h[i]
        hc += h[i] * trace[i]
        hx += h[i] * x[i]
    return _update(P, x, hc, z - hx, r, trace)


@njit(cache=True)
def update_component(P: Floats, x: Floats, index: int, z: float, r: float) -> float:
    """Update by `z` = x[`index`] + noise of variance `r`: `update_row` for a unit row, cheaper."""
    return update_component_traced(P, x, index, z, r, np.empty(len(x) + 2))


@njit(cache=True)
def update_component_traced(P: Floats, x: Floats, index: int, z: float, r: float, trace: Floats) -> float:
    """`update_component`, leaving the trace (n + 2,), or with room for the row (2 n + 2,)."""
    n = len(x)
    for i in range(n):
        trace[i] = P[index, i]
    for i in range(n + 2, len(trace)):
        trace[i] = 1.0 if i == n + 2 + index else 0.0
    return _update(P, x, P[index, index], z - x[index], r, trace)


@njit(cache=True)
def _update(P: Floats, x: Floats, hc: float, nu: float, r: float, trace: Floats) -> float:
    """Joseph update of `x`, `P` by innovation `nu`: the trace holds c = P h^T, hc = h c; returns nu / sqrt(s)."""
    c, s = trace, hc + r
    trace[len(x)], trace[len(x) + 1] = s, nu
    for i in range(len(x)):
        x[i] += c[i] / s * nu
    for i in range(len(x)):
        gain = c[i] / s
        rounding = c[i] - gain * hc - r * gain
        for j in range(i, len(x)):
            P[i, j] = (P[i, j] - gain * c[j]) - rounding * c[j] / s
            P[j, i] = P[i, j]
    return float(nu / np.sqrt(s))


@njit(cache=True)
def inject_error(state: NavState, x: Floats) -> None:
    """Subtract the estimated error `x` (15,) from `state` in place, and set it to zero."""
    position, velocity, R, gyro_bias, acc_bias = state
    for i in range(3):
        position[i] -= x[POSITION + i]
        velocity[i] -= x[VELOCITY + i]
        gyro_bias[i] -= x[GYRO_BIAS + i]
        acc_bias[i] -= x[ACC_BIAS + i]
    rotate_in_nav(R, -x[ATTITUDE], -x[ATTITUDE + 1], -x[ATTITUDE + 2])
    for i in range(len(x)):
        x[i] = 0.0


@njit(cache=True)
def rotate_in_nav(R: Floats, x: float, y: float, z: float) -> None:
    """R <- Exp(theta) R in place, with theta = (x, y, z) rad in nav."""
    angle = x * x + y * y + z * z
    a, b, _ = rotation_series(angle)
    sinc = 1.0 - b * angle
    for j in range(3):
        r0, r1, r2 = R[0, j], R[1, j], R[2, j]
        along = a * (x * r0 + y * r1 + z * r2)
        # Rodrigues: cos r + sinc theta x r + (1 - cos) / angle^2 (theta . r) theta
        R[0, j] = (1.0 - a * angle) * r0 + sinc * (y * r2 - z * r1) + along * x
        R[1, j] = (1.0 - a * angle) * r1 + sinc * (z * r0 - x * r2) + along * y
        R[2, j] = (1.0 - a * angle) * r2 + sinc * (x * r1 - y * r0) + along * z
