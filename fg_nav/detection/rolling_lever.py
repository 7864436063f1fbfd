"""Lever from the rolling point of a foot to its sensor, estimated from the recording itself.

In stance a foot rolls slowly about a point near the ground, and a sensor at l from it (body frame) moves with
v = w x l. With R(t) the attitude since the first sample of the stance,

    y(t) = int R f ds = R (w x l) + offset + ramp,    R (w x l) = A(t) l,    A = R [w]x,

offset and ramp being the velocity at the start, gravity, tilt and bias. Both are projected out of each stance, and l is
the least-squares solution over all of them. No velocity is assumed to be zero, so it does not shrink: an estimate in a
graph whose zero-velocity factors pull v to zero is far too small. The covariance is that of the scatter from stance to
stance (a sandwich estimate: errors within a stance are correlated).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.detection.stance import Stances
from fg_nav.mechanisation import rotate_in_body
from fg_nav.recording import Recording
from fg_nav.system.compiled import njit

FINEST_M = 1e-4  # Least sigma of a lever, m.
ABOVE_NOISE = 4.0  # Of rolling, mean square over that of the gyroscope's noise, which would make the lever zero.
MAX_S = 0.25  # On either side of the stillest instant: longer, and the nuisance ramp no longer covers the tilt.
MAX_RATE_RAD_S = 1.0  # Above this the foot no longer rolls on the ground but leaves it.
MIN_S = 0.05  # Of a stance that is used.
GYR_NOISE_DEG_S = 0.2  # White noise of the angular rate, per sample and axis; sheets and recordings have 0.1 to 0.4.
PRIOR_SIGMA_M = 0.1  # A foot's sensor is within a hand of the ground; the mean is zero, the plain zero-velocity update.
ERROR_CORRELATION = 25.0  # Factor on the scatter's covariance: all stances share their shape, and so their model error.


@dataclass(frozen=True)
class RollingLever:
    """`lever` (3,) m in the body frame, from the rolling point to the sensor, and its covariance (3, 3) m^2."""

    lever: Floats
    covariance: Floats
    stances_used: int


def estimate_lever(recording: Recording, stances: Stances) -> RollingLever:
    """Estimate the lever from every stance that rolls; few or unrolling stances leave it at the prior, zero."""
    # about the stillest instant of each stance; the very last sample has no period
    stop = np.minimum(stances.stop, len(recording.t) - 1)
    first, last = _reach_out(recording.t, recording.integrable[1], stances.start, stop)
    enough = last - first + 1 >= max(4, round(MIN_S / recording.period_s))
    first, last = first[enough], last[enough]
    middle = 0.5 * (recording.t[1:] + recording.t[:-1])
    products, s, q, squares = _sum_products(recording.t, middle, *recording.integrable, first, last)
    samples = last - first + 1
    products -= np.einsum("krj,kri->kji", s, s) / samples[:, None, None]
    products -= np.einsum("krj,kri->kji", q, q) / squares[:, None, None]
    noise = 2 * int(samples.sum()) * float(np.radians(GYR_NOISE_DEG_S)) ** 2
    return _solve(products[:, :3, :3], products[:, :3, 3], noise)


@njit(cache=True)
def _reach_out(t: Floats, gyr: Floats, start: Ints, stop: Ints) -> tuple[Ints, Ints]:
    """First and last sample (K,) of the span about each stance's stillest sample: near in time, and turning slowly."""
    first, last = start.copy(), stop - 1
    for k in range(len(start)):
        still, least = start[k], np.inf
        for i in range(start[k], stop[k]):
            rate = _squared_rate(gyr, i)
            if rate < least:
                still, least = i, rate
        for way in (-1, 1):
            i = still + way
            while start[k] <= i < stop[k] and abs(t[i] - t[still]) < MAX_S:
                if not _squared_rate(gyr, i) < MAX_RATE_RAD_S**2:
                    break
                i += way
            if start[k] <= i < stop[k]:
                if way < 0:
                    first[k] = i + 1
                else:
                    last[k] = i - 1
    return first, last


@njit(cache=True)
def _squared_rate(gyr: Floats, i: int) -> float:
    """Squared rate of a sample."""
    return float(gyr[i, 0] ** 2 + gyr[i, 1] ** 2 + gyr[i, 2] ** 2)


def _solve(normal: Floats, right: Floats, noise: float) -> RollingLever:
    """Lever from the stances' normal equations (K, 3, 3), (K, 3) and the prior; its covariance from their scatter.

    `noise` (rad/s)^2 is the part of the gyroscope's noise in every eigenvalue of the sum of the normal matrices. About
    an axis with little more the foot does not roll, and across it there is only the prior.
    """
    if len(normal) < 4:
        return RollingLever(np.zeros(3), np.eye(3) * PRIOR_SIGMA_M**2, len(normal))
    strength, axes = np.linalg.eigh(normal.sum(axis=0))
    seen = strength > ABOVE_NOISE * noise
    axes, weighted = axes[:, seen], axes[:, seen] / strength[seen]
    free = axes @ (weighted.T @ right.sum(axis=0))
    misfit = (right - normal @ free) @ weighted
    scatter = ERROR_CORRELATION * misfit.T @ misfit + np.eye(seen.sum()) * FINEST_M**2
    information = axes @ np.linalg.inv(scatter) @ axes.T
    covariance = np.linalg.inv(information + np.eye(3) / PRIOR_SIGMA_M**2)
    return RollingLever(covariance @ information @ free, covariance, len(normal))


@njit(cache=True)
def _sum_products(
    t: Floats, middle: Floats, acc: Floats, gyr: Floats, first: Ints, last: Ints
) -> tuple[Floats, Floats, Floats, Floats]:
    """Sums over the samples `first` to `last` (K,) of each stance, for a fit with a free line in time.

    A sample is the mean over its period, so all is taken at the periods' middles. Each nav axis r has at each sample
    the row z = (A_r1, A_r2, A_r3, y_r). Its products less those of its line are
    sum z z' - s s'/n - q q'/sum tau^2, with s = sum z, q = sum z tau, tau the time from the mean time. Returned are the
    first sum (K, 4, 4), s and q (K, 3, 4) and the last sum (K,).
    """
    count = len(first)
    products, s, q, squares = np.zeros((count, 4, 4)), np.zeros((count, 3, 4)), np.zeros((count, 3, 4)), np.zeros(count)
    R, y, z = np.empty((3, 3)), np.empty(3), np.empty(4)
    for n in range(count):
        center = 0.0
        for i in range(first[n], last[n] + 1):
            center += middle[i]
        center /= last[n] + 1 - first[n]
        for r in range(3):
            y[r] = 0.0
            for k in range(3):
                R[r, k] = 1.0 if k == r else 0.0
        for i in range(first[n], last[n] + 1):
            w, tau = gyr[i], middle[i] - center
            squares[n] += tau * tau
            if i > first[n]:
                before, after, u = t[i] - middle[i - 1], middle[i] - t[i], gyr[i - 1]
                _push(y, R, acc[i - 1], before)
                rotate_in_body(
                    R, before * u[0] + after * w[0], before * u[1] + after * w[1], before * u[2] + after * w[2]
                )
                _push(y, R, acc[i], after)
            for r in range(3):
                z[0] = R[r, 1] * w[2] - R[r, 2] * w[1]
                z[1] = R[r, 2] * w[0] - R[r, 0] * w[2]
                z[2] = R[r, 0] * w[1] - R[r, 1] * w[0]
                z[3] = y[r]
                for j in range(4):
                    s[n, r, j] += z[j]
                    q[n, r, j] += z[j] * tau
                    for k in range(4):
                        products[n, j, k] += z[j] * z[k]
    return products, s, q, squares


@njit(cache=True)
def _push(y: Floats, R: Floats, f: Floats, h: float) -> None:
    """Add to y what the specific force f does in the time h at the attitude R."""
    for r in range(3):
        y[r] += h * (R[r, 0] * f[0] + R[r, 1] * f[1] + R[r, 2] * f[2])
