"""Steps from the flexion of one thigh.

The leg that wears the sensor swings forward while its foot is in the air, and is carried back while it stands and the
other foot swings. So between two turning points of flexion somebody makes one step, with either foot:

    opening   the angle between the directions of up, in the body, at the two turning points: by how much the legs are
              open at a footfall. Where a sensor slips about the thigh the difference of flexion is less, not this
    step      one opening, forward or back
    stride    one swing of the leg forward, and what follows until the next: two steps

A turning point is one after which flexion comes back by more than a hysteresis. What is too small (one who shifts from
leg to leg or turns on the spot), too slow (sits down), too far flexed (sits, and moves) or alone is no step. The first
step out of standing and the last one into it are half a one, and counted as they are.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.stances import runs


@dataclass(frozen=True)
class StepParameters:
    """What counts as a step. Angles between those of walking, 30 to 65 deg, and of what is none."""

    hysteresis_deg: float = 12.0
    """A turning point is one after which flexion comes back by so much, deg. After a footfall in a tight turn a real
    thigh (`qmt_fullbody`) gives way by 7 to 11 and goes on."""
    least_opening_deg: float = 20.0
    """Less, deg, is no step: legs that turn on the spot open by some 16, and the first step out of standing by more."""
    most_opening_deg: float = 85.0
    """More, deg, is no step: one who runs opens by up to 75."""
    most_flexed_deg: float = 50.0
    """The middle of a step is no farther from that of the walk, deg: one who sits is at 60 to 80."""
    shortest_s: float = 0.12
    """A step takes longer, s, from a tenth of its opening to nine tenths: a runner's 0.2."""
    longest_s: float = 1.0
    """... and no longer than this, s: one who sits down takes 1 or more."""
    pause_s: float = 0.6
    """Longer between two steps, s, is a pause."""
    least_steps: int = 3
    """Fewer steps in a row are not a walk: a kick, or a leg that is crossed."""


_LEVELS = np.arange(0.15, 0.9, 0.1)
"""Shares of an opening; between two of them a leg that is on its way does not pause."""


@dataclass(frozen=True)
class Steps:
    """Steps of a walk, in order.

    ========= ==== ================================================================================
    start     (S,) sample at which the step begins
    stop      (S,) sample at which it ends; the next one begins there or, after a pause, later
    opening   (S,) rad
    forward   (S,) True where the leg that wears the sensor swings
    bout      (S,) number of the walk without a pause that it belongs to, from 0
    ========= ==== ================================================================================
    """

    start: Ints
    stop: Ints
    opening: Floats
    forward: Bools
    bout: Ints

    def __len__(self) -> int:
        return len(self.start)

    @property
    def strides(self) -> Ints:
        """First step (K,) of each stride: a swing, or the first step of a bout where that is the other leg's."""
        begins = self.forward.copy()
        first = np.flatnonzero(np.diff(self.bout, prepend=-1))
        other = first[~self.forward[first]]
        begins[other] = True
        begins[other + 1] = False  # that swing goes with the step before it
        return np.flatnonzero(begins)


def find_steps(t: Floats, flexion: Floats, up: Floats, parameters: StepParameters = StepParameters()) -> Steps:
    """Find the steps of a thigh; there may be none.

    Parameters
    ----------
    t : (N,) s.
    flexion : (N,) rad, positive with the knee ahead, and free of what is faster than 6 Hz.
    up : (N, 3) direction of up in the body, likewise.
    parameters : StepParameters
    """
    p = parameters
    turn = _parted(t, flexion, turning_points(flexion, float(np.radians(p.hysteresis_deg))), p.pause_s)
    start, stop = _on_the_way(flexion, turn)
    swept = np.diff(flexion[turn])
    took = t[stop] - t[start]
    together = t[start[1:]] - t[stop[:-1]] < p.pause_s
    walked, bout = _bouts(_possible(flexion, turn, took, p), together, p.least_steps)
    start, stop = _joined(start, stop, turn, together)
    opening = 2.0 * np.arcsin(np.linalg.norm(np.diff(up[turn], axis=0), axis=1) / 2.0)
    return Steps(start[walked], stop[walked], opening[walked], swept[walked] > 0, bout[walked])


def turning_points(values: Floats, hysteresis: float) -> Ints:
    """Samples (M,) at which values (N,) turn, from high to low and back, by more than the hysteresis; ends included."""
    found, extreme, way = [0], 0, 0  # since the last turning point the extreme, and whether up or down to it
    for corner in _corners(values):
        back = values[corner] - values[extreme]
        if way != 0 and back * way >= 0:
            extreme = corner
        elif abs(back) > hysteresis:
            if way != 0:
                found.append(extreme)
            extreme, way = corner, 1 if back > 0 else -1
    return np.array([*found, extreme] if way != 0 else [], dtype=np.int64)


def _corners(values: Floats) -> list[int]:
    """Samples at which values (N,) stop rising or falling, and the last."""
    moving = np.flatnonzero(np.diff(values))
    rising = np.diff(values)[moving] > 0
    return [*moving[1:][rising[1:] != rising[:-1]].tolist(), len(values) - 1]


def _parted(t: Floats, flexion: Floats, turn: Ints, pause_s: float) -> Ints:
    """Turning points, and one more in each opening with a pause: into standing, and on in the same direction."""
    parted = []
    for a, b in pairwise(turn.tolist()):
        if t[b] - t[a] > pause_s:
            done = (flexion[a : b + 1] - flexion[a]) / (flexion[b] - flexion[a])
            reached = a + np.array([np.argmax(done >= level) for level in _LEVELS])
            longest = int(np.argmax(np.diff(t[reached])))
            if t[reached[longest + 1]] - t[reached[longest]] > pause_s:
                parted.append((reached[longest] + reached[longest + 1]) // 2)
    return np.sort(np.append(turn, np.array(parted, dtype=np.int64)))


def _on_the_way(flexion: Floats, turn: Ints) -> tuple[Ints, Ints]:
    """First and last sample (S,) of each opening that are a tenth of it away from its ends."""
    start, stop = np.zeros(max(len(turn) - 1, 0), dtype=np.int64), np.zeros(max(len(turn) - 1, 0), dtype=np.int64)
    for k, (a, b) in enumerate(pairwise(turn.tolist())):
        done = (flexion[a : b + 1] - flexion[a]) / (flexion[b] - flexion[a])
        middle = int(np.argmax(done > 0.5))
        start[k] = a + np.flatnonzero(done[: middle + 1] < 0.1)[-1]
        stop[k] = a + middle + np.argmax(done[middle:] > 0.9)
    return start, stop


def _possible(flexion: Floats, turn: Ints, took: Floats, p: StepParameters) -> Bools:
    """(S,) True where an opening is as large, as quick and as upright as that of a step."""
    swept, middle = np.degrees(np.abs(np.diff(flexion[turn]))), np.degrees(flexion[turn[1:]] + flexion[turn[:-1]]) / 2
    large = (swept > p.least_opening_deg) & (swept < p.most_opening_deg)
    quick = (took > p.shortest_s) & (took < p.longest_s)
    return np.asarray(large & quick & (np.abs(middle) < p.most_flexed_deg))


def _bouts(possible: Bools, together: Bools, least: int) -> tuple[Bools, Ints]:
    """(S,) which openings are steps of a walk, and the number of the walk of each."""
    walked, bout = np.zeros(len(possible), dtype=np.bool_), np.zeros(len(possible), dtype=np.int64)
    walks = [(first, last) for first, last in _together(possible, together) if last - first >= least]
    for number, (first, last) in enumerate(walks):
        walked[first:last], bout[first:last] = True, number
    return walked, bout


def _together(possible: Bools, together: Bools) -> list[tuple[int, int]]:
    """First, and after the last, of the openings that may be steps without a pause between."""
    found = []
    for first, last in zip(*runs(possible), strict=True):
        cuts = first + 1 + np.flatnonzero(~together[first : last - 1])
        ends = [int(first), *cuts.tolist(), int(last)]
        found += list(pairwise(ends))
    return found


def _joined(start: Ints, stop: Ints, turn: Ints, together: Bools) -> tuple[Ints, Ints]:
    """Let each step end at the turning point where the next begins, unless there is a pause between."""
    start, stop = start.copy(), stop.copy()
    start[1:] = np.where(together, turn[1:-1], start[1:])
    stop[:-1] = np.where(together, turn[1:-1], stop[:-1])
    return start, stop
