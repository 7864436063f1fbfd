"""APDM Opal: the CSV exports of Motion Studio and Mobility Lab, all sensors of a session in one file.

*Format 7* has three header rows: `Format=7,5718,,,Lumbar,...` with number and name of each sensor above its columns,
`Time,Accelerometer,,,Gyroscope,,,Magnetometer,,,Barometer,Orientation,,,` and the axes. Time is in us since 1970.

The other has keys, such as `Sample Rate:,128,Hz`, then `Time,Lumbar/Acceleration/X,...`, then a row of units.

acc is in m/s^2, gyr in rad/s, mag in uT. The barometer and the orientation are left out.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.columns.units import Quantity, find_factor
from fg_nav.errors import FormatError
from fg_nav.io.choice import choose_sensor
from fg_nav.io.content import Content
from fg_nav.io.delimited import find_header
from fg_nav.io.text_columns import drop_held, read_table, require_factor, scale_values
from fg_nav.recording import Provenance, RawRecording

_QUANTITIES: dict[str, Quantity] = {
    "accelerometer": "acc",
    "acceleration": "acc",
    "gyroscope": "gyr",
    "angular velocity": "gyr",
    "magnetometer": "mag",
    "magnetic field": "mag",
}
_USUAL_UNITS: dict[Quantity, str] = {"time": "s", "acc": "m/s^2", "gyr": "rad/s", "mag": "uT"}
_PATH = re.compile(r"^(?:(.*)/)?([^/]+)/([XYZ])$")


class _Column(NamedTuple):
    """A column: which sensor, which quantity, which axis, in which unit (SI or uT)."""

    position: int
    sensor: str
    quantity: Quantity
    axis: str
    scale: float


def recognizes(content: Content) -> bool:
    """Whether the first line gives the number of the format, or a header has paths with acceleration or rate."""
    return _is_numbered(content) or _find_path_header(content) is not None


def read(content: Content) -> RawRecording:
    """Read one sensor of an export.

    Raises `FormatError` if a column is missing or doubled, a field is no number, or it is not said which of several
    sensors to take.
    """
    path = content.path
    columns, header, first_line, time_scale = _read_numbered(content) if _is_numbered(content) else _read_paths(content)
    sensors = list(dict.fromkeys(column.sensor for column in columns))
    if not sensors:
        raise FormatError(
            f"{path.name} has no columns of acceleration and angular velocity: export it again with them."
        )
    sensor = choose_sensor(sensors, content.sensor, path)
    wanted = [column for column in columns if column.sensor == sensor]
    has_mag = any(column.quantity == "mag" for column in wanted)
    quantities: tuple[Quantity, ...] = ("acc", "gyr", "mag") if has_mag else ("acc", "gyr")
    ordered = [_find_one(wanted, quantity, axis, sensor, path) for quantity in quantities for axis in "XYZ"]
    table, row = read_table(content, header, [0, *(column.position for column in ordered)], first_line)
    samples = scale_values(table[:, 1:], np.array([column.scale for column in ordered]))
    return RawRecording(
        t=scale_values(table[:, 0], time_scale),
        acc=samples[:, :3],
        gyr=samples[:, 3:6],
        mag=_mag(samples),
        row=row,
        provenance=Provenance(path=path, format="apdm", notes=(f"the sensor is '{sensor}'",)),
    )


def _mag(samples: Floats) -> Floats | None:
    return drop_held(samples[:, 6:], samples[:, 3:6]) if samples.shape[1] > 6 else None


def _is_numbered(content: Content) -> bool:
    return bool(content.lines) and content.lines[0].lstrip('"').startswith("Format=")


def _read_numbered(content: Content) -> tuple[list[_Column], list[str], int, float]:
    """Columns, header, first line of data and the unit of time of a file in format 7."""
    names, groups, axes = (content.fields(line) for line in range(3))
    width = max(len(names), len(groups), len(axes))
    names, groups, axes = ([*fields, *[""] * (width - len(fields))] for fields in (names, groups, axes))
    columns, header, block, group = [], ["Time"], "", ""
    for k in range(1, width):
        group = groups[k] or group
        if groups[k].lower() == "accelerometer":
            block = _name_block(names, groups, k)
        header.append(f"{block} {group} {axes[k]}".strip())
        quantity = _QUANTITIES.get(group.lower())
        if quantity and axes[k] in ("X", "Y", "Z"):
            columns.append(_Column(k, block, quantity, axes[k], 1.0))
    return columns, header, 4, 1e-6


def _name_block(names: list[str], groups: list[str], start: int) -> str:
    """Name of the sensor whose columns begin here: the words above them, its number where there are none."""
    later = (k for k in range(start + 1, len(groups)) if groups[k].lower() == "accelerometer")
    above = [name for name in names[start : next(later, len(groups))] if name]
    words = [name for name in above if not name.isdigit()]
    return " ".join(words or above) or f"sensor in column {start + 1}"


def _find_path_header(content: Content) -> list[str] | None:
    header = find_header(content, lambda names: _is_path_header(names))
    return None if header is None else header.names


def _is_path_header(names: list[str]) -> bool:
    paths = [_PATH.match(name) for name in names]
    return (
        bool(names)
        and names[0].lower().startswith("time")
        and any(match and match[2].lower() in _QUANTITIES for match in paths)
    )


def _read_paths(content: Content) -> tuple[list[_Column], list[str], int, float]:
    """Columns, header, first line of data and the unit of time of a file with paths for names."""
    header = find_header(content, _is_path_header)
    if header is None:
        raise FormatError(f"{content.path.name} has no header of APDM: export it again.")
    below = content.fields(header.line + 1)
    has_units = bool(below) and find_factor("time", below[0]) is not None
    units = [*below, *[""] * len(header.names)] if has_units else [""] * len(header.names)
    columns = []
    for k, name in enumerate(header.names):
        match = _PATH.match(name)
        quantity = _QUANTITIES.get(match[2].lower()) if match else None
        if match and quantity:
            scale = require_factor(quantity, units[k] or _USUAL_UNITS[quantity], name, content.path)
            columns.append(_Column(k, match[1] or "sensor", quantity, match[3], scale))
    first_line = header.line + (3 if has_units else 2)
    return (
        columns,
        header.names,
        first_line,
        require_factor("time", units[0] or _USUAL_UNITS["time"], "Time", content.path),
    )


def _find_one(columns: list[_Column], quantity: Quantity, axis: str, sensor: str, path: Path) -> _Column:
    found = [column for column in columns if column.quantity == quantity and column.axis == axis]
    if len(found) != 1:
        name = next(word for word, known in _QUANTITIES.items() if known == quantity)
        raise FormatError(
            f"{path.name} has {len(found)} columns '{name} {axis}' of '{sensor}' where one is needed: export it again."
        )
    return found[0]
