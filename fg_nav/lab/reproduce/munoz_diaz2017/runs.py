"""What the estimators make of the walks of Munoz Diaz et al. (2017): orientation, bias, and the way by dead reckoning.

========== =========================================================================================================
as printed the paper's filter, its equations as they stand, misprints and all (`as_printed`)
filter     with these corrected; gravity by a mean over two strides
batch      `fg_nav.pocket.smooth_pocket`, an iterated Kalman smoother of the whole walk
online     `fg_nav.lab.follow_pocket`, the same with a fixed lag: each estimate is made of what was there until then
========== =========================================================================================================

The graph is given what the filter assumes: that the emulated sensor of the first walk has no errors of scale
and axes, and a magnetometer that is off by its white error only. The MTw of the second walk may have them.

The position is that of the thigh's steps (`fg_nav.pocket.dead_reckoning`), the constant of their length calibrated by
the whole walk.

How a figure of Munoz Diaz et al. (2017) is read off a run. Biases are in deg/s, axis z along the thigh.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial, wraps
from types import MappingProxyType
from typing import Concatenate, ParamSpec, TypeAlias

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.errors import EstimationError
from fg_nav.frames import compute_heading
from fg_nav.lab.follow_pocket import follow_pocket
from fg_nav.lab.reproduce.munoz_diaz2017 import as_printed
from fg_nav.lab.reproduce.munoz_diaz2017.walks import BATCH, FILTER, FIRST, ONLINE, PRINTED, Case, Setting
from fg_nav.pocket import PocketParameters, PocketSmootherParameters, PocketTrack, estimate_pocket, level_start
from fg_nav.pocket.dead_reckoning import calibrate_step_length, reckon_path
from fg_nav.pocket.iterated_smoother import smooth_pocket
from fg_nav.pocket.steps import estimate_swing, find_steps
from fg_nav.recording import Recording
from fg_nav.truth import TrajectoryTruth


@dataclass(frozen=True)
class Run:
    """What an estimator made of a walk, once a second (M rows).

    Attributes
    ----------
    minute : (M,) min.
    bias, sigma : (M, 3) deg/s.
    yaw_error : (M,) deg, unwrapped, zero at the start.
    strength : (M,) uT as measured; None without a magnetometer.
    used : (M,) whether the differential field update was used.
    path : (K, 2) m, places after each stride by dead reckoning.
    """

    minute: Floats
    bias: Floats
    sigma: Floats
    yaw_error: Floats
    strength: Floats | None
    used: Bools
    path: Floats


Estimate: TypeAlias = Callable[[Recording, Case, float], PocketTrack]
"""Of a recording, what is given of it, and the heading at the start."""

GRAPHS = {True: PocketSmootherParameters(gyr_scale_sigma=1e-5, mag_left_uT=1e-3), False: PocketSmootherParameters()}
"""Parameters of the graph, by whether the sensor is emulated; a thousandth of what a real one has stands for none."""

FILTERS: Mapping[str, tuple[PocketParameters, Callable[..., PocketTrack]]] = MappingProxyType(
    {
        PRINTED: (as_printed.PRINTED, as_printed.estimate_as_printed),
        FILTER: (PocketParameters(), estimate_pocket),
    }
)


def _filter(name: str, recording: Recording, case: Case, heading: float) -> PocketTrack:
    parameters, run = FILTERS[name]
    known = replace(parameters, field_gated=case.gated, mag_sigma_uT=case.mag_sigma_uT)
    return run(recording, known, level_start(recording, heading))


def _smooth(graph: Callable[..., PocketTrack], recording: Recording, case: Case, heading: float) -> PocketTrack:
    parameters = replace(GRAPHS[case in FIRST], mag_sigma_uT=case.mag_sigma_uT)
    return graph(recording, parameters, level_start(recording, heading))


ESTIMATORS: Mapping[str, Estimate] = MappingProxyType(
    {
        **{name: partial(_filter, name) for name in FILTERS},
        BATCH: partial(_smooth, smooth_pocket),
        ONLINE: partial(_smooth, follow_pocket),
    }
)


def run_estimators(recording: Recording, case: Case, setting: Setting) -> dict[str, Run | None]:
    """What each estimator of a case makes of a recording; None where it ended."""
    truth = recording.truth
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    heading = float(compute_heading(truth.nav_R_body[0]))
    found: dict[str, Run | None] = {}
    for name in case.by:
        try:
            track = ESTIMATORS[name](recording, case, heading)
        except EstimationError:
            found[name] = None
        else:
            found[name] = make_run(track, recording, truth.nav_R_body, setting)
    return found


def make_run(track: PocketTrack, recording: Recording, true_R: Floats, setting: Setting) -> Run:
    """Once a second, and the way by dead reckoning."""
    yaw = np.degrees(np.unwrap(compute_heading(track.nav_R_body)) - np.unwrap(compute_heading(true_R)))
    rows = slice(None, None, 100)
    strength = None if recording.mag is None else np.linalg.norm(recording.mag[rows], axis=1)
    return Run(
        minute=track.t[rows] / 60.0,
        bias=np.degrees(track.gyro_bias[rows]),
        sigma=np.degrees(track.sigma[rows, 3:]),
        yaw_error=yaw[rows] - yaw[0],
        strength=strength,
        used=track.field_used[rows],
        path=reckon_places(track, recording, setting),
    )


def reckon_places(track: PocketTrack, recording: Recording, setting: Setting) -> Floats:
    """Places (K, 2) m at the end of each stride: steps of the thigh, their length from that of the whole walk.

    NaN where there is no step to be found.
    """
    try:
        swing = estimate_swing(recording, track, with_force=False)
        steps = find_steps(recording.t, swing.flexion, swing.up_now)
        path = reckon_path(track, swing, steps, calibrate_step_length(steps, setting.length_m))
    except EstimationError:
        return np.full((len(setting.ends), 2), np.nan)
    return np.stack([np.interp(setting.ends, track.t[path.sample], axis) for axis in path.position.T[:2]], axis=1)


Measure: TypeAlias = Callable[[Run, Setting], float]
"""NaN where the walk has nothing to read it off."""

X, Y, Z = range(3)


P = ParamSpec("P")


def _measure(read: Callable[Concatenate[Run, Setting, P], float]) -> Callable[P, Measure]:
    """Make a reading, whose further arguments are given once, a `Measure`."""

    @wraps(read)
    def measure(*args: P.args, **named: P.kwargs) -> Measure:
        return lambda run, setting: read(run, setting, *args, **named)

    return measure


@_measure
def reached(run: Run, _: Setting, axis: int, level: float) -> float:
    """Minute at which a bias first is as far from zero as `level`, deg/s, to the same side; infinite for never."""
    there = np.flatnonzero(run.bias[:, axis] * np.sign(level) >= abs(level))
    return float(run.minute[there[0]]) if len(there) else math.inf


@_measure
def for_good(run: Run, _: Setting, axis: int, level: float) -> float:
    """As `reached`, but the minute from which on it stays so; infinite where it does not at the end."""
    short = np.flatnonzero(run.bias[:, axis] * np.sign(level) < abs(level))
    first = short[-1] + 1 if len(short) else 0
    return float(run.minute[first]) if first < len(run.minute) else math.inf


@_measure
def at_end(run: Run, _: Setting, axis: int) -> float:
    """Bias of the last minute, deg/s."""
    return float(run.bias[run.minute > run.minute[-1] - 1.0, axis].mean())


@_measure
def from_zero(run: Run, setting: Setting, axis: int) -> float:
    """How far a bias of the last minute is from zero, deg/s."""
    return abs(at_end(axis)(run, setting))


@_measure
def at_minute(run: Run, _: Setting, axis: int, minute: float) -> float:
    """Bias at a minute, deg/s."""
    return float(np.interp(minute, run.minute, run.bias[:, axis]))


@_measure
def largest(run: Run, setting: Setting, axis: int, from_min: float = 0.0) -> float:
    """How far a bias is from the true one at most, deg/s; which way depends on the iron."""
    return float(np.abs(run.bias - setting.bias)[run.minute >= from_min, axis].max(initial=0.0))


def share_used(run: Run, _: Setting) -> float:
    """Share of the seconds in which the field was used."""
    return float(run.used.mean())


@_measure
def jump(run: Run, setting: Setting, event: int) -> float:
    """How far the z bias goes to and fro while one passes, deg/s: within 0.3 min of it."""
    near = np.abs(run.minute - setting.passed_min[event]) < 0.3
    return float(np.ptp(run.bias[near, 2])) if near.any() else math.nan


def yaw_at_end(run: Run, _: Setting) -> float:
    """Yaw error, deg, without its sign."""
    return float(abs(run.yaw_error[-1]))


@_measure
def yaw_range(run: Run, _: Setting, begin: float, end: float) -> float:
    """How far the yaw error goes to and fro between two minutes, deg."""
    part = (run.minute >= begin) & (run.minute <= end)
    return float(np.ptp(run.yaw_error[part])) if part.any() else math.nan


@_measure
def yaw_wander(run: Run, _: Setting, begin: float, end: float, blunt_min: float = 0.5) -> float:
    """How far the yaw error goes up and down over how far it gets, between two minutes: 1 where it goes one way.

    Means over half a minute, in which strides do not count.
    """
    part = (run.minute >= begin) & (run.minute <= end)
    place = (run.minute[part] / blunt_min).astype(int)
    at, count = np.unique(place, return_inverse=True, return_counts=True)[1:]
    means = np.bincount(at, run.yaw_error[part]) / count
    return ratio(float(np.abs(np.diff(means)).sum()), float(np.ptp(means))) if len(means) > 1 else math.nan


@_measure
def yaw_after(run: Run, setting: Setting, legs: int) -> float:
    """Yaw error after so many ways along the street, deg, without its sign."""
    end = setting.ends[setting.legs < legs][-1] / 60.0
    return float(abs(np.interp(end, run.minute, run.yaw_error)))


@_measure
def away_after(run: Run, setting: Setting, legs: int) -> float:
    """Distance from the first place to that after so many ways along the street, m; truly none."""
    return float(np.linalg.norm(run.path[np.flatnonzero(setting.legs < legs)[-1]]))


@_measure
def yaw_grown(run: Run, _: Setting, begin: float, end: float) -> float:
    """How much farther the yaw is off from one share of the time to another, deg."""
    at = np.interp(np.array([begin, end]) * run.minute[-1], run.minute, run.yaw_error)
    return float(abs(at[1]) - abs(at[0]))


@_measure
def over(run: Run, setting: Setting, one: Measure, other: Measure) -> float:
    """One figure over another of the same run."""
    return ratio(one(run, setting), other(run, setting))


def ratio(one: float, other: float) -> float:
    """NaN where neither came, or there is nothing to divide by."""
    if other == 0.0 or (math.isinf(one) and math.isinf(other)):
        return math.nan
    return one / other
