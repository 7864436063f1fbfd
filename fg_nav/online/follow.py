"""Follow a source to its end: rows in, estimates out, recorded on the way.

    StreamRequest  options of `fg-nav stream`: source, lag, heading, calibration, record
    run_stream     opens the source, and follows it to its end
    follow_source  rows -> navigator -> one line an estimate, until the source ends or an event is set
    StreamedWalk   the closed navigator, to be solved as a whole

Nothing that happens to the stream ends the walk but its end: bad rows are left out, and a stalled source is waited for,
with a remark on each.

A walk that is resumed is replayed: its recorded rows pass the same checks into a new navigator, without a word, and
where the lines that were given end it is solved once (`record`). Then it goes on with what the source sends.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.calibration.of_recording import Calibration, read_calibration
from fg_nav.detection.mount import Wearing
from fg_nav.errors import EstimationError, OutputError, StreamError
from fg_nav.io import read_fixes
from fg_nav.magnetic.axes import MagAxes
from fg_nav.magnetic.quasi_static import choose_gate
from fg_nav.online.buffer import OnlineOptions
from fg_nav.online.estimates import Revision, StanceEstimate, format_estimate, format_revision
from fg_nav.online.line_verdict import LineVerdict
from fg_nav.online.outlets import Outlets, Say, StatusReporter, describe_walk
from fg_nav.online.pocket import Navigator, PocketOptions, begin_walk
from fg_nav.online.record import Record
from fg_nav.online.rows import Columns, parse_columns
from fg_nav.online.source_check import LossCounter, Silence, SourceCheck, describe_losses
from fg_nav.online.sources import SampleSource, open_samples
from fg_nav.smoother.parameters import FieldParameters, SmootherParameters
from fg_nav.system.processes import catch_signals
from fg_nav.text import find_version
from fg_nav.view.process import ListenerProcess

WAIT_S = 0.2  # for bytes, before the stop signal is checked
REPLAYED = 1 << 14  # rows of a record at once; the answer does not depend on it
MIN_LAG_S = 10.0  # a shorter lag holds fewer strides than the smoother needs to estimate sensor and foot

# Ctrl-C, a service that is stopped, a terminal or connection that is gone: they end the walk.
ENDING = (signal.SIGINT, signal.SIGTERM, *([signal.SIGHUP] if hasattr(signal, "SIGHUP") else []))


@dataclass(frozen=True)
class StreamRequest:
    """Options of a user, as of `fg-nav stream --help`."""

    source: str
    lag_s: float | None = None
    heading_deg: float | None = None
    use_magnetometer: bool = True
    gate: str | None = None
    calibration_path: Path | None = None
    serve: int | None = None
    baud: int = 115200
    silence_s: float | None = None
    mag_axes: str | None = None
    polish: bool = False
    view: tuple[str, int] | None = None
    columns: str | None = None
    units: str | None = None
    rate_hz: float | None = None
    mount: Wearing = "foot"
    fixes_path: Path | None = None
    step_constant_m: float | None = None
    speed: str | None = None
    record: Path | None = None
    resume: bool = False
    force: bool = False


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


def run_stream(request: StreamRequest, outlets: Outlets) -> StreamedWalk:
    """Follow a source until it ends or a signal arrives; lines and remarks go to the outlets.

    Raises `FgNavError` if something that was requested cannot be: the source, the record, the rows.
    """
    options = read_stream_options(request)
    with catch_signals(*ENDING) as stop, ExitStack() as opened:
        record = _open_record(request, outlets.remark)
        if record is not None:
            opened.callback(record.close)
        source = opened.enter_context(closing(open_source_of(request, options.columns, outlets.remark)))
        navigator = follow_source(source, options, outlets.emit, outlets.remark, stop, outlets.watcher, record)
    given = options.calibration, options.mag_axes
    return StreamedWalk(navigator, source.name, *given, request.polish, options.rate_sigma)


def read_stream_options(request: StreamRequest) -> StreamOptions:
    """Turn a request into stream options, reading the files it names; raises `FgNavError` if an option is invalid."""
    calibration = None if request.calibration_path is None else read_calibration(request.calibration_path)
    axes = None if request.mag_axes is None else MagAxes.parse(request.mag_axes)
    return StreamOptions(
        online=_online_options(request, calibration),
        until_silent_s=_check_positive(request.silence_s, "--silence"),
        calibration=calibration,
        mag_axes=axes,
        columns=parse_columns(request.columns, request.units, request.rate_hz),
        background=True,
    )


def open_source_of(request: StreamRequest, columns: Columns | None, remark: Say) -> SampleSource:
    """Open the source of a request."""
    return open_samples(request.source, columns, request.baud, request.speed, remark)


def _open_record(request: StreamRequest, remark: Say) -> Record | None:
    path, source = request.record, Path(request.source)
    if path is None:
        if request.resume:
            raise StreamError("--resume goes on with the walk of a record: name it, as --record FILE.")
        return None
    if path.exists() and source.exists() and path.samefile(source):
        raise OutputError(f"{path} is what is streamed: name another file to record into.")
    return Record(path, request.resume, request.force, remark)


def _online_options(request: StreamRequest, calibration: Calibration | None) -> OnlineOptions | PocketOptions:
    heading = request.heading_deg
    if heading is not None and not np.isfinite(heading):
        raise EstimationError(f"a heading of {heading} deg is no direction: give a number.")
    heading_rad = None if heading is None else float(np.radians(heading))
    if request.mount == "pocket":
        for name, given in (("--lag", request.lag_s), ("--gate", request.gate), ("--fixes", request.fixes_path)):
            if given is not None:
                raise EstimationError(f"{name} is for a sensor on a foot: leave it out with --mount pocket.")
        axes_given = request.mag_axes is not None
        return PocketOptions(heading_rad, request.use_magnetometer, request.step_constant_m, axes_given)
    if request.step_constant_m is not None:
        raise EstimationError("--step-constant is for a sensor in a pocket: add --mount pocket, or leave it out.")
    lag_s = _check_positive(request.lag_s, "--lag")
    if lag_s is not None and lag_s < MIN_LAG_S:
        raise EstimationError(f"a lag of {lag_s:g} s is too short: give {MIN_LAG_S:g} or more.")
    if lag_s is not None and request.polish:
        raise EstimationError("with --lag the samples are discarded, so there is no --polish: give one of the two.")
    magnetic = FieldParameters(gate=choose_gate(request.gate, request.use_magnetometer))
    parameters, known = SmootherParameters(magnetic=magnetic), None if calibration is None else calibration.gyroscope
    return OnlineOptions(
        heading_rad=heading_rad,
        use_field=request.use_magnetometer,
        lag_s=lag_s,
        parameters=parameters if known is None else replace(parameters, **known.prior),
        axes_given=request.mag_axes is not None,
        fixes=() if request.fixes_path is None else read_fixes(request.fixes_path),
        calibration=None if calibration is None else calibration.magnetometer,
    )


def _check_positive(value: float | None, name: str) -> float | None:
    if value is not None and not 0 < value < np.inf:
        raise StreamError(f"{name} {value:g} is no time: give seconds above zero.")
    return value


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
                self.navigator.judge.resume()
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
                self.navigator.judge.resume()
        self._push(rows)

    def _push(self, rows: Floats) -> None:
        if not len(rows):
            return
        self._check.add(rows)
        # Axes and calibration are applied as to a recording (`fg_nav.walk`).
        acc, mag, found = rows[:, 1:4], rows[:, 7:10], self._options.calibration
        if self._options.mag_axes is not None:
            mag = mag @ self._options.mag_axes.P.T
        if found is not None and found.magnetometer is not None:
            mag = np.asarray(found.magnetometer.correct(mag))
        if found is not None and found.accelerometer is not None:
            acc = found.accelerometer.correct(acc)
        field = mag if self._options.online.use_field else None
        made = self.navigator.push(rows[:, 0], acc, rows[:, 4:7], field, rows[:, 10])
        self.losses.add(rows[:, 0])
        self._verdict.axes.look_at(self.navigator.buffer)
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
                line = format_estimate(one, continues[one.number], self.navigator.judge.sensor_time, verdict)
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
