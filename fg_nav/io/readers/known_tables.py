"""Programs that write one table of all sensors: columns, clock and unit of each (docs/formats.md).

=============== ====================================================================================================
canonical       this project's own; mag and pressure may be absent, and empty where there is no sample
sensorconnect   LORD/MicroStrain: names of channels behind the sensor's, `inertial-6253.76535:scaledAccelX`; those of a
                filter in the sensor have `:valid` behind them; rows of other packets, without acc and gyr, are left out
openshoe        17 columns by blanks without a header
yei             a comment names the columns; `Corrected` by the sensor's calibration goes before `Raw`
vectornav       as INSTINCT converts it: a table as any, compensated by the sensor before `UncompAccel`
sensorlog       **Apple's sign**; each sensor has a clock of its own; `motion...` is without bias, and the field 0 until
                it is calibrated; `loggingTime(txt)`, when the row was written, jitters
androsensor     a row at a chosen rate; 2 Hz, as proposed, is too low
physics-toolbox a row whenever any sensor has a sample, in which the others hold their last one, 0 before the first
hyperimu        columns named after the phone's chips; without `timestamp` a nominal time between the rows
=============== ====================================================================================================

Names of the apps' columns are compared without their units, which have been through many hands and are those of the app
where not known.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.columns.choice import find_pressure
from fg_nav.columns.headers import read_header
from fg_nav.columns.mapping import ACC, GYR, MAG, TIME
from fg_nav.columns.samples import convert_pressure
from fg_nav.columns.units import GAUSS_UT, find_factor
from fg_nav.errors import FormatError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.io.content import Content, read_content, split_fields
from fg_nav.io.readers import table
from fg_nav.io.streams import NAMES, UNCALIBRATED_FIELD, Sensor, Stream, join_streams, keep_changes
from fg_nav.io.text_columns import (
    Header,
    continue_counter,
    drop_held,
    find_column,
    find_header,
    read_table,
    scale_values,
)
from fg_nav.io.truth import read_footprint_mat
from fg_nav.recording import NOMINAL_SIGMA, Provenance, RawRecording, note_nominal_rate
from fg_nav.truth import FootprintTruth


def is_canonical(content: Content) -> bool:
    """Whether the first line names at least one of the format's acc or gyr columns, and none that names sensors."""
    names = content.fields()
    return not {*ACC, *GYR}.isdisjoint(names) and not any(map(table.SENSOR_WORD.search, names))


def read_canonical(content: Content) -> RawRecording:
    """Read a canonical CSV; further columns are ignored, the order is free."""
    header, notes = Header(0, content.fields()), list[str]()
    magnetic = () if set(MAG).isdisjoint(header.names) else MAG
    air = find_pressure(header.names)
    names = [*TIME, *ACC, *GYR, *magnetic]
    positions = [find_column(name, header.names, content.path) for name in names] + list(air.positions if air else ())
    values, row = read_table(content, header.names, positions, first_line=2)
    pressure = convert_pressure(values[:, -1], air, notes) if air else None
    mag, provenance = values[:, 7:10] if magnetic else None, Provenance(content.path, "canonical", tuple(notes))
    return RawRecording(
        values[:, 0], values[:, 1:4], values[:, 4:7], row, mag, provenance=provenance, pressure=pressure
    )


# LORD/MicroStrain SensorConnect

_EXPORTS = (("scaledAccel", "scaledGyro", GRAVITY_M_S2), ("estCompensatedAccel", "estAngularRate", 1.0))
"""Channels of acc and gyr, and the unit of acc in m/s^2; raw ones before those a filter has touched."""

_CHANNEL = re.compile(r"(scaledAccel|scaledGyro|estCompensatedAccel|estAngularRate|estLinearAccel)[XYZ]$")


def find_sensorconnect_header(content: Content) -> Header | None:
    """Header with SensorConnect's channel names; newer exports put lines about the session before it."""
    headers = (Header(line, split_fields(text)) for line, text in enumerate(content.lines))
    return next((header for header in headers if any(map(_CHANNEL.search, header.names))), None)


def read_sensorconnect(content: Content) -> RawRecording:
    """Read a SensorConnect CSV, with the surveyed footprints next to it, in a MATLAB file of the same name."""
    path, full = content.path, find_sensorconnect_header(content) or Header(0, content.fields())
    header = [name.split(":", 1)[1] if ":" in name else name for name in full.names]
    export = next((one for one in _EXPORTS if any(name.startswith(one[:2]) for name in header)), None)
    if export is None:
        raise FormatError(
            f"{path.name} holds estLinearAccel, from which gravity has been removed: "
            f"export scaledAccel or estCompensatedAccel instead."
        )
    acc, gyr, unit = export
    channels = [name + axis for name in (acc, gyr) for axis in "XYZ"]
    magnetic = [f"scaledMag{axis}" for axis in "XYZ"] if "scaledMagX" in header else []
    flags = [f"{name}:valid" for name in channels if f"{name}:valid" in header]
    names = ["Time", *channels, *magnetic, *flags]
    positions = [find_column(name, header, path) for name in names]
    values, row = read_table(content, full.names, positions, first_line=full.line + 2)
    inertial = ~np.isnan(values[:, 1:7]).all(axis=1)
    values, row = values[inertial], row[inertial]
    # what is not valid is no sample
    for flag in flags:
        values[values[:, names.index(flag)] != 1.0, names.index(flag.removesuffix(":valid"))] = np.nan
    # footprints
    truth, notes, beside = None, tuple[str, ...](), path.with_suffix(".mat")
    if beside != path and beside.is_file():
        try:
            truth = read_footprint_mat(read_content(beside))
        except FormatError as error:
            notes = (f"the file next to it gave no truth: {error}",)
    mag = values[:, 7:10] if magnetic else None
    return _pack(content, "sensorconnect", values[:, 0], values[:, 1:7], unit, mag, row, notes, truth)


def _pack(
    content: Content, format: str, t: Floats, inertial: Floats, unit: float, mag: Floats | None, row: Ints,
    notes: tuple[str, ...], truth: FootprintTruth | None = None,
) -> RawRecording:  # fmt: skip
    """Samples of stamps (N,) s, `inertial` (N, 6) with acc in a `unit` and gyr in rad/s, `mag` (N, 3) in gauss."""
    gyr = np.ascontiguousarray(inertial[:, 3:])
    field = None if mag is None else drop_held(scale_values(mag, GAUSS_UT), gyr)
    acc = scale_values(inertial[:, :3], unit)
    return RawRecording(t, acc, gyr, row, field, truth, Provenance(content.path, format, notes))


# OpenShoe. "PC time" is that of the logging computer, s; "rate" is estimated from packet to packet, Hz.

_OPENSHOE = (
    *("header", "acc x", "acc y", "acc z", "gyr x", "gyr y", "gyr z", "ticks", "checksum", "row number"),
    *("PC time 1", "PC time 2", "PC time 3", "rate", "mag x", "mag y", "mag z"),
)
_TAKEN = [k for k, n in enumerate(_OPENSHOE) if n.startswith(("acc", "gyr", "mag", "row", "rate", "PC time 1"))]

_PACKET_DELAY_S = 0.05  # Packets come up to 15 ms late; a step of the PC's clock within this shows no lost sample.
_MAX_PAUSE_S = 1e4  # A clock that shows more was set.
_SET_HZ, _SET_SHARE = 5.0, 0.005  # Sensors are set to multiples of this rate; the median estimate is as near to it.


def _split_first(content: Content) -> list[str]:
    """Fields of the first line that is not empty."""
    return next((line.split() for line in content.lines if line.strip()), [])


def is_openshoe(content: Content) -> bool:
    """Whether the first line that is not empty begins with the packet header."""
    return [word.lower() for word in _split_first(content)[:1]] == ["0xcb"]


def read_openshoe(content: Content) -> RawRecording:
    """Read an OpenShoe recording: the sensor samples evenly, so time is the row number over the nominal rate.

    Row numbers that restart are continued by the time elapsed on the logging PC, or by one if that is within its packet
    delays; where that clock shows no time between, they are left unchanged.
    """
    path, width = content.path, len(_split_first(content))
    if width != len(_OPENSHOE):
        raise FormatError(
            f"{path.name}: the first row has {width} columns, not {len(_OPENSHOE)}: copy the recording again."
        )
    values, row = read_table(content, _OPENSHOE, _TAKEN, first_line=1, separator=r"\s+")
    number, pc_s, rates = values[:, 6].copy(), values[:, 7], values[:, 8]
    # nominal rate
    usable = rates[(rates >= 1.0) & (rates <= 1e5)]
    if not usable.size:
        raise FormatError(f"{path.name} holds no sample rate in column 14: export the recording as canonical CSV.")
    rate_hz = float(np.median(usable))
    nominal_hz = _SET_HZ * round(rate_hz / _SET_HZ)
    rate_hz = nominal_hz if abs(nominal_hz - rate_hz) <= _SET_SHARE * rate_hz else rate_hz
    # row numbers that begin again
    notes = []
    for at in (np.flatnonzero(np.diff(number) < 0) + 1).tolist():
        passed_s = float(pc_s[at]) - float(pc_s[at - 1])
        if 0.0 < passed_s < _MAX_PAUSE_S:
            steps = 1.0 if passed_s <= _PACKET_DELAY_S else round(passed_s * rate_hz)
            number[at:] += number[at - 1] + steps - number[at]
            words = "nothing is missing there" if steps == 1.0 else f"{passed_s:.2f} s later"
            notes.append(f"the row numbers begin again in row {row[at]}: by the computer's clock {words}")
    t = scale_values(number, 1.0 / rate_hz)
    return _pack(content, "openshoe", t, values[:, :6], GRAVITY_M_S2, values[:, 9:], row, tuple(notes))


# YEI 3-Space

_YEI_NAMES, _YEI_CLOCK = re.compile(r"%\w+\(([^)]*)\)"), "ChipTimeUS"


def _find_yei_names(content: Content) -> list[str]:
    first = content.lines[0] if content.lines else ""
    return _YEI_NAMES.findall(first) if first.lstrip().startswith("#") else []


def is_yei(content: Content) -> bool:
    """Whether the first line is a comment with the names of the columns."""
    return bool(_find_yei_names(content)) and "Data format" in content.lines[0]


def read_yei(content: Content) -> RawRecording:
    """Read a log of the 3-Space software."""
    names, wanted = _find_yei_names(content), [_YEI_CLOCK]
    for sensor in ("Accel", "Gyro", "Compass"):
        kind = next((kind for kind in ("Corrected", "Raw") if f"{kind}{sensor}X" in names), None)
        if kind is not None:
            wanted += [f"{kind}{sensor}{axis}" for axis in "XYZ"]
        elif sensor != "Compass":
            raise FormatError(
                f"{content.path.name} has no columns Raw{sensor}X, Y, Z: log them with the other sensors."
            )
    values, row = Header(0, names).read(content, wanted)
    ticks, notes = continue_counter(values[:, 0], 2.0**32, _YEI_CLOCK)
    mag = values[:, 7:10] if len(wanted) > 7 else None
    return _pack(content, "yei", ticks * 1e-6, values[:, 1:7], GRAVITY_M_S2, mag, row, notes)


def is_vectornav(content: Content) -> bool:
    """Whether the first line has VectorNav's time since startup, or its names below `IMU::`."""
    names = [name for name in content.fields() if re.match(r"(Time::)?TimeStartup\b|IMU::", name)]
    return any("TimeStartup" in name or read_header(name) for name in names)


read_vectornav = partial(table.read, format="vectornav")


# Apps of phones, as data

_STEP = re.compile(r"Sampling (?:Time|Rate)\s*:\s*(\d+(?:\.\d+)?)\s*ms", re.IGNORECASE)


@dataclass(frozen=True)
class Source:
    """Columns of a sensor: patterns of their names before the axis, of several the sum; their unit, and a remark.

    `clock` is the pattern of the stamps' name. The unit of the header, if it is known, goes before `unit`.
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
    since 1970. `keeps` where rows hold older samples. `removed` is what is without gravity, `instead` what to record.
    """

    name: str
    is_header: Callable[[list[str]], bool]
    sources: tuple[Source, ...]
    removed: str
    instead: str
    top: str = ""
    tick_s: float = 1.0
    is_epoch: bool = False
    keeps: bool = False

    def recognizes(self, content: Content) -> bool:
        """Whether a header is that of the app."""
        first = content.lines[0] if content.lines else ""
        is_below = bool(re.match(self.top, first, re.IGNORECASE))
        return is_below and (bool(self.top) or find_header(content, self.is_header) is not None)

    @np.errstate(over="ignore", invalid="ignore")  # of numbers that a damaged file may hold
    def read(self, content: Content) -> RawRecording:
        """Read a recording."""
        path, header, notes = content.path, find_header(content, self.is_header), list[str]()
        if header is None:
            raise FormatError(f"{path.name} has no header with columns of sensors: record it again.")
        plain = [re.sub(r"\s*\(.*$", "", name).strip() for name in header.names]
        found: dict[Sensor, Stream] = {}
        nominal_s = None  # time between the rows without stamps: by the rate that is given, or that in the first lines
        if self.is_epoch and "timestamp" not in plain:
            said = next((match for match in map(_STEP.search, content.lines[:5]) if match), None)
            if content.rate_hz is not None:
                nominal_s = 1.0 / content.rate_hz
            elif said is not None and 0.1 <= float(said[1]) <= 1e4:
                nominal_s = 1e-3 * float(said[1])
                words = f"time is the row number at the nominal {said[1]} ms, which phones exceed"
                notes.append(f"there is no clock: {words}")
            else:
                raise FormatError(
                    f"{path.name} has neither a column 'timestamp' nor a rate: give the rate it was recorded at in "
                    f"Hz, such as `--rate 50`."
                )
        for source in self.sources:
            stream = None if source.what in found else self._read(content, header, plain, source, nominal_s)
            if stream is not None and (source.what != "mag" or stream.xyz.any()):
                found[source.what] = stream
                notes += [source.remark] if source.remark else []
        lacking = next((name for name in plain if re.match(self.removed, name, re.IGNORECASE)), None)
        if "acc" not in found and lacking is not None:
            raise FormatError(
                f"{path.name} holds {lacking[:-1].strip(' .')}, from which gravity has been removed: {self.instead}."
            )
        raw = join_streams([found[what] for what in NAMES if what in found], path, self.name, notes)
        return note_nominal_rate(raw, NOMINAL_SIGMA) if content.rate_hz is None and nominal_s is not None else raw

    def _read(
        self, content: Content, header: Header, plain: list[str], source: Source, nominal_s: float | None
    ) -> Stream | None:
        """Return the stream of one sensor in SI, or None if a column is absent; `nominal_s`: period without stamps."""
        clock = next((k for k, name in enumerate(plain) if re.fullmatch(source.clock, name, re.IGNORECASE)), None)
        wanted: list[int] = []
        for pattern in source.columns:
            first = next((n for n in plain if re.fullmatch(f"(?:{pattern})x", n, re.IGNORECASE)), "")
            axes = [first[:-1] + axis for axis in ("xyz" if first[-1:] == "x" else "XYZ")]
            if not first or not set(axes) <= set(plain):
                return None
            wanted += [plain.index(axis) for axis in axes]
        if clock is None and nominal_s is None:
            return None
        names = [header.names[k] for k in ([] if nominal_s is not None or clock is None else [clock]) + wanted]
        values, row = header.read(content, names)
        # unit
        meaning = read_header(header.names[wanted[0]])
        unit = find_factor(source.what, meaning.unit) if meaning and meaning.unit and source.unit == 1.0 else None
        xyz = values[:, -len(wanted) :].reshape(len(values), -1, 3).sum(axis=1)
        xyz = scale_values(xyz, unit if unit is not None and np.isfinite(unit) else source.unit)
        # stamps
        t: Floats | Ints = np.asarray((row - header.line - 2) * (nominal_s or 0.0), dtype=np.float64)
        if nominal_s is None:
            stamps = header.read_integers(content, names[0], row) if self.is_epoch else None
            t = values[:, 0] * self.tick_s if stamps is None else stamps * 1_000_000
        stream = Stream(source.what, t, xyz, row, header.names[wanted[0]])
        if self.keeps:
            return keep_changes(stream)
        return stream.take(np.concatenate(([True], np.diff(t) != 0)))  # rows repeat a sample until there is a new one


_APPLE = "specific force is -9.80665 * {}, as an iPhone has the sign turned"
_SINCE = "Timestamp_sinceReboot"

SENSORLOG = TableFormat(
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
    "motionUserAcceleration",
    "log accelerometerAcceleration or motionGravity along",
)  # fmt: skip

_START = "Time since start in ms"
_ANDRO = re.compile("(ACCELEROMETER|LINEAR ACCELERATION|GYROSCOPE|MAGNETIC FIELD) [XYZ]")

ANDROSENSOR = TableFormat(
    "androsensor",
    lambda names: any(name.startswith(_START) for name in names) and any(map(_ANDRO.match, names)),
    (
        Source("acc", ("ACCELEROMETER ",), _START),
        Source("gyr", ("GYROSCOPE ",), _START),
        Source("mag", ("MAGNETIC FIELD ",), _START),
    ),
    "LINEAR ACCELERATION",
    "record ACCELEROMETER along",
    tick_s=1e-3,
)

PHYSICS_TOOLBOX = TableFormat(
    "physics-toolbox",
    lambda names: (
        "".join(names[:1]).lower() == "time"
        and ("gFx" in names or (not names[-1] and not {"wx", "Bx", "ax"}.isdisjoint(names)))
    ),
    (Source("acc", ("gF",), "time", GRAVITY_M_S2), Source("gyr", ("w",), "time"), Source("mag", ("B",), "time")),
    "ax",
    "record the g-force (gFx ..) along",
    keeps=True,
)

_OTHER = "(?!.*(?:linear|gravity|rotation|orient|uncal))"

HYPERIMU = TableFormat(
    "hyperimu",
    lambda names: any(re.fullmatch(r".+\.[xyz]", name) for name in names),
    (
        Source("gyr", (_OTHER + r".*(?:gyro|L3G|BMG).*\.",), "timestamp"),
        Source("mag", (_OTHER + r".*(?:magn|compass|AK0|AK8|YAS|HMC|MMC|BMM).*\.",), "timestamp"),
        Source("acc", (_OTHER + r"(?!.*(?:gyro|magn)).*(?:acc|LIS[23]|BMA|KX|ADXL|MMA).*\.",), "timestamp"),
    ),
    ".*linear",
    "record acceleration along",
    top="@.*(?:HyperIMU|HIMU|ianovir)",
    tick_s=1e-3,
    is_epoch=True,
)
