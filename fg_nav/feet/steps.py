"""Steps of the two feet of one person: which footfalls are beside each other, and how the sensors are turned by them.

A person who walks sets the feet in turn. Between two footfalls of one foot, one stride apart, is one footfall of the
other, halfway between them but for the width w of the walk to its side:

    q = (p_i + p_(i+1)) / 2 -+ w n + noise,

p the positions of the one foot's footfalls, q that of the other's, n the unit vector to the left of the stride, minus
for a right foot. On 63 m of motion-captured walking in laps of 12 m the noise is 0.02 m along, 0.05 m across and
0.003 m up (rms; `two_feet.py`, b894e160); across it is the bend of the path, since the middle of a chord lies inside of
a curve. In the mean over steps of both feet that cancels, as the middles of both feet's strides do so alike. A person
also steps unevenly, or stands longer on one leg: that is the same from step to step, and does not cancel.

So steps are averaged over cells, `CELL_M` of the way or a turn by `CELL_TURN_RAD`. With weights a_k and b_k of the
footfalls of the right and of the left foot (1 where the foot is q, 1/2 and 1/2 in a stride), the means of a cell are

    q_R = sum a_k p_k,    q_L = sum b_k p_k,    n = mean of n,    q_R = q_L - w n.

A stride that is short, as in a shuffle or a turn on the spot, or takes long, as a halt, has no direction, or the other
foot not in its middle: it counts little; what is slow all along counts in full. Over a hole in a
recording its path is no measure of a distance: no step and no cell crosses one. A part of a recording between holes
with a few footfalls is tied by no cell, and left out.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from fg_nav.arrays import Bools, Complexes, Floats, Ints
from fg_nav.detection.stance import Stances
from fg_nav.errors import EstimationError
from fg_nav.recording import Recording
from fg_nav.samples.gaps import find_holes

CELL_M, CELL_TURN_RAD = 8.0, np.deg2rad(60.0)  # Six strides: a path found alone bends by less than steps differ.
MIN_CELLS, MIN_GROWN = 6, 0.25  # Cells of a short walk are smaller, down to a stride and a half.
MAX_CELLS, MAX_GROWN = 40, 2.0  # Those of a long walk are larger: twice as many change no error, and take longer.
MAX_APART_M = 30.0  # More than `MAX_CELLS` are kept where these would be further apart.
MIN_TURNS = 4  # Steps whose directions show how two paths are turned: each does to some degrees.
MIN_STEPS = 1.0  # In a cell, by their weights (`Cells.steps`).
SHORT_M, LONG_M = 0.4, 4.0  # Strides that count half: a shuffle has no direction, longer than a runner's is an error.
NEGLIGIBLE = 0.01  # Weight of a step that is none.
MAX_S, TIMES_USUAL = 2.5, 2.0  # A stride longer than both, s and times the person's usual one, was a halt.
SPAN_S = 60.0  # Of headings, from the first step on: later a path found alone is turned by the gyroscope's drift.
MIN_FOOTFALLS = 10  # Of a part of a recording: some fifteen metres, and two cells.


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
class InterleavedSteps:
    """S footfalls of one foot, each between two of the other."""

    at: Ints  # (S,) rows of the foot
    before: Ints  # (S,) rows of the other one's footfall before it; the next one is after it
    left_normal: Floats  # (S, 2) unit vector to the left of the other one's stride
    weight: Floats  # (S,) 0 to 1, how far that stride is one of a walk: by length, and time against the usual one


def find_steps(foot: Footfalls, other: Footfalls) -> InterleavedSteps:
    """Find the footfalls of a foot that lie, as a single step, between two successive ones of the other."""
    before = np.searchsorted(other.t, foot.t) - 1
    at = np.flatnonzero((before >= 0) & (before < len(other) - 1))
    # no other footfall of this foot in that stride
    counts = np.bincount(before[at], minlength=len(other))
    at = at[counts[before[at]] == 1]
    before = before[at]
    stride, took = np.diff(other.position[:, :2], axis=0), np.diff(other.t)
    length = np.linalg.norm(stride, axis=1)
    # weight of a stride: half at `SHORT_M`, at `LONG_M` and at a halt, against the weighted median of the times
    with np.errstate(divide="ignore", over="ignore"):
        goes = 1.0 / ((1.0 + (SHORT_M / length) ** 4) * (1.0 + (length / LONG_M) ** 4))
    usual = 1.0
    if len(took):
        order = np.argsort(took)
        middle = np.searchsorted(np.cumsum(goes[order]), 0.5 * goes.sum())
        usual = float(took[order[min(middle, len(took) - 1)]])
    goes = goes / (1.0 + (np.maximum(took / usual, 1.0) - 1.0) ** 4)
    known = np.diff(other.count_holes(other.t)) + np.diff(foot.count_holes(other.t)) == 0
    kept = known[before] & (goes[before] > NEGLIGIBLE)
    at, before = at[kept], before[kept]
    u = stride[before] / length[before, None]
    return InterleavedSteps(at, before, np.stack([-u[:, 1], u[:, 0]], axis=1), goes[before])


@dataclass(frozen=True)
class Cells:
    """C cells of steps, each a mean."""

    t: Floats  # (C,) s
    right: Floats  # (C, 3) m, place of the foot
    left: Floats
    left_normal: Floats  # (C, 2)
    steps: Floats  # (C,) number of steps, by their weights
    grown: float  # size over `CELL_M`

    def __len__(self) -> int:
        return len(self.t)

    def take(self, kept: Bools) -> Cells:
        """Return those that are kept (C,)."""
        rows = {name: getattr(self, name)[kept] for name in ("t", "right", "left", "left_normal", "steps")}
        return replace(self, **rows)


def average_cells(right: Footfalls, left: Footfalls) -> Cells:
    """Average interleaved steps of both feet over cells of the walk; return the cells in order of time."""
    of_right, of_left = find_steps(right, left), find_steps(left, right)
    # way walked to each footfall of the left foot, and turns taken, in cells
    move = np.diff(left.position[:, :2], axis=0, prepend=left.position[:1, :2])
    length = np.linalg.norm(move, axis=1)
    walks, turned = length > SHORT_M, np.zeros(len(left))
    heading = np.unwrap(np.arctan2(move[walks, 1], move[walks, 0]))
    turned[walks] = np.abs(np.diff(heading, prepend=heading[:1]))
    way, turned = np.cumsum(length) / CELL_M, np.cumsum(turned) / CELL_TURN_RAD
    grown = float(np.clip((way + turned)[-1:].max(initial=0.0) / MAX_CELLS, 1.0, MAX_GROWN))
    shrunk = float(np.clip(way[-1:].max(initial=0.0) / MIN_CELLS, MIN_GROWN, 1.0))
    # number of each footfall's cell: none crosses a hole of either recording
    piece = left.count_holes(left.t) + np.searchsorted(right.holes, left.t)
    pair = np.stack([piece, np.floor(way / (grown * shrunk) + turned / grown)], axis=1)
    number = np.unique(pair, axis=0, return_inverse=True)[1].ravel()
    cells, steps = (number[of_right.before], number[of_left.at]), (of_right, of_left)
    count = number.max(initial=0) + 1
    weights = [np.bincount(cell, of.weight, count) for cell, of in zip(cells, steps, strict=True)]
    # both kinds count alike, or the bend of a curve would not cancel
    with np.errstate(divide="ignore"):
        n_steps = 4.0 / (1.0 / weights[0] + 1.0 / weights[1])
    # cells that are kept, evenly
    kept = np.flatnonzero(n_steps >= MIN_STEPS)
    most = max(MAX_CELLS, int(np.ceil(float(length[1:].sum()) / MAX_APART_M)))
    if len(kept) > most:
        kept = kept[np.rint(np.linspace(0, len(kept) - 1, most)).astype(np.int64)]

    def mean(of_right_steps: Floats, of_left_steps: Floats) -> Floats:
        """Weighted mean (C, c) of rows (S, c) of both kinds of steps."""
        means = []
        for cell, of, rows in zip(cells, steps, (of_right_steps, of_left_steps), strict=True):
            with np.errstate(invalid="ignore"):
                total = np.stack([np.bincount(cell, of.weight * column, count) for column in rows.T], axis=1)
                means.append((total / np.bincount(cell, of.weight, count)[:, None])[kept])
        return np.asarray(np.mean(means, axis=0))

    middle = [0.5 * (one.position[:-1] + one.position[1:]) for one in (right, left)]
    return Cells(
        t=mean(right.t[of_right.at, None], left.t[of_left.at, None])[:, 0],
        right=mean(right.position[of_right.at], middle[0][of_left.before]),
        left=mean(middle[1][of_right.before], left.position[of_left.at]),
        left_normal=mean(of_right.left_normal, of_left.left_normal),
        steps=n_steps[kept],
        grown=grown * shrunk,
    )


def measure_turns(right: Footfalls, left: Footfalls) -> tuple[Floats, Complexes]:
    """Times (S,) s of steps, and weight exp(i turn) (S,), turn being the right foot's direction less the left one's.

    The left foot's stride `before` to `before` + 1 is compared with the way of the right foot from its footfall
    `at` - 1 to `at` + 1, its two strides about the same time.
    """
    of_right = find_steps(right, left)
    inner = (of_right.at > 0) & (of_right.at < len(right) - 1)
    at, before, weight = of_right.at[inner], of_right.before[inner], of_right.weight[inner]
    whole = right.count_holes(right.t[at + 1]) == right.count_holes(right.t[at - 1])  # no hole of the recording between
    at, before, weight = at[whole], before[whole], weight[whole]
    by_left = np.diff(left.position[:, :2], axis=0)[before]
    by_right = right.position[at + 1, :2] - right.position[at - 1, :2]
    turn = np.arctan2(by_right[:, 1], by_right[:, 0]) - np.arctan2(by_left[:, 1], by_left[:, 0])
    return right.t[at], weight * np.exp(1j * turn)


def measure_relative_heading(right: Footfalls, left: Footfalls) -> float:
    """Heading of the right sensor's x axis at its start less that of the left one's, rad clockwise.

    Both paths begin with the same sensor heading. After a hole in a recording the heading of its path is arbitrary, so
    only steps before the first hole are used, if there are any.

    Raises `EstimationError` where no step of the one foot lies between two of the other.
    """
    t, turn = measure_turns(right, left)
    if not len(t):
        raise EstimationError(
            "the two feet take no step in turn: are they of one person at one time, and their clocks aligned? "
            "Run each of them by itself, or give --clock-offset."
        )
    first_hole = np.concatenate([right.holes, left.holes]).min(initial=np.inf)
    end = min(t[0] + SPAN_S, first_hole if first_hole > t[0] else np.inf)
    return float(np.angle(np.sum(turn[t < end])))


# parts of a recording, between its holes


def keep_walked_parts(recording: Recording, stances: Stances) -> Recording:
    """Return a recording without its parts of a few footfalls; the same where there are none."""
    part = np.searchsorted(find_holes(recording.t), np.arange(len(recording)))
    footfalls = np.bincount(part[stances.spans[0]], minlength=part[-1] + 1)
    return _keep(recording, (footfalls >= MIN_FOOTFALLS)[part], "too few footfalls to be laid beside the other foot")


def keep_longest_part(recording: Recording) -> Recording:
    """Return the longest part of a recording, as of a foot alone; the same where there is one."""
    part = np.searchsorted(find_holes(recording.t), np.arange(len(recording)))
    return _keep(recording, part == np.bincount(part).argmax(), "the longest part is used, as there is one foot alone")


def _keep(recording: Recording, kept: Bools, why: str) -> Recording:
    """Return the recording at the samples `kept` (N,), with the note `why`; unchanged if none would be left."""
    if kept.all() or not kept.any():
        return recording
    t, lost = recording.t, np.flatnonzero(~kept)
    note = f"left out {len(lost)} samples between {t[lost[0]]:.1f} and {t[lost[-1]]:.1f} s, about gaps: {why}"
    provenance = replace(recording.provenance, notes=(*recording.provenance.notes, note))
    return replace(recording.take(kept), provenance=provenance)
