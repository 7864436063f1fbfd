"""IEZ with the heading of the compass, where a detector finds the field quasi-static: QSF, iQSF and Ma 2018.

    each footfall
        T = detector(field of the last footfalls)                                  (Ma Eq. 13-26)
        if T < threshold: take in the heading of the levelled field                 (Ma Eq. 34-37)
    else as the IEZ

The three differ by their detector alone. Ma's z (heading of the gyroscope less that of the field) and its row of H are
those of `fg_nav.ekf.attitude_updates`; Eq. 36 as printed has the row of the gyro bias instead. The attitude is
corrected with the one sign that shrinks its error, and an angle needs no sample period (Eq. 38, 39).

A detector looks at changes, and a filter takes the heading itself: a deviation that stays is believed. Its sigma stands
for the deviations of the place, far above the compass's noise.

References: Afzal, Renaudin, Lachapelle (2011), "Use of Earth's magnetic field for mitigating gyroscope errors
regardless of magnetic perturbation" (QSF); Ma et al. (2016) as told in Ma et al. (2018) (iQSF); Ma et al. (2018).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from time import perf_counter

import numpy as np

from fg_nav.arrays import Bools
from fg_nav.ekf.core import GAUGE_SIGMA, compiled, filter_walk, solution_of, start_note
from fg_nav.ekf.evidence import Evidence, no_evidence
from fg_nav.ekf.parameters import IezParameters
from fg_nav.ekf.track import Track
from fg_nav.errors import EstimationError
from fg_nav.magnetic import FieldVerdicts, FootfallField
from fg_nav.magnetic.quasi_static import Detector, judge
from fg_nav.recording import Recording
from fg_nav.solution import Solution
from fg_nav.stances import Stances
from fg_nav.start import Start, starting_point


@dataclass(frozen=True)
class GatedCompassParameters:
    """What the filter believes."""

    detector: Detector
    """Which footfalls it believes the compass at."""
    compass_sigma_deg: float = 10.0
    """Of the heading that a footfall's field tells: the deviation of the place, alike at neighbouring footfalls."""
    start_sigma_deg: float = 20.0
    """Of the heading that the first footfall's field tells, where none is given; set aside until the detector lets one
    in (`fg_nav.ekf.core.turned_about_start`), so that without any the walk is that of the IEZ. With the way back it is
    there from the start."""
    levelled_by_force: bool = False
    """Level the field by the stance's mean specific force, as printed; else by the filter's attitude."""
    declination_deg: float = 0.0
    """Of magnetic north, clockwise from true north."""
    inertial: IezParameters = field(default_factory=IezParameters)
    """The core."""


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
    verdicts = judge(known, parameters.detector)
    evidence = compass_evidence(known, verdicts.quasi_static, parameters)
    track, start = passed(recording, stances, known, parameters, heading, evidence)
    return solved(recording, stances, track, start, verdicts, parameters, method, began)


def passed(
    recording: Recording,
    stances: Stances,
    field: FootfallField,
    parameters: GatedCompassParameters,
    heading: float | None,
    evidence: Evidence,
) -> tuple[Track, Start]:
    """Run the core on what is believed of the field; and where it began."""
    start, sigma = started(recording, stances, field, parameters, heading)
    if heading is None:
        evidence = without_compass(evidence, first_measured(field))
    rows = stances.stillest(recording.gyr)
    core = parameters.inertial
    sigmas = (max(sigma, GAUGE_SIGMA), 0.0) if core.smoothed else (GAUGE_SIGMA, sigma)
    return filter_walk(recording, stances.mask, rows, start, core, evidence, *sigmas), start


def solved(
    recording: Recording,
    stances: Stances,
    track: Track,
    start: Start,
    verdicts: FieldVerdicts,
    parameters: GatedCompassParameters,
    method: str,
    began: float,
) -> Solution:
    """Put the solution of a pass that `began` (perf_counter) together."""
    told, note = (verdicts.words, verdicts.reason), start_note(recording, start, parameters.inertial)
    return solution_of(recording, stances, track, told, asdict(parameters), method, began, note)


def needed(field: FootfallField | None, method: str) -> FootfallField:
    """Return the field; raises `EstimationError` if there is none."""
    if field is None:
        raise EstimationError(f"{method} needs a magnetometer that is used: take iez or smoother for this recording.")
    return field


def compass_evidence(field: FootfallField, believed: Bools, parameters: GatedCompassParameters) -> Evidence:
    """The compass at each footfall (F,) where it is believed, and nothing else."""
    variance = np.radians(parameters.compass_sigma_deg) ** 2
    heading = field.force_heading if parameters.levelled_by_force else np.full(len(field), np.nan)
    return no_evidence(len(field))._replace(
        body_field=field.body_field,
        body_force=field.body_force,
        compass_heading=heading,
        compass_variance=np.where(believed, variance, np.nan),
        declination=float(np.radians(parameters.declination_deg)),
    )


def started(
    recording: Recording,
    stances: Stances,
    field: FootfallField,
    parameters: GatedCompassParameters,
    heading: float | None,
) -> tuple[Start, float]:
    """Where the filter begins, and the sigma (rad) of its heading: 0 for one given, or the first footfall's field's."""
    if heading is not None:
        return starting_point(recording, stances, heading, parameters.inertial.rest), 0.0
    told, sigma = first_heading(field), float(np.radians(parameters.start_sigma_deg))
    at_start = told + float(np.radians(parameters.declination_deg))
    return starting_point(recording, stances, at_start, parameters.inertial.rest), sigma


def first_heading(field: FootfallField) -> float:
    """Magnetic heading (rad) at the start: of the first footfall that has a field, less what was turned since."""
    k = first_measured(field)
    return float(field.heading_difference[k]) + float(field.gyro_heading[0])


def first_measured(field: FootfallField) -> int:
    """First footfall that has a field."""
    return int(np.flatnonzero(np.isfinite(field.strength))[0])


def without_compass(evidence: Evidence, footfall: int) -> Evidence:
    """Return the evidence without the compass of a footfall: what began the heading is not taken in a second time."""
    variance = evidence.compass_variance.copy()
    variance[footfall] = np.nan
    return evidence._replace(compass_variance=variance)
