"""A walk that comes back to places it has been at: they are recognized by the field along it, and close the walk.

    repeat   the path of the solution, with the field along it        -> stretches that are one place (`fg_nav.places`)
             stretches that agree with each other and with the path   -> ties -> factors -> the walk is solved again
    until    the same stretches are recognized again, or `ROUNDS` are over

The path of a walk that was closed is compared with itself again, as more of it then lies where it was before, and what
was recognized by accident falls out. Where nothing is left, the walk is the one that was not closed. Of the last round
only that is used which the one before had recognized too: so nothing is used that was not confirmed.

How far a place of the path may be from where it seems, relative to an earlier one, is what the graph says before it is
closed: with the covariance of each footfall and with that of each of some `ANCHORS`,

    var(p_k - p_a) = P_kk + P_aa - P_ka - P_ak.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints, interpolate_columns
from fg_nav.errors import EstimationError
from fg_nav.places import Signature, Stretch, recognize, select_consistent, trace_signature
from fg_nav.places.candidates import ALIKE_M
from fg_nav.places.recognition import AVERAGE_M
from fg_nav.places.signature import MIN_POINTS, SPACING_M, TURNED
from fg_nav.smoother.combinations import FootfallCovariance
from fg_nav.smoother.graph import Trajectory, WalkProblem, solve, trajectory_of
from fg_nav.smoother.place_factors import PlaceFactors, make_place_factors
from fg_nav.smoother.solver import Solved, list_covariances, list_positions
from fg_nav.solution import Return, StanceTable
from fg_nav.text import format_count

ROUNDS = 3
"""Of recognizing and solving: the second looks along a path that closes, the third mostly finds the same again."""

ANCHORS = 12  # Footfalls relative to which the uncertainty of all others is taken.

MAX_M = 20_000.0
"""Walks of more than some four hours are not compared with themselves: what could be one place grows with the square of
the laps in one building, and takes more memory than the walk."""

MIN_SIGMA_M, MIN_SIGMA_DEG, MIN_HEIGHT_M = 1.0, 3.0, 0.3
"""Of one place relative to another: a corridor's width, and what a stride wanders."""


@dataclass(frozen=True)
class PathUncertainty:
    """Of any place of the path relative to an earlier one, by those relative to anchors.

    `walked_m` (F,) to each footfall, `anchor_m` (A,) to each anchor; variances (A, F) of horizontal place (the larger
    axis), height and heading.
    """

    walked_m: Floats
    anchor_m: Floats
    place: Floats
    height: Floats
    heading: Floats

    def position_m(self, first: Floats, second: Floats) -> Floats:
        """(M,) m, of each horizontal axis."""
        return np.hypot(self._look_up(self.place, first, second), MIN_SIGMA_M)

    def height_m(self, first: Floats, second: Floats) -> Floats:
        """(M,) m."""
        return np.hypot(self._look_up(self.height, first, second), MIN_HEIGHT_M)

    def heading_rad(self, first: Floats, second: Floats) -> Floats:
        """(M,) rad."""
        return np.hypot(self._look_up(self.heading, first, second), np.radians(MIN_SIGMA_DEG))

    def _look_up(self, variance: Floats, first: Floats, second: Floats) -> Floats:
        nearest = np.searchsorted(0.5 * (self.anchor_m[1:] + self.anchor_m[:-1]), first)
        sigma = np.sqrt(np.maximum(variance, 0.0))
        # From an anchor before the first place on to the second; by way of one behind it, at most the sum of both ways.
        to_anchor = np.where(self.anchor_m[nearest] > first, sigma[nearest, self._footfall_at(first)], 0.0)
        return np.asarray(sigma[nearest, self._footfall_at(second)] + to_anchor)

    def _footfall_at(self, walked_m: Floats) -> Ints:
        return np.clip(np.searchsorted(self.walked_m, walked_m), 0, len(self.walked_m) - 1)


def tie_places(problem: WalkProblem, solved: Solved) -> tuple[WalkProblem, Solved, tuple[Return, ...], tuple[str, ...]]:
    """Recognize where a solved walk was before, and solve it with that; return the stretches and notes too."""
    mag = problem.recording.mag
    if not problem.parameters.walk.places or mag is None:
        return problem, solved, (), ()
    open_walk = problem, solved
    walked = _measure_walked(problem, solved)[-1]
    if walked < MIN_POINTS * SPACING_M:
        return *open_walk, (), ()
    if walked > MAX_M:
        return *open_walk, (), (f"no places are looked for on a walk of more than {MAX_M / 1000:.0f} km",)
    uncertainty = measure_uncertainty(problem, solved)
    known: tuple[Stretch, ...] = ()
    path = None
    for number in range(1, ROUNDS + 1):
        # The field along the path, and what of it is one place.
        track = trajectory_of(problem.recording, problem.nodes, solved.values, problem.parameters.gravity)
        path = trace_signature(problem.recording.t, track.position, track.nav_R_body, mag)
        found = _recognize(path, uncertainty)
        is_confirmed = bool(known) and are_alike(found, known)
        known = keep_common(found, known) if number == ROUNDS and not is_confirmed else found
        if not known:
            # What the closed walk does not confirm is taken back.
            return *open_walk, (), ()
        if is_confirmed:
            break
        # The walk with the ties of it.
        places = _make_factors(problem, path, known, track)
        if not len(places):
            return *open_walk, (), ()
        problem = replace(problem, places=places, values=solved.values)
        try:
            solved = solve(problem)
        except EstimationError:
            return *open_walk, (), ("places that were recognized are not used: with them there is no solution",)
    assert path is not None
    returns = tuple(_describe_return(path, one) for one in known)
    return problem, solved, returns, (_write_note(returns),)


def _measure_walked(problem: WalkProblem, solved: Solved) -> Floats:
    """Distance over ground (F,) m walked to each footfall."""
    place = list_positions(problem.nodes.result, solved.values)[:, :2]
    return np.cumsum(np.linalg.norm(np.diff(place, axis=0, prepend=place[:1]), axis=1))


def _recognize(path: Signature, uncertainty: PathUncertainty) -> tuple[Stretch, ...]:
    return select_consistent(path, recognize(path, uncertainty).stretches, uncertainty)


def are_alike(found: tuple[Stretch, ...], known: tuple[Stretch, ...]) -> bool:
    """Whether two rounds recognized the same stretches, but for `ALIKE_M` at their ends."""
    if len(found) != len(known):
        return False
    ends = [
        np.array(sorted((s.opposite, s.later[0], s.earlier[0], s.later[-1]) for s in one)) for one in (found, known)
    ]
    return bool((np.abs(ends[0] - ends[1]) <= [0.0, *3 * [ALIKE_M / SPACING_M]]).all())


def keep_common(found: Sequence[Stretch], known: Sequence[Stretch]) -> tuple[Stretch, ...]:
    """Return the pieces of stretches, of `AVERAGE_M` at least, that lie within `ALIKE_M` of those of another round."""
    pieces = []
    for stretch in found:
        rows = np.flatnonzero(np.any([_lie_on(stretch, one) for one in known], axis=0)) if known else np.zeros(0, int)
        for part in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):
            score = stretch.score * len(part) / len(stretch.later)
            piece = replace(stretch, later=stretch.later[part], earlier=stretch.earlier[part], score=score)
            pieces += [piece] if len(part) * SPACING_M >= AVERAGE_M else []
    return tuple(pieces)


def _lie_on(stretch: Stretch, other: Stretch) -> Bools:
    """Whether the points (M,) of a stretch are at the place that another one says."""
    earlier = np.interp(stretch.later, other.later, other.earlier, left=np.inf, right=np.inf)
    near = np.abs(earlier - stretch.earlier) <= ALIKE_M / SPACING_M
    return near & (stretch.opposite == other.opposite)


def _make_factors(
    problem: WalkProblem, path: Signature, stretches: tuple[Stretch, ...], track: Trajectory
) -> PlaceFactors:
    nodes, t = problem.nodes, problem.recording.t
    sample = nodes.sample[nodes.result]
    return make_place_factors(
        path, stretches, t[sample], track.position[sample], track.nav_R_body[sample], nodes.result
    )


def measure_uncertainty(problem: WalkProblem, solved: Solved) -> PathUncertainty:
    """Measure what a solved walk says of the place of each footfall relative to each anchor."""
    nodes = problem.nodes
    joint = FootfallCovariance.of(solved, nodes, np.zeros((solved.root.total, 0)))
    own = _list_own(joint, solved)
    anchors = np.unique(np.linspace(0, len(nodes.result) - 1, ANCHORS).astype(np.int64))
    relative = np.array([_relative_to(joint, own, int(a)) for a in anchors])
    place = np.linalg.eigvalsh(relative[:, :, :2, :2])[..., 1]
    walked = _measure_walked(problem, solved)
    return PathUncertainty(walked, walked[anchors], place, relative[:, :, 2, 2], relative[:, :, 3, 3])


def _list_own(joint: FootfallCovariance, solved: Solved) -> Floats:
    """Covariances (F, 4, 4) of the footfalls."""
    body = list_covariances(joint.keys, solved.root, joint.shared)
    return joint.nav_T_body @ body @ np.swapaxes(joint.nav_T_body, 1, 2)


def _relative_to(joint: FootfallCovariance, own: Floats, anchor: int) -> Floats:
    """Covariances (F, 4, 4) of the footfalls relative to one of them."""
    weights = np.zeros((len(own), 4, 4))
    weights[anchor] = np.eye(4)
    itself, cross = joint.combine(weights)
    return own + itself - cross - np.swapaxes(cross, 1, 2)


def _describe_return(path: Signature, stretch: Stretch) -> Return:
    """Take the moments of a stretch and the field of both passes, in the directions of the later one."""
    points = np.arange(len(path), dtype=float)
    t, before = (np.interp(at, points, path.t) for at in (stretch.later, stretch.earlier))
    field, of_before = (interpolate_columns(at, points, path.field) for at in (stretch.later, stretch.earlier))
    if stretch.opposite:
        of_before = of_before * TURNED
    length = float(np.ptp(np.interp(stretch.later, points, path.distance_m)))
    return Return(t, before, stretch.opposite, stretch.score, stretch.expected_false, length, field, of_before)


def _write_note(returns: tuple[Return, ...]) -> str:
    length = sum(one.length_m for one in returns)
    many = format_count(len(returns), "return")
    return f"{many} to where the walk was before, {length:.0f} m in all, recognized by the field"


def mark_returns(table: StanceTable, returns: Sequence[Return]) -> StanceTable:
    """Write into a table which earlier footfall each was at the place of, by the surest stretch that says so."""
    same, score = np.full(len(table), -1), np.zeros(len(table))
    halfway = 0.5 * (table.t[1:] + table.t[:-1])
    for one in sorted(returns, key=lambda of: of.score):
        inside = np.flatnonzero((table.t >= one.t[0]) & (table.t <= one.t[-1]))
        same[inside] = np.searchsorted(halfway, np.interp(table.t[inside], one.t, one.earlier_t))
        score[inside] = one.score
    return replace(table, same_place=same, place_score=score)
