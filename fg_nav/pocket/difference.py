"""How a field seen now follows from the last one that was measured: the chain behind the differential field update.

While the body turns by A = A_1 A_2 ... since then, a field that does not change in nav goes, in the body, from mu to

    A^T mu                                                                          (Eq. 15, read with Eq. 4)

A hangs on the gyro bias: each A_i is turned by -Jr h db at its end, and so with S as A is A Exp(S db),

    A <- A A_i,    S <- A_i^T S - Jr h.

A magnetometer slower than the gyroscope has A over several samples; in the paper it is one. When an update in between
moves the bias, A is turned along.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from fg_nav.arrays import Floats
from fg_nav.mechanisation import rotate_in_body
from fg_nav.pocket.belief import Chain


@njit(cache=True)
def begin(chain: Chain, field: Floats) -> None:
    """Begin anew at a field (3,) uT just measured."""
    chain.field[:] = field
    chain.turn[:] = np.eye(3)
    chain.per_bias[:] = 0.0
    chain.age[0] = 0.0


@njit(cache=True)
def lengthen(chain: Chain, theta: Floats, per_bias: Floats, h: float) -> None:
    """Take in a sample: the turn `theta` (3,) rad in `h` seconds, and how it hangs on the bias, `per_bias` (3, 3) s."""
    S = chain.per_bias.T.copy()
    rotate_in_body(S, theta[0], theta[1], theta[2])  # S^T A_i is (A_i^T S)^T
    chain.per_bias[:] = S.T + per_bias
    rotate_in_body(chain.turn, theta[0], theta[1], theta[2])
    chain.age[0] += h


@njit(cache=True)
def rebias(chain: Chain, change: Floats) -> None:
    """Turn A along with a change (3,) rad/s of the bias."""
    theta = chain.per_bias @ change
    rotate_in_body(chain.turn, theta[0], theta[1], theta[2])
