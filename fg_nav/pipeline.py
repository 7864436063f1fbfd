"""The main job on one page: a recording becomes a trajectory with uncertainties.

    read_walk     file -> Walk: recording, truth, fixes, calibration
    prepare_walk  Walk -> Walk: recording corrected, stances, field at the footfalls
    run_method    Walk -> Outcome: solution, errors
    navigate      all of these -> Result, which `fg_nav.report` writes and draws

The data types and the steps are in `fg_nav.walk`, the methods in `fg_nav.estimators`. Errors are `FgNavError`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from fg_nav.detection.handedness import measure_swing_axes, refuse_wrong_axes
from fg_nav.estimators import Progress, check_changes
from fg_nav.on_places import estimate_on_places
from fg_nav.recording import Recording
from fg_nav.result import Result
from fg_nav.truth import Fix, Truth
from fg_nav.walk import (
    Options,
    Outcome,
    Walk,
    add_known,
    check_known,
    correct_walk,
    evaluate_solution,
    find_stances,
    measure_field,
    read_walk,
)

if TYPE_CHECKING:
    from fg_nav.smoother import ExtraFactors


def navigate(
    recording: Recording | Path | str | Walk,
    method: str = "smoother",
    *,
    heading_deg: float | None = None,
    truth: Truth | Path | str | None = None,
    fixes: Sequence[Fix] = (),
    extra: ExtraFactors | None = None,
    options: Options | None = None,
    progress: Progress | None = None,
) -> Result:
    """Turn a recording into the path that was walked.

    Parameters
    ----------
    recording : Recording, path or Walk
        What the sensor recorded; a file or folder in any format that is read; or a walk as `read_walk` returns it.
    method : str
        One of `fg_nav.estimators.ESTIMATORS`: `smoother`, `inertial`, `online`, `iez`, ...
    heading_deg : float
        Of the body's x axis at the start, deg clockwise from north; without it from the field, else zero.
    truth : truth or path
        To measure errors against.
    fixes : sequence of Fix
        Positions known from elsewhere, for the smoother.
    extra
        Makes factors of your own for the smoother's graph, of its variables (`GraphNodes`); see `smooth`.
    options : Options
        All else that can be chosen: whether the magnetometer is used, calibration, detector of the field, parameters.
    progress
        Called from time to time with the fraction of the work that is done.

    Returns
    -------
    Result
        A `Solution`: `t` (N,) s, `position` (N, 3) m, `velocity` (N, 3) m/s and `nav_R_body` (N, 3, 3) at the
        recording's rate, `stances` with one row a footfall and its sigmas; with `metrics` and `verdict`.

    Raises
    ------
    FgNavError
        In one sentence: what is wrong, where, and what to try.

    Examples
    --------
    >>> recording = fg_nav.read("walk.csv")
    >>> result = fg_nav.navigate(recording, truth="truth.tum", options=fg_nav.Options(use_magnetometer=False))
    >>> result.metrics.strides_detected, result.verdict.word
    (16, 'trusted')
    """
    # read
    walk = recording if isinstance(recording, Walk) else read_walk(recording, options or Options())
    walk = add_known(walk, heading_deg, truth, fixes, extra)
    # correct, find the stances, judge the field
    walk = prepare_walk(walk)
    # estimate, evaluate
    return Result.of(walk, run_method(walk, method, progress))


def prepare_walk(walk: Walk) -> Walk:
    """Correct a recording, find its stances, measure its field and judge it for the report: once, for all methods."""
    # are truth and fixes of this walk, and is there what is changed?
    check_known(walk)
    check_changes(walk.options)
    # magnetometer and accelerometer by their calibration
    walk = correct_walk(replace(walk, sensed=None))
    if walk.options.mount == "pocket":
        refuse_wrong_axes(walk.recording, measure_swing_axes)
        return walk  # a thigh never stands
    # when does the foot stand?
    walk = find_stances(walk)
    # the magnetic field at the footfalls, and for the report where it is undisturbed
    return measure_field(walk)


def run_method(walk: Walk, method: str, progress: Progress | None = None) -> Outcome:
    """Estimate the trajectory of a prepared walk by one method, and measure it against the truth if there is one."""
    # the dense trajectory, and one row a stance, with uncertainties; on the places of an earlier walk if there are some
    solution = estimate_on_places(walk, method, progress)
    # distance, closure, and errors where there is a truth
    return evaluate_solution(walk, solution)
