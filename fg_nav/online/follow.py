"""Follow a source to its end: rows in, estimates out, each with the verdict on the path so far, checkpoints on the way.

    StreamOptions  how a source is followed: options of the navigator, calibration, checkpoint
    follow_source  rows -> navigator -> one line an estimate, until the source ends or an event is set
    LineVerdict    judges the path up to each line
    Outlets        where lines and remarks go: a printer or a port, and a page for people
    StreamedWalk   the closed navigator, to be solved as a whole

Nothing that happens to the stream ends the walk but its end: bad rows are left out, and a stalled source is waited for,
with a remark on each. Checkpoints come every `checkpoint_s`, are written in a thread of their own, and less often once
that takes long: at most one part in twenty of the time goes into it.

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
from contextlib import ExitStack, closing, contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.calibration.of_recording import Calibration
from fg_nav.errors import EstimationError, FgNavError
from fg_nav.frames import compute_heading
from fg_nav.magnetic.axes import MagAxes
from fg_nav.online.buffer import OnlineOptions
from fg_nav.online.checkpoint import Checkpoint, Snapshot
from fg_nav.online.estimates import DIGITS, Revision, StanceEstimate, format_estimate, format_revision, thin_rows
from fg_nav.online.pocket import Navigator, PocketOptions, begin_walk
from fg_nav.online.record_check import report_damaged
from fg_nav.online.rows import Columns
from fg_nav.online.source_check import AxesCheck, LossCounter, Silence, SourceCheck, describe_losses
from fg_nav.online.sources import SampleSource
from fg_nav.solution import Return
from fg_nav.text import to_json
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
SAVING_SHARE = 0.05  # of the time at most

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
    remark, refuses : as of `AxesCheck`.
    rate_sigma : of a nominal sample rate, a share of it; 0 where rows have stamps.
    """

    def __init__(
        self,
        in_pocket: bool = False,
        remark: Callable[[str], None] = lambda words: None,
        refuses: bool = True,
        rate_sigma: float = 0.0,
    ) -> None:
        self._in_pocket, self._rate_sigma = in_pocket, rate_sigma
        self.axes = AxesCheck(remark, refuses, "pocket" if in_pocket else "foot")
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
                is_newest = abs(one.path[-1, 0] - self._last[0]) < SAME_S
                self._last = one.path[-1] if is_newest else np.full(4, np.nan)
                judged.append((one, None))
            else:
                self._measure(np.append(one.t, one.position), continues[one.number])
                judged.append((one, combine(self._list_reasons(one.pose_cov[:2, :2]))))
        return judged

    def state(self) -> dict[str, Any]:
        """Return what `resume` needs, as JSON values."""
        numbers = (self._distance, self._lost_s, self._reach, *self._steepest)
        return {
            "begun": self._begun,
            "last": self._last.tolist(),
            "numbers": [float(one) for one in numbers],
            "heights": self._heights.tolist(),
            "fast": self._fast.tolist(),
            "strides": self._strides,
            "axes": self.axes.state(),
        }

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on where another verdict on the same walk was."""
        self._begun = None if state["begun"] is None else float(state["begun"])
        self._last = np.array(state["last"], dtype=float).reshape(4)
        self._distance, self._lost_s, self._reach, rate, when = map(float, state["numbers"])
        self._steepest = rate, when
        self._fast = np.array(state["fast"], dtype=float).reshape(-1, 3)
        self._heights = np.array(state["heights"], dtype=float).reshape(-1, 2)
        self._strides = int(state["strides"])
        self.axes.resume(state["axes"])

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
    checkpoint: Path | None = None  # File to save the walk in, and to resume it from if it is there.
    checkpoint_s: float = 10.0  # Between two saves.
    stalled_s: float = 5.0  # Silence after which it is remarked that the source stalls.
    until_silent_s: float | None = None  # Silence after which the walk ends; None to wait for ever.
    calibration: Calibration | None = None  # To apply.
    mag_axes: MagAxes | None = None  # Of the magnetometer in those of the gyroscope; None for the same.
    columns: Columns | None = None  # Of rows without a header, which a checkpoint must share.
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
) -> Navigator:
    """Follow a source to its end; return the navigator, closed, with the whole walk.

    Raises `FormatError`, `RecordingError`, `EstimationError` if the rows are of another format or unit, or a checkpoint
    cannot be resumed.

    Parameters
    ----------
    emit : called with one line of JSON (`fg_nav.online.estimates`) for each estimate.
    remark : called with a sentence for people about what is odd.
    stop : ends the walk when it is set.
    watcher : sent the status between footfalls; None without.
    """
    checkpoint = None if options.checkpoint is None else Checkpoint(options.checkpoint)
    with nullcontext() if checkpoint is None else checkpoint.hold():
        # the walk, new or resumed
        navigator = _open_navigator(options, checkpoint, remark)
        status = None if watcher is None else StatusReporter(watcher)
        walk = FollowedWalk(navigator, options, checkpoint, emit, remark, status)
        if navigator.footfalls:  # its path, for clients that have not seen it
            table = navigator.smoothed()
            path = np.column_stack([table.t, table.position])[thin_rows(len(table))]
            walk.emit_lines([(Revision(float(table.t[-1]), 0.0, (), path), None)])
        if navigator.source.get("header") and options.checkpoint is not None:
            with report_damaged(options.checkpoint):
                source.resume(navigator.source["header"])
        # the source, to its end
        silence = Silence(source.name, options.stalled_s, options.until_silent_s, remark)
        while not (stop is not None and stop.is_set()):
            rows = source.read(WAIT_S)
            if rows is None or silence.is_over(len(rows)):
                break
            walk.add(rows, source.header)
            walk.show_status(source.lost)
        walk.add(source.finish(), source.header)
        walk.end(source.lost)
    return navigator


def _open_navigator(options: StreamOptions, checkpoint: Checkpoint | None, remark: Say) -> Navigator:
    path, axes = options.checkpoint, options.mag_axes
    given = {"calibration": to_json(options.calibration), "columns": to_json(options.columns)}
    given["mag_axes"] = None if axes is None else str(axes)
    if path is None or checkpoint is None or not path.exists():
        navigator = begin_walk(options.online, remark, background=options.background)
        navigator.source |= given
        return navigator
    navigator = checkpoint.resume(options.online, remark, background=options.background)
    changed = {"calibration": "another calibration", "columns": "other --columns", "mag_axes": "other --mag-axes"}
    for key, words in changed.items():
        if navigator.source.get(key) != given[key]:
            raise EstimationError(f"{path.name} was made with {words}: give the same, or name another.")
    rows = "strides" if isinstance(options.online, PocketOptions) else "stances"
    remark(f"resumed from {path.name}: {len(navigator.footfalls)} {rows}, {navigator.buffer.stop} samples.")
    return navigator


class FollowedWalk:
    """Gives samples to the navigator, emits the lines of its estimates, and saves the walk in its checkpoint.

    Arguments are as of `follow_source`; the checkpoint is held, the status reported if somebody may watch.
    """

    def __init__(
        self,
        navigator: Navigator,
        options: StreamOptions,
        checkpoint: Checkpoint | None,
        emit: Say,
        remark: Say,
        status: StatusReporter | None = None,
    ) -> None:
        self._checkpoint, self._navigator, self._options = checkpoint, navigator, options
        self._emit, self._remark, self._status, self._unsaved = emit, remark, status, False
        self._races, self._due = navigator.races, time.monotonic() + options.checkpoint_s
        self._check = SourceCheck("pocket" if isinstance(options.online, PocketOptions) else "foot", remark)
        in_pocket = isinstance(options.online, PocketOptions)
        self._verdict = LineVerdict(in_pocket, remark, not navigator.footfalls, options.rate_sigma)
        self.losses = LossCounter(remark)
        # what a checkpoint keeps beside the navigator
        self._parts: dict[str, SourceCheck | LineVerdict | LossCounter] = {
            "check": self._check,
            "verdict": self._verdict,
            "losses": self.losses,
        }
        with nullcontext() if options.checkpoint is None else report_damaged(options.checkpoint):
            for name, part in self._parts.items():
                if name in navigator.source:
                    part.resume(navigator.source[name])
        self._saving: threading.Thread | None = None

    def add(self, rows: Floats, header: list[str] | None) -> None:
        """Calibrate and push rows (n, 11), emit the lines that they complete, save if due; `header` names columns."""
        if self._status is not None:
            self._status.count_samples(len(rows))
        if not len(rows):
            return
        self._check.add(rows)
        self._navigator.source["header"] = header
        overlap = self._navigator.judge.overlap
        # Axes and calibration are applied as to a recording (`fg_nav.walk`).
        acc, mag, found = rows[:, 1:4], rows[:, 7:10], self._options.calibration
        if self._options.mag_axes is not None:
            mag = mag @ self._options.mag_axes.P.T
        if found is not None and found.magnetometer is not None:
            mag = np.asarray(found.magnetometer.correct(mag))
        if found is not None and found.accelerometer is not None:
            acc = found.accelerometer.correct(acc)
        field = mag if self._options.online.use_field else None
        made = self._navigator.push(rows[:, 0], acc, rows[:, 4:7], field, rows[:, 10])
        self.losses.add(rows[:, 0], overlap)
        self._verdict.axes.look_at(self._navigator.buffer)
        judged = self._judge(made)
        # What depends on the machine's speed is saved before it is sent, once the last save is done.
        raced = self._navigator.races != self._races and self._due < np.inf
        if self._checkpoint is not None and (raced or time.monotonic() >= self._due):
            self._save(self._checkpoint)
        self.emit_lines(judged)

    def end(self, lost_datagrams: int) -> None:
        """Save and end the walk, and emit its last lines; `lost_datagrams` as the source counted them."""
        self.count_losses(lost_datagrams)
        if self._checkpoint is not None:
            self._save(self._checkpoint)
            if self._saving is not None:
                self._saving.join()
        self.report(self._navigator.close())
        self.show_status(lost_datagrams, ended=True)

    def count_losses(self, lost_datagrams: int) -> None:
        """Count what was lost in all, and remark it."""
        self.losses.finish()
        self._navigator.source["lost"] = lost = self.losses.report(lost_datagrams)
        for words in describe_losses(lost):
            self._remark(f"{words}.")

    def report(self, made: Sequence[StanceEstimate | Revision]) -> None:
        """Judge what the navigator made, and emit its lines."""
        self.emit_lines(self._judge(made))

    def _judge(self, made: Sequence[StanceEstimate | Revision]) -> list[Judged]:
        if self._options.rate_sigma > 0.0:
            made = [one if isinstance(one, Revision) else one.widen(self._options.rate_sigma) for one in made]
        return self._verdict.judge(made, self._navigator.reported_continues)

    def show_status(self, lost_datagrams: int, ended: bool = False) -> None:
        """Send the status between footfalls."""
        if self._status is not None:
            self._status.report(lambda: describe_walk(self._navigator), self.losses.report(lost_datagrams), ended)

    def emit_lines(self, found: Sequence[Judged]) -> None:
        """Emit the JSON lines of estimates, each with its verdict, and of revisions."""
        for one, verdict in found:
            if isinstance(one, Revision):
                for line in format_revision(one):
                    self._emit(line)
            else:
                continues = self._navigator.reported_continues[one.number]
                self._emit(format_estimate(one, continues, self._navigator.judge.sensor_time, verdict))
                if self._status is not None:
                    self._status.note_line()

    def _save(self, checkpoint: Checkpoint) -> None:
        """Save in a thread: only what is collected holds the walk up."""
        if self._saving is not None:
            self._saving.join()
        self._navigator.source |= {name: part.state() for name, part in self._parts.items()}
        snapshot, self._races = checkpoint.collect(self._navigator), self._navigator.races
        self._saving = threading.Thread(target=self._write, args=(snapshot, checkpoint))
        self._due = np.inf
        self._saving.start()

    def _write(self, snapshot: Snapshot, checkpoint: Checkpoint) -> None:
        began = time.monotonic()
        try:
            checkpoint.write(snapshot)
            self._unsaved = False
        except FgNavError as error:  # the walk goes on, disk full or not
            if not self._unsaved:
                self._remark(str(error))
            self._unsaved = True
        finally:
            took = time.monotonic() - began
            self._due = time.monotonic() + max(self._options.checkpoint_s, took / SAVING_SHARE)
