"""PyShoe's processed trials (Wagstaff et al., University of Toronto): MATLAB files of a LORD 3DM-GX5-25.

=========== ======== ================================================================================
`imu`       (N, 6)   acc m/s^2, gyr rad/s
`ts`        (N,)     s
`gt`        (N, 3)   m, foot position by motion capture, **left-handed**: y is negated here
`gt_idx`    (M,)     where present, `gt` is (M, 3): surveyed points passed at these samples (from 0)
`zv_*_opt`  (N,)     1 where the authors' detector of that name, at its best threshold, sees the foot stand
=========== ======== ================================================================================
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.errors import FormatError
from fg_nav.io.content import Content, Variables, load_mat, mat_array, mat_samples, read_content
from fg_nav.io.truth import pack_true_path
from fg_nav.recording import Provenance, RawRecording
from fg_nav.truth import TrajectoryTruth

_RIGHT_HANDED = np.array([1.0, -1.0, 1.0])


def recognizes(content: Content) -> bool:
    """Whether the file holds a variable `imu`, or the time stamps or labels that go with it."""
    return "imu" in content.variables or "zv_shoe_opt" in content.variables


def read(content: Content) -> RawRecording:
    """Read a PyShoe trial.

    Raises `FormatError` if `imu` or `ts` is missing, damaged, or does not fit the other.
    """
    path = content.path
    variables = load_mat(content)
    t, acc, gyr = mat_samples(variables, "imu", "ts", path)
    return RawRecording(
        t=t,
        acc=acc,
        gyr=gyr,
        row=np.arange(1, len(t) + 1),
        truth=_truth(variables, t, path),
        provenance=Provenance(path=path, format="pyshoe"),
    )


def read_pyshoe_labels(path: Path | str, detector: str = "shoe") -> Bools:
    """(N,) True where a reference detector of a PyShoe trial sees the foot stand.

    `detector` is `shoe`, `ared`, `amvd`, `mbgtd` or `vicon`, whose `zv_<detector>_opt` is read.

    Raises `FormatError` if the file is no MATLAB file or does not hold these labels.
    """
    path = Path(path)
    labels = mat_array(load_mat(read_content(path)), f"zv_{detector}_opt", path)
    return labels > 0.5


def _truth(variables: Variables, t: Floats, path: Path) -> TrajectoryTruth | None:
    gt = variables.get("gt")
    if not isinstance(gt, np.ndarray) or gt.ndim != 2 or gt.shape[1] != 3:  # the stair trials give one height a landing
        return None
    position = mat_array(variables, "gt", path, columns=3) * _RIGHT_HANDED
    sample = np.arange(len(t)) if "gt_idx" not in variables else _read_indices(variables, len(t), path)
    if len(sample) != len(position):
        raise FormatError(f"{path.name} has {len(position)} true positions for {len(sample)} samples: export it again.")
    return pack_true_path(t[sample], position)


def _read_indices(variables: Variables, n_samples: int, path: Path) -> Ints:
    index = mat_array(variables, "gt_idx", path)
    if not ((index >= 0) & (index < n_samples)).all():
        raise FormatError(f"{path.name}: 'gt_idx' points outside of the recording: export it again.")
    return index.astype(np.int64)
