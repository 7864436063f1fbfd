"""One recording, its stances found once, and any number of methods run on the two: what `fg-nav run` does.

`prepare` makes a `Session`, `solve` runs one method in it. Every method of a session sees the same
recording, the same stances and the same heading at the start, so their outcomes differ by the estimator
alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fg_nav.detection import StanceParameters, detect_stances
from fg_nav.errors import EstimationError, EvaluationError
from fg_nav.estimators import Progress, estimator
from fg_nav.evaluation import Metrics, evaluate
from fg_nav.evaluation.comparison import Comparison, compare
from fg_nav.io import read, read_truth
from fg_nav.recording import Recording, Truth
from fg_nav.solution import Solution
from fg_nav.stances import Stances


@dataclass(frozen=True)
class Options:
    """What a user can choose.

    Attributes
    ----------
    use_magnetometer : whether the methods see the magnetometer at all.
    heading_deg : heading of the body's x axis at the start, degrees clockwise from north.
    alignment : how a solution is laid on the truth (`fg_nav.evaluation.alignment`).
    truth_path : file with the truth; without one the truth in the recording is taken, if there is one.
    """

    use_magnetometer: bool = True
    heading_deg: float = 0.0
    alignment: str = "yaw"
    truth_path: Path | None = None


@dataclass(frozen=True)
class Session:
    """What all methods share; `detection` is how the stances were found, None where they were given."""

    recording: Recording
    stances: Stances
    truth: Truth | None
    options: Options
    detection: StanceParameters | None = None


@dataclass(frozen=True)
class Outcome:
    """What one method made of it; `comparison` is None without a usable truth."""

    solution: Solution
    metrics: Metrics
    comparison: Comparison | None


def load(path: Path, format: str | None = None, options: Options | None = None) -> Session:
    """Read a recording, and the truth if one was named, and find the stances.

    Raises
    ------
    FormatError, RecordingError, DetectionError
        If either file cannot be read, or the recording cannot be navigated with.
    """
    options = options or Options()
    truth = None if options.truth_path is None else read_truth(options.truth_path)
    recording = read(path, format)
    return prepare(recording if truth is None else replace(recording, truth=truth), options)


def prepare(recording: Recording, options: Options | None = None) -> Session:
    """Find the stances of a recording; raises `DetectionError` where there are none."""
    options = options or Options()
    seen = recording if options.use_magnetometer else replace(recording, mag=None)
    detection = StanceParameters()
    return Session(seen, detect_stances(seen, detection), recording.truth, options, detection)


def solve(session: Session, method: str, progress: Progress | None = None) -> Outcome:
    """Run a method and measure its solution.

    Raises
    ------
    EstimationError
        If there is no such method, or it cannot solve this walk.
    EvaluationError
        If the solution cannot be compared with a truth that the user named. A truth that merely came with the
        recording is then left out, with a note.
    """
    heading = float(np.deg2rad(session.options.heading_deg))
    if not np.isfinite(heading):
        raise EstimationError(f"a heading of {session.options.heading_deg} deg is no direction: give a number.")
    solution = estimator(method)(session.recording, session.stances, heading, progress)
    if session.truth is None:
        return Outcome(solution, evaluate(solution), None)
    try:
        comparison = compare(solution, session.truth, session.options.alignment)
        return Outcome(solution, evaluate(solution, session.truth, session.options.alignment), comparison)
    except EvaluationError as error:
        if session.options.truth_path is not None:
            raise
        metrics = evaluate(solution)
        return Outcome(solution, replace(metrics, notes=(*metrics.notes, f"truth left out: {error}")), None)
