"""How a pocket's track starts, the track, and its turn to magnetic north.

Start (MD 2.1, Figure 1): level by the mean specific force of the first second, biases zero, the heading of the body's x
axis given (zero by default, as in MD) or that of the magnetometer over the same second. Motion meanwhile is added to
the sigma of the tilt.

Compass. A track is right from one minute to the next, but for the turn about up that it starts with and for what a
gyroscope loses at footfalls faster than its samples. A compass is right in the mean, and off by tens of degrees beside
iron. With mu_k the heading of the mean field over block k, in the track,

    mu_k = x_k + n_k

x the turn of the track, clockwise, from magnetic north, a random walk of q rad^2/s; n the deviation of a place, of
sigma a / H and t-distributed: a the deviation of the field, uT, H its horizontal part. Iron that turns the field
changes its strength as much, so a is the spread of the strength over the walk. q is not known: the smoothed x are
averaged over a grid of q, weighted by the evidence of each.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints, robust_sigma, weigh_models
from fg_nav.detection.rest import MIN_FORCE_M_S2
from fg_nav.errors import EstimationError
from fg_nav.frames import level_attitude, yaw_rotation
from fg_nav.magnetic.footfall_field import compute_field_heading, compute_true_heading
from fg_nav.recording import Recording

GAUGE_SIGMA = 1e-4  # Sigma of a heading that is zero by definition, rad: small, but it keeps P invertible.
STILL_S = 1.0  # The attitude at the start is levelled by the mean over this, s (MD 2.1).
TILT_SIGMA_DEG = 0.5  # Tilt after levelling at rest, deg: a MEMS accelerometer's bias. Not printed.
START_SIGMA_DEG = 10.0  # Of the compass over one second outdoors, near houses and cars, deg.
STORED_EVERY_S = 1.0  # Interval at which the whole covariance is stored: 40 minutes of it are 0.7 MB.
PLACE_S = 10.0  # Over which the field's deviation is one error: as many metres.
WALKS_DEG = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0)  # sqrt(q), deg/sqrt(s)
FREEDOM = 4.0  # Degrees of freedom of n.
ROUNDS = 6  # Of weights of n.
MIN_DEVIATION_UT = 0.5  # Of a calibrated magnetometer.
COMPASS_SIGMA_DEG = 5.0  # Common to all of the walk: remaining iron of the phone, and a local declination.


@dataclass(frozen=True)
class PocketStart:
    """Attitude `nav_R_body` (3, 3) at the first sample, and its sigmas, rad."""

    nav_R_body: Floats
    tilt_sigma: float
    heading_sigma: float = GAUGE_SIGMA


class PocketTrack(NamedTuple):
    """Orientation and bias at the recording's rate, each sample after its own updates."""

    t: Floats  # (N,) s.
    nav_R_body: Floats  # (N, 3, 3).
    gyro_bias: Floats  # (N, 3) rad/s, body.
    sigma: Floats  # (N, 6) standard deviations: of the rotation in nav about east, north, up, rad; of the bias, rad/s.
    covariance_sample: Ints  # (M,) samples, one a second, of which ...
    covariance: Floats  # (M, 6, 6) is stored, in the order of `sigma`.
    gravity_nis: Floats  # (N,) normalized innovations squared, of two each; NaN where not used.
    field_nis: Floats  # (N,) likewise.

    @property
    def field_used(self) -> Bools:
        """(N,) True where the differential magnetic field update was used (DMFU)."""
        return np.asarray(np.isfinite(self.field_nis))

    def rotate(self, clockwise: float) -> PocketTrack:
        """Return it rotated about up, rad clockwise; the sigmas are those of the axes that east and north become."""
        return self._replace(nav_R_body=yaw_rotation(-clockwise) @ self.nav_R_body)


def level_start(recording: Recording, heading: float = 0.0, heading_sigma: float = GAUGE_SIGMA) -> PocketStart:
    """Start level, with a heading of the body's x axis in rad clockwise from north.

    Raises `EstimationError` if the specific force vanishes.
    """
    acc = recording.acc[_first_second(recording)]
    force = acc.mean(axis=0)
    strength = float(np.linalg.norm(force))
    if strength < MIN_FORCE_M_S2:
        raise EstimationError(
            f"the mean specific force of the first {STILL_S:g} s is {strength:.2f} m/s^2, so there is no "
            "up: accelerations must include gravity."
        )
    moved = float(np.linalg.norm(acc.std(axis=0))) / strength
    return PocketStart(
        level_attitude(force, heading), float(np.hypot(np.radians(TILT_SIGMA_DEG), moved)), heading_sigma
    )


def compass_start(recording: Recording, declination: float = 0.0) -> PocketStart:
    """Start level, with the heading of the first second's field; `declination` rad, east positive.

    Raises `EstimationError` if the specific force vanishes, or there is no magnetometer in the first second.
    """
    start = level_start(recording)
    mag = None if recording.mag is None else recording.mag[_first_second(recording)]
    if mag is None or not np.isfinite(mag).all(axis=1).any():
        raise EstimationError(f"there is no magnetometer in the first {STILL_S:g} s to begin with: give the heading.")
    east, north, up = start.nav_R_body @ np.nanmean(mag, axis=0)
    # levelled with heading 0 the body's x axis points north, that is ahead; left of it is west
    heading = compute_field_heading(np.array([north, -east, up]))
    return level_start(recording, float(compute_true_heading(heading, declination)), float(np.radians(START_SIGMA_DEG)))


def choose_start(recording: Recording, heading: float | None) -> tuple[PocketStart, list[str]]:
    """Return the start, by the compass unless a heading is given, and notes on it."""
    if heading is not None:
        return level_start(recording), []
    try:
        return compass_start(recording), ["the heading at the start is the compass's, from magnetic north"]
    except EstimationError:
        start = level_start(recording)  # raises without gravity
    return start, ["the heading at the start is unknown and set to 0: give it with --heading"]


def _first_second(recording: Recording) -> slice:
    return slice(0, int(np.searchsorted(recording.t, recording.t[0] + STILL_S)))


# the turn to magnetic north


@dataclass(frozen=True)
class CompassTurn:
    """Turn of a track from magnetic north: `t` (K,) s, `turn` (K,) rad clockwise, continuous, and `sigma` (K,) rad."""

    t: Floats
    turn: Floats
    sigma: Floats

    @property
    def sigma_at_start(self) -> float:
        """Of the heading at the start, rad, with what is common to all of the walk."""
        return float(np.hypot(self.sigma[0], np.radians(COMPASS_SIGMA_DEG)))

    def apply(self, track: PocketTrack) -> PocketTrack:
        """Return the track turned to magnetic north at each sample."""
        turn, own = np.interp(track.t, self.t, self.turn), np.interp(track.t, self.t, self.sigma)
        sigma = track.sigma.copy()
        sigma[:, 2] = np.hypot(own, np.radians(COMPASS_SIGMA_DEG))
        return track._replace(nav_R_body=yaw_rotation(turn) @ track.nav_R_body, sigma=sigma)


def measure_turn(recording: Recording, track: PocketTrack) -> CompassTurn | None:
    """Estimate the heading offset of a track from magnetic north over time; None without a horizontal field."""
    if recording.mag is None:
        return None
    seen = np.isfinite(recording.mag).all(axis=1)
    if not seen.any():
        return None
    # mean field of each block
    mag, t = recording.mag[seen], recording.t[seen]
    field = (track.nav_R_body[seen] @ mag[:, :, None])[:, :, 0]
    block = np.floor((t - t[0]) / PLACE_S).astype(np.int64)
    _, block, count = np.unique(block, return_inverse=True, return_counts=True)
    east, north, at = (np.bincount(block, x) / count for x in (field[:, 0], field[:, 1], t))
    # direction noise is taken from that of the strength, which heading errors leave alone
    strength = np.linalg.norm(mag, axis=1)
    deviation = max(robust_sigma(strength - np.median(strength)), MIN_DEVIATION_UT)
    level = float(np.median(np.hypot(east, north)))
    if not level > deviation:
        return None
    variance = (deviation / level) ** 2 * np.maximum(count.max() / count, 1.0)
    return CompassTurn(at, *smooth_angles(at, np.arctan2(east, north), variance))


def smooth_angles(t: Floats, angle: Floats, variance: Floats) -> tuple[Floats, Floats]:
    """Smoothed, unwrapped `angle` (K,) rad and its sigma (K,) rad, averaged over random walks by their evidence."""
    fits = [_smooth(angle, variance, np.radians(walk) ** 2 * np.diff(t)) for walk in WALKS_DEG]
    weight = weigh_models(np.array([fit[2] for fit in fits]))
    best = fits[int(np.argmax(weight))][0]
    smoothed = np.array([x - 2 * np.pi * np.round((x - best) / (2 * np.pi)) for x, _, _ in fits])
    mean = weight @ smoothed
    return mean, np.sqrt(weight @ (np.array([P for _, P, _ in fits]) + (smoothed - mean) ** 2))


def _smooth(mu: Floats, variance: Floats, walk: Floats) -> tuple[Floats, Floats, float]:
    """Smoothed heading offset (K,) rad, its variance (K,), and the log evidence, with t-distributed errors of mu (K,).

    `variance` (K,) rad^2 is that of mu, `walk` (K - 1,) rad^2 that of the random walk between them.
    """
    n, scale = len(mu), np.ones(len(mu))
    for _ in range(ROUNDS):
        # Kalman filter forward
        x, P, weighted = np.empty(n), np.empty(n), variance * scale
        x[0], P[0] = mu[0], weighted[0]
        for k in range(1, n):
            ahead = P[k - 1] + walk[k - 1]
            x[k] = x[k - 1] + ahead / (ahead + weighted[k]) * np.angle(np.exp(1j * (mu[k] - x[k - 1])))
            P[k] = ahead * weighted[k] / (ahead + weighted[k])
        # Rauch-Tung-Striebel smoother back
        for k in range(n - 2, -1, -1):
            ahead = P[k] + walk[k]
            gain = P[k] / ahead
            x[k] += gain * (x[k + 1] - x[k])
            P[k] += gain**2 * (P[k + 1] - ahead)
        # weights of the t-distribution
        miss = np.angle(np.exp(1j * (mu - x)))
        scale = np.maximum((FREEDOM + (miss**2 + P) / variance) / (FREEDOM + 1.0), 1.0)
    forth, back = _find_evidence(mu, variance, walk), _find_evidence(mu[::-1], variance[::-1], walk[::-1])
    return x, P, 0.5 * (forth + back)


def _find_evidence(mu: Floats, variance: Floats, walk: Floats) -> float:
    """Log evidence: sum of the log t densities of the innovations of a causal robust filter, up to a constant."""
    x, P, evidence = mu[0], variance[0], 0.0
    for k in range(1, len(mu)):
        ahead, miss = P + walk[k - 1], np.angle(np.exp(1j * (mu[k] - x)))
        square = miss**2 / (ahead + variance[k])
        evidence -= 0.5 * (np.log(ahead + variance[k]) + (FREEDOM + 1.0) * np.log1p(square / FREEDOM))
        own = variance[k] * max((FREEDOM + square) / (FREEDOM + 1.0), 1.0)
        x, P = x + ahead / (ahead + own) * miss, ahead * own / (ahead + own)
    return float(evidence)
