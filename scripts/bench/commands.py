"""What commands cost, each a process of its own: processor time, time on the wall, memory at its highest.

    python scripts/bench/commands.py start [--repeats N]
    python scripts/bench/commands.py hours [--hours H [H ...]] [--rate HZ] [--no-field]
    python scripts/bench/commands.py simulate

start      `fg-nav --help`, the first `fg-nav run` after installing (nothing is compiled, matplotlib has not listed its
           fonts), and the same again, on the minute of walking of the scenario `demo`; of the repeats the least
hours      `fg-nav run` on hours of a simulated walk with a magnetometer, all files written; and the processor time over
           that of half the walk, where both are measured
simulate   `fg-nav simulate mall`, half an hour at 400 Hz with eight units averaged, and an hour by a scenario file
"""

from __future__ import annotations

import os
import sys
import tempfile
from argparse import Namespace
from collections.abc import Mapping, Sequence
from pathlib import Path
from subprocess import DEVNULL, Popen
from time import perf_counter

import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[1]))

import harness
from harness import FIRST_SEED, Figure, option
from stress import HEADER, Rows

from fg_nav.errors import SimulationError
from fg_nav.io import write_canonical
from fg_nav.lab.simulation import simulate

HELP_S, FIRST_S, WARM_S, MALL_S, HOUR_MB, DOUBLING = 0.3, 15.0, 3.0, 20.0, 2000.0, 2.2  # what is asked
BLOCK = 100_000  # rows written at once
HOUR = 'like = "mall"\ncourse = {points_m = [[0, 0], [0, 60], [110, 60], [110, 0], [0, 0]], laps = 15}\n'  # 5 km


def run_command(*words: str, variables: Mapping[str, str] | None = None) -> tuple[float, float, float]:
    """Run `fg-nav` with these words; its processor time, time on the wall, s, and memory at its highest, MB."""
    began = perf_counter()
    process = Popen(
        [sys.executable, "-m", "fg_nav.cli", *words],
        stdout=DEVNULL,
        stderr=DEVNULL,
        env={**os.environ, **(variables or {})},
    )
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SimulationError(f"`fg-nav {' '.join(words)}` failed: run it by hand.")
    return used.ru_utime + used.ru_stime, perf_counter() - began, used.ru_maxrss / 1024


def measure_start(chosen: Namespace, folder: Path) -> list[Figure]:
    """Cost of help, of a first run and of one after it, with folders of each repeat for what is kept between runs."""
    write_canonical(simulate("demo", 1).recording, folder / "walk.csv")
    spent = []
    for k in range(chosen.repeats):
        kept = {"NUMBA_CACHE_DIR": str(folder / f"numba{k}"), "MPLCONFIGDIR": str(folder / f"fonts{k}")}
        run = ("run", str(folder / "walk.csv"), "--force", "--out", str(folder / "out"))
        spent.append([run_command(*words, variables=kept) for words in (("--help",), run, run)])
    least = np.min(spent, axis=0)
    asked = {"help": HELP_S, "first run": FIRST_S, "warm run": WARM_S}
    figures = []
    for (name, high), (cpu, wall, _) in zip(asked.items(), least, strict=True):
        figures.append(Figure("start", f"{name}, processor (s)", "fg-nav", float(cpu), high=high, pattern="{:.2f}"))
        figures.append(Figure("start", f"{name}, wall (s)", "fg-nav", float(wall), pattern="{:.2f}"))
    return figures


def measure_hours(chosen: Namespace, folder: Path) -> list[Figure]:
    """Cost of `fg-nav run` on walks of these hours."""
    rows, figures, before = Rows.simulate(chosen.seed, chosen.rate), [], dict[float, float]()
    mode, options = ("without field", ["--no-mag"]) if chosen.no_field else ("with field", [])
    for hours in sorted(chosen.hours):
        count, path = round(3600.0 * hours / rows.period_s), folder / "walk.csv"
        with path.open("wb") as file:
            file.write(HEADER)
            file.writelines(rows.format(k, min(k + BLOCK, count)) for k in range(0, count, BLOCK))
        cpu, wall, mb = run_command("run", str(path), "--force", "--out", str(folder / "out"), *options)
        before[hours] = cpu
        found = {"processor (s)": cpu, "wall (s)": wall, "us a sample": 1e6 * cpu / count, "memory (MB)": mb}
        figures += [Figure("hours", f"{hours:g} h, {name}", mode, x, pattern="{:.1f}") for name, x in found.items()]
        if hours / 2.0 in before:
            growth = cpu / before[hours / 2.0]
            figures.append(Figure("hours", f"doubling to {hours:g} h", mode, growth, high=DOUBLING))
    return figures


def measure_simulator(chosen: Namespace, folder: Path) -> list[Figure]:
    """Cost of `fg-nav simulate`, its files included, after a short simulation that compiles."""
    (folder / "hour.toml").write_text(HOUR)
    _, mall, hour = (
        run_command("simulate", name, "--seed", "1", "--out", str(folder / f"out{k}"))
        for k, name in enumerate(("demo", "mall", str(folder / "hour.toml")))
    )
    return [
        Figure("simulate", "mall, wall (s)", "fg-nav", mall[1], high=MALL_S, pattern="{:.1f}"),
        Figure("simulate", "mall, memory (MB)", "fg-nav", mall[2], pattern="{:.0f}"),
        Figure("simulate", "one hour, wall (s)", "fg-nav", hour[1], pattern="{:.1f}"),
        Figure("simulate", "one hour, memory (MB)", "fg-nav", hour[2], high=HOUR_MB, pattern="{:.0f}"),
    ]


MEASURES = {"start": measure_start, "hours": measure_hours, "simulate": measure_simulator}


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print, and write what was asked for."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        what=option("start", "which commands", choices=list(MEASURES), positional=True),
        hours=option([1.0, 2.0], "of walking", type=float, nargs="+", metavar="H"),
        rate=option(200.0, "of the samples", metavar="HZ"),
        no_field=option(False, "without the magnetometer"),
        seed=FIRST_SEED,
        repeats=3,
        json=None,
    )
    with tempfile.TemporaryDirectory() as folder:
        figures = MEASURES[chosen.what](chosen, Path(folder))
    harness.print_figures(figures)
    harness.print_verdict(figures, chosen.json)


if __name__ == "__main__":
    harness.run(main)
