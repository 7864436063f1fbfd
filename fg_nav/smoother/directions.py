"""The directions of a building that a solved walk follows: found along its path, and made factors of its graph.

    repeat   courses of the solution   -> alpha along the walk, s and P   -> path turned by its drift -> solved again
    `ROUNDS` times

Displacements (`factors.BuildingDirection`) share no stride and lie in the middle of straight stretches, so that no
corner turns their course.

Tracking. In the frame of the drifted solution alpha is phi_k at displacement k, of course psi_k, a random walk on the
quarter circle, and a steady drift on top of it,

    phi_(k+1) = phi_k + b n_k + N(0, q n_k),    b ~ N(0, (sigma / F)^2),
    p(psi_k | phi_k) = (P N(wrap(psi_k - phi_k); 0, s^2) + (1 - P) 2/pi)^h_k,

n_k the strides between their middles of F, sigma that of the heading at any footfall relative to the start in the
solution, h_k the share of each displacement in its leg; q adds up to sigma^2 over the walk, within the bounds of
`DRIFT_DEG`. phi_0 is anything. Forward and backward passes on a grid give p(phi_k | all psi) and the likelihood (hidden
Markov model: Rabiner 1989), for each of some b; with the likeliest, s and P are estimated by expectation maximization.
No assignment is made: the graph's mixture has the same four directions. The path is turned by phi_0 - phi_k, to start
from. Reasons and limits: `docs/models.md`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import gtsam
import numpy as np
from gtsam.symbol_shorthand import A, X
from numpy.lib.stride_tricks import sliding_window_view

from fg_nav.arrays import Bools, Floats, Ints, find_runs
from fg_nav.errors import EstimationError
from fg_nav.factors.residual import ResidualBlock
from fg_nav.factors.walk_constraints import QUARTER, BuildingDirection, measure_course, odds_of_elsewhere, wrap_quarter
from fg_nav.frames import wrap_angle
from fg_nav.smoother.graph import WalkProblem, solve, turn_walk
from fg_nav.smoother.sensitivity import FootfallCovariance
from fg_nav.smoother.solver import GtsamFactors, Solved, list_covariances, list_positions
from fg_nav.text import format_count

STRIDES = 5  # Of a displacement: 7 m, over which weaving by 7 cm is 0.8 deg (0.07 sqrt(2) / 7 rad).
MIN_M = 2.5  # Displacements below this have no course of a walk: half a metre a stride.
STRAIGHT_WITHIN_M = 0.15  # Off the line between the ends of a straight displacement: two sigmas of weaving by 7 cm.
LEG_COURSES = 3.0  # Independent courses that a leg counts as at most.
NEW_LEG_RAD = np.radians(22.5)  # Change of course that begins another leg: a quarter of what is between two directions.
OPEN_RAD = 2.0 * np.pi  # Sigma of the prior of a direction: a full turn, as open as the heading behind a hole.
ROUNDS = 2  # The second finds s and P, and what follows the building, on a path without drift.
CELLS = 180  # Of the quarter circle, half a degree each: a third of the least sigma.
GRID = QUARTER * np.arange(CELLS) / CELLS
ITERATIONS = 10  # Of expectation maximization, which has s to some per cent by then.
FIRST_SIGMA_DEG, FIRST_SHARE = 4.0, 0.5
MIN_SIGMA_DEG, MAX_SIGMA_DEG = 1.5, 8.0
MIN_SHARE, MAX_SHARE = 0.05, 0.95  # Of P.
DRIFT_DEG = 5.0, 15.0  # Bounds of the random drift of a walk, one sigma: more of it is a bias, and steady.
RATE_STEP_DEG = 5.0  # Between steady drifts that are tried, at the end of the walk, up to `RATE_SIGMAS` either way.
RATE_SIGMAS = 3.0
LOST_DEG = 10.0  # Growth of the heading's sigma over a stride: behind a few of them any direction may be any other.
ANY_TURN = 10.0  # rad^2, of a turn that is uniform over the quarter circle.
MIN_EVIDENCE = 6.0  # Log likelihood over that of any courses: three numbers are chosen, half log M each, M = 50.
NONE_FOUND = "no directions of a building are used: the courses of the walk do not show any"


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


def make_direction_factors(node: Ints, piece: Ints, share: Floats, alpha: Floats, mixture: Mixture) -> DirectionFactors:
    """Tie pairs of nodes (M, 2) to the directions A(k) + m pi/2 of their piece k of the walk.

    Parameters
    ----------
    node, piece : (M, 2) end nodes of each displacement, and (M,) the piece it lies in.
    share : (M,) power of each likelihood, <= 1: displacements along one corridor share its error.
    alpha : (n,) rad, initial direction of each piece, and mean of its prior.
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
    # Non-overlapping displacements, centred in each straight run.
    first = [np.zeros(0, dtype=np.int64)]
    for begin, end in zip(*find_runs(find_straight(position)), strict=True):
        strides = end - begin + STRIDES - 1
        first.append(begin + strides % STRIDES // 2 + STRIDES * np.arange(strides // STRIDES))
    return np.asarray(np.concatenate(first)[:, None] + np.array([0, STRIDES]))


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


@dataclass(frozen=True)
class TrackedDirections:
    """Directions found along a walk.

    Attributes
    ----------
    phi : (M,) rad, unwrapped, at each displacement.
    mixture : s and P.
    evidence : log likelihood over that of courses that are anything.
    """

    phi: Floats
    mixture: Mixture
    evidence: float


def follow_directions(problem: WalkProblem, solved: Solved) -> tuple[WalkProblem, Solved, tuple[str, ...]]:
    """Find the building's directions on a solved walk; return problem, solution with them, and notes."""
    if not problem.parameters.walk.directions:
        return problem, solved, ()
    free = problem, solved
    for _ in range(ROUNDS):
        followed = add_directions(problem, solved)
        if followed is None:
            return *free, (NONE_FOUND,)
        problem, mixture = followed
        try:
            solved = solve(problem)
        except EstimationError:
            return *free, ("no directions of a building are used: with them there is no solution",)
    assert problem.directions is not None
    courses, sigma = format_count(len(problem.directions.courses), "course"), np.degrees(mixture.sigma)
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
    share = share_legs(course)
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
    return replace(problem, directions=factors, values=values), tracked.mixture


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

    Parameters
    ----------
    share : (M,) power of the likelihood of each course, <= 1.
    at : (M,) position of each course along the walk, 0 to 1.
    drift : sigma of heading drift over the whole walk, rad.
    is_lost : (M-1,) whether heading is lost (uniform turn) before the next course; None if nowhere.
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
        mixture = Mixture(float(sigma), float(np.clip(weight.sum() / share.sum(), MIN_SHARE, MAX_SHARE)))
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
