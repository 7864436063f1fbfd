"""Background re-solve of a walk, or of those of two feet, in another process (`concurrent.futures`).

    begin, request    a task, or the footfalls since, with the samples up to there    -> submitted
    is_ready, take    its result                                                      -> AnchorState

The process holds samples and newest task of each walk, by the side of the foot, None of one foot alone. A result is
what `WalkSolver` returns, to the bit. Where the process cannot start, dies (memory, a signal), fails or has not
answered for `MAX_S` (it was stopped), the `WalkSolver` of this process takes its place, on the samples the owner has.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from typing import TypeAlias, TypeVar

from fg_nav.arrays import Floats
from fg_nav.detection.stance import StanceParameters
from fg_nav.feet import Side
from fg_nav.online.anchor import AnchorState
from fg_nav.online.buffer import OnlineOptions, ReportedFootfall, SampleBuffer
from fg_nav.online.resolve import FootSolver, Pace, Task, WalksAlone, WalkSolver
from fg_nav.system.processes import Worker

MAX_S = 120.0  # For a result: twenty times what a solution takes on two cores.
NICENESS = 5  # The process that reports the walk comes first.

T = TypeVar("T")


class SolverProcess:
    """The other process, which starts with the first call; `options` by side of the foot, None of one foot alone."""

    def __init__(self, options: Mapping[Side | None, OnlineOptions], stance: StanceParameters) -> None:
        self._worker, self.pace, self.is_closed = Worker(_set_up, options, stance), Pace(), False

    @property
    def pid(self) -> int | None:
        """Process id; None before it starts."""
        return self._worker.pid

    def submit(self, function: Callable[..., T], *arguments: object) -> Future[T]:
        """Call a function there; raises `BrokenProcessPool` where it has died or was closed."""
        if self.is_closed:
            raise BrokenProcessPool
        return self._worker.submit(function, *arguments)

    def part(self) -> None:
        """Leave each of two feet alone from here on."""
        with suppress(BrokenProcessPool):
            self.submit(_part)

    def close(self) -> None:
        """Kill the process."""
        self.is_closed = True
        self._worker.kill()


class BackgroundSolver:
    """Solves in another process; attributes and methods as of `WalkSolver`.

    Parameters
    ----------
    process, side : where, and the side of the foot; None of one foot alone.
    here : solves in this process where that has died.
    remark : given a sentence then.
    """

    def __init__(
        self,
        process: SolverProcess,
        here: WalkSolver,
        remark: Callable[[str], None] = lambda words: None,
        side: Side | None = None,
    ) -> None:
        self.is_here, self.pace = False, process.pace
        self._process, self._here, self._remark, self._side = process, here, remark, side
        self._sent, self._requested_s = 0, time.monotonic()
        self._futures: list[Future[AnchorState | None]] = []  # Of the newest task, and of what followed it.

    def start(self) -> None:
        """As of `WalkSolver`: it takes some seconds until the process has loaded what it needs."""
        self._submit(_load)

    def begin(self, task: Task) -> None:
        """As of `WalkSolver`."""
        self._here.begin(task)
        self._futures.clear()
        self._sent = max(self._sent, task.since)
        self._submit(_begin, *self._cut_samples(task.footfalls), task)

    def request(self, footfalls: Sequence[ReportedFootfall]) -> None:
        """As of `WalkSolver`."""
        self._requested_s = time.monotonic()
        self._here.request(footfalls)
        self._submit(_request, *self._cut_samples(footfalls), tuple(footfalls))

    def is_ready(self) -> bool:
        """As of `WalkSolver`."""
        return all(one.done() for one in self._futures) or self._left_s <= 0.0

    def take(self) -> AnchorState | None:
        """As of `WalkSolver`."""
        found: AnchorState | None = None
        try:
            for future in self._futures:
                found = future.result(max(self._left_s, 0.0))
        except BrokenProcessPool:
            self._solve_here("has died")
        except TimeoutError:
            self._solve_here(f"has not answered for {MAX_S:.0f} s")
        except Exception as error:  # its memory may have been too small
            self._solve_here(f"has failed ({type(error).__name__})")
        return found if self._futures else self._here.take()

    def close(self) -> WalkSolver:
        """As of `WalkSolver`; that of a foot leaves the process to the other foot."""
        if self._side is None:
            self._process.close()
        return self._here

    @property
    def _left_s(self) -> float:
        """Seconds left until the result is overdue."""
        return self._requested_s + MAX_S - time.monotonic()

    def _cut_samples(self, footfalls: Sequence[ReportedFootfall]) -> tuple[int, Floats]:
        """Return the first sample that was not sent, and the samples from there up to the last of some footfalls."""
        first, stop = self._sent, footfalls[-1].until if footfalls else 0
        self._sent = max(first, stop)
        return first, self._here.buffer.between(first, self._sent)

    def _submit(self, function: Callable[..., AnchorState | None], *content: object) -> None:
        if self.is_here:
            return
        try:
            self._futures.append(self._process.submit(function, self._side, *content))
        except BrokenProcessPool:
            self._solve_here("has died")
        except Exception as error:  # the system has no process or no semaphore left, or this process may start none
            self._solve_here(f"cannot be started ({type(error).__name__})")

    def _solve_here(self, why: str) -> None:
        if not self._process.is_closed:  # Else it was reported for the other foot, or nobody waits for it any more.
            self._remark(f"the process that solves the walk again {why}: this one does its work from here on.")
        self._process.close()
        self.is_here = True
        self._futures.clear()


Solver: TypeAlias = WalkSolver | BackgroundSolver

# --- in the other process ---------------------------------------------------------------------------------------------

_solvers: dict[Side | None, WalkSolver] = {}
_walks = WalksAlone()


def _set_up(options: Mapping[Side | None, OnlineOptions], stance: StanceParameters) -> None:
    os.nice(NICENESS)
    for side, given in options.items():
        walk = given, stance, SampleBuffer()
        _solvers[side] = WalkSolver(*walk) if side is None else FootSolver(side, _walks, *walk)


def _load(side: Side | None) -> None:
    """Nothing more than to have loaded this module."""


def _begin(side: Side | None, first: int, rows: Floats, task: Task) -> None:
    """Solve a task, with samples from number `first` on that came since the last time."""
    solver = _add_samples(side, first, rows)
    solver.buffer.discard(task.since)
    solver.begin(task)
    solver.prepare()


def _request(side: Side | None, first: int, rows: Floats, footfalls: Sequence[ReportedFootfall]) -> AnchorState | None:
    """Return the anchor state at the last of these footfalls."""
    solver = _add_samples(side, first, rows)
    solver.request(footfalls)
    return solver.take()


def _add_samples(side: Side | None, first: int, rows: Floats) -> WalkSolver:
    solver = _solvers[side]
    if first > solver.buffer.stop:
        solver.buffer.skip_to(first)
    solver.buffer.append(rows)
    return solver


def _part() -> None:
    _walks.is_parted = True
