"""The heading of a pocket's track by the compass, over all of the walk.

A track is right to a few degrees from one minute to the next, but for the turn about up that it starts with, and for
what a gyroscope loses: at 50 Hz a footfall is faster than its samples, and each leaves a bit of a degree, to the same
side while the gait is the same. A compass is right in the mean, and off by tens of degrees beside iron. With mu_k the
heading of the mean field over block k, in the track,

    mu_k = x_k + n_k

x the turn of the track, clockwise, from magnetic north, a random walk of q rad^2/s; n the deviation of a place, of
sigma a / H and t-distributed: a the deviation of the field, uT, H its horizontal part. Iron that turns the field
changes its strength as much, and so a is the spread of the strength over the walk. How much a gyroscope loses is not
known before: the smoothed x are averaged over a grid of q, from hardly any to ten deg per root second, by the evidence
of each.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.frames import yaw_rotation
from fg_nav.pocket.track import PocketTrack
from fg_nav.recording import Recording

PLACE_S = 10.0  # over which the field's deviation is one error: as many metres

WALKS_DEG = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0)  # sqrt(q), deg/sqrt(s)

FREEDOM = 4.0  # degrees of freedom of n

ROUNDS = 6  # of weights of n

MIN_DEVIATION_UT = 0.5  # of a calibrated magnetometer

COMPASS_SIGMA_DEG = 5.0  # common to all of the walk: what is left of the phone's iron, and a local declination


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

    @property
    def note(self) -> str:
        """What the heading rests on."""
        sigma = np.degrees(self.sigma_at_start)
        return f"the heading is the compass's over all of the walk, from magnetic north: {sigma:.0f} deg at the start"

    def apply(self, track: PocketTrack) -> PocketTrack:
        """Return the track turned to magnetic north at each sample."""
        turn, own = np.interp(track.t, self.t, self.turn), np.interp(track.t, self.t, self.sigma)
        sigma = track.sigma.copy()
        sigma[:, 2] = np.hypot(own, np.radians(COMPASS_SIGMA_DEG))
        return replace(track, nav_R_body=yaw_rotation(turn) @ track.nav_R_body, sigma=sigma)


def measure_turn(recording: Recording, track: PocketTrack) -> CompassTurn | None:
    """Estimate the turn of a track from magnetic north; None without a horizontal field."""
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
    # its deviation, as that of the strength
    strength = np.linalg.norm(mag, axis=1)
    deviation = max(1.4826 * float(np.median(np.abs(strength - np.median(strength)))), MIN_DEVIATION_UT)
    level = float(np.median(np.hypot(east, north)))
    if not level > deviation:
        return None
    variance = (deviation / level) ** 2 * np.maximum(count.max() / count, 1.0)
    return CompassTurn(at, *smooth_angles(at, np.arctan2(east, north), variance))


def smooth_angles(t: Floats, angle: Floats, variance: Floats) -> tuple[Floats, Floats]:
    """Smoothed angle (K,) rad, continuous, and its sigma (K,), of angles (K,) with variances (K,) at t (K,) s."""
    fits = [_smooth(angle, variance, np.radians(walk) ** 2 * np.diff(t)) for walk in WALKS_DEG]
    evidence = np.array([fit[2] for fit in fits])
    weight = np.exp(evidence - evidence.max())
    weight /= weight.sum()
    best = fits[int(np.argmax(weight))][0]
    smoothed = np.array([x - 2 * np.pi * np.round((x - best) / (2 * np.pi)) for x, _, _ in fits])
    mean = weight @ smoothed
    return mean, np.sqrt(weight @ (np.array([P for _, P, _ in fits]) + (smoothed - mean) ** 2))


def _smooth(mu: Floats, variance: Floats, walk: Floats) -> tuple[Floats, Floats, float]:
    """Smoothed turn (K,) rad, its variance (K,), and the log evidence, of headings (K,) with t-distributed errors."""
    scale = np.ones(len(mu))
    for _ in range(ROUNDS):
        x, P = _pass_both_ways(mu, variance * scale, walk)
        miss = np.angle(np.exp(1j * (mu - x)))
        scale = np.maximum((FREEDOM + (miss**2 + P) / variance) / (FREEDOM + 1.0), 1.0)
    forth, back = _find_evidence(mu, variance, walk), _find_evidence(mu[::-1], variance[::-1], walk[::-1])
    return x, P, 0.5 * (forth + back)


def _pass_both_ways(mu: Floats, variance: Floats, walk: Floats) -> tuple[Floats, Floats]:
    """Kalman filter and Rauch-Tung-Striebel smoother of a random walk with steps of variances `walk` (K - 1,)."""
    n = len(mu)
    x, P = np.empty(n), np.empty(n)
    x[0], P[0] = mu[0], variance[0]
    for k in range(1, n):
        ahead = P[k - 1] + walk[k - 1]
        x[k] = x[k - 1] + ahead / (ahead + variance[k]) * np.angle(np.exp(1j * (mu[k] - x[k - 1])))
        P[k] = ahead * variance[k] / (ahead + variance[k])
    for k in range(n - 2, -1, -1):
        ahead = P[k] + walk[k]
        gain = P[k] / ahead
        x[k] += gain * (x[k + 1] - x[k])
        P[k] += gain**2 * (P[k + 1] - ahead)
    return x, P


def _find_evidence(mu: Floats, variance: Floats, walk: Floats) -> float:
    """Log of the product of the innovations' t densities, less a constant; each is weighed as it comes."""
    x, P, evidence = mu[0], variance[0], 0.0
    for k in range(1, len(mu)):
        ahead, miss = P + walk[k - 1], np.angle(np.exp(1j * (mu[k] - x)))
        square = miss**2 / (ahead + variance[k])
        evidence -= 0.5 * (np.log(ahead + variance[k]) + (FREEDOM + 1.0) * np.log1p(square / FREEDOM))
        own = variance[k] * max((FREEDOM + square) / (FREEDOM + 1.0), 1.0)
        x, P = x + ahead / (ahead + own) * miss, ahead * own / (ahead + own)
    return float(evidence)
