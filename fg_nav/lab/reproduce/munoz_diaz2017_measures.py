"""How a figure of Munoz Diaz et al. (2017) is read off a run. Biases are in deg/s, axis z along the thigh."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from fg_nav.lab.reproduce.munoz_diaz2017_runs import Run
from fg_nav.lab.reproduce.munoz_diaz2017_walks import Setting

Measure: TypeAlias = Callable[[Run, Setting], float]
"""NaN where the walk has nothing to read it off."""

X, Y, Z = range(3)


def reached(axis: int, level: float) -> Measure:
    """Minute at which a bias first is as far from zero as `level`, deg/s, to the same side; infinite for never."""

    def measure(run: Run, _: Setting) -> float:
        there = np.flatnonzero(run.bias[:, axis] * np.sign(level) >= abs(level))
        return float(run.minute[there[0]]) if len(there) else math.inf

    return measure


def for_good(axis: int, level: float) -> Measure:
    """As `reached`, but the minute from which on it stays so; infinite where it does not at the end."""

    def measure(run: Run, _: Setting) -> float:
        short = np.flatnonzero(run.bias[:, axis] * np.sign(level) < abs(level))
        first = short[-1] + 1 if len(short) else 0
        return float(run.minute[first]) if first < len(run.minute) else math.inf

    return measure


def at_end(axis: int) -> Measure:
    """Bias of the last minute, deg/s."""
    return lambda run, _: float(run.bias[run.minute > run.minute[-1] - 1.0, axis].mean())


def at_minute(axis: int, minute: float) -> Measure:
    """Bias at a minute, deg/s."""
    return lambda run, _: float(np.interp(minute, run.minute, run.bias[:, axis]))


def largest(axis: int, from_min: float = 0.0) -> Measure:
    """How far a bias is from the true one at most, deg/s; which way goes by the iron."""

    def measure(run: Run, setting: Setting) -> float:
        return float(np.abs(run.bias - setting.bias)[run.minute >= from_min, axis].max(initial=0.0))

    return measure


def share_used(run: Run, _: Setting) -> float:
    """Share of the seconds in which the field was used."""
    return float(run.used.mean())


def jump(event: int) -> Measure:
    """How far the z bias goes to and fro while one passes, deg/s: within 0.3 min of it."""

    def measure(run: Run, setting: Setting) -> float:
        near = np.abs(run.minute - setting.passed_min[event]) < 0.3
        return float(np.ptp(run.bias[near, 2])) if near.any() else math.nan

    return measure


def yaw_at_end(run: Run, _: Setting) -> float:
    """Yaw error, deg, without its sign."""
    return float(abs(run.yaw_error[-1]))


def yaw_range(begin: float, end: float) -> Measure:
    """How far the yaw error goes to and fro between two minutes, deg."""

    def measure(run: Run, _: Setting) -> float:
        part = (run.minute >= begin) & (run.minute <= end)
        return float(np.ptp(run.yaw_error[part])) if part.any() else math.nan

    return measure


def yaw_wander(begin: float, end: float, blunt_min: float = 0.5) -> Measure:
    """How far the yaw error goes up and down over how far it gets, between two minutes: 1 where it goes one way.

    Means over half a minute, in which strides do not count.
    """

    def measure(run: Run, setting: Setting) -> float:
        part = (run.minute >= begin) & (run.minute <= end)
        place = (run.minute[part] / blunt_min).astype(int)
        _, at, count = np.unique(place, return_inverse=True, return_counts=True)
        means = np.bincount(at, run.yaw_error[part]) / count
        return ratio(float(np.abs(np.diff(means)).sum()), float(np.ptp(means))) if len(means) > 1 else math.nan

    return measure


def yaw_after(legs: int) -> Measure:
    """Yaw error after so many ways along the street, deg, without its sign."""

    def measure(run: Run, setting: Setting) -> float:
        end = setting.ends[setting.legs < legs][-1] / 60.0
        return float(abs(np.interp(end, run.minute, run.yaw_error)))

    return measure


def away_after(legs: int) -> Measure:
    """Distance from the first place to that after so many ways along the street, m; truly none."""
    return lambda run, setting: float(np.linalg.norm(run.path[np.flatnonzero(setting.legs < legs)[-1]]))


def from_zero(axis: int) -> Measure:
    """How far a bias of the last minute is from zero, deg/s."""
    return lambda run, setting: abs(at_end(axis)(run, setting))


def yaw_grown(begin: float, end: float) -> Measure:
    """How much farther the yaw is off from one share of the time to another, deg."""

    def measure(run: Run, _: Setting) -> float:
        at = np.interp(np.array([begin, end]) * run.minute[-1], run.minute, run.yaw_error)
        return float(abs(at[1]) - abs(at[0]))

    return measure


def over(one: Measure, other: Measure) -> Measure:
    """One figure over another of the same run."""

    def measure(run: Run, setting: Setting) -> float:
        return ratio(one(run, setting), other(run, setting))

    return measure


def ratio(one: float, other: float) -> float:
    """NaN where neither came, or there is nothing to divide by."""
    if other == 0.0 or (math.isinf(one) and math.isinf(other)):
        return math.nan
    return one / other
