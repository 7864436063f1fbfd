"""The main job on one page: a file of samples becomes a trajectory with uncertainties, and a folder of results.

    read_walk     file -> Walk: recording, truth, fixes, calibration
    prepare_walk  Walk -> Walk: recording corrected, stances, field at the footfalls
    run_method    Walk -> Outcome: solution, errors
    write_run     Outcome -> files

The data types and the steps are in `fg_nav.walk`, the methods in `fg_nav.estimators`. Errors are `FgNavError`.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from pathlib import Path

from fg_nav.estimators import Progress, estimate
from fg_nav.io.formats import Reading
from fg_nav.walk import Options, Outcome, Walk, correct_walk, evaluate_solution, find_stances, measure_field, read_walk


def navigate(
    path: Path,
    method: str,
    options: Options,
    folder: AbstractContextManager[Path],
    reading: Reading = Reading(),
    progress: Progress | None = None,
) -> dict[str, object]:
    """Run one method on a recording, write its result into a folder, and return the summary of it."""
    # read
    walk = read_walk(path, options, reading)
    # correct, find the stances, judge the field
    walk = prepare_walk(walk)
    # estimate, evaluate
    outcome = run_method(walk, method, progress)
    # write
    with folder as place:
        from fg_nav.report.files import write_run

        return write_run(place, walk, outcome)


def prepare_walk(walk: Walk) -> Walk:
    """Correct a recording, find its stances, measure its field and judge it for the report: once, for all methods."""
    # magnetometer and accelerometer by their calibration
    walk = correct_walk(walk)
    if walk.options.mount == "pocket":
        return walk  # a thigh never stands
    # when does the foot stand?
    walk = find_stances(walk)
    # the magnetic field at the footfalls, and for the report where it is undisturbed
    return measure_field(walk)


def run_method(walk: Walk, method: str, progress: Progress | None = None) -> Outcome:
    """Estimate the trajectory of a prepared walk by one method, and measure it against the truth if there is one."""
    # the dense trajectory, and one row a stance, with uncertainties
    solution = estimate(walk, method, progress)
    # distance, closure, and errors where there is a truth
    return evaluate_solution(walk, solution)
