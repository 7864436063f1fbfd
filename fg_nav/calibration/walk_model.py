"""The readings of a walk: what turns with the foot is the sensor's, what stays is the building's.

In stride k at phase i, with the inertial attitude R_ki of the moment at which the reading was measured, it is

    m_ki = S (R_ki Exp(e_i))^T Z_k^T b + h + R_ki^T d_ki

============ ==== ==================================================================================================
m_ki         uT   reading, body frame
R_ki              inertial attitude nav_R_body, `delay` before the sample; its heading drifts
e_i          rad  how the attitude of the magnetometer differs from it in all strides alike: axes that do not agree with
                  the gyroscope's, and what the inertial attitude has wrong in each swing; a line between knots
Z_k               turn about up by delta_k, the drift: a constant rate and a random walk, a line between knots
h, S         uT,1 hard iron; soft iron, symmetric
b            uT   mean field along the walk, nav
d_ki         uT   what the building adds there, nav: 6 to 13 uT per axis at a foot indoors, heavy-tailed, alike within
                  about a meter
delay        s    of the readings behind the gyroscope
============ ==== ==================================================================================================

Why the swings: at the footfalls the foot stands level, and h along the vertical is one with the vertical part of b but
for the degrees by which the foot stands otherwise from time to time. The inertial tilt is wrong by as much. A fit that
takes it for exact sees a field that does not turn as the tilt does, and calls the vertical field iron: 32 uT too much
with a sigma of 3 in a field without a building. In the swing the pitch turns by 80 deg, and the error of the tilt is
next to nothing.

d of one stride is Gaussian with a covariance over its phases, one over the ground and one upright, learned from the
residuals: neighbors in a swing feel nearly one field, and the foot aloft feels less of the floor. A stride as a whole
is Student distributed. h, S, e, delta and the delay have Gaussian priors. The field explains the readings and not the
other way round: fields explained by noisy readings would be least for S^-1 = 0. The unknowns are h, S (six), b, the
delay, e at the knots and delta at the knots, in this order.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Bools, Floats
from fg_nav.calibration.magnetometer import UPPER, matrix_of
from fg_nav.calibration.stride_readings import PHASES, StrideReadings

IRON, FIELD, DELAY, COMMON = slice(0, 9), slice(9, 12), 12, slice(13, 28)
"""Where the unknowns stand: h and S, b, the delay, e; the drift comes last."""

DRIFT = 28  # First unknown of the drift.
WITHOUT_IRON = np.concatenate([np.zeros(3), np.eye(3)[UPPER]])  # h and S of a sensor that carries none.


HARD_IRON_SIGMA_UT = 30.0  # Prior of h per axis: wider than Ma's Table 1 (14 uT), which is a battery next to the chip.
SOFT_IRON_SIGMA = 0.06  # Prior of S about identity: half of all level axis ratios are then below that of Ma's Table 1.
DELAY_SIGMA_S = 0.03  # Of the readings: gdin's are 20 ms late.

AXES_SIGMA_RAD = np.radians(3.0)
"""Of the magnetometer's axes about the gyroscope's: two chips on a board, and the rotation in a soft iron."""

SWING_SIGMA_RAD, SWING_KNOTS = np.radians(0.3), 2.0
"""Of the inertial attitude, what all swings have wrong alike (0.1 to 0.2 deg on simulated feet), and over how many
knots."""

DRIFT_RATE_DEG_S = 0.05
"""Of the inertial heading: what a rest leaves of the gyroscope's bias, and some more where there was none."""

DRIFT_WALK_DEG_SQRT_MIN = 2.0  # Of the inertial heading: scale errors in turns, and the bias that moves.
KNOT_S = 60.0  # Between the knots of the drift.
TAIL = 5.0  # Degrees of freedom of the Student distribution: excess kurtosis of the field at a real foot is 0 to 4.

FIELD_LENGTH_M = 1.0
"""Over which the field of a building is alike, as exp(-distance / length): the simulator's indoor field, and gdin's
neighboring footfalls (0.2 to 0.25). Tuned on simulated walks, seeds 1 to 8."""

MIN_UT = 0.03  # Of d: no magnetometer resolves less.


@dataclass(frozen=True)
class Walk:
    """S strides; shares (S, K) of the K knots of the drift at each, and the precision of the knots."""

    strides: StrideReadings
    knots: Floats
    drift_precision: Floats

    def __len__(self) -> int:
        return len(self.strides)

    @property
    def unknowns(self) -> int:
        """How many."""
        return DRIFT + len(self.drift_precision)

    @classmethod
    def of(cls, strides: StrideReadings) -> Walk:
        """With knots from the first stride, where the drift is nothing, to the last."""
        if len(strides) < 2:
            return cls(strides, np.empty((len(strides), 0)), np.empty((0, 0)))
        t = strides.start_s - strides.start_s[0]
        since = np.linspace(0.0, t[-1], 1 + max(1, round(t[-1] / KNOT_S)))
        knots = np.stack([np.interp(t, since, row) for row in np.eye(len(since))], axis=1)
        since = since[1:]
        walk = np.radians(DRIFT_WALK_DEG_SQRT_MIN) ** 2 / 60 * np.minimum.outer(since, since)
        covariance = walk + np.radians(DRIFT_RATE_DEG_S) ** 2 * np.outer(since, since)
        return cls(strides, knots[:, 1:], np.linalg.inv(covariance))

    def part(self, chosen: Bools) -> Walk:
        """Some of the strides, the same knots."""
        return replace(self, strides=self.strides.part(chosen), knots=self.knots[chosen])


COMMON_KNOTS = (COMMON.stop - COMMON.start) // 3
_AT = np.linspace(0.0, COMMON_KNOTS - 1, PHASES)
PHASE_SHARES = np.stack([np.interp(_AT, np.arange(COMMON_KNOTS), row) for row in np.eye(COMMON_KNOTS)], axis=1)
"""Shares (P, K) of the knots of e at each phase."""


def prior_precision(walk: Walk) -> Floats:
    """Of all unknowns; b has none. Off the diagonal S spreads less by the root of two, the same in all directions."""
    soft = np.where(UPPER[0] == UPPER[1], 1.0, 0.5) * SOFT_IRON_SIGMA**2
    precision = np.zeros((walk.unknowns,) * 2)
    precision[IRON, IRON] = np.diag(1 / np.concatenate([np.full(3, HARD_IRON_SIGMA_UT**2), soft]))
    precision[DELAY, DELAY] = DELAY_SIGMA_S**-2
    apart = np.abs(np.subtract.outer(np.arange(COMMON_KNOTS), np.arange(COMMON_KNOTS)))
    common = AXES_SIGMA_RAD**2 + SWING_SIGMA_RAD**2 * np.exp(-apart / SWING_KNOTS)
    precision[COMMON, COMMON] = np.kron(np.linalg.inv(common), np.eye(3))
    precision[DRIFT:, DRIFT:] = walk.drift_precision
    return precision


def start_unknowns(walk: Walk) -> Floats:
    """No iron, no delay, no drift, and the mean field."""
    at = np.zeros(walk.unknowns)
    at[IRON] = WITHOUT_IRON
    strides = walk.strides
    at[FIELD] = np.einsum("kpij,kpj->kpi", strides.nav_R_body[strides.sample], strides.reading).mean(axis=(0, 1))
    return at


def linearize(walk: Walk, at: Floats) -> tuple[Floats, Floats]:
    """What the building adds (S, P, 3) uT, nav, and the derivative (S, P, 3, U) of the rest by the unknowns."""
    R, rate = walk.strides.motion_before(float(at[DELAY]))
    R = R @ Rotation.from_rotvec(PHASE_SHARES @ at[COMMON].reshape(-1, 3)).as_matrix()
    soft, back = matrix_of(at[3:9]), _rotate_back(walk, at)
    field = back @ at[FIELD]
    body = np.einsum("kpji,kj->kpi", R, field)
    residual = np.einsum("kpij,kpj->kpi", R, walk.strides.reading - body @ soft - at[:3])
    bend = R @ soft
    turn = bend @ _cross(body)
    level = bend @ np.swapaxes(R, -1, -2)
    by_delta = np.stack([field[:, 1], -field[:, 0], np.zeros(len(field))], axis=1)
    parts = (
        R,
        np.stack([np.einsum("kpij,kpj->kpi", R, body @ matrix_of(one)) for one in np.eye(6)], axis=3),
        level @ back[:, None],
        -np.einsum("kpij,kpj->kpi", turn, rate)[..., None],
        np.einsum("kpij,pq->kpiqj", turn, PHASE_SHARES).reshape(*residual.shape, -1),
        np.einsum("kpi,kq->kpiq", np.einsum("kpij,kj->kpi", level, by_delta), walk.knots),
    )
    return residual, np.concatenate(parts, axis=3)


def _rotate_back(walk: Walk, at: Floats) -> Floats:
    """Z^T (S, 3, 3)."""
    delta = walk.knots @ at[DRIFT:]
    c, s, zero = np.cos(delta), np.sin(delta), np.zeros(len(delta))
    return np.stack([c, s, zero, -s, c, zero, zero, zero, zero + 1], axis=1).reshape(-1, 3, 3)


def _cross(vector: Floats) -> Floats:
    """[v]x (..., 3, 3)."""
    x, y, z = np.moveaxis(vector, -1, 0)
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*x.shape, 3, 3)


def learn_spread(walk: Walk, residual: Floats, weight: Floats) -> Floats:
    """Covariance (3, P, P) of d over the phases of a stride, the same for both axes over the ground.

    Few strides show few of its numbers: it is drawn toward a field that is alike over `FIELD_LENGTH_M`.
    """
    pulled = residual * np.sqrt(weight)[:, None, None]
    square = np.einsum("kpa,kqa->apq", pulled, pulled) / len(residual)
    alike = _alike_in_stride(walk)
    level = _draw_toward((square[0] + square[1]) / 2, alike, 2 * len(residual))
    return np.stack([level, level, _draw_toward(square[2], alike, len(residual))])


def _draw_toward(covariance: Floats, alike: Floats, count: int) -> Floats:
    share = PHASES / (PHASES + count)
    sigma = np.sqrt(np.diag(covariance))
    return np.asarray((1 - share) * covariance + share * alike * np.outer(sigma, sigma) + MIN_UT**2 * np.eye(PHASES))


def _alike_in_stride(walk: Walk) -> Floats:
    """Correlation (P, P) of a building's field between the phases of a stride."""
    place = walk.strides.place
    apart = np.linalg.norm(place[:, :, None] - place[:, None], axis=3).mean(axis=0)
    return np.asarray(np.exp(-apart / FIELD_LENGTH_M))


def compute_weights(whitened: Floats) -> Floats:
    """(S,) of the Student distribution, of strides (S, P, 3) in sigmas; 1 in the mean."""
    size = whitened[0].size
    weight = (TAIL + size) / (TAIL + (whitened**2).sum(axis=(1, 2)))
    return np.asarray(weight / weight.mean())


def find_whitening(spread: Floats) -> Floats:
    """(3, P, P): what makes strides of this covariance white."""
    return np.asarray(np.linalg.inv(np.linalg.cholesky(spread)))


def whiten(whitening: Floats, values: Floats) -> Floats:
    """Apply to residuals (S, P, 3) or their derivatives (S, P, 3, U)."""
    rows = np.moveaxis(values, 2, 0)
    turned = np.einsum("apq,akq...->akp...", whitening, rows, optimize=True)
    return np.asarray(np.moveaxis(turned, 0, 2))
