"""Where and how far the line integral of the field can be used: jumps of its potential, and what does not telescope.

Jumps: a path through a circuit of current I, a lift, a magnet that is put down. The line integrals of the strides add
up to the difference of two potentials, within bounds (`factors.magnetic_field`), and mu_0 I = 1.26 uT m an ampere:
one row of the potential, that of stride k, is off by an unknown constant c. Its own residual does not show it, as the
potential's state takes the step up; the likelihood of the whole walk does. With r_k the residual of the row at the
minimum, sigma its noise, J its Jacobian and P the marginal covariance of its variables,

    T_k = r_k^2 / (sigma^2 - J P J^T)        chi^2 of one degree of freedom without a jump

is by how much twice the error falls at the minimum where the row is left out, that is, with c free (a deletion
diagnostic; Cook 1977). It costs one pass down the triangle. At the largest T the rows k-1, k, k+1 are left out, as the
stride that passes the conductor is wrong in its shape too. By how much twice the error then falls follows in the same
way, from all their residuals r, with H = J P J^T by one pass up the tree (`sensitivity`); so does by how much it rises
where rows that are left out come back:

    fall = r^T (I - H)^-1 r,     rise = r^T (I + H)^-1 r,     r and J over sigma.

Where the fall is more than `MIN_FALL` the walk is solved again without them, the jump is kept if twice the error fell
by as much, and the next one is searched. The roughness of the potential, which a jump swells, is held meanwhile;
measured without the jump, it has to confirm it.

Noise. The integral over stride k differs from that of the building's field by the change of the potential, whose sum
over a walk stays within bounds, and by an error of its own, whose sum does not: iron and delay of the magnetometer,
tilt in the swing, an uneven clock, currents. From one stride alone the two look alike. With v the variance of all of it
over a stride (from spread sigma and correlation length of the potential as the walk shows them, a what is left of it
after the length of that stride, all of it where the foot stays), a share s is error:

    v = 2 sigma^2 (1 - a),     noise of the integral^2 = sigma_u^2 + s v,     potential^2 = (1 - s) sigma^2.

s = 0: the integral is a coordinate along north that does not drift. s = 1: it drifts as a random walk does and is worth
no more than that. The evidence of the walk (`sensitivity`) separates them, the longer the better; of the noises those
of integrals and potential count. The walk uses the mean of s under the posterior of s on `SHARES`, with `PRIOR` before
the walk. The mean of a variance is that of the mixture, so no share has to win. Nodes between the footfalls are
eliminated once; each level eliminates what is left, a quarter of the variables.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import V, X

from fg_nav.arrays import Floats, Ints, find_runs
from fg_nav.errors import EstimationError
from fg_nav.factors.magnetic_field import E_H, PHI
from fg_nav.factors.residual import ResidualBlock
from fg_nav.smoother.field_factors import MIN_STEP_M, FieldFactors
from fg_nav.smoother.gauss_newton import CONVERGENCE, LinearWalk
from fg_nav.smoother.graph import WalkProblem, solve
from fg_nav.smoother.sensitivity import SharingFactors, average, shared_information
from fg_nav.smoother.solver import Solved, residuals_at_minimum

MIN_STATISTIC = 15.0  # T below which no row is tried: the largest of clean walks is 1 to 15, of a circuit of 100 A 200.
MIN_FALL = 25.0  # Of twice the error, chi^2 of three degrees of freedom: by 2 to 19 on clean simulated walks.
MIN_JUMP_UT_M = 15.0  # Twelve amperes; less is in the tails of the potential next to large iron.
MAX_JUMPS = 20  # After so many the walk's field is not one that a potential describes.
MIN_VARIANCE = 1e-9  # Share of a row's noise that the walk leaves open, below which rounding decides.
UT_M_PER_AMPERE = 1.2566  # mu_0, uT m/A.
SHARES = (0.0, 0.01, 0.1, 1.0, 4.0)  # At 0 the sampling leaves a tenth of a uT m a stride; 4: a late sensor, currents.
PRIOR = (1.0, 1.0, 1.0, 1.0, 0.1)  # Weights of the shares before the walk.


@dataclass(frozen=True)
class Jump:
    """Of the potential: between footfalls `first` and `last`, by `size_uT_m`."""

    first: int
    last: int
    size_uT_m: float


def free_jumps(problem: WalkProblem, solved: Solved, convergence: float = CONVERGENCE) -> tuple[WalkProblem, Solved]:
    """Return the walk solved without the line integrals across potential jumps; unchanged if there are none."""
    # Test earlier jumps again: the roughness they were found at included them.
    for stride in _freed_runs(problem):
        if predict_change(problem, solved, stride) >= MIN_FALL:
            continue
        restored = _solve_with(problem, solved, stride, False, convergence)
        if 2.0 * (restored[1].error - solved.error) < MIN_FALL:
            problem, solved = restored
    for _ in range(MAX_JUMPS):
        # The row without which the error falls most.
        statistic = compute_jump_statistic(problem.field_factors.potential, solved)
        if not len(statistic) or statistic.max() < MIN_STATISTIC:
            break
        # Leave it out with its neighbors; stop where that gains too little.
        field = problem.field_factors
        stride = field.strides[statistic.argmax()]
        near = np.arange(max(stride - 1, 0), min(stride + 2, len(field.path.u)))
        near = near[np.isfinite(field.path.sigma_uT_m[near])]
        if predict_change(problem, solved, near) < MIN_FALL:
            break
        try:
            freed = _solve_with(problem, solved, near, True, convergence)
        except EstimationError:
            break
        if 2.0 * (solved.error - freed[1].error) < MIN_FALL or abs(_size(*freed, near)) < MIN_JUMP_UT_M:
            break
        problem, solved = freed
    return problem, solved


def _freed_runs(problem: WalkProblem) -> list[Ints]:
    """Strides that were left out, in runs without a gap."""
    return [np.arange(*run) for run in zip(*find_runs(problem.field_factors.path.jumps), strict=True)]


def _solve_with(
    problem: WalkProblem, solved: Solved, stride: Ints, jumps: bool, convergence: float
) -> tuple[WalkProblem, Solved]:
    """Solve again with the potential free to jump at these strides, or not."""
    changed = replace(problem, field=problem.field_factors.mark_jumps(stride, jumps), values=solved.values)
    return changed, solve(changed, convergence)


def compute_jump_statistic(block: ResidualBlock, solved: Solved) -> Floats:
    """Return T (K,), squared residual over 1 - leverage: the fall of twice the error without that row, chi^2 of 1."""
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
    """Return the predicted change of twice the error if the line integrals of strides `stride` are toggled.

    By the last linearization: the fall without integrals that are in use, the rise with those that are left out.
    """
    field = problem.field_factors
    used = np.intersect1d(stride, field.strides)
    sign, those = (-1.0, used) if len(used) else (1.0, stride)
    block = field.integrals_over(those)
    residual, jacobians = block.evaluate(solved.linearized_at)
    # A free offset on each integral is equivalent to leaving it out.
    own = np.eye(len(those))
    factors = SharingFactors(np.concatenate(jacobians, axis=2), -residual, block.keys, own[:, None])
    columns, _, pull = shared_information(solved.root, [factors], len(those))
    share, axes = np.linalg.eigh(own + sign * columns.explained)
    return float(((axes.T @ pull) ** 2 / np.maximum(share, MIN_VARIANCE)).sum())


def list_jumps(problem: WalkProblem, solved: Solved) -> list[Jump]:
    """List the jumps: runs of strides without line integrals, and the change of potential (uT m) over each."""
    runs = _freed_runs(problem)
    return [Jump(int(run[0]), int(run[-1]) + 1, _size(problem, solved, run)) for run in runs]


def _size(problem: WalkProblem, solved: Solved, stride: Ints) -> float:
    """Return the total jump of the potential over these strides, uT m: minus the residuals left out."""
    field = problem.field_factors
    left_out = np.flatnonzero(field.path.jumps)
    if not len(left_out):
        return 0.0
    e, _ = field.integrals_over(left_out).evaluate(solved.values, with_jacobians=False)
    size = np.zeros(len(field.path.jumps))
    size[left_out] = -e[:, 0] * field.sigma_of(left_out)
    return float(size[stride].sum())


def describe_jumps(problem: WalkProblem, solved: Solved) -> tuple[str, ...]:
    """Return one note for each jump of the potential."""
    nodes = problem.nodes
    t = problem.recording.t[nodes.sample[nodes.result]]
    return tuple(
        f"the potential jumps by {jump.size_uT_m:+.0f} uT m at {t[jump.first]:.0f} to {t[jump.last]:.0f} s, as through "
        f"a circuit of {abs(jump.size_uT_m / UT_M_PER_AMPERE):.0f} A: the line integral is not used there"
        for jump in list_jumps(problem, solved)
    )


@dataclass(frozen=True)
class PathNoise:
    """What a walk shows of its line integrals: the share s used, the drift that may be, m a stride, and the strides."""

    lost_share: float
    drift_m: float
    strides: int

    @property
    def note(self) -> str:
        """The same in words."""
        return (
            f"line integral of the field: {100 * self.lost_share:.1f} % of its changes do not telescope, a drift of "
            f"{self.drift_m:.2f} m a stride, by the evidence of {self.strides} strides"
        )


def average_path_noise(problem: WalkProblem, values: gtsam.Values) -> PathNoise:
    """Average the share of the integral's changes that does not telescope, the graph linearized at these values."""
    field = problem.field_factors
    # The walk between its footfalls, which no share changes.
    rest = _eliminate_between(problem, values)
    evidence = np.array([_minus_log_evidence(rest, field.assume_lost_share(share), values) for share in SHARES])
    share = float(average(np.array(SHARES), evidence, np.array(PRIOR)))
    # The drift over the walk as a random walk's a stride.
    horizontal, strides = float(np.linalg.norm(field.prior.mean[E_H])), int((field.path.distance_m > MIN_STEP_M).sum())
    drift_uT_m = float(np.sqrt(np.sum(field.assume_lost_share(share).drift_uT_m ** 2) / max(strides, 1)))
    return PathNoise(share, drift_uT_m / horizontal, len(field.potential))


def _eliminate_between(problem: WalkProblem, values: gtsam.Values) -> LinearWalk:
    """Return the linearized walk without its field, nodes between footfalls marginalized."""
    between = np.delete(np.arange(len(problem.nodes)), problem.nodes.result)
    nodes = np.array([key(int(j)) for j in between for key in (X, V)], dtype=np.uint64)
    order = problem.time_order
    first = np.isin(order, nodes)
    stacks = replace(problem, field=None).system.stack(values)
    walk = LinearWalk.of(stacks, np.concatenate([order[first], order[~first]]))
    return walk.eliminate_before(len(nodes))


def _minus_log_evidence(rest: LinearWalk, field: FieldFactors, values: gtsam.Values) -> float:
    """Of a field, up to a constant."""
    sigmas = (field.integral_sigma, field.change_sigma[:, PHI], field.prior.sigma[PHI])
    walk = rest.join(stack for block in field.blocks for stack in block.stack(values))
    return walk.minus_log_evidence(float(sum(np.log(one).sum() for one in sigmas)))
