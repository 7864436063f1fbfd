"""The motion of a sensor, exact at any instant: strides, poses, and the smooth pieces in closed form they are made of.

`Strides` is what a plan of a walk comes down to, and all that foot and thigh share. A `Motion` is known in closed form,
so rate and specific force are exact derivatives of the pose. A sensor records the *mean* over its sample period
[t, t + period] (an integrating sensor, or one behind an anti-alias filter): steps of constant rate and force then
reproduce the pose to second order in the period.

A *ramp* takes a coordinate from 0 to its rise within [start, start + width],

    S(u) = 35 u^4 - 84 u^5 + 70 u^6 - 20 u^7,    u = (t - start) / width in [0, 1],

and leaves it there. The first three derivatives of S vanish at both ends, so a sum of ramps has a continuous
third derivative: rate and specific force are smooth. Its velocity is a bell; bells side by side make any curve.

A *burst* is an oscillation that swells and dies within [start, start + width],

    a w(u) sin(omega (t - start) + phase),    w(u) = u^4 (1 - u)^8 / c,    max w = 1 at u = 1/3.

It begins and ends at zero with three derivatives: after it neither velocity nor position is left.

At rising instants a pointer moves along with t; each value depends on its t alone, however the instants are cut
into blocks.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import Protocol

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import SimulationError
from fg_nav.system.compiled import njit


class Style(IntEnum):
    """The manner of a stride; the gait of a person has parameters for each."""

    WALK = 0
    RUN = 1
    STAIRS_UP = 2
    STAIRS_DOWN = 3
    TURN = 4  # on the spot


@dataclass(frozen=True)
class Strides:
    """K strides of one foot; in pauses between them it stands.

    Attributes
    ----------
    start, duration : (K,) s; a stride lasts from the beginning of its swing (heel-off) to the end of the stance
        after it, so that start[k] + duration[k] <= start[k + 1]; the rest is standing.
    footprint : (K + 1, 3) m, where the foot stands before stride 0 and after each; z is the height of the floor.
    heading : (K + 1,) rad clockwise from north, of the foot at each footprint; unwrapped.
    style : (K,) of `Style`.
    end_s : when the recording ends; the foot stands from the last stride's end to then.
    """

    start: Floats
    duration: Floats
    footprint: Floats
    heading: Floats
    style: Ints
    end_s: float

    def __len__(self) -> int:
        return len(self.start)


@dataclass(frozen=True)
class Kinematics:
    """State of the sensor at N instants.

    `position` (N, 3) m and `velocity` (N, 3) m/s in nav, `nav_R_body` (N, 3, 3), `rate` (N, 3) rad/s and
    specific `force` (N, 3) m/s^2 in the body frame.
    """

    position: Floats
    velocity: Floats
    nav_R_body: Floats
    rate: Floats
    force: Floats


def average_over_period(motion: Motion, t: Floats, period_s: float, nodes: int) -> tuple[Floats, Floats]:
    """Rate (N, 3) rad/s and specific force (N, 3) m/s^2, each the mean over [t, t + period].

    By Gauss-Legendre quadrature, whose error is of order 2 `nodes` in the period.
    """
    node, weight = np.polynomial.legendre.leggauss(nodes)
    rate, force = np.zeros((2, len(t), 3))
    for x, w in zip(node, weight / 2, strict=True):
        state = motion.at(t + period_s * (1 + x) / 2)
        rate += w * state.rate
        force += w * state.force
    return rate, force


class Motion(Protocol):
    """What moves a sensor."""

    def at(self, t: Floats) -> Kinematics:
        """Exact state at rising instants `t` (N,) s."""
        ...

    def sampled(self, t: Floats, period_s: float) -> tuple[Floats, Floats]:
        """Rate (N, 3) rad/s and specific force (N, 3) m/s^2, each the mean over [t, t + period]."""
        ...


PEAK = 1 / 3  # Where in a burst its window is largest.

_WINDOW_PEAK = PEAK**4 * (1 - PEAK) ** 8


@dataclass(frozen=True)
class Ramps:
    """One coordinate that M ramps move: `start`, `width` (M,) s, in order of `start`; `rise` (M,) in its unit.

    They may overlap. `begun_at` is the value before the first.
    """

    start: Floats
    width: Floats
    rise: Floats
    begun_at: float = 0.0

    def __post_init__(self) -> None:
        _check_times(self.start, self.width, "ramp")

    @classmethod
    def of(cls, start: Floats, width: Floats, rise: Floats, begun_at: float = 0.0) -> Ramps:
        """Ramps in any order; those that rise by nothing are left out."""
        kept = np.flatnonzero(rise)
        order = kept[np.argsort(start[kept], kind="stable")]
        return cls(start[order], width[order], rise[order], begun_at)

    def at(self, t: Floats) -> Floats:
        """Value, first and second derivative by time (3, N) at rising `t` (N,) s."""
        check_rising(t)
        return np.asarray(_ramps_at(t, self.start, self.width, self.rise, self._done, self._over))

    @cached_property
    def _done(self) -> Floats:
        """Value (M + 1,) when the first 0, 1, ... M are over."""
        return self.begun_at + np.concatenate([[0.0], np.cumsum(self.rise)])

    @cached_property
    def _over(self) -> Floats:
        return _over(self.start, self.width)


@dataclass(frozen=True)
class Bursts:
    """M bursts of C coordinates: `start`, `width` (M,) s, `omega` (M,) rad/s, `phase` (M,) rad, `amplitude` (M, C)."""

    start: Floats
    width: Floats
    omega: Floats
    phase: Floats
    amplitude: Floats

    def __post_init__(self) -> None:
        _check_times(self.start, self.width, "burst")

    @classmethod
    def of(cls, start: Floats, width: Floats, omega: Floats, phase: Floats, amplitude: Floats) -> Bursts:
        """Bursts in any order; those without amplitude are left out."""
        kept = np.flatnonzero(amplitude.any(axis=1))
        order = kept[np.argsort(start[kept], kind="stable")]
        return cls(start[order], width[order], omega[order], phase[order], np.ascontiguousarray(amplitude[order]))

    def at(self, t: Floats) -> Floats:
        """Value, first and second derivative by time (3, N, C) at rising `t` (N,) s."""
        check_rising(t)
        return np.asarray(_bursts_at(t, self.start, self.width, self.omega, self.phase, self.amplitude, self._over))

    @cached_property
    def _over(self) -> Floats:
        return _over(self.start, self.width)


def check_rising(t: Floats) -> None:
    """Raise `SimulationError` where the instants `t` (N,) do not rise."""
    if len(t) > 1 and not (t[1:] >= t[:-1]).all():
        late = int(np.argmin(t[1:] >= t[:-1])) + 1
        raise SimulationError(f"instant {late} ({t[late]:.3f} s) is before the one ahead of it: sort the instants.")


def _check_times(start: Floats, width: Floats, name: str) -> None:
    if not (np.isfinite(start).all() and np.isfinite(width).all() and (width > 0).all()):
        raise SimulationError(f"a {name} has no time to happen in: give strides a positive, finite duration.")
    if (np.diff(start) < 0).any():
        raise SimulationError(f"the {name}s are not in order of their start: sort them, or use `of`.")


def _over(start: Floats, width: Floats) -> Floats:
    """When each piece and all before it are over (M,): pieces differ in width, so later ones may end first."""
    return np.maximum.accumulate(start + width)


@njit(cache=True)
def _under_way(t: float, start: Floats, over: Floats, first: int, stop: int) -> tuple[int, int]:
    """Move the window of pieces that are begun and not over on to the instant `t`."""
    while first < len(over) and over[first] <= t:
        first += 1
    stop = max(stop, first)
    while stop < len(start) and start[stop] < t:
        stop += 1
    return first, stop


@njit(cache=True)
def _ramps_at(t: Floats, start: Floats, width: Floats, rise: Floats, done: Floats, over: Floats) -> Floats:
    out = np.zeros((3, len(t)))
    first = stop = np.searchsorted(over, t[0], side="right") if len(t) else 0
    for n in range(len(t)):
        first, stop = _under_way(t[n], start, over, first, stop)
        value, slope, bend = done[first], 0.0, 0.0
        for k in range(first, stop):
            u = (t[n] - start[k]) / width[k]
            if u >= 1.0:
                value += rise[k]
                continue
            v = 1.0 - u
            uv = u * v
            value += rise[k] * u * u * u * u * (35.0 - u * (84.0 - u * (70.0 - 20.0 * u)))
            slope += rise[k] / width[k] * 140.0 * uv * uv * uv
            bend += rise[k] / (width[k] * width[k]) * 420.0 * uv * uv * (v - u)
        out[0, n], out[1, n], out[2, n] = value, slope, bend
    return out


@njit(cache=True)
def _bursts_at(
    t: Floats, start: Floats, width: Floats, omega: Floats, phase: Floats, amplitude: Floats, over: Floats
) -> Floats:
    out = np.zeros((3, len(t), amplitude.shape[1]))
    first = stop = np.searchsorted(over, t[0], side="right") if len(t) else 0
    for n in range(len(t)):
        first, stop = _under_way(t[n], start, over, first, stop)
        for k in range(first, stop):
            u = (t[n] - start[k]) / width[k]
            if u >= 1.0:
                continue
            v = 1.0 - u
            w0 = u**4 * v**8 / _WINDOW_PEAK
            # w'/w = 4/u - 8/v, kept free of divisions
            w1 = u**3 * v**7 * (4.0 - 12.0 * u) / (_WINDOW_PEAK * width[k])
            w2 = u**2 * v**6 * (12.0 - 88.0 * u + 132.0 * u * u) / (_WINDOW_PEAK * width[k] ** 2)
            angle = omega[k] * (t[n] - start[k]) + phase[k]
            s, c = np.sin(angle), omega[k] * np.cos(angle)
            value, slope = w0 * s, w1 * s + w0 * c
            bend = w2 * s + 2.0 * w1 * c - w0 * omega[k] ** 2 * s
            for j in range(amplitude.shape[1]):
                out[0, n, j] += amplitude[k, j] * value
                out[1, n, j] += amplitude[k, j] * slope
                out[2, n, j] += amplitude[k, j] * bend
    return out
