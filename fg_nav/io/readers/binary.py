"""Recordings in binary files: published sets of walks in MATLAB files, each with its truth, and ROS bags.

PyShoe (Wagstaff et al., University of Toronto) and gdlbio, of a LORD 3DM-GX5-25 on a shoe: acc and gyr (N, 6). The
truths of both are **left-handed**: y is negated here. Their `gt_idx` and `strideIndex` are samples, from 0.

BROAD (Laidig et al., Data 6(7), 2021): `imu_mag` repeats held samples; `opt_quat` (N, 4) is w, x, y, z, sensor to
East-North-Up, and `opt_pos` (N, 3) m, NaN where unseen; the samples are even.

ROS 1 and 2, by the extra `ros` (rosbags): a `.bag`, a folder with `metadata.yaml`, a `.db3` or `.mcap` alone. Of topics
with `sensor_msgs/Imu` one is taken, at `header.stamp`, or where that is empty at the time when the bag took it in. Its
field is the `sensor_msgs/MagneticField` (of older drivers `geometry_msgs/Vector3Stamped`) whose name begins most like
it; drivers that do not keep to tesla, or normalize it, are found by the strength.
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
from fg_nav.io.beside import pack_footprints, pack_true_path
from fg_nav.io.content import Content, choose_sensor, explain_library
from fg_nav.io.matlab import Variables, mat_array
from fg_nav.io.streams import Stream, drop_held, join_streams
from fg_nav.recording import Provenance, RawRecording
from fg_nav.samples.plausibility import find_mag_problem, measure_field_strength
from fg_nav.truth import Truth

_RIGHT_HANDED = np.array([1.0, -1.0, 1.0])


def _take(variables: Variables, name: str, path: Path, columns: int | None, like: str, count: int) -> Floats:
    """Return an array with a row for each of the `count` of `like`; raises `FormatError` as `mat_array`."""
    values = mat_array(variables, name, path, columns=columns)
    if len(values) != count:
        raise FormatError(f"{path.name}: '{name}' has {len(values)} rows, '{like}' {count}: export it again.")
    return values


def read_pyshoe(content: Content) -> RawRecording:
    """Read a PyShoe trial."""
    path, variables = content.path, content.load_variables()
    inertial = mat_array(variables, "imu", path, columns=6)
    t = _take(variables, "ts", path, None, "imu", len(inertial))
    truth, gt = None, variables.get("gt")
    if gt is not None and gt.ndim == 2 and gt.shape[1] == 3:  # the stair trials give one height a landing
        sample, like = np.arange(len(t)), "imu"
        if "gt_idx" in variables:
            index = mat_array(variables, "gt_idx", path)
            if not ((index >= 0) & (index < len(t))).all():
                raise FormatError(f"{path.name}: 'gt_idx' points outside of the recording: export it again.")
            sample, like = index.astype(np.int64), "gt_idx"
        position = _take(variables, "gt", path, 3, like, len(sample)) * _RIGHT_HANDED
        truth = pack_true_path(t[sample], position)
    return _pack(t, inertial, truth, path, "pyshoe")


def _pack(t: Floats, inertial: Floats, truth: Truth | None, path: Path, format: str) -> RawRecording:
    acc, gyr, row = inertial[:, :3].copy(), inertial[:, 3:].copy(), np.arange(1, len(t) + 1)
    return RawRecording(t, acc, gyr, row, truth=truth, provenance=Provenance(path, format))


def read_gdlbio(content: Content) -> RawRecording:
    """Read a surveyed walk."""
    path, variables = content.path, content.load_variables()
    inertial = mat_array(variables, "imu_data", path, columns=6)
    t = _take(variables, "timestamps", path, None, "imu_data", len(inertial))
    truth = None
    if {"strideIndex", "GCP"} <= variables.keys():
        sample = mat_array(variables, "strideIndex", path)
        whole = ((sample >= 0) & (sample < len(t)) & (sample == np.round(sample))).all()
        if not whole or (np.diff(sample) <= 0).any():
            raise FormatError(f"{path.name}: 'strideIndex' must be rising samples of the recording: export it again.")
        xy = _take(variables, "GCP", path, 2, "strideIndex", len(sample)) * _RIGHT_HANDED[:2]
        stride = np.arange(len(xy), dtype=np.float64)
        truth = pack_footprints(stride, xy, len(xy) - 1, path, t[sample.astype(np.int64)])
    return _pack(t, inertial, truth, path, "gdlbio")


def read_broad(content: Content) -> RawRecording:
    """Read a BROAD trial."""
    path, variables = content.path, content.load_variables()
    rate = mat_array(variables, "sampling_rate", path)
    if rate.size != 1 or not 1.0 <= rate[0] <= 1e5:
        raise FormatError(f"{path.name}: 'sampling_rate' is no usable rate in Hz: export it again.")
    acc = mat_array(variables, "imu_acc", path, columns=3)

    like = ("imu_acc", len(acc))
    gyr = _take(variables, "imu_gyr", path, 3, *like)
    mag = _take(variables, "imu_mag", path, 3, *like) if "imu_mag" in variables else None
    mag = drop_held(mag, gyr) if mag is not None and len(mag) else None
    t, truth = np.arange(len(acc)) / rate[0], None
    if {"opt_quat", "opt_pos"} <= variables.keys():
        from scipy.spatial.transform import Rotation  # slow to load

        wxyz, position = _take(variables, "opt_quat", path, 4, *like), _take(variables, "opt_pos", path, 3, *like)
        seen = np.abs(np.linalg.norm(wxyz, axis=1) - 1.0) < 0.01
        nav_R_body = np.full((len(t), 3, 3), np.nan)
        if seen.any():
            nav_R_body[seen] = Rotation.from_quat(wxyz[seen], scalar_first=True).as_matrix()
        truth = pack_true_path(t, position, nav_R_body)
    return RawRecording(t, acc, gyr, np.arange(1, len(acc) + 1), mag, truth, Provenance(path, "broad"))


# ROS

_SUFFIXES = {b"#ROSBAG V": ".bag", b"\x89MCAP": ".mcap", b"SQLite format 3\0": ".db3"}
_METADATA = "metadata.yaml"
_MENDERS = {".bag": "rosbag reindex", ".mcap": "mcap recover"}

_IMU = ("sensor_msgs/msg/Imu", "sensor_msgs/Imu")
_FIELD = ("sensor_msgs/msg/MagneticField", "sensor_msgs/MagneticField")
_VECTOR = ("geometry_msgs/msg/Vector3Stamped", "geometry_msgs/Vector3Stamped")

_UNITS_UT = {"T": 1e6, "uT": 1.0, "gauss": 100.0, "mG": 0.1, "nT": 1e-3}  # Of drivers; the first is the standard.
_SAME = 1e-6  # A strength that changes by less of itself is that of a normalized field: even at rest there is noise.


def is_bag(content: Content) -> bool:
    """Whether it begins as a bag or a storage of one, or is a folder with a bag's description."""
    if content.members:
        return _METADATA in content.members and any(
            "rosbag2_bagfile_information" in line for line in content.members[_METADATA].lines[:5]
        )
    return _find_suffix(content) is not None


def read_bag(content: Content) -> RawRecording:
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
            streams.append(Stream("mag", field.t, field.values * scale, field.row, magnetic))
    return join_streams(streams, path, "ros", notes)


def _find_suffix(content: Content) -> str | None:
    return next((suffix for magic, suffix in _SUFFIXES.items() if content.head.startswith(magic)), None)


@contextmanager
def _place(content: Content) -> Iterator[Path]:
    """Yield a path that rosbags can open: the bag itself, or a temporary copy, unpacked or renamed."""
    suffix = None if content.members else _find_suffix(content)
    files = content.members or {f"bag{suffix or ''}": content}
    if all(file.opener is None for file in files.values()) and (content.members or content.path.suffix == suffix):
        yield content.path
        return
    with TemporaryDirectory() as folder:
        for name, file in files.items():
            if "/" not in name:
                (Path(folder) / name).write_bytes(file.read_bytes())
        yield Path(folder) if content.members else Path(folder, *files)


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
    median = float(np.median(strength)) if strength.size else 0.0
    if median == 0.0 or np.ptp(strength) <= _SAME * median:
        return 0.0, f"{topic} is normalized (its strength is always {median:.3g}), no field in uT, and was left out"
    unit = next((unit for unit, scale in _UNITS_UT.items() if find_mag_problem(xyz * scale) is None), None)
    if unit is None:
        return 0.0, f"{topic} has a median strength of {median:.3g} T, no field on Earth, and was left out"
    told = "" if unit == "T" else f", in {unit} by its strength and not in T"
    return _UNITS_UT[unit], f"the magnetometer is {topic}{told}"
