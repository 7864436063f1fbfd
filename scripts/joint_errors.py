"""Errors of a walk over what its solution claims for them, with all that its footfalls have in common.

The estimate p_k and the truth q_k at the footfalls that the truth saw, 0 to K, are taken relative to the first. Where
the heading is a gauge (the truth has a frame of its own, or none was given), the truth is turned by the yaw psi that
makes the errors most likely, the footfalls taken as independent of each other:

    e_k = (p_k - p_0) - R_z(psi) (q_k - q_0),      psi = argmin sum_k e_k^T W_k e_k,    W_k = cov(p_k - p_0)^-1, level.

A fit is a linear combination of the errors it is made of, so is what it leaves, and the covariance of that is exact by
the joint covariance of the footfalls (`fg_nav.smoother.sensitivity`): the degree of freedom that a fit takes counts
where it takes it. With d_k the error of p_k, h_k = de_k / dpsi and s the sigma of each true position,

    e_k = d_k - d_0 + h_k psi',    psi' = sum_l w_l^T (d_l - d_0),    w_l = -W_l h_l / sum_j h_j^T W_j h_j.

============= =========================================================================================================
horizontal    e_k, 2 degrees of freedom
along, across e_k along the move that led to footfall k, and left of it
height        e_k, up; where the truth has heights
heading       yaw at the footfalls, less psi; of a truth without attitude: by how much a quarter of the walk is turned
              about its middle, by least squares, less psi. A rotation of feet is not what is surveyed; a stretch of
              footprints is, and it is turned by as much as the heading is wrong in it
length        of the path over the ground through these footfalls, from the first to `PLACES` of them
============= =========================================================================================================

Each is squared over its variance; an honest claim makes it chi-square, and 95 % of it less than the 95 % quantile.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.stats import chi2

from fg_nav.arrays import Floats, Ints
from fg_nav.evaluation.comparison import align, yaw_between
from fg_nav.frames import wrap_angle, yaw_rotation
from fg_nav.smoother.sensitivity import FootfallCovariance, weigh_path
from fg_nav.solution import StanceTable

FREEDOM = {"horizontal": 2, "along": 1, "across": 1, "height": 1, "heading": 1, "length": 1}
"""Degrees of freedom of what is measured."""

REGION = 0.95

PLACES = 8  # Lengths of the path are taken from the start to so many footfalls.
STRETCHES = 4  # A walk without true attitudes is turned in so many of its parts.
FEWEST = 3  # Surveyed footfalls that show anything.

_ROUNDS = 10

TURN = np.array([[0.0, -1.0], [1.0, 0.0]])  # A quarter to the left.


@dataclass(frozen=True)
class Seen:
    """Footfalls that the truth saw.

    Attributes
    ----------
    row : (M,) of the stance table.
    place : (M, 3) m, true; heights of zero where there are none.
    sigma_m : of each true place, per axis.
    has_height : whether the truth has heights.
    nav_R_body : (M, 3, 3) true attitude; None without.
    is_aligned : whether the truth is in the solution's frame but for its origin; else its yaw is fitted.
    """

    row: Ints
    place: Floats
    sigma_m: float
    has_height: bool
    nav_R_body: Floats | None
    is_aligned: bool


@dataclass(frozen=True)
class Measured:
    """Errors of a walk, of one kind: `error` (N,) in their unit, `squared` (N,) over the claim; the last is the end."""

    error: Floats
    squared: Floats
    freedom: int

    @property
    def inside(self) -> float:
        """Share in the region of 95 %."""
        return float(np.mean(self.squared < chi2.ppf(REGION, self.freedom)))

    @property
    def ends_inside(self) -> bool:
        """Whether the last one is."""
        return bool(self.squared[-1] < chi2.ppf(REGION, self.freedom))

    @property
    def ratio(self) -> float:
        """Root mean square of error over sigma, per degree of freedom."""
        return float(np.sqrt(self.squared.mean() / self.freedom))


def measure_errors(stances: StanceTable, joint: FootfallCovariance, seen: Seen) -> dict[str, Measured]:
    """Measure a solution where the truth saw it, by the names of `FREEDOM`."""
    errors = _Errors(stances, joint, seen)
    found = {**errors.measure_places(), "length": errors.measure_lengths()}
    found["heading"] = errors.measure_stretches() if seen.nav_R_body is None else errors.measure_yaws(seen.nav_R_body)
    return found


class _Errors:
    """The errors of a walk after its gauge, and the weights of the footfalls' errors in them."""

    def __init__(self, stances: StanceTable, joint: FootfallCovariance, seen: Seen) -> None:
        self.stances, self.joint, self.seen = stances, joint, seen
        first, later = seen.row[0], seen.row[1:]
        unit = np.zeros((len(stances), 4, 4))
        unit[first] = np.eye(4)
        self._start, with_start = joint.combine(unit)
        own = joint_blocks(stances)
        self._relative = own[later] - with_start[later] - np.swapaxes(with_start[later], 1, 2) + self._start
        self._relative[:, :3, :3] += 2 * seen.sigma_m**2 * np.eye(3)
        p = stances.position[seen.row]
        self.p, q = p - p[0], seen.place - seen.place[0]
        self.yaw, self.slope, self.weight = 0.0, np.zeros((len(later), 2)), np.zeros((len(later), 2))
        if not seen.is_aligned:
            self._fit_yaw(q)
        self.q = q @ yaw_rotation(self.yaw).T

    def _fit_yaw(self, q: Floats) -> None:
        turn = align(q, self.p).truth_R_nav
        self.yaw = float(np.arctan2(turn[1, 0], turn[0, 0]))
        W = np.linalg.inv(self._relative[:, :2, :2])
        for _ in range(_ROUNDS):
            turned = (q @ yaw_rotation(self.yaw).T)[1:, :2]
            self.slope = -turned @ TURN.T
            pull = np.einsum("kij,kj->ki", W, self.slope)
            self.weight = -pull / np.sum(pull * self.slope)
            self.yaw += float(np.sum(self.weight * (self.p[1:, :2] - turned)))

    @property
    def _yaw_weights(self) -> Floats:
        """(F, 4) of all footfalls in psi'."""
        weights = np.zeros((len(self.stances), 4))
        weights[self.seen.row[1:], :2] += self.weight
        weights[self.seen.row[0], :2] -= self.weight.sum(axis=0)
        return weights

    def _measure(self, error: Floats, weights: Floats) -> Measured:
        """Measure combinations (N,) of the errors with weights (F, 4, N)."""
        variance = np.diagonal(self.joint.combine(weights)[0]) + self.seen.sigma_m**2 * np.sum(
            weights[:, :3] ** 2, axis=(0, 1)
        )
        return Measured(error, error**2 / variance, 1)

    def measure_places(self) -> dict[str, Measured]:
        """Measure the positions relative to the first."""
        later, s2 = self.seen.row[1:], self.seen.sigma_m**2
        columns = self._yaw_weights[:, :, None]
        yaw_variance, with_yaw = self.joint.combine(columns)
        # cov(d_k - d_0 + errors of the truth, psi'), and the variance of psi'.
        total = self.weight.sum(axis=0)
        cross = (with_yaw[later] - with_yaw[self.seen.row[0]])[:, :2, 0] + s2 * (self.weight + total)
        variance = yaw_variance[0, 0] + s2 * (np.sum(self.weight**2) + total @ total)
        h = self.slope
        C = self._relative[:, :2, :2] + h[:, :, None] * cross[:, None] + cross[:, :, None] * h[:, None]
        C = C + variance * h[:, :, None] * h[:, None]
        e = (self.p - self.q)[1:]
        squared = np.einsum("ki,kij,kj->k", e[:, :2], np.linalg.inv(C), e[:, :2])
        found = {"horizontal": Measured(np.linalg.norm(e[:, :2], axis=1), squared, 2)}
        for name, ahead in zip(("along", "across"), self._directions(), strict=True):
            moved = np.linalg.norm(ahead, axis=1) > 0.0
            if not moved.any():
                continue
            error = np.sum(ahead * e[:, :2], axis=1)[moved]
            found[name] = Measured(error, error**2 / np.einsum("ki,kij,kj->k", ahead, C, ahead)[moved], 1)
        if self.seen.has_height:
            found["height"] = Measured(e[:, 2], e[:, 2] ** 2 / self._relative[:, 2, 2], 1)
        return found

    def _directions(self) -> tuple[Floats, Floats]:
        """Unit vectors (K, 2) along each move and left of it; zero where there is none."""
        move = np.diff(self.q[:, :2], axis=0)
        length = np.linalg.norm(move, axis=1, keepdims=True)
        ahead = np.divide(move, length, out=np.zeros_like(move), where=length > MIN_MOVE_M)
        return ahead, ahead @ TURN.T

    def measure_lengths(self) -> Measured:
        """Measure the path over the ground, up to some of the footfalls."""
        last = len(self.p) - 1
        until = np.unique(np.linspace(0, last, PLACES + 1).round().astype(int))[1:]
        level = self.p * [1.0, 1.0, 0.0]
        weights = np.zeros((len(self.stances), 4, len(until)))
        weights[self.seen.row] = np.stack([weigh_path(level, k) for k in until], axis=2)
        longer = np.diff([np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1) for path in (self.q, self.p)], axis=0)[0]
        return self._measure(np.cumsum(longer)[until - 1], weights)

    def measure_yaws(self, nav_R_body: Floats) -> Measured:
        """Measure the heading at each footfall but the first, whose own is the gauge."""
        later = self.seen.row[1:]
        error = wrap_angle(yaw_between(nav_R_body, self.stances.nav_R_body[self.seen.row])[1:] - self.yaw)
        columns = self._yaw_weights[:, :, None]
        variance, cross = self.joint.combine(columns)
        own = joint_blocks(self.stances)[later, 3, 3]
        of_fit = variance[0, 0] + self.seen.sigma_m**2 * np.sum(columns[:, :3] ** 2)
        return Measured(error, error**2 / (own - 2 * cross[later, 3, 0] + of_fit), 1)

    def measure_stretches(self) -> Measured:
        """Measure by how much each part of the walk is turned."""
        edges = np.unique(np.linspace(0, len(self.p) - 1, STRETCHES + 1).round().astype(int))
        error, columns = [], []
        for first, last in pairwise(edges):
            some = slice(first, last + 1)
            p, q = (path[some, :2] - path[some, :2].mean(axis=0) for path in (self.p, self.q))
            column = -self._yaw_weights
            column[self.seen.row[some], :2] += p @ TURN.T / np.sum(p**2)
            columns.append(column)
            error.append(np.arctan2(np.sum(p * (q @ TURN.T)), np.sum(p * q)))
        return self._measure(np.array(error), np.stack(columns, axis=2))


MIN_MOVE_M = 0.3  # A shorter move has no direction.


def joint_blocks(stances: StanceTable) -> Floats:
    """Covariance (F, 4, 4) of each footfall."""
    assert stances.pose_cov is not None
    return stances.pose_cov
