"""Shimmer Consensys: CSV with a row of names, `Shimmer_40AC_Accel_LN_X_CAL`, and a row of units below it.

A line `"sep=;"` stands above them, or not; fields are separated by tab, semicolon or comma. Each name begins with that
of the device.

============================== ================================================================================
`Timestamp_Unix_CAL`           ms since 1970, whole; or `..._FormattedUnix_CAL`, as `2017/11/14 17:07:24.254`
`Accel_LN_X_CAL`, `Accel_WR_`  m/s^2, of low noise (2 g) and of wide range (to 16 g): two chips, not in one frame
`Gyro_X_CAL`                   deg/s
`Mag_X_CAL`                    `local_flux`: of the local field, which is 1, taken for 48 uT
============================== ================================================================================

The accelerometer of low noise is taken where both are there: its frame is the gyroscope's. Columns `_RAW` are counts.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from fg_nav.arrays import Floats, Ints
from fg_nav.columns.units import Quantity, find_factor
from fg_nav.errors import FormatError
from fg_nav.io.choice import choose_sensor
from fg_nav.io.content import Content
from fg_nav.io.delimited import Header, find_header, split_line
from fg_nav.io.readers.xsens_columns import scale_local_field
from fg_nav.io.text_columns import drop_held, scale_values
from fg_nav.recording import Provenance, RawRecording

_NAME = re.compile(
    r"^(?P<device>.*?)_?(?P<what>Accel_LN|Accel_WR|Accel|Gyro|Mag)_(?P<axis>[XYZ])_CAL$|"
    r"^(?P<clock_device>.*?)_?(?P<clock>Timestamp(?:Sync)?(?:_(?:Sync)?(?:Unix|FormattedUnix))?)_CAL$"
)
_SOURCES: tuple[tuple[Quantity, tuple[str, ...]], ...] = (
    ("acc", ("Accel_LN", "Accel", "Accel_WR")),
    ("gyr", ("Gyro",)),
    ("mag", ("Mag",)),
)
_WORDS: dict[str, str] = {"acc": "accelerometer", "gyr": "gyroscope", "mag": "magnetometer"}


class _Columns(NamedTuple):
    """Names of the columns of one device."""

    clock: str
    sources: dict[Quantity, str]
    axes: dict[Quantity, list[str]]


def recognizes(content: Content) -> bool:
    """Whether one of the first lines has names as Consensys gives them."""
    return _find_header(content) is not None


def read(content: Content) -> RawRecording:
    """Read one device of an export of Consensys.

    Raises `FormatError` if a column is missing or doubled, a unit is not known, a field is no number or no time, or it
    is not said which of several devices to take.
    """
    path, header = content.path, _find_header(content)
    if header is None:
        raise FormatError(f"{path.name} has no calibrated columns of a Shimmer: export it again with them.")
    units = _find_units(content, header)
    device = choose_sensor(_list_devices(header), content.sensor, path)
    columns = _choose_columns(header, device, path)
    scales = {quantity: _find_scale(names, quantity, header, units, path) for quantity, names in columns.axes.items()}
    skip = 1 if units else 0
    table, row = header.read(content, [name for names in columns.axes.values() for name in names], skip)
    samples = {
        quantity: scale_values(table[:, 3 * k : 3 * k + 3], scales[quantity]) for k, quantity in enumerate(columns.axes)
    }
    mag, said = samples.get("mag"), tuple[str, ...]()
    if mag is not None and np.isnan(scales["mag"]):
        mag, said = scale_local_field(table[:, -3:], samples["gyr"])
    elif mag is not None:
        mag = drop_held(mag, samples["gyr"])
    return RawRecording(
        t=_read_time(columns.clock, header, units, skip, row, content),
        acc=samples["acc"],
        gyr=samples["gyr"],
        mag=mag,
        row=row,
        provenance=Provenance(path=path, format="shimmer", notes=(*_remark(columns, header, device), *said)),
    )


def _find_header(content: Content) -> Header | None:
    """Only the first lines are looked at: names stand at the top, or below the separator."""
    header = find_header(content, lambda names: any(match and match["what"] for match in map(_NAME.match, names)))
    return header if header is not None and header.line <= 3 else None


def _find_units(content: Content, header: Header) -> list[str]:
    """Fields of the row of units; none if there is no such row."""
    if header.line + 1 >= len(content.lines):
        return []
    below = split_line(content.lines[header.line + 1], header.separator)
    return below if any(find_factor("acc", field) for field in below) else []


def _list_devices(header: Header) -> list[str]:
    matches = [match for match in map(_NAME.match, header.names) if match and match["what"]]
    return list(dict.fromkeys(match["device"] for match in matches))


def _choose_columns(header: Header, device: str, path: Path) -> _Columns:
    """Choose the columns of a device: the clock that is finest, the accelerometer of low noise."""
    prefix = f"{device}_" if device else ""
    sources, axes = {}, {}
    for quantity, known in _SOURCES:
        there = [source for source in known if f"{prefix}{source}_X_CAL" in header]
        if not there and quantity != "mag":
            raise FormatError(
                f"{path.name} has no calibrated {_WORDS[quantity]} ({prefix}{known[0]}_X_CAL): export it again with it."
            )
        if there:
            sources[quantity] = there[0]
            axes[quantity] = [f"{prefix}{there[0]}_{axis}_CAL" for axis in "XYZ"]
    return _Columns(_choose_clock(header, device, path), sources, axes)


def _choose_clock(header: Header, device: str, path: Path) -> str:
    """Choose the clock of a device; that of the session where it has none of its own; numbers before text."""
    found = [(name, match) for name, match in ((name, _NAME.match(name)) for name in header.names) if match]
    clocks = [(name, match["clock_device"], match["clock"]) for name, match in found if match["clock"]]
    own = [clock for clock in clocks if clock[1] == device] or clocks
    if not own:
        raise FormatError(f"{path.name} has no column Timestamp_Unix_CAL: export it again with it.")
    return min(own, key=lambda clock: ("Formatted" in clock[2], "Unix" not in clock[2]))[0]


def _find_scale(names: list[str], quantity: Quantity, header: Header, units: list[str], path: Path) -> float:
    """Find the unit of a sensor's columns; NaN for one of the local field."""
    said = {
        units[k] for name in names if (k := header.names.index(name) if name in header else -1) in range(len(units))
    }
    if len(said) != 1:
        raise FormatError(f"{path.name}: '{names[0]}' has no one unit for its axes below it: export it again.")
    unit = said.pop()
    factor = find_factor(quantity, unit)
    if factor is None or (np.isnan(factor) and quantity != "mag"):
        raise FormatError(f"{path.name}: '{names[0]}' has the unit '{unit}', which is not known here: convert it.")
    return factor


def _read_time(clock: str, header: Header, units: list[str], skip: int, row: Ints, content: Content) -> Floats:
    """Stamps (N,) s of the rows."""
    if "Formatted" not in clock:
        table, lines = header.read(content, [clock], skip)
        k = header.names.index(clock)
        factor = find_factor("time", units[k]) if k < len(units) else None
        return scale_values(_pick_rows(table[:, 0], lines, row), 1e-3 if factor is None else factor)
    return _read_text_time(clock, header, skip, row, content)


def _pick_rows(values: Floats, lines: Ints, row: Ints) -> Floats:
    """Values (N,) of the lines `row`; NaN where there is none."""
    picked = np.full(len(row), np.nan)
    there = np.isin(row, lines)
    picked[there] = values[np.searchsorted(lines, row[there])]
    return picked


def _read_text_time(clock: str, header: Header, skip: int, row: Ints, content: Content) -> Floats:
    """Stamps (N,) s since 1970, of the clock on the wall, from text such as `2017/11/14 17:07:24.254`."""
    text = header.read_words(content, clock, row, skip)
    stamps = pd.to_datetime(text.str.strip().str.replace("/", "-"), format="ISO8601", errors="coerce")
    bad = (stamps.isna() & text.notna()).to_numpy()
    if bad.any():
        k = int(np.argmax(bad))
        raise FormatError(
            f"{content.path.name}, line {row[k]}, column '{clock}': {str(text.iloc[k])[:40]!r} is no time; "
            f"correct or delete that line."
        )
    return np.asarray((stamps - pd.Timestamp(0)).dt.total_seconds(), dtype=np.float64)


def _remark(columns: _Columns, header: Header, device: str) -> tuple[str, ...]:
    """Say which accelerometer was taken."""
    source, prefix = columns.sources["acc"], f"{device}_" if device else ""
    both = {f"{prefix}{name}_X_CAL" for name in ("Accel_LN", "Accel_WR")} <= set(header.names)
    remarks = []
    if both:
        remarks.append("of two accelerometers the one of low noise (LN) is taken: it is in the gyroscope's frame")
    elif source == "Accel_WR":
        remarks.append("the accelerometer is that of wide range (WR): the file has no other")
    return tuple(remarks)
