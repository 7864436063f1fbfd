"""Checks of a stream by its motion: rows of one sensor, worn where it is said to be, with right axes.

A stream of two sensors, of one worn elsewhere, or with wrong axes is refused in its first minute, and remarked later.

Two sensors at once, such as one on a foot and one in a pocket that send to the same port, are found in windows of
`WINDOW` rows by either sign:

* stamps    rows fall into two sequences, each of rising stamps, that take turns: two clocks, or one and two delays
* readings  a row x (specific force over g, rate over 5 rad/s) is nearer to the one two or three before it than to the
            last one,

                r = median |x_i - x_i-1| / median min(|x_i - x_i-2|, |x_i - x_i-3|)

Of one sensor r is 1.4 at most, in 15 real walks and simulated feet and thighs. Rows of two that take turns have 3 to 19
while they walk, over 100 while they stand, and 1.8 to 6 where one sends two for one of the other.

Where a sensor is worn is found as in a recording (`fg_nav.detection.mount`), as soon as it is clear. None of 63 real
recordings of feet is refused by either.

Whether its sensors have the same, right-handed axes is measured in strides (`detection.mount`), in blocks of
`BLOCK_S`, until `MIN_AXES_STRIDES` of them show the axes that were given, or `MAX_STRIDES` are there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.detection.mount import (
    DECISIVE,
    MAX_STRIDES,
    NO_EVIDENCE,
    NO_SWINGS,
    SWINGS_S,
    Wearing,
    measure_axes,
    measure_swing_axes,
    measure_turning,
)
from fg_nav.errors import EstimationError, RecordingError, StreamError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.recording import Recording
from fg_nav.samples.plausibility import find_squarable
from fg_nav.samples.readings import COLUMNS

WINDOW = 200  # rows, one to four seconds; most of their steps are one period, unless every third sample is lost
IN_A_ROW = 3  # windows that agree
MAX_STEP_S = 1.0  # from row to row of one sequence; a longer step is a sensor that was off, or a clock that was set
MAX_RATIO = 2.0  # r of one sensor is below this
REFUSED_S = 60.0  # of the stream, in which it is refused; later there is a remark, for a walk is not ended
MOUNT_EVERY_S = 10.0  # between two checks of where the sensor is worn
MAX_WINDOWS = round(REFUSED_S * 5000.0 / WINDOW)  # for that: of the fastest sensor, however slowly its clock goes
MIN_SHARE = 0.25  # of the rows, in the second sequence of stamps; rows that a network delays are some per cent
TURNS = 6  # of the two sequences in a window, at least
RATE_RAD_S = 5.0  # by which rates are divided
MIN_AXES_STRIDES = 15  # that show the axes given
MIN_SAMPLES = 50  # of a block for axes; fewer show no stride
BLOCK_S: Mapping[Wearing, float] = {"foot": 5.0, "pocket": SWINGS_S + 0.05}  # four strides; a window for their period


class SourceCheck:
    """Checks the rows of a stream as they come, whatever the blocks; after `REFUSED_S` it only remarks."""

    def __init__(self, mount: Wearing, remark: Callable[[str], None]) -> None:
        self._mount, self._remark = mount, remark
        self._window = np.empty((0, COLUMNS))
        self._suspect = 0  # windows of two sensors in a row
        # where it is worn: windows for it, checks so far, and whether it is known, or too late
        self._seen: list[Floats] = []
        self._looked, self._is_settled = 0, False
        self._passed_s, self._remarked = 0.0, False

    def push(self, rows: Floats) -> None:
        """Check rows (n, 11) as they were sent.

        Raises `StreamError` if they are of two sensors, `EstimationError` if the sensor is clearly worn elsewhere.
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

    def _check_one_sensor(self, window: Floats) -> None:
        """Refuse rows of two sensors in turn: by two clocks, or if they are nearer to those two or three before."""
        x = np.concatenate([window[:, 1:4] / GRAVITY_M_S2, window[:, 4:7] / RATE_RAD_S], axis=1)
        last, second, third = (np.linalg.norm(x[3:] - x[3 - k : len(x) - k], axis=1) for k in (1, 2, 3))
        has_two = has_two_clocks(window[:, 0])
        has_two = has_two or float(np.median(last)) > MAX_RATIO * float(np.median(np.minimum(second, third)))
        self._suspect = self._suspect + 1 if has_two else 0
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
        looked = int(self._passed_s / MOUNT_EVERY_S)
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


class AxesCheck:
    """Checks the axes of samples as they come by the `evidence` of their strides; after `REFUSED_S` it only remarks."""

    def __init__(self, remark: Callable[[str], None], mount: Wearing = "foot") -> None:
        is_foot = mount == "foot"
        self.evidence = NO_EVIDENCE if is_foot else NO_SWINGS
        self._block_s, self._measure = BLOCK_S[mount], measure_axes if is_foot else measure_swing_axes
        self._remark = remark
        self._held = np.empty((0, 7))  # t, acc and gyr of a block that is not complete
        self._passed_s, self._is_settled = 0.0, False

    def push(self, rows: Floats) -> None:
        """Check samples (n, 7 or more) that follow; raises `RecordingError` if the first minute shows other axes."""
        self._held = self._held[:0] if self._is_settled else np.concatenate([self._held, rows[:, :7]])
        while not self._is_settled and len(self._held):
            # the next block, once it has come
            stop = max(int(np.searchsorted(self._held[:, 0], self._held[0, 0] + self._block_s)), 1)  # at 1e17 s, 0
            if stop == len(self._held):
                return
            block, self._held = self._held[:stop], self._held[stop:]
            if len(block) < MIN_SAMPLES:
                continue
            # its strides
            self._passed_s += float(np.ptp(block[:, 0]))
            self.evidence += self._measure(block[:, 0], block[:, 1:4], block[:, 4:7])
            against = self.evidence.against
            enough = MIN_AXES_STRIDES if against < 1.0 else MAX_STRIDES
            self._is_settled = against > DECISIVE or self.evidence.strides >= enough
            if against > DECISIVE:
                if self._passed_s <= REFUSED_S:
                    raise RecordingError(f"{self.evidence.problem}.")
                self._remark(f"{self.evidence.problem}; the track is not to be used.")
