"""The walk with its magnetic field: rounds of looking at the field along the smoothed walk and smoothing anew.

    trajectory         -> line integrals of the field over the strides, which no heading changes
    repeat a few times
        attitudes      -> field at each footfall, in nav
        its deviations -> roughness of the field, and which footfalls are disturbed
        walk and field -> solution

The first trajectory is that of the walk without the field. Its heading has drifted, so the first verdicts rest on
strength and inclination alone, and strength stands in for the deviation across; from the second round on the smoothed
heading is used as well, but never alone, so that it cannot talk itself into a wrong field.

Where the heading at the start was told, the field's direction is found. Where nobody told it, north is where the field
points, and the walk is turned there first. A long walk's line integrals then show which field is the building's: its
direction is held, and the start is free. A short walk has nothing to tell a region's field from the building's, and
what is believed of regions bends it or leaves no north. So it is smoothed as if its start had been told, with the
field's direction free, and turned as one piece until its mean field points north. How far a mean can be off there,

    variance = sum over (footfalls, regions) of sigma^2 min(1, 2 length / way),

goes into the sigmas of all its poses.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import X

from fg_nav.arrays import Bools, Floats
from fg_nav.frames import yaw_rotation
from fg_nav.magnetic import FootfallField
from fg_nav.magnetic.quasi_static import DISTURBED, NO_FIELD, QUASI_STATIC, UNKNOWN, judge_field
from fg_nav.recording import Recording
from fg_nav.smoother.dense import trajectory_of
from fg_nav.smoother.field_noise import FieldRoughness, Roughness, regional, robust_sigma, roughness
from fg_nav.smoother.field_parameters import FieldParameters
from fg_nav.smoother.field_state import (
    E_H,
    IRON,
    PHI,
    FieldPrior,
    FieldSeen,
    FieldTies,
    across_field,
)
from fg_nav.smoother.field_way import FieldWay, field_way
from fg_nav.smoother.initial import turn_walk
from fg_nav.smoother.nodes import Nodes
from fg_nav.smoother.solver import Part, Solved, time_order

LEAST_SIGMA_UT = 0.2
"""Spread of the field below which a walk's differences are the magnetometer's."""

LEAST_REGIONAL_UT = 0.01
"""Of a region: keeps the equations well conditioned where the field is the same everywhere."""

POTENTIAL_PER_FIELD_M = 1.5
"""Potential over field before it is measured: the reach of the steel of a building."""


LEAST_POTENTIAL_PER_FIELD_M = 1.0
"""And at least: a smoothed heading takes some of the potential for its own."""


@dataclass(frozen=True)
class FieldProblem:
    """What a walk with its field is solved from.

    Attributes
    ----------
    recording, nodes, gravity : of the walk.
    field : at its footfalls.
    heading_known : whether the heading at the start was told.
    minimise : solves the walk with another part, from these values; begun as it was told, or where there is one at
        another heading.
    """

    recording: Recording
    nodes: Nodes
    field: FootfallField
    heading_known: bool
    gravity: float
    minimise: Callable[[Part, gtsam.Values, gtsam.Ordering, Begun | None], Solved]


@dataclass(frozen=True)
class Begun:
    """Attitude (3, 3) at the start, and whether its heading is free to be found or so by definition."""

    nav_R_body: Floats
    free: bool


@dataclass(frozen=True)
class FieldVerdict:
    """What the smoother made of the field at the footfalls: `words` and `reason` as in a stance table, and notes.

    `north_sigma` rad, by how much the whole walk may be turned beyond what its marginals say.
    """

    words: tuple[str, ...]
    reason: tuple[str, ...]
    notes: tuple[str, ...]
    north_sigma: float = 0.0


@dataclass(frozen=True)
class _Look:
    """What a round sees.

    Attitudes (F, 3, 3); the way; deviations (F, 3) of the field across, along and up, uT, NaN where it was not seen;
    the largest of them over its threshold (F,); roughness; and the horizontal field (F, 2) they are taken from.
    """

    nav_R_body: Floats
    way: FieldWay
    deviation: Floats
    statistic: Floats
    rough: FieldRoughness
    reference: Floats


def unusable(field: FootfallField | None, p: FieldParameters) -> str:
    """Why the field of a walk tells no heading; empty where it does."""
    if field is None:
        return "the magnetometer was not used"
    seen = np.isfinite(field.strength)
    if seen.sum() < FEWEST:
        return f"the field was seen at {seen.sum()} footfalls only"
    level = float(np.median(np.hypot(field.level_field[seen, 0], field.level_field[seen, 1])))
    if level < p.least_strength_uT:
        return f"the field is {level:.1f} uT over ground, which is too little for a compass"
    return ""


FEWEST = 4
"""Footfalls with a field without which it is not used."""


def solve_with_field(problem: FieldProblem, solved: Solved, p: FieldParameters) -> tuple[Solved, FieldVerdict]:
    """Smooth a walk that was solved without its field together with it."""
    p = _for_this_way(problem, solved.values, p)
    values, start = _towards_north(problem, solved.values, p)
    ordering = time_order(problem.nodes, with_field=True)
    way = _way(problem, values, p)
    look = _look(problem, values, way, None, p)
    towards = _expected_direction(problem, look, p)
    ties = _ties(problem, look, towards, p)
    ties.insert(values)
    solved = problem.minimise(ties, values, ordering, start)
    for _ in range(p.rounds - 1):
        look = _look(problem, solved.values, way, _states(problem, solved.values, ties, look, p), p)
        ties = _ties(problem, look, towards, p)
        solved = problem.minimise(ties, solved.values, ordering, start)
    if _north_is_open(problem, p):
        _turn_to(problem, solved.values, _mean_field(problem, solved.values, ties.states(solved.values), look))
    north_sigma = _mean_field_sigma(look, p) if _north_is_open(problem, p) else 0.0
    return solved, _verdict(look, _states(problem, solved.values, ties, look, p), north_sigma)


def _north_is_open(problem: FieldProblem, p: FieldParameters) -> bool:
    """Whether only the walk's mean field tells north."""
    return not problem.heading_known and not p.potential


def _states(problem: FieldProblem, values: gtsam.Values, ties: FieldTies, look: _Look, p: FieldParameters) -> Floats:
    """(F, 8); with the mean field for the building's where regions as wide as assumed leave that open."""
    states = ties.states(values)
    if _north_is_open(problem, p):
        states[:, E_H] = _mean_field(problem, values, states, look)[:2]
    return states


def _for_this_way(problem: FieldProblem, values: gtsam.Values, p: FieldParameters) -> FieldParameters:
    """Leave the line integral out on a short walk."""
    place = np.array([values.atPose3(X(int(j))).translation() for j in problem.nodes.result])
    way_m = float(np.linalg.norm(np.diff(place, axis=0), axis=1).sum())
    return p if way_m >= p.potential_least_way_m else replace(p, potential=False)


def _ties(problem: FieldProblem, look: _Look, towards: tuple[float, float], p: FieldParameters) -> FieldTies:
    return FieldTies(_seen(problem, look, p), look.way, _prior(look, towards, p), look.rough, p)


def _towards_north(
    problem: FieldProblem, values: gtsam.Values, p: FieldParameters
) -> tuple[gtsam.Values, Begun | None]:
    """Turn the walk so that its mean field points north, unless its heading was told."""
    values = gtsam.Values(values)
    if problem.heading_known:
        return values, None
    _turn_to(problem, values, np.nanmean(_nav_field(problem, _attitudes(problem, values)), axis=0))
    start = values.atPose3(X(0)).rotation().matrix()
    return values, Begun(start, free=p.potential)


def _mean_field(problem: FieldProblem, values: gtsam.Values, states: Floats, look: _Look) -> Floats:
    """(3,) in nav, uT, over the footfalls that are not disturbed, without the hard iron that was found."""
    nav_R_body = _attitudes(problem, values)
    iron = np.einsum("kij,kj->ki", nav_R_body, states[:, IRON] @ look.way.level_R_body)
    field = _nav_field(problem, nav_R_body) - iron
    undisturbed = look.statistic < 1.0
    return np.asarray(np.nanmean(field[undisturbed] if undisturbed.any() else field, axis=0))


def _turn_to(problem: FieldProblem, values: gtsam.Values, nav_north: Floats) -> None:
    """Turn the walk about up, in place, so that what points along `nav_north` (3,) points north."""
    east, north, _ = nav_north
    turn_walk(values, problem.nodes, yaw_rotation(float(np.arctan2(east, north))))


def _mean_field_sigma(look: _Look, p: FieldParameters) -> float:
    """How far the direction of a walk's mean field is from north, rad."""
    own = look.rough.across
    region = Roughness(p.regional_share_of_mean * own.sigma, p.regional_length_m)
    way_m = max(float(look.way.distance_m.sum()), LEAST_WAY_M)
    variance = sum(one.sigma**2 * min(1.0, 2.0 * one.length_m / way_m) for one in (own, region))
    return float(np.sqrt(variance) / np.linalg.norm(np.median(look.reference, axis=0)))


LEAST_WAY_M = 0.1
"""Of one who stands all the time."""


def _attitudes(problem: FieldProblem, values: gtsam.Values) -> Floats:
    return np.array([values.atPose3(X(int(j))).rotation().matrix() for j in problem.nodes.result])


def _nav_field(problem: FieldProblem, nav_R_body: Floats) -> Floats:
    return np.asarray(np.einsum("kij,kj->ki", nav_R_body, problem.field.body_field))


def _look(
    problem: FieldProblem, values: gtsam.Values, way: FieldWay, states: Floats | None, p: FieldParameters
) -> _Look:
    """Look at the field along the walk; `states` (F, 8) of the last round, None before the first."""
    nav_R_body = _attitudes(problem, values)
    field = _nav_field(problem, nav_R_body)
    seen = np.isfinite(field[:, 0])
    level = np.hypot(field[:, 0], field[:, 1])
    if states is None:
        reference = np.tile([0.0, float(np.median(level[seen]))], (len(field), 1))
        deviation = np.stack([level, level, field[:, 2]], axis=1)
    else:
        reference = states[:, E_H]
        along = (field[:, :2] * reference).sum(axis=1) / np.linalg.norm(reference, axis=1)
        deviation = np.stack([across_field(field, reference), along, field[:, 2]], axis=1)
    centre = np.nanmedian(deviation, axis=0)
    if states is not None:
        centre[0] = 0.0
    deviation = deviation - centre
    statistic = _over_threshold(deviation[:, 0 if states is not None else 1 :], seen, p)
    rough = roughness_of(deviation, states, seen, way, p)
    return _Look(nav_R_body, way, deviation, statistic, rough, reference)


def roughness_of(
    deviation: Floats, states: Floats | None, seen: Bools, way: FieldWay, p: FieldParameters
) -> FieldRoughness:
    """Of deviations (F, 3) across, along and up, and of the potential where it is known from a round before."""
    deviation = np.nan_to_num(deviation)
    across = roughness(deviation[:, 0], seen, way.distance_m, LEAST_SIGMA_UT)
    # Along and up no heading can hide: they stand for the deviation across as well.
    steady = deviation[:, 1:]
    own = np.array([max(robust_sigma(column[seen]), LEAST_SIGMA_UT) for column in steady.T])
    beyond_sensor = np.sqrt(max(across.sigma**2 - LEAST_SIGMA_UT**2, LEAST_REGIONAL_UT**2))
    assumed = Roughness(p.regional_share * float(beyond_sensor), p.regional_length_m)
    region = regional(steady, own, seen, way.distance_m, assumed, across.length_m, p.regional_weight)
    return FieldRoughness(_potential(states, across, way), across, region)


def _way(problem: FieldProblem, values: gtsam.Values, p: FieldParameters) -> FieldWay:
    recording, nodes = problem.recording, problem.nodes
    assert recording.mag is not None
    track = trajectory_of(recording, nodes, values, problem.gravity)
    up_uT = float(np.nanmedian(_nav_field(problem, _attitudes(problem, values))[:, 2]))
    footfall = nodes.sample[nodes.result]
    return field_way(recording.t, recording.mag, track.position, track.nav_R_body, footfall, up_uT, p)


def _potential(states: Floats | None, across: Roughness, way: FieldWay) -> Roughness:
    if states is None:
        return Roughness(POTENTIAL_PER_FIELD_M * across.sigma, POTENTIAL_PER_FIELD_M)
    phi = states[:, PHI]
    found = roughness(phi - np.median(phi), np.ones(len(phi), dtype=bool), way.distance_m, LEAST_SIGMA_UT)
    return replace(found, sigma=max(found.sigma, LEAST_POTENTIAL_PER_FIELD_M * across.sigma))


def _over_threshold(deviation: Floats, seen: Bools, p: FieldParameters) -> Floats:
    """(F,) the largest component of the deviations (F, c) over what the walk's own spread allows."""
    spread = np.array([max(robust_sigma(column[seen]), LEAST_SIGMA_UT) for column in deviation.T])
    return np.asarray(np.abs(deviation / (p.outlier_sigmas * spread)).max(axis=1))


def _seen(problem: FieldProblem, look: _Look, p: FieldParameters) -> FieldSeen:
    usable = np.isfinite(look.statistic)
    disturbed = usable & (look.statistic >= 1.0)
    sigma = np.where(usable & ~disturbed, p.compass_sigma_uT, np.inf)
    if p.gate is not None:
        passed = judge_field(replace(problem.field, nav_R_body=look.nav_R_body), p.gate).quasi_static
        sigma = np.where(passed, sigma, p.outside_gate * sigma)
    body_field = np.where(usable[:, None], problem.field.body_field, 0.0)
    return FieldSeen(problem.nodes.result, body_field, sigma, disturbed)


def _expected_direction(problem: FieldProblem, look: _Look, p: FieldParameters) -> tuple[float, float]:
    """Direction of the mean field, rad clockwise from north, and its sigma.

    A told heading is taken to be from magnetic north, unless the first footfalls have the field where neither that nor
    its own deviations let it be: zero is told as well by those who know no heading.
    """
    if not problem.heading_known:
        return 0.0, np.radians(DECLINATION_SIGMA_DEG if p.potential else FOUND_SIGMA_DEG)
    first = _nav_field(problem, look.nav_R_body)[look.statistic < 1.0][:FIRST_FOOTFALLS]
    east, north, _ = first.mean(axis=0) if len(first) else (0.0, 1.0, 0.0)
    strength = np.linalg.norm(np.median(look.reference, axis=0))
    deviations = np.hypot(look.rough.across.sigma, look.rough.regional.sigma) / strength
    told, found = np.radians(p.reference_sigma_deg), float(np.arctan2(east, north))
    if abs(found) <= CONTRADICTED_SIGMAS * np.hypot(told, deviations):
        return 0.0, told
    return found, np.radians(FOUND_SIGMA_DEG)


FIRST_FOOTFALLS = 10
"""At which the heading is still the one that was told."""

CONTRADICTED_SIGMAS = 3.0
"""By how much the field there has to be off for the heading not to be from magnetic north."""

FOUND_SIGMA_DEG = 60.0
"""Sigma of the field's direction where only the field tells it."""


def _prior(look: _Look, towards: tuple[float, float], p: FieldParameters) -> FieldPrior:
    strength = float(np.linalg.norm(np.median(look.reference, axis=0)))
    azimuth, direction_sigma = towards
    east, north = strength * np.sin(azimuth), strength * np.cos(azimuth)
    sigma = np.array(
        [
            look.rough.potential.sigma,
            look.rough.across.sigma,
            look.rough.regional.sigma,
            direction_sigma * strength,
            p.strength_sigma_uT,
            p.hard_iron_level_uT,
            p.hard_iron_level_uT,
            p.hard_iron_up_uT,
        ]
    )
    return FieldPrior(np.array([0.0, 0.0, 0.0, east, north, 0.0, 0.0, 0.0]), sigma)


DECLINATION_SIGMA_DEG = 0.05
"""Where nobody told the heading, north is magnetic north by definition."""


def _verdict(look: _Look, states: Floats, north_sigma: float = 0.0) -> FieldVerdict:
    known, passed = np.isfinite(look.statistic), look.statistic < 1.0
    words = np.where(known, np.where(passed, QUASI_STATIC, DISTURBED), UNKNOWN)
    reasons = (reason_of(deviation, s) for deviation, s in zip(look.deviation, look.statistic, strict=True))
    return FieldVerdict(
        tuple(str(word) for word in words), tuple(reasons), _notes(look, states, passed.mean()), north_sigma
    )


def reason_of(deviation: Floats, statistic: float) -> str:
    """Say in words how far the field of a footfall is off: deviation (3,) across, along and up, uT."""
    if not np.isfinite(statistic):
        return NO_FIELD
    across, along, up = deviation
    return (
        f"{across:+.1f} uT across the mean field, {along:+.1f} along, {up:+.1f} up; {statistic:.2g} times the threshold"
    )


def _notes(look: _Look, states: Floats, used: float) -> tuple[str, ...]:
    east, north = np.median(states[:, E_H], axis=0)
    forward, left, up = states[-1, IRON]
    return (
        f"field over ground {np.hypot(east, north):.1f} uT, {np.degrees(np.arctan2(east, north)):+.1f} deg from north; "
        f"{100 * used:.0f} % of the footfalls are used",
        f"it deviates by {_in_words(look.rough.across, 'uT')}, by region {_in_words(look.rough.regional, 'uT')}, "
        f"its potential by {_in_words(look.rough.potential, 'uT m')}",
        f"hard iron left in the stance's axes: {forward:.1f}, {left:.1f}, {up:.1f} uT",
    )


def _in_words(rough: Roughness, unit: str) -> str:
    return f"{rough.sigma:.1f} {unit} over {rough.length_m:.1f} m"
