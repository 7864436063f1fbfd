"""VectorNav: CSV as INSTINCT converts the sensor's binary output, with names such as `IMU::Accel::X [m/s^2]`.

`Time::TimeStartup [ns]` is the clock; the columns before it are empty until satellites give their time. `Accel`,
`AngularRate` and `Mag` are compensated by the sensor's filter and calibration; `UncompAccel`, `UncompGyro` and
`UncompMag` stand beside them, and are taken where the others are absent. The unit is in brackets; where it is missing
on one axis, that of the other axes holds.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

from fg_nav.columns.units import Quantity
from fg_nav.errors import FormatError
from fg_nav.io.content import Content
from fg_nav.io.text_columns import drop_held, read_table, require_factor, scale_values
from fg_nav.recording import Provenance, RawRecording

_COLUMN = re.compile(
    r"^(?:\w+::)?(Uncomp)?(Accel|Gyro|AngularRate|Mag)(?:::|\s)([XYZ])\s*(?:\[(.*)\])?$", re.IGNORECASE
)
_CLOCK = re.compile(r"^(?:Time::)?TimeStartup\s*(?:\[(.*)\])?$", re.IGNORECASE)
_QUANTITIES: dict[str, Quantity] = {"accel": "acc", "gyro": "gyr", "angularrate": "gyr", "mag": "mag"}
_WORDS: dict[str, str] = {"time": "time since startup", "acc": "acceleration", "gyr": "angular rate", "mag": ""}


class _Axes(NamedTuple):
    """Columns (3,) of a sensor, the size of its unit in SI or uT, and the remarks."""

    positions: list[int]
    scale: float
    remarks: tuple[str, ...]


def recognizes(content: Content) -> bool:
    """Whether the first line has VectorNav's time since startup, or its names below `IMU::`."""
    header = content.fields()
    return any(_CLOCK.match(name) or (name.startswith("IMU::") and _COLUMN.match(name)) for name in header)


def read(content: Content) -> RawRecording:
    """Read a VectorNav CSV.

    Raises `FormatError` if a column is missing or doubled, has no known unit, or a field is no number.
    """
    path, header = content.path, content.fields()
    clock = _find_clock(header, path)
    acc, gyr, mag = (_find_axes(header, quantity, path) for quantity in ("acc", "gyr", "mag"))
    for axes, quantity in ((acc, "acc"), (gyr, "gyr")):
        if axes is None:
            raise FormatError(
                f"{path.name} has no {_WORDS[quantity]}: export it again with the outputs of the IMU group."
            )
    assert acc is not None
    assert gyr is not None
    found = [axes for axes in (clock, acc, gyr, mag) if axes is not None]
    table, row = read_table(content, header, [position for axes in found for position in axes.positions], first_line=2)
    rates = scale_values(table[:, 4:7], gyr.scale)
    return RawRecording(
        t=scale_values(table[:, 0], clock.scale),
        acc=scale_values(table[:, 1:4], acc.scale),
        gyr=rates,
        mag=drop_held(scale_values(table[:, 7:10], mag.scale), rates) if mag else None,
        row=row,
        provenance=Provenance(
            path=path, format="vectornav", notes=tuple(remark for axes in found for remark in axes.remarks)
        ),
    )


def _find_clock(header: list[str], path: Path) -> _Axes:
    found = [(k, match) for k, match in enumerate(map(_CLOCK.match, header)) if match]
    if len(found) != 1:
        raise FormatError(f"{path.name} has {len(found)} columns 'TimeStartup': export it again with one.")
    position, match = found[0]
    return _Axes([position], require_factor("time", match[1] or "ns", header[position], path), ())


def _find_axes(header: list[str], quantity: Quantity, path: Path) -> _Axes | None:
    """Columns of a quantity: compensated ones if there are any; None without."""
    found = [(k, match) for k, match in enumerate(map(_COLUMN.match, header)) if match]
    found = [(k, match) for k, match in found if _QUANTITIES[match[2].lower()] == quantity]
    compensated = [(k, match) for k, match in found if not match[1]]
    chosen = compensated or found
    if not chosen:
        return None
    axes = "".join(match[3].upper() for _, match in chosen)
    if sorted(axes) != list("XYZ"):
        name = header[chosen[0][0]]
        raise FormatError(f"{path.name} has the axes {axes} of '{name}', not X, Y and Z once each: export it again.")
    units = {match[4] for _, match in chosen if match[4]}
    if len(units) != 1:
        raise FormatError(f"{path.name}: '{header[chosen[0][0]]}' has no one unit for its axes: write it in brackets.")
    unit, name = units.pop(), chosen[0][1][2]
    remarks = [] if compensated else [f"{name} is not compensated by the sensor: the file has nothing else"]
    if any(not match[4] for _, match in chosen):
        remarks.append(f"an axis of {name} has no unit: that of the others, {unit}, is taken")
    positions = [chosen[axes.index(axis)][0] for axis in "XYZ"]
    return _Axes(positions, require_factor(quantity, unit, header[positions[0]], path), tuple(remarks))
