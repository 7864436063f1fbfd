"""Factors between the two feet of one person (`factors.same_place`).

In each cell of steps (`feet.steps`) the mean places of both feet are beside each other. The mean places are points next
to the footfalls nearest to the middle of the cell, as each path has them: what a path is bent by within a cell is less
than what steps differ by. Along the way the mean is as good as a person steps evenly, across as one keeps the width,
and up as the sensors are worn alike and the floor is level across.

Where for long there is no cell, pairs of footfalls are tied by nothing, with a weight of zero: they hold no
information, and keep both feet's joint covariance there for the sigmas of the person.

Feet that stand at about one time are within reach: a factor of the pairs of footfalls that are not, and of further
ones where the walk was solved with it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import gtsam
import numpy as np
from gtsam.symbol_shorthand import X

from fg_nav.arrays import Floats, Ints
from fg_nav.factors.residual import LETTER_SHIFT, Keys, Stack
from fg_nav.factors.same_place import BesideEachOther, WithinReach, weigh_place
from fg_nav.feet.steps import MAX_S, Footfalls, average_cells
from fg_nav.samples.gaps import find_holes
from fg_nav.smoother.graph import WalkProblem
from fg_nav.smoother.places import find_footfalls
from fg_nav.smoother.solver import list_poses

ALONG_SIGMA_M, ACROSS_SIGMA_M, UP_SIGMA_M = 0.08, 0.05, 0.04  # Of a cell of a short walk; laps 0.03, 0.02, 0.005.
STEPS_HALF = 2.0  # Steps of a cell in whose mean they differ as much as what a person does alike from step to step.
WIDTH_M, WIDTH_SIGMA_M = 0.15, 0.1  # Between the sensors: people walk 0.05 to 0.2 m wide, with sensors outside.
STAND_SIGMA_M, STAND_UP_SIGMA_M = 0.25, 0.15  # Between the feet of a person who stands still.
STAND_SHARE = 0.5  # Of the usual time of a stride: who walks has both feet on the ground for a tenth to a fourth of it.
SAME_STAND_M = 0.1  # Between stands of feet that have not moved since.
MAX_GROWN_SIGMA = 2.0  # Of a stand: nobody who walks has both feet on the ground for half of a stride's time.
NEAR_FOOTFALLS = 4  # Of the one foot, that are compared with one of the other.
REACH_M, REACH_SIGMA_M = 1.2, 0.1  # Between two standing feet: what a tall person lunges, and soft edges.
FLIGHT_M_S, MAX_FLIGHT_S = 3.0, 0.3  # Where neither is seen to stand the person moves on, for no longer.
WATCHED_S = 15.0  # From the nearest cell, beyond which pairs are tied by nothing: cells of long walks are 20 s apart.
RIGHT = np.uint64(1 << 40)  # Added to the keys of the right foot's variables in the graph of both.
WIDTH = np.uint64(ord("w") << LETTER_SHIFT)  # Key of the width.


@dataclass(frozen=True)
class FeetValues:
    """Values of all variables of both feet, and of the width, m."""

    right: gtsam.Values
    left: gtsam.Values
    width: float


def mark_right(keys: Keys) -> Keys:
    """Return the keys of the right foot's variables in the graph of both."""
    return np.asarray(keys, dtype=np.uint64) + RIGHT


@dataclass(frozen=True)
class FootfallTies:
    """C pairs of footfalls `right`, `left` (C,) at nodes (C,), and the residuals.

    The first `cells` of them stand for cells of steps, the others are tied by nothing.
    """

    right: Ints
    left: Ints
    right_node: Ints
    left_node: Ints
    residuals: BesideEachOther
    cells: int

    def __len__(self) -> int:
        return len(self.right)

    def evaluate(self, values: FeetValues, with_jacobians: bool) -> tuple[Floats, list[Floats]]:
        """Return residuals (C, 3) and Jacobians."""
        poses = list_poses(self.right_node, values.right), list_poses(self.left_node, values.left)
        return self.residuals.evaluate((*poses, np.full((len(self), 1), values.width)), with_jacobians)

    def stack(self, values: FeetValues) -> list[Stack]:
        """Return them linearized, and the prior of the width."""
        prior = np.array([[[1.0, WIDTH_M - values.width]]]) / WIDTH_SIGMA_M
        stacks = [Stack(np.array([[WIDTH]]), prior)]
        if len(self):
            e, H = self.evaluate(values, True)
            of_right, of_left = mark_right(list_pose_keys(self.right_node)), list_pose_keys(self.left_node)
            keys = np.stack([of_right, of_left, np.full(len(self), WIDTH)], axis=1)
            stacks.append(Stack(keys, np.concatenate([*H, -e[..., None]], axis=2)))
        return stacks

    def error(self, values: FeetValues) -> float:
        """Half the sum of squares, with the prior of the width."""
        of_cells = float((self.evaluate(values, False)[0] ** 2).sum()) if len(self) else 0.0
        return 0.5 * (of_cells + ((values.width - WIDTH_M) / WIDTH_SIGMA_M) ** 2)


@dataclass(frozen=True)
class ReachFactors:
    """Pairs of nodes `right`, `left` (P,) at which feet stand at about one time, `reach` (P,) m apart at most."""

    right: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    left: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    reach: Floats = field(default_factory=lambda: np.zeros(0))

    def __len__(self) -> int:
        return len(self.right)

    def take(self, rows: Ints) -> ReachFactors:
        """Return some of them."""
        return ReachFactors(self.right[rows], self.left[rows], self.reach[rows])

    def evaluate(self, values: FeetValues, with_jacobians: bool) -> tuple[Floats, list[Floats]]:
        """Return residuals (P, 1) and Jacobians."""
        poses = list_poses(self.right, values.right), list_poses(self.left, values.left)
        return WithinReach(self.reach, np.full(len(self), REACH_SIGMA_M)).evaluate(poses, with_jacobians)

    def stack(self, values: FeetValues) -> list[Stack]:
        """Return them linearized."""
        if not len(self):
            return []
        e, H = self.evaluate(values, True)
        keys = np.stack([mark_right(list_pose_keys(self.right)), list_pose_keys(self.left)], axis=1)
        return [Stack(keys, np.concatenate([*H, -e[..., None]], axis=2))]

    def error(self, values: FeetValues) -> float:
        """Half the sum of squares."""
        return 0.5 * float((self.evaluate(values, False)[0] ** 2).sum()) if len(self) else 0.0


def list_pose_keys(nodes: Ints) -> Keys:
    """List the keys (n,) of poses at nodes (n,)."""
    return np.array([X(int(j)) for j in nodes], dtype=np.uint64)


def list_footfalls(problem: WalkProblem, values: gtsam.Values) -> Footfalls:
    """List the footfalls of a foot, in the middle of their standing."""
    nodes, t = problem.nodes, problem.recording.t[problem.nodes.sample]
    middle = 0.5 * (t[nodes.first[:-1]] + t[nodes.first[1:] - 1])
    holes = problem.recording.t[find_holes(problem.recording.t)]
    return Footfalls(middle, list_poses(nodes.result, values)[:, :3, 3].copy(), holes)


def tie_feet(right: WalkProblem, left: WalkProblem, values: FeetValues) -> FootfallTies:
    """Tie the cells of steps of two solved feet."""
    feet = list_footfalls(right, values.right), list_footfalls(left, values.left)
    cells = average_cells(*feet)
    *stands, stand_sigma = _find_stands(right, left, feet)
    # Each footfall in one tie only.
    free = [np.setdiff1d(np.arange(len(foot)), taken) for foot, taken in zip(feet, stands, strict=True)]
    count = np.arange(len(cells))
    nearest = [
        np.maximum.accumulate(find_footfalls(cells.t, foot.t[one]) - count) + count
        for foot, one in zip(feet, free, strict=True)
    ]
    cells = cells.take((nearest[0] < len(free[0])) & (nearest[1] < len(free[1])))
    by_tie = [
        np.concatenate([one[near[: len(cells)]], taken]) for one, near, taken in zip(free, nearest, stands, strict=True)
    ]
    of_right, of_left = (np.concatenate(each) for each in zip(by_tie, _watch_between(feet, *by_tie), strict=True))
    node = right.nodes.result[of_right], left.nodes.result[of_left]
    poses = list_poses(node[0], values.right), list_poses(node[1], values.left)
    in_body = [
        np.einsum("kji,kj->ki", pose[: len(cells), :3, :3], place - pose[: len(cells), :3, 3])
        for pose, place in zip(poses, (cells.right, cells.left), strict=True)
    ]
    normal = np.pad(cells.left_normal, ((0, 0), (0, 1)))
    heading = np.arctan2(-normal[:, 0], normal[:, 1])
    # The means of larger cells are those of more steps, and of few steps those of few.
    times = np.sqrt(1.0 / cells.grown + STEPS_HALF / cells.steps)
    along, across, up = np.array([ALONG_SIGMA_M, ACROSS_SIGMA_M, UP_SIGMA_M])[:, None] * times
    weight = weigh_place(heading, along, across, up)
    in_left = np.einsum("kji,kj->ki", poses[1][: len(cells), :3, :3], normal)
    # Of who stands the sensors themselves are near each other, and it is not known which way.
    in_body = [np.concatenate([one, np.zeros((len(stand_sigma), 3))]) for one in in_body]
    near = np.array([STAND_SIGMA_M, STAND_SIGMA_M, STAND_UP_SIGMA_M])
    weight = np.concatenate([weight, np.eye(3) / (near * stand_sigma[:, None])[:, None]])
    # Pairs that nothing ties have a weight of zero.
    rows = [
        np.concatenate([one, np.zeros((len(of_right) - len(one), *one.shape[1:]))])
        for one in (*in_body, in_left, weight)
    ]
    residuals = BesideEachOther(*rows)
    return FootfallTies(of_right, of_left, *node, residuals, len(cells))


def _find_stands(right: WalkProblem, left: WalkProblem, feet: tuple[Footfalls, Footfalls]) -> tuple[Ints, Ints, Floats]:
    """Find pairs of footfalls (P,) at which the person stood with both feet, and by how much their sigmas grow (P,)."""
    spans = [_list_spans(one) for one in (right, left)]
    usual = np.median(np.concatenate([np.diff(foot.t) for foot in feet])) if min(map(len, feet)) > 1 else np.inf
    first = np.searchsorted(spans[1][1], spans[0][0])
    pairs, placed = list[tuple[int, int, float]](), list[Floats]()
    for i, j in enumerate(first):
        # Of the left foot's footfalls at that time the one that it shares the most of.
        begin, end = (one[j : j + NEAR_FOOTFALLS] for one in spans[1])
        shared = np.minimum(spans[0][1][i], end) - np.maximum(spans[0][0][i], begin)
        if not len(shared) or shared.max() <= 0.0:
            continue
        k = int(j + shared.argmax())
        grown = 1.0 + (STAND_SHARE * usual / shared.max()) ** 4
        place = np.concatenate([feet[0].position[i], feet[1].position[k]])
        is_same = bool(placed) and float(np.abs(place - placed[-1]).max()) < SAME_STAND_M
        if grown < MAX_GROWN_SIGMA and not is_same and not (pairs and pairs[-1][1] == k):
            pairs.append((i, k, grown))
            placed.append(place)
    of_right, of_left, grown_by = (np.array(column) for column in zip(*pairs, strict=True)) if pairs else ([], [], [])
    return np.asarray(of_right, np.int64), np.asarray(of_left, np.int64), np.asarray(grown_by, np.float64)


def _watch_between(feet: tuple[Footfalls, Footfalls], *by_tie: Ints) -> list[Ints]:
    """Find pairs of footfalls, of no tie, where for long there is none."""
    right, left = feet
    cell_t = np.concatenate([[-np.inf], np.sort(left.t[by_tie[1]]), [np.inf]])
    moment = np.arange(max(right.t[0], left.t[0]), min(right.t[-1], left.t[-1]), WATCHED_S)
    after = np.searchsorted(cell_t, moment)
    lonely = moment[np.minimum(moment - cell_t[after - 1], cell_t[after] - moment) > WATCHED_S]
    pairs = np.stack([find_footfalls(lonely, foot.t) for foot in feet], axis=1)
    apart_s = np.abs(right.t[pairs[:, 0]] - left.t[pairs[:, 1]])
    is_new = [~np.isin(pairs[:, k], by_tie[k]) & (np.diff(pairs[:, k], prepend=-1) > 0) for k in range(2)]
    return list(pairs[is_new[0] & is_new[1] & (apart_s < MAX_S)].T)


def find_beyond_reach(right: WalkProblem, left: WalkProblem, values: FeetValues, known: ReachFactors) -> ReachFactors:
    """Add to known pairs those of footfalls at about one time that are beyond reach."""
    pairs = _list_pairs(right, left)
    beyond = np.flatnonzero(pairs.evaluate(values, False)[0][:, 0] > 0.0) if len(pairs) else np.zeros(0, np.int64)
    found = pairs.take(beyond)
    joined = [np.concatenate([getattr(one, name) for one in (known, found)]) for name in ("right", "left", "reach")]
    _, first = np.unique(np.stack(joined[:2], axis=1), axis=0, return_index=True)
    return ReachFactors(*joined).take(first)


def _list_pairs(right: WalkProblem, left: WalkProblem) -> ReachFactors:
    """List the pairs of footfalls between which both feet were in the air for a moment, or for none."""
    (begin, end), (begin_left, end_left) = (_list_spans(problem) for problem in (right, left))
    first = np.searchsorted(end_left, begin - MAX_FLIGHT_S)
    count = np.maximum(np.searchsorted(begin_left, end + MAX_FLIGHT_S) - first, 0)
    at = np.repeat(np.arange(len(count)), count)
    at_left = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count) + np.repeat(first, count)
    flight = np.maximum(begin[at] - end_left[at_left], begin_left[at_left] - end[at])
    reach = REACH_M + FLIGHT_M_S * np.maximum(flight, 0.0)
    return ReachFactors(right.nodes.result[at], left.nodes.result[at_left], reach)


def _list_spans(problem: WalkProblem) -> tuple[Floats, Floats]:
    """Begin and end (F,) of each footfall, s."""
    nodes, t = problem.nodes, problem.recording.t[problem.nodes.sample]
    return t[nodes.first[:-1]], t[nodes.first[1:] - 1]
