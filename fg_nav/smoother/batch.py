"""The smoother: a whole walk at once. What comes before the moving foot is in `fitting`.

problem       rests, lever, swing noise; nodes, factors and initial values; first solution; bias walk
              (`problem.walk_problem`, which calls `graph.build_problem`)
fixes         known positions, factors of the caller's own (`own_factors`) and places of an earlier walk
              (`known_places`), added to the first solution (`constraints`), which is solved again
constraints   level floors found on that solution
solve         Gauss-Newton (`gauss_newton`), where the field is not used
differential  field while the foot stands: factors on the gyro bias (`differential`)
field         the magnetic field, in rounds, each of which solves again (`field`); both by `solved_walk.solve_walk`
prior         of the gyro bias: solved again with the one that the evidence averages (`bias_prior`)
scale         of the gyroscope, by the field: all again with samples without what both halves agree on (`gyro_scale`)
directions    of a building that the walk follows, where they are asked for (`directions`), in `solve_walk` too
places        where the field shows that the walk was at a place before (`places`), in `solve_walk` too
moving foot   what is not known of the walk's scale joins the sigmas (`moving_foot`)
solution      marginals -> sigmas (`solver`), that of the distance (`combinations`); nodes -> trajectory (`graph`)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache, cached_property, partial
from time import perf_counter

import gtsam
import numpy as np

from fg_nav.arrays import Floats
from fg_nav.detection.rest import freeze_ends
from fg_nav.errors import EstimationError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.magnetic import FootfallField
from fg_nav.recording import Recording
from fg_nav.smoother.combinations import FootfallCovariance, weigh_path
from fg_nav.smoother.count import count_factors
from fg_nav.smoother.differential import write_note
from fg_nav.smoother.fitting import fit_walk
from fg_nav.smoother.floors import write_floor_note
from fg_nav.smoother.graph import Trajectory, prepare_trajectory
from fg_nav.smoother.known_places import KnownTies
from fg_nav.smoother.own_factors import ExtraFactors, GraphNodes
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.smoother.places import mark_returns
from fg_nav.smoother.solved_walk import SolvedWalk
from fg_nav.smoother.solver import list_covariances, list_table_keys, stance_table
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
    compile_smoother()
    check_field(recording, stances, field)
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
    compile_smoother()
    check_field(recording, stances, field)
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
) -> tuple[SolvedWalk, FootfallCovariance, Draft]:
    began = perf_counter()
    fitted = fit_walk(recording, stances, parameters, heading, progress, field, fixes, extra, known)
    # The dense path, and the sigmas of its footfalls, with what the walk shares that its triangle does not hold.
    walk = fitted.walk
    joint = FootfallCovariance.of(walk.solved, walk.problem.nodes, fitted.shared_sqrt_covariance())
    covariances = list_covariances(list_table_keys(walk.problem.nodes), walk.solved.root, joint.shared)
    draft = Draft.of(walk, joint, covariances, stances, began)
    if progress is not None:
        progress(1.0)
    return walk, joint, draft


@dataclass(frozen=True)
class Draft:
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
    def of(
        cls, walk: SolvedWalk, joint: FootfallCovariance, covariances: Floats, stances: Stances, began: float
    ) -> Draft:
        """Return that of a solved walk, with the covariances (K, 6, 6) of its table (`solver.list_table_keys`)."""
        problem, solved, verdict = walk.problem, walk.solved, walk.verdict
        recording, p = problem.recording, problem.parameters
        table = stance_table(recording.t, problem.nodes, solved, verdict, covariances)
        table = mark_returns(table, walk.returns)
        if problem.differential is not None:
            sigma = problem.differential.find_sigma(problem.nodes.bias, table.nav_R_body[:, 2])
            table = replace(table, differential_sigma=sigma)
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


def check_field(recording: Recording, stances: Stances, field: FootfallField | None) -> None:
    """Raise `EstimationError` if a field is not that of these stances."""
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
def compile_smoother() -> None:
    """Smooth two seconds of rest, so that no walk is charged for the compiler."""
    t = np.arange(200) / 100.0
    rest = Recording(t=t, acc=np.tile([0.0, 0.0, GRAVITY_M_S2], (200, 1)), gyr=np.zeros((200, 3)))
    stances = Stances.from_mask(np.ones(200, dtype=np.bool_))
    _smooth(rest, stances, SmootherParameters(), 0.0, None, None, (), None)[-1].finish()
