"""Model of a magnetometer's readings along the strides of a walk, with the sensor's inertial motion, and its fit.

A stride has `PHASES` readings: the one at the footfall's stillest sample, and the others evenly over the swing that
follows, each the nearest measured one. Only swings of `MAX_SWING_S` count: in longer ones the walker stood. The
attitude is given, or that of the gyroscope levelled in the stances (`fg_nav.magnetic.footfall_field`). Places follow
from it and the specific force, with zero velocity at the footfalls: good to a few percent of the way, enough to find
the strides past the same place.

In stride k at phase i, with the inertial attitude R_ki of the instant at which the reading was measured, it is

    m_ki = S (R_ki Exp(e_i))^T Z_k^T b + h + R_ki^T d_ki

============ ==== ==================================================================================================
m_ki         uT   reading, body frame
R_ki              inertial attitude nav_R_body, `delay` before the sample; its heading drifts
e_i          rad  attitude of the magnetometer against it, the same in all strides: misalignment with the gyroscope, and
                  the error of the inertial attitude common to all swings; linear between knots
Z_k               rotation about up by delta_k, the drift: a constant rate and a random walk, linear between knots
h, S         uT,1 hard iron; soft iron, symmetric
b            uT   mean field along the walk, nav
d_ki         uT   field of the building there, nav: 6 to 13 uT per axis at a foot indoors, heavy-tailed, correlated
                  within about a meter
delay        s    of the readings behind the gyroscope
============ ==== ==================================================================================================

At the footfalls alone h along the vertical cannot be separated from the vertical part of b (docs/field.md).

d of one stride is Gaussian with a covariance over its phases, one horizontal and one vertical, learned from the
residuals. A stride as a whole is Student distributed. h, S, e, delta and the delay have Gaussian priors. The field
explains the readings and not the other way round: fields explained by noisy readings would be least for S^-1 = 0. The
unknowns are h, S (six), b, the delay, e at the knots and delta at the knots, in this order.

Fit. Gauss-Newton with the Student weights and the covariance of d of the last step. Observable is h forward and up in
each swing, to the side only between headings: a straight walk does not determine it. The size of S is one with the
strength of the field, and keeps its prior.

    A^-1 (M + prior) A^-1 + floor,    M = W C W + sum over strides k, l of W_k rho(|p_k - p_l|) s s^T W_l

is the covariance, with

========== ============================================================================================================
A          Gauss-Newton matrix with its prior
W          J^T C^-1 of each reading, Student weights included
C          covariance of d within a stride, as learned
rho        exp(-distance / `FIELD_LENGTH_M`): strides past the same place have the same field, be it the next stride,
           the next round of a circle or the way back; of it only the building's share, which exceeds `READING_UT`
s          uT, sigma of d at the phase of the reading
floor      common error of all readings of a sensor
========== ============================================================================================================

rho follows from the places and not from the residuals, because a fit hides correlation: on a circle a field that falls
off across it looks like hard iron, and leaves no residual. For the same reason d is scaled up by the share of
independent fields that the unknowns absorb.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.sparse import coo_matrix
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Floats, Ints
from fg_nav.calibration import UPPER, matrix_of, mean_up
from fg_nav.detection.stance import Stances
from fg_nav.errors import MagneticError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.magnetic.footfall_field import compute_level_R_body, integrate_attitude
from fg_nav.recording import Recording

PHASES = 16  # Readings of a stride: one every 5 cm of the way of a foot at the usual pace.
MAX_SWING_S = 2.0  # Beyond it the foot stood where no stance was found.
MAX_APART_S = 0.1  # From the instant of a phase to its reading: the spacing of a magnetometer of 10 Hz.
IRON, FIELD, DELAY, COMMON = slice(0, 9), slice(9, 12), 12, slice(13, 28)  # Places of h and S, b, the delay, e.
DRIFT = 28  # First unknown of the drift, the last ones.
WITHOUT_IRON = np.concatenate([np.zeros(3), np.eye(3)[UPPER]])  # h and S of a sensor without any.
HARD_IRON_SIGMA_UT = 30.0  # Prior of h per axis: wider than Ma's Table 1 (14 uT), which is a battery next to the chip.
SOFT_IRON_SIGMA = 0.06  # Prior of S about identity: half of all level axis ratios are then below that of Ma's Table 1.
DELAY_SIGMA_S = 0.03  # Of the readings: gdin's are 20 ms late.
AXES_SIGMA_RAD = np.radians(3.0)  # Misalignment with the gyroscope: two chips, and the rotation in a soft iron.
SWING_SIGMA_RAD, SWING_KNOTS = np.radians(0.3), 2.0  # Common error of the swings (0.1 to 0.2 deg), and its length.
DRIFT_RATE_DEG_S = 0.05  # Of the inertial heading: gyroscope bias after a rest, and some more where there was none.
DRIFT_WALK_DEG_SQRT_MIN = 2.0  # Of the inertial heading: scale errors in turns, and the bias that moves.
KNOT_S = 60.0  # Between the knots of the drift.
TAIL = 5.0  # Degrees of freedom of the Student distribution: excess kurtosis of the field at a real foot is 0 to 4.
FIELD_LENGTH_M = 1.0  # Of exp(-distance / length), a building's field: tuned on simulated walks, seeds 1 to 8; gdin.
MIN_UT = 0.03  # Of d: resolution of magnetometers.
START_UT = 10.0  # Of d, before its covariance is learned.
MAX_STEPS, MIN_STEPS, CLOSE_UT = 30, 5, 3e-3  # Of Gauss-Newton, which takes 6 to 10; the covariance of d needs five.
READING_UT = 0.25  # Of d without a building: error of magnetometer and inertial attitude in a stride (0.2 uT).
FLOOR_UT = 0.06  # Of h: readings in steps of 0.15 uT, attitudes between samples, gyroscopes at the end of their range.
REACH_M = 3.0 * FIELD_LENGTH_M  # Of correlated places.
SITES = 4  # Parts of a stride whose places are compared: a third of a meter each.
BLOCKS = 8  # Of the trial out of sample: seven eighths determine almost as much as all.
MIN_LEFT = 3.0  # Components of the field that remain where the unknowns absorb them all.

COMMON_KNOTS = (COMMON.stop - COMMON.start) // 3
_AT = np.linspace(0.0, COMMON_KNOTS - 1, PHASES)
# Shares (P, K) of the knots of e at each phase.
PHASE_SHARES = np.stack([np.interp(_AT, np.arange(COMMON_KNOTS), row) for row in np.eye(COMMON_KNOTS)], axis=1)


@dataclass(frozen=True)
class StrideReadings:
    """S strides of a walk, in order, over a recording of N samples."""

    t: Floats  # (N,) s.
    nav_R_body: Floats  # (N, 3, 3) inertial attitude; its heading drifts.
    rate: Floats  # (N, 3) rad/s, of the gyroscope.
    sample: Ints  # (S, P) of each reading; the first of each stride is that of the footfall.
    reading: Floats  # (S, P, 3) uT, body frame, not calibrated.
    place: Floats  # (S, P, 3) m, nav, by the inertial attitude.

    def __len__(self) -> int:
        return len(self.sample)

    @property
    def start_s(self) -> Floats:
        """(S,) of each stride."""
        return np.asarray(self.t[self.sample[:, 0]])

    @property
    def standing_R(self) -> Floats:
        """Attitude (S, 3, 3) at the footfalls."""
        return np.asarray(self.nav_R_body[self.sample[:, 0]])

    def motion_before(self, delay_s: float) -> tuple[Floats, Floats]:
        """Attitude (S, P, 3, 3) and rate (S, P, 3) at the instants of measurement of readings with this delay."""
        t = self.t[self.sample] - delay_s
        i = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.t) - 2)
        since = np.clip(t - self.t[i], 0.0, self.t[i + 1] - self.t[i])[..., None]
        turn = Rotation.from_rotvec((self.rate[i] * since).reshape(-1, 3)).as_matrix()
        return self.nav_R_body[i] @ turn.reshape(*i.shape, 3, 3), self.rate[i]


def read_strides(recording: Recording, stances: Stances, nav_R_body: Floats | None = None) -> StrideReadings:
    """Select the readings of each stride; attitudes `nav_R_body` (N, 3, 3) are by gyroscope and stances if None.

    Raises `MagneticError` without a magnetometer, or if it never measures; `EstimationError` without a stance, or with
    stances of another recording.
    """
    if recording.mag is None:
        raise MagneticError("the recording has no magnetometer, so nothing is known of the field: record with one.")
    measured = np.flatnonzero(np.isfinite(recording.mag).all(axis=1))
    if not len(measured):
        raise MagneticError("no sample of the magnetometer is a number: is it recorded?")
    attitude = integrate_attitude(recording, stances) if nav_R_body is None else nav_R_body
    footfall = stances.stillest(recording.gyr)
    # phases (S, P) in samples: the footfall, and evenly over the swing
    arrives, leaves = stances.spans
    begin, end = leaves[:-1] - 1, arrives[1:]
    swing = begin[:, None] + (end - begin)[:, None] * np.linspace(0.0, 1.0, PHASES - 1)
    wanted = np.column_stack([footfall[:-1], swing])
    # the measured sample nearest to each
    after = np.clip(np.searchsorted(measured, wanted), 1, max(len(measured) - 1, 1))
    low, high = measured[after - 1], measured[np.minimum(after, len(measured) - 1)]
    sample = np.where(wanted - low < high - wanted, low, high)
    off_s = np.abs(recording.t[sample] - recording.t[wanted.astype(np.int64)]).max(axis=1, initial=0.0)
    kept = (recording.t[end] - recording.t[begin] < MAX_SWING_S) & (off_s < MAX_APART_S)
    sample = sample[kept]
    # places (N, 3) m by the specific force integrated twice, with zero velocity at the footfalls
    step = np.diff(recording.t, append=recording.t[-1])[:, None]
    force = np.einsum("nij,nj->ni", attitude, recording.acc) - [0.0, 0.0, GRAVITY_M_S2]
    velocity = np.cumsum(force * step, axis=0)
    samples = np.arange(len(velocity))
    false = np.stack([np.interp(samples, footfall, axis[footfall]) for axis in velocity.T], axis=1)
    moves = (samples >= footfall[0]) & (samples <= footfall[-1])
    place = np.cumsum(np.where(moves[:, None], velocity - false, 0.0) * step, axis=0)
    return StrideReadings(recording.t, attitude, recording.gyr, sample, recording.mag[sample], place[sample])


@dataclass(frozen=True)
class StrideModel:
    """S strides; shares (S, K) of the K knots of the drift at each, and the prior precision of the knots."""

    strides: StrideReadings
    knots: Floats
    drift_precision: Floats

    def __len__(self) -> int:
        return len(self.strides)

    @property
    def unknowns(self) -> int:
        """Number of unknowns."""
        return DRIFT + len(self.drift_precision)

    @classmethod
    def of(cls, strides: StrideReadings) -> StrideModel:
        """Return the model with drift linear between knots, zero at the first stride."""
        if len(strides) < 2:
            return cls(strides, np.empty((len(strides), 0)), np.empty((0, 0)))
        t = strides.start_s - strides.start_s[0]
        since = np.linspace(0.0, t[-1], 1 + max(1, round(t[-1] / KNOT_S)))
        knots = np.stack([np.interp(t, since, row) for row in np.eye(len(since))], axis=1)
        since = since[1:]
        walk = np.radians(DRIFT_WALK_DEG_SQRT_MIN) ** 2 / 60 * np.minimum.outer(since, since)
        covariance = walk + np.radians(DRIFT_RATE_DEG_S) ** 2 * np.outer(since, since)
        return cls(strides, knots[:, 1:], np.linalg.inv(covariance))


def start_unknowns(walk: StrideModel) -> Floats:
    """Initial values: no iron, no delay, no drift, and the mean field."""
    at = np.zeros(walk.unknowns)
    at[IRON] = WITHOUT_IRON
    strides = walk.strides
    at[FIELD] = np.einsum("kpij,kpj->kpi", strides.nav_R_body[strides.sample], strides.reading).mean(axis=(0, 1))
    return at


def linearize(walk: StrideModel, at: Floats) -> tuple[Floats, Floats]:
    """Residual d (S, P, 3) uT in nav, and Jacobian (S, P, 3, U) by the unknowns, at `at` (U,)."""
    R, rate = walk.strides.motion_before(float(at[DELAY]))
    R = R @ Rotation.from_rotvec(PHASE_SHARES @ at[COMMON].reshape(-1, 3)).as_matrix()
    soft, delta = matrix_of(at[3:9]), walk.knots @ at[DRIFT:]
    c, s, zero = np.cos(delta), np.sin(delta), np.zeros(len(delta))
    back = np.stack([c, s, zero, -s, c, zero, zero, zero, zero + 1], axis=1).reshape(-1, 3, 3)  # Z^T
    field = back @ at[FIELD]
    body = np.einsum("kpji,kj->kpi", R, field)
    residual = np.einsum("kpij,kpj->kpi", R, walk.strides.reading - body @ soft - at[:3])
    bend = R @ soft
    x, y, z = np.moveaxis(body, -1, 0)
    none = np.zeros_like(x)
    cross = np.stack([none, -z, y, z, none, -x, -y, x, none], axis=-1).reshape(*x.shape, 3, 3)  # [body]x
    turn = bend @ cross
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


def _shrink(covariance: Floats, alike: Floats, count: int) -> Floats:
    """Covariance (P, P) of `count` strides, shrunk toward one with the correlation `alike` (P, P)."""
    share = PHASES / (PHASES + count)
    sigma = np.sqrt(np.diag(covariance))
    return np.asarray((1 - share) * covariance + share * alike * np.outer(sigma, sigma) + MIN_UT**2 * np.eye(PHASES))


def compute_weights(whitened: Floats) -> Floats:
    """Student weights (S,) of strides (S, P, 3) in sigmas; 1 in the mean."""
    size = whitened[0].size
    weight = (TAIL + size) / (TAIL + (whitened**2).sum(axis=(1, 2)))
    return np.asarray(weight / weight.mean())


def whiten(whitening: Floats, values: Floats) -> Floats:
    """Apply a whitening (3, P, P) to residuals (S, P, 3) or their derivatives (S, P, 3, U)."""
    rows = np.moveaxis(values, 2, 0)
    turned = np.einsum("apq,akq...->akp...", whitening, rows, optimize=True)
    return np.asarray(np.moveaxis(turned, 0, 2))


def list_blocks(strides: int) -> list[slice]:
    """List the strides of each of `BLOCKS` parts of a walk, of which each is compared with the others."""
    ends = -(-np.arange(BLOCKS + 1) * strides // BLOCKS)
    return [slice(*ends) for ends in pairwise(ends.tolist())]


@dataclass(frozen=True)
class Linearization:
    """S strides about a point: d, whitened by its covariance over the phases, and what follows for the U unknowns.

    A matrix a stride would take 14 GB after six hours, as unknowns grow with time.
    """

    residual: Floats  # (S, P, 3) uT, d in nav.
    jacobian: Floats  # (S, P, 3, U) of the prediction.
    weight: Floats  # (S,) Student weights.
    whitening: Floats  # (3, P, P) inverse roots of the covariance of d, an axis each.
    information: Floats  # (K, U, U) of each block of strides (`list_blocks`), without the prior.
    score: Floats  # (K, U) of each block: derivative of its log likelihood.

    @classmethod
    def at(cls, walk: StrideModel, unknowns: Floats, spread: Floats) -> Linearization:
        """Linearize at `unknowns` (U,), with the covariance of d `spread` (3, P, P) uT^2."""
        residual, jacobian = linearize(walk, unknowns)
        whitening = np.asarray(np.linalg.inv(np.linalg.cholesky(spread)))
        rows, J = whiten(whitening, residual), whiten(whitening, jacobian)
        weight = compute_weights(rows)
        # The normal equations of each block of strides.
        pulled = rows * weight[:, None, None]
        of_blocks = [(J[block].reshape(-1, walk.unknowns), block) for block in list_blocks(len(walk))]
        information = np.array([A.T @ (A * np.repeat(weight[block], rows[0].size)[:, None]) for A, block in of_blocks])
        score = np.array([A.T @ pulled[block].ravel() for A, block in of_blocks])
        return cls(residual, jacobian, weight, whitening, information, score)


@dataclass(frozen=True)
class IronFit:
    """Solution of a walk."""

    unknowns: Floats  # (U,) in the order of the model.
    linearization: Linearization  # About them.
    prior: Floats  # (U, U) precision.
    covariance: Floats  # (9, 9) of h and the six of S.
    level_iron: Floats  # (2,) uT, horizontal at the footfalls: h, and S times the vertical field.
    level_covariance: Floats  # (2, 2) uT^2.

    @property
    def S(self) -> Floats:
        """(3, 3)."""
        return matrix_of(self.unknowns[3:9])

    @property
    def b(self) -> Floats:
        """(3,) uT."""
        return np.asarray(self.unknowns[FIELD])

    @property
    def level_sigma(self) -> float:
        """Of the worse horizontal direction, uT."""
        return float(np.sqrt(np.linalg.eigvalsh(self.level_covariance)[1]))


def fit_iron(walk: StrideModel) -> IronFit:
    """Estimate the iron, with all other unknowns, by robust Gauss-Newton from zero, and its sandwich covariance."""
    at, spread = start_unknowns(walk), START_UT**2 * np.stack([np.eye(PHASES)] * 3)
    # Prior about `rest`, zero information on b; off-diagonal S has sigma / sqrt(2), which makes it isotropic.
    prior, rest = np.zeros((walk.unknowns,) * 2), np.zeros(walk.unknowns)
    soft = np.where(UPPER[0] == UPPER[1], 1.0, 0.5) * SOFT_IRON_SIGMA**2
    prior[IRON, IRON] = np.diag(1 / np.concatenate([np.full(3, HARD_IRON_SIGMA_UT**2), soft]))
    prior[DELAY, DELAY] = DELAY_SIGMA_S**-2
    apart = np.abs(np.subtract.outer(np.arange(COMMON_KNOTS), np.arange(COMMON_KNOTS)))
    common = AXES_SIGMA_RAD**2 + SWING_SIGMA_RAD**2 * np.exp(-apart / SWING_KNOTS)
    prior[COMMON, COMMON] = np.kron(np.linalg.inv(common), np.eye(3))
    prior[DRIFT:, DRIFT:] = walk.drift_precision
    rest[IRON] = WITHOUT_IRON
    # Correlation of a field over `FIELD_LENGTH_M`, toward which that of d is shrunk: few strides determine it poorly.
    place = walk.strides.place
    alike = np.exp(-np.linalg.norm(place[:, :, None] - place[:, None], axis=3).mean(axis=0) / FIELD_LENGTH_M)
    last = Linearization.at(walk, at, spread)
    for step in range(MAX_STEPS):
        if step:
            del last  # as large as all else: not kept beside the next one
            last = Linearization.at(walk, at, spread)
        normal = last.information.sum(axis=0) + prior
        change = np.linalg.solve(normal, last.score.sum(axis=0) - prior @ (at - rest))
        if step >= MIN_STEPS and np.abs(change[:3]).max() < CLOSE_UT:
            break
        at = at + change
        # Covariance of d over the phases of a stride, the same for both axes over the ground.
        pulled = (last.residual - last.jacobian @ change) * np.sqrt(last.weight)[:, None, None]
        square = np.einsum("kpa,kqa->apq", pulled, pulled) / len(walk)
        level = _shrink((square[0] + square[1]) / 2, alike, 2 * len(walk))
        spread = np.stack([level, level, _shrink(square[2], alike, len(walk))])
    covariance = _compute_covariance(walk, last, prior)[IRON, IRON]
    up = mean_up(walk.strides.standing_R)
    level = compute_level_R_body(up)[:2] @ sum_iron(up, float(at[FIELD][2]))
    return IronFit(at, last, prior, covariance, level @ (at[IRON] - WITHOUT_IRON), level @ covariance @ level.T)


def sum_iron(up: Floats, vertical_uT: float) -> Floats:
    """Jacobian (3, 9) of the iron, in body axes, by h and the six of S with the vertical field along `up` (3,)."""
    by_soft = np.stack([matrix_of(one) @ up for one in np.eye(6)], axis=1)
    return np.hstack([np.eye(3), vertical_uT * by_soft])


def _compute_covariance(walk: StrideModel, fit: Linearization, prior: Floats) -> Floats:
    """Sandwich covariance (U, U) of all unknowns: strides passing one place are not independent."""
    bread = np.linalg.inv(fit.information.sum(axis=0) + prior)
    size = float((whiten(fit.whitening, fit.residual) ** 2).mean())
    white = whiten(fit.whitening, fit.jacobian)
    J = white * fit.weight[:, None, None, None]
    J = J.reshape(-1, walk.unknowns)
    within = size * J.T @ J
    # share of the variance of d that is the building's field, repeated wherever the walk returns
    square = float((fit.residual**2).mean())
    share = 1.0 - READING_UT**2 / max(square, READING_UT**2)
    between = share * _sum_over_places(walk, fit, white)
    # project to positive semidefinite: correlation may only add uncertainty
    value, axes = np.linalg.eigh(between)
    between = (axes * np.maximum(value, 0.0)) @ axes.T
    # independent fields of three components, and those left by the unknowns: all but e and the delay
    _, alike = _compare_places(walk.strides.place[..., :2].mean(axis=1), np.arange(len(walk)))
    fields = 3 * len(walk) ** 2 / (len(walk) + 2 * share * alike.sum())
    absorbed = 1 + FIELD.stop - 2 + walk.unknowns - COMMON.stop
    growth = float(fields / max(fields - absorbed, MIN_LEFT))
    covariance = bread @ (growth * (within + between) + prior) @ bread
    covariance[:3, :3] += FLOOR_UT**2 * np.eye(3)
    return np.asarray(covariance)


def _sum_over_places(walk: StrideModel, fit: Linearization, white: Floats) -> Floats:
    """Cross-stride part (U, U) of M, the covariance of the score, if all of d were the building's field.

    `white` is the whitened Jacobian of the fit.
    """
    sigma = (fit.residual**2).mean(axis=0)
    sigma[:, :2] = sigma[:, :2].mean(axis=1, keepdims=True)
    sigma = np.sqrt(sigma)
    pulls = np.swapaxes(fit.whitening, 1, 2) @ np.moveaxis(white, 2, 0).reshape(3, len(walk), PHASES, -1).swapaxes(0, 1)
    pulls = pulls * fit.weight[:, None, None, None] * sigma.T[None, :, :, None]
    sites = pulls.reshape(len(walk), 3, SITES, PHASES // SITES, -1).sum(axis=3).swapaxes(1, 2)
    place = walk.strides.place.reshape(len(walk), SITES, PHASES // SITES, 3).mean(axis=2)
    pair, alike = _compare_places(place[..., :2].reshape(-1, 2), np.repeat(np.arange(len(walk)), SITES))
    rows = sites.reshape(len(walk) * SITES, -1)
    near = coo_matrix((alike, (pair[:, 0], pair[:, 1])), shape=(len(rows),) * 2).tocsr() @ rows
    unknowns = fit.jacobian.shape[3]
    half = rows.reshape(-1, unknowns).T @ near.reshape(-1, unknowns)
    return np.asarray(half + half.T)


def _compare_places(place: Floats, stride: Ints) -> tuple[Ints, Floats]:
    """Pairs (M, 2) of places (N, 2) m of different strides (N,) within reach, and their fields' correlation (M,)."""
    pair = cKDTree(place).query_pairs(REACH_M, output_type="ndarray")
    pair = pair[stride[pair[:, 0]] != stride[pair[:, 1]]]
    apart = np.linalg.norm(place[pair[:, 0]] - place[pair[:, 1]], axis=1)
    return pair, np.exp(-apart / FIELD_LENGTH_M)
