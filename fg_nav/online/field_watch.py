"""A magnetometer whose unit changes midway: its rows are left out, and said, until it is as before.

The strength of the field of a walk is the median of the first `WINDOW` rows whose field is one on Earth. A row is odd
where its field is none on Earth, and `ANOTHER` times stronger or weaker than that: uT, mG, gauss, nT and T are a factor
of ten or more apart, and iron beside the way is neither so strong nor there for long. Odd rows lose their field at
once, so none of it is compared with what was before. It is said where half of the rows of `IN_A_ROW` windows are odd.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.online.buffer import COLUMNS
from fg_nav.samples.plausibility import find_mag_problem, is_field_on_earth, measure_field_strength

MAG, STAMP_AND_MAG = slice(7, 10), (0, 7, 8, 9)
"""Columns."""

WINDOW, IN_A_ROW = 200, 3
"""Rows with a field."""

ANOTHER = 5.0
"""Within buildings the field at a foot varies by a factor of two or three."""


class FieldWatch:
    """Leaves out the field of rows in another unit than before, whatever the blocks in which they come.

    Parameters
    ----------
    tell : given a sentence where the field is left out, and where it is taken again.
    """

    def __init__(self, tell: Callable[[str], None]) -> None:
        self._tell = tell
        self._usual_uT = np.nan
        self._window = np.empty((0, len(STAMP_AND_MAG)))  # of the rows that have a field
        self._others, self._is_wrong = 0, False

    def admit(self, rows: Floats) -> Floats:
        """Return rows (n, 10) with NaN in place of a field that is in another unit."""
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
        usual = self._usual_uT if np.isfinite(self._usual_uT) else None
        return {"usual_uT": usual, "others": self._others, "is_wrong": self._is_wrong}

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on where another was."""
        self._usual_uT = np.nan if state["usual_uT"] is None else float(state["usual_uT"])
        self._others, self._is_wrong = int(state["others"]), bool(state["is_wrong"])

    def _leave_out(self, rows: Floats) -> Floats:
        odd = self._find_odd(_measure(rows[:, MAG]))
        if not odd.any():
            return rows
        kept = rows.copy()
        kept[odd, MAG] = np.nan
        return kept

    def _find_odd(self, strength: Floats) -> Bools:
        """(n,) which fields are in another unit; none before the strength of the walk is known."""
        far = (strength > ANOTHER * self._usual_uT) | (strength < self._usual_uT / ANOTHER)
        return np.asarray(far & ~is_field_on_earth(strength))

    def _look(self, window: Floats) -> None:
        """See whether a full window of rows (n, 4) is in the unit of those before."""
        strength, mag = _measure(window[:, 1:]), window[:, 1:]
        if np.isnan(self._usual_uT):
            median = np.median(strength)
            self._usual_uT = float(median) if is_field_on_earth(median) else np.nan
            return
        is_odd = 2 * int(self._find_odd(strength).sum()) > len(window)
        self._others = self._others + 1 if is_odd != self._is_wrong else 0
        if self._others < IN_A_ROW:
            return
        self._others, self._is_wrong = 0, is_odd
        since = f"from about t = {window[0, 0]:.1f} s"
        if is_odd:
            self._tell(
                f"{find_mag_problem(mag) or 'mag is no field on Earth'}: {since} on it is left out, until this is over"
            )
        else:
            self._tell(f"{since} on mag is as before, and taken again")


def _measure(mag: Floats) -> Floats:
    """Strength (n,) of fields (n, 3); NaN where there is none, zeros included."""
    strength = measure_field_strength(mag)
    strength[strength == 0.0] = np.nan
    return strength
