"""A walk that cannot be solved as a whole: what was known on the way, straight from footfall to footfall.

Seconds without a sample can leave the batch solver without a solution. The walk still ends with a result: the rows that
were smoothed on the way, and between them positions on a line and attitudes on the shortest arc.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from fg_nav.recording import Recording
from fg_nav.solution import Solution, StanceTable

NOTE = "the walk could not be solved as a whole; this is what was known on the way, straight between the footfalls"


def straight_between(recording: Recording, table: StanceTable, why: str) -> Solution:
    """Return a solution through the rows of a table, one or more.

    Parameters
    ----------
    recording
        Of the walk.
    table
        Of its footfalls, with samples of the recording.
    why
        It could not be solved, for the note.
    """
    t = recording.t
    held = np.clip(t, table.t[0], table.t[-1])
    position = np.stack([np.interp(t, table.t, axis) for axis in table.position.T], axis=1)
    if len(table) > 1:
        attitude = Slerp(table.t, Rotation.from_matrix(table.nav_R_body))(held).as_matrix()
    else:
        attitude = np.repeat(table.nav_R_body, len(t), axis=0)
    velocity = np.gradient(position, t, axis=0)
    return Solution("online", t, position, velocity, attitude, table, 0.0, notes=(f"{NOTE} ({why})",))
