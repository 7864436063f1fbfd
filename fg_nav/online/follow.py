"""Follow a source to its end: rows in, estimates out, checkpoints on the way. `fg-nav stream` does (`request`).

    follow_source  -> rows -> navigator -> one line an estimate, until the source ends or an event says stop

Nothing that happens to the stream ends the walk but its end: bad rows are left out, and a stalled source is waited for,
with a remark on each. Checkpoints come every `checkpoint_s`, are written in a thread of their own, and less often once
that takes long: at most one part in twenty of the time goes into it.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.calibration.of_recording import Calibration
from fg_nav.errors import EstimationError, FgNavError
from fg_nav.magnetic.axes import MagAxes
from fg_nav.online.checkpoint import Checkpoint, Snapshot
from fg_nav.online.estimates import StanceEstimate, format_estimate
from fg_nav.online.line_verdict import Judged, LineVerdict
from fg_nav.online.losses import LossCounter, describe_losses
from fg_nav.online.options import OnlineOptions
from fg_nav.online.outlets import Say
from fg_nav.online.pocket import Navigator, PocketOptions, begin_walk
from fg_nav.online.record_check import say_damaged
from fg_nav.online.revision import Revision, describe_past, format_revision
from fg_nav.online.rows import Columns
from fg_nav.online.silence import Silence
from fg_nav.online.source_check import SourceCheck
from fg_nav.online.sources import SampleSource
from fg_nav.online.status import StatusReporter, Watcher
from fg_nav.text import to_json

WAIT_S = 0.2  # For bytes, before the stop signal is checked.
SAVING_SHARE = 0.05  # Of the time at most.


@dataclass(frozen=True)
class StreamOptions:
    """How a source is followed.

    Attributes
    ----------
    online : options of the smoother, or of a sensor in a pocket.
    checkpoint : file to save the walk in, and to resume it from if it is there; None without.
    checkpoint_s : time between two saves, s.
    stalled_s : silence after which a remark says that the source stalls, s.
    until_silent_s : silence after which the walk ends, s; None to wait for ever.
    calibration : to apply; None without.
    mag_axes : of the magnetometer in those of the gyroscope; None for the same.
    columns : of rows without a header, which a checkpoint must share; None where the source names them.
    beside : whether the walk is solved again in another process.
    """

    online: OnlineOptions | PocketOptions = field(default_factory=OnlineOptions)
    checkpoint: Path | None = None
    checkpoint_s: float = 10.0
    stalled_s: float = 5.0
    until_silent_s: float | None = None
    calibration: Calibration | None = None
    mag_axes: MagAxes | None = None
    columns: Columns | None = None
    beside: bool = False


def follow_source(
    source: SampleSource,
    options: StreamOptions,
    emit: Say,
    remark: Say,
    stop: threading.Event | None = None,
    watcher: Watcher | None = None,
) -> Navigator:
    """Follow a source to its end.

    Parameters
    ----------
    source
        Of samples.
    options
        How.
    emit
        Given one JSON line (`fg_nav.online.estimates`) for each estimate.
    remark
        Given a sentence for people about what is odd.
    stop
        Ends the walk when it is set.
    watcher
        Shown what holds between footfalls; None without.

    Returns
    -------
    Navigator
        Closed: ask it for the whole walk.

    Raises
    ------
    FormatError, RecordingError, EstimationError
        Where the rows are of another format or unit, or a checkpoint cannot be resumed.
    """
    checkpoint = None if options.checkpoint is None else Checkpoint(options.checkpoint)
    with nullcontext() if checkpoint is None else checkpoint.hold():
        return _follow(source, options, checkpoint, emit, remark, stop, watcher)


def _follow(
    source: SampleSource,
    options: StreamOptions,
    checkpoint: Checkpoint | None,
    emit: Say,
    remark: Say,
    stop: threading.Event | None,
    watcher: Watcher | None,
) -> Navigator:
    navigator = _open_navigator(options, checkpoint, remark)
    status = None if watcher is None else StatusReporter(watcher)
    walk = FollowedWalk(navigator, options, checkpoint, emit, remark, status)
    walk.tell_past()
    if navigator.source.get("header") and options.checkpoint is not None:
        with say_damaged(options.checkpoint):
            source.resume(navigator.source["header"])
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
        navigator = begin_walk(options.online, remark, beside=options.beside)
        navigator.source |= given
        return navigator
    navigator = checkpoint.resume(options.online, remark, beside=options.beside)
    changed = {"calibration": "another calibration", "columns": "other --columns", "mag_axes": "other --mag-axes"}
    for key, words in changed.items():
        if navigator.source.get(key) != given[key]:
            raise EstimationError(f"{path.name} was made with {words}: give the same, or name another.")
    rows = "strides" if isinstance(options.online, PocketOptions) else "stances"
    remark(f"resumed from {path.name}: {len(navigator.footfalls)} {rows}, {navigator.buffer.stop} samples.")
    return navigator


class FollowedWalk:
    """Samples to the navigator, lines of its estimates, and the walk into its checkpoint.

    Parameters
    ----------
    navigator, options, emit, remark : as of `follow_source`.
    checkpoint : that is held; None without.
    status : reported to who watches; None without.
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
        rate_sigma = 0.0 if options.columns is None else options.columns.rate_sigma
        in_pocket = isinstance(options.online, PocketOptions)
        self._verdict = LineVerdict(in_pocket, remark, not navigator.footfalls, rate_sigma)
        self._losses = LossCounter(remark)
        with nullcontext() if options.checkpoint is None else say_damaged(options.checkpoint):
            for name, part in self._parts().items():
                if name in navigator.source:
                    part.resume(navigator.source[name])
        self._saving: threading.Thread | None = None

    def add(self, rows: Floats, header: list[str] | None) -> None:
        """Add rows (n, 11) of a source with this header."""
        if self._status is not None:
            self._status.count_samples(len(rows))
        if not len(rows):
            return
        self._check.add(rows)
        self._navigator.source["header"] = header
        overlap = self._navigator.judge.overlap
        acc, mag = self._corrected(rows[:, 1:4], rows[:, 7:10])
        field = mag if self._options.online.use_field else None
        made = self._navigator.push(rows[:, 0], acc, rows[:, 4:7], field, rows[:, 10])
        self._losses.add(rows[:, 0], overlap)
        self._verdict.look_at(self._navigator.buffer)
        found = self._judge(made)
        # What hung on the machine is saved before it is told, once the last save is done: it cannot be made again.
        raced = self._navigator.races != self._races and self._due < np.inf
        if self._checkpoint is not None and (raced or time.monotonic() >= self._due):
            self._save(self._checkpoint)
        self._emit_lines(found)

    def end(self, lost_datagrams: int) -> None:
        """End the walk, with what its source lost."""
        self.count_losses(lost_datagrams)
        if self._checkpoint is not None:
            self._save(self._checkpoint)
            self._wait()
        self.tell(self._navigator.close())
        self.show_status(lost_datagrams, ended=True)

    def count_losses(self, lost_datagrams: int) -> None:
        """Count what was lost in all, and say it."""
        self._losses.finish()
        self._navigator.source["lost"] = lost = self._losses.report(lost_datagrams)
        for words in describe_losses(lost):
            self._remark(f"{words}.")

    def tell(self, made: Sequence[StanceEstimate | Revision]) -> None:
        """Judge what the navigator made, and emit its lines."""
        self._emit_lines(self._judge(made))

    def _judge(self, made: Sequence[StanceEstimate | Revision]) -> list[Judged]:
        columns = self._options.columns
        if columns is not None and columns.rate_sigma > 0.0:
            made = [one if isinstance(one, Revision) else one.widen(columns.rate_sigma) for one in made]
        return self._verdict.judge(made, self._navigator.reported_continues)

    def report_losses(self, lost_datagrams: int) -> dict[str, int]:
        """Return what was lost so far, with the datagrams for which there was no room."""
        return self._losses.report(lost_datagrams)

    def show_status(self, lost_datagrams: int, ended: bool = False) -> None:
        """Report what holds between footfalls."""
        if self._status is not None:
            self._status.report(self._navigator, self._losses.report(lost_datagrams), ended)

    def tell_past(self) -> None:
        """Tell the path of a walk that was resumed, for who has not seen it."""
        if self._navigator.footfalls:
            self._emit_lines([(describe_past(self._navigator.smoothed()), None)])

    def _emit_lines(self, found: list[Judged]) -> None:
        for one, verdict in found:
            if isinstance(one, Revision):
                for line in format_revision(one):
                    self._emit(line)
            else:
                continues = self._navigator.reported_continues[one.number]
                self._emit(format_estimate(one, continues, self._navigator.judge.sensor_time, verdict))
                if self._status is not None:
                    self._status.note_line()

    def _parts(self) -> dict[str, SourceCheck | LineVerdict | LossCounter]:
        """What a checkpoint keeps beside the navigator, by name."""
        return {"check": self._check, "verdict": self._verdict, "losses": self._losses}

    def _save(self, checkpoint: Checkpoint) -> None:
        """Save in a thread: only what is collected holds the walk up."""
        self._wait()
        self._navigator.source |= {name: part.state() for name, part in self._parts().items()}
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

    def _wait(self) -> None:
        if self._saving is not None:
            self._saving.join()

    def _corrected(self, acc: Floats, mag: Floats) -> tuple[Floats, Floats]:
        """Apply axes and calibration as to a recording (`fg_nav.walk`)."""
        found = self._options.calibration
        if self._options.mag_axes is not None:
            mag = mag @ self._options.mag_axes.P.T
        if found is None:
            return acc, mag
        if found.magnetometer is not None:
            mag = np.asarray(found.magnetometer.correct(mag))
        if found.accelerometer is not None:
            acc = found.accelerometer.correct(acc)
        return acc, mag
