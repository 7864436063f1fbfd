"""How far the line integral of the field can be used: the share of its changes that does not telescope, by evidence.

The integral over stride k differs from that of the building's field by the change of the potential, whose sum over a
walk stays within bounds, and by an error of its own, whose sum does not: iron and delay of the magnetometer, tilt in
the swing, an uneven clock, currents. From one stride alone the two look alike. With v the variance of all of it over a
stride (from spread sigma and correlation length of the potential as the walk shows them, a what is left of it after the
length of that stride, all of it where the foot stays), a share s is error:

    v = 2 sigma^2 (1 - a),     noise of the integral^2 = sigma_u^2 + s v,     potential^2 = (1 - s) sigma^2.

s = 0: the integral is a coordinate along north that does not drift. s = 1: it drifts as a random walk does and is worth
no more than that. The evidence of the walk tells them apart, the longer the better,

    -log p(z | s) = E + log|R| + 1/2 sum log|S(s)|                         (Laplace; MacKay 2003, section 27)

E the error at the minimum of the graph linearized once, R the triangle of its square-root information, S the noise of
integrals and potential. The walk averages over the shares: it uses the mean of s under the posterior of s on `SHARES`,
with `PRIOR` before the walk. The mean of a variance is that of the mixture, so no share has to win.

Cost. Nodes between the footfalls are eliminated once; each level eliminates what is left, a quarter of the variables.
"""

from __future__ import annotations

from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam.symbol_shorthand import V, X

from fg_nav.factors.magnetic_field import E_H, PHI
from fg_nav.smoother.evidence import average
from fg_nav.smoother.field_factors import FieldFactors
from fg_nav.smoother.graph import WalkProblem
from fg_nav.smoother.linear import LinearWalk
from fg_nav.smoother.roughness import MIN_STEP_M
from fg_nav.smoother.solver import list_in_time, stack_walk

SHARES, PRIOR = (0.0, 0.01, 0.1, 1.0, 4.0), (1.0, 1.0, 1.0, 1.0, 0.1)
"""Shares, and their weights before the walk. At 0 the sampling leaves a tenth of a uT m a stride; beyond 1 they are
worse than the potential is thought to change: a late magnetometer, currents."""


@dataclass(frozen=True)
class PathNoise:
    """What a walk shows of its line integrals: the share s used, the drift that may be, m a stride, and the strides."""

    lost_share: float
    drift_m: float
    strides: int

    def describe(self) -> str:
        """Return a note."""
        return (
            f"line integral of the field: {100 * self.lost_share:.1f} % of its changes do not telescope, a drift of "
            f"{self.drift_m:.2f} m a stride, by the evidence of {self.strides} strides"
        )


def average_path_noise(problem: WalkProblem, values: gtsam.Values) -> PathNoise:
    """Average the share of the integral's changes that does not telescope, the graph linearized at these values."""
    field = problem.field
    assert field is not None
    # The walk between its footfalls, which no share changes.
    rest = _eliminate_between(problem, values)
    evidence = np.array([_minus_log_evidence(rest, field.assume_lost_share(share), values) for share in SHARES])
    share = float(average(np.array(SHARES), evidence, np.array(PRIOR)))
    horizontal = float(np.linalg.norm(field.prior.mean[E_H]))
    return PathNoise(share, _drift_a_stride(field.assume_lost_share(share)) / horizontal, len(field.potential))


def _drift_a_stride(field: FieldFactors) -> float:
    """Drift of the integral over the walk as a random walk's a stride, uT m."""
    strides = int((field.path.distance_m > MIN_STEP_M).sum())
    return float(np.sqrt(np.sum(field.drift_uT_m**2) / max(strides, 1)))


def _eliminate_between(problem: WalkProblem, values: gtsam.Values) -> LinearWalk:
    """Linear graph of the walk without its field, the nodes between footfalls eliminated."""
    blocks = [block for block in problem.blocks if block is not problem.field]
    between = np.delete(np.arange(len(problem.nodes)), problem.nodes.result)
    nodes = np.array([key(int(j)) for j in between for key in (X, V)], dtype=np.uint64)
    with_air = problem.barometer is not None
    order = list_in_time(problem.nodes, with_field=True, floor=problem.floor, with_air=with_air)
    first = np.isin(order, nodes)
    walk = LinearWalk.of(stack_walk(problem.graph, blocks, values), np.concatenate([order[first], order[~first]]))
    return walk.eliminate_before(len(nodes))


def _minus_log_evidence(rest: LinearWalk, field: FieldFactors, values: gtsam.Values) -> float:
    """Of a field, up to a constant."""
    left = rest.join(field.stack(values)).eliminate_all()
    noise = (
        np.log(field.integral_sigma).sum() + np.log(field.change_sigma[:, PHI]).sum() + np.log(field.prior.sigma[PHI])
    )
    return float(left.error + left.volume + noise)
