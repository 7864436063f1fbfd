"""Rows whose stamps, force or rate are not in s, m/s^2 and rad/s: refused, or left out where that changes midway.

A row is odd where no sensor that is worn gives it for long:

===== ==========================================================================================================
t     a step of more than `ODD_STEPS` periods, or less than one part in so many of one
acc   below `MIN_M_S2` or above `MAX_M_S2`: gravity is in it but in free fall, so this is g, or mg
gyr   above `MAX_RAD_S`, faster than a limb turns: deg/s
===== ==========================================================================================================

Odd rows wait, and what follows them. They are taken as soon as few enough of these are odd: a gap, an impact, a sample
that is wrong. They are in another unit where `STAMPS` steps in a row are odd and even, or for `HELD_S` more than a part
of `SHARES` of the rows is odd. Stamps show their unit in the first rows, before anything is taken; force in the first
second, rate in the first strides. Where that is so from the beginning the walk is refused; midway it is where a sensor
restarts as another program set it up: what is wrong is left out, until it is right again.

The other way round, a gyroscope that hardly turns while its wearer walks, is seen in windows, and said. So is a
magnetometer in another unit than before, whose field alone is left out (`field_watch`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.errors import RecordingError
from fg_nav.online.buffer import COLUMNS
from fg_nav.online.field_watch import FieldWatch
from fg_nav.samples.plausibility import (
    find_acc_problem,
    find_gyr_problem,
    find_squarable,
    find_stamp_problem,
    find_time_unit,
    median_period_s,
)
from fg_nav.text import format_count

FIRST = 20  # Rows that show the unit of stamps.
NOT_ADVANCING = 1000  # Rows whose stamps never rise.

ODD_STEPS, MIN_ODD_S = 100.0, 0.2
"""Units of time are a thousand apart; a shorter step is a few lost samples of a slow sensor."""

MIN_STEP_S = 1e-5  # Rows that a radio sends at once are stamped 50 us apart; no sensor is as fast.

STAMPS, EVEN = 10, 0.5
"""Steps in a row, and how far from their median: another unit has them all alike, a broken connection has not."""

MIN_M_S2, MAX_M_S2, MAX_RAD_S = 2.0, 500.0, 40.0
"""A foot swings with 4 to 30 m/s^2, and lands with 160; no limb turns faster than 2300 deg/s."""

SHARES = {"acc": 0.5, "gyr": 0.05}
"""Of the rows that may be odd: free fall is over in less than a second, and the fastest turn of a run in less."""

HELD_S, HELD = 1.0, 100  # And so many rows at least.
WINDOW, IN_A_ROW = 200, 3  # Rows in which it is seen whether units are right.

LIVELY_M_S2, SLOW_RAD_S = 2.0, 0.3
"""Who walks shakes the sensor by more, standard deviation, and turns it faster, for one sample in a hundred."""

MAX_NOTES = 20  # Changes that are noted one by one.

_WHAT_TO_DO = "correct it at the sender, or say its unit in --columns, such as acc=ax:ay:az[g]"


class StampWatch:
    """Holds rows (n, 11) until it is known that their stamps are in s; `period_s` is that of the first ones."""

    def __init__(self, tell: Callable[[str], None]) -> None:
        self.period_s = np.nan
        self._tell = tell
        self._held = np.empty((0, COLUMNS))
        self._last = np.nan
        self._is_wrong = False

    def admit(self, rows: Floats, at_end: bool = False) -> Floats:
        """Return the rows to take, of these and of those that waited.

        Raises `RecordingError` where the first stamps are not in s.
        """
        rows = np.concatenate([self._held, rows])
        self._held = rows[:0]
        if np.isnan(self.period_s) and not self._find_period(rows[:, 0]) and not at_end:
            self._held = rows
            return rows[:0]
        return self._leave_out_wrong(rows, at_end)

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

    def _leave_out_wrong(self, rows: Floats, at_end: bool) -> Floats:
        t = np.where(np.isfinite(rows[:, 0]), rows[:, 0], np.nan)
        odd = self._is_odd(np.diff(t, prepend=self._last))
        if not self._is_wrong and not odd.any():
            self._last = float(t[-1]) if len(t) else self._last
            return rows
        taken: list[Floats] = []
        begins = 0  # of the rows that wait
        for i in range(len(rows)):
            if odd[i] == self._is_wrong:  # as the rows before
                taken += [] if self._is_wrong else list(rows[begins : i + 1])
                begins = i + 1
            elif i + 1 - begins > STAMPS:
                taken += self._turn(rows[begins : i + 1], float(t[begins - 1]) if begins else self._last)
                begins = i + 1
        waits = rows[begins:]
        if at_end:
            return np.array([*taken, *([] if self._is_wrong else waits)]).reshape(-1, COLUMNS)
        self._held = waits
        self._last = self._last if begins == 0 else float(t[begins - 1])
        return np.array(taken).reshape(-1, COLUMNS)

    def _turn(self, rows: Floats, before: float) -> list[Floats]:
        """Decide on rows with stamps unlike those up to `before`; return which to take."""
        step = np.diff(rows[:, 0])
        is_unit = bool((np.abs(step - np.median(step)) < EVEN * np.median(step)).all())
        if not self._is_wrong and not is_unit:
            return list(rows)
        self._is_wrong = not self._is_wrong
        if not self._is_wrong:
            self._tell(f"from t = {rows[0, 0]:.3f} s on the stamps are as before, and taken again")
            return list(rows)
        problem = find_stamp_problem(float(np.median(step)))
        words = problem or f"the stamps step by {np.median(step):.3g} s and not by {self.period_s:.3g} as before"
        self._tell(f"{words}: rows after t = {before:.3f} s are left out, until this is over")
        return []

    def _is_odd(self, step: Floats) -> Bools:
        long = step > max(ODD_STEPS * self.period_s, MIN_ODD_S)
        return np.asarray(long | ((step > 0.0) & (step < self.period_s / ODD_STEPS)))


class UnitWatch:
    """Admits rows in s, m/s^2, rad/s; `notes` says what was left out, up to `MAX_NOTES` times, and of how many fields.

    Parameters
    ----------
    remark : given a sentence where rows are left out, and where they are taken again.
    """

    def __init__(self, remark: Callable[[str], None]) -> None:
        self._notes: list[str] = []
        self._remark = remark
        self._stamps, self._field = StampWatch(self._tell), FieldWatch(self._tell)
        self._held = np.empty((0, COLUMNS))
        self._window = np.empty((0, COLUMNS))
        self._was_right = self._is_wrong = False
        self._slow = 0

    @property
    def notes(self) -> tuple[str, ...]:
        """What was left out, in words."""
        fields = format_count(self._field.left_out, "field")
        odd = (f"{fields} of another strength than before left out",) * (self._field.left_out > 0)
        return (*self._notes, *odd)

    def admit(self, rows: Floats, at_end: bool = False) -> Floats:
        """Return the rows (m, 11) to take, of these and of those that waited; `at_end` none waits any more.

        Raises
        ------
        RecordingError
            Where the first rows are in another unit: which, and what to do.
        """
        return self._field.admit(self._admit(rows, at_end))

    def _admit(self, rows: Floats, at_end: bool) -> Floats:
        """Return the rows to take whose stamps, force and rate are in their units."""
        rows = np.concatenate([self._held, self._stamps.admit(rows, at_end)])
        self._held = rows[:0]
        odd = _find_odd(rows)
        if not self._is_wrong and not odd.any():
            self._look(rows)
            return rows
        taken, begins = [], 0
        while begins < len(rows):
            first, stop = self._find_piece(odd, begins, at_end)
            taken.append(rows[begins:first])
            self._look(rows[begins:first])
            if stop is None:
                self._held = rows[first:]
                break
            taken.append(self._judge(rows[first:stop], odd[first:stop]))
            begins = stop
        return np.concatenate([rows[:0], *taken])

    def state(self) -> dict[str, Any]:
        """Return what `resume` needs, as JSON values: rows that wait come again, or are lost."""
        period_s = self._stamps.period_s
        period = period_s if np.isfinite(period_s) else None
        kept = {"was_right": self._was_right, "field": self._field.state(), "notes": list(self._notes)}
        return {"period_s": period, **kept}

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on where another was."""
        self._stamps.period_s = np.nan if state["period_s"] is None else float(state["period_s"])
        self._was_right = bool(state["was_right"])
        self._field.resume(state["field"])
        self._notes = [str(words) for words in state["notes"]]

    def _find_piece(self, odd: Bools, begins: int, at_end: bool) -> tuple[int, int | None]:
        """Return from and to which row it can be judged what waits; to None where too few are there.

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
            few = (np.cumsum(odd[first : first + n], axis=0) <= np.array([*SHARES.values()]) * count).all(axis=1)
            stop = first + (int(np.argmax(few)) + 1 if few.any() else n)
        if stop > len(odd):
            return first, len(odd) if at_end else None
        return first, stop

    def _judge(self, rows: Floats, odd: Bools) -> Floats:
        """Return the rows of a piece to take: all, or none."""
        is_odd = odd.mean(axis=0) > np.array([*SHARES.values()])
        if self._is_wrong:
            if (odd.mean(axis=0) > min(SHARES.values())).any() or not _is_right(rows):
                return rows[:0]
            self._is_wrong = False
            self._tell(f"from t = {rows[0, 0]:.3f} s on acc and gyr are as before, and taken again")
        elif is_odd.any() and len(rows) >= HELD:
            self._refuse(rows, is_odd)
            self._is_wrong = True
            return rows[:0]
        self._look(rows)
        return rows

    def _refuse(self, rows: Floats, is_odd: Bools) -> None:
        """Refuse rows in another unit; where they were right before, say it."""
        usable = rows[np.isfinite(rows[:, 1:7]).all(axis=1)]
        acc, gyr = usable[:, 1:4], usable[:, 4:7]
        force = find_acc_problem(acc, self._stamps.period_s) or "acc has no gravity in it for a second"
        rate = find_gyr_problem(acc, gyr, np.nan) or "gyr is faster than a limb turns for a second"
        problem = " and ".join(np.array([force, rate])[is_odd])
        where = f"t = {rows[0, 0]:.3f} to {rows[-1, 0]:.3f} s"
        if not self._was_right:
            raise RecordingError(f"{problem} ({where}): {_WHAT_TO_DO}.")
        self._tell(f"{problem}: from t = {rows[0, 0]:.3f} s on rows are left out, until this is over")

    def _look(self, rows: Floats) -> None:
        """See in windows of rows that are taken whether units are right, and that the gyroscope turns."""
        self._window = np.concatenate([self._window, rows])
        while len(self._window) >= WINDOW:
            window, self._window = self._window[:WINDOW], self._window[WINDOW:]
            self._was_right |= _is_right(window)
            self._slow = self._slow + 1 if _is_slow(window) else 0
            if self._slow == IN_A_ROW:
                self._say_slow(window)

    def _say_slow(self, window: Floats) -> None:
        words = (
            f"gyr turns by less than {SLOW_RAD_S:g} rad/s while acc is that of walking, up to t = {window[-1, 0]:.1f} "
            "s: multiply it by 57.2958 if it was taken for deg/s, else the gyroscope is broken"
        )
        if not self._was_right:
            raise RecordingError(f"{words}.")
        self._tell(f"{words}, and the track is not to be used from there on")

    def _tell(self, words: str) -> None:
        self._remark(f"{words}.")
        if len(self._notes) < MAX_NOTES and words not in self._notes:  # rows that a resumed walk is sent again
            self._notes.append(words)


def _find_odd(rows: Floats) -> Bools:
    """(n, 2) which of force and rate are odd in rows (n, 11); NaN, and a force of zero, which is none, are not."""
    force, rate = _norm(rows[:, 1:4]), _norm(rows[:, 4:7])
    return np.column_stack([((force > 0.0) & (force < MIN_M_S2)) | (force > MAX_M_S2), rate > MAX_RAD_S])


def _norm(vectors: Floats) -> Floats:
    with np.errstate(over="ignore"):
        return np.asarray(np.linalg.norm(vectors, axis=1))


def _is_right(rows: Floats) -> bool:
    """Whether the rows are those of somebody who walks, in m/s^2 and rad/s."""
    return _is_lively(rows) and bool(SLOW_RAD_S < np.quantile(_finite(_norm(rows[:, 4:7])), 0.99) < MAX_RAD_S)


def _is_slow(rows: Floats) -> bool:
    """Whether somebody walks, and the gyroscope does not turn."""
    return _is_lively(rows) and bool(np.quantile(_finite(_norm(rows[:, 4:7])), 0.99) < SLOW_RAD_S)


def _is_lively(rows: Floats) -> bool:
    """Whether at least half of the rows are there, and their force is that of somebody who walks."""
    there = rows[find_squarable(rows[:, 1:7])]
    force = _norm(there[:, 1:4])
    if 2 * len(there) < len(rows):
        return False
    return float(np.std(force)) > LIVELY_M_S2 and MIN_M_S2 < float(np.median(force)) < MAX_M_S2


def _finite(values: Floats) -> Floats:
    return values[np.isfinite(values)]
