"""Which samples of a stream are used. What a file would be refused for is left out here: a walk in progress goes on.

================================= ==========================================================================
missing (NaN, empty, no range)    left out
bad samples                       found as in a file (`fg_nav.samples.outliers`); one of which one sensor is bad is
                                  bridged by a line (`fg_nav.samples.gaps`), others are left out
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
depends on the blocks in which the rows come.

Most samples pass at once. One at which a run of bad ones may begin, far from the one before, is held until `LOOK_AHEAD`
more are there: 55 ms at 200 Hz, in which a shoe that strikes is on its way to a footfall.

A filter is resumed from a checkpoint to the last bit. What comes then may be the same stream from its beginning, or
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

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.errors import RecordingError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.online.buffer import COLUMNS, TAKEN
from fg_nav.online.overlap import HEAD, TAIL, Overlap, fingerprint_rows, restore_stamps
from fg_nav.recording import MAX_GAP_S, find_field_samples
from fg_nav.samples import outliers
from fg_nav.samples.gaps import interpolate_unread
from fg_nav.samples.outliers import ACC_OUT, BOTH_OUT, GYR_OUT, MAG_OUT, scan_mag, scan_outliers
from fg_nav.samples.plausibility import (
    find_acc_problem,
    find_mag_problem,
    find_stamp_problem,
    find_usable_samples,
    keep_air,
    measure_field_strength,
    median_period_s,
)
from fg_nav.samples.stamps import AROUND, SAME_S, goes_on
from fg_nav.text import format_count

JUMP_S = 1.0  # a step ahead that is accepted only if the next stamp goes on from there
LEAP = 1.5  # times the largest change around: less than within a file, for behind a restart anything may have happened
RESTART = 100  # stamps before the last one that follow each other: not a delayed block, but a clock that restarted
MAX_CLOCK_STEP_S = 86400.0  # a longer step is a clock that was set, from 1970 or from when the sensor was switched on
UNKNOWN_GAP_S = 60.0  # assumed for an unknown gap: a sensor is switched off and on in less; the heading is lost in it
MAX_CHANGES = 20  # changes of the stamps that the notes name one by one
MAX_LEFT = 4096  # rows left out for their stamps that a checkpoint recognizes
CHECKED = 1000  # samples, some seconds, that show in which unit they are
PLAUSIBLE_G = (0.7, 2.0)  # median specific force on a foot, in g
FIELD_UT = (5.0, 200.0)  # field on a foot; a magnet makes more of it for a while ...
MIN_FIELD_SHARE = 0.05  # ... but not always

REMARKS = {
    "missing": "samples are missing (empty, NaN or out of any range) and left out",
    "gyr": "samples of the gyroscope are far off what those around allow, and not used",
    "acc": "samples of the accelerometer are far off what those around allow, and not used",
    "mag": "samples of the magnetometer are far off what those around allow, and not used",
    "repeated": "stamps repeat the one before, and their samples are left out",
    "backward": "stamps are before the last one, and their samples are left out",
    "ahead": "stamps are far ahead of those around them, and their samples are left out",
    "restart": "the clock of the sensor restarted with nothing missing, and its stamps are shifted to go on",
    "rebooted": f"the clock of the sensor restarted, after a time unknown: a gap of {UNKNOWN_GAP_S:g} s is assumed",
    "gap": f"there is a gap of more than {MAX_GAP_S:g} s: the track goes on with larger sigmas",
    "set": f"the clock of the sensor was set by more than a day: a gap of {UNKNOWN_GAP_S:g} s is assumed",
    "known": "samples are in the checkpoint already and left out",
    "late": "samples that the checkpoint does not hold come before its last one, and are left out",
}

NOTHING = np.empty((0, COLUMNS))


class SampleFilter:
    """Accepts what can be navigated with; `counts` holds how much of each kind of `REMARKS` there was.

    `overlap` is what a resumed stream is compared with, as long as it may hold known samples. `remark` is called with
    one sentence the first time that something of a kind happens, and whenever the stamps are changed. Raises
    `RecordingError` from `accept`, if the samples are in a wrong unit.
    """

    def __init__(self, remark: Callable[[str], None] = lambda words: None) -> None:
        self.counts: Counter[str] = Counter()
        self.overlap: Overlap | None = None
        self._remark = remark
        # the clock: last stamp, the one before a gap, shift of the stamps, (sample, shift) of each change and its words
        self._last, self._before, self._offset = -np.inf, np.nan, 0.0
        self._clocks = [(0, 0.0)]
        self._changes: list[str] = []
        # rows that wait: before the last stamp (shifted), and far ahead (as sent)
        self._behind: list[Floats] = []
        self._waits = NOTHING
        # samples: how many, the last ones that are not bad, the first ones, and the last as sent; what was left out
        self._taken = 0
        self._recent: deque[Floats] = deque(maxlen=AROUND)
        self._head = self._tail = NOTHING
        self._left: deque[int] = deque(maxlen=MAX_LEFT)
        self._missing_last = self._missing_again = self._missing_unsure = 0
        self._outliers = OutlierFilter()
        # samples by which units are still to be checked
        self._to_check, self._unchecked = CHECKED, list[Floats]()

    def accept(
        self, t: Floats, acc: Floats, gyr: Floats, mag: Floats | None = None, pressure: Floats | None = None
    ) -> Floats:
        """Return the rows (m, 12) to use, of this block and of what waited: t, acc, gyr, mag, pressure, bad.

        The block is (n,) s, (n, 3) m/s^2, (n, 3) rad/s, (n, 3) uT, (n,) Pa; whatever a sensor may deliver.
        """
        unseen = np.full((len(t), 3), np.nan)
        field = unseen if mag is None else np.where(find_field_samples(mag)[:, None], mag, unseen)
        air = None if pressure is None else keep_air(pressure)
        air = np.full(len(t), np.nan) if air is None else air
        usable = find_usable_samples(t, acc, gyr)
        return self._accept(np.column_stack([t, acc, gyr, field, air])[usable], usable)

    def flush(self) -> Floats:
        """Return the rows (m, 12) to use of those that wait, at the end of the stream."""
        return self._accept(NOTHING, np.empty(0, dtype=np.bool_), at_end=True)

    def sensor_time(self, sample: int, t: float) -> float:
        """Return the stamp, s, that the sensor gave a sample whose stamp is now t."""
        return t - next(offset for first, offset in reversed(self._clocks) if first <= sample)

    def state(self) -> dict[str, Any]:
        """Return what `resume` needs, as JSON values, a copy of it."""
        held = NOTHING if self.overlap is None else self.overlap.held
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
            "to_check": self._to_check,
            "gate": self._outliers.held.tolist(),
            "fields": self._outliers.fields.tolist(),
            "missing_last": self._missing_last,
        }

    @classmethod
    def resume(
        cls, state: Mapping[str, Any], blocks: Sequence[Floats], remark: Callable[[str], None], first: int = 0
    ) -> SampleFilter:
        """Return a filter that goes on behind a checkpoint with these samples (n, 12), as if it had never stopped.

        They come in blocks one behind the other, from number `first` on: those before it were discarded.
        """
        self = cls(remark)
        self.counts.update(state["counts"])
        self._last, self._before, self._offset = (float(state[name]) for name in ("last", "before", "offset"))
        self._clocks = [(int(begin), float(offset)) for begin, offset in state["clocks"]]
        self._changes = list(state["changes"])
        names = ("gate", "fields", "behind", "waits", "tail", "held", "head")
        gate, fields, behind, self._waits, self._tail, held, self._head = (
            np.array(state[name], dtype=np.float64).reshape(-1, COLUMNS) for name in names
        )
        self._taken = first + sum(map(len, blocks)) + len(gate)
        self._behind = list(behind)
        for rows in blocks:
            self._note_recent(rows)
        self._to_check = int(state["to_check"])
        self._unchecked = [*blocks] if self._to_check > 0 else []
        self._outliers = OutlierFilter(np.array([*self._recent]).reshape(-1, COLUMNS), gate, fields)
        self._missing_last = self._missing_again = int(state["missing_last"])
        self._left.extend(state["left"])
        # what the stream may send again: the samples, and what was left out or not decided yet
        undecided = (
            self._waits,
            restore_stamps(behind, self._taken, self._clocks),
            restore_stamps(gate, self._taken - len(gate), self._clocks),
        )
        left = [*self._left, *(one for rows in undecided for one in fingerprint_rows(rows).tolist())]
        self.overlap = Overlap(blocks, self._clocks, left, self._tail, held, first, self._head[:first])
        return self

    @property
    def notes(self) -> tuple[str, ...]:
        """What was left out or odd, in words."""
        notes = [f"{number} times: {REMARKS[kind]}" for kind, number in self.counts.items()]
        changes = list(self._changes)
        if self._offset:
            changes.append(f"at the end stamps are {_describe_shift(self._offset)} from those of the sensor")
        return (*notes, *changes)

    def _accept(self, sent: Floats, usable: Bools, at_end: bool = False) -> Floats:
        """Return the rows (m, 12) to use, of usable ones `sent` and of those held; `usable` (n,) flags all rows."""
        # what the checkpoint of a resumed walk does not hold
        new = self._drop_known(sent, at_end)
        self._count_missing(usable, len(new))
        # those whose stamps go on, and that are not bad
        self._tail = np.concatenate([self._tail, new[-TAIL:]])[-TAIL:]
        rows = self._put_in_order(np.concatenate([self._waits, new]), at_end)
        self._head = np.concatenate([self._head, rows[: HEAD - len(self._head), :COLUMNS]])
        # gaps between them
        if len(rows):
            step = np.diff(rows[:, 0], prepend=rows[0, 0] if np.isnan(self._before) else self._before)
            self._before = float(rows[-1, 0])
            gap = step > MAX_GAP_S
            if gap.any():
                i = int(np.argmax(gap))
                self._count("gap", int(gap.sum()), f"of {step[i]:.2f} s before t = {rows[i, 0]:.3f} s")
        self._check_units(rows)
        return rows

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
        after_last = int((np.cumsum(usable[::-1]) == 0).sum())
        self._missing_last = after_last + (0 if usable.any() else self._missing_last)
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
        """Return the rows that are new behind the checkpoint; shift the clock of a sensor that rebooted."""
        overlap = self.overlap
        if overlap is None:
            return rows
        before = Counter(known=overlap.known, late=overlap.late)
        rows = overlap.select_new(rows, at_end)
        for kind, number in (Counter(known=overlap.known, late=overlap.late) - before).items():
            self._count(kind, number, f"before t = {self._tail[-1, 0]:.3f} s")
        if not overlap.is_over:
            return rows
        self.overlap = None
        if not overlap.skips:
            self._missing_again = 0
            # all stamps are before the last one, and do not go on from those that wait
            t = rows[:HEAD, 0] + self._offset
            if len(t) and (t < self._last).all() and not (self._behind and t[0] > self._behind[-1][0]):
                self._shift_clock("rebooted", self._last + UNKNOWN_GAP_S - float(t[0]), float(rows[0, 0]))
        return rows

    def _put_in_order(self, sent: Floats, at_end: bool) -> Floats:
        """Return the rows (m, 12) whose stamps go on; hold or drop the others, and shift a clock that restarted."""
        self._waits = sent[:0]
        rows = sent.copy()
        rows[:, 0] += self._offset
        # nearly always all stamps go on
        step = np.diff(rows[:, 0], prepend=self._last)
        step[np.isinf(step)] = 0.5 * JUMP_S  # the very first
        if not self._behind and ((step > SAME_S) & (step <= JUMP_S)).all():
            self._last = float(rows[-1, 0]) if len(rows) else self._last
            return self._drop_outliers(rows, at_end)
        # else row by row
        taken = [np.empty((0, TAKEN))]
        for i, stamp in enumerate(sent[:, 0].tolist()):
            following = float(sent[i + 1, 0]) if i + 1 < len(sent) else None
            if following is None and not at_end and JUMP_S < stamp + self._offset - self._last < np.inf:
                self._waits = sent[i:]
                break
            row = np.append(stamp + self._offset, sent[i, 1:])
            for one in self._select(row, following is not None and following > stamp):
                self._last = float(one[0])
                taken.append(self._drop_outliers(one[None]))
        if at_end:
            self._drop_behind()
            taken.append(self._drop_outliers(rows[:0], at_end))
        return np.concatenate(taken)

    def _drop_outliers(self, rows: Floats, at_end: bool = False) -> Floats:
        """Return the good ones of rows in order, and of those that were held; leave the bad ones out."""
        first = self._taken - len(self._outliers.held)
        good, bad, place, sensor = self._outliers.split(rows, at_end)
        self._taken += len(rows) - int((sensor & BOTH_OUT == BOTH_OUT).sum())
        self._note_recent(good)
        # from the last one on, so that the number of each is that before any was left out
        for row, at, which in reversed([*zip(bad, (first + place).tolist(), sensor.tolist(), strict=True)]):
            self._left.extend(fingerprint_rows(restore_stamps(row[None], at, self._clocks)).tolist())
            gone = which & BOTH_OUT == BOTH_OUT
            self._clocks = [(begins - (gone and begins > at), offset) for begins, offset in self._clocks]
            for kind, of_it in (("gyr", GYR_OUT), ("acc", ACC_OUT), ("mag", MAG_OUT)):
                self._count(kind, int(which & of_it > 0), f"at t = {row[0]:.3f} s")
        return good

    def _note_recent(self, rows: Floats) -> None:
        """Note those of the last rows (n, 12) of which no sensor was bad."""
        self._recent.extend(rows[rows[:, COLUMNS] == 0, :COLUMNS][-AROUND:])

    def _select(self, row: Floats, is_followed: bool) -> list[Floats]:
        """Return the rows to use now: none, this one, or those that waited too; `is_followed` if a later stamp is next.

        Shifts the clock if the row shows a restart.
        """
        t = float(row[0])
        if t < self._last:
            return self._wait_for_restart(row)
        is_ahead = JUMP_S < t - self._last < np.inf
        kind = "repeated" if t - self._last <= SAME_S else "ahead"
        if kind == "repeated" or (is_ahead and not is_followed):
            self._count(kind, 1, f"at t = {t:.3f} s")
            self._leave_out([row])
            return []
        shift = 0.0
        if is_ahead and t - self._last > MAX_CLOCK_STEP_S:
            shift = self._last + UNKNOWN_GAP_S - t
            self._shift_clock("set", shift, t)
        self._drop_behind()
        return [np.append(row[0] + shift, row[1:])]

    def _wait_for_restart(self, row: Floats) -> list[Floats]:
        """Hold a row stamped before the last one; after `RESTART` in order shift the clock; return the rows to use."""
        if self._behind and row[0] <= self._behind[-1][0]:
            self._drop_behind()
        self._behind.append(row)
        if len(self._behind) < RESTART:
            return []
        t, first = float(row[0]), float(self._behind[0][0])
        recent = [*self._recent, *self._outliers.held][-AROUND:]
        if goes_on(np.array([*recent, *self._behind])[:, 1:7], len(recent), LEAP):
            kind, shift = "restart", self._last + (t - first) / (RESTART - 1) - first
            taken, self._behind = self._behind, []
        else:
            kind, shift = "rebooted", self._last + UNKNOWN_GAP_S - t
            taken, self._behind = [row], self._behind[:-1]
        self._shift_clock(kind, shift, t)
        return [np.append(one[0] + shift, one[1:]) for one in taken]

    def _drop_behind(self) -> None:
        """Leave out the rows before the last one that were held."""
        if self._behind:
            where = f"at t = {self._behind[0][0]:.3f} s, after {self._last:.3f} s"
            self._count("backward", len(self._behind), where)
            self._leave_out(self._behind)
            self._behind = []

    def _leave_out(self, rows: list[Floats]) -> None:
        """Note rows that were left out for their stamps, which are on the present clock."""
        self._left.extend(fingerprint_rows(restore_stamps(np.array(rows), self._taken, self._clocks)).tolist())

    def _shift_clock(self, kind: str, shift: float, t: float) -> None:
        """Set the clock on or back from the next sample on, which has stamp t."""
        words = f"{REMARKS[kind]}, at t = {t:.3f} s, after {self._last:.3f} s"
        words = f"{words}; from there on stamps are {_describe_shift(shift)}"
        self._remark(f"{words}.")
        self._changes += [words] * (len(self._changes) < MAX_CHANGES)
        self.counts[kind] += 1
        self._drop_behind()
        self._offset += shift
        self._clocks.append((self._taken, self._offset))

    def _check_units(self, rows: Floats) -> None:
        """Check the units of the first `CHECKED` samples, as of a file; not if a sensor hangs, or a magnet is near."""
        if self._to_check <= 0:
            return
        self._unchecked.append(rows[: self._to_check])
        self._to_check -= len(rows)
        if self._to_check > 0:
            return
        seen, self._unchecked = np.concatenate(self._unchecked), []
        acc, mag = seen[:, 1:4], seen[:, 7:10]
        period_s = median_period_s(seen[:, 0])
        problem = find_stamp_problem(period_s)
        low, high = np.array(PLAUSIBLE_G) * GRAVITY_M_S2
        if problem is None and not low < np.median(np.linalg.norm(acc, axis=1)) < high:
            problem = find_acc_problem(acc, period_s)
        strength = measure_field_strength(mag)
        is_field = (strength > FIELD_UT[0]) & (strength < FIELD_UT[1])
        if problem is None and not np.mean(is_field) > MIN_FIELD_SHARE:
            problem = find_mag_problem(mag)
        if problem is not None:
            raise RecordingError(f"{problem} (seen in the first {format_count(CHECKED, 'sample')}).")


class OutlierFilter:
    """Finds bad samples among rows (n, 11) of t, acc, gyr, mag; those of which it is not clear yet are `held`.

    Parameters
    ----------
    before : the last rows that passed, of which neither accelerometer nor gyroscope was bad.
    held : rows behind them.
    fields : the last rows that passed with a field.
    """

    def __init__(self, before: Floats = NOTHING, held: Floats = NOTHING, fields: Floats = NOTHING) -> None:
        self._before, self.held, self.fields = before[-outliers.AROUND - 1 :], held, fields

    def split(self, rows: Floats, at_end: bool = False) -> tuple[Floats, Floats, Ints, Ints]:
        """Judge rows in order of time that go on behind the last ones; at the end of a stream none is held.

        Returns
        -------
        good : (n, 12) rows that pass.
        bad : (m, 11) those that do not, or without one sensor, as they came.
        place : (m,) of each of the bad ones among the rows that were held and came.
        sensor : (m,) sum of `ACC_OUT`, `GYR_OUT` and `MAG_OUT`; of a row that does not pass the first two.
        """
        kept = -outliers.AROUND - 1
        seen, begin = np.concatenate([self._before, self.held, rows]), len(self._before)
        # accelerometer and gyroscope
        found, stop = scan_outliers(seen[:, 0].copy(), seen[:, 1:7].copy(), begin, at_end)
        # magnetometer, among its own samples
        there = begin + np.flatnonzero((found[begin:stop] != BOTH_OUT) & np.isfinite(seen[begin:stop, 7]))
        series, known = np.concatenate([self.fields, seen[there]]), len(self.fields)
        bad, until = scan_mag(series[:, 0].copy(), series[:, 7:10].copy(), known, at_end)
        found[there] += bad[known:]
        stop = int(there[until - known]) if until < len(series) else stop
        while not at_end and stop > begin and found[stop - 1] & BOTH_OUT:
            stop -= 1  # what it is bridged to is not judged yet
        # a line, or no field, in place of a bad sensor
        unread = found[:stop] & BOTH_OUT
        bridged = np.column_stack([seen[:stop], unread])
        interpolate_unread(bridged[:, 0], bridged[:, 1:4], bridged[:, 4:7], unread)
        bridged[(found[:stop] & MAG_OUT) > 0, 7:10] = np.nan
        # what passes, and what does not
        sensor = found[begin:stop]
        good, place = bridged[begin:][sensor & BOTH_OUT != BOTH_OUT], np.flatnonzero(sensor)
        bad_rows = seen[begin:stop][place]
        self._before = np.concatenate([self._before, good[good[:, COLUMNS] == 0, :COLUMNS]])[kept:]
        self.held = seen[stop:]
        self.fields = np.concatenate([self.fields, good[np.isfinite(good[:, 7]), :COLUMNS]])[kept:]
        return good, bad_rows, place, sensor[place]


def _describe_shift(shift: float) -> str:
    return f"set {'back' if shift < 0.0 else 'on'} by {abs(shift):.3f} s"
