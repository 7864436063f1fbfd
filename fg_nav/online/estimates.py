"""What a walk in progress reports: an estimate at each footfall, and the path between footfalls.

StanceEstimate        a footfall, as known when it was complete; kept as a row of numbers, for a walk has thousands
propagate_strapdown   from the last footfall to now: strapdown, standing still where the foot is seen to stand
interpolate_stances   a walk that cannot be solved as a whole: straight from footfall to footfall
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.spatial.transform import Rotation, Slerp

from fg_nav.arrays import Bools, Floats
from fg_nav.mechanisation import NavState, strapdown
from fg_nav.recording import Recording
from fg_nav.solution import Solution, StanceTable

UNSOLVED_NOTE = (
    "the walk could not be solved as a whole; these are the estimates of the walk in progress, straight between the "
    "footfalls"
)


@dataclass(frozen=True)
class StanceEstimate:
    """Where the foot stands, as known when its footfall was complete; at the stillest sample of the footfall.

    ================ ======= =======================================================================
    number                   of the footfall, from 0
    sample                   counted from the first of the walk
    t                        s
    position         (3,)    m, navigation frame
    nav_R_body       (3, 3)
    heading                  rad, of the body's x axis, clockwise from north
    velocity         (3,)    m/s
    gyro_bias        (3,)    rad/s
    pose_cov         (4, 4)  of east, north, up (m) and yaw about up (rad)
    gyro_bias_sigma  (3,)    rad/s
    field                    verdict on the field, as in a stance table
    field_reason             in words
    ================ ======= =======================================================================
    """

    number: int
    sample: int
    t: float
    position: Floats
    nav_R_body: Floats
    heading: float
    velocity: Floats
    gyro_bias: Floats
    pose_cov: Floats
    gyro_bias_sigma: Floats
    field: str
    field_reason: str

    def as_row(self) -> EstimateRow:
        """Return it as a row of numbers and its words."""
        matrices = (self.position, self.nav_R_body, self.gyro_bias, self.pose_cov, self.gyro_bias_sigma)
        numbers = np.concatenate([[self.sample, self.t], *(matrix.ravel() for matrix in matrices)])
        return EstimateRow(numbers, self.field, self.field_reason)


class EstimateRow(NamedTuple):
    """An estimate as one row of numbers (37,) and its words."""

    numbers: Floats
    field: str
    field_reason: str


def build_table(rows: Sequence[EstimateRow]) -> StanceTable:
    """Return the stance table of some estimates."""
    numbers = np.array([row.numbers for row in rows]).reshape(len(rows), -1)
    sample, t, position, attitude, bias, pose_cov, bias_sigma = np.split(numbers, (1, 2, 5, 14, 17, 33), axis=1)
    pose_cov = pose_cov.reshape(-1, 4, 4)
    return StanceTable(
        sample=sample[:, 0].astype(np.int64),
        t=t[:, 0],
        position=position,
        nav_R_body=attitude.reshape(-1, 3, 3),
        gyro_bias=bias,
        position_cov=pose_cov[:, :3, :3],
        heading_sigma=np.sqrt(pose_cov[:, 3, 3]),
        gyro_bias_sigma=bias_sigma,
        field=tuple(row.field for row in rows),
        field_reason=tuple(row.field_reason for row in rows),
        pose_cov=pose_cov,
    )


class Track(NamedTuple):
    """A path at the rate of the samples: `t` (n,), position (n, 3), velocity (n, 3), attitude (n, 3, 3)."""

    t: Floats
    position: Floats
    velocity: Floats
    nav_R_body: Floats


def propagate_strapdown(recording: Recording, first: int, state: NavState, stands: Bools, gravity: float) -> Track:
    """Propagate a state from sample `first` to the last; at samples of `stands` (N,) the foot does not move."""
    h = np.append(np.diff(recording.t), recording.period_s)
    path = _propagate(h, *recording.integrable, stands, first, state, gravity)
    return Track(recording.t[first:], *path)


@njit(cache=True)
def _propagate(
    h: Floats, acc: Floats, gyr: Floats, stands: Bools, first: int, state: NavState, gravity: float
) -> tuple[Floats, Floats, Floats]:
    """Position (n, 3), velocity (n, 3) and attitude (n, 3, 3) from sample `first` on."""
    n = len(h) - first
    p, v, R = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3, 3))
    turn, push, at = np.empty((3, 3)), np.empty(3), np.empty(3)
    for i in range(n):
        p[i], v[i], R[i] = state.position, state.velocity, state.nav_R_body
        at[:] = state.position
        strapdown(state, acc[first + i], gyr[first + i], h[first + i], gravity, turn, push)
        if stands[first + i]:
            state.position[:] = at
            state.velocity[:] = 0.0
    return p, v, R


def interpolate_stances(recording: Recording, table: StanceTable, why: str) -> Solution:
    """Return a solution through the rows of a table: positions on a line, attitudes on the shortest arc.

    Parameters
    ----------
    recording
        Of the walk.
    table
        Of its footfalls, one or more, with samples of the recording.
    why
        The walk could not be solved, for the note.
    """
    t = recording.t
    inside = np.clip(t, table.t[0], table.t[-1])
    position = np.stack([np.interp(t, table.t, axis) for axis in table.position.T], axis=1)
    if len(table) > 1:
        attitude = Slerp(table.t, Rotation.from_matrix(table.nav_R_body))(inside).as_matrix()
    else:
        attitude = np.repeat(table.nav_R_body, len(t), axis=0)
    velocity = np.gradient(position, t, axis=0)
    return Solution("online", t, position, velocity, attitude, table, 0.0, notes=(f"{UNSOLVED_NOTE} ({why})",))
