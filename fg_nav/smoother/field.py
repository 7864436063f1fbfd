"""The magnetic field along a smoothed walk: what it shows there, and the factors that it is to have in the next round.

    attitudes      -> field at each footfall, in nav
    gate           -> how much more or less than the walk's spread a footfall's compass may deviate
    deviations     -> roughness of the field
    all of these   -> readings of the compass, prior of the field's state, direction in which it is expected

Every footfall with a reading has its compass. The gate (`FieldParameters.gate`) is a detector of `magnetic.detectors`,
judged with the attitudes of the round: with T_k its statistic, of n squares, and the walk's white spread of the field

    sigma_k^2 = noise^2 + white^2 (2 + n T_k / median T) / (2 + n)         (`magnetic.quasi_static.weigh_statistic`)

from the noise of a quiet field to none of the information. What deviates alike for metres and in whole regions are
states (`roughness`). The iron of the magnetometer has the prior of its calibration.

Whether a heading is given turns the path and changes nothing else: where it is, the direction of the field is free;
where it is not, the start is, and north is where the field points.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import gtsam
import numpy as np

from fg_nav.arrays import Floats
from fg_nav.factors.magnetic_field import E_H, IRON, FieldPrior
from fg_nav.magnetic import FootfallField
from fg_nav.magnetic.quasi_static import UNKNOWN, FieldVerdicts, apply_gate, weigh_statistic
from fg_nav.smoother.field_factors import CompassReadings, FieldFactors, FieldPath, integrate_path
from fg_nav.smoother.graph import Trajectory, WalkProblem
from fg_nav.smoother.parameters import FieldParameters
from fg_nav.smoother.roughness import FieldRoughness, Roughness, deviate_along, measure_roughness
from fg_nav.smoother.solver import list_attitudes

COMPASS_SIGMA_UT = 0.3
"""Noise of a footfall's mean field, uT: what levelling and a soft sole leave, white from stride to stride."""

STRENGTH_SIGMA_UT = 5.0  # Horizontal strength of the field about the walk's median, uT.

LEFT_IRON_LEVEL_UT, LEFT_IRON_UP_UT = 0.3, 4.0
"""What a calibration leaves, one sigma an axis. Upward it turns forward in the swing, and stands for all that adds up
along the path in all strides alike: soft iron, delay, tilt. Line integrals of 21 closed walks end off by 0.1 to 2 uT
times their length, of which iron upward makes a third."""

MIN_STRENGTH_UT = 3.0  # Horizontal strength below which there is no compass.
MIN_SEEN = 4  # Footfalls with a field without which it is not used.
FOUND_SIGMA_DEG = 60.0  # Sigma of the field's direction where only the field shows it.
DECLINATION_SIGMA_DEG = 0.05  # Where the heading was not given, north is magnetic north by definition.


@dataclass(frozen=True)
class FieldVerdict:
    """What the smoother made of the field at the footfalls, as in a stance table, and notes.

    The words are the detector's verdicts; what a footfall's compass counts is its weight.
    """

    words: tuple[str, ...]
    reason: tuple[str, ...]
    notes: tuple[str, ...]
    statistic: Floats
    compass_weight: Floats


@dataclass(frozen=True)
class FieldResiduals:
    """The field along a walk against its mean.

    Verdicts of the gate; sigma of the compass (F,) uT, infinite where it has no reading; roughness; attitudes
    (F, 3, 3); the walk's horizontal field (F, 2).
    """

    verdicts: FieldVerdicts
    sigma_uT: Floats
    rough: FieldRoughness
    nav_R_body: Floats
    reference: Floats

    @property
    def compass_weight(self) -> Floats:
        """(F,) information of the compass over that at the walk's own spread, at most 1; 0 where it is not used."""
        return weigh_compass(self.sigma_uT, self.rough)


def compass_sigma(variance: Floats, rough: FieldRoughness) -> Floats:
    """Sigma (...) uT of compasses, by their variance over that of the walk's (`quasi_static.weigh_statistic`)."""
    return np.asarray(np.hypot(COMPASS_SIGMA_UT, rough.white_uT * np.sqrt(variance)))


def weigh_compass(sigma_uT: Floats, rough: FieldRoughness) -> Floats:
    """Weight of compasses with these sigmas (...): 1 where the field changes as usual, 0 without a reading."""
    return np.asarray(np.minimum((compass_sigma(np.ones(()), rough) / sigma_uT) ** 2, 1.0))


def find_obstacle(field: FootfallField | None, p: FieldParameters) -> str:
    """Say why the field of a walk shows no heading; empty where it does."""
    if field is None:
        return "the magnetometer was not used"
    seen = np.isfinite(field.strength)
    if seen.sum() < MIN_SEEN:
        return f"the field was seen at {seen.sum()} footfalls only"
    level = float(np.median(np.hypot(field.level_field[seen, 0], field.level_field[seen, 1])))
    if level < MIN_STRENGTH_UT:
        return f"the field is {level:.1f} uT over ground, which is too little for a compass"
    return ""


def ignore_field(problem: WalkProblem, reason: str) -> FieldVerdict:
    """Return the verdict on a walk whose field is not used."""
    footfalls = len(problem.nodes.result)
    unjudged, unused = np.full(footfalls, np.nan), np.zeros(footfalls)
    return FieldVerdict((UNKNOWN,) * footfalls, (reason,) * footfalls, (), unjudged, unused)


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
    """Compare the field along the walk with its mean; `states` (F, 9) of the last round, None before the first."""
    nav_R_body = list_attitudes(problem.nodes.result, values)
    nav_field = rotate_field(field, nav_R_body)
    seen = np.isfinite(nav_field[:, 0])
    level = np.hypot(nav_field[:, 0], nav_field[:, 1])
    verdicts = apply_gate(replace(field, nav_R_body=nav_R_body), p.gate)
    if states is None:
        reference = np.tile([0.0, float(np.median(level[seen]))], (len(nav_field), 1))
        deviation = level - np.median(level[seen])
    else:
        reference = states[:, E_H]
        deviation = deviate_along(nav_field, reference)
    weight = weigh_statistic(verdicts, p.gate)
    used = seen & np.isfinite(weight)
    rough = measure_roughness(deviation, used, path.distance_m)
    sigma_uT = np.where(used & p.compass, compass_sigma(np.where(used, weight, 1.0), rough), np.inf)
    return FieldResiduals(verdicts, sigma_uT, rough, nav_R_body, reference)


def add_field_factors(
    problem: WalkProblem,
    field: FootfallField,
    residuals: FieldResiduals,
    path: FieldPath,
    p: FieldParameters,
) -> WalkProblem:
    """Add the factors of the field to a walk, in place of those of the round before."""
    readings = CompassReadings(problem.nodes.result, field.body_field, residuals.nav_R_body, residuals.sigma_uT)
    prior = _expect_field(problem, field, residuals, path)
    return replace(problem, field=FieldFactors(readings, path, prior, residuals.rough, p))


def _expect_field(problem: WalkProblem, field: FootfallField, residuals: FieldResiduals, path: FieldPath) -> FieldPrior:
    """Prior of the first state: the mean field, north by definition where no heading was given, and the iron."""
    strength, rough = float(np.linalg.norm(np.median(residuals.reference, axis=0))), residuals.rough
    east, north, direction_sigma = 0.0, strength, np.radians(DECLINATION_SIGMA_DEG)
    if problem.heading_known:
        mean = np.nanmean(rotate_field(field, residuals.nav_R_body), axis=0)[:2]
        east, north = strength * mean / np.linalg.norm(mean)
        direction_sigma = np.radians(FOUND_SIGMA_DEG)
    left = np.array([LEFT_IRON_LEVEL_UT, LEFT_IRON_LEVEL_UT, LEFT_IRON_UP_UT])
    iron = np.sqrt(path.level_R_body**2 @ field.iron_sigma_uT[0] ** 2 + left**2)
    spreads = rough.potential.sigma, rough.across.sigma, rough.regional.sigma, rough.regional.sigma
    sigma = np.array([*spreads, direction_sigma * strength, STRENGTH_SIGMA_UT, *iron])
    return FieldPrior(np.array([0.0, 0.0, 0.0, 0.0, east, north, 0.0, 0.0, 0.0]), sigma)


def write_notes(residuals: FieldResiduals, states: Floats) -> tuple[str, ...]:
    """Write what was found of the field, with its states (F, 9)."""
    east, north = np.median(states[:, E_H], axis=0)
    forward, left, up = states[-1, IRON]
    rough, used, count = residuals.rough, int(np.isfinite(residuals.sigma_uT).sum()), len(residuals.sigma_uT)
    return (
        f"field over ground {np.hypot(east, north):.1f} uT, {np.degrees(np.arctan2(east, north)):+.1f} deg from north; "
        f"the compass of {used} of {count} footfalls weighs (gate {residuals.verdicts.detector})",
        f"it deviates by {rough.white_uT:.1f} uT from stride to stride, {_write(rough.across, 'uT')}, by region "
        f"{_write(rough.regional, 'uT')}, its potential by {_write(rough.potential, 'uT m')}",
        f"hard iron left in the stance's axes: {forward:.1f}, {left:.1f}, {up:.1f} uT",
    )


def _write(rough: Roughness, unit: str) -> str:
    return f"{rough.sigma:.1f} {unit} over {rough.length_m:.1f} m"
