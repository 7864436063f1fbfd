"""Kill a streamed walk again and again: every line of it is told, and each is the same.

    python scripts/online_kills.py [--kills N] [--speed N] [--minutes N] [--lag SECONDS] [--load N] [--seed N]
                                   [--json FILE]

A simulated walk with a magnetometer is streamed from its file, `fg-nav stream FILE --speed N`, once as it is, and once
with `--checkpoint`, killed (SIGKILL) at random instants of its way and begun again with the same command. This is done
for all of the walk and with a lag. With `--load` so many processes beside it do nothing but keep a core busy.

=========== ======================================================================================================
missing     lines of the uninterrupted walk that no process told
different   tellings of a line, more than one where it was told, lost and told again, that differ by more than 1e-9
difference  the largest of any number in a line; infinite where a word differs
=========== ======================================================================================================
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
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

EXACT = 1e-9  # What is asked of the difference.
EVERY_S = 0.3  # Between two saves.

KINDS = ("now", "turned", "retracted", "smoothed")
"""Lines that are compared; the first of a walk that is resumed is a `revised` one, which the other does not have."""

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
            found = measure_kills(command, folder / f"{len(more)}.save", chosen.kills, mode, rng)
            harness.print_heading(f"{mode}, speed {chosen.speed:g}, {chosen.load} busy beside")
            harness.print_figures(found)
            figures += found
    harness.print_verdict(figures, chosen.json)


def stream_command(path: Path, speed: float, more: Sequence[str]) -> list[str]:
    """Return the command that streams a file."""
    return [sys.executable, "-m", "fg_nav.cli", "stream", str(path), "--speed", f"{speed:g}", "--silence", "1", *more]


def measure_kills(
    command: Sequence[str], checkpoint: Path, kills: int, mode: str, rng: np.random.Generator
) -> list[Figure]:
    """Return the figures of a walk that is killed so often."""
    began = perf_counter()
    whole = list(read_lines(run_for(command, math.inf)[0]))
    if not whole:
        raise SimulationError("the walk told no line: ask for more minutes.")
    took_s, told = perf_counter() - began, []
    saved = [*command, "--checkpoint", str(checkpoint), "--every", str(EVERY_S)]
    killed, ended = 0, False
    while killed < kills or not ended:
        if ended:
            checkpoint.unlink(missing_ok=True)  # it was not killed in time: another walk
        text, ended = run_for(saved, took_s * rng.uniform(0.2, 0.95) if killed < kills else math.inf)
        killed += not ended
        told += list(read_lines(text))
    missing, differences = compare_lines(whole, told)
    different = sum(one > EXACT for one in differences)
    return [
        Figure(mode, "kills", "stream", float(killed), low=float(kills), pattern="{:.0f}"),
        Figure(mode, "lines missing", "stream", float(missing), high=0.0, pattern="{:.0f}"),
        Figure(mode, "tellings", "stream", float(len(differences)), pattern="{:.0f}"),
        Figure(mode, "different", "stream", float(different), high=0.0, pattern="{:.0f}"),
        Figure(mode, "largest difference", "stream", max(differences, default=math.inf), high=EXACT, pattern="{:.1e}"),
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
    """Yield the lines that are compared, without one that the kill cut off."""
    for words in text.splitlines():
        try:
            line = json.loads(words)
        except ValueError:
            continue
        if line["kind"] in KINDS:
            yield line


def compare_lines(whole: Iterable[Line], told: Iterable[Line]) -> tuple[int, list[float]]:
    """Return how many lines of a walk were not told, and how far each telling is from the line of the walk.

    A telling of a line that the walk does not have is infinitely far.
    """
    expected = {name_line(line): line for line in whole}
    found = [(name_line(line), line) for line in told]
    missing = expected.keys() - {name for name, _ in found}
    return len(missing), [measure_difference(expected.get(name), line) for name, line in found]


def name_line(line: Line) -> tuple[object, ...]:
    """Return what tells a line from the others."""
    return line["kind"], line.get("stance"), line["t"] if line["kind"] == "turned" else None


def measure_difference(one: Any, other: Any) -> float:
    """Return the largest difference of any number in two values of JSON; infinite where anything else differs."""
    if isinstance(one, dict) and isinstance(other, dict) and one.keys() == other.keys():
        return max((measure_difference(one[key], other[key]) for key in one), default=0.0)
    if isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        return max((measure_difference(*pair) for pair in zip(one, other, strict=True)), default=0.0)
    if isinstance(one, int | float) and isinstance(other, int | float):
        return float(abs(one - other))
    return 0.0 if one == other else math.inf


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
