"""What hours of walking cost `fg-nav run`: time, and memory at its highest.

    python scripts/long_walks.py [--hours H [H ...]] [--rate HZ] [--no-field] [--seed N] [--json FILE]

A simulated walk with a magnetometer, repeated (`walks.RepeatedWalk`), is written as canonical CSV, and the command runs
on it, a process of its own, with its trajectory, its page and all other files.

=========== ========================================================================================================
memory      of the process at its highest, MB
processor   time of the processor, s, and microseconds a sample
doubling    that time over the one of half the walk, where both are measured
=========== ========================================================================================================
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter, sleep

import harness
import numpy as np
from harness import FIRST_SEED, Figure, option
from online_limits import read_peak_mb
from walks import RepeatedWalk, simulate_long_walk

from fg_nav.columns.mapping import CANONICAL
from fg_nav.io.writing import format_rows

MINUTES = 60.0  # Of the walk that is repeated.

BLOCK_ROWS = 100_000

DOUBLING_RATIO = 2.2  # What is asked.


@dataclass(frozen=True)
class Cost:
    """What a run cost."""

    hours: float
    samples: int
    wall_s: float
    processor_s: float
    peak_mb: float


def write_walk(walk: RepeatedWalk, hours: float, path: Path) -> int:
    """Write so many hours of a walk, block by block; return how many samples they are."""
    recording = walk.recording
    samples, period_s = np.column_stack([recording.acc, recording.gyr, recording.mag]), recording.period_s
    count = round(3600.0 * hours / period_s)
    with path.open("w") as file:
        file.write(",".join(CANONICAL) + "\n")
        for start in range(0, count, BLOCK_ROWS):
            index = np.arange(start, min(start + BLOCK_ROWS, count))
            rows = np.column_stack([index * period_s, samples[walk.number(index)]])
            file.writelines(format_rows(rows, "%.9g", ","))
    return count


def run_walk(path: Path, hours: float, samples: int, options: Sequence[str]) -> Cost:
    """Run the command on a file; raise `CalledProcessError` where it fails."""
    words = [sys.executable, "-m", "fg_nav.cli", "run", str(path), "--out", str(path.with_suffix("")), *options]
    began, before = perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    peak_mb = float("nan")
    while process.poll() is None:
        peak_mb = read_peak_mb(process.pid, peak_mb)
        sleep(0.02)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, words)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    processor_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Cost(hours, samples, perf_counter() - began, processor_s, peak_mb)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the figures of the script."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        hours=option([1.0, 2.0], "of walking", type=float, nargs="+", metavar="H"),
        rate=option(200.0, "of the samples", metavar="HZ"),
        no_field=option(False, "without the magnetometer"),
        seed=FIRST_SEED,
        json=None,
    )
    walk = RepeatedWalk.of(simulate_long_walk(MINUTES, chosen.seed, chosen.rate, "indoor"))
    options, mode = (["--no-mag"], "without field") if chosen.no_field else ([], "with field")
    costs: list[Cost] = []
    for hours in sorted(chosen.hours):
        with tempfile.TemporaryDirectory() as name:
            path = Path(name) / "walk.csv"
            costs.append(run_walk(path, hours, write_walk(walk, hours, path), options))
        cost = costs[-1]
        print(
            f"{mode}, {hours:g} h, {cost.samples} samples: {cost.wall_s:.0f} s, processor {cost.processor_s:.0f} s "
            f"({1e6 * cost.processor_s / cost.samples:.1f} us a sample), {cost.peak_mb:.0f} MB",
            flush=True,
        )
    harness.print_figures(figures := judge_costs(mode, costs))
    harness.print_verdict(figures, chosen.json, costs=[vars(cost) for cost in costs])


def judge_costs(mode: str, costs: Sequence[Cost]) -> list[Figure]:
    """Return the figures of the walks."""
    processor_s = {cost.hours: cost.processor_s for cost in costs}
    figures = []
    for cost in costs:
        name = f"{cost.hours:g} h"
        figures.append(Figure(name, f"memory, {name} (MB)", mode, cost.peak_mb, pattern="{:.0f}"))
        figures.append(Figure(name, f"processor, {name} (s)", mode, cost.processor_s, pattern="{:.0f}"))
        if cost.hours / 2.0 in processor_s:
            doubling = cost.processor_s / processor_s[cost.hours / 2.0]
            figures.append(Figure(name, f"doubling to {name}", mode, doubling, high=DOUBLING_RATIO))
    return figures


if __name__ == "__main__":
    harness.run(main)
