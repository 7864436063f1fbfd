"""Checks of a source: one sensor, worn where it is said to be, with right axes, and how much of it is lost or silent.

A stream of two sensors, or of one worn elsewhere, is refused in its first minute.

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

Samples that were lost on the way are counted by the stamps of those that came. A sensor samples evenly: within a window
of `WINDOW` rows the median step between stamps is its period T, and a step of k T, k = 2, 3, ..., lacks k - 1 samples.
Longer steps than `MAX_STEP_S` are gaps, which are remarked by themselves. Of stamps that jitter only steps of more than
`GAP_PERIODS` periods are counted. If T is another in `IN_A_ROW` windows, the sensor's rate has changed, which is
remarked. What this machine had no room for is counted by the system (`live.Datagrams`), as datagrams.
"""

from __future__ import annotations

import time
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
from fg_nav.online.buffer import COLUMNS, SampleBuffer
from fg_nav.recording import GAP_PERIODS, Recording
from fg_nav.samples.plausibility import find_squarable, find_stamp_problem, median_period_s
from fg_nav.text import format_count

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
EVEN, MAX_UNEVEN = 0.25, 0.1  # deviation of even steps from whole periods, in periods; share of others that may be
ANOTHER = 1.2  # times longer or shorter is a period of another rate


class SourceCheck:
    """Checks the rows of a stream as they come, whatever the blocks.

    Parameters
    ----------
    mount : where the sensor should be worn.
    remark : called with one sentence if two sensors are found later than `REFUSED_S`.
    """

    def __init__(self, mount: Wearing, remark: Callable[[str], None]) -> None:
        self._mount, self._remark = mount, remark
        self._window = np.empty((0, COLUMNS))
        self._suspect = 0  # windows of two sensors in a row
        # where it is worn: windows for it, checks so far, and whether it is known, or too late
        self._seen: list[Floats] = []
        self._looked, self._is_settled = 0, False
        self._passed_s, self._remarked = 0.0, False

    def add(self, rows: Floats) -> None:
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
    """Checks the axes of the samples of a walk as they come, whatever the blocks, by the `evidence` of its strides.

    Parameters
    ----------
    remark : called with one sentence if wrong axes are found later than `REFUSED_S`.
    mount : where the sensor is worn.
    """

    def __init__(self, remark: Callable[[str], None], mount: Wearing = "foot") -> None:
        is_foot = mount == "foot"
        self.evidence = NO_EVIDENCE if is_foot else NO_SWINGS
        self._block_s, self._measure = BLOCK_S[mount], measure_axes if is_foot else measure_swing_axes
        self._remark = remark
        self._begins = 0  # sample at which the next block begins
        self._passed_s = 0.0

    def look_at(self, buffer: SampleBuffer) -> None:
        """Check the samples since; raises `RecordingError` if strides of the first minute surely show other axes."""
        while not self._is_settled:
            # the next block, once it has come
            self._begins = max(self._begins, buffer.first)
            if self._begins >= buffer.stop:
                return
            stop = buffer.find_since(buffer.stamp(self._begins) + self._block_s, buffer.stop)
            if stop == buffer.stop:
                return
            rows = buffer.between(self._begins, stop)
            self._begins = stop
            if len(rows) < MIN_SAMPLES:
                continue
            # its strides
            self._passed_s += float(np.ptp(rows[:, 0]))
            self.evidence += self._measure(rows[:, 0], rows[:, 1:4], rows[:, 4:7])
            if self.evidence.against > DECISIVE:
                if self._passed_s <= REFUSED_S:
                    raise RecordingError(f"{self.evidence.problem}.")
                self._remark(f"{self.evidence.problem}; the track is not to be used.")

    @property
    def _is_settled(self) -> bool:
        found = self.evidence
        agrees = found.strides >= MIN_AXES_STRIDES and found.against < 1.0
        return agrees or found.strides >= MAX_STRIDES or found.against > DECISIVE


class LossCounter:
    """Counts what is lost of a stream, whatever the blocks: samples missing by the stamps, of those that came.

    `remark` is called with one sentence the first time that samples are missing, and whenever the rate changes.
    """

    def __init__(self, remark: Callable[[str], None]) -> None:
        self.samples = self.came = 0
        self._remark = remark
        self._window = np.empty(0)
        self._period_s, self._others = np.nan, 0

    def add(self, t: Floats) -> None:
        """Count by the stamps (n,) s of rows as they were sent; NaN is ignored."""
        self.came += len(t)
        self._window = np.concatenate([self._window, t[np.isfinite(t)]])
        while len(self._window) > WINDOW:
            self._count(self._window[: WINDOW + 1])
            self._check_rate(self._window[: WINDOW + 1])
            self._window = self._window[WINDOW:]

    def finish(self) -> None:
        """Count, at the end, the rows of a window that is not full."""
        self._count(self._window)
        self._window = self._window[-1:]

    def report(self, datagrams: int) -> dict[str, int]:
        """Return what was lost so far, with the datagrams for which this machine had no room."""
        return {"samples": self.samples, "came": self.came, "datagrams": datagrams}

    def _count(self, t: Floats) -> None:
        """Count the samples that are missing between stamps (n,) s of a sensor that samples evenly."""
        step = np.diff(t)
        forward = (step > 0.0) & (step <= MAX_STEP_S)
        if not forward.any():
            return
        period = float(np.median(step[forward]))
        periods = np.where(forward, step, period) / period
        is_even = np.mean(np.abs(periods - np.rint(periods)) > EVEN) < MAX_UNEVEN
        missing = np.where(periods > (1.5 if is_even else GAP_PERIODS), np.rint(periods) - 1.0, 0.0).astype(np.int64)
        lost = int(missing.sum())
        if lost and not self.samples:
            first = int(np.argmax(missing > 0))
            self._remark(
                f"samples are lost on the way here, by the stamps: the first {missing[first]} before "
                f"t = {t[first + 1]:.3f} s."
            )
        self.samples += lost

    def _check_rate(self, t: Floats) -> None:
        """Remark if the rate has changed."""
        period_s = median_period_s(t)
        if find_stamp_problem(period_s) is not None:
            return  # no rate: stamps in another unit
        if not max(period_s / self._period_s, self._period_s / period_s) > ANOTHER:
            self._period_s, self._others = period_s, 0
            return
        self._others += 1
        if self._others == IN_A_ROW:
            self._remark(
                f"the rate of the sensor has changed near t = {t[0]:.3f} s, from {1.0 / self._period_s:.4g} to "
                f"{1.0 / period_s:.4g} Hz."
            )
            self._period_s, self._others = period_s, 0


def describe_losses(lost: Mapping[str, int]) -> tuple[str, ...]:
    """Describe what was lost in all: `samples`, where `came` samples came, and `datagrams`; nothing if nothing was."""
    words = []
    if lost.get("samples"):
        words.append(
            f"by the stamps {format_count(lost['samples'], 'sample')} of {lost['samples'] + lost['came']} were lost "
            "on the way, steps of more than a second not counted"
        )
    if lost.get("datagrams"):
        words.append(f"this machine had no room for {format_count(lost['datagrams'], 'datagram')}")
    return tuple(words)


class Silence:
    """Time without a sample from a source of that name.

    Silence of `stalled_s` is remarked; after `until_silent_s` the walk is over, None to wait for ever.
    """

    def __init__(
        self, name: str, stalled_s: float, until_silent_s: float | None, remark: Callable[[str], None]
    ) -> None:
        self._name, self._stalled_s, self._until_silent_s, self._remark = name, stalled_s, until_silent_s, remark
        self._since = time.monotonic()
        self._remarked = False

    def is_over(self, n_samples: int) -> bool:
        """Note how many samples have come; return whether the silence is so long that the walk is over."""
        now = time.monotonic()
        silent = now - self._since
        if n_samples:
            if self._remarked:
                self._remark(f"{self._name} sends again after {silent:.0f} s.")
            self._since, self._remarked = now, False
            return False
        if silent >= self._stalled_s and not self._remarked:
            self._remark(f"no sample has come from {self._name} for {silent:.0f} s: waiting.")
            self._remarked = True
        return self._until_silent_s is not None and silent >= self._until_silent_s
