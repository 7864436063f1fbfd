"""What a stride of a walk in progress shows of the field: footfall and way, on the window of the stride.

By `average_footfall_field` and `field_way`, as in batch. Their trajectory is that of the stride as it is known without
its field: where it is and which way it heads makes no difference.
"""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import MagneticError
from fg_nav.magnetic import average_footfall_field
from fg_nav.online.field import Seen
from fg_nav.recording import Recording
from fg_nav.smoother.dense import Trajectory
from fg_nav.smoother.field_parameters import FieldParameters
from fg_nav.smoother.field_way import field_way
from fg_nav.stances import Stances


def seen_on(recording: Recording, stances: Stances, track: Trajectory, up_uT: float, p: FieldParameters) -> Seen:
    """Return what the second of two footfalls and the stride to it show of the field.

    Parameters
    ----------
    recording, stances : of the two footfalls.
    track : at its samples.
    up_uT : vertical field of the walk.
    """
    sample = stances.stillest(recording.gyr)
    move = track.position[sample[1]] - track.position[sample[0]]
    body_move, distance = track.nav_R_body[sample[0]].T @ move, float(np.linalg.norm(move))
    nothing = Seen(np.full(3, np.nan), 0.0, np.zeros(3), body_move, np.inf, distance)
    if recording.mag is None or not np.isfinite(recording.mag[:, 0]).any():
        return nothing
    way = field_way(recording.t, recording.mag, track.position, track.nav_R_body, sample, up_uT, p)
    body_way = way.level_way[0] @ way.level_R_body
    body_field = _at_footfall(recording, stances, track)
    return Seen(body_field, float(way.u[0]), body_way, way.body_move[0], float(way.sigma_uT_m[0]), distance)


def _at_footfall(recording: Recording, stances: Stances, track: Trajectory) -> Floats:
    try:
        return np.asarray(average_footfall_field(recording, stances, nav_R_body=track.nav_R_body).body_field[1])
    except MagneticError:
        return np.full(3, np.nan)
