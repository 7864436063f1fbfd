"""Where a foot's sensor stands above the point about which the foot rolls, known from the recording itself.

In stance a foot rolls slowly about a point near the ground, and a sensor at l from it (body frame) moves with
v = w x l. With R(t) the attitude since the first sample of the stance,

    y(t) = int R f ds = R (w x l) + offset + ramp,    R (w x l) = A(t) l,    A = R [w]x,

offset and ramp being the velocity at the start, gravity, tilt and bias. Both are projected out of each stance, and l is
the least-squares solution over all of them. It assumes nothing about the velocity being zero, which is why it does not
shrink: a blind estimate inside a graph whose zero-velocity factors pull v to zero is far too small.

The stance-to-stance scatter gives the covariance (a sandwich estimate: errors within a stance are correlated).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from fg_nav.arrays import Floats, Ints
from fg_nav.mechanisation import rotate_in_body
from fg_nav.recording import Recording
from fg_nav.stances import Stances

FINEST_M = 1e-4
"""No scatter shows a lever better than to this, m."""

ABOVE_NOISE = 4.0
"""Rolling counts where its mean square is this many times that of the gyroscope's noise: noise, taken for rolling that
moves nothing, would show a lever of zero."""


LONGEST_S = 0.25
"""On either side of the stillest instant: longer, and the nuisance ramp no longer covers the tilt."""

LARGEST_RATE_RAD_S = 1.0
"""Above this the foot no longer rolls on the ground but leaves it."""

SHORTEST_S = 0.05
"""Less of a stance than this shows no lever."""

GYR_NOISE_DEG_S = 0.2
"""White noise of the angular rate, per sample and axis; data sheets and recordings at rest have 0.1 to 0.4."""

PRIOR_SIGMA_M = 0.1
"""A foot's sensor is within a hand of the ground; the prior mean is zero, the plain zero-velocity update."""

ERROR_CORRELATION = 25.0
"""Factor on the covariance of the scatter: all stances of a walk share their shape, and so their model error."""


@dataclass(frozen=True)
class RollingLever:
    """`lever` (3,) m in the body frame, from the rolling point to the sensor, and its covariance (3, 3) m^2."""

    lever: Floats
    covariance: Floats
    stances_used: int


def estimate_lever(recording: Recording, stances: Stances) -> RollingLever:
    """Estimate the lever from every stance that rolls; few or unrolling stances leave it at the prior, zero."""
    normal, right, samples = _normal_equations(
        recording.t,
        *recording.integrable,
        stances.start,
        stances.stop,
        LONGEST_S,
        LARGEST_RATE_RAD_S,
        max(4, round(SHORTEST_S / recording.period_s)),
    )
    used = samples > 0
    noise = 2 * int(samples.sum()) * float(np.radians(GYR_NOISE_DEG_S)) ** 2
    return _solve(normal[used], right[used], noise)


def _solve(normal: Floats, right: Floats, noise: float) -> RollingLever:
    """Least squares with the prior; the noise is what the stances scatter about the common solution.

    `noise` (rad/s)^2 is what the gyroscope's noise adds to every eigenvalue of the sum of the normal matrices. About
    an axis with little more the foot does not roll, and across it nothing is known but the prior.
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
def _normal_equations(
    t: Floats,
    acc: Floats,
    gyr: Floats,
    start: Ints,
    stop: Ints,
    longest: float,
    largest_rate: float,
    fewest: int,
) -> tuple[Floats, Floats, Ints]:
    """A^T A (K, 3, 3) and A^T y (K, 3) of each stance, nuisance projected out, and its samples (K,), 0 if not used."""
    normal, right = np.zeros((len(start), 3, 3)), np.zeros((len(start), 3))
    samples = np.zeros(len(start), dtype=np.int64)
    rate = np.sqrt((gyr**2).sum(axis=1))
    for k in range(len(start)):
        first, last = start[k], min(stop[k], len(t) - 1) - 1  # the very last sample has no period
        if last - first + 1 < fewest:
            continue
        still = first + np.argmin(rate[first : last + 1])
        a, b = still, still
        while a > first and rate[a - 1] < largest_rate and t[still] - t[a - 1] < longest:
            a -= 1
        while b < last and rate[b + 1] < largest_rate and t[b + 1] - t[still] < longest:
            b += 1
        if b - a + 1 >= fewest:
            _add_stance(t, acc, gyr, a, b, normal[k], right[k])
            samples[k] = b - a + 1
    return normal, right, samples


@njit(cache=True)
def _add_stance(t: Floats, acc: Floats, gyr: Floats, a: int, b: int, normal: Floats, right: Floats) -> None:
    """Add the samples a <= i <= b of a stance, without the part of them that is a line in time.

    A sample is the mean over its period, so all is taken at the periods' middles. Each nav axis r has at each sample
    the row z = (A_r1, A_r2, A_r3, y_r). Its products less those of its line are
    sum z z' - s s'/n - q q'/sum tau^2, with s = sum z, q = sum z tau, tau the time from the mean time.
    """
    middle = 0.5 * (t[a + 1 : b + 2] + t[a : b + 1])
    center = middle.mean()
    R, y, z = np.eye(3), np.zeros(3), np.empty(4)
    products, s, q = np.zeros((4, 4)), np.zeros((3, 4)), np.zeros((3, 4))
    for i in range(a, b + 1):
        w = gyr[i]
        tau = middle[i - a] - center
        if i > a:
            before, after = t[i] - middle[i - 1 - a], middle[i - a] - t[i]
            _push(y, R, acc[i - 1], before)
            x = before * gyr[i - 1] + after * w
            rotate_in_body(R, x[0], x[1], x[2])
            _push(y, R, acc[i], after)
        for r in range(3):
            z[0] = R[r, 1] * w[2] - R[r, 2] * w[1]
            z[1] = R[r, 2] * w[0] - R[r, 0] * w[2]
            z[2] = R[r, 0] * w[1] - R[r, 1] * w[0]
            z[3] = y[r]
            for j in range(4):
                s[r, j] += z[j]
                q[r, j] += z[j] * tau
                for k in range(4):
                    products[j, k] += z[j] * z[k]
    products -= s.T @ s / len(middle) + q.T @ q / ((middle - center) ** 2).sum()
    normal += products[:3, :3]
    right += products[:3, 3]


@njit(cache=True)
def _push(y: Floats, R: Floats, f: Floats, h: float) -> None:
    """Add to y what the specific force f does in the time h at the attitude R."""
    for r in range(3):
        y[r] += h * (R[r, 0] * f[0] + R[r, 1] * f[1] + R[r, 2] * f[2])
