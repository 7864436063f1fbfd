"""Truth from a file of its own: TUM lines, a table of footprints, or a MATLAB file.

A TUM line is `t x y z qx qy qz qw`: s, m, and the quaternion of nav_R_body; z is up. Lines that begin with
`#` at the head of the file are comments.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from fg_nav.errors import FormatError
from fg_nav.io import footprints
from fg_nav.io.content import Content, look
from fg_nav.io.formats import FORMATS
from fg_nav.io.tables import read_table
from fg_nav.recording import TrajectoryTruth, Truth

TUM_COLUMNS = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")


def read_truth(path: Path | str) -> Truth:
    """Read a true path or surveyed footprints; which it is, the content says.

    Raises
    ------
    FormatError
        If the file holds neither, or is damaged.
    """
    content = look(Path(path))
    if "GCP_meters" in content.variables:
        return footprints.read_footprint_mat(content.path)
    if content.variables:
        return _beside_a_recording(content)
    if not set(footprints.CSV_COLUMNS).isdisjoint(content.fields()):
        return footprints.read_footprint_csv(content)
    return read_tum(content)


def read_tum(content: Content) -> TrajectoryTruth:
    """Read TUM lines.

    Raises
    ------
    FormatError
        If a line has not 8 numbers, the stamps do not rise, or a quaternion is not of unit length.
    """
    path = content.path
    comments = next((k for k, line in enumerate(content.lines) if not line.startswith("#")), 0)
    fields = content.lines[comments].split() if content.lines else []
    if len(fields) != len(TUM_COLUMNS):
        raise FormatError(
            f"{path.name} is no truth read here: give TUM lines (t x y z qx qy qz qw), "
            f"a CSV with stride,x_m,y_m, or a MATLAB file of footprints."
        )
    table, row = read_table(path, TUM_COLUMNS, range(8), first_line=comments + 1, separator=r"\s+")
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
    return TrajectoryTruth(table[:, 0], table[:, 1:4], Rotation.from_quat(table[:, 4:]).as_matrix())


def _beside_a_recording(content: Content) -> Truth:
    """Truth of a MATLAB recording that carries its own."""
    for known in FORMATS.values():
        if known.is_mat and known.recognises(content):
            truth = known.read(content).truth
            if truth is not None:
                return truth
    raise FormatError(f"{content.path.name} holds neither footprints nor a true path: give another file.")
