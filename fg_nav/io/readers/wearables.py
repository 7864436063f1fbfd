"""Exports of worn sensors with a clock of their own for each sensor: MetaWear, Movesense and x-io (docs/formats.md).

MbientLab MetaWear, CSV of MetaBase and MetaHub, one file a sensor of each session. The clock is the first `epoch (ms)`
(older: `epoc`), and `elapsed (s)` since the first row of the file. Columns are `x-axis (g)`, `(deg/s)` or `(T)`. Only
the file's name says that an acceleration is linear, which is without gravity, or gravity alone: these are left out. In
`<name>_<time>_<device>_Accelerometer_12.500Hz_1.4.4.csv` what stands before the sensor is one for all of a session.

Movesense, JSON of its app, `{"Meas": {"IMU9": [{"Timestamp": ..., "ArrayAcc": [{"x": ..., ...}, ...], ...}, ...]}}`.
The stamp is of the first of the 4 to 16 samples of a block; these are spread evenly up to the stamp of the next one;
where blocks are missing, they come as in the blocks around. Blocks are taken wherever they stand: apps nest them
differently, and sensors that were not recorded as IMU6 or IMU9 have blocks and stamps of their own.

x-io NGIMU and x-IMU3, CSV whose header carries the units: a table as any. The x-IMU3 writes a folder: `Inertial.csv`
has force and rate, `Magnetometer.csv` the field at a rate of its own, left out in arbitrary units.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.columns.headers import find_factor, find_quantity
from fg_nav.errors import FormatError
from fg_nav.io.content import Content, choose_sensor
from fg_nav.io.readers import table
from fg_nav.io.streams import NAMES, Sensor, Stream, continue_counter, join_streams
from fg_nav.io.tables import TextTable, scale_values
from fg_nav.recording import RawRecording
from fg_nav.samples.plausibility import find_mag_problem, measure_field_strength
from fg_nav.samples.stamps import LOST_PERIODS

# MetaWear

_EPOCHS, _ELAPSED = ("epoch (ms)", "epoc (ms)"), "elapsed (s)"
_LATEST = (9e12, 3e9)  # Of the clocks, ms and s: later ones are damaged, and too large in ns for 64 bits.
_AXIS = re.compile(r"^([xyz])-axis \((.+)\)$")
_SENSOR = re.compile(r"[_ -]*(accelerometer|gyroscope|magnetometer)", re.IGNORECASE)
_FUSED = re.compile(r"linear|gravity|euler|quaternion|fusion", re.IGNORECASE)


def is_metawear(content: Content) -> bool:
    """Whether it is a file of a session, or a folder or archive right with such files."""
    return any(map(_find_sensor, content.files()))


def _find_sensor(file: Content) -> Sensor | None:
    """Which sensor a file is of, by the unit of its axes; None for those of a filter and of others."""
    header = file.fields()
    units = {match[2] for match in map(_AXIS.match, header) if match}
    if _ELAPSED not in header or len(units) != 1 or _FUSED.search(file.path.name):
        return None
    quantity = find_quantity(units.pop())
    return None if quantity == "time" else quantity


def read_metawear(content: Content) -> RawRecording:
    """Read a session."""
    path, sessions = content.path, dict[str, dict[Sensor, Content]]()
    for file in content.files():
        what, name = _find_sensor(file), file.path.name
        if what is not None:
            session = _SENSOR.split(name)[0] if _SENSOR.search(name) else ""
            sessions.setdefault(session or "session", {})[what] = file
    if not sessions:
        raise FormatError(f"{path.name} holds no file of a MetaWear: export the session again.")
    chosen = choose_sensor(list(sessions), content.sensor, path, "sessions")
    files = sessions[chosen]
    streams = [_read_metawear_stream(files[what], what) for what in NAMES if what in files]
    notes = [f"the session is '{chosen}'"] if len(sessions) > 1 else []
    return join_streams(streams, path, "metawear", notes, is_part=not content.members)


def _read_metawear_stream(file: Content, what: Sensor) -> Stream:
    """Samples of a file with their stamps in whole ns."""
    header = TextTable(file, file.fields())
    epoch = next((name for name in _EPOCHS if name in header), _EPOCHS[0])
    axes = [next((name for name in header.names if name.startswith(f"{a}-axis")), f"{a}-axis") for a in "xyz"]
    values, row = header.read_columns([epoch, _ELAPSED, *axes])
    factor = find_factor(what, axes[0].split("(", 1)[1].rstrip(")"))
    whole = (np.abs(values[:, :2]) < _LATEST).all(axis=1)
    values, row = values[whole], row[whole]
    if not len(row) or factor is None:
        raise FormatError(f"{file.path.name} has no row with both clocks: export it again.")
    elapsed = np.rint(values[:, 1] * 1e9 - values[0, 1] * 1e9).astype(np.int64)
    t = np.rint(values[0, 0] * 1e6).astype(np.int64) + elapsed
    return Stream(what, t, scale_values(values[:, 2:], factor), row, file.path.name)


# Movesense

_ARRAYS: dict[Sensor, tuple[str, float]] = {
    "acc": ("ArrayAcc", 1.0), "gyr": ("ArrayGyro", np.pi / 180.0), "mag": ("ArrayMagn", 1.0),
}  # fmt: skip
_ARRAY_NAMES = frozenset(name for name, _ in _ARRAYS.values())
_MAX_DEPTH = 12  # Blocks stand three to five levels deep; a file made of brackets is none.


def is_movesense(content: Content) -> bool:
    """Whether it begins as JSON, and blocks of Movesense's samples are in the beginning."""
    head = "\n".join(content.lines)
    return head.lstrip()[:1] in ("{", "[") and any(f'"{name}"' in head for name in _ARRAY_NAMES)


def read_movesense(content: Content) -> RawRecording:
    """Read a Movesense log."""
    name = content.path.name
    try:
        logged = json.loads(content.read_text())
    except (ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())[:80]
        raise FormatError(f"{name} is no whole JSON ({reason}): export it again.") from None
    blocks = list(_find_blocks(logged, 0))
    streams = {what: _read_blocks(blocks, what, name) for what in _ARRAYS}
    notes = ["each stamp stands for a block of samples: they are spread evenly up to the next"]
    mag = streams["mag"].xyz
    if len(mag) and find_mag_problem(mag) is not None:
        median = np.nanmedian(measure_field_strength(mag))
        notes.append(f"the magnetometer is not calibrated (median {median:.0f} uT), and was left out")
        del streams["mag"]
    return join_streams([stream for stream in streams.values() if len(stream.t)], content.path, "movesense", notes)


def _find_blocks(value: Any, depth: int) -> Iterator[dict[str, Any]]:
    if isinstance(value, dict) and not _ARRAY_NAMES.isdisjoint(value) and depth <= _MAX_DEPTH:
        yield value
    elif isinstance(value, dict | list) and depth <= _MAX_DEPTH:
        for part in value.values() if isinstance(value, dict) else value:
            yield from _find_blocks(part, depth + 1)


def _read_blocks(blocks: list[dict[str, Any]], what: Sensor, name: str) -> Stream:
    """Return the stream of one sensor, joined from all blocks with its samples."""
    (array, unit), parts, begins = _ARRAYS[what], [np.empty((0, 3))], list[float]()
    blocks = [block for block in blocks if array in block]
    for k, block in enumerate(blocks):
        try:
            xyz = np.array([[p["x"], p["y"], p["z"]] for p in block[array]], dtype=np.float64).reshape(-1, 3)
        except (TypeError, KeyError, ValueError, OverflowError):
            raise FormatError(f"{name}: block {k + 1} holds something other than x, y, z: export it again.") from None
        parts.append(xyz)
    for block in blocks:
        stamp = block.get("Timestamp", block.get("timestamp"))
        if isinstance(stamp, bool) or not isinstance(stamp, int | float) or not abs(float(min(stamp, 1e300))) < 1e300:
            raise FormatError(f"{name}: a block has no Timestamp that is a number: export it again.")
        begins.append(float(stamp))
    stamps, _ = continue_counter(np.array(begins), 2.0**32, "Timestamp")
    t = _spread_blocks(stamps * 1e-3, np.array([len(part) for part in parts[1:]], dtype=np.int64))
    return Stream(what, t, scale_values(np.concatenate(parts), unit), np.arange(1, len(t) + 1), array)


def _spread_blocks(stamps: Floats, sizes: Ints) -> Floats:
    """Return sample stamps (N,) s, spread evenly between block `stamps` (B,) s; `sizes` (B,) are samples a block."""
    stamps, sizes = stamps[sizes > 0], sizes[sizes > 0]
    if not len(stamps):
        return stamps
    period = np.diff(stamps) / sizes[:-1]
    known = period[period > 0]
    usual = float(np.median(known)) if known.size else np.nan
    step = np.append(period, usual)
    step[~((step > 0) & (step < LOST_PERIODS * usual))] = usual
    within = np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    return np.asarray(np.repeat(stamps, sizes) + within * np.repeat(step, sizes))


# x-io

_XIO_AXIS = re.compile(r"(gyroscope|accelerometer|magnetometer)\s+[xyz]\b", re.IGNORECASE)


def _name_sensors(content: Content) -> set[str]:
    return {match[1].lower() for match in map(_XIO_AXIS.match, content.fields()) if match}


def _find_parts(content: Content) -> tuple[Content | None, Content | None]:
    """Files right in a folder or archive with force and rate, and with the field; None where there is not one."""
    found: dict[frozenset[str], list[Content]] = {}
    for file in content.parts():
        found.setdefault(frozenset(_name_sensors(file)), []).append(file)
    kinds = frozenset({"gyroscope", "accelerometer"}), frozenset({"magnetometer"})
    inertial, magnetic = (found[kind][0] if len(found.get(kind, ())) == 1 else None for kind in kinds)
    return inertial, magnetic


def is_xio(content: Content) -> bool:
    """Whether the first line names a gyroscope or accelerometer axis as x-io does; a folder or archive, both parts."""
    if content.members:
        return None not in _find_parts(content)
    return not _name_sensors(content).isdisjoint({"gyroscope", "accelerometer"})


def read_xio(content: Content) -> RawRecording:
    """Read an x-io CSV, or the folder of an x-IMU3."""
    if not content.members:
        return table.read(content, "xio")
    inertial, magnetic = _find_parts(content)
    field = None if magnetic is None else table.find_sensor_table(magnetic)
    if inertial is None or magnetic is None or field is None:
        raise FormatError(f"{content.path.name} has no Inertial.csv beside Magnetometer.csv: give the one that it has.")
    raw, mag, name = table.read(inertial, "xio"), field.read(), inertial.path.name
    if np.isnan(mag.xyz).all():
        notes = (f"{magnetic.path.name} is in arbitrary units and was left out",)
        return replace(raw, provenance=replace(raw.provenance, path=content.path, notes=notes))
    streams = [Stream("acc", raw.t, raw.acc, raw.row, name), Stream("gyr", raw.t, raw.gyr, raw.row, name), mag]
    return join_streams(streams, content.path, "xio")
