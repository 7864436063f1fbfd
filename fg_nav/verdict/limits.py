"""Limits that no person on foot passes, and the words for what does: of a path at its end, and of each line online.

============== ======= ========= ======= ==============================================================================
quantity       unit    doubtful  no use  what it rests on
============== ======= ========= ======= ==============================================================================
speed          m/s     9         12      of the foot; a walking one reaches 6, a running one 9 to 12
stride         m       2.6       3       from footfall to footfall: 1.5 walked, 2.5 run; a missed stance doubles one
height rate    m/s     0.8       1.5     over 10 s and more: 0.5 is to run up stairs, 1 to run down
position       share   0.1       0.3     its own sigma at the end over the distance, horizontally
strides        1       1/4       1/3     one over their number
time           share   0.05      0.1     in which the foot moved on without a footfall where one was due
gravity        share   0.03      0.08    by which the vertical force of a stride, from rest to rest, is not that of
                                         gravity: of sensors 0.005 to 0.03. Median over the strides
axes           -       3         7       log of the odds of other axes of the gyroscope than those given
                                         (`detection.handedness`, in a pocket `detection.swing_axes`)
============== ======= ========= ======= ==============================================================================
"""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.detection.handedness import DECISIVE, SUSPECT, AxesEvidence
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.text import format_count
from fg_nav.verdict.reason import Reason, weigh

FEW_STRIDES = 1 / 4, 1 / 3
SEEN_BY = 20
"""Strides, of which those tested are at least a half in any ordinary walk."""

SPEED_M_S = 9.0, 12.0
STRIDE_M = 2.6, 3.0
HEIGHT_RATE_M_S = 0.8, 1.5
POSITION_SHARE = 0.1, 0.3
LOST_SHARE = 0.05, 0.1

POSITION_SHARE_IN_POCKET = 0.25, 0.5
"""Of a sensor in a pocket: the length of a step alone is known to 0.12."""

GRAVITY_SHARE = 0.03, 0.08
AXES_ODDS = SUSPECT, DECISIVE

CLIMBED_S = 10.0
"""Over which the height rate is measured: a jump, or a pole slid down, is shorter."""


def judge_strides(count: int, duration_s: float) -> Reason:
    """Judge the number of strides in a time, s."""
    words = f"no walking: {format_count(count, 'stride')} in {duration_s:.0f} s"
    return Reason(weigh(1.0 / max(count, 1), *FEW_STRIDES), words)


def judge_beginning(walked: int, tested: int) -> Reason:
    """Judge the strides of a walk in progress, and of those so many whose axes were tested: too few are doubtful.

    Where `SEEN_BY` strides were walked and none can be tested, the sensor never stands, and shows nothing of its axes.
    """
    known = walked if walked >= SEEN_BY else min(walked, tested)
    few = weigh(1.0 / max(known, 1), *FEW_STRIDES) >= 1.0
    return Reason(float(few), f"too little has been walked to know: {format_count(walked, 'stride')}")


def judge_speed(speed: float, t: float) -> Reason:
    """Judge the highest speed, m/s, at time t, s."""
    return Reason(weigh(speed, *SPEED_M_S), f"the foot reaches {speed:.0f} m/s, at {t:.1f} s")


def judge_stride(length: float, t: float, in_pocket: bool = False) -> Reason:
    """Judge the longest stride, m, that ends at time t, s."""
    why = "no legs open so far" if in_pocket else "stances were missed, or it drifted"
    words = f"a stride of {length:.1f} m, at {t:.1f} s: {why}"
    return Reason(weigh(length, *STRIDE_M), words)


def judge_height_rate(rate: float, t: float) -> Reason:
    """Judge the highest rate of the height, m/s, over `CLIMBED_S` up to time t, s."""
    words = f"it climbs or falls by {rate:.1f} m/s for {CLIMBED_S:.0f} s and more, up to {t:.1f} s"
    return Reason(weigh(rate, *HEIGHT_RATE_M_S), words)


def judge_position(
    sigma: float, distance: float, limits: tuple[float, float] = POSITION_SHARE, least_m: float = 1.0
) -> Reason:
    """Judge the sigma of the end, m, after a distance, m; one below `least_m` is judged as if it were that."""
    words = f"the end is known to {sigma:.1f} m only, after {distance:.0f} m"
    return Reason(weigh(sigma / max(distance, least_m), *limits), words)


def judge_lost_time(lost_s: float, duration_s: float) -> Reason:
    """Judge the time without a footfall, s, of a recording, s."""
    words = f"{lost_s:.1f} s of motion without a footfall: strides were missed"
    return Reason(weigh(lost_s / max(duration_s, 1e-9), *LOST_SHARE), words)


def judge_gravity(gravity: float) -> Reason:
    """Judge the mean vertical force of the strides, m/s^2."""
    words = f"gravity is {gravity:.2f} m/s^2 in the strides, not {GRAVITY_M_S2:.2f}: the accelerometer's scale or unit"
    return Reason(weigh(abs(gravity / GRAVITY_M_S2 - 1.0), *GRAVITY_SHARE), words)


def judge_axes(seen: AxesEvidence) -> Reason:
    """Judge the axes of the gyroscope by what strides show of them."""
    return Reason(weigh(seen.against, *AXES_ODDS), seen.problem)


def find_height_rate(t: Floats, height: Floats) -> tuple[float, float]:
    """Highest rate, m/s, of a height (K,) m at stamps (K,) s over the first that is `CLIMBED_S` back, and when."""
    since = np.searchsorted(t, t - CLIMBED_S, side="right") - 1
    known = since >= 0
    if not known.any():
        return 0.0, float(t[-1]) if len(t) else 0.0
    rate = np.abs(height[known] - height[since[known]]) / (t[known] - t[since[known]])
    worst = int(np.argmax(rate))
    return float(rate[worst]), float(t[known][worst])
