"""Pairs of magnetometer readings a short time apart while the sensor turns: the gyroscope says how they must differ.

Symbols

========= ===== =======================================================================================
y_1, y_2  uT    two readings, in the axes of the magnetometer
dR        -     body_1 to body_2 by the gyroscope, each sample held over its own period: w_1 = dR w_2
tau       s     how late the magnetometer is: what is stamped t it read at t - tau
h         uT    hard iron
P         -     axes of the magnetometer, a signed permutation: P y is in the axes of the gyroscope
========= ===== =======================================================================================

In a field that does not change along the path of one swing, dm/dt = -w x m, or over a short time

    dR(tau) P (y_2 - h) = P (y_1 - h).

The building's field changes by some uT in a swing, which turns the reading by 50: the left side minus the right, r, is
small only with the right tau and P. Only the rotation between the two instants enters, so that no stances, attitude or
gyroscope bias are needed. The weights are those of the pseudo-Huber loss, whose scale s is the median of |r|:

    rho(r) = s^2 (sqrt(1 + |r|^2 / s^2) - 1),   weight 1 / sqrt(1 + |r|^2 / s^2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.mechanisation import rotate_in_body
from fg_nav.recording import Recording
from fg_nav.system.compiled import njit

TURNING_RAD_S = 1.0  # Mean rate of a pair: slower, the building's changes hide what the turning does.
BLOCK_S = 2.0  # Pairs of one block count as one observation where scatter is asked for: a stride or two.
HELD_SHARE = 0.2  # Of the readings of a turning sensor that repeat the one before: more, and the logger holds them.
MAX_SPACING = 1.6  # Readings of a pair are at most so many times as far apart as they should be.
HARD_IRON_SIGMA_UT = 100.0  # Prior of h per axis: what turns about one axis only does not show all of it.


@dataclass(frozen=True)
class TurningPairs:
    """K pairs of readings.

    Attributes
    ----------
    t, gyr : (N,) s and (N, 3) rad/s of the recording, for rotations.
    stamps : (K, 2) s, of the two readings.
    readings : (K, 2, 3) uT.
    block : (K,) which block of the walk each is in, from 0 on without holes.
    held : whether the logger repeats readings until there is a new one.
    """

    t: Floats
    gyr: Floats
    stamps: Floats
    readings: Floats
    block: Ints
    held: bool

    def __len__(self) -> int:
        return len(self.stamps)

    @property
    def n_blocks(self) -> int:
        """Blocks with pairs."""
        return int(self.block[-1]) + 1 if len(self) else 0

    def rotations(self, tau: float) -> tuple[Floats, Floats]:
        """Rotations dR (K, 3, 3) and the rates (K, 2, 3) rad/s at both ends for a magnetometer late by tau s."""
        return rotate_between(self.t, self.gyr, self.stamps - tau)


def list_readings(recording: Recording, held: bool) -> Ints:
    """Rows (M,) with a reading of the magnetometer; where it holds them, with a new one."""
    if recording.mag is None:
        return np.zeros(0, dtype=np.int64)
    measured = np.flatnonzero(np.isfinite(recording.mag).all(axis=1))
    return measured[_differs(recording.mag[measured])] if held else measured


def holds_readings(recording: Recording) -> bool:
    """Whether the rows between two readings of the magnetometer repeat the older one."""
    if recording.mag is None:
        return False
    measured = np.flatnonzero(np.isfinite(recording.mag).all(axis=1))
    turns = (recording.gyr[measured] ** 2).sum(axis=1) > TURNING_RAD_S**2
    return bool(turns.any() and np.mean(~_differs(recording.mag[measured])[turns]) > HELD_SHARE)


def _differs(mag: Floats) -> Bools:
    """(N,) True where a reading is not the one before."""
    return np.append(True, (np.diff(mag, axis=0) != 0.0).any(axis=1))[: len(mag)]


def find_pairs(recording: Recording, span_s: float, most: int) -> TurningPairs:
    """Find pairs of readings about `span_s` apart while the sensor turns, evenly thinned to `most`."""
    held = holds_readings(recording)
    rows = list_readings(recording, held)
    if len(rows) < 2:
        return TurningPairs(
            recording.t, recording.gyr, np.zeros((0, 2)), np.zeros((0, 2, 3)), np.zeros(0, np.int64), held
        )
    t, spacing = recording.t[rows], float(np.median(np.diff(recording.t[rows])))
    # pairs that overlap by half, in a row
    first = np.arange(0, len(t), max(1, round(span_s / spacing / 2)))
    second = np.searchsorted(t, t[first] + span_s - 0.01 * spacing)
    first, second = first[second < len(t)], second[second < len(t)]
    near = t[second] - t[first] <= MAX_SPACING * max(span_s, spacing)
    first, second = first[near], second[near]
    # those between which it turns
    stamps = np.stack([t[first], t[second]], axis=1)
    dR, _ = rotate_between(recording.t, recording.gyr, stamps)
    angle = np.arccos(np.clip((np.trace(dR, axis1=1, axis2=2) - 1.0) / 2.0, -1.0, 1.0))
    turning = np.flatnonzero(angle > TURNING_RAD_S * (stamps[:, 1] - stamps[:, 0]))
    chosen = turning[:: max(1, -(-len(turning) // most))]
    stamps = stamps[chosen]
    _, block = np.unique(np.floor(stamps[:, 0] / BLOCK_S), return_inverse=True)
    assert recording.mag is not None
    readings = recording.mag[rows[np.stack([first[chosen], second[chosen]], axis=1)]]
    return TurningPairs(recording.t, recording.gyr, stamps, readings, block.astype(np.int64), held)


def compute_weights(size: Floats) -> Floats:
    """Weights of residuals of these lengths (..., K) by the pseudo-Huber loss, scaled by the median of each row."""
    scale = np.median(size, axis=-1, keepdims=True) + 1e-9
    return np.asarray(1.0 / np.sqrt(1.0 + (size / scale) ** 2))


def rotate_between(t: Floats, gyr: Floats, between: Floats) -> tuple[Floats, Floats]:
    """Rotations (K, 3, 3) between the instants (K, 2), and the rates (K, 2, 3) there; the ends' rates are held."""
    first = np.maximum(np.searchsorted(t, between[:, 0], side="right") - 1, 0)
    rotations, last = np.tile(np.eye(3), (len(between), 1, 1)), first.copy()
    _rotate(t, gyr, between, first, rotations, last)
    return rotations, gyr[np.stack([first, last], axis=1)]


@njit(cache=True)
def _rotate(t: Floats, gyr: Floats, between: Floats, first: Ints, rotations: Floats, last: Ints) -> None:
    """Turn the identities from sample `first` (K,) on, and write the sample that was held `last` (K,)."""
    for k in range(len(between)):
        at, end, i, R = between[k, 0], between[k, 1], first[k], rotations[k]
        while at < end:
            until = min(t[i + 1], end) if i + 1 < len(t) else end
            rotate_in_body(R, gyr[i, 0] * (until - at), gyr[i, 1] * (until - at), gyr[i, 2] * (until - at))
            last[k] = i
            at = until
            i = min(i + 1, len(t) - 1)
