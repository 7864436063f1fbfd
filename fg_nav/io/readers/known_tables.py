"""Apps that write one table of all sensors, as data: which columns each sensor has, on which clock, in which unit.

=============== ====================================================================================================
sensorlog       SensorLog, iPhone: g **with Apple's sign**; each sensor has a clock of its own; `motion...` is without
                bias, and the field 0 until it is calibrated; `loggingTime(txt)`, when the row was written, jitters
androsensor     AndroSensor, Android: m/s^2, rad/s, uT, a row at a chosen rate; 2 Hz, as proposed, is too low
physics-toolbox Physics Toolbox, Android: `gFx` in g, `ax` without gravity; a row whenever any sensor has a sample, in
                which the others hold their last one, 0 before the first
hyperimu        HyperIMU, Android: columns named after the phone's chips; `timestamp` in ms since 1970, or a nominal
                time between the rows in the second line
vectornav       VectorNav as INSTINCT converts it: a table as any, `IMU::Accel::X [m/s^2]`, on `Time::TimeStartup [ns]`,
                compensated by the sensor before `UncompAccel`
=============== ====================================================================================================

Names are compared without their units, which have been through many hands and are those of the app where not known.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.columns.headers import read_header
from fg_nav.columns.units import find_factor
from fg_nav.errors import FormatError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.io.content import Content
from fg_nav.io.delimited import Header, find_header
from fg_nav.io.readers import table
from fg_nav.io.readers.sensor_logger import UNCALIBRATED_FIELD
from fg_nav.io.streams import NAMES, Sensor, Stream, join_streams, keep_changes
from fg_nav.io.text_columns import scale_values
from fg_nav.recording import NOMINAL_SIGMA, RawRecording, note_nominal_rate


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
        return bool(re.match(self.top, first, re.IGNORECASE)) and (bool(self.top) or self._find(content) is not None)

    def _find(self, content: Content) -> Header | None:
        return find_header(content, self.is_header)

    @np.errstate(over="ignore", invalid="ignore")  # of numbers that a damaged file may hold
    def read(self, content: Content) -> RawRecording:
        """Read a recording.

        Raises `FormatError` if acceleration with gravity, rotation or time are absent, the rate is too low, or a field
        is no number.
        """
        path, header, notes = content.path, self._find(content), list[str]()
        if header is None:
            raise FormatError(f"{path.name} has no header with columns of sensors: record it again.")
        plain = [re.sub(r"\s*\(.*$", "", name).strip() for name in header.names]
        found: dict[Sensor, Stream] = {}
        nominal_s = self._find_step_s(content, notes) if self.is_epoch and "timestamp" not in plain else None
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
        said = content.rate_hz is None and nominal_s is not None
        return note_nominal_rate(raw, NOMINAL_SIGMA) if said else raw

    def _read(
        self, content: Content, header: Header, plain: list[str], source: Source, nominal_s: float | None
    ) -> Stream | None:
        """Read a sensor; None where a column of it is absent."""
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
        meaning = read_header(header.names[wanted[0]])
        unit = find_factor(source.what, meaning.unit) if meaning and meaning.unit and source.unit == 1.0 else None
        xyz = values[:, -len(wanted) :].reshape(len(values), -1, 3).sum(axis=1)
        xyz = scale_values(xyz, unit if unit is not None and np.isfinite(unit) else source.unit)
        t: Floats | Ints = np.asarray((row - header.line - 2) * (nominal_s or 0.0), dtype=np.float64)
        if nominal_s is None:
            t = values[:, 0] * self.tick_s
        stamps = header.read_integers(content, names[0], row) if self.is_epoch and nominal_s is None else None
        stream = Stream(source.what, t if stamps is None else stamps * 1_000_000, xyz, row, header.names[wanted[0]])
        if self.keeps:
            return keep_changes(stream)
        new = np.concatenate(([True], np.diff(stream.t) != 0))  # rows repeat a sample until there is a new one
        return stream.take(new)

    def _find_step_s(self, content: Content, notes: list[str]) -> float:
        """Time between the rows, by the rate that is given, or the nominal one in the first lines."""
        if content.rate_hz is not None:
            return 1.0 / content.rate_hz
        step = re.compile(r"Sampling (?:Time|Rate)\s*:\s*(\d+(?:\.\d+)?)\s*ms", re.IGNORECASE)
        said = next((match for match in map(step.search, content.lines[:5]) if match), None)
        if said is None or not 0.1 <= float(said[1]) <= 1e4:
            raise FormatError(
                f"{content.path.name} has neither a column 'timestamp' nor a rate: give the rate it was recorded at in "
                f"Hz, such as `--rate 50`."
            )
        notes.append(f"there is no clock: time is the row number at the nominal {said[1]} ms, which phones exceed")
        return 1e-3 * float(said[1])


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

ANDROSENSOR = TableFormat(
    "androsensor",
    lambda names: (
        any(name.startswith("Time since start in ms") for name in names)
        and any(re.match("(ACCELEROMETER|LINEAR ACCELERATION|GYROSCOPE|MAGNETIC FIELD) [XYZ]", name) for name in names)
    ),
    (
        Source("acc", ("ACCELEROMETER ",), "Time since start in ms"),
        Source("gyr", ("GYROSCOPE ",), "Time since start in ms"),
        Source("mag", ("MAGNETIC FIELD ",), "Time since start in ms"),
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


def is_vectornav(content: Content) -> bool:
    """Whether the first line has VectorNav's time since startup, or its names below `IMU::`."""
    names = [name for name in content.fields() if re.match(r"(Time::)?TimeStartup\b|IMU::", name)]
    return any("TimeStartup" in name or read_header(name) for name in names)


read_vectornav = partial(table.read, format="vectornav")
