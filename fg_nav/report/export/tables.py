"""Tables of a path and its footfalls: TUM, MATLAB (version 5) and Parquet.

======= ===============================================================================================================
TUM     lines `t x y z qx qy qz qw`, for evo and its kin
MATLAB  structures `path`, `footfalls` and `about`. A row a sample; matrices 3 x 3 in pages:
        `footfalls.position_cov_m2(:, :, k)` is the covariance of footfall k. Quaternions are w, x, y, z, as MATLAB's
Parquet a table of the path, a row a sample, and a second file of the footfalls, with the columns of `strides.csv`, and
        `time_utc` where it is known; the meaning of the columns in the attributes of the tables (`DataFrame.attrs`)
======= ===============================================================================================================
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from fg_nav import io
from fg_nav.frames import quaternion_xyzw
from fg_nav.report.export.track import FRAME, POSITION, ExportTrack
from fg_nav.text import find_version

UNITS = "s, m, m/s, deg, deg/s, m^2, as the names of the fields end; time_s is the recording's own clock"


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
