"""A solution saved and drawn by itself, for those who type: what `Solution.save` and `Solution.plot` do."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fg_nav.errors import OutputError
from fg_nav.feet_result import FeetResult
from fg_nav.report.aligned import AlignedSolution, align_solution
from fg_nav.report.export import export_track
from fg_nav.report.export.place import Origin
from fg_nav.report.export.track import Track
from fg_nav.report.feet import view_person, write_feet
from fg_nav.report.files import write_lagged, write_run
from fg_nav.report.folder import result_folder
from fg_nav.result import Result

if TYPE_CHECKING:
    from fg_nav.solution import Solution

_WORDS = {"--out": "path", "--force": "force=True", "--origin 48.137,11.575": "origin=(48.137, 11.575)"}
"""What the command line calls these."""


def save_solution(solution: Solution, path: Path, force: bool = False, origin: Sequence[float] | None = None) -> Path:
    """Write a solution into a folder, or into a file of the kind that its ending names; return the path.

    `origin` is where the walk starts on the Earth, for maps: latitude, longitude, and height where it is known.

    Raises `OutputError` if something is there already, it cannot be written, or there is no such ending.
    """
    try:
        if path.suffix:
            export_track(Track.of(solution, path.stem), path, None if origin is None else Origin(*origin), force)
        else:
            with result_folder(path, force) as folder:
                _write_folder(folder, solution)
    except OutputError as error:
        words = str(error)
        for typed, named in _WORDS.items():
            words = words.replace(typed, named)
        raise OutputError(words) from None
    return path


def _write_folder(folder: Path, solution: Solution) -> None:
    if isinstance(solution, Result):
        write_run(folder, solution.walk, solution.outcome)
    elif isinstance(solution, FeetResult):
        write_feet(folder, solution)
    else:
        write_lagged(folder, solution)


def plot_solution(solution: Solution, axes: Any = None) -> Any:
    """Draw a solution from above, with its truth where it knows one; return the axes."""
    from fg_nav.report.plots.maps import plot_trajectory_on_screen

    if isinstance(solution, Result):
        return plot_trajectory_on_screen(align_solution(solution.walk, solution.outcome), axes)
    if isinstance(solution, FeetResult):
        return plot_trajectory_on_screen(view_person(solution), axes)
    return plot_trajectory_on_screen(AlignedSolution(solution), axes)
