"""`fg-nav stream`: lines on standard output, remarks on standard error, and the result of the walk at the end."""

from __future__ import annotations

import logging
import os
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, closing, suppress
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
from fg_nav.online.estimates import POLISHED, SMOOTHED, format_table, tag_line
from fg_nav.online.feet import FeetNavigator
from fg_nav.online.follow import ENDING, FollowedWalk, Sensor, StreamOptions, follow
from fg_nav.online.navigator import finish_walk
from fg_nav.online.pocket import Navigator, compute_stride_headings
from fg_nav.online.record import Record
from fg_nav.online.rows import parse_columns
from fg_nav.online.sources import open_samples
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
from fg_nav.view.outlets import Outlets, open_outlets
from fg_nav.view.plan import Plan
from fg_nav.walk import Options, Walk, evaluate_solution

MIN_LAG_S = 10.0  # a shorter lag holds fewer strides than the smoother needs to estimate sensor and foot


def stream(request: StreamRequest) -> Answer:
    """Follow sources to their end; then print the lines of the whole walk, or write its result into a folder.

    Lines go to standard output if no other answer was asked for. If they can no longer be printed and there is no
    folder, the result is written into a fresh one.
    """
    refuse_misfits(request, [METHODS["pocket" if request.mount == "pocket" else "foot"]["online"]])
    words, prints = name_sources(request), not (request.json or request.quiet)
    out = request.out
    target = Target(out, request.force and (out is not None or request.record is None), "stream")
    view, printer = (request.host, request.port) if request.view else None, LinePrinter()
    plan = Plan.read(request.plan, request.plan_points, request.view)
    with target, open_outlets(request.serve, view, printer if prints else drop_line, remark, plan) as outlets:
        walk = run_stream(request, outlets)
        if out is None and outlets.emit_end is None and prints:  # they were served: that is all
            return Answer({}, say_nothing)
        end = find_end(walk, request.polish) if walk.feet is None else find_feet_end(walk, walk.feet, request)
        content: Summary = {"source": request.source} if walk.feet is None else {"sources": words}
        if out is None:
            for line in end.format_lines():
                (outlets.emit_end or drop_line)(line)
            if not printer.has_failed:
                return Answer({**content, **end.summary}, say_nothing)
        failure = save_end(end, target, request.plots)
    if failure is not None:
        return Answer({**content, **end.summary}, say_nothing, failure)
    content = {**content, "folder": str(target.place), **end.summary}
    return Answer(content, partial(remark, terminal.describe_place(target.place)))


def name_sources(request: StreamRequest) -> dict[Side | None, str]:
    """Return the source of each sensor, by its side; raises `FgNavError` where there are too few or too many."""
    if request.mount != "feet":
        return {None: request.source}
    if request.right is None:
        raise EstimationError("--mount feet takes two sources: name the left foot's, then the right one's.")
    if request.right == request.source:
        raise StreamError(f"{request.right} is named twice: --mount feet takes two sources, the left foot's first.")
    return {"left": request.source, "right": request.right}


def run_stream(request: StreamRequest, outlets: Outlets) -> FollowedWalk:
    """Follow the sources until they end or a signal arrives; lines and remarks go to the outlets.

    Raises `FgNavError` if something that was requested cannot be: a source, the record, the rows.
    """
    calibrations: dict[Side | None, Path | None] = {None: request.calibration}
    if request.mount == "feet":
        calibrations = dict(zip(SIDES, split_files("--calibration", request.calibration), strict=True))
    options = {side: read_stream_options(request, calibration) for side, calibration in calibrations.items()}
    with catch_signals(*ENDING) as stop, ExitStack() as opened:
        # the record, and the walk in it to be resumed
        record, path, source = None, request.record, Path(request.source)
        if path is None and request.resume:
            raise StreamError("--resume goes on with the walk of a record: name it, as --record FILE.")
        if path is not None:
            if path.exists() and source.exists() and path.samefile(source):
                raise OutputError(f"{path} is what is streamed: name another file to record into.")
            record = opened.enter_context(closing(Record(path, request.resume, request.force, outlets.remark)))
        # the sources
        sensors = dict[Side | None, Sensor]()
        for side, word in name_sources(request).items():
            samples = open_samples(word, options[side].columns, request.baud, request.speed, outlets.remark)
            sensors[side] = Sensor(opened.enter_context(closing(samples)), options[side], record)
        return follow(sensors, outlets, stop, request.clock_offset or 0.0)


def read_stream_options(request: StreamRequest, calibration_path: Path | None) -> StreamOptions:
    """Turn a request into stream options, reading the files it names; raises `FgNavError` if an option is invalid."""
    options = choose_options(request)
    calibration = None if calibration_path is None else read_calibration(calibration_path)
    lag_s = _check_positive(request.lag, "--lag")
    if lag_s is not None and lag_s < MIN_LAG_S:
        raise EstimationError(f"a lag of {lag_s:g} s is too short: give {MIN_LAG_S:g} or more.")
    if lag_s is not None and request.polish:
        raise EstimationError("with --lag the samples are discarded, so there is no --polish: give one of the two.")
    online = OnlineOptions(
        mount="pocket" if request.mount == "pocket" else "foot",
        heading_rad=options.heading_rad,
        use_field=options.use_magnetometer,
        lag_s=lag_s,
        parameters=choose_parameters(options, calibration),
        axes_given=options.mag_axes is not None,
        fixes=() if request.fixes is None else read_fixes(request.fixes),
        calibration=None if calibration is None else calibration.magnetometer,
        step_constant_m=request.step_constant,
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


def remark(words: str, level: int = logging.INFO) -> None:
    """Print a sentence for people, apart from the lines."""
    terminal.remark(f"fg-nav: {words}", level)


def drop_line(line: str) -> None:
    """Print no line."""


def say_nothing() -> None:
    """Add nothing to the lines, which said it all."""


class LinePrinter:
    """Prints lines, each at once; where that fails it says so, and the walk goes on without."""

    def __init__(self) -> None:
        self.has_failed = False  # Whether lines were lost.

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
            remark(
                f"the lines {why}: the walk goes on without them, and its result comes into a folder.", logging.WARNING
            )


@dataclass(frozen=True)
class End:
    """What a stream comes to: its summary, the lines of the whole walk, and what is written of it.

    `write_least` writes what is kept where the disk has no room for all, `least` says what that is.
    """

    summary: Summary
    format_lines: Callable[[], Iterable[str]]
    write: Callable[..., object]  # Of the folder and `plots`.
    write_least: Callable[[Path], object]
    least: str = "the footfalls alone are"


def find_end(walk: FollowedWalk, polish: bool) -> End:
    """Finish the walk of one sensor: its final solution (with a lag, the lagged one), and the batch one to `polish`."""
    sensor, navigator = walk.sensors[None], walk.navigators[None]
    if navigator.options.lag_s is not None:
        solution = note_losses(navigator.finish(), sensor, navigator)
        summary, write = summarize_lagged(solution), partial(write_lagged, solution=solution)
    else:
        with terminal.progress("online") as report:
            # Stances and field of the whole recording, for the plots and the batch solution.
            prepared = prepare_stream(sensor, navigator)
            # The full path of the online graph, and with --polish the batch solution.
            solution = finish_walk(navigator, polish, report, prepared.stances)
            outcome = evaluate_solution(prepared, note_losses(solution, sensor, navigator))
        solution, summary = outcome.solution, summarize(prepared, outcome)
        write = partial(write_run, walk=prepared, outcome=outcome, summary=summary)
    verdict = Verdict(cast("Word", summary["verdict"]), tuple(cast("list[str]", summary["reasons"])))
    ends = [(SMOOTHED, solution, verdict)]
    if solution.polished is not None:
        ends.append((POLISHED, solution.polished, judge_path(prepared, solution.polished)))

    def format_lines() -> Iterator[str]:
        """Yield one line a footfall, and those of the batch solution where there is one, with the verdict on each."""
        for kind, one, verdict in ends:
            heading = compute_stride_headings(one.stances) if navigator.options.mount == "pocket" else None
            yield from format_table(one.stances, navigator.intake.sensor_time, kind, heading, verdict)

    return End(summary, format_lines, write, partial(write_footfalls, solution=solution, summary=summary))


def find_feet_end(walk: FollowedWalk, feet: FeetNavigator, request: StreamRequest) -> End:
    """Finish the walk of two feet: the solutions of both, and each foot measured."""
    from fg_nav.both_feet import FeetResult, Pairing

    found, solved = feet.finish(), dict[Side, Result]()
    for side, solution in found.feet.items():
        sensor, navigator = walk.sensors[side], walk.navigators[side]
        prepared = prepare_stream(sensor, navigator)
        solved[side] = Result.of(prepared, evaluate_solution(prepared, note_losses(solution, sensor, navigator)))
    pairing = Pairing(SIDES, "named", request.clock_offset or 0.0, clock_given=True, heading_deg=request.heading)
    result = FeetResult.of(solved, found.both, pairing, lost=found.lost, untied="their steps do not tie them.")

    def format_lines() -> Iterator[str]:
        """Yield one line a footfall of each foot, with the verdict on its path."""
        for side, foot in solved.items():
            sensor_time = walk.navigators[side].intake.sensor_time
            for line in format_table(foot.stances, sensor_time, SMOOTHED, None, foot.verdict):
                yield tag_line(line, side, feet.frame(side))

    write = partial(write_feet, result=result)
    return End(
        summarize_feet(result),
        format_lines,
        write,
        partial(write, plots="none"),
        "the result without page and pictures is",
    )


def save_end(end: End, target: Target, plots: Plots) -> OutputError | None:
    """Write the result into its folder; failing that, the least of it, there or in a temporary folder.

    Returns the failure to report, None if all was written; raises `OutputError` if nothing can be written at all.
    """
    try:
        with target.open() as folder:
            end.write(folder, plots=plots)
        return None
    except OutputError as error:
        failure = str(error).rstrip(".")
    with suppress(OutputError):
        with target.open() as folder:
            end.write_least(folder)
        return OutputError(f"{failure}; {end.least} in {target.place}.")
    with suppress(OutputError, OSError):
        place = Path(tempfile.mkdtemp(prefix="fg-nav-stream-")) / "result"
        with result_folder(place) as folder:
            end.write_least(folder)
        return OutputError(f"{failure}; {end.least} in {place}.")
    raise OutputError(f"{failure}; the result of the walk is lost.")


def note_losses(solution: Solution, sensor: Sensor, navigator: Navigator) -> Solution:
    """Add what was lost on the way to the notes, and what a nominal rate leaves open to the sigmas."""
    rate_sigma = 0.0 if navigator.options.mount == "pocket" else sensor.options.rate_sigma
    polished = None if solution.polished is None else solution.polished.widen(rate_sigma)
    notes = (*solution.notes, *describe_losses(navigator.lost))
    return replace(solution.widen(rate_sigma), notes=notes, polished=polished)


def prepare_stream(sensor: Sensor, navigator: Navigator) -> Walk:
    """Return a finished walk (without lag) as that of a recording, with its stances and field."""
    given, asked = sensor.options, navigator.options
    bad = max(navigator.intake.counts[name] for name in ("acc", "gyr"))
    format_name = f"canonical rows from {sensor.source.name}"
    provenance = Provenance(format=format_name, bad_samples=bad, rate_sigma=given.rate_sigma)
    recording = replace(navigator.recording(), provenance=provenance)
    # Options only: the samples were already mapped to these axes and corrected on arrival.
    axes = MagAxes(np.eye(3)) if asked.axes_given else None
    heading_deg = None if asked.heading_rad is None else float(np.degrees(asked.heading_rad))
    options = Options(
        use_magnetometer=asked.use_field,
        heading_deg=heading_deg,
        mag_axes=axes,
        gate=asked.parameters.magnetic.gate,
        mount=asked.mount,
        step_constant_m=asked.step_constant_m,
    )
    applied = () if given.calibration is None else given.calibration.corrects(recording.mag is not None)
    prepared = prepare_walk(replace(Walk.of(recording, options, given.calibration), applied=applied))
    return replace(prepared, options=replace(prepared.options, mag_axes=given.mag_axes))
