"""A recording for the viewer Rerun (`.rrd`), by the extra `rerun`.

It has the foot in motion, the path, footfalls with ellipsoids, and sigmas over time.

The timeline is `utc` where absolute time is known, else `recording`, seconds of the recording's clock. Ellipsoids are
of 95 %.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import chdtri

from fg_nav.arrays import Floats
from fg_nav.frames import quaternion_xyzw
from fg_nav.report.export.track import POSITION, SIGMA, Track

SEMI = float(np.sqrt(chdtri(3, 0.05)))
"""Semi-axes of the 95 % ellipsoid of a normal distribution, in standard deviations."""

BLUE, GRAY = (0, 114, 178), (120, 120, 120, 60)
LINE_M, DOT_M = 0.01, 0.03  # Radii of the line and of the dots: a shoe is 0.1 m wide.


def write(track: Track, path: Path) -> None:
    """Write path and footfalls."""
    import rerun

    recording = rerun.RecordingStream("fg-nav")
    recording.save(path)
    recording.log("walk", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    line = track.position[track.line]
    recording.log("walk/path", rerun.LineStrips3D([line], colors=[BLUE], radii=[LINE_M]), static=True)
    places = track.footfalls[POSITION].to_numpy()
    recording.log("walk/footfalls", rerun.Points3D(places, colors=[BLUE], radii=[DOT_M]), static=True)
    _log_ellipsoids(recording, track, places)
    _log_motion(recording, track)
    recording.flush()
    recording.disconnect()


def _log_ellipsoids(recording: Any, track: Track, places: Floats) -> None:
    """Log the ellipsoids of the footfalls: half axes and their attitude are those of the covariance."""
    import rerun

    claimed = np.isfinite(track.cov).all(axis=(1, 2))
    variance, axes = np.linalg.eigh(track.cov[claimed])
    axes[:, :, 2] *= np.sign(np.linalg.det(axes))[:, None]
    half = SEMI * np.sqrt(np.maximum(variance, 0.0))
    shapes = rerun.Ellipsoids3D(
        half_sizes=half, centers=places[claimed], quaternions=quaternion_xyzw(axes), colors=[GRAY]
    )
    recording.log("walk/ellipsoids", shapes, static=True)


def _log_motion(recording: Any, track: Track) -> None:
    import rerun

    moving = rerun.Transform3D.columns(translation=track.position, quaternion=quaternion_xyzw(track.nav_R_body))
    recording.send_columns("walk/foot", indexes=[_timeline(track, track.t)], columns=moving)
    at = _timeline(track, track.footfalls["time_s"].to_numpy())
    for name in (*SIGMA, "sigma_heading_deg"):
        values = rerun.Scalars.columns(scalars=track.footfalls[name].to_numpy())
        recording.send_columns(f"sigma/{name}", indexes=[at], columns=values)


def _timeline(track: Track, t: Floats) -> Any:
    import rerun

    if track.epoch_s is None:
        return rerun.TimeColumn("recording", duration=t)
    return rerun.TimeColumn("utc", timestamp=t + track.epoch_s)
