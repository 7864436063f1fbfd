"""Which stretches of a path could be the same place: those within the path's own uncertainty of each other.

The path is cut into blocks of `BLOCK` points. A pair of blocks, the later one first, is a candidate where

    |p_i - p_j| <= LIMIT sigma(d_i, d_j) + size of a block,    the same in height with its own sigma,

by a KD-tree of the blocks, and where the walked distance between them is more than `APART_M`. In heading the pair is
in the same direction where the ranges of their headings are less than LIMIT sigma_heading + `BEND_RAD` apart, in the
opposite one where as little from half a turn; it may be both. The cost is that of the pairs that are near each other.

Source of the limits: three sigmas, so that a true return is missed in 1 % of the walks (two dimensions).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.frames import wrap_angle
from fg_nav.places.signature import BLOCK, SPACING_M, Signature

if TYPE_CHECKING:
    from scipy.spatial import KDTree

LIMIT = 3.0  # Sigmas.
APART_M = 12.0  # Walked in between, or the same wave of the field is seen twice.
PIECE = 16  # Blocks, 64 m: much longer than alignments by chance.
BEND_RAD = np.deg2rad(30.0)  # By which directions of walking differ in one corridor.
ALIKE_M = 2.0  # By which places differ that are walked as the same one: a corridor's width.


class Uncertainty(Protocol):
    """Of one place of a path relative to another: standard deviations, by the distances (M,) m walked to both."""

    def position_m(self, first: Floats, second: Floats) -> Floats:
        """(M,) m, of each horizontal axis."""

    def height_m(self, first: Floats, second: Floats) -> Floats:
        """(M,) m."""

    def heading_rad(self, first: Floats, second: Floats) -> Floats:
        """(M,) rad."""


@dataclass(frozen=True)
class Drift:
    """Uncertainty that grows with the distance between.

    Attributes
    ----------
    position_share : of the distance, per axis (2 %: foot-mounted inertial navigation in the literature, 0.3 to 4 %).
    heading_rad_m : rad for each meter.
    height_share : of the distance.
    """

    position_share: float = 0.02
    heading_rad_m: float = np.deg2rad(0.05)
    height_share: float = 0.003

    def position_m(self, first: Floats, second: Floats) -> Floats:
        """(M,) m, of each horizontal axis."""
        return self.position_share * np.abs(second - first)

    def height_m(self, first: Floats, second: Floats) -> Floats:
        """(M,) m."""
        return 0.3 + self.height_share * np.abs(second - first)

    def heading_rad(self, first: Floats, second: Floats) -> Floats:
        """(M,) rad."""
        return self.heading_rad_m * np.abs(second - first)


@dataclass(frozen=True)
class BlockPairs:
    """Candidates of one relation: block `start[a]:start[a + 1]` of `earlier` are those that go with block a."""

    start: Ints
    earlier: Ints

    def __len__(self) -> int:
        return len(self.earlier)

    def reverse(self, blocks: int) -> BlockPairs:
        """Return the pairs with the earlier of so many blocks counted from the end, as `Features.reverse` has them."""
        later = np.repeat(np.arange(len(self.start) - 1), np.diff(self.start))
        earlier = blocks - 1 - self.earlier
        return BlockPairs(self.start, earlier[np.lexsort((earlier, later))])

    def thin(self, every: int) -> BlockPairs:
        """Return the pairs of every so many-th piece (`PIECE`) of the later walk."""
        kept = (np.arange(len(self.start) - 1) // PIECE) % every == 0
        return self.select(kept, np.ones(self.earlier.max(initial=0) + 1, dtype=bool))

    def select(self, later: Bools, earlier: Bools) -> BlockPairs:
        """Return the pairs whose blocks are both marked."""
        rows = np.repeat(np.arange(len(self.start) - 1), np.diff(self.start))
        kept = later[rows] & earlier[self.earlier]
        count = np.bincount(rows[kept], minlength=len(self.start) - 1)
        return BlockPairs(np.concatenate([[0], np.cumsum(count)]).astype(np.int64), self.earlier[kept])

    @property
    def area_m2(self) -> float:
        """Of all pairs of points that are compared."""
        return len(self) * (BLOCK * SPACING_M) ** 2


@dataclass(frozen=True)
class Candidates:
    """Pairs of blocks that could be one place, walked in the same or the opposite direction."""

    same: BlockPairs
    opposite: BlockPairs

    def select(self, later: Bools, earlier: Bools) -> Candidates:
        """Return the pairs whose blocks are both marked."""
        return Candidates(self.same.select(later, earlier), self.opposite.select(later, earlier))

    @property
    def area_m2(self) -> float:
        """Of all pairs of points that are compared, in both directions."""
        return self.same.area_m2 + self.opposite.area_m2


def find_candidates(path: Signature, uncertainty: Uncertainty) -> Candidates:
    """List the pairs of stretches that could be one place."""
    from scipy.spatial import KDTree  # loaded where a path is long enough to return

    count = _count(path)
    middle = np.minimum(np.arange(count) * BLOCK + BLOCK // 2, len(path) - 1)
    blocks = _Blocks(path.distance_m[middle], path.position[middle], *_directions(path))
    tree = KDTree(blocks.place[:, :2])
    same, opposite = [], []
    # Piece by piece: what is near of a long walk is many times what is a candidate.
    for begin in range(0, count, PIECE):
        rows = np.arange(begin, min(begin + PIECE, count))
        later, earlier = _near_pairs(blocks, tree, rows, uncertainty)
        d, bend = (blocks.walked_m[earlier], blocks.walked_m[later]), blocks.bend[earlier] + blocks.bend[later]
        limit = LIMIT * uncertainty.heading_rad(*d) + BEND_RAD + bend
        apart = np.abs(wrap_angle(blocks.direction[later] - blocks.direction[earlier]))
        same.append(_list_pairs(later, earlier, apart < limit, rows))
        opposite.append(_list_pairs(later, earlier, np.pi - apart < limit, rows))
    return Candidates(_join(same), _join(opposite))


@dataclass(frozen=True)
class _Blocks:
    """Of B blocks: distance walked (B,) m and place (B, 3) m of the middle, direction and bend (B,) rad around it."""

    walked_m: Floats
    place: Floats
    direction: Floats
    bend: Floats


def _count(path: Signature) -> int:
    return -(-len(path) // BLOCK)


def _directions(path: Signature) -> tuple[Floats, Floats]:
    """Direction of walking in the middle of the range of each block (B,) and around it, and half that range (B,)."""
    padded = np.pad(path.heading, (BLOCK // 2, -len(path) % BLOCK + BLOCK // 2), mode="edge")
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * BLOCK)[::BLOCK]
    low, high = around.min(axis=1), around.max(axis=1)
    return 0.5 * (low + high), 0.5 * (high - low)


def _near_pairs(blocks: _Blocks, tree: KDTree, rows: Ints, uncertainty: Uncertainty) -> tuple[Ints, Ints]:
    """Pairs (M,), (M,) of some blocks with earlier ones that are near them."""
    d, place = blocks.walked_m, blocks.place
    size = BLOCK * SPACING_M + ALIKE_M
    reach = LIMIT * uncertainty.position_m(np.zeros(len(rows)), d[rows]) + size
    found = tree.query_ball_point(place[rows, :2], reach)
    count = [len(row) for row in found]
    later, earlier = np.repeat(rows, count), np.concatenate([np.array(row, dtype=int) for row in found])
    behind = d[later] - d[earlier] > APART_M
    later, earlier = later[behind], earlier[behind]
    apart = np.linalg.norm(place[later, :2] - place[earlier, :2], axis=1)
    near = apart <= LIMIT * uncertainty.position_m(d[earlier], d[later]) + size
    level = np.abs(place[later, 2] - place[earlier, 2]) <= LIMIT * uncertainty.height_m(d[earlier], d[later])
    return later[near & level], earlier[near & level]


def _list_pairs(later: Ints, earlier: Ints, usable: Bools, rows: Ints) -> BlockPairs:
    """Pairs of some later blocks in a row, the first of which is the first of `start`."""
    later, earlier = later[usable], earlier[usable]
    order = np.lexsort((earlier, later))
    start = np.searchsorted(later[order], np.append(rows, rows[-1] + 1))
    return BlockPairs(start.astype(np.int64), earlier[order].astype(np.int64))


def _join(parts: Sequence[BlockPairs]) -> BlockPairs:
    """Pairs of parts of the later blocks, one behind the other."""
    count = np.concatenate([np.diff(part.start) for part in parts])
    start = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    return BlockPairs(start, np.concatenate([part.earlier for part in parts]))


def pair_all(later: int, earlier: int) -> BlockPairs:
    """Return all pairs of blocks of two paths of so many points."""
    rows, columns = later // BLOCK, earlier // BLOCK
    return BlockPairs(np.arange(rows + 1) * columns, np.tile(np.arange(columns), rows))
