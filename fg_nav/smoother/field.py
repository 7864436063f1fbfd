"""The magnetic field along a smoothed walk: factors of it, and rounds of making them and smoothing again.

    drift              -> values to start from, with a heading that drifted far bent back
    trajectory         -> line integrals of the field over the strides, which no heading changes
    repeat a few times
        attitudes      -> field at each footfall, in nav
        gate           -> how much more or less than the walk's spread a footfall's compass may deviate
        deviations     -> roughness of the field
        all of these   -> readings of the compass, prior of the field's state, direction in which it is expected
        walk and field -> solution

Every footfall with a reading has its compass. The gate (`FieldParameters.gate`) is a detector of `magnetic.detectors`,
judged with the attitudes of the round: with T_k its statistic, of n squares, and the walk's white spread of the field

    sigma_k^2 = noise^2 + white^2 (2 + n T_k / median T) / (2 + n)         (`magnetic.quasi_static.weigh_statistic`)

What deviates alike for metres and in whole regions are states (`field_factors`). The iron of the magnetometer has the
prior of its calibration. Strides where the potential jumps are left out (`potential`). Where a heading is given, the
direction of the field is free about it; where not, the walk is first turned to the field, and its start is free.

Drift. The residual of a compass has a second zero half a turn away, so a heading that drifted far is bent back to start
from; the minimum stays where it is. With z_k the field over ground at footfall k as the drifting heading has it, a
complex number, and t_k the time,

    rate     r = argmax  |sum z_k exp(-i r t_k)| / mean |z| - r^2 / (2 sigma_r^2)        a constant bias
    drift_k  = r t_k + angle of the mean of z exp(-i r t) over `WINDOW` footfalls about k, less that of the first

each node is turned by minus what the drift is there, and so is each move from node to node.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import X

from fg_nav.arrays import Floats
from fg_nav.factors.magnetic_field import E_H, IRON, FieldPrior
from fg_nav.magnetic import FootfallField
from fg_nav.magnetic.quasi_static import FieldVerdicts, apply_gate, weigh_statistic
from fg_nav.smoother.dense_path import Trajectory
from fg_nav.smoother.field_factors import (
    CompassReadings,
    FieldFactors,
    FieldPath,
    FieldRoughness,
    Roughness,
    deviate_along,
    integrate_path,
    measure_roughness,
)
from fg_nav.smoother.gauss_newton import CONVERGENCE, FIRST_CONVERGENCE
from fg_nav.smoother.graph import UNKNOWN_HEADING_DEG, StartPrior, WalkProblem, solve, turn_walk
from fg_nav.smoother.parameters import FieldParameters
from fg_nav.smoother.potential import average_path_noise, describe_jumps, free_jumps
from fg_nav.smoother.solver import Solved, list_attitudes
from fg_nav.smoother.strides import Nodes

COMPASS_SIGMA_UT = 0.3  # Noise of a footfall's mean field, white: what levelling and a soft sole leave.
STRENGTH_SIGMA_UT = 5.0  # Horizontal strength of the field about the walk's median, uT.
LEFT_IRON_LEVEL_UT = 0.3  # Hard iron that a calibration leaves, one sigma, level axes.
LEFT_IRON_UP_UT = 4.0  # Upward: all that adds up along the path alike, soft iron, delay, tilt; by 21 closed walks.
MIN_STRENGTH_UT = 3.0  # Horizontal strength below which there is no compass.
MIN_SEEN = 4  # Footfalls with a field without which it is not used.
FOUND_SIGMA_DEG = 60.0  # Sigma of the field's direction where only the field shows it.
DECLINATION_SIGMA_DEG = 0.05  # Where the heading was not given, north is magnetic north by definition.
MIN_WINDOW, MAX_WINDOW = 40, 1024  # Footfalls: 40 on a rough floor show a heading to 10 deg, a kilometre to 1 deg.
PIECES = 6  # Windows of a walk, within these bounds.
RATE_SIGMA_RAD_S = float(np.radians(0.3))  # Of the drift before the field has shown it: an uncalibrated bias.
MAX_RATES = 4096  # That are tried at most, half a radian apart at the end of the walk where there are enough.
MIN_DRIFT_RAD = 0.3  # Below it the solver needs no help.


@dataclass(frozen=True)
class FieldVerdict:
    """Verdicts on the field at the footfalls, as in a stance table, and notes.

    The words are the detector's; what a footfall's compass counts is its weight.
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


@dataclass(frozen=True)
class FieldSolution:
    """A walk solved with its field: the problem of the last round, its minimum, the states (F, 9), and the verdict."""

    problem: WalkProblem
    solved: Solved
    states: Floats
    verdict: FieldVerdict


def turn_to_field(problem: WalkProblem, field: FootfallField) -> WalkProblem:
    """Return the walk with a heading that drifted far bent back, and an unknown heading set by the field."""
    nav_R_body = list_attitudes(problem.nodes.result, problem.values)
    values = remove_drift(problem.values, problem.nodes, rotate_field(field, nav_R_body), field.t)
    problem = replace(problem, values=values)
    if problem.heading_known:
        return problem
    # Turned about up, so that its mean field points north; its start is free.
    values = gtsam.Values(values)
    mean = np.nanmean(rotate_field(field, list_attitudes(problem.nodes.result, values)), axis=0)
    turn_walk(values, problem.nodes, float(np.arctan2(*mean[:2])))
    start = StartPrior(values.atPose3(X(0)).rotation().matrix(), float(np.radians(UNKNOWN_HEADING_DEG)))
    return replace(problem, values=values, start=start)


def solve_with_field(problem: WalkProblem, field: FootfallField, path: FieldPath) -> FieldSolution:
    """Smooth a walk with its field, in rounds: compass sigmas, verdicts and roughness from the walk of the last.

    `path` is the field along the trajectory of the problem's values.
    """
    p, noise_notes = problem.parameters.magnetic, tuple[str, ...]()
    problem = turn_to_field(problem, field)
    # The first round, without the heading: it finds the direction in which the field is expected.
    residuals = compare_field(problem, field, problem.values, path, None, p)
    problem = add_field_factors(problem, field, residuals, path, p)
    values = gtsam.Values(problem.values)
    problem.field_factors.insert(values)
    problem = replace(problem, values=values)
    close = CONVERGENCE if p.rounds == 1 else FIRST_CONVERGENCE
    problem, solved = free_jumps(problem, solve(problem, close), close)
    for _ in range(p.rounds - 1):
        # Spread and weights of the compass by the smoothed walk.
        factors = problem.field_factors
        residuals = compare_field(problem, field, solved.values, factors.path, factors.states(solved.values), p)
        problem = add_field_factors(problem, field, residuals, factors.path, p)
        # The noise of the line integrals by its evidence.
        factors = problem.field_factors
        if len(factors.potential):
            noise = average_path_noise(problem, solved.values)
            problem, noise_notes = replace(problem, field=factors.assume_lost_share(noise.lost_share)), (noise.note,)
        # And solved again.
        problem = replace(problem, values=solved.values)
        del solved  # its triangle is as large as all else
        problem, solved = free_jumps(problem, solve(problem))
    states, verdicts = problem.field_factors.states(solved.values), residuals.verdicts
    # Notes.
    east, north = np.median(states[:, E_H], axis=0)
    forward, left, up = states[-1, IRON]
    rough, used, count = residuals.rough, int(np.isfinite(residuals.sigma_uT).sum()), len(residuals.sigma_uT)
    notes = (
        f"field over ground {np.hypot(east, north):.1f} uT, {np.degrees(np.arctan2(east, north)):+.1f} deg from north; "
        f"the compass of {used} of {count} footfalls weighs (gate {residuals.verdicts.detector})",
        f"it deviates by {rough.white_uT:.1f} uT from stride to stride, {_write(rough.across, 'uT')}, by region "
        f"{_write(rough.regional, 'uT')}, its potential by {_write(rough.potential, 'uT m')}",
        f"hard iron left in the stance's axes: {forward:.1f}, {left:.1f}, {up:.1f} uT",
        *noise_notes,
        *describe_jumps(problem, solved),
    )
    weight = weigh_compass(residuals.sigma_uT, rough)
    verdict = FieldVerdict(verdicts.words, verdicts.reason, notes, verdicts.statistic, weight)
    return FieldSolution(problem, solved, states, verdict)


def measure_drift(nav_field: Floats, t: Floats) -> Floats:
    """Return the heading drift (F,) rad, counter-clockwise, from the nav-frame field (F, 3) uT; NaN rows are skipped.

    `t` (F,) s of the footfalls. Zero where there are fewer than two windows.
    """
    window = int(np.clip(len(nav_field) // PIECES, MIN_WINDOW, MAX_WINDOW))
    if len(nav_field) < 2 * window:
        return np.zeros(len(nav_field))
    level, since = np.nan_to_num(nav_field[:, 0] + 1j * nav_field[:, 1]), t - t[0]
    # Drift rate of a constant bias: the peak of the spectrum of the level field, with its prior.
    spread = np.abs(level).mean()
    count = min(MAX_RATES, 3 + 2 * int(8.0 * RATE_SIGMA_RAD_S * since[-1]))
    rates = np.linspace(-4.0, 4.0, count) * RATE_SIGMA_RAD_S
    shown = np.array([np.abs((level * np.exp(-1j * rate * since)).sum()) for rate in rates]) / spread
    rate = rates[np.argmax(shown - 0.5 * (rates / RATE_SIGMA_RAD_S) ** 2)]
    # Remaining drift, by the mean field direction in moving windows.
    total = np.append(0.0, np.cumsum(level * np.exp(-1j * rate * since)))
    middle = np.arange(window // 2, len(level) - window // 2 + 1)
    angle = np.unwrap(np.angle(total[middle + window // 2] - total[middle - window // 2]))
    return np.asarray(rate * since + np.interp(np.arange(len(level)), middle, angle - angle[0]))


def remove_drift(values: gtsam.Values, nodes: Nodes, nav_field: Floats, t: Floats) -> gtsam.Values:
    """Return the values of a walk with its heading bent back where it has drifted far, else as they are."""
    drift = measure_drift(nav_field, t)
    if np.ptp(drift) < MIN_DRIFT_RAD:
        return values
    bent = gtsam.Values(values)
    turn_walk(bent, nodes, -np.interp(np.arange(len(nodes)), nodes.result, drift))
    return bent


def compass_sigma(variance: Floats, rough: FieldRoughness) -> Floats:
    """Sigma (...) uT of compasses, by their variance over that of the walk's (`quasi_static.weigh_statistic`)."""
    return np.asarray(np.hypot(COMPASS_SIGMA_UT, rough.white_uT * np.sqrt(variance)))


def weigh_compass(sigma_uT: Floats, rough: FieldRoughness) -> Floats:
    """Information of compasses with these sigmas (...) over that at the walk's own spread, at most 1; 0 without one."""
    return np.asarray(np.minimum((compass_sigma(np.ones(()), rough) / sigma_uT) ** 2, 1.0))


def find_obstacle(field: FootfallField | None) -> str:
    """Return why the field of a walk shows no heading; empty where it does."""
    if field is None:
        return "the magnetometer was not used"
    seen = np.isfinite(field.strength)
    if seen.sum() < MIN_SEEN:
        return f"the field was seen at {seen.sum()} footfalls only"
    level = float(np.median(np.hypot(field.level_field[seen, 0], field.level_field[seen, 1])))
    if level < MIN_STRENGTH_UT:
        return f"the field is {level:.1f} uT over ground, which is too little for a compass"
    return ""


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
    """Return gate verdicts, sigmas (uT), roughness and reference field; `states` (F, 9) of the last round."""
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
    problem: WalkProblem, field: FootfallField, residuals: FieldResiduals, path: FieldPath, p: FieldParameters
) -> WalkProblem:
    """Add the factors of the field to a walk, in place of those of the round before."""
    readings = CompassReadings(problem.nodes.result, field.body_field, residuals.nav_R_body, residuals.sigma_uT)
    # Prior of the first state: the mean field, north by definition where no heading was given, and the iron.
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
    prior = FieldPrior(np.array([0.0, 0.0, 0.0, 0.0, east, north, 0.0, 0.0, 0.0]), sigma)
    return replace(problem, field=FieldFactors(readings, path, prior, residuals.rough, p))


def _write(rough: Roughness, unit: str) -> str:
    return f"{rough.sigma:.1f} {unit} over {rough.length_m:.1f} m"
