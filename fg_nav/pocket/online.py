"""The pocket's smoother and the steps of the thigh while the walk goes on, from the past alone.

    samples -> links of half a second -> fixed-lag smoother (`iterated_smoother`)
            -> orientation at the last sample, propagated from the last node by the gyroscope
            -> attitudes since the last estimate, by the gyroscope -> steps (`causal_steps`)

A rate's change within its sample (coning, `fg_nav.samples.gaps`) is known one sample late, and so is a node. At the end
of a walk the estimates are a track of it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import EstimationError
from fg_nav.factors.rotation import relative_rotations, rotation_exp
from fg_nav.magnetic.quasi_static import QUASI_STATIC, UNKNOWN
from fg_nav.pocket.causal_steps import CausalSteps, StrideEnd
from fg_nav.pocket.iterated_smoother import FixedLagSmoother, Prior, build_prior, propagate_gap, propagate_track
from fg_nav.pocket.kalman_smoother import NODE_S, preintegrate_links
from fg_nav.pocket.parameters import PocketSmootherParameters
from fg_nav.pocket.track import STILL_S, PocketStart, PocketTrack, choose_start, level_start
from fg_nav.recording import MAX_GAP_S, MIN_SAMPLES, Recording
from fg_nav.samples.gaps import compensate_coning
from fg_nav.text import format_count

UPDATE_LINKS = max(round(1.0 / NODE_S), 1)  # From estimate to estimate: one second.
WALKER_M_S = 1.4  # Walking pace: sigma an axis of what is walked in a second that is lost.


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
    """Orientation and gyro bias from samples as they come.

    A sample that is not finite is left out. Where more than `fg_nav.recording.MAX_GAP_S` is missing, the smoother
    starts again after the gap from the prior of `iterated_smoother.propagate_gap`; shorter gaps hold the last rate.
    Unlike in a `Recording`, clipped peaks are not rebuilt.

    Attributes
    ----------
    left_out : how many samples were not finite.
    nis : (stamp in s, of force, of field) at each node that was complete, as in `fg_nav.pocket.kalman_smoother`.
    gaps : stamps before and after each gap, s.
    """

    def __init__(
        self, parameters: PocketSmootherParameters = PocketSmootherParameters(), start: PocketStart | None = None
    ) -> None:
        self._p = parameters
        self._start = start
        self._samples = np.empty((0, 10))  # from the last node on, and `_before` (0 or 1) before it
        self._before = 0
        self._origin, self._made = np.nan, 0  # stamp of the first node since the last gap, and links made since
        self._window: FixedLagSmoother | None = None
        self._resumed: Prior | None = None
        self.left_out = 0
        self.nis: list[tuple[float, float, float]] = []
        self.gaps: list[tuple[float, float]] = []

    def push(self, t: Floats, acc: Floats, gyr: Floats, mag: Floats | None = None) -> PocketEstimate | None:
        """Add samples and return the estimate at the last one; None until there is the first second.

        Parameters
        ----------
        t, acc, gyr, mag : (n,) s, and (n, 3) in m/s^2, rad/s and uT; NaN, or None, without a field.

        Raises `EstimationError` if a stamp is not after the one before, or it cannot be levelled.
        """
        new = np.column_stack([t, acc, gyr, np.full((len(t), 3), np.nan) if mag is None else mag])
        # finite samples, in order, split at gaps
        finite = np.isfinite(new[:, :7]).all(axis=1)
        new = new[finite]
        if not (np.diff(np.append(self._samples[-1:, 0], new[:, 0])) > 0).all():
            raise EstimationError("the stamp of a sample that was pushed is not after the last one: leave it out.")
        self.left_out += int((~finite).sum())
        for part in np.split(new, 1 + np.flatnonzero(np.diff(new[:, 0]) > MAX_GAP_S)):
            if not len(part):
                continue
            if len(self._samples) and part[0, 0] - self._samples[-1, 0] > MAX_GAP_S:
                # a gap: restart behind it; a beginning that was too short for a start is dropped
                before, stamp = float(self._samples[-1, 0]), float(part[0, 0])
                self.gaps.append((before, stamp))
                if self._start is not None:
                    self._resumed = propagate_gap(self._propagate_last(self._start), stamp - before)
                self._samples, self._window = np.empty((0, 10)), None
                self._made, self._before = 0, 0
            if not len(self._samples):
                self._origin = float(part[0, 0])
            self._samples = np.concatenate([self._samples, part])
            # the start, by the first second
            t = self._samples[:, 0]
            if self._start is None and len(t) >= MIN_SAMPLES and t[-1] - t[0] >= STILL_S:
                s = self._samples
                self._start = level_start(Recording(t=t, acc=s[:, 1:4], gyr=s[:, 4:7], mag=s[:, 7:]))
            if self._start is not None:
                self._make_nodes(self._start)
        if not len(self._samples) or self._start is None:
            return None
        last = self._propagate_last(self._start)
        return PocketEstimate(float(self._samples[-1, 0]), last.R, last.y[:3], last.P[:6, :6])

    def _make_nodes(self, start: PocketStart) -> None:
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
                prior = self._resumed or build_prior(start, links, self._p)
                self._window = FixedLagSmoother(prior, links, self._p)
            else:
                self._window.extend(links)
            new, smoothed = slice(-len(links.h) - 1, -1), self._window.smoothed
            self.nis += zip(t[node[:-1]].tolist(), smoothed.swing_nis[new], smoothed.field_nis[new], strict=True)
            # drop the samples used
            self._made += UPDATE_LINKS
            self._before = min(int(node[-1]), 1)
            self._samples = s[node[-1] - self._before :]

    def _propagate_last(self, start: PocketStart) -> Prior:
        """Estimate and covariance of the last node, its attitude propagated to the last sample by the gyroscope."""
        known = self._window.last if self._window else self._resumed or build_prior(start, None, self._p)
        t, gyr = self._samples[:, 0], self._samples[:, 4:7]
        R, part = known.R, slice(self._before, -1)
        for turn in rotation_exp((gyr[part] - known.y[:3]) * np.diff(t)[self._before :, None]):
            R = R @ turn
        return known._replace(R=R)


class OnlineThigh:
    """Orientation and steps, block by block, from the first second (N, 10) on.

    Attributes
    ----------
    steps : found so far.
    notes : on the start.
    """

    def __init__(self, first: Recording, heading: float | None) -> None:
        start, notes = choose_start(first, heading)
        self.notes = tuple(notes)
        self.steps = CausalSteps(first.period_s)
        self._orientation = OnlinePocket(start=start)
        self._known: list[tuple[int, PocketEstimate]] = []
        self._latest: PocketEstimate | None = None
        self._start = start.nav_R_body
        self._judged, self._verdict = 0, (str(UNKNOWN), "no magnetometer")

    @property
    def latest(self) -> PocketEstimate:
        """Orientation and bias at the last sample."""
        assert self._latest is not None
        return self._latest

    def add(self, first: int, rows: Floats, before: Floats) -> list[StrideEnd]:
        """Add rows (n, 11) from sample `first` on; `before` (0 or 1, 11) precedes them. Return completed strides."""
        ends: list[StrideEnd] = []
        last, nodes = self._latest, len(self._orientation.nis)
        R, bias = (self._start, np.zeros(3)) if last is None else (last.nav_R_body, last.gyro_bias)
        lost_s = float(rows[0, 0] - before[0, 0]) if len(before) else 0.0
        if lost_s > MAX_GAP_S:
            ends += self.steps.cut(WALKER_M_S * lost_s)
        # attitudes from the last estimate on; a gap turns nothing
        both = np.concatenate([before, rows])
        periods = np.append(np.diff(both[:, 0]), 0.0)
        periods[periods > MAX_GAP_S] = 0.0
        turned = relative_rotations(both[:, 4:7], periods, np.zeros(len(both), dtype=np.int64), bias)[0]
        attitude = np.asarray(R @ turned)[len(before) :]
        # the estimate at the end
        self._latest = self._orientation.push(rows[:, 0], rows[:, 1:4], rows[:, 4:7], rows[:, 7:10])
        latest = self.latest
        attitude[-1] = latest.nav_R_body
        # estimates for the path at the end
        if last is None or lost_s > MAX_GAP_S:
            self._known.append((first, replace(latest, nav_R_body=attitude[0], gyro_bias=bias)))
        if len(self._orientation.nis) > nodes and len(rows) > 1:
            self._known.append((first + len(rows) - 1, latest))
        # steps
        return ends + self.steps.push(rows[:, 0], rows[:, 4:7] - latest.gyro_bias, attitude, float(latest.sigma[2]))

    def judge_field(self) -> tuple[str, str]:
        """Return the verdict on the field at the nodes since the last call, and the share of nodes in words."""
        nis = np.array(self._orientation.nis[self._judged :]).reshape(-1, 3)
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
        nis = np.array(self._orientation.nis).reshape(-1, 3)
        node = np.minimum(np.searchsorted(recording.t, nis[:, 0] - 1e-9), len(recording) - 1)
        return propagate_track(recording, at, R, b, P, node, nis[:, 1:])
