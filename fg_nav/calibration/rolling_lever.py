"""Where a foot's sensor stands above the point about which the foot rolls, known from the recording itself.

In stance a foot rolls slowly about a point near the ground, and a sensor at l from it (body frame) moves with
v = w x l. Integrated from the stillest instant t_0 of a stance, in the body frame of that instant (R_0 = I),

    y(t) = int_{t_0}^t R f - R(t_0) f(t_0) ds  =  (R w(t) - w(t_0)) x l-terms + c (t - t_0) + d,

that is, y(t) = (R(t) [w(t)]x - [w(t_0)]x) l + nuisance: a ramp c for tilt and bias, an offset d for the noise of the
starting instant. Both are projected out of each stance, and l is the least-squares solution over all of them. It
assumes nothing about the velocity being zero, which is why it does not shrink: a blind estimate inside a graph
whose zero-velocity factors pull v to zero gives about half.

The stance-to-stance scatter gives the covariance (a sandwich estimate: errors within a stance are correlated).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from fg_nav.arrays import Floats, Ints
from fg_nav.recording import Recording
from fg_nav.stances import Stances


@dataclass(frozen=True)
class RollingLeverParameters:
    """Which part of a stance shows the lever."""

    longest_s: float = 0.25
    """On either side of the stillest instant: longer, and the nuisance ramp no longer covers the tilt."""
    largest_rate_rad_s: float = 1.0
    """Above this the foot no longer rolls on the ground but leaves it."""
    fewest_samples: int = 10
    prior_sigma_m: float = 0.1
    """A foot's sensor is within a hand of the ground; the prior mean is zero, the plain zero-velocity update."""
    error_correlation: float = 25.0
    """Factor on the covariance of the scatter: all stances of a walk share their shape, and so their model error."""


@dataclass(frozen=True)
class RollingLever:
    """`lever` (3,) m in the body frame, from the rolling point to the sensor, and its covariance (3, 3) m^2."""

    lever: Floats
    covariance: Floats
    stances_used: int


def rolling_lever(
    recording: Recording, stances: Stances, parameters: RollingLeverParameters = RollingLeverParameters()
) -> RollingLever:
    """Estimate the lever from every stance that rolls; few or unrolling stances leave it at the prior, zero."""
    p = parameters
    normal, right = _normal_equations(
        recording.t,
        recording.acc,
        recording.gyr,
        stances.start,
        stances.stop,
        p.longest_s,
        p.largest_rate_rad_s,
        p.fewest_samples,
    )
    used = normal.trace(axis1=1, axis2=2) > 0
    return _solution(normal[used], right[used], p)


def _solution(normal: Floats, right: Floats, p: RollingLeverParameters) -> RollingLever:
    """Least squares with the prior; the noise is what the stances scatter about the common solution."""
    if len(normal) < 4:
        return RollingLever(np.zeros(3), np.eye(3) * p.prior_sigma_m**2, len(normal))
    total = normal.sum(axis=0)
    free = np.linalg.solve(total, right.sum(axis=0))
    misfit = right - normal @ free
    spread = np.linalg.inv(total)
    scatter = p.error_correlation * spread @ (misfit.T @ misfit) @ spread
    information = np.linalg.inv(scatter + np.eye(3) * 1e-8)
    covariance = np.linalg.inv(information + np.eye(3) / p.prior_sigma_m**2)
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
) -> tuple[Floats, Floats]:
    """A^T A (K, 3, 3) and A^T y (K, 3) of each stance, nuisance projected out; zero where it is not used."""
    normal, right = np.zeros((len(start), 3, 3)), np.zeros((len(start), 3))
    rate = np.sqrt((gyr**2).sum(axis=1))
    for k in range(len(start)):
        still = start[k] + np.argmin(rate[start[k] : stop[k]])
        a, b = still, still
        while a > start[k] and rate[a - 1] < largest_rate and t[still] - t[a - 1] < longest:
            a -= 1
        while b < stop[k] - 1 and rate[b + 1] < largest_rate and t[b + 1] - t[still] < longest:
            b += 1
        if b - a + 1 >= fewest:
            _add_stance(t, acc, gyr, a, b, still, normal[k], right[k])
    return normal, right


@njit(cache=True)
def _add_stance(t: Floats, acc: Floats, gyr: Floats, a: int, b: int, still: int, normal: Floats, right: Floats) -> None:
    n = b - a + 1
    design, y = np.zeros((n, 9)), np.zeros((n, 3))
    low, high = max(still - 2, 0), min(still + 3, len(acc))
    level = np.zeros(3)
    for i in range(low, high):
        level += acc[i] / (high - low)
    for direction in (1, -1):
        R, v = np.eye(3), np.zeros(3)
        i = still
        while (direction == 1 and i <= b) or (direction == -1 and i >= a):
            design[i - a] = (R @ _cross_matrix(gyr[i])).copy().reshape(9)
            y[i - a] = v
            held = i if direction == 1 else i - 1
            if held < a or held + 1 > b:
                break
            h = (t[held + 1] - t[held]) * direction
            turned = R @ (np.eye(3) + _cross_matrix(gyr[held]) * h)
            force = 0.5 * (R @ acc[held] + turned @ acc[held])
            v = v + (force - level) * h
            R = turned
            i += direction
    at_still = design[still - a].copy()
    elapsed = t[a : b + 1] - t[still]
    elapsed = elapsed - elapsed.mean()
    elapsed /= np.sqrt((elapsed**2).sum())
    for j in range(9):
        design[:, j] = _without_line(design[:, j] - at_still[j], elapsed)
    for j in range(3):
        y[:, j] = _without_line(y[:, j], elapsed)
    for i in range(n):
        A = design[i].copy().reshape(3, 3)
        normal += A.T @ A
        right += A.T @ y[i]


@njit(cache=True)
def _without_line(column: Floats, unit_time: Floats) -> Floats:
    centred = column - column.mean()
    return centred - unit_time * (unit_time * centred).sum()


@njit(cache=True)
def _cross_matrix(w: Floats) -> Floats:
    return np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
