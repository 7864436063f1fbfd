"""The magnetic field along a smoothed walk: what it shows there, and the factors that it is to have in the next round.

    attitudes      -> field at each footfall, in nav
    gate           -> footfalls whose compass is used: the detector's statistic is below its threshold
    deviations     -> roughness of the field
    all of these   -> readings of the compass, prior of the field's state, direction in which it is expected

The gate (`FieldParameters.gate`) is a detector of `magnetic.detectors`, judged with the attitudes of the round. It is
hard: a heading it rejects is not in the graph. On a rough floor it may reject all of them; what needs a mean field is
then taken from all footfalls. The first walk is that without the field. Its heading has drifted, so in the first round
strength stands in for the deviation across.

The line integrals show how the field deviates from footfall to footfall, and from one region of the building to the
next. A walk without them cannot tell a slow deviation from a drift of its heading. There the heading has one unknown
north and white noise, of a sigma that each round takes from the footfalls that pass,

    sigma^2 = noise^2 + max(robust(e)^2 - noise^2, 0) N / min(N, regions),

e across the mean field, N footfalls that passed, in so many regions of `REGIONAL_LENGTH_M` of the path (`roughness`).
By as much as the gate narrowed the spread of the headings, those it passed may be off together: so is their north.
Where too few pass to show north, all that were seen do, as one reading of their mean field at the footfall in the
middle of the walk: it turns the walk as one piece, and bends nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import gtsam
import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.factors.magnetic_field import E_H, IRON, FieldPrior, across_field
from fg_nav.magnetic import FootfallField
from fg_nav.magnetic.quasi_static import UNKNOWN, FieldVerdicts, apply_gate
from fg_nav.smoother.field_factors import CompassReadings, FieldFactors, FieldPath, integrate_path
from fg_nav.smoother.graph import Trajectory, WalkProblem
from fg_nav.smoother.parameters import FieldParameters
from fg_nav.smoother.roughness import (
    LEAST_SIGMA_UT,
    REGIONAL_LENGTH_M,
    FieldRoughness,
    Roughness,
    field_deviation,
    measure_roughness,
    measure_white_noise,
    neglect_deviation,
    roughness_of,
    usual_deviation,
)
from fg_nav.smoother.solver import list_attitudes

COMPASS_SIGMA_UT = 0.3
"""Noise of a footfall's mean field, uT: what levelling and a soft sole leave, white from stride to stride."""

REFERENCE_SIGMA_DEG = 1.0
"""How well compass and given heading have the same north, deg: declination, mounting, soft iron."""

STRENGTH_SIGMA_UT = 5.0
"""Horizontal strength of the field about the walk's median, uT."""

HARD_IRON_LEVEL_UT = 0.3
"""Hard iron left in the stance's level plane after a calibration, uT."""

HARD_IRON_UP_UT = 15.0
"""The same upward: a calibration from footfalls cannot see it, and in a swing it turns forward."""

REGIONAL_SHARE_OF_MEAN = 0.3
"""By how much regions turn the mean field of a short walk, as a share of how the field differs between footfalls."""

LEAST_STRENGTH_UT = 3.0
"""Horizontal strength below which there is no compass."""

FEWEST_SEEN = 4
"""Footfalls with a field without which it is not used, and that have to pass the gate to stand for the walk."""

LEAST_PATH_M = 0.1
"""Length of the path of a person who stands all the time."""

FIRST_FOOTFALLS = 10
"""At which the heading is still the one that was given."""

CONTRADICTED_SIGMAS = 3.0
"""By how much the field there has to be off for the heading not to be from magnetic north."""

FOUND_SIGMA_DEG = 60.0
"""Sigma of the field's direction where only the field shows it."""

DECLINATION_SIGMA_DEG = 0.05
"""Where the heading was not given, north is magnetic north by definition."""


@dataclass(frozen=True)
class FieldVerdict:
    """What the smoother made of the field at the footfalls: `words` and `reason` as in a stance table, and notes."""

    words: tuple[str, ...]
    reason: tuple[str, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class FieldResiduals:
    """The field along a walk against its mean.

    Verdicts of the gate; the footfalls (F,) that passed, or all seen where these are too few; roughness; spread across
    the mean of all seen and white noise of the compass, uT; attitudes (F, 3, 3); the walk's horizontal field (F, 2).
    """

    verdicts: FieldVerdicts
    steady: Bools
    rough: FieldRoughness
    spread_uT: float
    white_uT: float
    nav_R_body: Floats
    reference: Floats


def find_obstacle(field: FootfallField | None, p: FieldParameters) -> str:
    """Say why the field of a walk shows no heading; empty where it does."""
    if field is None:
        return "the magnetometer was not used"
    seen = np.isfinite(field.strength)
    if seen.sum() < FEWEST_SEEN:
        return f"the field was seen at {seen.sum()} footfalls only"
    level = float(np.median(np.hypot(field.level_field[seen, 0], field.level_field[seen, 1])))
    if level < LEAST_STRENGTH_UT:
        return f"the field is {level:.1f} uT over ground, which is too little for a compass"
    return ""


def ignore_field(problem: WalkProblem, reason: str) -> FieldVerdict:
    """Return the verdict on a walk whose field is not used."""
    footfalls = len(problem.nodes.result)
    return FieldVerdict((UNKNOWN,) * footfalls, (reason,) * footfalls, ())


def rotate_field(field: FootfallField, nav_R_body: Floats) -> Floats:
    """Rotate the field at the footfalls into nav, (F, 3) uT."""
    return np.asarray(np.einsum("kij,kj->ki", nav_R_body, field.body_field))


def integrate_field(problem: WalkProblem, field: FootfallField, track: Trajectory) -> FieldPath:
    """Integrate the field along the strides of a walk."""
    recording, nodes = problem.recording, problem.nodes
    assert recording.mag is not None
    up_uT = float(np.nanmedian(rotate_field(field, list_attitudes(nodes.result, problem.values))[:, 2]))
    footfall = nodes.sample[nodes.result]
    return integrate_path(recording.t, recording.mag, track.position, track.nav_R_body, footfall, up_uT)


def compare_field(
    problem: WalkProblem,
    field: FootfallField,
    values: gtsam.Values,
    path: FieldPath,
    states: Floats | None,
    p: FieldParameters,
) -> FieldResiduals:
    """Compare the field along the walk with its mean; `states` (F, 8) of the last round, None before the first."""
    nav_R_body = list_attitudes(problem.nodes.result, values)
    nav_field = rotate_field(field, nav_R_body)
    seen = np.isfinite(nav_field[:, 0])
    level = np.hypot(nav_field[:, 0], nav_field[:, 1])
    verdicts = apply_gate(replace(field, nav_R_body=nav_R_body), p.gate)
    steady = choose_steady(seen, verdicts.quasi_static)
    if states is None:
        reference = np.tile([0.0, float(np.median(level[seen]))], (len(nav_field), 1))
        deviation = np.stack([level, level, nav_field[:, 2]], axis=1)
        deviation = deviation - np.nanmedian(deviation, axis=0)
    else:
        reference = states[:, E_H]
        deviation = field_deviation(nav_field, reference)
        deviation = deviation - usual_deviation(deviation[steady])
    rough = measure_roughness(deviation, states, seen, steady, path.distance_m)
    mean = np.broadcast_to(nav_field[steady, :2].mean(axis=0), reference.shape)
    white_uT = measure_white_noise(
        across_field(nav_field, mean), steady, path.distance_m, COMPASS_SIGMA_UT, states is None
    )
    spread_uT = roughness_of(np.nan_to_num(deviation[:, 0]), seen, path.distance_m, LEAST_SIGMA_UT).sigma
    return FieldResiduals(verdicts, steady, rough, spread_uT, white_uT, nav_R_body, reference)


def choose_steady(seen: Bools, passed: Bools) -> Bools:
    """Return the footfalls (F,) that stand for the walk's compass: those that passed, or all where too few did."""
    return passed if passed.sum() >= FEWEST_SEEN else seen


def add_field_factors(
    problem: WalkProblem,
    field: FootfallField,
    residuals: FieldResiduals,
    path: FieldPath,
    direction: tuple[float, float],
    p: FieldParameters,
) -> WalkProblem:
    """Add the factors of the field to a walk, in place of those of the round before."""
    rough = residuals.rough if p.potential else neglect_deviation(residuals.rough)
    readings = _read_compass(problem, field, residuals, path, p)
    factors = FieldFactors(readings, path, _expect_field(residuals, rough, direction), rough, p)
    return replace(problem, field=factors)


def _read_compass(
    problem: WalkProblem, field: FootfallField, residuals: FieldResiduals, path: FieldPath, p: FieldParameters
) -> CompassReadings:
    passed, nav_R_body, body_field = residuals.verdicts.quasi_static & p.compass, residuals.nav_R_body, field.body_field
    sigma = np.where(passed, compass_sigma(residuals, p), np.inf)
    if not (problem.heading_known or p.potential or passed.sum() >= FEWEST_SEEN):
        # Their mean as one reading in the middle of the walk.
        middle, body_field = len(sigma) // 2, body_field.copy()
        mean = rotate_field(field, nav_R_body)[residuals.steady].mean(axis=0)
        body_field[middle] = nav_R_body[middle].T @ mean
        sigma[middle] = np.hypot(COMPASS_SIGMA_UT, _average(residuals.rough.across, path))
    return CompassReadings(problem.nodes.result, body_field, nav_R_body, sigma)


def compass_sigma(residuals: FieldResiduals, p: FieldParameters) -> float:
    """Noise of a footfall's compass, uT."""
    return COMPASS_SIGMA_UT if p.potential else residuals.white_uT


def expect_direction(
    problem: WalkProblem, field: FootfallField, residuals: FieldResiduals, path: FieldPath, p: FieldParameters
) -> tuple[float, float]:
    """Direction of the mean field, rad clockwise from north, and its sigma.

    A given heading is taken to be from magnetic north, unless the first footfalls have the field where neither that nor
    its own deviations let it be: a heading of zero is often given where none is known.
    """
    strength = np.linalg.norm(np.median(residuals.reference, axis=0))
    region = Roughness(REGIONAL_SHARE_OF_MEAN * residuals.rough.across.sigma, REGIONAL_LENGTH_M)
    chosen_uT = float(np.sqrt(max(residuals.spread_uT**2 - residuals.rough.across.sigma**2, 0.0)))
    of_regions = 0.0 if p.potential else float(np.hypot(_average(region, path), chosen_uT)) / strength
    if not problem.heading_known:
        return 0.0, float(np.hypot(np.radians(DECLINATION_SIGMA_DEG), of_regions))
    first = rotate_field(field, residuals.nav_R_body)[residuals.steady][:FIRST_FOOTFALLS]
    east, north, _ = first.mean(axis=0)
    deviations = np.hypot(residuals.rough.across.sigma, residuals.rough.regional.sigma) / strength
    sigma, found = float(np.hypot(np.radians(REFERENCE_SIGMA_DEG), of_regions)), float(np.arctan2(east, north))
    if abs(found) <= CONTRADICTED_SIGMAS * np.hypot(sigma, deviations):
        return 0.0, sigma
    return found, np.radians(FOUND_SIGMA_DEG)


def _average(deviation: Roughness, path: FieldPath) -> float:
    """Standard deviation of the mean of a deviation over the walk."""
    path_m = max(float(path.distance_m.sum()), LEAST_PATH_M)
    return deviation.sigma * float(np.sqrt(min(1.0, 2.0 * deviation.length_m / path_m)))


def _expect_field(residuals: FieldResiduals, rough: FieldRoughness, direction: tuple[float, float]) -> FieldPrior:
    strength = float(np.linalg.norm(np.median(residuals.reference, axis=0)))
    azimuth, direction_sigma = direction
    east, north = strength * np.sin(azimuth), strength * np.cos(azimuth)
    sigma = np.array(
        [
            rough.potential.sigma,
            rough.across.sigma,
            rough.regional.sigma,
            direction_sigma * strength,
            STRENGTH_SIGMA_UT,
            HARD_IRON_LEVEL_UT,
            HARD_IRON_LEVEL_UT,
            HARD_IRON_UP_UT,
        ]
    )
    return FieldPrior(np.array([0.0, 0.0, 0.0, east, north, 0.0, 0.0, 0.0]), sigma)


def write_notes(residuals: FieldResiduals, states: Floats, compass: bool) -> tuple[str, ...]:
    """Write what was found of the field, with its states (F, 8)."""
    east, north = np.median(states[:, E_H], axis=0)
    forward, left, up = states[-1, IRON]
    rough, verdicts = residuals.rough, residuals.verdicts
    return (
        f"field over ground {np.hypot(east, north):.1f} uT, {np.degrees(np.arctan2(east, north)):+.1f} deg from north; "
        f"the compass of {100 * verdicts.coverage * compass:.0f} % of the footfalls is used (gate {verdicts.detector})",
        f"it deviates by {_write(rough.across, 'uT')}, by region {_write(rough.regional, 'uT')}, "
        f"its potential by {_write(rough.potential, 'uT m')}",
        f"hard iron left in the stance's axes: {forward:.1f}, {left:.1f}, {up:.1f} uT",
    )


def _write(rough: Roughness, unit: str) -> str:
    return f"{rough.sigma:.1f} {unit} over {rough.length_m:.1f} m"
