"""The person between two feet: the middle of both, at every moment.

    p = (p_R + p_L) / 2,    v = (v_R + v_L) / 2,

at the left foot's samples, while both sensors recorded. One foot stands while the other swings, so the middle moves
evenly. The heading is the direction in which it moved over a stride, `CHORD_M`, and stays while it stands.

Its covariance is that of the mean of both feet's errors, known at the cells of steps (`steps`), interpolated between.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.frames import yaw_rotation
from fg_nav.solution import Solution

CHORD_M = 1.4
"""Over which the direction of walking is taken."""


@dataclass(frozen=True)
class PersonPath:
    """The path of a person.

    Attributes
    ----------
    t : (N,) s. position : (N, 3) m. velocity : (N, 3) m/s.
    heading : (N,) rad clockwise from north, of the direction of walking.
    cell_t : (C,) s, where the covariance is known. cell_cov : (C, 4, 4) of east, north, up (m) and yaw about up (rad).
    """

    t: Floats
    position: Floats
    velocity: Floats
    heading: Floats
    cell_t: Floats
    cell_cov: Floats

    @property
    def nav_R_person(self) -> Floats:
        """Attitude (N, 3, 3) of the level axes forward, left and up."""
        return yaw_rotation(0.5 * np.pi - self.heading)

    def covariance_at(self, t: Floats) -> Floats:
        """Return the covariance (M, 4, 4) at times (M,)."""
        flat = self.cell_cov.reshape(len(self.cell_t), 16)
        return np.stack([np.interp(t, self.cell_t, column) for column in flat.T], axis=1).reshape(-1, 4, 4)


@dataclass(frozen=True)
class FeetSolution:
    """Two feet of one person as they were solved together, in one frame.

    Attributes
    ----------
    right, left : each foot, with the sigmas that it has beside the other.
    person : the middle of both.
    width_m, width_sigma_m : between the sensors, across the way; negative where the right foot's recording is on the
        left.
    cells, beyond_reach : how many cells of steps tie the feet, and how many pairs of footfalls were out of reach.
    notes : remarks for the user.
    """

    right: Solution
    left: Solution
    person: PersonPath
    width_m: float
    width_sigma_m: float
    cells: int
    beyond_reach: int
    notes: tuple[str, ...] = ()


def trace_person(right: Solution, left: Solution, cell_t: Floats, cell_cov: Floats) -> PersonPath:
    """Trace the middle of two feet, with its covariance (C, 4, 4) at times (C,) s."""
    seen = (left.t >= right.t[0]) & (left.t <= right.t[-1])
    t = left.t[seen]
    position, velocity = (
        0.5 * (getattr(left, name)[seen] + _interpolate(t, right.t, getattr(right, name)))
        for name in ("position", "velocity")
    )
    return PersonPath(t, position, velocity, _find_heading(position), cell_t, cell_cov)


def _interpolate(asked: Floats, t: Floats, values: Floats) -> Floats:
    return np.stack([np.interp(asked, t, column) for column in values.T], axis=1)


def _find_heading(position: Floats) -> Floats:
    """Direction (N,) in which places (N, 3) moved over a chord, clockwise from north."""
    walked = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(position[:, :2], axis=0), axis=1))])
    ends = [np.clip(walked + half, 0.0, walked[-1]) for half in (-0.5 * CHORD_M, 0.5 * CHORD_M)]
    # Where it stood, one distance has many places: any of them.
    rising = np.maximum.accumulate(walked + 1e-9 * np.arange(len(walked)))
    first, last = (_interpolate(at, rising, position[:, :2]) for at in ends)
    chord = last - first
    return np.asarray(np.arctan2(chord[:, 0], chord[:, 1]))
