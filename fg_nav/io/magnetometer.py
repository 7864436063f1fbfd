"""A magnetometer slower than the rest of the sensor: its held samples are no measurements.

Many loggers repeat the last magnetometer sample until there is a new one. An estimator that counted each
repeat as a measurement would believe the field several times over.
"""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Floats

_MOVING_RAD_S = 0.5
"""Turning this fast, no real magnetometer gives the same three numbers twice by chance."""

_HELD_SHARE = 0.1
"""More repeats than this in motion are the logger's doing, not the quantisation's."""


def without_held(mag: Floats, gyr: Floats) -> Floats:
    """Set rows of `mag` (N, 3) that repeat the row before exactly to NaN, if the logger holds samples at all.

    `gyr` (N, 3) rad/s tells the motion: repeats at rest alone are quantisation, and stay.
    """
    repeated = np.concatenate(([False], (mag[1:] == mag[:-1]).all(axis=1)))
    moving = (np.abs(gyr) > _MOVING_RAD_S).any(axis=1)
    judged = repeated[moving] if np.count_nonzero(moving) >= 100 else repeated
    if judged.mean() < _HELD_SHARE:
        return mag
    return np.where(repeated[:, None], np.nan, mag)
