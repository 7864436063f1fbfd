"""What a line of two feet costs next to one of a foot alone: a simulated walk, pushed as it is walked.

    python scripts/online_feet.py --scenario demo --seed 5

Samples come in tenths of a second in their own time, with the process that solves the walk again beside. Timed is each
push that returns a line of a footfall. Printed are the median, 99 % and longest, in ms.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from itertools import count
from typing import Any

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.feet import SIDES, Side
from fg_nav.lab.simulation import SimulatedFeet, simulate_feet
from fg_nav.online.buffer import OnlineOptions, rows_of
from fg_nav.online.feet import FeetNavigator
from fg_nav.online.navigator import OnlineNavigator

BLOCK_S = 0.1

OPTIONS = OnlineOptions(heading_rad=None)


def main() -> None:
    """Print a row for the left foot alone and one for both."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenario", default="demo")
    parser.add_argument("--seed", type=int, default=5)
    given = parser.parse_args()
    feet = simulate_feet(given.scenario, given.seed)
    one = OnlineNavigator(OPTIONS, background=True)
    print_row("left foot alone", time_lines(feet, ("left",), lambda side, *part: one.push(*part)))
    one.close()
    both = FeetNavigator(OPTIONS, background=True)
    print_row("both feet", time_lines(feet, SIDES, both.push))
    both.close()


def time_lines(feet: SimulatedFeet, sides: tuple[Side, ...], push: Callable[..., list[Any]]) -> list[float]:
    """Push the samples in their own time; seconds (L,) that each push with a line took."""
    found, began = [], time.monotonic()
    for due, side, rows in list_blocks(feet, sides):
        time.sleep(max(began + due - time.monotonic(), 0.0))
        start = time.perf_counter()
        if push(side, rows[:, 0], rows[:, 1:4], rows[:, 4:7], rows[:, 7:10]):
            found.append(time.perf_counter() - start)
    return found


def list_blocks(feet: SimulatedFeet, sides: tuple[Side, ...]) -> Iterator[tuple[float, Side, Floats]]:
    """Yield when each block of samples is due, s, whose it is, and its rows (n, 10)."""
    rows = {side: rows_of(feet.sides[side].recording) for side in sides}
    last = max(one[-1, 0] for one in rows.values())
    for begin in (BLOCK_S * number for number in count()):
        if begin > last:
            return
        for side in sides:
            first, stop = np.searchsorted(rows[side][:, 0], [begin, begin + BLOCK_S])
            if stop > first:
                yield begin + BLOCK_S, side, rows[side][first:stop]


def print_row(name: str, seconds: list[float]) -> None:
    """Print the figures of one run."""
    median, most, longest = 1e3 * np.percentile(seconds, [50, 99, 100])
    print(f"{name}: {len(seconds)} lines, {median:.1f} / {most:.0f} / {longest:.0f} ms")


if __name__ == "__main__":
    main()
