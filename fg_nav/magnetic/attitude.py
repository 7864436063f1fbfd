"""Attitude from the gyroscope alone, held upright by the stances: good to a degree of tilt, its heading drifts.

    begin        level in the first stance; the gyro bias is that of the longest rest, or nothing
    each sample  R <- R Exp((w - b) h); in stance, nudge the tilt towards the specific force

It exists so that the field can be judged before any estimator has run, the same for all of them. It looks at the whole
recording for its longest rest, so a live estimator gives `footfall_field` the attitude that it has at the time.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from fg_nav.arrays import Bools, Floats
from fg_nav.mechanisation import nudge_tilt, rotate_in_body
from fg_nav.recording import Recording
from fg_nav.stances import Stances
from fg_nav.start import starting_point

TILT_TIME_S = 0.5
"""Time in stance in which the tilt follows the specific force; 0.25 to 2 s differ by 0.1 deg on simulated walks."""


def inertial_attitude(recording: Recording, stances: Stances, heading: float = 0.0) -> Floats:
    """Attitude nav_R_body (N, 3, 3), with this heading (rad clockwise from north) of the body's x axis at the start.

    Raises
    ------
    EstimationError
        Without a stance, on stances of another recording, or where the specific force vanishes.
    """
    start = starting_point(recording, stances, heading)
    longest = max(start.rests, key=lambda rest: rest.stop - rest.start, default=None)
    bias = np.zeros(3) if longest is None else longest.rate
    return _tracked(
        recording.t, recording.acc, recording.gyr, stances.mask, start.nav_R_body, start.row, bias, TILT_TIME_S
    )


@njit(cache=True)
def _tracked(
    t: Floats, acc: Floats, gyr: Floats, stands: Bools, nav_R_body: Floats, row: int, bias: Floats, tilt_time: float
) -> Floats:
    """Attitudes (N, 3, 3) from that at sample `row`; those before it are reached by stepping backward."""
    attitude = np.empty((len(t), 3, 3))
    R = nav_R_body.copy()
    attitude[row] = R
    for i in range(row, len(t) - 1):
        _turn(R, gyr[i], bias, t[i + 1] - t[i])
        if stands[i + 1]:
            nudge_tilt(R, acc[i + 1], min((t[i + 1] - t[i]) / tilt_time, 1.0))
        attitude[i + 1] = R
    R = nav_R_body.copy()
    for i in range(row - 1, -1, -1):
        _turn(R, gyr[i], bias, t[i] - t[i + 1])
        attitude[i] = R
    return attitude


@njit(cache=True)
def _turn(R: Floats, rate: Floats, bias: Floats, h: float) -> None:
    rotate_in_body(R, (rate[0] - bias[0]) * h, (rate[1] - bias[1]) * h, (rate[2] - bias[2]) * h)
