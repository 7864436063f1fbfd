"""Is what comes that of one sensor, worn where it is said to be? A stream is refused in its first minute if not.

That minute is of the walk: one that is resumed from a checkpoint goes on with what was seen before.

Two sensors at once, such as one on a foot and one in a pocket that send to the same port, are seen in windows of
`WINDOW` rows by either sign:

* stamps    rows fall into two sequences, each of rising stamps, that take turns: two clocks, or one and two delays
* readings  a row x (specific force over g, rate over 5 rad/s) is nearer to the one two or three before it than to the
            last one,

                r = median |x_i - x_i-1| / median min(|x_i - x_i-2|, |x_i - x_i-3|)

One sensor moves on from row to row: r is 0.5 to 0.6 for walking feet, 1.2 for one that stands, and 1.4 at most in all
windows of 15 walks of gdin, openshoe, xio and gdlbio, and of simulated feet and thighs. Rows of two that take turns
have 3 to 19 while they walk, over 100 while they stand, and 1.8 to 6 where one sends two for one of the other.

Where a sensor is worn is seen as in a recording (`fg_nav.detection.mount`), as soon as it is clear. None of 63 real
recordings of feet, walked and run (gdin, gdlbio, openshoe, xio, vicon, two feet), is refused by either.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.detection.mount import Wearing, measure_turning
from fg_nav.errors import EstimationError, RecordingError, StreamError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.online.buffer import COLUMNS
from fg_nav.recording import Recording
from fg_nav.samples.plausibility import find_squarable

WINDOW = 200  # Rows, one to four seconds.
MAX_RATIO = 2.0  # r of one sensor is below this.
IN_A_ROW = 3  # Windows that agree.
REFUSED_S = 60.0  # Of the stream, in which it is refused; later there is a remark, for a walk is not ended.
LOOKED_EVERY_S = 10.0  # Where the sensor is worn.
MIN_SHARE = 0.25  # Of the rows, that the second sequence of stamps has; rows that a network delays are some per cent.
TURNS = 6  # Of the two sequences in a window, at least.
MAX_STEP_S = 1.0  # From row to row of one sequence.

_RATE_RAD_S = 5.0

MAX_WINDOWS = round(REFUSED_S * 5000.0 / WINDOW)
"""That are kept to see where the sensor is worn: those of the fastest sensor, however slowly its clock goes."""


class SourceCheck:
    """Looks at the rows of a stream as they come, whatever the blocks.

    Parameters
    ----------
    mount : where the sensor is said to be worn.
    remark : given one sentence if two sensors are seen later than `REFUSED_S`.
    """

    def __init__(self, mount: Wearing, remark: Callable[[str], None]) -> None:
        self._mount, self._remark = mount, remark
        self._window = np.empty((0, COLUMNS))
        self._suspect = 0
        self._seen: list[Floats] = []
        self._looked, self._is_settled = 0, False  # where it is worn: known, or asked no more
        self._passed_s, self._remarked = 0.0, False

    def add(self, rows: Floats) -> None:
        """Look at rows (n, 11) as they were sent.

        Raises
        ------
        StreamError
            If they are of two sensors.
        EstimationError
            If the sensor is clearly worn elsewhere.
        """
        usable = rows[np.isfinite(rows[:, 0]) & find_squarable(rows[:, 1:7])]
        self._window = np.concatenate([self._window, usable])
        while len(self._window) >= WINDOW:
            window, self._window = self._window[:WINDOW], self._window[WINDOW:]
            self._check_one_sensor(window)
            self._is_settled |= self._passed_s >= REFUSED_S or len(self._seen) >= MAX_WINDOWS
            self._seen = [] if self._is_settled else self._seen
            if not self._is_settled:
                self._check_mount(window)
            step = np.diff(window[:, 0])
            self._passed_s += float(step[(step > 0.0) & (step < MAX_STEP_S)].sum())

    def state(self) -> dict[str, Any]:
        """Return what `resume` needs; what is in it does not change any more."""
        return {
            "window": self._window,
            "seen": list(self._seen),
            "suspect": self._suspect,
            "looked": self._looked,
            "is_settled": self._is_settled,
            "passed_s": self._passed_s,
            "remarked": self._remarked,
        }

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on where another check of the same stream was; raises `ValueError` for what none can be."""
        self._window, *self._seen = map(_check_rows, (state["window"], *state["seen"]))
        self._suspect, self._looked = int(state["suspect"]), int(state["looked"])
        self._is_settled, self._remarked = bool(state["is_settled"]), bool(state["remarked"])
        self._passed_s = float(state["passed_s"])
        if not (self._suspect >= 0 and self._looked >= 0 and 0.0 <= self._passed_s < np.inf):
            raise ValueError("a count below zero")

    def _check_one_sensor(self, window: Floats) -> None:
        self._suspect = self._suspect + 1 if has_two_clocks(window[:, 0]) or _has_two_levels(window) else 0
        if self._suspect < IN_A_ROW or self._remarked:
            return
        words = f"the rows about t = {window[-1, 0]:.1f} s come from two sensors in turn"
        if self._passed_s < REFUSED_S:
            raise StreamError(f"{words}: give each a source of its own, and each its own `fg-nav stream`.")
        self._remark(f"{words}: switch the other off, the track is not to be used from there on.")
        self._remarked = True

    def _check_mount(self, window: Floats) -> None:
        """Refuse a sensor that is worn elsewhere."""
        self._seen.append(window[np.diff(window[:, 0], prepend=-np.inf) > 0])
        looked = int(self._passed_s / LOOKED_EVERY_S)
        if looked == self._looked:
            return
        self._looked = looked
        rows = np.concatenate(self._seen)
        try:
            signs = measure_turning(Recording(rows[:, 0], rows[:, 1:4], rows[:, 4:7]))
        except RecordingError:
            return  # its clock restarted
        self._is_settled = signs.wearing == self._mount
        if signs.wearing is None or self._is_settled:
            return
        if self._mount == "foot":
            raise EstimationError(
                f"the sensor is in a trouser pocket, not on a foot (only {signs.words}): add --mount pocket."
            )
        raise EstimationError(f"the sensor is on a foot, not in a pocket ({signs.words}): leave --mount pocket out.")


def _check_rows(rows: Any) -> Floats:
    """Return rows (n, 11), at most a window of them, whose stamps are numbers."""
    if not isinstance(rows, np.ndarray) or rows.dtype != np.float64 or rows.shape[1:] != (COLUMNS,):
        raise ValueError("these are no rows")
    if len(rows) > WINDOW or not np.isfinite(rows[:, :7]).all():
        raise ValueError("these are no rows of a window")
    return rows


def has_two_clocks(t: Floats) -> bool:
    """Whether stamps (n,) s, in the order in which they came, are two rising sequences that take turns."""
    if (np.diff(t) >= 0).all():
        return False
    last = [float(t[0]), np.nan]
    of = np.zeros(len(t), dtype=np.int64)
    for i, stamp in enumerate(t[1:].tolist(), 1):
        step = np.array([stamp - one if 0 < stamp - one < MAX_STEP_S else np.inf for one in last])
        if np.isinf(step).all():
            if not np.isnan(last[1]):
                return False  # no two sequences
            of[i] = 1
        else:
            of[i] = int(step.argmin())
        last[of[i]] = stamp
    turns = int((np.diff(of) != 0).sum())
    return turns >= TURNS and MIN_SHARE < float(of.mean()) < 1.0 - MIN_SHARE


def _has_two_levels(window: Floats) -> bool:
    """Whether rows are nearer to those two or three before than to the last."""
    x = np.concatenate([window[:, 1:4] / GRAVITY_M_S2, window[:, 4:7] / _RATE_RAD_S], axis=1)
    last, second, third = (np.linalg.norm(x[3:] - x[3 - k : len(x) - k], axis=1) for k in (1, 2, 3))
    return float(np.median(last)) > MAX_RATIO * float(np.median(np.minimum(second, third)))
