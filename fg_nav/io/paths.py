"""A true path from whatever a file offers: rows that are not finite or not later are left out."""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.recording import TrajectoryTruth


def true_path(t: Floats, position: Floats, nav_R_body: Floats | None = None) -> TrajectoryTruth | None:
    """Pack a true path, or None if not two rows of it are usable.

    Parameters
    ----------
    t, position, nav_R_body
        (M,) s, (M, 3) m, (M, 3, 3); NaN where the reference saw nothing.
    """
    seen = np.isfinite(t) & np.isfinite(position).all(axis=1)
    if nav_R_body is not None:
        seen &= np.isfinite(nav_R_body).all(axis=(1, 2))
    before = np.concatenate(([-np.inf], np.maximum.accumulate(np.where(seen, t, -np.inf))[:-1]))
    seen &= t > before
    if np.count_nonzero(seen) < 2:
        return None
    return TrajectoryTruth(t[seen], position[seen], None if nav_R_body is None else nav_R_body[seen])
