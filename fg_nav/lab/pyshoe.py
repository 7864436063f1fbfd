"""What the files of PyShoe and gdlbio hold of their authors' own results: labels of stances, and a path."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.io.content import read_content
from fg_nav.io.matlab import mat_array


def read_pyshoe_labels(path: Path | str, detector: str = "shoe") -> Bools:
    """(N,) True where a detector of a PyShoe trial (shoe, ared, amvd, mbgtd, vicon) sees the foot stand.

    Raises `FormatError` if the file is no MATLAB file or does not hold these labels.
    """
    path = Path(path)
    return mat_array(read_content(path).load_variables(), f"zv_{detector}_opt", path) > 0.5


def read_pyshoe_track(path: Path | str) -> Floats:
    """Path (N, 2) m, right-handed, that the authors of gdlbio had from PyShoe, at every sample of the file.

    Raises `FormatError` if the file is no MATLAB file or does not hold it.
    """
    path = Path(path)
    track = mat_array(read_content(path).load_variables(), "pyshoeTrajectory", path, columns=2)
    return np.asarray(track * [1.0, -1.0])
