"""What a footfall costs online, however long the walk.

    python scripts/bench/online.py [--minutes N] [--lag SECONDS] [--rate HZ] [--json FILE]

`OnlineNavigator.push` for hours round a corridor with a magnetometer, a tenth of a second at a time, solved again in a
process beside it: from the push that completes a footfall to its line. A row each thousand lines: p50, p99 and longest,
ms, and memory of both processes, MB. The walk is pushed faster than it was walked, so where it waits for the other
process, the time that this would have had is not counted.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter, sleep

import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[1]))

import harness
from harness import Figure, option
from stress import read_memory_mb
from walks import simulate_long_walk

from fg_nav.arrays import Floats
from fg_nav.errors import SimulationError
from fg_nav.online import OnlineNavigator
from fg_nav.online.buffer import OnlineOptions
from fg_nav.online.estimates import StanceEstimate
from fg_nav.online.resolve import Solver, SolverProcess, Task, WalkSolver
from fg_nav.online.window import AnchorState
from fg_nav.recording import Recording

SEED, BLOCK_S = 1, 0.1  # samples that come at once
EVERY, EARLY = 1000, slice(500, 1500)
P50_MS, P99_MS, MAX_MS, LAG_RATIO, GROWTH = 10.0, 60.0, 250.0, 1.3, 1.05
"""What is asked: p50, p99 and longest of all lines; with a lag the ratio of p99 of the last thousand to that of lines
500 to 1500, and of the memory at the end to that at half of the walk."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print, and write what was asked for."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        minutes=option(20.0, "of walking", metavar="N"),
        lag=option(None, "fixed lag (none: the whole walk)", type=float, metavar="SECONDS"),
        rate=option(100.0, "of the samples", metavar="HZ"),
        json=None,
    )
    recording = simulate_long_walk(chosen.minutes, SEED, chosen.rate, "indoor")
    ms, mb = push_walk(recording, OnlineOptions(heading_rad=0.0, lag_s=chosen.lag))
    if len(ms) <= EARLY.start:
        raise SimulationError(f"{len(ms)} footfalls are too few for a trend: ask for 12 minutes or more.")
    mode = "the whole walk" if chosen.lag is None else f"a lag of {chosen.lag:g} s"
    harness.print_heading(f"{chosen.minutes:g} minutes, {len(ms)} footfalls, {mode}")
    rows = []
    for start in range(0, len(ms), EVERY):
        part = ms[start : start + EVERY]
        cells = [*(f"{np.percentile(part, q):.1f}" for q in (50, 99, 100)), f"{mb[start + len(part) - 1]:.0f}"]
        rows.append([f"{start} to {start + len(part)}", *cells])
    harness.print_table(("lines", "p50, ms", "p99, ms", "longest, ms", "memory, MB"), rows)
    figures = judge_footfalls(mode, ms, mb, math.inf if chosen.lag is None else 1.0)
    harness.print_figures(figures)
    harness.print_verdict(figures, chosen.json)


def push_walk(recording: Recording, options: OnlineOptions) -> tuple[Floats, Floats]:
    """Time (K,) of each push that returns a line, ms, and memory (K,) after it, MB."""
    navigator, milliseconds, megabytes = OnlineNavigator(options), [], []
    solver = PacedSolver(navigator)
    block = max(1, round(BLOCK_S / recording.period_s))
    for start in range(0, len(recording), block):
        part, idle_s = np.s_[start : start + block], solver.idle_s
        mag = None if recording.mag is None else recording.mag[part]
        began = perf_counter()
        lines = navigator.push(recording.t[part], recording.acc[part], recording.gyr[part], mag)
        elapsed_s = perf_counter() - began - (solver.idle_s - idle_s)
        if any(isinstance(line, StanceEstimate) for line in lines):
            milliseconds.append(1e3 * elapsed_s)
            megabytes.append(read_memory_mb("self") + read_memory_mb(solver.process.pid or 0))
    solver.close()
    return np.array(milliseconds), np.array(megabytes)


class PacedSolver(Solver):
    """Is given the time that it would have had; `idle_s` is how long it was waited for within that."""

    def __init__(self, navigator: OnlineNavigator) -> None:
        options, self._buffer = navigator.options, navigator.buffer
        self.process = SolverProcess({None: options})
        super().__init__(WalkSolver(options, self._buffer), self.process)
        self.idle_s, self._begun = 0.0, (0.0, 0.0)
        navigator._solver = navigator.smoother.solver = self

    def begin(self, task: Task) -> None:
        """As it does, and note when."""
        self._begun = perf_counter(), self._buffer.newest_s
        super().begin(task)

    def take(self) -> AnchorState | None:
        """As it does, after as long as the walk took since the task."""
        began = perf_counter()
        due = self._begun[0] + self._buffer.newest_s - self._begun[1]
        while not self.is_ready() and perf_counter() < due:
            sleep(0.001)
        self.idle_s += perf_counter() - began
        return super().take()


def judge_footfalls(mode: str, milliseconds: Floats, megabytes: Floats, lagged: float) -> list[Figure]:
    """Compare the lines of a walk with what is asked; `lagged` is infinite where the whole walk is kept."""
    p50, p99, longest = np.percentile(milliseconds, [50, 99, 100])
    late, early = (float(np.percentile(part, 99)) for part in (milliseconds[-EVERY:], milliseconds[EARLY]))
    growth, ratio = float(megabytes[-1] / megabytes[len(megabytes) // 2]), late / early
    return [
        Figure(mode, "p50 (ms)", "online", float(p50), high=P50_MS),
        Figure(mode, "p99 (ms)", "online", float(p99), high=P99_MS),
        Figure(mode, "longest (ms)", "online", float(longest), high=MAX_MS),
        Figure(mode, "p99 of the last thousand over that of 500 to 1500", "online", ratio, high=LAG_RATIO * lagged),
        Figure(mode, "memory at the end over that at half", "online", growth, high=GROWTH * lagged),
    ]


if __name__ == "__main__":
    harness.run(main)
