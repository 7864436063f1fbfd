"""Kill a streamed walk again and again: no line is lost or given twice, and it ends as one that was not killed.

    python scripts/online_kills.py [--kills N] [--speed N] [--minutes N] [--lag SECONDS] [--load N] [--seed N]
                                   [--json FILE]

A simulated walk with a magnetometer is streamed from its file, `fg-nav stream FILE --speed N`, once as it is, and once
with `--record FILE --resume`, killed (SIGKILL) at random instants of its way and begun again with the same command.
This is done for all of the walk and with a lag. With `--load` so many processes beside it keep a core busy each.

======== =========================================================================================================
missing  footfalls of the uninterrupted walk without a line that stands, by their stamps
twice    lines with a number that another has
end      largest difference of the smoothed positions from those of the uninterrupted walk, in their sigmas
======== =========================================================================================================
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from time import perf_counter
from typing import Any

import harness
import numpy as np
from harness import FIRST_SEED, Figure, option
from walks import simulate_long_walk

from fg_nav.errors import SimulationError
from fg_nav.io import write_canonical

RATE_HZ = 100.0

MAX_DIFFERENCE = 0.1  # Sigmas, at the end.
SAME_S = 1e-6

Line = dict[str, Any]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the figures of the script."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        kills=option(20, "how often it is killed", metavar="N"),
        speed=option(8.0, "times as fast as it was walked", metavar="N"),
        minutes=option(1.0, "of walking", metavar="N"),
        lag=option(15.0, "fixed lag of the second mode", metavar="SECONDS"),
        load=option(0, "processes beside it that keep a core busy", metavar="N"),
        seed=FIRST_SEED,
        json=None,
    )
    figures: list[Figure] = []
    with tempfile.TemporaryDirectory() as name, keep_busy(chosen.load):
        folder = Path(name)
        write_canonical(simulate_long_walk(chosen.minutes, chosen.seed, RATE_HZ, "indoor"), folder / "walk.csv")
        for mode, more in (("the whole walk", ()), (f"a lag of {chosen.lag:g} s", ("--lag", str(chosen.lag)))):
            command = stream_command(folder / "walk.csv", chosen.speed, more)
            rng = np.random.default_rng(chosen.seed)
            found = measure_kills(command, folder / f"{len(more)}.csv", chosen.kills, mode, rng)
            harness.print_heading(f"{mode}, speed {chosen.speed:g}, {chosen.load} busy beside")
            harness.print_figures(found)
            figures += found
    harness.print_verdict(figures, chosen.json)


def stream_command(path: Path, speed: float, more: Sequence[str]) -> list[str]:
    """Return the command that streams a file."""
    return [sys.executable, "-m", "fg_nav.cli", "stream", str(path), "--speed", f"{speed:g}", "--silence", "1", *more]


def measure_kills(
    command: Sequence[str], record: Path, kills: int, mode: str, rng: np.random.Generator
) -> list[Figure]:
    """Return the figures of a walk that is killed so often."""
    began = perf_counter()
    whole = list(read_lines(run_for(command, math.inf)[0]))
    if not whole:
        raise SimulationError("the walk told no line: ask for more minutes.")
    took_s, told = perf_counter() - began, []
    saved = [*command, "--record", str(record), "--resume"]
    killed, ended = 0, False
    while killed < kills or not ended:
        if ended:
            record.unlink(missing_ok=True)  # it was not killed in time: another walk
            told = []
        text, ended = run_for(saved, took_s * rng.uniform(0.2, 0.95) if killed < kills else math.inf)
        killed += not ended
        told += list(read_lines(text))
    missing, twice, difference = compare_lines(whole, told)
    return [
        Figure(mode, "kills", "stream", float(killed), low=float(kills), pattern="{:.0f}"),
        Figure(mode, "lines missing", "stream", float(missing), high=0.0, pattern="{:.0f}"),
        Figure(mode, "lines twice", "stream", float(twice), high=0.0, pattern="{:.0f}"),
        Figure(mode, "end, sigmas", "stream", difference, high=MAX_DIFFERENCE, pattern="{:.3f}"),
    ]


def run_for(command: Sequence[str], seconds: float) -> tuple[str, bool]:
    """Run a command, killed after so many seconds; what it printed, and whether it ended by itself."""
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        return process.communicate(timeout=seconds if math.isfinite(seconds) else None)[0], True
    except subprocess.TimeoutExpired:
        process.kill()
        return process.communicate()[0], False


def read_lines(text: str) -> Iterator[Line]:
    """Yield the lines, without one that the kill cut off."""
    for words in text.splitlines():
        with suppress(ValueError):
            yield json.loads(words)


def compare_lines(whole: Iterable[Line], told: Iterable[Line]) -> tuple[int, int, float]:
    """Return how many footfalls of a walk have no line, how many lines came twice, and the difference at the end."""
    whole, told = list(whole), list(told)
    stamps = [list_standing(lines) for lines in (whole, told)]
    missing = sum(not any(abs(t - other) < SAME_S for other in stamps[1]) for t in stamps[0])
    numbers = [line["stance"] for line in told if line["kind"] == "now"]
    ends = [[line for line in lines if line["kind"] == "smoothed"] for lines in (whole, told)]
    if len(ends[0]) != len(ends[1]):
        return missing, len(numbers) - len(set(numbers)), math.inf
    known = {key: np.array([line[key] for line in ends[0]]) for key in ("position_m", "position_sigma_m")}
    off = np.abs(np.array([line["position_m"] for line in ends[1]]) - known["position_m"])
    difference = float((off / np.maximum(known["position_sigma_m"], 1e-3)).max())
    return missing, len(numbers) - len(set(numbers)), difference


def list_standing(lines: Iterable[Line]) -> list[float]:
    """Stamps of the lines of the moment that were not taken back."""
    known = list(lines)
    gone = {line["stance"] for line in known if line["kind"] == "retracted"}
    return [line["t"] for line in known if line["kind"] == "now" and line["stance"] not in gone]


@contextmanager
def keep_busy(count: int) -> Iterator[None]:
    """Have so many processes that keep a core busy each."""
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for process in busy:
            process.kill()
            process.wait()


if __name__ == "__main__":
    harness.run(main)
