"""The pocket's smoother and the steps of the thigh while the walk goes on, from the past alone.

    samples -> links of half a second -> fixed-lag smoother (`iterated_smoother`)
            -> orientation at the last sample, propagated from the last node by the gyroscope
            -> attitudes since the last estimate, by the gyroscope
            -> slow parts, `EDGE_S` late -> sums over the swing: its axes, front and back
            -> flexion since the last turning point -> turning points -> openings -> steps, bouts

A rate's change within its sample (coning, `fg_nav.samples.gaps`) is known one sample late, and so is a node. At the end
of a walk the estimates are a track of it.

The steps are those of a recording (`fg_nav.pocket.steps`), half a second late, and differ from them in three ways:

* A slow part is that of the samples up to `EDGE_S` later, not of all.
* The axes are those of the walk so far, by sums over it. A step that was found stays; its direction is that of the
  axes as they are now, as its mean attitude is kept and not its direction.
* Standing shows once it has lasted for `PAUSE_S`. The opening before it ends at its extreme, and the next one begins
  where the leg stands; in a recording it may begin at the extreme.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.detection.mount import remove_fast
from fg_nav.factors.rotation import relative_rotations, rotation_exp
from fg_nav.magnetic.quasi_static import QUASI_STATIC, UNKNOWN
from fg_nav.pocket.iterated_smoother import (
    FixedLagSmoother,
    PocketSmootherParameters,
    Prior,
    build_prior,
    propagate_gap,
    propagate_track,
)
from fg_nav.pocket.kalman_smoother import NODE_S, preintegrate_links
from fg_nav.pocket.steps import (
    GAIT_HZ,
    HYSTERESIS_DEG,
    MIN_SKEW,
    MIN_STEPS,
    PAUSE_S,
    SWINGING_DEG_S,
    UPRIGHT_DEG,
    Steps,
    SwingSums,
    are_step_like,
    average_durations,
    compute_flexion,
    find_inner_spans,
    find_turning_points,
    split_at_pauses,
    spread_flags,
)
from fg_nav.pocket.track import PocketStart, PocketTrack
from fg_nav.recording import Recording
from fg_nav.samples.gaps import compensate_coning
from fg_nav.samples.stamps import MAX_GAP_S
from fg_nav.text import format_count

UPDATE_LINKS = max(round(1.0 / NODE_S), 1)  # From estimate to estimate: one second.
WALKER_M_S = 1.4  # Walking pace: sigma an axis of what is walked in a second that is lost.
EDGE_S = 0.25  # Later samples that a slow part needs, s: four times the memory of a filter of 6 Hz.
WARM_S = 0.75  # Earlier ones, s: the filter of 4 Hz begins in them.
AROUND_S = 0.5  # Samples so long before and after one show whether the leg swings about it, s (`steps.spread_flags`).
MAX_S = 10.0  # An opening that takes longer is none, s; so much is kept while the axes are not known.
STANDING_S = 2.0  # Of a leg that stands so much is kept, s.


@dataclass(frozen=True)
class PocketEstimate:
    """At the stamp `t` s: `nav_R_body` (3, 3), `gyro_bias` (3,) rad/s, and `covariance` (6, 6) as in `PocketTrack`."""

    t: float
    nav_R_body: Floats
    gyro_bias: Floats
    covariance: Floats

    @property
    def sigma(self) -> Floats:
        """(6,) standard deviations, as in `PocketTrack`."""
        return np.sqrt(np.diag(self.covariance))


class OnlinePocket:
    """Orientation, gyro bias and steps, block by block.

    Where more than `MAX_GAP_S` is missing before a block, the smoother starts again behind the gap
    from the prior of `iterated_smoother.propagate_gap`, and the bout of steps ends; shorter gaps hold the last rate.
    Unlike in a `Recording`, clipped peaks are not rebuilt.

    Attributes
    ----------
    latest : orientation and bias at the last sample; before the first those of the start.
    steps : found so far.
    notes : on the start.
    nis : (stamp in s, of force, of field) at each node that was complete, as in `fg_nav.pocket.kalman_smoother`.
    """

    def __init__(
        self,
        start: PocketStart,
        period_s: float,
        parameters: PocketSmootherParameters = PocketSmootherParameters(),
        notes: tuple[str, ...] = (),
    ) -> None:
        self._start, self._p, self.notes = start, parameters, notes
        self.steps = CausalSteps(period_s)
        self.latest = PocketEstimate(-np.inf, start.nav_R_body, np.zeros(3), np.zeros((6, 6)))
        self.nis: list[tuple[float, float, float]] = []
        self._samples = np.empty((0, 10))  # from the last node on, and `_before` (0 or 1) before it
        self._before = 0
        self._origin, self._made = np.nan, 0  # stamp of the first node since the last gap, and links made since
        self._window: FixedLagSmoother | None = None
        self._resumed: Prior | None = None
        self._known: list[tuple[int, PocketEstimate]] = []
        self._judged, self._verdict = 0, (str(UNKNOWN), "no magnetometer")

    def push(self, first: int, rows: Floats) -> list[StrideEnd]:
        """Add samples and return the strides that they complete.

        Parameters
        ----------
        first : number of the first of them.
        rows : (n, 10 or more) t (s), acc (m/s^2), gyr (rad/s), mag (uT, NaN without a field), finite, in order and
            without a gap between them.
        """
        ends: list[StrideEnd] = []
        rows, last, nodes = rows[:, :10], self.latest, len(self.nis)
        lost_s = float(rows[0, 0] - self._samples[-1, 0]) if len(self._samples) else 0.0
        is_begun = bool(self._known) and lost_s <= MAX_GAP_S
        if lost_s > MAX_GAP_S:
            ends += self.steps.cut(WALKER_M_S * lost_s)
            self._resumed = propagate_gap(self._propagate_last(), lost_s)
            self._samples, self._window = np.empty((0, 10)), None
            self._made, self._before = 0, 0
        if not len(self._samples):
            self._origin = float(rows[0, 0])
        # attitudes from the last estimate on
        both = np.concatenate([self._samples[-1:], rows])
        periods, segment = np.append(np.diff(both[:, 0]), 0.0), np.zeros(len(both), dtype=np.int64)
        turned = relative_rotations(both[:, 4:7], periods, segment, last.gyro_bias)[0]
        attitude = np.asarray(last.nav_R_body @ turned)[-len(rows) :]
        # the estimate at the end
        self._samples = np.concatenate([self._samples, rows])
        self._make_nodes()
        known = self._propagate_last()
        self.latest = PocketEstimate(float(rows[-1, 0]), known.R, known.y[:3], known.P[:6, :6])
        attitude[-1] = self.latest.nav_R_body
        # estimates for the path at the end
        if not is_begun:
            self._known.append((first, replace(self.latest, nav_R_body=attitude[0], gyro_bias=last.gyro_bias)))
        if len(self.nis) > nodes and len(rows) > 1:
            self._known.append((first + len(rows) - 1, self.latest))
        # steps
        rate, heading_sigma = rows[:, 4:7] - self.latest.gyro_bias, float(self.latest.sigma[2])
        return ends + self.steps.push(rows[:, 0], rate, attitude, heading_sigma)

    def judge_field(self) -> tuple[str, str]:
        """Return the verdict on the field at the nodes since the last call, and the share of nodes in words."""
        nis = np.array(self.nis[self._judged :]).reshape(-1, 3)
        if not len(nis):
            return self._verdict
        used = int(np.isfinite(nis[:, 2]).sum())
        self._judged += len(nis)
        self._verdict = str(QUASI_STATIC if used else UNKNOWN), f"used at {used} of {format_count(len(nis), 'node')}"
        return self._verdict

    def build_track(self, recording: Recording) -> PocketTrack:
        """Return the causal track: at each sample of the walk so far, the estimate known at that time."""
        at = np.array([sample for sample, _ in self._known])
        R, b, P = (
            np.array([getattr(one, name) for _, one in self._known])
            for name in ("nav_R_body", "gyro_bias", "covariance")
        )
        nis = np.array(self.nis).reshape(-1, 3)
        node = np.minimum(np.searchsorted(recording.t, nis[:, 0] - 1e-9), len(recording) - 1)
        return propagate_track(recording, at, R, b, P, node, nis[:, 1:])

    def _make_nodes(self) -> None:
        """Preintegrate complete half seconds and extend the smoother; a link needs one sample beyond its end."""
        while True:
            s, t = self._samples, self._samples[:, 0]
            ticks = self._origin + NODE_S * np.arange(self._made, self._made + UPDATE_LINKS + 1)
            node = np.searchsorted(t, ticks - 1e-6)
            if node[-1] >= len(t) - 1:
                return
            # preintegrate
            h = np.append(np.diff(t), t[-1] - t[-2])
            acc, gyr = compensate_coning(np.ascontiguousarray(s[:, 1:4]), np.ascontiguousarray(s[:, 4:7]), h)
            node = np.unique(node).astype(np.int64)
            links = preintegrate_links(node, t, acc, gyr, s[:, 7:])
            # smooth
            if self._window is None:
                prior = self._resumed or build_prior(self._start, links, self._p)
                self._window = FixedLagSmoother(prior, links, self._p)
            else:
                self._window.extend(links)
            new, smoothed = slice(-len(links.h) - 1, -1), self._window.smoothed
            self.nis += zip(t[node[:-1]].tolist(), smoothed.swing_nis[new], smoothed.field_nis[new], strict=True)
            # drop the samples used
            self._made += UPDATE_LINKS
            self._before = min(int(node[-1]), 1)
            self._samples = s[node[-1] - self._before :]

    def _propagate_last(self) -> Prior:
        """Estimate and covariance of the last node, its attitude propagated to the last sample by the gyroscope."""
        known = self._window.last if self._window else self._resumed or build_prior(self._start, None, self._p)
        t, gyr = self._samples[:, 0], self._samples[:, 4:7]
        R, part = known.R, slice(self._before, -1)
        for turn in rotation_exp((gyr[part] - known.y[:3]) * np.diff(t)[self._before :, None]):
            R = R @ turn
        return known._replace(R=R)


# steps


class StepsSoFar(NamedTuple):
    """Steps in order, by samples of the walk.

    `attitude` (S, 2, 3) mean of the level rows of nav_R_body over the stride about the step; `heading_sigma` (S,) rad
    of the track then; `lost_m2` (S,) variance of what was walked unseen before it, m^2.
    """

    steps: Steps
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
    """A step, and time and attitude at both ends.

    Its row (13,): first and last sample of the walk; opening and signed change of flexion, rad; number of the bout;
    heading sigma, unseen variance and mean attitude as in `StepsSoFar`.
    """

    row: Floats
    t: tuple[float, float]
    nav_R_body: tuple[Floats, Floats]


class CausalSteps:
    """Finder of steps in a stream of samples.

    Parameters
    ----------
    period_s : of the samples.

    Attributes
    ----------
    skewness : of the rate of flexion, absolute; front and back are known where it is well above zero.
    """

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._sums = SwingSums()
        self._rows = np.empty((0, 13))
        self._bouts, self.skewness = 0, 0.0
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
    def found(self) -> StepsSoFar:
        """All steps so far, as a recording's, and what their path needs."""
        rows = self._rows
        start, stop, bout = (rows[:, k].astype(np.int64) for k in (0, 1, 4))
        took = average_durations(np.asarray((stop - start) * self._period_s, dtype=np.float64), bout)
        steps = Steps(start, stop, rows[:, 2], took, self._front * rows[:, 3] > 0, bout)
        return StepsSoFar(steps, rows[:, 7:].reshape(-1, 2, 3), rows[:, 5], rows[:, 6])

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
            if not len(self._rows):
                self._ends.append(StrideEnd(0, int(step.row[0]), step.t[0], step.nav_R_body[0]))
            self._rows = np.vstack([self._rows, step.row])
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
            self._ends.append(StrideEnd(len(self._rows), int(step.row[1]), step.t[1], step.nav_R_body[1]))
