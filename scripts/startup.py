"""How long a user waits for help, for the first run after installing, and for a run after that.

    python scripts/startup.py [--repeats N] [--json FILE]

Each command is a process of its own; `run` is that of the minute of walking of the scenario `demo`, with all pictures.

=========== ==========================================================================================
help        `fg-nav --help`
first run   nothing is compiled, and matplotlib has not listed its fonts: new folders for both
warm run    the same again
=========== ==========================================================================================

Given is the time of the processor, which other work on the machine moves less than that on the wall; of the repeats the
least, which is that of an idle machine.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from time import perf_counter

import harness
from harness import Figure, Time

from fg_nav.io import write_canonical
from fg_nav.lab.simulation import simulate

HELP, FIRST, WARM = "help", "first run", "warm run"
LIMITS_S: Mapping[str, float] = {HELP: 0.3, FIRST: 15.0, WARM: 3.0}  # What is asked.

SEED = 1


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print, and write what was asked for."""
    chosen = harness.parse_arguments(__doc__, arguments, repeats=3, json=None)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_canonical(simulate("demo", SEED).recording, folder / "walk.csv")
        spent = [measure_commands(folder, repeat) for repeat in range(chosen.repeats)]
    figures = judge_times(spent)
    harness.print_figures(figures)
    harness.print_verdict(figures, chosen.json)


def measure_commands(folder: Path, repeat: int) -> dict[str, Time]:
    """Time each command once, with folders of this repeat for what is kept between runs."""
    kept = {"NUMBA_CACHE_DIR": str(folder / f"numba{repeat}"), "MPLCONFIGDIR": str(folder / f"fonts{repeat}")}
    run = ("run", str(folder / "walk.csv"), "--force", "--out", str(folder / f"out{repeat}"))
    return {HELP: time_command(kept, "--help"), FIRST: time_command(kept, *run), WARM: time_command(kept, *run)}


def time_command(variables: Mapping[str, str], *words: str) -> Time:
    """Time the command line with these words, in a process of its own."""
    command = [sys.executable, "-m", "fg_nav.cli", *words]
    began, before = perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env={**os.environ, **variables})
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Time(perf_counter() - began, cpu)


def judge_times(spent: Sequence[Mapping[str, Time]]) -> list[Figure]:
    """Compare the least time of each command with what is asked."""
    figures = []
    for name, limit in LIMITS_S.items():
        times = [repeat[name] for repeat in spent]
        cpu, wall = min(time.cpu for time in times), min(time.wall for time in times)
        figures.append(Figure("startup", f"{name}, processor (s)", "fg-nav", cpu, high=limit, pattern="{:.2f}"))
        figures.append(Figure("startup", f"{name}, wall (s)", "fg-nav", wall, pattern="{:.2f}"))
    return figures


if __name__ == "__main__":
    harness.run(main)
