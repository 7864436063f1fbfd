"""A solution that is late is taken over by a walk that is resumed where it was taken over before."""

from pathlib import Path

import numpy as np
import pytest
from fg_nav.online.checkpoint import Checkpoint

from fg_nav.detection.stance import StanceParameters
from fg_nav.online import OnlineNavigator, navigator, smoother
from fg_nav.online.buffer import OnlineOptions, ReportedFootfall, SampleBuffer, rows_of
from fg_nav.online.resolve import WalkSolver
from tests.online.walks import NORTH, push, short_walk, worst_difference


class LateSolver(WalkSolver):
    """Has each solution some lines after it is due."""

    late = 0

    def __init__(self, options: OnlineOptions, stance: StanceParameters, buffer: SampleBuffer) -> None:
        super().__init__(options, stance, buffer)
        self.is_here = False
        self.line = self._requested_at = 0

    def request(self, footfalls: tuple[ReportedFootfall, ...]) -> None:
        super().request(footfalls)
        self._requested_at = footfalls[-1].line + 1

    def is_ready(self) -> bool:
        return self.line >= self._requested_at + self.late


class NotedSchedule(smoother.ResolveSchedule):
    """Has its solver know the line that comes."""

    def is_taken(self, line: int) -> bool:
        self.solver.line = line
        return super().is_taken(line)


@pytest.fixture(autouse=True)
def as_it_is_walked(monkeypatch: pytest.MonkeyPatch) -> None:
    """No solution is waited for."""
    monkeypatch.setattr(smoother, "FAST", np.inf)
    monkeypatch.setattr(navigator, "WalkSolver", LateSolver)
    monkeypatch.setattr(smoother, "ResolveSchedule", NotedSchedule)


def walk_on(rows: np.ndarray, kills: tuple[int, ...], path: Path) -> OnlineNavigator:
    """Walk, saved before each of these samples, and killed a second later."""
    checkpoint, walked = Checkpoint(path), OnlineNavigator(NORTH)
    for start, stop in zip((0, *kills), (*kills, len(rows)), strict=True):
        push(walked, rows[start:stop], range(30, stop - start, 30))
        checkpoint.write(checkpoint.collect(walked))
        if stop < len(rows):
            push(walked, rows[stop : stop + 100])
            checkpoint = Checkpoint(path)
            walked = checkpoint.resume(NORTH)
    walked.close()
    return walked


@pytest.mark.parametrize("late", [8])
def test_a_walk_that_does_not_wait_is_resumed_to_the_same_answer(
    late: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where what came since is so much that it is added beside as well."""
    monkeypatch.setattr(LateSolver, "late", late)
    rows = rows_of(short_walk(34))
    whole = walk_on(rows, (), tmp_path / "whole")
    assert whole.races > late
    resumed = walk_on(rows, tuple(range(1500, len(rows), 700)), tmp_path / "killed")
    assert worst_difference(resumed.causal(), whole.causal()) < 1e-9
    assert worst_difference(resumed.smoothed(), whole.smoothed()) < 1e-9


def test_what_was_told_on_a_slow_machine_is_known_on_a_fast_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Saved while a solution was late, and later with no state behind the one before it."""
    rows, late = rows_of(short_walk(30)), []
    monkeypatch.setattr(LateSolver, "late", 4)
    checkpoint, walked = Checkpoint(tmp_path / "walk"), OnlineNavigator(NORTH)
    for start in range(0, len(rows), 300):
        push(walked, rows[start : start + 300], range(50, 300, 50))
        checkpoint.write(checkpoint.collect(walked))
        pending = walked.smoother.schedule.pending
        if pending is not None and walked.smoother.n_reported > pending.due_at:
            late.append(walked.smoother.n_reported)
            with monkeypatch.context() as fast:
                fast.setattr(LateSolver, "late", 0)
                resumed = Checkpoint(tmp_path / "walk").resume(NORTH)
            assert worst_difference(resumed.causal(), walked.causal()) < 1e-9
            assert worst_difference(resumed.smoothed(), walked.smoothed()) < 1e-9
    assert len(late) > 2
