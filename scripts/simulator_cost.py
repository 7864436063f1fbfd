"""What a simulation costs: seconds and memory of `fg-nav simulate`, writing its files included.

    python scripts/simulator_cost.py

============== ================================================================================================
mall           the longest walk of the papers on a foot: half an hour at 400 Hz, eight sensors averaged
one hour       the same sensor for an hour, by a scenario file: laps of a rectangle in the indoor field
============== ================================================================================================

Each runs in a process of its own, after one short simulation that compiles. Memory is the peak of the process.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter

import figures as fig
from figures import Figure

MALL_S, HOUR_MB = 20.0, 2000.0
"""What is asked."""

HOUR = """
like = "mall"
[course]
points_m = [[0, 0], [0, 60], [110, 60], [110, 0], [0, 0]]
laps = 15
"""
"""5 km at 1.39 m/s."""


def main() -> None:
    """Run, measure, print."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "hour.toml").write_text(HOUR)
        run(folder, "demo")
        seconds, megabytes = run(folder, "mall", "--seed", "1")
        figures = [
            Figure("simulate", "mall, time, s", "wall", seconds, high=MALL_S, pattern="{:.1f}"),
            Figure("simulate", "mall, memory, MB", "peak", megabytes, pattern="{:.0f}"),
        ]
        seconds, megabytes = run(folder, str(folder / "hour.toml"))
        figures += [
            Figure("simulate", "one hour, time, s", "wall", seconds, pattern="{:.1f}"),
            Figure("simulate", "one hour, memory, MB", "peak", megabytes, high=HOUR_MB, pattern="{:.0f}"),
        ]
    fig.print_figures(figures)
    fig.print_verdict(figures)


def run(folder: Path, *arguments: str) -> tuple[float, float]:
    """Simulate into the folder; returns seconds on the wall, and the largest memory of any such run so far in MB."""
    out = folder / f"out-{len(list(folder.iterdir()))}"
    command: Sequence[str] = [sys.executable, "-m", "fg_nav.cli", "simulate", *arguments, "--out", str(out)]
    begin = perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024


if __name__ == "__main__":
    fig.leave_with(main)
