"""Apps of phones that write a table, or kinds of lines, a sensor (docs/formats.md).

phyphox (RWTH Aachen): fields are separated by comma, semicolon or tab, with a decimal point or comma, as the user
chose; short columns end in NaN. Each sensor has its own `Time (s)` since the start of the experiment, up is + on
iPhones too. In the newer header, `X (m/s^2)`, the unit says the sensor, and the name of the file "Linear".
`meta/device.csv` and `meta/time.csv` say phone and app, and when the experiment was started and paused. Pauses are left
out of the time of the experiment: here they are put back, as gaps.

Sensor Logger (Kelvin Choi), `time,seconds_elapsed,z,y,x`, in whole ns since 1970:

============================= ===================================================== ===================================
table                         on Android, or standardised                           on an iPhone
============================= ===================================================== ===================================
`TotalAcceleration`           specific force, m/s^2                                 absent
`Accelerometer`, `Gravity`    the two parts of it, m/s^2                            the same with the sign turned
`AccelerometerUncalibrated`   specific force, m/s^2                                 g, with the sign turned
============================= ===================================================== ===================================

`Metadata.csv` names the platform and whether units and signs were standardised, to those of Android. Where it is
absent, an uncalibrated accelerometer that reads 1 at rest is that of an iPhone. The sign cannot be told from motion:
mirrored forces fit a mirrored world. Source: UNITS.md, COORDINATES.md, CROSSPLATFORM.md of
tszheichoi/awesome-sensor-logger.

Google's GnssLogger: records in lines that begin with their kind, below a header in lines with `#`. `UncalAccel`, utc in
ms, elapsed since the phone's start in ns, x, y, z, and the bias in it, which is subtracted; `Accel` is without it.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Literal

import numpy as np
import pandas as pd

from fg_nav.arrays import Floats
from fg_nav.columns.units import find_factor, find_quantity
from fg_nav.errors import FormatError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.io.content import Content, split_fields, split_lines
from fg_nav.io.streams import NAMES, UNCALIBRATED_FIELD, Sensor, Stream, interpolate_rows, join_streams
from fg_nav.io.text_columns import Header, find_header, guess_separator, has_rows, scale_values
from fg_nav.recording import RawRecording
from fg_nav.samples.plausibility import measure_rest_acc

_TIME = re.compile(r"Time \((\w+)\)")
_PRESSURE = re.compile(r"(?:Pressure|P) ?\((\w+)\)")
_Column = Literal["acc", "gyr", "mag", "linear", "other"]
_SENSORS: dict[str, _Column] = {
    "Acceleration": "acc", "Accelerometer": "acc", "Linear Acceleration": "linear", "Linear Accelerometer": "linear",
    "Gyroscope": "gyr", "Magnetic field": "mag", "Magnetometer": "mag",
}  # fmt: skip
_COLUMN = re.compile(rf"(?:({'|'.join(_SENSORS)}) ([xyz])|([XYZ])) ?\((.+)\)")

_LATE_S = 1.0  # A sensor delivers its last samples within this time of the end.


def is_phyphox(content: Content) -> bool:
    """Whether it is a table with a time and a sensor of phyphox, or a folder or archive right in which one is."""
    return any(map(_find_phyphox_header, content.files()))


def _find_phyphox_header(table: Content) -> Header | None:
    """Header of a table of phyphox in its first line: a time first, then a sensor's axes."""

    def is_header(names: list[str]) -> bool:
        is_sensor = len(names) > 3 and any(map(_COLUMN.fullmatch, names[1:]))
        return bool(names and _TIME.fullmatch(names[0])) and (is_sensor or any(map(_PRESSURE.fullmatch, names[1:])))

    header = find_header(table, is_header)
    return header if header is not None and header.line == 0 else None


@np.errstate(over="ignore", invalid="ignore")  # of numbers that a damaged file may hold
def read_phyphox(content: Content) -> RawRecording:
    """Read an experiment."""
    name, notes = content.path.name, list[str]()
    # phone and app
    said = {row[0]: row[1] for row in _read_meta(content, "device.csv") if len(row) > 1}
    model = " ".join(said[key] for key in ("deviceBrand", "deviceModel") if said.get(key))
    if model:
        notes.append(f"recorded by phyphox {said.get('version', '')} on {model}")
    # sensors
    streams: dict[Sensor, Stream] = {}
    has_linear = False
    for stream in (stream for table in content.files() for stream in _read_phyphox_table(table)):
        if stream is None:
            has_linear = True
        elif stream.what in streams:
            raise FormatError(
                f"{name} holds two tables of the {NAMES[stream.what]} ({streams[stream.what].source}, "
                f"{stream.source}): give a folder with those of one experiment."
            )
        else:
            streams[stream.what] = stream
    if has_linear and "acc" not in streams:
        raise FormatError(
            f"{name} holds linear acceleration only, from which gravity has been removed: "
            f"record 'Acceleration (with g)' and the gyroscope."
        )
    if len(streams) == 1 and not content.members:
        what = NAMES[next(iter(streams))]
        raise FormatError(f"{name} holds the {what} only: give the folder or zip with the files of all sensors.")
    # pauses
    pauses, last = _read_pauses(content)
    for what, stream in streams.items():
        end = max(stream.t[np.isfinite(stream.t)].tolist(), default=0.0)
        if end > last + _LATE_S:
            raise FormatError(
                f"{stream.source} lasts {end:.1f} s, but meta/time.csv says {last:.1f} s: give the files of one "
                f"experiment."
            )
        streams[what] = replace(stream, t=_add_pauses(np.asarray(stream.t, dtype=np.float64), pauses))
    if streams:
        notes += [f"paused for {pause:.1f} s at {at:.1f} s: a gap" for at, pause in pauses]
    return join_streams(list(streams.values()), content.path, "phyphox", list(dict.fromkeys(notes)))


def _read_phyphox_table(table: Content) -> Iterator[Stream | None]:
    """Yield the streams in a table; None for one from which gravity has been removed."""
    header = _find_phyphox_header(table)
    if header is None or not has_rows(table):
        return
    groups: dict[_Column, list[tuple[str, str, str]]] = {}  # axis, name and unit of its columns, for each sensor
    for name in header.names:
        match = _COLUMN.fullmatch(name)
        if match is not None:
            quantity = find_quantity(match[4])
            what: _Column = quantity if quantity == "acc" or quantity == "gyr" or quantity == "mag" else "other"
            if what == "acc" and "linear" in table.path.name.lower():
                what = "linear"
            axis = (match[2] or match[3]).lower()
            groups.setdefault(_SENSORS[match[1]] if match[1] else what, []).append((axis, name, match[4]))
    for name in header.names:
        match = _PRESSURE.fullmatch(name)
        if match is not None and find_factor("pressure", match[1]):
            yield _read_columns(table, header, "pressure", [("", name, match[1])])
    for what, columns in groups.items():
        if what == "linear":
            yield None
        elif what != "other" and [axis for axis, _, _ in sorted(columns)] == ["x", "y", "z"]:
            yield _read_columns(table, header, what, sorted(columns))


def _read_columns(table: Content, header: Header, what: Sensor, columns: list[tuple[str, str, str]]) -> Stream:
    match = _TIME.fullmatch(header.names[0])
    factors = [find_factor("time", match[1] if match else "s"), *(find_factor(what, unit) for _, _, unit in columns)]
    if None in factors:
        raise FormatError(f"{table.path.name} has a unit that is not known in '{columns[0][1]}': export it again.")
    values, row = header.read(table, [header.names[0], *(name for _, name, _ in columns)])
    values = scale_values(values, np.array(factors, dtype=np.float64))
    return Stream(what, values[:, 0], values[:, 1:], row, table.path.name)


def _read_meta(content: Content, name: str) -> list[list[str]]:
    """Rows of a table in `meta/`, below its header."""
    table = content.members.get(f"meta/{name}")
    return [split_fields(line, guess_separator(line)) for line in table.lines[1:]] if table else []


def _read_pauses(content: Content) -> tuple[list[tuple[float, float]], float]:
    """Return pauses (start, duration; s), and the time (s) of a last one that was not resumed, else infinity."""
    events = list[tuple[str, float, float]]()  # what, s of the experiment, s of the system's clock
    for row in _read_meta(content, "time.csv"):
        try:
            events.append((row[0], float(row[1].replace(",", ".")), float(row[2].replace(",", "."))))
        except (ValueError, IndexError):
            return [], np.inf
    pairs = [(after[1], after[2] - before[2]) for before, after in pairwise(events) if before[0] == "PAUSE"]
    last = events[-1][1] if events and events[-1][0] == "PAUSE" else np.inf
    return [(at, pause) for at, pause in pairs if 0.0 < pause < 1e6], last


def _add_pauses(t: Floats, pauses: list[tuple[float, float]]) -> Floats:
    """Stamps (N,) s as if the experiment's clock had gone on in its pauses."""
    shifted = t.copy()
    for at, pause in pauses:
        shifted[t > at] += pause
    return shifted


def put_on_recording_clock(content: Content, t: Floats) -> Floats:
    """Stamps (N,) s of a further table of an app, such as its `Location.csv`, on the clock of its recording as read."""
    begin = []
    for table in find_tables(content).values():
        header = find_header(table, lambda names: "seconds_elapsed" in names)
        if header is not None:
            begin.append(float(header.read(table, ["seconds_elapsed"])[0][0, 0]))
    return _add_pauses(t, _read_pauses(content)[0]) - min(begin, default=0.0)


# Sensor Logger

_WHAT: dict[str, Sensor] = {
    "totalacceleration": "acc", "accelerometer": "acc", "gravity": "acc", "accelerometeruncalibrated": "acc",
    "gyroscope": "gyr", "gyroscopeuncalibrated": "gyr", "magnetometer": "mag", "magnetometeruncalibrated": "mag",
    "barometer": "pressure",
}  # fmt: skip
"""Tables that are read, by the name of the file in lower case."""

_HPA = 100.0  # Pa.
_MAX_FORCE_IN_G = 3.0  # A sensor at rest reads 1 in g, and 9.8 in m/s^2.


def find_tables(content: Content) -> dict[str, Content]:
    """Return the Sensor Logger tables of a folder or archive (top level), or the file itself, by lower-case name."""
    files: Iterable[tuple[str, Content]] = content.members.items() or [(content.path.name, content)]
    named = {place.lower().split(".")[0]: table for place, table in files if "/" not in place}
    found = {}
    for name, table in named.items():
        fields = set(table.fields())
        is_table = {"time", "seconds_elapsed"} <= fields and ({"x", "y", "z"} <= fields or "pressure" in fields)
        if name in _WHAT and is_table and has_rows(table):
            found[name] = table
    return found


@np.errstate(over="ignore", invalid="ignore")  # of numbers that a damaged file may hold
def read_sensor_logger(content: Content) -> RawRecording:
    """Read a recording."""
    path, notes = content.path, list[str]()
    if not content.members:
        raise FormatError(f"{path.name} is one sensor of Sensor Logger: give the folder or zip with all of them.")
    # the first row of the metadata, by the names of its columns
    about = next((table for place, table in content.members.items() if place.lower() == "metadata.csv"), None)
    metadata = dict[str, str]()
    if about is not None and len(about.lines) > 1:
        metadata = {name.lower(): value for name, value in zip(about.fields(0), about.fields(1), strict=False)}
    # sensors, calibrated before uncalibrated
    streams = dict[str, Stream]()
    for name, table in find_tables(content).items():
        header = find_header(table, lambda names: "seconds_elapsed" in names)
        assert header is not None, "recognized by it"
        is_air = _WHAT[name] == "pressure"
        values, row = header.read(table, ["time", *(["pressure"] if is_air else "xyz")])
        stamps = header.read_integers(table, "time", row)
        if stamps is None:
            whole = np.abs(values[:, 0]) < 2.0**63
            values, row = values[whole], row[whole]
            stamps = np.rint(values[:, 0]).astype(np.int64)
        xyz = values[:, 1:] * (_HPA if is_air else 1.0)
        streams[name] = Stream(_WHAT[name], stamps, xyz, row, table.path.name)
    force = _find_force(streams, metadata, content, notes)
    gyr, mag = streams.get("gyroscope"), streams.get("magnetometer")
    if gyr is None and "gyroscopeuncalibrated" in streams:
        gyr = streams["gyroscopeuncalibrated"]
        notes.append("the gyroscope is uncalibrated: its bias is still in it")
    if mag is None and "magnetometeruncalibrated" in streams:
        mag = streams["magnetometeruncalibrated"]
        notes.append(UNCALIBRATED_FIELD)
    if metadata.get("device name", ""):
        notes.insert(0, f"recorded by Sensor Logger {metadata.get('appversion', '')} on {metadata['device name']}")
    found = [stream for stream in (force, gyr, mag, streams.get("barometer")) if stream is not None]
    return join_streams(found, path, "sensor-logger", notes)


def _find_force(
    streams: dict[str, Stream], metadata: dict[str, str], content: Content, notes: list[str]
) -> Stream | None:
    """Return specific force, m/s^2: as measured, or linear acceleration plus gravity; None without either."""
    if "totalacceleration" in streams:
        notes.append("specific force is TotalAcceleration")
        return streams["totalacceleration"]
    raw, in_g, turned = streams.get("accelerometeruncalibrated"), False, ", as an iPhone has the sign turned"
    if raw is not None:
        period_s = float(np.median(np.diff(raw.t))) * 1e-9 if len(raw.t) > 1 else np.nan
        in_g = measure_rest_acc(raw.xyz, period_s) < _MAX_FORCE_IN_G
    if {"accelerometer", "gravity"} <= streams.keys():
        linear, gravity = streams["accelerometer"], streams["gravity"]
        whole = linear.xyz + interpolate_rows(gravity, linear.t)
        if raw is not None:  # the sign by what the uncalibrated accelerometer has along it
            along = np.nansum(whole * interpolate_rows(raw, linear.t))
            sign = float(np.sign(along) * (-1.0 if in_g else 1.0)) or 1.0
        else:  # by the metadata
            platform = metadata.get("platform", "").lower()
            if platform not in ("ios", "android"):
                raise FormatError(
                    f"{content.path.name} does not say whether it is of an iPhone or of an Android phone, whose signs "
                    f"differ: add the Metadata.csv of the recording (a column 'platform' with ios or android)."
                )
            said = metadata.get("standardisation", metadata.get("standardization", "")).lower()
            sign = -1.0 if platform == "ios" and said not in ("true", "1", "yes", "on") else 1.0
        notes.append("specific force is " + ("-" if sign < 0 else "") + "(Accelerometer + Gravity)")
        notes[-1] += turned if sign < 0 else ""
        return replace(linear, xyz=sign * whole)
    if raw is not None and in_g:
        notes.append("specific force is -9.80665 * AccelerometerUncalibrated" + turned)
        return replace(raw, xyz=scale_values(raw.xyz, -GRAVITY_M_S2))
    if raw is not None:
        notes.append("specific force is AccelerometerUncalibrated")
    elif "accelerometer" in streams:
        raise FormatError(
            f"{content.path.name} holds Accelerometer.csv, from which gravity has been removed, and no Gravity.csv, "
            f"TotalAcceleration.csv or AccelerometerUncalibrated.csv: record one of these along."
        )
    return raw


# GnssLogger

_KINDS: dict[Sensor, tuple[str, str]] = {
    "acc": ("UncalAccel", "Accel"), "gyr": ("UncalGyro", "Gyro"), "mag": ("UncalMag", "Mag"),
}  # fmt: skip
_PREFIXES = tuple(f"{kind}," for kinds in _KINDS.values() for kind in kinds)


def is_gnss_logger(content: Content) -> bool:
    """Whether a header in comments names the records of GnssLogger, or a record of a sensor comes first."""
    named = any(
        line.startswith("#") and line.lstrip("# ").startswith(("Raw,utcTimeMillis", *_PREFIXES))
        for line in content.lines[:60]
    )
    first = next((line for line in content.lines if line and not line.startswith("#")), "")
    return named or (first.startswith(_PREFIXES) and first.count(",") >= 5)


@np.errstate(over="ignore", invalid="ignore")  # of numbers that a damaged file may hold
def read_gnss_logger(content: Content) -> RawRecording:
    """Read the inertial sensors and the magnetometer of a log."""
    lines = split_lines(content.read_text())
    rows: dict[str, list[int]] = {prefix: [] for prefix in _PREFIXES}
    for number, line in enumerate(lines):
        prefix = line[: line.find(",") + 1]
        if prefix in rows:
            rows[prefix].append(number)
    streams = []
    for what, kinds in _KINDS.items():
        kind = next((kind for kind in kinds if rows[f"{kind},"]), None)
        if kind is not None:
            own = rows[f"{kind},"]
            streams.append(_read_records(content, what, kind, [lines[k] for k in own], own))
    return join_streams(streams, content.path, "gnss-logger")


def _read_records(content: Content, what: Sensor, kind: str, lines: list[str], rows: list[int]) -> Stream:
    """Return the stream of a kind of record: kind, utc, elapsed, x, y, z[, bias]; `rows` (N,) are lines from 0."""
    width = 9 if kind.startswith("Uncal") else 6
    try:
        table = pd.read_csv(
            io.StringIO("\n".join(lines)), header=None, names=range(width), usecols=range(width), index_col=False,
            dtype=str, quoting=3, skip_blank_lines=False,
        )  # fmt: skip
    except (ValueError, pd.errors.ParserError):
        raise FormatError(f"{content.path.name} has no whole record of {kind}: log it again.") from None
    numbers = table.iloc[:, 1:].apply(pd.to_numeric, errors="coerce")
    bad = numbers.isna().any(axis=1).to_numpy()
    if bad.any():
        k = int(np.argmax(bad))
        raise FormatError(
            f"{content.path.name}, line {rows[k] + 1}: {lines[k][:40]!r} is no whole record of {kind}; correct or "
            f"delete that line."
        )
    values, elapsed = numbers.to_numpy(dtype=np.float64), numbers[2]
    xyz = values[:, 2:5] - values[:, 5:8] if width == 9 else values[:, 2:5]
    stamps = elapsed.to_numpy(dtype=np.int64) if elapsed.dtype.kind == "i" else values[:, 1] * 1e-9
    return Stream(what, stamps, np.ascontiguousarray(xyz), np.array(rows) + 1, kind)
