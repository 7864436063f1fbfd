"""A solution saved and drawn by itself, for those who type: what `Solution.save` and `Solution.plot` do."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from fg_nav.errors import OutputError
from fg_nav.io import write_tum
from fg_nav.report.aligned import AlignedSolution, align_solution
from fg_nav.report.files import write_lagged, write_run
from fg_nav.report.folder import result_file, result_folder
from fg_nav.result import Result

if TYPE_CHECKING:
    from fg_nav.solution import Solution

WRITERS = {".tum": lambda path, solution: write_tum(path, solution.t, solution.position, solution.nav_R_body)}
"""Files that hold a path, by their endings."""


def save_solution(solution: Solution, path: Path, force: bool = False) -> Path:
    """Write a solution into a folder, or into a file of the kind that its ending names; return the path.

    Raises `OutputError` if something is there already, it cannot be written, or there is no such ending.
    """
    if path.suffix and path.suffix not in WRITERS:
        known = ", ".join(WRITERS)
        raise OutputError(f"nothing is written as '{path.suffix}': choose one of {known}, or a folder without a dot.")
    try:
        if path.suffix:
            with result_file(path, Path.is_file, force) as file:
                WRITERS[path.suffix](file, solution)
        else:
            with result_folder(path, force) as folder:
                _write_folder(folder, solution)
    except OutputError as error:
        # the sentence is one of the command line
        raise OutputError(str(error).replace("--out", "path").replace("--force", "force=True")) from None
    return path


def _write_folder(folder: Path, solution: Solution) -> None:
    if isinstance(solution, Result):
        write_run(folder, solution.walk, solution.outcome)
    else:
        write_lagged(folder, solution)


def plot_solution(solution: Solution, axes: Any = None) -> Any:
    """Draw a solution from above, with its truth where it knows one; return the axes."""
    from fg_nav.report.plots.maps import plot_trajectory_on_screen

    if isinstance(solution, Result):
        return plot_trajectory_on_screen(align_solution(solution.walk, solution.outcome), axes)
    return plot_trajectory_on_screen(AlignedSolution(solution), axes)
