"""Steps of the two feet of one person: which footfalls are beside each other.

A person who walks sets the feet in turn. Between two footfalls of one foot, one stride apart, is one footfall of the
other, halfway between them but for the width w of the walk to its side:

    q = (p_i + p_(i+1)) / 2 -+ w n + noise,

p the positions of the one foot's footfalls, q that of the other's, n the unit vector to the left of the stride, minus
for a right foot. On 63 m of motion-captured walking in laps of 12 m the noise is 0.02 m along, 0.05 m across and
0.003 m up (rms, `scripts/two_feet.py`); across it is the bend of the path, since the middle of a chord lies inside of
a curve. In the mean over steps of both feet that falls out, as the middles of both feet's strides do so alike. A person
also steps unevenly, or stands longer on one leg: that is the same from step to step, and does not fall out.

So steps are averaged over cells, `CELL_M` of the way or a turn by `CELL_TURN_RAD`. With weights a_k and b_k of the
footfalls of the right and of the left foot (1 where the foot is q, 1/2 and 1/2 in a stride), the means of a cell are

    q_R = sum a_k p_k,    q_L = sum b_k p_k,    n = mean of n,    q_R = q_L - w n.

A stride that is short, as in a shuffle or a turn on the spot, or takes long, as a halt, has no direction, or the other
foot not in its middle: it counts little, by `weigh_strides`; what is slow all along counts in full. Over a hole in a
recording its path is no measure of a distance: no step and no cell crosses one.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from fg_nav.arrays import Bools, Complexes, Floats, Ints

CELL_M, CELL_TURN_RAD = 8.0, np.deg2rad(60.0)
"""Of the way, and by how much it turns: six strides, over which a path that was found alone is bent by less than steps
differ. In the mean over a turn the direction would be lost."""

MIN_CELLS, MIN_GROWN = 6, 0.25
MAX_CELLS, MAX_GROWN, MAX_APART_M = 40, 2.0, 30.0
"""Of a walk: cells of a short one are smaller, down to a stride and a half, so that there are some. Those of a long one
are up to twice as large, and no more of them are kept, as long as they are not further apart than that. With twice as
many errors and sigmas of simulated walks are the same, and the solver takes longer."""

MIN_TURNS = 4  # Steps whose directions show how two paths are turned: each does to some degrees.
MIN_STEPS = 1.0  # In a cell, by their weights (`Cells.steps`).

SHORT_M, LONG_M = 0.4, 4.0
"""Strides that count half: a shuffle has no direction, and what is longer than a runner's is an error of its path."""

NEGLIGIBLE = 0.01  # Weight of a step that is none.

MAX_S, TIMES_USUAL = 2.5, 2.0
"""Of a stride: what takes longer, and more times as long as the person's usual stride, was a halt."""


def find_longest_stride(t: Floats) -> float:
    """Longest time, s, of a stride of who walks on, by the times (F,) s of a foot's swings or footfalls."""
    return max(MAX_S, TIMES_USUAL * float(np.median(np.diff(t)))) if len(t) > 1 else MAX_S


@dataclass(frozen=True)
class Footfalls:
    """Footfalls of one foot: `t` (F,) s, in their middle, `position` (F, 3) m, and `holes` (H,) s in the recording."""

    t: Floats
    position: Floats
    holes: Floats = field(default_factory=lambda: np.zeros(0))

    def __len__(self) -> int:
        return len(self.t)

    def count_holes(self, t: Floats) -> Ints:
        """Count (N,) the holes before times t (N,) s."""
        return np.searchsorted(self.holes, t)


@dataclass(frozen=True)
class Steps:
    """S footfalls of one foot, each between two of the other.

    `at` (S,) of the foot, `before` (S,) of the other one's footfall before it; the next one is after it. `left_normal`
    (S, 2) is the unit vector to the left of that one's stride, and `weight` (S,) from 0 to 1 how far it is one of a
    walk: by its length and by its time, against the person's usual one.
    """

    at: Ints
    before: Ints
    left_normal: Floats
    weight: Floats


def find_steps(foot: Footfalls, other: Footfalls) -> Steps:
    """Find the footfalls of a foot that are one step between two of the other."""
    before = np.searchsorted(other.t, foot.t) - 1
    at = np.flatnonzero((before >= 0) & (before < len(other) - 1))
    # No other footfall of this foot in that stride.
    counts = np.bincount(before[at], minlength=len(other))
    at = at[counts[before[at]] == 1]
    before = before[at]
    stride, took = np.diff(other.position[:, :2], axis=0), np.diff(other.t)
    length = np.linalg.norm(stride, axis=1)
    goes = weigh_strides(length, took)
    known = np.diff(other.count_holes(other.t)) + np.diff(foot.count_holes(other.t)) == 0
    kept = known[before] & (goes[before] > NEGLIGIBLE)
    at, before = at[kept], before[kept]
    u = stride[before] / length[before, None]
    return Steps(at, before, np.stack([-u[:, 1], u[:, 0]], axis=1), goes[before])


def weigh_strides(length: Floats, took: Floats) -> Floats:
    """Weights (F,) of strides of some length (F,) m that took (F,) s: half at `SHORT_M`, at `LONG_M`, at a halt."""
    with np.errstate(divide="ignore", over="ignore"):
        goes = 1.0 / ((1.0 + (SHORT_M / length) ** 4) * (1.0 + (length / LONG_M) ** 4))
    usual = measure_usual_time(took, goes)
    return np.asarray(goes / (1.0 + (np.maximum(took / usual, 1.0) - 1.0) ** 4))


def measure_usual_time(took: Floats, weight: Floats) -> float:
    """Median of times (F,) s of strides, by their weights (F,)."""
    if not len(took):
        return 1.0
    order = np.argsort(took)
    at = np.searchsorted(np.cumsum(weight[order]), 0.5 * weight.sum())
    return float(took[order[min(at, len(took) - 1)]])


@dataclass(frozen=True)
class Cells:
    """C cells: mean places (C, 3) m of both feet, mean normal (C, 2), and the moment (C,) s.

    `steps` (C,) is how many each is the mean of, by their weights, and `grown` how many times as large they are as
    `CELL_M`.
    """

    t: Floats
    right: Floats
    left: Floats
    left_normal: Floats
    steps: Floats
    grown: float

    def __len__(self) -> int:
        return len(self.t)

    def take(self, kept: Bools) -> Cells:
        """Return those that are kept (C,)."""
        return Cells(
            self.t[kept], self.right[kept], self.left[kept], self.left_normal[kept], self.steps[kept], self.grown
        )


def average_cells(right: Footfalls, left: Footfalls) -> Cells:
    """Average the steps of a walk over cells, in order of time."""
    of_right, of_left = find_steps(right, left), find_steps(left, right)
    way, turned = _measure_way(left)
    grown = float(np.clip((way + turned)[-1:].max(initial=0.0) / MAX_CELLS, 1.0, MAX_GROWN))
    shrunk = float(np.clip(way[-1:].max(initial=0.0) / MIN_CELLS, MIN_GROWN, 1.0))
    number = _number_cells(left, right.holes, way / (grown * shrunk) + turned / grown)
    cells = number[of_right.before], number[of_left.at]
    count = number.max(initial=0) + 1
    weights = [np.bincount(cell, of.weight, count) for cell, of in zip(cells, (of_right, of_left), strict=True)]
    # Both kinds count alike, or the bend of a curve would not fall out.
    with np.errstate(divide="ignore"):
        steps = 4.0 / (1.0 / weights[0] + 1.0 / weights[1])
    kept = np.flatnonzero(steps >= MIN_STEPS)
    kept = kept[_spread_evenly(len(kept), _limit_cells(left))]
    means = [
        np.mean(
            [
                _average_by(cell, of.weight, one, count)[kept]
                for cell, of, one in zip(cells, (of_right, of_left), pair, strict=True)
            ],
            axis=0,
        )
        for pair in (
            (right.t[of_right.at, None], left.t[of_left.at, None]),
            (right.position[of_right.at], _middle(right, of_left)),
            (_middle(left, of_right), left.position[of_left.at]),
            (of_right.left_normal, of_left.left_normal),
        )
    ]
    t, of_right_foot, of_left_foot, normal = means
    return Cells(t[:, 0], of_right_foot, of_left_foot, normal, steps[kept], grown * shrunk)


def _limit_cells(foot: Footfalls) -> int:
    """Return how many cells a walk has at most."""
    way = float(np.linalg.norm(np.diff(foot.position[:, :2], axis=0), axis=1).sum())
    return max(MAX_CELLS, int(np.ceil(way / MAX_APART_M)))


def _spread_evenly(count: int, most: int) -> Ints:
    """Which of so many are kept, where they are more than `most`."""
    return np.arange(count) if count <= most else np.rint(np.linspace(0, count - 1, most)).astype(np.int64)


def _middle(foot: Footfalls, steps: Steps) -> Floats:
    """Middles (S, 3) of a foot's strides."""
    return np.asarray(0.5 * (foot.position[steps.before] + foot.position[steps.before + 1]))


def _average_by(group: Ints, weight: Floats, values: Floats, count: int) -> Floats:
    """Weighted means (G, c) of rows (S, c) over the groups 0 to G - 1 (S,) that they are in; of an empty one NaN."""
    with np.errstate(invalid="ignore"):
        total = np.stack([np.bincount(group, weight * column, count) for column in values.T], axis=1)
        return np.asarray(total / np.bincount(group, weight, count)[:, None])


def _number_cells(foot: Footfalls, holes: Floats, way: Floats) -> Ints:
    """Cell (F,) of each footfall, from 0, by the way (F,) in cells, its holes and those (H,) s of the other foot."""
    piece = foot.count_holes(foot.t) + np.searchsorted(holes, foot.t)
    return np.unique(np.stack([piece, np.floor(way)], axis=1), axis=0, return_inverse=True)[1].ravel()


def _measure_way(foot: Footfalls) -> tuple[Floats, Floats]:
    """Way (F,) walked to each footfall, and turns (F,) taken, in cells."""
    move = np.diff(foot.position[:, :2], axis=0, prepend=foot.position[:1, :2])
    length = np.linalg.norm(move, axis=1)
    walks = length > SHORT_M
    heading = np.unwrap(np.arctan2(move[walks, 1], move[walks, 0]))
    turned = np.zeros(len(foot))
    turned[walks] = np.abs(np.diff(heading, prepend=heading[:1]))
    return np.cumsum(length) / CELL_M, np.cumsum(turned) / CELL_TURN_RAD


def measure_turns(right: Footfalls, left: Footfalls) -> tuple[Floats, Complexes]:
    """Times (S,) s of steps, and by how much the right foot's directions are turned from the left one's there (S,).

    The latter is exp(i turn), times the step's weight. The direction of the one foot's stride is compared with the mean
    of the other's two that overlap it.
    """
    of_right = find_steps(right, left)
    inner = (of_right.at > 0) & (of_right.at < len(right) - 1)
    at, before, weight = of_right.at[inner], of_right.before[inner], of_right.weight[inner]
    whole = right.count_holes(right.t[at + 1]) == right.count_holes(right.t[at - 1])
    at, before, weight = at[whole], before[whole], weight[whole]
    by_left = np.diff(left.position[:, :2], axis=0)[before]
    by_right = right.position[at + 1, :2] - right.position[at - 1, :2]
    turn = np.arctan2(by_right[:, 1], by_right[:, 0]) - np.arctan2(by_left[:, 1], by_left[:, 0])
    return right.t[at], weight * np.exp(1j * turn)
