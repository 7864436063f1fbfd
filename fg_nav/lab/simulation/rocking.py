"""How a loaded foot rocks on its sole, to and fro about the point of the floor beneath the sensor.

In a stance, or while a person stands and shifts his weight, roll, pitch and yaw pass by ramps through angles

    theta_j ~ N(0, (c w rate)^2),    j = 1, 2, ...,    theta_0 = 0,

c for each axis (`SHARES`), w the mean length of a ramp. They turn at instants of their own, the first of which lies
before the stance, so that the foot is hardly ever still about all three. What is left at the end is taken back in the
next swing. These angles (rad) turn the foot about its pivot; for the sensor to turn about the point q of the floor
beneath it (foot frame, m, from the pivot), the pivot moves by

    -theta x q.

That is exact motion of the foot, and leaves q in place up to |q| theta^2 / 2, some 0.01 mm.

Feet turn at 7 to 18 deg/s at their stillest instant with a sensor on the instep, which goes along with the shin (gdin).
That a module in the heel rocks by what the lower end of that range leaves is assumed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.lab.simulation.steps import PAUSE_S, Moves, Steps, join_moves, rotate_to_level

PIECE_S = 0.18
"""From one turning point to the next: a foot rocks to and fro in about a third of a second (gdin: 2 to 4 Hz)."""

RAMP_SLOPE = 1.28  # Rms slope of a ramp over its mean slope: 140 sqrt(B(7, 7)).
SHARES = 0.65, 0.65, 0.4  # Of roll, pitch and yaw in the rate: the loaded sole turns least about the vertical.
JITTER = 0.25  # Ramps are shorter or longer by up to this share.
BACK = 0.10, 0.60  # Shares of the next swing between which the angle that is left is taken back.


def draw_rocking(
    steps: Steps, stance_rad_s: float, standing_rad_s: float, beneath_m: Sequence[float], rng: np.random.Generator
) -> Mapping[str, Moves]:
    """Moves of `east`, `north`, `up`, `roll`, `pitch` and `yaw` by which the foot rocks.

    Parameters
    ----------
    steps : of the foot.
    stance_rad_s, standing_rad_s : rms rate over all axes in the stances between strides, and in longer ones.
    beneath_m : q above, x and y.
    rng : draws angles and instants.
    """
    loaded = steps.pauses
    rate = np.where(loaded[:, 1] - loaded[:, 0] < PAUSE_S, stance_rad_s, standing_rad_s)
    loaded[1:, 0] = steps.strides.start + steps.swing_s
    rocks = np.flatnonzero((loaded[:, 1] > loaded[:, 0]) & (rate > 0))
    drawn = [_draw_stance(steps, k, loaded[k], rate[k], rng) for k in map(int, rocks)]
    roll, pitch, yaw = (join_moves([moves[axis] for moves in drawn]) for axis in range(3))
    heading = np.repeat(steps.strides.heading[rocks], [len(moves[2].rise) for moves in drawn])
    x, y = beneath_m
    level = rotate_to_level(heading, y * yaw.rise, -x * yaw.rise)
    return {
        "east": yaw._replace(rise=level[:, 0]),
        "north": yaw._replace(rise=level[:, 1]),
        "up": join_moves([pitch._replace(rise=x * pitch.rise), roll._replace(rise=-y * roll.rise)]),
        "roll": roll,
        "pitch": pitch,
        "yaw": yaw,
    }


def _draw_stance(
    steps: Steps, index: int, span: Floats, rate_rad_s: float, rng: np.random.Generator
) -> Sequence[Moves]:
    """Roll, pitch and yaw of one stance (2,) s, and the way back in the swing after it, if there is one."""
    moves = []
    for share in SHARES:
        width = PIECE_S * rng.uniform(1 - JITTER, 1 + JITTER, 2 + int((span[1] - span[0]) / (PIECE_S * (1 - JITTER))))
        start = span[0] - rng.random() * width[0] + np.cumsum(width) - width
        angle = share * rate_rad_s * PIECE_S / (np.sqrt(2) * RAMP_SLOPE) * rng.standard_normal(len(width))
        inside = start < span[1]
        start, width, rise = start[inside], width[inside], np.diff(angle[inside], prepend=0.0)
        if index < len(steps):
            leave, land = span[1] + np.array(BACK) * steps.swing_s[index]
            start, width, rise = np.append(start, leave), np.append(width, land - leave), np.append(rise, -rise.sum())
        moves.append(Moves(start, width, rise))
    return moves
