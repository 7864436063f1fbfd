"""A ROS 2 bag in one file (`.mcap`), by the extra `ros`: `nav_msgs/Odometry` and `nav_msgs/Path`.

====================== ======================================================================================
/fg_nav/odometry       one message a sample; pose in `odom` (East-North-Up from the start), twist in `foot`
/fg_nav/path           one message at the end: the poses of the footfalls
`pose.covariance`      of position, and about z of the heading; between two footfalls on the straight line between
                       theirs; what no method tells (roll, pitch, the turn with the place) is `UNKNOWN` or 0
`twist`                linear: R^T v; angular is not told
stamps                 UTC where it is known, else the recording's clock, moved to begin at 0 where it began before
====================== ======================================================================================
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import OutputError
from fg_nav.frames import quaternion_xyzw
from fg_nav.report.export.track import Track

ODOMETRY, PATH = "/fg_nav/odometry", "/fg_nav/path"
FRAME, CHILD = "odom", "foot"

UNKNOWN = 1e6  # A variance of what is not told: far beyond that of any foot.
_LAST_S = 2.0**31  # Stamps of ROS are 32-bit seconds.


def write(track: Track, path: Path) -> None:
    """Write path and odometry."""
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    stamps = _find_stamps(track, track.t)
    store = get_typestore(Stores.ROS2_HUMBLE)
    with TemporaryDirectory(dir=path.parent) as folder:
        place = Path(folder) / path.stem
        writer = Writer(place, version=9, storage_plugin=StoragePlugin.MCAP)
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        with writer:
            _write_topic(writer, store, ODOMETRY, "nav_msgs/msg/Odometry", _odometry(track, stamps, store.types))
            _write_topic(writer, store, PATH, "nav_msgs/msg/Path", [(int(stamps[-1]), _path(track, store.types))])
        next(place.glob("*.mcap")).replace(path)


def _write_topic(writer: Any, store: Any, topic: str, kind: str, messages: Iterable[tuple[int, Any]]) -> None:
    connection = writer.add_connection(topic, kind, typestore=store)
    for stamp, message in messages:
        writer.write(connection, stamp, store.serialize_cdr(message, kind))


def _find_stamps(track: Track, t: Floats) -> Ints:
    """Stamps (M,) ns as ROS has them; raises `OutputError` if they are beyond its range."""
    shift = -min(float(track.t[0]), 0.0) if track.epoch_s is None else track.epoch_s
    if not 0.0 <= track.t[0] + shift <= track.t[-1] + shift < _LAST_S:
        raise OutputError(f"stamps of {track.t[0]:.0f} s are beyond those of ROS: say when the walk began, --start.")
    return np.round((t + shift) * 1e9).astype(np.int64)


def _interpolate_covariance(track: Track) -> Floats:
    """(N, 36) covariances of x, y, z, roll, pitch, yaw at the samples: straight lines between those of footfalls."""
    known = np.zeros((len(track.cov), 6, 6))
    told = np.isfinite(track.cov).all(axis=(1, 2), keepdims=True)
    known[:, :3, :3] = np.where(told, track.cov, UNKNOWN * np.eye(3))
    heading = np.deg2rad(track.footfalls["sigma_heading_deg"].to_numpy()) ** 2
    known[:, 5, 5] = np.where(np.isfinite(heading), heading, UNKNOWN)
    known[:, [3, 4], [3, 4]] = UNKNOWN
    at = track.footfalls["time_s"].to_numpy()
    return np.stack([np.interp(track.t, at, column) for column in known.reshape(-1, 36).T], axis=1)


def _odometry(track: Track, stamps: Ints, types: Any) -> Iterator[tuple[int, Any]]:
    quaternion = quaternion_xyzw(track.nav_R_body)
    body_velocity = np.einsum("nji,nj->ni", track.nav_R_body, track.velocity)
    covariance = _interpolate_covariance(track)
    still = types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
    told = np.diag(np.full(6, UNKNOWN)).ravel()
    for k, stamp in enumerate(stamps.tolist()):
        pose = types["geometry_msgs/msg/PoseWithCovariance"](
            _pose(track.position[k], quaternion[k], types), covariance[k]
        )
        moving = types["geometry_msgs/msg/Vector3"](*body_velocity[k].tolist())
        twist = types["geometry_msgs/msg/TwistWithCovariance"](types["geometry_msgs/msg/Twist"](moving, still), told)
        message = types["nav_msgs/msg/Odometry"](_header(stamp, types), CHILD, pose, twist)
        yield stamp, message


def _path(track: Track, types: Any) -> Any:
    stamps = _find_stamps(track, track.footfalls["time_s"].to_numpy())
    rows = np.searchsorted(track.t, track.footfalls["time_s"].to_numpy()).clip(max=len(track.t) - 1)
    quaternion = quaternion_xyzw(track.nav_R_body[rows])
    places = track.footfalls[["x_m", "y_m", "z_m"]].to_numpy()
    poses = [
        types["geometry_msgs/msg/PoseStamped"](_header(stamp, types), _pose(places[k], quaternion[k], types))
        for k, stamp in enumerate(stamps.tolist())
    ]
    return types["nav_msgs/msg/Path"](_header(stamps.tolist()[-1], types), poses)


def _header(stamp_ns: int, types: Any) -> Any:
    time = types["builtin_interfaces/msg/Time"](stamp_ns // 10**9, stamp_ns % 10**9)
    return types["std_msgs/msg/Header"](time, FRAME)


def _pose(position: Floats, quaternion: Floats, types: Any) -> Any:
    point = types["geometry_msgs/msg/Point"](*position.tolist())
    return types["geometry_msgs/msg/Pose"](point, types["geometry_msgs/msg/Quaternion"](*quaternion.tolist()))
