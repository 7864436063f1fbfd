"""The path of a walk in progress at the rate of its samples: through the nodes of its graph, with their biases.

Between two nodes it is strapdown, bent to meet the second (`smoother.graph`). Of a footfall after which the graph had
no solution only its row is known: a node at its stillest sample, without a bias of the accelerometer.
"""

from __future__ import annotations

from collections.abc import Sequence

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, V, X

from fg_nav.detection.rest import freeze_ends
from fg_nav.online.estimates import EstimateRow, split_rows
from fg_nav.online.handover import NO_NODES, PathNodes
from fg_nav.online.isam2 import ISAM2Backend
from fg_nav.online.strides import Place, StrideWindow
from fg_nav.recording import Recording
from fg_nav.smoother.dense_path import Trajectory, dense_trajectory
from fg_nav.stances import Stances


def nodes_of_rows(rows: Sequence[EstimateRow]) -> PathNodes:
    """Return a node for each of some rows."""
    known = split_rows(rows)
    unknown = np.zeros_like(known.gyro_bias)
    return PathNodes(known.sample, known.position, known.velocity, known.nav_R_body, known.gyro_bias, unknown)


def nodes_of_places(places: Sequence[Place], values: gtsam.Values) -> PathNodes:
    """Return the nodes of some footfalls in a graph."""
    if not places:
        return NO_NODES
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


def trace_stride(backend: ISAM2Backend, window: StrideWindow, gravity: float) -> Trajectory:
    """Return the path of the newest stride on the samples of its window."""
    nodes = range(window.before.first, window.place.stop)
    poses = [backend.pose(X(j)) for j in nodes]
    bias = [backend.bias(B(place.bias)).vector() for place in (window.before, window.place)]
    both = np.array(bias)[window.nodes.footfall - window.nodes.footfall[0]]
    return dense_trajectory(
        window.recording,
        window.nodes.sample,
        np.array([pose.translation() for pose in poses]),
        np.array([backend.vector(V(j)) for j in nodes]),
        np.array([pose.rotation().matrix() for pose in poses]),
        np.ascontiguousarray(both[:, 3:]),
        np.ascontiguousarray(both[:, :3]),
        gravity,
    )
