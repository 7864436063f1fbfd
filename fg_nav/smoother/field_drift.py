"""A heading that drifts far, set right by the field before it is solved for.

Gauss-Newton steps find the heading by the compass where it is off by less than a radian: its residual has a second zero
half a turn away. Without the field a heading drifts by more in minutes where no rest shows the bias, and in hours
anywhere. So the values from which the solver starts are bent back; the minimum stays where it is. With z_k the field
over ground at footfall k as the drifting heading has it, a complex number, and t_k the time,

    rate     r = argmax  |sum z_k exp(-i r t_k)| / mean |z| - r^2 / (2 sigma_r^2)        a constant bias
    drift_k  = r t_k + angle of the mean of z exp(-i r t) over `WINDOW` footfalls about k, less that of the first

each node is turned by minus what the drift is there, and so is each move from node to node.
"""

from __future__ import annotations

import gtsam
import numpy as np

from fg_nav.arrays import Floats
from fg_nav.smoother.graph import turn_walk
from fg_nav.smoother.strides import Nodes

MIN_WINDOW, MAX_WINDOW, PIECES = 40, 1024, 6
"""Footfalls of a window: a sixth of the walk, within these bounds. 40 of them on a rough floor show a heading to 10
deg, a kilometre and more to 1 deg."""

RATE_SIGMA_RAD_S = float(np.radians(0.3))  # Of the drift before the field has shown it: an uncalibrated bias.
MAX_RATES = 4096  # That are tried at most, half a radian apart at the end of the walk where there are enough.
MIN_DRIFT_RAD = 0.3  # Below it the solver needs no help.


def measure_drift(nav_field: Floats, t: Floats) -> Floats:
    """Return by how much the heading drifts (F,) rad, counter-clockwise, by the field (F, 3) uT; NaN rows are not seen.

    `t` (F,) s of the footfalls. Zero where there are fewer than two windows.
    """
    window = int(np.clip(len(nav_field) // PIECES, MIN_WINDOW, MAX_WINDOW))
    if len(nav_field) < 2 * window:
        return np.zeros(len(nav_field))
    level, since = np.nan_to_num(nav_field[:, 0] + 1j * nav_field[:, 1]), t - t[0]
    # The rate of a constant bias.
    spread = np.abs(level).mean()
    count = min(MAX_RATES, 3 + 2 * int(8.0 * RATE_SIGMA_RAD_S * since[-1]))
    rates = np.linspace(-4.0, 4.0, count) * RATE_SIGMA_RAD_S
    shown = np.array([np.abs((level * np.exp(-1j * rate * since)).sum()) for rate in rates]) / spread
    rate = rates[np.argmax(shown - 0.5 * (rates / RATE_SIGMA_RAD_S) ** 2)]
    # What is left of it, in windows.
    total = np.append(0.0, np.cumsum(level * np.exp(-1j * rate * since)))
    middle = np.arange(window // 2, len(level) - window // 2 + 1)
    angle = np.unwrap(np.angle(total[middle + window // 2] - total[middle - window // 2]))
    return np.asarray(rate * since + np.interp(np.arange(len(level)), middle, angle - angle[0]))


def remove_drift(values: gtsam.Values, nodes: Nodes, nav_field: Floats, t: Floats) -> gtsam.Values:
    """Return the values of a walk with its heading bent back where it has drifted far, else as they are."""
    drift = measure_drift(nav_field, t)
    if np.ptp(drift) < MIN_DRIFT_RAD:
        return values
    bent = gtsam.Values(values)
    turn_walk(bent, nodes, -np.interp(np.arange(len(nodes)), nodes.result, drift))
    return bent
