"""Which stretches of a path could be the same place: those within the path's own uncertainty of each other.

The path is cut into blocks of `BLOCK` points. A pair of blocks, the later one first, is a candidate where

    |p_i - p_j| <= LIMIT sigma(d_i, d_j) + size of a block,    the same in height with its own sigma,

by a KD-tree of the blocks, and where the walked distance between them is more than `APART_M`. In heading the pair is
in the same direction where the ranges of their headings are less than LIMIT sigma_heading + `BEND_RAD` apart, in the
opposite one where as little from half a turn; it may be both. The cost is that of the pairs that are near each other.

Source of the limits: three sigmas, so that a true return is missed in 1 % of the walks (two dimensions).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.frames import wrap_angle
from fg_nav.places.signature import BLOCK, SPACING_M, Signature

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
    """Uncertainty that grows with the distance between."""

    position_share: float = 0.02  #: Of the distance, per axis: foot-mounted navigation in the literature, 0.3 to 4 %.
    heading_rad_m: float = np.deg2rad(0.05)  #: Rad for each meter.
    height_share: float = 0.003  #: Of the distance.

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

    @property
    def later(self) -> Ints:
        """The block a of each pair."""
        return np.repeat(np.arange(len(self.start) - 1), np.diff(self.start))

    def reverse(self, blocks: int) -> BlockPairs:
        """Return the pairs with the earlier of so many blocks counted from the end, as `Features.reverse` has them."""
        earlier = blocks - 1 - self.earlier
        return BlockPairs(self.start, earlier[np.lexsort((earlier, self.later))])

    def thin(self, every: int) -> BlockPairs:
        """Return the pairs of every so many-th piece (`PIECE`) of the later walk."""
        kept = (np.arange(len(self.start) - 1) // PIECE) % every == 0
        return self.select(kept, np.ones(self.earlier.max(initial=0) + 1, dtype=bool))

    def select(self, later: Bools, earlier: Bools) -> BlockPairs:
        """Return the pairs whose blocks are both marked."""
        rows = self.later
        kept = later[rows] & earlier[self.earlier]
        return list_pairs(rows[kept], self.earlier[kept], len(self.start) - 1)

    @property
    def area_m2(self) -> float:
        """Of all pairs of points that are compared."""
        return len(self) * (BLOCK * SPACING_M) ** 2


def list_pairs(later: Ints, earlier: Ints, count: int) -> BlockPairs:
    """List pairs, in order of the later blocks, of which there are so many."""
    start = np.concatenate([[0], np.cumsum(np.bincount(later, minlength=count))])
    return BlockPairs(start.astype(np.int64), earlier.astype(np.int64))


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

    # blocks: distance walked and place in the middle, direction and bend around it
    count = -(-len(path) // BLOCK)
    middle = np.minimum(np.arange(count) * BLOCK + BLOCK // 2, len(path) - 1)
    walked, place = path.distance_m[middle], path.position[middle]
    padded = np.pad(path.heading, (BLOCK // 2, -len(path) % BLOCK + BLOCK // 2), mode="edge")
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * BLOCK)[::BLOCK]
    low, high = around.min(axis=1), around.max(axis=1)
    direction, bends = 0.5 * (low + high), 0.5 * (high - low)
    tree, size = KDTree(place[:, :2]), BLOCK * SPACING_M + ALIKE_M
    found: list[list[tuple[Ints, Ints]]] = [[], []]
    # piece by piece: what is near of a long walk is many times what is a candidate
    for begin in range(0, count, PIECE):
        rows = np.arange(begin, min(begin + PIECE, count))
        # pairs within the largest uncertainty
        reach = LIMIT * uncertainty.position_m(np.zeros(len(rows)), walked[rows]) + size
        near = [np.array(sorted(row), dtype=np.int64) for row in tree.query_ball_point(place[rows, :2], reach)]
        later, earlier = np.repeat(rows, [len(row) for row in near]), np.concatenate(near)
        behind = walked[later] - walked[earlier] > APART_M
        later, earlier = later[behind], earlier[behind]
        # within their own
        d = walked[earlier], walked[later]
        apart = np.linalg.norm(place[later, :2] - place[earlier, :2], axis=1)
        is_near = apart <= LIMIT * uncertainty.position_m(*d) + size
        is_near &= np.abs(place[later, 2] - place[earlier, 2]) <= LIMIT * uncertainty.height_m(*d)
        later, earlier = later[is_near], earlier[is_near]
        # in the same or the opposite direction
        limit = LIMIT * uncertainty.heading_rad(walked[earlier], walked[later]) + BEND_RAD
        limit = limit + (bends[earlier] + bends[later])
        turned = np.abs(wrap_angle(direction[later] - direction[earlier]))
        for pairs, usable in zip(found, (turned < limit, np.pi - turned < limit), strict=True):
            pairs.append((later[usable], earlier[usable]))
    joined = ([np.concatenate(blocks) for blocks in zip(*pairs, strict=True)] for pairs in found)
    same, opposite = (list_pairs(later, earlier, count) for later, earlier in joined)
    return Candidates(same, opposite)


def pair_all(later: int, earlier: int) -> BlockPairs:
    """Return all pairs of blocks of two paths of so many points."""
    rows, columns = later // BLOCK, earlier // BLOCK
    return BlockPairs(np.arange(rows + 1) * columns, np.tile(np.arange(columns), rows))
