"""Two feet of one person in progress: samples of each as they come, lines of both and of the person.

    samples of a foot  -> its navigator, as of one foot alone               (`navigator`)
    its walk, again    -> with the other foot's, in one graph               (`feet_solving`)
    two footfalls      -> the person between them                           (`feet_person`)

Both are on one clock, but for an offset that is given. A foot that falls silent or is refused leaves the other going on
alone, from all that both had shown; one that comes back has a gap, and joins again by its steps. One whose clock
restarts is on no clock of both any more: each is as it is alone from then on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.detection.causal import CausalParameters
from fg_nav.errors import EstimationError, FgNavError
from fg_nav.feet.person import FeetSolution
from fg_nav.feet.sides import SIDES, Side
from fg_nav.online.estimates import StanceEstimate, split_rows
from fg_nav.online.feet_beside import FeetSolvers
from fg_nav.online.feet_clocks import ENOUGH_SWINGS, check_clocks
from fg_nav.online.feet_lines import FeetLine, FootState, State
from fg_nav.online.feet_person import MAX_STEP_S, PersonTracker
from fg_nav.online.handover import Handover, TiedHandover
from fg_nav.online.navigator import OnlineNavigator
from fg_nav.online.options import OnlineOptions
from fg_nav.online.revision import Revision
from fg_nav.online.schedule import AT_ONCE
from fg_nav.online.smoother_state import Pending
from fg_nav.smoother.feet import measure_width_sigma, trace_solved_person
from fg_nav.solution import Solution

SILENT_S = 5.0  # By which the stamps of one foot are behind the other's: then it is said to be silent.
EVERY = 4  # Footfalls, at which a foot that is not tied yet is solved again.


@dataclass(frozen=True)
class FeetWalk:
    """Two feet at the end.

    Attributes
    ----------
    feet : each that has a walk, by side.
    both : where they were solved together: with the person and the width between; else None.
    lost : why a foot has no walk, by side.
    """

    feet: Mapping[Side, Solution]
    both: FeetSolution | None
    lost: Mapping[Side, str]


class FeetNavigator:
    """Navigates both feet while samples come in.

    Attributes
    ----------
    navigators : of each foot, by side.
    refused : feet whose samples cannot be used, and why.
    offset_s : to add to the stamps of each; `push` does.
    is_parted : whether their clocks are not one any more.
    """

    def __init__(
        self,
        options: OnlineOptions = OnlineOptions(),
        remark: Callable[[str], None] = lambda words: None,
        detection: CausalParameters = CausalParameters(),
        clock_offset_s: float = 0.0,
        beside: bool = False,
        right: OnlineOptions | None = None,
    ) -> None:
        """Begin a walk.

        Parameters
        ----------
        options : of both feet; a heading is that of the left sensor.
        remark : given, in a sentence, what is odd about the samples, with the foot's name.
        detection : how footfalls are found.
        clock_offset_s : to add to the stamps of the right foot.
        beside : whether both are solved again in another process.
        right : options of the right foot, where its sensor is calibrated for itself.

        Raises
        ------
        EstimationError
            With a lag or fixes, and for an offset that is no time.
        """
        _check(options, clock_offset_s)
        self._remark = remark
        self._clocks_checked_at: int | None = ENOUGH_SWINGS
        self.offset_s: dict[Side, float] = {"left": 0.0, "right": clock_offset_s}
        given: dict[Side, OnlineOptions] = {"left": options, "right": options if right is None else right}
        self._solvers = FeetSolvers(given, detection.stance, remark, beside)
        self.navigators = {
            side: OnlineNavigator(
                given[side], partial(_say, remark, side), detection, solver=partial(self._solvers.open, side)
            )
            for side in SIDES
        }
        self.refused: dict[Side, str] = {}
        self._silent: set[Side] = set()
        self.is_parted, self._begun = False, np.inf
        self._person = PersonTracker()
        self._pending: dict[Side, Pending | None] = dict.fromkeys(SIDES)
        self._begun_s = dict.fromkeys(SIDES, -np.inf)
        self._known: list[Handover | None] = [None, None]

    def push(
        self,
        side: Side,
        t: Floats,
        acc: Floats,
        gyr: Floats,
        mag: Floats | None = None,
        pressure: Floats | None = None,
    ) -> list[FeetLine]:
        """Add samples of a foot, as to `OnlineNavigator.push`: both in turn, in blocks of less than `SILENT_S`.

        Raises `FgNavError` where the samples of neither foot can be used.
        """
        if side in self.refused:
            return []
        try:
            found = self.navigators[side].push(np.asarray(t) + self.offset_s[side], acc, gyr, mag, pressure)
        except FgNavError as error:
            return [self.refuse(side, error)]
        return [*self.label(side, found), *self.look(side)]

    def label(self, side: Side, found: Iterable[StanceEstimate | Revision]) -> list[FeetLine]:
        """Return what a foot's navigator found as lines."""
        frame, continues = self.frame(side), self.navigators[side].reported_continues
        return [FeetLine(side, frame, one, isinstance(one, StanceEstimate) and continues[one.number]) for one in found]

    def frame(self, side: Side) -> Side:
        """Return in which frame a foot's lines are now."""
        begun = self.navigators[side].smoother.begun
        return "left" if side == "left" or isinstance(begun, TiedHandover) else "right"

    def refuse(self, side: Side, error: FgNavError) -> FeetLine:
        """Leave a foot out from here on; raises the error where no other is left."""
        if len(self.refused) + 1 == len(SIDES):
            raise error
        self.refused[side] = str(error)
        return self._tell(side, "refused", str(error))

    def look(self, side: Side) -> list[FeetLine]:
        """Look at what samples of a foot that were just pushed change for both; lines of that."""
        news = [*self._watch_clock(side), *self._watch_silence(side)]
        self._hasten(side)
        self._check_clocks()
        return [*news, *self._follow_person()]

    def close(self) -> list[FeetLine]:
        """End the walk; lines of the footfalls that were still open, and what its end takes back."""
        used = [side for side in SIDES if side not in self.refused and not self.navigators[side].has_ended]
        found = [line for side in used for line in self.label(side, self.navigators[side].begin_end())]
        news = list(self._follow_person())
        ends = [line for side in used for line in self.label(side, self.navigators[side].take_end())]
        self._solvers.close()
        return [*found, *news, *ends, *self._follow_person()]

    def abandon(self) -> None:
        """End the process beside, and nothing else."""
        self._solvers.close()

    def finish(self) -> FeetWalk:
        """End the walk and return what each foot, and both, come to; raises `FgNavError` where neither has a walk."""
        self.close()
        feet, lost = dict[Side, Solution](), dict(self.refused)
        for side in (one for one in SIDES if one not in self.refused):
            try:
                feet[side] = self.navigators[side].finish()
            except FgNavError as error:
                lost[side] = str(error)
        if not feet:
            raise EstimationError(f"neither foot has a walk: {' '.join(lost.values())}")
        return FeetWalk(feet, self._build_both(feet), lost)

    def _build_both(self, feet: Mapping[Side, Solution]) -> FeetSolution | None:
        """Return both feet as they were solved together; None where they were not."""
        solved = self._solvers.walks.solved
        if len(feet) < len(SIDES) or solved is None or not self._is_tied:
            return None
        left, right = feet["left"], feet["right"]
        person = trace_solved_person(solved, right, left)
        counts = solved.problem.ties.cells, len(solved.problem.reach)
        return FeetSolution(
            right, left, person, solved.minimum.values.width, measure_width_sigma(solved.minimum.root), *counts
        )

    @property
    def _is_tied(self) -> bool:
        """Whether both feet are in one frame."""
        return self.frame("right") == "left"

    def _hasten(self, side: Side) -> None:
        """Let a foot that is not tied yet be solved again soon, where both walk, and both be solved together."""
        own, other = (self.navigators[one].smoother for one in (side, _other(side)))
        if min(own.n_reported, other.n_reported) < AT_ONCE[-1] or self._silent or self.refused or self.is_parted:
            return
        if not isinstance(own.begun, TiedHandover) and own.n_reported % EVERY == 0:
            own.resolve_soon(own.n_reported + 1)
        # Both begin together.
        if own.takeover.pending is not self._pending[side]:
            self._pending[side] = own.takeover.pending
            if own.takeover.pending is not None:
                self._begun_s[side] = self._find_last(side)
                if self._begun_s[side] - self._begun_s[_other(side)] > MAX_STEP_S:
                    other.resolve_soon(other.n_reported + 1)

    def _check_clocks(self) -> None:
        """Say once, as soon as the steps show it, that the clocks do not fit."""
        left, right = (self.navigators[side].smoother for side in SIDES)
        told, at = min(left.n_reported, right.n_reported), self._clocks_checked_at
        if at is None or told < at or self.is_parted or self.refused:
            return
        words = check_clocks(left.rows, right.rows, self.offset_s["right"])
        self._clocks_checked_at = None if words is not None else told + ENOUGH_SWINGS
        if words:
            self._remark(words)

    def _watch_clock(self, side: Side) -> Iterator[FeetLine]:
        """Notice a foot whose clock restarted: its stamps were set on by a guess."""
        navigator = self.navigators[side]
        newest = navigator.buffer.stop - 1
        if not self.is_parted and newest >= 0 and navigator.judge.sensor_time(newest, 0.0):
            self.is_parted = True
            self._solvers.part()
            yield self._tell(side, "parted", "its clock began again: each foot goes on alone, in a frame of its own")

    def _watch_silence(self, side: Side) -> Iterator[FeetLine]:
        """Notice that the other foot is behind, or that this one is back."""
        last, other = {one: self._find_last(one) for one in SIDES}, _other(side)
        if not np.isfinite(last[side]):
            return
        self._begun = min(self._begun, last[side])
        behind = last[side] - max(last[other], self._begun)
        if behind > SILENT_S and other not in (*self._silent, *self.refused):
            self._silent.add(other)
            yield self._tell(other, "silent", f"no samples for {SILENT_S:.0f} s: the {side} foot goes on alone")
        if side in self._silent and behind > -SILENT_S:
            self._silent.discard(side)
            yield self._tell(side, "back", "samples again: it joins the other foot by its next steps")

    def _find_last(self, side: Side) -> float:
        """Return the newest stamp of a foot, s."""
        buffer = self.navigators[side].buffer
        return buffer.stamp(buffer.stop - 1) if buffer.stop > buffer.first else -np.inf

    def _follow_person(self) -> Iterator[FeetLine]:
        """Yield the person's path where a foot's has changed, and a step where there is a new one."""
        if self.is_parted:
            return
        smoothers = [self.navigators[side].smoother for side in SIDES]
        begun = [one.begun for one in smoothers]
        is_one = _go_on_from_one(*begun)
        if is_one and any(one is not known for one, known in zip(begun, self._known, strict=True)):
            self._known = begun
            paths = (split_rows(one.rows) for one in smoothers)
            revised = self._person.revise(*(np.column_stack([path.t, path.position]) for path in paths))
            if revised is not None:
                yield FeetLine("person", "left", revised)
        left, right = (one.newest for one in smoothers)
        step = None if left is None or right is None else self._person.add(left, right)
        # Others are in the next path that is told.
        if step is not None and is_one:
            yield FeetLine("person", "left", step)

    @property
    def last_stamp(self) -> float:
        """The newest stamp of both, s; -inf before the first."""
        return max(self._find_last(side) for side in SIDES)

    def _tell(self, side: Side, state: State, reason: str) -> FeetLine:
        t = self.last_stamp
        return FeetLine(side, self.frame(side), FootState(t if np.isfinite(t) else 0.0, state, reason))


def _go_on_from_one(left: Handover | None, right: Handover | None) -> bool:
    """Whether both feet go on from the same solution: for a step or two one of them has the older one."""
    return isinstance(left, TiedHandover) and isinstance(right, TiedHandover) and left.number == right.number


def _other(side: Side) -> Side:
    return "right" if side == "left" else "left"


def _say(remark: Callable[[str], None], side: Side, words: str) -> None:
    remark(f"{side} foot: {words}")


def _check(options: OnlineOptions, clock_offset_s: float) -> None:
    for name, given in (("a lag", options.lag_s), ("fixes", options.fixes or None)):
        if given is not None:
            raise EstimationError(f"{name} cannot be used with two feet: leave it out, or follow one foot.")
    if not np.isfinite(clock_offset_s):
        raise EstimationError(f"a clock offset of {clock_offset_s} s is no time: give a number.")
