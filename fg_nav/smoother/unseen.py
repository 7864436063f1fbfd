"""What a person can have done while samples were missing: in place of an inertial measurement.

In a gap of more than `MAX_HELD_S` nothing shows how the foot moved. Between the nodes on either side, of a time T
apart, the foot has walked and turned (`factors.unseen_walk`) by

    0 +- WALKING_M_S d(T)      over ground on each axis
    0 +- CLIMBING_M_S d(T)     up
    turn +- min(TURNING_RAD sqrt(T), UNKNOWN_RAD),

    d(T)^2 = 2 tau (T - tau (1 - exp(-T / tau))),     tau = `STRAIGHT_S`,

the displacement of a velocity that is forgotten with the time tau (Fuerth 1920): T at first, sqrt(2 tau T) in the end.

The turn is that of the magnetic field between the stances on either side, as far as it is better than nothing: with
f the turn that makes the field there point as it did before, known to `FIELD_SIGMA_RAD` indoors,

    turn = f s^2 / (s^2 + FIELD_SIGMA_RAD^2),     s the sigma of the turn;     0 without a field.

It is where the compass of the footfalls begins from, whose residual has a second zero half a turn away; the sigma stays
that of a person. The inertial measurement of the interval, before the gap and behind it, is given up.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.factors.rotation import turn_about_up
from fg_nav.factors.unseen_walk import UnseenWalk
from fg_nav.frames import UNKNOWN_RAD, level_attitude, yaw_rotation
from fg_nav.recording import Recording
from fg_nav.samples.gaps import cross_holes, find_holes

WALKING_M_S = 1.0  # On each axis over ground: 1.4 m/s on both together, as people walk.
CLIMBING_M_S = 0.35  # Stairs are climbed at 0.3 to 0.5 m/s, and most ways are level.

STRAIGHT_S = 120.0
"""For so long people go on in one direction, up to a street: after an hour they are within some 1.3 km, one sigma."""

TURNING_RAD = 0.5  # In a second; a random walk: a right angle each ten seconds, as indoors.
FIELD_SIGMA_RAD = 0.8  # Of the field's turn from one footfall to another, in a building.
TILT_SIGMA_RAD = 0.3  # Of a foot in two stances: slopes, stairs, and the phase of its roll.
REACH_S = 0.1  # On either side of a node, over which gravity and field are averaged.


class UnseenWalks(NamedTuple):
    """Of the intervals between M nodes.

    ============ ======== =====================================================================
    unseen       (M-1,)   whether samples are missing
    body_up      (M-1, 3) specific force at the end of each that is unseen, m/s^2
    walk                  what a person does in each; of those that are seen, nothing of meaning
    ============ ======== =====================================================================
    """

    unseen: Bools
    body_up: Floats
    walk: UnseenWalk


def find_unseen_walks(recording: Recording, sample: Ints, with_compass: bool = True) -> UnseenWalks:
    """Find the intervals between nodes at `sample` (M,) in which samples are missing, and what is expected of them."""
    unseen = cross_holes(recording.t, sample)
    elapsed = np.diff(recording.t[sample])
    move = walk_for(elapsed)[:, None] * np.array([WALKING_M_S, WALKING_M_S, CLIMBING_M_S])
    turn, sigma = np.zeros(len(elapsed)), np.minimum(TURNING_RAD * np.sqrt(elapsed), UNKNOWN_RAD)
    body_up = np.zeros((len(elapsed), 3))
    for k in np.flatnonzero(unseen):
        before, behind = (_look_about(recording, int(i)) for i in sample[k : k + 2])
        body_up[k] = behind[0]
        share = sigma[k] ** 2 / (sigma[k] ** 2 + FIELD_SIGMA_RAD**2)
        turn[k] = share * _turn_of_field(before, behind) if with_compass else 0.0
    return UnseenWalks(unseen, body_up, UnseenWalk(move, turn, sigma, np.full(len(elapsed), TILT_SIGMA_RAD)))


def walk_for(elapsed_s: Floats) -> Floats:
    """Displacement d (...) of a person, rms, over these times (...) and over the speed: s."""
    forgotten = -STRAIGHT_S * np.expm1(-elapsed_s / STRAIGHT_S)
    return np.asarray(np.sqrt(2.0 * STRAIGHT_S * (elapsed_s - forgotten)))


def _look_about(recording: Recording, node: int) -> tuple[Floats, Floats]:
    """Mean specific force (3,) and field (3,) about a node, NaN without one, up to the next hole."""
    t = recording.t
    first, stop = np.searchsorted(t, [t[node] - REACH_S, t[node] + REACH_S])
    holes = find_holes(t[first:stop]) + first
    first = max([first, *(holes[holes < node] + 1)])
    stop = min([stop, *(holes[holes >= node] + 1)])
    force = recording.acc[first:stop].mean(axis=0)
    if recording.mag is None or not (seen := np.isfinite(recording.mag[first:stop, 0])).any():
        return force, np.full(3, np.nan)
    return force, recording.mag[first:stop][seen].mean(axis=0)


def _turn_of_field(before: tuple[Floats, Floats], behind: tuple[Floats, Floats]) -> float:
    """Turn about up, rad counter-clockwise, after which the field points as before; 0 without a field."""
    first, then = (_face_field(*one) for one in (before, behind))
    turn = float(turn_about_up(then @ first.T))
    return turn if np.isfinite(turn) else 0.0


def _face_field(force: Floats, field: Floats) -> Floats:
    """Attitude (3, 3) in which the force points up and the field north."""
    level_R_body = level_attitude(force)
    east, north, _ = level_R_body @ field
    return yaw_rotation(float(np.arctan2(east, north))) @ level_R_body
