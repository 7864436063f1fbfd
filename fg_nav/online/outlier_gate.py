"""Bad samples of a stream, as of a recording (`fg_nav.samples.outliers`): the same are found, some samples later.

Most samples pass at once. One at which a run of bad ones may begin, far from the one before, is held until
`LOOK_AHEAD` more are there: 55 ms at 200 Hz, in which a shoe that strikes is on its way to a footfall.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.online.buffer import COLUMNS
from fg_nav.samples.outliers import AROUND, scan_outliers


class Passed(NamedTuple):
    """Rows that pass a gate (n, 10), and those that do not (m, 10).

    `place` (m,) is that of each of the latter among the rows that were held and came, `sensor` (m,) as of
    `scan_outliers`.
    """

    good: Floats
    bad: Floats
    place: Ints
    sensor: Ints


class OutlierGate:
    """Lets rows (n, 10) of t, acc, gyr, mag pass that are good; `held` are those of which it is not clear yet.

    Parameters
    ----------
    before : the last rows that passed.
    held : rows behind them.
    """

    def __init__(self, before: Floats = np.empty((0, COLUMNS)), held: Floats = np.empty((0, COLUMNS))) -> None:
        self._before, self.held = before[-AROUND - 1 :], held

    def judge(self, rows: Floats, at_end: bool = False) -> Passed:
        """Judge rows in order of time that go on behind the last ones; at the end of a stream none is held."""
        seen, begin = np.concatenate([self._before, self.held, rows]), len(self._before)
        found, stop = scan_outliers(seen[:, 0].copy(), seen[:, 1:7].copy(), begin, at_end)
        judged, sensor = seen[begin:stop], found[begin:stop]
        good = judged[sensor == 0]
        self._before, self.held = np.concatenate([self._before, good])[-AROUND - 1 :], seen[stop:]
        place = np.flatnonzero(sensor)
        return Passed(good, judged[place], place, sensor[place])
