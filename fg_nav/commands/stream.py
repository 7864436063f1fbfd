"""`fg-nav stream`: lines on standard output, remarks on standard error, and the result of the walk at the end.

At the end the stances and the field are found again in all that was recorded, and the smoother is run on the whole
walk. With a lag there is only what left it: one row a stance.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import typer

from fg_nav.calibration.of_recording import Calibration
from fg_nav.commands import Target
from fg_nav.estimators import Progress
from fg_nav.evaluation import evaluate
from fg_nav.magnetic.axes import MagAxes
from fg_nav.navigate import prepare_walk
from fg_nav.online import OnlineNavigator
from fg_nav.online.estimates import format_table
from fg_nav.online.follow import StreamedWalk, StreamRequest, run_stream
from fg_nav.online.smoother import OnlineOptions
from fg_nav.recording import Provenance
from fg_nav.report.files import write_json, write_run, write_strides
from fg_nav.report.terminal import progress
from fg_nav.solution import Solution
from fg_nav.walk import Options, Outcome, Walk, evaluate_solution


def stream(request: StreamRequest, out: Path | None, force: bool) -> None:
    """Follow a source to its end; then print the lines of the whole walk, or write its result into a folder."""
    target = Target(out, force, "stream")
    walk = run_stream(request, line_printer(), remark)
    if out is None:
        print_end(walk, request.serve is not None)
        return
    with target.open() as folder:
        write_end(folder, walk)
    remark(f"files: {target.place}")


def remark(words: str) -> None:
    """Print a sentence for people, apart from the lines."""
    typer.echo(f"fg-nav: {words}", err=True)


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


def print_end(walk: StreamedWalk, served: bool) -> None:
    """Print the smoothed past, one line a footfall; nothing where the lines were served."""
    if served:
        return
    print_line = line_printer()
    for line in format_table(_solution(walk).stances, walk.navigator.judge.sensor_time):
        print_line(line)


def write_end(folder: Path, walk: StreamedWalk) -> None:
    """Write what `fg-nav run` writes; with a lag, the table of footfalls and a summary only."""
    if walk.navigator.options.lag_s is None:
        with progress("online") as report:
            solved, outcome = solve_stream(walk.navigator, walk.name, walk.calibration, report, walk.mag_axes)
        write_run(folder, solved, outcome)
        return
    solution = _solution(walk)
    write_strides(folder, solution)
    metrics = evaluate(solution)
    figures = {
        "method": solution.method,
        "duration_s": float(solution.t[-1] - solution.t[0]),
        "distance_m": metrics.distance_m,
        "strides": metrics.strides_detected,
        "closure_m": metrics.closure_m,
        "closure_percent": metrics.closure_percent,
        "runtime_s": solution.runtime_s,
        "notes": list(solution.notes),
    }
    write_json(folder / "summary.json", figures)


def _solution(walk: StreamedWalk) -> Solution:
    if walk.navigator.options.lag_s is not None:
        return walk.navigator.finish()
    return solve_stream(walk.navigator, walk.name, walk.calibration, mag_axes=walk.mag_axes)[1].solution


def solve_stream(
    navigator: OnlineNavigator,
    name: str,
    calibration: Calibration | None = None,
    progress: Progress | None = None,
    mag_axes: MagAxes | None = None,
) -> tuple[Walk, Outcome]:
    """Solve the walk as a whole.

    Parameters
    ----------
    navigator
        Without a lag.
    name
        Of the source.
    calibration, mag_axes
        That were applied on the way; for the record only.
    progress
        Called from time to time with the fraction that is done.

    Raises
    ------
    RecordingError, DetectionError, EstimationError
        Where there was no walk.
    """
    recording = replace(navigator.recording(), provenance=Provenance(format=f"canonical rows from {name}"))
    walk = prepare_walk(Walk.of(recording, _options(navigator.options)))
    walk = replace(walk, options=replace(walk.options, mag_axes=mag_axes))
    if calibration is not None:
        walk = replace(walk, calibration=calibration, applied=calibration.corrects(recording.mag is not None))
    solution = navigator.finish(progress, walk.stances, walk.field)
    if len(solution.stances) != walk.stances.n_footfalls:  # it could not be solved, and has the rows of the way
        walk = replace(walk, stances=navigator.stances(), field=None, verdicts=None)
    return walk, evaluate_solution(walk, solution)


def _options(options: OnlineOptions) -> Options:
    heading_deg = None if options.heading_rad is None else float(np.degrees(options.heading_rad))
    axes = MagAxes(np.eye(3)) if options.axes_given else None  # the rows have them already
    return Options(use_magnetometer=options.use_field, heading_deg=heading_deg, mag_axes=axes)
