"""Positions from files of their own: true paths, surveyed footprints, and fixes.

A TUM line is `t x y z qx qy qz qw`: s, m, and the quaternion of nav_R_body; z is up. Lines that begin with
`#` at the head of the file are comments.

Footprints are MATLAB files with `GCP_meters`, or CSV files `stride,x_m,y_m`. The MATLAB files give stride numbers as
uint8, which wraps in sums and differences; here they are int64.

Fixes of the position, surveyed points or a receiver's, are CSV files `time_s,x_m,y_m,z_m,sigma_m`. Time is that of the
recording as read; x is east, y north, z up from where the walk starts; an empty z is not known. The sigma is that of
each axis that is given.
"""

from __future__ import annotations

from itertools import chain
from pathlib import Path

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import FormatError
from fg_nav.frames import quaternion_xyzw
from fg_nav.io.choice import choose_sensor
from fg_nav.io.content import Content, explain_missing, load_mat, mat_array, read_content
from fg_nav.io.readers.canonical import format_rows, write_text
from fg_nav.io.text_columns import find_column, read_table
from fg_nav.system.spilled import drop_pages
from fg_nav.truth import Fix, FootprintTruth, TrajectoryTruth

TUM_COLUMNS = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")


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
    table, row = read_table(content, TUM_COLUMNS, range(8), first_line=comments + 1, separator=r"\s+")
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


def write_tum(path: Path | str, t: Floats, position: Floats, nav_R_body: Floats) -> None:
    """Write a trajectory as TUM lines `t x y z qx qy qz qw`, to the nanosecond and nanometer.

    `t` (N,) s, `position` (N, 3) m, `nav_R_body` (N, 3, 3).

    Raises `OutputError` if the file cannot be written.
    """
    blocks = (np.s_[start : start + _BLOCK_ROWS] for start in range(0, len(t), _BLOCK_ROWS))
    tables = (_tabulate(t[b], position[b], nav_R_body[b]) for b in blocks)
    write_text(Path(path), "", chain.from_iterable(format_rows(table, "%.9f", " ") for table in tables))


def _tabulate(t: Floats, position: Floats, nav_R_body: Floats) -> Floats:
    """Return the numbers of some lines."""
    table = np.column_stack([t, position, quaternion_xyzw(nav_R_body)])
    drop_pages()
    return table


_BLOCK_ROWS = 20_000  # Of which the quaternions are in memory together.


C3D_KEY = b"\x50"  # Second byte of a C3D file.


def read_c3d(content: Content, marker: str | None = None) -> TrajectoryTruth:
    """Read the path of a marker of a C3D file (needs ezc3d), from 0 s at its first frame on; z is up.

    Raises `FormatError` if the file is damaged, the library absent, or it is not said which of several markers to take.
    """
    path = content.path
    with explain_missing(path.name, "a C3D file", "ezc3d", "c3d"):
        import ezc3d
    try:
        file = ezc3d.c3d(str(path))
        point, frames = file["parameters"]["POINT"], np.asarray(file["data"]["points"], dtype=np.float64)
        names, rate_hz = list(point["LABELS"]["value"]), float(point["RATE"]["value"][0])
        scale = 1.0 if point["UNITS"]["value"][:1] == ["m"] else 1e-3
    except Exception as error:  # ezc3d raises OSError, and its own errors as RuntimeError and others
        raise FormatError(f"{path.name} is a damaged C3D file ({type(error).__name__}): export it again.") from None
    chosen = choose_sensor(names, marker, path, "markers", f"`--truth {path.name}:")
    position = scale * frames[:3, names.index(chosen)].T
    truth = pack_true_path(np.arange(len(position)) / rate_hz, position)
    if truth is None:
        raise FormatError(f"{path.name} has no frame with marker '{chosen}': name another behind the colon.")
    return truth


CSV_COLUMNS = ("stride", "x_m", "y_m")


def read_footprint_mat(content: Content) -> FootprintTruth:
    """Footprints from `GCP_meters` (M, 2), `GCP_stride_numbers` (M,) and, where there, `numberOfStrides`.

    Raises `FormatError` if a variable is missing, damaged, or does not fit the other.
    """
    path, variables = content.path, load_mat(content)
    xy = mat_array(variables, "GCP_meters", path, columns=2)
    stride = mat_array(variables, "GCP_stride_numbers", path)
    if len(stride) != len(xy):
        raise FormatError(f"{path.name} has {len(xy)} footprints but {len(stride)} stride numbers: export it again.")
    count = mat_array(variables, "numberOfStrides", path) if "numberOfStrides" in variables else np.empty(0)
    return pack_footprints(stride, xy, int(count[0]) if count.size and np.isfinite(count[0]) else None, path)


def read_footprint_csv(content: Content) -> FootprintTruth:
    """Footprints from a CSV with the columns `stride,x_m,y_m`.

    Raises `FormatError` if a column is missing or a field is no number.
    """
    path, header = content.path, content.fields()
    table, _ = read_table(content, header, [find_column(n, header, path) for n in CSV_COLUMNS], first_line=2)
    return pack_footprints(table[:, 0], table[:, 1:], None, path)


def pack_footprints(
    stride: Floats, xy: Floats, stride_count: int | None, path: Path, t: Floats | None = None
) -> FootprintTruth:
    """Check and pack footprints, with their times (M,) s where they are known.

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


FIX_COLUMNS = ("time_s", "x_m", "y_m", "z_m", "sigma_m")


def read_fixes(path: Path | str) -> tuple[Fix, ...]:
    """Read the fixes of a file.

    Raises `FormatError` if a column is missing, a field is no number, or anything but z is empty; or if a sigma is not
    above zero.
    """
    content = read_content(Path(path))
    path, header = content.path, content.fields()
    table, line = read_table(content, header, [find_column(name, header, path) for name in FIX_COLUMNS], first_line=2)
    needed = np.isfinite(np.delete(table, 3, axis=1)).all(axis=1) & ~np.isinf(table[:, 3])
    for good, what in (
        (needed, "lacks a number (only z_m may be empty)"),
        (table[:, 4] > 0, "has no sigma above zero"),
    ):
        if not good.all():
            raise FormatError(f"{path.name}, line {line[np.argmin(good)]} {what}: correct or delete that line.")
    return tuple(
        Fix(float(t), np.array([x, y, np.nan_to_num(z)]), float(sigma), float("inf") if np.isnan(z) else float(sigma))
        for t, x, y, z, sigma in table
    )
