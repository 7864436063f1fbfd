"""Two feet of one person in progress: samples of each as they come, lines of both and of the person.

    samples of a foot  -> its navigator, as of one foot alone               (`navigator`)
    its walk, again    -> with the other foot's, in one graph               (`resolve`)
    two footfalls      -> the person between them                           (`PersonTracker`)

Halfway in time between two footfalls of different feet both stand, so that the person, the middle of both, is at

    p = (p_left + p_right) / 2,    P = (P_left + P_right) / 2 >= cov(p).

The bound holds however the errors are correlated, as the covariance of their difference is none below zero; those of
two feet that were solved together are nearly one, and then it is close.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import EstimationError, FgNavError
from fg_nav.feet import SIDES, Side
from fg_nav.feet.clocks import Swings, match_swings
from fg_nav.feet.person import CHORD_M, FeetSolution
from fg_nav.feet.steps import SHORT_M, find_longest_stride
from fg_nav.frames import compute_heading
from fg_nav.online.buffer import OnlineOptions, SampleBuffer
from fg_nav.online.estimates import (
    EstimateRow,
    FeetLine,
    FootState,
    PersonEstimate,
    Revision,
    StanceEstimate,
    State,
    split_rows,
    thin_rows,
)
from fg_nav.online.navigator import OnlineNavigator
from fg_nav.online.resolve import FootSolver, Solver, SolverProcess, WalksAlone
from fg_nav.online.smoother import AT_ONCE, Pending
from fg_nav.online.window import AnchorState
from fg_nav.samples.readings import COLUMNS
from fg_nav.smoother.feet import measure_width_sigma, trace_solved_person
from fg_nav.solution import Solution

SILENT_S = 5.0  # By which the stamps of one foot are behind the other's: then it is silent.
EVERY = 4  # Footfalls, at which a foot that is not tied yet is solved again.
MAX_STEP_S = 2.0  # Between footfalls of different feet; a standing person has one of each every two seconds.
BLOCK_S = 0.1  # Of rows of one foot, so that no foot runs ahead of the other.
HELD_S = 1.0  # Of silence of one foot, that rows wait for it.
MAX_ROWS = 1000  # In a block, whatever their stamps.
MAX_HELD = 4000  # Rows that wait, more than are read at once: the clocks differ, and no foot waits for the other.
MAX_REMEMBERED = 8  # Steps before, by which the direction is found.
ENOUGH_SWINGS = 20  # Of each foot, that show whether the clocks fit; some of them in a bend.

OTHER: dict[Side, Side] = {"left": "right", "right": "left"}


@dataclass(frozen=True)
class FeetWalk:
    """Two feet at the end."""

    feet: Mapping[Side, Solution]  # Each that has a walk.
    both: FeetSolution | None  # With the person and the width between; None where they were not solved together.
    lost: Mapping[Side, str]  # Why a foot has no walk.


class FeetNavigator:
    """Navigates both feet while samples come in, by a navigator each."""

    def __init__(
        self,
        options: OnlineOptions = OnlineOptions(),
        remark: Callable[[str], None] = lambda words: None,
        clock_offset_s: float = 0.0,
        background: bool = False,
        right: OnlineOptions | None = None,
    ) -> None:
        """Begin a walk, as `OnlineNavigator` does; raises `EstimationError` with a lag or fixes.

        A heading of the `options` is that of the left sensor; `right` are those of the right foot where its sensor is
        calibrated for itself. `clock_offset_s` is added to the stamps of the right foot.
        """
        for name, is_given in (("a lag", options.lag_s is not None), ("fixes", bool(options.fixes))):
            if is_given:
                raise EstimationError(f"{name} cannot be used with two feet: leave it out, or follow one foot.")
        if not np.isfinite(clock_offset_s):
            raise EstimationError(f"a clock offset of {clock_offset_s} s is no time: give a number.")
        self._remark = remark
        self._clocks_checked_at: int | None = ENOUGH_SWINGS  # lines of each foot
        self.offset_s: dict[Side, float] = {"left": 0.0, "right": clock_offset_s}  # that `push` adds to the stamps
        given: dict[Side, OnlineOptions] = {"left": options, "right": options if right is None else right}
        self._walks = WalksAlone()
        self._process = SolverProcess({side: given[side] for side in SIDES}) if background else None

        def begin(side: Side) -> OnlineNavigator:
            """Begin the walk of a foot, which is solved with the other's."""

            def make_solver(buffer: SampleBuffer) -> Solver:
                here = FootSolver(side, self._walks, given[side], buffer)
                return Solver(here, self._process, remark, side)

            return OnlineNavigator(given[side], lambda words: remark(f"{side} foot: {words}"), solver=make_solver)

        self.navigators = {side: begin(side) for side in SIDES}
        self.refused: dict[Side, str] = {}  # feet whose samples cannot be used, and why
        self._silent: set[Side] = set()
        self._begun = np.inf  # first stamp, s
        self._person = PersonTracker()
        self._pending: dict[Side, Pending | None] = dict.fromkeys(SIDES)  # solutions, and when they were begun, s
        self._begun_s = dict.fromkeys(SIDES, -np.inf)
        self._known: list[AnchorState | None] = [None, None]

    @property
    def is_parted(self) -> bool:
        """Whether the clocks of the feet are not one any more: each foot is left alone."""
        return self._walks.is_parted

    def push(
        self, side: Side, t: Floats, acc: Floats, gyr: Floats, mag: Floats | None = None, pressure: Floats | None = None
    ) -> list[FeetLine]:
        """Add samples of a foot, as to `OnlineNavigator.push`: both in turn, in blocks of less than `SILENT_S`."""
        if side in self.refused:
            return []
        try:
            found = self.navigators[side].push(np.asarray(t) + self.offset_s[side], acc, gyr, mag, pressure)
        except FgNavError as error:
            return [self.refuse(side, error)]
        return [*self.label(side, found), *self.update_both(side)]

    def label(self, side: Side, found: Iterable[StanceEstimate | Revision]) -> list[FeetLine]:
        """Wrap results in lines, each with its foot and its frame."""
        return [FeetLine(side, self.frame(side), one) for one in found]

    def frame(self, side: Side) -> Side:
        """Return the frame of a foot's lines: the left foot's, and the right foot's own until it is tied."""
        initial = self.navigators[side].smoother.initial
        return "left" if side == "left" or (initial is not None and initial.tied is not None) else "right"

    def refuse(self, side: Side, error: FgNavError) -> FeetLine:
        """Leave a foot out from here on; return the line on that; raises the error where no other is left."""
        if len(self.refused) + 1 == len(SIDES):
            raise error
        self.refused[side] = str(error)
        return self._report_state(side, "refused", str(error))

    def update_both(self, side: Side) -> list[FeetLine]:
        """Return lines on lost and regained feet and on the person, after samples of this foot were pushed."""
        news: list[FeetLine] = []
        # After a clock restart the shift of the stamps is a guess: the feet share no clock any more.
        navigator = self.navigators[side]
        if not self.is_parted and navigator.intake.clock_shift_s:
            self._walks.is_parted = True
            if self._process is not None:
                self._process.part()
            why = "its clock began again: each foot goes on alone, in a frame of its own"
            news.append(self._report_state(side, "parted", why))
        # The other foot is behind, or this one is back.
        last, other = {one: self.navigators[one].buffer.newest_s for one in SIDES}, OTHER[side]
        if np.isfinite(last[side]):
            self._begun = min(self._begun, last[side])
            behind = last[side] - max(last[other], self._begun)
            if behind > SILENT_S and other not in (*self._silent, *self.refused):
                self._silent.add(other)
                why = f"no samples for {SILENT_S:.0f} s: the {side} foot goes on alone"
                news.append(self._report_state(other, "silent", why))
            if side in self._silent and behind > -SILENT_S:
                self._silent.discard(side)
                why = "samples again: it joins the other foot by its next steps"
                news.append(self._report_state(side, "back", why))
        self._schedule_both(side)
        self._check_clocks()
        return [*news, *self._follow_person()]

    def close(self) -> list[FeetLine]:
        """End the walk; return the lines of the footfalls that were still open, and the last revisions."""
        used = [side for side in SIDES if side not in self.refused and not self.navigators[side].has_ended]
        # the last solution of each foot is begun before either is taken: both walks are joined in it
        lines = [line for side in used for line in self.label(side, self.navigators[side].begin_end())]
        lines += self._follow_person()
        lines += [line for side in used for line in self.label(side, self.navigators[side].smoother.take_end())]
        self.stop_process()
        return [*lines, *self._follow_person()]

    def stop_process(self) -> None:
        """End the process that solves the walks in the background, and nothing else."""
        if self._process is not None:
            self._process.close()

    def finish(self) -> FeetWalk:
        """End the walk and return what each foot, and both, come to; raises `FgNavError` where neither has a walk."""
        self.close()
        feet, lost = dict[Side, Solution](), dict(self.refused)
        for side in SIDES:
            try:
                if side not in self.refused:
                    feet[side] = self.navigators[side].finish()
            except FgNavError as error:
                lost[side] = str(error)
        if not feet:
            raise EstimationError(f"neither foot has a walk: {' '.join(lost.values())}")
        # Both as they were solved together, where they were.
        solved, both = self._walks.both, None
        if len(feet) == len(SIDES) and solved is not None and self.frame("right") == "left":
            left, right = feet["left"], feet["right"]
            person, width = trace_solved_person(solved, right, left), solved.minimum.values.width
            counts = solved.problem.ties.cells, len(solved.problem.reach)
            both = FeetSolution(right, left, person, width, measure_width_sigma(solved.minimum.root), *counts)
        return FeetWalk(feet, both, lost)

    def _schedule_both(self, side: Side) -> None:
        """Schedule re-solves: of a foot not tied yet every `EVERY` footfalls, of the other foot along with this one."""
        own, other = (self.navigators[one].smoother for one in (side, OTHER[side]))
        if min(own.n_reported, other.n_reported) < AT_ONCE[-1] or self._silent or self.refused or self.is_parted:
            return
        if (own.initial is None or own.initial.tied is None) and own.n_reported % EVERY == 0:
            own.resolve_soon(own.n_reported + 1)
        # A re-solve of one foot starts the other foot's too, so that both are in one graph.
        pending = own.pending
        if pending is not self._pending[side]:
            self._pending[side] = pending
            if pending is not None:
                self._begun_s[side] = self.navigators[side].buffer.newest_s
                if self._begun_s[side] - self._begun_s[OTHER[side]] > MAX_STEP_S:
                    other.resolve_soon(other.n_reported + 1)

    def _check_clocks(self) -> None:
        """Remark once, as soon as the steps show it, that the clocks do not fit."""
        smoothers = [self.navigators[side].smoother for side in SIDES]
        count, at = min(one.n_reported for one in smoothers), self._clocks_checked_at
        if at is None or count < at or self.is_parted or self.refused:
            return
        swings = [list_swings(one.rows) for one in smoothers]
        if min(len(one.middle) for one in swings) < ENOUGH_SWINGS:
            self._clocks_checked_at = count + ENOUGH_SWINGS
            return
        self._clocks_checked_at = None
        try:
            clocks = match_swings(*swings)
        except EstimationError as error:
            self._remark(f"the clocks of both feet do not fit: {error}")
            return
        if clocks.note:
            offset, given = clocks.offset_s, self.offset_s["right"]
            fast = f" and drift by {100.0 * clocks.drift:+.2f} %, which a stream does not mend" if clocks.drift else ""
            self._remark(
                f"the clocks of both feet are {abs(offset):.2f} s apart{fast}, as their steps show: begin again with "
                f"--clock-offset {given + offset:.2f}"
            )

    def _follow_person(self) -> Iterator[FeetLine]:
        """Yield the person's path where a foot's has changed, and a step where there is a new one."""
        if self.is_parted:
            return
        smoothers = [self.navigators[side].smoother for side in SIDES]
        left, right = initial = [one.initial for one in smoothers]
        # For a step or two one foot goes on from an older joint solution.
        is_one = left is not None and right is not None and left.tied is not None and left.tied == right.tied
        if is_one and any(one is not known for one, known in zip(initial, self._known, strict=True)):
            self._known = initial
            paths = (split_rows(one.rows) for one in smoothers)
            revised = self._person.revise(*(np.column_stack([path.t, path.position]) for path in paths))
            if revised is not None:
                yield FeetLine("person", "left", revised)
        newest = [one.reported[-1] for one in smoothers if one.reported]
        step = self._person.add(*newest) if len(newest) == len(SIDES) else None
        # Steps that are not reported now are in the next revised path.
        if step is not None and is_one:
            yield FeetLine("person", "left", step)

    def _report_state(self, side: Side, state: State, reason: str) -> FeetLine:
        t = max(one.buffer.newest_s for one in self.navigators.values())
        return FeetLine(side, self.frame(side), FootState(t if np.isfinite(t) else 0.0, state, reason))


class FeetMerge:
    """Rows of two sources in the order of their stamps, in blocks of `BLOCK_S`; those of one source as they come.

    Rows wait until the other foot's have come as far, unless it is silent for `HELD_S`, or `MAX_HELD` rows behind.
    """

    def __init__(self, sides: Iterable[Side | None] = SIDES) -> None:
        self._waits = {side: np.empty((0, COLUMNS)) for side in sides}
        self.newest = dict.fromkeys(self._waits, -np.inf)
        self.silent_s, self._differs = dict.fromkeys(self._waits, 0.0), False

    def put(self, side: Side | None, rows: Floats, waited_s: float = 0.0) -> None:
        """Put in the rows (n, 11) of a foot that came, or note for how long none has."""
        self.silent_s[side] = 0.0 if len(rows) else self.silent_s[side] + waited_s
        self._waits[side] = np.concatenate([self._waits[side], rows])
        stamps = rows[np.isfinite(rows[:, 0]), 0]
        self.newest[side] = float(stamps[-1]) if len(stamps) else self.newest[side]

    def take(self, alone: bool) -> Iterator[tuple[Side | None, Floats]]:
        """Yield blocks of both in turn, as far as both have come; all of them where there is no other to wait for."""
        # Clocks that differ do so until both feet have come as far again: a burst of one is no other clock.
        apart = self._differs and max(self.newest.values()) - min(self.newest.values()) > HELD_S
        self._differs = apart or max(map(len, self._waits.values())) > MAX_HELD
        alone = alone or self._differs or max(self.silent_s.values()) > HELD_S
        limit = np.inf if alone else min(self.newest.values())
        block_s = BLOCK_S if len(self._waits) > 1 else np.inf
        while True:
            heads = {side: rows[0, 0] for side, rows in self._waits.items() if len(rows) and not rows[0, 0] > limit}
            if not heads:
                return
            # At least one row, up to the end of a block.
            side = min(heads, key=lambda one: heads[one])
            rows = self._waits[side]
            beyond = np.flatnonzero(rows[:MAX_ROWS, 0] > min(limit, heads[side] + block_s))
            stop = int(beyond[0]) if len(beyond) else min(len(rows), MAX_ROWS)
            self._waits[side] = rows[stop:]
            yield side, rows[:stop]


class PersonTracker:
    """Steps of a person so far, each midway between two footfalls of different feet."""

    def __init__(self) -> None:
        self._t: list[float] = []
        self._recent: list[Floats] = []

    def add(self, left: EstimateRow, right: EstimateRow) -> PersonEstimate | None:
        """Return the person midway between the newest footfall of each foot; None if these make no new step."""
        feet = split_rows([left, right])
        t = float(feet.t.mean())
        if np.ptp(feet.t) > MAX_STEP_S or (self._t and t <= self._t[-1]):
            return None
        # The heading is the direction from the newest step that is a chord away.
        position, heading = feet.position.mean(axis=0), None
        for before in reversed(self._recent):
            east, north, _ = position - before
            if np.hypot(east, north) >= CHORD_M:
                heading = float(np.arctan2(east, north))
                break
        self._t.append(t)
        self._recent = [*self._recent[1 - MAX_REMEMBERED :], position]
        return PersonEstimate(len(self._t) - 1, t, position, heading, feet.pose_cov.mean(axis=0))

    def revise(self, left: Floats, right: Floats) -> Revision | None:
        """Return the person's path at all steps, from the paths (K, 4) of both feet: t (s), east, north, up (m)."""
        if not self._t:
            return None
        t = np.array(self._t)
        places = [[np.interp(t, path[:, 0], column) for column in path[:, 1:].T] for path in (left, right)]
        path = np.column_stack([t, np.mean(places, axis=0).T])
        self._recent = list(path[-MAX_REMEMBERED:, 1:])
        return Revision(float(t[-1]), 0.0, (), path[thin_rows(len(t))])


def list_swings(rows: Sequence[EstimateRow]) -> Swings:
    """List the swings between reported footfalls; a standing has footfalls without one, every two seconds."""
    known = split_rows(rows)
    middle = 0.5 * (known.t[1:] + known.t[:-1])
    moved = np.linalg.norm(np.diff(known.position[:, :2], axis=0), axis=1)
    took = np.diff(known.t)
    longest = find_longest_stride(known.t)
    is_swing = (moved > SHORT_M) & (took < longest)
    heading = -np.unwrap(compute_heading(known.nav_R_body))  # counter-clockwise
    begins = np.concatenate([[-np.inf], known.t[:-1][took > longest], known.t[-1:]])
    ends = np.concatenate([known.t[:1], known.t[1:][took > longest], [np.inf]])
    return Swings(middle[is_swing], known.t, heading, np.stack([begins, ends], axis=1))
