"""Apps of phones that write a table of all sensors, a table a sensor, or kinds of lines (docs/formats.md).

Of one table of all sensors (`TableFormat`) names are compared without their units, which are those of the app.
SensorLog has **Apple's sign** and a clock for each sensor; `motion...` is without bias, and the field 0 until it is
calibrated. Physics Toolbox has a row whenever any sensor has a sample, in which the others hold their last one.

phyphox (RWTH Aachen): up is + on iPhones too. In the newer header, `X (m/s^2)`, the unit says the sensor, and the name
of the file "Linear". Pauses are left out of the time of the experiment: here they are put back, as gaps.

Sensor Logger (Kelvin Choi), in whole ns since 1970. On Android, or standardised, `TotalAcceleration` is the specific
force, m/s^2, `Accelerometer` and `Gravity` are its two parts, and `AccelerometerUncalibrated` is that too. An iPhone
has no total, the two parts with the sign turned, and the uncalibrated one in g with the sign turned. Source: UNITS.md,
COORDINATES.md, CROSSPLATFORM.md of tszheichoi/awesome-sensor-logger.

Google's GnssLogger: records in lines that begin with their kind; of `UncalAccel` the bias in it is subtracted.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.columns.headers import Quantity, find_factor, find_quantity, find_scale
from fg_nav.errors import FormatError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.io.content import Content, split_fields, split_lines
from fg_nav.io.streams import NAMES, UNCALIBRATED_FIELD, Sensor, Stream, interpolate_rows, join_streams, keep_changes
from fg_nav.io.tables import TextTable, find_header, guess_separator, has_rows
from fg_nav.recording import NOMINAL_SIGMA, RawRecording, note_nominal_rate
from fg_nav.samples.plausibility import measure_rest_acc
from fg_nav.text import format_count

# One table of all sensors

_STEP = re.compile(r"Sampling (?:Time|Rate)\s*:\s*(\d+(?:\.\d+)?)\s*ms", re.IGNORECASE)


@dataclass(frozen=True)
class Source:
    """Columns of a sensor: patterns of their names before the axis, of several the sum; their unit, and a remark.

    `clock` is the pattern of the stamps' name.
    """

    what: Sensor
    columns: tuple[str, ...]
    clock: str
    unit: float = 1.0
    remark: str = ""


@dataclass(frozen=True)
class TableFormat:
    """A table that an app writes.

    `is_header` knows the names of its columns, `top` the first line, where there is one above them; of each sensor the
    first source is taken that is there and not all zero. `tick_s` is the unit of the clocks, `is_epoch` where they are
    since 1970, or left out for a nominal rate. `keeps` where rows hold older samples.
    """

    name: str
    is_header: Callable[[list[str]], bool]
    sources: tuple[Source, ...]
    top: str = ""
    tick_s: float = 1.0
    is_epoch: bool = False
    keeps: bool = False

    def recognizes(self, content: Content) -> bool:
        """Whether a header is that of the app."""
        first = content.lines[0] if content.lines else ""
        is_below = bool(re.match(self.top, first, re.IGNORECASE))
        return is_below and (bool(self.top) or find_header(content, self.is_header) is not None)

    def read(self, content: Content) -> RawRecording:
        """Read a recording."""
        path, notes = content.path, list[str]()
        table = find_header(content, self.is_header) or TextTable(content, content.fields())
        plain = [re.sub(r"\s*\(.*$", "", name).strip().lower() for name in table.names]
        # time between the rows without stamps: by the rate that is given, or that in the first lines
        nominal_s = None
        if self.is_epoch and "timestamp" not in plain:
            said = next((float(match[1]) for match in map(_STEP.search, content.lines[:5]) if match), 0.0)
            if content.rate_hz is None and not 0.1 <= said <= 1e4:
                raise FormatError(f"{path.name} has no column 'timestamp': give its rate in Hz, such as `--rate 50`.")
            nominal_s = 1e-3 * said if content.rate_hz is None else 1.0 / content.rate_hz
            if content.rate_hz is None:
                words = f"time is the row number at the nominal {said:g} ms, which phones exceed"
                notes.append(f"there is no clock: {words}")
        found: dict[Sensor, Stream] = {}
        for source in self.sources:
            stream = None if source.what in found else self._read(table, plain, source, nominal_s)
            if stream is not None and (source.what != "mag" or stream.xyz.any()):
                found[source.what] = stream
                notes += [source.remark] if source.remark else []
        raw = join_streams([found[what] for what in NAMES if what in found], path, self.name, notes)
        return note_nominal_rate(raw, NOMINAL_SIGMA) if content.rate_hz is None and nominal_s is not None else raw

    def _read(self, table: TextTable, plain: list[str], source: Source, nominal_s: float | None) -> Stream | None:
        """Return the stream of one sensor in SI, or None if a column is absent; `nominal_s`: period without stamps."""
        clock = [k for k, name in enumerate(plain) if re.fullmatch(source.clock, name, re.IGNORECASE)][:1]
        wanted: list[int] = []
        for pattern in source.columns:
            first = next((n for n in plain if re.fullmatch(f"(?:{pattern})x", n, re.IGNORECASE)), " ")
            wanted += [plain.index(first[:-1] + axis) for axis in "xyz" if first[:-1] + axis in plain]
        if len(wanted) < 3 * len(source.columns) or (not clock and nominal_s is None):
            return None
        names = [table.names[k] for k in (clock if nominal_s is None else []) + wanted]
        values, row = table.read_columns(names)
        xyz = values[:, -len(wanted) :].reshape(len(values), -1, 3).sum(axis=1)
        # stamps
        t: Floats | Ints = np.asarray((row - table.first_line) * (nominal_s or 0.0), dtype=np.float64)
        if nominal_s is None:
            stamps = table.read_integers(names[0], row) if self.is_epoch else None
            t = values[:, 0] * self.tick_s if stamps is None else stamps * 1_000_000
        stream = Stream(source.what, t, xyz * source.unit, row, table.names[wanted[0]])
        if self.keeps:
            return keep_changes(stream)
        return stream.take(np.concatenate(([True], np.diff(t) != 0)))  # rows repeat a sample until there is a new one


_APPLE = "specific force is -9.80665 * {}, as an iPhone has the sign turned"
_SINCE = "Timestamp_sinceReboot"

_SENSORLOG = TableFormat(
    "sensorlog",
    lambda names: any(_SINCE in name for name in names),
    (
        Source("acc", ("accelerometerAcceleration",), f"accelerometer{_SINCE}", -GRAVITY_M_S2,
               _APPLE.format("accelerometerAcceleration")),
        Source("acc", ("motionUserAcceleration", "motionGravity"), f"motion{_SINCE}", -GRAVITY_M_S2,
               _APPLE.format("(motionUserAcceleration + motionGravity)")),
        Source("gyr", ("motionRotationRate",), f"motion{_SINCE}"),
        Source("gyr", ("gyroRotation",), f"gyro{_SINCE}",
               remark="the gyroscope is as measured: its bias is still in it"),
        Source("mag", ("motionMagneticField",), f"motion{_SINCE}"),
        Source("mag", ("magnetometer",), f"magnetometer{_SINCE}", remark=UNCALIBRATED_FIELD),
    ),
)  # fmt: skip

_START = "Time since start in ms"
_ANDRO = re.compile("(ACCELEROMETER|LINEAR ACCELERATION|GYROSCOPE|MAGNETIC FIELD) [XYZ]")

_ANDROSENSOR = TableFormat(
    "androsensor",
    lambda names: any(name.startswith(_START) for name in names) and any(map(_ANDRO.match, names)),
    (
        Source("acc", ("ACCELEROMETER ",), _START),
        Source("gyr", ("GYROSCOPE ",), _START),
        Source("mag", ("MAGNETIC FIELD ",), _START),
    ),
    tick_s=1e-3,
)

_PHYSICS_TOOLBOX = TableFormat(
    "physics-toolbox",
    lambda names: (
        "".join(names[:1]).lower() == "time"
        and ("gFx" in names or (not names[-1] and not {"wx", "Bx", "ax"}.isdisjoint(names)))
    ),
    (Source("acc", ("gF",), "time", GRAVITY_M_S2), Source("gyr", ("w",), "time"), Source("mag", ("B",), "time")),
    keeps=True,
)

_OTHER = "(?!.*(?:linear|gravity|rotation|orient|uncal))"

_HYPERIMU = TableFormat(
    "hyperimu",
    lambda names: any(re.fullmatch(r".+\.[xyz]", name) for name in names),
    (
        Source("gyr", (_OTHER + r".*(?:gyro|L3G|BMG).*\.",), "timestamp"),
        Source("mag", (_OTHER + r".*(?:magn|compass|AK0|AK8|YAS|HMC|MMC|BMM).*\.",), "timestamp"),
        Source("acc", (_OTHER + r"(?!.*(?:gyro|magn)).*(?:acc|LIS[23]|BMA|KX|ADXL|MMA).*\.",), "timestamp"),
    ),
    top="@.*(?:HyperIMU|HIMU|ianovir)",
    tick_s=1e-3,
    is_epoch=True,
)


APPS = (_SENSORLOG, _ANDROSENSOR, _PHYSICS_TOOLBOX, _HYPERIMU)


# phyphox

_TIME = re.compile(r"Time \((\w+)\)")
_PRESSURE = re.compile(r"(?:Pressure|P) ?\((\w+)\)")
_SENSORS: dict[str, Quantity] = {
    "Acceleration": "acc", "Accelerometer": "acc", "Linear Acceleration": "acc", "Linear Accelerometer": "acc",
    "Gyroscope": "gyr", "Magnetic field": "mag", "Magnetometer": "mag",
}  # fmt: skip
_COLUMN = re.compile(rf"(?:({'|'.join(_SENSORS)}) ([xyz])|([XYZ])) ?\((.+)\)")

_LATE_S = 1.0  # A sensor delivers its last samples within this time of the end.


def is_phyphox(content: Content) -> bool:
    """Whether it is a table with a time and a sensor of phyphox, or a folder or archive right in which one is."""
    return any(map(_find_phyphox_header, content.files()))


def _find_phyphox_header(file: Content) -> TextTable | None:
    """Table of phyphox with its header in the first line: a time first, then a sensor's axes."""

    def is_header(names: list[str]) -> bool:
        is_sensor = len(names) > 3 and any(map(_COLUMN.fullmatch, names[1:]))
        return bool(names and _TIME.fullmatch(names[0])) and (is_sensor or any(map(_PRESSURE.fullmatch, names[1:])))

    header = find_header(file, is_header)
    return header if header is not None and header.line == 0 else None


def read_phyphox(content: Content) -> RawRecording:
    """Read an experiment."""
    notes = list[str]()
    # phone and app
    said = {row[0]: row[1] for row in _read_meta(content, "device.csv") if len(row) > 1}
    model = " ".join(said[key] for key in ("deviceBrand", "deviceModel") if said.get(key))
    if model:
        notes.append(f"recorded by phyphox {said.get('version', '')} on {model}")
    # sensors
    streams = [stream for file in content.files() for stream in _read_phyphox_table(file)]
    # pauses
    pauses, last = _read_pauses(content)
    for stream in streams:
        end = max(stream.t[np.isfinite(stream.t)].tolist(), default=0.0)
        if end > last + _LATE_S:
            words = f"{stream.source} lasts {end:.1f} s, but meta/time.csv says {last:.1f} s"
            raise FormatError(f"{words}: give the files of one experiment.")
    streams = [replace(one, t=_add_pauses(np.asarray(one.t, dtype=np.float64), pauses)) for one in streams]
    if streams:
        notes += [f"paused for {pause:.1f} s at {at:.1f} s: a gap" for at, pause in pauses]
    return join_streams(streams, content.path, "phyphox", list(dict.fromkeys(notes)), is_part=not content.members)


def _read_phyphox_table(file: Content) -> Iterator[Stream]:
    """Yield the streams in a table, without accelerations from which gravity has been removed."""
    table, found = _find_phyphox_header(file), dict[Sensor, dict[str, tuple[str, str]]]()
    if table is None or not has_rows(file):
        return
    # name and unit of the columns of each sensor, by axis
    for name in table.names[1:]:
        if (air := _PRESSURE.fullmatch(name)) is not None and find_factor("pressure", air[1]):
            found["pressure"] = {"": (name, air[1])}
        elif (match := _COLUMN.fullmatch(name)) is not None:
            what = _SENSORS[match[1]] if match[1] else find_quantity(match[4])
            is_linear = "linear" in (match[1] or (file.path.name if what == "acc" else "")).lower()
            if what in ("acc", "gyr", "mag") and not is_linear:
                found.setdefault(what, {})[(match[2] or match[3]).lower()] = name, match[4]
    for sensor, columns in found.items():
        if sorted(columns) in (["x", "y", "z"], [""]):
            own, clock = [columns[axis] for axis in sorted(columns)], _TIME.fullmatch(table.names[0])
            factors = [find_scale("time", clock[1] if clock else "s", table.names[0], file.path.name)]
            factors += [find_scale(sensor, unit, name, file.path.name) for name, unit in own]
            values, row = table.read_columns([table.names[0], *(name for name, _ in own)])
            values *= np.array(factors)
            yield Stream(sensor, values[:, 0], values[:, 1:], row, file.path.name)


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
    begin = [float(table.read_columns(["seconds_elapsed"])[0][0, 0]) for table in find_tables(content).values()]
    return _add_pauses(t, _read_pauses(content)[0]) - min(begin, default=0.0)


# Sensor Logger

_WHAT: dict[str, Sensor] = {  # Tables that are read, by the name of the file in lower case.
    "totalacceleration": "acc", "accelerometer": "acc", "gravity": "acc", "accelerometeruncalibrated": "acc",
    "gyroscope": "gyr", "gyroscopeuncalibrated": "gyr", "magnetometer": "mag", "magnetometeruncalibrated": "mag",
    "barometer": "pressure",
}  # fmt: skip

_HPA = 100.0  # Pa.
_MAX_FORCE_IN_G = 3.0  # A sensor at rest reads 1 in g, and 9.8 in m/s^2.


def find_tables(content: Content) -> dict[str, TextTable]:
    """Return the Sensor Logger tables of a folder or archive (top level), or the file itself, by lower-case name."""
    files: Iterable[tuple[str, Content]] = content.members.items() or [(content.path.name, content)]
    found = {}
    for name, file in {place.lower().split(".")[0]: file for place, file in files if "/" not in place}.items():
        fields = set(file.fields())
        is_table = {"time", "seconds_elapsed"} <= fields and ({"x", "y", "z"} <= fields or "pressure" in fields)
        table = find_header(file, lambda names: "seconds_elapsed" in names)
        if name in _WHAT and is_table and table is not None and has_rows(file):
            found[name] = table
    return found


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
        is_air = _WHAT[name] == "pressure"
        values, row = table.read_columns(["time", *(["pressure"] if is_air else "xyz")])
        stamps = table.read_integers("time", row)
        t = values[:, 0] * 1e-9 if stamps is None else stamps
        xyz = values[:, 1:] * (_HPA if is_air else 1.0)
        streams[name] = Stream(_WHAT[name], t, xyz, row, table.content.path.name)
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
                words = f"{content.path.name} does not say whether it is of an iPhone or of an Android phone"
                raise FormatError(f"{words}, whose signs differ: add its Metadata.csv (a column 'platform').")
            said = metadata.get("standardisation", metadata.get("standardization", "")).lower()
            sign = -1.0 if platform == "ios" and said not in ("true", "1", "yes", "on") else 1.0
        notes.append("specific force is " + ("-" if sign < 0 else "") + "(Accelerometer + Gravity)")
        notes[-1] += turned if sign < 0 else ""
        return replace(linear, xyz=sign * whole)
    if raw is not None and in_g:
        notes.append("specific force is -9.80665 * AccelerometerUncalibrated" + turned)
        return replace(raw, xyz=-GRAVITY_M_S2 * raw.xyz)
    if raw is not None:
        notes.append("specific force is AccelerometerUncalibrated")
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


def read_gnss_logger(content: Content) -> RawRecording:
    """Read the inertial sensors and the magnetometer of a log; a record that is not whole is no sample."""
    lines, streams, notes = split_lines(content.read_text()), list[Stream](), list[str]()
    for what, kinds in _KINDS.items():
        kind = next((kind for kind in kinds if any(line.startswith(f"{kind},") for line in lines)), None)
        if kind is None:
            continue
        # a table of the records of one kind, utc, elapsed, x, y, z[, bias], in which other lines are empty
        own, has_bias = [line if line.startswith(f"{kind},") else "" for line in lines], "Uncal" in kind
        text, width = "\n".join(own).encode(), 9 if has_bias else 6
        names = [f"field {k + 1}" for k in range(max(width, *(line.count(",") + 1 for line in own)))]
        records = replace(content, encoding="utf-8", opener=partial(io.BytesIO, text), opened={})
        values, row = TextTable(records, names, first_line=1).read_numbers(range(2, width))
        elapsed, xyz = values[:, 0], values[:, 1:4] - (values[:, 4:7] if has_bias else 0.0)
        if cut := sum(map(bool, own)) - int((~np.isnan(elapsed) & ~np.isnan(xyz).any(axis=1)).sum()):
            notes.append(f"left out {format_count(cut, f'{kind} record')} not whole")
        is_whole = bool((elapsed == np.rint(elapsed)).all() and np.abs(elapsed).max() < 2.0**53)
        streams.append(Stream(what, elapsed.astype(np.int64) if is_whole else elapsed * 1e-9, xyz, row, kind))
    return join_streams(streams, content.path, "gnss-logger", notes)
