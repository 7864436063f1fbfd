"""What is known of a walk beyond its sensor: fixes, own factors, known places, a satellite receiver.

Fixes are in the walk's own frame, with its start at the origin; its heading there is shown by any fix away from it,

    sigma^-2 = sum |fix - start|^2 / sigma_fix^2    over ground, rad^-2.

A heading that was given becomes a prior of some degrees as soon as the fixes show more; where none was given, the walk
is first turned to where it fits them best. A fix is tied to the node nearest in time, with the sigma of a walk between.

Own factors, a graph of gtsam, join where fixes do, on the first solution. Their information on the heading is that on a
turn of the walk about its start: with A d the change of their residuals over their sigmas for a turn d of one radian,

    sigma^-2 = |A d|^2,     d = (R^T u, R^T (u x p)) of a pose, u x v of a velocity, 0 of a bias, u up,

which for fixes is the formula above. A robust noise model is linearized by the weight that it has there (iteratively
reweighted least squares); the solver takes the `excess` of its loss over that into account.

Known places (`fg_nav.places.location`): e = p + R c - q, q (3,) m the place in the known frame about the start as
located there, c (3,) m its point from a footfall in body axes, with the covariance of a tie. Start and heading are no
gauge any more, and get priors without information.

Satellite fixes are own factors, e = p_j + s - q_k over ground with Cauchy's loss: p_j the footfall nearest in time, q_k
the fix, s the start in the axes of the fixes, which with its turn lays the first solution on them best.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, V, X

from fg_nav.arrays import Brief, Floats, Ints
from fg_nav.errors import EstimationError
from fg_nav.factors.walk_constraints import position_fix_noise
from fg_nav.frames import yaw_rotation
from fg_nav.samples.gaps import MAX_HELD_S
from fg_nav.smoother.graph import (
    GAUGE_SIGMA,
    KNOWN_PLACE,
    OWN,
    POSITION_FIX,
    UNKNOWN_HEADING_DEG,
    StartPrior,
    WalkProblem,
    turn_walk,
)
from fg_nav.smoother.solver import GtsamFactors, list_positions
from fg_nav.smoother.strides import Nodes
from fg_nav.truth import (
    CAUCHY,
    FIX_REACH_S,
    FIX_SPEED_M_S,
    Fix,
    Gnss,
    check_fix,
    check_fixes_on_path,
    check_times,
    describe_start,
    find_turn,
    select_fixes,
)

TURNS = 24  # Directions of the start that are tried: 15 deg apart, from which Gauss-Newton finds the rest.
UP = np.array([0.0, 0.0, 1.0])
GIVEN_HEADING_DEG = 5.0  # Sigma of a given heading where fixes show it as well: a compass held by hand, a plan.
MIN_KNOWN_HEADING_RAD = 1.0  # Sigma that fixes leave of the heading at the start beyond which they show nothing of it.
UNKNOWN_PLACE_M = 100.0  # Sigma of the start where known places show it: more than a location is ever off.


@dataclass(frozen=True)
class GraphNodes(Brief):
    """The variables of a walk that a factor can join: M nodes, where the foot stands, several in each stance.

    Attributes
    ----------
    t : (M,) s, in the recording's time.
    pose : M keys of `gtsam.Pose3`, nav_T_body: east, north, up in m from the first stance.
    velocity : M keys of vectors (3,), m/s, navigation frame.
    bias : M keys of `gtsam.imuBias.ConstantBias`, m/s^2 and rad/s, body frame; footfalls of ten seconds share one.
    footfall : (M,) number of the footfall that the node belongs to, from 0.
    stillest : (F,) node of each footfall at its stillest sample, where results are given.
    values : all variables of the walk without these factors, near its minimum: to place them. A copy.

    Examples
    --------
    >>> import gtsam
    >>> def at_the_door(nodes: fg_nav.GraphNodes) -> gtsam.NonlinearFactorGraph:
    ...     graph = gtsam.NonlinearFactorGraph()
    ...     sigmas = gtsam.noiseModel.Diagonal.Sigmas([0.1, 0.1, 10.0])
    ...     graph.add(gtsam.GPSFactor(nodes.pose[nodes.at(18.0)], [10.3, 7.7, 0.0], sigmas))
    ...     return graph
    >>> result = fg_nav.navigate("walk.csv", extra=at_the_door)
    >>> bool(result.stances.position_sigma[-1, 0] < 1.0)
    True
    """

    t: Floats
    pose: tuple[int, ...]
    velocity: tuple[int, ...]
    bias: tuple[int, ...]
    footfall: Ints
    stillest: Ints
    values: gtsam.Values

    @classmethod
    def of(cls, nodes: Nodes, t: Floats, values: gtsam.Values) -> GraphNodes:
        """Take those of a walk, `t` (N,) s the stamps of its recording."""
        count = range(len(nodes))
        bias = tuple(B(int(k)) for k in nodes.bias[nodes.footfall])
        pose, velocity = tuple(map(X, count)), tuple(map(V, count))
        return cls(t[nodes.sample], pose, velocity, bias, nodes.footfall, nodes.result, gtsam.Values(values))

    def at(self, time_s: float) -> int:
        """Return the number of the node nearest to an instant; `EstimationError` more than 1.5 s from any."""
        apart = np.abs(self.t - time_s)
        if not apart.min() <= FIX_REACH_S:
            raise EstimationError(
                f"there is no node within {FIX_REACH_S:g} s of {time_s:.2f} s: the walk lasts from {self.t[0]:.2f} s "
                f"to {self.t[-1]:.2f} s, and has nodes where the foot stands."
            )
        return int(apart.argmin())


ExtraFactors: TypeAlias = Callable[[GraphNodes], gtsam.NonlinearFactorGraph]
"""Makes the caller's own factors. It is called again whenever a walk is built again, with nodes that may differ."""


class OwnFactors(GtsamFactors):
    """The caller's factors in the graph of a walk."""

    def __init__(self, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> None:
        super().__init__(*(graph.at(i) for i in range(graph.size())), kind=OWN)
        # Information on a turn of the walk about its start, by second differences of the linearized error.
        linear = self._graph.linearize(values)
        forth, here, back = (linear.error(_move(self._graph, values, turn)) for turn in (1.0, 0.0, -1.0))
        information = float(forth - 2.0 * here + back)
        # Sigma that they leave of the heading at the start, rad; infinite where they show nothing of it.
        self.heading_sigma = information**-0.5 if information > 0.0 else float("inf")

    def excess(self, values: gtsam.Values) -> float:
        """Robust-loss excess; zero for quadratic factors."""
        linear = self._graph.linearize(values)
        return self.error(values) - linear.error(_move(self._graph, values, 0.0))

    def best_turn(self, values: gtsam.Values) -> float:
        """Return the turn about up at the start, rad counter-clockwise, with the least error, of a grid of `TURNS`."""
        turns = np.linspace(0.0, 2 * np.pi, TURNS, endpoint=False)
        errors = list[float]()
        for turn in yaw_rotation(turns):
            turned, about = gtsam.Values(), gtsam.Pose3(gtsam.Rot3(turn), np.zeros(3))
            for key in self._graph.keyVector():
                letter = gtsam.Symbol(key).chr()
                if letter == ord("x"):
                    turned.insert(key, about.compose(values.atPose3(key)))
                elif letter == ord("v"):
                    turned.insert(key, turn @ values.atVector(key))
                else:
                    turned.insert(key, values.atConstantBias(key))
            errors.append(self.error(turned))
        return float(turns[int(np.nanargmin(errors))])


def make_own_factors(extra: ExtraFactors, nodes: GraphNodes) -> OwnFactors:
    """Make the caller's factors; `EstimationError` if they join no variable of the walk or cannot be evaluated."""
    graph = extra(nodes)
    if not isinstance(graph, gtsam.NonlinearFactorGraph):
        raise EstimationError(f"extra returned a {type(graph).__name__}: return a gtsam.NonlinearFactorGraph.")
    known = {*nodes.pose, *nodes.velocity, *nodes.bias}
    for i in range(graph.size()):
        factor: gtsam.NonlinearFactor | None = graph.at(i)
        joins = [] if factor is None else factor.keys()
        if factor is None or not joins:
            raise EstimationError(f"extra factor {i} joins no variable: leave it out.")
        for key in joins:
            if key not in known:
                raise EstimationError(
                    f"extra factor {i} joins {gtsam.DefaultKeyFormatter(key)}, which is no variable of this walk: use "
                    "the keys in pose, velocity and bias of the nodes."
                )
        try:
            error = factor.error(nodes.values)
            linear = factor.linearize(nodes.values)
            if linear is not None:  # one that is not active there
                gtsam.JacobianFactor(linear)
        except Exception as reason:
            words = " ".join(str(reason).split()).rstrip(".")
            raise EstimationError(f"extra factor {i} cannot be linearized ({words}): correct it.") from reason
        if not np.isfinite(error):
            raise EstimationError(
                f"the error of extra factor {i} is {error}: give finite measurements and sigmas above zero."
            )
    return OwnFactors(graph, nodes.values)


def _move(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, turn: float) -> gtsam.VectorValues:
    """Return the tangent-space increments of the variables for a turn (rad) of the walk about its start, linearized."""
    moved = gtsam.VectorValues()
    for key in graph.keyVector():
        letter = gtsam.Symbol(key).chr()
        step = np.zeros(6)
        if letter == ord("x"):
            pose = values.atPose3(key)
            R = pose.rotation().matrix()
            step = np.concatenate([R.T @ UP, R.T @ np.cross(UP, pose.translation())])
        elif letter == ord("v"):
            step = np.cross(UP, values.atVector(key))
        moved.insert(key, turn * step)
    return moved


@dataclass(frozen=True)
class PinnedFixes:
    """Fixes at their nodes: `node` (K,), `position` (K, 3) m, `horizontal` and `vertical` (K,) sigmas, m."""

    node: Ints
    position: Floats
    horizontal: Floats
    vertical: Floats

    def factors(self) -> GtsamFactors:
        """Tie the nodes to their fixes."""
        return GtsamFactors(
            *(
                gtsam.GPSFactor(X(int(j)), at, position_fix_noise(float(horizontal), float(vertical)))
                for j, at, horizontal, vertical in zip(
                    self.node, self.position, self.horizontal, self.vertical, strict=True
                )
            ),
            kind=POSITION_FIX,
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


def select_reached_fixes(fixes: Sequence[Fix], t_node: Floats, after_s: float = -np.inf) -> tuple[Fix, ...]:
    """Return the fixes after a time and up to the last of some nodes (n,) s that have one of them within reach."""
    return tuple(
        fix
        for fix in fixes
        if after_s < fix.time_s <= t_node[-1] and float(np.abs(t_node - fix.time_s).min()) <= FIX_REACH_S
    )


def pin_to_times(fixes: Sequence[Fix], t_node: Floats) -> PinnedFixes:
    """Find the node of each fix, nearest in time among nodes at these times (n,) s.

    Raises `EstimationError` for a fix outside the walk, far from any node, or without a place or a sigma.
    """
    node = np.zeros(len(fixes), dtype=np.intp)
    for k, fix in enumerate(fixes):
        check_fix(fix)
        check_times([fix], float(t_node[0]), float(t_node[-1]))
        off = np.abs(t_node - fix.time_s)
        if off.min() > FIX_REACH_S:
            raise EstimationError(
                f"the fix at {fix.time_s:.2f} s is {off.min():.1f} s from the nearest footfall, which is farther than "
                "a stride: take fixes where the foot stands, or leave it out."
            )
        node[k] = off.argmin()
    apart = np.array([fix.time_s for fix in fixes], dtype=np.float64) - t_node[node]
    return PinnedFixes(
        node,
        np.array([fix.position for fix in fixes], dtype=np.float64).reshape(-1, 3),
        np.hypot([fix.horizontal_sigma_m for fix in fixes], FIX_SPEED_M_S * apart),
        np.array([fix.vertical_sigma_m for fix in fixes], dtype=np.float64),
    )


def find_nearest_nodes(t: Floats, t_node: Floats) -> Ints:
    """Nodes (K,) nearest to instants (K,) s, among those at `t_node` (n,) s."""
    return np.asarray(np.abs(t[:, None] - t_node).argmin(axis=1))


def check_fix_distance(problem: WalkProblem, fixes: Sequence[Fix]) -> None:
    """Refuse fixes that the path of a first solution does not reach; raises `EstimationError`."""
    footfall, t = problem.nodes.result, problem.recording.t
    sample, step = problem.nodes.sample[footfall], np.diff(t, prepend=t[0])
    unseen_s = np.cumsum(np.where(step > MAX_HELD_S, step, 0.0))
    check_fixes_on_path(fixes, t[sample], list_positions(footfall, problem.values), unseen_s[sample])


def add_fixes(problem: WalkProblem, values: gtsam.Values, fixes: Sequence[Fix]) -> WalkProblem:
    """Add fixes to a walk, on its first solution, with the heading at the start as they show it."""
    pinned = pin_to_times(fixes, problem.recording.t[problem.nodes.sample])
    problem = problem.join(pinned.factors())
    if fixes[0].origin is None:
        return _free_heading(problem, pinned, values)
    # Fixes about another place than the start: it is free, at first where the walk lies on them best.
    weight, is_high = pinned.horizontal**-2.0, np.isfinite(pinned.vertical)
    middle = np.append(weight @ pinned.position[:, :2] / weight.sum(), 0.0)
    problem = _free_heading(problem, replace(pinned, position=pinned.position - middle), values)
    off = pinned.position - list_positions(pinned.node, values)
    shift = np.append(weight @ off[:, :2] / weight.sum(), off[is_high, 2].mean() if is_high.any() else 0.0)
    for key in map(X, range(len(problem.nodes))):
        pose = values.atPose3(key)
        values.update(key, gtsam.Pose3(pose.rotation(), pose.translation() + shift))
    sigma = UNKNOWN_PLACE_M, UNKNOWN_PLACE_M, UNKNOWN_PLACE_M if is_high.any() else GAUGE_SIGMA
    return replace(problem, start=replace(problem.start, place=values.atPose3(X(0)).translation(), place_sigma=sigma))


def add_own(problem: WalkProblem, values: gtsam.Values, extra: ExtraFactors) -> WalkProblem:
    """Add the caller's own factors to a walk, on its first solution; the heading at the start as with fixes."""
    own = make_own_factors(extra, GraphNodes.of(problem.nodes, problem.recording.t, values))
    return _free_heading(problem.join(own), own, values)


def _free_heading(problem: WalkProblem, placed: PinnedFixes | OwnFactors, values: gtsam.Values) -> WalkProblem:
    """Return the problem with its start heading free where fixes show it; an unknown one is first turned to fit."""
    nav_R_body = problem.start.nav_R_body
    if problem.heading_known:
        sigma = float(np.radians(GIVEN_HEADING_DEG))
        if not placed.heading_sigma < sigma or not problem.start.heading_sigma < sigma:
            return problem
        return replace(problem, start=StartPrior(nav_R_body, sigma))
    if placed.heading_sigma > MIN_KNOWN_HEADING_RAD:
        return problem
    turn = placed.best_turn(values)
    turn_walk(values, problem.nodes, turn)
    start = StartPrior(yaw_rotation(turn) @ nav_R_body, float(np.radians(UNKNOWN_HEADING_DEG)))
    return replace(problem, start=start, heading_known=True)


@dataclass(frozen=True)
class KnownTies(Brief):
    """Footfalls at known places, in the axes of the known frame about the located start."""

    t: Floats  # (P,) s.
    in_body: Floats  # (P, 3) m, the point next to each footfall.
    place: Floats  # (P, 3) m, where it is, east, north and up.
    covariance: Floats  # (P, 3, 3) m^2.


def add_known_places(problem: WalkProblem, ties: KnownTies) -> WalkProblem:
    """Tie a walk to known places, and free its start."""
    nodes = find_nearest_nodes(ties.t, problem.recording.t[problem.nodes.sample])
    rows = zip(nodes, ties.place, ties.in_body, ties.covariance, strict=True)
    factors = GtsamFactors(
        *(
            gtsam.GPSFactorArm(X(int(j)), place, arm, gtsam.noiseModel.Gaussian.Covariance(covariance))
            for j, place, arm, covariance in rows
        ),
        kind=KNOWN_PLACE,
    )
    start = StartPrior(problem.start.nav_R_body, float(np.radians(UNKNOWN_HEADING_DEG)), UNKNOWN_PLACE_M)
    return replace(problem.join(factors), start=start, heading_known=True)


def make_gnss_factors(gnss: Gnss) -> tuple[ExtraFactors, dict[str, float]]:
    """Return the factory of GNSS factors, and a dict that it fills with the geodetic start of the walk."""
    found: dict[str, float] = {}

    def make(nodes: GraphNodes) -> gtsam.NonlinearFactorGraph:
        # the start, and with it the axes of the walk
        seen = select_fixes(gnss.fixes, float(nodes.t[0]), float(nodes.t[-1]))
        node = find_nearest_nodes(seen.time, nodes.t)
        walked = list_positions(node, nodes.values)[:, :2]
        turn, start = find_turn(walked, seen)
        # the factors
        sigma = np.hypot(seen.sigma, FIX_SPEED_M_S * (seen.time - nodes.t[node]))
        loss = gtsam.noiseModel.mEstimator.Cauchy.Create(CAUCHY)
        graph = gtsam.NonlinearFactorGraph()
        for j, place, own in zip(node, seen.place - start, sigma, strict=True):
            noise = gtsam.noiseModel.Robust.Create(loss, position_fix_noise(float(own)))
            graph.add(gtsam.GPSFactor(nodes.pose[int(j)], np.array([*place, 0.0]), noise))
        off = np.linalg.norm(seen.place - start - walked @ yaw_rotation(turn)[:2, :2].T, axis=1)
        found.update(describe_start(gnss, start, float(np.sum(seen.sigma**-2.0) ** -0.5), off < CAUCHY * sigma))
        return graph

    return make, found
