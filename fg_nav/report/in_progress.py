"""A walk that was followed: its lines on standard output, remarks on standard error, and its result at the end."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from fg_nav.commands.stream_end import result
from fg_nav.evaluation import evaluate
from fg_nav.online.lines import lines_of
from fg_nav.report.results import write_json, write_strides
from fg_nav.report.terminal import progress
from fg_nav.report.writing import write_run_folder

if TYPE_CHECKING:
    from fg_nav.online.command import Followed
    from fg_nav.solution import Solution


def remark(words: str) -> None:
    """Tell people something beside the lines."""
    typer.echo(f"fg-nav: {words}", err=True)


def printed() -> Callable[[str], None]:
    """Return what prints a line at once; when nobody reads any more it says so, and the walk goes on."""
    listened = True

    def tell(line: str) -> None:
        nonlocal listened
        if not listened:
            return
        try:
            typer.echo(line)
        except BrokenPipeError:
            listened = False
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # so that the exit is quiet
            remark("nobody reads the lines any more: the walk goes on without them.")

    return tell


def show_end(walk: Followed, served: bool) -> None:
    """Print the smoothed past, one line a footfall; where the lines were served there is nobody to print for."""
    if served:
        return
    tell = printed()
    for line in lines_of(_solution(walk).stances, walk.navigator.judge.sensor_time):
        tell(line)


def write_end(folder: Path, walk: Followed) -> None:
    """Write what `fg-nav run` writes; with a lag, the table of footfalls and a summary only."""
    if walk.navigator.options.lag_s is None:
        with progress("online") as report:
            session, outcome = result(walk.navigator, walk.name, walk.calibration, report)
        write_run_folder(folder, session, outcome)
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


def _solution(walk: Followed) -> Solution:
    if walk.navigator.options.lag_s is not None:
        return walk.navigator.finish()
    return result(walk.navigator, walk.name, walk.calibration)[1].solution
