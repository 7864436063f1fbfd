"""Paths for other programs: TUM, MATLAB (version 5), Parquet, ROS 2 and Rerun (docs/export.md).

In the bag of ROS 2 poses are in `odom` (East-North-Up from the start), twists in `foot`: linear R^T v, angular unknown.
The covariance of a pose is of position, and about z of the heading, 0 between the two, `UNKNOWN` for roll and pitch;
linear between footfalls. Stamps are UTC where it is known, else the recording's clock, from 0 where it began before.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import chdtri

from fg_nav import io
from fg_nav.arrays import Floats, Ints, interpolate_columns
from fg_nav.errors import OutputError
from fg_nav.frames import quaternion_xyzw
from fg_nav.report.export.track import FRAME, POSITION, SIGMA, ExportTrack
from fg_nav.text import find_version

UNITS = "s, m, m/s, deg, deg/s, m^2, as the names of the fields end; time_s is the recording's own clock"
ODOMETRY, PATH = "/fg_nav/odometry", "/fg_nav/path"
ODOM, FOOT = "odom", "foot"

UNKNOWN = 1e6  # Variance of an unknown quantity: far beyond that of any foot.
_LAST_S = 2.0**31  # Stamps of ROS are 32-bit seconds.
SEMI = float(np.sqrt(chdtri(3, 0.05)))  # Semi-axes of the 95 % ellipsoid of a normal distribution, sigmas.
BLUE, GRAY = (0, 114, 178), (120, 120, 120, 60)
LINE_M, DOT_M = 0.01, 0.03  # Radii of the line and of the dots: a shoe is 0.1 m wide.


def write_tum(track: ExportTrack, path: Path) -> None:
    """Write the path as TUM lines."""
    io.write_tum(path, track.t, track.position, track.nav_R_body)


def write_matlab(track: ExportTrack, path: Path) -> None:
    """Write path and footfalls for MATLAB."""
    from scipy.io import savemat

    table, times = track.footfalls, track.format_utc(track.t[:1])
    content = {
        "path": {
            "time_s": track.t,
            "position_m": track.position,
            "velocity_m_s": track.velocity,
            "quaternion_wxyz": np.roll(quaternion_xyzw(track.nav_R_body), 1, axis=1),
        },
        "footfalls": {
            "time_s": table["time_s"].to_numpy(),
            "position_m": table[POSITION].to_numpy(),
            "position_cov_m2": np.moveaxis(track.cov, 0, -1),
            "heading_deg": table["heading_deg"].to_numpy(),
            "sigma_heading_deg": table["sigma_heading_deg"].to_numpy(),
            "gyro_bias_deg_s": table[[f"gyro_bias_{axis}_deg_s" for axis in "xyz"]].to_numpy(),
            "field": table["field"].to_numpy(dtype=object),
            "field_reason": table["field_reason"].to_numpy(dtype=object),
        },
        "about": {
            "name": track.name,
            "method": track.method,
            "frame": FRAME,
            "units": UNITS,
            "start_utc": "not known" if times is None else times[0],
            "made_by": f"fg-nav {find_version()}",
        },
    }
    savemat(path, content, do_compression=True, oned_as="column", long_field_names=True)


def write_parquet(track: ExportTrack, path: Path, footfalls: Path) -> None:
    """Write the path, and the footfalls into a second file."""
    for table, file in ((track.tabulate(), path), (track.footfalls.copy(), footfalls)):
        if track.epoch_s is not None:
            instants = pd.to_datetime((table["time_s"] + track.epoch_s) * 1e6, unit="us", utc=True)
            table.insert(1, "time_utc", instants.dt.as_unit("us"))
        table.attrs = {"name": track.name, "method": track.method, "frame": FRAME}
        table.to_parquet(file, engine="pyarrow", index=False)


def write_ros(track: ExportTrack, path: Path) -> None:
    """Write path and odometry as a bag of ROS 2."""
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    stamps, store = _find_stamps(track, track.t), get_typestore(Stores.ROS2_HUMBLE)
    # path: the poses of the footfalls
    t, places, types = track.footfalls["time_s"].to_numpy(), track.footfalls[POSITION].to_numpy(), store.types
    rows = np.searchsorted(track.t, t).clip(max=len(track.t) - 1)
    at, quaternion = _find_stamps(track, t).tolist(), quaternion_xyzw(track.nav_R_body[rows])
    stamped = types["geometry_msgs/msg/PoseStamped"]
    poses = [
        stamped(_make_header(stamp, types), _make_pose(places[k], quaternion[k], types)) for k, stamp in enumerate(at)
    ]
    line = types["nav_msgs/msg/Path"](_make_header(at[-1], types), poses)
    # both topics, into the one file of a bag
    with TemporaryDirectory(dir=path.parent) as folder:
        place = Path(folder) / path.stem
        writer = Writer(place, version=9, storage_plugin=StoragePlugin.MCAP)
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        with writer:
            for topic, kind, messages in (
                (ODOMETRY, "nav_msgs/msg/Odometry", _make_odometry(track, stamps, types)),
                (PATH, "nav_msgs/msg/Path", iter([(int(stamps[-1]), line)])),
            ):
                connection = writer.add_connection(topic, kind, typestore=store)
                for stamp, message in messages:
                    writer.write(connection, stamp, store.serialize_cdr(message, kind))
        next(place.glob("*.mcap")).replace(path)


def _find_stamps(track: ExportTrack, t: Floats) -> Ints:
    """Stamps (M,) ns of ROS; raises `OutputError` if they are beyond its range."""
    shift = -min(float(track.t[0]), 0.0) if track.epoch_s is None else track.epoch_s
    if not 0.0 <= track.t[0] + shift <= track.t[-1] + shift < _LAST_S:
        raise OutputError(f"stamps of {track.t[0]:.0f} s are beyond those of ROS: say when the walk began, --start.")
    return np.round((t + shift) * 1e9).astype(np.int64)


def _make_odometry(track: ExportTrack, stamps: Ints, types: Any) -> Iterator[tuple[int, Any]]:
    quaternion = quaternion_xyzw(track.nav_R_body)
    body_velocity = np.einsum("nji,nj->ni", track.nav_R_body, track.velocity)
    # covariances of x, y, z, roll, pitch, yaw, linear between footfalls
    known = np.zeros((len(track.cov), 6, 6))
    finite = np.isfinite(track.cov).all(axis=(1, 2), keepdims=True)
    known[:, :3, :3] = np.where(finite, track.cov, UNKNOWN * np.eye(3))
    heading = np.deg2rad(track.footfalls["sigma_heading_deg"].to_numpy()) ** 2
    known[:, 5, 5] = np.where(np.isfinite(heading), heading, UNKNOWN)
    known[:, [3, 4], [3, 4]] = UNKNOWN
    covariance = interpolate_columns(track.t, track.footfalls["time_s"].to_numpy(), known.reshape(-1, 36))

    still = types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
    unknown = np.diag(np.full(6, UNKNOWN)).ravel()
    for k, stamp in enumerate(stamps.tolist()):
        pose = _make_pose(track.position[k], quaternion[k], types)
        moving = types["geometry_msgs/msg/Vector3"](*body_velocity[k].tolist())
        twist = types["geometry_msgs/msg/Twist"](moving, still)
        yield (
            stamp,
            types["nav_msgs/msg/Odometry"](
                _make_header(stamp, types),
                FOOT,
                types["geometry_msgs/msg/PoseWithCovariance"](pose, covariance[k]),
                types["geometry_msgs/msg/TwistWithCovariance"](twist, unknown),
            ),
        )


def _make_header(stamp_ns: int, types: Any) -> Any:
    time = types["builtin_interfaces/msg/Time"](stamp_ns // 10**9, stamp_ns % 10**9)
    return types["std_msgs/msg/Header"](time, ODOM)


def _make_pose(position: Floats, quaternion: Floats, types: Any) -> Any:
    point = types["geometry_msgs/msg/Point"](*position.tolist())
    return types["geometry_msgs/msg/Pose"](point, types["geometry_msgs/msg/Quaternion"](*quaternion.tolist()))


def write_rerun(track: ExportTrack, path: Path) -> None:
    """Write path and footfalls as a recording of Rerun."""
    import rerun

    def timeline(t: Floats) -> Any:
        if track.epoch_s is None:
            return rerun.TimeColumn("recording", duration=t)
        return rerun.TimeColumn("utc", timestamp=t + track.epoch_s)

    recording = rerun.RecordingStream("fg-nav")
    recording.save(path)
    recording.log("walk", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    line = track.position[track.line]
    recording.log("walk/path", rerun.LineStrips3D([line], colors=[BLUE], radii=[LINE_M]), static=True)
    places = track.footfalls[POSITION].to_numpy()
    recording.log("walk/footfalls", rerun.Points3D(places, colors=[BLUE], radii=[DOT_M]), static=True)
    # ellipsoids
    claimed = np.isfinite(track.cov).all(axis=(1, 2))
    variance, axes = np.linalg.eigh(track.cov[claimed])
    axes[:, :, 2] *= np.sign(np.linalg.det(axes))[:, None]
    half = SEMI * np.sqrt(np.maximum(variance, 0.0))
    shapes = rerun.Ellipsoids3D(
        half_sizes=half, centers=places[claimed], quaternions=quaternion_xyzw(axes), colors=[GRAY]
    )
    recording.log("walk/ellipsoids", shapes, static=True)
    # motion and sigmas
    moving = rerun.Transform3D.columns(translation=track.position, quaternion=quaternion_xyzw(track.nav_R_body))
    recording.send_columns("walk/foot", indexes=[timeline(track.t)], columns=moving)
    at = timeline(track.footfalls["time_s"].to_numpy())
    for name in (*SIGMA, "sigma_heading_deg"):
        values = rerun.Scalars.columns(scalars=track.footfalls[name].to_numpy())
        recording.send_columns(f"sigma/{name}", indexes=[at], columns=values)
    recording.flush()
    recording.disconnect()
