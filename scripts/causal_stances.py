"""Stances found in a stream beside those of the whole recording.

    python scripts/causal_stances.py [--data DIR] [--seeds N] [--first SEED] [--only simulated|real]

A recording comes in blocks of 50 ms. A footfall of either kind is found if a stance of the other overlaps it. The delay
is from the end of a footfall, or of a piece of a long one, to the block that completed it. The masks are compared
sample by sample. Cost is the time that the search takes for a second of walking.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import figures as fig
import numpy as np
import walks

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.detection import detect_stances
from fg_nav.detection.causal import CausalStances, join_footfalls
from fg_nav.errors import FormatError
from fg_nav.lab.simulation import simulate
from fg_nav.recording import Recording
from fg_nav.stances import Stances

BLOCK_S = 0.05
FIRST_SEED, SEEDS = 101, 1
SCENARIOS = ("office", "mall", "teaching-building")
HEADERS = (
    "walks",
    "footfalls",
    "missed",
    "extra",
    "mask, %",
    "delay median, s",
    "95 %, s",
    "largest, s",
    "ms a second",
)


@dataclass(frozen=True)
class Found:
    """Of one recording: footfalls offline, of these missed, extra ones, share of samples that differ, delays, cost."""

    footfalls: int
    missed: int
    extra: int
    differ: float
    delay_s: Floats
    cost: float


def compared(recording: Recording, offline: Stances) -> Found:
    """Search a recording as a stream, and compare."""
    block = max(1, round(BLOCK_S / recording.period_s))
    stream, footfalls, delay = CausalStances(), [], []
    began = perf_counter()
    for start in range(0, len(recording), block):
        part = slice(start, start + block)
        for footfall in stream.push(recording.t[part], recording.acc[part], recording.gyr[part]):
            footfalls.append(footfall)
            delay.append(recording.t[part][-1] - recording.t[footfall.stop[-1] - 1])
    footfalls += stream.finish()
    busy = perf_counter() - began
    online = join_footfalls(footfalls, len(recording))
    missed, extra = (int((~_overlapped(*pair)).sum()) for pair in ((offline, online), (online, offline)))
    differ = float(np.mean(online.mask != offline.mask))
    return Found(offline.n_footfalls, missed, extra, differ, np.array(delay), 1e3 * busy / recording.duration_s)


def _overlapped(stances: Stances, other: Stances) -> Bools:
    """(F,) whether a stance of the other lies in the footfall, from its first sample to its last."""
    number: Ints = np.arange(stances.n_footfalls)
    first = stances.start[np.searchsorted(stances.footfall, number)]
    last = stances.stop[np.searchsorted(stances.footfall, number, side="right") - 1]
    before = np.concatenate([[0], np.cumsum(other.mask)])
    return np.asarray(before[last] > before[first])


def row(name: str, found: Sequence[Found]) -> tuple[str, ...]:
    """One row of the table."""
    delay = np.concatenate([one.delay_s for one in found])
    whole = (sum(getattr(one, key) for one in found) for key in ("footfalls", "missed", "extra"))
    return (
        f"{name} ({len(found)})",
        *(str(number) for number in whole),
        f"{100 * np.mean([one.differ for one in found]):.3f}",
        *(f"{value:.2f}" for value in (np.median(delay), np.quantile(delay, 0.95), delay.max())),
        f"{np.mean([one.cost for one in found]):.1f}",
    )


def simulated(first: int, seeds: int) -> Iterator[tuple[str, ...]]:
    """Rows of the long simulated walks."""
    for name in SCENARIOS:
        recordings = (simulate(name, seed).recording for seed in range(first, first + seeds))
        yield row(name, [compared(recording, detect_stances(recording)) for recording in recordings])


def real(data: Path) -> Iterator[tuple[str, ...]]:
    """Rows of the real walks."""
    groups = {
        "gdin": walks.gdin(data),
        "running": walks.gdin(data, walks.RUNNING),
        "loops": walks.loops(data),
        "vicon": walks.vicon_detected(data),
    }
    for name, group in groups.items():
        yield row(name, [compared(walk.recording, walk.stances) for walk in group])


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=None)
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("--first", type=int, default=FIRST_SEED)
    parser.add_argument("--only", choices=("simulated", "real"), default=None)
    given = parser.parse_args(arguments)
    rows: list[tuple[str, ...]] = []
    if given.only != "real":
        rows += simulated(given.first, given.seeds)
    if given.only != "simulated":
        try:
            rows += real(walks.data_folder(given.data))
        except FormatError as error:
            if given.only == "real" or given.data is not None:
                raise
            print(error)
    fig.print_heading("stances in a stream beside those of the whole recording")
    fig.print_table(HEADERS, rows)


if __name__ == "__main__":
    fig.leave_with(main)
