"""Whether the path of a walk in progress is to be trusted up to a line: by what is wrong with it so far.

The limits are those of `fg_nav.verdict.limits`. A path that was spoiled stays so, and none is trusted before it has as
many strides as make a walk, and the axes were seen in as many.

Between two lines a new solution may move the map. A stride is measured within one map: where the past was revised, from
its newest footfall in the new map; where the revision does not include it, the stride to the next line is not measured.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.online.estimates import Revision, StanceEstimate
from fg_nav.online.source_check import AxesCheck
from fg_nav.verdict.limits import (
    Reason,
    Verdict,
    combine,
    find_height_rate,
    judge_axes,
    judge_beginning,
    judge_gravity,
    judge_height_rate,
    judge_position,
    judge_rate,
    judge_speed,
    judge_stride,
    judge_unfollowed,
)

DUE_S = 4.0  # To the next line at most: a standing has one every two seconds.
MIN_STRIDES = 5  # Of which the median of gravity is judged.
N_FASTEST = 4  # Strides, by the slowest of which the fastest is judged: who begins to run makes more of them.
MAX_HEIGHTS = 32  # More than are made in the time over which their rate is measured.
SAME_S = 1e-3  # Stamps of one footfall, of any clock: less than a sample apart.

Judged: TypeAlias = tuple[StanceEstimate | Revision, Verdict | None]  # A line of a walk; the verdict on an estimate.


class LineVerdict:
    """Judges the lines of a walk, in their order; `axes` of its samples.

    Parameters
    ----------
    in_pocket : whether the sensor is in a pocket: a line is then two steps, and places are less certain.
    remark : as of `AxesCheck`.
    rate_sigma : of a nominal sample rate, a share of it; 0 where rows have stamps.
    """

    def __init__(
        self,
        in_pocket: bool = False,
        remark: Callable[[str], None] = lambda words: None,
        rate_sigma: float = 0.0,
    ) -> None:
        self._in_pocket, self._rate_sigma = in_pocket, rate_sigma
        self.axes = AxesCheck(remark, "pocket" if in_pocket else "foot")
        self._begun: float | None = None
        self._last = np.zeros(4)  # t, east, north, up of the newest footfall
        self._distance, self._lost_s, self._strides = 0.0, 0.0, 0
        self._steepest, self._reach = (0.0, 0.0), 0.0
        self._fast = np.zeros((0, 3))  # Speed, time and end of the fastest strides, the fastest first.
        self._heights = np.zeros((0, 2))

    def judge(self, found: Sequence[StanceEstimate | Revision], continues: Sequence[bool]) -> list[Judged]:
        """Return the lines, each estimate with the verdict on the path up to it; `continues` is that of all lines."""
        judged: list[Judged] = []
        for one in found:
            if isinstance(one, Revision):
                is_newest = len(one.path) > 0 and abs(one.path[-1, 0] - self._last[0]) < SAME_S
                self._last = one.path[-1] if is_newest else np.full(4, np.nan)
                judged.append((one, None))
            else:
                self._measure(np.append(one.t, one.position), continues[one.number])
                judged.append((one, combine(self._list_reasons(one.pose_cov[:2, :2]))))
        return judged

    def _measure(self, now: Floats, continues: bool) -> None:
        """Measure the stride to a footfall, of which t, east, north, up (4,) are given."""
        before, self._last = self._last, now
        if self._begun is None:
            self._begun, self._heights = float(now[0]), now[None, [0, 3]]
            return
        self._strides += not continues
        took, moved = float(now[0] - before[0]), float(np.linalg.norm(now[1:] - before[1:]))
        if not (took > 0.0 and np.isfinite(moved)):
            return
        self._distance += moved
        self._lost_s += took if took > DUE_S and not continues else 0.0
        self._reach = max(self._reach, float(np.hypot(*before[1:3])))
        fast = np.vstack([self._fast, [moved / took, took, now[0]]])
        self._fast = fast[np.argsort(-fast[:, 0], kind="stable")][:N_FASTEST]
        height = self._heights[-1, 1] + float(now[3] - before[3])
        self._heights = np.vstack([self._heights, [now[0], height]])[-MAX_HEIGHTS:]
        self._steepest = max(self._steepest, find_height_rate(*self._heights.T))

    def _list_reasons(self, covariance: Floats) -> list[Reason]:
        assert self._begun is not None
        axes, way, sigma = self.axes.evidence, self._distance, float(np.sqrt(np.trace(covariance)))
        found = [judge_position(covariance, way, self._in_pocket), judge_axes(axes), judge_rate(self._rate_sigma)]
        if len(self._fast):
            speed, took, end = map(float, self._fast[0])
            found.append(judge_speed(speed, end))
            if len(self._fast) == N_FASTEST:
                found.append(judge_stride(speed * took, took, end, float(self._fast[-1, 0]), sigma, way))
        if self._in_pocket:
            return found
        found.append(judge_height_rate(*self._steepest))
        found.append(judge_beginning(self._strides, axes.strides))
        usual = way / max(float(self._last[0]) - self._begun, 1e-9) if self._strides else 0.0
        words = f"{self._lost_s:.1f} s of motion without a footfall"
        found.append(judge_unfollowed(self._lost_s, usual, sigma, way, words))
        if axes.strides >= MIN_STRIDES:
            found.append(judge_gravity(float(np.median(axes.gravity)), self._reach, sigma, way))
        return found
