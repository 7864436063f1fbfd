"""A position that was fixed at an instant of the walk: at a surveyed point, or by a receiver.

Fixes are in the walk's own navigation frame, m: x east, y north, z up, from where the sensor stood in the first stance.
Whoever has a plan of the building subtracts the plan's coordinates of the start.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Floats


@dataclass(frozen=True)
class Fix:
    """Where the sensor was.

    Attributes
    ----------
    time_s : s, in the recording's own time.
    position : (3,) m, x east, y north, z up from the start; z does not count where `vertical_sigma_m` is infinite.
    horizontal_sigma_m : of x, and of y.
    vertical_sigma_m : of z; infinite where the height is not known.
    """

    time_s: float
    position: Floats
    horizontal_sigma_m: float
    vertical_sigma_m: float = np.inf
