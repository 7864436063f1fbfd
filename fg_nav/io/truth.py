"""Truth from files of its own: true paths (TUM, C3D) and surveyed footprints.

A TUM line is `t x y z qx qy qz qw`: s, m, and the quaternion of nav_R_body; z is up. Lines that begin with `#` at the
head of the file are comments. Footprints are MATLAB files with `GCP_meters`, or CSV files `stride,x_m,y_m`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import FormatError
from fg_nav.io.content import Content, choose_sensor, explain_library
from fg_nav.io.matlab import mat_array
from fg_nav.io.tables import TextTable
from fg_nav.truth import FootprintTruth, TrajectoryTruth

TUM_COLUMNS = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")
CSV_COLUMNS = ("stride", "x_m", "y_m")
C3D_KEY = b"\x50"  # Second byte of a C3D file.


def read_tum(content: Content) -> TrajectoryTruth:
    """Read TUM lines.

    Raises `FormatError` if a line has not 8 numbers, the stamps do not rise, or a quaternion is not of unit length.
    """
    path = content.path
    comments = next((k for k, line in enumerate(content.lines) if not line.startswith("#")), 0)
    fields = content.lines[comments].split() if content.lines else []
    if len(fields) != len(TUM_COLUMNS):
        raise FormatError(
            f"{path.name} is no truth read here: give TUM lines (t x y z qx qy qz qw), "
            f"a CSV with stride,x_m,y_m, or a MATLAB file of footprints."
        )
    table, row = TextTable(content, TUM_COLUMNS, comments + 1, r"\s+").read_numbers(range(8))
    unit = np.zeros(len(table), dtype=np.bool_)
    small = (np.abs(table[:, 4:]) < 1.1).all(axis=1)  # and finite, so that it may be squared
    unit[small] = np.abs(np.linalg.norm(table[small, 4:], axis=1) - 1.0) < 0.01
    rising = np.concatenate(([True], table[1:, 0] > table[:-1, 0]))
    wrong = ~(np.isfinite(table).all(axis=1) & unit & rising)
    if wrong.any():
        raise FormatError(
            f"{path.name}, line {row[np.argmax(wrong)]}: stamps must rise and quaternions have length 1; "
            f"correct or delete that line."
        )
    from scipy.spatial.transform import Rotation  # slow to load, and few walks have a truth

    return TrajectoryTruth(table[:, 0], table[:, 1:4], Rotation.from_quat(table[:, 4:]).as_matrix())


def read_c3d(content: Content, marker: str | None = None) -> TrajectoryTruth:
    """Read the path of a marker of a C3D file (needs ezc3d), from 0 s at its first frame on; z is up.

    Raises `FormatError` if the file is damaged, the library absent, or it is not said which of several markers to take.
    """
    path = content.path
    with explain_library(path.name, "a C3D file", "ezc3d", "c3d"):
        import ezc3d

        file = ezc3d.c3d(str(path))
        point, frames = file["parameters"]["POINT"], np.asarray(file["data"]["points"], dtype=np.float64)
        names, rate_hz = list(point["LABELS"]["value"]), float(point["RATE"]["value"][0])
        scale = 1.0 if point["UNITS"]["value"][:1] == ["m"] else 1e-3
    chosen = choose_sensor(names, marker, path, "markers", f"`--truth {path.name}:")
    position = scale * frames[:3, names.index(chosen)].T
    truth = pack_true_path(np.arange(len(position)) / rate_hz, position)
    if truth is None:
        raise FormatError(f"{path.name} has no frame with marker '{chosen}': name another behind the colon.")
    return truth


def read_footprint_mat(content: Content) -> FootprintTruth:
    """Footprints from `GCP_meters` (M, 2), `GCP_stride_numbers` (M,) and, where there, `numberOfStrides`.

    Raises `FormatError` if a variable is missing, damaged, or does not fit the other.
    """
    path, variables = content.path, content.load_variables()
    xy = mat_array(variables, "GCP_meters", path, columns=2)
    stride = mat_array(variables, "GCP_stride_numbers", path)
    if len(stride) != len(xy):
        raise FormatError(f"{path.name} has {len(xy)} footprints but {len(stride)} stride numbers: export it again.")
    count = mat_array(variables, "numberOfStrides", path) if "numberOfStrides" in variables else np.empty(0)
    return pack_footprints(stride, xy, int(count[0]) if count.size and np.isfinite(count[0]) else None, path)


def pack_footprints(
    stride: Floats, xy: Floats, stride_count: int | None, path: Path, t: Floats | None = None
) -> FootprintTruth:
    """Check and pack footprints `xy` (M, 2) m with stride numbers `stride` (M,) and, where known, times `t` (M,) s.

    Raises `FormatError` if a number is not finite, or the strides are not whole, rising numbers.
    """
    if not all(np.isfinite(part).all() for part in (stride, xy, *([] if t is None else [t]))):
        raise FormatError(f"{path.name} has a footprint that is not finite: correct or delete it.")
    whole = (stride >= 0).all() and (stride == np.round(stride)).all() and (stride < 2**31).all()
    if not whole or (np.diff(stride) <= 0).any():
        raise FormatError(f"{path.name}: stride numbers must be whole and rising, 0 at the start: correct them.")
    return FootprintTruth(stride=stride.astype(np.int64), xy=xy, stride_count=stride_count, t=t)


def pack_true_path(t: Floats, position: Floats, nav_R_body: Floats | None = None) -> TrajectoryTruth | None:
    """Pack a true path: `t` (M,) s, `position` (M, 3) m, `nav_R_body` (M, 3, 3), NaN where the reference saw nothing.

    Rows that are not finite or not later are left out; None if not two rows are usable.
    """
    seen = np.isfinite(t) & np.isfinite(position).all(axis=1)
    if nav_R_body is not None:
        seen &= np.isfinite(nav_R_body).all(axis=(1, 2))
    before = np.concatenate(([-np.inf], np.maximum.accumulate(np.where(seen, t, -np.inf))[:-1]))
    seen &= t > before
    if np.count_nonzero(seen) < 2:
        return None
    return TrajectoryTruth(t[seen], position[seen], None if nav_R_body is None else nav_R_body[seen])
