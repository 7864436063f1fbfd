"""A solution that is late takes effect when it is there."""

from collections.abc import Sequence

import numpy as np
import pytest

from fg_nav.online import OnlineNavigator, navigator, smoother
from fg_nav.online.buffer import ReportedFootfall, rows_of
from fg_nav.online.resolve import Solver
from tests.online.walks import NORTH, push, short_walk, worst_difference


class LateSolver(Solver):
    """Has each solution some lines after it is due."""

    late = line = requested_at = 0
    is_here = False

    def __init__(self, *given: object) -> None:
        super().__init__(*given)
        self.is_here = False

    def _submit(self, work: object, footfalls: object = ()) -> None:
        self.is_here = True
        super()._submit(work, footfalls)
        self.is_here = False

    def request(self, footfalls: Sequence[ReportedFootfall]) -> None:
        super().request(footfalls)
        self.requested_at = footfalls[-1].line + 1

    def is_ready(self) -> bool:
        return self.line >= self.requested_at + self.late


class NotedSmoother(smoother.OnlineSmoother):
    """Has its solver know the line that comes."""

    def add_footfall(self, *given, **further):
        self.solver.line = self.n_reported
        return super().add_footfall(*given, **further)


@pytest.fixture(autouse=True)
def as_it_is_walked(monkeypatch: pytest.MonkeyPatch) -> None:
    """No solution is waited for."""
    monkeypatch.setattr(smoother, "FAST", np.inf)
    monkeypatch.setattr(navigator, "Solver", LateSolver)
    monkeypatch.setattr(navigator, "OnlineSmoother", NotedSmoother)


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
