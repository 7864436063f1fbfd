"""The smoother: a whole walk at once, solved from its samples with what it shows of its sensor.

    problem       rests, lever, swing noise; nodes, factors and initial values; first solution; bias walk (`problem`)
    known         fixes, own factors, places of an earlier walk (`constraints`); level floors (`heights`)
    differential  field while the foot stands: factors on the gyro bias (`differential`)
    field         the magnetic field, in rounds, each of which solves again (`field`)
    directions    of a building that the walk follows, an option (`building`)
    places        where the field shows that the walk was at a place before (`building`)
    bias prior    solved again with the one that the evidence averages (`problem`)
    gyro scale    by the field: all again with samples without what both halves of the walk agree on (`sensitivity`)
    shared        what all strides share and the triangle does not hold joins the sigmas (`sensitivity`)
    solution      marginals -> sigmas (`solver`), that of the distance (`sensitivity`); nodes -> path (`graph`)

`fit_walk` is all of it but the solution: a walk in progress is solved by it at each re-solve, and each foot of two.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from dataclasses import field as declare
from functools import cache, cached_property
from time import perf_counter
from typing import TYPE_CHECKING

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, X

from fg_nav.arrays import Bools, Brief, Floats
from fg_nav.detection.rest import freeze_ends
from fg_nav.detection.stance import Stances
from fg_nav.errors import EstimationError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.magnetic import FootfallField
from fg_nav.magnetic.detectors import UNKNOWN
from fg_nav.recording import Recording
from fg_nav.smoother.building import follow_directions, mark_returns, tie_places
from fg_nav.smoother.constraints import (
    ExtraFactors,
    GraphNodes,
    KnownTies,
    add_fixes,
    add_known_places,
    add_own,
    check_fix_distance,
    select_reached_fixes,
)
from fg_nav.smoother.differential import DifferentialFactors, add_differential_field, write_note
from fg_nav.smoother.field import FieldSolution, FieldVerdict, find_obstacle, integrate_field, solve_with_field
from fg_nav.smoother.field_factors import FieldFactors
from fg_nav.smoother.graph import WalkProblem, count_factors, solve, trajectory_of
from fg_nav.smoother.heights import BarometerFactors, add_constraints, spread_scale
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.smoother.problem import average_bias_prior, walk_problem
from fg_nav.smoother.sensitivity import (
    FootfallCovariance,
    WalkScale,
    estimate_gyro_scale,
    spread_clipped_peaks,
    spread_moving_foot,
    weigh_gyro_scale,
    weigh_path,
)
from fg_nav.smoother.solver import FIRST_CONVERGENCE, Solved, in_nav, list_biases, list_covariances, list_poses
from fg_nav.smoother.strides import Nodes
from fg_nav.solution import Return, Solution, StanceTable
from fg_nav.text import format_count
from fg_nav.truth import Fix

if TYPE_CHECKING:
    import pandas as pd

USUAL_STEPS = 5  # Of the last solve; more are worth a remark.


@dataclass(frozen=True)
class InProgress:
    """What a walk in progress, whose samples end in the middle of it, is solved with besides."""

    continues: Bools | None = None  # (F,) footfalls that are further pieces of a standing, None where none is.
    unseen: str = ""  # Why the field was not measured though it is to be used.
    has_ended: bool = False  # Whether no samples follow.


@dataclass(frozen=True)
class WalkInput:
    """What a walk is solved from, see `smooth`; a walk `in_progress` uses the fixes that it has come to."""

    recording: Recording
    stances: Stances
    heading: float | None = 0.0
    field: FootfallField | None = None
    parameters: SmootherParameters = declare(default_factory=SmootherParameters)
    progress: Callable[[float], None] | None = None
    fixes: Sequence[Fix] = ()
    extra: ExtraFactors | None = None
    known: KnownTies | None = None
    in_progress: InProgress | None = None


@dataclass(frozen=True)
class SolvedWalk(Brief):
    """The problem of the last solution, its minimum, and what was found on it."""

    problem: WalkProblem
    solved: Solved
    verdict: FieldVerdict
    field: FieldSolution | None = None
    returns: tuple[Return, ...] = ()
    scale: WalkScale | None = None  # What is left of the gyroscope's; None where nothing shows it.

    def take_solution(self, problem: WalkProblem, solved: Solved) -> SolvedWalk:
        """Return it at another solution, of a problem that has its factors and more."""
        scale = self.scale
        if scale is not None:
            scale = replace(scale, columns=weigh_gyro_scale(problem, solved)[0])
        return replace(self, problem=problem, solved=solved, scale=scale)

    def shared_sqrt_covariance(self) -> Floats:
        """Return S (N, n): S S^T is the covariance of errors that all strides share, one a column at one sigma."""
        problem, solved = self.problem, self.solved
        moved = [np.zeros((solved.root.total, 0)) if self.scale is None else self.scale.spread()]
        moved.append(spread_clipped_peaks(problem, solved))
        if problem.parameters.moving_foot:
            moved.append(spread_moving_foot(problem, solved))
        if (barometer := problem.find(BarometerFactors)) is not None:
            moved.append(spread_scale(barometer, solved))
        return np.hstack(moved)


def fit_walk(given: WalkInput) -> SolvedWalk:
    """Solve a walk, in rounds of what its solution shows; raises as `batch.smooth`."""
    if given.field is not None and given.recording.mag is None:
        raise EstimationError("there is a field and the recording has no magnetometer: leave the field out.")
    if given.field is not None and len(given.field) != (footfalls := given.stances.n_footfalls):
        raise EstimationError(
            f"the field is that of {len(given.field)} footfalls and the stances have {footfalls}: "
            "take the field at these stances."
        )
    # Where the field is not used it does not show how the person turned over a hole in the samples either; of a walk in
    # progress it is not known yet whether it is.
    p, so_far = given.parameters, given.in_progress
    is_used = given.field is not None or so_far is not None
    of_sensor = p if is_used else replace(p, magnetic=replace(p.magnetic, compass=False))
    goes_on = so_far is not None and not so_far.has_ended
    recording, corrected = given.recording, None
    while True:
        # Sensor and mounting from the recording; nodes, factors, and the first solution.
        problem = walk_problem(recording, given.stances, given.heading, of_sensor, given.progress, goes_on)
        problem = replace(problem, parameters=replace(problem.parameters, magnetic=p.magnetic))
        # Fixes, own factors and known places; level floors.
        problem = add_known(problem, given)
        # The magnetic field, in rounds; a building's directions; places where the walk was before.
        walk = solve_with_all(problem, given)
        # The prior of the gyro bias that the solution shows.
        if (problem_again := average_bias_prior(walk.problem, walk.solved)) is not None:
            walk = replace(walk, problem=problem_again, solved=solve(problem_again))
        # Once more on samples without the gyroscope's scale error, which shows where the field shows the heading.
        if corrected is not None:
            # The errors of the scale are those about what was taken off: its second moment stays.
            verdict = replace(walk.verdict, notes=(corrected.found.note, *walk.verdict.notes))
            return replace(walk, verdict=verdict, scale=corrected).take_solution(walk.problem, walk.solved)
        field = walk.problem.find(FieldFactors)
        if not p.gyro_scale or so_far is not None or field is None or not field.shows_heading:
            return walk
        scale = estimate_gyro_scale(walk.problem, walk.solved)
        if not scale.found.matters:
            return replace(walk, scale=scale)
        recording, corrected = replace(recording, gyr=recording.gyr / (1.0 + scale.found.scale)), scale


def add_known(problem: WalkProblem, given: WalkInput) -> WalkProblem:
    """Add fixes, own factors and known places, placed on the first solution, and level floors on that with them."""
    so_far, fixes, placed = given.in_progress, given.fixes, problem
    if so_far is not None:
        fixes = select_reached_fixes(fixes, problem.recording.t[problem.nodes.sample])
    elif fixes:
        check_fix_distance(problem, fixes)
    if fixes:
        placed = add_fixes(placed, placed.values, fixes)
    if given.extra is not None:
        placed = add_own(placed, placed.values, given.extra)
    if given.known is not None:
        placed = add_known_places(placed, given.known)
    if placed is not problem:
        placed = replace(placed, values=solve(placed, FIRST_CONVERGENCE).values)
    return add_constraints(placed, placed.values, None if so_far is None else so_far.continues)


def solve_with_all(problem: WalkProblem, given: WalkInput) -> SolvedWalk:
    """Solve a walk with field, building directions and places, from its minimum without the field."""
    field, so_far = given.field, given.in_progress
    obstacle = (so_far.unseen if so_far is not None else "") or find_obstacle(field)
    found = path = None
    if field is not None:
        # While the foot stands the field shows the gyro bias, also where it shows no heading.
        track = trajectory_of(problem.recording, problem.nodes, problem.values, problem.parameters.gravity)
        problem = add_differential_field(problem, problem.values, track)
        path = None if obstacle else integrate_field(problem, field, track)
        del track  # fifteen numbers a sample
    if field is not None and path is not None:
        # The field is compared along the solution, and joins it.
        found = solve_with_field(problem, field, path)
        problem, solved, verdict = found.problem, found.solved, found.verdict
    else:
        count = len(problem.nodes.result)
        words, statistic, weight = (UNKNOWN,) * count, np.full(count, np.nan), np.zeros(count)
        solved, verdict = solve(problem), FieldVerdict(words, (obstacle,) * count, (), statistic, weight)
    # The field settles which direction is which, and the path along them where places are searched.
    problem, solved, notes = follow_directions(problem, solved)
    returns: tuple[Return, ...] = ()
    if field is not None:
        problem, solved, returns, of_places = tie_places(problem, solved)
        notes = (*notes, *of_places)
    return SolvedWalk(problem, solved, replace(verdict, notes=(*verdict.notes, *notes)), found, returns)


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
        `gtsam.NonlinearFactorGraph`, which joins the walk's before it is solved, in all rounds (`constraints`). It may
        be called several times.
    known
        Footfalls at places known from an earlier walk, in whose frame it is then solved (`constraints`).

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
    given = WalkInput(recording, stances, heading, field, parameters, progress, fixes, extra, known)
    return _smooth(given).solution


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
    given = WalkInput(recording, stances, heading, field, parameters, progress, fixes, extra)
    return _smooth(given)


@dataclass(frozen=True)
class SmoothedWalk(Brief):
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

    def __repr__(self) -> str:
        """Say in a line what it is; graph and values print themselves in pages."""
        counts = ", ".join(f"{count} {kind}" for kind, count in self.solution.graph.items() if count)
        return f"<SmoothedWalk: {self.values.size()} variables, {counts}; {self.solution!r}>"

    @cached_property
    def graph(self) -> gtsam.NonlinearFactorGraph:
        """All factors of the walk, one by one, at whose minimum the `values` are."""
        return self.walk.problem.factors()

    @cached_property
    def factors(self) -> pd.DataFrame:
        """A row a factor of the `graph`, in its order.

        `kind` is the word of `Solution.graph`, empty for priors and what else is not counted there, `name` that of the
        residual or the class of gtsam, `variables` are as gtsam writes them, `error` is half the square at the minimum.

        Examples
        --------
        >>> recording = fg_nav.read("walk.csv")
        >>> walk = fg_nav.smooth_graph(recording, fg_nav.detect_stances(recording))
        >>> rows = walk.factors.query("kind == 'zero_velocity'")
        >>> len(rows) == walk.solution.graph["zero_velocity"], rows.name.iloc[0], rows.variables.iloc[0]
        (True, 'stance velocity', 'x0 v0 s0')
        """
        import pandas as pd

        table = pd.DataFrame(self.walk.problem.name_factors(), columns=["kind", "name"])
        each = list(map(self.graph.at, range(self.graph.size())))
        table["variables"] = [" ".join(map(gtsam.DefaultKeyFormatter, factor.keys())) for factor in each]
        table["error"] = [factor.error(self.values) for factor in each]
        return table

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


def _smooth(given: WalkInput) -> SmoothedWalk:
    """Solve a walk; return its solution, with its graph."""
    began = perf_counter()
    walk = fit_walk(given)
    # Covariances, including walk-wide parameters outside the square-root information (gyro scale, moving foot).
    joint = FootfallCovariance.of(walk.solved, walk.problem.nodes, walk.shared_sqrt_covariance())
    covariances = list_covariances(list_table_keys(walk.problem.nodes), walk.solved.root, joint.shared)
    solution = to_solution(walk, joint, covariances, given.stances, began)
    if given.progress is not None:
        given.progress(1.0)
    return SmoothedWalk(solution, walk, joint)


def list_table_keys(nodes: Nodes) -> list[int]:
    """List the poses of the footfalls, and the biases, whose covariances a stance table has: all of six dimensions."""
    return [*(X(int(j)) for j in nodes.result), *(B(k) for k in range(int(nodes.bias[-1]) + 1))]


def stance_table(t: Floats, nodes: Nodes, solved: Solved, verdict: FieldVerdict, covariances: Floats) -> StanceTable:
    """Poses, biases and their marginal sigmas at the stillest node of each footfall.

    `covariances` (K, 6, 6) are those of `list_table_keys`.
    """
    body, of_bias = covariances[: len(nodes.result)], covariances[len(nodes.result) :]
    bias_variance = np.diagonal(of_bias, axis1=1, axis2=2)[nodes.bias]
    bias = list_biases(nodes, solved.values)[:, 3:]
    poses = list_poses(nodes.result, solved.values)
    attitude, position = poses[:, :3, :3].copy(), poses[:, :3, 3].copy()
    pose_cov = in_nav(attitude, body)
    sample = nodes.sample[nodes.result]
    return StanceTable(
        sample=sample,
        t=t[sample],
        position=position,
        nav_R_body=attitude,
        gyro_bias=bias[nodes.bias],
        position_cov=pose_cov[:, :3, :3],
        heading_sigma=np.sqrt(pose_cov[:, 3, 3]),
        gyro_bias_sigma=np.sqrt(bias_variance[:, 3:]),
        field=verdict.words,
        field_reason=verdict.reason,
        pose_cov=pose_cov,
        compass_weight=verdict.compass_weight,
        field_statistic=verdict.statistic,
    )


def to_solution(
    walk: SolvedWalk, joint: FootfallCovariance, covariances: Floats, stances: Stances, began: float
) -> Solution:
    """Return the dense path with the table of footfalls.

    `covariances` (K, 6, 6) are those of `list_table_keys`; `began` s is the start of the solve.
    """
    # Footfalls and biases, and the sigma of the distance.
    problem, solved, verdict = walk.problem, walk.solved, walk.verdict
    recording, p = problem.recording, problem.parameters
    table = mark_returns(stance_table(recording.t, problem.nodes, solved, verdict, covariances), walk.returns)
    table = replace(table, move_cov=joint.measure_moves(problem.nodes))
    if (differential := problem.find(DifferentialFactors)) is not None:
        sigma = differential.find_sigma(problem.nodes.bias, table.nav_R_body[:, 2])
        table = replace(table, differential_sigma=sigma)
    path_variance = joint.combine(weigh_path(table.position)[:, :, None])[0]
    # Notes.
    steps = [f"solved in {solved.steps} Gauss-Newton steps"] if solved.steps > USUAL_STEPS else []
    floors = list[str]()
    if problem.floor is not None and problem.floor.max(initial=-1) >= 0:
        count, on = format_count(int(problem.floor.max()) + 1, "level floor"), int(np.count_nonzero(problem.floor >= 0))
        floors.append(f"{count} with {on} of {format_count(len(problem.floor), 'footfall')}")
    notes = (*problem.known.notes, *steps, *floors, *write_note(differential), *verdict.notes)
    # The path at the recording's rate.
    position, velocity, nav_R_body = trajectory_of(recording, problem.nodes, solved.values, p.gravity)
    tails = freeze_ends(recording.t, stances, position, velocity)
    return Solution(
        method="smoother",
        t=recording.t,
        position=position,
        velocity=velocity,
        nav_R_body=nav_R_body,
        stances=table,
        parameters=asdict(p),
        graph=count_factors(problem),
        recording=recording,
        returns=walk.returns,
        distance_sigma_m=float(np.sqrt(path_variance[0, 0])),
        runtime_s=perf_counter() - began,
        notes=(*notes, *tails),
    )


@cache
def compile_smoother() -> None:
    """Smooth two seconds of rest, so that no walk is charged for the compiler."""
    t = np.arange(200) / 100.0
    rest = Recording(t=t, acc=np.tile([0.0, 0.0, GRAVITY_M_S2], (200, 1)), gyr=np.zeros((200, 3)))
    _smooth(WalkInput(rest, Stances.from_mask(np.ones(200, dtype=np.bool_))))
