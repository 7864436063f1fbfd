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
from fg_nav.errors import FgNavError, FormatError
from fg_nav.io.choice import choose_sensor
from fg_nav.io.content import Content
from fg_nav.io.streams import Stream, join_streams
from fg_nav.io.text_columns import scale_values
from fg_nav.recording import RawRecording
from fg_nav.samples.plausibility import find_mag_problem, measure_field_strength

_SUFFIXES = {b"#ROSBAG V": ".bag", b"\x89MCAP": ".mcap", b"SQLite format 3\0": ".db3"}
_METADATA = "metadata.yaml"
_MENDERS = {".bag": "rosbag reindex", ".mcap": "mcap recover"}

_IMU = ("sensor_msgs/msg/Imu", "sensor_msgs/Imu")
_FIELD = ("sensor_msgs/msg/MagneticField", "sensor_msgs/MagneticField")
_VECTOR = ("geometry_msgs/msg/Vector3Stamped", "geometry_msgs/Vector3Stamped")

_UNITS_UT = {"T": 1e6, "uT": 1.0, "gauss": 100.0, "mG": 0.1, "nT": 1e-3}
"""Units that drivers give fields in; the first is the standard."""

_SAME = 1e-6
"""A field whose strength changes by less than this share is normalized: even a magnetometer at rest has noise."""


class Vectors(NamedTuple):
    """Messages of a topic: stamps (N,) ns of their headers and of the bag, and the vectors (N, 3) in them."""

    stamp: Ints
    taken_in: Ints
    xyz: Floats

    @property
    def t(self) -> Ints:
        """Stamps (N,) ns of the headers; those of the bag where the headers are empty."""
        return self.stamp if self.stamp.any() else self.taken_in


def recognizes(content: Content) -> bool:
    """Whether it begins as a bag or a storage of one, or is a folder with a bag's description."""
    if content.members:
        return _METADATA in content.members and any(
            "rosbag2_bagfile_information" in line for line in content.members[_METADATA].lines[:5]
        )
    return _find_suffix(content) is not None


def read(content: Content) -> RawRecording:
    """Read the inertial sensor of a bag.

    Raises `FormatError` if rosbags is not installed, the bag is damaged or holds no Imu, or it is not said which of
    several topics to take.
    """
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
        magnetic = _choose_field(topics, imu)
        acc, gyr = _read_imu(reader, imu, path)
        field = None if magnetic is None else _read_vectors(reader, magnetic)
    notes = [
        f"the topic is {imu}",
        *([] if acc.stamp.any() else ["headers have no stamps: those of the bag are taken"]),
    ]
    streams = [_pack("acc", acc, imu), _pack("gyr", gyr, imu)]
    if field is not None and magnetic is not None and len(field.xyz):
        scale, words = _judge_field(field.xyz, magnetic)
        notes.append(words)
        if scale:
            streams.append(_pack("mag", field._replace(xyz=scale_values(field.xyz, scale)), magnetic))
    return join_streams(streams, path, "ros", notes)


def _find_suffix(content: Content) -> str | None:
    return next((suffix for magic, suffix in _SUFFIXES.items() if content.head.startswith(magic)), None)


@contextmanager
def _place(content: Content) -> Iterator[Path]:
    """Where rosbags finds the bag, named as it needs it: the path itself, or a copy of what is packed for the while."""
    suffix = None if content.members else _find_suffix(content)
    packed = content.fetch is not None or any(member.fetch is not None for member in content.members.values())
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
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise FormatError(
            f"{path.name} is a ROS bag, which rosbags reads: install it, `pip install 'fg-nav[ros]'`."
        ) from None
    try:
        with AnyReader([place], default_typestore=get_typestore(Stores.LATEST)) as reader:
            yield reader
    except FgNavError:
        raise
    except Exception as error:  # the zoo: struct, Key, Value, sqlite3, yaml, zstd, lz4 ... errors
        reason = " ".join(f"{type(error).__name__} {error}".split())[:120]
        mend = _MENDERS.get(place.suffix, "ros2 bag reindex")
        raise FormatError(f"{path.name} is a damaged ROS bag ({reason}): copy it again, or try `{mend}`.") from None


def _choose_field(topics: dict[str, str], imu: str) -> str | None:
    """Choose the topic of the magnetometer that belongs to an Imu."""
    fields = [topic for topic, kind in topics.items() if kind in _FIELD]
    fields = fields or [topic for topic, kind in topics.items() if kind in _VECTOR and "mag" in topic.lower()]
    return max(sorted(fields), key=lambda topic: _count_shared(topic, imu), default=None)


def _count_shared(one: str, other: str) -> int:
    """Count the characters that two names begin with together."""
    differ = (k for k, (a, b) in enumerate(zip(one, other, strict=False)) if a != b)
    return next(differ, min(len(one), len(other)))


def _read_imu(reader: Any, topic: str, path: Path) -> tuple[Vectors, Vectors]:
    """Specific force and rate of a topic."""
    rows = []
    absent = {"linear_acceleration": True, "angular_velocity": True}
    for message, taken_in in _messages(reader, topic):
        for name in absent:
            absent[name] &= getattr(message, f"{name}_covariance")[0] == -1.0
        a, w = message.linear_acceleration, message.angular_velocity
        rows.append((_stamp(message), taken_in, a.x, a.y, a.z, w.x, w.y, w.z))
    for name, missing in absent.items():
        if missing:
            raise FormatError(f"{path.name}: {topic} does not measure {name}: record the raw topic of the sensor.")
    stamps, samples = _split(rows, 6)
    return Vectors(*stamps, samples[:, :3]), Vectors(*stamps, samples[:, 3:])


def _read_vectors(reader: Any, topic: str) -> Vectors:
    rows = []
    for message, taken_in in _messages(reader, topic):
        field = message.magnetic_field if hasattr(message, "magnetic_field") else message.vector
        rows.append((_stamp(message), taken_in, field.x, field.y, field.z))
    stamps, xyz = _split(rows, 3)
    return Vectors(*stamps, xyz)


def _messages(reader: Any, topic: str) -> Iterator[tuple[Any, int]]:
    """Messages of a topic, and when the bag took them in, ns."""
    connections = [connection for connection in reader.connections if connection.topic == topic]
    for connection, taken_in, data in reader.messages(connections):
        yield reader.deserialize(data, connection.msgtype), taken_in


def _stamp(message: Any) -> int:
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)


def _split(rows: list[tuple[Any, ...]], width: int) -> tuple[tuple[Ints, Ints], Floats]:
    """Stamps and numbers (N, width) of rows."""
    stamps = np.array([row[:2] for row in rows], dtype=np.int64).reshape(-1, 2)
    return (stamps[:, 0], stamps[:, 1]), np.array([row[2:] for row in rows], dtype=np.float64).reshape(-1, width)


def _pack(what: Any, vectors: Vectors, topic: str) -> Stream:
    return Stream(what, vectors.t, vectors.xyz, np.arange(1, len(vectors.t) + 1), topic)


def _judge_field(xyz: Floats, topic: str) -> tuple[float, str]:
    """Size in uT of the unit of a field (N, 3), 0 if it has none, and what is to be said of it."""
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
