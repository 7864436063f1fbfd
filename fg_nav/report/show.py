"""A single solution saved and drawn: `Solution.save` and `Solution.plot`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fg_nav.errors import OutputError
from fg_nav.feet_result import FeetResult
from fg_nav.pipeline import Result
from fg_nav.report.drawn import AlignedSolution, align_solution
from fg_nav.report.export import export_track
from fg_nav.report.export.track import ExportTrack, Origin
from fg_nav.report.feet import view_person, write_feet
from fg_nav.report.files import write_lagged, write_run
from fg_nav.report.folder import result_folder

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
    from fg_nav.report.plots.walk import plot_trajectory_on_screen

    if isinstance(solution, Result):
        return plot_trajectory_on_screen(align_solution(solution.walk, solution.outcome), axes)
    if isinstance(solution, FeetResult):
        return plot_trajectory_on_screen(view_person(solution), axes)
    return plot_trajectory_on_screen(AlignedSolution(solution), axes)
