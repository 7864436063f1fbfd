"""Rows whose stamps, force or rate are not in s, m/s^2 and rad/s: refused, or left out where that changes midway.

A row is odd if no sensor that is worn gives it for long:

===== ==========================================================================================================
t     a step of more than `ODD_STEPS` periods, or less than one part in so many of one
acc   below `MIN_M_S2` or above `MAX_M_S2`: gravity is in it but in free fall, so this is g, or mg
gyr   above `MAX_RAD_S`, faster than a limb turns: deg/s
mag   no field on Earth, and `ANOTHER` times stronger or weaker than that of the walk: mG, gauss, nT, T
===== ==========================================================================================================

Odd rows wait, and what follows them. They are accepted as soon as few enough of these are odd: a gap, an impact, a
sample that is wrong. They are in another unit if `STAMPS` steps in a row are odd and even, or for `HELD_S` more than a
part of `SHARES` of the rows is odd. Stamps show their unit in the first rows, before anything is accepted; force in the
first second, rate in the first strides. If that is so from the beginning the walk is refused; midway it is a sensor
that restarts as another program set it up: what is wrong is left out, until it is right again.

The other way round, a gyroscope that hardly turns while its wearer walks, is found in windows, and remarked.

Of a magnetometer in another unit than before the field alone is left out, at once, so that none of it is compared with
what was before. The strength of the field of a walk is the median of those of its newest windows, `MAX_WINDOWS` at
most, each the median of `WINDOW` rows, if that is one on Earth. Units are a factor of ten or more apart, and iron
beside the way is seldom as strong, and not there for long. It is remarked if half of the rows of `IN_A_ROW` windows are
odd, with the unit that makes the usual field of them, if there is one.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.errors import RecordingError
from fg_nav.online.buffer import COLUMNS
from fg_nav.samples.plausibility import (
    find_acc_problem,
    find_gyr_problem,
    find_mag_problem,
    find_squarable,
    find_stamp_problem,
    find_time_unit,
    is_field_on_earth,
    measure_field_strength,
    median_period_s,
)
from fg_nav.text import format_count

FIRST = 20  # rows that show the unit of stamps
NOT_ADVANCING = 1000  # rows whose stamps never rise
ODD_STEPS, MIN_ODD_S = 100.0, 0.2  # units of time are 1000 apart; a shorter step is a few lost samples of a slow sensor
MIN_STEP_S = 1e-5  # rows that a radio sends at once are stamped 50 us apart; no sensor is as fast
STAMPS, EVEN = 10, 0.5  # steps in a row, and their deviation from the median: alike in another unit, not if broken
MIN_M_S2, MAX_M_S2 = 2.0, 500.0  # a foot swings with 4 to 30 m/s^2, and lands with 160
MAX_RAD_S = 40.0  # no limb turns faster than 2300 deg/s
SHARES = np.array([0.5, 0.05])  # of odd force, free fall being over within 1 s; of odd rate, as for the fastest turn
HELD_S, HELD = 1.0, 100  # and so many rows at least
WINDOW, IN_A_ROW = 200, 3  # rows of a window, and windows that agree
LIVELY_M_S2, SLOW_RAD_S = 2.0, 0.3  # who walks shakes the sensor by more, and turns it faster for 1 sample in 100
MAX_NOTES = 20  # changes that are noted one by one
WHAT_TO_DO = "correct it at the sender, or say its unit in --columns, such as acc=ax:ay:az[g]"

MAG, STAMP_AND_MAG = slice(7, 10), (0, 7, 8, 9)  # columns
MAX_WINDOWS = 32  # of which the strength is kept: a minute at 100 Hz, so a beginning beside iron is forgotten
ANOTHER = 5.0  # within buildings the field at a foot varies by a factor of two or three


class StampMonitor:
    """Holds rows (n, 11) until their stamps are known to be in s; `period_s` is that of the first ones."""

    def __init__(self, note: Callable[[str], None]) -> None:
        self.period_s = np.nan
        self._note = note
        self._held = np.empty((0, COLUMNS))
        self._last = np.nan
        self._is_wrong = False

    def accept(self, rows: Floats, at_end: bool = False) -> Floats:
        """Return the rows to use, of these and of those that waited.

        Raises `RecordingError` if the first stamps are not in s.
        """
        rows = np.concatenate([self._held, rows])
        self._held = rows[:0]
        if np.isnan(self.period_s) and not self._find_period(rows[:, 0]) and not at_end:
            self._held = rows
            return rows[:0]
        t = np.where(np.isfinite(rows[:, 0]), rows[:, 0], np.nan)
        step = np.diff(t, prepend=self._last)
        odd = (step > max(ODD_STEPS * self.period_s, MIN_ODD_S)) | ((step > 0.0) & (step < self.period_s / ODD_STEPS))
        if not self._is_wrong and not odd.any():
            self._last = float(t[-1]) if len(t) else self._last
            return rows
        # Row by row; those at the end of which it is not clear yet are held.
        taken: list[Floats] = []
        begins = 0  # of the rows that wait
        for i in range(len(rows)):
            if odd[i] == self._is_wrong:  # as the rows before
                taken += [] if self._is_wrong else list(rows[begins : i + 1])
                begins = i + 1
            elif i + 1 - begins > STAMPS:
                taken += self._decide(rows[begins : i + 1], float(t[begins - 1]) if begins else self._last)
                begins = i + 1
        waits = rows[begins:]
        if at_end:
            return np.array([*taken, *([] if self._is_wrong else waits)]).reshape(-1, COLUMNS)
        self._held = waits
        self._last = self._last if begins == 0 else float(t[begins - 1])
        return np.array(taken).reshape(-1, COLUMNS)

    def _find_period(self, t: Floats) -> bool:
        """Whether the period is known by stamps (n,); refuse those of another unit."""
        known = t[np.isfinite(t)][: NOT_ADVANCING if len(t) >= NOT_ADVANCING else FIRST]
        period_s = median_period_s(known)
        if len(known) >= NOT_ADVANCING and np.isnan(period_s):
            raise RecordingError(f"{find_stamp_problem(period_s)}.")
        if len(known) < FIRST or np.isnan(period_s):
            return len(t) >= NOT_ADVANCING  # of which hardly any has a stamp: they are missing
        if period_s < MIN_STEP_S:
            raise RecordingError(f"{find_stamp_problem(period_s)}.")
        if find_time_unit(period_s) not in ("s", None):
            raise RecordingError(f"{find_stamp_problem(period_s)}, or name the unit in --columns.")
        self.period_s = period_s
        return True

    def _decide(self, rows: Floats, before: float) -> list[Floats]:
        """Decide on rows with stamps unlike those up to `before`; return which to use."""
        step = np.diff(rows[:, 0])
        is_unit = bool((np.abs(step - np.median(step)) < EVEN * np.median(step)).all())
        if not self._is_wrong and not is_unit:
            return list(rows)
        self._is_wrong = not self._is_wrong
        if not self._is_wrong:
            self._note(f"from t = {rows[0, 0]:.3f} s on the stamps are as before, and taken again")
            return list(rows)
        problem = find_stamp_problem(float(np.median(step)))
        words = problem or f"the stamps step by {np.median(step):.3g} s and not by {self.period_s:.3g} as before"
        self._note(f"{words}: rows after t = {before:.3f} s are left out, until this is over")
        return []


class FieldMonitor:
    """Leaves out the field of rows in another unit than before, `left_out` so far, whatever the blocks they come in."""

    def __init__(self, note: Callable[[str], None]) -> None:
        self._note = note
        self.left_out = 0
        self._strengths_uT: deque[float] = deque(maxlen=MAX_WINDOWS)  # of the newest windows with a field on Earth
        self._usual_uT = np.nan
        self._window = np.empty((0, len(STAMP_AND_MAG)))  # of the rows that have a field
        self._others, self._is_wrong = 0, False

    def accept(self, rows: Floats) -> Floats:
        """Return rows (n, 11) with NaN in place of a field that is in another unit."""
        taken = [np.empty((0, COLUMNS))]
        while len(rows):
            # up to the end of a window all are judged by the same strength
            sensed = np.flatnonzero(_measure_strength(rows[:, MAG]) > 0.0)[: WINDOW - len(self._window)]
            self._window = np.concatenate([self._window, rows[sensed][:, STAMP_AND_MAG]])
            is_full = len(self._window) == WINDOW
            stop = int(sensed[-1]) + 1 if is_full else len(rows)
            part, rows = rows[:stop], rows[stop:]
            odd = self._find_odd(_measure_strength(part[:, MAG]))
            if odd.any():
                part = part.copy()
                part[odd, MAG] = np.nan
                self.left_out += int(odd.sum())
            taken.append(part)
            if is_full:
                self._check_window(self._window)
                self._window = self._window[:0]
        return np.concatenate(taken)

    def _find_odd(self, strength: Floats) -> Bools:
        """Return flags (n,) of fields in another unit; none before the strength of the walk is known."""
        far = (strength > ANOTHER * self._usual_uT) | (strength < self._usual_uT / ANOTHER)
        return np.asarray(far & ~is_field_on_earth(strength))

    def _check_window(self, window: Floats) -> None:
        """Compare the unit of a full window of rows (n, 4) with that of those before."""
        strength, mag = _measure_strength(window[:, 1:]), window[:, 1:]
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
            problem = find_mag_problem(mag, self._usual_uT) or "mag is no field on Earth"
            self._note(f"{problem}: {since} on it is left out, until this is over")
        else:
            self._note(f"{since} on mag is as before, and taken again")


class UnitMonitor:
    """Accepts rows in s, m/s^2, rad/s and uT; `remark` is called with a sentence where rows are left out, and again."""

    def __init__(self, remark: Callable[[str], None]) -> None:
        self._notes: list[str] = []
        self._remark = remark
        self._stamps, self._field = StampMonitor(self._note), FieldMonitor(self._note)
        self._held = np.empty((0, COLUMNS))
        self._window = np.empty((0, COLUMNS))
        self._was_right = self._is_wrong = False
        self._slow = 0

    @property
    def notes(self) -> tuple[str, ...]:
        """What was left out, in words, up to `MAX_NOTES` times, and of how many fields."""
        fields = format_count(self._field.left_out, "field")
        odd = (f"{fields} of another strength than before left out",) * (self._field.left_out > 0)
        return (*self._notes, *odd)

    def accept(self, rows: Floats, at_end: bool = False) -> Floats:
        """Return the rows (m, 11) to use, of these and of those that waited; `at_end` none waits any more.

        Raises `RecordingError` if the first rows are in another unit.
        """
        rows = np.concatenate([self._held, self._stamps.accept(rows, at_end)])
        self._held = rows[:0]
        # NaN is not odd, nor is a force of zero, which is none
        force, rate = _norm(rows[:, 1:4]), _norm(rows[:, 4:7])
        odd = np.column_stack([((force > 0.0) & (force < MIN_M_S2)) | (force > MAX_M_S2), rate > MAX_RAD_S])
        if not self._is_wrong and not odd.any():
            self._check_windows(rows)
            return self._field.accept(rows)
        # piece by piece
        taken, begins = [rows[:0]], 0
        while begins < len(rows):
            first, stop = self._find_piece(odd, begins, at_end)
            taken.append(rows[begins:first])
            self._check_windows(rows[begins:first])
            if stop is None:
                self._held = rows[first:]
                break
            taken.append(self._judge(rows[first:stop], odd[first:stop]))
            begins = stop
        return self._field.accept(np.concatenate(taken))

    def _find_piece(self, odd: Bools, begins: int, at_end: bool) -> tuple[int, int | None]:
        """Return the rows [first, stop) of the next piece to judge; `stop` is None where it needs more rows.

        Of rows that are right a piece begins with an odd one, and ends once few enough are; of others it is all `HELD`.
        """
        n = max(HELD, round(HELD_S / self._stamps.period_s)) if self._stamps.period_s > 0.0 else HELD
        if self._is_wrong:
            first = begins
            stop = begins + n
        else:
            found = np.flatnonzero(odd[begins:].any(axis=1))
            if not len(found):
                return len(odd), None
            first = begins + int(found[0])
            count = np.arange(1, min(n, len(odd) - first) + 1)[:, None]
            few = (np.cumsum(odd[first : first + n], axis=0) <= SHARES * count).all(axis=1)
            stop = first + (int(np.argmax(few)) + 1 if few.any() else n)
        if stop > len(odd):
            return first, len(odd) if at_end else None
        return first, stop

    def _judge(self, rows: Floats, odd: Bools) -> Floats:
        """Return the rows of a piece to use: all, or none."""
        share = odd.mean(axis=0)
        if self._is_wrong:
            if (share > SHARES.min()).any() or _judge_walking(rows) != "right":
                return rows[:0]
            self._is_wrong = False
            self._note(f"from t = {rows[0, 0]:.3f} s on acc and gyr are as before, and taken again")
        elif (share > SHARES).any() and len(rows) >= HELD:
            # Refuse rows in another unit; if they were right before, note it.
            usable = rows[np.isfinite(rows[:, 1:7]).all(axis=1)]
            acc, gyr = usable[:, 1:4], usable[:, 4:7]
            force = find_acc_problem(acc, self._stamps.period_s) or "acc has no gravity in it for a second"
            rate = find_gyr_problem(acc, gyr, np.nan) or "gyr is faster than a limb turns for a second"
            problem = " and ".join(np.array([force, rate])[share > SHARES])
            if not self._was_right:
                where = f"t = {rows[0, 0]:.3f} to {rows[-1, 0]:.3f} s"
                raise RecordingError(f"{problem} ({where}): {WHAT_TO_DO}.")
            self._note(f"{problem}: from t = {rows[0, 0]:.3f} s on rows are left out, until this is over")
            self._is_wrong = True
            return rows[:0]
        self._check_windows(rows)
        return rows

    def _check_windows(self, rows: Floats) -> None:
        """Find in windows of accepted rows whether units are right, and the gyroscope turns."""
        self._window = np.concatenate([self._window, rows])
        while len(self._window) >= WINDOW:
            window, self._window = self._window[:WINDOW], self._window[WINDOW:]
            found = _judge_walking(window)
            self._was_right |= found == "right"
            self._slow = self._slow + 1 if found == "slow" else 0
            if self._slow != IN_A_ROW:
                continue
            words = (
                f"gyr turns by less than {SLOW_RAD_S:g} rad/s while acc is that of walking, up to t = "
                f"{window[-1, 0]:.1f} s: multiply it by 57.2958 if it was taken for deg/s, else the gyroscope is broken"
            )
            if not self._was_right:
                raise RecordingError(f"{words}.")
            self._note(f"{words}, and the track is not to be used from there on")

    def _note(self, words: str) -> None:
        self._remark(f"{words}.")
        if len(self._notes) < MAX_NOTES:
            self._notes.append(words)


def _norm(vectors: Floats) -> Floats:
    with np.errstate(over="ignore"):
        return np.asarray(np.linalg.norm(vectors, axis=1))


def _judge_walking(rows: Floats) -> str:
    """Return "right" for rows of walking in m/s^2 and rad/s, "slow" if the gyroscope hardly turns, "" for others."""
    there = rows[find_squarable(rows[:, 1:7])]
    force = _norm(there[:, 1:4])
    if 2 * len(there) < len(rows):
        return ""
    if not (float(np.std(force)) > LIVELY_M_S2 and MIN_M_S2 < float(np.median(force)) < MAX_M_S2):
        return ""
    rate = _norm(rows[:, 4:7])
    fastest = float(np.quantile(rate[np.isfinite(rate)], 0.99))
    if fastest < SLOW_RAD_S:
        return "slow"
    return "right" if SLOW_RAD_S < fastest < MAX_RAD_S else ""


def _measure_strength(mag: Floats) -> Floats:
    """Return the strength (n,) of fields (n, 3); NaN if there is none, zeros included."""
    strength = measure_field_strength(mag)
    strength[strength == 0.0] = np.nan
    return strength
