"""A solution that is late takes effect when it is there."""

import numpy as np
import pytest

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


@pytest.mark.parametrize("late", [8])
def test_a_walk_does_not_wait_for_a_solution_that_is_late(late: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where what came since is so much that it is added beside as well: it ends as one that waits."""
    rows, ends = rows_of(short_walk(34)), []
    for lines in (0, late):
        monkeypatch.setattr(LateSolver, "late", lines)
        walked = OnlineNavigator(NORTH)
        push(walked, rows, range(30, len(rows), 30))
        walked.close()
        ends.append(walked.smoothed())
    assert worst_difference(*ends) < 1e-9
