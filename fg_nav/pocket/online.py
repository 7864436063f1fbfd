"""The pocket's smoother while the walk goes on: orientation and gyro bias at the moment, from the past alone.

Samples are stored until the next nodes are complete, preintegrated (`links`), and smoothed with a fixed lag
(`fixed_lag`). Between, the last node is propagated by the gyroscope. A rate's change within its sample (coning,
`fg_nav.samples.gaps`) is known one sample late, and so is a node.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import EstimationError
from fg_nav.factors.rotation import rotation_exp
from fg_nav.pocket.fixed_lag import FixedLagSmoother, Prior, build_prior, propagate_gap
from fg_nav.pocket.iterated_smoother import propagate_track
from fg_nav.pocket.links import NODE_S, place_nodes, preintegrate_links
from fg_nav.pocket.parameters import PocketSmootherParameters
from fg_nav.pocket.track import STILL_S, PocketStart, PocketTrack, level_start
from fg_nav.recording import MAX_GAP_S, MIN_SAMPLES, Recording
from fg_nav.samples.gaps import compensate_coning

UPDATE_S = 1.0  # Estimates are made so often, s.

_EVERY = max(round(UPDATE_S / NODE_S), 1)


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
    starts again after the gap from the prior of `fixed_lag.propagate_gap`; shorter gaps hold the last rate. Unlike in a
    `Recording`, clipped peaks are not rebuilt.

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
        self._samples = np.empty((0, 10))
        self._origin = np.nan
        self._made = 0
        self._before = 0
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
        for part in self._split_at_gaps(new):
            if self._is_behind_gap(part):
                self._restart(float(part[0, 0]))
            self._store(part)
            if self._has_begun():
                self._make_nodes()
        return self._estimate_now() if len(self._samples) and self._start is not None else None

    def _split_at_gaps(self, new: Floats) -> list[Floats]:
        """Samples (n, 10) that are finite, split at gaps; raises if a stamp goes back."""
        finite = np.isfinite(new[:, :7]).all(axis=1)
        new = new[finite]
        if not (np.diff(np.append(self._samples[-1:, 0], new[:, 0])) > 0).all():
            raise EstimationError("the stamp of a sample that was pushed is not after the last one: leave it out.")
        self.left_out += int((~finite).sum())
        return [part for part in np.split(new, 1 + np.flatnonzero(np.diff(new[:, 0]) > MAX_GAP_S)) if len(part)]

    def _is_behind_gap(self, part: Floats) -> bool:
        return len(self._samples) > 0 and part[0, 0] - self._samples[-1, 0] > MAX_GAP_S

    def _restart(self, stamp: float) -> None:
        """Restart at a stamp after a gap; a beginning that was too short for a start is dropped."""
        last = float(self._samples[-1, 0])
        self.gaps.append((last, stamp))
        if self._start is not None:
            self._resumed = propagate_gap(self._propagate_last(), stamp - last)
        self._samples, self._window = np.empty((0, 10)), None
        self._origin, self._made, self._before = np.nan, 0, 0

    def _store(self, new: Floats) -> None:
        self._samples = np.concatenate([self._samples, new])
        if np.isnan(self._origin):
            self._origin = float(new[0, 0])

    def _has_begun(self) -> bool:
        """Whether there is a start, making it of the first second if there is enough of it."""
        if self._start is None:
            t, acc, gyr, mag = self._split_columns()
            if len(t) < MIN_SAMPLES or t[-1] - t[0] < STILL_S:
                return False
            self._start = level_start(Recording(t=t, acc=acc, gyr=gyr, mag=mag))
        return True

    def _split_columns(self) -> tuple[Floats, Floats, Floats, Floats]:
        s = self._samples
        return s[:, 0], s[:, 1:4], s[:, 4:7], s[:, 7:]

    def _make_nodes(self) -> None:
        """Make links of whole half seconds, if complete; one sample beyond is needed, and one before stays stored."""
        t, acc, gyr, mag = self._split_columns()
        ticks = self._origin + NODE_S * np.arange(self._made, self._made + _EVERY + 1)
        node = np.searchsorted(t, ticks - 1e-6)
        if node[-1] >= len(t) - 1:
            return
        # preintegrate
        h = np.append(np.diff(t), t[-1] - t[-2])
        acc, gyr = compensate_coning(np.ascontiguousarray(acc), np.ascontiguousarray(gyr), h)
        node = np.unique(node).astype(np.int64)
        links = preintegrate_links(node, t, acc, gyr, mag, np.zeros(3))
        # smooth
        assert self._start is not None
        if self._window is None:
            prior = self._resumed or build_prior(self._start, links, self._p)
            self._window = FixedLagSmoother(prior, links, self._p)
        else:
            self._window.extend(links)
        new, smoothed = slice(-len(links) - 1, -1), self._window.smoothed
        self.nis += zip(t[node[:-1]].tolist(), smoothed.swing_nis[new], smoothed.field_nis[new], strict=True)
        # drop the samples used, and look for more
        self._made += _EVERY
        self._before = min(int(node[-1]), 1)
        self._samples = self._samples[node[-1] - self._before :]
        self._make_nodes()

    def _estimate_now(self) -> PocketEstimate:
        """The last node, propagated to the last sample."""
        known = self._propagate_last()
        return PocketEstimate(float(self._samples[-1, 0]), known.R, known.y[:3], known.P[:6, :6])

    def _propagate_last(self) -> Prior:
        """Estimate and covariance of the last node, its attitude propagated to the last sample by the gyroscope."""
        t, _, gyr, _ = self._split_columns()
        known = self._last_node()
        R, part = known.R, slice(self._before, -1)
        for turn in rotation_exp((gyr[part] - known.y[:3]) * np.diff(t)[self._before :, None]):
            R = R @ turn
        return known._replace(R=R)

    def _last_node(self) -> Prior:
        if self._window is not None:
            return self._window.last
        assert self._start is not None
        return self._resumed or build_prior(self._start, None, self._p)


def follow_pocket(
    recording: Recording,
    parameters: PocketSmootherParameters = PocketSmootherParameters(),
    start: PocketStart | None = None,
    progress: Callable[[float], None] | None = None,
) -> PocketTrack:
    """Estimates of `OnlinePocket` at each sample of a recording: each uses the data until then.

    Parameters and errors as in `fg_nav.pocket.iterated_smoother.smooth_pocket`.
    """
    start = level_start(recording) if start is None else start
    acc, gyr = recording.integrable
    node = place_nodes(recording.t)
    links = preintegrate_links(node, recording.t, acc, gyr, recording.mag, np.zeros(3))
    ends = np.unique(np.append(np.arange(_EVERY, len(links), _EVERY), len(links)))
    window = FixedLagSmoother(build_prior(start, links, parameters), links.slice(0, ends[0]), parameters)
    R, b, P = [window.nodes.R[0]], [np.zeros(3)], [window.smoothed.P_ahead[0, :6, :6]]
    nis = []
    for first, last in zip(np.append(0, ends[:-1]), ends, strict=True):
        # smooth with the new links
        if first:
            window.extend(links.slice(first, last))
        # the last node is the estimate
        R.append(window.nodes.R[-1])
        b.append(window.nodes.b[-1])
        P.append(window.smoothed.P[-1, :6, :6])
        new = slice(-(last - first) - 1, -1)
        nis.append(np.stack([window.smoothed.swing_nis[new], window.smoothed.field_nis[new]], axis=1))
        if progress is not None:
            progress(last / len(links))
    at = node[np.append(0, ends)]
    R[0] = start.nav_R_body
    return propagate_track(recording, at, np.array(R), np.array(b), np.array(P), node[:-1], np.concatenate(nis))
