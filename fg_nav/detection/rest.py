"""Rests, in which the foot is so still that its mean angular rate is the gyroscope's bias; and the walk's ends.

A foot "in stance" still turns at a few deg/s; a rest fixes the bias. The recording is cut into blocks of a quarter of a
second, shorter than body sway. A rest is a run of blocks that are quiet within and agree with each other, in rate and
in specific force. None reaches over a hole in the samples.

The bias is the slope of the integrated rate over the rest, not the mean rate: a standing foot sways by small angles,
and fast sway is white in the angle. Each axis has its sigma from the rest's own sway: with s the measured rms of the
angle about that line, over a time T the slope is uncertain by

    `SWAY_SCALE` s sqrt(12) / T,

for n independent angles have s sqrt(12 / n) / T, and sway has about one. Further parts are the sensor's noise, and a
floor for changes of the bias within a walk. So 0.75 s of a foot that sways by 0.02 deg determine the bias to 0.2 deg/s,
and three seconds to 0.05.

Navigation begins in the first stance: the mean specific force levels the sensor; the heading is given, or zero. A rest
in the first footfall determines the gyro bias, and in the first stance it levels better. Before the first stance and
after the last nothing bounds the motion: within the longest swing of them the samples are integrated like any others,
and beyond the path is frozen, for the error of a free strapdown grows to kilometres in half a minute.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fg_nav.arrays import Floats, find_runs
from fg_nav.detection.footfalls import MAX_SWING_S
from fg_nav.detection.stance import Stances
from fg_nav.errors import EstimationError
from fg_nav.frames import level_attitude
from fg_nav.recording import Recording
from fg_nav.samples.gaps import count_periods, cross_holes

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
    """Samples `start <= i < stop` of a rest.

    `rate` (3,) rad/s is the gyro bias, with this covariance (3, 3), `force` (3,) m/s^2 the mean specific force.
    """

    start: int
    stop: int
    rate: Floats
    covariance: Floats
    force: Floats

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


def find_rests(recording: Recording, parameters: RestParameters = RestParameters()) -> tuple[Rest, ...]:
    """Find the rests of a recording that agree with the longest one in the bias, in order."""
    rests = find_still_stretches(recording, parameters)
    longest = max(rests, key=lambda rest: rest.stop - rest.start, default=None)
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
    rate = max(rests, key=lambda rest: rest.stop - rest.start).rate if rests else np.zeros(3)
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
    """Start of navigation: sample `row` and its attitude.

    `rest` is that of the first footfall, if there is one, and `rests` are those of the whole recording.
    """

    row: int
    nav_R_body: Floats
    levelled_at_rest: bool
    rest: Rest | None
    rests: tuple[Rest, ...]


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
    return max(inside, key=lambda rest: rest.stop - rest.start, default=None)


def freeze_ends(t: Floats, stances: Stances, position: Floats, velocity: Floats) -> tuple[str, ...]:
    """Hold position and velocity (N, 3) in place beyond `MAX_FREE_S` from the outermost stances; return notes on it."""
    first = int(np.searchsorted(t, t[stances.start[0]] - MAX_FREE_S))
    last = int(np.searchsorted(t, t[stances.stop[-1] - 1] + MAX_FREE_S, side="right")) - 1
    position[:first], velocity[:first] = position[first], 0.0
    position[last + 1 :], velocity[last + 1 :] = position[last], 0.0
    held = ((t[first] - t[0], "before the first"), (t[-1] - t[last], "after the last"))
    return tuple(f"{seconds:.1f} s {where} footfall are not navigated" for seconds, where in held if seconds > 0)
