"""From a path with its field to the stretches of it that are one place.

A stretch is recognized where its local alignment with an earlier one scores more than chance does: the expected number
of chance alignments as good, in all that was searched (`calibration`), is below `MAX_EXPECTED`. Three things are
asked besides.

Position. With e the mean of p(later) - p(earlier) over the stretch and sigma that of the path and of the tie,

    D^2 = |e|^2 / sigma^2

is chi^2 of two degrees of freedom at one place. Beyond `MAX_CHI2` it is none, however alike: corridors next to each
other share large iron. Below, a chance alignment lies anywhere in the area, and a true one with the density
exp(-D^2 / 2): expected = chance(S) exp(D^2 / 2).

Likeness. At one place the score is 0.95 nats a meter where the model is right, 0.3 to 1.2 on real and simulated walks
(`scripts/place_recognition.py`); a long stretch of less than `MIN_LIKENESS` resembles, as the next corridor does.

Rivals. A stretch that resembles two places, b as well as a, which are not one by the path's own uncertainty, is a
with the odds of their scores only,

    expected_a = expected(S_a) + sum over rivals b of exp(-lambda (S_a - S_b) + (D_a^2 - D_b^2) / 2).

A building that repeats itself thereby takes its own recognitions back.

A long walk is searched part by part, of `PART_M` each. What of a part was recognized for sure is compared with no later
one: what comes back to it finds its first pass too. So the cost grows with the ground that is covered times the walk,
and not with the square of the laps.

What a stretch is worth as a tie of two poses: along the path it is as sharp as the alignment, the mean of its steps
over `AVERAGE_M`; to the side it has the freedom of a corridor, for who walks it again does not walk in his own
footprints, and the field does not show by how much.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints, interpolate_columns
from fg_nav.places.alignment import align, separate, trace
from fg_nav.places.calibration import ChanceLevel, measure_chance
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
from fg_nav.places.signature import BLOCK, MIN_POINTS, SPACING_M, Signature
from fg_nav.places.whitening import Features, whiten

MAX_EXPECTED = 0.1
"""False recognitions in a walk above which a stretch is not listed. What is used is decided in `consistency`."""

MAX_CHI2 = 13.8  # D^2 that one true stretch in a thousand exceeds.
MIN_LIKENESS = 0.2  # Score of a stretch, nats a meter: a fifth of what the model expects.
MAX_CHANCE_M2 = 5e5  # Area in which chance alignments are counted: there are some hundred in it.
PART_M = 2000.0  # Of a walk, half an hour.

SURE_EXPECTED = 1e-6
"""False recognitions in a walk, with which a stretch needs no confirmation before later parts rest on it."""

AVERAGE_M = 6.0
"""Over which the steps of an alignment are averaged: its points are half a meter apart, the path is even."""

ALONG_SIGMA_M = 0.3
"""Of a tie along the path: rms of simulated walks on rough floors is 0.2 m (`scripts/place_recognition.py`)."""

LATERAL_SIGMA_M = 0.6  # Of a tie to the side: two walks along one corridor, each within 0.4 m of its middle line.
UP_SIGMA_M = 0.2  # Of the heights: a floor is level, a ramp is not at the tie's own sigma along it.
HEADING_SIGMA_RAD = np.deg2rad(8.0)  # Of the directions of walking there: 0.35 m aside within 5 m.


@dataclass(frozen=True)
class Stretch:
    """A stretch that was recognized as an earlier one.

    Attributes
    ----------
    later, earlier : (M,) points of the signature that are one place, in the order of the later walk. `earlier` may lie
        between two points.
    opposite : whether it was walked in the opposite direction.
    score : log likelihood ratio of one place over two, of the model, nats.
    expected_false : false recognitions as good as this one that are expected in the whole walk.
    """

    later: Floats
    earlier: Floats
    opposite: bool
    score: float
    expected_false: float

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
    area_m2: float


NOTHING = Recognition((), measure_chance(np.zeros(0), 0.0, 0.0), 0.0)  # Of a path too short to return on.


def recognize(path: Signature, uncertainty: Uncertainty = Drift()) -> Recognition:
    """Find the stretches of a path that were walked before.

    Parameters
    ----------
    path : the field along it.
    uncertainty : of one place of the path relative to another.
    """
    if len(path) < MIN_POINTS:
        return NOTHING
    pairs = find_candidates(path, uncertainty)
    if not (len(pairs.same) or len(pairs.opposite)):
        return NOTHING
    features = whiten(path)
    chance, area = _measure_chance(features, features, pairs)
    # Part by part, along all that was walked for the first time.
    part = np.arange(len(features) // BLOCK) * BLOCK * SPACING_M // PART_M
    is_first, stretches = np.ones(len(part), dtype=bool), list[Stretch]()
    for number in np.unique(part):
        some = pairs.select(part == number, is_first)
        found = _sort_by_score(_search(features, features, some, chance, len(path)))
        weighed = _weigh_positions(found, chance, path, uncertainty)
        _mark_recognized(is_first, weighed)
        stretches += weighed
    return Recognition(_sort_by_score(stretches), chance, area)


def _sort_by_score(stretches: Iterable[Stretch]) -> tuple[Stretch, ...]:
    return tuple(sorted(stretches, key=lambda stretch: -stretch.score))


def _mark_recognized(is_first: Bools, stretches: Sequence[Stretch]) -> None:
    """Note which blocks (B,) lie within stretches that were recognized for sure: these are no first pass."""
    for stretch in stretches:
        if stretch.expected_false < SURE_EXPECTED:
            is_first[-(-int(stretch.later[0]) // BLOCK) : (int(stretch.later[-1]) + 1) // BLOCK] = False


def recognize_known(path: Signature, known: Signature) -> Recognition:
    """Find the stretches of a path that lie on that of an earlier walk, wherever; `earlier` are points of that one.

    Both are filtered alike, by the spectra of the longer one: a short one does not show its own, and two filters would
    make two signals of one place.
    """
    if min(len(path), len(known)) < MIN_POINTS:
        return NOTHING
    longer = max(path, known, key=len)
    features, old = whiten(path, longer), whiten(known, longer)
    everywhere = pair_all(len(features), len(old))
    pairs = Candidates(everywhere, everywhere)
    chance, area = _measure_chance(features, old, pairs)
    return Recognition(_sort_by_score(_search(features, old, pairs, chance, len(known))), chance, area)


def _measure_chance(features: Features, old: Features, pairs: Candidates) -> tuple[ChanceLevel, float]:
    """Measure what chance does over pairs of blocks with an earlier path, from an even part of their area, m^2."""
    area = pairs.area_m2
    every = int(np.ceil(area / MAX_CHANCE_M2)) if area else 1
    thin = [(other.negate(), some.thin(every)) for other, some, _ in _list_relations(old, pairs)]
    scores = np.concatenate([separate(align(features, other, some)).score for other, some in thin])
    return measure_chance(scores, sum(some.area_m2 for _, some in thin), area), area


def _list_relations(old: Features, pairs: Candidates) -> Iterator[tuple[Features, BlockPairs, bool]]:
    """Yield an earlier path and the pairs with it, as it was walked and in the opposite direction."""
    yield old, pairs.same, False
    yield old.reverse(), pairs.opposite.reverse(len(old) // BLOCK), True


def _search(
    features: Features, old: Features, pairs: Candidates, chance: ChanceLevel, length: int
) -> Iterator[Stretch]:
    """Yield what chance does not explain, point by point, of an earlier path of so many points."""
    for other, some, is_opposite in _list_relations(old, pairs):
        yield from _trace_all(features, other, some, is_opposite, chance, length)


def _trace_all(
    features: Features, other: Features, pairs: BlockPairs, opposite: bool, chance: ChanceLevel, length: int
) -> list[Stretch]:
    """Stretches of the alignments that chance does not explain; `length` of the earlier path in points."""
    found = separate(align(features, other, pairs, chance.score_of(MAX_EXPECTED)))
    expected = chance.expected(found.score)
    stretches = []
    for a in range(len(found)):
        later, earlier = _even(trace(features, other, found.begin[a], found.end[a]))
        earlier = len(other) - 1 - earlier if opposite else earlier
        inside = (earlier >= 0) & (earlier <= length - 1)
        stretches.append(Stretch(later[inside], earlier[inside], opposite, float(found.score[a]), float(expected[a])))
    return stretches


def _even(points: Ints) -> tuple[Floats, Floats]:
    """Points (M,) of the later walk, each once, and those of the earlier one, by the mean of the steps between."""
    later = np.arange(points[0, 0], points[-1, 0] + 1)
    total = np.bincount(points[:, 0] - later[0], points[:, 1])
    shift = total / np.bincount(points[:, 0] - later[0]) - later
    width = min(round(AVERAGE_M / SPACING_M), (len(shift) - 1) // 2 * 2) | 1
    window = np.ones(min(width, len(shift)))
    mean = np.convolve(shift, window, "same") / np.convolve(np.ones(len(shift)), window, "same")
    return later.astype(float), later + mean


def _weigh_positions(
    stretches: Sequence[Stretch], chance: ChanceLevel, path: Signature, uncertainty: Uncertainty
) -> tuple[Stretch, ...]:
    """Stretches with what their positions and their rivals take away, without those of which too little is left."""
    likely = [stretch for stretch in stretches if stretch.score >= MIN_LIKENESS * stretch.length_m]
    chi2 = np.array([_distance_chi2(stretch, path, uncertainty) for stretch in likely])
    near = np.flatnonzero(chi2 <= MAX_CHI2)
    if not len(near):
        return ()
    some, chi2 = [likely[k] for k in near], chi2[near]
    score, expected = np.array([s.score for s in some]), np.array([s.expected_false for s in some])
    one, other = _list_rivals(some, path, uncertainty)
    odds = np.exp(np.minimum(chance.decay * (score[other] - score[one]) + 0.5 * (chi2[one] - chi2[other]), 0.0))
    expected = expected * np.exp(0.5 * chi2) + np.bincount(one, odds, len(some))
    weighed = (replace(stretch, expected_false=float(e)) for stretch, e in zip(some, expected, strict=True))
    return tuple(stretch for stretch in weighed if stretch.expected_false < MAX_EXPECTED)


def _distance_chi2(stretch: Stretch, path: Signature, uncertainty: Uncertainty) -> float:
    """D^2 of a stretch."""
    d, place = _passes(stretch.later, stretch.earlier, path)
    sigma = uncertainty.position_m(np.mean(d[1], keepdims=True), np.mean(d[0], keepdims=True))[0]
    return float(np.sum(np.mean(place[0] - place[1], axis=0) ** 2) / (sigma**2 + LATERAL_SIGMA_M**2))


def _passes(first: Floats, second: Floats, path: Signature) -> tuple[list[Floats], list[Floats]]:
    """Distances walked (M,) and places (M, 2) at points (M,) and (M,) of a path."""
    points = np.arange(len(path), dtype=float)
    d = [np.interp(at, points, path.distance_m) for at in (first, second)]
    place = [interpolate_columns(at, points, path.position[:, :2]) for at in (first, second)]
    return d, place


def _list_rivals(stretches: Sequence[Stretch], path: Signature, uncertainty: Uncertainty) -> tuple[Ints, Ints]:
    """Pairs (M,), (M,) of stretches which say that one piece of the walk is at two places that are not one."""
    begin, end = (np.array([stretch.later[k] for stretch in stretches]) for k in (0, -1))
    low, high = np.maximum(begin[:, None], begin), np.minimum(end[:, None], end)
    overlaps = high - low >= 0.5 * np.minimum((end - begin)[:, None], end - begin)
    np.fill_diagonal(overlaps, False)
    one, other = np.nonzero(overlaps)
    middle = 0.5 * (low + high)[one, other]
    first, second = (_earlier_at(stretches, rows, middle) for rows in (one, other))
    rivals = _apart(first, second, path, uncertainty)
    return one[rivals], other[rivals]


def _earlier_at(stretches: Sequence[Stretch], rows: Ints, later: Floats) -> Floats:
    """Points (M,) of the earlier pass at those of the later one, each of one of the stretches `rows` (M,)."""
    ends = np.cumsum([0, *(len(stretch.later) for stretch in stretches)])
    begin = np.array([stretch.later[0] for stretch in stretches])
    earlier = np.concatenate([stretch.earlier for stretch in stretches])
    # The points of the later pass follow each other: the number of one is its place in the stretch.
    return np.asarray(np.interp(ends[rows] + later - begin[rows], np.arange(len(earlier)), earlier))


def _apart(first: Floats, second: Floats, path: Signature, uncertainty: Uncertainty) -> Bools:
    """Whether points (M,) and (M,) of a path are different places, by its own uncertainty."""
    d, place = _passes(first, second, path)
    limit = LIMIT * uncertainty.position_m(np.minimum(*d), np.maximum(*d)) + 2.0 * ALIKE_M
    return np.asarray(np.linalg.norm(place[1] - place[0], axis=1) > limit)
