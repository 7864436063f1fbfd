"""What stances show of the sensor: the gyroscope's bias in rests, the walk's ends, and the lever of a rolling foot.

Rests and the lever are those of docs/models.md ("Rests", "The rolling lever"); none reaches over a hole in the samples.

Navigation begins in the first stance: the mean specific force levels the sensor; the heading is given, or zero. A rest
in the first footfall determines the gyro bias, and in the first stance it levels better. Before the first stance and
after the last nothing bounds the motion: within the longest swing of them the samples are integrated like any others,
and beyond the path is frozen, for the error of a free strapdown grows to kilometres in half a minute.

Lever. With y the integral of R f there, offset and ramp are projected out of each stance. The covariance of l is of the
scatter from stance to stance (a sandwich estimate: errors within a stance are correlated).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fg_nav.arrays import Floats, Ints, find_runs
from fg_nav.detection.footfalls import MAX_SWING_S
from fg_nav.detection.stance import GYR_NOISE_DEG_S, Stances
from fg_nav.errors import EstimationError
from fg_nav.frames import level_attitude
from fg_nav.mechanisation import rotate_in_body
from fg_nav.recording import Recording
from fg_nav.samples.gaps import count_periods, cross_holes
from fg_nav.system.compiled import njit

BLOCK_S = 0.25  # Shorter than body sway (about 0.5 Hz), long enough to average sensor noise.
GYR_STD_DEG_S, ACC_STD_M_S2 = 0.5, 0.2  # Largest standard deviations within a block, per axis.
GYR_STEP_DEG_S, ACC_STEP_M_S2 = 0.5, 0.15  # Largest changes between means of blocks, per axis; 1 deg of tilt.
MAX_BIAS_DEG_S = 25.0  # A steady rate above this is a motion: data sheets of MEMS have zero-rate outputs to 20 deg/s.
LARGE_BIAS_DEG_S = 5.0  # Beyond the tolerance of checks of single strides.
SWAY_SCALE = 2.0  # Slow sway looks like a bias: error of 0.75 to 3 s of standing over its sway, in the median.
MIN_SIGMA_DEG_S = 0.015  # Instability of the bias, and of a foot that seems to rest.
MIN_ADDED = 0.02  # Share of the information of an earlier view of a rest below which a later one adds nothing.
MAX_APART_SIGMAS = 4.0  # A rest this far from the longest one, in sigmas of both, was the rolling of a slow stance.
MIN_FORCE_M_S2 = 1.0  # Of a mean specific force with a direction.
MAX_FREE_S = MAX_SWING_S  # Integrated beyond the outermost stances.


@dataclass(frozen=True)
class RestParameters:
    """Shortest rests."""

    shortest_s: float = 0.75  # The stance of a stride is not as still for as long.
    shortest_at_end_s: float = 0.5  # Within a second of the start or the end of the recording, where people stand.


@dataclass(frozen=True)
class Rest:
    """Samples `start <= i < stop` of a rest."""

    start: int
    stop: int
    rate: Floats  # (3,) rad/s, the gyro bias.
    covariance: Floats  # (3, 3) of it.
    force: Floats  # (3,) m/s^2, mean specific force.

    @property
    def sigma(self) -> Floats:
        """(3,) of the rate, rad/s."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance)))

    def lasts(self, recording: Recording, shortest_s: float) -> bool:
        """Whether it lasts that long in its recording, within the rounding of its samples, lost ones included."""
        periods = int(count_periods(recording.t[self.start : self.stop], recording.period_s)[-1]) + 1
        return periods * recording.period_s >= shortest_s * (1 - 1e-3)

    def agrees_with(self, longest: Rest) -> bool:
        """Whether it shows the same bias as the longest rest."""
        apart = self.rate - longest.rate
        return bool(apart @ np.linalg.solve(self.covariance + longest.covariance, apart) <= MAX_APART_SIGMAS**2)

    def beyond(self, before: Rest) -> Rest | None:
        """Return the information of this rest beyond that of an earlier view of it; None if nothing.

        The two together have the information of this one alone. In a direction with less information than before, as
        of a foot that began to sway, nothing is added.
        """
        weight, counted = np.linalg.inv(self.covariance), np.linalg.inv(before.covariance)
        added, axes = np.linalg.eigh(weight - counted)
        more = added > MIN_ADDED * np.trace(counted)
        if not more.any():
            return None
        along = axes.T @ (weight @ self.rate - counted @ before.rate) / np.where(more, added, np.inf)
        covariance = axes / np.where(more, added, MIN_ADDED**2 * np.trace(counted)) @ axes.T
        return replace(self, rate=axes @ along, covariance=covariance)


def find_longest(rests: Sequence[Rest]) -> Rest | None:
    """Return the longest rest, the first of those that last as long; None without any."""
    return max(rests, key=lambda rest: rest.stop - rest.start, default=None)


def find_rests(recording: Recording, parameters: RestParameters = RestParameters()) -> tuple[Rest, ...]:
    """Find the rests of a recording that agree with the longest one in the bias, in order."""
    rests = find_still_stretches(recording, parameters)
    longest = find_longest(rests)
    return tuple(rest for rest in rests if longest is not None and rest.agrees_with(longest))


def find_still_stretches(recording: Recording, parameters: RestParameters) -> list[Rest]:
    """Find all rests that last long enough, in order, whether or not their biases agree."""
    # edges of the blocks, as long where samples are missing as elsewhere
    block, tick = max(2, round(BLOCK_S / recording.period_s)), count_periods(recording.t, recording.period_s)
    edge = np.unique(np.searchsorted(tick, np.arange(0, tick[-1] + 2, block))).tolist()
    # runs of blocks that are quiet and agree
    start, count = np.array(edge[:-1], dtype=np.int64), np.diff(edge)
    mean, std = np.empty((len(count), 6)), np.empty((len(count), 6))
    for samples, columns in ((recording.gyr, np.s_[:3]), (recording.acc, np.s_[3:])):
        mean[:, columns] = np.add.reduceat(samples[: edge[-1]], start) / count[:, None]
        squares = np.add.reduceat(samples[: edge[-1]] ** 2, start) / count[:, None]
        std[:, columns] = np.sqrt(np.maximum(squares - mean[:, columns] ** 2, 0.0))
    quiet = (std[:, :3].max(axis=1) < np.radians(GYR_STD_DEG_S)) & (std[:, 3:].max(axis=1) < ACC_STD_M_S2)
    quiet, rate, force = quiet & (count > count.max(initial=0) / 2), mean[:, :3], mean[:, 3:]
    agree = (np.abs(np.diff(rate, axis=0)).max(axis=1, initial=0.0) < np.radians(GYR_STEP_DEG_S)) & (
        np.abs(np.diff(force, axis=0)).max(axis=1, initial=0.0) < ACC_STEP_M_S2
    )
    seen = ~cross_holes(recording.t, np.array(edge))
    first, last = find_runs(quiet[1:] & quiet[:-1] & agree & seen[1:] & seen[:-1])
    found, t = [], recording.t
    for a, b in zip(first, last, strict=True):
        rest = _measure_rest(recording, edge[a], edge[b + 1])
        at_end = t[rest.start] - t[0] < 1.0 or t[-1] - t[rest.stop - 1] < 1.0
        shortest = parameters.shortest_at_end_s if at_end else parameters.shortest_s
        if rest.lasts(recording, shortest) and np.abs(rest.rate).max() <= np.radians(MAX_BIAS_DEG_S):
            found.append(rest)
    return found


def remove_large_bias(t: Floats, acc: Floats, gyr: Floats) -> Floats:
    """Subtract the rate of the longest rest from the rates (N, 3), if large, for checks that assume a small one."""
    rests = find_still_stretches(Recording(t, acc, gyr), RestParameters())
    longest = find_longest(rests)
    rate = np.zeros(3) if longest is None else longest.rate
    return gyr - rate if np.linalg.norm(rate) > np.radians(LARGE_BIAS_DEG_S) else gyr


def _measure_rest(recording: Recording, start: int, stop: int) -> Rest:
    """Rest in these samples: bias as the slope of the integrated rate, covariance from its sway and noise."""
    t = recording.t[start:stop] - recording.t[start]
    gyr = recording.gyr[start:stop]
    steps = 0.5 * (gyr[1:] + gyr[:-1]) * np.diff(t)[:, None]
    angle = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    slope = np.polynomial.polynomial.polyfit(t, angle, 1)[1]
    line = angle.mean(axis=0) + np.outer(t - t.mean(), slope)
    sway = (SWAY_SCALE * np.sqrt(12.0) / t[-1]) ** 2 * np.cov((angle - line).T, bias=True)
    noise = 1.2 / len(t) * gyr.var(axis=0).mean()  # of a slope, 6/5 of that of a mean
    covariance = sway + (noise + np.radians(MIN_SIGMA_DEG_S) ** 2) * np.eye(3)
    return Rest(start, stop, slope, covariance, recording.acc[start:stop].mean(axis=0))


@dataclass(frozen=True)
class Start:
    """Start of navigation: sample `row` and its attitude."""

    row: int
    nav_R_body: Floats
    levelled_at_rest: bool
    rest: Rest | None  # Of the first footfall.
    rests: tuple[Rest, ...]  # Of the whole recording.


def find_start(
    recording: Recording,
    stances: Stances,
    heading: float = 0.0,
    parameters: RestParameters = RestParameters(),
) -> Start:
    """Level the sensor in its first stance, and find the rest in it.

    `heading` is that of the body's x axis at the start, rad clockwise from north. Raises `EstimationError` without a
    stance, on stances of another recording, or where the specific force vanishes.
    """
    if stances.n_samples != len(recording):
        raise EstimationError(
            f"the stances belong to {stances.n_samples} samples and the recording has {len(recording)}: "
            "detect the stances on this recording."
        )
    if len(stances) == 0:
        raise EstimationError("there is no stance to start from: check the stance detection.")
    first = slice(int(stances.start[0]), int(stances.stop[0]))
    footfall = slice(first.start, int(stances.stop[stances.footfall == 0][-1]))
    rests = find_rests(recording, parameters)
    level, rest = _longest_within(first, rests), _longest_within(footfall, rests)
    force = recording.acc[first].mean(axis=0) if level is None else level.force
    if np.linalg.norm(force) < MIN_FORCE_M_S2:
        raise EstimationError(
            f"the mean specific force in the first stance, at {recording.t[first.start]:.3f} s, is "
            f"{np.linalg.norm(force):.2f} m/s^2, so there is no up: accelerations must include gravity."
        )
    return Start(first.start, level_attitude(force, heading), level is not None, rest, rests)


def _longest_within(span: slice, rests: tuple[Rest, ...]) -> Rest | None:
    """Return the longest rest with its middle in a span of samples."""
    inside = [rest for rest in rests if span.start <= (rest.start + rest.stop) // 2 < span.stop]
    return find_longest(inside)


def freeze_ends(t: Floats, stances: Stances, position: Floats, velocity: Floats) -> tuple[str, ...]:
    """Hold position and velocity (N, 3) in place beyond `MAX_FREE_S` from the outermost stances; return notes on it."""
    first = int(np.searchsorted(t, t[stances.start[0]] - MAX_FREE_S))
    last = int(np.searchsorted(t, t[stances.stop[-1] - 1] + MAX_FREE_S, side="right")) - 1
    position[:first], velocity[:first] = position[first], 0.0
    position[last + 1 :], velocity[last + 1 :] = position[last], 0.0
    held = ((t[first] - t[0], "before the first"), (t[-1] - t[last], "after the last"))
    return tuple(f"{seconds:.1f} s {where} footfall are not navigated" for seconds, where in held if seconds > 0)


# rolling

FINEST_M = 1e-4  # Least sigma of a lever, m.
ABOVE_NOISE = 4.0  # Of rolling, mean square over that of the gyroscope's noise, which would make the lever zero.
MAX_ROLL_S = 0.25  # On either side of the stillest instant: longer, and the nuisance ramp no longer covers the tilt.
MAX_RATE_RAD_S = 1.0  # Above this the foot no longer rolls on the ground but leaves it.
MIN_ROLL_S = 0.05  # Of a stance that is used.
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
    enough = last - first + 1 >= max(4, round(MIN_ROLL_S / recording.period_s))
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
            while start[k] <= i < stop[k] and abs(t[i] - t[still]) < MAX_ROLL_S:
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
