"""Where the foot is between footfalls: strapdown from the last node, standing still where it is seen to stand."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from fg_nav.arrays import Bools, Floats
from fg_nav.mechanisation import NavState, strapdown
from fg_nav.recording import Recording


class Track(NamedTuple):
    """A path at the rate of the samples: `t` (n,), position (n, 3), velocity (n, 3), attitude (n, 3, 3)."""

    t: Floats
    position: Floats
    velocity: Floats
    nav_R_body: Floats


def carried_on(recording: Recording, first: int, state: NavState, stands: Bools, gravity: float) -> Track:
    """Carry a state on from sample `first` to the last; `stands` (N,) is where the foot does not move."""
    h = np.append(np.diff(recording.t), recording.period_s)
    path = _carry(h, *recording.integrable, stands, first, state, gravity)
    return Track(recording.t[first:], *path)


@njit(cache=True)
def _carry(
    h: Floats, acc: Floats, gyr: Floats, stands: Bools, first: int, state: NavState, gravity: float
) -> tuple[Floats, Floats, Floats]:
    """Position (n, 3), velocity (n, 3) and attitude (n, 3, 3) from sample `first` on."""
    n = len(h) - first
    p, v, R = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3, 3))
    turn, push, at = np.empty((3, 3)), np.empty(3), np.empty(3)
    for i in range(n):
        p[i], v[i], R[i] = state.position, state.velocity, state.nav_R_body
        at[:] = state.position
        strapdown(state, acc[first + i], gyr[first + i], h[first + i], gravity, turn, push)
        if stands[first + i]:
            state.position[:] = at
            state.velocity[:] = 0.0
    return p, v, R
