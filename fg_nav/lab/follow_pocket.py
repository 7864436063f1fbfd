"""Estimates of `fg_nav.pocket.OnlinePocket` at each sample of a recording, for experiments."""

from __future__ import annotations

import numpy as np

from fg_nav.factors.rotation import relative_rotations
from fg_nav.pocket.iterated_smoother import FixedLagSmoother, PocketSmootherParameters, build_prior, scatter_nis
from fg_nav.pocket.kalman_smoother import place_nodes, preintegrate_links
from fg_nav.pocket.online import UPDATE_LINKS
from fg_nav.pocket.track import PocketStart, PocketTrack, level_start
from fg_nav.recording import Recording


def follow_pocket(
    recording: Recording,
    parameters: PocketSmootherParameters = PocketSmootherParameters(),
    start: PocketStart | None = None,
) -> PocketTrack:
    """Estimates with the data until then; parameters and errors as of `fg_nav.pocket.smooth_pocket`."""
    start = level_start(recording) if start is None else start
    acc, gyr = recording.integrable
    node = place_nodes(recording.t)
    links = preintegrate_links(node, recording.t, acc, gyr, recording.mag)
    ends = np.unique(np.append(np.arange(UPDATE_LINKS, len(links.h), UPDATE_LINKS), len(links.h)))
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
    at = node[np.append(0, ends)]
    R[0] = start.nav_R_body
    swing, field = np.concatenate(nis).T
    # between the estimates by the gyroscope
    n = len(recording)
    segment = np.repeat(np.arange(len(at)), np.diff(np.append(at, n)))
    turned, _ = relative_rotations(recording.integrable[1], recording.periods_s, segment, np.array(b))
    return PocketTrack(
        recording.t,
        np.array(R)[segment] @ turned,
        np.array(b)[segment],
        np.sqrt(np.array(P)[:, range(6), range(6)])[segment],
        at,
        np.array(P),
        *scatter_nis(node[:-1], swing, field, n),
    )
