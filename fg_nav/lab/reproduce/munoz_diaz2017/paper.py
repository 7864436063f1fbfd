"""What Munoz Diaz et al. (2017) print of their experiments: fields, errors, biases and the results they read off.

Fields are in East-North-Up. Sensor axes: z along the thigh, up when standing; in their walks x and y are level then.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

_DIP = np.radians(64.0)

FIELDS_UT: Mapping[str, tuple[float, float, float]] = MappingProxyType(
    {
        "north-pole": (0.0, 0.0, -65.0),
        "equator": (0.0, 25.0, 0.0),
        "munich": (0.0, 48.0 * float(np.cos(_DIP)), -48.0 * float(np.sin(_DIP))),
    }
)
"""Homogeneous fields in nav, uT (MD Table 1)."""


class Published(NamedTuple):
    """The figures of the paper; what is not here is not printed."""

    gyr_noise_deg_s: float = 0.1
    """White error of a rate sample, deg/s (MD Table 2); at which sampling rate is not said."""
    gyro_bias_deg_s: tuple[float, float, float] = (-0.1, 0.1, -0.1)
    """Added to the error-free rates, deg/s (MD Table 2)."""
    mag_noise_uT: float = 0.015
    """White error of a magnetometer sample, uT (MD Table 2)."""
    mtw_bias_start_deg_s: tuple[float, float, float] = (-0.12, 0.06, -0.12)
    """Of the MTw before the second walk, deg/s (MD Table 3)."""
    mtw_bias_end_deg_s: tuple[float, float, float] = (-0.13, 0.05, -0.22)
    """The same after it, deg/s (MD Table 3)."""
    minutes_north_pole: float = 29.0
    """When the z bias is there, by the field, min (3.1.2, Figure 9)."""
    minutes_equator: float = 10.0
    """The same."""
    minutes_munich: float = 15.0
    """The same."""
    minutes_perturbed: float = 32.0
    """The same in the perturbed field with the detector: "approached" (3.1.3, Figure 10c)."""
    minutes_walked: float = 39.0
    """Length of the first walk (3.1)."""


PUBLISHED = Published()
"""The paper."""
