"""The pocket's graph while the walk goes on: orientation and gyro bias at the moment, from the past alone.

Samples are kept until the next nodes are complete, made into links (`graph_links`), and the end of the graph is solved
anew (`graph_window`). Between, the last node is carried on by the gyroscope. A rate's change within its sample (coning,
`fg_nav.samples.coning`) is known one sample late, and so is a node.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import EstimationError
from fg_nav.factors.rotation import rotation_exp
from fg_nav.pocket.graph_links import Links, links_between, node_samples
from fg_nav.pocket.graph_parameters import PocketGraphParameters
from fg_nav.pocket.graph_solution import Prior, after_gap, prior_of
from fg_nav.pocket.graph_track import causal_track
from fg_nav.pocket.graph_window import Window
from fg_nav.pocket.parameters import PocketParameters
from fg_nav.pocket.start import PocketStart, level_start
from fg_nav.pocket.track import PocketTrack
from fg_nav.recording import MAX_GAP_S, MIN_SAMPLES, Recording
from fg_nav.samples.coning import compensated


@dataclass(frozen=True)
class PocketEstimate:
    """At the stamp `t` s: `nav_R_body` (3, 3), `gyro_bias` (3,) rad/s, and `sigma` (6,) as in `PocketTrack`."""

    t: float
    nav_R_body: Floats
    gyro_bias: Floats
    sigma: Floats


class OnlinePocket:
    """Orientation and gyro bias from samples as they come.

    A sample that is not finite is left out. Where more than `fg_nav.recording.MAX_GAP_S` is missing, the graph goes on
    behind the gap from what is then still known (`graph_solution.after_gap`); shorter gaps hold the last rate. Unlike
    in a `Recording`, clipped peaks are not rebuilt.

    Attributes
    ----------
    left_out : how many samples were not finite.
    gaps : stamps before and after each gap, s.
    """

    def __init__(
        self, parameters: PocketGraphParameters = PocketGraphParameters(), start: PocketStart | None = None
    ) -> None:
        self._p = parameters
        self._start = start
        self._samples = np.empty((0, 10))
        self._origin = np.nan
        self._made = 0
        self._before = 0
        self._window: Window | None = None
        self._resumed: Prior | None = None
        self.left_out = 0
        self.gaps: list[tuple[float, float]] = []

    def push(self, t: Floats, acc: Floats, gyr: Floats, mag: Floats | None = None) -> PocketEstimate | None:
        """Take in samples and return the estimate at the last one; None until there is the first second.

        Parameters
        ----------
        t, acc, gyr, mag : (n,) s, and (n, 3) in m/s^2, rad/s and uT; NaN, or None, without a field.

        Raises
        ------
        EstimationError
            If a stamp is not after the one before, or it cannot be levelled.
        """
        new = np.column_stack([t, acc, gyr, np.full((len(t), 3), np.nan) if mag is None else mag])
        for part in self._parts(new):
            if self._is_behind_gap(part):
                self._lose(float(part[0, 0]))
            self._take(part)
            if self._has_begun():
                self._make_nodes()
        return self._now() if len(self._samples) and self._start is not None else None

    def _parts(self, new: Floats) -> list[Floats]:
        """Samples (n, 10) that are finite, parted at gaps; raises if a stamp goes back."""
        finite = np.isfinite(new[:, :7]).all(axis=1)
        new = new[finite]
        if not (np.diff(np.append(self._samples[-1:, 0], new[:, 0])) > 0).all():
            raise EstimationError("the stamp of a sample that was pushed is not after the last one: leave it out.")
        self.left_out += int((~finite).sum())
        return [part for part in np.split(new, 1 + np.flatnonzero(np.diff(new[:, 0]) > MAX_GAP_S)) if len(part)]

    def _is_behind_gap(self, part: Floats) -> bool:
        return len(self._samples) > 0 and part[0, 0] - self._samples[-1, 0] > MAX_GAP_S

    def _lose(self, stamp: float) -> None:
        """Go on at a stamp behind a gap; a beginning that was too short for a start is begun anew."""
        last = float(self._samples[-1, 0])
        self.gaps.append((last, stamp))
        if self._start is not None:
            known = self._carried()
            self._resumed = after_gap(known, stamp - last, self._p)
        self._samples, self._window = np.empty((0, 10)), None
        self._origin, self._made, self._before = np.nan, 0, 0

    def _take(self, new: Floats) -> None:
        self._samples = np.concatenate([self._samples, new])
        if np.isnan(self._origin):
            self._origin = float(new[0, 0])

    def _has_begun(self) -> bool:
        """Whether there is a start, making it of the first second if there is enough of it."""
        if self._start is None:
            p, (t, acc, gyr, mag) = PocketParameters(gravity=self._p.gravity), self._columns()
            if len(t) < MIN_SAMPLES or t[-1] - t[0] < p.still_s:
                return False
            self._start = level_start(Recording(t=t, acc=acc, gyr=gyr, mag=mag), p)
        return True

    def _columns(self) -> tuple[Floats, Floats, Floats, Floats]:
        s = self._samples
        return s[:, 0], s[:, 1:4], s[:, 4:7], s[:, 7:]

    def _make_nodes(self) -> None:
        """Make links of whole half seconds, once there are enough; one sample beyond is needed, and one before kept."""
        p, (t, acc, gyr, mag) = self._p, self._columns()
        every = max(round(p.push_s / p.node_s), 1)
        ticks = self._origin + p.node_s * np.arange(self._made, self._made + every + 1)
        node = np.searchsorted(t, ticks - 1e-6)
        if node[-1] >= len(t) - 1:
            return
        acc, gyr = compensated(acc, gyr, np.append(np.diff(t), t[-1] - t[-2]))
        node = np.unique(node).astype(np.int64)
        links = links_between(node, t, acc, gyr, mag, np.zeros(3))
        assert self._start is not None
        if self._window is None:
            self._window = Window(self._resumed or prior_of(self._start, links, p), links, p)
        else:
            self._window.extend(links)
        self._made += every
        self._before = min(int(node[-1]), 1)
        self._samples = self._samples[node[-1] - self._before :]
        self._make_nodes()

    def _now(self) -> PocketEstimate:
        """The last node, carried on to the last sample."""
        known = self._carried()
        return PocketEstimate(float(self._samples[-1, 0]), known.R, known.y[:3], np.sqrt(np.diag(known.P)[:6]))

    def _carried(self) -> Prior:
        """What is known of the last node, its attitude carried on to the last sample by the gyroscope."""
        t, _, gyr, _ = self._columns()
        known = self._known()
        R, part = known.R, slice(self._before, -1)
        for turn in rotation_exp((gyr[part] - known.y[:3]) * np.diff(t)[self._before :, None]):
            R = R @ turn
        return known._replace(R=R)

    def _known(self) -> Prior:
        if self._window is not None:
            return self._window.last
        assert self._start is not None
        return self._resumed or prior_of(self._start, None, self._p)


def follow_pocket(
    recording: Recording,
    parameters: PocketGraphParameters = PocketGraphParameters(),
    start: PocketStart | None = None,
    progress: Callable[[float], None] | None = None,
) -> PocketTrack:
    """What `OnlinePocket` says at each sample of a recording: each estimate is made of what was there until then.

    Parameters and errors as in `fg_nav.pocket.smoother.smooth_pocket`.
    """
    p = parameters
    begun = level_start(recording, PocketParameters(gravity=p.gravity)) if start is None else start
    acc, gyr = recording.integrable
    node = node_samples(recording.t, p.node_s)
    links = links_between(node, recording.t, acc, gyr, recording.mag, np.zeros(3))
    return _followed(recording, node, links, begun, p, progress)


def _followed(
    recording: Recording,
    node: Ints,
    links: Links,
    start: PocketStart,
    p: PocketGraphParameters,
    progress: Callable[[float], None] | None,
) -> PocketTrack:
    every = max(round(p.push_s / p.node_s), 1)
    ends = np.unique(np.append(np.arange(every, len(links), every), len(links)))
    window = Window(prior_of(start, links, p), links.part(0, ends[0]), p)
    R, b, P = [window.nodes.R[0]], [np.zeros(3)], [window.solved.P_ahead[0, :6, :6]]
    nis = []
    for first, last in zip(np.append(0, ends[:-1]), ends, strict=True):
        if first:
            window.extend(links.part(first, last))
        R.append(window.nodes.R[-1])
        b.append(window.nodes.b[-1])
        P.append(window.solved.P[-1, :6, :6])
        new = slice(-(last - first) - 1, -1)
        nis.append(np.stack([window.solved.swing_nis[new], window.solved.field_nis[new]], axis=1))
        if progress is not None:
            progress(last / len(links))
    at = node[np.append(0, ends)]
    R[0] = start.nav_R_body
    return causal_track(recording, at, np.array(R), np.array(b), np.array(P), node[:-1], np.concatenate(nis))
