"""The pocket's graph while the walk goes on: orientation and gyro bias at the moment, from the past alone.

Samples are kept until the next nodes are complete, made into links (`graph_links`), and the end of the graph is solved
anew (`graph_window`). Between, the last node is carried on by the gyroscope. A rate's change within its sample (coning,
`fg_nav.coning`) is known one sample late, and so is a node.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from factors.rotation import rotation_exp
from fg_nav.arrays import Floats, Ints
from fg_nav.coning import compensated
from fg_nav.errors import EstimationError
from fg_nav.pocket.graph_links import Links, links_between, node_samples
from fg_nav.pocket.graph_parameters import PocketGraphParameters
from fg_nav.pocket.graph_track import causal_track
from fg_nav.pocket.graph_window import Window
from fg_nav.pocket.parameters import PocketParameters
from fg_nav.pocket.start import PocketStart, level_start
from fg_nav.pocket.track import PocketTrack
from fg_nav.recording import MIN_SAMPLES, Recording


@dataclass(frozen=True)
class PocketEstimate:
    """At the stamp `t` s: `nav_R_body` (3, 3), `gyro_bias` (3,) rad/s, and `sigma` (6,) as in `PocketTrack`."""

    t: float
    nav_R_body: Floats
    gyro_bias: Floats
    sigma: Floats


class OnlinePocket:
    """Orientation and gyro bias from samples as they come.

    Unlike a `Recording` samples are taken as they are: gaps are not bridged and clipped peaks not rebuilt.
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

    def push(self, t: Floats, acc: Floats, gyr: Floats, mag: Floats | None = None) -> PocketEstimate | None:
        """Take in samples and return the estimate at the last one; None until there is the first second.

        Parameters
        ----------
        t, acc, gyr, mag : (n,) s, and (n, 3) in m/s^2, rad/s and uT; NaN, or None, without a field.

        Raises
        ------
        EstimationError
            If a stamp is not after the one before, or a sample is not finite; or it cannot be levelled.
        """
        self._take(t, acc, gyr, np.full((len(t), 3), np.nan) if mag is None else mag)
        if not len(self._samples) or not self._has_begun():
            return None
        self._make_nodes()
        return self._now()

    def _take(self, t: Floats, acc: Floats, gyr: Floats, mag: Floats) -> None:
        new = np.column_stack([t, acc, gyr, mag])
        stamps = np.append(self._samples[-1:, 0], new[:, 0])
        if not np.isfinite(new[:, :7]).all() or not (np.diff(stamps) > 0).all():
            raise EstimationError("a sample that was pushed is not finite or not after the last one: leave it out.")
        self._samples = np.concatenate([self._samples, new])
        if np.isnan(self._origin) and len(new):
            self._origin = float(t[0])

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
            self._window = Window(self._start, links, p)
        else:
            self._window.extend(links)
        self._made += every
        self._before = min(int(node[-1]), 1)
        self._samples = self._samples[node[-1] - self._before :]
        self._make_nodes()

    def _now(self) -> PocketEstimate:
        """The last node, carried on to the last sample."""
        t, _, gyr, _ = self._columns()
        assert self._start is not None
        if self._window is None:
            R, bias = self._start.nav_R_body, np.zeros(3)
            sigma = np.repeat([self._start.tilt_sigma, np.radians(self._p.gyro_bias_sigma_deg_s)], 3)
            sigma[2] = self._start.heading_sigma
        else:
            nodes, P = self._window.nodes, self._window.solved.P[-1]
            R, bias, sigma = nodes.R[-1], nodes.b[-1], np.sqrt(np.diag(P)[:6])
        part = slice(self._before, -1)
        for turn in rotation_exp((gyr[part] - bias) * np.diff(t)[self._before :, None]):
            R = R @ turn
        return PocketEstimate(float(t[-1]), R, bias, sigma)


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
    window = Window(start, links.part(0, ends[0]), p)
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
