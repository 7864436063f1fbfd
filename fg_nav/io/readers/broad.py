"""BROAD trials (Laidig et al., Data 6(7), 2021): MATLAB files with optical orientation and position.

=================================== ======== ======================================================
`imu_acc`, `imu_gyr`, `imu_mag`     (N, 3)   m/s^2, rad/s, uT (the magnetometer repeats held samples)
`opt_quat`                          (N, 4)   w, x, y, z: sensor to East-North-Up; NaN where unseen
`opt_pos`                           (N, 3)   m; NaN where unseen
`sampling_rate`                     scalar   Hz: the samples are even
=================================== ======== ======================================================
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import FormatError
from fg_nav.io.content import Content, Variables, load_mat, mat_array
from fg_nav.io.text_columns import drop_held
from fg_nav.io.truth import pack_true_path
from fg_nav.recording import Provenance, RawRecording
from fg_nav.truth import TrajectoryTruth


def recognizes(content: Content) -> bool:
    """Whether the file holds `imu_acc` or `imu_gyr`."""
    return not {"imu_acc", "imu_gyr"}.isdisjoint(content.variables)


def read(content: Content) -> RawRecording:
    """Read a BROAD trial.

    Raises `FormatError` if a variable is missing, damaged, or does not fit the others.
    """
    path = content.path
    variables = load_mat(content)
    rate = mat_array(variables, "sampling_rate", path)
    if rate.size != 1 or not 1.0 <= rate[0] <= 1e5:
        raise FormatError(f"{path.name}: 'sampling_rate' is no usable rate in Hz: export it again.")
    acc = mat_array(variables, "imu_acc", path, columns=3)
    gyr = _fitting(variables, "imu_gyr", len(acc), path)
    mag = _fitting(variables, "imu_mag", len(acc), path) if "imu_mag" in variables else None
    t = np.arange(len(acc)) / rate[0]
    return RawRecording(
        t=t,
        acc=acc,
        gyr=gyr,
        mag=None if mag is None or not len(mag) else drop_held(mag, gyr),
        row=np.arange(1, len(acc) + 1),
        truth=_truth(variables, t, path),
        provenance=Provenance(path=path, format="broad"),
    )


def _fitting(variables: Variables, name: str, length: int, path: Path, columns: int = 3) -> Floats:
    values = mat_array(variables, name, path, columns=columns)
    if len(values) != length:
        raise FormatError(f"{path.name}: '{name}' has {len(values)} rows, 'imu_acc' {length}: export it again.")
    return values


def _truth(variables: Variables, t: Floats, path: Path) -> TrajectoryTruth | None:
    if not {"opt_quat", "opt_pos"} <= variables.keys():
        return None
    wxyz = _fitting(variables, "opt_quat", len(t), path, columns=4)
    position = _fitting(variables, "opt_pos", len(t), path)
    from scipy.spatial.transform import Rotation  # slow to load

    norm = np.linalg.norm(wxyz, axis=1)
    seen = np.abs(norm - 1.0) < 0.01
    nav_R_body = np.full((len(t), 3, 3), np.nan)
    if seen.any():
        nav_R_body[seen] = Rotation.from_quat(wxyz[seen], scalar_first=True).as_matrix()
    return pack_true_path(t, position, nav_R_body)
