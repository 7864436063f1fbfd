"""MATLAB (version 5): structures `path` and `footfalls`, and `about` with what they mean.

Arrays stand as MATLAB has them: a row a sample; matrices 3 x 3 in pages: `footfalls.position_cov_m2(:, :, k)` is the
covariance of footfall k. Quaternions are w, x, y, z, as MATLAB's `quaternion`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.io import savemat

from fg_nav.arrays import Floats
from fg_nav.frames import quaternion_xyzw
from fg_nav.report.export.track import FRAME, POSITION, Track
from fg_nav.text import find_version

UNITS = "s, m, m/s, deg, deg/s, m^2, as the names of the fields end; time_s is the recording's own clock"


def write(track: Track, path: Path) -> None:
    """Write path and footfalls."""
    content = {"path": _describe_path(track), "footfalls": _describe_footfalls(track), "about": _describe_all(track)}
    savemat(path, content, do_compression=True, oned_as="column", long_field_names=True)


def _describe_path(track: Track) -> dict[str, object]:
    return {
        "time_s": track.t,
        "position_m": track.position,
        "velocity_m_s": track.velocity,
        "quaternion_wxyz": np.roll(quaternion_xyzw(track.nav_R_body), 1, axis=1),
    }


def _describe_footfalls(track: Track) -> dict[str, object]:
    table = track.footfalls
    return {
        "time_s": table["time_s"].to_numpy(),
        "position_m": table[POSITION].to_numpy(),
        "position_cov_m2": _to_pages(track.cov),
        "heading_deg": table["heading_deg"].to_numpy(),
        "sigma_heading_deg": table["sigma_heading_deg"].to_numpy(),
        "gyro_bias_deg_s": table[[f"gyro_bias_{axis}_deg_s" for axis in "xyz"]].to_numpy(),
        "field": table["field"].to_numpy(dtype=object),
        "field_reason": table["field_reason"].to_numpy(dtype=object),
    }


def _describe_all(track: Track) -> dict[str, object]:
    times = track.tell_time(track.t[:1])
    return {
        "name": track.name,
        "method": track.method,
        "frame": FRAME,
        "units": UNITS,
        "start_utc": "not known" if times is None else times[0],
        "made_by": f"fg-nav {find_version()}",
    }


def _to_pages(matrices: Floats) -> Floats:
    return np.moveaxis(matrices, 0, -1)
