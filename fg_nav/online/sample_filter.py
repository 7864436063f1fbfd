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

Between the rows before a walk was interrupted and those after nobody knows how long the sensor was off: a clock that
restarted there (`resume`) is never taken to go on with nothing missing. A clock that restarted and has already passed
the last stamp looks like a gap, and is taken for one.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.errors import RecordingError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.online.buffer import COLUMNS, TAKEN
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
}

NOTHING = np.empty((0, COLUMNS))


class SampleFilter:
    """Accepts what can be navigated with; `counts` holds how much of each kind of `REMARKS` there was.

    `remark` is called with one sentence the first time that something of a kind happens, and whenever the stamps are
    changed. Raises `RecordingError` from `accept`, if the samples are in a wrong unit.
    """

    def __init__(self, remark: Callable[[str], None] = lambda words: None) -> None:
        self.counts: Counter[str] = Counter()
        self._remark = remark
        # the clock: last stamp, the one before a gap, shift of the stamps, (sample, shift) of each change and its words
        self._last, self._before, self._offset = -np.inf, np.nan, 0.0
        self._clocks = [(0, 0.0)]
        self._changes: list[str] = []
        # rows that wait: before the last stamp (shifted), and far ahead (as sent)
        self._behind: list[Floats] = []
        self._waits = NOTHING
        # samples: how many, and the last ones that are not bad; whether none has passed since the walk was resumed
        self._taken, self._is_resumed = 0, False
        self._recent: deque[Floats] = deque(maxlen=AROUND)
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

    def resume(self) -> None:
        """Expect rows from after an interruption of unknown length."""
        self._is_resumed = True

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
        missing = int((~usable).sum())
        self._count("missing", missing, f"near t = {self._last:.3f} s" if np.isfinite(self._last) else "of all")
        # those whose stamps go on, and that are not bad
        rows = self._put_in_order(np.concatenate([self._waits, sent]), at_end)
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
            self._is_resumed &= not len(rows)
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
                self._last, self._is_resumed = float(one[0]), False
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
        if not self._is_resumed and goes_on(np.array([*recent, *self._behind])[:, 1:7], len(recent), LEAP):
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
            self._behind = []

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
    """Finds bad samples among rows (n, 11) of t, acc, gyr, mag; those of which it is not clear yet are `held`."""

    def __init__(self) -> None:
        self.held = NOTHING
        # The last rows that passed: of which neither accelerometer nor gyroscope was bad, and those with a field.
        self._before = self._fields = NOTHING

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
        series, known = np.concatenate([self._fields, seen[there]]), len(self._fields)
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
        self._fields = np.concatenate([self._fields, good[np.isfinite(good[:, 7]), :COLUMNS]])[kept:]
        return good, bad_rows, place, sensor[place]


def _describe_shift(shift: float) -> str:
    return f"set {'back' if shift < 0.0 else 'on'} by {abs(shift):.3f} s"
