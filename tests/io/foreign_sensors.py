"""Small files as the tools of sensor makers write them, from one recording: what is read is held against it."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from fg_nav.frames import GRAVITY_M_S2
from fg_nav.recording import RawRecording
from tests.io.samples import Sample, axes, tabulate

EPOCH_MS = 1_595_933_810_034  # Start of the files that have the time of day, ms since 1970.

_MT_LINES = (
    "// General information: ",
    "//  MT Manager version: 2022.2.0 ",
    "// Device information: ",
    "//  DeviceId: 00B42D4B",
    "//  Update Rate: {rate:.1f}Hz",
    "// Coordinate system: ENU",
)


def write_xsens_mt(raw: RawRecording, path: Path, separator: str = "\t", fine: bool = False) -> None:
    """With empty columns of time and a counter that begins again; packet 7 is lost."""
    k = np.delete(np.arange(len(raw.t)), 7)
    names = ["PacketCounter", "SampleTimeFine", "Year", *axes("Acc_{}", "Gyr_{}", "Mag_{}")]
    counter = [f"{count % 65536:05d}" for count in 65500 + k]
    stamps = [str(round(864_000_000 - 100 + t * 1e4) % 864_000_000) if fine else "" for t in raw.t[k]]
    columns = [counter, stamps, [""] * len(k), raw.acc[k], raw.gyr[k], raw.mag[k] / 48.0]
    above = "\n".join(_MT_LINES).format(rate=_rate(raw))
    path.write_text(f"{above}\n{tabulate(names, columns, separator, '{:.6f}')}")


def _rate(raw: RawRecording) -> float:
    return float(1.0 / np.median(np.diff(raw.t)))


def write_xsens_dot(raw: RawRecording, path: Path, increments: bool = False) -> None:
    """A recording of the app: us that begin again after 2^32, the first row of zeros, no magnetometer."""
    keys = ["sep=,", "DeviceTag:,LF", "FirmwareVersion:,2.1.0", "AppVersion:,2023.6.1", "OutputRate:,60Hz", " 2024", ""]
    if increments:
        names = ["dq_W", *axes("dq_{}"), "dv[1]", "dv[2]", "dv[3]"]
        turns = Rotation.from_rotvec(raw.gyr / _rate(raw)).as_quat(scalar_first=True)
        samples = np.hstack([turns, raw.acc / _rate(raw)])
    else:
        names, samples = axes("Acc_{}", "Gyr_{}"), np.hstack([raw.acc, np.rad2deg(raw.gyr)])
        samples[0] = 0.0
    clocks = [[str(k + 1), str(round(2**32 - 50_000 + t * 1e6) % 2**32)] for k, t in enumerate(raw.t)]
    rows = tabulate([], [clocks, samples], ", ", "{:.12f}").lstrip()
    path.write_text("\n".join([*keys, ",".join(["PacketCounter", "SampleTimeFine", *names]), rows]))


def write_dot_sdk(raw: RawRecording, path: Path, rad: bool = False, attitude: bool = False) -> None:
    """A log of the PC SDK: all keys in one line, 0.1 ms, four digits, and a last row that was cut."""
    names = ["SampleTimeFine", *axes("Acc_{}", "Gyr_{}", "Mag_{}")]
    stamps = [f"{1000.0 + t * 1e4:.0f}" for t in raw.t]
    columns = [stamps, raw.acc, raw.gyr if rad else np.rad2deg(raw.gyr), raw.mag / 48.0]
    if attitude:
        names += ["Quat_W", *axes("Quat_{}")]
        columns.append(_integrate(raw).as_quat(scalar_first=True))
    keys = "DeviceTag: Movella DOT,FirmwareVersion: 3.0.0,AppVersion: 2023.6.0,OutputRate: 60"
    path.write_text(f"{keys}\n{tabulate(names, columns, form='{:.4f}')}{1000 + raw.t[-1] * 1e4 + 50:.0f}\n")


def write_movesense(raw: RawRecording, path: Path, separate: bool = False) -> None:
    """Blocks of eight samples with a stamp in whole ms each."""
    blocks: dict[str, list[dict[str, object]]] = {}
    for start in range(0, len(raw.t) // 8 * 8, 8):
        block = {
            key: [dict(zip("xyz", row, strict=True)) for row in values[start : start + 8].tolist()]
            for key, values in (("ArrayAcc", raw.acc), ("ArrayGyro", np.rad2deg(raw.gyr)), ("ArrayMagn", raw.mag))
        }
        stamp = {"Timestamp": round(17541 + raw.t[start] * 1e3)}
        if separate:
            for key, values in block.items():
                blocks.setdefault(key.removeprefix("Array"), []).append({key: values, **stamp})
        else:
            blocks.setdefault("IMU9", []).append({**block, **stamp})
    path.write_text(json.dumps({"Meas": blocks}))


SHIMMER_CLOCKS: dict[str, tuple[str, Callable[[int], str]]] = {
    "Timestamp_Unix": ("ms", lambda ms: f"{(EPOCH_MS + ms) / 1e12:.12f}E12"),
    "Timestamp_FormattedUnix": (
        "yyyy/mm/dd hh:mm:ss.000",
        lambda ms: pd.Timestamp(EPOCH_MS + ms, unit="ms").strftime("%Y/%m/%d %H:%M:%S.%f")[:-3],
    ),
    "Timestamp": ("ms", lambda ms: str(1000 + 2 * ms)),  # a clock that runs at the double rate, to tell it from others
}


def write_shimmer(
    raw: RawRecording, path: Path, formatted: bool = False, wide: bool = False, clocks: tuple[str, ...] = ()
) -> None:
    """With the separator told, a row of units, CRLF, a separator at the end, and both accelerometers."""
    clocks = clocks or ("Timestamp_FormattedUnix" if formatted else "Timestamp_Unix",)
    names = [*clocks, *axes("Accel_WR_{}", *([] if wide else ["Accel_LN_{}"]), "Gyro_{}", "Mag_{}")]
    units = [*(SHIMMER_CLOCKS[clock][0] for clock in clocks), *["m/(s^2)"] * (3 if wide else 6)]
    times = [[SHIMMER_CLOCKS[clock][1](round(t * 1e3)) for t in raw.t] for clock in clocks]
    acc = [raw.acc] if wide else [raw.acc[:, ::-1], raw.acc]
    columns = [*times, *acc, np.rad2deg(raw.gyr), raw.mag / 48.0, [""] * len(raw.t)]
    units += [*["deg/s"] * 3, *["local_flux"] * 3]
    table = tabulate([*(f"Shimmer_40AC_{name}_CAL" for name in names), ""], columns, ";").splitlines()
    lines = ['"sep=;"', table[0], ";".join([*units, ""]), *table[1:]]
    path.write_bytes(("\r\n".join(lines) + "\r\n").encode())


def write_apdm(raw: RawRecording, path: Path, paths: bool = False) -> None:
    """Two sensors, of which the second is the recording and the first stands on its head."""
    sensors = {"Lumbar": -1.0, "Left Foot": 1.0}
    values = [np.hstack([sign * raw.acc, sign * raw.gyr, sign * raw.mag]) for sign in sensors.values()]
    if paths:
        words = ("Acceleration", "Angular Velocity", "Magnetic Field")
        header = ["Time", *axes(*(f"{name}/{word}/{{}}" for name in sensors for word in words))]
        units = ["s", *[*["m/s^2"] * 3, *["rad/s"] * 3, *["uT"] * 3] * 2]
        above = ["Test Name:,Walk", "Sample Rate:,100,Hz", ",".join(header), ",".join(units)]
        time = [f"{t:.6f}" for t in raw.t]
    else:
        block = ["Accelerometer", "", "", "Gyroscope", "", "", "Magnetometer", "", "", "Barometer"]
        numbers = "".join(f",{5718 + k},,,{name},,,,,," for k, name in enumerate(sensors))
        above = [f"Format=7{numbers}", ",".join(["Time", *block, *block]), "," + ",".join([*"XYZXYZXYZ", ""] * 2)]
        values = [np.column_stack([part, np.full(len(raw.t), 4636858284341460992.0)]) for part in values]
        time = [f"{EPOCH_MS * 1000 + round(t * 1e6)}" for t in raw.t]
    path.write_text("\n".join(above) + tabulate([], [time, *values], form="{:.6f}"))


def write_vectornav(raw: RawRecording, path: Path, compensated: bool = True) -> None:
    """With the names of INSTINCT, empty columns before satellites are seen, and one unit missing."""
    empty, stamps = [""] * len(raw.t), [f"{18656256000 + t * 1e9:.0f}" for t in raw.t]
    names, columns = ["Time [s]", "GpsWeek", "Time::TimeStartup [ns]"], [empty, empty, stamps]
    for kind, sign in {"Uncomp": -1.0, "": 1.0}.items() if compensated else [("Uncomp", 1.0)]:
        rate = "AngularRate" if kind == "" else "UncompGyro"
        names += axes(f"IMU::{kind}Mag::{{}} [Gauss]", f"IMU::{kind}Accel::{{}} [m/s^2]")
        names += [f"IMU::{rate}::X", *axes(f"IMU::{rate}::{{}} [rad/s]", letters="YZ")]
        columns += [sign * raw.mag / 100.0, sign * raw.acc, sign * raw.gyr]
    path.write_text(tabulate(names, columns, form="{:.8f}"))


def write_yei(raw: RawRecording, path: Path) -> None:
    names = ["%int(ChipTimeUS)", *axes("%float(RawGyro{})", "%float(RawCompass{})", "%float(RawAccel{})")]
    stamps = [f"{t * 1e6:.0f}" for t in raw.t]
    rows = tabulate([], [stamps, raw.gyr, raw.mag / 100.0, raw.acc / GRAVITY_M_S2])
    path.write_text(f' # Data format: "{",".join(names)}"{rows}')


def write_metawear(raw: RawRecording, folder: Path, session: str = "Left_MetaWear_2019-01-11T16.10.08.270_C4") -> None:
    """A file a sensor, and one of a filter in the accelerometer's unit; the magnetometer has every fourth sample.

    Each file counts from its own first sample.
    """
    folder.mkdir(exist_ok=True)
    every, fourth = slice(None), slice(2, None, 4)
    for name, values, unit, rows in (
        ("Accelerometer_100.000Hz", raw.acc / GRAVITY_M_S2, "g", every),
        ("LinearAcceleration", 0.0 * raw.acc, "g", every),
        ("Gyroscope_100.000Hz", np.rad2deg(raw.gyr), "deg/s", every),
        ("Magnetometer_25.000Hz", raw.mag * 1e-6, "T", fourth),
    ):
        names = ["epoch (ms)", "time (01:00)", "elapsed (s)", *axes(f"{{}}-axis ({unit})", letters="xyz")]
        t, day = raw.t[rows], "2019-01-11T16:10:08.431"
        stamps = [[f"{EPOCH_MS + round(one * 1e3)}", day, f"{one - t[0]:.3f}"] for one in t]
        text = tabulate(names, [stamps, values[rows]], form="{:.12g}")
        (folder / f"{session}_{name}_1.4.4.csv").write_text(text)


def write_ximu3(raw: RawRecording, folder: Path, unit: str = "a.u.") -> None:
    """Inertial.csv, Magnetometer.csv with every fifth sample, and files that are of no use."""
    folder.mkdir(exist_ok=True)
    stamps, mag = np.round(1e6 * raw.t), raw.mag if unit == "uT" else raw.mag / 48.0
    inertial = np.hstack([np.rad2deg(raw.gyr), raw.acc / GRAVITY_M_S2])
    for name, columns, table, step in (
        ("Inertial.csv", axes("Gyroscope {} (deg/s)", "Accelerometer {} (g)"), inertial, 1),
        ("Magnetometer.csv", axes(f"Magnetometer {{}} ({unit})"), mag, 5),
        ("HighGAccelerometer.csv", axes("High-g Accelerometer {} (g)"), raw.acc, 4),
        ("Temperature.csv", ["Temperature (C)"], stamps, 50),
    ):
        text = tabulate(["Timestamp (us)", *columns], [stamps[::step], table[::step]], form="{:.12g}")
        (folder / name).write_text(text)


def write_bag(raw: RawRecording, path: Path, imus: tuple[str, ...] = ("/left/imu",), normalized: bool = False) -> None:
    """A ROS 1 bag at `walk.bag`; else a ROS 2 bag, a folder with storage of mcap or sqlite3 as its suffix says.

    Besides the magnetometer `/left/mag` there is another, of half the field.
    """
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if path.suffix == ".bag" else Stores.LATEST)
    serialize = store.serialize_ros1 if path.suffix == ".bag" else store.serialize_cdr
    plugin = StoragePlugin.MCAP if path.suffix == ".mcap" else StoragePlugin.SQLITE3
    kind, field_kind = "sensor_msgs/msg/Imu", "sensor_msgs/msg/MagneticField"
    types = store.types
    stamp_of, vector = types["builtin_interfaces/msg/Time"], types["geometry_msgs/msg/Vector3"]
    with Writer1(path) if path.suffix == ".bag" else Writer(path, version=9, storage_plugin=plugin) as writer:
        topics = {topic: writer.add_connection(topic, kind, typestore=store) for topic in imus}
        fields = {topic: writer.add_connection(topic, field_kind, typestore=store) for topic in ("/a/mag", "/left/mag")}
        for k, t in enumerate(raw.t):
            ns = EPOCH_MS * 10**6 + round(t * 1e9)
            extra = {"seq": k} if path.suffix == ".bag" else {}
            header = types["std_msgs/msg/Header"](
                stamp=stamp_of(sec=ns // 10**9, nanosec=ns % 10**9), frame_id="imu", **extra
            )
            force, rate = vector(*raw.acc[k]), vector(*raw.gyr[k])
            attitude = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 0.0)
            message = types[kind](header, attitude, np.zeros(9), rate, np.zeros(9), force, np.zeros(9))
            for topic in topics.values():
                writer.write(topic, ns + 30_000_000, serialize(message, kind))
            if k % 4 == 0:
                field = 1e-4 * raw.mag[k] / np.linalg.norm(raw.mag[k]) if normalized else 1e-6 * raw.mag[k]
                for topic, share in zip(fields.values(), (0.5, 1.0), strict=True):
                    message = types[field_kind](header, vector(*(share * field)), np.zeros(9))
                    writer.write(topic, ns + 30_000_000, serialize(message, field_kind))


def _integrate(raw: RawRecording) -> Rotation:
    """Attitude that turns as the gyroscope says."""
    turns = Rotation.from_rotvec(raw.gyr * np.diff(raw.t, prepend=raw.t[0])[:, None])
    attitude = [turns[0]]
    for k in range(1, len(raw.t)):
        attitude.append(attitude[-1] * turns[k])
    return Rotation.concatenate(attitude)


SENSORS = {
    "xsens": Sample(write_xsens_mt, "xsens", 1e-6),
    "dot": Sample(write_xsens_dot, "xsens-dot", 1e-9),
    "dot-increments": Sample(partial(write_xsens_dot, increments=True), "xsens-dot", 1e-9),
    "dot-sdk": Sample(partial(write_dot_sdk, attitude=True), "xsens-dot", 1e-4),
    "dot-sdk-rad": Sample(partial(write_dot_sdk, rad=True), "xsens-dot", 1e-4),
    "movesense": Sample(write_movesense, "movesense", 1e-9),
    "movesense-apart": Sample(partial(write_movesense, separate=True), "movesense", 1e-9),
    "shimmer": Sample(write_shimmer, "shimmer", 1e-9),
    "shimmer-text": Sample(partial(write_shimmer, formatted=True), "shimmer", 1e-9),
    "shimmer-wide": Sample(partial(write_shimmer, wide=True), "shimmer", 1e-9),
    "apdm": Sample(write_apdm, "apdm", 1e-6, "left foot"),
    "apdm-paths": Sample(partial(write_apdm, paths=True), "apdm", 1e-6, "Foot"),
    "vectornav": Sample(write_vectornav, "vectornav", 1e-7),
    "vectornav-uncompensated": Sample(partial(write_vectornav, compensated=False), "vectornav", 1e-7),
    "yei": Sample(write_yei, "yei", 1e-9),
}
"""Kinds of files of sensor makers' tools."""
