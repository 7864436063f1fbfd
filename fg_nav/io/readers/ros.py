"""ROS 1 and ROS 2 bags: `sensor_msgs/Imu` and `sensor_msgs/MagneticField`, by the extra `ros` (rosbags).

========================= =====================================================================================
path                      a `.bag`; a folder with `metadata.yaml`; a `.db3` or `.mcap` alone
time                      `header.stamp`, of the sensor's driver; where it is empty, when the bag took it in
`linear_acceleration`     m/s^2, with gravity; covariance[0] = -1: not measured
`angular_velocity`        rad/s; covariance[0] = -1: not measured
`magnetic_field`          tesla; some drivers normalize it, and then it has a direction and no strength
`orientation`             of the driver's own filter: left out
========================= =====================================================================================

One topic with Imu is taken; of several the user names one. Its magnetometer is the one topic with a field, or of
several the one whose name begins most like it; older drivers give the field as `geometry_msgs/Vector3Stamped`. Drivers
that do not keep to tesla are found by the strength of the field, which is 25 to 65 uT on Earth.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import FormatError
from fg_nav.io.content import Content, choose_sensor, explain_library
from fg_nav.io.streams import Stream, join_streams
from fg_nav.io.tables import scale_values
from fg_nav.recording import RawRecording
from fg_nav.samples.plausibility import find_mag_problem, measure_field_strength

_SUFFIXES = {b"#ROSBAG V": ".bag", b"\x89MCAP": ".mcap", b"SQLite format 3\0": ".db3"}
_METADATA = "metadata.yaml"
_MENDERS = {".bag": "rosbag reindex", ".mcap": "mcap recover"}

_IMU = ("sensor_msgs/msg/Imu", "sensor_msgs/Imu")
_FIELD = ("sensor_msgs/msg/MagneticField", "sensor_msgs/MagneticField")
_VECTOR = ("geometry_msgs/msg/Vector3Stamped", "geometry_msgs/Vector3Stamped")

_UNITS_UT = {"T": 1e6, "uT": 1.0, "gauss": 100.0, "mG": 0.1, "nT": 1e-3}  # Of drivers; the first is the standard.
_SAME = 1e-6  # A strength that changes by less of itself is that of a normalized field: even at rest there is noise.


def recognizes(content: Content) -> bool:
    """Whether it begins as a bag or a storage of one, or is a folder with a bag's description."""
    if content.members:
        return _METADATA in content.members and any(
            "rosbag2_bagfile_information" in line for line in content.members[_METADATA].lines[:5]
        )
    return _find_suffix(content) is not None


def read(content: Content) -> RawRecording:
    """Read the inertial sensor of a bag."""
    path = content.path
    with _place(content) as place, _open(place, path) as reader:
        topics = {connection.topic: connection.msgtype for connection in reader.connections if connection.msgcount}
        imus = sorted(topic for topic, kind in topics.items() if kind in _IMU)
        if not imus:
            raise FormatError(
                f"{path.name} has no topic of sensor_msgs/Imu ({', '.join(sorted(topics)) or 'it is empty'}): "
                f"record one with the raw samples."
            )
        imu = choose_sensor(imus, content.sensor, path, "topics of sensor_msgs/Imu")
        # the magnetometer that belongs to it
        fields = [topic for topic, kind in topics.items() if kind in _FIELD]
        fields = fields or [topic for topic, kind in topics.items() if kind in _VECTOR and "mag" in topic.lower()]
        shared = {topic: sum(imu.startswith(topic[:k]) for k in range(1, len(topic) + 1)) for topic in sorted(fields)}
        magnetic = max(shared, key=lambda topic: shared[topic], default=None)
        inertial = _read_topic(reader, imu)
        for name, covariance in (("linear_acceleration", 6), ("angular_velocity", 7)):
            if (inertial.values[:, covariance] == -1.0).all():
                raise FormatError(f"{path.name}: {imu} does not measure {name}: record the raw topic of the sensor.")
        field = None if magnetic is None else _read_topic(reader, magnetic)
    notes = [f"the topic is {imu}"]
    if not inertial.has_stamps:
        notes.append("headers have no stamps: those of the bag are taken")
    acc, gyr = inertial.values[:, :3], inertial.values[:, 3:6]
    streams = [Stream("acc", inertial.t, acc, inertial.row, imu), Stream("gyr", inertial.t, gyr, inertial.row, imu)]
    if field is not None and magnetic is not None and len(field.t):
        scale, words = _judge_field(field.values, magnetic)
        notes.append(words)
        if scale:
            streams.append(Stream("mag", field.t, scale_values(field.values, scale), field.row, magnetic))
    return join_streams(streams, path, "ros", notes)


def _find_suffix(content: Content) -> str | None:
    return next((suffix for magic, suffix in _SUFFIXES.items() if content.head.startswith(magic)), None)


@contextmanager
def _place(content: Content) -> Iterator[Path]:
    """Yield a path that rosbags can open: the bag itself, or a temporary copy, unpacked or renamed."""
    suffix = None if content.members else _find_suffix(content)
    packed = content.opener is not None or any(member.opener is not None for member in content.members.values())
    if not packed and (content.members or content.path.suffix == suffix):
        yield content.path
        return
    with TemporaryDirectory() as folder:
        if not content.members:
            place = Path(folder) / f"bag{suffix or ''}"
            if packed:
                place.write_bytes(content.read_bytes())
            else:
                place.symlink_to(content.path.resolve())
            yield place
            return
        for name, member in content.members.items():
            if "/" not in name:
                (Path(folder) / name).write_bytes(member.read_bytes())
        yield Path(folder)


@contextmanager
def _open(place: Path, path: Path) -> Iterator[Any]:
    """Open a bag. Whatever rosbags, yaml, sqlite, lz4 or zstd make of a damaged one is a `FormatError`."""
    mend = _MENDERS.get(place.suffix, "ros2 bag reindex")
    with explain_library(path.name, "a ROS bag", "rosbags", "ros", f"copy it again, or try `{mend}`"):
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

        with AnyReader([place], default_typestore=get_typestore(Stores.LATEST)) as reader:
            yield reader


class _Messages(NamedTuple):
    """Messages of a topic: stamps (N,) ns, of the headers or else of the bag, numbers (N, K) in them, rows (N,)."""

    t: Ints
    has_stamps: bool
    values: Floats
    row: Ints


def _read_topic(reader: Any, topic: str) -> _Messages:
    """Return stamps and numbers of a topic: force, rate, first covariance of each (-1: not measured); or field."""
    stamps, values = list[tuple[int, int]](), list[tuple[float, ...]]()
    connections = [connection for connection in reader.connections if connection.topic == topic]
    for connection, taken_in, data in reader.messages(connections):
        message = reader.deserialize(data, connection.msgtype)
        if hasattr(message, "linear_acceleration"):
            a, w = message.linear_acceleration, message.angular_velocity
            absent = message.linear_acceleration_covariance[0], message.angular_velocity_covariance[0]
            values.append((a.x, a.y, a.z, w.x, w.y, w.z, *absent))
        else:
            field = message.magnetic_field if hasattr(message, "magnetic_field") else message.vector
            values.append((field.x, field.y, field.z))
        stamps.append((int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec), taken_in))
    of_header, of_bag = np.array(stamps, dtype=np.int64).reshape(-1, 2).T
    has_stamps = bool(of_header.any())
    numbers = np.array(values, dtype=np.float64).reshape(len(values), -1) if values else np.empty((0, 8))
    return _Messages(of_header if has_stamps else of_bag, has_stamps, numbers, np.arange(1, len(stamps) + 1))


def _judge_field(xyz: Floats, topic: str) -> tuple[float, str]:
    """Return the factor from the unit of a field (N, 3) to uT, 0 if it is to be left out, and a note on it."""
    strength = measure_field_strength(xyz)
    strength = strength[np.isfinite(strength)]
    if not strength.size:
        return 0.0, f"{topic} has no field in it, and was left out"
    median = float(np.median(strength))
    if median == 0.0 or np.ptp(strength) <= _SAME * median:
        return 0.0, f"{topic} is normalized (its strength is always {median:.3g}), no field in uT, and was left out"
    for unit, scale in _UNITS_UT.items():
        if find_mag_problem(xyz * scale) is None:
            told = "" if unit == "T" else f", in {unit} by its strength and not in T"
            return scale, f"the magnetometer is {topic}{told}"
    return 0.0, f"{topic} has a median strength of {median:.3g} T, no field on Earth, and was left out"
