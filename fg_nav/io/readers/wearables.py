"""Exports of further makers of worn sensors: APDM, Shimmer, MetaWear, Movesense and x-io (docs/formats.md).

APDM Opal, all sensors of a session in one CSV. *Format 7* has three header rows: `Format=7,5718,,,Lumbar,...` with
number and name of each sensor above its columns, `Time,Accelerometer,,,Gyroscope,,,...` and the axes; time is in us
since 1970. The other has keys, such as `Sample Rate:,128,Hz`, then `Time,Lumbar/Acceleration/X,...`, then a row of
units.

Shimmer Consensys, CSV with a row of names and one of units below it, perhaps below `"sep=;"`; each name begins with
that of the device, `Shimmer_40AC_Accel_LN_X_CAL`. `LN` is of low noise (2 g) and in the gyroscope's frame, `WR` of wide
range (16 g) and another chip. The clock is in whole ms since 1970, or text, `2017/11/14 17:07:24.254`.

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
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from fg_nav.arrays import Floats, Ints
from fg_nav.columns.units import KNOWN_UNITS, Quantity, find_factor, find_quantity
from fg_nav.errors import FormatError
from fg_nav.io.content import Content, choose_sensor, split_fields
from fg_nav.io.readers import table
from fg_nav.io.readers.xsens import scale_local_field
from fg_nav.io.streams import NAMES, Sensor, Stream, join_streams
from fg_nav.io.text_columns import Header, continue_counter, drop_held, find_header, read_table, scale_values
from fg_nav.recording import Provenance, RawRecording
from fg_nav.samples.plausibility import find_mag_problem, measure_field_strength
from fg_nav.samples.stamps import LOST_PERIODS

# APDM

_QUANTITIES: dict[str, Quantity] = {
    "accelerometer": "acc", "acceleration": "acc", "gyroscope": "gyr", "angular velocity": "gyr",
    "magnetometer": "mag", "magnetic field": "mag",
}  # fmt: skip
_USUAL_UNITS: dict[Quantity, str] = {"time": "s", "acc": "m/s^2", "gyr": "rad/s", "mag": "uT"}
_PATH = re.compile(r"^(?:(.*)/)?([^/]+)/([XYZ])$")


class _Column(NamedTuple):
    """A column: which sensor, which quantity, which axis, in which unit (SI or uT)."""

    position: int
    sensor: str
    quantity: Quantity
    axis: str
    scale: float = 1.0


def is_apdm(content: Content) -> bool:
    """Whether the first line gives the number of the format, or a header has paths with acceleration or rate."""
    return "".join(content.lines[:1]).lstrip('"').startswith("Format=") or _find_paths(content) is not None


def _find_paths(content: Content) -> Header | None:
    def is_header(names: list[str]) -> bool:
        is_timed = bool(names) and names[0].lower().startswith("time")
        return is_timed and any(match and match[2].lower() in _QUANTITIES for match in map(_PATH.match, names))

    return find_header(content, is_header)


def read_apdm(content: Content) -> RawRecording:
    """Read one sensor of an export."""
    path = content.path
    is_numbered = "".join(content.lines[:1]).lstrip('"').startswith("Format=")
    columns, header, first_line, time_scale = (_read_numbered if is_numbered else _read_paths)(content)
    sensors = list(dict.fromkeys(column.sensor for column in columns))
    if not sensors:
        raise FormatError(
            f"{path.name} has no columns of acceleration and angular velocity: export it again with them."
        )
    sensor = choose_sensor(sensors, content.sensor, path)
    wanted = [column for column in columns if column.sensor == sensor]
    has_mag = any(column.quantity == "mag" for column in wanted)
    # one column for each axis
    ordered = []
    for word in ("accelerometer", "gyroscope", *(("magnetometer",) if has_mag else ())):
        for axis in "XYZ":
            found = [one for one in wanted if (one.quantity, one.axis) == (_QUANTITIES[word], axis)]
            if len(found) != 1:
                raise FormatError(
                    f"{path.name} has {len(found)} columns '{word} {axis}' of '{sensor}' where one is needed: export "
                    f"it again."
                )
            ordered += found
    values, row = read_table(content, header, [0, *(column.position for column in ordered)], first_line)
    samples = scale_values(values[:, 1:], np.array([column.scale for column in ordered]))
    t, acc, gyr = scale_values(values[:, 0], time_scale), samples[:, :3], samples[:, 3:6]
    mag = drop_held(samples[:, 6:], gyr) if has_mag else None
    return RawRecording(t, acc, gyr, row, mag, provenance=Provenance(path, "apdm", (f"the sensor is '{sensor}'",)))


def _read_numbered(content: Content) -> tuple[list[_Column], list[str], int, float]:
    """Return columns, header, first line of data and time unit (s) of a file in format 7."""
    rows = [content.fields(line) for line in range(3)]
    width = max(map(len, rows))
    names, groups, axes = ([*fields, *[""] * (width - len(fields))] for fields in rows)
    starts = [k for k in range(1, width) if groups[k].lower() == "accelerometer"]
    columns, header, block, group = [], ["Time"], "", ""
    for k in range(1, width):
        group = groups[k] or group
        if k in starts:  # of the next sensor: its name stands above, or its number alone
            end = next((start for start in starts if start > k), width)
            above = [name for name in names[k:end] if name]
            words = [name for name in above if not name.isdigit()]
            block = " ".join(words or above) or f"sensor in column {k + 1}"
        header.append(f"{block} {group} {axes[k]}".strip())
        quantity = _QUANTITIES.get(group.lower())
        if quantity and axes[k] in ("X", "Y", "Z"):
            columns.append(_Column(k, block, quantity, axes[k]))
    return columns, header, 4, 1e-6


def _read_paths(content: Content) -> tuple[list[_Column], list[str], int, float]:
    """Return columns, header, first line of data and time unit (s) of a file with paths for column names."""
    header = _find_paths(content)
    if header is None:
        raise FormatError(f"{content.path.name} has no header of APDM: export it again.")
    below = content.fields(header.line + 1)
    has_units = bool(below) and find_factor("time", below[0]) is not None
    units = [*(below if has_units else []), *[""] * len(header.names)]

    def scale(quantity: Quantity, k: int, name: str) -> float:
        factor = find_factor(quantity, units[k] or _USUAL_UNITS[quantity])
        if factor is None or not np.isfinite(factor):
            raise FormatError(
                f"{content.path.name}: column '{name}' has the unit '{units[k]}', which is not known here: convert it "
                f"to one of {KNOWN_UNITS[quantity]}."
            )
        return factor

    columns = []
    for k, name in enumerate(header.names):
        match = _PATH.match(name)
        quantity = _QUANTITIES.get(match[2].lower()) if match else None
        if match and quantity:
            columns.append(_Column(k, match[1] or "sensor", quantity, match[3], scale(quantity, k, name)))
    return columns, header.names, header.line + (3 if has_units else 2), scale("time", 0, "Time")


# Shimmer

_NAME = re.compile(
    r"^(?P<device>.*?)_?(?P<what>Accel_LN|Accel_WR|Accel|Gyro|Mag)_(?P<axis>[XYZ])_CAL$|"
    r"^(?P<clock_device>.*?)_?(?P<clock>Timestamp(?:Sync)?(?:_(?:Sync)?(?:Unix|FormattedUnix))?)_CAL$"
)
_SOURCES: dict[Sensor, tuple[str, ...]] = {
    "acc": ("Accel_LN", "Accel", "Accel_WR"), "gyr": ("Gyro",), "mag": ("Mag",),
}  # fmt: skip


def find_shimmer_header(content: Content) -> Header | None:
    """Header with names as Consensys gives them, in the first lines: at the top, or below the separator."""
    header = find_header(content, lambda names: any(match and match["what"] for match in map(_NAME.match, names)))
    return header if header is not None and header.line <= 3 else None


def read_shimmer(content: Content) -> RawRecording:
    """Read one device of an export of Consensys."""
    path, header = content.path, find_shimmer_header(content)
    if header is None:
        raise FormatError(f"{path.name} has no calibrated columns of a Shimmer: export it again with them.")
    lines = content.lines[header.line + 1 : header.line + 2]
    units = [field for line in lines for field in split_fields(line, header.separator)]
    units = units if any(find_factor("acc", field) for field in units) else []
    skip = 1 if units else 0
    matches = [match for match in map(_NAME.match, header.names) if match]
    device = choose_sensor(
        list(dict.fromkeys(match["device"] for match in matches if match["what"])), content.sensor, path
    )
    prefix = f"{device}_" if device else ""
    # columns, of the accelerometers that of low noise
    axes = dict[Sensor, list[str]]()
    for what, sources in _SOURCES.items():
        there = [source for source in sources if f"{prefix}{source}_X_CAL" in header]
        if there:
            axes[what] = [f"{prefix}{there[0]}_{axis}_CAL" for axis in "XYZ"]
        elif what != "mag":
            raise FormatError(
                f"{path.name} has no calibrated {NAMES[what]} ({prefix}{sources[0]}_X_CAL): export it again with it."
            )
    # the clock of the device, or of the session where it has none of its own; numbers before text
    clocks = [(match.string, match["clock_device"], match["clock"]) for match in matches if match["clock"]]
    own = [one for one in clocks if one[1] == device] or clocks
    if not own:
        raise FormatError(f"{path.name} has no column Timestamp_Unix_CAL: export it again with it.")
    clock = min(own, key=lambda one: ("Formatted" in one[2], "Unix" not in one[2]))[0]
    # samples
    scales = {what: _find_scale(names, what, header, units, path) for what, names in axes.items()}
    values, row = header.read(content, [name for names in axes.values() for name in names], skip)
    samples = {what: scale_values(values[:, 3 * k : 3 * k + 3], scales[what]) for k, what in enumerate(axes)}
    mag, said = samples.get("mag"), tuple[str, ...]()
    if mag is not None and np.isnan(scales["mag"]):
        mag, said = scale_local_field(values[:, -3:], samples["gyr"])
    elif mag is not None:
        mag = drop_held(mag, samples["gyr"])
    t = _read_shimmer_time(clock, header, units, skip, row, content)
    notes = []
    if {f"{prefix}Accel_LN_X_CAL", f"{prefix}Accel_WR_X_CAL"} <= set(header.names):
        notes = ["of two accelerometers the one of low noise (LN) is taken: it is in the gyroscope's frame"]
    elif axes["acc"][0] == f"{prefix}Accel_WR_X_CAL":
        notes = ["the accelerometer is that of wide range (WR): the file has no other"]
    provenance = Provenance(path, "shimmer", (*notes, *said))
    return RawRecording(t, samples["acc"], samples["gyr"], row, mag, provenance=provenance)


def _find_scale(names: list[str], quantity: Quantity, header: Header, units: list[str], path: Path) -> float:
    """Return the factor to SI (uT) of a sensor's columns; NaN for units of the local field."""
    places = [header.names.index(name) for name in names if name in header]
    said = {units[k] for k in places if k < len(units)}
    if len(said) != 1:
        raise FormatError(f"{path.name}: '{names[0]}' has no one unit for its axes below it: export it again.")
    unit = said.pop()
    factor = find_factor(quantity, unit)
    if factor is None or (np.isnan(factor) and quantity != "mag"):
        raise FormatError(f"{path.name}: '{names[0]}' has the unit '{unit}', which is not known here: convert it.")
    return factor


def _read_shimmer_time(clock: str, header: Header, units: list[str], skip: int, row: Ints, content: Content) -> Floats:
    """Return stamps (N,) s of `row` (N,): the device clock, or wall time since 1970 (`2017/11/14 17:07:24.254`)."""
    if "Formatted" not in clock:
        values, lines = header.read(content, [clock], skip)
        k = header.names.index(clock)
        factor = find_factor("time", units[k]) if k < len(units) else None
        picked, there = np.full(len(row), np.nan), np.isin(row, lines)
        picked[there] = values[np.searchsorted(lines, row[there]), 0]
        return scale_values(picked, 1e-3 if factor is None else factor)
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
    if not content.members:  # the other file is needed too, by its name if it lies beside
        own, session = next(iter(files)), _SENSOR.split(path.name)[0]
        other = NAMES["gyr" if own == "acc" else "acc"]
        beside = sorted(path.parent.glob("*")) if content.fetch is None and path.is_file() else []
        names = [file.name for file in beside if file.name.startswith(session) and other in file.name.lower()]
        missing = f"'{names[0]}'" if len(names) == 1 else f"the file of the {other}"
        raise FormatError(
            f"{path.name} holds the {NAMES[own]} alone: put {missing} of the same session beside it, and give the "
            f"folder, or a zip of both."
        )
    streams = [_read_metawear_stream(files[what], what) for what in NAMES if what in files]
    return join_streams(streams, path, "metawear", (f"the session is '{chosen}'",) if len(sessions) > 1 else ())


def _read_metawear_stream(file: Content, what: Sensor) -> Stream:
    """Samples of a file with their stamps in whole ns."""
    header = Header(0, file.fields())
    epoch = next((name for name in _EPOCHS if name in header), _EPOCHS[0])
    axes = [next((name for name in header.names if name.startswith(f"{a}-axis")), f"{a}-axis") for a in "xyz"]
    values, row = header.read(file, [epoch, _ELAPSED, *axes])
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
