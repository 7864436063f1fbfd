"""One recording, and what is found in it once for all methods: stances, field, and verdicts on it for the report.

The functions here are the steps of `fg_nav.pipeline`; each takes a `Walk` and returns one with more fields filled.
Every method is given the same walk and the same heading at the start, so outcomes differ by the estimator alone.

A calibration corrects the magnetometer and the accelerometer. Its gyroscope bias is not taken off the samples, because
that changes with each switch-on; the smoother begins with it, and every estimator estimates that of the recording.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from fg_nav.arrays import Brief, Floats
from fg_nav.detection import StanceParameters, detect_stances
from fg_nav.detection.mount import refuse_pocket, refuse_wrong_axes
from fg_nav.detection.sensor_processing import refuse_high_pass, remove_gyro_delay
from fg_nav.detection.stance import Stances
from fg_nav.errors import EstimationError, EvaluationError, MagneticError
from fg_nav.evaluation.comparison import Comparison, compare, share_truth
from fg_nav.evaluation.metrics import Metrics, MomentErrors, evaluate, measure_moment
from fg_nav.io import Reading, read_fixes, read_gnss, read_truth
from fg_nav.magnetic.axes import AlignedMagnetometer, MagAxes, align_magnetometer
from fg_nav.magnetic.detectors import DEFAULT, QUASI_STATIC, UNKNOWN, FieldVerdicts, apply_gate, choose_gate
from fg_nav.magnetic.footfall_field import FootfallField
from fg_nav.recording import Recording
from fg_nav.solution import Solution
from fg_nav.text import DETECTOR, Changes, change_parameters, select_changes
from fg_nav.truth import Fix, Gnss, TrajectoryTruth, Truth, check_fixes, check_truth, select_fixes

if TYPE_CHECKING:
    from fg_nav.calibration.of_recording import Calibration
    from fg_nav.places import SavedPlaces
    from fg_nav.smoother import ExtraFactors
    from fg_nav.smoother.constraints import KnownTies

Mount: TypeAlias = Literal["foot", "pocket"]  # Where the sensor is worn.

Magnetic: TypeAlias = Literal["all", "card"]  # Which factors of the field the graph has.

OWN_GNSS = Path("own")  # in place of a file of GNSS fixes: those in the recording itself

LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class Options:
    """What a user can choose.

    Examples
    --------
    >>> options = fg_nav.Options(use_magnetometer=False, heading_deg=90.0, changes=(("smoother.node_spacing_s", 0.1),))
    >>> fg_nav.navigate("walk.csv", options=options).parameters["node_spacing_s"]
    0.1
    """

    use_magnetometer: bool = True  #: whether the methods see the magnetometer at all
    #: of the body's x axis at the start, degrees clockwise from north; None for zero, or from the field in methods that
    #: use it
    heading_deg: float | None = None
    alignment: str = "yaw"  #: how a solution is aligned with the truth (`fg_nav.evaluation.comparison`)
    truth_path: Path | None = None  #: file with the truth; None for that in the recording, if there is one
    #: detector that weighs the field at a footfall, one of `fg_nav.magnetic.detectors.GATES`; a filter with a compass
    #: has a detector of its own
    gate: str = DEFAULT
    #: factors of the field in the graph: "card", magnetic heading and differential field alone: no line integrals, no
    #: recognized places
    magnetic: Magnetic = "all"
    calibration_path: Path | None = None  #: file with a calibration to apply
    preset: str = "tuned"  #: of the filters (`fg_nav.ekf.presets`)
    fixes_path: Path | None = None  #: file with fixes of the position for the smoother
    mount: Mount | None = None  #: where the sensor is worn, checked against the recording; None for a foot, unchecked
    step_constant_m: float | None = None  #: for the length of a step, in a pocket (`fg_nav.pocket.dead_reckoning`)
    known_distance_m: float | None = None  #: walked, to find the step constant by
    #: parameters to override, by the method's name and their dotted name, as `smoother.magnetic.rounds`; those of the
    #: stances as `detector.threshold`; ignored for a pocket
    changes: Changes = ()
    mag_axes: MagAxes | None = None  #: of the magnetometer in those of the gyroscope; None for the same, or as it shows
    polish: bool = False  #: whether the online method solves the walk in batch as well
    places_path: Path | None = None  #: file with the places of an earlier walk, on which this one is to be located
    gnss_path: Path | None = None  #: file with a receiver's fixes (`fg_nav.io.read_gnss`), or `OWN_GNSS`

    @property
    def heading_rad(self) -> float | None:
        """The heading at the start, rad clockwise from north; raises `EstimationError` if it is not finite."""
        if self.heading_deg is None:
            return None
        if not np.isfinite(self.heading_deg):
            raise EstimationError(f"a heading of {self.heading_deg} deg is no direction: give a number.")
        return float(np.deg2rad(self.heading_deg))


@dataclass(frozen=True)
class Walk(Brief):
    """What every method is given."""

    recording: Recording  # as the methods see it, once `correct_walk` has calibrated it
    stances: Stances  # of this recording; none before `find_stances`, and with the sensor in a pocket
    truth: Truth | None = None  # of this recording
    options: Options = Options()
    detection: StanceParameters | None = None  # how the stances were found; None where they were given
    field: FootfallField | None = None  # at the footfalls; None where it is not known
    # of the gate on the field, for the report of methods without a compass; None where there are none
    verdicts: FieldVerdicts | None = None
    unjudged: str = ""  # why the field was not judged; empty where it was, or before `measure_field`
    calibration: Calibration | None = None  # that was given; None without
    applied: tuple[str, ...] = ()  # what the calibration corrected, in words; such a recording is not corrected again
    # how the magnetometer was corrected by the walk itself, in words; empty where a calibration was given
    iron: tuple[str, ...] = ()
    # the recording before that, for a method that finds the iron on its way; None before `measure_field`
    sensed: Recording | None = None
    # its delay and its axes, as `correct_walk` found them; None before, and where it is not used
    magnetometer: AlignedMagnetometer | None = None
    fixes: tuple[Fix, ...] = ()  # positions known from elsewhere; used by the smoother only
    gnss: Gnss | None = None  # a receiver's fixes, for the smoother and in a pocket; None without
    extra: ExtraFactors | None = None  # makes factors of the user's own; used by the smoother only
    # of an earlier walk, on which this one is to be located; used by the smoother only
    places: SavedPlaces | None = None
    known: KnownTies | None = None  # footfalls at these places, where they were recognized, for the smoother
    beside: Floats | None = None  # (N,) s, stamps of the recording of the other foot; None where there is none

    @classmethod
    def of(cls, recording: Recording, options: Options = Options(), calibration: Calibration | None = None) -> Walk:
        """Begin with a recording: nothing is corrected yet, and there are no stances."""
        none = Stances.from_mask(np.zeros(len(recording), dtype=bool))
        return cls(recording, none, recording.truth, options, calibration=calibration)

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks for the user on fixes, calibration and field."""
        notes = []
        if self.fixes and self.fixes[0].origin is not None:
            latitude, longitude, _ = self.fixes[0].origin
            notes.append(f"places are m east, north and up of the first fix, at {latitude:.7f}, {longitude:.7f} deg")
        if self.calibration is not None:
            notes.append(f"corrected by the calibration: {', '.join(self.applied) or 'nothing'}")
        if self.magnetometer is not None:
            notes += self.magnetometer.notes
        notes += self.iron
        if self.unjudged and self.recording.mag is not None:
            notes.append(f"the field was not judged: {self.unjudged}")
        return tuple(notes)


@dataclass(frozen=True)
class Outcome(Brief):
    """What one method made of a walk."""

    solution: Solution  # with the verdicts on the field in its table of stances
    metrics: Metrics  # of the solution; `comparison` is None without a usable truth
    comparison: Comparison | None
    field_used: bool = False  # whether the method used the field, known from the verdicts in its own stance table
    # errors of an online method's estimates at the moment of each footfall; None from others, and without a usable
    # truth
    moment: MomentErrors | None = None
    polished: Outcome | None = None  # what came of the batch solution next to an online one; None without


def read_walk(path: Path | str | Recording, options: Options = Options(), reading: Reading = Reading()) -> Walk:
    """Return the walk: the recording, read if it is a path, with calibration, fixes, GNSS and places of the options."""
    truth = None if options.truth_path is None else read_truth(options.truth_path)
    fixes = () if options.fixes_path is None else read_fixes(options.fixes_path)
    calibration = None
    if options.calibration_path is not None:
        from fg_nav.calibration.of_recording import read_calibration

        calibration = read_calibration(options.calibration_path)
    places = None
    if options.places_path is not None:
        from fg_nav.places import read_places

        places = read_places(options.places_path)
    gnss = None
    if options.gnss_path is not None:
        source = path.provenance.path if isinstance(path, Recording) else path
        if options.gnss_path == OWN_GNSS and source is None:
            raise EstimationError("the recording is of no file, so it has no Location.csv: give the file of the fixes.")
        gnss = read_gnss(source if options.gnss_path == OWN_GNSS and source else options.gnss_path)
    recording = path if isinstance(path, Recording) else reading.read(path)
    known, rate = recording.provenance, f"{1.0 / recording.period_s:.4g} Hz"
    about = f"{known.path or 'arrays'}: {len(recording)} samples of format {known.format} at {rate}"
    for words in (about, *known.notes):
        LOG.info(words)
    recording = recording if truth is None else replace(recording, truth=truth)
    return replace(Walk.of(recording, options, calibration), fixes=fixes, gnss=gnss, places=places)


def add_known(
    walk: Walk,
    heading_deg: float | None,
    truth: Truth | Path | str | None,
    fixes: Sequence[Fix] = (),
    extra: ExtraFactors | None = None,
) -> Walk:
    """Return the walk with heading (deg), truth, fixes and extra factors added; None leaves its own."""
    options = walk.options if heading_deg is None else replace(walk.options, heading_deg=heading_deg)
    if isinstance(truth, Path | str):
        options = replace(options, truth_path=Path(truth))
        truth = read_truth(truth)
    truth = walk.truth if truth is None else truth
    return replace(walk, options=options, truth=truth, fixes=(*walk.fixes, *fixes), extra=extra or walk.extra)


def check_known(walk: Walk) -> None:
    """Refuse fixes, and a truth that the user named, that cannot belong to this walk, before it is solved."""
    if walk.options.truth_path is not None and walk.truth is not None:
        check_truth(walk.truth, walk.recording.t)
        if isinstance(walk.truth, TrajectoryTruth):
            share_truth(walk.truth, walk.recording.t)
    if walk.gnss is not None:
        if len(walk.fixes) > 0 or walk.extra is not None or walk.places is not None:
            raise EstimationError("GNSS fixes are not combined with other fixes, places or factors: leave one out.")
        select_fixes(walk.gnss.fixes, float(walk.recording.t[0]), float(walk.recording.t[-1]))
    if walk.fixes:
        check_fixes(walk.fixes, walk.recording.t)


def correct_walk(walk: Walk) -> Walk:
    """Return the walk calibrated and with aligned sensor times; drops a magnetometer that is unused or misaligned."""
    recording, options, calibration = walk.recording, walk.options, walk.calibration
    # delay of the gyroscope; axes of the magnetometer
    if options.mount != "pocket":
        recording = remove_gyro_delay(recording)
    if not options.use_magnetometer:
        recording = replace(recording, mag=None)
    elif options.mag_axes is not None:
        recording = options.mag_axes.apply_to(recording)
    # calibration
    if calibration is not None and not walk.applied:
        if calibration.magnetometer is not None and options.use_magnetometer:
            recording = calibration.magnetometer.apply_to(recording)
        if calibration.accelerometer is not None and calibration.accelerometer.separable:
            recording = calibration.accelerometer.apply_to(recording)
        walk = replace(walk, applied=calibration.corrects(options.use_magnetometer))
    # delay of the magnetometer, and other axes that the recording shows
    if not options.use_magnetometer:
        return replace(walk, recording=recording)
    found = align_magnetometer(recording, options.mag_axes is not None)
    return replace(walk, recording=found.recording, magnetometer=found)


def find_stances(walk: Walk) -> Walk:
    """Return the walk with its stances, corrected for a large accelerometer error if they show one.

    Raises `DetectionError` where there are none. Of a sensor that is said to be on a foot, `EstimationError` if it was
    clearly in a pocket, and `RecordingError` if its strides show other axes than those given, or a high-pass.
    """
    if walk.options.mount == "foot":
        refuse_pocket(walk.recording)
        refuse_wrong_axes(walk.recording)
    detection = change_parameters(StanceParameters(), select_changes(walk.options.changes, DETECTOR))
    stances = detect_stances(walk.recording, detection)
    if "accelerometer" not in walk.applied:
        from fg_nav.calibration.inertial import average_out_error

        corrected = average_out_error(walk.recording, stances)
        if corrected is not walk.recording:  # gravity decides what is a stance
            walk, stances = replace(walk, recording=corrected), detect_stances(corrected, detection)
    if walk.options.mount == "foot":
        refuse_high_pass(walk.recording, stances)
    return replace(walk, stances=stances, detection=detection)


def measure_field(walk: Walk) -> Walk:
    """Return the walk with the magnetic field at its footfalls and the verdicts on it, or with the reason why not.

    Raises `MagneticError` if there is no such gate. A field that cannot be judged is no error.
    """
    options = walk.options
    if not options.use_magnetometer:
        return replace(walk, unjudged="the magnetometer was left out, as asked")
    if walk.recording.mag is None and walk.magnetometer is not None and walk.magnetometer.notes:
        return replace(walk, unjudged=walk.magnetometer.notes[0])
    choose_gate(options.gate)
    from fg_nav.calibration.walk import measure_walk_field

    sensed = walk.recording if walk.sensed is None else walk.sensed
    given = None if walk.calibration is None else walk.calibration.magnetometer
    measured = measure_walk_field(sensed, walk.stances, options.heading_rad, given)
    if measured.field is None:
        return replace(walk, unjudged=measured.unseen)
    walk = replace(walk, recording=measured.recording, iron=measured.notes, sensed=sensed)
    try:
        return replace(walk, field=measured.field, verdicts=apply_gate(measured.field, options.gate), unjudged="")
    except MagneticError as error:
        return replace(walk, unjudged=str(error))


def find_origin(fixes: Sequence[Fix], solution: Solution) -> tuple[float, float, float | None] | None:
    """Return latitude, longitude (deg) and height (m) of the zero of a path, where fixes or a receiver show it."""
    start = solution.parameters.get("gnss_start")
    if isinstance(start, dict):
        return start["latitude_deg"], start["longitude_deg"], None
    return fixes[0].origin if fixes else None


def evaluate_solution(walk: Walk, solution: Solution) -> Outcome:
    """Return the solution with its metrics: distance and closure, and errors where the walk has a truth.

    Raises `EvaluationError` if the solution cannot be compared with a truth that the user named. A truth that merely
    came with the recording is then left out, with a note.
    """
    # did the method use the field? In a pocket "disturbed" is a stride without a sample that was used
    table, verdicts, on_foot = solution.stances, walk.verdicts, walk.options.mount != "pocket"
    used = any(word == QUASI_STATIC or (word != UNKNOWN and on_foot) for word in table.field)
    # the gate's verdicts, or why there are none, where the method did not judge the field along its own solution
    if all(word == UNKNOWN for word in table.field):
        if verdicts is None:
            table = replace(table, field_reason=(walk.unjudged or "the field was not judged",) * len(table))
        elif not solution.uses_field:
            reason, statistic = verdicts.reason, verdicts.statistic
            table = replace(table, field=verdicts.words, field_reason=reason, field_statistic=statistic)
        solution = replace(solution, stances=table)
    polished = None if solution.polished is None else evaluate_solution(walk, solution.polished)
    # errors, where there is a truth
    comparison = moment = None
    try:
        if walk.truth is not None:
            comparison = compare(solution, walk.truth, walk.options.alignment)
            if solution.moment is not None:
                moment = measure_moment(solution, solution.moment, walk.truth, comparison.alignment)
        metrics = evaluate(solution, walk.truth, comparison=comparison)
    except EvaluationError as error:
        if walk.options.truth_path is not None:
            raise
        comparison = moment = None
        metrics = evaluate(solution)
        metrics = replace(metrics, notes=(*metrics.notes, f"truth left out: {error}"))
    for words in metrics.notes:
        LOG.info(words)
    return Outcome(solution, metrics, comparison, used, moment, polished)
