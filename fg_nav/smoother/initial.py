"""Where the solver starts: dead reckoning, stopped at every node.

Strapdown from node to node; at a node the velocity is set to zero, the position gives back what the linear growth of
the velocity error added, and while the foot stands the tilt is nudged towards gravity. Good to some degrees and
per cents, which Gauss-Newton needs no better.
"""

from __future__ import annotations

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, S, V, X
from numba import njit

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.mechanisation import TILT_TIME_S, NavState, nudge_tilt, strapdown
from fg_nav.recording import Recording
from fg_nav.smoother.nodes import Nodes
from fg_nav.stances import Stances


def initial_values(
    recording: Recording,
    stances: Stances,
    nodes: Nodes,
    nav_R_body: Floats,
    gyro_bias: Floats,
    gravity: float,
) -> gtsam.Values:
    """Values of all variables; `nav_R_body` (3, 3) is the attitude at the first node."""
    position, attitude = _stop_and_go(
        recording.t,
        *recording.integrable,
        stances.mask,
        nodes.sample,
        nav_R_body,
        gyro_bias,
        gravity,
    )
    values = gtsam.Values()
    rest = np.zeros(3)
    for j in range(len(nodes)):
        values.insert(X(j), gtsam.Pose3(gtsam.Rot3(attitude[j]), position[j]))
        values.insert(V(j), rest)
    bias = gtsam.imuBias.ConstantBias(rest, gyro_bias)
    for k in range(nodes.bias[-1] + 1):
        values.insert(B(k), bias)
        values.insert(S(k), np.zeros(1))
    return values


def turn_walk(values: gtsam.Values, nodes: Nodes, nav_R_nav: Floats) -> None:
    """Turn the poses and velocities of a walk about its origin, in place."""
    about = gtsam.Pose3(gtsam.Rot3(nav_R_nav), np.zeros(3))
    for j in range(len(nodes)):
        values.update(X(j), about.compose(values.atPose3(X(j))))
        values.update(V(j), nav_R_nav @ values.atVector(V(j)))


@njit(cache=True)
def _stop_and_go(
    t: Floats,
    acc: Floats,
    gyr: Floats,
    stands: Bools,
    sample: Ints,
    nav_R_body: Floats,
    gyro_bias: Floats,
    gravity: float,
) -> tuple[Floats, Floats]:
    """Position (M, 3) and attitude (M, 3, 3) at the nodes."""
    position, attitude = np.zeros((len(sample), 3)), np.empty((len(sample), 3, 3))
    state = NavState(np.zeros(3), np.zeros(3), nav_R_body.copy(), gyro_bias, np.zeros(3))
    turn, push = np.empty((3, 3)), np.empty(3)
    attitude[0] = nav_R_body
    for j in range(1, len(sample)):
        for i in range(sample[j - 1], sample[j]):
            h = t[i + 1] - t[i]
            strapdown(state, acc[i], gyr[i], h, gravity, turn, push)
            if stands[i]:
                nudge_tilt(state.nav_R_body, acc[i], min(h / TILT_TIME_S, 1.0))
        state.position[:] -= state.velocity * (0.5 * (t[sample[j]] - t[sample[j - 1]]))
        state.velocity[:] = 0.0
        position[j], attitude[j] = state.position, state.nav_R_body
    return position, attitude
