"""From nodes to samples: what the graph knows, at the recording's rate."""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.factors.rotation import relative_rotations, rotation_exp, unskew
from fg_nav.pocket.ekf import KEPT_EVERY_S
from fg_nav.pocket.graph_chain import Nodes, Solved
from fg_nav.pocket.track import PocketTrack
from fg_nav.recording import Recording


def smoothed_track(recording: Recording, node: Ints, nodes: Nodes, solved: Solved) -> PocketTrack:
    """Nodes at samples `node` (K + 1,), joined by the gyroscope; bias and sigmas on straight lines."""
    t, at = recording.t, recording.t[node]
    every = max(round(KEPT_EVERY_S * (len(node) - 1) / (at[-1] - at[0])), 1)
    return PocketTrack(
        t=t,
        nav_R_body=_joined(recording, node, nodes),
        gyro_bias=_between(t, at, nodes.b),
        sigma=_between(t, at, np.sqrt(solved.P[:, range(6), range(6)])),
        covariance_sample=node[::every],
        covariance=np.ascontiguousarray(solved.P[::every, :6, :6]),
        gravity_nis=_at(node, solved.swing_nis, len(t)),
        field_nis=_at(node, solved.field_nis, len(t)) * (2.0 / 3.0),
    )


def causal_track(
    recording: Recording, at: Ints, R: Floats, b: Floats, P: Floats, node: Ints, nis: Floats
) -> PocketTrack:
    """Estimates R (M, 3, 3), b (M, 3) and P (M, 6, 6) at samples `at` (M,), carried on by the gyroscope till the next.

    `nis` (K, 2) of force and field at samples `node` (K,).
    """
    n = len(recording)
    segment = np.repeat(np.arange(len(at)), np.diff(np.append(at, n)))
    periods = np.append(np.diff(recording.t), recording.period_s)
    turned, _ = relative_rotations(recording.integrable[1], periods, segment, b)
    return PocketTrack(
        t=recording.t,
        nav_R_body=R[segment] @ turned,
        gyro_bias=b[segment],
        sigma=np.sqrt(P[:, range(6), range(6)])[segment],
        covariance_sample=at,
        covariance=P,
        gravity_nis=_at(node, nis[:, 0], n),
        field_nis=_at(node, nis[:, 1], n) * (2.0 / 3.0),
    )


def _joined(recording: Recording, node: Ints, nodes: Nodes) -> Floats:
    """Attitudes (N, 3, 3): from each node on by the gyroscope, what is left at the next one spread over the link."""
    gyr = recording.integrable[1]
    periods = np.append(np.diff(recording.t), recording.period_s)
    segment = np.append(np.repeat(np.arange(len(node) - 1), np.diff(node)), len(node) - 1)
    R, _ = relative_rotations(gyr, periods, segment, nodes.b)
    last = node[1:] - 1
    at_end = nodes.R[:-1] @ R[last] @ rotation_exp((gyr[last] - nodes.b[:-1]) * periods[last, None])
    left = unskew(nodes.R[1:] @ np.swapaxes(at_end, 1, 2))
    axis = np.concatenate([left, np.zeros((1, 3))])
    share = (recording.t - recording.t[node[segment]]) / np.append(np.diff(recording.t[node]), 1.0)[segment]
    return np.asarray(rotation_exp(axis[segment] * share[:, None]) @ nodes.R[segment] @ R)


def _between(t: Floats, at: Floats, x: Floats) -> Floats:
    return np.stack([np.interp(t, at, column) for column in x.T], axis=1)


def _at(node: Ints, values: Floats, samples: int) -> Floats:
    out = np.full(samples, np.nan)
    out[node] = values
    return out
