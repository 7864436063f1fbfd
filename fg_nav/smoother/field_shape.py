"""Does the field refute the shape that a walk has without it? If not, the walk keeps it, and the field shows north.

Line integrals and compass know a heading to some tenths of a degree over a leg of a short walk. So does a gyroscope
whose bias a rest has shown, where the foot stood still, and nothing says so: what is assumed of a rest (a foot that
sways) and of a swing is what may be. Weighed by such sigmas the field would bend a walk that is better than they claim.
Whether it knows better, it has to show itself. With psi_k the heading of footfall k and psi'_k that without the field,

    E_1 = min E,     E_0 = min E with psi_k = psi'_k + c at all footfalls,     c one unknown turn,

E half the sum of squares of the walk with its field, E_0 - E_1 is the logarithm of the likelihood ratio. Where the
shape is right it is half a chi^2 of as many degrees of freedom as there are bends that the field can see, two to six.
Below `MOST_NATS` the shape stands. Tilt, biases and the state of the field stay free in both.

    E_0 is linear about the minimum: one more elimination, with the row psi_k - c at each footfall, c eliminated last.
"""

from __future__ import annotations

from dataclasses import replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import X, Z

from fg_nav.factors.residual import Stack
from fg_nav.factors.rotation import turn_about_up
from fg_nav.smoother.evidence import MOST_NATS
from fg_nav.smoother.field_rounds import FieldSolution, FieldWalk, solve_for_north, solve_with_field
from fg_nav.smoother.floors import count_floors
from fg_nav.smoother.linear import LinearWalk
from fg_nav.smoother.solver import compute_error, compute_excess, list_attitudes, list_in_time, stack_walk

SHAPE_SIGMA_DEG = 0.1
"""Within which a footfall has the heading that it has without the field: of a still rest and a good gyroscope."""


def solve_where_field_tells(walk: FieldWalk, without: gtsam.Values) -> FieldSolution:
    """Smooth a walk with its field; `without` is its minimum without."""
    found, problem = solve_with_field(walk), walk.problem
    # Without a rest the shape is not known; with a heading that is given the direction of the field is looked for.
    if not problem.known.rests or problem.heading_known:
        return found
    # Is a walk of the shape without the field less likely?
    nats = refute_shape(found, without)
    if nats > MOST_NATS:
        return found
    # It is not: the field shows north.
    del found
    kept = solve_for_north(walk)
    note = (
        f"the path keeps the shape that it has without the field, which shows north alone: it speaks against that "
        f"shape by {nats:.1f} nats, and {MOST_NATS:.0f} are asked for"
    )
    return replace(kept, verdict=replace(kept.verdict, notes=(*kept.verdict.notes, note)))


def refute_shape(found: FieldSolution, without: gtsam.Values) -> float:
    """By how many nats a walk with its field is less likely with the headings that it has without it."""
    problem, values = found.problem, found.solved.values
    node, common = problem.nodes.result.tolist(), Z(count_floors(problem.floor))
    nav_R_body, held = (list_attitudes(node, some) for some in (values, without))
    turn = np.unwrap(turn_about_up(nav_R_body @ np.swapaxes(held, -1, -2)))
    rows = np.zeros((len(node), 1, 8))
    rows[:, 0, :3], rows[:, 0, 6], rows[:, 0, 7] = nav_R_body[:, 2], -1.0, np.median(turn) - turn
    shape = Stack(np.array([(X(j), common) for j in node], dtype=np.uint64), rows / np.radians(SHAPE_SIGMA_DEG))
    keys = list_in_time(problem.nodes, with_field=True, floor=problem.floor)
    stacks = [*stack_walk(problem.graph, problem.blocks, values), shape]
    walk = LinearWalk.of(stacks, np.append(keys, np.uint64(common)))
    del stacks
    without_shape = compute_error(problem.graph, problem.blocks, values) - compute_excess(problem.blocks, values)
    return walk.eliminate_all().error - without_shape
