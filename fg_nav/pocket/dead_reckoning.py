"""Where somebody is by steps alone: each a length along the way, in the direction in which the thigh swings.

    p_k+1 = p_k + l_k d_k,     d_k level and forward: the mean of the thigh's left over a stride, turned to the front

Over a stride the twist of the pelvis goes to and fro, and leaves nothing. Height is not seen, and stays what it was.

Its covariance has four parts, l being the lengths, n the left of the directions d, sums over all steps so far:

======= =============================== ==============================================================================
scale   (s sum l d)(..)^T               the constant of the length, the same always
heading sum_m dv_m (J r_m)(J r_m)^T     v_m the track's variance of heading at step m, never falling, dv_m by how much
                                        it grew, r_m the way from there to here, J a quarter turn: what a heading loses
                                        it loses for the rest of the walk. dv_0 is that of the start and the axis's,
                                        which is not quite across the way
steps   sum l^2 (q^2 d d^T + r^2 n n^T) length and direction of each on its own
slope   (g sum l)^2 on the vertical     stairs and ramps
======= =============================== ==============================================================================
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.pocket.step_length import StepLength
from fg_nav.pocket.steps import Steps
from fg_nav.pocket.swing_axis import ThighSwing
from fg_nav.pocket.track import PocketTrack


@dataclass(frozen=True)
class ReckoningParameters:
    """Sigmas of the directions. Of the lengths they are those of `StepLength`."""

    mounting_sigma_deg: float = 4.0
    """Axis of the swing against the way, deg: a leg that abducts while it swings turns it by 2 in the simulator, and
    toes that point out by some more. Assumed."""
    step_heading_sigma_deg: float = 4.0
    """Direction of each step on its own, deg. Assumed."""
    slope_sigma: float = 0.03
    """Rise over way: floors, streets and ramps. Stairs are ten times that, and not told. Assumed."""


@dataclass(frozen=True)
class Way:
    """What the steps add up to.

    Attributes
    ----------
    sample : (P,) at the start of the walk, and at both ends of each step.
    position : (P, 3) m, from the first at nought.
    covariance : (P, 3, 3) m^2.
    length : (S,) m of each step.
    heading : (S,) rad clockwise from north, of each step.
    """

    sample: Ints
    position: Floats
    covariance: Floats
    length: Floats
    heading: Floats


def reckon(
    track: PocketTrack,
    swing: ThighSwing,
    steps: Steps,
    law: StepLength,
    parameters: ReckoningParameters = ReckoningParameters(),
) -> Way:
    """Add up the steps of a track."""
    forward = directions(track, swing, steps)
    length = law.of(steps.opening)
    sigma = track.sigma[(steps.start + steps.stop) // 2, 2]
    after = np.cumsum(length[:, None] * forward, axis=0)
    position = np.concatenate([np.zeros((1, 2)), after])
    covariance = _covariance(forward, length, sigma, law, parameters)
    ends = np.repeat(np.arange(len(steps) + 1), 2)[1:-1]  # before and after each step
    return Way(
        sample=np.stack([steps.start, steps.stop], axis=1).ravel(),
        position=np.pad(position, ((0, 0), (0, 1)))[ends],
        covariance=covariance[ends],
        length=length,
        heading=np.arctan2(forward[:, 0], forward[:, 1]),
    )


def directions(track: PocketTrack, swing: ThighSwing, steps: Steps) -> Floats:
    """Directions (S, 2) east and north, of length 1, in which the thigh swings over the stride about each step."""
    left = track.nav_R_body[:, :2] @ swing.left
    total = np.concatenate([np.zeros((1, 2)), np.cumsum(left, axis=0)])
    half = (steps.stop - steps.start + 1) // 2
    first, last = np.maximum(steps.start - half, 0), np.minimum(steps.stop + half, len(left))
    mean = total[last] - total[first]
    mean /= np.linalg.norm(mean, axis=1, keepdims=True)
    return np.stack([mean[:, 1], -mean[:, 0]], axis=1)


def _covariance(forward: Floats, length: Floats, sigma: Floats, law: StepLength, p: ReckoningParameters) -> Floats:
    """Covariance (S + 1, 3, 3) m^2 before and after each step."""
    along, left = length[:, None] * forward, np.stack([-forward[:, 1], forward[:, 0]], axis=1)
    after = np.cumsum(along, axis=0)
    own = _outer(law.step_sigma * along) + _outer(np.radians(p.step_heading_sigma_deg) * length[:, None] * left)
    variance = np.maximum.accumulate(sigma**2) + np.radians(p.mounting_sigma_deg) ** 2
    covariance = np.zeros((len(length) + 1, 3, 3))
    covariance[1:, :2, :2] = _outer(law.sigma * after) + np.cumsum(own, axis=0) + _by_heading(after, along, variance)
    covariance[1:, 2, 2] = (p.slope_sigma * np.cumsum(length)) ** 2
    return covariance


def _by_heading(after: Floats, along: Floats, variance: Floats) -> Floats:
    """Covariance (S, 2, 2) by a heading of this variance (S,): sum over m of dv_m (J (p - p_m))(J (p - p_m))^T."""
    grown = np.diff(variance, prepend=0.0)
    before = after - along
    once = np.cumsum(grown[:, None] * before, axis=0)
    twice = np.cumsum(grown[:, None, None] * _outer(before), axis=0)
    mixed = once[:, :, None] * after[:, None, :]
    ways = variance[:, None, None] * _outer(after) - mixed - np.swapaxes(mixed, 1, 2) + twice
    quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
    return np.asarray(quarter @ ways @ quarter.T)


def _outer(vectors: Floats) -> Floats:
    return np.asarray(vectors[:, :, None] * vectors[:, None, :])
