"""The process beside a walk in progress (`beside`): it reads messages from its standard input, and answers tasks.

It ends when its standard input does, so it never outlives the walk.
"""

from __future__ import annotations

import os
import pickle
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Any, cast

from fg_nav.detection.stance import StanceParameters
from fg_nav.online.buffer import ReportedFootfall, SampleBuffer
from fg_nav.online.handover import Handover
from fg_nav.online.options import OnlineOptions
from fg_nav.online.solving import Task, WalkSolver
from fg_nav.smoother.solver import UNSOLVED
from fg_nav.system.processes import collect_seldom

NICENESS = 5  # The process that tells the walk comes first.


class Worker:
    """Does what the messages say."""

    def __init__(self) -> None:
        self._buffer = SampleBuffer()
        self._solver: WalkSolver
        self._begun: Any = None

    def answer(self, kind: str, *content: Any) -> tuple[Handover | None] | None:
        """Return the answer to a message as a tuple of one; None where it asks for none."""
        match kind:
            case "options":
                options, stance = content
                self._solver = self._make_solver(options, stance)
            case "samples":
                self._buffer.append(content[0])
            case "skip":
                self._buffer.skip_to(content[0])
            case "discard":
                self._buffer.discard(content[0])
            case "begin":
                self._begin(content[0])
            case "ask":
                return (self._go_on(content[0]),)
        return None

    def _make_solver(self, options: OnlineOptions, stance: StanceParameters) -> WalkSolver:
        return WalkSolver(options, stance, self._buffer)

    def _begin(self, task: Task) -> None:
        self._begun = self._try(self._solver.solve, task)

    def _go_on(self, footfalls: tuple[ReportedFootfall, ...]) -> Handover | None:
        if self._begun is None:
            return None
        handover = self._try(self._solver.go_on, *self._begun, footfalls)
        self._begun = None if handover is None else (handover, self._begun[1])
        return cast("Handover | None", handover)

    @staticmethod
    def _try(work: Any, *content: Any) -> Any:
        try:
            return work(*content)
        except UNSOLVED:
            return None


def answer_messages(answer: Callable[..., tuple[Any] | None]) -> None:
    """Answer messages until there are no more, each by a tuple of one, or by none."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that tells the walk
    os.nice(NICENESS)
    collect_seldom()
    messages, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever prints must not print into the answers
    with suppress(EOFError, OSError, pickle.UnpicklingError):  # its owner has gone, maybe in the middle of a message
        while True:
            found = answer(*pickle.load(messages))
            if found is not None:
                pickle.dump(found[0], answers, protocol=pickle.HIGHEST_PROTOCOL)
                answers.flush()


if __name__ == "__main__":
    answer_messages(Worker().answer)
