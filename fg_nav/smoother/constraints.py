"""What is known of a walk beyond its sensor: fixes, and the level floors of buildings.

Fixes are in the walk's own frame, with its start at the origin: where the walk began remains known. That it began in
this heading does not, as any fix away from the start shows it as well, with

    sigma^-2 = sum |fix - start|^2 / sigma_fix^2    over ground, rad^-2.

A heading that was given becomes a prior of some degrees as soon as the fixes show more. Where none was given, the walk
is first turned about its start to where it fits the fixes best, and then its heading is free. A fix is tied to the node
nearest in time. Between the two the foot moves on, at walking pace on the mean; its sigma grows by as much.

Floors (`factors.FloorHeight`), where the walk shows them (`floors.find_floors`). Each has its height Z as a variable.
Factors from footfall to footfall would do without, but sum up to a walk of their own: after a thousand strides a floor
of factors of 2 cm is as steep as 0.6 m. A variable costs one row in each clique between the first footfall on a floor
and the last.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import gtsam
import numpy as np
from gtsam.symbol_shorthand import S, X, Z

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.errors import EstimationError
from fg_nav.factors.residual import ResidualBlock
from fg_nav.factors.walk_constraints import FloorHeight, position_fix_factor, position_fix_noise
from fg_nav.factors.zero_velocity import StanceVelocity
from fg_nav.fix_check import FIX_REACH_S, check_fix, check_fixes_on_path, check_times
from fg_nav.frames import yaw_rotation
from fg_nav.samples.gaps import MAX_HELD_S, cross_holes
from fg_nav.smoother.floors import LEVEL_SIGMA_M, Ground, find_floors
from fg_nav.smoother.graph import UNKNOWN_HEADING_DEG, StartPrior, WalkProblem, turn_walk
from fg_nav.smoother.own_factors import ExtraFactors, GraphNodes, make_own_factors
from fg_nav.smoother.solver import GtsamFactors, list_positions
from fg_nav.smoother.strides import Nodes
from fg_nav.truth import Fix

DRIFT_FLOOR_M = 0.003  # What a walk shows of its climb a stride is no truer: on stairs it is another than on the level.

GIVEN_HEADING_DEG = 5.0
"""Sigma of the heading at the start that was given, where fixes show it as well: a compass held by hand, or a line
on a plan. Fixes show it once they leave a smaller one."""

FIX_SPEED_M_S = 1.4  # Walking pace: for so much a second between a fix and the node it is tied to its sigma grows.
MIN_KNOWN_HEADING_RAD = 1.0  # Sigma that fixes leave of the heading at the start beyond which they show nothing of it.


class FixFactors(GtsamFactors):
    """Factors of fixes, which are counted as such."""


@dataclass(frozen=True)
class PinnedFixes:
    """Fixes at their nodes: `node` (K,), `position` (K, 3) m, `horizontal` and `vertical` (K,) sigmas, m."""

    node: Ints
    position: Floats
    horizontal: Floats
    vertical: Floats

    def __len__(self) -> int:
        return len(self.node)

    def factors(self) -> FixFactors:
        """Tie the nodes to their fixes."""
        return FixFactors(
            *(
                position_fix_factor(X(int(j)), at, position_fix_noise(float(horizontal), float(vertical)))
                for j, at, horizontal, vertical in zip(
                    self.node, self.position, self.horizontal, self.vertical, strict=True
                )
            )
        )

    @property
    def heading_sigma(self) -> float:
        """Sigma that the fixes leave of the heading at the start, rad; infinite where all are at the start."""
        information = float((np.hypot(*self.position.T[:2]) ** 2 / self.horizontal**2).sum())
        return information**-0.5 if information else float("inf")

    def best_turn(self, values: gtsam.Values) -> float:
        """Turn about up and the start, rad counter-clockwise, that brings a walk nearest to its fixes."""
        walked = list_positions(self.node, values)
        weight = self.horizontal**-2.0
        across = weight @ (walked[:, 0] * self.position[:, 1] - walked[:, 1] * self.position[:, 0])
        along = weight @ (walked[:, :2] * self.position[:, :2]).sum(axis=1)
        return float(np.arctan2(across, along))


def fix_factors(fixes: Sequence[Fix], t: Floats, nodes: Nodes) -> PinnedFixes:
    """Find the node of each fix.

    Raises
    ------
    EstimationError
        For a fix outside the walk or farther than a stride from any node, or one without a place or a sigma.
    """
    return pin_to_times(fixes, t[nodes.sample])


def pin_to_times(fixes: Sequence[Fix], t_node: Floats) -> PinnedFixes:
    """Find the node of each fix among nodes at these times (n,) s; errors as of `fix_factors`."""
    node = [_node_of(fix, t_node) for fix in fixes]
    apart = np.array([fix.time_s - t_node[j] for fix, j in zip(fixes, node, strict=True)])
    return PinnedFixes(
        np.array(node, dtype=np.intp),
        np.array([fix.position for fix in fixes], dtype=np.float64).reshape(-1, 3),
        np.hypot([fix.horizontal_sigma_m for fix in fixes], FIX_SPEED_M_S * apart),
        np.array([fix.vertical_sigma_m for fix in fixes], dtype=np.float64),
    )


def find_nearest_nodes(t: Floats, t_node: Floats) -> Ints:
    """Nodes (K,) nearest to instants (K,) s, among those at `t_node` (n,) s."""
    return np.asarray(np.abs(t[:, None] - t_node).argmin(axis=1))


def _node_of(fix: Fix, t_node: Floats) -> int:
    """Index of the node nearest to a fix in time."""
    check_fix(fix)
    check_times([fix], float(t_node[0]), float(t_node[-1]))
    apart = np.abs(t_node - fix.time_s)
    if apart.min() > FIX_REACH_S:
        raise EstimationError(
            f"the fix at {fix.time_s:.2f} s is {apart.min():.1f} s from the nearest footfall, which is farther than a "
            "stride: take fixes where the foot stands, or leave it out."
        )
    return int(apart.argmin())


def check_fix_distance(problem: WalkProblem, fixes: Sequence[Fix]) -> None:
    """Refuse fixes that the path of a first solution does not reach; raises `EstimationError`."""
    footfall, t = problem.nodes.result, problem.recording.t
    sample, step = problem.nodes.sample[footfall], np.diff(t, prepend=t[0])
    unseen_s = np.cumsum(np.where(step > MAX_HELD_S, step, 0.0))
    check_fixes_on_path(fixes, t[sample], list_positions(footfall, problem.values), unseen_s[sample])


def add_fixes(problem: WalkProblem, values: gtsam.Values, fixes: Sequence[Fix]) -> WalkProblem:
    """Add fixes to a walk, on its first solution.

    Where the fixes show the heading at the start better than it was given, it gets a sigma. Where it was not given, the
    walk is first turned, in place, to where it fits them best.

    Raises
    ------
    EstimationError
        As `fix_factors`.
    """
    pinned = fix_factors(fixes, problem.recording.t, problem.nodes)
    problem = replace(problem, constraints=(*problem.constraints, pinned.factors()))
    start = free_heading(problem, pinned, values)
    return problem if start is None else replace(problem, start=start, heading_known=True)


def add_own(problem: WalkProblem, values: gtsam.Values, extra: ExtraFactors) -> WalkProblem:
    """Add the caller's own factors to a walk, on its first solution; the heading at the start as with fixes.

    Raises
    ------
    EstimationError
        As `make_own_factors`.
    """
    own = make_own_factors(extra, GraphNodes.of(problem.nodes, problem.recording.t, values))
    problem = replace(problem, constraints=(*problem.constraints, own))
    start = free_heading(problem, own, values)
    return problem if start is None else replace(problem, start=start, heading_known=True)


class ShowsHeading(Protocol):
    """What may show the heading at the start: the sigma that it leaves, and where a walk fits it best."""

    @property
    def heading_sigma(self) -> float:
        """Sigma left of the heading at the start, rad."""

    def best_turn(self, values: gtsam.Values) -> float:
        """Turn about up and the start, rad counter-clockwise."""


def free_heading(problem: WalkProblem, pinned: ShowsHeading, values: gtsam.Values) -> StartPrior | None:
    """Return the start with a heading to be found, where it is shown; None where it stays as it is."""
    nav_R_body = problem.start.nav_R_body
    if problem.heading_known:
        sigma = float(np.radians(GIVEN_HEADING_DEG))
        is_shown = pinned.heading_sigma < sigma and problem.start.heading_sigma < sigma
        return StartPrior(nav_R_body, sigma) if is_shown else None
    if pinned.heading_sigma > MIN_KNOWN_HEADING_RAD:
        return None
    turn = pinned.best_turn(values)
    turn_walk(values, problem.nodes, turn)
    return StartPrior(yaw_rotation(turn) @ nav_R_body, float(np.radians(UNKNOWN_HEADING_DEG)))


def add_constraints(problem: WalkProblem, values: gtsam.Values, continues: Bools | None = None) -> WalkProblem:
    """Add the floors found on a first solution, into whose values they are put.

    `continues` (F,) are the footfalls that are further pieces of a standing: no stride leads to them.
    """
    p, nodes = problem.parameters, problem.nodes
    if not p.walk.floors:
        return problem
    position = list_positions(nodes.result, values)
    t, footfall = problem.recording.t, nodes.sample[nodes.result]
    stepped = np.ones(len(footfall), dtype=np.bool_) if continues is None else ~continues
    floor, ground = find_floors_of_pieces(t, footfall, position, stepped, p.settling_sigma_m)
    for number in range(floor.max(initial=-1) + 1):
        values.insert(Z(number), np.array([position[floor == number, 2].mean()]))
    heights = constrain_heights(nodes.result, floor, LEVEL_SIGMA_M)
    climb = () if ground is None else measure_excess(problem, values, ground, np.diff(t[footfall])[stepped[1:]])
    return replace(problem, constraints=(*problem.constraints, heights, *climb), floor=floor)


def measure_excess(
    problem: WalkProblem, values: gtsam.Values, ground: Ground, stride_s: Floats
) -> tuple[GtsamFactors, ...]:
    """Return what the ground shows of the excess S of the soles, in strides of these durations (K,) s.

    An excess S lifts each stride by S (duration of the stride) / (time in which the sole settles). What the path at
    `values` climbs is beyond the S that it has there.
    """
    ties = problem.velocities.residuals
    assert isinstance(ties, StanceVelocity)
    sinks_per_m = ties.sinks_per_m[ties.sinks_per_m > 0.0]
    if not len(sinks_per_m) or not len(stride_s):
        return ()
    lift = float(np.median(sinks_per_m) * np.median(stride_s))
    sigma = np.hypot(ground.drift_sigma, DRIFT_FLOOR_M) / lift
    noise = gtsam.noiseModel.Isotropic.Sigma(1, float(sigma))
    middle = S(int(problem.nodes.bias[-1]) // 2)
    return (GtsamFactors(gtsam.PriorFactorVector(middle, values.atVector(middle) + ground.drift / lift, noise)),)


def find_floors_of_pieces(
    t: Floats, footfall: Ints, position: Floats, stepped: Bools, settling_sigma_m: float
) -> tuple[Ints, Ground | None]:
    """Return the floor (F,) of each footfall; one that was not stepped to is on that of the footfall before.

    `t` (N,) s are the recording's stamps, `footfall` (F,) samples; the others, and the ground, as of `find_floors`.
    """
    first = np.flatnonzero(stepped | (np.arange(len(stepped)) == 0))
    holes = cross_holes(t, footfall[first])
    found, ground = find_floors(t[footfall[first]], position[first], settling_sigma_m, holes)
    return found[np.searchsorted(first, np.arange(len(stepped)), side="right") - 1], ground


def constrain_heights(node: Ints, label: Ints, sigma_m: float) -> ResidualBlock:
    """Keep footfalls at `node` (F,) at the heights of their floors `label` (F,), -1 on none."""
    on_floor = np.flatnonzero(label >= 0)
    return ResidualBlock(FloorHeight(sigma_m), [(X(int(node[k])), Z(int(label[k]))) for k in on_floor])
