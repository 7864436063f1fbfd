"""Hard and soft iron from an ordinary walk: what turns with the foot is the sensor's, what stays is the building's.

At footfall k, with the inertial attitude R_k, the reading is

    m_k = S R_k^T Z_k^T b + h + R_k^T d_k

============ ==== ==================================================================================================
m_k          uT   mean reading over the footfall, body frame
R_k               inertial attitude nav_R_body; its heading drifts
Z_k               turn about up by delta_k, that drift: a constant rate and a random walk, a line between knots
h, S         uT,1 hard iron; soft iron, symmetric
b            uT   mean field along the walk, nav
d_k          uT   what the building adds there, nav: 6 to 13 uT per axis at a foot indoors, heavy-tailed, alike at
                  neighbouring footfalls
============ ==== ==================================================================================================

The most likely h, S, b, delta under a Student distribution of d, with Gaussian priors on h, S and delta: Gauss-Newton
steps with the weights of the last one. The scale of d is found on the way, over the ground and upright apart. It is the
readings that are explained by the field and not the other way round: fields explained by noisy readings would be least
for S^-1 = 0.

Covariance, a sandwich: A^-1 (J^T W corr(d) W J + prior) A^-1, the correlation of d from footfall to footfall being that
of the residuals, and no less than `least_correlation`, for a straight hides a part of it. A walk of several rounds
sees the same places again: the correlation of its residuals shows it, and it is counted (`_of_other_passes`).

What a level floor cannot tell: h along the vertical is one with b, and what S makes of the vertical field is one with
h over the ground. Both keep their priors, and the covariance says so; the heading of a foot that stands flat needs
neither. The swings, whose pitch goes round by 80 deg, show the vertical part: on 8 simulated demos to 5 uT, but they
would say 3, for their samples feel one field after another along the way, and over the ground h is no better for them.
They are not used.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import correlate
from scipy.stats import chi2

from fg_nav.arrays import Bools, Floats
from fg_nav.calibration.magnetometer import UPPER, MagnetometerCalibration
from fg_nav.errors import CalibrationError
from fg_nav.frames import wrap
from fg_nav.magnetic.compass import level_R_body
from fg_nav.magnetic.footfall_field import FootfallField

METHOD = "walk"

IRON = 9
"""h and S come first among the unknowns, then b, then delta at the knots."""


WITHOUT_IRON = np.concatenate([np.zeros(3), np.eye(3)[UPPER]])
"""h and S of a sensor that carries none."""

SEEN = float(chi2.ppf(0.95, 2))
"""Squared sigmas over the ground below which iron that is found may be none. Soft iron alone does not count: of what it
does to the level field a real floor shows next to nothing."""

MOST_CORRELATED = 0.9
"""Neighbouring footfalls: beyond this nothing could be said of h at all."""

MOST_STEPS, CLOSE_UT = 30, 3e-3
"""Of Gauss-Newton: it takes 5 to 15, and steps below this change nothing."""

DRIFT_SIGMAS, LINE_STEP_RAD = 3.0, 0.1
"""How fast a drift is looked for where spreads are compared, and in what steps at the end of the walk."""

PASS_WIDTH = 9
"""Lags over which another pass shows: rounds differ by some strides."""

CHANCE_SIGMAS = 5.5
"""Of the mean correlation over them; four, times 1.4 as the deviations are not white."""


@dataclass(frozen=True)
class WalkCalibrationParameters:
    """What is believed before the walk, and what is asked of the result."""

    hard_iron_sigma_uT: float = 30.0
    """Of h per axis: wider than Ma's Table 1 (14 uT), which is a battery beside the chip."""
    soft_iron_sigma: float = 0.06
    """Of S about identity: half of all level axis ratios are then below that of Ma's Table 1."""
    drift_rate_deg_s: float = 0.05
    """Of the inertial heading: what a rest leaves of the gyroscope's bias, and some more where there was none."""
    drift_walk_deg_sqrt_min: float = 2.0
    """Of the inertial heading: scale errors in turns, and the bias that moves."""
    knot_s: float = 60.0
    """Between the knots of the drift."""
    tail: float = 5.0
    """Degrees of freedom of the Student distribution: excess kurtosis of the field at a real foot is 0 to 4."""
    lags: int = 8
    """Footfalls over which neighbours may be alike: ten metres."""
    least_correlation: float = 0.4
    """Of neighbouring footfalls, falling off as a power: gdin walks have 0.2 to 0.25, and their mean hides some.
    Tuned on 60 simulated demos (seeds below 100), whose errors it makes 1.03 sigmas instead of 1.26."""
    fewest: int = 20
    """Footfalls: a footfall tells h to 10 uT, twenty to 2 uT."""
    largest_sigma_uT: float = 4.0
    """Of h over the ground: 11 deg of heading at 21 uT; a compass that is worse than that is no use."""
    must_gain: bool = True
    """Refuse where no iron shows, or the spread out of sample is not less than before; False to study walks."""
    blocks: int = 8
    """The walk is cut into so many for the trial out of sample: seven eighths know almost what all know."""


@dataclass(frozen=True)
class Spread:
    """Circular standard deviation of compass minus inertial heading, deg, about a line in time: the drift."""

    before_deg: float
    after_deg: float


def calibrate_on_walk(
    field: FootfallField, parameters: WalkCalibrationParameters = WalkCalibrationParameters()
) -> MagnetometerCalibration:
    """Find the iron from the field at the footfalls of any walk that turns.

    Parameters
    ----------
    field : of the walk, not calibrated; footfalls without a field are left out.
    parameters : see there.

    Raises
    ------
    CalibrationError
        With the reason: too few footfalls, headings that do not go round, or nothing gained out of sample.
    """
    p = parameters
    walk = _Walk.of(field, p)
    if len(walk) < p.fewest:
        raise CalibrationError(
            f"{len(walk)} footfalls with a field are too few to tell the shoe's iron from the building's: "
            f"walk {p.fewest} strides or more, with turns."
        )
    fit = _fitted(walk, p)
    sigma = fit.level_sigma
    if sigma > p.largest_sigma_uT:
        raise CalibrationError(
            f"after {len(walk)} footfalls the hard iron would be known to {sigma:.1f} uT only, for {_turned(walk)}: "
            "walk longer and through all headings, such as a round or a figure of eight, or calibrate on a loop."
        )
    if p.must_gain and fit.seen < SEEN:
        found = float(np.linalg.norm(fit.level_iron))
        raise CalibrationError(
            f"no iron shows against the building: over the ground {found:.1f} uT were found, and {len(walk)} footfalls "
            f"tell it to {sigma:.1f} uT per axis; go on without a calibration, or walk longer."
        )
    spread = _out_of_sample(walk, p, fit)
    if p.must_gain and not spread.after_deg < spread.before_deg:
        raise CalibrationError(
            "the iron found in one part of the walk does not help in the others: compass minus inertial heading would "
            f"spread by {spread.after_deg:.1f} deg instead of {spread.before_deg:.1f}; go on without a calibration, "
            "or walk longer."
        )
    return _calibration(fit, walk, spread)


def spread_out_of_sample(
    field: FootfallField, parameters: WalkCalibrationParameters = WalkCalibrationParameters()
) -> Spread:
    """Cut the walk into blocks and correct each by a calibration on the others, refused or not."""
    walk = _Walk.of(field, parameters)
    return _out_of_sample(walk, parameters, _fitted(walk, parameters))


def level_iron(calibration: MagnetometerCalibration, field: FootfallField) -> tuple[Floats, Floats]:
    """What the iron adds to the level field of a foot that stands flat: h, and what S makes of the vertical field.

    Parameters
    ----------
    calibration : any, with a covariance.
    field : of a walk, not calibrated: it says which way up is and how strong the vertical field is.

    Returns
    -------
    (2,) uT in levelled axes, forward and left, and its covariance (2, 2) uT^2. A heading errs by up to its length over
    the level strength, once to either side in a turn.
    """
    S = np.linalg.inv(calibration.correction)
    by_correction = np.eye(IRON)
    by_correction[3:, 3:] = np.stack([-(S @ _symmetric(one) @ S)[UPPER] for one in np.eye(6)], axis=1)
    up = _mean_up(field.nav_R_body)
    added = _level_sum(up, float(np.nanmean(corrected_field(field, calibration).nav_field[:, 2])))
    change = np.concatenate([calibration.hard_iron_uT, S[UPPER]]) - WITHOUT_IRON
    by_parameters = added @ by_correction
    return added @ change, by_parameters @ calibration.covariance @ by_parameters.T


def corrected_field(field: FootfallField, calibration: MagnetometerCalibration) -> FootfallField:
    """Return the field at the footfalls as a corrected magnetometer would have it; its scatter and slope stay."""
    return replace(field, body_field=calibration.corrected(field.body_field))


def circular_sd_deg(angle: Floats) -> float:
    """Circular standard deviation, deg, of angles (N,) rad; NaN ones are left out."""
    resultant = min(float(np.abs(np.nanmean(np.exp(1j * angle)))), 1.0)
    return float(np.degrees(np.sqrt(-2 * np.log(max(resultant, 1e-12)))))


@dataclass(frozen=True)
class _Walk:
    """N footfalls with a field; shares (N, K) of the K knots of the drift at each, and the precision of the knots."""

    field: FootfallField
    knots: Floats
    drift_precision: Floats

    def __len__(self) -> int:
        return len(self.field)

    @property
    def reading(self) -> Floats:
        return self.field.body_field

    @property
    def nav_R_body(self) -> Floats:
        return self.field.nav_R_body

    @classmethod
    def of(cls, field: FootfallField, p: WalkCalibrationParameters) -> _Walk:
        """With knots from the first footfall, where the drift is nothing, to the last."""
        field = _chosen(field, np.asarray(np.isfinite(field.body_field).all(axis=1)))
        if len(field) < 2:
            return cls(field, np.empty((len(field), 0)), np.empty((0, 0)))
        duration = field.t[-1] - field.t[0]
        since = np.linspace(0.0, duration, 1 + max(1, round(duration / p.knot_s)))
        knots = np.stack([np.interp(field.t - field.t[0], since, row) for row in np.eye(len(since))], axis=1)
        since = since[1:]
        walk = np.radians(p.drift_walk_deg_sqrt_min) ** 2 / 60 * np.minimum.outer(since, since)
        covariance = walk + np.radians(p.drift_rate_deg_s) ** 2 * np.outer(since, since)
        return cls(field, knots[:, 1:], np.linalg.inv(covariance))

    def part(self, chosen: Bools) -> _Walk:
        """Some of the footfalls, the same knots."""
        return _Walk(_chosen(self.field, chosen), self.knots[chosen], self.drift_precision)


def _chosen(field: FootfallField, chosen: Bools) -> FootfallField:
    """Some of the footfalls."""
    return FootfallField(*(getattr(field, f.name)[chosen] for f in fields(field)))


@dataclass(frozen=True)
class _Fit:
    """h, S, b, drift at the knots; scale of d (3,); covariance of h and the six of S; mean direction of up (body)."""

    h: Floats
    S: Floats
    b: Floats
    drift: Floats
    sigma_d: Floats
    covariance: Floats

    up: Floats

    @property
    def unknowns(self) -> Floats:
        """(P,) in the order of the Jacobian."""
        return np.concatenate([self.h, self.S[UPPER], self.b, self.drift])

    def corrected(self, reading: Floats) -> Floats:
        """Field (N, 3) uT."""
        return np.asarray(np.linalg.solve(self.S, (reading - self.h).T).T)

    @property
    def level_covariance(self) -> Floats:
        """Of h over the ground with what S makes of the vertical field, (2, 2) uT^2."""
        level = _level_sum(self.up, float(self.b[2]))
        return np.asarray(level @ self.covariance @ level.T)

    @property
    def level_iron(self) -> Floats:
        """What h and S add over the ground, (2,) uT."""
        return np.asarray(_level_sum(self.up, float(self.b[2])) @ (self.unknowns[:IRON] - WITHOUT_IRON))

    @property
    def seen(self) -> float:
        """Squared sigmas by which the sensor differs over the ground from one without iron; chi-square with two."""
        found = self.level_iron
        return float(found @ np.linalg.solve(self.level_covariance, found))

    @property
    def level_sigma(self) -> float:
        """Of the worse direction over the ground, uT."""
        return float(np.sqrt(np.linalg.eigvalsh(self.level_covariance)[1]))


def _fitted(walk: _Walk, p: WalkCalibrationParameters, first: _Fit | None = None) -> _Fit:
    """Gauss-Newton with Student weights, from no iron or from a fit to much the same walk."""
    prior = _prior_precision(walk, p)
    rest = np.concatenate([WITHOUT_IRON, _mean_field(walk), np.zeros(walk.knots.shape[1])])
    at, sigma = (rest, np.full(3, 10.0)) if first is None else (first.unknowns, first.sigma_d)
    rest = np.where(np.arange(len(rest)) < IRON, rest, 0.0)
    for _ in range(MOST_STEPS):
        residual, jacobian = _residual(walk, at), _jacobian(walk, at)
        weight = _weights(residual, sigma, p.tail)
        sigma = np.sqrt(_scales(residual, weight))
        scaled = jacobian / sigma[:, None]
        normal = np.einsum("n,nij,nik->jk", weight, scaled, scaled) + prior
        right = np.einsum("n,nij,ni->j", weight, scaled, residual / sigma) - prior @ (at - rest)
        step = np.linalg.solve(normal, right)
        at = at + step
        if np.abs(step[:3]).max() < CLOSE_UT:
            break
    covariance = _covariance(walk, at, sigma, prior, p) if first is None else np.zeros((IRON, IRON))
    return _Fit(
        at[:3], _symmetric(at[3:9]), at[9:12], at[12:], sigma, covariance[:IRON, :IRON], _mean_up(walk.nav_R_body)
    )


def _mean_field(walk: _Walk) -> Floats:
    return np.asarray(np.einsum("nij,nj->ni", walk.nav_R_body, walk.reading).mean(axis=0))


def _mean_up(nav_R_body: Floats) -> Floats:
    """Direction (3,) of up in the body."""
    up = nav_R_body[:, 2].mean(axis=0)
    return np.asarray(up / np.linalg.norm(up))


def _level_sum(up: Floats, vertical_uT: float) -> Floats:
    """(2, 9): what h and the six of S add up to over the ground, in levelled axes, where up is up in the body."""
    by_soft = np.stack([_symmetric(one) @ up for one in np.eye(6)], axis=1)
    return np.asarray(level_R_body(up)[:2] @ np.hstack([np.eye(3), vertical_uT * by_soft]))


def _prior_precision(walk: _Walk, p: WalkCalibrationParameters) -> Floats:
    """Of all unknowns; b has none. Off the diagonal S spreads less by the root of two, the same in all directions."""
    soft = np.where(UPPER[0] == UPPER[1], 1.0, 0.5) * p.soft_iron_sigma**2
    iron = np.concatenate([np.full(3, p.hard_iron_sigma_uT**2), soft])
    precision = np.zeros((12 + len(walk.drift_precision),) * 2)
    precision[:IRON, :IRON] = np.diag(1 / iron)
    precision[12:, 12:] = walk.drift_precision
    return precision


def _symmetric(upper: Floats) -> Floats:
    matrix = np.zeros((3, 3))
    matrix[UPPER] = upper
    return matrix + np.triu(matrix, 1).T


def _turned_back(walk: _Walk, at: Floats) -> tuple[Floats, Floats]:
    """Z^T b (N, 3), and its derivative by delta."""
    delta = walk.knots @ at[12:]
    c, s, (x, y, z) = np.cos(delta), np.sin(delta), at[9:12]
    field = np.stack([c * x + s * y, c * y - s * x, np.full_like(c, z)], axis=1)
    return field, np.stack([field[:, 1], -field[:, 0], np.zeros_like(c)], axis=1)


def _residual(walk: _Walk, at: Floats) -> Floats:
    """What the building adds (N, 3) uT, in nav."""
    field, _ = _turned_back(walk, at)
    body = np.einsum("nji,nj->ni", walk.nav_R_body, field)
    return np.asarray(np.einsum("nij,nj->ni", walk.nav_R_body, walk.reading - body @ _symmetric(at[3:9]) - at[:3]))


def _jacobian(walk: _Walk, at: Floats) -> Floats:
    """Of what is explained, in nav, by the unknowns (N, 3, P)."""
    field, by_delta = _turned_back(walk, at)
    R, S = walk.nav_R_body, _symmetric(at[3:9])
    body = np.einsum("nji,nj->ni", R, field)
    jacobian = np.zeros((len(walk), 3, len(at)))
    jacobian[:, :, :3] = R
    for column, (i, j) in enumerate(zip(*UPPER, strict=True)):
        jacobian[:, :, 3 + column] = R[:, :, i] * body[:, j, None]
        if i != j:
            jacobian[:, :, 3 + column] += R[:, :, j] * body[:, i, None]
    R_S_Rt = R @ S @ R.transpose(0, 2, 1)
    delta = walk.knots @ at[12:]
    c, s, zero = np.cos(delta), np.sin(delta), np.zeros(len(walk))
    Zt = np.stack([c, s, zero, -s, c, zero, zero, zero, zero + 1], axis=1).reshape(-1, 3, 3)
    jacobian[:, :, 9:12] = R_S_Rt @ Zt
    jacobian[:, :, 12:] = np.einsum("nij,nj,nk->nik", R_S_Rt, by_delta, walk.knots)
    return jacobian


def _weights(residual: Floats, sigma: Floats, tail: float) -> Floats:
    """(N,) of the Student distribution; 1 in the mean."""
    return np.asarray((tail + 3) / (tail + ((residual / sigma) ** 2).sum(axis=1)))


def _scales(residual: Floats, weight: Floats) -> Floats:
    """Squared scale (3,) of d: one over the ground, one upright."""
    square = (weight[:, None] * residual**2).mean(axis=0) + 1e-6
    level = square[:2].mean()
    return np.array([level, level, square[2]])


def _covariance(walk: _Walk, at: Floats, sigma: Floats, prior: Floats, p: WalkCalibrationParameters) -> Floats:
    """Of all unknowns (P, P): the sandwich.

    The share of the Hessian that the weights keep, `bend`, is that of the Student distribution, averaged over axes.
    """
    jacobian = _jacobian(walk, at) / sigma[:, None]
    residual = _residual(walk, at) / sigma
    weight = _weights(residual, np.ones(3), p.tail)
    pull = weight[:, None] * residual
    square = float((pull**2).mean())
    bend = float(weight.mean()) - 2 / (p.tail + 3) * square
    free = len(walk) / max(len(walk) - IRON / 3, 1.0)
    meat = square * free * (_of_neighbours(jacobian, pull, p) + _of_other_passes(jacobian, pull, p))
    bread = np.linalg.inv(bend * _at_lag(jacobian, 0) + prior)
    return np.asarray(bread @ (meat + prior) @ bread)


def _at_lag(jacobian: Floats, lag: int) -> Floats:
    """Sum (P, P) of J_k^T J_k+lag and its transpose; of J_k^T J_k alone for none."""
    columns = jacobian.shape[2]
    product = jacobian[: len(jacobian) - lag].reshape(-1, columns).T @ jacobian[lag:].reshape(-1, columns)
    return np.asarray(product + product.T if lag else product)


def _of_neighbours(jacobian: Floats, pull: Floats, p: WalkCalibrationParameters) -> Floats:
    """J^T corr(d) J (P, P), the correlation a power of that of neighbours, all axes alike."""
    neighbours = float((pull[1:] * pull[:-1]).sum() / (pull**2).sum())
    base = float(np.clip(neighbours, p.least_correlation, MOST_CORRELATED))
    last = min(p.lags, len(pull) - 1)
    return np.asarray(sum(base**lag * _at_lag(jacobian, lag) for lag in range(last + 1)))


def _of_other_passes(jacobian: Floats, pull: Floats, p: WalkCalibrationParameters) -> Floats:
    """Add (P, P) for a walk that comes by the same places again: strides far apart are alike there.

    It shows as a correlation over a few neighbouring lags that chance does not make. It may only add doubt.
    """
    lag = np.arange(len(pull))
    pairs = len(pull) - lag
    products = sum(correlate(axis, axis, method="fft")[len(pull) - 1 :] for axis in pull.T)
    correlation = products / (pull**2).sum() * len(pull) / pairs
    about = uniform_filter1d(correlation, PASS_WIDTH)
    chance = CHANCE_SIGMAS / np.sqrt(len(pull.T) * PASS_WIDTH * pairs)
    again = (about > chance) & (lag > p.lags) & (pairs >= p.fewest)
    added = np.zeros((jacobian.shape[2],) * 2)
    for k in np.flatnonzero(again):
        added += correlation[k] * _at_lag(jacobian, int(k))
    value, axes = np.linalg.eigh(added)
    return np.asarray((axes * np.maximum(value, 0.0)) @ axes.T)


def _out_of_sample(walk: _Walk, p: WalkCalibrationParameters, fit: _Fit) -> Spread:
    """Spread before, and after a calibration on the other blocks of the walk."""
    block = np.arange(len(walk)) * p.blocks // len(walk)
    corrected = np.empty_like(walk.reading)
    for held in (block == k for k in range(p.blocks)):
        corrected[held] = _fitted(walk.part(~held), p, fit).corrected(walk.reading[held])
    after = replace(walk.field, body_field=corrected)
    return Spread(*(_least_spread(field, p.drift_rate_deg_s) for field in (walk.field, after)))


def _least_spread(field: FootfallField, drift_rate_deg_s: float) -> float:
    """Circular sd, deg, of compass minus inertial heading about the line in time that leaves least."""
    t = field.t - field.t[0]
    most = DRIFT_SIGMAS * np.radians(drift_rate_deg_s)
    rates = np.linspace(-most, most, 2 * max(1, int(np.ceil(most * t[-1] / LINE_STEP_RAD))) + 1)
    return min(circular_sd_deg(field.heading_difference - rate * t) for rate in rates)


def _turned(walk: _Walk) -> str:
    """How far the headings go round, in words."""
    heading = walk.field.gyro_heading
    share = np.mean(np.abs(wrap(heading - np.angle(np.exp(1j * heading).mean()))) < np.pi / 4)
    return f"{100 * share:.0f} % of them head within 45 deg of one direction"


def _calibration(fit: _Fit, walk: _Walk, spread: Spread) -> MagnetometerCalibration:
    correction = np.linalg.inv(fit.S)
    correction = (correction + correction.T) / 2
    by_soft = np.eye(IRON)
    by_soft[3:, 3:] = np.stack([-(correction @ _symmetric(one) @ correction)[UPPER] for one in np.eye(6)], axis=1)
    return MagnetometerCalibration(
        method=METHOD,
        hard_iron_uT=fit.h,
        correction=correction,
        covariance=by_soft @ fit.covariance @ by_soft.T,
        strength_uT=float(np.linalg.norm(fit.b)),
        residual_uT=float(np.sqrt(np.mean(fit.sigma_d**2))),
        samples=len(walk),
        notes=(
            f"hard iron over the ground, with what soft iron makes of the vertical field, is known to "
            f"{fit.level_sigma:.1f} uT from {len(walk)} footfalls; what the walk does not show is left as believed",
            f"compass minus inertial heading spreads by {spread.after_deg:.1f} deg instead of {spread.before_deg:.1f}, "
            "each footfall corrected by the others of the walk but its neighbours",
            "residual: scale per axis of what the building adds",
        ),
    )
