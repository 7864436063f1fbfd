"""Is a path to be trusted? Measured signs, each with a physical limit, make one verdict and its reasons.

A sign is one number that a recording and its solution show. It weighs 1 at its limit, from which on the path is
doubtful, and 2 where that alone makes it of no use; between and beyond the weight is linear in the logarithm. The
verdict is by the heaviest sign, and signs of `MANY` together spoil a path as one of weight 2 does.

==================== ======== ========= ======= =====================================================================
sign                 unit     doubtful  no use  what it rests on
==================== ======== ========= ======= =====================================================================
footfalls            1/.      1/4       1/3     three strides or fewer are no walk
velocity             share    0.15      0.3     strapdown by the solution's attitude and bias from one footfall to the
                                                next, where the foot stands: what is left, over the fastest of the
                                                stride; half of it is missing in the stride's length. Median
open strides         share    0.2       0.5     those of which more than 0.3 is left: the foot does not stand in some
tilt                 deg      2         5       the same of the vertical: a gyroscope turns 100 deg in a swing, and a
                                                scale error of 1 per cent makes 1 deg. Median
turning              rad/s    0.8       1.2     rate in the stillest moment of a stance: a foot that stands turns by 0.1
                                                to 0.4, one that runs by 0.7. Median
shaking              rad/s    0.3       0.9     the rate faster than 6 Hz in stances, where a shoe on the ground has
                                                come to rest: twice as much is let pass in a run. Median
no footfall          share    0.05      0.1     time in which the foot moved on without a stance where one was due:
                                                after 1.6 usual swings, and 1.2 s; 2 s in any case
standing still       1/m      1/0.15    1/0.1   the median stride is shorter: no walk, or on the spot
speed, stride,        -        -         -       of a person, and why: `fg_nav.verdict.limits`; of all of the path,
height rate, gravity,                           before the first and after the last footfall too
axes
climbing             m        0.5       1       height of a stride, of which one in twenty is above: stairs make 0.36
clipping             share    0.05      0.15    time in which a sensor is at the end of its range, of that in which the
                                                foot swings: what is rebuilt there is a guess
gyro bias            deg/s    1         3       of sensors that were calibrated once, 0.1 to 0.5
rate                 s        1/80      1/40    a heel strikes within 20 ms
nominal rate         -        -         -       no stamps: the rate is what was said of it. Weight 0.8; its sigma is in
                                                those of places and distance
smoothing            share    0.004     1e-5    power at 8 to 14 Hz over that at 0.5 to 4 Hz, geometric mean of force
                                                and rate: of a foot 0.03 and more, behind a low-pass of 10 Hz 0.008, of
                                                5 Hz 0.002 and less
bad samples          share    0.005     0.05    that were not used: at 200 Hz one in every stride, or ten; others may be
                                                as wrong and not be seen
unseen               s        0.1       0.5     the longest gap: a foot turns by 2 rad/s in it
heading              deg      30        90      the solution's own sigma at the end
hidden turning       sigma    2         3       of the heading, and 2 deg: what clipped peaks of the rate may hide of
                                                the turning about up, one error in all peaks to the left and one in all
                                                to the right; where neither field nor fixes show the heading
position             -        -         -       the same over the distance (`fg_nav.verdict.limits`)
worn                 -        -         -       the turning is not that of a foot (`detection.mount`): names what it is
                                                like; a thigh is of no use
magnetometer         -        -         -       its axes contradict the gyroscope's: weight 0.8, as it is left out
height               sigma    -         -       the walk ends where it began, but not at its height by that many sigmas:
                                                weight 0.8 from 3 on, as it may be another floor
==================== ======== ========= ======= =====================================================================

Of a sensor in a pocket only those count that need no footfalls, its speed, its longest stride, its axes and the sigmas
of place and heading.
"""

from __future__ import annotations

import numpy as np

from fg_nav.solution import Solution, StanceTable
from fg_nav.system.spilled import drop_pages
from fg_nav.verdict.limits import (
    find_height_rate,
    judge_height_rate,
    judge_position,
    judge_speed,
    judge_stride,
    judge_strides,
)
from fg_nav.verdict.reason import UNUSABLE, Verdict, Word, combine
from fg_nav.verdict.seen import Seen
from fg_nav.verdict.signs import SIGNS, SIGNS_IN_POCKET, SIGNS_WITHOUT_FOOTFALLS, count_footfalls
from fg_nav.walk import Walk

__all__ = ["UNUSABLE", "Verdict", "Word", "combine", "judge_footfalls", "judge_path"]


def judge_path(walk: Walk, solution: Solution) -> Verdict:
    """Judge what a method made of a walk."""
    seen = Seen(walk, solution)
    if walk.options.mount == "pocket":
        signs = SIGNS_IN_POCKET
    else:
        signs = SIGNS if len(solution.stances) else (count_footfalls, *SIGNS_WITHOUT_FOOTFALLS)
    found = []
    for measure in signs:
        found.append(measure(seen))
        drop_pages()
    return combine([reason for reason in found if reason is not None])


def judge_footfalls(table: StanceTable) -> Verdict:
    """Judge a path of which footfalls alone are known, without samples, by the limits of a person."""
    stride = np.linalg.norm(np.diff(table.position, axis=0), axis=1)
    speed = stride / np.maximum(np.diff(table.t), 1e-9)
    found = [judge_strides(len(stride), float(np.ptp(table.t)))]
    for judge, values in ((judge_stride, stride), (judge_speed, speed)):
        if len(values):
            found.append(judge(float(values.max()), float(table.t[1 + int(np.argmax(values))])))
    found.append(judge_height_rate(*find_height_rate(table.t, table.position[:, 2])))
    found.append(judge_position(float(np.hypot(*table.position_sigma[-1, :2])), float(stride.sum())))
    return combine(found)
