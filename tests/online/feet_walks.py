"""A simulated walk with a sensor on each foot, pushed through the navigator of both."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.feet import SIDES, Side
from fg_nav.online.buffer import OnlineOptions, rows_of
from fg_nav.online.estimates import FeetLine
from fg_nav.online.feet import FeetNavigator
from tests.feet.walks import demo_feet, feet

BLOCK_S = 0.2


def heads_known() -> OnlineOptions:
    return OnlineOptions(heading_rad=feet()["left"].heading, use_field=False)


def list_blocks(keep: Callable[[Side, float], bool]) -> Iterator[tuple[Side, Floats]]:
    """Yield the rows (n, 10) of each foot in turn that are kept, by side and stamp of their block."""
    rows = {side: rows_of(one.recording) for side, one in demo_feet().sides.items()}
    for begin in np.arange(0.0, rows["left"][-1, 0] + BLOCK_S, BLOCK_S):
        for side in SIDES:
            first, stop = np.searchsorted(rows[side][:, 0], [begin, begin + BLOCK_S])
            if stop > first and keep(side, float(begin)):
                yield side, rows[side][first:stop]


def push_feet(
    navigator: FeetNavigator,
    keep: Callable[[Side, float], bool] = lambda side, t: True,
    change: Callable[[Side, Floats], Floats] = lambda side, rows: rows,
) -> list[FeetLine]:
    """Push the demo's samples that are kept, and changed, and return all lines up to the end of the walk."""
    found = []
    for side, rows in list_blocks(keep):
        rows = change(side, rows.copy())
        found += navigator.push(side, rows[:, 0], rows[:, 1:4], rows[:, 4:7], rows[:, 7:10])
    return [*found, *navigator.close()]
