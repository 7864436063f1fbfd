"""The intake of a stream: rows in blocks of any size in, judged samples out, whatever the blocks.

    rows as sent -> UnitMonitor -> FieldMonitor -> StampFilter -> OutlierFilter (`fg_nav.samples.readings`) -> samples

What a file would be refused for is left out here: a walk in progress goes on.

Units. A row is odd if no worn sensor gives it for long:

===== ==========================================================================================================
t     a step of more than `ODD_STEPS` periods, or less than one part in so many of one
acc   below `MIN_M_S2` or above `MAX_M_S2`: gravity is in it but in free fall, so this is g, or mg
gyr   above `TOO_FAST_RAD_S`: deg/s
mag   no field on Earth, and `ANOTHER` times stronger or weaker than that of the walk: mG, gauss, nT, T
===== ==========================================================================================================

Odd rows wait, and what follows them, until few enough of these are odd: a gap, an impact, a wrong sample. They are in
another unit if for `HELD_S` more than a part of `SHARES` of them is odd. At the beginning that is refused: stamps show
their unit in the first rows, force in the first second, rate in the first strides, force and field by their medians
over `CHECKED` samples. Midway rows are left out until a second of them is that of walking in the right units. A
gyroscope that hardly turns while its wearer walks is found in windows, and remarked. Of another field the field alone
is left out, at once: the strength of the walk's field is the median of those of its newest windows.

================================= ==========================================================================
missing (NaN, empty, no range)    left out
bad samples                       found as in a file; one of which one sensor is bad is bridged by a line, others are
                                  left out
stamp as the one before           left out
stamp before the last one         waits, and is left out; but after `RESTART` of them in order the clock has restarted,
                                  and its stamps are shifted: where force and rate go on (a counter that began again)
                                  those that wait go on from the last one, and else the newest does, after a gap of
                                  `UNKNOWN_GAP_S`
stamp more than `JUMP_S` ahead    waits for the next: left out if that one is back in line, or never comes
gap of more than `MAX_GAP_S`      remarked, and as long as it is; the estimator widens the sigmas across it
more than `MAX_CLOCK_STEP_S`      a clock that was set: a gap of `UNKNOWN_GAP_S`, and stamps from there on set back
================================= ==========================================================================

A sample at which a run of bad ones may begin, far from the one before, is held until `LOOK_AHEAD` more are there. A
clock that restarted while a walk was interrupted (`resume`) is never taken to go on with nothing missing. A clock that
restarted and has passed the last stamp already is taken for a gap.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.errors import RecordingError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.samples.plausibility import (
    LIVELY_M_S2,
    TOO_FAST_RAD_S,
    TOO_SLOW_RAD_S,
    find_acc_problem,
    find_field_samples,
    find_gyr_problem,
    find_mag_problem,
    find_squarable,
    find_stamp_problem,
    find_time_unit,
    find_usable_samples,
    is_field_on_earth,
    keep_air,
    measure_field_strength,
    median_period_s,
)
from fg_nav.samples.readings import ACC_OUT, BOTH_OUT, COLUMNS, GYR_OUT, LONGEST, MAG_OUT, OutlierFilter, scan_outliers
from fg_nav.samples.stamps import AROUND, JUMP_S, MAX_GAP_S, SAME_S, goes_on
from fg_nav.text import format_count

LEAP = 1.5  # times the largest change around: less than within a file, for behind a restart anything may have happened
RESTART = 100  # stamps before the last one that follow each other: not a delayed block, but a clock that restarted
MAX_CLOCK_STEP_S = 86400.0  # a longer step is a clock that was set, from 1970 or from when the sensor was switched on
UNKNOWN_GAP_S = 60.0  # assumed for an unknown gap: a sensor is switched off and on in less; the heading is lost in it
MAX_NOTES = 20  # changes that are noted one by one

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

FIRST, NOT_ADVANCING = 20, 1000  # rows that show the unit of stamps; rows whose stamps never rise
ODD_STEPS, MIN_ODD_S = 100.0, 0.2  # units of time are 1000 apart; a shorter step is a few lost samples of a slow sensor
MIN_STEP_S = 1e-5  # rows that a radio sends at once are stamped 50 us apart; no sensor is as fast
MIN_M_S2, MAX_M_S2 = 2.0, 500.0  # a foot swings with 4 to 30 m/s^2, and lands with 160
SHARES = np.array([0.5, 0.5, 0.05])  # odd steps; odd force, free fall being over within 1 s; rate of the fastest turn
HELD_S, HELD = 1.0, 100  # and so many rows at least
SLOW_S, SLOW = 5.0, 10  # so many steps over so long show stamps alone: a radio sends its rows at once, a gap is one
CHECKED = 1000  # samples, some seconds, whose medians show the units of force and field
PLAUSIBLE_G, MIN_FIELD_SHARE = (0.7, 2.0), 0.05  # median force on a foot; part that is a field on Earth, magnet or not
WINDOW, IN_A_ROW = 200, 3  # rows of a window, and windows that agree
MAX_WINDOWS = 32  # of which the field is kept: a minute at 100 Hz, so a beginning beside iron is forgotten
ANOTHER = 5.0  # within buildings the field at a foot varies by a factor of two or three
WHAT_TO_DO = "correct it at the sender, or say its unit in --columns, such as acc=ax:ay:az[g]"
MAG, STAMP_AND_MAG = slice(7, 10), (0, 7, 8, 9)  # columns


class Intake:
    """Passes the samples of a stream that can be navigated with; `counts` and remarks each kind of `REMARKS`."""

    def __init__(self, remark: Callable[[str], None] = lambda words: None) -> None:
        self.counts: Counter[str] = Counter()
        self._remark, self._changes = remark, list[str]()
        self._units, self._field = UnitMonitor(self._note), FieldMonitor(self._note)
        self._stamps, self._outliers = StampFilter(self._count, self._note), OutlierFilter()
        self._newest = np.nan  # stamp of the last sample that passed

    def push(self, rows: Floats, at_end: bool = False) -> Floats:
        """Return the samples (m, 12) to use, of rows (n, 11) as they were sent and of those that waited.

        Columns are those of `COLUMNS`, and behind them which sensor was bad; `at_end` no row waits any more. Raises
        `RecordingError` where the first seconds show that a unit is wrong.
        """
        rows = self._field.push(self._units.push(rows, at_end))
        # missing readings
        usable = find_usable_samples(rows[:, 0], rows[:, 1:4], rows[:, 4:7])
        where = "of all" if np.isnan(self._newest) else f"near t = {self._newest:.3f} s"
        self._count("missing", int((~usable).sum()), where)
        rows = rows[usable]
        rows[~find_field_samples(rows[:, MAG]), MAG] = np.nan
        air = keep_air(rows[:, 10])
        rows[:, 10] = np.nan if air is None else air
        # stamps that go on, and readings that fit those around
        rows, bad = self._outliers.push(self._stamps.push(rows, at_end), at_end)
        for kind, sensor in (("gyr", GYR_OUT), ("acc", ACC_OUT), ("mag", MAG_OUT)):
            of_it = bad[bad[:, COLUMNS].astype(np.int64) & sensor > 0, 0]
            self._count(kind, len(of_it), f"at t = {of_it[0]:.3f} s" if len(of_it) else "")
        # gaps between them
        if len(rows):
            step = np.diff(rows[:, 0], prepend=rows[0, 0] if np.isnan(self._newest) else self._newest)
            self._newest = float(rows[-1, 0])
            gap, first = step > MAX_GAP_S, int(np.argmax(step > MAX_GAP_S))
            self._count("gap", int(gap.sum()), f"of {step[first]:.2f} s before t = {rows[first, 0]:.3f} s")
        return rows

    def resume(self) -> None:
        """Expect rows from after an interruption of unknown length."""
        self._stamps.is_resumed = True

    @property
    def clock_shift_s(self) -> float:
        """By how much the present stamps are set on from those of the sensor."""
        return self._stamps.shifts[-1][1]

    def sensor_time(self, t: float) -> float:
        """Return the stamp, s, that the sensor gave a sample whose stamp is now t."""
        return t - next(shift for begin, shift in reversed(self._stamps.shifts) if begin <= t + 0.5 * SAME_S)

    @property
    def notes(self) -> tuple[str, ...]:
        """What was left out or odd, in words, changes up to `MAX_NOTES` times."""
        notes = [f"{number} times: {REMARKS[kind]}" for kind, number in self.counts.items()] + self._changes
        if self.clock_shift_s:
            notes.append(f"at the end stamps are {_describe_shift(self.clock_shift_s)} from those of the sensor")
        if self._field.left_out:
            notes.append(f"{format_count(self._field.left_out, 'field')} of another strength than before left out")
        return tuple(notes)

    def _note(self, words: str) -> None:
        """Remark and note a change of units or stamps."""
        self._remark(f"{words}.")
        self._changes += [words] * (len(self._changes) < MAX_NOTES)

    def _count(self, kind: str, number: int, where: str = "") -> None:
        """Count samples of a kind; remark the first unless it is a change, which is noted by itself."""
        if number and where and not self.counts[kind]:
            self._remark(f"{REMARKS[kind]}, the first {where}.")
        if number:
            self.counts[kind] += number


class StampFilter:
    """Passes rows (n, 11) whose stamps go on, and shifts those of a clock that restarted or was set.

    `count` is called with a kind of `REMARKS`, how many rows are of it, and where; `note` with words on a change.
    `shifts` are the stamps from which on, shifted, they are set on, and by how much, s.
    """

    def __init__(self, count: Callable[[str, int, str], None], note: Callable[[str], None]) -> None:
        self._count, self._note = count, note
        self.shifts, self.is_resumed = [(-np.inf, 0.0)], False  # whether none has passed since the walk was resumed
        self._last = -np.inf
        self._recent: deque[Floats] = deque(maxlen=AROUND + LONGEST)  # rows that passed
        # rows that wait: before the last stamp (shifted), and far ahead (as sent)
        self._behind: list[Floats] = []
        self._waits = np.empty((0, COLUMNS))

    def push(self, rows: Floats, at_end: bool = False) -> Floats:
        """Return the rows to use, of these and of those that waited; `at_end` none waits any more."""
        sent = np.concatenate([self._waits, rows])
        self._waits = sent[:0]
        rows = sent.copy()
        rows[:, 0] += self.shifts[-1][1]
        # nearly always all stamps go on
        step = np.diff(rows[:, 0], prepend=self._last)
        step[np.isinf(step)] = 0.5 * JUMP_S  # the very first
        if not self._behind and ((step > SAME_S) & (step <= JUMP_S)).all():
            return self._accept(rows)
        # else row by row
        taken = [rows[:0]]
        for i, stamp in enumerate(sent[:, 0].tolist()):
            following = float(sent[i + 1, 0]) if i + 1 < len(sent) else None
            t = stamp + self.shifts[-1][1]
            is_ahead = JUMP_S < t - self._last < np.inf
            if is_ahead and following is None and not at_end:
                self._waits = sent[i:]
                break
            row, found = np.append(t, sent[i, 1:]), rows[:0]
            if t < self._last:
                found = self._wait_for_restart(row)
            elif t - self._last <= SAME_S:
                self._count("repeated", 1, f"at t = {t:.3f} s")
            elif is_ahead and (following is None or following <= stamp):
                self._count("ahead", 1, f"at t = {t:.3f} s")
            else:
                self._drop_behind()
                is_set = is_ahead and t - self._last > MAX_CLOCK_STEP_S
                found = self._shift("set", self._last + UNKNOWN_GAP_S - t, row[None]) if is_set else row[None]
            taken.append(self._accept(found))
        if at_end:
            self._drop_behind()
        return np.concatenate(taken)

    def _accept(self, rows: Floats) -> Floats:
        """Return rows that are passed, and keep what the next are compared with."""
        if len(rows):
            self._last, self.is_resumed = float(rows[-1, 0]), False
            self._recent.extend(rows[-AROUND - LONGEST :])
        return rows

    def _wait_for_restart(self, row: Floats) -> Floats:
        """Hold a row stamped before the last one; after `RESTART` in order shift the clock; return the rows to use."""
        if self._behind and row[0] <= self._behind[-1][0]:
            self._drop_behind()
        self._behind.append(row)
        if len(self._behind) < RESTART:
            return row[None][:0]
        t, behind = float(row[0]), np.array(self._behind)
        # the last rows before it that are no outliers
        before = np.array(self._recent)
        before = before[scan_outliers(before[:, 0].copy(), before[:, 1:7].copy(), 0, True)[0] & BOTH_OUT == 0][-AROUND:]
        around = np.concatenate([before, behind])[:, 1:7]
        if not self.is_resumed and goes_on(around, len(before), LEAP):
            self._behind = []
            first = float(behind[0, 0])
            return self._shift("restart", self._last + (t - first) / (RESTART - 1) - first, behind)
        self._behind = self._behind[:-1]
        self._drop_behind()
        return self._shift("rebooted", self._last + UNKNOWN_GAP_S - t, row[None])

    def _drop_behind(self) -> None:
        """Leave out the rows before the last one that were held."""
        if self._behind:
            where = f"at t = {self._behind[0][0]:.3f} s, after {self._last:.3f} s"
            self._count("backward", len(self._behind), where)
            self._behind = []

    def _shift(self, kind: str, shift: float, rows: Floats) -> Floats:
        """Set the clock on or back from these rows on, and return them."""
        where = f"at t = {rows[-1, 0]:.3f} s, after {self._last:.3f} s"
        self._note(f"{REMARKS[kind]}, {where}; from there on stamps are {_describe_shift(shift)}")
        self._count(kind, 1, "")
        rows = np.column_stack([rows[:, 0] + shift, rows[:, 1:]])
        self.shifts.append((float(rows[0, 0]), self.shifts[-1][1] + shift))
        return rows


def _describe_shift(shift: float) -> str:
    return f"set {'back' if shift < 0.0 else 'on'} by {abs(shift):.3f} s"


class UnitMonitor:
    """Passes rows (n, 11) in s, m/s^2 and rad/s; `note` is called with words on those that are left out."""

    def __init__(self, note: Callable[[str], None]) -> None:
        self._note = note
        self._period_s, self._last = np.nan, np.nan  # of the first stamps; stamp of the last row that was judged
        self._held = np.empty((0, COLUMNS))
        self._was_right = self._is_wrong = False  # whether walking in these units was seen; whether rows are left out
        self._window, self._slow = self._held, 0
        self._first: list[Floats] | None = []

    def push(self, rows: Floats, at_end: bool = False) -> Floats:
        """Return the rows to use, of these and of those that waited; raises `RecordingError` for a wrong first unit."""
        rows = np.concatenate([self._held, rows])
        self._held = rows[:0]
        if np.isnan(self._period_s) and not self._find_period(rows[:, 0]) and not at_end:
            self._held = rows
            return rows[:0]
        # NaN is not odd, nor is a force of zero, which is none
        t = np.where(np.isfinite(rows[:, 0]), rows[:, 0], np.nan)
        step, period_s = np.diff(t, prepend=self._last), self._period_s
        force, rate = _norm(rows[:, 1:4]), _norm(rows[:, 4:7])
        jumps = (step > max(ODD_STEPS * period_s, MIN_ODD_S)) | ((step > 0.0) & (step < period_s / ODD_STEPS))
        odd = np.column_stack([jumps, ((force > 0.0) & (force < MIN_M_S2)) | (force > MAX_M_S2), rate > TOO_FAST_RAD_S])
        n = max(HELD, round(HELD_S / period_s)) if period_s > 0.0 else HELD
        taken, begin, is_odd = [rows[:0]], 0, np.asarray(odd.any(axis=1))
        while begin < len(rows):
            # what goes on as before, up to the first odd row
            if not self._is_wrong:
                first = begin + int(np.argmax(is_odd[begin:])) if is_odd[begin:].any() else len(rows)
                taken.append(self._check_accepted(rows[begin:first]))
                begin = first
            # a piece, until few enough are odd, or long enough to show another unit
            piece = odd[begin : begin + n]
            share = np.cumsum(piece, axis=0) / np.arange(1, len(piece) + 1)[:, None]
            few = np.asarray((share <= SHARES).all(axis=1))
            # rows that have become rare take minutes to fill a piece: their steps alone are judged
            slow = (share[:, 0] > SHARES[0]) & (t[begin : begin + n] - t[begin : begin + 1] > SLOW_S)
            slow[: SLOW - 1] = False
            at = int(np.argmax(np.append(slow, True)))
            is_slow = at < len(piece) and not self._is_wrong and not few[:at].any()
            is_passing = bool(few.any()) and not self._is_wrong and not is_slow
            stop = begin + (at + 1 if is_slow else int(np.argmax(few)) + 1 if is_passing else n)
            if begin == len(rows) or (stop > len(rows) and not at_end):
                self._held = rows[begin:]
                break
            if self._is_wrong:
                if (share[-1] <= SHARES.min()).all() and _judge_walking(rows[begin:stop]) == "right":
                    self._is_wrong = False
                    self._note(f"from t = {rows[begin, 0]:.3f} s on units are as before, and rows taken again")
            elif is_slow or (not is_passing and len(piece) >= HELD):
                before = float(t[begin - 1]) if begin else self._last
                is_wrong = np.array([True, False, False]) if is_slow else share[-1] > SHARES
                self._find_change(rows[begin:stop], is_wrong, before)
            taken.append(rows[:0] if self._is_wrong else self._check_accepted(rows[begin:stop]))
            begin = min(stop, len(rows))
        self._last = float(t[begin - 1]) if begin else self._last
        return np.concatenate(taken)

    def _find_period(self, t: Floats) -> bool:
        """Whether the period is known by stamps (n,); refuse those of another unit."""
        known = t[np.isfinite(t)][: NOT_ADVANCING if len(t) >= NOT_ADVANCING else FIRST]
        period_s = median_period_s(known)
        if (len(known) >= NOT_ADVANCING and np.isnan(period_s)) or (len(known) >= FIRST and period_s < MIN_STEP_S):
            raise RecordingError(f"{find_stamp_problem(period_s)}.")
        if len(known) < FIRST or np.isnan(period_s):
            return len(t) >= NOT_ADVANCING  # of which hardly any has a stamp: they are missing
        if find_time_unit(period_s) not in ("s", None):
            raise RecordingError(f"{find_stamp_problem(period_s)}, or name the unit in --columns.")
        self._period_s = period_s
        return True

    def _find_change(self, rows: Floats, is_wrong: Bools, before: float) -> None:
        """Refuse rows in another unit, stamps, force or rate (3,); note it if they were right before."""
        step = median_period_s(rows[:, 0])
        usable = rows[np.isfinite(rows[:, 1:7]).all(axis=1)]
        acc, gyr = usable[:, 1:4], usable[:, 4:7]
        other = f"the stamps step by {step:.3g} s and not by {self._period_s:.3g} as before"
        stamps = find_stamp_problem(step) or other
        force = find_acc_problem(acc, self._period_s) or "acc has no gravity in it for a second"
        rate = find_gyr_problem(acc, gyr, np.nan) or "gyr is faster than a limb turns for a second"
        problem = " and ".join(np.array([stamps, force, rate])[is_wrong])
        if is_wrong[1:].any() and not self._was_right:
            raise RecordingError(f"{problem} (t = {rows[0, 0]:.3f} to {rows[-1, 0]:.3f} s): {WHAT_TO_DO}.")
        self._note(f"{problem}: rows after t = {before:.3f} s are left out, until this is over")
        self._is_wrong = True

    def _check_accepted(self, rows: Floats) -> Floats:
        """Return accepted rows; refuse them where they show another unit in the long run."""
        # the first samples, by their medians: not if a sensor hangs, or a magnet is near
        if self._first is not None:
            self._first.append(rows[find_usable_samples(rows[:, 0], rows[:, 1:4], rows[:, 4:7])])
            if sum(map(len, self._first)) >= CHECKED:
                _check_first(np.concatenate(self._first)[:CHECKED])
                self._first = None
        # windows in which the sensor walks, and its gyroscope turns
        self._window = np.concatenate([self._window, rows])
        while len(self._window) >= WINDOW:
            window, self._window = self._window[:WINDOW], self._window[WINDOW:]
            found = _judge_walking(window)
            self._was_right |= found == "right"
            self._slow = self._slow + 1 if found == "slow" else 0
            if self._slow == IN_A_ROW:
                words = (
                    f"gyr turns by less than {TOO_SLOW_RAD_S:g} rad/s while acc is that of walking, up to t = "
                    f"{window[-1, 0]:.1f} s: multiply it by 57.2958 if it was taken for deg/s, else the gyroscope is "
                    "broken"
                )
                if not self._was_right:
                    raise RecordingError(f"{words}.")
                self._note(f"{words}, and the track is not to be used from there on")
        return rows


def _check_first(rows: Floats) -> None:
    """Refuse the first `CHECKED` samples (n, 11) in a wrong unit, or without gravity."""
    acc, mag = rows[:, 1:4], np.where(find_field_samples(rows[:, MAG])[:, None], rows[:, MAG], np.nan)
    period_s = median_period_s(rows[:, 0])
    problem = find_stamp_problem(period_s)
    low, high = np.array(PLAUSIBLE_G) * GRAVITY_M_S2
    if problem is None and not low < np.median(np.linalg.norm(acc, axis=1)) < high:
        problem = find_acc_problem(acc, period_s)
    if problem is None and not np.mean(is_field_on_earth(measure_field_strength(mag))) > MIN_FIELD_SHARE:
        problem = find_mag_problem(mag)
    if problem is not None:
        raise RecordingError(f"{problem} (seen in the first {format_count(len(rows), 'sample')}).")


def _judge_walking(rows: Floats) -> str:
    """Return "right" for rows of walking in m/s^2 and rad/s, "slow" if the gyroscope hardly turns, "" for others."""
    there = rows[find_squarable(rows[:, 1:7])]
    if 2 * len(there) < len(rows):
        return ""
    force = _norm(there[:, 1:4])
    if not (float(np.std(force)) > LIVELY_M_S2 and MIN_M_S2 < float(np.median(force)) < MAX_M_S2):
        return ""
    rate = _norm(rows[:, 4:7])
    fastest = float(np.quantile(rate[np.isfinite(rate)], 0.99))
    if fastest < TOO_SLOW_RAD_S:
        return "slow"
    return "right" if TOO_SLOW_RAD_S < fastest < TOO_FAST_RAD_S else ""


def _norm(vectors: Floats) -> Floats:
    with np.errstate(over="ignore"):
        return np.asarray(np.linalg.norm(vectors, axis=1))


class FieldMonitor:
    """Passes rows (n, 11), in another unit than before without their field, `left_out` so far."""

    def __init__(self, note: Callable[[str], None]) -> None:
        self._note = note
        self.left_out = 0
        self._strengths_uT: deque[float] = deque(maxlen=MAX_WINDOWS)  # of the newest windows with a field on Earth
        self._usual_uT = np.nan
        self._window = np.empty((0, len(STAMP_AND_MAG)))  # of the rows that have a field
        self._others, self._is_wrong = 0, False

    def push(self, rows: Floats) -> Floats:
        """Return rows (n, 11) with NaN in place of a field that is in another unit."""
        taken = [rows[:0]]
        while len(rows):
            # up to the end of a window all are judged by the same strength
            strength = measure_field_strength(rows[:, MAG])
            sensed = np.flatnonzero(strength > 0.0)[: WINDOW - len(self._window)]
            self._window = np.concatenate([self._window, rows[sensed][:, STAMP_AND_MAG]])
            stop = int(sensed[-1]) + 1 if len(self._window) == WINDOW else len(rows)
            part, odd = rows[:stop], self._find_odd(strength[:stop])
            if odd.any():
                part = part.copy()
                part[odd, MAG] = np.nan
                self.left_out += int(odd.sum())
            taken.append(part)
            rows = rows[stop:]
            if len(self._window) == WINDOW:
                self._check_window(self._window)
                self._window = self._window[:0]
        return np.concatenate(taken)

    def _find_odd(self, strength: Floats) -> Bools:
        """Return flags (n,) of fields in another unit; none before the strength of the walk is known."""
        far = (strength > ANOTHER * self._usual_uT) | ((strength < self._usual_uT / ANOTHER) & (strength > 0.0))
        return np.asarray(far & ~is_field_on_earth(strength))

    def _check_window(self, window: Floats) -> None:
        """Compare the unit of a full window of rows (n, 4) with that of those before; note where it has changed."""
        strength = measure_field_strength(window[:, 1:])
        is_odd = 2 * int(self._find_odd(strength).sum()) > len(window)
        # its strength counts as that of the walk if it is one on Earth, and much as before
        median_uT = float(np.median(strength))
        is_other = self._is_wrong or not self._usual_uT / ANOTHER < median_uT < self._usual_uT * ANOTHER
        if is_field_on_earth(median_uT) and not (is_other and len(self._strengths_uT) == MAX_WINDOWS):
            self._strengths_uT.append(median_uT)
            self._usual_uT = float(np.median(self._strengths_uT))
        # the unit has changed if some windows agree
        self._others = self._others + 1 if is_odd != self._is_wrong else 0
        if self._others < IN_A_ROW:
            return
        self._others, self._is_wrong = 0, is_odd
        since = f"from about t = {window[0, 0]:.1f} s"
        if is_odd:
            problem = find_mag_problem(window[:, 1:], self._usual_uT) or "mag is no field on Earth"
            self._note(f"{problem}: {since} on it is left out, until this is over")
        else:
            self._note(f"{since} on mag is as before, and taken again")
