"""Background re-solve of a walk in a worker process, which is sent the walk's samples as they come.

    WorkerSolver  --- samples, tasks, footfalls --->  `python -m fg_nav.online.worker`
                  <-------- anchor states ----------

A message is (key, kind, *content), an answer (key, anchor state or None), pickled over pipes between our own two
processes; the key is the side of a foot, "" of one foot alone. A thread writes, so that sending never blocks. An answer
is what `WalkSolver` returns, to the bit. Where the process dies (memory, a signal) or has not answered for `MAX_S` (it
was stopped), the `WalkSolver` of this process takes its place, on the samples the owner has.
"""

from __future__ import annotations

import pickle
import queue
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from typing import Any, TypeAlias

from fg_nav.detection.stance import StanceParameters
from fg_nav.online.anchor import AnchorState
from fg_nav.online.buffer import ReportedFootfall, SampleBuffer
from fg_nav.online.options import OnlineOptions
from fg_nav.online.solving import Task, WalkSolver
from fg_nav.system.processes import start_module

WORKER = "fg_nav.online.worker"  # The module that the other process runs.
MAX_S = 120.0  # For an answer: twenty times what a solution takes on two cores.


class WorkerProcess:
    """The worker process: messages to it, and its answers in a queue a key; an EOFError where there are no more."""

    def __init__(self, keys: Iterable[str] = ("",)) -> None:
        self.process = start_module(WORKER)
        self.messages = queue.SimpleQueue[Any]()
        self.answers = {key: queue.SimpleQueue[Any]() for key in keys}
        for work in (self._write, self._read):
            threading.Thread(target=work, daemon=True).start()

    def close(self) -> None:
        """Kill the process."""
        self.messages.put(None)
        with suppress(OSError):
            self.process.kill()
        self.process.wait()

    def _write(self) -> None:
        pipe = self.process.stdin
        assert pipe is not None
        with suppress(OSError, ValueError):
            while (message := self.messages.get()) is not None:
                pickle.dump(message, pipe, protocol=pickle.HIGHEST_PROTOCOL)
                pipe.flush()

    def _read(self) -> None:
        assert self.process.stdout is not None
        with suppress(EOFError, OSError, ValueError, pickle.UnpicklingError):
            while True:
                key, answer = pickle.load(self.process.stdout)
                self.answers[key].put(answer)
        for answers in self.answers.values():
            answers.put(EOFError())


class WorkerSolver:
    """Solves in a worker process; attributes and methods as of `WalkSolver`.

    Parameters
    ----------
    buffer : of the walk's samples.
    remark : given a sentence where the worker process dies.
    here : solves in this process where that has died; None for the walk of one foot.
    worker : the process, closed by its owner; None to start one.
    key : of this walk.
    """

    def __init__(
        self,
        options: OnlineOptions,
        stance: StanceParameters,
        buffer: SampleBuffer,
        remark: Callable[[str], None] = lambda words: None,
        here: WalkSolver | None = None,
        worker: WorkerProcess | None = None,
        key: str = "",
    ) -> None:
        self.is_here = False
        self._here, self._buffer = WalkSolver(options, stance, buffer) if here is None else here, buffer
        self._remark, self._sent = remark, 0
        self._requested_s = time.monotonic()
        self._answer: tuple[AnchorState | None] | None = None
        self._outstanding = 0
        self._is_owner, self._key = worker is None, key
        self._worker = WorkerProcess() if worker is None else worker
        self._answers = self._worker.answers[key]
        self._send("options", options, stance)

    @property
    def pid(self) -> int:
        """Process id of the worker."""
        return self._worker.process.pid

    def follow(self, until: int) -> None:
        """As of `WalkSolver`."""
        if until > self._sent and not self.is_here:
            self._send("samples", self._buffer.between(self._sent, until))
            self._sent = until

    def discard(self, before: int) -> None:
        """As of `WalkSolver`."""
        self._send("discard" if before <= self._sent else "skip", before)
        self._sent = max(self._sent, before)

    def begin(self, task: Task) -> None:
        """As of `WalkSolver`."""
        self._here.begin(task)
        self._outstanding = 0
        self._send("begin", task)

    def request(self, footfalls: Sequence[ReportedFootfall]) -> None:
        """As of `WalkSolver`."""
        self._requested_s = time.monotonic()
        self._here.request(footfalls)
        self._outstanding += 1
        self._send("request", tuple(footfalls))

    def is_ready(self) -> bool:
        """As of `WalkSolver`."""
        is_given_up = self._worker.process.poll() is not None or self._left_s <= 0.0
        return self._answer is not None or is_given_up or self._answers.qsize() >= self._outstanding > 0

    def wait(self) -> None:
        """As of `WalkSolver`."""
        if self._answer is not None:
            return
        answer: object = EOFError() if self.is_here else None
        # Of several requests the last answer counts.
        while self._outstanding and not isinstance(answer, EOFError | TimeoutError):
            try:
                answer = self._answers.get(timeout=max(self._left_s, 0.0))
            except queue.Empty:
                answer = TimeoutError()
            self._outstanding -= 1
        # Without an answer this process solves the walk, from here on.
        if isinstance(answer, EOFError | TimeoutError):
            if not self.is_here:
                why = "has died" if isinstance(answer, EOFError) else f"has not answered for {MAX_S:.0f} s"
                self._remark(f"the process that solves the walk again {why}: its work is done in between from here on.")
                self._worker.process.kill()
            self.is_here = True
            answer = self._here.take()
        assert answer is None or isinstance(answer, AnchorState)
        self._answer = (answer,)

    def take(self) -> AnchorState | None:
        """As of `WalkSolver`."""
        self.wait()
        assert self._answer is not None
        answer, self._answer = self._answer[0], None
        return answer

    def close(self) -> WalkSolver:
        """As of `WalkSolver`."""
        if self._is_owner:
            self._worker.close()
        return self._here

    @property
    def _left_s(self) -> float:
        """Seconds left until the answer is overdue."""
        return self._requested_s + MAX_S - time.monotonic()

    def _send(self, kind: str, *content: Any) -> None:
        """Send a message, unless nobody reads it any more."""
        if not self.is_here:
            self._worker.messages.put((self._key, kind, *content))


Solver: TypeAlias = WalkSolver | WorkerSolver
