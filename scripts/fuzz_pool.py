"""Workers that run cases, of which any may die or hang: then the case is named, and another worker goes on.

    Pool --- case --->  worker process  --- fate --->  Pool

A worker has one case at a time, so that the one it was at is known. It compiles once, and lives until it is no longer
needed, dies, or takes longer than allowed for a case.
"""

from __future__ import annotations

import faulthandler
import signal
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Generic, TypeVar

C, F = TypeVar("C"), TypeVar("F")

FIRST_S = 120.0  # For its first case a worker may take longer: it loads and compiles.


@dataclass
class _Worker(Generic[C]):
    process: BaseProcess
    pipe: Connection
    log: Path
    case: C | None = None
    due: float = 0.0
    is_new: bool = True


class Pool(Generic[C, F]):
    """Runs cases on processes.

    Parameters
    ----------
    run : called in a worker, with a case; returns its fate.
    died : makes the fate of a case whose worker died or hung, from the case and words.
    jobs, limit_s : how many processes; the longest time for a case.
    folder : for what workers print as they die.
    """

    def __init__(
        self, run: Callable[[C], F], died: Callable[[C, str], F], jobs: int, limit_s: float, folder: Path
    ) -> None:
        self._run, self._died, self._jobs, self._limit_s, self._folder = run, died, jobs, limit_s, folder
        self._workers: list[_Worker[C]] = []
        self._begun = 0

    def map(self, cases: Iterable[C]) -> Iterator[F]:
        """Yield the fates of cases as they come."""
        waiting = iter(cases)
        try:
            for _ in range(self._jobs):
                self._give(self._begin(), waiting)
            while busy := [worker for worker in self._workers if worker.case is not None]:
                yield from self._collect(busy, waiting)
        finally:
            for worker in self._workers:
                worker.process.kill()

    def _collect(self, busy: list[_Worker[C]], waiting: Iterator[C]) -> Iterator[F]:
        """Take what has come, and what will not come any more."""
        next_s = min(worker.due for worker in busy) - time.monotonic()
        ready = wait([worker.pipe for worker in busy], timeout=max(0.0, next_s))
        for worker in busy:
            case = worker.case
            assert case is not None
            if worker.pipe in ready:
                try:
                    fate = worker.pipe.recv()
                    worker.is_new = False
                except (EOFError, OSError):
                    fate = self._died(case, f"crash: {self._bury(worker)}")
                    worker = self._begin()
                yield fate
                self._give(worker, waiting)
            elif time.monotonic() > worker.due:
                worker.process.kill()
                self._bury(worker)
                yield self._died(case, f"hang: more than {self._limit_s:g} s")
                self._give(self._begin(), waiting)

    def _begin(self) -> _Worker[C]:
        context = get_context("spawn")
        ours, theirs = context.Pipe()
        self._begun += 1
        log = self._folder / f"worker-{self._begun}.log"
        process = context.Process(target=_work, args=(theirs, self._run, log), daemon=True)
        process.start()
        theirs.close()
        self._workers.append(worker := _Worker(process, ours, log))
        return worker

    def _give(self, worker: _Worker[C], waiting: Iterator[C]) -> None:
        worker.case = next(waiting, None)
        worker.due = time.monotonic() + self._limit_s + (FIRST_S if worker.is_new else 0.0)
        if worker.case is not None:
            worker.pipe.send(worker.case)

    def _bury(self, worker: _Worker[C]) -> str:
        """End a worker; in words of what it died."""
        self._workers.remove(worker)
        worker.process.join(5.0)
        code = worker.process.exitcode
        worker.process.kill()
        worker.process.join()
        lines = worker.log.read_text(errors="replace").splitlines() if worker.log.exists() else []
        frames = [line.strip() for line in lines if "/fg_nav/" in line]
        reason = signal.Signals(-code).name if code is not None and code < 0 else f"exit code {code}"
        return " at ".join([reason, *frames[:1]])


def _work(pipe: Connection, run: Callable[[C], F], log: Path) -> None:
    """Run what comes, until nothing comes any more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the pool ends its workers
    with log.open("w") as file:
        faulthandler.enable(file)
        while True:
            try:
                pipe.send(run(pipe.recv()))
            except (EOFError, BrokenPipeError):
                return
