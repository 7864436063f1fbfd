"""`fg-nav stream LEFT RIGHT --mount feet`: two sensors, one on each foot, followed as one walk (`stream`).

Lines are those of each foot and of the person between them; at the end, without `--out`, come those of the whole walk
of each foot, and with it a folder.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

from fg_nav.commands import Answer, Target
from fg_nav.commands.stream import LinePrinter, drop_line, note_losses, prepare_stream, remark, say_nothing
from fg_nav.feet import Side
from fg_nav.online.estimates import SMOOTHED, format_table, tag_line
from fg_nav.online.feet import FeetWalk
from fg_nav.online.feet_follow import FeetStreamRequest, StreamedFeet, run_feet_stream
from fg_nav.online.outlets import Say, open_outlets
from fg_nav.report import terminal
from fg_nav.report.feet import summarize_streamed_feet, write_streamed_feet
from fg_nav.report.files import Summary
from fg_nav.verdict import judge_path
from fg_nav.walk import Outcome, Walk, evaluate_solution


def stream_feet(request: FeetStreamRequest, out: Path | None, force: bool, lines: bool = True) -> Answer:
    """Follow two sources to their end; then print the lines of the whole walk, or write its result into a folder.

    Without `lines` none are printed on standard output. Where they cannot be printed any more, and no folder was named,
    the result is written into a fresh one.
    """
    both, printer = request.both, LinePrinter()
    target = Target(out, force, "stream")
    with target, open_outlets(both.serve, both.view, printer if lines else drop_line, remark) as outlets:
        streamed = run_feet_stream(request, outlets)
        if out is None and outlets.emit_end is None and lines:
            return Answer({}, say_nothing)
        end = find_feet_end(streamed)
        content = {"sources": request.sources, **end.summary}
        if out is None:
            emit_feet(end, streamed, outlets.emit_end or drop_line)
            if not printer.has_failed:
                return Answer(content, say_nothing)
        with target.open() as folder:
            write_streamed_feet(folder, end.walk.feet, end.walk.both, end.summary)
    content = {"sources": request.sources, "folder": str(target.place), **end.summary}
    return Answer(content, partial(remark, terminal.describe_place(target.place)))


@dataclass(frozen=True)
class FeetEnd:
    """What a stream of two feet comes to: their solutions, each foot measured, and the summary."""

    walk: FeetWalk
    feet: dict[Side, tuple[Walk, Outcome]]
    summary: Summary


def find_feet_end(streamed: StreamedFeet) -> FeetEnd:
    """Return what a walk of two feet that was followed comes to."""
    walk, feet = streamed.navigator.finish(), dict[Side, tuple[Walk, Outcome]]()
    for side, solution in walk.feet.items():
        of_foot = streamed.walks[side]
        prepared = prepare_stream(of_foot)
        feet[side] = prepared, evaluate_solution(prepared, note_losses(solution, of_foot))
    return FeetEnd(walk, feet, summarize_streamed_feet(feet, walk.both, walk.lost))


def emit_feet(end: FeetEnd, streamed: StreamedFeet, emit: Say) -> None:
    """Emit one line a footfall of each foot, with the verdict on its path."""
    for side, (walk, outcome) in end.feet.items():
        sensor_time = streamed.navigator.navigators[side].judge.sensor_time
        verdict = judge_path(walk, outcome.solution)
        for line in format_table(outcome.solution.stances, sensor_time, SMOOTHED, None, verdict):
            emit(tag_line(line, side, streamed.navigator.frame(side)))
