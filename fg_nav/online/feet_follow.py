"""`fg-nav stream LEFT RIGHT --mount feet`: follow the sources of two feet to their end.

    two sources -> rows in the order of their stamps (`FeetMerge`) -> the walk of each foot, as of one (`follow`)
                -> its lines, with foot and frame; and those of both (`feet`)

A watcher gets the keys of one foot (`follow`): `position_m` and `heading_deg` are null, as the newest step's line has
them; `standing` is whether both feet stand, `floor` and `returns` are the left foot's, rate and losses those of both.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import FgNavError
from fg_nav.feet import SIDES, Side
from fg_nav.online.buffer import OnlineOptions
from fg_nav.online.estimates import DIGITS, FeetLine, Revision, StanceEstimate, format_feet_line, tag_line
from fg_nav.online.feet import FeetNavigator
from fg_nav.online.follow import (
    FollowedWalk,
    Outlets,
    StatusReporter,
    StreamedWalk,
    StreamOptions,
    list_ends,
)
from fg_nav.online.sources import SampleSource
from fg_nav.samples.delivery import Silence
from fg_nav.samples.readings import COLUMNS

WAIT_S = 0.05  # For bytes of one foot, before the other's are read.
BLOCK_S = 0.1  # Of rows of one foot, so that no foot runs ahead of the other.
HELD_S = 1.0  # Of the wall clock, that rows wait for the other foot's: then that is silent, or its stamps differ.
MAX_ROWS = 1000  # In a block, whatever their stamps.


@dataclass(frozen=True)
class StreamedFeet:
    """Two feet whose walk has ended: their navigator, and the walk of each as of one foot."""

    navigator: FeetNavigator
    walks: dict[Side, StreamedWalk]


def follow_feet(
    sources: Mapping[Side, SampleSource],
    options: Mapping[Side, StreamOptions],
    outlets: Outlets,
    stop: threading.Event,
    clock_offset_s: float = 0.0,
) -> StreamedFeet:
    """Follow both sources until they end or `stop` is set; lines and remarks go to the outlets.

    `clock_offset_s` is to be added to the stamps of the right foot. Raises `FgNavError` where something that was asked
    for cannot be.
    """
    left, right = (options[side].online for side in SIDES)
    assert isinstance(left, OnlineOptions)
    assert isinstance(right, OnlineOptions)
    navigator = FeetNavigator(left, outlets.remark, clock_offset_s=clock_offset_s, background=True, right=right)
    with ExitStack() as opened:
        opened.callback(navigator.stop_process)
        walk = _FollowedFeet(sources, options, navigator, outlets)
        while not stop.is_set() and walk.advance():
            pass
        walk.end()
    walks = {
        side: StreamedWalk(
            navigator.navigators[side],
            one.name,
            options[side].calibration,
            options[side].mag_axes,
            rate_sigma=options[side].rate_sigma,
        )
        for side, one in sources.items()
    }
    return StreamedFeet(navigator, walks)


class _FollowedFeet:
    """Both sources, the walk of each foot, and the lines of both."""

    def __init__(
        self,
        sources: Mapping[Side, SampleSource],
        options: Mapping[Side, StreamOptions],
        navigator: FeetNavigator,
        outlets: Outlets,
    ) -> None:
        self._sources, self._feet, self._emit = sources, navigator, outlets.emit

        def remark_on(side: Side, words: str) -> None:
            outlets.remark(f"{side} foot: {words}")

        self._walks = {
            side: FollowedWalk(one, options[side], partial(self._tag, side), partial(remark_on, side))
            for side, one in navigator.navigators.items()
        }
        self._silence = {
            side: Silence(one.name, options[side].stalled_s, options[side].until_silent_s, outlets.remark)
            for side, one in sources.items()
        }
        self._open, self._over = list(SIDES), set[Side]()
        self._merge = FeetMerge()
        self._status = None if outlets.watcher is None else _FeetStatus(outlets.watcher)

    def advance(self) -> bool:
        """Add rows of the foot that is behind, or of the other where it has sent nothing; False where none can come."""
        for side in sorted(self._open, key=lambda one: self._merge.newest[one]):
            rows = self._sources[side].read(WAIT_S)
            if rows is None:
                self._end_source(side)
                break
            is_over = self._silence[side].is_over(len(rows))
            (self._over.add if is_over else self._over.discard)(side)
            self._put(side, rows)
            if len(rows):
                break
        if not set(self._open) - self._over:
            return False
        # Those that need not wait for the other foot's.
        is_alone = len(self._open) < len(SIDES) or bool(self._feet.refused) or self._feet.is_parted
        for side, rows in self._merge.take(is_alone):
            self._add(side, rows)
        if self._status is not None:
            self._status.report_feet(self._feet, self._list_lost())
        return True

    def end(self) -> None:
        """End the walk."""
        for side in list(self._open):
            self._end_source(side)
        for side, rows in self._merge.take(alone=True):
            self._add(side, rows)
        for side in SIDES:
            self._walks[side].count_losses(self._sources[side].lost)
        for line in self._feet.close():
            self._report(line)
        if self._status is not None:
            self._status.report_feet(self._feet, self._list_lost(), ended=True)

    def _add(self, side: Side, rows: Floats) -> None:
        if side in self._feet.refused or not len(rows):
            return
        try:
            self._walks[side].add(rows, self._sources[side].header)
        except FgNavError as error:
            self._report(self._feet.refuse(side, error))
            return
        for line in self._feet.update_both(side):
            self._report(line)

    def _end_source(self, side: Side) -> None:
        self._open.remove(side)
        try:
            self._put(side, self._sources[side].finish())
        except FgNavError as error:
            self._report(self._feet.refuse(side, error))

    def _put(self, side: Side, rows: Floats) -> None:
        """Put rows by the clock of both into the merge."""
        rows = rows.copy()
        rows[:, 0] += self._feet.offset_s[side]
        self._merge.put(side, rows)
        if self._status is not None:
            self._status.count_samples(len(rows))

    def _report(self, line: FeetLine) -> None:
        """Emit a line; those of a foot with the verdict on its path."""
        if line.foot != "person" and isinstance(line.content, StanceEstimate | Revision):
            self._walks[line.foot].report([line.content])
            return
        for text in format_feet_line(line):
            self._emit(text)

    def _tag(self, side: Side, line: str) -> None:
        self._emit(tag_line(line, side, self._feet.frame(side)))
        if self._status is not None:
            self._status.note_line()

    def _list_lost(self) -> dict[str, int]:
        lost = [self._walks[side].losses.report(self._sources[side].lost) for side in SIDES]
        return {name: sum(one[name] for one in lost) for name in ("samples", "datagrams")}


class FeetMerge:
    """Rows of two sources in the order of their stamps, in blocks of `BLOCK_S`.

    A source gives its rows in pieces: a file some seconds at once, a sensor as they come. Rows wait until the other
    foot's have come as far, but no longer than `HELD_S`.
    """

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
        beyond = np.flatnonzero(rows[:MAX_ROWS, 0] > until)
        stop = int(beyond[0]) if len(beyond) else min(len(rows), MAX_ROWS)
        self._waits[side], self._since[side] = rows[stop:], time.monotonic()
        return rows[:stop]


class _FeetStatus(StatusReporter):
    """Measures while two sources are followed, and reports to a watcher."""

    def report_feet(self, feet: FeetNavigator, lost: Mapping[str, int], ended: bool = False) -> None:
        """Send the status, as `report` does of one foot."""

        def describe() -> dict[str, Any]:
            navigators, t = feet.navigators, feet.last_stamp
            return {
                "t": round(t, DIGITS) if np.isfinite(t) else None,
                "standing": all(one.stands for one in navigators.values()),
                "position_m": None,
                "heading_deg": None,
                "floor": navigators["left"].floor,
                "returns": [list_ends(one) for one in navigators["left"].returns],
            }

        self.report(describe, lost, ended)
