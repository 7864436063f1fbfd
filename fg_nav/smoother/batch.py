"""The smoother: a whole walk at once.

problem       rests, lever, swing noise; nodes, factors and initial values; first solution; bias walk
              (`problem.walk_problem`, which calls `graph.build_problem`)
fixes         known positions, factors of the caller's own (`own_factors`) and places of an earlier walk
              (`known_places`), added to the first solution (`constraints`), which is solved again
constraints   level floors found on that solution, and straight stretches where they are asked for
solve         Gauss-Newton (`solver`), where the field is not used
differential  field while the foot stands: factors on the gyro bias (`differential`)
field         the magnetic field, in rounds, each of which solves again (`field`); both by `solved_walk.solve_walk`
prior         of the gyro bias: all again with a wider one where the bias is too large for it (`bias_prior`)
scale         of the gyroscope, by the field: all again with corrected samples where it is wrong (`gyro_scale`)
places        where the field shows that the walk was at a place before (`places`), in `solve_walk` too
moving foot   what is not known of the walk's scale joins the sigmas (`moving_foot`)
solution      marginals -> sigmas (`solver`), that of the distance (`combinations`); nodes -> trajectory (`graph`)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache, cached_property, partial
from time import perf_counter
from typing import TypeAlias

import gtsam
import numpy as np

from fg_nav.arrays import Floats
from fg_nav.detection.rest import freeze_ends
from fg_nav.errors import EstimationError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.magnetic import FootfallField
from fg_nav.recording import Recording
from fg_nav.smoother.bias_prior import find_bias_prior
from fg_nav.smoother.combinations import FootfallCovariance, weigh_path
from fg_nav.smoother.constraints import add_constraints, add_fixes, add_own, refuse_far_fixes
from fg_nav.smoother.count import count_factors
from fg_nav.smoother.differential import write_note
from fg_nav.smoother.floors import write_floor_note
from fg_nav.smoother.gauss_newton import FIRST_CONVERGENCE
from fg_nav.smoother.graph import Trajectory, prepare_trajectory, solve
from fg_nav.smoother.gyro_scale import estimate_gyro_scale, shows_heading
from fg_nav.smoother.known_places import KnownTies, add_known_places
from fg_nav.smoother.moving_foot import spread_moving_foot
from fg_nav.smoother.own_factors import ExtraFactors, GraphNodes
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.smoother.places import mark_returns
from fg_nav.smoother.problem import walk_problem
from fg_nav.smoother.solved_walk import SolvedWalk, solve_walk
from fg_nav.smoother.solver import list_covariances, stance_table
from fg_nav.solution import Solution
from fg_nav.stances import Stances
from fg_nav.system.memory import return_freed
from fg_nav.text import format_count
from fg_nav.truth import Fix


def smooth(
    recording: Recording,
    stances: Stances,
    parameters: SmootherParameters = SmootherParameters(),
    heading: float | None = 0.0,
    progress: Callable[[float], None] | None = None,
    field: FootfallField | None = None,
    fixes: Sequence[Fix] = (),
    extra: ExtraFactors | None = None,
    known: KnownTies | None = None,
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
    extra
        Makes factors of your own: it is given the variables of the walk (`GraphNodes`) and returns a
        `gtsam.NonlinearFactorGraph`, which joins the walk's before it is solved, in all rounds (`own_factors`). It may
        be called several times.
    known
        Footfalls at places known from an earlier walk, in whose frame it is then solved (`known_places`).

    Raises
    ------
    EstimationError
        With stances of another recording, a fix that is not on the walk, extra factors that join what is not in it or
        cannot be evaluated, or where the solution cannot be found.

    Examples
    --------
    >>> recording = fg_nav.read("walk.csv")
    >>> solution = fg_nav.smooth(recording, fg_nav.detect_stances(recording))
    >>> solution.position.shape == (len(recording), 3)  # m
    True
    """
    _compile()
    _check(recording, stances, field)
    draft = _smooth(recording, stances, parameters, heading, progress, field, fixes, extra, known)[-1]
    return draft.finish()


def smooth_graph(
    recording: Recording,
    stances: Stances,
    parameters: SmootherParameters = SmootherParameters(),
    heading: float | None = 0.0,
    progress: Callable[[float], None] | None = None,
    field: FootfallField | None = None,
    fixes: Sequence[Fix] = (),
    extra: ExtraFactors | None = None,
) -> SmoothedWalk:
    """Smooth a walk as `smooth` does, and keep its graph: several times the memory of the solution.

    Examples
    --------
    >>> recording = fg_nav.read("walk.csv")
    >>> walk = fg_nav.smooth_graph(recording, fg_nav.detect_stances(recording))
    >>> last = walk.nodes.pose[walk.nodes.stillest[-1]]
    >>> bool(np.allclose(walk.values.atPose3(last).translation(), walk.solution.stances.position[-1]))
    True
    """
    _compile()
    _check(recording, stances, field)
    walk, joint, draft = _smooth(recording, stances, parameters, heading, progress, field, fixes, extra)
    return SmoothedWalk(draft.finish(), walk, joint)


@dataclass(frozen=True)
class SmoothedWalk:
    """A walk as it was solved: `smooth_graph` returns it.

    Attributes
    ----------
    solution : the dense trajectory and the footfalls.
    walk : the problem of the last solution, and its minimum.
    joint : joint covariance of the footfalls.

    Examples
    --------
    >>> recording = fg_nav.read("walk.csv")
    >>> walk = fg_nav.smooth_graph(recording, fg_nav.detect_stances(recording))
    >>> walk.graph.size() > 100 and walk.graph.error(walk.values) > 0.0
    True
    >>> walk.find_covariance(walk.nodes.velocity[-1]).shape  # (m/s)^2
    (3, 3)
    """

    solution: Solution
    walk: SolvedWalk
    joint: FootfallCovariance

    @cached_property
    def graph(self) -> gtsam.NonlinearFactorGraph:
        """All factors of the walk, one by one, at whose minimum the `values` are."""
        return self.walk.problem.factors()

    @property
    def values(self) -> gtsam.Values:
        """All variables at the minimum."""
        return self.walk.solved.values

    @cached_property
    def nodes(self) -> GraphNodes:
        """Keys and times of the variables."""
        problem = self.walk.problem
        return GraphNodes.of(problem.nodes, problem.recording.t, self.values)

    def find_covariance(self, key: int) -> Floats:
        """Return the covariance (d, d) of a variable in its tangent space: of a pose rad and m, body axes.

        Raises `EstimationError` if the walk has no such variable.
        """
        if not self.values.exists(key):
            raise EstimationError(f"the walk has no variable {gtsam.DefaultKeyFormatter(key)}: take one of its nodes.")
        (covariance,) = list_covariances([key], self.walk.solved.root, self.joint.shared)
        return np.asarray(covariance)


def _smooth(
    recording: Recording,
    stances: Stances,
    parameters: SmootherParameters,
    heading: float | None,
    progress: Callable[[float], None] | None,
    field: FootfallField | None,
    fixes: Sequence[Fix],
    extra: ExtraFactors | None,
    known: KnownTies | None = None,
) -> tuple[SolvedWalk, FootfallCovariance, _Draft]:
    began = perf_counter()
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
    # A bias that is too large for its prior is the sign of a sensor that was not calibrated: solved with a wider one.
    walk, parameters, of_bias = _fit_bias_prior(solve_again, recording, parameters)
    # Where the field shows the heading it shows the gyroscope's scale: taken off the samples, or counted in the sigmas.
    walk, by_scale, of_scale = _fit_gyro_scale(solve_again, recording, parameters, walk)
    # The dense path, and the sigmas of its footfalls, with the scale of the walk that a moving foot leaves unknown.
    walk = replace(walk, verdict=replace(walk.verdict, notes=(*of_bias, *of_scale, *walk.verdict.notes)))
    by_foot = [spread_moving_foot(walk.problem, walk.solved)] if parameters.moving_foot else []
    joint = FootfallCovariance.of(walk.solved, walk.problem.nodes, np.hstack([by_scale, *by_foot]))
    draft = _Draft.of(walk, joint, stances, began)
    if progress is not None:
        progress(1.0)
    return walk, joint, draft


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
        refuse_far_fixes(problem, fixes)
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


def _fit_bias_prior(
    solve_again: Solve, recording: Recording, parameters: SmootherParameters
) -> tuple[SolvedWalk, SmootherParameters, tuple[str, ...]]:
    """Solve a walk, with a wider prior of the gyro bias where it shows one; return the parameters and notes too."""
    walk = solve_again(recording, parameters)
    prior = find_bias_prior(walk.problem, walk.solved)
    if prior is None:
        return walk, parameters, ()
    parameters = replace(parameters, gyro_bias_sigma_deg_s=prior.sigma_deg_s)
    return solve_again(recording, parameters), parameters, (prior.note,)


def _fit_gyro_scale(
    solve_again: Solve, recording: Recording, parameters: SmootherParameters, walk: SolvedWalk
) -> tuple[SolvedWalk, Floats, tuple[str, ...]]:
    """Return a walk without the scale of its gyroscope that the field shows, the covariance by the rest, and notes."""
    if not (parameters.gyro_scale and shows_heading(walk.problem)):
        return walk, np.zeros((walk.solved.root.total, 0)), ()
    scale = estimate_gyro_scale(walk.problem, walk.solved)
    walk.problem.recording.release()
    if not scale.found.is_shown:
        return walk, scale.columns.spread(scale.found.second_moment), ()
    walk = solve_again(scale.found.remove_from(recording), parameters)
    left = estimate_gyro_scale(walk.problem, walk.solved)
    return walk, left.columns.spread(left.found.covariance), (scale.found.note,)


@dataclass(frozen=True)
class _Draft:
    """A solution without its dense path, of arrays alone: its graph can be let go of before `finish`.

    `known` makes the solution of what is still missing; the clock showed `began` at the start.
    """

    known: Callable[..., Solution]
    trajectory: Callable[[], Trajectory]
    recording: Recording
    stances: Stances
    notes: tuple[str, ...]
    began: float

    @classmethod
    def of(cls, walk: SolvedWalk, joint: FootfallCovariance, stances: Stances, began: float) -> _Draft:
        """Return that of a solved walk, with the sigmas of its footfalls."""
        problem, solved, verdict = walk.problem, walk.solved, walk.verdict
        recording, p = problem.recording, problem.parameters
        table = stance_table(recording.t, problem.nodes, solved, verdict, joint.shared)
        table = mark_returns(table, walk.returns)
        path_variance = joint.combine(weigh_path(table.position)[:, :, None])[0]
        floors = write_floor_note(problem.floor)
        steps = f"solved in {format_count(solved.steps, 'Gauss-Newton step')}"
        known = partial(
            Solution,
            method="smoother",
            t=recording.t,
            stances=table,
            parameters=asdict(p),
            graph=count_factors(problem),
            recording=recording,
            returns=walk.returns,
            distance_sigma_m=float(np.sqrt(path_variance[0, 0])),
        )
        trajectory = prepare_trajectory(recording, problem.nodes, solved.values, p.gravity)
        notes = (*problem.known.notes, steps, *floors, *write_note(problem.differential), *verdict.notes)
        return cls(known, trajectory, recording, stances, notes, began)

    def finish(self) -> Solution:
        """Return the solution with its dense path."""
        return_freed()
        position, velocity, nav_R_body = self.trajectory()
        self.recording.release()
        tails = freeze_ends(self.recording.t, self.stances, position, velocity)
        return self.known(
            position=position,
            velocity=velocity,
            nav_R_body=nav_R_body,
            runtime_s=perf_counter() - self.began,
            notes=(*self.notes, *tails),
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
    _smooth(rest, stances, SmootherParameters(), 0.0, None, None, (), None)[-1].finish()
