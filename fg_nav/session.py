"""One recording, its stances found once, and any number of methods run on the two: what `fg-nav run` does.

`prepare` makes a `Session`, `solve` runs one method in it. Every method of a session sees the same
recording, calibrated or not, the same stances, the same verdicts on the magnetic field and the same heading
at the start, so their outcomes differ by the estimator alone.

Of a calibration the magnetometer and the accelerometer are corrected. Its gyroscope's bias is left on the samples:
a bias is that of one switch-on, and every estimator finds that of the recording itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fg_nav.calibration.file import Calibration, read_calibration
from fg_nav.changes import Changes
from fg_nav.detection import StanceParameters, detect_stances
from fg_nav.errors import EstimationError, EvaluationError, MagneticError
from fg_nav.estimators import WITH_FIXES, Given, Mount, Progress, estimator
from fg_nav.evaluation import Metrics, evaluate
from fg_nav.evaluation.comparison import Comparison, compare
from fg_nav.evaluation.walked import WalkErrors, measure_walk
from fg_nav.io import read, read_fixes, read_truth
from fg_nav.magnetic import FieldVerdicts, FootfallField, average_footfall_field
from fg_nav.magnetic.quasi_static import DEFAULT, QUASI_STATIC, UNKNOWN, find_detector, judge_field
from fg_nav.recording import Recording, Truth
from fg_nav.solution import Solution
from fg_nav.stances import Stances


@dataclass(frozen=True)
class Options:
    """What a user can choose.

    Attributes
    ----------
    use_magnetometer : whether the methods see the magnetometer at all.
    heading_deg : heading of the body's x axis at the start, degrees clockwise from north; None where it is not known:
        then zero, or what the compass says.
    alignment : how a solution is laid on the truth (`fg_nav.evaluation.alignment`).
    truth_path : file with the truth; without one the truth in the recording is taken, if there is one.
    field_detector : which detector of a quasi-static field the verdicts come from (`fg_nav.magnetic.quasi_static`).
    calibration_path : file with a calibration to apply; None to take the recording as it is.
    preset : of the filters (`fg_nav.ekf.presets`).
    fixes_path : file with fixes of the position for the smoother; None without.
    mount : where the sensor is worn, to be held against the recording; None for a foot that nobody doubts.
    step_constant_m, known_distance_m : for the length of a step, with the sensor in a pocket
        (`fg_nav.pocket.dead_reckoning`).
    changes : of the method's parameters, on a foot.
    """

    use_magnetometer: bool = True
    heading_deg: float | None = None
    alignment: str = "yaw"
    truth_path: Path | None = None
    field_detector: str = DEFAULT
    calibration_path: Path | None = None
    preset: str = "tuned"
    fixes_path: Path | None = None
    mount: Mount | None = None
    step_constant_m: float | None = None
    known_distance_m: float | None = None
    changes: Changes = ()


@dataclass(frozen=True)
class Session:
    """What all methods share.

    Attributes
    ----------
    recording : as the methods see it, calibrated.
    stances, truth, options : of this recording; no stances where nobody looked for them.
    detection : how the stances were found; None where they were given.
    field : at the footfalls; None where it is not known.
    verdicts : on the field; None where it could not be judged.
    unjudged : why not; empty where it was judged, or nobody asked.
    calibration : that was given; None without.
    applied : what was corrected by it, in words.
    """

    recording: Recording
    stances: Stances
    truth: Truth | None
    options: Options
    detection: StanceParameters | None = None
    field: FootfallField | None = None
    verdicts: FieldVerdicts | None = None
    unjudged: str = ""
    calibration: Calibration | None = None
    applied: tuple[str, ...] = ()

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks for the user on calibration and field."""
        notes = []
        if self.calibration is not None:
            notes.append(f"corrected by the calibration: {', '.join(self.applied) or 'nothing'}")
        if self.unjudged and self.recording.mag is not None:
            notes.append(f"the field was not judged: {self.unjudged}")
        return tuple(notes)

    def known_field(self) -> FootfallField:
        """Return the field at the footfalls; raises `MagneticError` with the reason where it is not known."""
        if self.field is None:
            raise MagneticError(self.unjudged or "nobody looked at the field of this walk: use `with_field`.")
        return self.field


@dataclass(frozen=True)
class Outcome:
    """What one method made of it.

    Attributes
    ----------
    solution : with the verdicts on the field in its table of stances.
    metrics, comparison : of the solution; `comparison` is None without a usable truth.
    field_used : whether the method made use of the field: then its own table had verdicts.
    moment : errors of what an online method told at the moment; None from others, and without a usable truth.
    """

    solution: Solution
    metrics: Metrics
    comparison: Comparison | None
    field_used: bool = False
    moment: WalkErrors | None = None


def load(path: Path, format: str | None = None, options: Options | None = None) -> Session:
    """Read a recording, and truth and calibration if they were named; on a foot find stances and judge the field.

    Raises
    ------
    FormatError, RecordingError, CalibrationError, DetectionError, EstimationError
        If a file cannot be read, if the recording cannot be navigated with, the calibration is not for it, or a sensor
        that is said to be on a foot was clearly in a pocket.
    """
    session = opened(path, format, options)
    if session.options.mount == "pocket":
        return session  # a pocket has no footfalls
    if session.options.mount == "foot":
        from fg_nav.detection.mount import refuse_pocket

        refuse_pocket(session.recording)
    return with_footfalls(session)


def opened(path: Path, format: str | None = None, options: Options | None = None) -> Session:
    """Read the same files and apply the calibration; the session has no stances.

    Raises
    ------
    FormatError, RecordingError, CalibrationError
        If a file cannot be read, or the calibration is not for the recording.
    """
    options = options or Options()
    truth = None if options.truth_path is None else read_truth(options.truth_path)
    calibration = None if options.calibration_path is None else read_calibration(options.calibration_path)
    recording = read(path, format)
    return _corrected(recording if truth is None else replace(recording, truth=truth), options, calibration)


def prepare(recording: Recording, options: Options | None = None, calibration: Calibration | None = None) -> Session:
    """Apply the calibration, find the stances and judge the field.

    Raises
    ------
    DetectionError
        Where there are no stances.
    CalibrationError
        If the calibration is of a magnetometer and the recording has none.
    MagneticError
        If there is no such detector. A field that cannot be judged is no error: `Session.unjudged` tells why.
    """
    return with_footfalls(_corrected(recording, options or Options(), calibration))


def with_footfalls(session: Session) -> Session:
    """Return a session with the stances of its recording, and with its field; raises as `prepare` does."""
    detection = StanceParameters()
    return with_field(replace(session, stances=detect_stances(session.recording, detection), detection=detection))


def with_field(session: Session) -> Session:
    """Return a session with the field at the footfalls and the verdicts on it, or with the reason why not."""
    options = session.options
    if not options.use_magnetometer:
        return replace(session, unjudged="the magnetometer was left out, as told")
    find_detector(options.field_detector)
    try:
        field = average_footfall_field(session.recording, session.stances, _heading(options) or 0.0)
    except MagneticError as error:
        return replace(session, unjudged=str(error))
    try:
        return replace(session, field=field, verdicts=judge_field(field, options.field_detector), unjudged="")
    except MagneticError as error:
        return replace(session, field=field, unjudged=str(error))


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
    options = session.options
    if options.fixes_path is not None and method not in WITH_FIXES:
        raise EstimationError(
            f"{method} makes no use of fixes: leave --fixes out, or choose {' or '.join(WITH_FIXES)}."
        )
    fixes = () if options.fixes_path is None else read_fixes(options.fixes_path)
    lengths = (options.step_constant_m, options.known_distance_m)
    of_walk = (session.recording, session.stances, session.field, _heading(options))
    given = Given(*of_walk, options.preset, fixes, *lengths, options.changes)
    return measured(session, estimator(method, options.mount or "foot")(given, progress))


def measured(session: Session, found: Solution) -> Outcome:
    """Measure a solution of the session's recording and stances; raises `EvaluationError` as `solve` does."""
    on_foot = session.options.mount != "pocket"  # in a pocket "disturbed" is a stride without a sample that was used
    used = any(word == QUASI_STATIC or (word != UNKNOWN and on_foot) for word in found.stances.field)
    solution = _with_verdicts(found, session)
    if session.truth is None:
        return Outcome(solution, evaluate(solution), None, used)
    try:
        comparison = compare(solution, session.truth, session.options.alignment)
        metrics = evaluate(solution, session.truth, session.options.alignment)
        moment = None
        if solution.moment is not None:
            told = replace(solution, stances=solution.moment)
            moment = measure_walk(told, session.truth, session.options.alignment)
        return Outcome(solution, metrics, comparison, used, moment)
    except EvaluationError as error:
        if session.options.truth_path is not None:
            raise
        metrics = evaluate(solution)
        left_out = f"truth left out: {error}"
        return Outcome(solution, replace(metrics, notes=(*metrics.notes, left_out)), None, used)


def _heading(options: Options) -> float | None:
    if options.heading_deg is None:
        return None
    heading = float(np.deg2rad(options.heading_deg))
    if not np.isfinite(heading):
        raise EstimationError(f"a heading of {options.heading_deg} deg is no direction: give a number.")
    return heading


def _corrected(recording: Recording, options: Options, calibration: Calibration | None) -> Session:
    """Begin a session: the recording as the methods see it, no stances yet."""
    seen = recording if options.use_magnetometer else replace(recording, mag=None)
    applied = () if calibration is None else calibration.corrects(options.use_magnetometer)
    seen = seen if calibration is None else _calibrated(seen, calibration, options)
    none = Stances.from_mask(np.zeros(len(seen), dtype=bool))
    return Session(seen, none, recording.truth, options, calibration=calibration, applied=applied)


def _calibrated(recording: Recording, calibration: Calibration, options: Options) -> Recording:
    if calibration.magnetometer is not None and options.use_magnetometer:
        recording = calibration.magnetometer.apply_to(recording)
    if calibration.accelerometer is not None and calibration.accelerometer.separable:
        recording = calibration.accelerometer.apply_to(recording)
    return recording


def _with_verdicts(solution: Solution, session: Session) -> Solution:
    """Write the verdicts on the field into the table of the stances; both have one row a footfall."""
    rows, verdicts = len(solution.stances), session.verdicts
    if any(word != UNKNOWN for word in solution.stances.field):
        return solution  # the method judged the field by its own detector
    if verdicts is None:
        words, reasons = (UNKNOWN,) * rows, (session.unjudged or "the field was not judged",) * rows
    else:
        words, reasons = verdicts.words, verdicts.reason
    return replace(solution, stances=replace(solution.stances, field=words, field_reason=reasons))
