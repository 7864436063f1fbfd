"""Follow a source to its end: rows in, estimates out, each with the verdict on the path so far, recorded on the way.

    StreamOptions  how a source is followed: options of the navigator, calibration, columns
    follow_source  rows -> navigator -> one line an estimate, until the source ends or an event is set
    LineVerdict    judges the path up to each line
    Outlets        where lines and remarks go: a printer or a port, and a page for people
    StreamedWalk   the closed navigator, to be solved as a whole

Nothing that happens to the stream ends the walk but its end: bad rows are left out, and a stalled source is waited for,
with a remark on each.

A walk that is resumed is replayed: its recorded rows pass the same checks into a new navigator, without a word, and
where the lines that were given end it is solved once (`record`). Then it goes on with what the source sends.

Verdict: the limits are those of `fg_nav.verdict.limits`. A path that was spoiled stays so, and none is trusted before
it has as many strides as make a walk, and the axes were seen in as many. Between two lines a new solution may move the
map. A stride is measured within one map: where the past was revised, from its newest footfall in the new map; where the
revision does not include it, the stride to the next line is not measured.

Outlets: `emit` gets the lines of the moment, `emit_end` those of the whole walk at its end, which are not served: a
client of the port follows a walk. The page gets all of them; `emit_end` is None if nothing takes those of the end. The
page is shown the status between footfalls too (its keys are in docs/online.md); what is not known yet is null. Sigmas
and the verdict on the field are those of the newest line.
"""

from __future__ import annotations

import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.calibration.of_recording import Calibration
from fg_nav.detection.source import AxesCheck, SourceCheck
from fg_nav.frames import compute_heading
from fg_nav.magnetic.axes import MagAxes
from fg_nav.online.buffer import OnlineOptions
from fg_nav.online.estimates import DIGITS, Revision, StanceEstimate, format_estimate, format_revision
from fg_nav.online.pocket import Navigator, PocketOptions, begin_walk
from fg_nav.online.record import Record
from fg_nav.online.rows import Columns
from fg_nav.online.sources import SampleSource
from fg_nav.samples.delivery import LossCounter, Silence, describe_losses
from fg_nav.solution import Return
from fg_nav.text import find_version
from fg_nav.verdict.limits import (
    Reason,
    Verdict,
    combine,
    find_height_rate,
    judge_axes,
    judge_beginning,
    judge_gravity,
    judge_height_rate,
    judge_position,
    judge_rate,
    judge_speed,
    judge_stride,
    judge_unfollowed,
)
from fg_nav.view.line_server import format_address, is_loopback, open_port
from fg_nav.view.process import ListenerProcess

WAIT_S = 0.2  # for bytes, before the stop signal is checked
REPLAYED = 1 << 14  # rows of a record at once; the answer does not depend on it

# Ctrl-C, a service that is stopped, a terminal or connection that is gone: they end the walk.
ENDING = (signal.SIGINT, signal.SIGTERM, *([signal.SIGHUP] if hasattr(signal, "SIGHUP") else []))
HOST = "127.0.0.1"  # that serves lines
RATE_S = 2.0  # in which samples are counted for their rate
SILENT_S = 1.5  # without samples, after which a source is called silent

Say = Callable[[str], None]  # Called with a line, or a sentence for people.
DUE_S = 4.0  # To the next line at most: a standing has one every two seconds.
MIN_STRIDES = 5  # Of which the median of gravity is judged.
N_FASTEST = 4  # Strides, by the slowest of which the fastest is judged: who begins to run makes more of them.
MAX_HEIGHTS = 32  # More than are made in the time over which their rate is measured.
SAME_S = 1e-3  # Stamps of one footfall, of any clock: less than a sample apart.

Judged: TypeAlias = tuple[StanceEstimate | Revision, Verdict | None]  # A line of a walk; the verdict on an estimate.


# --- outlets ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Outlets:
    """Where lines, those of the end, and remarks go; and the process that is sent the status."""

    emit: Say
    emit_end: Say | None
    remark: Say
    watcher: ListenerProcess | None = None


@contextmanager
def open_outlets(serve: int | None, view: tuple[str, int] | None, print_line: Say, remark: Say) -> Iterator[Outlets]:
    """Open what was requested.

    Raises `StreamError` if a port cannot be served.

    Parameters
    ----------
    serve : port for the lines, which are then not printed; None without.
    view : host and port of the page; None without.
    print_line, remark : called with lines, and with sentences for people.
    """
    with ExitStack() as opened:
        lines = None if serve is None else opened.enter_context(open_port(HOST, serve, "--serve"))
        page = None if view is None else opened.enter_context(open_port(*view, "--port or --host"))
        if lines is not None:
            remark(f"lines are served on {HOST}:{lines.getsockname()[1]}.")
        if page is not None and view is not None:
            reach = "for all who reach this machine: there is no password, and no encryption"
            reach = "for this machine alone" if is_loopback(view[0]) else reach
            remark(f"the walk is shown on {format_address(view[0], page.getsockname()[1])} ({reach}).")
        if lines is None and page is None:
            yield Outlets(print_line, print_line, remark)
            return
        host = HOST if view is None else view[0]
        listeners = opened.enter_context(closing(ListenerProcess(lines, page, host, remark)))
        emit = listeners.send_line if lines is not None else _both(print_line, listeners.send)
        if page is None:
            yield Outlets(emit, None, remark)
            return
        emit_end = listeners.send if lines is not None else emit
        yield Outlets(emit, emit_end, _both(remark, listeners.send_remark), listeners)


def _both(first: Say, second: Say) -> Say:
    def say(words: str) -> None:
        first(words)
        second(words)

    return say


class StatusReporter:
    """Measures rate, latency and silence while a source is followed, and sends the status while somebody watches."""

    def __init__(self, watcher: ListenerProcess) -> None:
        self._watcher = watcher
        self._due = self._arrived = time.monotonic()
        self._silent_since: float | None = None
        self._counts: deque[tuple[float, int]] = deque()
        self._latency_ms: float | None = None

    def count_samples(self, count: int) -> None:
        """Note how many samples have come, at each read: one that finds none begins a silence."""
        now = time.monotonic()
        if count:
            self._arrived, self._silent_since = now, None
            self._counts.append((now, count))
        elif self._silent_since is None:
            self._silent_since = now

    def note_line(self) -> None:
        """Note that a line was just sent."""
        self._latency_ms = 1e3 * (time.monotonic() - self._arrived)

    def report(self, describe: Callable[[], dict[str, Any]], lost: Mapping[str, int], ended: bool = False) -> None:
        """Send the status if it is due and somebody watches; at the end always.

        `describe` returns what the samples so far show, in some milliseconds; `lost` is that of `LossCounter`.
        """
        now = time.monotonic()
        while self._counts and self._counts[0][0] < now - RATE_S:
            self._counts.popleft()
        if not (ended or (now >= self._due and self._watcher.viewers)):
            return
        self._due = now + self._watcher.status_s
        silent_s = 0.0 if self._silent_since is None else now - self._silent_since
        source = "ok" if silent_s < SILENT_S else f"silent {silent_s:.0f} s"
        flow = {
            "latency_ms": None if self._latency_ms is None else round(self._latency_ms, 1),
            "rate_hz": round(sum(count for _, count in self._counts) / RATE_S, 1),
            "lost_samples": lost["samples"],
            "lost_datagrams": lost["datagrams"],
            "source": "ended" if ended else source,
        }
        self._watcher.send_status({**describe(), **flow})


def describe_walk(navigator: Navigator) -> dict[str, Any]:
    """Return what the samples so far show of a walk; the pose costs some milliseconds."""
    stop, pose = navigator.buffer.stop, navigator.pose()
    heading_deg = None if pose is None else float(np.degrees(float(compute_heading(pose.nav_R_body[-1]))) % 360.0)
    return {
        "t": round(navigator.buffer.stamp(stop - 1), DIGITS) if stop else None,
        "standing": navigator.stands,
        "position_m": None if pose is None else np.round(pose.position[-1], DIGITS),
        "heading_deg": None if heading_deg is None else round(heading_deg, DIGITS),
        "floor": navigator.floor,
        "returns": [list_ends(one) for one in navigator.returns],
    }


def list_ends(one: Return) -> list[float]:
    """Begin and end of a return, and of the earlier pass, s."""
    return [round(float(t), DIGITS) for t in (one.t[0], one.t[-1], one.earlier_t.min(), one.earlier_t.max())]


# --- verdict on each line --------------------------------------------------------------------------------------------


class LineVerdict:
    """Judges the lines of a walk, in their order; `axes` of its samples.

    Parameters
    ----------
    in_pocket : whether the sensor is in a pocket: a line is then two steps, and places are less certain.
    remark : as of `AxesCheck`.
    rate_sigma : of a nominal sample rate, a share of it; 0 where rows have stamps.
    """

    def __init__(
        self,
        in_pocket: bool = False,
        remark: Callable[[str], None] = lambda words: None,
        rate_sigma: float = 0.0,
    ) -> None:
        self._in_pocket, self._rate_sigma = in_pocket, rate_sigma
        self.axes = AxesCheck(remark, "pocket" if in_pocket else "foot")
        self._begun: float | None = None
        self._last = np.zeros(4)  # t, east, north, up of the newest footfall
        self._distance, self._lost_s, self._strides = 0.0, 0.0, 0
        self._steepest, self._reach = (0.0, 0.0), 0.0
        self._fast = np.zeros((0, 3))  # Speed, time and end of the fastest strides, the fastest first.
        self._heights = np.zeros((0, 2))

    def judge(self, found: Sequence[StanceEstimate | Revision], continues: Sequence[bool]) -> list[Judged]:
        """Return the lines, each estimate with the verdict on the path up to it; `continues` is that of all lines."""
        judged: list[Judged] = []
        for one in found:
            if isinstance(one, Revision):
                is_newest = len(one.path) > 0 and abs(one.path[-1, 0] - self._last[0]) < SAME_S
                self._last = one.path[-1] if is_newest else np.full(4, np.nan)
                judged.append((one, None))
            else:
                self._measure(np.append(one.t, one.position), continues[one.number])
                judged.append((one, combine(self._list_reasons(one.pose_cov[:2, :2]))))
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
        self._steepest = max(self._steepest, find_height_rate(*self._heights.T))

    def _list_reasons(self, covariance: Floats) -> list[Reason]:
        assert self._begun is not None
        axes, way, sigma = self.axes.evidence, self._distance, float(np.sqrt(np.trace(covariance)))
        found = [judge_position(covariance, way, self._in_pocket), judge_axes(axes), judge_rate(self._rate_sigma)]
        if len(self._fast):
            speed, took, end = map(float, self._fast[0])
            found.append(judge_speed(speed, end))
            if len(self._fast) == N_FASTEST:
                found.append(judge_stride(speed * took, took, end, float(self._fast[-1, 0]), sigma, way))
        if self._in_pocket:
            return found
        found.append(judge_height_rate(*self._steepest))
        found.append(judge_beginning(self._strides, axes.strides))
        usual = way / max(float(self._last[0]) - self._begun, 1e-9) if self._strides else 0.0
        words = f"{self._lost_s:.1f} s of motion without a footfall"
        found.append(judge_unfollowed(self._lost_s, usual, sigma, way, words))
        if axes.strides >= MIN_STRIDES:
            found.append(judge_gravity(float(np.median(axes.gravity)), self._reach, sigma, way))
        return found


# --- the source ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class StreamedWalk:
    """A walk that has ended: its navigator, the name of its source, and the calibration and axes that were applied.

    `polish` requests its batch solution as well; `rate_sigma` as of `StreamOptions`.
    """

    navigator: Navigator
    name: str
    calibration: Calibration | None
    mag_axes: MagAxes | None = None
    polish: bool = False
    rate_sigma: float = 0.0


@dataclass(frozen=True)
class StreamOptions:
    """How a source is followed."""

    online: OnlineOptions | PocketOptions = field(default_factory=OnlineOptions)
    stalled_s: float = 5.0  # Silence after which it is remarked that the source stalls.
    until_silent_s: float | None = None  # Silence after which the walk ends; None to wait for ever.
    calibration: Calibration | None = None  # To apply.
    mag_axes: MagAxes | None = None  # Of the magnetometer in those of the gyroscope; None for the same.
    columns: Columns | None = None  # Of rows without a header.
    background: bool = False  # Whether the walk is solved again in another process.

    @property
    def rate_sigma(self) -> float:
        """Sigma of the rate by which stamps are counted, a share of it; 0 where rows have stamps."""
        return 0.0 if self.columns is None else self.columns.rate_sigma


def follow_source(
    source: SampleSource,
    options: StreamOptions,
    emit: Say,
    remark: Say,
    stop: threading.Event | None = None,
    watcher: ListenerProcess | None = None,
    record: Record | None = None,
) -> Navigator:
    """Follow a source to its end; return the navigator, closed, with the whole walk.

    Raises `FormatError`, `RecordingError`, `EstimationError` if the rows are of another format or unit, or the walk of
    the record cannot be resumed.

    Parameters
    ----------
    emit : called with one line of JSON (`fg_nav.online.estimates`) for each estimate.
    remark : called with a sentence for people about what is odd.
    stop : ends the walk when it is set.
    watcher : sent the status between footfalls; None without.
    record : what comes and what is given is recorded there, and its walk goes on; None without.
    """
    status = None if watcher is None else StatusReporter(watcher)
    walk = FollowedWalk.begin(options, emit, remark, status, record)
    if record is not None and record.given is not None:
        walk.replay(record)
        if record.header is not None:
            source.resume(record.header)
    # The source, to its end.
    silence = Silence(source.name, options.stalled_s, options.until_silent_s, remark)
    while not (stop is not None and stop.is_set()):
        rows = source.read(WAIT_S)
        if rows is None or silence.is_over(len(rows)):
            break
        walk.add(rows, source.header)
        walk.show_status(source.lost)
    walk.add(source.finish(), source.header, at_end=True)
    walk.end(source.lost)
    return walk.navigator


class FollowedWalk:
    """Gives samples to the navigator, and emits the lines of its estimates; both are recorded first, if at all.

    Arguments are as of `follow_source`; the status is reported if somebody may watch.
    """

    def __init__(
        self,
        navigator: Navigator,
        options: StreamOptions,
        emit: Say,
        remark: Say,
        status: StatusReporter | None = None,
        record: Record | None = None,
    ) -> None:
        self.navigator, self._options, self._record = navigator, options, record
        self._emit, self._remark, self._status, self.is_replayed = emit, remark, status, False
        in_pocket = isinstance(options.online, PocketOptions)
        self._check = SourceCheck("pocket" if in_pocket else "foot", remark)
        self._verdict = LineVerdict(in_pocket, remark, options.rate_sigma)
        self.losses = LossCounter(remark)

    @classmethod
    def begin(
        cls,
        options: StreamOptions,
        emit: Say,
        remark: Say,
        status: StatusReporter | None = None,
        record: Record | None = None,
    ) -> FollowedWalk:
        """Return a walk with a navigator of its own; what is remarked while it is replayed was said before."""

        def remark_new(words: str) -> None:
            if not walk.is_replayed:
                remark(words)

        navigator = begin_walk(options.online, remark_new, background=options.background)
        walk = cls(navigator, options, emit, remark_new, status, record)
        if record is not None:
            record.begin(
                {
                    "version": find_version(),
                    "options": options.online,
                    "calibration": options.calibration,
                    "columns": options.columns,
                    "mag_axes": None if options.mag_axes is None else str(options.mag_axes),
                }
            )
        return walk

    def replay(self, record: Record) -> None:
        """Bring the walk to where its record ends, and emit its past, and the lines that were not given yet."""
        assert record.given is not None
        self.is_replayed = True
        self.navigator.resume(record.given)
        self._verdict.judge(record.given.lines, record.given.continues)
        for number, part in enumerate(record.replay()):
            if number:
                self.navigator.intake.resume()
            for start in range(0, len(part), REPLAYED):
                self._push(part[start : start + REPLAYED])
        self.report(self.navigator.end_replay())
        self.is_replayed = False
        name, walked = record.path.name, "strides" if isinstance(self._options.online, PocketOptions) else "stances"
        n_footfalls, n_samples = len(self.navigator.footfalls), self.navigator.buffer.stop
        self._remark(f"resumed from {name}: {n_footfalls} {walked}, {n_samples} samples.")

    def add(self, rows: Floats, header: list[str] | None, at_end: bool = False) -> None:
        """Record and push rows (n, 11), and emit the lines that they complete; `header` names their columns."""
        if self._status is not None:
            self._status.count_samples(len(rows))
        if self._record is not None:
            rows = self._record.add(rows, header, at_end)
            if self._record.is_interrupted:
                self.navigator.intake.resume()
        self._push(rows)

    def _push(self, rows: Floats) -> None:
        if not len(rows):
            return
        self._check.push(rows)
        # Axes and calibration are applied as to a recording (`fg_nav.walk`).
        acc, mag, found = rows[:, 1:4], rows[:, 7:10], self._options.calibration
        if self._options.mag_axes is not None:
            mag = mag @ self._options.mag_axes.P.T
        if found is not None and found.magnetometer is not None:
            mag = np.asarray(found.magnetometer.correct(mag))
        if found is not None and found.accelerometer is not None:
            acc = found.accelerometer.correct(acc)
        field = mag if self._options.online.use_field else None
        buffer = self.navigator.buffer
        before = buffer.stop
        made = self.navigator.push(rows[:, 0], acc, rows[:, 4:7], field, rows[:, 10])
        self.losses.push(rows[:, 0])
        self._verdict.axes.push(buffer.between(max(before, buffer.first), buffer.stop))
        self.report(made)

    def end(self, lost_datagrams: int) -> None:
        """End the walk, and emit its last lines; `lost_datagrams` as the source counted them."""
        self.count_losses(lost_datagrams)
        self.report(self.navigator.close())
        self.show_status(lost_datagrams, ended=True)

    def count_losses(self, lost_datagrams: int) -> None:
        """Count what was lost in all, and remark it."""
        self.losses.finish()
        self.navigator.lost = lost = self.losses.report(lost_datagrams)
        for words in describe_losses(lost):
            self._remark(f"{words}.")

    def report(self, made: Sequence[StanceEstimate | Revision]) -> None:
        """Judge what the navigator made, and emit its lines once they are recorded."""
        if self._options.rate_sigma > 0.0:
            made = [one if isinstance(one, Revision) else one.widen(self._options.rate_sigma) for one in made]
        continues, lines = self.navigator.reported_continues, list[tuple[str, bool]]()
        for one, verdict in self._verdict.judge(made, continues):
            if isinstance(one, Revision):
                lines += [(line, False) for line in format_revision(one)]
            else:
                line = format_estimate(one, continues[one.number], self.navigator.intake.sensor_time, verdict)
                lines.append((line, True))
        if self._record is not None:
            self._record.add_lines([line for line, _ in lines])
        for line, is_of_now in lines:
            self._emit(line)
            if is_of_now and self._status is not None:
                self._status.note_line()

    def show_status(self, lost_datagrams: int, ended: bool = False) -> None:
        """Send the status between footfalls."""
        if self._status is not None:
            self._status.report(lambda: describe_walk(self.navigator), self.losses.report(lost_datagrams), ended)
