"""The main job on one page: a recording becomes a trajectory with uncertainties.

    read_walk     file -> Walk: recording, truth, fixes, calibration
    prepare_walk  Walk -> Walk: recording corrected, stances, field at the footfalls
    run_method    Walk -> Outcome: solution, errors
    navigate      all of these -> Result, which `fg_nav.report` writes and draws

The data types and the steps are in `fg_nav.walk`, the methods in `fg_nav.estimators`. Errors are `FgNavError`.

A walk on the places of an earlier one (`--places`), `estimate_on_places`, is solved, located and solved again:

    path      of the solution, with the field along it                     (`fg_nav.places.signature`)
    location  start and heading in the known frame, by what is recognized  (`fg_nav.places.location`)
    solution  again, tied to the known places, in axes of the known frame  (`fg_nav.smoother.constraints`)

Its sigmas are those in the known frame: of the ties, of the walk between them, and of the known walk itself at the
places that were recognized, which all footfalls share. A walk that is not recognized stays in its own frame.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.detection.mount import measure_swing_axes, refuse_wrong_axes
from fg_nav.errors import PlacesError
from fg_nav.estimators import Progress, check_changes, estimate
from fg_nav.evaluation.metrics import Metrics
from fg_nav.frames import compute_heading
from fg_nav.recording import Recording
from fg_nav.solution import KnownStretch, Located, Solution
from fg_nav.text import format_count
from fg_nav.truth import Fix, Truth
from fg_nav.verdict import Verdict, judge_path
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
    from fg_nav.places import SavedPlaces
    from fg_nav.smoother import ExtraFactors

LOG = logging.getLogger(__name__)


@dataclass(frozen=True, repr=False)
class Result(Solution):
    """A `Solution` that knows its walk: what `fg_nav.navigate` returns.

    Attributes
    ----------
    walk : the recording as the method saw it, its stances, its field at the footfalls, its truth, the options.
    outcome : the comparison with the truth, and for an online method what came of its batch solution.

    Examples
    --------
    >>> result = fg_nav.navigate("walk.csv", "inertial")
    >>> result.position.shape == (len(result.t), 3)  # m, east, north, up from the first stance
    True
    >>> result.stances.position_sigma.shape == (len(result.stances), 3)  # m, one standard deviation
    True
    >>> result.walk.stances.n_footfalls == len(result.stances)
    True
    """

    walk: Walk = field(kw_only=True)
    outcome: Outcome = field(kw_only=True)

    @classmethod
    def of(cls, walk: Walk, outcome: Outcome) -> Result:
        """Join a walk with what a method made of it."""
        known = {item.name: getattr(outcome.solution, item.name) for item in fields(Solution)}
        return cls(**known, walk=walk, outcome=outcome)

    @property
    def metrics(self) -> Metrics:
        """Distance and closure in m, and where there is a truth the errors, in m and deg.

        Examples
        --------
        >>> result = fg_nav.navigate("walk.csv", "inertial", truth="truth.tum")
        >>> result.metrics.rmse_2d_m < 0.5
        True
        """
        return self.outcome.metrics

    @cached_property
    def verdict(self) -> Verdict:
        """Whether the path is to be trusted: a word, and the reasons against it.

        Examples
        --------
        >>> fg_nav.navigate("walk.csv", "inertial").verdict.word
        'trusted'
        """
        return judge_path(self.walk, self)


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
        One of `fg_nav.estimators.METHODS`: `smoother`, `inertial`, `online`, `iez`, ...
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
    """Return the walk with corrected samples, stances, and field with verdicts: once, for all methods."""
    # do truth and fixes belong to this walk, and do the changed parameters exist?
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
    walk = measure_field(walk)
    for words in (f"{len(walk.stances)} stances, {format_count(walk.stances.n_footfalls, 'footfall')}", *walk.notes):
        LOG.info(words)
    return walk


def run_method(walk: Walk, method: str, progress: Progress | None = None) -> Outcome:
    """Estimate the trajectory of a prepared walk by one method, and measure it against the truth if there is one."""
    # the dense trajectory, and one row a stance, with uncertainties; on the places of an earlier walk if there are some
    solution = estimate_on_places(walk, method, progress)
    # distance, closure, and errors where there is a truth
    return evaluate_solution(walk, solution)


def estimate_on_places(walk: Walk, method: str, progress: Progress | None = None) -> Solution:
    """Solve a walk; where known places are recognized, solve it again in their frame, tied to them.

    Raises `EstimationError` or `PlacesError` for known places where the method has no use of them, with fixes, or
    without a magnetometer.
    """
    if walk.places is None:
        return estimate(walk, method, progress)
    from fg_nav.places import locate, trace_signature
    from fg_nav.smoother.constraints import KnownTies

    if walk.fixes or walk.extra is not None:
        raise PlacesError("fixes and saved places are in frames of their own: give one of them.")
    mag = require_mag(walk)
    solution = estimate(walk, method, progress)
    path = trace_signature(walk.recording.t, solution.position, solution.nav_R_body, mag)
    # start and heading in the known frame, from the recognized places
    location = locate(path, walk.places)
    if location is None:
        words = "nothing of the saved places was recognized: the walk is in a frame of its own"
        return replace(solution, notes=(*solution.notes, words))
    # the footfall nearest to each recognized piece is tied to it, relative to the located start
    footfalls, pieces = solution.stances, location.pieces
    nearest = np.abs(pieces.t[:, None] - footfalls.t).argmin(axis=1)
    apart = np.einsum("kji,kj->ki", footfalls.nav_R_body[nearest], pieces.place - footfalls.position[nearest])
    known = KnownTies(footfalls.t[nearest], apart, pieces.known - location.start, pieces.tie_covariance)
    # the same walk in axes of the known frame
    heading_deg = float(np.rad2deg(compute_heading(footfalls.nav_R_body[0]) - location.turn_rad))
    options = replace(walk.options, heading_deg=heading_deg)
    again = estimate(replace(walk, options=options, known=known), method, progress)
    # shifted to its located start; with the variance of the known walk
    table, variance = again.stances, np.diag(location.map_variance)
    pose_cov = None if table.pose_cov is None else table.pose_cov.copy()
    if pose_cov is not None:
        pose_cov[:, :3, :3] += variance
    position, position_cov = table.position + location.start, table.position_cov + variance
    table = replace(table, position=position, position_cov=position_cov, pose_cov=pose_cov)
    # where it begins, and what was recognized
    stretches = []
    for one in location.stretches:
        points = (one.later, path), (one.earlier, walk.places.path)
        t, known_t = (np.interp(point, np.arange(len(there)), there.t) for point, there in points)
        stretches.append(KnownStretch(t, known_t, one.opposite, one.score, one.expected_false, one.length_m))
    located = Located(
        table.position[0],
        float(compute_heading(table.nav_R_body[0])),
        np.append(table.position_sigma[0], table.heading_sigma[0]),
        location.expected_false,
        walk.places.recording,
        tuple(stretches),
    )
    moved, notes = again.position + location.start, (*again.notes, located.sentence)
    return replace(again, position=moved, stances=table, located=located, notes=notes)


def take_places(walk: Walk, solution: Solution) -> SavedPlaces:
    """Return the magnetic places along a solved walk, to be saved."""
    from fg_nav.places import trace_places

    table, name, mag = solution.stances, walk.recording.provenance.path, require_mag(walk)
    path = (walk.recording.t, solution.position, solution.nav_R_body)
    return replace(trace_places(*path, mag, table.t, table.position_sigma), recording="" if name is None else name.name)


def require_mag(walk: Walk) -> Floats:
    """Return the readings of the magnetometer; raise `PlacesError` where there are none."""
    if walk.recording.mag is None:
        raise PlacesError("places are known by their magnetic field, and there is no magnetometer: leave them out.")
    return walk.recording.mag
