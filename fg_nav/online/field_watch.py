"""A magnetometer whose unit changes midway: its rows are left out, and said, until it is as before.

The strength of the field of a walk is the median of those of its newest windows, `MOST` at most, each the median of
`WINDOW` rows, whose field is one on Earth. A row is odd where its field is none on Earth, and `ANOTHER` times stronger
or weaker than that: uT, mG, gauss, nT and T are a factor of ten or more apart, and iron beside the way is seldom as
strong, and not there for long. Odd rows lose their field at once, so none of it is compared with what was before, and
are counted. It is said where half of the rows of `IN_A_ROW` windows are odd, with the unit that makes the usual field
of them, if there is one.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.online.buffer import COLUMNS
from fg_nav.samples.plausibility import find_mag_problem, is_field_on_earth, measure_field_strength

MAG, STAMP_AND_MAG = slice(7, 10), (0, 7, 8, 9)  # Columns.
WINDOW, IN_A_ROW = 200, 3  # Rows with a field.
MOST = 32  # Windows of which the strength is remembered: a minute at 100 Hz, so a beginning beside iron is forgotten.
ANOTHER = 5.0  # Within buildings the field at a foot varies by a factor of two or three.


class FieldWatch:
    """Leaves out the field of rows in another unit than before, `left_out` so far, whatever the blocks they come in.

    Parameters
    ----------
    tell : given a sentence where the field is left out, and where it is taken again.
    """

    def __init__(self, tell: Callable[[str], None]) -> None:
        self._tell = tell
        self.left_out, self._left_out_until = 0, -np.inf
        self._counted_until = -np.inf  # stamp, s: a resumed walk may be sent again what comes before
        self._strengths_uT: deque[float] = deque(maxlen=MOST)  # of the newest windows with a field on Earth
        self._usual_uT = np.nan
        self._window = np.empty((0, len(STAMP_AND_MAG)))  # of the rows that have a field
        self._others, self._is_wrong = 0, False

    def admit(self, rows: Floats) -> Floats:
        """Return rows (n, 11) with NaN in place of a field that is in another unit."""
        taken = [np.empty((0, COLUMNS))]
        while len(rows):
            # Up to the end of a window all are judged by the same strength.
            sensed = np.flatnonzero(_measure(rows[:, MAG]) > 0.0)[: WINDOW - len(self._window)]
            self._window = np.concatenate([self._window, rows[sensed][:, STAMP_AND_MAG]])
            is_full = len(self._window) == WINDOW
            stop = int(sensed[-1]) + 1 if is_full else len(rows)
            taken.append(self._leave_out(rows[:stop]))
            rows = rows[stop:]
            if is_full:
                self._look(self._window)
                self._window = self._window[:0]
        return np.concatenate(taken)

    def state(self) -> dict[str, Any]:
        """Return what `resume` needs, as JSON values; a window that is not full begins again."""
        return {
            "strengths_uT": list(self._strengths_uT),
            "others": self._others,
            "is_wrong": self._is_wrong,
            "left_out": self.left_out,
            "until": self._left_out_until,
        }

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on where another was."""
        self._strengths_uT = deque(map(float, state["strengths_uT"]), MOST)
        self._usual_uT = float(np.median(self._strengths_uT)) if self._strengths_uT else np.nan
        self._others, self._is_wrong = int(state["others"]), bool(state["is_wrong"])
        self.left_out = int(state["left_out"])
        self._counted_until = self._left_out_until = float(state["until"])

    def _leave_out(self, rows: Floats) -> Floats:
        odd = self._find_odd(_measure(rows[:, MAG]))
        if not odd.any():
            return rows
        kept = rows.copy()
        kept[odd, MAG] = np.nan
        t = rows[odd, 0]
        self.left_out += int((~(t <= self._counted_until)).sum())
        self._left_out_until = float(t[-1]) if np.isfinite(t[-1]) else self._left_out_until
        return kept

    def _find_odd(self, strength: Floats) -> Bools:
        """(n,) which fields are in another unit; none before the strength of the walk is known."""
        far = (strength > ANOTHER * self._usual_uT) | (strength < self._usual_uT / ANOTHER)
        return np.asarray(far & ~is_field_on_earth(strength))

    def _look(self, window: Floats) -> None:
        """See whether a full window of rows (n, 4) is in the unit of those before."""
        strength, mag = _measure(window[:, 1:]), window[:, 1:]
        is_odd = 2 * int(self._find_odd(strength).sum()) > len(window)
        self._note_strength(float(np.median(strength)))
        self._others = self._others + 1 if is_odd != self._is_wrong else 0
        if self._others < IN_A_ROW:
            return
        self._others, self._is_wrong = 0, is_odd
        since = f"from about t = {window[0, 0]:.1f} s"
        if is_odd:
            problem = find_mag_problem(mag, self._usual_uT) or "mag is no field on Earth"
            self._tell(f"{problem}: {since} on it is left out, until this is over")
        else:
            self._tell(f"{since} on mag is as before, and taken again")

    def _note_strength(self, strength_uT: float) -> None:
        """Take the strength of a window for that of the walk, if it is one on Earth, and no other one than before."""
        is_other = self._is_wrong or not self._usual_uT / ANOTHER < strength_uT < self._usual_uT * ANOTHER
        if is_field_on_earth(strength_uT) and not (is_other and len(self._strengths_uT) == MOST):
            self._strengths_uT.append(strength_uT)
            self._usual_uT = float(np.median(self._strengths_uT))


def _measure(mag: Floats) -> Floats:
    """Strength (n,) of fields (n, 3); NaN where there is none, zeros included."""
    strength = measure_field_strength(mag)
    strength[strength == 0.0] = np.nan
    return strength
