"""A single solution saved and drawn: `Solution.save` and `Solution.plot`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fg_nav.errors import OutputError
from fg_nav.evaluation.metrics import evaluate
from fg_nav.feet_result import FeetResult
from fg_nav.report.course import align_feet, align_solution, describe_frame, draw_course, draw_feet
from fg_nav.report.export import export_track
from fg_nav.report.export.track import ExportTrack, Origin
from fg_nav.report.feet import write_feet
from fg_nav.report.files import write_lagged, write_run
from fg_nav.report.folder import result_folder
from fg_nav.result import Result
from fg_nav.walk import Options, Outcome

if TYPE_CHECKING:
    from fg_nav.solution import Solution

# Options of the command line, and the arguments in their place.
_OPTIONS = {"--out": "path", "--force": "force=True", "--origin 48.137,11.575": "origin=(48.137, 11.575)"}


def save_solution(solution: Solution, path: Path, force: bool = False, origin: Sequence[float] | None = None) -> Path:
    """Write a solution into a folder, or into a file of the format of its ending; return the path.

    `origin` is the start of the walk on the Earth, for maps: latitude, longitude, and height where it is known.

    Raises `OutputError` if something is there already, it cannot be written, or the ending is unknown.
    """
    try:
        if path.suffix:
            track = ExportTrack.of(solution, path.stem)
            export_track(track, path, None if origin is None else Origin(*origin), force)
            return path
        with result_folder(path, force) as folder:
            if isinstance(solution, Result):
                write_run(folder, solution.walk, solution.outcome)
            elif isinstance(solution, FeetResult):
                write_feet(folder, solution)
            else:
                write_lagged(folder, solution)
    except OutputError as error:
        words = str(error)
        for option, argument in _OPTIONS.items():
            words = words.replace(option, argument)
        raise OutputError(words) from None
    return path


def plot_solution(solution: Solution, axes: Any = None) -> Any:
    """Draw a solution from above, with its truth where it has one; return the axes."""
    from fg_nav.report.plots.walk import draw_on_screen

    if isinstance(solution, FeetResult):
        person, feet, frame = align_feet(solution)
        return draw_on_screen(draw_feet(person, feet, frame), f"Path{person.alignment_words}", axes)
    outcome, walk = Outcome(solution, evaluate(solution), None), None
    if isinstance(solution, Result):
        outcome, walk = solution.outcome, solution.walk
    view, name = align_solution(walk, outcome), solution.method
    frame = describe_frame(view, outcome, Options() if walk is None else walk.options)
    chart = draw_course({name: view}, {name: outcome}, frame)
    return draw_on_screen(chart, f"Path{view.alignment_words}", axes)
