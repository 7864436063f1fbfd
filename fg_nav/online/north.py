"""What a walk in progress knows of north, where no heading was given and the field shows it.

North is where the mean field of the walk points. At a foot the field deviates from that of the Earth, across it by
delta (uT): from one footfall to the next by what lies in the floor, and from one room to the next by what stands in it.
Both are taken for stationary processes along the path, of the correlation lengths L and L_r. Over a path of s m the
mean of such a process has the variance sigma^2 v(s / L),

    v(x) = 2 (x - 1 + exp(-x)) / x^2,    v(0) = 1,    v -> 2 / x,

the inverse of the number of independent places. North is off by as much, with H the horizontal field:

    sigma_north^2 = (sigma^2 v(s / L) + sigma_r^2 v(s / L_r)) / H^2
    sigma^2 = (n_0 sigma_0^2 + sum e_k^2) / (n_0 + n - 1),    sigma_r = c sigma,

e_k the deviation across the mean at the n footfalls so far. Few footfalls of one room agree and may all be wrong, so
they begin from what a reinforced floor does to a foot, sigma_0, and unlearn that. What the rooms do a short walk cannot
show at all: that is a share c. Before the field is in the graph nothing is known: the heading is any, and has the sigma
of an angle that is uniform, pi / sqrt(3).

A north that is off by theta turns the walk about its origin. A position p from there is off by
sin(theta) (up x p) - (1 - cos(theta)) p over the ground, whose second moments are, theta normal,

    <theta^2> = s^2,    <theta sin> = s^2 exp(-s^2 / 2),
    <sin^2> = (1 - exp(-2 s^2)) / 2,    <(1 - cos)^2> = 3/2 - 2 exp(-s^2 / 2) + exp(-2 s^2) / 2:

for a small s a move across by s |p|, and with an unknown north as far as the walk has come, and no farther.
"""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.frames import UNKNOWN_RAD

FLOOR_UT = 7.0  # sigma_0: per axis, at the height of a foot over a reinforced floor.
FLOOR_WEIGHT = 5.0  # n_0: how many footfalls that is worth.
FLOOR_LENGTH_M = 1.5  # L: a quarter of the longest waves in such a floor, which are 1 to 6 m long.
ROOM_SHARE = 0.3  # c: by how much rooms turn the field, as a share of how it differs between footfalls.
ROOM_LENGTH_M = 20.0  # L_r.


def find_north_sigma(across_uT: Floats, walked_m: float, strength_uT: float) -> float:
    """Sigma of north, rad.

    Parameters
    ----------
    across_uT : (n,) deviations of the field across its mean, at the footfalls where it was seen.
    walked_m : length of the path.
    strength_uT : horizontal field of the walk.
    """
    freedom = FLOOR_WEIGHT + max(len(across_uT) - 1, 0)
    variance = (FLOOR_WEIGHT * FLOOR_UT**2 + float(np.sum(across_uT**2))) / freedom
    left = average_along(walked_m / FLOOR_LENGTH_M) + ROOM_SHARE**2 * average_along(walked_m / ROOM_LENGTH_M)
    across = float(np.sqrt(variance * left))
    return UNKNOWN_RAD if across >= UNKNOWN_RAD * strength_uT else across / strength_uT


def average_along(lengths: float) -> float:
    """Variance v of the mean of a process of unit variance over so many correlation lengths."""
    if lengths < SHORT:
        return 1.0 - lengths / 3.0
    return float(2.0 * (lengths - 1.0 + np.exp(-lengths)) / lengths**2)


SHORT = 1e-4  # Lengths over which v is its Taylor series: the closed form loses its digits there.


def extend_with_north(pose_cov: Floats, position: Floats, sigma: float) -> Floats:
    """Return the covariance (4, 4) of a pose with that of north, as far as its heading does not have it already.

    Parameters
    ----------
    pose_cov : of east, north, up and yaw, as in `StanceEstimate`.
    position : (3,) m from the origin of the walk.
    sigma : of north, rad.
    """
    s2 = max(sigma**2 - float(pose_cov[3, 3]), 0.0)
    east, north = position[:2]
    across, along = np.array([-north, east, 0.0, 0.0]), np.array([-east, -north, 0.0, 0.0])
    turn = np.array([0.0, 0.0, 0.0, 1.0])
    by_sin, by_cos = np.exp(-s2 / 2.0), np.exp(-2.0 * s2)
    both = s2 * by_sin * np.outer(turn, across)
    return np.asarray(
        pose_cov
        + s2 * np.outer(turn, turn)
        + both
        + both.T
        + 0.5 * (1.0 - by_cos) * np.outer(across, across)
        + (1.5 - 2.0 * by_sin + 0.5 * by_cos) * np.outer(along, along)
    )
