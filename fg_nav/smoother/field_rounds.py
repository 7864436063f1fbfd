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
from fg_nav.magnetic import FootfallField
from fg_nav.smoother.field import (
    FieldResiduals,
    FieldVerdict,
    add_field_factors,
    compare_field,
    integrate_field,
    rotate_field,
    write_notes,
)
from fg_nav.smoother.field_drift import remove_drift
from fg_nav.smoother.field_factors import FieldFactors, FieldPath
from fg_nav.smoother.gauss_newton import CONVERGENCE, FIRST_CONVERGENCE
from fg_nav.smoother.graph import UNKNOWN_HEADING_DEG, StartPrior, Trajectory, WalkProblem, solve, turn_walk
from fg_nav.smoother.parameters import FieldParameters
from fg_nav.smoother.path_noise import PathNoise, average_path_noise
from fg_nav.smoother.potential import describe_jumps, free_jumps
from fg_nav.smoother.solver import Solved, list_attitudes
from fg_nav.system.memory import return_freed


@dataclass(frozen=True)
class FieldWalk:
    """A walk before it is solved with its field, turned to it where no heading was given; the integrals along it."""

    problem: WalkProblem
    field: FootfallField
    path: FieldPath


@dataclass(frozen=True)
class FieldSolution:
    """A walk solved with its field: the problem of the last round, its minimum, the states (F, 9), and the verdict."""

    problem: WalkProblem
    solved: Solved
    states: Floats
    verdict: FieldVerdict


@dataclass(frozen=True)
class _Round:
    """A walk with factors of its field, the last solution, and what the factors were made of."""

    problem: WalkProblem
    solved: Solved
    residuals: FieldResiduals

    @property
    def field(self) -> FieldFactors:
        """Factors of the field."""
        assert self.problem.field is not None
        return self.problem.field


def sample_field(problem: WalkProblem, field: FootfallField, track: Trajectory) -> FieldWalk:
    """Look at the field along a walk, whose values are near its minimum without it; `track` is theirs."""
    path = integrate_field(problem, field, track)
    nav_field = rotate_field(field, list_attitudes(problem.nodes.result, problem.values))
    problem = replace(problem, values=remove_drift(problem.values, problem.nodes, nav_field, field.t))
    return FieldWalk(problem if problem.heading_known else _turn_north(problem, field), field, path)


def _turn_north(problem: WalkProblem, field: FootfallField) -> WalkProblem:
    """Turn the walk about up, so that its mean field points north; its start is free."""
    values = gtsam.Values(problem.values)
    mean = np.nanmean(rotate_field(field, list_attitudes(problem.nodes.result, values)), axis=0)
    turn_walk(values, problem.nodes, float(np.arctan2(*mean[:2])))
    start = StartPrior(values.atPose3(X(0)).rotation().matrix(), float(np.radians(UNKNOWN_HEADING_DEG)))
    return replace(problem, values=values, start=start)


def solve_with_field(walk: FieldWalk) -> FieldSolution:
    """Smooth a walk with its field, in rounds."""
    p, notes = walk.problem.parameters.magnetic, tuple[str, ...]()
    current = _solve_first(walk, p)
    for _ in range(p.rounds - 1):
        # Spread and weights of the compass are those of the smoothed walk.
        current = _look_again(walk.field, current, p)
        # So is the noise of the line integrals.
        if len(current.field.potential):
            noise = average_path_noise(current.problem, current.solved.values)
            current, notes = _assume_path_noise(current, noise), (noise.describe(),)
        current = _solve_again(current)
    return _conclude(current, notes)


def _solve_first(walk: FieldWalk, p: FieldParameters) -> _Round:
    """Solve with residuals without the heading; it finds the direction in which the field is expected."""
    values = gtsam.Values(walk.problem.values)
    residuals = compare_field(walk.problem, walk.field, values, walk.path, None, p)
    problem = add_field_factors(walk.problem, walk.field, residuals, walk.path, p)
    assert problem.field is not None
    problem.field.insert(values)
    close = CONVERGENCE if p.rounds == 1 else FIRST_CONVERGENCE
    problem, solved = free_jumps(problem, solve(replace(problem, values=values), close), close)
    return _Round(problem, solved, residuals)


def _look_again(field: FootfallField, last: _Round, p: FieldParameters) -> _Round:
    """Make the factors again, of the field along the last solution, whose tree is let go of."""
    problem, values, path = last.problem, last.solved.values, last.field.path
    residuals = compare_field(problem, field, values, path, last.field.states(values), p)
    problem = add_field_factors(problem, field, residuals, path, p)
    return replace(last, problem=problem, solved=last.solved.forget_root(), residuals=residuals)


def _assume_path_noise(current: _Round, noise: PathNoise) -> _Round:
    field = current.field.assume_lost_share(noise.lost_share)
    return replace(current, problem=replace(current.problem, field=field))


def _solve_again(current: _Round) -> _Round:
    """Solve with the factors of a round, from the last solution on."""
    return_freed()
    solved = solve(replace(current.problem, values=current.solved.values))
    problem, solved = free_jumps(current.problem, solved)
    return replace(current, problem=problem, solved=solved)


def _conclude(current: _Round, notes: tuple[str, ...]) -> FieldSolution:
    problem, solved, verdicts = current.problem, current.solved, current.residuals.verdicts
    states = current.field.states(solved.values)
    notes = (*write_notes(current.residuals, states), *notes, *describe_jumps(problem, solved))
    weight = current.residuals.compass_weight
    verdict = FieldVerdict(verdicts.words, verdicts.reason, notes, verdicts.statistic, weight)
    return FieldSolution(problem, solved, states, verdict)
