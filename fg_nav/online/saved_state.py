"""The state of a walk in progress as a record of its checkpoint holds it: what changed since the record before.

    lines, footfalls, past     those from the first that differs on; lines stay, the past is revised as far back as the
                               walk was solved again
    anchor states              those that are new, by the sample at which they are
    all else                   as it is: small, and of the last seconds

`find_changes` returns it, of objects that do not change any more; `StateReader` joins the records again.
"""

from __future__ import annotations

import operator
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.detection.causal import CausalStances, Footfall
from fg_nav.online.anchor import NO_NODES, AnchorState, Past, PathNodes
from fg_nav.online.buffer import ReportedFootfall, SensorState
from fg_nav.online.estimates import EstimateRow
from fg_nav.online.navigator import NavigatorState
from fg_nav.online.resolve import Task
from fg_nav.online.smoother import Pending, SmootherState

OF_WALK = -1  # in place of the sample of an anchor state: the start of the walk


@dataclass(frozen=True)
class RowTable:
    """Estimates from number `first` on: (K, 40) numbers of their rows, the different words, which of these each has."""

    first: int
    numbers: Floats
    words: list[tuple[str, str]]
    which: Ints

    @classmethod
    def from_rows(cls, rows: Sequence[EstimateRow], first: int) -> RowTable:
        """Return the table of these rows from number `first` on."""
        known: dict[tuple[str, str], int] = {}
        which = [known.setdefault((row.field, row.field_reason), len(known)) for row in rows[first:]]
        numbers = np.array([row.numbers for row in rows[first:]]) if which else np.empty((0, 0))
        return cls(first, numbers, list(known), np.array(which, dtype=np.int64))

    def rows(self) -> list[EstimateRow]:
        """Return the rows."""
        return [EstimateRow(row, *self.words[k]) for row, k in zip(self.numbers, self.which.tolist(), strict=True)]


@dataclass(frozen=True)
class FootfallTable:
    """Footfalls from number `first` on: their intervals, all in one, `counts` each; else as in `ReportedFootfall`."""

    first: int
    counts: Ints
    start: Ints
    stop: Ints
    threshold: Floats
    stillest: Ints
    continues: Ints
    line: Ints
    until: Ints

    @classmethod
    def from_footfalls(cls, footfalls: Sequence[ReportedFootfall], first: int) -> FootfallTable:
        """Return the table of these footfalls from number `first` on."""
        new = footfalls[first:]
        found = [one.footfall for one in new]
        columns_of = ([getattr(one, name) for one in found] for name in ("start", "stop", "threshold"))
        parts: list[Any] = [np.concatenate(column) if column else np.empty(0) for column in columns_of]
        columns = (
            [len(one.start) for one in found],
            [one.stillest for one in found],
            [one.continues for one in found],
            [one.line for one in new],
            [one.until for one in new],
        )
        counts, *others = (np.array(column, dtype=np.int64) for column in columns)
        return cls(first, counts, *parts, *others)

    def footfalls(self) -> list[ReportedFootfall]:
        """Return the footfalls."""
        edges = np.cumsum(self.counts).tolist()
        found = []
        columns = (self.stillest.tolist(), self.continues.tolist(), self.line.tolist(), self.until.tolist())
        for begin, end, stillest, continues, line, until in zip([0, *edges], edges, *columns, strict=False):
            parts = self.start[begin:end], self.stop[begin:end], self.threshold[begin:end]
            found.append(ReportedFootfall(Footfall(*parts, stillest, bool(continues)), line, until))
        return found

    def cut(self, stop: int) -> FootfallTable:
        """Return a copy of the footfalls before number `stop`."""
        kept = stop - self.first
        intervals = int(self.counts[:kept].sum())
        each = {name: getattr(self, name)[:intervals].copy() for name in ("start", "stop", "threshold")}
        one = {name: getattr(self, name)[:kept].copy() for name in ("counts", "stillest", "continues", "line", "until")}
        return replace(self, **each, **one)


@dataclass(frozen=True)
class PastTable:
    """Estimates of the past from number `first` on, and the nodes of the path that changed with them."""

    first: int
    rows: RowTable
    nodes: PathNodes


@dataclass(frozen=True)
class StateChanges:
    """What changed from one state of a walk to another.

    `starts` are the samples of its anchor states; `due` the lines before which a solution is requested,
    of how many footfalls, and where it begins.
    """

    lines: RowTable
    reported_continues: Ints
    footfalls: FootfallTable
    past: PastTable
    anchors: tuple[AnchorState, ...]
    starts: tuple[int, ...]
    due: tuple[tuple[int, ...], int, int] | None
    sensor: SensorState | None
    others: dict[str, Any]
    stances: CausalStances


def find_changes(state: NavigatorState, known: NavigatorState | None) -> StateChanges:
    """Return what changed from the state `known` to this one; all of it where `known` is None."""
    new, old = state.smoother, None if known is None else known.smoother
    lines, footfalls, past = 0, 0, 0
    if old is not None:
        lines = _count_same(new.told, old.told)
        footfalls = _count_same(new.footfalls, old.footfalls)
        past = _count_same(new.past.rows, old.past.rows)
    at = set() if old is None else {one.stance.sample for one in old.starts}
    # nodes behind the row before the first that differs may have changed
    begins = 0 if past == 0 else int(np.searchsorted(new.past.nodes.sample, new.past.rows[past - 1].numbers[0]))
    nodes = PathNodes._make(part[begins:] for part in new.past.nodes)
    # the task that is pending, by the sample of the anchor state it begins at
    pending, due = new.pending, None
    if pending is not None:
        start = pending.task.start
        due = (pending.asked, pending.footfalls, OF_WALK if start is None else start.stance.sample)
    others = {name: getattr(state, name) for name in ("stop", "handed", "waits", "warned", "has_ended", "busy_s")}
    others |= {name: getattr(new, name) for name in ("next", "doubted", "has_mag", "discarded")}
    return StateChanges(
        lines=RowTable.from_rows(new.told, lines),
        reported_continues=np.array(new.reported_continues[lines:], dtype=np.int64),
        footfalls=FootfallTable.from_footfalls(new.footfalls, footfalls),
        past=PastTable(past, RowTable.from_rows(new.past.rows, past), nodes),
        anchors=tuple(one for one in new.starts if one.stance.sample not in at),
        starts=tuple(one.stance.sample for one in new.starts),
        due=due,
        sensor=None if pending is None else pending.task.sensor,
        others=others,
        stances=state.stances,
    )


class StateReader:
    """Joins the changes of a walk, as they come."""

    def __init__(self) -> None:
        self._lines: list[tuple[RowTable, Ints]] = []
        self._footfalls: list[FootfallTable] = []
        self._past: list[PastTable] = []
        self._anchors: dict[int, AnchorState] = {}
        self._newest: StateChanges | None = None

    def add(self, changes: StateChanges) -> None:
        """Add the next changes."""
        self._newest = changes
        self._lines.append((changes.lines, changes.reported_continues))
        # footfalls and past from the first that changed on are superseded
        footfalls, past = changes.footfalls, changes.past
        while self._footfalls and self._footfalls[-1].first >= footfalls.first:
            self._footfalls.pop()
        if self._footfalls:
            self._footfalls[-1] = self._footfalls[-1].cut(footfalls.first)
        self._footfalls.append(footfalls)
        while self._past and self._past[-1].first >= past.first:
            self._past.pop()
        if self._past:
            before, stop = self._past[-1], len(self._past[-1].nodes.sample)
            if len(past.nodes.sample):
                stop = int(np.searchsorted(before.nodes.sample, past.nodes.sample[0]))
            nodes = PathNodes._make(part[:stop].copy() for part in before.nodes)
            kept, rows = past.first - before.rows.first, before.rows
            rows = replace(rows, numbers=rows.numbers[:kept].copy(), which=rows.which[:kept].copy())
            self._past[-1] = PastTable(before.first, rows, nodes)
        self._past.append(past)
        known = self._anchors | {one.stance.sample: one for one in changes.anchors}
        self._anchors = {sample: known[sample] for sample in changes.starts}

    def state(self) -> NavigatorState | None:
        """Return the newest state; None before the walk had begun."""
        newest = self._newest
        if newest is None:
            return None
        starts = tuple(self._anchors[sample] for sample in newest.starts)
        footfalls = tuple(one for table in self._footfalls for one in table.footfalls())
        others = dict(newest.others)
        of_smoother = {name: others.pop(name) for name in ("next", "doubted", "has_mag", "discarded")}
        # the path through all nodes
        rows = tuple(row for table in self._past for row in table.rows.rows())
        parts = [table.nodes for table in self._past if len(table.nodes.sample)]
        nodes = PathNodes._make(np.concatenate(column) for column in zip(*parts, strict=True)) if parts else NO_NODES
        # the task that is pending
        pending = None
        if newest.due is not None and newest.sensor is not None:
            asked, count, at = newest.due
            start = None if at == OF_WALK else self._anchors[at]
            begins = 0 if start is None else start.stance.number
            pending = Pending(asked, count, Task(start, footfalls[begins:count], newest.sensor, since=0))
        smoother = SmootherState(
            told=tuple(row for table, _ in self._lines for row in table.rows()),
            reported_continues=tuple(bool(one) for _, part in self._lines for one in part.tolist()),
            footfalls=footfalls,
            past=Past(0, rows, nodes),
            starts=starts,
            pending=pending,
            **of_smoother,
        )
        return NavigatorState(smoother=smoother, stances=newest.stances, **others)


def _count_same(new: Sequence[object], old: Sequence[object]) -> int:
    """Return the number of identical objects before the first that differs."""
    flags = list(map(operator.is_, new, old))
    return flags.index(False) if False in flags else len(flags)
