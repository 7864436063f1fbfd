"""`fg-nav stream`: lines on standard output, remarks on standard error, and the result of the walk at the end.

The result is what the graph in progress has at the end: the path through its nodes, and one row a stance; with a lag
one line of the trajectory a footfall. With `--polish` stances and field are found again in all that was recorded, and
the batch smoother is run on the whole walk as well.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import typer

from fg_nav.commands import Answer, Target
from fg_nav.estimators import Progress
from fg_nav.magnetic.axes import MagAxes
from fg_nav.online.estimates import POLISHED, SMOOTHED, SensorTime, format_table
from fg_nav.online.follow import StreamedWalk, StreamRequest, run_stream
from fg_nav.online.losses import describe_losses
from fg_nav.online.navigator import finish_walk
from fg_nav.online.options import OnlineOptions
from fg_nav.online.outlets import Say, open_outlets
from fg_nav.online.pocket import PocketOptions, compute_stride_headings
from fg_nav.pipeline import prepare_walk
from fg_nav.recording import Provenance
from fg_nav.report import Plots, terminal
from fg_nav.report.files import Summary, summarize, summarize_lagged, write_lagged, write_run
from fg_nav.solution import Solution
from fg_nav.walk import Options, Outcome, Walk, evaluate_solution


def stream(request: StreamRequest, plots: Plots, out: Path | None, force: bool, lines: bool = True) -> Answer:
    """Follow a source to its end; then print the lines of the whole walk, or write its result into a folder.

    Without `lines` none are printed on standard output.
    """
    target = Target(out, force and (out is not None or request.record is None), "stream")
    with open_outlets(request.serve, request.view, line_printer() if lines else drop_line, remark) as outlets:
        walk = run_stream(request, outlets)
        if out is None:
            if outlets.emit_end is None and lines:  # the lines were served, and nobody asks for more
                return Answer({}, say_nothing)
            summary = emit_end(walk, outlets.emit_end or drop_line)
            return Answer({"source": request.source, **summary}, say_nothing)
        with target.open() as folder:
            summary = write_end(folder, walk, plots)
    content = {"source": request.source, "folder": str(target.place), **summary}
    return Answer(content, partial(remark, terminal.describe_place(target.place)))


def remark(words: str) -> None:
    """Print a sentence for people, apart from the lines."""
    terminal.remark(f"fg-nav: {words}")


def drop_line(line: str) -> None:
    """Print no line."""


def say_nothing() -> None:
    """Add nothing to the lines, which said it all."""


def line_printer() -> Callable[[str], None]:
    """Return what prints a line at once; when its reader has gone it says so, and the walk goes on."""
    listened = True

    def print_line(line: str) -> None:
        nonlocal listened
        if not listened:
            return
        try:
            typer.echo(line)
        except BrokenPipeError:
            listened = False
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # so that the exit is quiet
            remark("the lines have no reader any more: the walk goes on without them.")

    return print_line


def emit_end(walk: StreamedWalk, emit: Say) -> Summary:
    """Emit the past as it is known at the end, one line a footfall; return the summary of it."""
    if _has_lag(walk):
        solution = _finish_lagged(walk)
        summary = summarize_lagged(solution)
    else:
        prepared, outcome = finish_stream(walk)
        solution, summary = outcome.solution, summarize(prepared, outcome)
    in_pocket = isinstance(walk.navigator.options, PocketOptions)
    emit_solution(solution, walk.navigator.judge.sensor_time, emit, in_pocket)
    return summary


def emit_solution(solution: Solution, sensor_time: SensorTime, emit: Say, in_pocket: bool = False) -> None:
    """Emit the lines of a solution, and those of its batch solution where there is one."""
    for kind, known in ((SMOOTHED, solution), (POLISHED, solution.polished)):
        if known is not None:
            heading = compute_stride_headings(known.stances) if in_pocket else None
            for line in format_table(known.stances, sensor_time, kind, heading):
                emit(line)


def write_end(folder: Path, walk: StreamedWalk, plots: Plots) -> Summary:
    """Write what `fg-nav run` writes; with a lag, what needs no samples. Return the summary."""
    if not _has_lag(walk):
        with terminal.progress("online") as report:
            prepared, outcome = finish_stream(walk, report)
        return write_run(folder, prepared, outcome, plots)
    return write_lagged(folder, _finish_lagged(walk), plots)


def _has_lag(walk: StreamedWalk) -> bool:
    return walk.navigator.options.lag_s is not None


def _finish_lagged(walk: StreamedWalk) -> Solution:
    """End a walk with a lag."""
    return _note_losses(walk.navigator.finish(), walk)


def _note_losses(solution: Solution, walk: StreamedWalk) -> Solution:
    """Add what was lost on the way to the notes."""
    return replace(solution, notes=(*solution.notes, *describe_losses(walk.navigator.source.get("lost", {}))))


def finish_stream(walk: StreamedWalk, progress: Progress | None = None) -> tuple[Walk, Outcome]:
    """End a walk without a lag, and measure it.

    Parameters
    ----------
    walk
        That was followed to its end.
    progress
        Called from time to time with the fraction of the batch solution that is done.

    Raises
    ------
    RecordingError, DetectionError
        Where there was no walk.
    """
    navigator, calibration = walk.navigator, walk.calibration
    recording = replace(navigator.recording(), provenance=Provenance(format=f"canonical rows from {walk.name}"))
    # Stances and field as of a recording: for the pictures, and for the batch solution.
    prepared = prepare_walk(Walk.of(recording, _options(navigator.options)))
    prepared = replace(prepared, options=replace(prepared.options, mag_axes=walk.mag_axes))
    if calibration is not None:
        prepared = replace(prepared, calibration=calibration, applied=calibration.corrects(recording.mag is not None))
    # The path through the graph, and the batch solution next to it where it was asked for.
    solution = finish_walk(navigator, walk.polish, progress, prepared.stances, prepared.field)
    return prepared, evaluate_solution(prepared, _note_losses(solution, walk))


def _options(options: OnlineOptions | PocketOptions) -> Options:
    heading_deg = None if options.heading_rad is None else float(np.degrees(options.heading_rad))
    axes = MagAxes(np.eye(3)) if options.axes_given else None  # the rows have them already
    if isinstance(options, PocketOptions):
        given = Options(use_magnetometer=options.use_field, heading_deg=heading_deg, mag_axes=axes)
        return replace(given, mount="pocket", step_constant_m=options.step_constant_m)
    gate = options.parameters.magnetic.gate
    return Options(use_magnetometer=options.use_field, heading_deg=heading_deg, gate=gate, mag_axes=axes)
