"""Where on the Earth a walk was: from East-North-Up about an origin to latitude, longitude and height (WGS 84).

East, north and up are tangent to the ellipsoid at the origin. `pymap3d` does the geodesy.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import OutputError

DEGREE_DIGITS, METER_DIGITS = 9, 3
"""Digits of degrees and heights in files: a ten-billionth of a degree is a hundredth of a millimeter."""


@dataclass(frozen=True)
class Origin:
    """Where the foot first stood: geodetic degrees, north and east positive; None for a height that is not known.

    Raises `OutputError` if it is not on the Earth.
    """

    latitude_deg: float
    longitude_deg: float
    height_m: float | None = None

    def __post_init__(self) -> None:
        latitude, longitude = self.latitude_deg, self.longitude_deg
        if abs(latitude) <= 90.0 and abs(longitude) <= 180.0 and math.isfinite(self.height_m or 0.0):
            return
        swapped = 90.0 < abs(latitude) <= 180.0 and abs(longitude) <= 90.0
        hint = f"latitude is first, try {longitude:g},{latitude:g}" if swapped else "give degrees, latitude first"
        raise OutputError(f"latitude {latitude:g}, longitude {longitude:g} is not on the Earth: {hint}.")

    @classmethod
    def parse(cls, words: str) -> Origin:
        """Read LAT,LON or LAT,LON,HEIGHT; raises `OutputError` for anything else."""
        try:
            numbers = [float(part) for part in words.split(",")]
        except ValueError:
            numbers = []
        if len(numbers) not in (2, 3):
            raise OutputError(f"--origin '{words}' is no place: give LAT,LON or LAT,LON,HEIGHT, as 48.137,11.575,520.")
        return cls(*numbers)

    def locate(self, position: Floats) -> Floats:
        """Longitude, latitude (deg) and height (m) (N, 3) of positions (N, 3) m, rounded as files have them.

        Heights are above the origin's, or above the start where that is not known.
        """
        from pymap3d import enu2geodetic

        at = (self.latitude_deg, self.longitude_deg, self.height_m or 0.0)
        latitude, longitude, height = enu2geodetic(*position.T, *at)
        degrees = np.round(np.stack([longitude, latitude], axis=1), DEGREE_DIGITS)
        return np.column_stack([degrees, np.round(height, METER_DIGITS)])
