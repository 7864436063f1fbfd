"""Published sets of walks in MATLAB files, each with its truth.

PyShoe (Wagstaff et al., University of Toronto), processed trials of a LORD 3DM-GX5-25:

=========== ======== ================================================================================
`imu`       (N, 6)   acc m/s^2, gyr rad/s
`ts`        (N,)     s
`gt`        (N, 3)   m, foot position by motion capture, **left-handed**: y is negated here
`gt_idx`    (M,)     where present, `gt` is (M, 3): surveyed points passed at these samples (from 0)
`zv_*_opt`  (N,)     1 where the authors' detector of that name, at its best threshold, sees the foot stand
=========== ======== ================================================================================

gdlbio, walks of a LORD 3DM-GX5-25 on a shoe over surveyed footprints, one a stride; they are matched in time:

=================== ======== ============================================================================
`imu_data`          (N, 6)   acc m/s^2, gyr rad/s
`timestamps`        (N,)     s
`strideIndex`       (M,)     sample (from 0) in each stance of the shoe; the first is the start of the walk
`GCP`               (M, 2)   m, footprint of each of them, **left-handed** seen from above: y is negated here
`pyshoeTrajectory`  (N, 2)   m, path by PyShoe as the authors of the set ran it, left-handed as well
=================== ======== ============================================================================

BROAD (Laidig et al., Data 6(7), 2021), trials with optical orientation and position:

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

from fg_nav.arrays import Bools, Floats
from fg_nav.errors import FormatError
from fg_nav.io.content import Content, read_content
from fg_nav.io.matlab import Variables, mat_array
from fg_nav.io.streams import drop_held
from fg_nav.io.truth import pack_footprints, pack_true_path
from fg_nav.recording import Provenance, RawRecording
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
    truth: Truth | None = None
    gt = variables.get("gt")
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


def read_pyshoe_labels(path: Path | str, detector: str = "shoe") -> Bools:
    """(N,) True where a reference detector of a PyShoe trial sees the foot stand.

    `detector` is `shoe`, `ared`, `amvd`, `mbgtd` or `vicon`, whose `zv_<detector>_opt` is read.

    Raises `FormatError` if the file is no MATLAB file or does not hold these labels.
    """
    path = Path(path)
    return mat_array(read_content(path).load_variables(), f"zv_{detector}_opt", path) > 0.5


def read_gdlbio(content: Content) -> RawRecording:
    """Read a surveyed walk."""
    path, variables = content.path, content.load_variables()
    inertial = mat_array(variables, "imu_data", path, columns=6)
    t = _take(variables, "timestamps", path, None, "imu_data", len(inertial))
    truth: Truth | None = None
    if {"strideIndex", "GCP"} <= variables.keys():
        sample = mat_array(variables, "strideIndex", path)
        whole = ((sample >= 0) & (sample < len(t)) & (sample == np.round(sample))).all()
        if not whole or (np.diff(sample) <= 0).any():
            raise FormatError(f"{path.name}: 'strideIndex' must be rising samples of the recording: export it again.")
        xy = _take(variables, "GCP", path, 2, "strideIndex", len(sample)) * _RIGHT_HANDED[:2]
        stride = np.arange(len(xy), dtype=np.float64)
        truth = pack_footprints(stride, xy, len(xy) - 1, path, t[sample.astype(np.int64)])
    return _pack(t, inertial, truth, path, "gdlbio")


def read_pyshoe_track(path: Path | str) -> Floats:
    """Path (N, 2) m, right-handed, that the authors of gdlbio had from PyShoe, at every sample of the file.

    Raises `FormatError` if the file is no MATLAB file or does not hold it.
    """
    path = Path(path)
    track = mat_array(read_content(path).load_variables(), "pyshoeTrajectory", path, columns=2)
    return np.asarray(track * _RIGHT_HANDED[:2])


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
