"""The state of a walk in progress as a record of its checkpoint holds it: what changed since the record before.

    lines, footfalls, past     those from the first that is another on; what was told stays, the past is
                               revised as far back as the walk was solved again
    handovers                  those that are new, by the sample at which they are
    all else                   as it is: small, and of the last seconds

`find_changes` makes it, on objects that do not change any more; `StateReader` puts the records together again.
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
from fg_nav.online.smoother_state import Pending, SmootherState
from fg_nav.online.solving import Task

OF_WALK = -1  # In place of the sample of a handover: the start of the walk.


@dataclass(frozen=True)
class RowTable:
    """Estimates from number `first` on: (K, 40) numbers of their rows, the different words, which of these each has."""

    first: int
    numbers: Floats
    words: list[tuple[str, str]]
    which: Ints

    @classmethod
    def from_rows(cls, rows: Sequence[EstimateRow], first: int) -> RowTable:
        """Return the table of those of some rows from one on."""
        known: dict[tuple[str, str], int] = {}
        which = [known.setdefault((row.field, row.field_reason), len(known)) for row in rows[first:]]
        numbers = np.array([row.numbers for row in rows[first:]]) if which else np.empty((0, 0))
        return cls(first, numbers, list(known), np.array(which, dtype=np.int64))

    def rows(self) -> list[EstimateRow]:
        """Return the rows."""
        return [EstimateRow(row, *self.words[k]) for row, k in zip(self.numbers, self.which.tolist(), strict=True)]

    def cut(self, stop: int) -> RowTable:
        """Return a copy of the rows before number `stop`."""
        kept = stop - self.first
        return replace(self, numbers=self.numbers[:kept].copy(), which=self.which[:kept].copy())


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
    told: Ints
    until: Ints

    @classmethod
    def from_footfalls(cls, footfalls: Sequence[ReportedFootfall], first: int) -> FootfallTable:
        """Return the table of those of some footfalls from one on."""
        new = footfalls[first:]
        found = [one.footfall for one in new]
        parts = (_join([getattr(one, name) for one in found]) for name in ("start", "stop", "threshold"))
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
        columns = (self.stillest.tolist(), self.continues.tolist(), self.told.tolist(), self.until.tolist())
        for begin, end, stillest, continues, told, until in zip([0, *edges], edges, *columns, strict=False):
            parts = self.start[begin:end], self.stop[begin:end], self.threshold[begin:end]
            found.append(ReportedFootfall(Footfall(*parts, stillest, bool(continues)), told, until))
        return found

    def cut(self, stop: int) -> FootfallTable:
        """Return a copy of the footfalls before number `stop`."""
        kept = stop - self.first
        intervals = int(self.counts[:kept].sum())
        each = {name: getattr(self, name)[:intervals].copy() for name in ("start", "stop", "threshold")}
        one = {name: getattr(self, name)[:kept].copy() for name in ("counts", "stillest", "continues", "told", "until")}
        return replace(self, **each, **one)


@dataclass(frozen=True)
class PastTable:
    """Estimates of the past from number `first` on, and the nodes of the path that changed with them."""

    first: int
    rows: RowTable
    nodes: PathNodes

    @classmethod
    def from_past(cls, past: Past, first: int) -> PastTable:
        """Return the table of a past from a number on; nodes behind the row before it may have changed."""
        begins = 0 if first == 0 else int(np.searchsorted(past.nodes.sample, past.rows[first - 1].numbers[0]))
        nodes = PathNodes._make(part[begins:] for part in past.nodes)
        return cls(first, RowTable.from_rows(past.rows, first), nodes)

    def cut_at(self, later: PastTable) -> PastTable:
        """Return a copy of what a later table leaves of it."""
        stop = len(self.nodes.sample)
        if len(later.nodes.sample):
            stop = int(np.searchsorted(self.nodes.sample, later.nodes.sample[0]))
        nodes = PathNodes._make(part[:stop].copy() for part in self.nodes)
        return PastTable(self.first, self.rows.cut(later.first), nodes)


@dataclass(frozen=True)
class StateChanges:
    """What changed from one state of a walk to another.

    `starts` are the samples of its handovers; `due` is when a solution is asked for, of how many footfalls, and where
    it begins.
    """

    told: RowTable
    reported_continues: Ints
    footfalls: FootfallTable
    past: PastTable
    handovers: tuple[AnchorState, ...]
    starts: tuple[int, ...]
    due: tuple[tuple[int, ...], int, int] | None
    sensor: SensorState | None
    others: dict[str, Any]
    stances: CausalStances


def find_changes(state: NavigatorState, known: NavigatorState | None) -> StateChanges:
    """Return what changed since a state that is known; None for nothing that is known."""
    new, old = state.smoother, None if known is None else known.smoother
    told, footfalls, past = 0, 0, 0
    if old is not None:
        told = _count_same(new.told, old.told)
        footfalls = _count_same(new.footfalls, old.footfalls)
        past = _count_same(new.past.rows, old.past.rows)
    at = set() if old is None else {one.stance.sample for one in old.starts}
    pending = new.pending
    others = {name: getattr(state, name) for name in ("stop", "handed", "waits", "warned", "has_ended", "busy_s")}
    others |= {name: getattr(new, name) for name in ("next", "doubted", "has_mag", "discarded")}
    return StateChanges(
        told=RowTable.from_rows(new.told, told),
        reported_continues=np.array(new.reported_continues[told:], dtype=np.int64),
        footfalls=FootfallTable.from_footfalls(new.footfalls, footfalls),
        past=PastTable.from_past(new.past, past),
        handovers=tuple(one for one in new.starts if one.stance.sample not in at),
        starts=tuple(one.stance.sample for one in new.starts),
        due=None if pending is None else (pending.asked, pending.footfalls, _name_start(pending.task)),
        sensor=None if pending is None else pending.task.sensor,
        others=others,
        stances=state.stances,
    )


class StateReader:
    """Puts the changes of a walk together, as they come."""

    def __init__(self) -> None:
        self._told: list[tuple[RowTable, Ints]] = []
        self._footfalls: list[FootfallTable] = []
        self._past: list[PastTable] = []
        self._handovers: dict[int, AnchorState] = {}
        self._newest: StateChanges | None = None

    def add(self, changes: StateChanges) -> None:
        """Add the next changes."""
        self._newest = changes
        self._told.append((changes.told, changes.reported_continues))
        # What is there of the footfalls and of the past from the first that changed on is superseded.
        footfalls, past = changes.footfalls, changes.past
        while self._footfalls and self._footfalls[-1].first >= footfalls.first:
            self._footfalls.pop()
        if self._footfalls:
            self._footfalls[-1] = self._footfalls[-1].cut(footfalls.first)
        self._footfalls.append(footfalls)
        while self._past and self._past[-1].first >= past.first:
            self._past.pop()
        if self._past:
            self._past[-1] = self._past[-1].cut_at(past)
        self._past.append(past)
        known = self._handovers | {one.stance.sample: one for one in changes.handovers}
        self._handovers = {sample: known[sample] for sample in changes.starts}

    def state(self) -> NavigatorState | None:
        """Return the newest state; None before the walk had begun."""
        newest = self._newest
        if newest is None:
            return None
        starts = tuple(self._handovers[sample] for sample in newest.starts)
        footfalls = tuple(one for table in self._footfalls for one in table.footfalls())
        others = dict(newest.others)
        going_on = {name: others.pop(name) for name in ("next", "doubted", "has_mag", "discarded")}
        smoother = SmootherState(
            told=tuple(row for table, _ in self._told for row in table.rows()),
            reported_continues=tuple(bool(one) for _, part in self._told for one in part.tolist()),
            footfalls=footfalls,
            past=_join_past(self._past),
            starts=starts,
            pending=_restore_pending(newest, self._handovers, footfalls),
            **going_on,
        )
        return NavigatorState(smoother=smoother, stances=newest.stances, **others)


def _restore_pending(
    changes: StateChanges, handovers: dict[int, AnchorState], footfalls: tuple[ReportedFootfall, ...]
) -> Pending | None:
    if changes.due is None or changes.sensor is None:
        return None
    asked, count, at = changes.due
    start = None if at == OF_WALK else handovers[at]
    begins = 0 if start is None else start.stance.number
    return Pending(asked, count, Task(start, footfalls[begins:count], changes.sensor))


def _name_start(task: Task) -> int:
    """Sample of the handover that a task begins at."""
    return OF_WALK if task.start is None else task.start.stance.sample


def _join_past(tables: Sequence[PastTable]) -> Past:
    rows = tuple(row for table in tables for row in table.rows.rows())
    parts = [table.nodes for table in tables if len(table.nodes.sample)]
    if not parts:
        return Past(0, rows, NO_NODES)
    return Past(0, rows, PathNodes._make(np.concatenate(column) for column in zip(*parts, strict=True)))


def _count_same(new: Sequence[object], old: Sequence[object]) -> int:
    """Return how many objects, from the first on, are the same."""
    flags = list(map(operator.is_, new, old))
    return flags.index(False) if False in flags else len(flags)


def _join(parts: Sequence[Any]) -> Any:
    return np.concatenate(parts) if parts else np.empty(0)
