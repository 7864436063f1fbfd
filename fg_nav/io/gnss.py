"""Fixes of a satellite receiver: the `Location.csv` of a phone's app in a folder or zip, or a CSV of the user's own.

============================ ==================================================================================
phyphox                      `Time (s)`, `Latitude (deg sign)`, `Longitude (..)`, `Horizontal Accuracy (m)`
Sensor Logger                `seconds_elapsed`, `latitude`, `longitude`, `horizontalAccuracy`
any CSV                      time (`time_s`, `t`), latitude (`lat_deg`), longitude (`lon`), accuracy (`hacc_m`)
============================ ==================================================================================

Time is that of the recording as read, s. Rows without a place or with an accuracy that is not above zero (iOS: -1 is
none) are no fixes. The origin is the first whose accuracy is no worse than twice the median.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from fg_nav.errors import FormatError
from fg_nav.gnss import Gnss
from fg_nav.io.content import read_content
from fg_nav.io.delimited import find_header
from fg_nav.io.readers import phyphox, sensor_logger
from fg_nav.truth import Fix

_UNITS = re.compile(r"\(.*\)|\[.*\]")

_COLUMNS = {
    "time": ("secondselapsed", "times", "time", "t", "seconds"),
    "latitude": ("latitude", "latitudedeg", "lat", "latdeg"),
    "longitude": ("longitude", "longitudedeg", "lon", "londeg", "lng"),
    "accuracy": ("horizontalaccuracy", "horizontalaccuracym", "accuracy", "accuracym", "hacc", "haccm", "sigmam"),
}
"""Names by their letters alone, without units, the first that is there."""


def read_gnss(path: Path | str) -> Gnss:
    """Read the fixes of a receiver from a table, or from the `Location.csv` in a folder or archive.

    Raises `FormatError` if there is no such table, a column is missing, or no row is a fix.
    """
    content = read_content(Path(path))
    tables = [one for place, one in content.members.items() if re.search(r"(^|/)location\.csv$", place, re.IGNORECASE)]
    if content.members and not tables:
        raise FormatError(
            f"{content.path.name} holds no Location.csv: record the location too, or give a CSV with time_s, latitude, "
            "longitude and accuracy."
        )
    table = tables[0] if tables else content
    # columns
    header = find_header(
        table, lambda names: bool(_find_column(names, "latitude") and _find_column(names, "longitude"))
    )
    names = [] if header is None else [_find_column(header.names, what) for what in _COLUMNS]
    if header is None or None in names:
        missing = [what for what, name in zip(_COLUMNS, names or [None] * 4, strict=True) if name is None]
        raise FormatError(
            f"{table.path.name} has no column of {', '.join(missing)}: fixes have time_s, latitude, longitude (deg) "
            "and accuracy (m)."
        )
    values, _ = header.read(table, [name for name in names if name is not None])
    # rows that are fixes
    t, latitude, longitude, accuracy = values[np.isfinite(values).all(axis=1)].T
    good = (np.abs(latitude) <= 90.0) & (np.abs(longitude) <= 360.0) & (accuracy > 0.0)
    if not good.any():
        raise FormatError(f"{table.path.name} holds no fix with an accuracy above zero: was there a view of the sky?")
    t, latitude, longitude, accuracy = (x[good] for x in (t, latitude, longitude, accuracy))
    if tables:
        t = phyphox.put_pauses_back(content, t) - sensor_logger.find_begin(content)
    # level axes of the origin
    from pymap3d import geodetic2enu

    first = int(np.argmax(accuracy <= 2.0 * np.median(accuracy)))
    origin = float(latitude[first]), float(longitude[first])
    east, north, _ = geodetic2enu(latitude, longitude, 0.0, *origin, 0.0)
    fixes = tuple(
        Fix(float(time), np.array([x, y, 0.0]), float(sigma))
        for time, x, y, sigma in zip(t, east, north, accuracy, strict=True)
    )
    return Gnss(fixes, *origin)


def _find_column(names: list[str], what: str) -> str | None:
    """Name of the column that is this; None without one."""
    letters = {re.sub(r"[^a-z]", "", _UNITS.sub("", name).lower()): name for name in names}
    return next((letters[word] for word in _COLUMNS[what] if word in letters), None)
