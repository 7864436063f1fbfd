"""Orientation and steps of a thigh while the walk goes on, from the past alone: one class over one window of samples.

    samples -> links of half a second -> fixed-lag smoother (`iterated_smoother`)
            -> orientation at the last sample, propagated from the last node by the gyroscope
            -> attitudes since the last estimate, by the gyroscope
            -> slow parts, `EDGE_S` late -> sums over the swing: its axes, front and back
            -> flexion since the last turning point -> turning points -> openings -> steps, bouts

A rate's change within its sample (coning, `fg_nav.samples.gaps`) is known one sample late, and so is a node. At the end
of a walk the estimates are a track of it.

The steps are joined as those of a recording (`fg_nav.pocket.steps`), half a second late, and differ in three ways:

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

from fg_nav.arrays import Floats, Ints
from fg_nav.detection.mount import remove_fast
from fg_nav.magnetic.detectors import QUASI_STATIC, UNKNOWN
from fg_nav.pocket.filter import integrate_rates
from fg_nav.pocket.iterated_smoother import (
    FixedLagSmoother,
    PocketSmootherParameters,
    Prior,
    build_prior,
    propagate_gap,
    scatter_nis,
)
from fg_nav.pocket.kalman_smoother import NODE_S, preintegrate_links
from fg_nav.pocket.steps import (
    GAIT_HZ,
    HYSTERESIS,
    MIN_SKEW,
    PAUSE_S,
    SWINGING_DEG_S,
    UPRIGHT_DEG,
    Openings,
    Steps,
    SwingSums,
    compute_flexion,
    find_ends,
    find_inner_spans,
    find_turning_points,
    join_openings,
    measure_openings,
    spread_flags,
)
from fg_nav.pocket.track import PocketStart, PocketTrack
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
    """`nav_R_body` (3, 3), `gyro_bias` (3,) rad/s, and `covariance` (6, 6) as in `PocketTrack`."""

    nav_R_body: Floats
    gyro_bias: Floats
    covariance: Floats

    @property
    def sigma(self) -> Floats:
        """(6,) standard deviations, as in `PocketTrack`."""
        return np.sqrt(np.diag(self.covariance))


class StrideEnd(NamedTuple):
    """A stride is complete: `steps` were made until then, the last ends at a sample, with that attitude (3, 3)."""

    steps: int
    sample: int
    t: float
    nav_R_body: Floats


class StepsSoFar(NamedTuple):
    """Steps in order, by samples of the walk."""

    steps: Steps
    attitude: Floats  # (S, 2, 3) mean of the level rows of nav_R_body over the stride about the step.
    heading_sigma: Floats  # (S,) rad, of the track then.
    lost_m2: Floats  # (S,) m^2, variance of what was walked unseen before it.


class _Moments(NamedTuple):
    """Of P openings, as each was found: `t` (P, 2) s and `nav_R_body` (P, 2, 3, 3) at both ends, the rest as above."""

    t: Floats
    nav_R_body: Floats
    attitude: Floats
    heading_sigma: Floats
    lost_m2: Floats


class OnlinePocket:
    """Orientation, gyro bias and steps, block by block.

    Where more than `MAX_GAP_S` is missing before a block, the smoother starts again behind the gap
    from the prior of `iterated_smoother.propagate_gap`, and the bout of steps ends; shorter gaps hold the last rate.
    Unlike in a `Recording`, clipped peaks are not rebuilt.

    Attributes
    ----------
    latest : orientation and bias at the last sample; before the first those of the start.
    notes : on the start.
    nis : (stamp in s, of force, of field) at each node that was complete, as in `fg_nav.pocket.kalman_smoother`.
    skewness : of the rate of flexion, absolute; front and back are known where it is well above zero.
    """

    def __init__(
        self,
        start: PocketStart,
        period_s: float,
        parameters: PocketSmootherParameters = PocketSmootherParameters(),
        notes: tuple[str, ...] = (),
    ) -> None:
        self._start, self._period_s, self._p, self.notes = start, period_s, parameters, notes
        # orientation
        self.latest = PocketEstimate(start.nav_R_body, np.zeros(3), np.zeros((6, 6)))
        self.nis: list[tuple[float, float, float]] = []
        self._attitudes: list[Floats] = []  # of all samples, block by block,
        self._known: list[tuple[int, PocketEstimate]] = []  # and the estimate known at the next so many of them
        self._origin, self._made = np.nan, 0  # stamp of the first node since the last gap, and links made since
        self._window: FixedLagSmoother | None = None
        self._resumed: Prior | None = None
        self._judged, self._verdict = 0, (str(UNKNOWN), "no magnetometer")
        # steps
        self._sums, self._front, self.skewness = SwingSums(), 1.0, 0.0
        none = np.zeros((0, 4), dtype=np.int64), np.empty((0, 4)), np.empty(0), np.empty(0), np.zeros(0, dtype=np.bool_)
        self._openings, self._is_open, self._last_end, self._lost_m2 = Openings(*none), False, -1, 0.0
        self._joined: tuple[tuple[int, bool, float], Steps, Ints] | None = None
        empty = np.empty((0, 2)), np.empty((0, 2, 3, 3)), np.empty((0, 2, 3)), np.empty(0), np.empty(0)
        self._moments = _Moments(*empty)
        # samples that are still needed, of which the first is number `_first` of the walk, and their slow parts
        self._first, self._rows = 0, np.empty((0, 10))
        self._rate, self._R = np.empty((0, 3)), np.empty((0, 3, 3))
        self._up, self._gait, self._swings = np.empty((0, 3)), np.empty((0, 3)), np.zeros(0, dtype=np.bool_)
        # from there on: the last node, the last turning point, and the end of the gait in the sums
        self._node = self._turn = self._summed = 0

    def push(self, rows: Floats) -> list[StrideEnd]:
        """Add samples and return the strides that they complete.

        rows: (n, 10 or more) t (s), acc (m/s^2), gyr (rad/s), mag (uT, NaN without a field), finite, in order and
        without a gap between them.
        """
        rows, last = rows[:, :10], self.latest
        lost_s = float(rows[0, 0] - self._rows[-1, 0]) if len(self._rows) else 0.0
        ends = self._restart(lost_s) if lost_s > MAX_GAP_S else []
        is_new = not len(self._rows)
        if is_new:
            self._origin = float(rows[0, 0])
        # attitudes from the last estimate on
        both = np.concatenate([self._rows[-1:], rows])
        turned = integrate_rates(both[:, 4:7] - last.gyro_bias, np.diff(both[:, 0], append=both[-1, 0]))
        attitude = np.asarray(last.nav_R_body @ turned)[-len(rows) :]
        # the estimate at the end
        self._rows = np.concatenate([self._rows, rows])
        self._make_nodes()
        known = self._propagate_last()
        self.latest = PocketEstimate(known.R, known.y[:3], known.P[:6, :6])
        attitude[-1] = self.latest.nav_R_body
        before = replace(self.latest, gyro_bias=last.gyro_bias) if is_new else last
        self._attitudes.append(attitude)
        self._known += [(len(rows) - 1, before), (1, self.latest)]
        # steps
        self._rate = np.concatenate([self._rate, rows[:, 4:7] - self.latest.gyro_bias])
        self._R = np.concatenate([self._R, attitude])
        self._settle(len(self._rows) - round(EDGE_S / self._period_s))
        self._search()
        return ends + self._end_strides()

    def cut(self) -> list[StrideEnd]:
        """End the bout and return the strides completed by that; nothing is left of the samples."""
        self._settle(len(self._rows))
        self._search(at_end=True)
        self._is_open = False
        self._drop(len(self._rows))
        self._node = self._turn = self._summed = 0
        return self._end_strides()

    @property
    def axes(self) -> tuple[Floats, Floats] | None:
        """Current left and up of the thigh, unit vectors (3,) in the body; None before the leg has swung."""
        axes = self._sums.axes
        return None if axes is None else (self._front * axes[0], axes[1])

    @property
    def stands(self) -> bool:
        """Whether the last step was followed by a pause."""
        return not (self._is_open and self._openings.is_step_like[-1])

    @property
    def is_forward_known(self) -> bool:
        """Whether the gait distinguishes forward from backward."""
        return self.skewness > MIN_SKEW

    @property
    def steps(self) -> StepsSoFar:
        """All steps so far, as a recording's, and what their path needs."""
        steps, of = self._join()
        return StepsSoFar(steps, *(part[of] for part in self._moments[2:]))

    def judge_field(self) -> tuple[str, str]:
        """Return the verdict on the field at the nodes since the last call, and the share of nodes in words."""
        nis = np.array(self.nis[self._judged :]).reshape(-1, 3)
        if not len(nis):
            return self._verdict
        used = int(np.isfinite(nis[:, 2]).sum())
        self._judged += len(nis)
        self._verdict = str(QUASI_STATIC if used else UNKNOWN), f"used at {used} of {format_count(len(nis), 'node')}"
        return self._verdict

    def build_track(self, t: Floats) -> PocketTrack:
        """Return the causal track: at the samples `t` (N,) s of the walk, the estimate known then."""
        count, estimates = zip(*self._known, strict=True)
        P = np.array([one.covariance for one in estimates])
        nis = np.array(self.nis).reshape(-1, 3)
        node = np.minimum(np.searchsorted(t, nis[:, 0] - 1e-9), len(t) - 1)
        return PocketTrack(
            t,
            np.concatenate(self._attitudes),
            np.repeat([one.gyro_bias for one in estimates], count, axis=0),
            np.repeat(np.sqrt(P[:, range(6), range(6)]), count, axis=0),
            np.cumsum(count)[1::2] - 1,
            P[1::2],
            *scatter_nis(node, nis[:, 1], nis[:, 2], len(t)),
        )

    # orientation

    def _make_nodes(self) -> None:
        """Preintegrate complete half seconds and extend the smoother; a link needs one sample beyond its end."""
        while True:
            before = max(self._node - 1, 0)
            s, t = self._rows[before:], self._rows[before:, 0]
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
            self._made += UPDATE_LINKS
            self._node = before + int(node[-1])

    def _propagate_last(self) -> Prior:
        """Estimate and covariance of the last node, its attitude propagated to the last sample by the gyroscope."""
        known = self._window.last if self._window else self._resumed or build_prior(self._start, None, self._p)
        t, gyr = self._rows[self._node :, 0], self._rows[self._node :, 4:7]
        turned = integrate_rates(gyr - known.y[:3], np.diff(t, append=t[-1]))
        return known._replace(R=known.R @ turned[-1])

    def _restart(self, lost_s: float) -> list[StrideEnd]:
        """Begin again with the next sample, `lost_s` behind the last; return the strides completed by that."""
        self._resumed = propagate_gap(self._propagate_last(), lost_s)
        self._window, self._made = None, 0
        ends = self.cut()
        self._lost_m2 += (WALKER_M_S * lost_s) ** 2
        return ends

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
        around, warm = round(AROUND_S / self._period_s), round(WARM_S / self._period_s)
        if axes is None:
            self._turn = max(self._turn, done - round(MAX_S / self._period_s))
            oldest = min(self._turn, done) - 2 * around
            self._summed = max(self._summed, oldest)
        elif done - self._turn > 1:
            t, up = self._rows[self._turn : done, 0], self._up[self._turn : done]
            flexion = compute_flexion(up, *axes)
            turn = find_turning_points(flexion, HYSTERESIS)
            last = len(t) - 1
            # openings between consecutive turning points
            if len(turn) > 2:
                self._add_openings(measure_openings(t, flexion, up, turn[:-1]), is_open=True)
            # the last opening is still in progress, or has ended in standing
            if not len(turn):
                if t[last] - t[0] > STANDING_S:
                    self._turn += max(last - round(0.5 * STANDING_S / self._period_s), 0)
            elif at_end or t[last] - t[find_inner_spans(flexion, turn[-2:])[1][0]] > PAUSE_S:
                self._add_openings(measure_openings(t, flexion, up, turn[-2:]), is_open=False)
                self._turn += last
            else:
                self._turn += last if t[last] - t[turn[-2]] > MAX_S else int(turn[-2])
        # drop the samples that neither the next node, nor filters and mean attitudes need any more
        if axes is not None:
            oldest = min(self._turn - 2 * around, self._summed - around, done - warm)
        oldest = min(oldest, self._node - 1)
        if oldest > 0:
            self._turn, self._summed, self._node = self._turn - oldest, self._summed - oldest, self._node - oldest
            self._drop(oldest)

    def _drop(self, count: int) -> None:
        """Drop the first samples and their slow parts."""
        self._first += count
        self._rows, self._rate, self._R = self._rows[count:], self._rate[count:], self._R[count:]
        self._up, self._gait, self._swings = self._up[count:], self._gait[count:], self._swings[count:]

    def _add_openings(self, new: Openings, is_open: bool) -> None:
        """Add openings that follow the last turning point, in samples from that on, with the attitudes about them."""
        new = new._replace(sample=new.sample + self._turn + self._first)
        self._openings = Openings(*(np.concatenate(pair) for pair in zip(self._openings, new, strict=True)))
        self._is_open = is_open
        _, begin, end = find_ends(self._openings, is_open)
        for k in range(len(begin) - len(new.t), len(begin)):
            column = [begin[k], end[k]]
            a, b = self._openings.sample[k, column] - self._first
            half = (b - a + 1) // 2
            level, sigma = self._R[max(a - half, 0) : b + half, :2].mean(axis=0), float(self.latest.sigma[2])
            moment = (self._openings.t[k, column], self._R[[a, b]], level, sigma, self._lost_m2)
            self._moments = _Moments(
                *(np.concatenate([all_, [one]]) for all_, one in zip(self._moments, moment, strict=True))
            )

    def _join(self) -> tuple[Steps, Ints]:
        """All steps so far, with the front as it is known now, and the opening (S,) of each; joined anew if changed."""
        state = len(self._openings.t), self._is_open, self._front
        if self._joined is None or self._joined[0] != state:
            signed = self._openings._replace(swept=self._front * self._openings.swept)
            self._joined = (state, *join_openings(signed, self._is_open))
        return self._joined[1:]

    def _end_strides(self) -> list[StrideEnd]:
        """Strides completed since the last call; before the first of them where it begins."""
        known = self._joined
        steps, of = self._join()
        if self._joined is known or not len(steps):
            return []
        # the last one is complete with the step of the other leg, or with its bout
        begin, last = steps.strides, len(steps) - 1
        is_bout_open = self._is_open and of[last] == len(self._openings.t) - 1
        is_complete = not is_bout_open or (not steps.forward[last] and last > begin[-1])
        until = np.concatenate([[0], begin[1:], [last + 1] if is_complete else []]).astype(np.int64)
        # those behind the last one given: where front and back were exchanged since, the strides before are others
        ends = []
        for count in until[until > self._last_end].tolist():
            step, side = (count - 1, 1) if count else (0, 0)
            sample = int(steps.stop[step] if side else steps.start[step])
            t, R = self._moments.t[of[step], side], self._moments.nav_R_body[of[step], side]
            ends.append(StrideEnd(count, sample, float(t), R))
            self._last_end = count
        return ends
