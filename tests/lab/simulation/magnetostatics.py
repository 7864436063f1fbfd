"""Divergence and curl of a field by differences: away from its sources a static field has neither."""

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.lab.simulation.fields import Field

STEP_M = 0.02  # Short against what bends a field half a metre from steel, and far above rounding.


def compute_gradient(field: Field, position: Floats) -> Floats:
    """Gradient (N, 3, 3) uT/m: row is the component of the field, column the direction; by Richardson's differences."""

    def central(step_m: float) -> Floats:
        shifts = step_m * np.eye(3)
        columns = [(field.at(position + shift) - field.at(position - shift)) / (2 * step_m) for shift in shifts]
        return np.stack(columns, axis=2)

    return (4 * central(STEP_M / 2) - central(STEP_M)) / 3


def measure_sources(field: Field, position: Floats) -> tuple[Floats, Floats, Floats]:
    """Divergence (N,) and curl (N,) uT/m, absolute, and the size (N,) of the gradient."""
    gradient = compute_gradient(field, position)
    curl = np.linalg.norm(gradient - np.swapaxes(gradient, 1, 2), axis=(1, 2)) / np.sqrt(2)
    return np.abs(np.trace(gradient, axis1=1, axis2=2)), curl, np.linalg.norm(gradient, axis=(1, 2))


def is_magnetic(field: Field, position: Floats, least: float = 0.0) -> bool:
    """Whether there are no sources where one is, to 1e-4 of the largest gradient, or of this many uT/m."""
    divergence, curl, size = measure_sources(field, position)
    return bool(max(divergence.max(), curl.max()) <= 1e-4 * max(size.max(), least))
