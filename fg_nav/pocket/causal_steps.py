"""Steps of a thigh while the walk goes on: what `fg_nav.pocket.steps` finds in a recording, half a second late.

    attitudes, rates -> slow parts, `EDGE_S` late -> sums over the swing: its axes, front and back
                     -> flexion since the last turning point -> turning points -> openings -> steps, bouts

The functions are those of the batch, on what there is. Three things differ from a recording:

* A slow part is that of the samples up to `EDGE_S` later, not of all.
* The axes are those of the walk so far, by sums over it. A step that was found stays; its direction is that of the
  axes as they are now, as its mean attitude is kept and not its direction.
* Standing shows once it has lasted for `PAUSE_S`. The opening before it ends at its extreme, and the next one begins
  where the leg stands; in a recording it may begin at the extreme.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.detection.mount import remove_fast
from fg_nav.pocket.steps import (
    GAIT_HZ,
    HYSTERESIS_DEG,
    MIN_SHARE,
    MIN_SKEW,
    MIN_STEPS,
    PAUSE_S,
    SWINGING_DEG_S,
    UPRIGHT_DEG,
    Steps,
    are_step_like,
    average_durations,
    compute_flexion,
    find_inner_spans,
    find_level_axis,
    find_turning_points,
    split_at_pauses,
    spread_flags,
)

EDGE_S = 0.25  # Later samples that a slow part needs, s: four times the memory of a filter of 6 Hz.
WARM_S = 0.75  # Earlier ones, s: the filter of 4 Hz begins in them.
AROUND_S = 0.5  # Samples so long before and after one show whether the leg swings about it, s (`steps.spread_flags`).
MIN_SWING_S = 1.0  # Swinging in all before which there are no axes, s, as in a recording.
MAX_S = 10.0  # An opening that takes longer is none, s; so much is kept while the axes are not known.
STANDING_S = 2.0  # Of a leg that stands so much is kept, s.


class StepColumns(NamedTuple):
    """Steps so far, in order (`fg_nav.pocket.steps.Steps`).

    `start`, `stop` (S,) samples of the walk; `opening` (S,) rad; `swept` (S,) change of flexion, rad; `bout` (S,);
    `attitude` (S, 2, 3) mean of the level rows of nav_R_body over the stride about the step; `heading_sigma` (S,) rad
    of the track then; `lost_m2` (S,) variance of what was walked unseen before it, m^2.
    """

    start: Ints
    stop: Ints
    opening: Floats
    swept: Floats
    bout: Ints
    attitude: Floats
    heading_sigma: Floats
    lost_m2: Floats


class StrideEnd(NamedTuple):
    """A stride is complete: `steps` were made until then, the last ends at a sample, with that attitude (3, 3)."""

    steps: int
    sample: int
    t: float
    nav_R_body: Floats


class _Found(NamedTuple):
    """A step: its row (13,) of numbers, and time and attitude at both ends."""

    row: Floats
    t: tuple[float, float]
    nav_R_body: tuple[Floats, Floats]


class SwingSums:
    """Sums over the swing so far, from which follow the axes of the thigh (`fg_nav.pocket.steps`)."""

    def __init__(self) -> None:
        self._up, self._power, self._swinging_s = np.zeros(3), np.zeros((3, 3)), 0.0
        self._count, self._square, self._cube = 0, np.zeros((3, 3)), np.zeros((3, 3, 3))
        self._left: Floats | None = None

    def add_swing(self, rate: Floats, up: Floats, period_s: float) -> None:
        """Add low-passed rates (n, 3) rad/s and unit vectors up (n, 3), in the body, while the leg swings."""
        self._swinging_s += len(rate) * period_s
        self._power += rate.T @ rate
        self._up += up.sum(axis=0)

    def update_skewness(self, rate: Floats, left: Floats) -> float:
        """Add rates (n, 3) rad/s below `GAIT_HZ` of an upright leg; return the skewness of all about `left` (3,).

        The sign gives the front: a leg swings faster forward than back. 0 without any rotation.
        """
        self._count += len(rate)
        self._square += rate.T @ rate
        self._cube += np.einsum("ni,nj,nk->ijk", rate, rate, rate)
        square = float(left @ self._square @ left)
        if square == 0.0:
            return 0.0
        cube = -float(np.einsum("ijk,i,j,k->", self._cube, left, left, left))
        return float(cube / self._count / (square / self._count) ** 1.5)

    @property
    def axes(self) -> tuple[Floats, Floats] | None:
        """Level axis of the swing, its sign arbitrary but constant, and up, unit vectors (3,) in body; None at first.

        Once the swing no longer has a dominant axis, the last one is kept.
        """
        if self._swinging_s < MIN_SWING_S:
            return None
        up = self._up / np.linalg.norm(self._up)
        share, left = find_level_axis(self._power, up)
        if share < MIN_SHARE:
            return None if self._left is None else (self._left, up)
        self._left = left if self._left is None or left @ self._left > 0 else -left
        return self._left, up


class CausalSteps:
    """Finder of steps in a stream of samples.

    Parameters
    ----------
    period_s : of the samples.

    Attributes
    ----------
    n_steps : found so far.
    skewness : of the rate of flexion, absolute; front and back are known where it is well above zero.
    """

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._sums = SwingSums()
        self._rows = np.empty((64, 13))
        self.n_steps, self._bouts, self.skewness = 0, 0, 0.0
        self._front = 1.0
        self._lost_m2, self._heading_sigma = 0.0, 0.0
        self._bout: list[_Found] = []
        self._last_stop_t = -np.inf
        self._ends: list[StrideEnd] = []
        self._base, self._turn, self._summed = 0, 0, 0
        self._t, self._rate, self._R = np.empty(0), np.empty((0, 3)), np.empty((0, 3, 3))
        self._up, self._gait = np.empty((0, 3)), np.empty((0, 3))
        self._swings: Bools = np.empty(0, dtype=np.bool_)

    def push(self, t: Floats, rate: Floats, nav_R_body: Floats, heading_sigma: float) -> list[StrideEnd]:
        """Add samples and return the strides that they complete.

        Parameters
        ----------
        t, rate, nav_R_body : stamps (n,) s, angular rates less bias (n, 3) rad/s, attitudes (n, 3, 3).
        heading_sigma : rad, one standard deviation of the heading of these attitudes.
        """
        self._heading_sigma = heading_sigma
        self._t = np.concatenate([self._t, t])
        self._rate = np.concatenate([self._rate, rate])
        self._R = np.concatenate([self._R, nav_R_body])
        self._settle(len(self._t) - round(EDGE_S / self._period_s))
        self._search()
        ends, self._ends = self._ends, []
        return ends

    def cut(self, lost_m: float = 0.0) -> list[StrideEnd]:
        """End the bout before a gap and return the strides completed by that; the filters restart at the next sample.

        `lost_m` is the sigma, m per axis, of the displacement during the gap.
        """
        self._settle(len(self._t))
        self._search(at_end=True)
        self._close_bout()
        self._lost_m2 += lost_m**2
        # begin with nothing at the next sample
        self._base, self._turn, self._summed = self._base + len(self._t), 0, 0
        self._keep_from(len(self._t))
        self._last_stop_t = -np.inf
        ends, self._ends = self._ends, []
        return ends

    @property
    def axes(self) -> tuple[Floats, Floats] | None:
        """Current left and up of the thigh, unit vectors (3,) in the body; None before the leg has swung."""
        axes = self._sums.axes
        return None if axes is None else (self._front * axes[0], axes[1])

    @property
    def stands(self) -> bool:
        """Whether the last step was followed by a pause."""
        return not self._bout

    @property
    def is_forward_known(self) -> bool:
        """Whether the gait distinguishes forward from backward."""
        return self.skewness > MIN_SKEW

    @property
    def columns(self) -> StepColumns:
        """All steps so far."""
        rows = self._rows[: self.n_steps]
        start, stop, bout = (rows[:, k].astype(np.int64) for k in (0, 1, 4))
        return StepColumns(start, stop, rows[:, 2], rows[:, 3], bout, rows[:, 7:].reshape(-1, 2, 3), *rows[:, 5:7].T)

    @property
    def steps(self) -> Steps:
        """All steps so far, as a recording's."""
        known = self.columns
        took = average_durations(np.asarray((known.stop - known.start) * self._period_s, dtype=np.float64), known.bout)
        return Steps(known.start, known.stop, known.opening, took, self._front * known.swept > 0, known.bout)

    # slow parts

    def _settle(self, until: int) -> None:
        """Low-pass the samples before index `until`, and add them to the sums from which the axes follow."""
        done = len(self._up)
        if until <= done:
            return
        first = max(done - round(WARM_S / self._period_s), 0)
        new = slice(done - first, until - first)
        # slow parts
        up = remove_fast(self._R[first:, 2], self._period_s)[new]
        slow = remove_fast(self._rate[first:], self._period_s)
        gait = remove_fast(slow, self._period_s, GAIT_HZ)[new]
        up /= np.linalg.norm(up, axis=1, keepdims=True)
        slow = slow[new]
        # sums over the swing
        swings = np.linalg.norm(slow, axis=1) > np.radians(SWINGING_DEG_S)
        self._sums.add_swing(slow[swings], up[swings], self._period_s)
        self._up, self._gait = np.concatenate([self._up, up]), np.concatenate([self._gait, gait])
        self._swings = np.concatenate([self._swings, swings])
        # skewness of the gait: samples upright and within `AROUND_S` of a swing, hence known that much later
        axes, around = self._sums.axes, round(AROUND_S / self._period_s)
        until = len(self._up) - around
        if axes is None or until <= self._summed:
            return
        new = slice(self._summed, until)
        upright = np.abs(compute_flexion(self._up[new], *axes)) < np.radians(UPRIGHT_DEG)
        first = max(self._summed - around, 0)
        near = spread_flags(self._swings[first:], self._period_s)[self._summed - first : until - first]
        self._summed = until
        # front is where the leg swings faster
        skewness = self._sums.update_skewness(self._gait[new][near & upright], axes[0])
        self._front, self.skewness = (1.0 if skewness >= 0 else -1.0), abs(skewness)

    # turning points and openings

    def _search(self, at_end: bool = False) -> None:
        """Add the openings completed since the last turning point; `at_end` closes the last one. Drop old samples."""
        axes, done = self._sums.axes, len(self._up)
        if axes is None:
            self._turn = max(self._turn, done - round(MAX_S / self._period_s))
        elif done - self._turn > 1:
            t, up = self._t[self._turn : done], self._up[self._turn : done]
            flexion = compute_flexion(up, *axes)
            turn = find_turning_points(flexion, float(np.radians(HYSTERESIS_DEG)))
            # openings between consecutive turning points
            for k in range(len(turn) - 2):
                self._add_opening(t, flexion, up, turn[k : k + 2])
            # the last opening is still in progress, or has ended in standing
            last = len(t) - 1
            if not len(turn):
                if t[last] - t[0] > STANDING_S:
                    self._turn += max(last - round(0.5 * STANDING_S / self._period_s), 0)
            elif at_end or t[last] - t[find_inner_spans(flexion, turn[-2:])[1][0]] > PAUSE_S:
                self._add_opening(t, flexion, up, turn[-2:], stands=True)
                self._close_bout()
                self._turn += last
            else:
                self._turn += last if t[last] - t[turn[-2]] > MAX_S else int(turn[-2])
        # drop the samples that neither filter nor mean attitude needs any more
        around = round(AROUND_S / self._period_s)
        oldest = min(self._turn - 2 * around, self._summed - around, len(self._up) - round(WARM_S / self._period_s))
        if self._sums.axes is None:
            oldest = min(self._turn, len(self._up)) - 2 * around
            self._summed = max(self._summed, oldest)
        if oldest > 0:
            self._base += oldest
            self._turn, self._summed = self._turn - oldest, self._summed - oldest
            self._keep_from(oldest)

    def _keep_from(self, first: int) -> None:
        """Drop the stored samples before one."""
        self._t, self._rate, self._R = self._t[first:], self._rate[first:], self._R[first:]
        self._up, self._gait, self._swings = self._up[first:], self._gait[first:], self._swings[first:]

    def _add_opening(self, t: Floats, flexion: Floats, up: Floats, turn: Ints, stands: bool = False) -> None:
        """Add the steps in the opening between samples `turn` (2,), split at pauses; `stands`: standing follows."""
        turn = split_at_pauses(t, flexion, turn)
        start, stop = find_inner_spans(flexion, turn)
        possible = are_step_like(flexion, turn, t[stop] - t[start])
        for k in range(len(start)):
            together = t[start[k]] - self._last_stop_t < PAUSE_S
            self._last_stop_t = float(t[stop[k]])
            if not (possible[k] and together):
                self._close_bout()
            if not possible[k]:
                continue
            pauses = stands or k + 1 < len(start)
            begin, end = int(turn[k] if together else start[k]), int(stop[k] if pauses else turn[k + 1])
            chord = float(np.linalg.norm(up[turn[k + 1]] - up[turn[k]]))
            self._add_step(begin, end, 2.0 * np.arcsin(chord / 2.0), float(flexion[turn[k + 1]] - flexion[turn[k]]))

    def _add_step(self, start: int, stop: int, opening: float, swept: float) -> None:
        """Add a step between samples counted from the last turning point; `opening` rad, signed flexion `swept` rad."""
        a, b = start + self._turn, stop + self._turn
        half = (b - a + 1) // 2
        level = self._R[max(a - half, 0) : b + half, :2].mean(axis=0)
        numbers = (a + self._base, b + self._base, opening, swept, self._bouts, self._heading_sigma, self._lost_m2)
        ends = (float(self._t[a]), float(self._t[b])), (self._R[a].copy(), self._R[b].copy())
        self._bout.append(_Found(np.array([*numbers, *level.ravel()]), *ends))
        # `MIN_STEPS` in a row are a walk: store all of them, then each further one
        count = len(self._bout)
        for number in range(0 if count == MIN_STEPS else count - 1, count if count >= MIN_STEPS else 0):
            step = self._bout[number]
            if self.n_steps == len(self._rows):
                self._rows = np.concatenate([self._rows, np.empty_like(self._rows)])
            if self.n_steps == 0:
                self._ends.append(StrideEnd(0, int(step.row[0]), step.t[0], step.nav_R_body[0]))
            self._rows[self.n_steps] = step.row
            self.n_steps += 1
            # the other leg's step ends a stride
            if number > 0:
                self._end_stride(step, if_forward=False)

    def _close_bout(self) -> None:
        """End the bout in progress, and the stride in it that is not complete."""
        if len(self._bout) >= MIN_STEPS:
            self._bouts += 1
            self._end_stride(self._bout[-1], if_forward=True)
        self._bout = []

    def _end_stride(self, step: _Found, if_forward: bool) -> None:
        """Record the end of a stride at this step if its leg swings forward (`if_forward`), or if it does not."""
        if bool(self._front * step.row[3] > 0) == if_forward:
            self._ends.append(StrideEnd(self.n_steps, int(step.row[1]), step.t[1], step.nav_R_body[1]))
