"""The process beside a walk of two feet (`feet_beside`): that of a walk of one (`worker`), for both.

Each message and each answer has the foot's side before it; "part" is of both.
"""

from __future__ import annotations

from typing import Any

from fg_nav.detection.stance import StanceParameters
from fg_nav.feet import SIDES, Side
from fg_nav.online.buffer import ReportedFootfall
from fg_nav.online.feet_solving import FootSolver, WalksAlone
from fg_nav.online.handover import Handover
from fg_nav.online.options import OnlineOptions
from fg_nav.online.solving import Task
from fg_nav.online.worker import Worker, answer_messages


class FootWorker(Worker):
    """Does what the messages of one foot say: it is solved alone at once, and with the other one when that is asked."""

    def __init__(self, side: Side, walks: WalksAlone) -> None:
        super().__init__()
        self._side, self._walks = side, walks

    def _make_solver(self, options: OnlineOptions, stance: StanceParameters) -> FootSolver:
        return FootSolver(self._side, self._walks, options, stance, self._buffer)

    def _begin(self, task: Task) -> None:
        solver = self._walks.solvers[self._side]
        solver.begin(task)
        solver.prepare()

    def _go_on(self, footfalls: tuple[ReportedFootfall, ...]) -> Handover | None:
        solver = self._walks.solvers[self._side]
        solver.ask(footfalls)
        return solver.take()


class FeetWorker:
    """Does what the messages of both feet say."""

    def __init__(self) -> None:
        self._walks = WalksAlone()
        self._workers = {side: FootWorker(side, self._walks) for side in SIDES}

    def answer(self, side: Side, kind: str, *content: Any) -> tuple[tuple[Side, Handover | None]] | None:
        """Return the answer to a message with its side, as a tuple of one; None where it asks for none."""
        if kind == "part":
            self._walks.part()
            return None
        found = self._workers[side].answer(kind, *content)
        return None if found is None else ((side, found[0]),)


if __name__ == "__main__":
    answer_messages(FeetWorker().answer)
