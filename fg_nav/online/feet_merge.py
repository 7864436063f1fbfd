"""Rows of two sources in the order of their stamps, in blocks of `BLOCK_S`, so that no foot runs ahead of the other.

A source gives its rows in pieces: a file some seconds at once, a sensor as they come. Rows wait until the other foot's
have come as far, but no longer than `HELD_S` of the clock on the wall: then that one is silent, or its stamps differ.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.feet import SIDES, Side
from fg_nav.online.buffer import COLUMNS

BLOCK_S = 0.1

HELD_S = 1.0

HEAD = 1000  # Rows in a block at most, whatever their stamps.


class FeetMerge:
    """Rows of both feet that wait."""

    def __init__(self) -> None:
        self._waits = {side: np.empty((0, COLUMNS)) for side in SIDES}
        self._since = dict.fromkeys(SIDES, 0.0)
        self.newest = dict.fromkeys(SIDES, -np.inf)

    def put(self, side: Side, rows: Floats) -> None:
        """Put in rows (n, 11) of a foot."""
        if len(rows):
            if not len(self._waits[side]):
                self._since[side] = time.monotonic()
            self._waits[side] = np.concatenate([self._waits[side], rows])
            self.newest[side] = float(rows[-1, 0])

    def take(self, alone: bool) -> Iterator[tuple[Side, Floats]]:
        """Yield blocks of both in turn, as far as both have come; all of them where there is no other to wait for."""
        now = time.monotonic()
        until = min(self.newest.values())
        limit = {side: np.inf if alone or now - self._since[side] > HELD_S else until for side in SIDES}
        while True:
            heads = {side: rows[0, 0] for side, rows in self._waits.items() if len(rows) and rows[0, 0] <= limit[side]}
            if not heads:
                return
            side = min(SIDES, key=lambda one: heads.get(one, np.inf))
            yield side, self._cut(side, min(limit[side], heads[side] + BLOCK_S))

    def _cut(self, side: Side, until: float) -> Floats:
        """Cut the rows of a foot up to a stamp off, at least one."""
        rows = self._waits[side]
        beyond = np.flatnonzero(rows[:HEAD, 0] > until)
        stop = int(beyond[0]) if len(beyond) else min(len(rows), HEAD)
        self._waits[side], self._since[side] = rows[stop:], time.monotonic()
        return rows[:stop]
