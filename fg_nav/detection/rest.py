"""Rests, in which the foot stands so still that its mean angular rate is the gyroscope's bias; and the walk's ends.

A foot "in stance" still turns at a few deg/s; a rest fixes the bias, so it must be one. The recording is
cut into blocks of a quarter of a second, shorter than body sway. A rest is a run of blocks that are quiet within
and agree with each other, in rate and in specific force. None reaches over a hole in the samples.

The bias is the slope of the integrated rate over the rest, not the mean rate: a standing foot sways by small angles,
and fast sway is white in the angle. Each axis has its sigma from the rest's own sway: with s the measured rms of the
angle about that line, over a time T the slope is uncertain by

    `SWAY_SCALE` s sqrt(12) / T,

for n independent angles would show it to s sqrt(12 / n) / T, and sway is about one. Further parts are the sensor's
noise, and a floor for what a bias does within a walk. So 0.75 s of a foot that sways by 0.02 deg show the bias to 0.2
deg/s, and three seconds to 0.05.

Navigation begins in the first stance: the mean specific force points up and levels the sensor; the heading is given, or
zero. A rest in the first footfall shows the gyro bias, and in the first stance it levels better. Before the first
stance and after the last nothing bounds the motion. Within the longest swing of them the samples are integrated like
any others. Beyond, the error of a free strapdown grows with the square of the time, to kilometres in half a minute: the
path is frozen where it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.detection.footfalls import MAX_SWING_S
from fg_nav.errors import EstimationError
from fg_nav.frames import level_attitude
from fg_nav.recording import Recording
from fg_nav.samples.gaps import count_periods, cross_holes
from fg_nav.stances import Stances, find_runs

BLOCK_S = 0.25  # Shorter than body sway (about 0.5 Hz), long enough to average sensor noise.
GYR_STD_DEG_S, ACC_STD_M_S2 = 0.5, 0.2  # Largest standard deviations within a block, per axis.

GYR_STEP_DEG_S, ACC_STEP_M_S2 = 0.5, 0.15
"""Largest changes of the means from block to block, per axis; of the force 1 deg of tilt."""

MAX_BIAS_DEG_S = 25.0  # A steady rate above this is a motion: data sheets of MEMS have zero-rate outputs to 20 deg/s.

LARGE_BIAS_DEG_S = 5.0  # Beyond what checks of single strides leave room for.

SWAY_SCALE = 2.0
"""Error of the slope over what the sway about it shows, for sway slower than the rest looks like a bias: pieces of
0.75, 1.5 and 3 s of standing feet (mems_foot, openshoe, xio and others) differ from the bias of the whole standing by
twice what their own sway says, in the median."""

MIN_SIGMA_DEG_S = 0.015
"""No rest shows the bias better: its own instability, and what a foot turns while it seems to rest."""

MIN_ADDED = 0.02  # Share of the information of an earlier view of a rest below which a later one adds nothing.
MAX_APART_SIGMAS = 4.0  # A rest this far from the longest one, in sigmas of both, was the rolling of a slow stance.


@dataclass(frozen=True)
class RestParameters:
    """When a stance is long enough for a rest."""

    shortest_s: float = 0.75
    """Shortest rest: the stance of a stride is not as still for as long."""
    shortest_at_end_s: float = 0.5
    """The same within a second of the start or the end of the recording, where people stand."""


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
        """Whether it, of this recording, lasts that long to the rounding of its samples, there or missing."""
        periods = int(count_periods(recording.t[self.start : self.stop], recording.period_s)[-1]) + 1
        return periods * recording.period_s >= shortest_s * (1 - 1e-3)

    def agrees_with(self, longest: Rest) -> bool:
        """Whether it shows the same bias as the longest rest."""
        apart = self.rate - longest.rate
        return bool(apart @ np.linalg.solve(self.covariance + longest.covariance, apart) <= MAX_APART_SIGMAS**2)

    def beyond(self, before: Rest) -> Rest | None:
        """Return what this rest shows beyond what an earlier view of it showed; None if nothing.

        The two together weigh as much as this one alone: information that was counted is not counted again. In a
        direction in which it shows less than before, for a foot that began to sway, nothing is added.
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
    """Find the rests of a recording that show one bias, in order; none where there are none."""
    return _choose_in_agreement(find_still_stretches(recording, parameters))


def find_still_stretches(recording: Recording, parameters: RestParameters) -> list[Rest]:
    """Find the stretches that are still for long enough, whether or not they show the same bias."""
    edge = _cut_blocks(recording)
    quiet, rate, force = _measure_blocks(recording, edge)
    agree = (np.abs(np.diff(rate, axis=0)).max(axis=1, initial=0.0) < np.radians(GYR_STEP_DEG_S)) & (
        np.abs(np.diff(force, axis=0)).max(axis=1, initial=0.0) < ACC_STEP_M_S2
    )
    seen = ~cross_holes(recording.t, np.array(edge))
    first, last = find_runs(quiet[1:] & quiet[:-1] & agree & seen[1:] & seen[:-1])
    rests = [_measure_rest(recording, edge[a], edge[b + 1]) for a, b in zip(first, last, strict=True)]
    return [rest for rest in rests if _is_long_and_slow(recording, rest, parameters)]


def remove_large_bias(t: Floats, acc: Floats, gyr: Floats) -> Floats:
    """Take the rate of the longest rest off the rates (N, 3), where it is large, for checks that assume a small one."""
    rests = find_still_stretches(Recording(t, acc, gyr), RestParameters())
    rate = max(rests, key=lambda rest: rest.stop - rest.start).rate if rests else np.zeros(3)
    return gyr - rate if np.linalg.norm(rate) > np.radians(LARGE_BIAS_DEG_S) else gyr


def _cut_blocks(recording: Recording) -> list[int]:
    """First sample of each block, and that behind the last: as long where samples are missing as elsewhere."""
    block = max(2, round(BLOCK_S / recording.period_s))
    tick = count_periods(recording.t, recording.period_s)
    edges = np.unique(np.searchsorted(tick, np.arange(0, tick[-1] + 2, block)))
    return [int(edge) for edge in edges]


def _measure_blocks(recording: Recording, edge: list[int]) -> tuple[Bools, Floats, Floats]:
    """Of each block (n,): whether it is quiet within, its mean rate (n, 3) and its mean specific force (n, 3)."""
    start, count = np.array(edge[:-1], dtype=np.int64), np.diff(edge)
    mean, std = np.empty((len(count), 6)), np.empty((len(count), 6))
    for samples, columns in ((recording.gyr, np.s_[:3]), (recording.acc, np.s_[3:])):
        mean[:, columns] = np.add.reduceat(samples[: edge[-1]], start) / count[:, None]
        squares = np.add.reduceat(samples[: edge[-1]] ** 2, start) / count[:, None]
        std[:, columns] = np.sqrt(np.maximum(squares - mean[:, columns] ** 2, 0.0))
    quiet = (std[:, :3].max(axis=1) < np.radians(GYR_STD_DEG_S)) & (std[:, 3:].max(axis=1) < ACC_STD_M_S2)
    return quiet & (count > count.max(initial=0) / 2), mean[:, :3], mean[:, 3:]


def _measure_rest(recording: Recording, start: int, stop: int) -> Rest:
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


def _is_long_and_slow(recording: Recording, rest: Rest, p: RestParameters) -> bool:
    t = recording.t
    at_end = t[rest.start] - t[0] < 1.0 or t[-1] - t[rest.stop - 1] < 1.0
    shortest = p.shortest_at_end_s if at_end else p.shortest_s
    return rest.lasts(recording, shortest) and bool(np.abs(rest.rate).max() <= np.radians(MAX_BIAS_DEG_S))


def _choose_in_agreement(rests: list[Rest]) -> tuple[Rest, ...]:
    """Rests that show the same bias as the longest of them."""
    if not rests:
        return ()
    longest = max(rests, key=lambda rest: rest.stop - rest.start)
    return tuple(rest for rest in rests if rest.agrees_with(longest))


MIN_FORCE_M_S2 = 1.0  # A mean specific force below this has no direction worth the name.


MAX_FREE_S = MAX_SWING_S  # No foot of a walking or running person is in the air for longer.


@dataclass(frozen=True)
class Start:
    """Where navigation begins: at sample `row` with this attitude.

    `rest` is the rest of the first footfall, if there is one, and `rests` are those of the whole recording.
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

    Parameters
    ----------
    recording, stances
        Of the same length.
    heading : float
        Of the body's x axis at the start, rad clockwise from north.
    parameters : RestParameters

    Raises
    ------
    EstimationError
        Without a stance, on stances of another recording, or where the specific force vanishes.
    """
    first = find_first_stance(recording, stances)
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


def find_first_stance(recording: Recording, stances: Stances) -> slice:
    """Return the samples of the first stance; `EstimationError` without one, or with stances of another walk."""
    if stances.n_samples != len(recording):
        raise EstimationError(
            f"the stances belong to {stances.n_samples} samples and the recording has {len(recording)}: "
            "detect the stances on this recording."
        )
    if len(stances) == 0:
        raise EstimationError("there is no stance to start from: check the stance detection.")
    return slice(int(stances.start[0]), int(stances.stop[0]))


def _longest_within(span: slice, rests: tuple[Rest, ...]) -> Rest | None:
    """Return the longest rest with its middle in a span of samples."""
    inside = [rest for rest in rests if span.start <= (rest.start + rest.stop) // 2 < span.stop]
    return max(inside, key=lambda rest: rest.stop - rest.start, default=None)


def freeze_ends(t: Floats, stances: Stances, position: Floats, velocity: Floats) -> tuple[str, ...]:
    """Freeze position (N, 3) and velocity (N, 3) beyond the outermost stances; notes of how long."""
    first = int(np.searchsorted(t, t[stances.start[0]] - MAX_FREE_S))
    last = int(np.searchsorted(t, t[stances.stop[-1] - 1] + MAX_FREE_S, side="right")) - 1
    position[:first], velocity[:first] = position[first], 0.0
    position[last + 1 :], velocity[last + 1 :] = position[last], 0.0
    held = ((t[first] - t[0], "before the first"), (t[-1] - t[last], "after the last"))
    return tuple(f"{seconds:.1f} s {where} footfall are not navigated" for seconds, where in held if seconds > 0)
