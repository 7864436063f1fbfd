"""A walk solved from its samples, with what it shows of its sensor: problem, first solution, all evidence, and again.

The steps are those of `batch`, up to the solution; a foot of two is solved by the same (`feet_batch`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.magnetic import FootfallField
from fg_nav.recording import Recording
from fg_nav.smoother.barometer import spread_scale
from fg_nav.smoother.bias_prior import average_bias_prior
from fg_nav.smoother.constraints import add_constraints, add_fixes, add_own, check_fix_distance
from fg_nav.smoother.gauss_newton import FIRST_CONVERGENCE
from fg_nav.smoother.graph import WalkProblem, solve
from fg_nav.smoother.gyro_scale import WalkScale, estimate_gyro_scale, shows_heading, spread_clipped_peaks
from fg_nav.smoother.known_places import KnownTies, add_known_places
from fg_nav.smoother.moving_foot import spread_moving_foot
from fg_nav.smoother.own_factors import ExtraFactors
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.smoother.problem import walk_problem
from fg_nav.smoother.solved_walk import SolvedWalk, solve_walk
from fg_nav.smoother.solver import Solved
from fg_nav.stances import Stances
from fg_nav.truth import Fix


@dataclass(frozen=True)
class FittedWalk:
    """A walk solved with the bias prior and the gyroscope's scale that it shows.

    `scale` is what is left of the scale, in the triangle of the solution; None where nothing shows it.
    """

    walk: SolvedWalk
    scale: WalkScale | None

    def shared_sqrt_covariance(self) -> Floats:
        """Return by how much the walk moves (N, n) by numbers of unit covariance that all of it shares."""
        walk = self.walk
        others = [spread_clipped_peaks(walk.problem, walk.solved)]
        if walk.problem.parameters.moving_foot:
            others.append(spread_moving_foot(walk.problem, walk.solved))
        if walk.problem.barometer is not None:
            others.append(spread_scale(walk.problem.barometer, walk.solved))
        of_scale = np.zeros((walk.solved.root.total, 0)) if self.scale is None else self.scale.spread()
        return np.hstack([of_scale, *others])

    def take_solution(self, problem: WalkProblem, solved: Solved) -> FittedWalk:
        """Return it at another solution, of a problem that has its factors and more."""
        scale = self.scale
        if scale is not None:
            scale = replace(scale, columns=estimate_gyro_scale(problem, solved).columns)
        return replace(self, walk=replace(self.walk, problem=problem, solved=solved), scale=scale)


def fit_walk(
    recording: Recording,
    stances: Stances,
    parameters: SmootherParameters,
    heading: float | None,
    progress: Callable[[float], None] | None,
    field: FootfallField | None,
    fixes: Sequence[Fix] = (),
    extra: ExtraFactors | None = None,
    known: KnownTies | None = None,
) -> FittedWalk:
    """Solve a walk, given as to `smooth`."""
    solve_again = partial(
        _solve_from_samples,
        stances=stances,
        heading=heading,
        progress=progress,
        field=field,
        fixes=fixes,
        extra=extra,
        known=known,
    )
    walk = widen_bias_prior(solve_again(recording, parameters))
    # Where the field shows the heading it shows the gyroscope's scale: taken off the samples, or counted in the sigmas.
    fitted, of_scale = _fit_gyro_scale(solve_again, recording, parameters, walk)
    verdict = replace(fitted.walk.verdict, notes=(*of_scale, *fitted.walk.verdict.notes))
    return replace(fitted, walk=replace(fitted.walk, verdict=verdict))


def _solve_from_samples(
    recording: Recording,
    parameters: SmootherParameters,
    stances: Stances,
    heading: float | None,
    progress: Callable[[float], None] | None,
    field: FootfallField | None,
    fixes: Sequence[Fix],
    extra: ExtraFactors | None,
    known: KnownTies | None,
) -> SolvedWalk:
    # The walk by its inertial sensor and its stances, with values near the minimum.
    # Where the field is not used it does not show how the person turned over a hole in the samples either.
    magnetic = parameters.magnetic if field is not None else replace(parameters.magnetic, compass=False)
    problem = walk_problem(recording, stances, heading, replace(parameters, magnetic=magnetic), progress)
    problem = replace(problem, parameters=replace(problem.parameters, magnetic=parameters.magnetic))
    # Fixes, factors of the caller's own and known places need that solution to be placed, and constraints between
    # footfalls the one with them.
    if fixes:
        check_fix_distance(problem, fixes)
        problem = add_fixes(problem, problem.values, fixes)
    if extra is not None:
        problem = add_own(problem, problem.values, extra)
    if known is not None:
        problem = add_known_places(problem, known)
    if fixes or extra is not None or known is not None:
        problem = replace(problem, values=solve(problem, FIRST_CONVERGENCE).values)
    return solve_walk(add_constraints(problem, problem.values), field)


Solve: TypeAlias = Callable[[Recording, SmootherParameters], SolvedWalk]
"""Solves a walk with these samples and parameters."""


def widen_bias_prior(walk: SolvedWalk) -> SolvedWalk:
    """Return a walk with the prior of the gyro bias that it shows, solved again from its solution."""
    problem = average_bias_prior(walk.problem, walk.solved)
    return walk if problem is None else replace(walk, problem=problem, solved=solve(problem))


def _fit_gyro_scale(
    solve_again: Solve, recording: Recording, parameters: SmootherParameters, walk: SolvedWalk
) -> tuple[FittedWalk, tuple[str, ...]]:
    """Return a walk without the scale of its gyroscope that the field shows, with what is left of it, and notes."""
    if not (parameters.gyro_scale and shows_heading(walk.problem)):
        return FittedWalk(walk, None), ()
    scale = estimate_gyro_scale(walk.problem, walk.solved)
    walk.problem.recording.release()
    if not scale.found.matters:
        return FittedWalk(walk, scale), ()
    walk = widen_bias_prior(solve_again(scale.found.remove_from(recording), parameters))
    # The errors are those about what was taken off: its second moment stays.
    columns = estimate_gyro_scale(walk.problem, walk.solved).columns
    return FittedWalk(walk, replace(scale, columns=columns)), (scale.found.note,)
