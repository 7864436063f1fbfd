"""Recognized stretches that agree with each other and with the odometry: one false tie shall not bend a walk.

Symbols: of stretch a the points i_a (later) and j_a (earlier) of its middle, their positions p, the directions of
walking there. psi_a is by how much the path's heading turned between the two passes: the mean difference of the
directions of walking along the stretch, less half a turn where it was walked in the opposite direction.

Two stretches a and b close a cycle: from i_a along the path to i_b, over to j_b, along the path to j_a, and over to
i_a. With Rot(psi) the turn of the earlier part into the later part's frame,

    e = (p(i_b) - p(i_a)) - Rot(psi) (p(j_b) - p(j_a)),        psi = (psi_a + psi_b) / 2,

    sigma^2 = 2 tie^2 + odometry(i_a, i_b)^2 + odometry(j_a, j_b)^2 + (sigma_psi |p(j_b) - p(j_a)|)^2,

    |e|^2 / sigma^2 + (psi_b - psi_a)^2 / sigma_turn^2 <= chi^2 of 3 degrees of freedom (Mangelson et al. 2018: pairwise
    consistency maximization).

The set that is kept is the heaviest of greedy cliques, a stretch's weight being minus the logarithm of its expected
number of false recognitions. A stretch by itself has to be sure: `LONE_EXPECTED`. One that agrees with a sure one may
be less so, for an accident would have to happen at the one place where it agrees.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints, interpolate_columns
from fg_nav.frames import wrap_angle
from fg_nav.places.calibration import TINY
from fg_nav.places.candidates import Uncertainty
from fg_nav.places.recognition import ALONG_SIGMA_M, HEADING_SIGMA_RAD, LATERAL_SIGMA_M, Stretch
from fg_nav.places.signature import Signature

LONE_EXPECTED = 1e-3
"""False recognitions in a walk, with which a stretch is used that nothing confirms: one walk of a thousand."""

MAX_CHI2 = 16.3  # chi^2 of three degrees of freedom that one true pair in a thousand exceeds.
TURN_LENGTH_M = 6.0  # Of a stretch, whose directions of walking differ independently of those of the next piece.
MAX_STARTS = 20  # Stretches that a clique is grown from.


@dataclass(frozen=True)
class _Passes:
    """Of S stretches, at their middles: distances walked (S,), places (S, 2), turn (S,) rad with its variance (S,)."""

    later_m: Floats
    earlier_m: Floats
    later: Floats
    earlier: Floats
    turn: Floats
    turn_variance: Floats


def select_consistent(path: Signature, stretches: Sequence[Stretch], uncertainty: Uncertainty) -> tuple[Stretch, ...]:
    """Select the heaviest set of stretches in which each agrees with each other, the heaviest one first."""
    if not stretches:
        return ()
    expected = np.maximum([stretch.expected_false for stretch in stretches], TINY)
    chosen = _heaviest_clique(_agreement(_middle_passes(path, stretches), uncertainty), -np.log(expected))
    sure = expected[chosen].min() < LONE_EXPECTED if len(chosen) else False
    return tuple(stretches[k] for k in chosen) if sure else ()


def _heaviest_clique(agrees: Bools, weight: Floats) -> Ints:
    """Members of the heaviest clique, grown greedily from each of the heaviest members."""
    order = np.argsort(-weight, kind="stable")
    cliques = [_grow(int(start), order, agrees) for start in order[:MAX_STARTS]]
    heaviest = max(cliques, key=lambda members: float(weight[members].sum()))
    return heaviest[np.argsort(-weight[heaviest], kind="stable")]


def _grow(start: int, order: Ints, agrees: Bools) -> Ints:
    members = [start]
    for k in order:
        if k != start and agrees[k, members].all():
            members.append(int(k))
    return np.sort(members)


def _agreement(passes: _Passes, uncertainty: Uncertainty) -> Bools:
    """Whether stretches (S, S) agree."""
    a, b = np.triu_indices(len(passes.turn), 1)
    turned = wrap_angle(passes.turn[b] - passes.turn[a])
    psi = passes.turn[a] + 0.5 * turned
    earlier, later = passes.earlier[b] - passes.earlier[a], passes.later[b] - passes.later[a]
    error = later - _rotate(earlier, psi)
    # What the ties leave open, what the path adds between them, and the turn with its lever.
    d = [np.sort(np.stack([m[a], m[b]]), axis=0) for m in (passes.later_m, passes.earlier_m)]
    turn_variance = 0.25 * (passes.turn_variance[a] + passes.turn_variance[b])
    path_turn = sum(uncertainty.heading_rad(*ends) ** 2 for ends in d)
    variance = LATERAL_SIGMA_M**2 + ALONG_SIGMA_M**2 + sum(uncertainty.position_m(*ends) ** 2 for ends in d)
    variance = 2.0 * variance + (turn_variance + 0.25 * path_turn) * (earlier**2).sum(axis=1)
    chi2 = (error**2).sum(axis=1) / variance + turned**2 / (4.0 * turn_variance + path_turn)
    agrees = np.eye(len(passes.turn), dtype=bool)
    agrees[a, b] = agrees[b, a] = chi2 <= MAX_CHI2
    return agrees


def _rotate(vectors: Floats, angle: Floats) -> Floats:
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * vectors[:, 0] - s * vectors[:, 1], s * vectors[:, 0] + c * vectors[:, 1]], axis=1)


def _middle_passes(path: Signature, stretches: Sequence[Stretch]) -> _Passes:
    points = np.arange(len(path), dtype=float)
    middle = [len(s.later) // 2 for s in stretches]
    later = np.array([s.later[k] for s, k in zip(stretches, middle, strict=True)])
    earlier = np.array([s.earlier[k] for s, k in zip(stretches, middle, strict=True)])
    place = [interpolate_columns(at, points, path.position[:, :2]) for at in (later, earlier)]
    distance = [np.interp(at, points, path.distance_m) for at in (later, earlier)]
    independent = np.array([max(s.length_m / TURN_LENGTH_M, 1.0) for s in stretches])
    turn = np.array([_mean_turn(path, s) for s in stretches])
    variance = HEADING_SIGMA_RAD**2 / independent
    return _Passes(distance[0], distance[1], place[0], place[1], turn, variance)


def _mean_turn(path: Signature, stretch: Stretch) -> float:
    """By how much the heading of the path turned between the passes, rad."""
    points = np.arange(len(path), dtype=float)
    later, earlier = (np.interp(at, points, path.heading) for at in (stretch.later, stretch.earlier))
    turned = later - earlier - (np.pi if stretch.opposite else 0.0)
    return float(np.angle(np.mean(np.exp(1j * turned))))
