"""Fixes of the position from a CSV `time_s,x_m,y_m,z_m,sigma_m`: surveyed points, or a receiver's positions.

Time is that of the recording as read. x is east, y north, z up from where the walk starts; an empty z is one nobody
knows. The sigma is that of each axis that is given.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fg_nav.errors import FormatError
from fg_nav.fixes import Fix
from fg_nav.io.content import look
from fg_nav.io.tables import position_of, read_table

COLUMNS = ("time_s", "x_m", "y_m", "z_m", "sigma_m")


def read_fixes(path: Path | str) -> tuple[Fix, ...]:
    """Read the fixes of a file.

    Raises
    ------
    FormatError
        If a column is missing, a field is no number, or anything but z is empty; or if a sigma is not above zero.
    """
    content = look(Path(path))
    path, header = content.path, content.fields()
    table, line = read_table(path, header, [position_of(name, header, path) for name in COLUMNS], first_line=2)
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
