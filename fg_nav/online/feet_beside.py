"""What solves the walks of both feet again: in this process, or in one other process for both (`feet_worker`).

Messages of both go over one pipe, each with its side before it, and answers come back so (`beside`).
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Mapping
from typing import Any

from fg_nav.detection.stance import StanceParameters
from fg_nav.feet import SIDES, Side
from fg_nav.online.beside import Link, WorkerSolver, read_answers, start_writer
from fg_nav.online.buffer import SampleBuffer
from fg_nav.online.feet_solving import FootSolver, WalksAlone
from fg_nav.online.options import OnlineOptions
from fg_nav.online.solving import Solver, WalkSolver
from fg_nav.system.processes import start_module

WORKER = "fg_nav.online.feet_worker"  # The module that the other process runs.


class FeetSolvers:
    """The solvers of both feet.

    Attributes
    ----------
    walks : of both, as they were solved in this process.
    here : those that solve in this process, by side.

    Parameters
    ----------
    remark : given a sentence where the other process dies.
    beside : whether there is one.
    """

    def __init__(
        self,
        options: Mapping[Side, OnlineOptions],
        stance: StanceParameters,
        remark: Callable[[str], None],
        beside: bool,
    ) -> None:
        self._given = {side: (options[side], stance) for side in SIDES}
        self._remark, self.walks = remark, WalksAlone()
        self.here: dict[Side, FootSolver] = {}
        self._process = FeetProcess() if beside else None

    def open(self, side: Side, buffer: SampleBuffer) -> Solver:
        """Return the solver of a foot, of its samples."""
        here = self.here[side] = FootSolver(side, self.walks, *self._given[side], buffer)
        if self._process is None:
            return here
        return _FootBeside(side, self._process, here, *self._given[side], buffer, self._remark)

    def part(self) -> None:
        """Leave each foot alone from here on: their clocks are not one any more."""
        self.walks.part()
        if self._process is not None:
            self._process.messages.put((SIDES[0], "part"))

    def close(self) -> None:
        """End the other process."""
        if self._process is not None:
            self._process.close()


class FeetProcess:
    """The other process, with answers for each foot in a queue of its own."""

    def __init__(self) -> None:
        self.process = start_module(WORKER)
        self.messages = start_writer(self.process)
        self.answers: dict[Side, queue.SimpleQueue[Any]] = {side: queue.SimpleQueue() for side in SIDES}
        threading.Thread(target=read_answers, args=(self.process, self._take), daemon=True).start()

    def close(self) -> None:
        """End it."""
        self.messages.put(None)
        self.process.kill()
        self.process.wait()

    def _take(self, answer: Any) -> None:
        """Put an answer where it belongs, and the end of all where both see it."""
        side, content = (None, answer) if isinstance(answer, EOFError) else answer
        for one in SIDES if side is None else (side,):
            self.answers[one].put(content)


class _Tagged:
    """Messages of one foot."""

    def __init__(self, side: Side, messages: queue.SimpleQueue[Any]) -> None:
        self._side, self._messages = side, messages

    def put(self, item: Any) -> None:
        """Take one."""
        self._messages.put((self._side, *item))


class _FootBeside(WorkerSolver):
    """Solves the walk of one foot in the process of both, which whoever holds that ends."""

    def __init__(
        self,
        side: Side,
        process: FeetProcess,
        here: FootSolver,
        options: OnlineOptions,
        stance: StanceParameters,
        buffer: SampleBuffer,
        remark: Callable[[str], None],
    ) -> None:
        link = Link(process.process, _Tagged(side, process.messages), process.answers[side])
        super().__init__(options, stance, buffer, remark, here, link)

    def close(self) -> WalkSolver:
        """Return who solves here."""
        return self._here
