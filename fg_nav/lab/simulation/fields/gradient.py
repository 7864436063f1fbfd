"""Gradient, divergence and curl of a field by central differences: what a map must show to be a magnetic field.

Away from its sources a static field has neither divergence nor curl (Maxwell), so its gradient is symmetric and has
no trace. With D(h) the central difference over +-h,

    dB_i / dx_j = (4 D(h/2) - D(h)) / 3 + O(h^4)        (Richardson).

Two centimetres are short against what bends a field half a metre from steel, and far above rounding.
"""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.lab.simulation.fields.field import Field

STEP_M = 0.02


def gradient(field: Field, position: Floats, step_m: float = STEP_M) -> Floats:
    """Gradient (N, 3, 3) uT/m at `position` (N, 3) m: row is the component of the field, column the direction."""
    coarse, fine = _central(field, position, step_m), _central(field, position, step_m / 2)
    return (4 * fine - coarse) / 3


def divergence(gradient: Floats) -> Floats:
    """Divergence (N,) uT/m of gradients (N, 3, 3)."""
    trace: Floats = np.trace(gradient, axis1=1, axis2=2)
    return trace


def curl(gradient: Floats) -> Floats:
    """Curl (N, 3) uT/m of gradients (N, 3, 3)."""
    turned = np.swapaxes(gradient, 1, 2) - gradient
    return np.stack([turned[:, 1, 2], turned[:, 2, 0], turned[:, 0, 1]], axis=1)


def _central(field: Field, position: Floats, step_m: float) -> Floats:
    shifts = step_m * np.eye(3)
    columns = [(field.at(position + shift) - field.at(position - shift)) / (2 * step_m) for shift in shifts]
    return np.stack(columns, axis=2)
