"""Solving a walk beside its telling: in another process, with the walk's samples as they come.

    WorkerSolver  --- samples, tasks, footfalls --->  `python -m fg_nav.online.worker`
                  <--------- handovers -------------

Arrays and dataclasses go over pipes of our own two processes, pickled. Sending never waits: a thread writes what the
worker, busy with a task, does not read yet. What a worker answers is what `WalkSolver` does, to the bit; where it dies
(memory, a signal) or has not answered for `MAX_S` (it was stopped), that takes its place, on the samples the owner
has.
"""

from __future__ import annotations

import pickle
import queue
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from subprocess import Popen
from typing import IO, Any, NamedTuple, Protocol

from fg_nav.detection.stance import StanceParameters
from fg_nav.online.buffer import ReportedFootfall, SampleBuffer
from fg_nav.online.handover import Handover
from fg_nav.online.options import OnlineOptions
from fg_nav.online.solving import Task, WalkSolver
from fg_nav.system.processes import start_module

WORKER = "fg_nav.online.worker"  # The module that the other process runs.
MAX_S = 120.0  # For an answer: twenty times what a solution takes on two cores.


class Messages(Protocol):
    """Takes messages to the other process; None is the last."""

    def put(self, item: Any, /) -> None:
        """Take one; does not wait."""


class Link(NamedTuple):
    """The other process, messages to it, and its answers."""

    process: Popen[bytes]
    messages: Messages
    answers: queue.SimpleQueue[Any]


def start_worker(module: str) -> Link:
    """Start a module as the other process."""
    process, answers = start_module(module), queue.SimpleQueue[Any]()
    threading.Thread(target=read_answers, args=(process, answers.put), daemon=True).start()
    return Link(process, start_writer(process), answers)


def start_writer(process: Popen[bytes]) -> queue.SimpleQueue[Any]:
    """Return a queue whose messages a thread writes to a process, until one is None."""
    messages = queue.SimpleQueue[Any]()
    threading.Thread(target=_write, args=(process.stdin, messages), daemon=True).start()
    return messages


def read_answers(process: Popen[bytes], take: Callable[[Any], None]) -> None:
    """Read answers of a process; an EOFError where there are no more."""
    assert process.stdout is not None
    while True:
        try:
            take(pickle.load(process.stdout))
        except (EOFError, OSError, ValueError, pickle.UnpicklingError):
            take(EOFError())
            return


class WorkerSolver:
    """Solves in another process; attributes and methods as in `Solver`.

    Parameters
    ----------
    remark : given a sentence where the other process dies.
    buffer : of the walk's samples.
    here : solves in this process where the other one has died; None for the walk of one foot.
    link : to the other process; None to start one.
    """

    def __init__(
        self,
        options: OnlineOptions,
        stance: StanceParameters,
        buffer: SampleBuffer,
        remark: Callable[[str], None] = lambda words: None,
        here: WalkSolver | None = None,
        link: Link | None = None,
    ) -> None:
        self._here, self._buffer = WalkSolver(options, stance, buffer) if here is None else here, buffer
        self._remark, self._sent = remark, 0
        self.is_here = False
        self._asked_s = time.monotonic()
        self._answer: tuple[Handover | None] | None = None
        self._outstanding = 0
        self._worker, self._messages, self._answers = start_worker(WORKER) if link is None else link
        self._say("options", options, stance)

    @property
    def pid(self) -> int:
        """Of the other process."""
        return self._worker.pid

    def follow(self, until: int) -> None:
        """See `Solver`."""
        if until > self._sent and not self.is_here:
            self._say("samples", self._buffer.between(self._sent, until))
            self._sent = until

    def discard(self, before: int) -> None:
        """See `Solver`."""
        if before > self._sent:
            self._sent = before
            self._say("skip", before)
        else:
            self._say("discard", before)

    def begin(self, task: Task) -> None:
        """See `Solver`."""
        self._here.begin(task)
        self._outstanding = 0
        self._say("begin", task)

    def ask(self, footfalls: Sequence[ReportedFootfall]) -> None:
        """See `Solver`."""
        self._asked_s = time.monotonic()
        self._here.ask(footfalls)
        self._outstanding += 1
        self._say("ask", tuple(footfalls))

    def is_ready(self) -> bool:
        """See `Solver`."""
        is_given_up = self._worker.poll() is not None or self._left_s <= 0.0
        return self._answer is not None or is_given_up or self._answers.qsize() >= self._outstanding > 0

    def wait(self) -> None:
        """See `Solver`."""
        if self._answer is not None:
            return
        answer: object = EOFError() if self.is_here else None
        # What was asked for again has another answer: the last counts.
        while self._outstanding and not isinstance(answer, EOFError | TimeoutError):
            answer = self._wait_for_answer()
            self._outstanding -= 1
        if isinstance(answer, EOFError):
            answer = self._solve_here("has died")
        elif isinstance(answer, TimeoutError):
            answer = self._solve_here(f"has not answered for {MAX_S:.0f} s")
        assert answer is None or isinstance(answer, Handover)
        self._answer = (answer,)

    def take(self) -> Handover | None:
        """See `Solver`."""
        self.wait()
        assert self._answer is not None
        answer, self._answer = self._answer[0], None
        return answer

    @property
    def _left_s(self) -> float:
        """Of the time in which an answer is waited for."""
        return self._asked_s + MAX_S - time.monotonic()

    def _wait_for_answer(self) -> object:
        try:
            return self._answers.get(timeout=max(self._left_s, 0.0))
        except queue.Empty:
            return TimeoutError()

    def _solve_here(self, why: str) -> Handover | None:
        if not self.is_here:
            self._remark(f"the process that solves the walk again {why}: its work is done in between from here on.")
            self._worker.kill()
        self.is_here = True
        return self._here.take()

    def close(self) -> WalkSolver:
        """End the other process."""
        self._messages.put(None)
        with suppress(OSError):
            self._worker.kill()
        self._worker.wait()
        return self._here

    def _say(self, *message: Any) -> None:
        """Send a message; what nobody reads any more is not kept."""
        if not self.is_here:
            self._messages.put(message)


def _write(pipe: IO[bytes], messages: queue.SimpleQueue[Any]) -> None:
    with suppress(OSError, ValueError):
        while (message := messages.get()) is not None:
            pickle.dump(message, pipe, protocol=pickle.HIGHEST_PROTOCOL)
            pipe.flush()
