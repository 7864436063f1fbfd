"""A heading that has drifted over hours, set right by the field before it is solved for.

Gauss-Newton steps find the heading by the field where it is off by some tenths of a radian. Without the field it drifts
by more in hours, and the solver then takes ten times as many steps. So the values from which it starts are bent back;
the minimum stays where it is. With m_k the horizontal field at footfall k as the drifting heading has it, averaged over
`WINDOW` footfalls, so that iron and steel average out,

    drift_k = angle(m_k) - angle(m_0),

each node is turned by minus what the drift is there, and so is each move from node to node.
"""

from __future__ import annotations

import gtsam
import numpy as np

from fg_nav.arrays import Floats
from fg_nav.smoother.graph import turn_walk
from fg_nav.smoother.strides import Nodes

WINDOW = 1024
"""Footfalls: a kilometer and more, through many regions of a building's field."""

LEAST_DRIFT_RAD = 0.3
"""Below it the solver needs no help."""


def measure_drift(nav_field: Floats) -> Floats:
    """Return by how much the heading drifts (F,) rad, counter-clockwise, by the field (F, 3) uT; NaN rows are not seen.

    Zero where the walk is too short to tell.
    """
    if len(nav_field) < 2 * WINDOW:
        return np.zeros(len(nav_field))
    level = np.nan_to_num(nav_field[:, 0] + 1j * nav_field[:, 1])
    total = np.append(0.0, np.cumsum(level))
    middle = np.arange(WINDOW // 2, len(level) - WINDOW // 2 + 1)
    mean = total[middle + WINDOW // 2] - total[middle - WINDOW // 2]
    angle = np.unwrap(np.angle(mean))
    return np.asarray(np.interp(np.arange(len(level)), middle, angle - angle[0]))


def remove_drift(values: gtsam.Values, nodes: Nodes, nav_field: Floats) -> gtsam.Values:
    """Return the values of a walk with its heading bent back where it has drifted far, else as they are."""
    drift = measure_drift(nav_field)
    if np.ptp(drift) < LEAST_DRIFT_RAD:
        return values
    bent = gtsam.Values(values)
    turn_walk(bent, nodes, -np.interp(np.arange(len(nodes)), nodes.result, drift))
    return bent
