"""A walk in progress, solved as a whole: the batch's own functions on all there is, and what that hands over.

Lever, swing noise, the bias to linearize at, its random walk, the height of clipped peaks, delay and iron of the
magnetometer and the roughness of the field are estimated on the walk, level floors are recognized, and stances that it
refuses are trusted less.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.calibration.magnetometer import MagnetometerCalibration
from fg_nav.calibration.walk_field import average_corrected_field, find_own_iron
from fg_nav.errors import MagneticError
from fg_nav.magnetic import FootfallField
from fg_nav.online.anchor import MarginalPrior, marginalize
from fg_nav.online.buffer import PartialWalk
from fg_nav.online.differential import BiasLedger
from fg_nav.online.estimates import EstimateRow, list_estimates
from fg_nav.online.field import OnlineField, Verdict
from fg_nav.online.fixes import add_fixes_so_far
from fg_nav.online.floor_number import track_floors
from fg_nav.online.graph_parts import list_variables, result_keys
from fg_nav.online.handover import Handover, Past
from fg_nav.online.options import OnlineOptions
from fg_nav.online.path import nodes_of_places
from fg_nav.online.strides import Place, RestLedger, list_places
from fg_nav.recording import Recording
from fg_nav.smoother.batch import solve_walk, widen_bias_prior
from fg_nav.smoother.constraints import add_constraints
from fg_nav.smoother.field import FieldSolution, FieldVerdict
from fg_nav.smoother.graph import Known, WalkProblem, count_factors, order_variables
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.smoother.problem import walk_problem
from fg_nav.smoother.solver import Solved, linearize, list_positions
from fg_nav.smoother.strides import Nodes
from fg_nav.solution import Return
from fg_nav.stances import Stances


@dataclass(frozen=True)
class WalkSolution:
    """A walk solved so far.

    Attributes
    ----------
    problem : of the walk, with its field where that is used.
    solved : its minimum.
    field : to go on with; None where it is not used.
    verdict : on the field at all footfalls.
    returns : stretches at which the walk was before.
    iron : of the magnetometer, by the walk itself; None where it shows none, or a calibration was given.
    shown : the solution of the field, and the field at the footfalls; None where it is not used.
    """

    problem: WalkProblem
    solved: Solved
    field: OnlineField | None
    verdict: FieldVerdict
    returns: tuple[Return, ...]
    iron: MagnetometerCalibration | None
    shown: tuple[FieldSolution, FootfallField] | None = None

    @property
    def known(self) -> Known:
        """What is known of sensor and mounting."""
        return self.problem.known

    @property
    def parameters(self) -> SmootherParameters:
        """With swing noise and bias walk that were chosen."""
        return self.problem.parameters

    @property
    def nodes(self) -> Nodes:
        """Of the walk."""
        return self.problem.nodes

    @property
    def newest(self) -> Place:
        """Its newest footfall."""
        return list_places(self.nodes, self.problem.recording.t)[-1]


def solve_from_start(walk: PartialWalk, options: OnlineOptions, has_ended: bool = False) -> Handover:
    """Solve a walk with all its footfalls and samples; raises what `UNSOLVED` has where there is no solution."""
    found = solve_alone(walk, options, has_ended)
    return hand_over_solution(walk, options, found, condense_at(found, found.newest))


def solve_alone(walk: PartialWalk, options: OnlineOptions, has_ended: bool = False) -> WalkSolution:
    """Solve a walk with all that it shows of its sensor, which is noted in it."""
    walk.align_magnetometer()
    recording, stances = walk.cut_whole(), walk.cut_stances(0, 0)
    found = solve_so_far(recording, stances, options, walk.continues, has_ended)
    walk.sensor = replace(walk.sensor, peak_height=found.known.peak_height, iron=found.iron)
    return found


def hand_over_solution(
    walk: PartialWalk, options: OnlineOptions, found: WalkSolution, anchor: MarginalPrior
) -> Handover:
    """Return what a solved walk leaves at its newest footfall, of which the anchor says all that is known."""
    places = list_places(found.nodes, found.problem.recording.t)
    problem, magnetometer = found.problem, walk.sensor.magnetometer
    return Handover(
        place=places[-1],
        verdict=_list_verdicts(found)[-1],
        anchor=anchor,
        past=Past(0, _list_rows(found, places)[:-1], nodes_of_places(places[:-1], found.solved.values)),
        first=0,
        footfalls=walk.footfalls_since(0),
        t_first=places[0].t,
        known=found.known,
        parameters=found.parameters,
        field=found.field,
        barometer=None if problem.barometer is None else problem.barometer.barometer,
        rests=RestLedger.from_rests(found.known.rests),
        biases=BiasLedger.from_factors(problem.differential),
        sensor=walk.sensor,
        counts=dict(count_factors(problem)),
        fixes=options.fixes,
        floors=track_floors(_list_heights(found), problem.floor, walk.continues),
        heading_known=problem.heading_known,
        returns=found.returns,
        notes=(*found.known.notes, *found.verdict.notes, *(() if magnetometer is None else magnetometer.notes)),
    )


def condense_at(found: WalkSolution, place: Place) -> MarginalPrior:
    """Condense a solved walk to what it says of a footfall."""
    problem, values = found.problem, found.solved.values
    linear = linearize(problem.graph, problem.blocks, values)
    order, keep = order_variables(problem), list_variables(place, values)
    return marginalize(linear, values, keep, [key for key in order.tolist() if key not in set(keep)])


def _list_heights(found: WalkSolution) -> Floats:
    """Heights (F,) m of all footfalls."""
    return np.asarray(list_positions(found.nodes.result, found.solved.values)[:, 2])


def _list_rows(found: WalkSolution, places: list[Place]) -> tuple[EstimateRow, ...]:
    """Estimates of all footfalls."""
    values, covariances = found.solved.values, found.solved.root.covariances(result_keys(places))
    shared = found.parameters.moving_foot, found.problem.barometer is not None
    return tuple(list_estimates(places, _list_verdicts(found), values, covariances, *shared))


def _list_verdicts(found: WalkSolution) -> list[Verdict]:
    """Verdicts on the field at all footfalls."""
    verdict = found.verdict
    weight = verdict.compass_weight.tolist()
    return [Verdict(*one) for one in zip(verdict.words, verdict.reason, weight, strict=True)]


def solve_so_far(
    recording: Recording,
    stances: Stances,
    options: OnlineOptions,
    continues: Bools | None = None,
    has_ended: bool = False,
) -> WalkSolution:
    """Solve a walk so far.

    Parameters
    ----------
    recording : with the magnetometer as it measures, unless a calibration is among the options.
    options : of the fixes those are used that the walk has come to.
    continues : (F,) which footfalls are further pieces of a standing: on the same spot each has the deviation of the
        first, so the field there counts once. None where there is none.
    has_ended : whether nothing follows: then who stands at the end rests.

    Raises
    ------
    EstimationError
        Where the batch smoother does.
    """
    standings = stances
    if continues is not None:
        standings = replace(stances, footfall=(np.cumsum(~continues) - 1)[stances.footfall])
    seen = measure_walk_field(recording, stances, options, standings)
    field = seen.field if seen.field is None or continues is None else seen.field.leave_out(continues)
    problem = walk_problem(seen.recording, stances, options.heading_rad, options.parameters, in_progress=not has_ended)
    problem = add_fixes_so_far(problem, options.fixes)
    problem = add_constraints(problem, problem.values, continues)
    found = widen_bias_prior(solve_walk(problem, field, seen.unseen))
    shown = None if found.field is None or field is None else (found.field, field)
    going_on = None if shown is None else OnlineField(*shown)
    verdict = replace(found.verdict, notes=(*seen.notes, *found.verdict.notes))
    return WalkSolution(found.problem, found.solved, going_on, verdict, found.returns, seen.iron, shown)


@dataclass(frozen=True)
class SeenField:
    """The field of a walk.

    Attributes
    ----------
    recording : with the magnetometer corrected.
    field : at the footfalls; None where it is not used, or not seen.
    unseen : why it was not seen, where it was looked for.
    iron : by which the walk itself corrected the recording; None where it shows none, or a calibration was given.
    notes : how the magnetometer was corrected.
    """

    recording: Recording
    field: FootfallField | None = None
    unseen: str = ""
    iron: MagnetometerCalibration | None = None
    notes: tuple[str, ...] = ()


def measure_walk_field(
    recording: Recording, stances: Stances, options: OnlineOptions, standings: Stances | None = None
) -> SeenField:
    """Measure the field at the footfalls as the batch does; `standings` are its stances, where they are others."""
    if not options.use_field or recording.mag is None:
        return SeenField(recording)
    iron, notes = None, tuple[str, ...]()
    try:
        if options.calibration is None:
            iron, note = find_own_iron(recording, stances if standings is None else standings)
            recording, notes = recording if iron is None else iron.apply_to(recording), (note,)
        calibration = iron if options.calibration is None else options.calibration
        field = average_corrected_field(recording, stances, options.heading_rad or 0.0, calibration)
        return SeenField(recording, field, iron=iron, notes=notes)
    except MagneticError as error:
        return SeenField(recording, unseen=str(error), iron=iron, notes=notes)
