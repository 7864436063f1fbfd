"""x-io sensors (NGIMU, x-IMU3): CSV whose header carries the units, `Gyroscope X (deg/s)`.

Columns are found by quantity and axis; the unit in brackets decides the scale, and a column without a known
unit is refused rather than guessed. A magnetometer in arbitrary units (`a.u.`) is left out, with a note.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.columns.units import KNOWN_UNITS, Quantity, find_factor
from fg_nav.errors import FormatError
from fg_nav.io.content import Content, drop_held, read_table, scale_values
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
    """Whether the first line names a gyroscope or accelerometer axis as x-io does."""
    return any(re.match(r"(gyroscope|accelerometer)\s+[xyz]\b", name, re.IGNORECASE) for name in content.fields())


def read(content: Content) -> RawRecording:
    """Read an x-io CSV.

    Raises `FormatError` if a column is missing or doubled, has no known unit, or a field is no number.
    """
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
