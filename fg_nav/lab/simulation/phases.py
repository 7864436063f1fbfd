"""How the foot's coordinates move through a stride: the curves that all strides of a manner share.

Each coordinate is a sum of ramps. A *phase* is a set of ramps (begin, end, weight) in shares of the swing, 0 at
heel-off and 1 at foot-flat; its weights sum to 1 (to 0 where it comes back). A share below 0 or above 1 reaches into
the stance before or after: foot-flat is nominal, and what is true is from `LANDED_AT` to `LEAVES_AT`. The tables are
round figures for the median curve of ten real walks with a sensor on the instep; scaled by duration, length and angles,
those walks lie on one curve within a few per cent.

=========== ======== ==================================================================================================
PUSH        pitch    heel-off: slowly at first, then the toe points down
FALL        pitch    the toe comes up again, through the whole swing
LAND        pitch    from heel strike to foot-flat, fast at first
LIFT        height   up with the heel
DROP        height   down to where the foot passes the other leg
RAISE       height   up again with the toe
SET_DOWN    height   to the floor
FORWARD     place    a slight roll back on the toe, then the swing to the next footprint
ASIDE       place    outward, round the other leg, and back
INVERT_OFF  roll     the sole turns inward at push-off
INVERT_ON   roll     and again as the heel comes down
TOE_OUT     yaw      the toe turns outward at push-off, and back through the swing
TOE_IN      yaw      the toe turns to and fro at heel strike
TURN        yaw      into the next direction
PRESS       height   the load of the body presses the sole together
SPRING      height   the sole springs back as the foot unloads
SETTLE      pitch    what is left of landing, slowly
ROLL_OVER   pitch    the foot rolls forward in stance (in shares of the stance)
STIR        pitch    slowly up to heel-off
LEAN        roll,yaw the loaded foot leans over and back (in shares of the stance)
SLIP        place    the foot slips in stance, mostly early (in shares of the stance)
=========== ======== ==================================================================================================
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from fg_nav.arrays import Floats

Phase: TypeAlias = tuple[tuple[float, float, float], ...]
"""Ramps as (begin, end, weight)."""

PUSH: Phase = ((-0.08, 0.29, 0.12), (0.00, 0.39, 0.36), (0.09, 0.38, 0.52))
FALL: Phase = ((0.26, 0.55, 0.11), (0.36, 0.73, 0.38), (0.52, 0.89, 0.34), (0.56, 0.99, 0.17))
LAND: Phase = ((0.80, 1.04, 0.60), (0.84, 1.13, 0.40))

LIFT: Phase = ((0.03, 0.53, 0.61), (0.17, 0.41, 0.39))
DROP: Phase = ((0.31, 0.75, 1.00),)
RAISE: Phase = ((0.60, 0.91, 0.67), (0.70, 0.85, 0.33))
SET_DOWN: Phase = ((0.74, 1.14, 0.66), (0.83, 1.01, 0.34))

FORWARD: Phase = (
    (-0.01, 0.29, -0.01),
    (0.19, 0.49, 0.115),
    (0.27, 0.73, 0.38),
    (0.44, 0.95, 0.48),
    (0.57, 1.09, 0.035),
)
ASIDE: Phase = ((0.00, 0.35, -0.22), (0.41, 0.77, 1.00), (0.66, 1.07, -0.78))

INVERT_OFF: Phase = ((-0.04, 0.23, 0.40), (0.07, 0.30, 0.60), (0.24, 0.42, -1.00))
INVERT_ON: Phase = ((0.58, 0.92, 0.20), (0.76, 0.88, 0.46), (0.83, 1.00, -0.66))
TOE_OUT: Phase = ((0.27, 0.40, -1.00), (0.30, 0.63, 0.45), (0.62, 0.87, 0.55))
TOE_IN: Phase = ((0.64, 0.84, 0.45), (0.77, 0.89, -0.75), (0.90, 1.00, 0.30))
TURN: Phase = ((0.15, 0.90, 1.00),)

PRESS: Phase = ((0.80, 1.71, 1.00),)
SPRING: Phase = ((0.10, 0.35, 1.00),)

SETTLE: Phase = ((0.90, 1.44, 1.00),)
STIR: Phase = ((-0.36, 0.24, 1.00),)
ROLL_OVER: Phase = ((-0.40, 0.80, 0.50), (0.20, 1.40, 0.50))
LEAN: Phase = ((-0.30, 0.50, 1.00), (0.30, 1.30, -1.00))
SLIP: Phase = ((-0.10, 0.70, 1.00),)

_SWINGING = (
    PUSH,
    FALL,
    LAND,
    LIFT,
    DROP,
    RAISE,
    SET_DOWN,
    FORWARD,
    ASIDE,
    INVERT_OFF,
    INVERT_ON,
    TOE_OUT,
    TOE_IN,
    TURN,
)
"""All but those of the loaded foot, which rolls on, leans, slips and sinks while it is flat."""

LEAVES_AT = min(begin for phase in _SWINGING for begin, _, _ in phase)
LANDED_AT = max(end for phase in _SWINGING for _, end, _ in phase)
"""Where the first of these begins and the last one ends: the foot is flat from landing to the next leaving."""

TOE_DOWN_AT, HEEL_STRIKE_AT = 0.33, 0.86
"""When the pitch is greatest, and when it is least."""

CLEAR_AT, PASSING_AT, HIGH_HEEL_AT = 0.41, 0.66, 0.84
"""When the pivot is highest, lowest in mid-swing, and highest again."""


def moved_by(phase: Phase, share: Floats) -> Floats:
    """What a phase has moved by (N,) at shares of the swing (N,)."""
    begin, end, weight = np.array(phase).T
    u = np.clip((share[:, None] - begin) / (end - begin), 0.0, 1.0)
    step = u**4 * (35 - u * (84 - u * (70 - 20 * u)))
    return np.asarray(step @ weight)


def rises(phases: Sequence[Phase], closing: Phase, at: Sequence[float], values: Floats) -> Floats:
    """Rises (P + 1, K) of the phases and of a closing one that takes all back, so that the sum passes through `values`.

    The sum is `values` (P, K) at the P shares `at`: phases overlap, and a rise alone is not what is reached.
    """
    shares = np.array(at)
    back = moved_by(closing, shares)
    matrix = np.stack([moved_by(phase, shares) - back for phase in phases], axis=1)
    free = np.linalg.solve(matrix, values)
    return np.vstack([free, -free.sum(axis=0)])


def pitch_rises(toe_down: Floats, toe_up: Floats) -> Floats:
    """Rises (3, K) of PUSH, LAND and FALL for the pitch (K,) rad after push-off and, upward, at heel strike."""
    return rises((PUSH, LAND), FALL, (TOE_DOWN_AT, HEEL_STRIKE_AT), np.stack([toe_down, -toe_up]))


def lift_rises(clearance: Floats, midswing: Floats, heel: Floats) -> Floats:
    """Rises (4, K) of LIFT, RAISE, SET_DOWN and DROP for the heights (K,) m at the instants above."""
    heights = np.stack([clearance, midswing, heel])
    return rises((LIFT, RAISE, SET_DOWN), DROP, (CLEAR_AT, PASSING_AT, HIGH_HEEL_AT), heights)
