"""From a path with its field to the stretches of it that are one place, and what they are worth as ties.

A stretch is recognized where its local alignment with an earlier one scores more than chance does: the expected number
of chance alignments as good, in all that was searched (`alignment`), is below `MAX_EXPECTED`. Three conditions besides:

Position. With e the mean of p(later) - p(earlier) over the stretch and sigma that of the path and of the tie,

    D^2 = |e|^2 / sigma^2

is chi^2 of two degrees of freedom at one place. Beyond `MAX_CHI2` it is none, however alike: corridors next to each
other share large iron. Below, a chance alignment lies anywhere in the area, and a true one with the density
exp(-D^2 / 2): expected = chance(S) exp(D^2 / 2).

Likeness. At one place the score is 0.95 nats a metre where the model is right, 0.3 to 1.2 on real and simulated walks
(`place_recognition.py` of b894e160); a long stretch of less than `MIN_LIKENESS` resembles, as the next corridor does.

Rivals. A stretch that resembles two places, b as well as a, which are not one by the path's own uncertainty, is a
with the odds of their scores only,

    expected_a = expected(S_a) + sum over rivals b of exp(-lambda (S_a - S_b) + (D_a^2 - D_b^2) / 2).

A long walk is searched part by part, of `PART_M` each. What of a part was recognized for sure is compared with no later
one, so the cost grows with the ground that is covered times the walk.

Sharpness. A piece of a stretch is weighed at shifts s of the earlier pass about its alignment. With L(i, j) the log
likelihood ratio of points i and j, between two points by a cubic spline of the features, and all s as likely before,

    p(s) ~ exp(sum over the piece of L(i, j_i + s)),    |s| <= `REACH_M`,

the piece is at the mean of p, and its sigma along the path is that of p: `REACH_M` / sqrt 3 where the field shows
nothing.

Consistency. One false tie shall not bend a walk. Symbols: of stretch a the points i_a (later) and j_a (earlier) of its
middle, their positions p; psi_a by how much the path's heading turned between the two passes: the mean difference of
the directions of walking along the stretch, less half a turn where it was walked in the opposite direction. Two
stretches a and b close a cycle: from i_a along the path to i_b, over to j_b, along the path to j_a, and over to i_a.
With Rot(psi) the turn of the earlier part into the later part's frame,

    e = (p(i_b) - p(i_a)) - Rot(psi) (p(j_b) - p(j_a)),        psi = (psi_a + psi_b) / 2,

    sigma^2 = 2 tie^2 + odometry(i_a, i_b)^2 + odometry(j_a, j_b)^2 + (sigma_psi |p(j_b) - p(j_a)|)^2,

    |e|^2 / sigma^2 + (psi_b - psi_a)^2 / sigma_turn^2 <= chi^2 of 3 degrees of freedom (Mangelson et al. 2018: pairwise
    consistency maximization).

The set that is kept is the heaviest of greedy cliques, a stretch's weight being minus the logarithm of its expected
number of false recognitions. A stretch by itself has to be sure (`LONE_EXPECTED`); one that agrees with it less so.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints, interpolate_columns, weigh_models
from fg_nav.frames import average_angles, wrap_angle, yaw_rotation
from fg_nav.places.alignment import MIN_RATIO, RHO, SHARE, TINY, ChanceLevel, align, measure_chance, separate, trace
from fg_nav.places.candidates import (
    ALIKE_M,
    LIMIT,
    BlockPairs,
    Candidates,
    Drift,
    Uncertainty,
    find_candidates,
    pair_all,
)
from fg_nav.places.signature import BLOCK, MIN_POINTS, SPACING_M, Features, Signature, whiten

MAX_EXPECTED = 0.1  # False recognitions in a walk above which a stretch is not listed; see `select_consistent`.
SURE_EXPECTED = 1e-6  # ... with which a stretch needs no confirmation before later parts rest on it.
LONE_EXPECTED = 1e-3  # ... with which a stretch is used that nothing confirms: one walk of a thousand.
MAX_CHI2 = 13.8  # D^2 that one true stretch in a thousand exceeds.
MIN_LIKENESS = 0.2  # Score of a stretch, nats a metre: a fifth of what the model expects.
MAX_CHANCE_M2 = 5e5  # Area in which chance alignments are counted: there are some hundred in it.
PART_M = 2000.0  # Of a walk, half an hour.
AVERAGE_M = 6.0  # Over which the steps of an alignment are averaged: its points are 0.5 m apart, the path is even.
ALONG_SIGMA_M = 0.3  # Of a tie along the path: 0.2 m rms on simulated rough floors.
LATERAL_SIGMA_M = 0.6  # Of a tie to the side: two walks along one corridor, each within 0.4 m of its middle line.
UP_SIGMA_M = 0.2  # Of the heights: a floor is level, a ramp is not at the tie's own sigma along it.
HEADING_SIGMA_RAD = np.deg2rad(8.0)  # Of the directions of walking there: 0.35 m aside within 5 m.
REACH_M = 2.0  # By which places differ that are walked as one, and the shortest wavelength: beyond, the next one fits.
SHIFTS_M = np.linspace(-REACH_M, REACH_M, 33)  # An eighth of a metre apart: a rough floor shows 20 m of path to 0.1 m.
MARGIN = 8  # Points around a piece, beyond which a spline through them is the same.
MAX_CYCLE_CHI2 = 16.3  # chi^2 of three degrees of freedom that one true pair in a thousand exceeds.
TURN_LENGTH_M = 6.0  # Of a stretch, whose directions of walking differ independently of those of the next piece.
MAX_STARTS = 20  # Stretches that a clique is grown from.


@dataclass(frozen=True)
class Stretch:
    """A stretch that was recognized as an earlier one."""

    later: Floats  #: (M,) points of the signature, of which each is one place with that of `earlier`.
    earlier: Floats  #: (M,) in the order of the later walk; they may lie between two points.
    opposite: bool  #: Whether it was walked in the opposite direction.
    score: float  #: Log likelihood ratio of one place over two, of the model, nats.
    expected_false: float  #: False recognitions as good as this one that are expected in the whole walk.

    @property
    def length_m(self) -> float:
        """Of the later walk."""
        return float(self.later[-1] - self.later[0]) * SPACING_M

    def move_earlier(self, shift_m: float) -> Floats:
        """Return the earlier points (M,), so many m further on as the later walk goes."""
        return self.earlier + (-shift_m if self.opposite else shift_m) / SPACING_M


@dataclass(frozen=True)
class Recognition:
    """Stretches that were recognized, the best one first, and what chance does in the area that was searched."""

    stretches: tuple[Stretch, ...]
    chance: ChanceLevel


NOTHING = Recognition((), measure_chance(np.zeros(0), 0.0, 0.0))  # Of a path too short to return on.


def recognize(path: Signature, uncertainty: Uncertainty = Drift()) -> Recognition:
    """Find the stretches of a path that were walked before; `uncertainty` is of a place relative to another."""
    if len(path) < MIN_POINTS:
        return NOTHING
    pairs = find_candidates(path, uncertainty)
    if not (len(pairs.same) or len(pairs.opposite)):
        return NOTHING
    features = whiten(path)
    chance = _measure_chance(features, features, pairs)
    # part by part, along all that was walked for the first time
    part = np.arange(len(features) // BLOCK) * BLOCK * SPACING_M // PART_M
    is_first, stretches = np.ones(len(part), dtype=bool), list[Stretch]()
    for number in np.unique(part):
        found = _search(features, features, pairs.select(part == number, is_first), chance, len(path))
        weighed = _weigh_positions(found, chance, path, uncertainty)
        stretches += weighed
        # blocks within what was recognized for sure are no first pass
        for one in weighed:
            if one.expected_false < SURE_EXPECTED:
                is_first[-(-int(one.later[0]) // BLOCK) : (int(one.later[-1]) + 1) // BLOCK] = False
    return Recognition(tuple(sorted(stretches, key=lambda stretch: -stretch.score)), chance)


def recognize_known(path: Signature, known: Signature) -> Recognition:
    """Find the stretches of a path that lie on that of an earlier walk, wherever; `earlier` are points of that one.

    Both are whitened with the spectra of the longer path: a short one does not determine its own, and different filters
    would decorrelate the same place.
    """
    if min(len(path), len(known)) < MIN_POINTS:
        return NOTHING
    longer = max(path, known, key=len)
    features, old = whiten(path, longer), whiten(known, longer)
    everywhere = pair_all(len(features), len(old))
    pairs = Candidates(everywhere, everywhere)
    chance = _measure_chance(features, old, pairs)
    return Recognition(tuple(_search(features, old, pairs, chance, len(known))), chance)


def _measure_chance(features: Features, old: Features, pairs: Candidates) -> ChanceLevel:
    """Measure what chance does over pairs of blocks with an earlier path, from an even part of their area, m^2."""
    area = pairs.area_m2
    every = int(np.ceil(area / MAX_CHANCE_M2)) if area else 1
    thin = [(other.negate(), some.thin(every)) for other, some, _ in _list_relations(old, pairs)]
    scores = np.concatenate([separate(align(features, other, some)).score for other, some in thin])
    return measure_chance(scores, sum(some.area_m2 for _, some in thin), area)


def _list_relations(old: Features, pairs: Candidates) -> Iterator[tuple[Features, BlockPairs, bool]]:
    """Yield an earlier path and the pairs with it, as it was walked and in the opposite direction."""
    yield old, pairs.same, False
    yield old.reverse(), pairs.opposite.reverse(len(old) // BLOCK), True


def _search(features: Features, old: Features, pairs: Candidates, chance: ChanceLevel, length: int) -> list[Stretch]:
    """Return the stretches above the chance level, best first; the earlier path has `length` points."""
    stretches = []
    for other, some, opposite in _list_relations(old, pairs):
        found = separate(align(features, other, some, chance.score_of(MAX_EXPECTED)))
        expected = chance.expected(found.score)
        for a in range(len(found)):
            # points of the later walk, each once, and those of the earlier one by the mean of the steps between
            points = trace(features, other, found.begin[a], found.end[a])
            later = np.arange(points[0, 0], points[-1, 0] + 1)
            total = np.bincount(points[:, 0] - later[0], points[:, 1])
            shift = total / np.bincount(points[:, 0] - later[0]) - later
            width = min(round(AVERAGE_M / SPACING_M), (len(shift) - 1) // 2 * 2) | 1
            window = np.ones(min(width, len(shift)))
            mean = np.convolve(shift, window, "same") / np.convolve(np.ones(len(shift)), window, "same")
            earlier = later + mean
            earlier = len(other) - 1 - earlier if opposite else earlier
            inside, score = (earlier >= 0) & (earlier <= length - 1), float(found.score[a])
            one = Stretch(later.astype(float)[inside], earlier[inside], opposite, score, float(expected[a]))
            stretches.append(one)
    return sorted(stretches, key=lambda stretch: -stretch.score)


def _weigh_positions(
    stretches: Sequence[Stretch], chance: ChanceLevel, path: Signature, uncertainty: Uncertainty
) -> tuple[Stretch, ...]:
    """Stretches with `expected_false` raised for position mismatch and rivals; only those below `MAX_EXPECTED`."""
    # likeness and position
    some, chi2s = list[Stretch](), list[float]()
    for stretch in stretches:
        if stretch.score < MIN_LIKENESS * stretch.length_m:
            continue
        d, place = _passes(stretch.later, stretch.earlier, path)
        sigma = uncertainty.position_m(np.mean(d[1], keepdims=True), np.mean(d[0], keepdims=True))[0]
        off = float(np.sum(np.mean(place[0] - place[1], axis=0) ** 2) / (sigma**2 + LATERAL_SIGMA_M**2))
        if off <= MAX_CHI2:
            some.append(stretch)
            chi2s.append(off)
    if not some:
        return ()
    # rivals
    chi2 = np.array(chi2s)
    score, expected = np.array([s.score for s in some]), np.array([s.expected_false for s in some])
    one, other = _list_rivals(some, path, uncertainty)
    odds = np.exp(np.minimum(chance.decay * (score[other] - score[one]) + 0.5 * (chi2[one] - chi2[other]), 0.0))
    expected = expected * np.exp(0.5 * chi2) + np.bincount(one, odds, len(some))
    weighed = (replace(stretch, expected_false=float(e)) for stretch, e in zip(some, expected, strict=True))
    return tuple(stretch for stretch in weighed if stretch.expected_false < MAX_EXPECTED)


def _passes(first: Floats, second: Floats, path: Signature) -> tuple[list[Floats], list[Floats]]:
    """Distances walked (M,) and places (M, 2) at points (M,) and (M,) of a path."""
    points = np.arange(len(path), dtype=float)
    d = [np.interp(at, points, path.distance_m) for at in (first, second)]
    place = [interpolate_columns(at, points, path.position[:, :2]) for at in (first, second)]
    return d, place


def _list_rivals(stretches: Sequence[Stretch], path: Signature, uncertainty: Uncertainty) -> tuple[Ints, Ints]:
    """Indices (M,), (M,) of pairs of stretches that put the same piece of the walk at two distinct places."""
    begin, end = (np.array([stretch.later[k] for stretch in stretches]) for k in (0, -1))
    low, high = np.maximum(begin[:, None], begin), np.minimum(end[:, None], end)
    overlaps = high - low >= 0.5 * np.minimum((end - begin)[:, None], end - begin)
    np.fill_diagonal(overlaps, False)
    one, other = np.nonzero(overlaps)
    middle = 0.5 * (low + high)[one, other]
    # the earlier pass of each there: its points follow each other, the number of one is its place in the stretch
    ends = np.cumsum([0, *(len(stretch.later) for stretch in stretches)])
    earlier = np.concatenate([stretch.earlier for stretch in stretches])
    first, second = (
        np.asarray(np.interp(ends[rows] + middle - begin[rows], np.arange(len(earlier)), earlier))
        for rows in (one, other)
    )
    d, place = _passes(first, second, path)
    limit = LIMIT * uncertainty.position_m(np.minimum(*d), np.maximum(*d)) + 2.0 * ALIKE_M
    rivals = np.linalg.norm(place[1] - place[0], axis=1) > limit
    return one[rivals], other[rivals]


# sharpness


def weigh_shifts(features: Features, stretch: Stretch) -> Floats:
    """Log-likelihood ratio (M, S) nats at each point of a stretch, the earlier pass shifted by `SHIFTS_M` (S,)."""
    from scipy.interpolate import CubicSpline  # loaded where something was recognized

    last = len(features) - 1.0
    other, earlier = (features.reverse(), last - stretch.earlier) if stretch.opposite else (features, stretch.earlier)
    at = np.clip(earlier[:, None] + SHIFTS_M / SPACING_M, 0.0, last)
    # the earlier pass, and what of it is the field's, between its points
    near = np.arange(max(int(at.min()) - MARGIN, 0), min(int(at.max()) + MARGIN, len(other)))
    y = CubicSpline(near, other.values[near])(at)
    signal = np.stack([np.interp(at, near, column) for column in other.signal[near].T], axis=2)
    later = stretch.later.astype(np.int64)[:, None]
    x, r = features.values[later], RHO * features.signal[later] * signal
    ratio = -0.5 * np.log1p(-(r**2)) - (r**2 * (x**2 + y**2) - 2.0 * r * x * y) / (2.0 * (1.0 - r**2))
    return np.asarray(SHARE * np.maximum(ratio.sum(axis=2), MIN_RATIO))


def find_shift(ratio: Floats) -> tuple[float, float]:
    """Return the shift, m, of a piece whose points have these L (M, S), and its sigma."""
    p = weigh_models(ratio.sum(axis=0))
    mean = float(p @ SHIFTS_M)
    step = SHIFTS_M[1] - SHIFTS_M[0]
    return mean, float(np.sqrt(p @ (SHIFTS_M - mean) ** 2 + step**2 / 12.0))


# consistency


def select_consistent(path: Signature, stretches: Sequence[Stretch], uncertainty: Uncertainty) -> tuple[Stretch, ...]:
    """Select the heaviest clique of mutually consistent stretches, grown greedily; heaviest stretch first."""
    if not stretches:
        return ()
    agrees = _agreement(path, stretches, uncertainty)
    expected = np.maximum([stretch.expected_false for stretch in stretches], TINY)
    weight = -np.log(expected)
    order = np.argsort(-weight, kind="stable")
    # cliques, grown greedily from each of the heaviest members
    cliques = []
    for start in order[:MAX_STARTS].tolist():
        members = [start]
        for k in order.tolist():
            if k != start and agrees[k, members].all():
                members.append(k)
        cliques.append(np.sort(members))
    heaviest = max(cliques, key=lambda members: float(weight[members].sum()))
    if expected[heaviest].min() >= LONE_EXPECTED:
        return ()
    return tuple(stretches[k] for k in heaviest[np.argsort(-weight[heaviest], kind="stable")])


def _agreement(path: Signature, stretches: Sequence[Stretch], uncertainty: Uncertainty) -> Bools:
    """Flags (S, S) of pairs of stretches whose offsets agree within drift."""
    # distances walked and places at their middles, and the turn of the path between the passes, rad
    middle = [len(s.later) // 2 for s in stretches]
    later_at = np.array([s.later[k] for s, k in zip(stretches, middle, strict=True)])
    earlier_at = np.array([s.earlier[k] for s, k in zip(stretches, middle, strict=True)])
    walked, (later, earlier) = _passes(later_at, earlier_at, path)
    points, turns = np.arange(len(path), dtype=float), []
    for s in stretches:
        now, then = (np.interp(at, points, path.heading) for at in (s.later, s.earlier))
        turned = now - then - (np.pi if s.opposite else 0.0)
        turns.append(average_angles(turned))
    turn = np.array(turns)
    own_variance = HEADING_SIGMA_RAD**2 / np.array([max(s.length_m / TURN_LENGTH_M, 1.0) for s in stretches])
    # misclosure of each pair's cycle
    a, b = np.triu_indices(len(turn), 1)
    turned = wrap_angle(turn[b] - turn[a])
    psi = turn[a] + 0.5 * turned
    before = earlier[b] - earlier[a]
    error = later[b] - later[a] - (yaw_rotation(psi)[:, :2, :2] @ before[:, :, None])[:, :, 0]
    # its variance: the ties, the path between them, and the turn with its lever
    d = [np.sort(np.stack([m[a], m[b]]), axis=0) for m in walked]
    turn_variance = 0.25 * (own_variance[a] + own_variance[b])
    path_turn = sum(uncertainty.heading_rad(*ends) ** 2 for ends in d)
    variance = LATERAL_SIGMA_M**2 + ALONG_SIGMA_M**2 + sum(uncertainty.position_m(*ends) ** 2 for ends in d)
    variance = 2.0 * variance + (turn_variance + 0.25 * path_turn) * (before**2).sum(axis=1)
    chi2 = (error**2).sum(axis=1) / variance + turned**2 / (4.0 * turn_variance + path_turn)
    agrees = np.eye(len(turn), dtype=bool)
    agrees[a, b] = agrees[b, a] = chi2 <= MAX_CYCLE_CHI2
    return agrees
