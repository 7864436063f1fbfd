"""Small recordings as the apps of phones write them, from one recording: what is read is held against it.

Sensors have clocks of their own where the app gives them: the accelerometer's is shifted by `ACC_LATE_S`, the
magnetometer has every other sample.
"""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fg_nav.frames import GRAVITY_M_S2
from fg_nav.recording import RawRecording

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
    files = {}
    for name, t, xyz in _sensors(raw, "Accelerometer", "Gyroscope", "Magnetometer"):
        words, unit = PHYPHOX_HEADERS[name]
        axes = [f'"{axis.upper() if short else words.format(axis)} ({unit})"' for axis in "xyz"]
        rows = [separator.join(f"{v:.9E}".replace(".", decimal) for v in row) for row in np.column_stack([t, xyz])]
        files[f"{name}.csv"] = "\n".join([separator.join(['"Time (s)"', *axes]), *rows]) + "\n"
    linear = PHYPHOX_HEADERS["Linear Accelerometer"]
    axes = ["X", "Y", "Z"] if short else [linear[0].format(axis) for axis in "xyz"]
    head = separator.join(['"Time (s)"', *(f'"{axis} (m/s^2)"' for axis in axes)])
    last = f"{raw.t[-1]:.15E}".replace(".", decimal)
    meta = ['"event"{0}"experiment time"{0}"system time"', f'"START"{{0}}0{decimal}0{{0}}100{decimal}0']
    meta += [f'"PAUSE"{{0}}{last}{{0}}200{decimal}0']
    return {
        **files,
        "Linear Accelerometer.csv": head + "\n",
        "meta/device.csv": "\n".join(f'"{key}"{separator}"{value}"' for key, value in DEVICE) + "\n",
        "meta/time.csv": "\n".join(meta).format(separator) + "\n",
    }


def phyphox_in_one(raw: RawRecording) -> Files:
    """All sensors of one experiment on one clock, short columns filled with NaN."""
    names = [f"{words.format(axis)} ({unit})" for words, unit in PHYPHOX_HEADERS.values() for axis in "xyz"]
    mag = np.where(np.arange(len(raw.t))[:, None] < len(raw.t) - 20, raw.mag, np.nan)
    table = np.column_stack([raw.t, raw.acc, 0.0 * raw.acc, raw.gyr, mag])
    return {"": _csv(["Time (s)", *names], table, "{:.9E}")}


def sensor_logger(raw: RawRecording, kind: str = "ios") -> Files:
    """A table a sensor: of an iPhone, of Android, standardised, uncalibrated only, or without `Metadata.csv`."""
    sign = -1.0 if kind in ("ios", "raw") else 1.0
    gravity = np.tile([0.0, 0.6 * GRAVITY_M_S2, 0.8 * GRAVITY_M_S2], (len(raw.t) - 1, 1))
    files = {"Annotation.csv": "", "Barometer.csv": "time,seconds_elapsed,pressure\n1,2,1013\n"}
    for name, t, xyz in _sensors(raw, "Accelerometer", "Gyroscope", "Magnetometer"):
        tables = {name: xyz}
        if name == "Accelerometer":
            tables = {name: sign * (xyz - gravity), "Gravity": sign * gravity}
            tables |= {"TotalAcceleration": xyz} if kind == "android" else {}
            tables |= {"AccelerometerUncalibrated": sign * xyz / GRAVITY_M_S2} if kind == "raw" else {}
            tables |= {"AccelerometerUncalibrated": xyz} if kind == "bare" else {}
        for table, values in tables.items():
            stamps = START_NS + np.rint(t * 1e9).astype(np.int64)
            rows = [
                f"{s},{e!r},{z!r},{y!r},{x!r}"
                for s, e, (x, y, z) in zip(stamps, t.tolist(), values.tolist(), strict=True)
            ]
            files[f"{table}.csv"] = "\n".join(["time,seconds_elapsed,z,y,x", *rows]) + "\n"
    if kind == "raw":
        files = {name: text for name, text in files.items() if name not in ("Accelerometer.csv", "Gravity.csv")}
        files = {name.replace("Gyroscope", "GyroscopeUncalibrated"): text for name, text in files.items()}
    standardised, platform = str(kind == "standardised").lower(), "android" if kind == "android" else "ios"
    if kind not in ("raw", "bare"):
        head = "version,device name,platform,appVersion,standardisation"
        files["Metadata.csv"] = f"{head}\n3,Phone,{platform},1.30,{standardised}\n"
    return files


def sensorlog(raw: RawRecording, separator: str = ",") -> Files:
    """One row a sample, the force in g with Apple's sign, each sensor with stamps of its own."""
    head = ["loggingTime(txt)", "accelerometerTimestamp_sinceReboot(s)", *_names("accelerometerAcceleration{}(G)")]
    head += ["motionTimestamp_sinceReboot(s)", *_names("motionRotationRate{}(rad/s)")]
    lines = [separator.join([*head, *_names("motionMagneticField{}(µT)"), "activity(txt)"])]
    assert raw.mag is not None
    late, force = _late(raw)
    start = 251699.0
    table = np.column_stack([start + late, -force / GRAVITY_M_S2, start + raw.t[:-1], raw.gyr[:-1], raw.mag[:-1]])
    for row in table:
        fields = [f"{v:.9f}" for v in row]
        lines.append(separator.join(["2026-05-26T14:17:24.702+02:00", *fields, "unknown"]))
    return {"": "\n".join(lines) + "\n"}


def androsensor(raw: RawRecording) -> Files:
    names = [*_names("ACCELEROMETER {} (m/s²)"), *_names("LINEAR ACCELERATION {} (m/s²)")]
    names += [*_names("GYROSCOPE {} (rad/s)"), *_names("MAGNETIC FIELD {} (μT)")]
    table = np.column_stack([raw.acc, 0.0 * raw.acc, raw.gyr, raw.mag, np.rint(1e3 * raw.t)])
    rows = [";".join(f"{v:.5f}" for v in row[:-1]) + f";{row[-1]:.0f};2022-10-22 18:36:24:895" for row in table]
    return {"": "\n".join([";".join([*names, "Time since start in ms ", "YYYY-MO-DD HH-MI-SS_SSS"]), *rows]) + "\n"}


def physics_toolbox(raw: RawRecording) -> Files:
    """A row for each sample of any sensor; the others hold theirs, 0 before the first."""
    groups = (("gF", raw.acc / GRAVITY_M_S2), ("a", 0.1 * raw.acc), ("w", raw.gyr), ("B", raw.mag))
    names = ["time", *(f"{name}{axis}" for name, _ in groups for axis in "xyz")]
    held, lines = np.zeros(12), []
    for k, t in enumerate(raw.t):
        for sensor, (_, values) in enumerate(groups):
            held[3 * sensor : 3 * sensor + 3] = values[k]
            lines.append(f"{t + 1e-6 * sensor:.6f}," + ",".join(f"{v:.6f}" for v in held) + ",")
    return {"": "\n" + "\n".join([",".join(names) + ",", *lines]) + "\n"}


def hyperimu(raw: RawRecording, clock: bool = True) -> Files:
    names = [f"MPL_{name}.{axis}" for name in ("Gyroscope", "Accelerometer", "Magnetic_Field") for axis in "xyz"]
    step = round(1e3 * float(np.median(np.diff(raw.t))))
    lines = ["@ HyperIMU - ianovir - 2017", f"@ Date: Sat Nov 11 15:39:03 GMT+01:00 2017, Sampling Time: {step}ms", ""]
    lines.append(",".join([*(["timestamp"] if clock else []), *names]))
    for k, row in enumerate(np.column_stack([raw.gyr, raw.acc, raw.mag])):
        stamp = [str(1_510_411_143_791 + round(1e3 * raw.t[k]))] if clock else []
        lines.append(",".join([*stamp, *(f"{v:.7f}" for v in (0.0 * row if k == 0 else row))]))
    return {"": "\n".join(lines) + "\n"}


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


class Phone(NamedTuple):
    """Files of an app, the format they are to be recognized as, and whether sensors have clocks of their own."""

    files: Callable[[RawRecording], Files]
    format: str
    own_clocks: bool = True
    digits: float = 1e-6


PHONES: Mapping[str, Phone] = {
    "phyphox": Phone(phyphox, "phyphox"),
    "phyphox, short header": Phone(lambda raw: phyphox(raw, ";", ".", short=True), "phyphox"),
    "phyphox, semicolon and comma": Phone(lambda raw: phyphox(raw, ";", ","), "phyphox"),
    "phyphox, tab and comma": Phone(lambda raw: phyphox(raw, "\t", ",", short=True), "phyphox"),
    "phyphox in one": Phone(phyphox_in_one, "phyphox", False),
    "sensor-logger, iPhone": Phone(sensor_logger, "sensor-logger"),
    "sensor-logger, Android": Phone(lambda raw: sensor_logger(raw, "android"), "sensor-logger"),
    "sensor-logger, standardised": Phone(lambda raw: sensor_logger(raw, "standardised"), "sensor-logger"),
    "sensor-logger, uncalibrated": Phone(lambda raw: sensor_logger(raw, "raw"), "sensor-logger"),
    "sensorlog": Phone(sensorlog, "sensorlog"),
    "androsensor": Phone(androsensor, "androsensor", False, 1e-5),
    "physics-toolbox": Phone(physics_toolbox, "physics-toolbox", False, 1e-4),
    "hyperimu": Phone(hyperimu, "hyperimu", False),
    "gnss-logger": Phone(gnss_logger, "gnss-logger", False),
}
"""Every kind of file that a phone's app writes here."""


def write_files(files: Files, path: Path) -> Path:
    """A file, or a folder of files."""
    if "" in files:
        path.write_text(files[""], encoding="utf-8")
        return path
    for place, text in files.items():
        (path / place).parent.mkdir(parents=True, exist_ok=True)
        (path / place).write_text(text, encoding="utf-8")
    return path


def zip_files(files: Files, path: Path) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for place, text in files.items():
            archive.writestr(place or "walk.csv", text)
    return path


def expected_force(raw: RawRecording, t: np.ndarray) -> np.ndarray:
    """Straight lines at `t` between samples that were themselves taken late, on straight lines."""
    late, force = _late(raw)
    return np.column_stack([np.interp(t, late, column) for column in force.T])


def _late(raw: RawRecording) -> tuple[np.ndarray, np.ndarray]:
    t = raw.t[:-1] + ACC_LATE_S
    return t, np.column_stack([np.interp(t, raw.t, column) for column in raw.acc.T])


def _sensors(raw: RawRecording, acc: str, gyr: str, mag: str) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Stamps and samples of each sensor on its own clock."""
    assert raw.mag is not None
    return [(acc, *_late(raw)), (gyr, raw.t, raw.gyr), (mag, raw.t[::2], raw.mag[::2])]


def _names(pattern: str) -> list[str]:
    return [pattern.format(axis) for axis in "XYZ"]


def _csv(names: list[str], table: np.ndarray, form: str) -> str:
    rows = [",".join(form.format(v) for v in row) for row in table]
    return "\n".join([",".join(f'"{name}"' for name in names), *rows]) + "\n"
