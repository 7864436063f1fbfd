"""Whether a path is to be trusted: measured signs make one verdict and its reasons.

The verdict is on the path, not on the sensor. Most signs are an error of the end of the path, m; an estimated quantity
counts by its remaining uncertainty, not by its size. Such a sign weighs 1 where the error is the sigma of the result
(or 1 per cent of the way, where the sigma is less), from which on the path is doubtful, and 2 at a tenth of the way,
from which on it is of no use. Others contradict walking itself, each between two physical limits. Between and beyond
the weight is linear in the logarithm. The heaviest sign decides, and signs of `MANY` together spoil a path as one of
weight 2 does.

==================== ===============================================================================================
error, m             measure
==================== ===============================================================================================
region               claimed 95 % region of the end: no use beyond a tenth of the way
bias                 turning about up that the solution leaves in the rests, linear between them, along the way; a rest
                     counts by its excess over its sway. Without rests, the excess of the bias about level axes, which
                     gravity shows, over the solution's prior about up
hidden turning       turning about up in clipped peaks of the rate, one error in all peaks to the left and one in all to
                     the right; where neither field nor fixes show the heading
gravity              scale of the accelerometer in the strides, times the distance from the start
                     (`fg_nav.verdict.limits`)
long stride          its excess over the others
no footfall          motion, at the usual speed, before the first footfall and after the last; between them the residual
                     velocity where a stance was due: after 1.6 usual swings, and 1.2 s; 2 s in any case
cut                  motion, at the usual speed, in the parts of a recording that a hole cut off
unseen               half of it in the gaps; the other foot sees too
==================== ===============================================================================================

==================== ======== ========= ======= =====================================================================
contradiction        unit     doubtful  no use  basis
==================== ======== ========= ======= =====================================================================
footfalls            1/.      1/4       1/3     three strides or fewer are no walk
velocity             share    0.15      0.3     strapdown with the solution's attitude and bias from one footfall to
                                                the next: residual velocity over the fastest of the stride, half of
                                                which is an error of the stride's length. Median
open strides         share    0.2       0.5     strides with a residual of more than 0.3: no stance in some of them
tilt                 deg      2         5       the same of the vertical: a gyroscope turns 100 deg in a swing, and a
                                                scale error of 1 per cent makes 1 deg. Median
turning              rad/s    0.8       1.2     rate in the stillest moment of a stance: 0.1 to 0.4 of a standing foot;
                                                twice the limits in a run. Median
shaking              rad/s    0.3       0.9     rate above 6 Hz in stances, where a shoe on the ground has come to
                                                rest; twice the limits in a run. Median
standing still       1/m      1/0.15    1/0.1   the median stride is shorter: no walk, or on the spot
speed, height rate,  -        -         -       of a person, and why: `fg_nav.verdict.limits`; of the whole path,
axes                                            before the first and after the last footfall too
climbing             m        0.5       1       95 % quantile of the height of a stride: stairs make 0.36
nominal rate         -        -         -       no stamps: the rate is nominal. Weight 0.8; its sigma is in those of
                                                positions and distance
smoothed             -        100       10^4    power of the force at 1 to 4 Hz over that at 8 to 12: 3 to 25 at a foot
high-pass            nats     7         14      evidence for one in the gyroscope (`fg_nav.detection.sensor_processing`)
bad samples          share    0.005     0.05    unused ones: at 200 Hz one in every stride, or ten; others may be as
                                                wrong and unnoticed
heading              deg      30        90      the solution's own sigma at the end
rate                 -        -         -       named beside other signs: below 80 Hz, as a heel strikes within 20 ms
worn                 -        -         -       the turning is not that of a foot (`detection.mount`): names its like;
                                                a thigh is of no use
magnetometer         -        -         -       its axes contradict the gyroscope's: weight 0.8, as it is left out
height               sigma    -         -       a closed walk ends at another height by that many sigmas: weight 0.8
                                                from 3 on, as it may be another floor
==================== ======== ========= ======= =====================================================================

In a pocket only signs that need no stances count: unseen, cut, bad samples, number of strides, speed, longest stride,
axes, region and sigma of the heading.
"""

from __future__ import annotations

import numpy as np

from fg_nav.solution import Solution, StanceTable
from fg_nav.verdict.limits import (
    FAST_SHARE,
    UNUSABLE,
    Verdict,
    Word,
    combine,
    find_height_rate,
    judge_height_rate,
    judge_position,
    judge_speed,
    judge_stride,
    judge_strides,
)
from fg_nav.verdict.signs import SIGNS, SIGNS_IN_POCKET, SIGNS_WITHOUT_FOOTFALLS, WalkSigns
from fg_nav.walk import Walk

__all__ = ["UNUSABLE", "Verdict", "Word", "combine", "judge_footfalls", "judge_path"]


def judge_path(walk: Walk, solution: Solution) -> Verdict:
    """Judge the solution of a walk by all signs that apply to its mount; return word and reasons."""
    observed = WalkSigns(walk, solution)
    if walk.options.mount == "pocket":
        signs = SIGNS_IN_POCKET
    else:
        signs = SIGNS if len(solution.stances) else SIGNS_WITHOUT_FOOTFALLS
    found = [measure(observed) for measure in signs]
    return combine([reason for reason in found if reason is not None])


def judge_footfalls(table: StanceTable) -> Verdict:
    """Judge a path by its footfalls alone, without samples, by the limits of a person."""
    stride, took = np.linalg.norm(np.diff(table.position, axis=0), axis=1), np.maximum(np.diff(table.t), 1e-9)
    speed, way = stride / took, float(np.hypot(*np.diff(table.position[:, :2], axis=0).T).sum())
    found = [judge_strides(len(stride), float(np.ptp(table.t)))]
    if len(stride):
        fast = float(np.quantile(speed, FAST_SHARE, method="lower"))
        sigma = float(np.hypot(*table.position_sigma[-1, :2]))
        worst = int(np.argmax((speed - fast) * took))
        found.append(judge_stride(stride[worst], took[worst], float(table.t[worst + 1]), fast, sigma, way))
        found.append(judge_speed(float(speed.max()), float(table.t[1 + int(np.argmax(speed))])))
    found.append(judge_height_rate(*find_height_rate(table.t, table.position[:, 2])))
    found.append(judge_position(table.position_cov[-1, :2, :2], way))
    return combine(found)
