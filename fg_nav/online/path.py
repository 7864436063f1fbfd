"""The path of a walk in progress at the rate of its samples: through the nodes of its graph, with their biases.

Between two nodes it is strapdown, bent to meet the second (`smoother.graph`). Of a footfall that left the graph only
its row is known: a node at its stillest sample, without a bias of the accelerometer.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, V, X

from fg_nav.arrays import Floats, Ints
from fg_nav.detection.rest import freeze_ends
from fg_nav.online.backend import Backend
from fg_nav.online.estimates import EstimateRow, split_rows
from fg_nav.online.strides import Place, StrideWindow
from fg_nav.recording import Recording
from fg_nav.smoother.graph import Trajectory, dense_trajectory
from fg_nav.stances import Stances


class PathNodes(NamedTuple):
    """Samples (M,) of the walk, and at each position (m), velocity (m/s), attitude, gyro (rad/s) and force bias."""

    sample: Ints
    position: Floats
    velocity: Floats
    nav_R_body: Floats
    gyro_bias: Floats
    acc_bias: Floats


def collect_nodes(frozen: Sequence[EstimateRow], places: Sequence[Place], values: gtsam.Values) -> PathNodes:
    """Return the nodes of a walk: of the footfalls that left its graph, then of those in it."""
    rows = split_rows(frozen)
    before = PathNodes(
        rows.sample, rows.position, rows.velocity, rows.nav_R_body, rows.gyro_bias, np.zeros_like(rows.gyro_bias)
    )
    return PathNodes(*(np.concatenate(both) for both in zip(before, _nodes_in_graph(places, values), strict=True)))


def _nodes_in_graph(places: Sequence[Place], values: gtsam.Values) -> PathNodes:
    nodes = [j for place in places for j in range(place.first, place.stop)]
    poses = [values.atPose3(X(j)) for j in nodes]
    bias = [values.atConstantBias(B(place.bias)).vector() for place in places for _ in place.samples]
    acc_bias, gyro_bias = np.split(np.array(bias), 2, axis=1)
    return PathNodes(
        np.array([sample for place in places for sample in place.samples]),
        np.array([pose.translation() for pose in poses]),
        np.array([values.atVector(V(j)) for j in nodes]),
        np.array([pose.rotation().matrix() for pose in poses]),
        gyro_bias,
        acc_bias,
    )


def build_path(
    recording: Recording, nodes: PathNodes, stances: Stances, gravity: float
) -> tuple[Trajectory, tuple[str, ...]]:
    """Return the path of a whole walk with these nodes and stances, and notes on its ends."""
    attitude, gyro_bias, acc_bias = nodes.nav_R_body, nodes.gyro_bias, nodes.acc_bias
    path = dense_trajectory(
        recording, nodes.sample, nodes.position, nodes.velocity, attitude, gyro_bias, acc_bias, gravity
    )
    return path, freeze_ends(recording.t, stances, path.position, path.velocity)


def trace_stride(
    backend: Backend, recording: Recording, window: StrideWindow, begins: int, gravity: float
) -> Trajectory:
    """Return the path of the newest stride on its samples, which begin there in the window."""
    nodes = range(window.before.first, window.place.stop)
    poses = [backend.pose(X(j)) for j in nodes]
    bias = [backend.bias(B(place.bias)).vector() for place in (window.before, window.place)]
    both = np.array(bias)[window.nodes.footfall - window.nodes.footfall[0]]
    return dense_trajectory(
        recording,
        window.nodes.sample - begins,
        np.array([pose.translation() for pose in poses]),
        np.array([backend.vector(V(j)) for j in nodes]),
        np.array([pose.rotation().matrix() for pose in poses]),
        np.ascontiguousarray(both[:, 3:]),
        np.ascontiguousarray(both[:, :3]),
        gravity,
    )
