"""Evidence for an assumption, errors that a whole walk shares, and the joint covariance of its footfalls.

All are of the linear graph at its minimum, R the triangle of its square-root information.

Evidence (Laplace; MacKay 2003, section 27). With E the error at the minimum, S_i the noise covariances of the factors
that an assumption changes,

    -log p(z | assumed) = E + log|R| + 1/2 sum_i log|S_i|.

Shared numbers. The linear graph is |A x + C s - b|^2, x the variables of the walk and s numbers (n of them) that many
of its factors share, with the prior 0 and S. With one pass up the triangle without s, R^T R = A^T A, and one down

    R^T Y = A^T C,    R X = Y,    x(s) = x(0) - X s,    information of s: L = C^T C - Y^T Y,

and with eta the product of L with the estimate

    s = P eta,     P = (L + S^-1)^-1,     log p(z | S) = 1/2 eta^T P eta - 1/2 log|I + S L| + const,
    cov(x) = (R^T R)^-1 + X P X^T.

Numbers that are not taken off, but left at zero, have the second moment P + s s^T in place of P. Three are shared:

moving foot   c = (c_1, c_2): in a stance after a stride of the horizontal displacement d (m) in T (s) the velocity is
              off by c_1 a + c_2 (up x a), a = d / T; 0 +- (`FORWARD_SIGMA`, `SIDEWAYS_SIGMA`), C = -(de/dv) (a, up x a)
              of the stance's velocity. It is counted, not taken off.
gyro scale    w = (1 + s) w_true + b on each axis, where the magnetic field shows the heading. To the first order the
              end of an interval preintegrated from (w - b) moves, in the tangent space of the state there, by D s,

                  D = (theta, rho, nu),   theta' = R c,   nu' = (theta) x R f,   rho' = nu,   c = -(w - b) per axis,

              R the attitude and f the specific force since its start: J = -(de/dpose_end, de/dv_end nav_R_end) D. Each
              half of the walk has an s of its own, and three models are as likely before the walk: nothing but what
              is alike (`ALIKE_SIGMA`), one scale (`SCALE_SIGMA` more), two that have nothing to do with each other.
              Only the second is taken off; the rest is counted (`docs/models.md`; Hoeting et al. 1999).
clipped peaks of the rate, rebuilt, are off alike on one side of an axis: the same columns with c = -sigma of the peak
              there, 0 +- 1. They are counted.

Footfalls. The errors of two footfalls are nearly the same error: heading and scale belong to the walk. With e_k (4,)
the error of footfall k, east, north, up (m) and yaw (rad), T_k the map of the tangent space of pose k to e_k, n
combinations c of weights w_k (4, n) and g_k = T_k^T w_k,

    cov(c) = g^T (R^T R)^-1 g = Y^T Y,    R^T Y = g,    cov(e_k, c) = T_k X_k,    R X = Y.

Those of all moves e_k - e_(k-1) together need one pass down the triangle, a group of variables each (`square_root`).
Numbers that the triangle does not hold move pose k by L_k a, a of unit covariance; that adds L_k sum_l L_l^T g_l.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import gtsam
import numpy as np
from gtsam.symbol_shorthand import X

from fg_nav.arrays import Brief, Floats, Ints, weigh_models
from fg_nav.factors.differential_field import GYRO
from fg_nav.factors.residual import Keys
from fg_nav.factors.zero_velocity import StanceVelocity
from fg_nav.mechanisation import rotate_in_body
from fg_nav.samples.gaps import cross_holes
from fg_nav.smoother.graph import WalkProblem
from fg_nav.smoother.solver import (
    Solved,
    list_attitudes,
    list_biases,
    list_positions,
    pose_in_nav,
    residuals_at_minimum,
)
from fg_nav.smoother.square_root import Groups, SquareRoot, stack_factors
from fg_nav.smoother.strides import INERTIAL_KEYS, Nodes
from fg_nav.system.compiled import njit

FORWARD_SIGMA, SIDEWAYS_SIGMA = 0.02, 0.01  # Shares of the walking speed: scatter between shoes, mountings and gaits.
MAX_STRIDE_S = 1.5  # What is longer was standing.
SCALE_SIGMA = 0.01  # Prior of each axis: tenths of a percent after a calibration, 1 to 3 by the sheet of a raw part.
ALIKE_SIGMA = 0.002  # What looks like a scale: axes out of square by 0.1 to 0.3 deg, by the sheet of a calibrated part.
MIN_OWN = 1e-3  # Share of what is alike that each half has of its own: keeps the prior invertible.
POSE_END, VELOCITY_END = slice(9, 15), slice(15, 18)  # Columns of an inertial factor.


def average(values: Floats, minus_log_evidence: Floats, prior: Floats | None = None) -> Floats:
    """Mean of values (L, ...) of L models, weighted by their evidence (L,) and, if given, by prior weights (L,)."""
    return np.asarray(np.tensordot(weigh_models(-minus_log_evidence, prior), values, axes=1))


def fit_shared(information: Floats, pull: Floats, prior: Floats) -> tuple[Floats, Floats, float]:
    """Return mean s (n,), covariance P (n, n), log evidence, from information L, its vector eta and N(0, S) prior."""
    covariance = np.asarray(np.linalg.inv(information + np.linalg.inv(prior)))
    found = covariance @ pull
    occam = 0.5 * np.linalg.slogdet(np.eye(len(prior)) + prior @ information)[1]
    return found, covariance, float(0.5 * pull @ found - occam)


class SharedColumns:
    """The columns of the shared numbers, A^T C (N, n), taken up the tree of a walk."""

    def __init__(self, root: SquareRoot, products: Floats) -> None:
        self._root, self._Y = root, root.forward_substitute(products)
        self.explained = np.asarray(self._Y.T @ self._Y)  # (n, n), what the walk takes off the information C^T C.

    def solve(self) -> Floats:
        """Return X (N, n) = R^-1 Y: the walk moves by -X s if the shared numbers are s (n,)."""
        return self._root.back_substitute(self._Y)

    def spread(self, covariance: Floats) -> Floats:
        """Return S (N, n): S S^T is the walk's covariance from the shared numbers, theirs being `covariance` (n, n)."""
        return np.asarray(self.solve() @ np.linalg.cholesky(covariance))

    def spread_untaken(self, information: Floats, pull: Floats, prior: Floats) -> Floats:
        """Return S (N, n) as `spread`, for numbers left at zero: by their second moment about it (`fit_shared`)."""
        found, covariance, _ = fit_shared(information, pull, prior)
        return self.spread(covariance + np.outer(found, found))


class SharingFactors(NamedTuple):
    """K factors of a kind |A x + C s - b|^2, linearized with the walk."""

    A: Floats  # (K, r, d).
    b: Floats  # (K, r).
    keys: Sequence[Sequence[int]] | Keys  # (K, v).
    C: Floats  # (K, r, n).


def shared_information(
    root: SquareRoot, parts: Iterable[SharingFactors], n: int
) -> tuple[SharedColumns, Floats, Floats]:
    """Return the columns of n shared numbers, their information L (n, n) and its vector eta (n,), walk marginalized."""
    products, information, pull = np.zeros((root.total, n)), np.zeros((n, n)), np.zeros(n)
    for A, b, keys, C in parts:
        # b less A x at the minimum without the shared numbers.
        left = -residuals_at_minimum(root, keys, -b, A)
        np.add.at(products, root.find_columns(keys), np.swapaxes(A, 1, 2) @ C)
        information += np.einsum("kri,krj->ij", C, C)
        pull += np.einsum("kri,kr->i", C, left)
    # Schur complement: less the information that the walk absorbs.
    columns = SharedColumns(root, products)
    return columns, information - columns.explained, pull


@dataclass(frozen=True)
class FootfallCovariance(Brief):
    """Joint covariance of the footfalls of a solved walk."""

    root: SquareRoot  # Of the walk, eliminated by QR.
    keys: tuple[int, ...]  # Of the poses of the F footfalls.
    nav_T_body: Floats  # (F, 4, 6), from their tangent spaces to east, north, up and yaw.
    shared: Floats  # L (N, n) of all columns of the walk, n = 0 where the tree holds all.

    @classmethod
    def of(cls, solved: Solved, nodes: Nodes, shared: Floats) -> FootfallCovariance:
        """Take that of a walk's footfalls, each at its stillest node."""
        keys = tuple(X(int(j)) for j in nodes.result)
        return cls(solved.root, keys, pose_in_nav(list_attitudes(nodes.result, solved.values)), shared)

    def combine(self, weights: Floats) -> tuple[Floats, Floats]:
        """Return cov(c) (n, n), and cov(e_k, c) (F, 4, n) with each footfall, of weights (F, 4, n)."""
        g = np.swapaxes(self.nav_T_body, 1, 2) @ weights
        at, products = self.root.find_columns([(key,) for key in self.keys]), np.zeros((self.root.total, g.shape[2]))
        products[at] = g
        columns = SharedColumns(self.root, products)
        L = self.shared[at]
        pull = np.einsum("kds,kdn->sn", L, g)
        return columns.explained + pull.T @ pull, self.nav_T_body @ (columns.solve()[at] + L @ pull)

    def measure_moves(self, nodes: Nodes) -> Floats:
        """Return cov(e_k - e_(k-1)) (F, 4, 4) of successive footfalls, NaN of the first, by a pass down the tree.

        The nodes between two footfalls are a path of the tree. The later footfall is in its first front; the earlier
        one ends the path, or where it is tied to others, and so eliminated after them, is in that front too.
        """
        column, count = self.root.find_columns([(X(j),) for j in range(len(nodes))]), len(nodes.result) - 1
        at, nav_T_body = column[nodes.result], self.nav_T_body
        start, end = -np.swapaxes(nav_T_body[:-1], 1, 2), np.swapaxes(nav_T_body[1:], 1, 2)
        # The path of each move: the nodes between, and the earlier footfall where it is eliminated before these.
        node = np.setdiff1d(np.arange(nodes.result[0], nodes.result[-1]), nodes.result)
        move = np.searchsorted(nodes.result, node) - 1
        ends_path = at[:-1, 0] < column[nodes.result[:-1] + 1, 0]
        groups = Groups(
            np.full(self.root.total, -1),
            np.zeros((self.root.total, 4)),
            np.concatenate([at[1:], at[:-1]], axis=1),
            np.concatenate([end, np.where(ends_path[:, None, None], 0.0, start)], axis=1),
        )
        groups.of_column[column[node]] = move[:, None]
        groups.of_column[at[:-1][ends_path]] = np.flatnonzero(ends_path)[:, None]
        groups.G[at[:-1][ends_path]] = start[ends_path]
        found = self.root.quadratic_forms(groups)
        # Without a path, both are in the front of the later footfall.
        alone = np.flatnonzero(~ends_path & ~np.isin(np.arange(count), move))
        if len(alone):
            difference = np.concatenate([-nav_T_body[alone], nav_T_body[alone + 1]], axis=2)
            pairs = [(self.keys[k], self.keys[k + 1]) for k in alone]
            found[alone] = difference @ self.root.joint_covariances(pairs) @ np.swapaxes(difference, 1, 2)
        # With what all moves share.
        L = nav_T_body[1:] @ self.shared[at[1:]] - nav_T_body[:-1] @ self.shared[at[:-1]]
        return np.concatenate([np.full((1, 4, 4), np.nan), found + L @ np.swapaxes(L, 1, 2)])


def weigh_path(position: Floats, until: int | None = None) -> Floats:
    """Return the gradient (F, 4) of path length by the error of each footfall, position (F, 3) m, up to `until`."""
    weights = np.zeros((len(position), 4))
    move = np.diff(position[: until if until is None else until + 1], axis=0)
    length = np.linalg.norm(move, axis=1, keepdims=True)
    unit = np.divide(move, length, out=np.zeros_like(move), where=length > 0.0)
    weights[1 : len(unit) + 1, :3] += unit
    weights[: len(unit), :3] -= unit
    return weights


def spread_moving_foot(problem: WalkProblem, solved: Solved) -> Floats:
    """Return by how much the walk moves (N, 2), for numbers of unit covariance, with what is not known of c."""
    columns, information, pull = weigh_moving_foot(problem, solved)
    return columns.spread_untaken(information, pull, np.diag([FORWARD_SIGMA**2, SIDEWAYS_SIGMA**2]))


def weigh_moving_foot(problem: WalkProblem, solved: Solved) -> tuple[SharedColumns, Floats, Floats]:
    """Return the columns of c in the tree of a solved walk, its information L (2, 2) on c, and eta (2,)."""
    block = problem.velocities
    residual, jacobians = block.evaluate(solved.linearized_at)
    by_share = -jacobians[1] @ find_motion(problem, solved.values)
    factors = SharingFactors(np.concatenate(jacobians, axis=2), -residual, block.keys, by_share)
    return shared_information(solved.root, [factors], 2)


def find_motion(problem: WalkProblem, values: gtsam.Values) -> Floats:
    """Return (a, up x a) (M, 3, 2) m/s at each node, nav axes; zero in the first stance, long ones, and after a gap."""
    nodes = problem.nodes
    t = problem.recording.t[nodes.sample[nodes.result]]
    position = list_positions(nodes.result, values)
    d = np.diff(position, axis=0, prepend=position[:1])
    a = d[:, :2] / np.minimum(np.diff(t, prepend=-np.inf), MAX_STRIDE_S)[:, None]
    a[1:][cross_holes(problem.recording.t, nodes.sample[nodes.result])] = 0.0
    level = np.zeros(len(a))
    motion = np.stack([np.column_stack([a, level]), np.column_stack([-a[:, 1], a[:, 0], level])], axis=2)
    ties = problem.velocities.residuals
    assert isinstance(ties, StanceVelocity)
    walks = ties.sinks_per_m > 0.0
    return np.asarray(motion[nodes.footfall] * walks[:, None, None])


@dataclass(frozen=True)
class GyroScale:
    """Scale errors of the gyroscope that are taken off, and what is left about them."""

    scale: Floats  # (3,).
    sigma: Floats  # (3,).
    probability: float  # Of the model with one scale for the whole walk.
    second_moment: Floats  # (3, 3) of what is wrong in all swings about what is taken off, over all models.

    @property
    def matters(self) -> bool:
        """Whether they are more than what other errors of a swing make: else they stay, and are in the sigmas."""
        return bool(np.abs(self.scale).max() > ALIKE_SIGMA)

    @property
    def note(self) -> str:
        """The same in words."""
        axes = ", ".join(f"{100 * s:+.2f} +- {100 * d:.2f}" for s, d in zip(self.scale, self.sigma, strict=True))
        share = 100.0 * self.probability
        return f"gyroscope's scale errors {axes} %, taken off: both halves of the walk agree on them by {share:.0f} %"


@dataclass(frozen=True)
class WalkScale:
    """The scale of a walk's gyroscope, and its columns in the walk's tree, one half of the walk after the other."""

    found: GyroScale
    columns: SharedColumns

    def spread(self) -> Floats:
        """Return S (N, 3): S S^T is the covariance from the scale errors left, equal in both halves."""
        moved = self.columns.solve()
        return np.asarray((moved[:, :3] + moved[:, 3:]) @ np.linalg.cholesky(self.found.second_moment))


def weigh_gyro_scale(problem: WalkProblem, solved: Solved) -> tuple[SharedColumns, Floats, Floats]:
    """Return the columns of the scale errors, three of each half of the walk, their information (6, 6) and vector."""
    return shared_information(solved.root, _list_inertial(problem, solved.linearized_at), 6)


def estimate_gyro_scale(problem: WalkProblem, solved: Solved) -> WalkScale:
    """Return the model-averaged scale errors of the gyroscope, and their sensitivity columns, at a solution."""
    columns, information, pull = weigh_gyro_scale(problem, solved)
    found = average_models(information, pull)
    if not found.matters:
        return WalkScale(found, columns)
    # Nats by which inertial and velocity factors fit worse with one scale for the walk: the field alone supports it.
    both = np.tile(found.scale / found.probability, 2)
    moved, worse = -columns.solve() @ both, 0.0
    e, H = problem.velocities.evaluate(solved.linearized_at)
    jacobian, none = np.concatenate(H, axis=2), np.zeros((*e.shape, 6))
    velocities = SharingFactors(jacobian, -e, problem.velocities.keys, none)
    for A, b, keys, C in (velocities, *_list_inertial(problem, solved.linearized_at)):
        left = residuals_at_minimum(solved.root, keys, -b, A)
        change = np.einsum("kij,kj->ki", A, moved[solved.root.find_columns(keys)]) + C @ both
        worse += float(((left + 0.5 * change) * change).sum())
    return WalkScale(average_models(information, pull, max(worse, 0.0)), columns)


def average_models(information: Floats, pull: Floats, worse_nats: float = 0.0) -> GyroScale:
    """Average the three models, by L (6, 6) and eta (6,) of both halves; one scale has `worse_nats` less evidence."""
    same, own = np.kron(np.ones((2, 2)), np.eye(3)), np.eye(6)
    alike = ALIKE_SIGMA**2 * (same + MIN_OWN * own)
    priors = alike, alike + SCALE_SIGMA**2 * same, alike + SCALE_SIGMA**2 * own
    fits = [fit_shared(information, pull, prior) for prior in priors]
    evidence = np.array([0.0, worse_nats, 0.0]) - [evidence for _, _, evidence in fits]
    weight = average(np.eye(3), evidence)
    means, covariances = ([one[:3] + one[3:] for one, _, _ in fits], [P for _, P, _ in fits])
    mean_of = np.kron(np.full((1, 2), 0.5), np.eye(3))
    scale = weight[1] * 0.5 * means[1]
    about = scale if np.abs(scale).max() > ALIKE_SIGMA else np.zeros(3)
    moments = [
        mean_of @ P @ mean_of.T + np.outer(0.5 * mean - about, 0.5 * mean - about)
        for mean, P in zip(means, covariances, strict=True)
    ]
    sigma = np.sqrt(np.diagonal(mean_of @ covariances[1] @ mean_of.T))
    return GyroScale(scale, sigma, float(weight[1]), np.tensordot(weight, np.array(moments), axes=1))


def _list_inertial(problem: WalkProblem, values: gtsam.Values) -> Iterator[SharingFactors]:
    """Yield the inertial factors with their columns of the scale."""
    nodes, bias = problem.nodes, _list_rate_biases(problem, values)
    error = problem.recording.integrable[1].copy()
    error[nodes.sample[0] : nodes.sample[-1]] -= np.repeat(bias, np.diff(nodes.sample), axis=0)
    at, count = 0, np.count_nonzero(~cross_holes(problem.recording.t, nodes.sample))
    for A, b, keys, by_scale in _share_rate_errors(problem, values, error):
        is_late = (np.arange(at, at + len(b)) >= count // 2)[:, None, None]
        yield SharingFactors(A, b, keys, np.concatenate([by_scale * ~is_late, by_scale * is_late], axis=2))
        at += len(b)


def spread_clipped_peaks(problem: WalkProblem, solved: Solved) -> Floats:
    """Return S (N, n): S S^T is the covariance of errors common to rebuilt (clipped) peaks, of an axis on one side."""
    peaks, gyr = problem.recording.peaks[1], problem.recording.gyr
    # A peak errs as a whole: scale the sigma of its samples, which holds for independent errors.
    alike = peaks.sigma / np.sqrt(np.maximum(peaks.run, 1.0))
    sides = [np.where(side * gyr > 0.0, alike, 0.0) for side in (1.0, -1.0)]
    clipped = np.flatnonzero(np.concatenate([side.any(axis=0) for side in sides]))
    if not len(clipped):
        return np.zeros((solved.root.total, 0))
    shared = _share_rate_errors(problem, solved.linearized_at, *sides)
    parts = (one._replace(C=one.C[:, :, clipped]) for one in shared)
    columns, information, pull = shared_information(solved.root, parts, len(clipped))
    return columns.spread_untaken(information, pull, np.eye(len(clipped)))


def _share_rate_errors(problem: WalkProblem, values: gtsam.Values, *errors: Floats) -> Iterator[SharingFactors]:
    """Yield the inertial factors with columns of three numbers, for each error (N, 3) rad/s of the axes by a unit."""
    recording, nodes, graph = problem.recording, problem.nodes, problem.graph
    given = recording.t, *recording.integrable, nodes.sample, _list_rate_biases(problem, values)
    moved = np.concatenate([sense_rate_error(*given, error) for error in errors], axis=2)
    moved[:, 6:] = list_attitudes(range(1, len(nodes)), values) @ moved[:, 6:]
    moved = moved[~cross_holes(recording.t, nodes.sample)]
    inertial = (graph.at(i) for i in range(graph.size()))
    at = 0
    for stack in stack_factors(factor.linearize(values) for factor in inertial if factor.size() == INERTIAL_KEYS):
        A, b, D = stack.rows[..., :-1], stack.rows[..., -1], moved[at : at + len(stack.rows)]
        yield SharingFactors(A, b, stack.keys, -(A[:, :, POSE_END] @ D[:, :6] + A[:, :, VELOCITY_END] @ D[:, 6:]))
        at += len(stack.rows)


def _list_rate_biases(problem: WalkProblem, values: gtsam.Values) -> Floats:
    """Bias (M-1, 3) rad/s of each interval between nodes."""
    return list_biases(problem.nodes, values)[problem.nodes.bias[problem.nodes.footfall[:-1]], GYRO]


def sense_rate_error(t: Floats, force: Floats, rate: Floats, sample: Ints, bias: Floats, error: Floats) -> Floats:
    """Return D (M-1, 9, 3): end state of each interval between samples (M,), by the size of a rate error on each axis.

    Rows: rotation (rad), position (m), velocity (m/s), in the body axes at the end; `error` (N, 3) rad/s.
    """
    count = len(sample) - 1
    start_R_end, moved = np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3, 3, 3))
    _integrate_error(t, force, rate, sample, bias, error, start_R_end, moved)
    return np.asarray(np.einsum("kji,kpjl->kpil", start_R_end, moved).reshape(count, 9, 3))


@njit(cache=True)
def _integrate_error(
    t: Floats,
    force: Floats,
    rate: Floats,
    sample: Ints,
    bias: Floats,
    error: Floats,
    start_R_end: Floats,
    moved: Floats,
) -> None:
    """Integrate rotation, position and velocity errors into `moved`, start axes, and attitude into `start_R_end`."""
    turn, a, push = np.empty(3), np.empty(3), np.empty(3)
    for k in range(len(sample) - 1):
        R, theta, rho, nu = start_R_end[k], moved[k, 0], moved[k, 1], moved[k, 2]
        for i in range(sample[k], sample[k + 1]):
            h = t[i + 1] - t[i]
            for axis in range(3):
                turn[axis] = (rate[i, axis] - bias[k, axis]) * h
            rotate_in_body(R, 0.5 * turn[0], 0.5 * turn[1], 0.5 * turn[2])
            for row in range(3):
                a[row] = R[row, 0] * force[i, 0] + R[row, 1] * force[i, 1] + R[row, 2] * force[i, 2]
            for axis in range(3):
                for row in range(3):
                    theta[row, axis] -= 0.5 * R[row, axis] * error[i, axis] * h
                x, y, z = theta[0, axis], theta[1, axis], theta[2, axis]
                push[0], push[1], push[2] = y * a[2] - z * a[1], z * a[0] - x * a[2], x * a[1] - y * a[0]
                for row in range(3):
                    rho[row, axis] += (nu[row, axis] + 0.5 * push[row] * h) * h
                    nu[row, axis] += push[row] * h
                    theta[row, axis] -= 0.5 * R[row, axis] * error[i, axis] * h
            rotate_in_body(R, 0.5 * turn[0], 0.5 * turn[1], 0.5 * turn[2])
