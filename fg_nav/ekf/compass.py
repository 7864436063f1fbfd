"""IEZ with the heading of the compass, where a detector finds the field quasi-static: QSF, iQSF, Ma 2018 and AIEZ.

Gated by a detector alone (`GatedCompassParameters`), in which QSF, iQSF and Ma 2018 differ:

    each footfall
        T = detector(field of the last footfalls)                                   Ma (13)-(26)
        if T < threshold: update by the heading of the levelled field               Ma (34)-(37)
    else as the IEZ                                                                 Ma (27)-(33), (37)-(39)

AIEZ (`AiezParameters`), with tilt by the accelerometer, and heading by the compass or a straight course:

    each footfall
        update by the direction of up of the mean specific force                    AIEZ (19)-(22)
        QMD = T < threshold: the compass agrees with the heading, |B| is constant   AIEZ (8)-(18)
        if QMD: update by the heading of the levelled field                         AIEZ (23)-(26)
        else if |change| <= xi: update by an unchanged course (HDR)                 AIEZ (27), (28)
        else nothing: it was a curve
    else as the IEZ                                                                 AIEZ (1)-(7), (29)-(32)

T is that of the detector, with the heading of this filter and S = var + sigma^2 in place of the sigma^2 of AIEZ (17),
with which the drift locks the compass out for good.

The course is that of the stride, its change taken from the mean of the n last ones; the heading of the standing foot,
as printed, scatters more (1.8 against 1.3 deg). HDR takes a bend of less than xi for a straight line: of 36 deg in 60
strides it removes 6; with xi of 5 deg and a sigma of 1 deg, 16. So xi is small and the sigma is not.

What is read otherwise than printed, Ma (36), (38), (39), AIEZ (22), (25)-(29), (32): docs/equations.md.

References: Afzal, Renaudin, Lachapelle (2011), "Use of Earth's magnetic field for mitigating gyroscope errors
regardless of magnetic perturbation" (QSF); Ma et al. (2016) as cited by Ma et al. (2018) (iQSF); Ma et al. (2018);
Zhang, Guo, Liu (2017), "Pedestrian Dead Reckoning system using quasi-static magnetic field detection" (AIEZ).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from time import perf_counter

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.detection.rest import find_start
from fg_nav.detection.stance import Stances
from fg_nav.ekf.core import GAUGE_SIGMA, IezParameters, compile_filter, describe_start, filter_walk, make_solution
from fg_nav.ekf.measurements import AGREEMENT, COURSE, PseudoMeasurements, make_pseudo_measurements
from fg_nav.ekf.rts import Track
from fg_nav.errors import EstimationError
from fg_nav.magnetic import Detector, FieldVerdicts, FootfallField
from fg_nav.magnetic.detectors import OFFSET, TOO_LITTLE, judge_field
from fg_nav.recording import Recording
from fg_nav.solution import Solution
from fg_nav.text import format_ratio

COURSE_STRIDES = 5  # n of AIEZ (27): strides before, whose mean is the reference of the course.
START_COMPASS = "here the compass gives the heading at the start"  # Reason not to test it.


@dataclass(frozen=True)
class GatedCompassParameters:
    """Detector and noises of the compass; noises of sensor and foot."""

    detector: Detector  #: Decides at which footfalls the compass is used.
    compass_sigma_deg: float = 10.0  #: Of the heading of a footfall's field: the deviation of the place.
    start_sigma_deg: float = 20.0
    """Of the heading of the first footfall's field, where no heading is given; a considered state until the detector
    passes a footfall (`fg_nav.ekf.core.propagate_considered`), so that without any the walk is that of the IEZ. With
    the backward pass it is in P from the start."""
    levelled_by_force: bool = False  #: Level the field by the mean specific force, as printed; else by the attitude.
    declination_deg: float = 0.0  #: Of magnetic north, clockwise from true north.
    inertial: IezParameters = field(default_factory=IezParameters)  #: Sensor and foot.


@dataclass(frozen=True)
class AiezParameters(GatedCompassParameters):
    """Noises and limits of AIEZ; Zhang gives no value, so ranges are those of the literature."""

    tilt_sigma_deg: float = 1.5  #: Of the direction of up by a stance's force: 0.25 m/s^2 of motion.
    course_sigma_deg: float = 4.0  #: Of an unchanged course: strides scatter by 1.5 to 2 deg, and n changes share some.
    course_limit_deg: float = 2.5  #: xi: beyond it a change is a curve; twice the scatter of straight strides.
    hdr_as_printed: bool = False  #: AIEZ (27), (28) as printed: course of the standing foot, and zero in a curve.


def run_with_compass(
    recording: Recording,
    stances: Stances,
    field: FootfallField | None,
    parameters: GatedCompassParameters,
    heading: float | None = None,
    method: str = "gated compass",
) -> Solution:
    """Navigate a walk forward in time.

    `heading` is rad clockwise from north, of the body's x axis at the start; None to take it from the compass.

    Raises `EstimationError` without a field, without a stance, with stances of another recording, with a detector that
    AIEZ cannot use, or where the filter diverges.
    """
    if field is None:
        raise EstimationError(f"{method} needs a magnetometer that is used: take iez or smoother for this recording.")
    compile_filter()
    began = perf_counter()
    # gate of the compass, and what is measured at each footfall
    core, sigma, at_start = parameters.inertial, 0.0, heading
    if isinstance(parameters, AiezParameters):
        steady = compute_steadiness(field, parameters.detector)
        pseudo = make_aiez_measurements(field, steady, parameters)
    else:
        verdicts = judge_field(field, parameters.detector)
        pseudo = measure_compass(field, verdicts.quasi_static, parameters)
    # without a heading the first compass sets that of the start, and is not used again: it would count twice
    if at_start is None:
        at_start = find_first_heading(field) + float(np.radians(parameters.declination_deg))
        sigma = float(np.radians(parameters.start_sigma_deg))
        variance = pseudo.compass_variance.copy()
        variance[np.flatnonzero(np.isfinite(field.strength))[0]] = np.nan  # of the first footfall that has a field
        pseudo = pseudo._replace(compass_variance=variance)
    start = find_start(recording, stances, at_start, core.rest)
    sigmas = (max(sigma, GAUGE_SIGMA), 0.0) if core.smoothed else (GAUGE_SIGMA, sigma)
    rows = stances.stillest(recording.gyr)
    track = filter_walk(recording, stances.mask, rows, start, core, pseudo, *sigmas)
    # the solution, with the verdicts on the field
    if isinstance(parameters, AiezParameters):
        verdicts = make_verdicts(track, steady, parameters.detector)
    judged, note = (verdicts.words, verdicts.reason), describe_start(recording, start, core)
    solution = make_solution(recording, stances, track, judged, asdict(parameters), method, began, note)
    weight = verdicts.quasi_static.astype(np.float64)
    table = replace(solution.stances, compass_weight=weight, field_statistic=verdicts.statistic)
    return replace(solution, stances=table)


def measure_compass(field: FootfallField, used: Bools, parameters: GatedCompassParameters) -> PseudoMeasurements:
    """Pseudo-measurements of F footfalls: the compass where `used` (F,), and nothing else."""
    variance = np.radians(parameters.compass_sigma_deg) ** 2
    heading = field.force_heading if parameters.levelled_by_force else np.full(len(field), np.nan)
    return make_pseudo_measurements(len(field))._replace(
        body_field=field.body_field,
        body_force=field.body_force,
        compass_heading=heading,
        compass_variance=np.where(used, variance, np.nan),
        declination=float(np.radians(parameters.declination_deg)),
    )


def find_first_heading(field: FootfallField) -> float:
    """Magnetic heading (rad) at the start: of the first footfall that has a field, less the turn since the start."""
    k = int(np.flatnonzero(np.isfinite(field.strength))[0])
    return float(field.heading_difference[k]) + float(field.gyro_heading[0])


def compute_steadiness(field: FootfallField, detector: Detector) -> Floats:
    """Return T (F,), AIEZ (17), without its heading term; NaN where too little of the field was measured.

    Raises `EstimationError` for a detector that does not test the heading, or looks at more than one footfall.
    """
    column = detector.offset_column
    if column is None or detector.rows != 1:
        raise EstimationError(
            f"detector '{detector.name}' does not test the heading of one footfall: give aiez one such as 'aiez'."
        )
    others = [channel for c, channel in enumerate(detector.channels) if c != column]
    total = np.where(np.isfinite(field.strength), 0.0, np.nan)
    return np.asarray(sum(((c.values(field) / c.sigmas(field)) ** 2 for c in others), start=total))


def make_aiez_measurements(field: FootfallField, steady: Floats, parameters: AiezParameters) -> PseudoMeasurements:
    """AIEZ (31), (32): up at every footfall, the compass where there is a field, to be tested, and else the course."""
    n, detector = len(field), parameters.detector
    channel = next(c for c in detector.channels if c.name == OFFSET)
    return measure_compass(field, np.isfinite(steady), parameters)._replace(
        compass_limit=detector.threshold - steady,
        agreement=channel.sigma**2,
        use_own_variance=detector.counts_drift,
        tilt_variance=np.full(n, np.radians(parameters.tilt_sigma_deg) ** 2),
        course_variance=np.full(n, np.radians(parameters.course_sigma_deg) ** 2),
        course_limit=float(np.radians(parameters.course_limit_deg)),
        course_strides=COURSE_STRIDES,
        course_by_path=not parameters.hdr_as_printed,
        curve_is_zero=parameters.hdr_as_printed,
    )


def make_verdicts(track: Track, steady: Floats, detector: Detector) -> FieldVerdicts:
    """Verdicts on the field by the filter's own test, AIEZ (18); `steady` (F,) as from `compute_steadiness`."""
    heading = track.innovation[:, AGREEMENT] ** 2
    statistic = (heading + steady) / detector.threshold
    reasons = []
    for own, others, ratio, course in zip(heading, steady, statistic, track.innovation[:, COURSE], strict=True):
        if np.isnan(others):
            reason = TOO_LITTLE
        elif np.isnan(ratio):
            reason = START_COMPASS
        else:
            reason = (
                f"compass {np.sqrt(own):.2g} sigma from the filter's heading, "
                f"strength {np.sqrt(others):.2g} from steady; {format_ratio(ratio)} times the threshold"
            )
        reasons.append(reason if np.isnan(course) else f"{reason}; held to the course")
    return FieldVerdicts(detector.name, statistic, detector.threshold, tuple(reasons))
