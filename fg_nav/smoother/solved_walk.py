"""A walk as it was solved last, in batch and online: with field, directions of a building and places that it shows."""

from __future__ import annotations

from dataclasses import dataclass, replace

from fg_nav.magnetic import FootfallField
from fg_nav.smoother.differential import add_differential_field
from fg_nav.smoother.directions import follow_directions
from fg_nav.smoother.field import FieldVerdict, find_obstacle, ignore_field
from fg_nav.smoother.field_rounds import FieldSolution, sample_field, solve_with_field
from fg_nav.smoother.graph import WalkProblem, solve, trajectory_of
from fg_nav.smoother.places import tie_places
from fg_nav.smoother.solver import Solved
from fg_nav.solution import Return


@dataclass(frozen=True)
class SolvedWalk:
    """The problem of the last solution, its minimum, verdict on the field, `field` where that was used, `returns`."""

    problem: WalkProblem
    solved: Solved
    verdict: FieldVerdict
    field: FieldSolution | None = None
    returns: tuple[Return, ...] = ()


def solve_walk(problem: WalkProblem, field: FootfallField | None, unseen: str = "") -> SolvedWalk:
    """Solve a walk as `_solve_with_field`, along a building where asked for, and close it at places the field shows."""
    walk = _solve_with_field(problem, field, unseen)
    # The field settles which direction is which, and the path along them where places are looked for.
    problem, solved, notes = follow_directions(walk.problem, walk.solved)
    verdict = replace(walk.verdict, notes=(*walk.verdict.notes, *notes))
    walk = replace(walk, problem=problem, solved=solved, verdict=verdict)
    if field is None:
        return walk
    problem, solved, returns, notes = tie_places(walk.problem, walk.solved)
    verdict = replace(walk.verdict, notes=(*walk.verdict.notes, *notes))
    return replace(walk, problem=problem, solved=solved, verdict=verdict, returns=returns)


def _solve_with_field(problem: WalkProblem, field: FootfallField | None, unseen: str = "") -> SolvedWalk:
    """Solve a walk, whose values are near its minimum without the field; `unseen` says why there is no field."""
    obstacle = unseen or find_obstacle(field, problem.parameters.magnetic)
    if field is None:
        return SolvedWalk(problem, solve(problem), ignore_field(problem, obstacle))
    # While the foot stands the field shows the gyro bias, also where it shows no heading.
    track = trajectory_of(problem.recording, problem.nodes, problem.values, problem.parameters.gravity)
    problem = add_differential_field(problem, problem.values, track)
    problem.recording.release()
    # The field is compared along the solution, and joins it.
    if obstacle:
        del track
        return SolvedWalk(problem, solve(problem), ignore_field(problem, obstacle))
    walk = sample_field(problem, field, track)
    del track  # as large as the recording
    found = solve_with_field(walk)
    return SolvedWalk(found.problem, found.solved, found.verdict, found)
