"""`fg-nav stream`: lines on standard output, remarks on standard error, and the result of the walk at the end."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Sequence
from contextlib import AbstractContextManager, ExitStack, closing, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import cast

import numpy as np
import typer

from fg_nav.calibration.of_recording import read_calibration
from fg_nav.commands.requests import StreamRequest
from fg_nav.commands.shared import Answer, Target, choose_options, refuse_misfits, split_files
from fg_nav.errors import EstimationError, OutputError, StreamError, describe_reason
from fg_nav.estimators import METHODS, choose_parameters
from fg_nav.feet import SIDES, Side
from fg_nav.io import read_fixes
from fg_nav.magnetic.axes import MagAxes
from fg_nav.online.buffer import OnlineOptions
from fg_nav.online.estimates import POLISHED, SMOOTHED, SensorTime, format_table
from fg_nav.online.follow import ENDING, Outlets, Say, StreamedWalk, StreamOptions, follow_source, open_outlets
from fg_nav.online.navigator import finish_walk
from fg_nav.online.pocket import PocketOptions, compute_stride_headings
from fg_nav.online.record import Record
from fg_nav.online.rows import Columns, parse_columns
from fg_nav.online.sources import SampleSource, open_samples
from fg_nav.pipeline import Result, prepare_walk
from fg_nav.recording import Provenance
from fg_nav.report import Plots, terminal
from fg_nav.report.files import (
    Summary,
    summarize,
    summarize_feet,
    summarize_lagged,
    write_feet,
    write_footfalls,
    write_lagged,
    write_run,
)
from fg_nav.report.folder import result_folder
from fg_nav.samples.delivery import describe_losses
from fg_nav.solution import Solution
from fg_nav.system.processes import catch_signals
from fg_nav.verdict import Verdict, Word, judge_path
from fg_nav.walk import Options, Outcome, Walk, evaluate_solution

MIN_LAG_S = 10.0  # a shorter lag holds fewer strides than the smoother needs to estimate sensor and foot


def stream(request: StreamRequest) -> Answer:
    """Follow a source to its end; then print the lines of the whole walk, or write its result into a folder.

    Lines go to standard output if no other answer was asked for. If they can no longer be printed and there is no
    folder, the result is written into a fresh one.
    """
    refuse_misfits(request, [METHODS["pocket" if request.mount == "pocket" else "foot"]["online"]])
    if request.mount == "feet":
        return _stream_feet(request)
    out, target = request.out, _find_target(request)
    with target, _open_outlets(request, printer := LinePrinter()) as outlets:
        walk = run_stream(request, outlets)
        if out is None and outlets.emit_end is None and prints_lines(request):  # they were served: that is all
            return Answer({}, say_nothing)
        end = find_end(walk)
        content = {"source": request.source, **end.summary}
        if out is None:
            outlet = outlets.emit_end or drop_line
            emit_solution(end.solution, end.sensor_time, outlet, end.verdicts, end.in_pocket)
            if not printer.has_failed:
                return Answer(content, say_nothing)
        failure = save_end(end, target, request.plots)
    if failure is not None:
        return Answer(content, say_nothing, failure)
    content = {"source": request.source, "folder": str(target.place), **end.summary}
    return Answer(content, partial(remark, terminal.describe_place(target.place)))


def run_stream(request: StreamRequest, outlets: Outlets) -> StreamedWalk:
    """Follow a source until it ends or a signal arrives; lines and remarks go to the outlets.

    Raises `FgNavError` if something that was requested cannot be: the source, the record, the rows.
    """
    options = read_stream_options(request, request.calibration)
    with catch_signals(*ENDING) as stop, ExitStack() as opened:
        record = _open_record(request, outlets.remark)
        if record is not None:
            opened.callback(record.close)
        source = _open_source(request, request.source, options.columns, outlets.remark)
        opened.callback(source.close)
        navigator = follow_source(source, options, outlets.emit, outlets.remark, stop, outlets.watcher, record)
    given = options.calibration, options.mag_axes
    return StreamedWalk(navigator, source.name, *given, request.polish, options.rate_sigma)


def read_stream_options(request: StreamRequest, calibration_path: Path | None) -> StreamOptions:
    """Turn a request into stream options, reading the files it names; raises `FgNavError` if an option is invalid."""
    options = choose_options(request)
    calibration = None if calibration_path is None else read_calibration(calibration_path)
    axes_given = options.mag_axes is not None
    online: OnlineOptions | PocketOptions
    if request.mount == "pocket":
        online = PocketOptions(options.heading_rad, options.use_magnetometer, request.step_constant, axes_given)
    else:
        lag_s = _check_positive(request.lag, "--lag")
        if lag_s is not None and lag_s < MIN_LAG_S:
            raise EstimationError(f"a lag of {lag_s:g} s is too short: give {MIN_LAG_S:g} or more.")
        if lag_s is not None and request.polish:
            raise EstimationError("with --lag the samples are discarded, so there is no --polish: give one of the two.")
        online = OnlineOptions(
            heading_rad=options.heading_rad,
            use_field=options.use_magnetometer,
            lag_s=lag_s,
            parameters=choose_parameters(options, calibration),
            axes_given=axes_given,
            fixes=() if request.fixes is None else read_fixes(request.fixes),
            calibration=None if calibration is None else calibration.magnetometer,
        )
    return StreamOptions(
        online=online,
        until_silent_s=_check_positive(request.silence, "--silence"),
        calibration=calibration,
        mag_axes=options.mag_axes,
        columns=parse_columns(request.columns, request.units, request.rate),
        background=True,
    )


def _check_positive(value: float | None, name: str) -> float | None:
    if value is not None and not 0 < value < np.inf:
        raise StreamError(f"{name} {value:g} is no time: give seconds above zero.")
    return value


def _open_source(request: StreamRequest, source: str, columns: Columns | None, remark: Say) -> SampleSource:
    return open_samples(source, columns, request.baud, request.speed, remark)


def _open_record(request: StreamRequest, remark: Say) -> Record | None:
    path, source = request.record, Path(request.source)
    if path is None:
        if request.resume:
            raise StreamError("--resume goes on with the walk of a record: name it, as --record FILE.")
        return None
    if path.exists() and source.exists() and path.samefile(source):
        raise OutputError(f"{path} is what is streamed: name another file to record into.")
    return Record(path, request.resume, request.force, remark)


def _find_target(request: StreamRequest) -> Target:
    return Target(request.out, request.force and (request.out is not None or request.record is None), "stream")


def _open_outlets(request: StreamRequest, printer: Say) -> AbstractContextManager[Outlets]:
    view = (request.host, request.port) if request.view else None
    return open_outlets(request.serve, view, printer if prints_lines(request) else drop_line, remark)


def prints_lines(request: StreamRequest) -> bool:
    """Whether the lines are the answer."""
    return not (request.json or request.quiet)


def _stream_feet(request: StreamRequest) -> Answer:
    """Follow a sensor on each foot as one walk, as `stream` does one; lines are of each foot and the person between."""
    from fg_nav.both_feet import FeetResult, Pairing
    from fg_nav.online.estimates import tag_line
    from fg_nav.online.feet_follow import follow_feet

    if request.right is None:
        raise EstimationError("--mount feet takes two sources: name the left foot's, then the right one's.")
    if request.right == request.source:
        raise StreamError(f"{request.right} is named twice: --mount feet takes two sources, the left foot's first.")
    words: dict[Side, str] = {"left": request.source, "right": request.right}
    calibrations = dict(zip(SIDES, split_files("--calibration", request.calibration), strict=True))
    options = {side: read_stream_options(request, calibrations[side]) for side in SIDES}
    out, target = request.out, _find_target(request)
    with target, _open_outlets(request, printer := LinePrinter()) as outlets:
        with catch_signals(*ENDING) as stop, ExitStack() as opened:
            sources = {
                side: opened.enter_context(
                    closing(_open_source(request, words[side], options[side].columns, outlets.remark))
                )
                for side in SIDES
            }
            streamed = follow_feet(sources, options, outlets, stop, request.clock_offset or 0.0)
        if out is None and outlets.emit_end is None and prints_lines(request):
            return Answer({}, say_nothing)
        # The solutions of both, and each foot measured.
        walk, feet = streamed.navigator.finish(), dict[Side, Result]()
        for side, solution in walk.feet.items():
            prepared = prepare_stream(streamed.walks[side])
            noted = note_losses(solution, streamed.walks[side])
            feet[side] = Result.of(prepared, evaluate_solution(prepared, noted))
        pairing = Pairing(SIDES, "named", request.clock_offset or 0.0, clock_given=True, heading_deg=request.heading)
        result = FeetResult.of(feet, walk.both, pairing, lost=walk.lost, untied="their steps do not tie them.")
        content = {"sources": words, **summarize_feet(result)}
        if out is None:
            # One line a footfall of each foot, with the verdict on its path.
            emit = outlets.emit_end or drop_line
            for side, foot in feet.items():
                sensor_time = streamed.navigator.navigators[side].intake.sensor_time
                for line in format_table(foot.stances, sensor_time, SMOOTHED, None, foot.verdict):
                    emit(tag_line(line, side, streamed.navigator.frame(side)))
            if not printer.has_failed:
                return Answer(content, say_nothing)
        with target.open() as folder:
            write_feet(folder, result, request.plots)
    content = content | {"folder": str(target.place)}
    return Answer(content, partial(remark, terminal.describe_place(target.place)))


def remark(words: str) -> None:
    """Print a sentence for people, apart from the lines."""
    terminal.remark(f"fg-nav: {words}")


def drop_line(line: str) -> None:
    """Print no line."""


def say_nothing() -> None:
    """Add nothing to the lines, which said it all."""


class LinePrinter:
    """Prints lines, each at once; where that fails it says so, and the walk goes on without.

    Attributes
    ----------
    has_failed : whether lines were lost.
    """

    def __init__(self) -> None:
        self.has_failed = False

    def __call__(self, line: str) -> None:
        """Print a line."""
        if self.has_failed:
            return
        try:
            typer.echo(line)
        except OSError as error:
            self.has_failed = True
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # so that the exit is quiet
            gone = isinstance(error, BrokenPipeError)
            why = "have no reader any more" if gone else f"cannot be written any more ({describe_reason(error)})"
            remark(f"the lines {why}: the walk goes on without them, and its result comes into a folder.")


@dataclass(frozen=True)
class End:
    """What a stream comes to: its solution, summary, and, where the samples were kept, the walk and its outcome."""

    solution: Solution
    summary: Summary
    sensor_time: SensorTime
    in_pocket: bool
    whole: tuple[Walk, Outcome] | None

    @property
    def verdicts(self) -> list[Verdict]:
        """On the solution and on the batch solution next to it, where there is one."""
        reasons = cast("list[str]", self.summary["reasons"])
        verdict, polished = Verdict(cast("Word", self.summary["verdict"]), tuple(reasons)), self.solution.polished
        if self.whole is None or polished is None:
            return [verdict]
        return [verdict, judge_path(self.whole[0], polished)]

    def write(self, folder: Path, plots: Plots) -> None:
        """Write what `fg-nav run` writes; with a lag, what needs no samples."""
        if self.whole is None:
            write_lagged(folder, self.solution, plots)
        else:
            write_run(folder, *self.whole, plots)


def find_end(walk: StreamedWalk) -> End:
    """Finish a streamed walk; return its final solution (with a lag, the lagged one), summary and outcome."""
    navigator = walk.navigator
    sensor_time, in_pocket = navigator.intake.sensor_time, isinstance(navigator.options, PocketOptions)
    if navigator.options.lag_s is not None:
        lagged = note_losses(navigator.finish(), walk)
        return End(lagged, summarize_lagged(lagged), sensor_time, in_pocket, None)
    with terminal.progress("online") as report:
        # Stances and field of the whole recording, for the plots and the batch solution.
        prepared = prepare_stream(walk)
        # The full path of the online graph, and with --polish the batch solution.
        solution = finish_walk(navigator, walk.polish, report, prepared.stances)
        outcome = evaluate_solution(prepared, note_losses(solution, walk))
    return End(outcome.solution, summarize(prepared, outcome), sensor_time, in_pocket, (prepared, outcome))


def emit_solution(
    solution: Solution, sensor_time: SensorTime, emit: Say, verdicts: Sequence[Verdict], in_pocket: bool = False
) -> None:
    """Emit one line a footfall, and those of the batch solution where there is one, with the verdict on each."""
    known = [one for one in (solution, solution.polished) if one is not None]
    for kind, one, verdict in zip((SMOOTHED, POLISHED), known, verdicts, strict=False):
        heading = compute_stride_headings(one.stances) if in_pocket else None
        for line in format_table(one.stances, sensor_time, kind, heading, verdict):
            emit(line)


def save_end(end: End, target: Target, plots: Plots) -> OutputError | None:
    """Write the result into its folder; failing that, the footfalls alone, there or in a temporary folder.

    Returns the failure to report, None if all was written; raises `OutputError` if nothing can be written at all.
    """
    try:
        with target.open() as folder:
            end.write(folder, plots)
        return None
    except OutputError as error:
        failure = str(error)
    with suppress(OutputError):
        with target.open() as folder:
            write_footfalls(folder, end.solution, end.summary)
        return _say_what_is_left(failure, f"the footfalls alone are in {target.place}")
    with suppress(OutputError, OSError):
        place = Path(tempfile.mkdtemp(prefix="fg-nav-stream-")) / "result"
        with result_folder(place) as folder:
            write_footfalls(folder, end.solution, end.summary)
        return _say_what_is_left(failure, f"the footfalls alone are in {place}")
    raise _say_what_is_left(failure, "the result of the walk is lost")


def _say_what_is_left(failure: str, words: str) -> OutputError:
    return OutputError(f"{failure.rstrip('.')}; {words}.")


def note_losses(solution: Solution, walk: StreamedWalk) -> Solution:
    """Add what was lost on the way to the notes, and what a nominal rate leaves open to the sigmas."""
    rate_sigma = 0.0 if isinstance(walk.navigator.options, PocketOptions) else walk.rate_sigma
    polished = None if solution.polished is None else solution.polished.widen(rate_sigma)
    notes = (*solution.notes, *describe_losses(walk.navigator.lost))
    return replace(solution.widen(rate_sigma), notes=notes, polished=polished)


def prepare_stream(walk: StreamedWalk) -> Walk:
    """Return a finished streamed walk (without lag) as the walk of a recording, with its stances and field."""
    navigator, calibration = walk.navigator, walk.calibration
    bad = max(navigator.intake.counts[sensor] for sensor in ("acc", "gyr"))
    provenance = Provenance(format=f"canonical rows from {walk.name}", bad_samples=bad, rate_sigma=walk.rate_sigma)
    recording = replace(navigator.recording(), provenance=provenance)
    # Options only: the samples were already mapped to these axes and corrected on arrival.
    asked, axes = navigator.options, MagAxes(np.eye(3)) if navigator.options.axes_given else None
    heading_deg = None if asked.heading_rad is None else float(np.degrees(asked.heading_rad))
    options = Options(use_magnetometer=asked.use_field, heading_deg=heading_deg, mag_axes=axes)
    if isinstance(asked, PocketOptions):
        options = replace(options, mount="pocket", step_constant_m=asked.step_constant_m)
    else:
        options = replace(options, gate=asked.parameters.magnetic.gate)
    applied = () if calibration is None else calibration.corrects(recording.mag is not None)
    prepared = prepare_walk(replace(Walk.of(recording, options, calibration), applied=applied))
    return replace(prepared, options=replace(prepared.options, mag_axes=walk.mag_axes))
