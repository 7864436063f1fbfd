"""The person between two feet: the middle of both, at every moment.

    p = (p_R + p_L) / 2,    v = (v_R + v_L) / 2.

One foot stands while the other swings, so the middle moves evenly. The heading is the direction in which it moved over
a stride, `CHORD_M`, and stays while it stands. Where one sensor did not record, the person goes on as the other foot
does, from where the middle was over the last `SEAM_S`; in a hole, to where it is over the first behind it.

Its error is that of one foot and half of what the other one's differs by,

    e = e_L + (e_R - e_L) / 2,    cov(e) = cov(e_L) + cov(e_R - e_L) / 4,

the latter known at the cells of steps (`steps`) and interpolated between. How the two go together is left out: in
simulated walks of feet that step in turn sigmas are by 2 % larger for that at most. Where for long no steps tie the
feet the difference is that of footfalls which nothing ties (`smoother.feet.WATCHED_S`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Brief, Floats, interpolate_columns
from fg_nav.frames import yaw_rotation
from fg_nav.samples.gaps import find_unrecorded, list_unrecorded
from fg_nav.solution import Solution, StanceTable

CHORD_M = 1.4  # Over which the direction of walking is taken.
SEAM_S = 1.5  # A stride: the middle of two feet is not that of one, but for a mean over both.


@dataclass(frozen=True)
class FeetSolution(Brief):
    """Two feet of one person as they were solved together, in one frame."""

    right: Solution  # each foot with the sigmas that it has beside the other
    left: Solution
    person: Solution  # the middle of both (`trace_person`)
    width_m: float  # between the sensors, across the way; negative where the right foot's recording is on the left
    width_sigma_m: float
    cells: int  # of steps that tie the feet
    beyond_reach: int  # pairs of footfalls that are held within reach


def trace_person(right: Solution, left: Solution, cell_t: Floats, apart_cov: Floats) -> Solution:
    """Return the path of the point midway between two feet, with method and parameters of the left one.

    It has a row a footfall of the left foot, and of the right one where the left one did not record; no gyroscope bias
    and no field. Its attitude is level, x forward. `apart_cov` (C, 4, 4) is the covariance of the right foot's errors
    less those of the left one, at times (C,) s, in any order.
    """
    t = np.sort(np.concatenate([left.t, right.t[find_unrecorded(right.t, left.t)]]))
    position = 0.5 * (_carry_on(t, left, right) + _carry_on(t, right, left))
    velocity = 0.5 * (_follow(t, left, right) + _follow(t, right, left))
    # heading: the direction of a chord; where the person stood, one distance has many places: any of them
    walked = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(position[:, :2], axis=0), axis=1))])
    rising = walked + 1e-9 * np.arange(len(walked))
    ends = [np.clip(walked + half, 0.0, walked[-1]) for half in (-0.5 * CHORD_M, 0.5 * CHORD_M)]
    first, last = (interpolate_columns(at, rising, position[:, :2]) for at in ends)
    chord = last - first
    nav_R_person = yaw_rotation(0.5 * np.pi - np.arctan2(chord[:, 0], chord[:, 1]))
    # covariance at the footfalls
    of_right = right.stances.t
    alone = find_unrecorded(of_right, left.t)
    footfall_t = np.concatenate([left.stances.t, of_right[alone]])
    own = np.concatenate([left.stances.position_yaw_cov, right.stances.position_yaw_cov[alone]])
    order, in_time = np.argsort(footfall_t, kind="stable"), np.argsort(cell_t)
    footfall_t = footfall_t[order]
    apart = interpolate_columns(footfall_t, cell_t[in_time], apart_cov[in_time].reshape(len(cell_t), 16))
    pose_cov = own[order] + 0.25 * apart.reshape(-1, 4, 4)
    # the sample of each footfall, once
    sample, once = np.unique(np.clip(np.searchsorted(t, footfall_t), 0, len(t) - 1), return_index=True)
    cov, count = pose_cov[once], len(sample)
    unknown = np.full((count, 3), np.nan)
    table = StanceTable(
        sample, t[sample], position[sample], nav_R_person[sample], unknown, cov[:, :3, :3], np.sqrt(cov[:, 3, 3]),
        unknown, ("none",) * count, ("",) * count, pose_cov=cov,
    )  # fmt: skip
    runtime_s = max(left.runtime_s, right.runtime_s)
    return Solution(left.method, t, position, velocity, nav_R_person, table, runtime_s, left.parameters)


def _carry_on(t: Floats, foot: Solution, other: Solution) -> Floats:
    """Positions (N, 3) m of a foot at `t` (N,) s; unrecorded spans: other foot plus interpolated offset."""
    place = interpolate_columns(t, foot.t, foot.position)
    for begin, end in list_unrecorded(foot.t):
        inside = (t > begin) & (t < end)
        if not inside.any():
            continue
        # how far the foot is from the other over a stride next to the span
        at, apart = [], []
        for edge, first in ((begin, begin - SEAM_S), (end, end)):
            span = np.linspace(first, first + SEAM_S) if np.isfinite(edge) else np.empty(0)
            seam = span[~find_unrecorded(span, other.t) & ~find_unrecorded(span, foot.t)]
            if len(seam):
                here, there = (interpolate_columns(seam, one.t, one.position) for one in (foot, other))
                at.append(edge)
                apart.append((here - there).mean(axis=0))
        if len(at):
            moved = interpolate_columns(t[inside], np.array(at), np.array(apart))
            place[inside] = interpolate_columns(t[inside], other.t, other.position) + moved
    return place


def _follow(t: Floats, foot: Solution, other: Solution) -> Floats:
    """Velocity (N, 3) of a foot, and where it did not record that of the other."""
    velocity = interpolate_columns(t, foot.t, foot.velocity)
    outside = find_unrecorded(t, foot.t)
    velocity[outside] = interpolate_columns(t[outside], other.t, other.velocity)
    return velocity
