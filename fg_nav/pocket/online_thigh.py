"""Orientation and steps of a thigh while the walk goes on, from blocks of samples.

    samples -> orientation at the end of the block (`online`) -> attitudes before it, by the gyroscope from the last one
            -> steps (`causal_steps`)

At the end of a walk the orientation of the moment is a track of it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.factors.rotation import relative_rotations
from fg_nav.magnetic.quasi_static import QUASI_STATIC, UNKNOWN
from fg_nav.pocket.causal_steps import CausalSteps, StrideEnd
from fg_nav.pocket.iterated_smoother import propagate_track
from fg_nav.pocket.navigate import choose_start
from fg_nav.pocket.online import OnlinePocket, PocketEstimate
from fg_nav.pocket.track import PocketTrack
from fg_nav.recording import MAX_GAP_S, Recording
from fg_nav.text import format_count

WALKER_M_S = 1.4  # Walking pace: so far an axis a person may go in a second that is lost.


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
        """Add rows (n, 11), the first of them that sample of the walk, `before` (0 or 1, 11) the row before them."""
        ends: list[StrideEnd] = []
        last, nodes = self._latest, len(self._orientation.nis)
        R, bias = (self._start, np.zeros(3)) if last is None else (last.nav_R_body, last.gyro_bias)
        lost_s = float(rows[0, 0] - before[0, 0]) if len(before) else 0.0
        if lost_s > MAX_GAP_S:
            ends += self.steps.cut(WALKER_M_S * lost_s)
        # attitudes from the last estimate on, and the estimate at the end
        attitude = _propagate(R, np.concatenate([before, rows]), bias)[len(before) :]
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
        """Return whether the field was used at the nodes since this was asked for last, in a word and in words."""
        nis = np.array(self._orientation.nis[self._judged :]).reshape(-1, 3)
        if not len(nis):
            return self._verdict
        used = int(np.isfinite(nis[:, 2]).sum())
        self._judged += len(nis)
        self._verdict = str(QUASI_STATIC if used else UNKNOWN), f"used at {used} of {format_count(len(nis), 'node')}"
        return self._verdict

    def build_track(self, recording: Recording) -> PocketTrack:
        """Return the orientation of the moment at all samples of the walk so far."""
        at = np.array([sample for sample, _ in self._known])
        R, b, P = (
            np.array([getattr(one, name) for _, one in self._known])
            for name in ("nav_R_body", "gyro_bias", "covariance")
        )
        nis = np.array(self._orientation.nis).reshape(-1, 3)
        node = np.minimum(np.searchsorted(recording.t, nis[:, 0] - 1e-9), len(recording) - 1)
        return propagate_track(recording, at, R, b, P, node, nis[:, 1:])


def _propagate(R: Floats, rows: Floats, bias: Floats) -> Floats:
    """Attitudes (n, 3, 3) at rows (n, 11), from that at the first; a gap turns nothing."""
    periods = np.append(np.diff(rows[:, 0]), 0.0)
    periods[periods > MAX_GAP_S] = 0.0
    return np.asarray(R @ relative_rotations(rows[:, 4:7], periods, np.zeros(len(rows), dtype=np.int64), bias)[0])
