"""Factors between footfalls of a walk that follow the directions of a building (`factors.BuildingDirection`).

Between footfalls one stride apart a course is some degrees off on the straightest walk, as feet are set down beside the
line, and these errors cancel from one stride to the next. So displacements are `STRIDES` long, and share no stride. A
corner that begins within the last stride of one turns its course by a few degrees, which passes for a corridor, and
does not cancel where a walk turns one way more often than the other: no footfall may stand farther off the line between
the ends than people weave. Displacements lie in the middle of such a straight stretch.

Courses along one leg have the error of its corridor in common. A leg counts as `LEG_COURSES` of them at most, of
2 deg each 1.2 deg; a corridor that is walked again counts again.
"""

from __future__ import annotations

from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam.symbol_shorthand import A, X
from numpy.lib.stride_tricks import sliding_window_view

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.factors.residual import ResidualBlock
from fg_nav.factors.walk_constraints import BuildingDirection, odds_of_elsewhere
from fg_nav.frames import wrap_angle
from fg_nav.smoother.solver import GtsamFactors, LinearizableBlock

STRIDES = 5  # Of a displacement: 7 m, over which weaving by 7 cm is 0.8 deg (0.07 sqrt(2) / 7 rad).
MIN_M = 2.5  # Displacements below this have no course of a walk: half a metre a stride.

STRAIGHT_WITHIN_M = 0.15
"""Off the line between its ends within which a displacement is straight: two sigmas of weaving by 7 cm."""

LEG_COURSES = 3.0  # Independent courses that a leg counts as at most.
NEW_LEG_RAD = np.radians(22.5)  # Change of course that begins another leg: a quarter of what is between two directions.

OPEN_RAD = 2.0 * np.pi
"""Sigma of the prior of a direction: a full turn, as much as the heading may be open behind a hole in the samples."""


@dataclass(frozen=True)
class Mixture:
    """What courses do: `share` P of them follow the building's directions, with `sigma` s, rad."""

    sigma: float
    share: float


@dataclass(frozen=True)
class DirectionFactors:
    """Factors of the courses of a walk, and priors that leave the direction of each of its `pieces` open."""

    courses: ResidualBlock
    priors: GtsamFactors
    pieces: int

    def __len__(self) -> int:
        return len(self.courses)

    @property
    def blocks(self) -> tuple[LinearizableBlock, ...]:
        """Both, to be linearized."""
        return self.courses, self.priors


def make_direction_factors(node: Ints, piece: Ints, share: Floats, alpha: Floats, mixture: Mixture) -> DirectionFactors:
    """Tie pairs of nodes (M, 2) to the directions A(k) + m pi/2 of their piece k of the walk.

    Parameters
    ----------
    node, piece : (M, 2), (M,) of the displacements.
    share : (M,) that each counts for.
    alpha : (n,) rad of the pieces, to start from.
    """
    courses = BuildingDirection(mixture.sigma, odds_of_elsewhere(mixture.sigma, mixture.share), share)
    wide = gtsam.noiseModel.Isotropic.Sigma(1, OPEN_RAD)
    priors = (gtsam.PriorFactorVector(A(k), np.array([one]), wide) for k, one in enumerate(alpha))
    keys = [(X(int(a)), X(int(b)), A(int(k))) for (a, b), k in zip(node, piece, strict=True)]
    return DirectionFactors(ResidualBlock(courses, keys), GtsamFactors(*priors), len(alpha))


def list_displacements(position: Floats) -> Ints:
    """List the first and last footfalls (M, 2) of straight displacements of footfalls at `position` (F, 3) m."""
    if len(position) <= STRIDES:
        return np.zeros((0, 2), dtype=np.int64)
    straight = np.flatnonzero(find_straight(position))
    runs = np.split(straight, np.flatnonzero(np.diff(straight) > 1) + 1) if len(straight) else []
    first: Ints = np.concatenate([np.zeros(0, dtype=np.int64), *map(_fill_run, runs)])
    return np.asarray(first[:, None] + np.array([0, STRIDES]))


def _fill_run(straight: Ints) -> Ints:
    """First footfalls of displacements, in the middle of a stretch along which these ones (n,) begin straight ones."""
    strides = len(straight) + STRIDES - 1
    return np.asarray(straight[0] + strides % STRIDES // 2 + STRIDES * np.arange(strides // STRIDES))


def find_straight(position: Floats) -> Bools:
    """Find whether the `STRIDES` strides from each footfall on, but for the last ones, go straight on over ground."""
    places = np.moveaxis(sliding_window_view(position[:, :2], STRIDES + 1, axis=0), 2, 1)
    from_first = places - places[:, :1]
    along = from_first[:, -1:]
    across = from_first[..., 0] * along[..., 1] - from_first[..., 1] * along[..., 0]
    length = np.linalg.norm(along, axis=2)
    off = np.abs(across).max(axis=1) / np.maximum(length[:, 0], MIN_M)
    return np.asarray((length[:, 0] >= MIN_M) & (off <= STRAIGHT_WITHIN_M))


def share_legs(course: Floats) -> Floats:
    """Share (M,) that each course (M,) rad counts for: those of a leg, in a row, for `LEG_COURSES` at most."""
    leg = np.cumsum(np.abs(wrap_angle(np.diff(course, prepend=course[:1]))) > NEW_LEG_RAD)
    return np.asarray(np.minimum(1.0, LEG_COURSES / np.bincount(leg)[leg]))
