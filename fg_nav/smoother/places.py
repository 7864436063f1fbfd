"""A walk that comes back to places it has been at: they are recognized by the field along it, and close the walk.

    repeat   the path of the solution, with the field along it        -> stretches that are one place (`fg_nav.places`)
             stretches that agree with each other and with the path   -> ties -> factors -> the walk is solved again
    until    the same stretches are recognized again, or `ROUNDS` are over

The path of a walk that was closed is compared with itself again, as more of it then lies where it was before, and what
was recognized by accident falls out. Where nothing is left, the walk is the one that was not closed. Of the last round
only that is used which the one before had recognized too: so nothing is used that was not confirmed.

How far a place of the path may be from where it seems, relative to an earlier one, follows from the graph before it is
closed: with the covariance of each footfall and with that of each of some `ANCHORS`,

    var(p_k - p_a) = P_kk + P_aa - P_ka - P_ak.

Factors (`factors.same_place`). The earliest pass of each place is divided into cells by distance, and has one footfall
in each to which all later passes are tied: so no error adds up from lap to lap, and few footfalls are joined over the
walk (`graph.order_variables`). What is tied are the means of both passes over the cell, relative to their footfalls;
with an independent error every `APART_M`,

    sigma = sigma_one / sqrt(length / APART_M),

and along the path, on top of that, what the field leaves open of the shift between the passes (`places.recognition`),
which is taken off first. A field that hardly changes ties weakly. A piece of the walk is tied to its earliest pass
only.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from gtsam.symbol_shorthand import X

from fg_nav.arrays import Floats, Ints, find_runs, interpolate_columns
from fg_nav.errors import EstimationError
from fg_nav.factors.residual import ResidualBlock
from fg_nav.factors.same_place import SamePlace, weigh_place
from fg_nav.places import Signature, Stretch, recognize, select_consistent, trace_signature
from fg_nav.places.candidates import ALIKE_M
from fg_nav.places.recognition import ALONG_SIGMA_M, AVERAGE_M, LATERAL_SIGMA_M, UP_SIGMA_M, find_shift, weigh_shifts
from fg_nav.places.signature import MIN_POINTS, SPACING_M, TURNED, whiten
from fg_nav.smoother.dense_path import trajectory_of
from fg_nav.smoother.graph import WalkProblem, solve
from fg_nav.smoother.sensitivity import FootfallCovariance
from fg_nav.smoother.solver import Solved, list_covariances, list_positions
from fg_nav.solution import Return, StanceTable
from fg_nav.text import format_count

CELL_M, MAX_CELLS = 20.0, 60  # Of a walk; where more ground is walked again cells are longer: the last fronts hold all.
MIN_SHARE = 0.5  # Of a cell that a pass has to cover.
APART_M = 6.0  # Between independent errors of a pass: those of an alignment, and the wander of a person.
ROUNDS = 3  # Of recognizing and solving: the second looks along a path that closes, the third mostly finds the same.
ANCHORS = 12  # Footfalls relative to which the uncertainty of all others is taken.
MAX_M = 20_000.0  # Four hours: what could be one place grows with the square of the laps, as does its memory.
MIN_SIGMA_M, MIN_SIGMA_DEG, MIN_HEIGHT_M = 1.0, 3.0, 0.3  # Between two places: a corridor's width, a stride's wander.


class PlaceFactors(ResidualBlock):
    """The ties of a walk; `footfalls` (n,) are those that they join, ascending."""

    def __init__(self, residuals: SamePlace, keys: Sequence[Sequence[int]], footfalls: Ints) -> None:
        super().__init__(residuals, keys)
        self.footfalls = footfalls


@dataclass(frozen=True)
class _Piece:
    """Part of a stretch, in one cell, of which it covers `covered_m`.

    `later_m` were walked to the middle of the later pass, `cell_m` to that of the cell.
    """

    stretch: Stretch
    later_m: float
    cell_m: float
    covered_m: float


def make_place_factors(
    path: Signature, stretches: Sequence[Stretch], t: Floats, position: Floats, nav_R_body: Floats, node: Ints
) -> PlaceFactors:
    """Return a tie for each cell of ground that was walked again: its mean place in the later and the earliest pass.

    Parameters
    ----------
    t, position, nav_R_body : (F,) s, (F, 3) m and (F, 3, 3) of the footfalls, from the current solution.
    node : (F,) result node of each footfall.
    """
    # Ground walked again: first passes that were not themselves recognized. Cells are longer where it is much.
    is_first = np.zeros(len(path), dtype=bool)
    for stretch in stretches:
        is_first[int(stretch.earlier.min()) : int(stretch.earlier.max()) + 1] = True
    for stretch in stretches:
        is_first[int(stretch.later[0]) : int(stretch.later[-1]) + 1] = False
    length = max(CELL_M, float(is_first.sum()) * SPACING_M / MAX_CELLS)
    # Each piece of the walk in a cell, with its earliest pass.
    pieces = [piece for stretch in stretches for piece in _cut_into_cells(path, stretch, length)]
    chosen: dict[int, _Piece] = {}
    for piece in sorted(pieces, key=lambda one: one.cell_m):
        chosen.setdefault(int(piece.later_m // length), piece)
    points, features, places = np.arange(len(path), dtype=float), whiten(path), list[list[Floats]]()
    pairs, ties = list[Ints](), list[tuple[float, float, float]]()
    for piece in chosen.values():
        # The footfalls in the middle of the later pass and of the cell, which all its passes share. Where a walk turns
        # back within a cell they are one, and nothing is tied.
        pair = find_footfalls(np.interp([piece.later_m, piece.cell_m], path.distance_m, path.t), t)
        if pair[0] == pair[1]:
            continue
        # Mean places of both passes, shifted to where the field has them, unless that leaves nothing of the walk.
        stretch = piece.stretch
        shift, shift_sigma = find_shift(weigh_shifts(features, stretch))
        earlier = stretch.move_earlier(shift)
        inside = (earlier >= 0.0) & (earlier <= points[-1])
        later, earlier = (stretch.later[inside], earlier[inside]) if inside.any() else (stretch.later, stretch.earlier)
        places.append([interpolate_columns(at, points, path.position).mean(axis=0) for at in (later, earlier)])
        # The direction of walking, and how many errors the means average.
        heading = float(np.interp(later.mean(), points, path.heading))
        ties.append((heading, max(piece.covered_m / APART_M, 1.0), shift_sigma))
        pairs.append(pair)
    foot, place = np.array(pairs, dtype=np.int64).reshape(-1, 2), np.reshape(places, (-1, 2, 3))
    in_body = [np.einsum("kji,kj->ki", nav_R_body[foot[:, k]], place[:, k] - position[foot[:, k]]) for k in range(2)]
    headings, count, shift_sigmas = np.reshape(ties, (-1, 3)).T
    along = np.hypot(ALONG_SIGMA_M / np.sqrt(count), shift_sigmas)
    weight = weigh_place(headings, along, LATERAL_SIGMA_M / np.sqrt(count), UP_SIGMA_M)
    keys = [(X(int(node[a])), X(int(node[b]))) for a, b in foot]
    return PlaceFactors(SamePlace(in_body[0], in_body[1], weight), keys, np.unique(foot))


def find_footfalls(at: Sequence[float] | Floats, t: Floats) -> Ints:
    """Find the footfalls (M,), of those at times t (F,) s, nearest to moments (M,) s."""
    return np.asarray(np.searchsorted(0.5 * (t[1:] + t[:-1]), at))


def _cut_into_cells(path: Signature, stretch: Stretch, length: float) -> Iterator[_Piece]:
    """Yield the pieces of a stretch, one in each cell of this length, m, that it covers."""
    points = np.arange(len(path))
    later_m, walked = (np.interp(at, points, path.distance_m) for at in (stretch.later, stretch.earlier))
    cell = (walked // length).astype(np.int64)
    for number in np.unique(cell):
        rows = np.flatnonzero(cell == number)
        covered = float(np.ptp(walked[rows]))
        if covered >= min(MIN_SHARE * length, 0.9 * np.ptp(walked)):
            piece = replace(stretch, later=stretch.later[rows], earlier=stretch.earlier[rows])
            yield _Piece(piece, float(later_m[rows].mean()), (number + 0.5) * length, covered)


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
        footfall = [np.minimum(np.searchsorted(self.walked_m, one), len(self.walked_m) - 1) for one in (first, second)]
        to_anchor = np.where(self.anchor_m[nearest] > first, sigma[nearest, footfall[0]], 0.0)
        return np.asarray(sigma[nearest, footfall[1]] + to_anchor)


def tie_places(problem: WalkProblem, solved: Solved) -> tuple[WalkProblem, Solved, tuple[Return, ...], tuple[str, ...]]:
    """Detect loop closures on a solved walk; return problem, solution with them, the returns and notes."""
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
        # Where the field along the path shows one place.
        track = trajectory_of(problem.recording, problem.nodes, solved.values, problem.parameters.gravity)
        path = trace_signature(problem.recording.t, track.position, track.nav_R_body, mag)
        found = select_consistent(path, recognize(path, uncertainty).stretches, uncertainty)
        is_confirmed = bool(known) and are_alike(found, known)
        known = keep_common(found, known) if number == ROUNDS and not is_confirmed else found
        if not known:
            # What the closed walk does not confirm is taken back.
            return *open_walk, (), ()
        if is_confirmed:
            break
        # The walk with ties there.
        sample = problem.nodes.sample[problem.nodes.result]
        of_footfalls = problem.recording.t[sample], track.position[sample], track.nav_R_body[sample]
        places = make_place_factors(path, known, *of_footfalls, problem.nodes.result)
        if not len(places):
            return *open_walk, (), ()
        problem = replace(problem, places=places, values=solved.values)
        try:
            solved = solve(problem)
        except EstimationError:
            return *open_walk, (), ("places that were recognized are not used: with them there is no solution",)
    assert path is not None
    returns = tuple(_describe_return(path, one) for one in known)
    many, total_m = format_count(len(returns), "return"), sum(one.length_m for one in returns)
    note = f"{many} to where the walk was before, {total_m:.0f} m in all, recognized by the field"
    return problem, solved, returns, (note,)


def _measure_walked(problem: WalkProblem, solved: Solved) -> Floats:
    """Distance over ground (F,) m walked to each footfall."""
    place = list_positions(problem.nodes.result, solved.values)[:, :2]
    return np.cumsum(np.linalg.norm(np.diff(place, axis=0, prepend=place[:1]), axis=1))


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
        is_near = np.zeros(len(stretch.later), dtype=np.bool_)
        for other in known:
            if other.opposite == stretch.opposite:
                earlier = np.interp(stretch.later, other.later, other.earlier, left=np.inf, right=np.inf)
                is_near |= np.abs(earlier - stretch.earlier) <= ALIKE_M / SPACING_M
        for part in (np.arange(*run) for run in zip(*find_runs(is_near), strict=True)):
            score = stretch.score * len(part) / len(stretch.later)
            piece = replace(stretch, later=stretch.later[part], earlier=stretch.earlier[part], score=score)
            pieces += [piece] if len(part) * SPACING_M >= AVERAGE_M else []
    return tuple(pieces)


def measure_uncertainty(problem: WalkProblem, solved: Solved) -> PathUncertainty:
    """Return the uncertainty of position and heading of each footfall relative to each anchor, from the marginals."""
    nodes = problem.nodes
    joint = FootfallCovariance.of(solved, nodes, np.zeros((solved.root.total, 0)))
    body = list_covariances(joint.keys, solved.root, joint.shared)
    own = joint.nav_T_body @ body @ np.swapaxes(joint.nav_T_body, 1, 2)
    # Covariances (A, F, 4, 4) relative to each anchor.
    anchors = np.unique(np.linspace(0, len(nodes.result) - 1, ANCHORS).astype(np.int64))
    relative = np.zeros((len(anchors), *own.shape))
    for of, anchor in zip(relative, anchors, strict=True):
        weights = np.zeros(own.shape)
        weights[anchor] = np.eye(4)
        itself, cross = joint.combine(weights)
        of[:] = own + itself - cross - np.swapaxes(cross, 1, 2)
    place = np.linalg.eigvalsh(relative[:, :, :2, :2])[..., 1]
    walked = _measure_walked(problem, solved)
    return PathUncertainty(walked, walked[anchors], place, relative[:, :, 2, 2], relative[:, :, 3, 3])


def _describe_return(path: Signature, stretch: Stretch) -> Return:
    """Take the moments of a stretch and the field of both passes, in the directions of the later one."""
    points = np.arange(len(path), dtype=float)
    t, before = (np.interp(at, points, path.t) for at in (stretch.later, stretch.earlier))
    field, of_before = (interpolate_columns(at, points, path.field) for at in (stretch.later, stretch.earlier))
    if stretch.opposite:
        of_before = of_before * TURNED
    length = float(np.ptp(np.interp(stretch.later, points, path.distance_m)))
    return Return(t, before, stretch.opposite, stretch.score, stretch.expected_false, length, field, of_before)


def mark_returns(table: StanceTable, returns: Sequence[Return]) -> StanceTable:
    """Write into a table which earlier footfall each was at the place of, by the surest stretch."""
    same, score = np.full(len(table), -1), np.zeros(len(table))
    halfway = 0.5 * (table.t[1:] + table.t[:-1])
    for one in sorted(returns, key=lambda of: of.score):
        inside = np.flatnonzero((table.t >= one.t[0]) & (table.t <= one.t[-1]))
        same[inside] = np.searchsorted(halfway, np.interp(table.t[inside], one.t, one.earlier_t))
        score[inside] = one.score
    return replace(table, same_place=same, place_score=score)
