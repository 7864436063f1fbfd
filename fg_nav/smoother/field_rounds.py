"""The walk with its magnetic field: rounds of looking at the field along the smoothed walk and smoothing it again.

    trajectory         -> line integrals of the field over the strides, which no heading changes
    repeat a few times
        walk           -> factors of the field (`field`)
        walk and field -> solution

Where the heading at the start was given, the field's direction is estimated about it. Where it was not, north is where
the field points: its direction is fixed, the start is free, and the walk is first turned there.

Whether the line integrals are used is decided by the evidence of the walk (`path_noise`); where its potential jumps
the strides are left out (`potential`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import X

from fg_nav.arrays import Floats
from fg_nav.errors import EstimationError
from fg_nav.magnetic import FootfallField
from fg_nav.smoother.field import (
    FieldResiduals,
    FieldVerdict,
    add_field_factors,
    compare_field,
    compass_sigma,
    expect_direction,
    integrate_field,
    rotate_field,
    write_notes,
)
from fg_nav.smoother.field_drift import remove_drift
from fg_nav.smoother.field_factors import FieldFactors, FieldPath
from fg_nav.smoother.gauss_newton import CONVERGENCE, FIRST_CONVERGENCE
from fg_nav.smoother.graph import UNKNOWN_HEADING_DEG, StartPrior, Trajectory, WalkProblem, solve, turn_walk
from fg_nav.smoother.parameters import FieldParameters
from fg_nav.smoother.path_noise import PathNoise, choose_path_noise
from fg_nav.smoother.potential import describe_jumps, free_jumps
from fg_nav.smoother.solver import Solved, list_attitudes
from fg_nav.system.memory import return_freed

COMPASS_ROUNDS = 1
"""More rounds without the line integral: noise and heading are found together."""


@dataclass(frozen=True)
class FieldWalk:
    """A walk before it is solved with its field, turned to it where no heading was given; the integrals along it."""

    problem: WalkProblem
    field: FootfallField
    path: FieldPath


@dataclass(frozen=True)
class FieldSolution:
    """A walk solved with its field: the problem of the last round, its minimum, the states (F, 8), and the verdict.

    `compass_sigma_uT` is the noise of a footfall's compass.
    """

    problem: WalkProblem
    solved: Solved
    states: Floats
    verdict: FieldVerdict
    compass_sigma_uT: float


@dataclass(frozen=True)
class _Round:
    """A walk with factors of its field, the last solution, and what the factors were made of.

    `direction` of the mean field, rad clockwise from north, and its sigma.
    """

    problem: WalkProblem
    solved: Solved
    residuals: FieldResiduals
    direction: tuple[float, float]

    @property
    def field(self) -> FieldFactors:
        """Factors of the field."""
        assert self.problem.field is not None
        return self.problem.field


def look_along(problem: WalkProblem, field: FootfallField, track: Trajectory) -> FieldWalk:
    """Look at the field along a walk, whose values are near its minimum without it; `track` is theirs."""
    path = integrate_field(problem, field, track)
    nav_field = rotate_field(field, list_attitudes(problem.nodes.result, problem.values))
    problem = replace(problem, values=remove_drift(problem.values, problem.nodes, nav_field))
    return FieldWalk(problem if problem.heading_known else _turn_north(problem, field), field, path)


def _turn_north(problem: WalkProblem, field: FootfallField) -> WalkProblem:
    """Turn the walk about up, so that its mean field points north; its start is free."""
    values = gtsam.Values(problem.values)
    mean = np.nanmean(rotate_field(field, list_attitudes(problem.nodes.result, values)), axis=0)
    turn_walk(values, problem.nodes, float(np.arctan2(*mean[:2])))
    start = StartPrior(values.atPose3(X(0)).rotation().matrix(), float(np.radians(UNKNOWN_HEADING_DEG)))
    return replace(problem, values=values, start=start)


def solve_with_field(walk: FieldWalk) -> FieldSolution:
    """Smooth a walk with its field."""
    p, notes = walk.problem.parameters.magnetic, tuple[str, ...]()
    if p.potential:
        found, notes = _try_line_integral(walk, p)
        if found is not None:
            return found
    # A walk that does not show that its line integrals can be used does without them.
    p = replace(p, potential=False, rounds=p.rounds + COMPASS_ROUNDS)
    by_compass = _solve_in_rounds(walk, p, notes)
    assert isinstance(by_compass, FieldSolution)
    return by_compass


def solve_for_north(walk: FieldWalk) -> FieldSolution:
    """Smooth a walk with the mean of its field as one reading of the compass, and nothing else of the field."""
    p = replace(walk.problem.parameters.magnetic, compass=False, potential=False, rounds=1)
    by_mean = _solve_in_rounds(replace(walk, problem=replace(walk.problem, differential=None)), p)
    assert isinstance(by_mean, FieldSolution)
    return by_mean


def _try_line_integral(walk: FieldWalk, p: FieldParameters) -> tuple[FieldSolution | None, tuple[str, ...]]:
    """Smooth a walk with its line integrals; or say why they are not used."""
    try:
        found = _solve_in_rounds(walk, p)
    except EstimationError:
        return None, ("line integral of the field not used: with it there is no solution",)
    if isinstance(found, PathNoise):
        return None, (found.describe(p.potential_drift_m),)
    return found, ()


def _solve_in_rounds(walk: FieldWalk, p: FieldParameters, notes: tuple[str, ...] = ()) -> FieldSolution | PathNoise:
    """Smooth a walk with its field; or return the noise of its line integrals, where it is too large to use them."""
    current = _solve_first(walk, p)
    for _ in range(p.rounds - 1):
        # Noise, verdicts and the sigma of an unknown north are those of the smoothed walk.
        current = _look_again(walk.field, current, p)
        # So is the noise of the line integrals.
        if len(current.field.potential):
            noise = choose_path_noise(current.problem, current.solved.values)
            if noise.drift_m >= p.potential_drift_m:
                return noise
            current, notes = _assume_path_noise(current, noise), (noise.describe(p.potential_drift_m),)
        current = _solve_again(current)
    return _conclude(current, p, notes)


def _solve_first(walk: FieldWalk, p: FieldParameters) -> _Round:
    """Solve with residuals without the heading; it finds the direction in which the field is expected."""
    values = gtsam.Values(walk.problem.values)
    residuals = compare_field(walk.problem, walk.field, values, walk.path, None, p)
    direction = expect_direction(walk.problem, walk.field, residuals, walk.path, p)
    problem = add_field_factors(walk.problem, walk.field, residuals, walk.path, direction, p)
    assert problem.field is not None
    problem.field.insert(values)
    close = CONVERGENCE if p.rounds == 1 else FIRST_CONVERGENCE
    problem, solved = free_jumps(problem, solve(replace(problem, values=values), close), close)
    return _Round(problem, solved, residuals, direction)


def _look_again(field: FootfallField, last: _Round, p: FieldParameters) -> _Round:
    """Make the factors again, of the field along the last solution, whose tree is let go of."""
    problem, values, path = last.problem, last.solved.values, last.field.path
    residuals = compare_field(problem, field, values, path, last.field.states(values), p)
    direction = last.direction
    if not problem.heading_known:
        direction = expect_direction(problem, field, residuals, path, p)
    problem = add_field_factors(problem, field, residuals, path, direction, p)
    return replace(last, problem=problem, solved=last.solved.forget_root(), residuals=residuals, direction=direction)


def _assume_path_noise(current: _Round, noise: PathNoise) -> _Round:
    field = current.field.assume_lost_share(noise.lost_share)
    return replace(current, problem=replace(current.problem, field=field))


def _solve_again(current: _Round) -> _Round:
    """Solve with the factors of a round, from the last solution on."""
    return_freed()
    solved = solve(replace(current.problem, values=current.solved.values))
    problem, solved = free_jumps(current.problem, solved)
    return replace(current, problem=problem, solved=solved)


def _conclude(current: _Round, p: FieldParameters, notes: tuple[str, ...]) -> FieldSolution:
    problem, solved, verdicts = current.problem, current.solved, current.residuals.verdicts
    states = current.field.states(solved.values)
    notes = (*write_notes(current.residuals, states, p.compass), *notes, *describe_jumps(problem, solved))
    verdict = FieldVerdict(verdicts.words, verdicts.reason, notes)
    return FieldSolution(problem, solved, states, verdict, compass_sigma(current.residuals, p))
