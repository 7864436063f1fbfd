"""Bad samples of a stream, as of a recording (`fg_nav.samples.outliers`): the same are found, some samples later.

One of which only one sensor is bad passes with a line in place of that (`fg_nav.samples.gaps`), and says so.

Most samples pass at once. One at which a run of bad ones may begin, far from the one before, is held until
`LOOK_AHEAD` more are there: 55 ms at 200 Hz, in which a shoe that strikes is on its way to a footfall.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.online.buffer import COLUMNS
from fg_nav.samples.gaps import interpolate_unread
from fg_nav.samples.outliers import AROUND, BOTH_OUT, MAG_OUT, scan_mag, scan_outliers

NOTHING = np.empty((0, COLUMNS))


class Passed(NamedTuple):
    """Rows that pass a gate (n, 12), and those that do not, or without one sensor, as they came (m, 11).

    `place` (m,) is that of each of the latter among the rows that were held and came, `sensor` (m,) the sum of
    `ACC_OUT`, `GYR_OUT` and `MAG_OUT`; of a row that does not pass the first two.
    """

    good: Floats
    bad: Floats
    place: Ints
    sensor: Ints


class OutlierFilter:
    """Lets rows (n, 11) of t, acc, gyr, mag pass that are good; `held` are those of which it is not clear yet.

    Parameters
    ----------
    before : the last rows that passed, of which neither accelerometer nor gyroscope was bad.
    held : rows behind them.
    fields : the last rows that passed with a field.
    """

    def __init__(self, before: Floats = NOTHING, held: Floats = NOTHING, fields: Floats = NOTHING) -> None:
        self._before, self.held, self.fields = before[-AROUND - 1 :], held, fields

    def judge(self, rows: Floats, at_end: bool = False) -> Passed:
        """Judge rows in order of time that go on behind the last ones; at the end of a stream none is held."""
        seen, begin = np.concatenate([self._before, self.held, rows]), len(self._before)
        found, stop = scan_outliers(seen[:, 0].copy(), seen[:, 1:7].copy(), begin, at_end)
        stop = self._judge_fields(seen, found, begin, stop, at_end)
        while not at_end and stop > begin and found[stop - 1] & BOTH_OUT:
            stop -= 1  # what it is bridged to is not judged yet
        judged, sensor = seen[begin:stop], found[begin:stop]
        passes = sensor & BOTH_OUT != BOTH_OUT
        good, place = _bridge(seen[:stop], found[:stop])[begin:][passes], np.flatnonzero(sensor)
        self._before = np.concatenate([self._before, good[good[:, COLUMNS] == 0, :COLUMNS]])[-AROUND - 1 :]
        self.held = seen[stop:]
        self.fields = np.concatenate([self.fields, good[np.isfinite(good[:, 7]), :COLUMNS]])[-AROUND - 1 :]
        return Passed(good, judged[place], place, sensor[place])

    def _judge_fields(self, seen: Floats, found: Ints, begin: int, stop: int, at_end: bool) -> int:
        """Note in `found` (n,) whose field is bad, of rows (n, 11) that were judged up to `stop`; up to where it is."""
        there = begin + np.flatnonzero((found[begin:stop] != BOTH_OUT) & np.isfinite(seen[begin:stop, 7]))
        series, known = np.concatenate([self.fields, seen[there]]), len(self.fields)
        bad, until = scan_mag(series[:, 0].copy(), series[:, 7:10].copy(), known, at_end)
        found[there] += bad[known:]
        return int(there[until - known]) if until < len(series) else stop


def _bridge(rows: Floats, found: Ints) -> Floats:
    """Rows (n, 12) of these (n, 11) with a line, or no field, where a sensor was found (n,) to be bad."""
    unread = found & BOTH_OUT
    bridged = np.column_stack([rows, unread])
    interpolate_unread(rows[:, 0], bridged[:, 1:4], bridged[:, 4:7], unread)
    bridged[(found & MAG_OUT) > 0, 7:10] = np.nan
    return bridged
