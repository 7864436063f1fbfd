"""The noise of each sensor of a recording that lay still: its longest rest, and an Allan deviation per axis.

Rest here is told by the sensor's own noise, not by what a foot does (`fg_nav.detection.rest`): one second is quiet if
its scatter is about that of the quietest seconds, and two quiet seconds belong together if their means agree as far as
noise allows. Whatever moves the sensor, a step on the floor beside it even, ends the stretch: a curve that is partly
motion shows no sensor.

A magnetometer with a rate of its own is read at its own rows. Samples that a recording lacks (up to
`fg_nav.recording.MAX_GAP_S` in a row) lie on a line between their neighbours: averages hardly know.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.calibration.allan import (
    MIN_READINGS,
    AllanCurve,
    FitParameters,
    NoiseFit,
    allan_curve,
    averaging_factors,
    fit_noise,
)
from fg_nav.errors import CalibrationError
from fg_nav.recording import Recording
from fg_nav.stances import runs


@dataclass(frozen=True)
class StillnessParameters:
    """What counts as lying still."""

    block_s: float = 1.0
    """Long enough to average noise, short enough to notice a touch."""
    quietest_percent: float = 10.0
    """The noise is that of the quietest blocks: so many of a hundred are at rest, or nothing is."""
    most_scatter: float = 1.5
    """Of a block over the noise; that of a hundred samples is off by 7 per cent, and blocks are many."""
    most_gyr_deg_s: float = 2.0
    """Largest scatter of a resting gyroscope: noisier ones are not made, but feet are."""
    most_acc_m_s2: float = 0.5
    """The same of an accelerometer."""
    gyr_step_deg_s: float = 0.2
    """By how much the mean rate may change from block to block, beside noise: the motion of a finger's touch."""
    acc_step_m_s2: float = 0.03
    """By how much the mean specific force may: 0.2 deg of tilt."""
    step_sigmas: float = 6.0
    """Noise of a block's mean that is let pass on top, for an hour of blocks."""
    shortest_s: float = 30.0
    """Averages of a second are then seen thirty times, which shows N to some per cent, and as a rule nothing else."""


@dataclass(frozen=True)
class SensorNoise:
    """Allan deviation of a sensor (`gyr`, `acc` or `mag`), one curve and fit an axis; its rate in Hz."""

    sensor: str
    rate_hz: float
    curves: tuple[AllanCurve, ...]
    fits: tuple[NoiseFit, ...]


@dataclass(frozen=True)
class RecordingNoise:
    """Noise of the sensors of a recording, seen from `start_s` for `seconds`, on the recording's clock."""

    start_s: float
    seconds: float
    sensors: tuple[SensorNoise, ...]


def recording_noise(
    recording: Recording,
    fit: FitParameters = FitParameters(),
    stillness: StillnessParameters = StillnessParameters(),
) -> RecordingNoise:
    """Allan deviations over the longest stretch at rest.

    Raises
    ------
    CalibrationError
        If the sensor does not lie still, or not for long enough.
    """
    start, stop = longest_stillness(recording, stillness)
    seconds = (stop - start) * recording.period_s
    if seconds < stillness.shortest_s * (1 - 1e-3):
        raise CalibrationError(
            f"the sensor lies still for {seconds:.0f} s at most, which is too short for an Allan deviation: record it "
            f"lying untouched, for {stillness.shortest_s:.0f} s at least and for hours to see its bias instability."
        )
    rest = recording.slice(start, stop)
    sensors = [_sensor(name, t, readings, fit) for name, t, readings in _readings(rest)]
    return RecordingNoise(float(rest.t[0]), seconds, tuple(sensors))


def longest_stillness(recording: Recording, parameters: StillnessParameters = StillnessParameters()) -> tuple[int, int]:
    """Find the samples `start <= i < stop` of the longest stretch at rest; none, 0 and 0, where nothing rests."""
    p = parameters
    block = max(2, round(p.block_s / recording.period_s))
    count = len(recording) // block
    if not count:
        return 0, 0
    quiet, together = np.ones(count, dtype=bool), np.ones(max(0, count - 1), dtype=bool)
    for samples, most, step in (
        (recording.gyr, np.radians(p.most_gyr_deg_s), np.radians(p.gyr_step_deg_s)),
        (recording.acc, p.most_acc_m_s2, p.acc_step_m_s2),
    ):
        here, joined = _still(samples[: count * block].reshape(count, block, 3), most, step, p)
        quiet &= here
        together &= joined
    return _longest(quiet, together, block)


def _still(blocks: Floats, most: float, step: float, p: StillnessParameters) -> tuple[Bools, Bools]:
    """Which blocks (B, n, 3) are quiet (B,), and which are together with the next (B - 1,)."""
    scatter, mean = blocks.std(axis=1), blocks.mean(axis=1)
    noise = np.percentile(scatter, p.quietest_percent, axis=0)
    limit = np.minimum(most, p.most_scatter * noise + 1e-12)
    allowed = step + p.step_sigmas * np.sqrt(2 / blocks.shape[1]) * noise
    return (scatter <= limit).all(axis=1), (np.abs(np.diff(mean, axis=0)) < allowed).all(axis=1)


def _longest(quiet: Bools, together: Bools, block: int) -> tuple[int, int]:
    """Samples of the longest run of quiet blocks that are together."""
    if not quiet.any():
        return 0, 0
    first, last = runs(quiet[1:] & quiet[:-1] & together)
    if not len(first):
        return 0, block
    longest = int(np.argmax(last - first))
    return int(first[longest]) * block, (int(last[longest]) + 1) * block


def _readings(rest: Recording) -> Iterator[tuple[str, Floats, Floats]]:
    """Name, stamps and readings of each sensor, in rows where it has a sample."""
    yield "gyr", rest.t, rest.gyr
    yield "acc", rest.t, rest.acc
    if rest.mag is not None:
        fresh = ~np.isnan(rest.mag).any(axis=1)
        if np.count_nonzero(fresh) >= MIN_READINGS:
            yield "mag", rest.t[fresh], rest.mag[fresh]


def _sensor(name: str, t: Floats, readings: Floats, parameters: FitParameters) -> SensorNoise:
    even, period_s = _evenly(t, readings)
    factors = averaging_factors(len(even), parameters)
    curves = tuple(allan_curve(axis, period_s, factors) for axis in even.T)
    fits = tuple(fit_noise(curve, parameters) for curve in curves)
    return SensorNoise(name, 1 / period_s, curves, fits)


def _evenly(t: Floats, readings: Floats) -> tuple[Floats, float]:
    """Readings with a row for every sample that should be there, and the time between two."""
    place = np.concatenate([[0], np.cumsum(np.maximum(1, np.round(np.diff(t) / np.median(np.diff(t)))))])
    period_s = float((t[-1] - t[0]) / place[-1])
    if place[-1] == len(t) - 1:
        return readings, period_s
    every = np.arange(int(place[-1]) + 1)
    return np.column_stack([np.interp(every, place, axis) for axis in readings.T]), period_s
