"""IEZ with the heading of the compass, where a detector finds the field quasi-static: QSF, iQSF and Ma 2018.

    each footfall
        T = detector(field of the last footfalls)                                  Ma (13)-(26)
        if T < threshold: update by the heading of the levelled field               Ma (34)-(37)
    else as the IEZ                                                                 Ma (27)-(33), (37)-(39)

The three differ by their detector alone. Ma's z (heading of the gyroscope less that of the field) and its row of H are
those of `fg_nav.ekf.measurements`; Ma (36) as printed has the row of the gyro bias instead. The attitude is
corrected with the one sign that shrinks its error, and an angle needs no sample period; Ma (38), (39).

A detector tests changes, and a filter uses the heading itself: a lasting deviation is followed. The compass's sigma
covers the deviations of the place, far above the compass's noise.

References: Afzal, Renaudin, Lachapelle (2011), "Use of Earth's magnetic field for mitigating gyroscope errors
regardless of magnetic perturbation" (QSF); Ma et al. (2016) as cited by Ma et al. (2018) (iQSF); Ma et al. (2018).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from time import perf_counter

import numpy as np

from fg_nav.arrays import Bools
from fg_nav.detection.rest import Start, find_start
from fg_nav.ekf.core import GAUGE_SIGMA, IezParameters, compile_filter, describe_start, filter_walk, make_solution
from fg_nav.ekf.measurements import PseudoMeasurements, make_pseudo_measurements
from fg_nav.ekf.rts import Track
from fg_nav.errors import EstimationError
from fg_nav.magnetic import FieldVerdicts, FootfallField
from fg_nav.magnetic.quasi_static import Detector, judge_field
from fg_nav.recording import Recording
from fg_nav.solution import Solution
from fg_nav.stances import Stances


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


def run_gated_compass(
    recording: Recording,
    stances: Stances,
    field: FootfallField | None,
    parameters: GatedCompassParameters,
    heading: float | None = None,
    method: str = "gated compass",
) -> Solution:
    """Navigate a walk forward in time.

    Parameters
    ----------
    recording, stances : of one walk.
    field : at its footfalls.
    parameters : GatedCompassParameters
    heading : rad clockwise from north, of the body's x axis at the start; None to take it from the compass.
    method : its name in the solution.

    Raises
    ------
    EstimationError
        Without a field, without a stance, with stances of another recording, or where the filter diverges.
    """
    measured = require_field(field, method)
    compile_filter()
    began = perf_counter()
    verdicts = judge_field(measured, parameters.detector)
    pseudo = measure_compass(measured, verdicts.quasi_static, parameters)
    track, start = filter_with_compass(recording, stances, measured, parameters, heading, pseudo)
    return make_compass_solution(recording, stances, track, start, verdicts, parameters, method, began)


def filter_with_compass(
    recording: Recording,
    stances: Stances,
    field: FootfallField,
    parameters: GatedCompassParameters,
    heading: float | None,
    pseudo: PseudoMeasurements,
) -> tuple[Track, Start]:
    """Run the core with these pseudo-measurements; return its track and its start.

    Without a `heading` (rad) the first compass sets that of the start, and is not used again: it would count twice.
    """
    core, sigma, at_start = parameters.inertial, 0.0, heading
    if at_start is None:
        at_start = find_first_heading(field) + float(np.radians(parameters.declination_deg))
        sigma = float(np.radians(parameters.start_sigma_deg))
        variance = pseudo.compass_variance.copy()
        variance[np.flatnonzero(np.isfinite(field.strength))[0]] = np.nan  # of the first footfall that has a field
        pseudo = pseudo._replace(compass_variance=variance)
    start = find_start(recording, stances, at_start, core.rest)
    sigmas = (max(sigma, GAUGE_SIGMA), 0.0) if core.smoothed else (GAUGE_SIGMA, sigma)
    rows = stances.stillest(recording.gyr)
    return filter_walk(recording, stances.mask, rows, start, core, pseudo, *sigmas), start


def make_compass_solution(
    recording: Recording,
    stances: Stances,
    track: Track,
    start: Start,
    verdicts: FieldVerdicts,
    parameters: GatedCompassParameters,
    method: str,
    began: float,
) -> Solution:
    """Solution of a pass that `began` (perf_counter)."""
    judged, note = (verdicts.words, verdicts.reason), describe_start(recording, start, parameters.inertial)
    solution = make_solution(recording, stances, track, judged, asdict(parameters), method, began, note)
    weight = verdicts.quasi_static.astype(np.float64)
    table = replace(solution.stances, compass_weight=weight, field_statistic=verdicts.statistic)
    return replace(solution, stances=table)


def require_field(field: FootfallField | None, method: str) -> FootfallField:
    """Return the field; raises `EstimationError` if there is none."""
    if field is None:
        raise EstimationError(f"{method} needs a magnetometer that is used: take iez or smoother for this recording.")
    return field


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
