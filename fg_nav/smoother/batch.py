"""The smoother: a whole walk at once.

problem       rests, lever, swing noise; nodes, factors and initial values; first solution; bias walk
              (`problem.walk_problem`, which calls `graph.build_problem`)
fixes         known positions, added to the first solution (`constraints`)
constraints   straight stretches and floors, found on the first solution, where they are asked for
solve         Gauss-Newton (`solver`), where there are fixes or constraints, and where the field is not used
differential  field while the foot stands: factors on the gyro bias (`differential`)
field         the magnetic field, in rounds, each of which solves again (`field`)
scale         of the gyroscope, by the field: all again with corrected samples where it is wrong (`gyro_scale`)
solution      marginals -> sigmas (`solver`), that of the distance (`combinations`); nodes -> trajectory (`graph`)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from functools import cache, partial
from time import perf_counter

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.detection.rest import freeze_ends
from fg_nav.errors import EstimationError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.magnetic import FootfallField
from fg_nav.recording import Fix, Recording
from fg_nav.smoother.bias_prior import find_bias_prior
from fg_nav.smoother.combinations import FootfallCovariance, weigh_path
from fg_nav.smoother.constraints import add_constraints, add_fixes
from fg_nav.smoother.count import count_factors
from fg_nav.smoother.differential import add_differential_field, write_note
from fg_nav.smoother.field import FieldVerdict, find_obstacle, ignore_field
from fg_nav.smoother.field_shape import solve_where_field_tells
from fg_nav.smoother.graph import WalkProblem, solve, trajectory_of
from fg_nav.smoother.gyro_scale import estimate_gyro_scale, shows_heading
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.smoother.problem import walk_problem
from fg_nav.smoother.solver import FIRST_CONVERGENCE, Solved, stance_table
from fg_nav.solution import Solution
from fg_nav.stances import Stances
from fg_nav.text import format_count


def smooth(
    recording: Recording,
    stances: Stances,
    parameters: SmootherParameters = SmootherParameters(),
    heading: float | None = 0.0,
    progress: Callable[[float], None] | None = None,
    field: FootfallField | None = None,
    fixes: Sequence[Fix] = (),
) -> Solution:
    """Smooth a walk.

    Parameters
    ----------
    recording : Recording
        Its magnetometer is used where `field` is given.
    stances : Stances
        When the foot stood, on this recording.
    parameters : SmootherParameters
    heading : float or None
        Of the body's x axis at the first stance, rad clockwise from north; None where it is not known: then zero, or
        with a field so that the walk's mean field points north.
    progress
        Called from time to time with the fraction that is done.
    field : FootfallField
        The field at the footfalls; None to do without.
    fixes
        Positions known from elsewhere, in the walk's own frame (`constraints`).

    Raises
    ------
    EstimationError
        With stances of another recording, a fix that is not on the walk, or where the solution cannot be found.
    """
    return smooth_jointly(recording, stances, parameters, heading, progress, field, fixes)[0]


def smooth_jointly(
    recording: Recording,
    stances: Stances,
    parameters: SmootherParameters = SmootherParameters(),
    heading: float | None = 0.0,
    progress: Callable[[float], None] | None = None,
    field: FootfallField | None = None,
    fixes: Sequence[Fix] = (),
) -> tuple[Solution, FootfallCovariance]:
    """Smooth a walk as `smooth` does; return the joint covariance of its footfalls too, which holds the whole graph."""
    _compile()
    _check(recording, stances, field)
    return _smooth(recording, stances, parameters, heading, progress, field, fixes)


def _smooth(
    recording: Recording,
    stances: Stances,
    parameters: SmootherParameters,
    heading: float | None,
    progress: Callable[[float], None] | None,
    field: FootfallField | None,
    fixes: Sequence[Fix],
) -> tuple[Solution, FootfallCovariance]:
    began = perf_counter()
    solve_walk = partial(_solve_walk, stances=stances, heading=heading, progress=progress, field=field, fixes=fixes)
    problem, solved, verdict = solve_walk(recording, parameters=parameters)
    notes: tuple[str, ...] = ()
    # A bias that is too large for its prior is the sign of a sensor that was not calibrated: solved with a wider one.
    prior = find_bias_prior(problem, solved)
    if prior is not None:
        parameters = replace(parameters, gyro_bias_sigma_deg_s=prior.sigma_deg_s)
        problem, solved, verdict = solve_walk(recording, parameters=parameters)
        notes = (prior.note,)
    by_scale: Mapping[int, Floats] = {}
    # Where the field shows the heading it shows the gyroscope's scale: taken off the samples, or counted in the sigmas.
    if parameters.gyro_scale and shows_heading(problem):
        scale = estimate_gyro_scale(problem, solved)
        unknown = scale.found.second_moment
        if scale.found.is_shown:
            problem, solved, verdict = solve_walk(scale.found.remove_from(recording), parameters=parameters)
            notes = (*notes, scale.found.note)
            scale = estimate_gyro_scale(problem, solved)
            unknown = scale.found.covariance
        by_scale = scale.spread(unknown)
    verdict = replace(verdict, notes=(*notes, *verdict.notes))
    joint = FootfallCovariance.of(solved, problem.nodes, by_scale)
    solution = _solution_of(problem, solved, verdict, joint, stances, began)
    if progress is not None:
        progress(1.0)
    return solution, joint


def _solve_walk(
    recording: Recording,
    stances: Stances,
    parameters: SmootherParameters,
    heading: float | None,
    progress: Callable[[float], None] | None,
    field: FootfallField | None,
    fixes: Sequence[Fix],
) -> tuple[WalkProblem, Solved, FieldVerdict]:
    """Return the problem of a walk as it was solved last, its solution, and the verdict on its field."""
    # The walk by its inertial sensor and its stances, with values near the minimum.
    problem = walk_problem(recording, stances, heading, parameters, progress)
    # Fixes and constraints between footfalls need that solution to be placed.
    inertial = problem
    if fixes:
        problem = add_fixes(problem, problem.values, fixes)
    if parameters.walk.straight or parameters.walk.floors:
        problem = add_constraints(problem, problem.values)
    if problem is not inertial:
        problem = replace(problem, values=solve(problem, FIRST_CONVERGENCE).values)
    obstacle = find_obstacle(field, parameters.magnetic)
    if field is None:
        return problem, solve(problem), ignore_field(problem, obstacle)
    # While the foot stands the field shows the gyro bias, also where it shows no heading.
    track = trajectory_of(problem.recording, problem.nodes, problem.values, parameters.gravity)
    problem = add_differential_field(problem, problem.values, track)
    # The field is compared along the solution, and joins it.
    if obstacle:
        return problem, solve(problem), ignore_field(problem, obstacle)
    with_field = solve_where_field_tells(problem, field, track)
    return with_field.problem, with_field.solved, with_field.verdict


def _solution_of(
    problem: WalkProblem,
    solved: Solved,
    verdict: FieldVerdict,
    joint: FootfallCovariance,
    stances: Stances,
    began: float,
) -> Solution:
    """Return the dense trajectory, and the stances with their sigmas; the clock showed `began` at the start."""
    recording, p = problem.recording, problem.parameters
    table = stance_table(recording.t, problem.nodes, solved, verdict, joint.shared)
    path_variance = joint.combine(weigh_path(table.position)[:, :, None])[0]
    position, velocity, nav_R_body = trajectory_of(recording, problem.nodes, solved.values, p.gravity)
    tails = freeze_ends(recording.t, stances, position, velocity)
    steps = f"solved in {format_count(solved.steps, 'Gauss-Newton step')}"
    return Solution(
        method="smoother",
        t=recording.t,
        position=position,
        velocity=velocity,
        nav_R_body=nav_R_body,
        stances=table,
        runtime_s=perf_counter() - began,
        parameters=asdict(p),
        notes=(*problem.known.notes, steps, *write_note(problem.differential), *verdict.notes, *tails),
        graph=count_factors(problem),
        recording=recording,
        distance_sigma_m=float(np.sqrt(path_variance[0, 0])),
    )


def _check(recording: Recording, stances: Stances, field: FootfallField | None) -> None:
    if field is None:
        return
    if recording.mag is None:
        raise EstimationError("there is a field and the recording has no magnetometer: leave the field out.")
    if len(field) != stances.n_footfalls:
        raise EstimationError(
            f"the field is that of {len(field)} footfalls and the stances have {stances.n_footfalls}: "
            "take the field at these stances."
        )


@cache
def _compile() -> None:
    """Smooth two seconds of rest, so that no walk is charged for the compiler."""
    t = np.arange(200) / 100.0
    rest = Recording(t=t, acc=np.tile([0.0, 0.0, GRAVITY_M_S2], (200, 1)), gyr=np.zeros((200, 3)))
    stances = Stances.from_mask(np.ones(200, dtype=np.bool_))
    _smooth(rest, stances, SmootherParameters(), 0.0, None, None, ())
