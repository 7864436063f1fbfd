"""Factors between the footfalls of a walk and places that are known from an earlier one (`fg_nav.places.location`).

The walk is solved in axes of the known frame, about its start as located there. A known place q (3,) m, c (3,) m from a
footfall in body axes, is

    e = p + R c - q,

p and R the pose of the footfall, with the covariance of a tie: sharp along the path, as wide as a corridor across it.
Start and heading are then no gauge any more. They get priors that say nothing, `UNKNOWN_PLACE_M` and
`UNKNOWN_HEADING_DEG`, and the sigmas of the solution are those of the places in the known frame.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import X

from fg_nav.arrays import Floats
from fg_nav.smoother.constraints import find_nearest_nodes
from fg_nav.smoother.graph import UNKNOWN_HEADING_DEG, StartPrior, WalkProblem
from fg_nav.smoother.solver import GtsamFactors

UNKNOWN_PLACE_M = 100.0  # Sigma of the start where known places show it: more than a location is ever off.


@dataclass(frozen=True)
class KnownTies:
    """Footfalls at known places.

    `t` (P,) s, `in_body` (P, 3) m the point next to each footfall, `place` (P, 3) m where it is, east, north and up of
    the located start in the axes of the known frame, `covariance` (P, 3, 3) m^2.
    """

    t: Floats
    in_body: Floats
    place: Floats
    covariance: Floats


class KnownPlaceFactors(GtsamFactors):
    """Factors of known places, which are counted as such."""


def add_known_places(problem: WalkProblem, ties: KnownTies) -> WalkProblem:
    """Tie a walk to known places, and free its start."""
    nodes = find_nearest_nodes(ties.t, problem.recording.t[problem.nodes.sample])
    rows = zip(nodes, ties.place, ties.in_body, ties.covariance, strict=True)
    factors = KnownPlaceFactors(
        *(
            gtsam.GPSFactorArm(X(int(j)), place, arm, gtsam.noiseModel.Gaussian.Covariance(covariance))
            for j, place, arm, covariance in rows
        )
    )
    start = StartPrior(problem.start.nav_R_body, float(np.radians(UNKNOWN_HEADING_DEG)), UNKNOWN_PLACE_M)
    return replace(problem, constraints=(*problem.constraints, factors), start=start, heading_known=True)
