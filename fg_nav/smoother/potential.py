"""Jumps of the field's potential: a path through a circuit of current, a lift, a magnet that is put down.

Without a current the line integrals of the strides add up to the difference of two potentials, which stays within
bounds (`factors.magnetic_field`). A path through a circuit of current I adds mu_0 I = 1.26 uT m for each ampere and
keeps it: one row of the potential, that of stride k, is off by an unknown constant c. Whether it is, its own residual
does not show: the potential's state takes the step up, and what does not fit is spread over the strides that follow. A
robust kernel on the row therefore sees nothing. The likelihood of the whole walk does. With r_k the residual of the
row at the minimum, sigma its noise, J its Jacobian and P the marginal covariance of its variables,

    T_k = r_k^2 / (sigma^2 - J P J^T)        chi^2 of one degree of freedom without a jump

is by how much twice the error falls at the minimum where the row is left out, that is, with c free (a deletion
diagnostic; Cook 1977). It costs one pass down the triangle. At the largest T the rows k-1, k, k+1 are left out, as
the stride that passes the conductor is wrong in its shape too. By how much twice the error then falls follows in the
same way, from all their residuals r, with H = J P J^T by one pass up the tree (`sensitivity`); so does by how much it
rises where rows that are left out come back:

    fall = r^T (I - H)^-1 r,     rise = r^T (I + H)^-1 r,     r and J over sigma.

Where the fall is more than `MIN_FALL` the walk is solved again without them, the jump is kept if twice the error
fell by as much, and the next one is looked for. The roughness of the potential is held meanwhile: measured on a walk
with a jump it swells and hides the jump. Measured without it, it has to confirm it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import EstimationError
from fg_nav.factors.residual import ResidualBlock
from fg_nav.smoother.gauss_newton import CONVERGENCE
from fg_nav.smoother.graph import WalkProblem, solve
from fg_nav.smoother.sensitivity import SharingFactors, shared_information
from fg_nav.smoother.solver import Solved, compute_error, residuals_at_minimum

MIN_STATISTIC = 15.0
"""T below which no row is tried: the largest of clean walks of 500 strides is 1 to 15, of a circuit of 100 A 200."""

MIN_FALL = 25.0
"""Of twice the error, chi^2 of three degrees of freedom: one clean walk of a thousand strides in a hundred. On
simulated ones it falls by 2 to 19, for the roughness is not exactly that of the walk."""

MIN_JUMP_UT_M = 15.0
"""Twelve amperes. Less is in the tails of the potential next to large iron, and its state has room for it."""

MAX_JUMPS = 20  # After so many the walk's field is not one that a potential describes.
MIN_VARIANCE = 1e-9  # Share of a row's noise that the walk leaves open, below which rounding decides.
UT_M_PER_AMPERE = 1.2566  # mu_0, uT m/A.


@dataclass(frozen=True)
class Jump:
    """Of the potential: between footfalls `first` and `last`, by `size_uT_m`."""

    first: int
    last: int
    size_uT_m: float

    def describe(self, t: Floats) -> str:
        """Return one sentence; `t` (F,) s of the footfalls."""
        ampere = self.size_uT_m / UT_M_PER_AMPERE
        return (
            f"the potential jumps by {self.size_uT_m:+.0f} uT m at {t[self.first]:.0f} to {t[self.last]:.0f} s, "
            f"as through a circuit of {abs(ampere):.0f} A: the line integral is not used there"
        )


def free_jumps(problem: WalkProblem, solved: Solved, convergence: float = CONVERGENCE) -> tuple[WalkProblem, Solved]:
    """Leave the line integrals out where the potential jumps, and solve again; a clean walk comes back as it is."""
    # What was a jump at an earlier roughness has to be one at that of the walk without it.
    for stride in _freed_runs(problem):
        if predict_change(problem, solved, stride) >= MIN_FALL:
            continue
        restored = _solve_with(problem, solved, stride, False, convergence)
        if _fall(restored, (problem, solved)) < MIN_FALL:
            problem, solved = restored
    for _ in range(MAX_JUMPS):
        assert problem.field is not None
        # The row without which the error falls most.
        statistic = compute_jump_statistic(problem.field.potential, solved)
        if not len(statistic) or statistic.max() < MIN_STATISTIC:
            break
        # Leave it out with its neighbors; stop where that gains too little.
        stride = problem.field.strides[statistic.argmax()]
        near = np.arange(max(stride - 1, 0), min(stride + 2, len(problem.field.path.u)))
        near = near[np.isfinite(problem.field.path.sigma_uT_m[near])]
        if predict_change(problem, solved, near) < MIN_FALL:
            break
        try:
            freed = _solve_with(problem, solved, near, True, convergence)
        except EstimationError:
            break
        if _fall((problem, solved), freed) < MIN_FALL or abs(_size(*freed, near)) < MIN_JUMP_UT_M:
            break
        problem, solved = freed
    return problem, solved


def _freed_runs(problem: WalkProblem) -> list[Ints]:
    """Strides that were left out, in runs without a gap."""
    assert problem.field is not None
    stride = np.flatnonzero(problem.field.path.jumps)
    return np.split(stride, np.flatnonzero(np.diff(stride) > 1) + 1) if len(stride) else []


def _solve_with(
    problem: WalkProblem, solved: Solved, stride: Ints, jumps: bool, convergence: float
) -> tuple[WalkProblem, Solved]:
    """Solve again with the potential free to jump at these strides, or not."""
    assert problem.field is not None
    changed = replace(problem, field=problem.field.mark_jumps(stride, jumps), values=solved.values)
    return changed, solve(changed, convergence)


def _fall(before: tuple[WalkProblem, Solved], after: tuple[WalkProblem, Solved]) -> float:
    """By how much twice the error falls."""
    return 2.0 * (_error(*before) - _error(*after))


def compute_jump_statistic(block: ResidualBlock, solved: Solved) -> Floats:
    """T (K,) of each row of the potential, at the minimum of the last linearization."""
    if not len(block):
        return np.zeros(0)
    residual, jacobians = block.evaluate(solved.linearized_at)
    jacobian = np.concatenate(jacobians, axis=2)
    left = residuals_at_minimum(solved.root, block.keys, residual, jacobian)[:, 0]
    # The front of the pose, which is eliminated first, holds all variables of the row.
    row, covariance = jacobian[:, 0], solved.root.joint_covariances(block.keys)
    open_share = 1.0 - np.einsum("ki,kij,kj->k", row, covariance, row)
    return np.asarray(left**2 / np.maximum(open_share, MIN_VARIANCE))


def predict_change(problem: WalkProblem, solved: Solved, stride: Ints) -> float:
    """By how much twice the error changes where the integrals of these strides are left out, or come back if they were.

    It is that of the last linearization: a fall of strides that are used, a rise of those that are not.
    """
    field = problem.field
    assert field is not None
    used = np.intersect1d(stride, field.strides)
    sign, those = (-1.0, used) if len(used) else (1.0, stride)
    block = field.integrals_over(those)
    residual, jacobians = block.evaluate(solved.linearized_at)
    # One number to each integral, by which it may be off.
    own = np.eye(len(those))
    factors = SharingFactors(np.concatenate(jacobians, axis=2), -residual, block.keys, own[:, None])
    columns, _, pull = shared_information(solved.root, [factors], len(those))
    share, axes = np.linalg.eigh(own + sign * columns.explained)
    return float(((axes.T @ pull) ** 2 / np.maximum(share, MIN_VARIANCE)).sum())


def list_jumps(problem: WalkProblem, solved: Solved) -> list[Jump]:
    """List where the line integrals were left out, and what they miss there."""
    runs = _freed_runs(problem)
    return [Jump(int(run[0]), int(run[-1]) + 1, _size(problem, solved, run)) for run in runs]


def _size(problem: WalkProblem, solved: Solved, stride: Ints) -> float:
    """By how much the potential jumps over these strides, uT m."""
    assert problem.field is not None
    jumps = problem.field.path.jumps
    size = np.zeros(len(jumps))
    size[jumps] = problem.field.compute_jumps(solved.values)
    return float(size[stride].sum())


def describe_jumps(problem: WalkProblem, solved: Solved) -> tuple[str, ...]:
    """Return notes on the jumps of a walk, none where there are none."""
    nodes = problem.nodes
    t = problem.recording.t[nodes.sample[nodes.result]]
    return tuple(jump.describe(t) for jump in list_jumps(problem, solved))


def _error(problem: WalkProblem, solved: Solved) -> float:
    return compute_error(problem.graph, problem.blocks, solved.values)
