"""Surveyed footprints: MATLAB files with `GCP_meters`, and CSV files `stride,x_m,y_m`.

The MATLAB files give stride numbers as uint8, which wraps in sums and differences; here they are int64.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import FormatError
from fg_nav.io import mat
from fg_nav.io.content import Content
from fg_nav.io.tables import position_of, read_table
from fg_nav.recording import FootprintTruth

CSV_COLUMNS = ("stride", "x_m", "y_m")


def read_footprint_mat(path: Path) -> FootprintTruth:
    """Footprints from `GCP_meters` (M, 2), `GCP_stride_numbers` (M,) and, where there, `numberOfStrides`.

    Raises
    ------
    FormatError
        If a variable is missing, damaged, or does not fit the other.
    """
    variables = mat.load(path)
    xy = mat.array(variables, "GCP_meters", path, columns=2)
    stride = mat.array(variables, "GCP_stride_numbers", path)
    if len(stride) != len(xy):
        raise FormatError(f"{path.name} has {len(xy)} footprints but {len(stride)} stride numbers: export it again.")
    count = mat.array(variables, "numberOfStrides", path) if "numberOfStrides" in variables else np.empty(0)
    return footprints(stride, xy, int(count[0]) if count.size and np.isfinite(count[0]) else None, path)


def read_footprint_csv(content: Content) -> FootprintTruth:
    """Footprints from a CSV with the columns `stride,x_m,y_m`.

    Raises
    ------
    FormatError
        If a column is missing or a field is no number.
    """
    path, header = content.path, content.fields()
    table, _ = read_table(path, header, [position_of(n, header, path) for n in CSV_COLUMNS], first_line=2)
    return footprints(table[:, 0], table[:, 1:], None, path)


def footprints(stride: Floats, xy: Floats, stride_count: int | None, path: Path) -> FootprintTruth:
    """Check and pack footprints.

    Raises
    ------
    FormatError
        If a number is not finite, or the strides are not whole, rising numbers.
    """
    if not (np.isfinite(stride).all() and np.isfinite(xy).all()):
        raise FormatError(f"{path.name} has a footprint that is not finite: correct or delete it.")
    whole = (stride >= 0).all() and (stride == np.round(stride)).all() and (stride < 2**31).all()
    if not whole or (np.diff(stride) <= 0).any():
        raise FormatError(f"{path.name}: stride numbers must be whole and rising, 0 at the start: correct them.")
    return FootprintTruth(stride=stride.astype(np.int64), xy=xy, stride_count=stride_count)
