"""The readings of a walk: what turns with the foot is the sensor's, what stays is the building's.

At footfall k, with the inertial attitude R_k, the reading is

    m_k = S R_k^T Z_k^T b + h + R_k^T d_k

============ ==== ==================================================================================================
m_k          uT   mean reading over the footfall, body frame
R_k               inertial attitude nav_R_body; its heading drifts
Z_k               turn about up by delta_k, that drift: a constant rate and a random walk, a line between knots
h, S         uT,1 hard iron; soft iron, symmetric
b            uT   mean field along the walk, nav
d_k          uT   what the building adds there, nav: 6 to 13 uT per axis at a foot indoors, heavy-tailed, alike at
                  neighboring footfalls
============ ==== ==================================================================================================

d is Student distributed, with one scale over the ground and one upright; h, S and delta have Gaussian priors. The field
explains the readings and not the other way round: fields explained by noisy readings would be least for S^-1 = 0. The
unknowns are h, S (six), b, and delta at the knots, in this order.

Their covariance is the sandwich A^-1 (J^T W corr(d) W J + prior) A^-1. The correlation of d from footfall to footfall
is that of the residuals, and no less than `LEAST_CORRELATION`, for a straight hides a part of it. A walk of several
rounds sees the same places again: the correlation of its residuals shows it, and it is counted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import correlate

from fg_nav.arrays import Bools, Floats
from fg_nav.calibration.magnetometer import UPPER, matrix_of, select_footfalls
from fg_nav.magnetic.footfall_field import FootfallField

IRON = 9
"""h and S come first among the unknowns."""

WITHOUT_IRON = np.concatenate([np.zeros(3), np.eye(3)[UPPER]])
"""h and S of a sensor that carries none."""


HARD_IRON_SIGMA_UT = 30.0
"""Prior of h per axis: wider than Ma's Table 1 (14 uT), which is a battery next to the chip."""

SOFT_IRON_SIGMA = 0.06
"""Prior of S about identity: half of all level axis ratios are then below that of Ma's Table 1."""

DRIFT_RATE_DEG_S = 0.05
"""Of the inertial heading: what a rest leaves of the gyroscope's bias, and some more where there was none."""

DRIFT_WALK_DEG_SQRT_MIN = 2.0
"""Of the inertial heading: scale errors in turns, and the bias that moves."""

KNOT_S = 60.0
"""Between the knots of the drift."""

TAIL = 5.0
"""Degrees of freedom of the Student distribution: excess kurtosis of the field at a real foot is 0 to 4."""

LAGS = 8
"""Footfalls over which neighbors may be alike: ten meters."""

LEAST_CORRELATION = 0.4
"""Of neighboring footfalls, falling off as a power: gdin walks have 0.2 to 0.25, and their mean hides some.
Tuned on 60 simulated demos (seeds below 100), whose errors it makes 1.03 sigmas instead of 1.26."""

FEWEST_FOOTFALLS = 20
"""One footfall shows h to 10 uT, twenty to 2 uT."""


@dataclass(frozen=True)
class Walk:
    """N footfalls with a field; shares (N, K) of the K knots of the drift at each, and the precision of the knots."""

    field: FootfallField
    knots: Floats
    drift_precision: Floats

    def __len__(self) -> int:
        return len(self.field)

    @property
    def reading(self) -> Floats:
        """(N, 3) uT, body frame."""
        return self.field.body_field

    @property
    def nav_R_body(self) -> Floats:
        """(N, 3, 3), drifting."""
        return self.field.nav_R_body

    @classmethod
    def of(cls, field: FootfallField) -> Walk:
        """With knots from the first footfall, where the drift is nothing, to the last."""
        field = select_footfalls(field, np.asarray(np.isfinite(field.body_field).all(axis=1)))
        if len(field) < 2:
            return cls(field, np.empty((len(field), 0)), np.empty((0, 0)))
        duration = field.t[-1] - field.t[0]
        since = np.linspace(0.0, duration, 1 + max(1, round(duration / KNOT_S)))
        knots = np.stack([np.interp(field.t - field.t[0], since, row) for row in np.eye(len(since))], axis=1)
        since = since[1:]
        walk = np.radians(DRIFT_WALK_DEG_SQRT_MIN) ** 2 / 60 * np.minimum.outer(since, since)
        covariance = walk + np.radians(DRIFT_RATE_DEG_S) ** 2 * np.outer(since, since)
        return cls(field, knots[:, 1:], np.linalg.inv(covariance))

    def part(self, chosen: Bools) -> Walk:
        """Some of the footfalls, the same knots."""
        return Walk(select_footfalls(self.field, chosen), self.knots[chosen], self.drift_precision)


def prior_precision(walk: Walk) -> Floats:
    """Of all unknowns; b has none. Off the diagonal S spreads less by the root of two, the same in all directions."""
    soft = np.where(UPPER[0] == UPPER[1], 1.0, 0.5) * SOFT_IRON_SIGMA**2
    iron = np.concatenate([np.full(3, HARD_IRON_SIGMA_UT**2), soft])
    precision = np.zeros((12 + len(walk.drift_precision),) * 2)
    precision[:IRON, :IRON] = np.diag(1 / iron)
    precision[12:, 12:] = walk.drift_precision
    return precision


def compute_residual(walk: Walk, at: Floats) -> Floats:
    """What the building adds (N, 3) uT, in nav."""
    field, _ = _rotate_back(walk, at)
    body = np.einsum("nji,nj->ni", walk.nav_R_body, field)
    return np.asarray(np.einsum("nij,nj->ni", walk.nav_R_body, walk.reading - body @ matrix_of(at[3:9]) - at[:3]))


def compute_jacobian(walk: Walk, at: Floats) -> Floats:
    """Of what is explained, in nav, by the unknowns (N, 3, P)."""
    field, by_delta = _rotate_back(walk, at)
    R = walk.nav_R_body
    R_S_Rt = R @ matrix_of(at[3:IRON]) @ R.transpose(0, 2, 1)
    body = np.einsum("nji,nj->ni", R, field)
    by_soft = np.stack([np.einsum("nij,jk,nk->ni", R, matrix_of(one), body) for one in np.eye(6)], axis=2)
    by_drift = np.einsum("nij,nj,nk->nik", R_S_Rt, by_delta, walk.knots)
    return np.concatenate([R, by_soft, R_S_Rt @ _back(walk, at), by_drift], axis=2)


def _rotate_back(walk: Walk, at: Floats) -> tuple[Floats, Floats]:
    """Z^T b (N, 3), and its derivative by delta."""
    field = np.asarray(_back(walk, at) @ at[9:12])
    return field, np.stack([field[:, 1], -field[:, 0], np.zeros(len(field))], axis=1)


def _back(walk: Walk, at: Floats) -> Floats:
    """Z^T (N, 3, 3)."""
    delta = walk.knots @ at[12:]
    c, s, zero = np.cos(delta), np.sin(delta), np.zeros(len(delta))
    return np.stack([c, s, zero, -s, c, zero, zero, zero, zero + 1], axis=1).reshape(-1, 3, 3)


def compute_weights(residual: Floats, sigma: Floats) -> Floats:
    """(N,) of the Student distribution; 1 in the mean."""
    return np.asarray((TAIL + 3) / (TAIL + ((residual / sigma) ** 2).sum(axis=1)))


MOST_CORRELATED = 0.9
"""Neighboring footfalls: beyond this nothing could be said of h at all."""

PASS_WIDTH = 9
"""Lags over which another pass shows: rounds differ by some strides."""

LEAST_PULL = 1e-12
"""Of all footfalls, in sigmas squared: readings that never change have none."""

CHANCE_SIGMAS = 5.5
"""Of the mean correlation over them; four, times 1.4 as the deviations are not white."""


def compute_covariance(walk: Walk, at: Floats, sigma_d: Floats) -> Floats:
    """Of all unknowns (P, P) that were found, with the scale of d (3,) that was: the sandwich.

    The share of the Hessian that the weights keep, `bend`, is that of the Student distribution, averaged over axes.
    """
    prior = prior_precision(walk)
    jacobian = compute_jacobian(walk, at) / sigma_d[:, None]
    residual = compute_residual(walk, at) / sigma_d
    weight = compute_weights(residual, np.ones(3))
    pull = weight[:, None] * residual
    square = float((pull**2).mean())
    bend = float(weight.mean()) - 2 / (TAIL + 3) * square
    free = len(walk) / max(len(walk) - IRON / 3, 1.0)
    meat = square * free * (_sum_over_neighbors(jacobian, pull) + _sum_over_passes(jacobian, pull))
    bread = np.linalg.inv(bend * _sum_at_lag(jacobian, 0) + prior)
    return np.asarray(bread @ (meat + prior) @ bread)


def _sum_at_lag(jacobian: Floats, lag: int) -> Floats:
    """Sum (P, P) of J_k^T J_k+lag and its transpose; of J_k^T J_k alone for none."""
    columns = jacobian.shape[2]
    product = jacobian[: len(jacobian) - lag].reshape(-1, columns).T @ jacobian[lag:].reshape(-1, columns)
    return np.asarray(product + product.T if lag else product)


def _sum_over_neighbors(jacobian: Floats, pull: Floats) -> Floats:
    """J^T corr(d) J (P, P), the correlation a power of that of neighbors, all axes alike."""
    neighbors = float((pull[1:] * pull[:-1]).sum() / _sum_of_squares(pull))
    base = float(np.clip(neighbors, LEAST_CORRELATION, MOST_CORRELATED))
    last = min(LAGS, len(pull) - 1)
    return np.asarray(sum(base**lag * _sum_at_lag(jacobian, lag) for lag in range(last + 1)))


def _sum_of_squares(pull: Floats) -> float:
    return max(float((pull**2).sum()), LEAST_PULL)


def _sum_over_passes(jacobian: Floats, pull: Floats) -> Floats:
    """Add (P, P) for a walk that comes by the same places again: strides far apart are alike there.

    It shows as a correlation over a few neighboring lags that chance does not make. It may only add uncertainty.
    """
    lag = np.arange(len(pull))
    pairs = len(pull) - lag
    products = sum(correlate(axis, axis, method="fft")[len(pull) - 1 :] for axis in pull.T)
    correlation = products / _sum_of_squares(pull) * len(pull) / pairs
    about = uniform_filter1d(correlation, PASS_WIDTH)
    chance = CHANCE_SIGMAS / np.sqrt(len(pull.T) * PASS_WIDTH * pairs)
    again = (about > chance) & (lag > LAGS) & (pairs >= FEWEST_FOOTFALLS)
    added = np.zeros((jacobian.shape[2],) * 2)
    for k in np.flatnonzero(again):
        added += correlation[k] * _sum_at_lag(jacobian, int(k))
    value, axes = np.linalg.eigh(added)
    return np.asarray((axes * np.maximum(value, 0.0)) @ axes.T)
