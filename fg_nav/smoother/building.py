"""What a building shows on a solved walk: directions that its courses follow, and places where it was before.

Directions   repeat   courses of the solution -> alpha along the walk, s and P -> path turned by its drift
                      -> solved again, `DIRECTION_ROUNDS` times
Places       repeat   path of the solution, with the field along it -> stretches that are one place (`fg_nav.places`)
                      stretches that agree with each other and the path -> ties -> factors -> solved again
             until    the same stretches are recognized again, or `ROUNDS` are over

Directions (`factors.BuildingDirection`; reasons and limits in `docs/models.md`). Displacements share no stride and lie
in the middle of straight stretches. In the frame of the drifted solution alpha is phi_k at displacement k, of course
psi_k, a random walk on the quarter circle, and a steady drift on top of it,

    phi_(k+1) = phi_k + b n_k + N(0, q n_k),    b ~ N(0, (sigma / F)^2),
    p(psi_k | phi_k) = (P N(wrap(psi_k - phi_k); 0, s^2) + (1 - P) 2/pi)^h_k,

n_k the strides between their middles of F, sigma that of the heading at any footfall relative to the start, h_k the
share of each displacement in its leg; q adds up to sigma^2 over the walk, within the bounds of `DRIFT_DEG`. Forward and
backward passes on a grid give p(phi_k | all psi) and the likelihood (hidden Markov model: Rabiner 1989), for each of
some b; with the likeliest, s and P are estimated by expectation maximization. The path is turned by phi_0 - phi_k, to
start from.

Places (`docs/field.md`). How far a place may be from where it seems, relative to an earlier one, follows from the
graph before it is closed: with the covariance of each footfall and with that of each of some `ANCHORS`,

    var(p_k - p_a) = P_kk + P_aa - P_ka - P_ak.

All later passes of a cell are tied to one footfall of the earliest (`factors.same_place`): so no error adds up from lap
to lap, and few footfalls are joined over the walk (`graph.order_variables`). What is tied are the means over the cell,
with sigma_one / sqrt(length / APART_M) and, along the path, what the field leaves open of the shift between the passes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import gtsam
import numpy as np
from gtsam.symbol_shorthand import A, X
from numpy.lib.stride_tricks import sliding_window_view

from fg_nav.arrays import Bools, Floats, Ints, find_runs, interpolate_columns
from fg_nav.errors import EstimationError
from fg_nav.factors.residual import ResidualBlock
from fg_nav.factors.same_place import SamePlace, weigh_place
from fg_nav.factors.walk_constraints import QUARTER, BuildingDirection, measure_course, odds_of_elsewhere, wrap_quarter
from fg_nav.frames import wrap_angle
from fg_nav.places import Signature, Stretch, recognize, select_consistent, trace_signature
from fg_nav.places.candidates import ALIKE_M
from fg_nav.places.recognition import ALONG_SIGMA_M, AVERAGE_M, LATERAL_SIGMA_M, UP_SIGMA_M, find_shift, weigh_shifts
from fg_nav.places.signature import MIN_POINTS, SPACING_M, TURNED, whiten
from fg_nav.smoother.graph import WalkProblem, solve, trajectory_of, turn_walk
from fg_nav.smoother.sensitivity import FootfallCovariance
from fg_nav.smoother.solver import BlockGroup, GtsamFactors, Solved, list_covariances, list_positions
from fg_nav.solution import Return, StanceTable
from fg_nav.text import format_count

STRIDES = 5  # Of a displacement: 7 m, over which weaving by 7 cm is 0.8 deg (0.07 sqrt(2) / 7 rad).
MIN_M = 2.5  # Displacements below this have no course of a walk: half a metre a stride.
STRAIGHT_WITHIN_M = 0.15  # Off the line between the ends of a straight displacement: two sigmas of weaving by 7 cm.
LEG_COURSES = 3.0  # Independent courses that a leg counts as at most.
NEW_LEG_RAD = np.radians(22.5)  # Change of course that begins another leg: a quarter of what is between two directions.
OPEN_RAD = 2.0 * np.pi  # Sigma of the prior of a direction: a full turn, as open as the heading behind a hole.
DIRECTION_ROUNDS = 2  # The second finds s and P, and what follows the building, on a path without drift.
CELLS = 180  # Of the quarter circle, half a degree each: a third of the least sigma.
GRID = QUARTER * np.arange(CELLS) / CELLS
ITERATIONS = 10  # Of expectation maximization, which has s to some per cent by then.
FIRST_SIGMA_DEG, FIRST_SHARE = 4.0, 0.5
MIN_SIGMA_DEG, MAX_SIGMA_DEG = 1.5, 8.0
MIN_FOLLOWED, MAX_FOLLOWED = 0.05, 0.95  # Of P.
DRIFT_DEG = 5.0, 15.0  # Bounds of the random drift of a walk, one sigma: more of it is a bias, and steady.
RATE_STEP_DEG = 5.0  # Between steady drifts that are tried, at the end of the walk, up to `RATE_SIGMAS` either way.
RATE_SIGMAS = 3.0
LOST_DEG = 10.0  # Growth of the heading's sigma over a stride: behind a few of them any direction may be any other.
ANY_TURN = 10.0  # rad^2, of a turn that is uniform over the quarter circle.
MIN_EVIDENCE = 6.0  # Log likelihood over that of any courses: three numbers are chosen, half log M each, M = 50.
NONE_FOUND = "no directions of a building are used: the courses of the walk do not show any"
CELL_M, MAX_CELLS = 20.0, 60  # Of a walk; where more ground is walked again cells are longer: the last fronts hold all.
MIN_SHARE = 0.5  # Of a cell that a pass has to cover.
APART_M = 6.0  # Between independent errors of a pass: those of an alignment, and the wander of a person.
ROUNDS = 3  # Of recognizing and solving: the second looks along a path that closes, the third mostly finds the same.
ANCHORS = 12  # Footfalls relative to which the uncertainty of all others is taken.
MAX_M = 20_000.0  # Four hours: what could be one place grows with the square of the laps, as does its memory.
MIN_PLACE_M, MIN_HEADING_DEG, MIN_HEIGHT_M = 1.0, 3.0, 0.3  # Between two places: a corridor's width, a stride's wander.


@dataclass(frozen=True)
class Mixture:
    """What courses do: `share` P of them follow the building's directions, with `sigma` s, rad."""

    sigma: float
    share: float


class DirectionFactors(BlockGroup):
    """Factors of the `courses` of a walk, and priors that leave the direction of each of its pieces open."""

    def __init__(self, courses: ResidualBlock, priors: GtsamFactors) -> None:
        super().__init__(courses, priors)
        self.courses = courses


def make_direction_factors(node: Ints, piece: Ints, share: Floats, alpha: Floats, mixture: Mixture) -> DirectionFactors:
    """Tie pairs of nodes (M, 2) to the directions of their piece (M,), about `alpha` (n,) rad, by `share` (M,) each."""
    courses = BuildingDirection(mixture.sigma, odds_of_elsewhere(mixture.sigma, mixture.share), share)
    wide = gtsam.noiseModel.Isotropic.Sigma(1, OPEN_RAD)
    priors = (gtsam.PriorFactorVector(A(k), np.array([one]), wide) for k, one in enumerate(alpha))
    keys = [(X(int(a)), X(int(b)), A(int(k))) for (a, b), k in zip(node, piece, strict=True)]
    return DirectionFactors(ResidualBlock(courses, keys, kind="direction"), GtsamFactors(*priors))


def list_displacements(position: Floats) -> Ints:
    """List the first and last footfalls (M, 2) of straight displacements of footfalls at `position` (F, 3) m."""
    if len(position) <= STRIDES:
        return np.zeros((0, 2), dtype=np.int64)
    # Footfalls from which `STRIDES` strides go straight on over ground.
    places = np.moveaxis(sliding_window_view(position[:, :2], STRIDES + 1, axis=0), 2, 1)
    from_first = places - places[:, :1]
    along = from_first[:, -1:]
    across = from_first[..., 0] * along[..., 1] - from_first[..., 1] * along[..., 0]
    length = np.linalg.norm(along, axis=2)[:, 0]
    off = np.abs(across).max(axis=1) / np.maximum(length, MIN_M)
    # Non-overlapping displacements, centred in each straight run.
    first = [np.zeros(0, dtype=np.int64)]
    for begin, end in zip(*find_runs((length >= MIN_M) & (off <= STRAIGHT_WITHIN_M)), strict=True):
        strides = end - begin + STRIDES - 1
        first.append(begin + strides % STRIDES // 2 + STRIDES * np.arange(strides // STRIDES))
    return np.asarray(np.concatenate(first)[:, None] + np.array([0, STRIDES]))


class TrackedDirections(NamedTuple):
    """Directions along a walk: `phi` (M,) rad, s and P, and log likelihood over that of courses that are anything."""

    phi: Floats
    mixture: Mixture
    evidence: float


def follow_directions(problem: WalkProblem, solved: Solved) -> tuple[WalkProblem, Solved, tuple[str, ...]]:
    """Find the building's directions on a solved walk; return problem, solution with them, and notes."""
    if not problem.parameters.walk.directions:
        return problem, solved, ()
    free = problem, solved
    for _ in range(DIRECTION_ROUNDS):
        followed = add_directions(problem, solved)
        if followed is None:
            return *free, (NONE_FOUND,)
        problem, mixture = followed
        try:
            solved = solve(problem)
        except EstimationError:
            return *free, ("no directions of a building are used: with them there is no solution",)
    courses = format_count(len(problem.get(DirectionFactors).courses), "course")
    sigma = np.degrees(mixture.sigma)
    follow = f"{100.0 * mixture.share:.0f} % of {courses} follow the directions of a building"
    return problem, solved, (f"{follow}, at right angles, within {sigma:.1f} deg",)


def add_directions(problem: WalkProblem, solved: Solved) -> tuple[WalkProblem, Mixture] | None:
    """Return the problem with direction factors and headings turned to them, and the mixture; None if none is found."""
    # Variance of heading at each footfall relative to the first, the random walk allowed between directions.
    nodes, position = problem.nodes, list_positions(problem.nodes.result, solved.values)
    joint = FootfallCovariance.of(solved, nodes, np.zeros((solved.root.total, 0)))
    weights = np.zeros((len(joint.keys), 4, 1))
    weights[0, 3] = 1.0
    of_first, cross = joint.combine(weights)
    yaw = joint.nav_T_body[:, 3:]
    own = yaw @ list_covariances(joint.keys, solved.root, joint.shared) @ np.swapaxes(yaw, 1, 2)
    drift = split_drift(np.asarray(own[:, 0, 0] + of_first[0, 0] - 2.0 * cross[:, 3, 0]))
    # The directions that the courses of straight displacements follow.
    pairs = list_displacements(position)
    pairs = pairs[drift.piece[pairs[:, 0]] == drift.piece[pairs[:, 1]]]
    if not len(pairs):
        return None
    course = measure_course(position[pairs[:, 1]] - position[pairs[:, 0]])
    middle, (known, piece) = pairs.mean(axis=1), np.unique(drift.piece[pairs[:, 0]], return_inverse=True)
    # Courses of a leg, in a row, count for `LEG_COURSES` at most.
    leg = np.cumsum(np.abs(wrap_angle(np.diff(course, prepend=course[:1]))) > NEW_LEG_RAD)
    share = np.minimum(1.0, LEG_COURSES / np.bincount(leg)[leg])
    tracked = track_directions(course, share, middle / len(position), drift.sigma, np.diff(piece) > 0)
    if tracked.evidence < MIN_EVIDENCE:
        return None
    # The path without its drift, piece by piece.
    alpha, turn, values = tracked.phi[np.searchsorted(piece, range(len(known)))], np.zeros(len(nodes)), solved.values
    for k, number in enumerate(known):
        inside = drift.piece[nodes.footfall] == number
        turn[inside] = alpha[k] - np.interp(nodes.footfall[inside], middle[piece == k], tracked.phi[piece == k])
    values = gtsam.Values(values)
    turn_walk(values, nodes, turn)
    for k, one in enumerate(alpha):
        values.insert_or_assign(A(k), np.array([one]))
    factors = make_direction_factors(nodes.result[pairs], piece, share, alpha, tracked.mixture)
    # A round before may have had more pieces.
    for key in [A(k) for k in range(len(alpha), len(nodes)) if values.exists(A(k))]:
        values.erase(key)
    return replace(problem.without(DirectionFactors).join(factors), values=values), tracked.mixture


class Drift(NamedTuple):
    """How far a walk's heading may drift: `sigma` rad, and the `piece` (F,) of each footfall, from 0."""

    sigma: float
    piece: Ints


def split_drift(variance: Floats) -> Drift:
    """Split a walk at strides over which its heading is lost, `variance` (F,) rad^2 that from its start on."""
    growth = np.diff(variance, prepend=variance[0])
    is_lost = growth > np.radians(LOST_DEG) ** 2
    left = variance - np.cumsum(np.where(is_lost, growth, 0.0))
    return Drift(float(np.sqrt(max(left.max(), 0.0))), np.cumsum(is_lost))


def track_directions(
    course: Floats, share: Floats, at: Floats, drift: float, is_lost: Bools | None = None
) -> TrackedDirections:
    """Estimate the building direction, modulo pi/2, along courses (M,) rad: a hidden Markov model on a circular grid.

    `share` (M,) is the power of each likelihood, `at` (M,) the place of each course along the walk, 0 to 1, `drift` rad
    the sigma over the walk; `is_lost` (M-1,) whether the heading is lost before the next course, None if nowhere.
    """
    variance = np.diff(at) * np.clip(drift, *np.radians(DRIFT_DEG)) ** 2
    variance = variance if is_lost is None else np.where(is_lost, ANY_TURN, variance)
    mixture = Mixture(float(np.radians(FIRST_SIGMA_DEG)), FIRST_SHARE)
    # Steady drift: the most probable rate, rad over the walk; `gained` is log evidence of all rates over that one.
    count = int(RATE_SIGMAS * drift / np.radians(RATE_STEP_DEG))
    rates = np.radians(RATE_STEP_DEG) * np.arange(-count, count + 1)
    prior = -0.5 * (rates / drift) ** 2 if count else np.zeros(1)
    likelihood = np.array([_smooth(course - rate * at, share, variance, mixture)[1] for rate in rates])
    best = int((likelihood + prior).argmax())
    steady = float(rates[best])
    gained = float(np.logaddexp.reduce(likelihood + prior) - np.logaddexp.reduce(prior) - likelihood[best])
    left = course - steady * at
    # EM for the mixture: sigma s and share P of courses that follow the directions.
    for _ in range(ITERATIONS):
        density, evidence, off = _smooth(left, share, variance, mixture)
        phi = np.unwrap(np.angle(density @ np.exp(4j * GRID))) / 4.0
        tracked = TrackedDirections(phi + steady * at, mixture, evidence + gained)
        # M step: s and P, weighted by the posterior of direction and of being followed.
        followed = _weigh_followed(off, mixture)
        weight = share[:, None] * density * followed / (followed + 1.0 - mixture.share)
        sigma = np.clip(np.sqrt((weight * off**2).sum() / weight.sum()), *np.radians([MIN_SIGMA_DEG, MAX_SIGMA_DEG]))
        mixture = Mixture(float(sigma), float(np.clip(weight.sum() / share.sum(), MIN_FOLLOWED, MAX_FOLLOWED)))
    return tracked


def _smooth(course: Floats, share: Floats, variance: Floats, mixture: Mixture) -> tuple[Floats, float, Floats]:
    """Return posterior p(phi_k) (M, `CELLS`), log evidence, and each course less each grid direction, rad."""
    off = wrap_quarter(course[:, None] - GRID)
    likelihood = (_weigh_followed(off, mixture) + 1.0 - mixture.share) ** share[:, None]
    harmonic = 4.0 * np.arange(CELLS // 2 + 1)
    spread = np.exp(-0.5 * harmonic**2 * variance[:, None])
    # Forward pass: filter, with its normalizers as log evidence.
    ahead, behind = np.ones_like(likelihood) / CELLS, np.ones_like(likelihood)
    log_likelihood = 0.0
    for k, here in enumerate(likelihood):
        if k:
            ahead[k] = _blur(ahead[k - 1], spread[k - 1])
        ahead[k] *= here
        total = ahead[k].sum()
        ahead[k] /= total
        log_likelihood += float(np.log(total))
    # Backward pass.
    for k in range(len(likelihood) - 2, -1, -1):
        behind[k] = _blur(likelihood[k + 1] * behind[k + 1], spread[k])
        behind[k] /= behind[k].sum()
    both = ahead * behind
    return both / both.sum(axis=1, keepdims=True), log_likelihood, off


def _weigh_followed(off: Floats, mixture: Mixture) -> Floats:
    """Likelihood (...) of courses `off` a direction by so much, rad, and along it, over that of anything."""
    s = mixture.sigma
    return np.asarray(mixture.share * QUARTER / (s * np.sqrt(2.0 * np.pi)) * np.exp(-0.5 * (off / s) ** 2))


def _blur(density: Floats, spread: Floats) -> Floats:
    """Convolve a density (`CELLS`,) with a normal one on the circle, given by its Fourier coefficients."""
    return np.maximum(np.fft.irfft(np.fft.rfft(density) * spread, CELLS), 1e-300)


class PlaceFactors(ResidualBlock):
    """The ties of a walk; `footfalls` (n,) are those that they join, ascending."""

    def __init__(self, residuals: SamePlace, keys: Sequence[Sequence[int]], footfalls: Ints) -> None:
        super().__init__(residuals, keys, kind="same_place")
        self.footfalls = footfalls


@dataclass(frozen=True)
class _Piece:
    """Part of a stretch, in one cell."""

    stretch: Stretch
    later_m: float  # Walked to the middle of the later pass,
    cell_m: float  # and to that of the cell,
    covered_m: float  # of which it covers so much.


def make_place_factors(
    path: Signature, stretches: Sequence[Stretch], t: Floats, position: Floats, nav_R_body: Floats, node: Ints
) -> PlaceFactors:
    """Return a tie for each cell of ground that was walked again, later and at first; `t` to `node` of footfalls."""
    # Ground walked again: first passes that were not themselves recognized. Cells are longer where it is much.
    is_first = np.zeros(len(path), dtype=bool)
    for stretch in stretches:
        is_first[int(stretch.earlier.min()) : int(stretch.earlier.max()) + 1] = True
    for stretch in stretches:
        is_first[int(stretch.later[0]) : int(stretch.later[-1]) + 1] = False
    length = max(CELL_M, float(is_first.sum()) * SPACING_M / MAX_CELLS)
    # The pieces of each stretch, one in each cell that it covers.
    points, pieces = np.arange(len(path), dtype=float), list[_Piece]()
    for stretch in stretches:
        later_m, walked = (np.interp(at, points, path.distance_m) for at in (stretch.later, stretch.earlier))
        cell = (walked // length).astype(np.int64)
        for number in np.unique(cell):
            rows = np.flatnonzero(cell == number)
            covered = float(np.ptp(walked[rows]))
            if covered >= min(MIN_SHARE * length, 0.9 * np.ptp(walked)):
                part = replace(stretch, later=stretch.later[rows], earlier=stretch.earlier[rows])
                pieces.append(_Piece(part, float(later_m[rows].mean()), (number + 0.5) * length, covered))
    # Each piece of the walk in a cell, with its earliest pass.
    chosen: dict[int, _Piece] = {}
    for piece in sorted(pieces, key=lambda one: one.cell_m):
        chosen.setdefault(int(piece.later_m // length), piece)
    features, places = whiten(path), list[list[Floats]]()
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


@dataclass(frozen=True)
class PathUncertainty:
    """Of any place of the path relative to an earlier one, by those relative to anchors."""

    walked_m: Floats  # (F,) to each footfall.
    anchor_m: Floats  # (A,) to each anchor.
    place: Floats  # (A, F) variance of horizontal place, of the larger axis,
    height: Floats  # of height,
    heading: Floats  # and of heading.

    def position_m(self, first: Floats, second: Floats) -> Floats:
        """(M,) m, of each horizontal axis."""
        return np.hypot(self._look_up(self.place, first, second), MIN_PLACE_M)

    def height_m(self, first: Floats, second: Floats) -> Floats:
        """(M,) m."""
        return np.hypot(self._look_up(self.height, first, second), MIN_HEIGHT_M)

    def heading_rad(self, first: Floats, second: Floats) -> Floats:
        """(M,) rad."""
        return np.hypot(self._look_up(self.heading, first, second), np.radians(MIN_HEADING_DEG))

    def _look_up(self, variance: Floats, first: Floats, second: Floats) -> Floats:
        nearest = find_footfalls(first, self.anchor_m)
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
    if _measure_walked(problem, solved)[-1] < MIN_POINTS * SPACING_M:
        return *open_walk, (), ()
    known: tuple[Stretch, ...] = ()
    path = None
    for number in range(1, ROUNDS + 1):
        # Where the field along the path shows one place.
        track = trajectory_of(problem.recording, problem.nodes, solved.values, problem.parameters.gravity)
        path = trace_signature(problem.recording.t, track.position, track.nav_R_body, mag)
        if path.distance_m[-1] > MAX_M:
            return *open_walk, (), (f"no places are looked for on a walk of more than {MAX_M / 1000:.0f} km",)
        if number == 1:
            uncertainty = measure_uncertainty(problem, solved)  # of the walk without ties
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
        problem = problem.without(PlaceFactors).join(places)
        problem = replace(problem, tied=places.footfalls, values=solved.values)
        try:
            solved = solve(problem)
        except EstimationError:
            return *open_walk, (), ("places that were recognized are not used: with them there is no solution",)
    assert path is not None
    # The moments of each stretch, and the field of both passes in the directions of the later one.
    points, returns = np.arange(len(path), dtype=float), list[Return]()
    for one in known:
        t, before = (np.interp(at, points, path.t) for at in (one.later, one.earlier))
        field, of_before = (interpolate_columns(at, points, path.field) for at in (one.later, one.earlier))
        of_before = of_before * TURNED if one.opposite else of_before
        length = float(np.ptp(np.interp(one.later, points, path.distance_m)))
        returns.append(Return(t, before, one.opposite, one.score, one.expected_false, length, field, of_before))
    many, total_m = format_count(len(returns), "return"), sum(one.length_m for one in returns)
    note = f"{many} to where the walk was before, {total_m:.0f} m in all, recognized by the field"
    return problem, solved, tuple(returns), (note,)


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


def mark_returns(table: StanceTable, returns: Sequence[Return]) -> StanceTable:
    """Write into a table which earlier footfall each was at the place of, by the surest stretch."""
    same, score = np.full(len(table), -1), np.zeros(len(table))
    for one in sorted(returns, key=lambda of: of.score):
        inside = np.flatnonzero((table.t >= one.t[0]) & (table.t <= one.t[-1]))
        same[inside] = find_footfalls(np.interp(table.t[inside], one.t, one.earlier_t), table.t)
        score[inside] = one.score
    return replace(table, same_place=same, place_score=score)
