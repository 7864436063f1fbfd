"""Where the graph has its variables: a few samples of each stance.

A swing needs none. A stance has one at each end and more between, so that the inertial measurements in stance tie
the still middle to the rolling ends. Results are given at the stillest sample of each footfall: the nearest node is
moved onto it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.recording import Recording
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.stances import Stances

LONG_STANCE_S = 0.5
"""Beyond this length of a stance, nodes stand `rest_spacing_s` apart."""

REST_SPACING_S = 0.5

BIAS_SPACING_S = 10.0
"""Footfalls within this time share one bias: its random walk in between is 0.002 deg/s."""


@dataclass(frozen=True)
class Nodes:
    """Nodes of a walk, in order of time.

    ========= ==== ===========================================================
    sample    (M,) index into the recording, ascending
    interval  (M,) stance interval it stands in
    footfall  (M,) footfall it belongs to
    first     (F+1,) first node of each footfall, and M
    result    (F,) node of each footfall at its stillest sample
    bias      (F,) bias variable of each footfall, from 0, never falling
    ========= ==== ===========================================================
    """

    sample: Ints
    interval: Ints
    footfall: Ints
    first: Ints
    result: Ints
    bias: Ints

    def __len__(self) -> int:
        return len(self.sample)


def place_nodes(recording: Recording, stances: Stances, p: SmootherParameters) -> Nodes:
    """Place the nodes of all stances."""
    stillest = stances.stillest(recording.gyr)
    per_interval = [
        _interval_nodes(recording.t, start, stop, stillest[footfall], p)
        for start, stop, footfall in zip(stances.start, stances.stop, stances.footfall, strict=True)
    ]
    sample = np.concatenate(per_interval)
    interval = np.repeat(np.arange(len(stances)), [len(nodes) for nodes in per_interval])
    footfall = stances.footfall[interval]
    first = np.searchsorted(footfall, np.arange(stances.n_footfalls + 1))
    return Nodes(
        sample, interval, footfall, first, np.searchsorted(sample, stillest), _biases(recording.t[stillest], p)
    )


def _biases(t: Floats, p: SmootherParameters) -> Ints:
    """Number (F,) of the bias variable of each footfall, at times `t` (F,): a new one after each spacing."""
    spacing = np.floor((t - t[0]) / BIAS_SPACING_S).astype(np.int64)
    return np.cumsum(np.diff(spacing, prepend=spacing[0]) > 0)


def _interval_nodes(t: Floats, start: int, stop: int, stillest: int, p: SmootherParameters) -> Ints:
    """Nodes of one stance interval: evenly spaced, the one nearest to the stillest sample moved onto it."""
    duration = t[stop - 1] - t[start]
    if duration < 2 * p.shortest_interval_s:
        return np.array([stillest if start <= stillest < stop else (start + stop) // 2])
    dense = min(duration, LONG_STANCE_S)
    pieces = np.ceil(dense / p.node_spacing_s) + np.ceil((duration - dense) / REST_SPACING_S)
    nodes = np.round(np.linspace(start, stop - 1, int(pieces) + 1)).astype(np.int64)
    if start <= stillest < stop:
        nodes[np.argmin(np.abs(nodes - stillest))] = stillest
    return _apart(t, nodes, stillest, p.shortest_interval_s)


def _apart(t: Floats, nodes: Ints, keep: int, shortest: float) -> Ints:
    """Drop nodes that follow another too closely, but never `keep`."""
    kept = [nodes[0]]
    for node in nodes[1:]:
        if t[node] - t[kept[-1]] >= shortest:
            kept.append(node)
        elif node == keep:
            kept[-1] = node
    return np.array(kept, dtype=np.int64)
