"""AIEZ (Zhang et al. 2017): the IEZ, upright by the accelerometer, its heading by the compass or by a straight course.

    each footfall
        take in the direction of up that the mean specific force tells                          (Eq. 19-22)
        QMD = T < threshold: the compass agrees with the heading, and |B| stands still           (Eq. 8-18)
        if QMD: take in the heading of the levelled field                                        (Eq. 23-26)
        else if |change| <= xi: take in that the heading did not change (HDR)                    (Eq. 27-28)
        else nothing: it was a curve
    else as the IEZ                                                                              (Eq. 1-7, 29-32)

T is that of the detector, with the heading of this filter and S = var + sigma^2 in place of the sigma^2 of Eq. 17, or
else the drift locks the compass out for good. The detector `aiez` of `fg_nav.magnetic`, which all methods share, has
only the drifting heading of the gyroscope and follows wrong compasses further, for it knows less of its own doubt.

The course is that of the stride, held against the mean of the n last ones; the heading of the standing foot, as
printed, scatters more (1.8 against 1.3 deg, half of them within), for it is not put down the same way twice. What bends
by less than xi is a straight line to HDR: of 36 deg in 60 strides it takes off 6, of 60 deg nothing; with xi of 5 deg
and a sigma of 1 deg, 16 and 26. The first strides of a turn suffer the same. So xi is small and the sigma is not.

HDR has the row of the compass but tells no heading, only that the filter's own goes on: held to it, the filter grows
surer of a heading than anything has told it, and slower to believe the next compass.

Read otherwise than printed (`fg_nav.ekf.printed` has the printed forms): errors of roll and pitch are rotations about
axes of nav (Eq. 22, 29); angles are wrapped (Eq. 26, 27); a curve is no measurement, where Eq. 28 takes zero with the
sigma of a straight line (`curve_is_zero` does so); the compass has the sign of `fg_nav.magnetic.compass` (Eq. 25).

Reference: Zhang, Guo, Liu (2017), "Pedestrian Dead Reckoning system using quasi-static magnetic field detection".
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.ekf.attitude_updates import AGREEMENT, COURSE
from fg_nav.ekf.core import compiled
from fg_nav.ekf.evidence import Evidence
from fg_nav.ekf.gated_compass import GatedCompassParameters, compass_evidence, needed, passed, solved
from fg_nav.ekf.track import Track
from fg_nav.errors import EstimationError
from fg_nav.magnetic import Detector, FieldVerdicts, FootfallField
from fg_nav.magnetic.channels import OFFSET, Channel
from fg_nav.magnetic.quasi_static import DETECTORS, TOO_LITTLE
from fg_nav.recording import Recording
from fg_nav.solution import Solution
from fg_nav.stances import Stances

AGREEING = replace(
    DETECTORS["aiez"],
    channels=(
        Channel(OFFSET, float(np.deg2rad(10.0)), float(np.deg2rad(40.0))),
        *(channel for channel in DETECTORS["aiez"].channels if channel.name != OFFSET),
    ),
)
"""The detector `aiez` as the filter's own test, with the sigma with which the compass is then taken in.

S is that of the innovation, and 25 deg pass. With the detector's 2.5 deg, 6 deg pass: who believes only what agrees
with him is never told that he is wrong. The price are magnets that turn the compass by less than 25 deg.
"""


TOLD_THE_START = "here the compass tells the heading at the start"
"""Reason not to test it."""


@dataclass(frozen=True)
class AiezParameters(GatedCompassParameters):
    """What the filter believes; Zhang gives no value, so ranges are those of the literature."""

    tilt_sigma_deg: float = 1.5
    """Of the direction of up that a stance's force tells: 0.25 m/s^2 of motion is taken for gravity."""
    course_sigma_deg: float = 4.0
    """Of the course going on as it was: strides scatter by 1.5 to 2 deg, and n changes in a row share their strides."""
    course_limit_deg: float = 2.5
    """xi: a change beyond this is a curve; twice the scatter of strides on a straight line."""
    course_strides: int = 5
    """n: strides before, whose mean the course is held against."""
    course_by_path: bool = True
    """The course is that of the stride; False for the heading of the standing foot."""
    curve_is_zero: bool = False
    """Take a change of zero for measured in a curve, as printed."""


def run_aiez(
    recording: Recording,
    stances: Stances,
    field: FootfallField | None,
    parameters: AiezParameters,
    heading: float | None = None,
    method: str = "aiez",
) -> Solution:
    """Navigate a walk forward in time.

    Parameters
    ----------
    recording, stances : of one walk.
    field : at its footfalls.
    parameters : AiezParameters
    heading : rad clockwise from north, of the body's x axis at the start; None to ask the compass.
    method : its name in the solution.

    Raises
    ------
    EstimationError
        Without a field, without a stance, with stances of another recording, or where the filter diverges.
    """
    known = needed(field, method)
    compiled()
    began = perf_counter()
    steady = steadiness(known, parameters.detector)
    evidence = aiez_evidence(known, steady, parameters)
    track, start = passed(recording, stances, known, parameters, heading, evidence)
    verdicts = verdicts_of(track, steady, parameters.detector)
    return solved(recording, stances, track, start, verdicts, parameters, method, began)


def steadiness(field: FootfallField, detector: Detector) -> Floats:
    """(F,) the part of T (Eq. 17) that is not the heading's; NaN where too little of the field was measured.

    Raises
    ------
    EstimationError
        For a detector that does not test the heading, or looks at more than one footfall.
    """
    column = detector.offset_column
    if column is None or detector.rows != 1:
        raise EstimationError(
            f"detector '{detector.name}' does not test the heading of one footfall: give aiez one such as 'aiez'."
        )
    others = [channel for c, channel in enumerate(detector.channels) if c != column]
    total = np.where(np.isfinite(field.strength), 0.0, np.nan)
    return np.asarray(sum(((c.values(field) / c.sigmas(field)) ** 2 for c in others), start=total))


def aiez_evidence(field: FootfallField, steady: Floats, parameters: AiezParameters) -> Evidence:
    """Up at every footfall, the compass to be tested where there was a field, and the course for the rest."""
    n, detector = len(field), parameters.detector
    channel = next(c for c in detector.channels if c.name == OFFSET)
    return compass_evidence(field, np.isfinite(steady), parameters)._replace(
        compass_limit=detector.threshold - steady,
        agreement=channel.sigma**2,
        own_doubt=detector.laying.in_test,
        tilt_variance=np.full(n, np.radians(parameters.tilt_sigma_deg) ** 2),
        course_variance=np.full(n, np.radians(parameters.course_sigma_deg) ** 2),
        course_limit=float(np.radians(parameters.course_limit_deg)),
        course_strides=parameters.course_strides,
        course_by_path=parameters.course_by_path,
        curve_is_zero=parameters.curve_is_zero,
    )


def verdicts_of(track: Track, steady: Floats, detector: Detector) -> FieldVerdicts:
    """What the filter found of the field on its way; `steady` (F,) as from `steadiness`."""
    heading = track.innovation[:, AGREEMENT] ** 2
    statistic = (heading + steady) / detector.threshold
    reasons = tuple(_reason(*row) for row in zip(heading, steady, statistic, track.innovation[:, COURSE], strict=True))
    return FieldVerdicts(detector.name, statistic, detector.threshold, reasons)


def _reason(heading: float, steady: float, statistic: float, course: float) -> str:
    held = "" if np.isnan(course) else "; held to the course"
    if np.isnan(steady):
        return f"{TOO_LITTLE}{held}"
    if np.isnan(statistic):
        return f"{TOLD_THE_START}{held}"
    parts = (
        f"compass {np.sqrt(heading):.2g} sigma from the filter's heading, strength {np.sqrt(steady):.2g} from steady"
    )
    return f"{parts}; {statistic:.2g} times the threshold{held}"
