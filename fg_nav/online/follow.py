"""Follow the sensors of a walk to its end: rows in, lines out, each with the verdict on the path so far.

    record, sources -> rows -> `FeetMerge` -> SensorWalk -> its navigator -> LineVerdict -> record -> outlets

A walk has sensors by side: that of one foot or pocket has one, without a side (None), that of two feet one on each. One
loop reads all sources, in a thread of its own, while the main thread computes, so that signals interrupt that. In the
status position and heading are null with two feet, floor and returns the left foot's, rate and losses those of both.

Verdict: a path that was spoiled stays so. A stride is measured within one map: where the past was revised, from its
newest footfall in the new map; where the revision does not include it, the stride to the next line is not measured.
"""

from __future__ import annotations

import asyncio
import signal
import threading
import time
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.calibration.of_recording import Calibration
from fg_nav.detection.source import AxesCheck, SourceCheck
from fg_nav.errors import FgNavError, StreamError
from fg_nav.feet import SIDES, Side
from fg_nav.frames import compute_heading
from fg_nav.magnetic.axes import MagAxes
from fg_nav.online.buffer import OnlineOptions
from fg_nav.online.estimates import (
    DIGITS,
    FeetLine,
    Revision,
    StanceEstimate,
    format_estimate,
    format_feet_line,
    format_revision,
    tag_line,
)
from fg_nav.online.feet import FeetMerge, FeetNavigator
from fg_nav.online.navigator import NO_ROWS
from fg_nav.online.pocket import Navigator, begin_walk
from fg_nav.online.record import Record
from fg_nav.online.rows import Columns
from fg_nav.online.sources import SampleSource
from fg_nav.recording import NOMINAL_SIGMA
from fg_nav.samples.delivery import LossCounter, Silence, describe_losses
from fg_nav.text import find_version
from fg_nav.verdict import limits
from fg_nav.verdict.limits import Reason, Verdict
from fg_nav.view.outlets import Outlets, Say, StatusReporter

WAIT_S = 0.05  # for rows of one sensor, before the other's are read, and the stop signal is checked
REPLAYED = 1 << 14  # rows of a record at once; the answer does not depend on it

# Ctrl-C, a service that is stopped, a terminal or connection that is gone: they end the walk.
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
DUE_S = 4.0  # To the next line at most: a standing has one every two seconds.
MIN_STRIDES = 5  # Of which the median of gravity is judged.
N_FASTEST = 4  # Strides, by the slowest of which the fastest is judged: who begins to run makes more of them.
MAX_HEIGHTS = 32  # More than are made in the time over which their rate is measured.
SAME_S = 1e-3  # Stamps of one footfall, of any clock: less than a sample apart.


@dataclass(frozen=True)
class StreamOptions:
    """How a source is followed."""

    online: OnlineOptions = field(default_factory=OnlineOptions)
    stalled_s: float = 5.0  # Silence after which it is remarked that the source stalls.
    until_silent_s: float | None = None  # Silence after which the walk ends; None to wait for ever.
    calibration: Calibration | None = None  # To apply.
    mag_axes: MagAxes | None = None  # Of the magnetometer in those of the gyroscope; None for the same.
    columns: Columns | None = None  # Of rows without a header.
    background: bool = False  # Whether the walk is solved again in another process.

    @property
    def rate_sigma(self) -> float:
        """Sigma of the rate by which stamps are counted, a share of it; 0 where rows have stamps."""
        return 0.0 if self.columns is None or self.columns.rate_hz is None else NOMINAL_SIGMA


@dataclass(frozen=True)
class Sensor:
    """Where the samples of a sensor come from, how they are followed, and where they are recorded, if at all."""

    source: SampleSource
    options: StreamOptions = StreamOptions()
    record: Record | None = None


@dataclass(frozen=True)
class FollowedWalk:
    """A walk that has ended: the closed navigator of each sensor, and that of both feet, to be solved as a whole."""

    sensors: Mapping[Side | None, Sensor]
    navigators: Mapping[Side | None, Navigator]
    feet: FeetNavigator | None


# --- the walk --------------------------------------------------------------------------------------------------------


def follow(
    sensors: Mapping[Side | None, Sensor],
    outlets: Outlets,
    stop: threading.Event | None = None,
    clock_offset_s: float = 0.0,
) -> FollowedWalk:
    """Follow the sources of a walk until they end or `stop` is set; lines and remarks go to the outlets.

    `clock_offset_s` is to be added to the stamps of the right foot. Raises `FormatError`, `RecordingError`,
    `EstimationError` if the rows (of both feet) are of another format or unit, or the walk of the record cannot be
    resumed; `StreamError` if `stop` is set before a record is replayed.
    """
    follower = _Follower(sensors, outlets, clock_offset_s)
    try:
        follower.read_sources(threading.Event() if stop is None else stop)
        follower.end()
    finally:
        if follower.feet is not None:
            follower.feet.stop_process()
    return FollowedWalk(sensors, follower.navigators, follower.feet)


class _Follower:
    """All sensors of a walk, and its lines."""

    def __init__(self, sensors: Mapping[Side | None, Sensor], outlets: Outlets, clock_offset_s: float) -> None:
        self._sensors, self._outlets, self._is_replayed = sensors, outlets, False
        self._status = None if outlets.watcher is None else StatusReporter(outlets.watcher)
        self.feet: FeetNavigator | None = None
        self.navigators: Mapping[Side | None, Navigator]
        if None in sensors:
            options = sensors[None].options
            self.navigators = {None: begin_walk(options.online, self._remark, background=options.background)}
        else:
            left, right = (sensors[side].options for side in SIDES)
            self.feet = FeetNavigator(left.online, self._remark, clock_offset_s, left.background, right.online)
            self.navigators = {side: self.feet.navigators[side] for side in SIDES}
        self._walks = {
            side: SensorWalk(one, self.navigators[side], partial(self._emit, side), partial(self._remark, side=side))
            for side, one in sensors.items()
        }
        self._open, self._merge = list(sensors), FeetMerge(sensors)

    def read_sources(self, stop: threading.Event) -> None:
        """Read the sources in a loop in another thread, and compute what they send, until they end or `stop` is set."""
        silent = set[Side | None]()
        with asyncio.Runner() as runner, ThreadPoolExecutor(1) as thread:
            loop, has_ended = runner.get_loop(), asyncio.Event()
            thread.submit(runner.run, has_ended.wait())
            try:
                for sensor in self._sensors.values():
                    loop.call_soon_threadsafe(sensor.source.start)
                # The walk so far, from its record.
                self._is_replayed = True
                resumed = [(side, walk.replay(stop)) for side, walk in self._walks.items()]
                self._is_replayed = False
                for side, words in resumed:
                    if words:
                        self._remark(words, side)
                # What the sources send from here on: the time of the replay is no silence.
                silence = dict[Side | None, Silence]()
                for side, one in self._sensors.items():
                    limits_s = one.options.stalled_s, one.options.until_silent_s
                    silence[side] = Silence(one.source.name, *limits_s, self._outlets.remark)
                while not stop.is_set() and set(self._open) - silent:
                    # Rows of the foot that is behind, or of the other where it has sent nothing.
                    for side in sorted(self._open, key=lambda one: self._merge.newest[one]):
                        began = time.monotonic()
                        try:
                            rows = asyncio.run_coroutine_threadsafe(self._read(side), loop).result()
                        except FgNavError as error:
                            self._refuse(side, error)
                            rows = None
                        if rows is None:
                            self._end_source(side)
                            break
                        (silent.add if silence[side].is_over(len(rows)) else silent.discard)(side)
                        self._put(side, rows, min(time.monotonic() - began, WAIT_S))  # load is no silence
                        if len(rows):
                            break
                    # Those that need not wait for the other foot's, and the lines that they complete.
                    self._add_blocks()
            finally:
                loop.call_soon_threadsafe(has_ended.set)

    async def _read(self, side: Side | None) -> Floats | None:
        """Return the rows of a sensor that have come, none after `WAIT_S`, None at its end."""
        try:
            async with asyncio.timeout(WAIT_S):
                return await self._sensors[side].source.read()
        except TimeoutError:
            return NO_ROWS

    def end(self) -> None:
        """End the walk, and emit its last lines."""
        for side in list(self._open):
            self._end_source(side)
        self._add_blocks()
        for side, walk in self._walks.items():
            self._add(side, NO_ROWS, at_end=True)
            walk.count_losses()
        if self.feet is None:
            self._walks[None].report(self.navigators[None].close())
        else:
            self._report(self.feet.close())
        self._show_status(ended=True)

    def _put(self, side: Side | None, rows: Floats, waited_s: float = 0.0) -> None:
        """Put rows by the clock of both feet where those of both are merged, or note for how long none has come."""
        if self._status is not None:
            self._status.count_samples(len(rows))
        if self.feet is not None and side is not None:
            rows = rows.copy()
            rows[:, 0] += self.feet.offset_s[side]
        self._merge.put(side, rows, waited_s)

    def _add_blocks(self) -> None:
        """Add the rows that need not wait for the other foot's, and send the status."""
        feet, has_ended = self.feet, len(self._open) < len(self._sensors)
        for side, rows in self._merge.take(feet is None or has_ended or bool(feet.refused) or feet.is_parted):
            self._add(side, rows)
        self._show_status()

    def _add(self, side: Side | None, rows: Floats, at_end: bool = False) -> None:
        """Add rows of a sensor, and emit the lines that they complete."""
        if self.feet is not None and side in self.feet.refused:
            return
        try:
            self._walks[side].add(rows, at_end)
        except FgNavError as error:
            self._refuse(side, error)
            return
        if self.feet is not None and side is not None and len(rows):
            self._report(self.feet.update_both(side))

    def _end_source(self, side: Side | None) -> None:
        """Put in what is left of a source at its end."""
        self._open.remove(side)
        try:
            self._put(side, self._sensors[side].source.finish())
        except FgNavError as error:
            self._refuse(side, error)

    def _refuse(self, side: Side | None, error: FgNavError) -> None:
        """Leave a foot out from here on; raises the error where no other is left."""
        if self.feet is None or side is None:
            raise error
        if side not in self.feet.refused:
            self._report([self.feet.refuse(side, error)])

    def _report(self, lines: Iterable[FeetLine]) -> None:
        """Emit lines of both feet; those of one with the verdict on its path."""
        for line in lines:
            if line.foot != "person" and isinstance(line.content, StanceEstimate | Revision):
                self._walks[line.foot].report([line.content])
                continue
            for text in format_feet_line(line):
                self._outlets.emit(text)

    def _emit(self, side: Side | None, line: str) -> None:
        tagged = line if self.feet is None or side is None else tag_line(line, side, self.feet.frame(side))
        self._outlets.emit(tagged)
        if self._status is not None:
            self._status.note_line()

    def _remark(self, words: str, side: Side | None = None) -> None:
        """Pass a remark on; what is remarked while a walk is replayed was said before."""
        if not self._is_replayed:
            self._outlets.remark(words if side is None else f"{side} foot: {words}")

    def _show_status(self, ended: bool = False) -> None:
        """Send the status between footfalls."""
        if self._status is None:
            return
        lost = [walk.count_lost() for walk in self._walks.values()]
        totals = {name: sum(one[name] for one in lost) for name in ("samples", "datagrams")}
        self._status.report(partial(describe_walk, list(self.navigators.values())), totals, ended)


def describe_walk(navigators: Sequence[Navigator]) -> dict[str, Any]:
    """Return what the samples so far show of a walk; the pose, of one sensor alone, costs some milliseconds."""
    first = navigators[0]
    pose = first.pose() if len(navigators) == 1 else None
    t = max(one.buffer.newest_s for one in navigators)
    heading_deg = None if pose is None else float(np.degrees(float(compute_heading(pose.nav_R_body[-1]))) % 360.0)
    ends = [(one.t[0], one.t[-1], one.earlier_t.min(), one.earlier_t.max()) for one in first.returns]
    return {
        "t": round(t, DIGITS) if np.isfinite(t) else None,
        "standing": all(one.stands for one in navigators),
        "position_m": None if pose is None else np.round(pose.position[-1], DIGITS),
        "heading_deg": None if heading_deg is None else round(heading_deg, DIGITS),
        "floor": first.floor,
        "returns": [[round(float(t), DIGITS) for t in one] for one in ends],  # Each, and its earlier pass, s.
    }


class SensorWalk:
    """Gives the samples of a sensor to its navigator, and emits its lines; both are recorded first, if at all."""

    def __init__(self, sensor: Sensor, navigator: Navigator, emit: Say, remark: Say) -> None:
        self._sensor, self._navigator, self._emit, self._remark = sensor, navigator, emit, remark
        options, record = sensor.options, sensor.record
        self._check = SourceCheck("pocket" if options.online.mount == "pocket" else "foot", remark)
        self._verdict = LineVerdict(options.online.mount == "pocket", remark, options.rate_sigma)
        self._losses = LossCounter(remark)
        if record is not None:
            axes = None if options.mag_axes is None else str(options.mag_axes)
            about = {"version": find_version(), "options": options.online, "calibration": options.calibration}
            record.begin({**about, "columns": options.columns, "mag_axes": axes})

    def replay(self, stop: threading.Event) -> str:
        """Bring the walk to where its record ends, and emit its past, and the lines not given yet; return a remark."""
        record, navigator = self._sensor.record, self._navigator
        if record is None or record.given is None:
            return ""
        navigator.resume(record.given)
        self._verdict.judge(record.given.lines, record.given.continues)
        for number, part in enumerate(record.replay()):
            if number:
                navigator.intake.resume()
            for start in range(0, len(part), REPLAYED):
                if stop.is_set():
                    raise StreamError(
                        f"{record.path.name} was not replayed to its end: --resume goes on with its walk."
                    )
                self._push(part[start : start + REPLAYED])
        self.report(navigator.end_replay())
        reader, unit = self._sensor.source.reader, "strides" if navigator.options.mount == "pocket" else "stances"
        if reader is not None and record.header is not None:
            reader.resume(record.header)
        walked = f"{len(navigator.footfalls)} {unit}, {navigator.buffer.stop} samples"
        return f"resumed from {record.path.name}: {walked}."

    def add(self, rows: Floats, at_end: bool = False) -> None:
        """Record and push rows (n, 11), and emit the lines that they complete."""
        record, reader = self._sensor.record, self._sensor.source.reader
        if record is not None:
            rows = record.add(rows, None if reader is None else reader.header, at_end)
            if record.is_interrupted:
                self._navigator.intake.resume()
        self._push(rows)

    def _push(self, rows: Floats) -> None:
        """Check, correct and push rows (n, 11), and emit the lines that they complete."""
        if not len(rows):
            return
        self._check.push(rows)
        # Axes and calibration are applied as to a recording (`fg_nav.walk`).
        options = self._sensor.options
        acc, mag, found = rows[:, 1:4], rows[:, 7:10], options.calibration
        if options.mag_axes is not None:
            mag = mag @ options.mag_axes.P.T
        if found is not None and found.magnetometer is not None:
            mag = np.asarray(found.magnetometer.correct(mag))
        if found is not None and found.accelerometer is not None:
            acc = found.accelerometer.correct(acc)
        field = mag if options.online.use_field else None
        buffer = self._navigator.buffer
        before = buffer.stop
        made = self._navigator.push(rows[:, 0], acc, rows[:, 4:7], field, rows[:, 10])
        self._losses.push(rows[:, 0])
        self._verdict.axes.push(buffer.between(max(before, buffer.first), buffer.stop))
        self.report(made)

    def count_lost(self) -> dict[str, int]:
        """Return what was lost so far."""
        losses = self._losses
        return {"samples": losses.samples, "came": losses.came, "datagrams": self._sensor.source.lost}

    def count_losses(self) -> None:
        """Count what was lost in all, and remark it."""
        self._losses.finish()
        self._navigator.lost = lost = self.count_lost()
        for words in describe_losses(lost):
            self._remark(f"{words}.")

    def report(self, made: Sequence[StanceEstimate | Revision]) -> None:
        """Judge what the navigator made, and emit its lines once they are recorded."""
        sigma, navigator = self._sensor.options.rate_sigma, self._navigator
        made = [one.widen(sigma) if sigma > 0.0 and isinstance(one, StanceEstimate) else one for one in made]
        continues, lines = navigator.reported_continues, list[str]()
        for one, verdict in self._verdict.judge(made, continues):
            if isinstance(one, Revision):
                lines += format_revision(one)
            else:
                lines.append(format_estimate(one, continues[one.number], navigator.intake.sensor_time, verdict))
        if self._sensor.record is not None:
            self._sensor.record.add_lines(lines)
        for line in lines:
            self._emit(line)


# --- verdict on each line --------------------------------------------------------------------------------------------


class LineVerdict:
    """Judges the lines of a walk, in their order, and the `axes` of its samples; `rate_sigma` as of `StreamOptions`."""

    def __init__(self, in_pocket: bool = False, remark: Say = lambda words: None, rate_sigma: float = 0.0) -> None:
        self._in_pocket, self._rate_sigma = in_pocket, rate_sigma
        self.axes = AxesCheck(remark, "pocket" if in_pocket else "foot")
        self._begun: float | None = None
        self._last = np.zeros(4)  # t, east, north, up of the newest footfall
        self._distance, self._lost_s, self._strides = 0.0, 0.0, 0
        self._steepest, self._reach = (0.0, 0.0), 0.0
        self._fast = np.zeros((0, 3))  # Speed, time and end of the fastest strides, the fastest first.
        self._heights = np.zeros((0, 2))

    def judge(
        self, found: Sequence[StanceEstimate | Revision], continues: Sequence[bool]
    ) -> list[tuple[StanceEstimate | Revision, Verdict | None]]:
        """Return the lines, each estimate with the verdict on the path up to it; `continues` is that of all lines."""
        judged: list[tuple[StanceEstimate | Revision, Verdict | None]] = []
        for one in found:
            if isinstance(one, Revision):
                is_newest = len(one.path) > 0 and abs(one.path[-1, 0] - self._last[0]) < SAME_S
                self._last = one.path[-1] if is_newest else np.full(4, np.nan)
                judged.append((one, None))
            else:
                self._measure(np.append(one.t, one.position), continues[one.number])
                judged.append((one, limits.combine(self._list_reasons(one.pose_cov[:2, :2]))))
        return judged

    def _measure(self, now: Floats, continues: bool) -> None:
        """Measure the stride to a footfall, of which t, east, north, up (4,) are given."""
        before, self._last = self._last, now
        if self._begun is None:
            self._begun, self._heights = float(now[0]), now[None, [0, 3]]
            return
        self._strides += not continues
        took, moved = float(now[0] - before[0]), float(np.linalg.norm(now[1:] - before[1:]))
        if not (took > 0.0 and np.isfinite(moved)):
            return
        self._distance += moved
        self._lost_s += took if took > DUE_S and not continues else 0.0
        self._reach = max(self._reach, float(np.hypot(*before[1:3])))
        fast = np.vstack([self._fast, [moved / took, took, now[0]]])
        self._fast = fast[np.argsort(-fast[:, 0], kind="stable")][:N_FASTEST]
        height = self._heights[-1, 1] + float(now[3] - before[3])
        self._heights = np.vstack([self._heights, [now[0], height]])[-MAX_HEIGHTS:]
        self._steepest = max(self._steepest, limits.find_height_rate(*self._heights.T))

    def _list_reasons(self, covariance: Floats) -> list[Reason]:
        assert self._begun is not None
        axes, way, sigma = self.axes.evidence, self._distance, float(np.sqrt(np.trace(covariance)))
        found = [
            limits.judge_position(covariance, way, self._in_pocket),
            limits.judge_axes(axes),
            limits.judge_rate(self._rate_sigma),
        ]
        if len(self._fast):
            speed, took, end = map(float, self._fast[0])
            found.append(limits.judge_speed(speed, end))
            if len(self._fast) == N_FASTEST:
                found.append(limits.judge_stride(speed * took, took, end, float(self._fast[-1, 0]), sigma, way))
        if self._in_pocket:
            return found
        found.append(limits.judge_height_rate(*self._steepest))
        found.append(limits.judge_beginning(self._strides, axes.strides))
        usual = way / max(float(self._last[0]) - self._begun, 1e-9) if self._strides else 0.0
        words = f"{self._lost_s:.1f} s of motion without a footfall"
        found.append(limits.judge_unfollowed(self._lost_s, usual, sigma, way, words))
        if axes.strides >= MIN_STRIDES:
            found.append(limits.judge_gravity(float(np.median(axes.gravity)), self._reach, sigma, way))
        return found
