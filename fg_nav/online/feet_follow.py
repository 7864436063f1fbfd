"""Follow the sources of two feet to their end: `fg-nav stream LEFT RIGHT --mount feet`.

    two sources -> rows in the order of their stamps (`feet_merge`) -> the walk of each foot, as of one (`follow`)
                -> its lines, with whose they are and in which frame; and those of both (`feet`)

A source that ends, falls silent or is refused leaves the other going on. The walk ends when both have ended, or are
silent for as long as was asked for.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from functools import partial

from fg_nav.arrays import Floats
from fg_nav.errors import FgNavError
from fg_nav.feet import SIDES, Side
from fg_nav.online.estimates import StanceEstimate
from fg_nav.online.feet import FeetNavigator
from fg_nav.online.feet_lines import FeetLine, format_feet_line, tag_line
from fg_nav.online.feet_merge import FeetMerge
from fg_nav.online.feet_status import FeetStatus
from fg_nav.online.follow import FollowedWalk, StreamOptions
from fg_nav.online.outlets import Outlets, Say
from fg_nav.online.revision import Revision
from fg_nav.online.silence import Silence
from fg_nav.online.sources import SampleSource

WAIT_S = 0.05  # For bytes of one foot, before the other's are looked for.


def follow_feet(
    sources: Mapping[Side, SampleSource],
    options: Mapping[Side, StreamOptions],
    navigator: FeetNavigator,
    outlets: Outlets,
    stop: threading.Event,
) -> None:
    """Follow both sources to their end, or until a stop; the navigator is closed then.

    Raises `FgNavError` where the samples of neither foot can be used.
    """
    walk = _FollowedFeet(sources, options, navigator, outlets)
    while not stop.is_set() and walk.read():
        walk.add_waiting()
    walk.end()


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
        self._walks = {
            side: FollowedWalk(one, options[side], None, partial(self._tag, side), _name(outlets.remark, side))
            for side, one in navigator.navigators.items()
        }
        self._silence = {
            side: Silence(one.name, options[side].stalled_s, options[side].until_silent_s, outlets.remark)
            for side, one in sources.items()
        }
        self._open, self._over = list(SIDES), set[Side]()
        self._merge = FeetMerge()
        self._status = None if outlets.watcher is None else FeetStatus(outlets.watcher)

    def read(self) -> bool:
        """Read the foot that is behind, or the other one where it has sent nothing; False where nothing can come."""
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
        return bool(set(self._open) - self._over)

    def add_waiting(self) -> None:
        """Add the rows that need not wait for the other foot's."""
        is_alone = len(self._open) < len(SIDES) or bool(self._feet.refused) or self._feet.is_parted
        for side, rows in self._merge.take(is_alone):
            self._add(side, rows)
        if self._status is not None:
            self._status.report_feet(self._feet, self._list_lost())

    def end(self) -> None:
        """End the walk."""
        for side in list(self._open):
            self._end_source(side)
        for side, rows in self._merge.take(alone=True):
            self._add(side, rows)
        for side in SIDES:
            self._walks[side].count_losses(self._sources[side].lost)
        for line in self._feet.close():
            self._tell(line)
        if self._status is not None:
            self._status.report_feet(self._feet, self._list_lost(), ended=True)

    def _add(self, side: Side, rows: Floats) -> None:
        if side in self._feet.refused or not len(rows):
            return
        try:
            self._walks[side].add(rows, self._sources[side].header)
        except FgNavError as error:
            self._tell(self._feet.refuse(side, error))
            return
        for line in self._feet.look(side):
            self._tell(line)

    def _end_source(self, side: Side) -> None:
        self._open.remove(side)
        try:
            self._put(side, self._sources[side].finish())
        except FgNavError as error:
            self._tell(self._feet.refuse(side, error))

    def _put(self, side: Side, rows: Floats) -> None:
        """Put rows by the clock of both where they wait."""
        rows = rows.copy()
        rows[:, 0] += self._feet.offset_s[side]
        self._merge.put(side, rows)
        if self._status is not None:
            self._status.count_samples(len(rows))

    def _tell(self, line: FeetLine) -> None:
        """Tell a line; those of a foot with the verdict on its path."""
        if line.foot != "person" and isinstance(line.content, StanceEstimate | Revision):
            self._walks[line.foot].tell([line.content])
            return
        for text in format_feet_line(line):
            self._emit(text)

    def _tag(self, side: Side, line: str) -> None:
        self._emit(tag_line(line, side, self._feet.frame(side)))
        if self._status is not None:
            self._status.note_line()

    def _list_lost(self) -> dict[str, int]:
        lost = [self._walks[side].report_losses(self._sources[side].lost) for side in SIDES]
        return {name: sum(one[name] for one in lost) for name in ("samples", "datagrams")}


def _name(remark: Say, side: Side) -> Say:
    return lambda words: remark(f"{side} foot: {words}")
