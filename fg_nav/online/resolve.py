"""Solution of a whole walk in progress, by the functions of the batch, and the anchor state that follows from it.

Lever, swing noise, the bias to linearize at, its random walk, the height of clipped peaks, delay and iron of the
magnetometer and the roughness of the field are estimated on the walk, level floors are recognized, and stances that
contradict it get a larger sigma. Of the position fixes those are used whose time has come (`smoother.constraints`):
where they show the heading better than it is known, the walk is turned to them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fg_nav.arrays import Bools
from fg_nav.calibration.magnetometer import MagnetometerCalibration
from fg_nav.calibration.walk import average_corrected_field, find_own_iron
from fg_nav.errors import MagneticError
from fg_nav.magnetic import FootfallField
from fg_nav.online.anchor import AnchorState, MarginalPrior, Past, PathNodes, marginalize
from fg_nav.online.buffer import PartialWalk
from fg_nav.online.estimates import list_estimates
from fg_nav.online.field import BiasLedger, CompassVerdict, OnlineField
from fg_nav.online.floor_number import track_floors
from fg_nav.online.options import OnlineOptions
from fg_nav.online.strides import RestLedger, StanceNodes, list_stances, list_variables, result_keys
from fg_nav.recording import Recording
from fg_nav.smoother.batch import InProgress, WalkInput, fit_walk
from fg_nav.smoother.field import FieldSolution, FieldVerdict
from fg_nav.smoother.graph import WalkProblem, count_factors, order_variables
from fg_nav.smoother.solver import Solved, list_positions
from fg_nav.solution import Return
from fg_nav.stances import Stances


@dataclass(frozen=True)
class WalkSolution:
    """A walk solved so far."""

    problem: WalkProblem  # With the field where that is used.
    solved: Solved  # Its minimum.
    field: OnlineField | None  # None where the field is not used.
    verdict: FieldVerdict  # On the field at all footfalls.
    returns: tuple[Return, ...]  # Stretches walked before.
    iron: MagnetometerCalibration | None  # By the walk itself; None where it shows none, or a calibration was given.
    solved_field: tuple[FieldSolution, FootfallField] | None = None  # Of the field, with the field at the footfalls.

    @property
    def stances(self) -> list[StanceNodes]:
        """Its footfalls."""
        return list_stances(self.problem.nodes, self.problem.recording.t)


def solve_from_start(walk: PartialWalk, options: OnlineOptions, has_ended: bool = False) -> AnchorState:
    """Solve the whole walk; return the anchor state at its newest footfall. Raises `UNSOLVED` without a solution."""
    found = solve_alone(walk, options, has_ended)
    return build_anchor(walk, options, found, marginalize_at(found, found.stances[-1]))


def solve_alone(walk: PartialWalk, options: OnlineOptions, has_ended: bool = False) -> WalkSolution:
    """Return the solution of a walk; note its clipped peaks' height and its iron in `walk.sensor`."""
    walk.align_magnetometer()
    recording, stances = walk.cut_whole(), walk.cut_stances(0, 0)
    found = solve_so_far(recording, stances, options, walk.continues, has_ended)
    walk.sensor = replace(walk.sensor, peak_height=found.problem.known.peak_height, iron=found.iron)
    return found


def build_anchor(walk: PartialWalk, options: OnlineOptions, found: WalkSolution, prior: MarginalPrior) -> AnchorState:
    """Return the anchor state of a solved walk at its newest footfall, whose marginal prior is given."""
    problem, values, stances = found.problem, found.solved.values, found.stances
    known, magnetometer = problem.known, walk.sensor.magnetometer
    verdicts = [
        CompassVerdict(*one)
        for one in zip(found.verdict.words, found.verdict.reason, found.verdict.compass_weight.tolist(), strict=True)
    ]
    covariances = found.solved.root.covariances(result_keys(stances))
    shared = problem.parameters.moving_foot, problem.barometer is not None
    rows = list_estimates(stances, verdicts, values, covariances, *shared)
    heights = np.asarray(list_positions(problem.nodes.result, values)[:, 2])
    longest_rest = max(known.rests, key=lambda rest: rest.stop - rest.start, default=None)
    return AnchorState(
        stance=stances[-1],
        verdict=verdicts[-1],
        prior=prior,
        past=Past(0, tuple(rows[:-1]), PathNodes.from_values(stances[:-1], values)),
        first=0,
        footfalls=walk.footfalls_since(0),
        t_first=stances[0].t,
        known=known,
        parameters=problem.parameters,
        field=found.field,
        barometer=None if problem.barometer is None else problem.barometer.barometer,
        rests=RestLedger(longest_rest, known.rests[-1] if known.rests else None),
        biases=BiasLedger.from_factors(problem.differential),
        sensor=walk.sensor,
        counts=dict(count_factors(problem)),
        fixes=options.fixes,
        floors=track_floors(heights, problem.floor, walk.continues),
        heading_known=problem.heading_known,
        returns=found.returns,
        notes=(*known.notes, *found.verdict.notes, *(() if magnetometer is None else magnetometer.notes)),
    )


def marginalize_at(found: WalkSolution, stance: StanceNodes) -> MarginalPrior:
    """Return the marginal prior on the variables of a footfall, from the whole solved walk."""
    problem, values = found.problem, found.solved.values
    linear = problem.system.linearize(values)
    order, keep = order_variables(problem), list_variables(stance, values)
    return marginalize(linear, values, keep, [key for key in order.tolist() if key not in set(keep)])


def solve_so_far(
    recording: Recording,
    stances: Stances,
    options: OnlineOptions,
    continues: Bools | None = None,
    has_ended: bool = False,
) -> WalkSolution:
    """Solve a walk so far.

    Raises `EstimationError` where the batch smoother does.

    Parameters
    ----------
    recording : with the magnetometer as it measures, unless a calibration is among the options.
    options : of the fixes those are used that the walk has come to.
    continues : (F,) which footfalls are further pieces of a standing: on the same spot each has the deviation of the
        first, so the field there counts once. None where there is none.
    has_ended : whether no samples follow: then a standing at the end is a rest.
    """
    # The field at the footfalls, once for each standing.
    standings = stances
    if continues is not None:
        standings = replace(stances, footfall=(np.cumsum(~continues) - 1)[stances.footfall])
    measured = measure_walk_field(recording, stances, options, standings)
    recording, field = measured.recording, measured.field
    field = field if field is None or continues is None else field.leave_out(continues)
    # The walk, by the recipe of the batch.
    so_far = InProgress(continues, measured.unseen, has_ended)
    given = WalkInput(recording, stances, options.heading_rad, field, options.parameters, fixes=options.fixes)
    found = fit_walk(replace(given, in_progress=so_far)).walk
    solved_field = None if found.field is None or field is None else (found.field, field)
    online_field = None if solved_field is None else OnlineField(*solved_field)
    verdict = replace(found.verdict, notes=(*measured.notes, *found.verdict.notes))
    return WalkSolution(found.problem, found.solved, online_field, verdict, found.returns, measured.iron, solved_field)


@dataclass(frozen=True)
class MeasuredField:
    """The field of a walk, as it is measured."""

    recording: Recording  # With the magnetometer corrected.
    field: FootfallField | None = None  # None where it is not used, or not measured.
    unseen: str = ""  # Why it was not measured, though it was to be used.
    iron: MagnetometerCalibration | None = None  # As in `WalkSolution`.
    notes: tuple[str, ...] = ()  # How the magnetometer was corrected.


def measure_walk_field(
    recording: Recording, stances: Stances, options: OnlineOptions, standings: Stances | None = None
) -> MeasuredField:
    """Return the field at the footfalls as in batch; `standings` are the stances for the iron, None for the same."""
    if not options.use_field or recording.mag is None:
        return MeasuredField(recording)
    iron, notes = None, tuple[str, ...]()
    try:
        if options.calibration is None:
            iron, note = find_own_iron(recording, stances if standings is None else standings)
            recording, notes = recording if iron is None else iron.apply_to(recording), (note,)
        calibration = iron if options.calibration is None else options.calibration
        field = average_corrected_field(recording, stances, options.heading_rad or 0.0, calibration)
        return MeasuredField(recording, field, iron=iron, notes=notes)
    except MagneticError as error:
        return MeasuredField(recording, unseen=str(error), iron=iron, notes=notes)
