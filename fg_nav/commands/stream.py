"""`fg-nav stream`: lines on standard output, remarks on standard error, and the result of the walk at the end."""

from __future__ import annotations

import os
import signal
import sys
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import typer

from fg_nav.commands import Answer, Target, simulate_named
from fg_nav.errors import EstimationError, OutputError, StreamError, describe_reason
from fg_nav.feet import Side
from fg_nav.magnetic.axes import MagAxes
from fg_nav.online.estimates import POLISHED, SMOOTHED, SensorTime, format_table
from fg_nav.online.follow import StreamedWalk, StreamOptions, StreamRequest, follow_source, run_stream
from fg_nav.online.navigator import finish_walk
from fg_nav.online.outlets import Say, open_outlets
from fg_nav.online.pocket import PocketOptions, compute_stride_headings
from fg_nav.online.source_check import describe_losses
from fg_nav.online.sources import Replay
from fg_nav.pipeline import prepare_walk
from fg_nav.recording import Provenance
from fg_nav.report import Plots, terminal
from fg_nav.report.files import Summary, summarize, summarize_lagged, write_footfalls, write_lagged, write_run
from fg_nav.report.folder import result_folder
from fg_nav.solution import Solution
from fg_nav.system.processes import catch_signals
from fg_nav.verdict import Verdict, judge_footfalls, judge_path
from fg_nav.walk import Options, Outcome, Walk, evaluate_solution

if TYPE_CHECKING:
    from fg_nav.online.feet_follow import FeetStreamRequest


def stream(request: StreamRequest, plots: Plots, out: Path | None, force: bool, lines: bool = True) -> Answer:
    """Follow a source to its end; then print the lines of the whole walk, or write its result into a folder.

    Lines go to standard output if `lines`. If they can no longer be printed and `out` is None, the result is written
    into a fresh folder.
    """
    target = Target(out, force and (out is not None or request.record is None), "stream")
    printer = LinePrinter()
    with target, open_outlets(request.serve, request.view, printer if lines else drop_line, remark) as outlets:
        walk = run_stream(request, outlets)
        if out is None and outlets.emit_end is None and lines:  # the lines were served, and nobody asks for more
            return Answer({}, say_nothing)
        end = find_end(walk)
        content = {"source": request.source, **end.summary}
        if out is None:
            outlet = outlets.emit_end or drop_line
            emit_solution(end.solution, end.sensor_time, outlet, end.verdicts, end.in_pocket)
            if not printer.has_failed:
                return Answer(content, say_nothing)
        failure = save_end(end, target, plots)
    if failure is not None:
        return Answer(content, say_nothing, failure)
    content = {"source": request.source, "folder": str(target.place), **end.summary}
    return Answer(content, partial(remark, terminal.describe_place(target.place)))


def stream_feet(request: FeetStreamRequest, out: Path | None, force: bool, lines: bool = True) -> Answer:
    """Follow a sensor on each foot as one walk, as `stream` does one; lines are of each foot and the person between."""
    from fg_nav.online.estimates import tag_line
    from fg_nav.online.feet_follow import run_feet_stream
    from fg_nav.report.feet import summarize_streamed_feet, write_streamed_feet

    both, printer = request.both, LinePrinter()
    target = Target(out, force, "stream")
    with target, open_outlets(both.serve, both.view, printer if lines else drop_line, remark) as outlets:
        streamed = run_feet_stream(request, outlets)
        if out is None and outlets.emit_end is None and lines:
            return Answer({}, say_nothing)
        # The solutions of both, and each foot measured.
        walk, feet = streamed.navigator.finish(), dict[Side, tuple[Walk, Outcome]]()
        for side, solution in walk.feet.items():
            prepared = prepare_stream(streamed.walks[side])
            feet[side] = prepared, evaluate_solution(prepared, note_losses(solution, streamed.walks[side]))
        summary = summarize_streamed_feet(feet, walk.both, walk.lost)
        content = {"sources": request.sources, **summary}
        if out is None:
            # One line a footfall of each foot, with the verdict on its path.
            emit = outlets.emit_end or drop_line
            for side, (prepared, outcome) in feet.items():
                sensor_time = streamed.navigator.navigators[side].judge.sensor_time
                verdict = judge_path(prepared, outcome.solution)
                for line in format_table(outcome.solution.stances, sensor_time, SMOOTHED, None, verdict):
                    emit(tag_line(line, side, streamed.navigator.frame(side)))
            if not printer.has_failed:
                return Answer(content, say_nothing)
        with target.open() as folder:
            write_streamed_feet(folder, walk.feet, walk.both, summary)
    content = {"sources": request.sources, "folder": str(target.place), **summary}
    return Answer(content, partial(remark, terminal.describe_place(target.place)))


def check_sources(second: str | None, clock_offset_s: float | None, mount: str) -> str | None:
    """Return the right foot's source, None for one sensor; raises `EstimationError` for a source too few or many."""
    if mount != "feet":
        for name, value in (("a second source", second), ("--clock-offset", clock_offset_s)):
            if value is not None:
                raise EstimationError(
                    f"{name} is for a sensor on each foot: name two, as --mount feet LEFT RIGHT, or leave it out."
                )
        return None
    if second is None:
        raise EstimationError("--mount feet takes two sources: name the left foot's, then the right one's.")
    return second


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
        if self.whole is None:
            return [judge_footfalls(self.solution.stances)]
        found = (self.solution, self.solution.polished)
        return [judge_path(self.whole[0], one) for one in found if one is not None]

    def write(self, folder: Path, plots: Plots) -> None:
        """Write what `fg-nav run` writes; with a lag, what needs no samples."""
        if self.whole is None:
            write_lagged(folder, self.solution, plots)
        else:
            write_run(folder, *self.whole, plots)


def find_end(walk: StreamedWalk) -> End:
    """Finish a streamed walk; return its final solution (with a lag, the lagged one), summary and outcome."""
    navigator = walk.navigator
    sensor_time, in_pocket = navigator.judge.sensor_time, isinstance(navigator.options, PocketOptions)
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
    bad = max(navigator.judge.counts[sensor] for sensor in ("acc", "gyr"))
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


def view_demo(seed: int, speed: float, host: str, port: int) -> None:
    """Show the simulated walk while it is walked (`fg-nav demo --view`), and then until Ctrl-C.

    Its samples come as a sensor's would, each when its time has come, through `follow_source`.
    """
    from fg_nav.commands.run import DEMO_SCENARIO
    from fg_nav.lab.simulation import simulate

    if not 0.0 < speed < float("inf"):
        raise StreamError(f"--speed {speed:g} is no factor: give one above zero.")
    with (
        open_outlets(None, (host, port), lambda line: None, remark) as outlets,
        catch_signals(signal.SIGINT, signal.SIGTERM) as stop,
    ):
        simulated = simulate_named(simulate, DEMO_SCENARIO, seed).recording
        remark(f"a walk of {simulated.t[-1] - simulated.t[0]:.0f} s; Ctrl-C ends it.")
        source = Replay(simulated, speed, "the simulated walk")
        navigator = follow_source(
            source, StreamOptions(background=True), outlets.emit, outlets.remark, stop, outlets.watcher
        )
        if not stop.is_set() and outlets.emit_end is not None:
            solution = navigator.finish()
            verdicts = [judge_footfalls(solution.stances)]
            emit_solution(solution, navigator.judge.sensor_time, outlets.emit_end, verdicts)
            remark("the walk is over, and stays on the page until Ctrl-C.")
            stop.wait()
