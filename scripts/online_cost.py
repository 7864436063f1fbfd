"""What a footfall costs online, however long the walk: hours round a corridor, one footfall after the other.

    python scripts/online_cost.py [--minutes N] [--lag SECONDS] [--rate HZ] [--field LEVEL] [--json FILE]

A simulated walk with a magnetometer (`long_walk`), its stances found beforehand: what is timed is `add_footfall` of
`fg_nav.online.smoother`, that is the graph, and not the detection. A row each thousand footfalls: p50, p99 and longest,
ms, and the memory of the process, MB. The longest is a warm-up, or where a full graph lets go of its older half.

Times depend on the machine and on what else it does, the ratio of the last thousand to footfalls 500 to 1500 on the
walk alone. Asked: of the whole walk p50 <= 10 ms and p99 <= 60 ms in the last thousand; with a lag the ratio of the p99
<= 1.3, and memory that grows by less than 5 per cent over the second half.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from time import perf_counter

import figures as fig
import numpy as np
from figures import Figure
from long_walk import long_walk

from fg_nav.arrays import Floats
from fg_nav.detection import detect_stances
from fg_nav.detection.causal import Footfall
from fg_nav.errors import SimulationError
from fg_nav.online.buffer import SampleBuffer, rows_of
from fg_nav.online.smoother import OnlineOptions, OnlineSmoother
from fg_nav.recording import Recording
from fg_nav.stances import Stances

MINUTES, RATE_HZ, SEED = 240.0, 100.0, 1
BEYOND = 5
"""Samples behind a footfall that come with it."""

EVERY = 1000
EARLY = slice(500, 1500)
P50_MS, P99_MS, LAG_RATIO, GROWTH = 10.0, 60.0, 1.3, 1.05


def main(arguments: Sequence[str] | None = None) -> None:
    """Simulate, feed, print."""
    parser = argparse.ArgumentParser(description="What a footfall costs online, however long the walk.")
    parser.add_argument("--minutes", type=float, default=MINUTES, metavar="N", help=f"of walking ({MINUTES:g})")
    parser.add_argument("--lag", type=float, metavar="SECONDS", help="fixed lag (none: the whole walk)")
    parser.add_argument("--rate", type=float, default=RATE_HZ, metavar="HZ", help=f"of the samples ({RATE_HZ:g})")
    parser.add_argument("--field", default="indoor", metavar="LEVEL", help="of the magnetic field (indoor)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures to this file")
    chosen = parser.parse_args(arguments)
    recording = long_walk(chosen.minutes, SEED, chosen.rate, chosen.field)
    stances = detect_stances(recording)
    fig.print_heading(f"{chosen.minutes:g} minutes, {stances.n_footfalls} footfalls, {named(chosen.lag)}")
    milliseconds, megabytes = measured(recording, stances, OnlineOptions(heading_rad=0.0, lag_s=chosen.lag))
    fig.print_table(("footfalls", "p50, ms", "p99, ms", "longest, ms", "memory, MB"), rows(milliseconds, megabytes))
    figures = judged(milliseconds, megabytes, chosen.lag)
    fig.print_figures(figures)
    fig.print_verdict(figures)
    if chosen.json:
        fig.write_json(chosen.json, {"figures": [f.as_dict() for f in figures]})


def named(lag_s: float | None) -> str:
    """Say which mode."""
    return "the whole walk" if lag_s is None else f"a lag of {lag_s:g} s"


def measured(recording: Recording, stances: Stances, options: OnlineOptions) -> tuple[Floats, Floats]:
    """Time (F,) of each footfall, ms, and memory (F,) after it, MB."""
    buffer = SampleBuffer()
    online, milliseconds, megabytes = OnlineSmoother(options, buffer), [], []
    rows = rows_of(recording)
    for footfall, until in footfalls(recording, stances):
        began = perf_counter()
        buffer.append(rows[buffer.stop : until])
        online.add_footfall(footfall, until)
        milliseconds.append(1e3 * (perf_counter() - began))
        megabytes.append(memory_mb())
    return np.array(milliseconds), np.array(megabytes)


def footfalls(recording: Recording, stances: Stances) -> Iterator[tuple[Footfall, int]]:
    """Yield the footfalls of a walk, each with the sample before which samples come with it."""
    stillest = stances.stillest(recording.gyr)
    for k in range(stances.n_footfalls):
        of = stances.footfall == k
        stop = min(int(stances.stop[of][-1]) + BEYOND, len(recording))
        yield Footfall(stances.start[of], stances.stop[of], np.ones(int(of.sum())), int(stillest[k]), False), stop


def memory_mb() -> float:
    """Memory of this process; NaN where the system does not tell."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except OSError:
        return float("nan")
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def rows(milliseconds: Floats, megabytes: Floats) -> list[list[str]]:
    """One row each thousand footfalls."""
    table = []
    for start in range(0, len(milliseconds), EVERY):
        part = milliseconds[start : start + EVERY]
        p50, p99 = np.percentile(part, [50, 99])
        last = start + len(part)
        table.append(
            [f"{start} to {last}", f"{p50:.1f}", f"{p99:.1f}", f"{part.max():.0f}", f"{megabytes[last - 1]:.0f}"]
        )
    return table


def judged(milliseconds: Floats, megabytes: Floats, lag_s: float | None) -> list[Figure]:
    """What was asked, of the last thousand footfalls."""
    if len(milliseconds) <= EARLY.start:
        raise SimulationError(f"{len(milliseconds)} footfalls are too few for a trend: ask for 15 minutes or more.")
    last, early = milliseconds[-EVERY:], milliseconds[EARLY]
    (p50, p99), early_p99 = np.percentile(last, [50, 99]), np.percentile(early, 99)
    growth = float(megabytes[-1] / megabytes[len(megabytes) // 2])
    section, lagged = named(lag_s), lag_s is not None
    infinite = float("inf")
    return [
        Figure(section, "p50 of the last thousand (ms)", "online", float(p50), high=infinite if lagged else P50_MS),
        Figure(section, "p99 of the last thousand (ms)", "online", float(p99), high=infinite if lagged else P99_MS),
        Figure(
            section,
            "p99 of the last thousand over that of footfalls 500 to 1500",
            "online",
            float(p99 / early_p99),
            high=LAG_RATIO if lagged else infinite,
        ),
        Figure(section, "memory at the end over that at half", "online", growth, high=GROWTH if lagged else infinite),
    ]


if __name__ == "__main__":
    fig.leave_with(main)
