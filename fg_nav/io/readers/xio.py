"""x-io sensors (NGIMU, x-IMU3): CSV whose header carries the units, `Gyroscope X (deg/s)`.

Columns are found by quantity and axis; the unit in brackets decides the scale, and a column without a known
unit is refused rather than guessed. A magnetometer in arbitrary units (`a.u.`) is left out, with a note.

The x-IMU3 writes a folder: `Inertial.csv` has force and rate, `Magnetometer.csv` the field at a rate of its own.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.columns.units import KNOWN_UNITS, Quantity, find_factor
from fg_nav.errors import FormatError
from fg_nav.io.content import Content
from fg_nav.io.streams import Stream, join_streams
from fg_nav.io.text_columns import drop_held, read_table, scale_values
from fg_nav.recording import Provenance, RawRecording

_QUANTITIES: dict[str, Quantity] = {
    "time": "time", "timestamp": "time", "accelerometer": "acc", "gyroscope": "gyr", "magnetometer": "mag",
}  # fmt: skip

_COLUMN = re.compile(
    r"^(time|timestamp|gyroscope|accelerometer|magnetometer)\s*([xyz]?)\s*(?:[(\[]\s*(.*?)\s*[)\]])?$",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class Column:
    """A column of the file: what it measures, along which axis, in which unit (SI or uT per unit)."""

    position: int
    quantity: str
    axis: str
    scale: float


def recognizes(content: Content) -> bool:
    """Whether the first line names a gyroscope or accelerometer axis as x-io does; a folder or archive, both parts."""
    if content.members:
        return None not in _find_parts(content)
    return any(re.match(r"(gyroscope|accelerometer)\s+[xyz]\b", name, re.IGNORECASE) for name in content.fields())


def read(content: Content) -> RawRecording:
    """Read an x-io CSV, or the folder of an x-IMU3.

    Raises `FormatError` if a column is missing or doubled, has no known unit, or a field is no number.
    """
    if content.members:
        return _read_parts(content)
    path, header = content.path, content.fields()
    columns = find_columns(header, path)
    wanted = [_find_one(columns, "time", "", path)]
    wanted += [
        _find_one(columns, quantity, axis, path) for quantity in ("accelerometer", "gyroscope") for axis in "xyz"
    ]
    magnetic = [column for column in columns if column.quantity == "magnetometer"]
    arbitrary = any(np.isnan(column.scale) for column in magnetic)
    if magnetic and not arbitrary:
        wanted += [_find_one(columns, "magnetometer", axis, path) for axis in "xyz"]
    table, row = read_table(content, header, [column.position for column in wanted], first_line=2)
    table = scale_values(table, np.array([column.scale for column in wanted]))
    notes = ("the magnetometer is in arbitrary units and was left out",) if arbitrary else ()
    return RawRecording(
        t=table[:, 0],
        acc=table[:, 1:4],
        gyr=table[:, 4:7],
        mag=_mag(table),
        row=row,
        provenance=Provenance(path=path, format="xio", notes=notes),
    )


def _find_parts(content: Content) -> tuple[Content | None, Content | None]:
    """Files right in a folder or archive with force and rate, and with the field; None where there is not one."""
    found: dict[frozenset[str], list[Content]] = {}
    for file in content.parts():
        matches = [match for match in map(_COLUMN.match, file.fields()) if match and match[2]]
        found.setdefault(frozenset(match[1].lower() for match in matches), []).append(file)
    kinds = frozenset({"gyroscope", "accelerometer"}), frozenset({"magnetometer"})
    inertial, magnetic = (found[kind][0] if len(found.get(kind, ())) == 1 else None for kind in kinds)
    return inertial, magnetic


def _read_parts(content: Content) -> RawRecording:
    inertial, magnetic = _find_parts(content)
    if inertial is None or magnetic is None:
        raise FormatError(f"{content.path.name} has no Inertial.csv beside Magnetometer.csv: give the one that it has.")
    raw, columns = read(inertial), find_columns(magnetic.fields(), magnetic.path)
    wanted = [_find_one(columns, "time", "", magnetic.path)]
    wanted += [_find_one(columns, "magnetometer", axis, magnetic.path) for axis in "xyz"]
    if any(np.isnan(column.scale) for column in wanted):
        notes = (f"{magnetic.path.name} is in arbitrary units and was left out",)
        return replace(raw, provenance=Provenance(path=content.path, format="xio", notes=notes))
    table, row = read_table(magnetic, magnetic.fields(), [column.position for column in wanted], first_line=2)
    table = scale_values(table, np.array([column.scale for column in wanted]))
    streams = [Stream("acc", raw.t, raw.acc, raw.row, inertial.path.name)]
    streams += [Stream("gyr", raw.t, raw.gyr, raw.row, inertial.path.name)]
    streams += [Stream("mag", table[:, 0], table[:, 1:], row, magnetic.path.name)]
    return join_streams(streams, content.path, "xio")


def find_columns(header: list[str], path: Path) -> list[Column]:
    """Find the columns of a header that are time, acc, gyr or mag.

    Raises `FormatError` if one of them has no unit or an unknown one.
    """
    columns = []
    for position, name in enumerate(header):
        match = _COLUMN.match(name)
        if match:
            quantity = match[1].lower().replace("timestamp", "time")
            scale = _scale(_QUANTITIES[match[1].lower()], match[3] or "", name, path)
            columns.append(Column(position, quantity, match[2].lower(), scale))
    return columns


def _scale(quantity: Quantity, unit: str, name: str, path: Path) -> float:
    factor = find_factor(quantity, unit)
    if factor is not None:
        return factor
    problem = f"the unit '{unit}', which is not known" if unit else "no unit"
    raise FormatError(f"{path.name}: column '{name}' has {problem}: write one of {KNOWN_UNITS[quantity]} in brackets.")


def _find_one(columns: list[Column], quantity: str, axis: str, path: Path) -> Column:
    found = [column for column in columns if column.quantity == quantity and column.axis == axis]
    if len(found) == 1:
        return found[0]
    name = f"{quantity} {axis}".strip()
    if not found:
        raise FormatError(f"{path.name} has no column '{name}': export the recording again with it.")
    raise FormatError(f"{path.name} has {len(found)} columns '{name}': keep one of them.")


def _mag(table: Floats) -> Floats | None:
    return drop_held(table[:, 7:10], table[:, 4:7]) if table.shape[1] > 7 else None
