"""Factors between the footfalls of a walk that are at one place (`fg_nav.places`, `factors.same_place`).

The earliest pass of each place is divided into cells by distance, and has one footfall in each to which all later
passes are tied: so no error adds up from lap to lap, and few footfalls are joined over the walk (`postpone`).
What is tied are the means of both passes over the cell, relative to their footfalls: two passes along a corridor are
aside of each other by decimeters here and there, and less on the mean. With an independent error every `APART_M`,

    sigma = sigma_one / sqrt(length / APART_M),

and along the path, on top of that, what the field leaves open of the shift between the passes (`places.recognition`),
which is taken off first. A field that hardly changes ties weakly.

A piece of the walk is tied to its earliest pass only.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from gtsam.symbol_shorthand import X

from fg_nav.arrays import Bools, Floats, Ints, interpolate_columns
from fg_nav.factors.residual import LETTER_SHIFT, Keys, ResidualBlock
from fg_nav.factors.same_place import SamePlace, weigh_place
from fg_nav.places import Signature, Stretch
from fg_nav.places.recognition import ALONG_SIGMA_M, LATERAL_SIGMA_M, UP_SIGMA_M, find_shift, weigh_shifts
from fg_nav.places.signature import SPACING_M, Features, whiten
from fg_nav.smoother.strides import Nodes

CELL_M, MAX_CELLS = 20.0, 60
"""Length of a cell, and how many there are at most: where more ground is walked again, they are longer. The last fronts
hold all cells, but the passes one after the other."""

MIN_SHARE = 0.5  # Of a cell that a pass has to cover.
APART_M = 6.0  # Between independent errors of a pass: those of an alignment, and the wander of a person.


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


@dataclass(frozen=True)
class _Tie:
    """Mean places (3,) m of two passes over a cell, the direction of walking, rad, and how many errors they average.

    `shift_sigma` m is that of the shift along the path between them. `later_s` is in the middle of the later pass,
    `cell_s` in that of the cell, which all passes of it share.
    """

    later_s: float
    cell_s: float
    later: Floats
    earlier: Floats
    heading: float
    count: float
    shift_sigma: float

    @property
    def moments(self) -> tuple[float, float]:
        """Of the two footfalls; where a walk turns back within a cell they are one, and nothing is tied."""
        return self.later_s, self.cell_s


def make_place_factors(
    path: Signature, stretches: Sequence[Stretch], t: Floats, position: Floats, nav_R_body: Floats, node: Ints
) -> PlaceFactors:
    """Tie the footfalls of recognized stretches.

    Parameters
    ----------
    t, position, nav_R_body : of the F footfalls; s, m.
    node : (F,) of the footfalls.
    """
    ties = [tie for tie in _choose_earliest(path, stretches) if len(set(find_footfalls(tie.moments, t))) == 2]
    later, earlier = ([getattr(tie, name) for tie in ties] for name in ("later", "earlier"))
    foot = list(np.array([find_footfalls(tie.moments, t) for tie in ties], dtype=np.int64).reshape(-1, 2).T)
    in_body = [
        np.einsum("kji,kj->ki", nav_R_body[at], np.reshape(place, (-1, 3)) - position[at])
        for at, place in zip(foot, (later, earlier), strict=True)
    ]
    heading, count, shift_sigma = np.reshape([[tie.heading, tie.count, tie.shift_sigma] for tie in ties], (-1, 3)).T
    along = np.hypot(ALONG_SIGMA_M / np.sqrt(count), shift_sigma)
    weight = weigh_place(heading, along, LATERAL_SIGMA_M / np.sqrt(count), UP_SIGMA_M)
    keys = [(X(int(node[a])), X(int(node[b]))) for a, b in zip(*foot, strict=True)]
    return PlaceFactors(SamePlace(in_body[0], in_body[1], weight), keys, np.unique(np.concatenate(foot)))


def find_footfalls(at: Sequence[float] | Floats, t: Floats) -> Ints:
    """Find the footfalls (M,), of those at times t (F,) s, nearest to moments (M,) s."""
    return np.asarray(np.searchsorted(0.5 * (t[1:] + t[:-1]), at))


def _choose_earliest(path: Signature, stretches: Sequence[Stretch]) -> list[_Tie]:
    """Tie each piece of the walk to its earliest pass."""
    length = max(CELL_M, _measure_ground(path, stretches) / MAX_CELLS)
    pieces = [piece for stretch in stretches for piece in _cut_into_cells(path, stretch, length)]
    chosen: dict[int, _Piece] = {}
    for piece in sorted(pieces, key=lambda one: one.cell_m):
        chosen.setdefault(int(piece.later_m // length), piece)
    # Their ties, where the field of each has the earlier pass.
    features = whiten(path)
    return [_make_tie(path, features, piece) for piece in chosen.values()]


def _measure_ground(path: Signature, stretches: Sequence[Stretch]) -> float:
    """Length, m, of the first passes: of what is walked again, and was not itself recognized."""
    is_first = np.zeros(len(path), dtype=bool)
    for stretch in stretches:
        is_first[int(stretch.earlier.min()) : int(stretch.earlier.max()) + 1] = True
    for stretch in stretches:
        is_first[int(stretch.later[0]) : int(stretch.later[-1]) + 1] = False
    return float(is_first.sum()) * SPACING_M


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


def _make_tie(path: Signature, features: Features, piece: _Piece) -> _Tie:
    """Tie a piece to the earlier pass, moved to where the field has it."""
    points, stretch = np.arange(len(path), dtype=float), piece.stretch
    shift, sigma = find_shift(weigh_shifts(features, stretch))
    earlier = stretch.move_earlier(shift)
    inside = (earlier >= 0.0) & (earlier <= points[-1])
    # A shift that leaves nothing of the walk is none.
    later, earlier = (stretch.later[inside], earlier[inside]) if inside.any() else (stretch.later, stretch.earlier)
    return _Tie(
        later_s=float(np.interp(piece.later_m, path.distance_m, path.t)),
        cell_s=float(np.interp(piece.cell_m, path.distance_m, path.t)),
        later=_mean_place(path, points, later),
        earlier=_mean_place(path, points, earlier),
        heading=float(np.interp(later.mean(), points, path.heading)),
        count=max(piece.covered_m / APART_M, 1.0),
        shift_sigma=sigma,
    )


def _mean_place(path: Signature, points: Floats, at: Floats) -> Floats:
    """Mean (3,) of the places at points (M,) of a path."""
    return np.asarray(interpolate_columns(at, points, path.position).mean(axis=0))


def postpone(keys: Keys, nodes: Nodes, tied: Ints) -> Keys:
    """Eliminate `tied` footfalls (n,) of a walk, which factors join over the walk, last and the newest of them first.

    In the order of time every front between two footfalls at one place would carry the later one. A tied footfall is
    left with all that joins its past to its future: then what lies between two of them is a chain by itself, and what
    is left a short one. Floors and the direction of a building, which join many, end the order.
    """
    is_last, is_common = split_tied(keys, nodes, tied)
    return np.concatenate([keys[~is_last & ~is_common], keys[is_last][::-1], keys[is_common]])


def split_tied(keys: Keys, nodes: Nodes, tied: Ints) -> tuple[Bools, Bools]:
    """Whether each key is of a tied footfall, its node, bias, settling and state of the field; and of what many join.

    `tied` (n,) are footfalls of the walk.
    """
    node, bias = nodes.result[tied], np.unique(nodes.bias[tied])
    kinds = (("x", node), ("v", node), ("m", tied), ("b", bias), ("s", bias))
    names = [(ord(letter) << LETTER_SHIFT) + number.astype(np.uint64) for letter, number in kinds]
    return np.isin(keys, np.concatenate(names)), np.isin(keys >> np.uint64(LETTER_SHIFT), [ord("z"), ord("a")])
