"""Is a path to be trusted? Measured signs make one verdict and its reasons.

The verdict speaks of the path, not of the sensor. Most signs are an error that something leaves in the end of the path,
in m: what was estimated counts by what is left unknown of it, however large it is. Such a sign weighs 1 where the error
is the sigma of the result (or 1 per cent of the way, where the sigma is less), from which on the path is doubtful, and
2 at a tenth of the way, where it is of no use. Others contradict that a foot walked at all, each between two physical
limits. Between and beyond the weight is linear in the logarithm. The verdict is by the heaviest sign, and signs of
`MANY` together spoil a path as one of weight 2 does.

==================== ===============================================================================================
error, m             what is left unknown
==================== ===============================================================================================
region               95 % of it that the result itself claims: no use beyond a tenth of the way
bias                 turning about up that the solution leaves in the rests, from each to the next on a line, along the
                     way; a rest counts by what exceeds its sway. Without rests, by how much the bias about level axes,
                     which gravity shows, exceeds what the solution assumes about up
hidden turning       what clipped peaks of the rate may hide of the turning about up, one error in all peaks to the left
                     and one in all to the right; where neither field nor fixes show the heading
gravity              the scale of the accelerometer that strides show, by the distance from the start
                     (`fg_nav.verdict.limits`)
long stride          by how much it is longer than others
no footfall          what was walked, at the usual speed, before the first footfall and after the last; and between
                     them what is left of the velocity where a stance was due: after 1.6 usual swings, and 1.2 s; 2 s in
                     any case
cut                  the same of the parts of a recording that a hole cut off
unseen               the same of the gaps, half of it; the other foot sees too
==================== ===============================================================================================

==================== ======== ========= ======= =====================================================================
contradiction        unit     doubtful  no use  what it rests on
==================== ======== ========= ======= =====================================================================
footfalls            1/.      1/4       1/3     three strides or fewer are no walk
velocity             share    0.15      0.3     strapdown by the solution's attitude and bias from one footfall to the
                                                next, where the foot stands: what is left, over the fastest of the
                                                stride; half of it is missing in the stride's length. Median
open strides         share    0.2       0.5     those of which more than 0.3 is left: the foot does not stand in some
tilt                 deg      2         5       the same of the vertical: a gyroscope turns 100 deg in a swing, and a
                                                scale error of 1 per cent makes 1 deg. Median
turning              rad/s    0.8       1.2     rate in the stillest moment of a stance: a foot that stands turns by 0.1
                                                to 0.4; twice as much is let pass in a run. Median
shaking              rad/s    0.3       0.9     the rate faster than 6 Hz in stances, where a shoe on the ground has
                                                come to rest: twice as much is let pass in a run. Median
standing still       1/m      1/0.15    1/0.1   the median stride is shorter: no walk, or on the spot
speed, height rate,  -        -         -       of a person, and why: `fg_nav.verdict.limits`; of all of the path,
axes                                            before the first and after the last footfall too
climbing             m        0.5       1       height of a stride, of which one in twenty is above: stairs make 0.36
nominal rate         -        -         -       no stamps: the rate is what was said of it. Weight 0.8; its sigma is in
                                                those of places and distance
smoothed             -        100       10^4    power of the force at 1 to 4 Hz over that at 8 to 12: 3 to 25 at a foot
high-pass            nats     7         14      evidence for one in the gyroscope (`fg_nav.detection.sensor_processing`)
bad samples          share    0.005     0.05    that were not used: at 200 Hz one in every stride, or ten; others may be
                                                as wrong and not be seen
heading              deg      30        90      the solution's own sigma at the end
rate                 -        -         -       named where others speak: below 80 Hz, as a heel strikes within 20 ms
worn                 -        -         -       the turning is not that of a foot (`detection.mount`): names what it is
                                                like; a thigh is of no use
magnetometer         -        -         -       its axes contradict the gyroscope's: weight 0.8, as it is left out
height               sigma    -         -       the walk ends where it began, but not at its height by that many sigmas:
                                                weight 0.8 from 3 on, as it may be another floor
==================== ======== ========= ======= =====================================================================

Of a sensor in a pocket only those count that need no stances: unseen, cut, bad samples, the number of its strides, its
speed, its longest stride, its axes, the region and the sigma of the heading.
"""

from __future__ import annotations

import numpy as np

from fg_nav.solution import Solution, StanceTable
from fg_nav.system.spilled import drop_pages
from fg_nav.verdict.limits import (
    FAST_SHARE,
    find_height_rate,
    judge_height_rate,
    judge_position,
    judge_speed,
    judge_stride,
    judge_strides,
)
from fg_nav.verdict.reason import UNUSABLE, Verdict, Word, combine
from fg_nav.verdict.seen import Seen
from fg_nav.verdict.signs import SIGNS, SIGNS_IN_POCKET, SIGNS_WITHOUT_FOOTFALLS
from fg_nav.walk import Walk

__all__ = ["UNUSABLE", "Verdict", "Word", "combine", "judge_footfalls", "judge_path"]


def judge_path(walk: Walk, solution: Solution) -> Verdict:
    """Judge what a method made of a walk."""
    seen = Seen(walk, solution)
    if walk.options.mount == "pocket":
        signs = SIGNS_IN_POCKET
    else:
        signs = SIGNS if len(solution.stances) else SIGNS_WITHOUT_FOOTFALLS
    found = []
    for measure in signs:
        found.append(measure(seen))
        drop_pages()
    return combine([reason for reason in found if reason is not None])


def judge_footfalls(table: StanceTable) -> Verdict:
    """Judge a path of which footfalls alone are known, without samples, by the limits of a person."""
    stride, took = np.linalg.norm(np.diff(table.position, axis=0), axis=1), np.maximum(np.diff(table.t), 1e-9)
    speed, way = stride / took, float(np.hypot(*np.diff(table.position[:, :2], axis=0).T).sum())
    found = [judge_strides(len(stride), float(np.ptp(table.t)))]
    if len(stride):
        fast, sigma = (
            float(np.quantile(speed, FAST_SHARE, method="lower")),
            float(np.hypot(*table.position_sigma[-1, :2])),
        )
        worst = int(np.argmax((speed - fast) * took))
        found.append(judge_stride(stride[worst], took[worst], float(table.t[worst + 1]), fast, sigma, way))
        found.append(judge_speed(float(speed.max()), float(table.t[1 + int(np.argmax(speed))])))
    found.append(judge_height_rate(*find_height_rate(table.t, table.position[:, 2])))
    found.append(judge_position(table.position_cov[-1, :2, :2], way))
    return combine(found)
