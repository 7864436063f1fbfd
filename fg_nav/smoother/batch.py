"""The batch smoother: a whole walk at once.

rests   -> gyro bias to start from, and its sigma
stances -> lever of the rolling foot
stances -> nodes; samples between nodes -> inertial measurements
strides -> factors, one stride after the other
dead reckoning -> initial values; Gauss-Newton -> solution
solution and field -> solution with the field (`field_rounds`)
marginals -> sigmas; nodes -> dense trajectory
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from functools import cache
from time import perf_counter

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, X

from fg_nav.arrays import Floats
from fg_nav.errors import EstimationError
from fg_nav.fixes import Fix
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.magnetic import FootfallField
from fg_nav.magnetic.quasi_static import UNKNOWN
from fg_nav.recording import Recording
from fg_nav.smoother.covariances import in_nav, marginal_covariances, turned_about_start
from fg_nav.smoother.dense import trajectory_of
from fg_nav.smoother.field_rounds import Begun, FieldProblem, FieldVerdict, solve_with_field, unusable
from fg_nav.smoother.initial import initial_values
from fg_nav.smoother.known import Known, known_before
from fg_nav.smoother.nodes import Nodes, place_nodes
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.smoother.preintegration import preintegrate
from fg_nav.smoother.solver import Native, Part, Solved, solve, time_order
from fg_nav.smoother.strides import VelocityTies, add_start, add_stride, gauge, gauge_of, strides_of
from fg_nav.smoother.walk_fixes import free_heading, pin_fixes
from fg_nav.smoother.walk_ties import walk_ties
from fg_nav.solution import Solution, StanceTable
from fg_nav.stances import Stances
from fg_nav.start import starting_point
from fg_nav.tails import hold_tails
from fg_nav.wording import counted


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
        Of the body's x axis at the first stance, rad clockwise from north; None where it is unknown: then zero, or
        with a field so that the walk's mean field points north.
    progress
        Told from time to time which fraction is done.
    field : FootfallField
        The field at the footfalls; None to do without.
    fixes
        Positions known from elsewhere, in the walk's own frame (`walk_fixes`).

    Raises
    ------
    EstimationError
        With stances of another recording, a fix that is not on the walk, or where the solution cannot be found.
    """
    _compile()
    _check(recording, stances, field)
    return _smooth(recording, stances, parameters, heading, progress, field, fixes)


def _smooth(
    recording: Recording,
    stances: Stances,
    p: SmootherParameters,
    heading: float | None,
    progress: Callable[[float], None] | None,
    field: FootfallField | None,
    fixes: Sequence[Fix],
) -> Solution:
    began = perf_counter()
    start = starting_point(recording, stances, heading or 0.0, p.rest)
    known = known_before(recording, stances, start.rests, p)
    p = replace(p, gyr_relative_density=known.swing.gyr_relative_density)
    nodes = place_nodes(recording, stances, p)
    pinned = pin_fixes(fixes, recording.t, nodes, p.walk)
    graph, ties = gtsam.NonlinearFactorGraph(), VelocityTies()
    add_walk(graph, ties, recording, stances, nodes, known, p, progress)
    initial = initial_values(recording, stances, nodes, start.nav_R_body, known.gyro_bias, p.gravity)
    told = Native(gauge(start.nav_R_body, p.gauge_sigma, p))
    reason = unusable(field, p.magnetic)
    near_enough = p.convergence if reason else p.magnetic.first_convergence
    solved = solve(graph, [ties, told], initial, time_order(nodes), near_enough, p.largest_steps)
    freed = free_heading(pinned, heading is not None, solved.values, nodes, p)
    if freed is not None:
        told = Native(gauge(freed.turn @ start.nav_R_body, freed.sigma, p))
    believed = walk_ties(nodes, solved.values, p.walk, *([pinned.factors()] if fixes else []))
    if believed.parts:
        parts: list[Part] = [ties, told, *believed.parts]
        ordering = believed.ordering(time_order(nodes))
        solved = solve(graph, parts, solved.values, ordering, near_enough, p.largest_steps)

    def minimise(part: Part, values: gtsam.Values, ordering: gtsam.Ordering, begun: Begun | None) -> Solved:
        began_there = told if begun is None else Native(gauge_of(begun.nav_R_body, begun.free, p))
        parts: list[Part] = [ties, began_there, part, *believed.parts]
        return solve(graph, parts, values, believed.ordering(ordering), p.convergence, p.largest_steps)

    verdict = FieldVerdict((UNKNOWN,) * len(nodes.result), (reason,) * len(nodes.result), ())
    if field is not None and not reason:
        known_north = heading is not None or freed is not None
        problem = FieldProblem(recording, nodes, field, known_north, p.gravity, minimise)
        solved, verdict = solve_with_field(problem, solved, p.magnetic)
    position, velocity, nav_R_body = trajectory_of(recording, nodes, solved.values, p.gravity)
    tails = hold_tails(recording.t, stances, position, velocity)
    table = _table(recording.t, nodes, solved, verdict)
    if progress is not None:
        progress(1.0)
    return Solution(
        method="smoother",
        t=recording.t,
        position=position,
        velocity=velocity,
        nav_R_body=nav_R_body,
        stances=table,
        runtime_s=perf_counter() - began,
        parameters=asdict(p),
        notes=(*known.notes, f"solved in {counted(solved.steps, 'Gauss-Newton step')}", *verdict.notes, *tails),
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


def add_walk(
    graph: gtsam.NonlinearFactorGraph,
    ties: VelocityTies,
    recording: Recording,
    stances: Stances,
    nodes: Nodes,
    known: Known,
    p: SmootherParameters,
    progress: Callable[[float], None] | None = None,
) -> None:
    """Turn a whole walk into factors: its start, and its strides one after the other."""
    bias = gtsam.imuBias.ConstantBias(np.zeros(3), known.gyro_bias)
    measurements = preintegrate(recording, nodes.sample, bias, p, progress)
    add_start(graph, known.gyro_bias_sigma, p)
    lever = known.lever.lever
    for stride in strides_of(recording, stances, nodes, measurements, known.gyro_bias, lever, known.rests, p):
        add_stride(graph, ties, stride, p)


def _table(t: Floats, nodes: Nodes, solved: Solved, verdict: FieldVerdict) -> StanceTable:
    """Poses, biases and their marginal sigmas at the stillest node of each footfall."""
    pose_keys = [X(j) for j in nodes.result]
    bias_keys = [B(k) for k in nodes.bias]
    covariance = marginal_covariances(solved.tree, {*pose_keys, *bias_keys})
    poses = [solved.values.atPose3(key) for key in pose_keys]
    attitude = np.array([pose.rotation().matrix() for pose in poses])
    body = np.array([covariance[key] for key in pose_keys])
    position = np.array([pose.translation() for pose in poses])
    pose_cov = in_nav(attitude, body) + turned_about_start(position, verdict.north_sigma)
    bias_variance = np.array([np.diagonal(covariance[key]) for key in bias_keys])
    sample = nodes.sample[nodes.result]
    return StanceTable(
        sample=sample,
        t=t[sample],
        position=position,
        nav_R_body=attitude,
        gyro_bias=np.array([solved.values.atConstantBias(key).gyroscope() for key in bias_keys]),
        position_cov=pose_cov[:, :3, :3],
        heading_sigma=np.sqrt(pose_cov[:, 3, 3]),
        gyro_bias_sigma=np.sqrt(bias_variance[:, 3:]),
        field=verdict.words,
        field_reason=verdict.reason,
        pose_cov=pose_cov,
    )
