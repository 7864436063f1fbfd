"""The scheduled batch re-solve of a walk in progress, which hands all of it to a graph that goes on from there.

Lever, swing noise, the bias to linearize at, its random walk, and the roughness of the field are estimated on the walk.
In its first minutes they still change by much, so at the footfalls `RESOLVE_AT` the batch's own functions estimate them
again on what there is, and the graph is built again around the batch's solution. From the last of these on they stay.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import gtsam

from fg_nav.arrays import Bools
from fg_nav.errors import MagneticError
from fg_nav.magnetic import FootfallField, average_footfall_field
from fg_nav.online.field import OnlineField
from fg_nav.recording import Recording
from fg_nav.smoother.bias_prior import find_bias_prior
from fg_nav.smoother.field import FieldVerdict
from fg_nav.smoother.graph import Known, WalkProblem
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.smoother.problem import walk_problem
from fg_nav.smoother.solved_walk import solve_walk
from fg_nav.smoother.solver import Solved
from fg_nav.smoother.strides import Nodes
from fg_nav.stances import Stances

RESOLVE_AT = (
    *(1, 2, 3, 4, 6, 8, 10, 13, 16, 19, 23, 27, 32, 38, 45, 54, 64, 76, 91, 108, 128, 152, 181, 215, 256),
    *(362, 512, 724, 1024, 1448),
)
"""Footfalls at which a walk is solved again. At 512 its lever is known to a few millimetres; how rough the field is and
with it how far each compass reading pulls, still changes. While that takes less than a second each has a fifth more
than the one before, then half as much again, until half of the graph leaves (`isam2.MOST_FOOTFALLS`)."""

LAST_WITH_LAG = 512
"""With a lag the samples of a walk are discarded once it is not solved again any more."""


@dataclass(frozen=True)
class WalkSolution:
    """A walk solved so far.

    Attributes
    ----------
    problem : of the walk, with its field where that is used.
    values : of all variables at its minimum.
    field : to go on with; None where it is not used.
    verdict : on the field at all footfalls.
    """

    problem: WalkProblem
    values: gtsam.Values
    field: OnlineField | None
    verdict: FieldVerdict

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


def solve_so_far(
    recording: Recording,
    stances: Stances,
    heading: float | None,
    use_field: bool,
    p: SmootherParameters,
    continues: Bools | None = None,
) -> WalkSolution:
    """Solve a walk so far.

    Parameters
    ----------
    continues : (F,) which footfalls are further pieces of a standing: on the same spot each has the deviation of the
        first, so the field there counts once. None where there is none.

    Raises
    ------
    EstimationError
        Where the batch smoother does.
    """
    field, unseen = measure_walk_field(recording, stances, heading, use_field)
    field = field if field is None or continues is None else field.leave_out(continues)
    solution, solved = _solve_once(recording, stances, heading, field, unseen, p)
    # As in batch: a bias that is too large for its prior is that of a sensor that was not calibrated.
    prior = find_bias_prior(solution.problem, solved)
    if prior is None:
        return solution
    p = replace(p, gyro_bias_sigma_deg_s=prior.sigma_deg_s)
    solution = _solve_once(recording, stances, heading, field, unseen, p)[0]
    return replace(solution, verdict=replace(solution.verdict, notes=(prior.note, *solution.verdict.notes)))


def _solve_once(
    recording: Recording,
    stances: Stances,
    heading: float | None,
    field: FootfallField | None,
    unseen: str,
    p: SmootherParameters,
) -> tuple[WalkSolution, Solved]:
    found = solve_walk(walk_problem(recording, stances, heading, p, in_progress=True), field, unseen)
    going_on = None if found.field is None or field is None else OnlineField(found.field, field)
    return WalkSolution(found.problem, found.solved.values, going_on, found.verdict), found.solved


def measure_walk_field(
    recording: Recording, stances: Stances, heading: float | None, use_field: bool
) -> tuple[FootfallField | None, str]:
    """Field at the footfalls, or None and, where it was looked for, why it was not seen."""
    if not use_field or recording.mag is None:
        return None, ""
    try:
        return average_footfall_field(recording, stances, heading or 0.0), ""
    except MagneticError as error:
        return None, str(error)
