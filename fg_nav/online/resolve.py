"""Solving a walk so far anew, in batch, and handing all of it to a graph that goes on from there.

Lever, swing noise, the bias to linearise at, and the roughness of the field are told by the walk. In its first minutes
they still change by much, so at the footfalls `WARM_UPS` the batch's own functions estimate them again on what there
is, and the graph is built anew around the batch's solution. From the last of these on they stay.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import M, X

from fg_nav.arrays import Floats
from fg_nav.detection import Rest
from fg_nav.errors import MagneticError
from fg_nav.magnetic import FootfallField, average_footfall_field
from fg_nav.magnetic.quasi_static import UNKNOWN
from fg_nav.online.field import OnlineField, field_factors, turned
from fg_nav.online.ties import GraphTies
from fg_nav.recording import Recording
from fg_nav.smoother.batch import add_walk
from fg_nav.smoother.field_rounds import Begun, FieldProblem, FieldVerdict, solve_with_field, unusable
from fg_nav.smoother.field_state import E_H, FieldTies
from fg_nav.smoother.initial import initial_values
from fg_nav.smoother.known import Known, known_before
from fg_nav.smoother.nodes import Nodes, place_nodes
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.smoother.solver import Native, Part, Solved, solve, time_order
from fg_nav.smoother.strides import gauge, gauge_of
from fg_nav.stances import Stances
from fg_nav.start import starting_point

WARM_UPS = (
    *(1, 2, 3, 4, 6, 8, 10, 13, 16, 19, 23, 27, 32, 38, 45, 54, 64, 76, 91, 108, 128, 152, 181, 215, 256),
    *(362, 512, 724, 1024, 1448),
)
"""Footfalls at which a walk is solved anew. At 512 it knows its lever to a few millimetres; how rough the field is, and
with it how far each compass reading pulls, still changes. While that takes less than a second each has a fifth more
than the one before, then half as much again, until half of the graph leaves (`online_graph.MOST_FOOTFALLS`)."""

LAST_WITH_LAG = 512
"""With a lag the samples of a walk are forgotten once it is not solved anew any more."""


@dataclass(frozen=True)
class Warm:
    """A walk solved so far.

    Attributes
    ----------
    known, parameters : of sensor and mounting; with the swing noise that was chosen.
    nodes : of the walk.
    graph : all factors, one by one; `values` of all variables at its minimum.
    field : to go on with; None where it is not used.
    verdict : on the field at all footfalls.
    """

    known: Known
    parameters: SmootherParameters
    nodes: Nodes
    graph: gtsam.NonlinearFactorGraph
    values: gtsam.Values
    field: OnlineField | None
    verdict: FieldVerdict


@dataclass
class _Rounds:
    """What the field's last round was solved with: its ties, and at which heading the walk began."""

    ties: FieldTies | None = None
    begun: Begun | None = None
    start: Floats | None = None


def solve_so_far(
    recording: Recording,
    stances: Stances,
    heading: float | None,
    use_field: bool,
    p: SmootherParameters,
) -> Warm:
    """Solve a walk so far.

    Raises
    ------
    EstimationError
        Where the batch smoother does.
    """
    start = starting_point(recording, stances, heading or 0.0, p.rest)
    rests = whole_rests(start.rests, recording, p)
    known = known_before(recording, stances, rests, p)
    p = replace(p, gyr_relative_density=known.swing.gyr_relative_density)
    nodes = place_nodes(recording, stances, p)
    graph, of_ties = gtsam.NonlinearFactorGraph(), gtsam.NonlinearFactorGraph()
    ties = GraphTies(of_ties)
    add_walk(graph, ties, recording, stances, nodes, known, p)
    told = gauge(start.nav_R_body, p.gauge_sigma, p)
    initial = initial_values(recording, stances, nodes, start.nav_R_body, known.gyro_bias, p.gravity)
    solved = solve(graph, [ties, Native(told)], initial, time_order(nodes), p.convergence, p.largest_steps)
    field, reason = _field(recording, stances, heading, use_field, p)
    went = _Rounds()
    verdict = FieldVerdict((UNKNOWN,) * len(nodes.result), (reason,) * len(nodes.result), ())
    if field is not None:
        minimise = _minimiser(graph, ties, told, went, p)
        problem = FieldProblem(recording, nodes, field, heading is not None, p.gravity, minimise)
        solved, verdict = solve_with_field(problem, solved, p.magnetic)
    graph.push_back(of_ties)
    online_field = _hand_over(graph, solved, nodes, field, went, told, p)
    return Warm(known, p, nodes, graph, solved.values, online_field, verdict)


def whole_rests(rests: tuple[Rest, ...], recording: Recording, p: SmootherParameters) -> tuple[Rest, ...]:
    """Leave out what is a rest only if the recording ends there: a walk in progress does not."""
    first = recording.t[0] + 1.0
    return tuple(
        rest for rest in rests if rest.lasts(recording.period_s, p.rest.shortest_s) or recording.t[rest.start] < first
    )


def _field(
    recording: Recording, stances: Stances, heading: float | None, use_field: bool, p: SmootherParameters
) -> tuple[FootfallField | None, str]:
    """Field at the footfalls, or why it is not used."""
    field, unseen = field_seen(recording, stances, heading, use_field)
    reason = unseen or unusable(field, p.magnetic)
    return (None if reason else field), reason


def field_seen(
    recording: Recording, stances: Stances, heading: float | None, use_field: bool
) -> tuple[FootfallField | None, str]:
    """Field at the footfalls, or None and, where it was looked for, why it was not seen."""
    if not use_field or recording.mag is None:
        return None, ""
    try:
        return average_footfall_field(recording, stances, heading or 0.0), ""
    except MagneticError as error:
        return None, str(error)


def _minimiser(
    graph: gtsam.NonlinearFactorGraph,
    ties: GraphTies,
    told: gtsam.PriorFactorPose3,
    went: _Rounds,
    p: SmootherParameters,
) -> Callable[[Part, gtsam.Values, gtsam.Ordering, Begun | None], Solved]:
    def minimise(part: Part, values: gtsam.Values, ordering: gtsam.Ordering, begun: Begun | None) -> Solved:
        began = told if begun is None else gauge_of(begun.nav_R_body, begun.free, p)
        solved = solve(graph, [ties, Native(began), part], values, ordering, p.convergence, p.largest_steps)
        assert isinstance(part, FieldTies)
        went.ties, went.begun, went.start = part, begun, solved.values.atPose3(X(0)).rotation().matrix()
        return solved

    return minimise


def _hand_over(
    graph: gtsam.NonlinearFactorGraph,
    solved: Solved,
    nodes: Nodes,
    field: FootfallField | None,
    went: _Rounds,
    told: gtsam.PriorFactorPose3,
    p: SmootherParameters,
) -> OnlineField | None:
    """Add gauge and field to the graph, turned as the walk was turned after its last round."""
    if field is None or went.ties is None or went.start is None:
        graph.push_back(told)
        return None
    values, states = solved.values, went.ties.states(solved.values)
    turn = values.atPose3(X(0)).rotation().matrix() @ went.start.T
    states = states.copy()
    states[:, E_H] = states[:, E_H] @ turn[:2, :2].T
    for k, state in enumerate(states):
        values.update(M(k), state)
    began = told if went.begun is None else gauge_of(turn @ went.begun.nav_R_body, went.begun.free, p)
    graph.push_back(began)
    field_factors(graph, went.ties, turned(went.ties.prior, turn))
    attitude = np.array([values.atPose3(X(j)).rotation().matrix() for j in nodes.result.tolist()])
    return OnlineField(went.ties, states, field, attitude, p.magnetic)
