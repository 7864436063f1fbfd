"""CSV exports of LORD/MicroStrain SensorConnect, scaled or estimated.

========== ================================ ========================= ====================
export     acc                              gyr                       mag
========== ================================ ========================= ====================
scaled     `scaledAccelX/Y/Z`, g            `scaledGyro*`, rad/s      `scaledMag*`, gauss
estimated  `estCompensatedAccel*`, m/s^2    `estAngularRate*`, rad/s  none
========== ================================ ========================= ====================

Column names carry the sensor in front (`inertial-6253.76535:scaledAccelX`); estimated ones are followed by a
`:valid` column, and what is not valid is NaN here. Time is in seconds from the start. Both exports give
specific force in the same axes (z down on the 3DM series: about -1 g on z at rest). `estLinearAccel*` has
gravity removed and is refused. Rows of other data packets, with neither acc nor gyr, are left out.

The surveyed footprints of a walk stand next to the recording, in a MATLAB file of the same name.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.columns.units import GAUSS_UT
from fg_nav.errors import FormatError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.io.content import Content, read_content, split_fields
from fg_nav.io.text_columns import drop_held, find_column, read_table, scale_values
from fg_nav.io.truth import read_footprint_mat
from fg_nav.recording import Provenance, RawRecording
from fg_nav.truth import FootprintTruth

_EXPORTS = (("scaledAccel", "scaledGyro", GRAVITY_M_S2), ("estCompensatedAccel", "estAngularRate", 1.0))
"""Channels of acc and gyr, and the unit of acc in m/s^2; raw ones before those a filter has touched."""

_CHANNEL = re.compile(r"(scaledAccel|scaledGyro|estCompensatedAccel|estAngularRate|estLinearAccel)[XYZ]$")


def recognizes(content: Content) -> bool:
    """Whether one of the first lines is a header with SensorConnect's channel names."""
    return _find_header(content) is not None


def read(content: Content) -> RawRecording:
    """Read a SensorConnect CSV, with the footprints next to it if there are any.

    Raises `FormatError` if channels are missing or doubled, or a field is no number.
    """
    path, line = content.path, _find_header(content) or 0
    full_header = content.fields(line)
    header = [name.split(":", 1)[1] if ":" in name else name for name in full_header]
    channels, scale = _choose_channels(header, path)
    magnetic = [f"scaledMag{axis}" for axis in "XYZ"] if "scaledMagX" in header else []
    names = ["Time", *channels, *magnetic]
    flags = [f"{name}:valid" for name in channels if f"{name}:valid" in header]
    positions = [find_column(name, header, path) for name in names + flags]
    table, row = read_table(content, full_header, positions, first_line=line + 2)
    inertial = ~np.isnan(table[:, 1:7]).all(axis=1)
    table, row = table[inertial], row[inertial]
    _blank_invalid(table, names, flags)
    gyr = np.ascontiguousarray(table[:, 4:7])
    truth, notes = _read_footprints_of(path)
    return RawRecording(
        t=table[:, 0],
        acc=scale_values(table[:, 1:4], scale),
        gyr=gyr,
        row=row,
        mag=drop_held(scale_values(table[:, 7:10], GAUSS_UT), gyr) if magnetic else None,
        truth=truth,
        provenance=Provenance(path=path, format="sensorconnect", notes=notes),
    )


def _find_header(content: Content) -> int | None:
    """Newer exports put lines about the session before the header."""
    for index, text in enumerate(content.lines):
        if any(_CHANNEL.search(name) for name in split_fields(text)):
            return index
    return None


def _choose_channels(header: Sequence[str], path: Path) -> tuple[list[str], float]:
    """Name the channels of acc and gyr, and the unit of acc in m/s^2."""
    for acc, gyr, unit in _EXPORTS:
        if any(name.startswith((acc, gyr)) for name in header):
            return [name + axis for name in (acc, gyr) for axis in "XYZ"], unit
    raise FormatError(
        f"{path.name} holds estLinearAccel, from which gravity has been removed: "
        f"export scaledAccel or estCompensatedAccel instead."
    )


def _blank_invalid(table: Floats, names: Sequence[str], flags: Sequence[str]) -> None:
    """Set to NaN, in place, the samples whose `:valid` column is not 1."""
    for offset, flag in enumerate(flags):
        column = names.index(flag.removesuffix(":valid"))
        table[table[:, len(names) + offset] != 1.0, column] = np.nan


def _read_footprints_of(path: Path) -> tuple[FootprintTruth | None, tuple[str, ...]]:
    """Footprints in the MATLAB file of the same name, and a note if it is there but of no use."""
    truth = path.with_suffix(".mat")
    if truth == path or not truth.is_file():
        return None, ()
    try:
        return read_footprint_mat(read_content(truth)), ()
    except FormatError as error:
        return None, (f"the file next to it gave no truth: {error}",)
