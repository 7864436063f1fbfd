"""YEI 3-Space: CSV below a comment that names its columns, `# Data format: "%int(ChipTimeUS),%float(RawGyroX),..."`.

========================== ==========================================
`ChipTimeUS`               us, of 32 bits
`...GyroX`                 rad/s
`...AccelX`                g
`...CompassX`              gauss
========================== ==========================================

What is before the sensor's name is `Corrected` (by the calibration in the sensor) or `Raw`; the corrected one is taken
where both are there. `Normalized` vectors have lost their length: no specific force and no field can be had from them.
"""

from __future__ import annotations

import re

import numpy as np

from fg_nav.columns.units import GAUSS_UT
from fg_nav.errors import FormatError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.io.content import Content
from fg_nav.io.counters import TICKS_32_BIT, continue_counter
from fg_nav.io.text_columns import drop_held, find_column, read_table, scale_values
from fg_nav.recording import Provenance, RawRecording
from fg_nav.text import format_count

_NAMES = re.compile(r"%\w+\(([^)]*)\)")
_TIME = "ChipTimeUS"
_KINDS = ("Corrected", "Raw")


def recognizes(content: Content) -> bool:
    """Whether the first line is such a comment."""
    return bool(_find_names(content)) and "Data format" in content.lines[0]


def read(content: Content) -> RawRecording:
    """Read a log of the 3-Space software.

    Raises `FormatError` if a column is missing or doubled, or a field is no number.
    """
    path, names = content.path, _find_names(content)
    acc, gyr, mag = (_find_kind(names, sensor) for sensor in ("Accel", "Gyro", "Compass"))
    for found, sensor in ((acc, "Accel"), (gyr, "Gyro")):
        if not found:
            raise FormatError(f"{path.name} has no columns Raw{sensor}X, Y, Z: log them with the other sensors.")
    wanted = [_TIME, *acc, *gyr, *mag]
    table, row = read_table(content, names, [find_column(name, names, path) for name in wanted], first_line=2)
    ticks, rounds = continue_counter(table[:, 0], TICKS_32_BIT)
    gyr_rad_s = np.ascontiguousarray(table[:, 4:7])
    notes = (f"{_TIME} began again at its end {format_count(rounds, 'time')}: set on",) if rounds else ()
    return RawRecording(
        t=ticks * 1e-6,
        acc=scale_values(table[:, 1:4], GRAVITY_M_S2),
        gyr=gyr_rad_s,
        mag=drop_held(scale_values(table[:, 7:10], GAUSS_UT), gyr_rad_s) if mag else None,
        row=row,
        provenance=Provenance(
            path=path,
            format="yei",
            notes=notes,
        ),
    )


def _find_names(content: Content) -> list[str]:
    first = content.lines[0] if content.lines else ""
    return _NAMES.findall(first) if first.lstrip().startswith("#") else []


def _find_kind(names: list[str], sensor: str) -> list[str]:
    """Columns of the best kind there is of a sensor; empty without one."""
    for kind in _KINDS:
        if f"{kind}{sensor}X" in names:
            return [f"{kind}{sensor}{axis}" for axis in "XYZ"]
    return []
