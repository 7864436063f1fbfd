"""Which samples of a stream are taken. What a file would be refused for is left out here: a walk in progress goes on.

================================= ==========================================================================
missing (NaN, empty, no range)    left out
bad samples                       bridged or left out, as in a file (`outlier_gate`)
stamp as the one before           left out
stamp before the last one         waits, and is left out; but after `RESTART` of them in order the clock has restarted,
                                  and its stamps are shifted: where force and rate go on (a counter that began again)
                                  those that wait go on from the last one, and else the newest does, after a gap of
                                  `UNKNOWN_GAP_S`
stamp more than `JUMP_S` ahead    waits for the next: left out if that one is back in line, or never comes
gap of more than `MAX_GAP_S`      remarked, and as long as it is; the estimator widens the sigmas across it
more than `MAX_CLOCK_STEP_S`      a clock that was set: a gap of `UNKNOWN_GAP_S`, and stamps from there on set back
wrong unit, gravity removed       refused, as in a file, once `CHECKED` samples are there
================================= ==========================================================================

Each kind is counted, and remarked once; a change of the stamps is remarked each time, and named in the notes. Nothing
depends on the blocks in which the rows come. Where stamps were set on or back, `sensor_time` returns those that the
sensor gave.

A judge is resumed from a checkpoint to the last bit. What comes then may be the same stream from its beginning, or
what a sensor sends now (`overlap`). If the first stamps of that, `HEAD` of them, are before the last one, the sensor
was switched off and on, and its clock restarted. How long the foot was not observed cannot be known; the walk goes on
after a gap of `UNKNOWN_GAP_S`, in which the heading is lost, and the sigmas grow accordingly. A clock that restarted
and has already passed the last stamp looks like a gap, and is taken for one.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.online.buffer import COLUMNS, TAKEN
from fg_nav.online.outlier_gate import OutlierFilter
from fg_nav.online.overlap import HEAD, TAIL, Overlap, fingerprint_rows
from fg_nav.online.remarks import REMARKS, UNKNOWN_GAP_S
from fg_nav.online.unit_check import UnitCheck
from fg_nav.recording import MAX_GAP_S, find_field_samples
from fg_nav.samples.outliers import ACC_OUT, BOTH_OUT, GYR_OUT, MAG_OUT
from fg_nav.samples.plausibility import find_usable_samples, keep_air
from fg_nav.samples.stamps import AROUND, SAME_S, goes_on

JUMP_S = 1.0  # A step ahead that is accepted only if the next stamp goes on from there.

LEAP = 1.5
"""Behind a clock that restarted force and rate go on if they change by less than this many times their largest change
around; anything may have happened, unlike within a file, so it is less than there."""

RESTART = 100  # Stamps before the last one that follow each other: not a delayed block, but a clock that restarted.

MAX_CLOCK_STEP_S = 86400.0
"""A longer step is that of a clock that was set, from 1970 or from when the sensor was switched on."""

MAX_CHANGES = 20  # Changes of the stamps that the notes name one by one.
MAX_LEFT = 4096  # Rows left out for their stamps that a checkpoint recognizes.


class SampleFilter:
    """Takes what can be navigated with; `counts` holds how much of each kind of `REMARKS` there was.

    Parameters
    ----------
    remark
        Given one sentence the first time that something of a kind happens, and whenever the stamps are changed.

    Raises
    ------
    RecordingError
        From `admit`, if the samples are in a wrong unit.
    """

    def __init__(self, remark: Callable[[str], None] = lambda words: None) -> None:
        self.counts: Counter[str] = Counter()
        self._remark = remark
        self._last = -np.inf
        self._before = np.nan
        self._offset = 0.0
        self._clocks = [(0, 0.0)]
        self._changes: list[str] = []
        self._taken = 0
        self._missing_last = self._missing_again = self._missing_unsure = 0
        self._behind: list[Floats] = []
        self._recent: deque[Floats] = deque(maxlen=AROUND)
        self._waits = np.empty((0, COLUMNS))
        self._tail = np.empty((0, COLUMNS))
        self._left: deque[int] = deque(maxlen=MAX_LEFT)
        self._head = np.empty((0, COLUMNS))
        self.overlap: Overlap | None = None
        self._units = UnitCheck()
        self._gate = OutlierFilter()

    def admit(
        self, t: Floats, acc: Floats, gyr: Floats, mag: Floats | None = None, pressure: Floats | None = None
    ) -> Floats:
        """Return the rows (m, 12) to take, of this block and of what waited: t, acc, gyr, mag, pressure, bad.

        Parameters
        ----------
        t, acc, gyr, mag, pressure
            (n,) s, (n, 3) m/s^2, (n, 3) rad/s, (n, 3) uT, (n,) Pa; whatever a sensor may deliver.
        """
        unseen = np.full((len(t), 3), np.nan)
        field = unseen if mag is None else np.where(find_field_samples(mag)[:, None], mag, unseen)
        air = None if pressure is None else keep_air(pressure)
        air = np.full(len(t), np.nan) if air is None else air
        usable = find_usable_samples(t, acc, gyr)
        new = self._drop_known(np.column_stack([t, acc, gyr, field, air])[usable])
        self._count_missing(usable, len(new))
        return self._take(new)

    def flush(self) -> Floats:
        """Return the rows (m, 12) to take of those that wait, at the end of the stream, for more to be judged by."""
        new = self._drop_known(np.empty((0, COLUMNS)), at_end=True)
        self._count_missing(np.empty(0, dtype=np.bool_), len(new))
        return self._take(new, at_end=True)

    def sensor_time(self, sample: int, t: float) -> float:
        """Return the stamp, s, that the sensor gave a sample which was taken with stamp t."""
        return t - next(offset for first, offset in reversed(self._clocks) if first <= sample)

    def state(self) -> dict[str, Any]:
        """Return what `resume` needs, as JSON values, a copy of it."""
        held = self._waits[:0] if self.overlap is None else self.overlap.held
        return {
            "counts": dict(self.counts),
            "last": self._last,
            "before": self._before,
            "offset": self._offset,
            "clocks": list(self._clocks),
            "changes": list(self._changes),
            "behind": np.array(self._behind).reshape(-1, COLUMNS).tolist(),
            "head": self._head.tolist(),
            "waits": self._waits.tolist(),
            "tail": self._tail.tolist(),
            "held": held.tolist(),
            "left": list(self._left),
            "to_check": self._units.left,
            "gate": self._gate.held.tolist(),
            "fields": self._gate.fields.tolist(),
            "missing_last": self._missing_last,
        }

    @classmethod
    def resume(
        cls, state: Mapping[str, Any], blocks: Sequence[Floats], remark: Callable[[str], None], first: int = 0
    ) -> SampleFilter:
        """Return a judge that goes on behind a checkpoint with these samples (n, 12), as if it had never stopped.

        They come in blocks one behind the other, from number `first` on: those before it were discarded.
        """
        judge = cls(remark)
        judge.counts.update(state["counts"])
        judge._last, judge._before, judge._offset = (float(state[name]) for name in ("last", "before", "offset"))
        judge._clocks = [(int(first), float(offset)) for first, offset in state["clocks"]]
        judge._changes = list(state["changes"])
        gate = _rows(state["gate"])
        judge._taken = first + sum(map(len, blocks)) + len(gate)
        judge._behind = list(_rows(state["behind"]))
        for rows in blocks:
            judge._note_recent(rows)
        judge._waits, judge._tail, held = (_rows(state[name]) for name in ("waits", "tail", "held"))
        judge._head, judge._units = _rows(state["head"]), UnitCheck(int(state["to_check"]), blocks)
        judge._gate = OutlierFilter(np.array([*judge._recent]).reshape(-1, COLUMNS), gate, _rows(state["fields"]))
        judge._missing_last = judge._missing_again = int(state["missing_last"])
        judge._left.extend(state["left"])
        undecided = judge._waits, judge._restore(judge._behind), judge._restore_samples(gate, judge._taken - len(gate))
        left = [*judge._left, *(one for rows in undecided for one in fingerprint_rows(rows).tolist())]
        judge.overlap = Overlap(blocks, judge._clocks, left, judge._tail, held, first, judge._head[:first])
        return judge

    @property
    def notes(self) -> tuple[str, ...]:
        """What was left out or odd, in words."""
        notes = [f"{number} times: {REMARKS[kind]}" for kind, number in self.counts.items()]
        changes = list(self._changes)
        if self._offset:
            changes.append(f"at the end stamps are {_name_shift(self._offset)} from those of the sensor")
        return (*notes, *changes)

    def _count(self, kind: str, number: int, where: str) -> None:
        if number == 0:
            return
        if not self.counts[kind]:
            self._remark(f"{REMARKS[kind]}, the first {where}.")
        self.counts[kind] += number

    def _count_missing(self, usable: Bools, new: int) -> None:
        """Count what is not usable (n,) of a block, but for what came before the checkpoint.

        `new` rows come now, of this block and of those held until it was clear which of them the checkpoint has.
        """
        self._missing_last = _count_after_last(usable) + (0 if usable.any() else self._missing_last)
        if self.overlap is not None and not self.overlap.is_over:
            self._missing_unsure = 0 if self.overlap.skips else self._missing_unsure + int((~usable).sum())
            return
        known = max(int(usable.sum()) - new, 0)
        missing = int((np.cumsum(usable) >= known)[~usable].sum())
        again = min(missing, self._missing_again)
        self._missing_again = 0 if new else self._missing_again - again
        self._count(
            "missing",
            missing - again + self._missing_unsure,
            f"near t = {self._last:.3f} s" if np.isfinite(self._last) else "of all",
        )
        self._missing_unsure = 0

    def _drop_known(self, rows: Floats, at_end: bool = False) -> Floats:
        """Leave out the rows of a checkpoint, and what comes before them."""
        overlap = self.overlap
        if overlap is None:
            return rows
        before = Counter(known=overlap.known, late=overlap.late)
        rows = overlap.select_new(rows, at_end)
        for kind, number in (Counter(known=overlap.known, late=overlap.late) - before).items():
            self._count(kind, number, f"before t = {self._tail[-1, 0]:.3f} s")
        if overlap.is_over:
            if not overlap.skips:
                self._missing_again = 0
                self._detect_reboot(rows[:HEAD, 0])
            self.overlap = None
        return rows

    def _detect_reboot(self, t: Floats) -> None:
        """Set the clock on where a source goes on with stamps (n,) that are all before the last one."""
        if len(t) == 0 or (t + self._offset >= self._last).any():
            return
        if self._behind and t[0] + self._offset > self._behind[-1][0]:
            return  # they go on from stamps that are counted already
        shift = self._last + UNKNOWN_GAP_S - (float(t[0]) + self._offset)
        self._shift_clock("rebooted", shift, f"at t = {t[0]:.3f} s, after {self._last:.3f} s")

    def _take(self, sent: Floats, at_end: bool = False) -> Floats:
        """Return the rows to take, of these as they were sent and of what waited."""
        self._tail = np.concatenate([self._tail, sent[-TAIL:]])[-TAIL:]
        rows = self._put_in_order(np.concatenate([self._waits, sent]), at_end)
        self._head = np.concatenate([self._head, rows[: HEAD - len(self._head), :COLUMNS]])
        self._count_gaps(rows)
        self._units.see(rows)
        return rows

    def _put_in_order(self, sent: Floats, at_end: bool) -> Floats:
        """Leave out the rows whose stamps do not go on from the last one, and set the clock on where it must be."""
        self._waits = sent[:0]
        rows = sent.copy()
        rows[:, 0] += self._offset
        if self._all_go_on(rows[:, 0]):
            self._last = float(rows[-1, 0]) if len(rows) else self._last
            return self._pass(rows, at_end)
        taken = [np.empty((0, TAKEN))]
        for i, stamp in enumerate(sent[:, 0].tolist()):
            following = float(sent[i + 1, 0]) if i + 1 < len(sent) else None
            if following is None and not at_end and self._is_far_ahead(stamp + self._offset):
                self._waits = sent[i:]
                break
            row = np.append(stamp + self._offset, sent[i, 1:])
            for one in self._select(row, following is not None and following > stamp):
                self._last = float(one[0])
                taken.append(self._pass(one[None]))
        if at_end:
            self._drop_behind()
            taken.append(self._pass(rows[:0], at_end))
        return np.concatenate(taken)

    def _pass(self, rows: Floats, at_end: bool = False) -> Floats:
        """Return the good ones of rows in order, and of those that were held; leave the bad ones out."""
        first = self._taken - len(self._gate.held)
        good, bad, place, sensor = self._gate.judge(rows, at_end)
        self._taken += len(rows) - int((sensor & BOTH_OUT == BOTH_OUT).sum())
        self._note_recent(good)
        # From the last one on, so that the number of each is that before any was left out.
        for row, at, which in reversed([*zip(bad, (first + place).tolist(), sensor.tolist(), strict=True)]):
            self._left.extend(fingerprint_rows(self._restore_samples(row[None], at)).tolist())
            gone = which & BOTH_OUT == BOTH_OUT
            self._clocks = [(begins - (gone and begins > at), offset) for begins, offset in self._clocks]
            for kind, of_it in (("gyr", GYR_OUT), ("acc", ACC_OUT), ("mag", MAG_OUT)):
                self._count(kind, int(which & of_it > 0), f"at t = {row[0]:.3f} s")
        return good

    def _note_recent(self, rows: Floats) -> None:
        """Note those of the last rows (n, 12) of which no sensor was bad."""
        self._recent.extend(rows[rows[:, COLUMNS] == 0, :COLUMNS][-AROUND:])

    def _all_go_on(self, t: Floats) -> bool:
        """Whether stamps (n,) go on from the last one, as they nearly always do."""
        step = np.diff(t, prepend=self._last)
        step[np.isinf(step)] = 0.5 * JUMP_S  # the very first
        return not self._behind and bool(((step > SAME_S) & (step <= JUMP_S)).all())

    def _is_far_ahead(self, t: float) -> bool:
        return np.isfinite(self._last) and t - self._last > JUMP_S

    def _select(self, row: Floats, is_followed: bool) -> list[Floats]:
        """Return the rows to take now: this one, which `is_followed` by a later one, none, or those that waited too.

        Shifts the clock where the row shows a restart.
        """
        t = float(row[0])
        if t < self._last:
            return self._wait_for_restart(row)
        kind = "repeated" if t - self._last <= SAME_S else "ahead"
        if kind == "repeated" or (self._is_far_ahead(t) and not is_followed):
            self._count(kind, 1, f"at t = {t:.3f} s")
            self._leave_out([row])
            return []
        shift = self._detect_set_clock(t) if self._is_far_ahead(t) else 0.0
        self._drop_behind()
        return [_shift_stamps(row, shift)]

    def _wait_for_restart(self, row: Floats) -> list[Floats]:
        """Hold a row before the last one; after `RESTART` of them in order, set the clock on; the rows to take."""
        if self._behind and row[0] <= self._behind[-1][0]:
            self._drop_behind()
        self._behind.append(row)
        if len(self._behind) < RESTART:
            return []
        t, first = float(row[0]), float(self._behind[0][0])
        where = f"at t = {t:.3f} s, after {self._last:.3f} s"
        recent = [*self._recent, *self._gate.held][-AROUND:]
        if goes_on(np.array([*recent, *self._behind])[:, 1:7], len(recent), LEAP):
            kind, shift = "restart", self._last + (t - first) / (RESTART - 1) - first
            taken, self._behind = self._behind, []
        else:
            kind, shift = "rebooted", self._last + UNKNOWN_GAP_S - t
            taken, self._behind = [row], self._behind[:-1]
        self._shift_clock(kind, shift, where)
        return [_shift_stamps(one, shift) for one in taken]

    def _drop_behind(self) -> None:
        """Leave out the rows before the last one that were held."""
        if self._behind:
            where = f"at t = {self._behind[0][0]:.3f} s, after {self._last:.3f} s"
            self._count("backward", len(self._behind), where)
            self._leave_out(self._behind)
            self._behind = []

    def _leave_out(self, rows: list[Floats]) -> None:
        """Note rows that were left out for their stamps, which are on the clock of now."""
        self._left.extend(fingerprint_rows(self._restore(rows)).tolist())

    def _restore(self, rows: list[Floats]) -> Floats:
        """Rows (n, 11) on the clock of now as the sensor sent them."""
        return np.array([_shift_stamps(row, -self._offset) for row in rows]).reshape(-1, COLUMNS)

    def _restore_samples(self, rows: Floats, first: int) -> Floats:
        """Rows (n, 11) that are the samples from number `first` on as the sensor sent them."""
        return np.array(
            [np.append(self.sensor_time(first + i, float(row[0])), row[1:]) for i, row in enumerate(rows)]
        ).reshape(-1, COLUMNS)

    def _detect_set_clock(self, t: float) -> float:
        """Set the clock back where a step is too long for a gap; by how much it was set on."""
        if t - self._last <= MAX_CLOCK_STEP_S:
            return 0.0
        shift = self._last + UNKNOWN_GAP_S - t
        self._shift_clock("set", shift, f"at t = {t:.3f} s, after {self._last:.3f} s")
        return shift

    def _shift_clock(self, kind: str, shift: float, where: str) -> None:
        """Set the clock on or back from the next sample on, and say so."""
        words = f"{REMARKS[kind]}, {where}; from there on stamps are {_name_shift(shift)}"
        self._remark(f"{words}.")
        self._changes += [words] * (len(self._changes) < MAX_CHANGES)
        self.counts[kind] += 1
        self._drop_behind()
        self._offset += shift
        self._clocks.append((self._taken, self._offset))

    def _count_gaps(self, rows: Floats) -> None:
        if len(rows) == 0:
            return
        step = np.diff(rows[:, 0], prepend=rows[0, 0] if np.isnan(self._before) else self._before)
        self._before = float(rows[-1, 0])
        gap = step > MAX_GAP_S
        if gap.any():
            i = int(np.argmax(gap))
            self._count("gap", int(gap.sum()), f"of {step[i]:.2f} s before t = {rows[i, 0]:.3f} s")


def _shift_stamps(row: Floats, shift: float) -> Floats:
    """Return a row (11,) with its stamp set on."""
    return np.append(row[0] + shift, row[1:])


def _name_shift(shift: float) -> str:
    return f"set {'back' if shift < 0.0 else 'on'} by {abs(shift):.3f} s"


def _count_after_last(usable: Bools) -> int:
    """Return how many samples behind the last usable one are not."""
    return int((np.cumsum(usable[::-1]) == 0).sum())


def _rows(content: Any) -> Floats:
    return np.array(content, dtype=np.float64).reshape(-1, COLUMNS)
