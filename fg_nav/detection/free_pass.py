"""A free strapdown pass over a walk: the velocity of the foot, up to a slow drift (`fg_nav.detection.footfalls`).

At still samples the tilt is nudged towards gravity.
"""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.frames import GRAVITY_M_S2, level_attitude
from fg_nav.mechanisation import TILT_TIME_S, NavState, nudge_tilt, strapdown
from fg_nav.samples.gaps import MAX_HELD_S
from fg_nav.system.compiled import njit

FREE_FALL_M_S2 = 1.0  # A foot that stands feels gravity, and so more specific force than this.
MANY = 1 << 40  # Still samples, of which one more is nothing.


def is_falling(acc: Floats) -> Bools:
    """Whether the sensor falls freely (N,), or its gravity has been removed."""
    return np.asarray(np.linalg.norm(acc, axis=1) < FREE_FALL_M_S2)


@njit(cache=True)
def integrate_velocity(
    t: Floats, acc: Floats, gyr: Floats, still: Bools, first: int, nav_R_body: Floats, gravity: float
) -> Floats:
    """Velocity (N, 3) m/s of a strapdown pass from rest and this attitude at the sample `first`, both ways.

    At still samples the tilt is nudged towards gravity.
    """
    n = len(t)
    velocity = np.zeros((n, 3))
    turn, push = np.empty((3, 3)), np.empty(3)
    no_bias, R, position = np.zeros(3), np.empty((3, 3)), np.zeros(3)
    for way in (1, -1):
        for row in range(3):
            for axis in range(3):
                R[row, axis] = nav_R_body[row, axis]
        i = first
        while 0 <= i + way < n:
            held = min(i, i + way)  # a sample holds from its stamp to the next
            h = t[i + way] - t[i]
            for axis in range(3):
                velocity[i + way, axis] = velocity[i, axis]
            state = NavState(position, velocity[i + way], R, no_bias, no_bias)
            strapdown(state, acc[held], gyr[held], h, gravity, turn, push)
            if still[held]:
                nudge_tilt(R, acc[held], min(abs(h) / TILT_TIME_S, 1.0))
            i += way
    return velocity


class StrapdownPass:
    """The free strapdown pass of step 2 as far as the samples have come: it goes forward, and never over a gap.

    It begins at the stillest of the samples of the first call, and goes back from there to the very first. Behind a
    hole the tilt is unknown: the mean of the still samples that follow is up, until they are many.
    """

    def __init__(self, still_level: float, longest_step_s: float) -> None:
        self._still_level, self._longest_step_s = still_level, longest_step_s
        self._state: NavState | None = None
        self._still_since_hole = np.array([MANY])

    def is_sound(self) -> bool:
        """Whether its numbers have the shapes of one that has begun, and are known."""
        since, fresh = self._still_since_hole, _at_rest(np.eye(3))
        counts = since.shape == (1,) and since.dtype == int and since[0] >= 0
        state = fresh if self._state is None else self._state
        known = all(
            one.shape == other.shape and bool(np.isfinite(one).all()) for one, other in zip(state, fresh, strict=True)
        )
        return bool(counts and known and state.nav_R_body.dtype == float)

    def velocity(self, t: Floats, acc: Floats, gyr: Floats, level: Floats) -> Floats:
        """Velocity (n, 3) m/s at each of n samples; `t` (n + 1,) s has the stamp after the last one too."""
        h, hole = np.minimum(np.diff(t), self._longest_step_s), np.diff(t) > MAX_HELD_S
        still, since = level < self._still_level, self._still_since_hole
        if self._state is not None:
            return np.asarray(_continue_pass(self._state, since, acc, gyr, h, still, hole, GRAVITY_M_S2))
        falls = is_falling(acc)
        if falls.all():
            return np.zeros_like(acc)
        first = int(np.argmin(np.where(falls, np.inf, level)))
        up = level_attitude(acc[first])
        self._state = _at_rest(up)
        there, back = np.arange(first, len(acc)), np.arange(first)[::-1]
        after = _continue_pass(
            self._state, since, acc[there], gyr[there], h[there], still[there], hole[there], GRAVITY_M_S2
        )
        before = _continue_pass(
            _at_rest(up), np.array([MANY]), acc[back], gyr[back], -h[back], still[back], hole[back], GRAVITY_M_S2
        )
        return np.concatenate([before[::-1], after])


def _at_rest(nav_R_body: Floats) -> NavState:
    return NavState(np.zeros(3), np.zeros(3), nav_R_body.copy(), np.zeros(3), np.zeros(3))


@njit(cache=True)
def _continue_pass(
    state: NavState, since: Ints, acc: Floats, gyr: Floats, h: Floats, still: Bools, hole: Bools, gravity: float
) -> Floats:
    """Velocity (n, 3) at the stamp of each sample; the state goes over all of them, backward where `h` is negative.

    `since` (1,) counts the still samples since the last hole.
    """
    velocity = np.empty((len(h), 3))
    turn, push = np.empty((3, 3)), np.empty(3)
    for i in range(len(h)):
        if h[i] > 0.0:
            velocity[i] = state.velocity
        strapdown(state, acc[i], gyr[i], h[i], gravity, turn, push)
        if hole[i]:
            since[0] = 0
        elif still[i]:
            since[0] += 1
            nudge_tilt(state.nav_R_body, acc[i], max(min(abs(h[i]) / TILT_TIME_S, 1.0), 1.0 / since[0]))
        if h[i] < 0.0:
            velocity[i] = state.velocity
    return velocity
