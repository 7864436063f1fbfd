"""Small recordings as the apps of phones write them, from one recording: what is read is held against it.

Sensors have clocks of their own where the app gives them: the accelerometer's is shifted by `ACC_LATE_S`, the
magnetometer has every other sample.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from fg_nav.frames import GRAVITY_M_S2
from fg_nav.recording import RawRecording
from tests.io.samples import Sample, axes, tabulate

DEVICE = (("property", "value"), ("version", "1.1.16"), ("deviceModel", "P1"))

Files = Mapping[str, str]
"""Texts by their places in a folder; one of the place "" is a file of its own."""

ACC_LATE_S = 0.002
START_NS = 1_663_326_947_248_860_701
PHYPHOX_HEADERS = {
    "Accelerometer": ("Acceleration {}", "m/s^2"), "Linear Accelerometer": ("Linear Acceleration {}", "m/s^2"),
    "Gyroscope": ("Gyroscope {}", "rad/s"), "Magnetometer": ("Magnetic field {}", "µT"),
}  # fmt: skip


def phyphox(raw: RawRecording, separator: str = ",", decimal: str = ".", short: bool = False) -> Files:
    """Each sensor in a file, with a header of either kind."""
    files, none = {}, np.zeros((0, 3))
    for name, t, xyz in (*_sensors(raw), ("Linear Accelerometer", none[:, 0], none)):
        words, unit = PHYPHOX_HEADERS[name]
        names = axes(f'"{{}} ({unit})"') if short else axes(f'"{words} ({unit})"', letters="xyz")
        rows = tabulate([], [t, xyz], separator, "{:.9E}").replace(".", decimal)
        files[f"{name}.csv"] = separator.join(['"Time (s)"', *names]) + rows
    times = [('"event"', '"experiment time"', '"system time"'), ('"START"', "0.0", "100.0")]
    times.append(('"PAUSE"', f"{raw.t[-1]:.15E}", "200.0"))
    return {
        **files,
        "meta/device.csv": "\n".join(f'"{key}"{separator}"{value}"' for key, value in DEVICE) + "\n",
        "meta/time.csv": "\n".join(separator.join(line).replace(".", decimal) for line in times) + "\n",
    }


def phyphox_in_one(raw: RawRecording) -> Files:
    """All sensors of one experiment on one clock, short columns filled with NaN."""
    names = axes(*(f'"{words} ({unit})"' for words, unit in PHYPHOX_HEADERS.values()), letters="xyz")
    mag = np.where(np.arange(len(raw.t))[:, None] < len(raw.t) - 20, raw.mag, np.nan)
    return {"": tabulate(['"Time (s)"', *names], [raw.t, raw.acc, 0.0 * raw.acc, raw.gyr, mag], form="{:.9E}")}


def sensor_logger(raw: RawRecording, kind: str = "ios") -> Files:
    """A table a sensor: of an iPhone, of Android, standardised, uncalibrated only, or without `Metadata.csv`."""
    sign = -1.0 if kind in ("ios", "raw") else 1.0
    gravity = np.tile([0.0, 0.6 * GRAVITY_M_S2, 0.8 * GRAVITY_M_S2], (len(raw.t) - 1, 1))
    files = {"Annotation.csv": "", "Barometer.csv": "time,seconds_elapsed,pressure\n1,2,1013\n"}
    for name, t, xyz in _sensors(raw):
        tables = {name + "Uncalibrated" * (kind == "raw" and name == "Gyroscope"): xyz}
        if name == "Accelerometer":
            tables = {name: sign * (xyz - gravity), "Gravity": sign * gravity}
            tables |= {"TotalAcceleration": xyz} if kind == "android" else {}
            tables |= {"AccelerometerUncalibrated": xyz} if kind == "bare" else {}
            tables = {"AccelerometerUncalibrated": sign * xyz / GRAVITY_M_S2} if kind == "raw" else tables
        stamps = [str(START_NS + round(one * 1e9)) for one in t]
        for table, values in tables.items():
            names = ["time", "seconds_elapsed", "z", "y", "x"]
            files[f"{table}.csv"] = tabulate(names, [stamps, t, values[:, ::-1]])
    standardised, platform = str(kind == "standardised").lower(), "android" if kind == "android" else "ios"
    if kind not in ("raw", "bare"):
        head = "version,device name,platform,appVersion,standardisation"
        files["Metadata.csv"] = f"{head}\n3,Phone,{platform},1.30,{standardised}\n"
    return files


def sensorlog(raw: RawRecording, separator: str = ",") -> Files:
    """One row a sample, the force in g with Apple's sign, each sensor with stamps of its own."""
    names = ["loggingTime(txt)", "accelerometerTimestamp_sinceReboot(s)", *axes("accelerometerAcceleration{}(G)")]
    names += ["motionTimestamp_sinceReboot(s)", *axes("motionRotationRate{}(rad/s)", "motionMagneticField{}(µT)")]
    late, force = _late(raw)
    day, unknown = ([word] * len(late) for word in ("2026-05-26T14:17:24.702+02:00", "unknown"))
    columns = [day, 251699.0 + late, -force / GRAVITY_M_S2, 251699.0 + raw.t[:-1], raw.gyr[:-1], raw.mag[:-1], unknown]
    return {"": tabulate([*names, "activity(txt)"], columns, separator, "{:.9f}")}


def androsensor(raw: RawRecording) -> Files:
    names = axes("ACCELEROMETER {} (m/s²)", "LINEAR ACCELERATION {} (m/s²)", "GYROSCOPE {} (rad/s)")
    names += [*axes("MAGNETIC FIELD {} (μT)"), "Time since start in ms ", "YYYY-MO-DD HH-MI-SS_SSS"]
    clocks = [[f"{1e3 * t:.0f}", "2022-10-22 18:36:24:895"] for t in raw.t]
    return {"": tabulate(names, [raw.acc, 0.0 * raw.acc, raw.gyr, raw.mag, clocks], ";", "{:.5f}")}


def physics_toolbox(raw: RawRecording) -> Files:
    """A row for each sample of any sensor; the others hold theirs, 0 before the first."""
    names = ["time", *axes("gF{}", "a{}", "w{}", "B{}", letters="xyz"), ""]
    table = np.hstack([raw.acc / GRAVITY_M_S2, 0.1 * raw.acc, raw.gyr, raw.mag])
    held = np.repeat(table, 4, axis=0)
    for k in range(3):  # the sensors after this one have not come yet
        held[k::4, 3 * (k + 1) :] = np.vstack([np.zeros(12), table[:-1]])[:, 3 * (k + 1) :]
    t = np.repeat(raw.t, 4) + 1e-6 * np.tile(np.arange(4), len(raw.t))
    return {"": "\n" + tabulate(names, [t, held, [""] * len(t)], form="{:.6f}")}


def hyperimu(raw: RawRecording, clock: bool = True) -> Files:
    names = axes("MPL_Gyroscope.{}", "MPL_Accelerometer.{}", "MPL_Magnetic_Field.{}", letters="xyz")
    step, table = round(1e3 * float(np.median(np.diff(raw.t)))), np.column_stack([raw.gyr, raw.acc, raw.mag])
    table[0] = 0.0
    stamps = [str(1_510_411_143_791 + round(1e3 * t)) for t in raw.t]
    text = tabulate(["timestamp", *names], [stamps, table]) if clock else tabulate(names, [table])
    day = "Sat Nov 11 15:39:03 GMT+01:00 2017"
    return {"": f"@ HyperIMU - ianovir - 2017\n@ Date: {day}, Sampling Time: {step}ms\n\n{text}"}


def gnss_logger(raw: RawRecording) -> Files:
    """Records of three sensors between others; the bias is in the uncalibrated ones."""
    lines = ["# ", "# Raw,utcTimeMillis,TimeNanos", "# UncalAccel,utcTimeMillis,elapsedRealtimeNanos,X", "#"]
    bias = np.array([0.3, -0.2, 30.0])
    for k, t in enumerate(raw.t):
        for kind, values in (("Accel", raw.acc), ("Gyro", raw.gyr), ("Mag", raw.mag)):
            numbers = ",".join(f"{v:.7f}" for v in (*(values[k] + bias), *bias))
            lines.append(f"Uncal{kind},1699400576750,{16_118_836_475_732 + round(1e9 * t)},{numbers}")
        lines += ["Raw,1699400576750,123,,,4", "Agc,1,2,3"] if k % 50 == 0 else []
    return {"": "\n".join(lines) + "\n"}


def write_files(files: Files, path: Path) -> Path:
    """A file, or a folder of files."""
    if "" in files:
        path.write_text(files[""], encoding="utf-8")
        return path
    for place, text in files.items():
        (path / place).parent.mkdir(parents=True, exist_ok=True)
        (path / place).write_text(text, encoding="utf-8")
    return path


def _app(files: Callable[..., Files], format: str, *options: object, late: bool = True, digits: float = 1e-6) -> Sample:
    return Sample(lambda raw, path: write_files(files(raw, *options), path), format, digits, late=late)


PHONES = {
    "phyphox": _app(phyphox, "phyphox"),
    "phyphox, short header": _app(phyphox, "phyphox", ";", ".", True),
    "phyphox, semicolon and comma": _app(phyphox, "phyphox", ";", ","),
    "phyphox, tab and comma": _app(phyphox, "phyphox", "\t", ",", True),
    "phyphox in one": _app(phyphox_in_one, "phyphox", late=False),
    "sensor-logger, iPhone": _app(sensor_logger, "sensor-logger"),
    "sensor-logger, Android": _app(sensor_logger, "sensor-logger", "android"),
    "sensor-logger, standardised": _app(sensor_logger, "sensor-logger", "standardised"),
    "sensor-logger, uncalibrated": _app(sensor_logger, "sensor-logger", "raw"),
    "sensorlog": _app(sensorlog, "sensorlog"),
    "androsensor": _app(androsensor, "androsensor", late=False, digits=1e-5),
    "physics-toolbox": _app(physics_toolbox, "physics-toolbox", late=False, digits=1e-4),
    "hyperimu": _app(hyperimu, "hyperimu", late=False),
    "gnss-logger": _app(gnss_logger, "gnss-logger", late=False),
}
"""Kinds of files of phones' apps."""


def expected_force(raw: RawRecording, t: np.ndarray) -> np.ndarray:
    """Straight lines at `t` between samples that were themselves taken late, on straight lines."""
    late, force = _late(raw)
    return np.column_stack([np.interp(t, late, column) for column in force.T])


def _late(raw: RawRecording) -> tuple[np.ndarray, np.ndarray]:
    t = raw.t[:-1] + ACC_LATE_S
    return t, np.column_stack([np.interp(t, raw.t, column) for column in raw.acc.T])


def _sensors(raw: RawRecording) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Name, stamps and samples of each sensor on its own clock."""
    assert raw.mag is not None
    gyr, mag = ("Gyroscope", raw.t, raw.gyr), ("Magnetometer", raw.t[::2], raw.mag[::2])
    return [("Accelerometer", *_late(raw)), gyr, mag]
