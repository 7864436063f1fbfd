"""Is the path of a walk in progress to be trusted up to this line? Each line says so, by the limits of a person.

What counts, with its limits, is in `fg_nav.verdict.limits`: the longest stride and the highest speed from line to line,
the highest rate of the height, the time without a footfall, the sigma of the place over the distance, and what strides
show of the axes and of gravity (`axes_check`). A path that was spoiled stays so, and one is not trusted before as many
strides were walked as make a walk, and the axes were seen in as many.

Between two lines the walk may be solved again, and its map move. A stride is measured within one map: where the past
was revised, from its newest footfall in the new map; where the revision does not know it, the stride to the next line
is not measured.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.online.axes_check import AxesCheck
from fg_nav.online.buffer import SampleBuffer
from fg_nav.online.estimates import StanceEstimate
from fg_nav.online.revision import Revision
from fg_nav.verdict.limits import (
    POSITION_SHARE,
    POSITION_SHARE_IN_POCKET,
    find_height_rate,
    judge_axes,
    judge_beginning,
    judge_gravity,
    judge_height_rate,
    judge_lost_time,
    judge_position,
    judge_speed,
    judge_stride,
)
from fg_nav.verdict.reason import Reason, Verdict, combine

DUE_S = 4.0
"""The line of a footfall comes at least so soon after the one before it: a standing has one every two seconds."""

JUDGED_S = 60.0
"""Of a shorter walk no share of the time is judged, but that of so much."""

JUDGED_M = 10.0
"""Of a shorter way the sigma of the place is judged over so much: seven strides, and 0.2 m are no doubt after one."""

FEWEST = 5
"""Strides of which the median of gravity is judged."""

REMEMBERED = 32
"""Heights, more than are made in the time over which their rate is measured."""

SAME_S = 1e-3
"""Stamps of one footfall, of any clock: less than a sample apart."""

Judged: TypeAlias = tuple[StanceEstimate | Revision, Verdict | None]
"""What a walk tells, and the verdict on an estimate."""


class LineVerdict:
    """Judges the lines of a walk, in their order.

    Parameters
    ----------
    in_pocket : whether the sensor is in a pocket: a line is then two steps, and places are less certain.
    remark, refuses : as of `AxesCheck`.
    """

    def __init__(
        self,
        in_pocket: bool = False,
        remark: Callable[[str], None] = lambda words: None,
        refuses: bool = True,
    ) -> None:
        self._in_pocket = in_pocket
        self._axes = AxesCheck(remark, refuses, "pocket" if in_pocket else "foot")
        self._begun: float | None = None
        self._last = np.zeros(4)  # t, east, north, up of the newest footfall
        self._distance, self._lost_s, self._strides = 0.0, 0.0, 0
        self._longest, self._fastest, self._steepest = (0.0, 0.0), (0.0, 0.0), (0.0, 0.0)
        self._heights = np.zeros((0, 2))

    def look_at(self, buffer: SampleBuffer) -> None:
        """Look at the axes of the samples that have come; raises `RecordingError` as `AxesCheck` does."""
        self._axes.look_at(buffer)

    def judge(self, found: Sequence[StanceEstimate | Revision], continues: Sequence[bool]) -> list[Judged]:
        """Put to each estimate the verdict on the path up to it; `continues` of all lines of the walk."""
        return [(one, self._judge(one, continues)) for one in found]

    def state(self) -> dict[str, Any]:
        """Return what `resume` needs, as JSON values."""
        numbers = (self._distance, self._lost_s, *self._longest, *self._fastest, *self._steepest)
        return {
            "begun": self._begun,
            "last": self._last.tolist(),
            "numbers": [float(one) for one in numbers],
            "heights": self._heights.tolist(),
            "strides": self._strides,
            "axes": self._axes.state(),
        }

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on where another verdict on the same walk was."""
        self._begun = None if state["begun"] is None else float(state["begun"])
        self._last = np.array(state["last"], dtype=float).reshape(4)
        self._distance, self._lost_s, *worst = map(float, state["numbers"])
        self._longest, self._fastest, self._steepest = zip(worst[::2], worst[1::2], strict=True)
        self._heights = np.array(state["heights"], dtype=float).reshape(-1, 2)
        self._strides = int(state["strides"])
        self._axes.resume(state["axes"])

    def _judge(self, one: StanceEstimate | Revision, continues: Sequence[bool]) -> Verdict | None:
        if isinstance(one, Revision):
            is_newest = abs(one.path[-1, 0] - self._last[0]) < SAME_S
            self._last = one.path[-1] if is_newest else np.full(4, np.nan)
            return None
        self._measure(np.append(one.t, one.position), continues[one.number])
        sigma = float(np.hypot(*np.sqrt(np.diagonal(one.pose_cov)[:2])))
        return combine(self._list_reasons(one.t, sigma))

    def _measure(self, now: Floats, continues: bool) -> None:
        """Take a footfall's t, east, north, up (4,)."""
        if self._begun is None:
            self._begun, self._heights = float(now[0]), now[None, [0, 3]]
        else:
            self._strides += not continues
            t, took, moved = float(now[0]), float(now[0] - self._last[0]), np.linalg.norm(now[1:] - self._last[1:])
            if took > 0.0 and np.isfinite(moved):
                self._note_stride(t, took, float(moved), float(now[3] - self._last[3]), continues)
        self._last = now

    def _note_stride(self, t: float, took: float, moved: float, climbed: float, continues: bool) -> None:
        self._distance += moved
        self._lost_s += took if took > DUE_S and not continues else 0.0
        self._longest = max(self._longest, (moved, t))
        self._fastest = max(self._fastest, (moved / took, t))
        self._heights = np.vstack([self._heights, [t, self._heights[-1, 1] + climbed]])[-REMEMBERED:]
        self._steepest = max(self._steepest, find_height_rate(*self._heights.T))

    def _list_reasons(self, t: float, sigma: float) -> list[Reason]:
        assert self._begun is not None
        axes = self._axes.evidence
        limits = POSITION_SHARE_IN_POCKET if self._in_pocket else POSITION_SHARE
        found = [judge_speed(*self._fastest), judge_position(sigma, self._distance, limits, JUDGED_M)]
        found += [judge_stride(*self._longest, self._in_pocket), judge_axes(axes)]
        if self._in_pocket:
            return found
        found.append(judge_height_rate(*self._steepest))
        found.append(judge_beginning(self._strides, axes.strides))
        found.append(judge_lost_time(self._lost_s, max(t - self._begun, JUDGED_S)))
        if axes.strides >= FEWEST:
            found.append(judge_gravity(float(np.median(axes.gravity))))
        return found
