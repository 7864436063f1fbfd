"""The Earth's field of a place and date: strength, inclination, declination.

With strength F, inclination I (positive where the field points into the ground) and declination D (positive where a
compass points east of north), in East-North-Up

    B = F (cos I sin D, cos I cos D, -sin I).

It is that of the World Magnetic Model (US and UK defence agencies; one edition every five years), computed by
`pygeomag`, an extra of this project: it is asked for only when a place is. The model has the core's field; crust and
buildings add a degree or more to the declination on the spot.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import date, datetime
from importlib import import_module

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import EarthError
from fg_nav.text import suggest_install

PLACE_FORM = "latitude,longitude,YYYY-MM-DD"  # How a place and date are written, degrees north and east.


@dataclass(frozen=True)
class Place:
    """Where and when: degrees north and east (geodetic), the day, and the height in m above the WGS 84 ellipsoid."""

    latitude_deg: float
    longitude_deg: float
    day: date
    height_m: float = 0.0

    def __post_init__(self) -> None:
        if not (-90.0 <= self.latitude_deg <= 90.0 and -180.0 <= self.longitude_deg <= 180.0):
            raise EarthError(
                f"latitude {self.latitude_deg}, longitude {self.longitude_deg} is not on the Earth: "
                f"give degrees within -90 to 90 and -180 to 180."
            )

    @classmethod
    def parse(cls, words: str) -> Place:
        """Read a place from `PLACE_FORM`; raises `EarthError` for anything else."""
        try:
            latitude, longitude, day = (part.strip() for part in words.split(","))
            given = float(latitude), float(longitude), datetime.strptime(day, "%Y-%m-%d").date()
        except ValueError:
            raise EarthError(f"'{words}' is no place and date: give {PLACE_FORM}.") from None
        return cls(*given)


@dataclass(frozen=True)
class EarthField:
    """The field of a place: flux density `nav_field_uT` in East-North-Up; north is the geographic one."""

    nav_field_uT: tuple[float, float, float]

    @property
    def vector(self) -> Floats:
        """Flux density (3,) uT in nav."""
        return np.array(self.nav_field_uT)

    @property
    def strength_uT(self) -> float:
        """Flux density, uT."""
        return float(np.linalg.norm(self.vector))

    @property
    def inclination(self) -> float:
        """Angle of the field below the horizon, rad."""
        east, north, up = self.nav_field_uT
        return float(np.arctan2(-up, np.hypot(east, north)))

    @property
    def declination(self) -> float:
        """Angle of magnetic north, rad clockwise from true north: true heading = magnetic heading + declination."""
        east, north, _ = self.nav_field_uT
        return float(np.arctan2(east, north))


def compute_field(place: Place) -> EarthField:
    """Return the field (uT; east, north, up) of the World Magnetic Model at a place and day.

    Raises `EarthError` without the extra `wmm`, or for a day of no edition that `pygeomag` knows (2010 to 2029).
    """
    try:
        library = import_module("pygeomag")
    except ModuleNotFoundError:
        raise EarthError(
            f"the World Magnetic Model needs a library that is not installed: {suggest_install('wmm')}."
        ) from None
    try:
        model = library.GeoMag(base_year=place.day.year)
        first, next_first = date(place.day.year, 1, 1), date(place.day.year + 1, 1, 1)
        year = place.day.year + (place.day - first).days / (next_first - first).days
        found = model.calculate(glat=place.latitude_deg, glon=place.longitude_deg, alt=place.height_m / 1000, time=year)
    except ValueError as error:
        raise EarthError(
            f"the World Magnetic Model knows no field of {place.day} ({error}): name a date from 2010 to 2029."
        ) from None
    return EarthField((found.y / 1000, found.x / 1000, -found.z / 1000))
