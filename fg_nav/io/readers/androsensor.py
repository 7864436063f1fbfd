"""AndroSensor (Android): a table of all sensors at a chosen rate, `ACCELEROMETER X (m/s²);...;Time since start in ms`.

`ACCELEROMETER` is specific force, m/s^2, with `GRAVITY` and `LINEAR ACCELERATION` beside it; `GYROSCOPE` rad/s;
`MAGNETIC FIELD` uT. Names end in blanks, and units have been through many hands: they are those of the app where they
cannot be read. Fields are separated by semicolon or comma. The rate that the app proposes, 2 Hz, is too low for a walk.
"""

from __future__ import annotations

import re

import numpy as np

from fg_nav.columns.units import find_factor
from fg_nav.errors import FormatError
from fg_nav.io.content import Content
from fg_nav.io.delimited import Header, find_header
from fg_nav.io.streams import Sensor, Stream, join_streams
from fg_nav.io.text_columns import scale_values
from fg_nav.recording import RawRecording

_COLUMN = re.compile(r"(ACCELEROMETER|LINEAR ACCELERATION|GYROSCOPE|MAGNETIC FIELD) ([XYZ])\b\s*\(?([^)]*)\)?")
_SENSORS: dict[str, Sensor] = {"ACCELEROMETER": "acc", "GYROSCOPE": "gyr", "MAGNETIC FIELD": "mag"}
_TIME = re.compile(r"Time since start in ms", re.IGNORECASE)


def recognizes(content: Content) -> bool:
    """Whether a header has the time since the start and a sensor in capitals."""
    return _find_header(content) is not None


def _find_header(content: Content) -> Header | None:
    return find_header(content, lambda names: any(map(_TIME.match, names)) and any(map(_COLUMN.match, names)))


def read(content: Content) -> RawRecording:
    """Read a recording.

    Raises `FormatError` if acceleration with gravity or rotation are absent, the rate is too low, or a field is no
    number.
    """
    path, header = content.path, _find_header(content)
    if header is None:
        raise FormatError(f"{path.name} has no columns 'Time since start in ms' and of sensors: record it again.")
    columns = {(match[1], match[2]): (name, match[3]) for name in header.names if (match := _COLUMN.match(name))}
    if ("ACCELEROMETER", "X") not in columns and ("LINEAR ACCELERATION", "X") in columns:
        raise FormatError(
            f"{path.name} holds LINEAR ACCELERATION, from which gravity has been removed: record ACCELEROMETER along."
        )
    clock = next(name for name in header.names if _TIME.match(name))
    streams = []
    for word, what in _SENSORS.items():
        axes = [columns[word, axis] for axis in "XYZ" if (word, axis) in columns]
        if len(axes) == 3:
            values, row = header.read(content, [clock, *(name for name, _ in axes)])
            units = [find_factor(what, unit) or 1.0 for _, unit in axes]
            scaled = scale_values(values, np.array([1e-3, *units]))
            streams.append(Stream(what, scaled[:, 0], scaled[:, 1:], row, word))
    return join_streams(streams, path, "androsensor")
