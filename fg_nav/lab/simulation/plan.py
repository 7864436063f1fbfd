"""From a plan of a walk to the strides of a right foot: where it comes down, when, and in which manner.

A plan is a row of sections, each beginning where the one before ended: standing, walking or running along a path,
stairs, turns on the spot. The path is that of the body's center over the ground.

Strides along a path. The n-th footprint lies at the share W(n) / W(end) of the integral of 1 + c |curvature| (people
shorten their strides in bends), where W sums the strides' weights

    w_k = half_k exp(a_k / 2) (1 + cv e_k),    stride time = T exp(-a_k / 2) (1 + cv e'_k),

half_k = 1/2 for the first step from, and the last into, standing, else 1; a_k the slow changes of pace, an AR(1)
process of strides; e, e' white and normal. Pace goes half into length and half into time, because people keep the
ratio of stride length to cadence when they walk faster (Sekiya et al. 1996, the walk ratio).

A footprint stands half the step width to the right of the center, and scatters about that place: white, and with a slow
wander of the center, which fades out towards both ends of the plan. The first and the last footprint do not scatter,
so that a walk whose path is closed ends exactly where it began.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal, TypeAlias

import numpy as np
from pydantic import Field
from scipy.signal import lfilter

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import SimulationError
from fg_nav.frames import wrap_angle
from fg_nav.lab.simulation.checks import Checked, Finite, Positive
from fg_nav.lab.simulation.motion import Strides, Style
from fg_nav.lab.simulation.path import GAP_M, KINK_RAD, Path, Pose, check_joint
from fg_nav.lab.simulation.person import Gait, Person, Scatter

MAX_STRIDE = 2.0  # No one makes strides longer than this many times the usual one.
MAX_STRIDES = 200_000  # Two days of walking, and more than a computer's memory likes.
FLAT_SHARE = 0.85  # By this share of a stride the foot is down and flat in every manner of going.
STEP_WIDTH_M = 0.18  # Between the lines on which left and right foot tread (adults: 0.10-0.20).
SLOW_STRIDES = 20.0  # Correlation length of wandering and of changes of pace.
BEND_M = 0.25  # c above: a curve of 1 m radius is walked in strides shorter by a fifth.
_TURN_RAD = 1.2  # By how much a foot turns in one stride on the spot: a right angle takes two, about-turn three.


@dataclass(frozen=True)
class Stand(Checked):
    """Standing still for `seconds`."""

    seconds: Positive


@dataclass(frozen=True)
class Walk(Checked):
    """Walking or running along a `path` of the body's center, in so many `strides` or, None, as the gait has it.

    `pace` : speed over the gait's usual one; half of it, as a power, goes into the strides' length.
    """

    path: Path
    style: Literal[Style.WALK, Style.RUN] = Style.WALK
    strides: Annotated[int, Field(ge=1)] | None = None
    pace: Annotated[float, Field(gt=0.0, le=3.0)] = 1.0  # no one goes more than three times as fast


@dataclass(frozen=True)
class Stairs(Checked):
    """A flight of so many stairs straight ahead, up or down, the landing included; one foot takes every second tread.

    `rise_m`, `tread_m` : height and depth of one, m (DIN 18065: 0.14-0.20 and 0.23-0.37).
    """

    treads: Annotated[int, Field(ge=1)]
    rise_m: Positive = 0.17
    tread_m: Positive = 0.29
    up: bool = True


@dataclass(frozen=True)
class TurnOnSpot(Checked):
    """Turning by `angle` rad, clockwise if positive, without going anywhere."""

    angle: Finite


Section: TypeAlias = Stand | Walk | Stairs | TurnOnSpot


@dataclass(frozen=True)
class Crossing:
    """A landmark and the stride that comes down nearest to it, whose foot is flat at `time_s`."""

    landmark: str
    stride: int
    time_s: float


Along: TypeAlias = Callable[[Floats], tuple[Floats, Floats]]
"""Position (N, 3) m and heading (N,) rad of the body's center after so many strides (N,), whole or not."""


@dataclass(frozen=True)
class Leg:
    """What a section comes down to: n strides of the right foot."""

    along: Along  # Where the center is after 0 to n strides of this leg.
    duration: Floats  # (n,) s.
    style: Style  # Of all of them.
    halves: tuple[bool, bool] = (False, False)  # Whether the first comes out of standing, the last goes into it.
    marks: tuple[tuple[str, int], ...] = ()  # Landmarks with the nearest footprint of this leg (0 = where it begins).
    wait_s: float = 0.0  # Before the first stride.

    def __len__(self) -> int:
        return len(self.duration)


@dataclass(frozen=True)
class WalkPlan:
    """A walk as planned."""

    strides: Strides  # Of the right foot, K.
    crossings: tuple[Crossing, ...]  # Of the paths' landmarks, in order.
    legs: tuple[Leg, ...]  # Of the sections.
    start: Pose  # Of the body's center.
    wander: Floats  # (K + 1,) m, by which the center is to the right of its path at each footprint.

    @property
    def center(self) -> tuple[Floats, Floats]:
        """Position (K + 1, 3) m and heading (K + 1,) rad of the body's center at each footprint, on its path."""
        return _join_centers(self.legs, self.start)


def plan(
    sections: Sequence[Section], person: Person, rng: np.random.Generator, scatter: Scatter = Scatter()
) -> Strides:
    """Draw the strides of a plan: those of `plan_walk`."""
    return plan_walk(sections, person, rng, scatter).strides


def plan_walk(
    sections: Sequence[Section], person: Person, rng: np.random.Generator, scatter: Scatter = Scatter()
) -> WalkPlan:
    """Draw the strides of a right foot along the sections, one after the other.

    The first path says where the walk begins, else it is the origin, facing north; `scatter` is how regular the walker
    is. Raises `SimulationError` for no strides at all, sections that do not join, or strides that no person can make.
    """
    if not any(not isinstance(section, Stand) for section in sections):
        raise SimulationError("The plan has no strides in it: add a Walk, Stairs or a TurnOnSpot.")
    start = _find_start(sections)
    legs = tuple(_make_legs(sections, start, person, scatter, rng))
    # by how much the center is to the right of its path; nothing at both ends
    number = np.arange(1 + sum(len(leg) for leg in legs))
    fade = np.minimum(np.minimum(number, number[::-1]) / SLOW_STRIDES, 1.0)
    wander = fade * _draw_slow_change(scatter.wander_m, len(number), rng)
    footprint, toe = place_foot(*_join_centers(legs, start), STEP_WIDTH_M / 2 + wander, rng, scatter)
    strides = _make_strides(legs, footprint, toe)
    # landmarks with the strides that come down nearest to them
    crossings = []
    for first, leg in zip(_count_before(legs), legs, strict=True):
        for name, nearest in leg.marks:
            stride = max(int(first) + nearest - 1, 0)
            time_s = float(strides.start[stride] + FLAT_SHARE * strides.duration[stride])
            crossings.append(Crossing(name, stride, time_s))
    return WalkPlan(strides, tuple(crossings), legs, start, wander)


def end_of(section: Section, pose: Pose) -> Pose:
    """The pose of the body's center after a section that begins at `pose`."""
    if isinstance(section, Walk):
        rounds = pose.heading - section.path.start.heading
        return Pose(section.path.end.position, section.path.end.heading + rounds)
    if isinstance(section, TurnOnSpot):
        return Pose(pose.position, pose.heading + section.angle)
    if isinstance(section, Stairs):
        return Pose(_climb(section, pose, np.array([float(section.treads)]))[0], pose.heading)
    return pose


def _find_start(sections: Sequence[Section]) -> Pose:
    """Where the first path begins, before the turns on the spot that come first."""
    turned = 0.0
    for section in sections:
        if isinstance(section, TurnOnSpot):
            turned += section.angle
        elif isinstance(section, Walk):
            return Pose(section.path.start.position, section.path.start.heading - turned)
        elif isinstance(section, Stairs):
            break
    return Pose(np.zeros(3), 0.0)


def _make_legs(
    sections: Sequence[Section], start: Pose, person: Person, scatter: Scatter, rng: np.random.Generator
) -> Iterator[Leg]:
    """The legs of the sections, in order."""
    pose = start
    for i, section in enumerate(sections):
        if isinstance(section, Walk):
            check_joint(f"The walk and section {i}", pose, section.path.start)
            halves = _stands(sections, i - 1), _stands(sections, i + 1)
            yield _draw_walking(section, pose, halves, person.gait(section.style), scatter, rng)
        elif isinstance(section, Stairs):
            # every second tread; with an odd number of them the first stride takes one
            style = Style.STAIRS_UP if section.up else Style.STAIRS_DOWN
            trodden = np.arange(section.treads, 0, -2, dtype=np.float64)[::-1]
            yield Leg(_climb_along(section, trodden, pose), _draw_times(person.gait(style), len(trodden), rng), style)
        elif isinstance(section, TurnOnSpot):
            count = max(2, int(np.ceil(abs(section.angle) / _TURN_RAD)))
            duration = _draw_times(person.gait(Style.TURN), count, rng)
            yield Leg(_turn_at(pose, section.angle, count), duration, Style.TURN)
        else:
            yield Leg(_turn_at(pose, 0.0, 1), np.zeros(0), Style.WALK, wait_s=section.seconds)
        pose = end_of(section, pose)


def _draw_walking(
    section: Walk, pose: Pose, halves: tuple[bool, bool], gait: Gait, scatter: Scatter, rng: np.random.Generator
) -> Leg:
    """Strides along a path; `halves` says whether it begins and ends in standing."""
    path = section.path
    weight = _weigh_strides(_count_strides(section, gait, halves), halves)
    faster = _draw_slow_change(scatter.pace, len(weight), rng) / 2
    weight *= np.exp(faster) * _draw_times(gait, len(weight), rng)
    # arc lengths after whole strides, which are shorter in bends
    middle = (path.arc[1:] + path.arc[:-1]) / 2
    density = np.diff(path.arc) * (1 + BEND_M * np.minimum(np.abs(path.curvature(middle)), 1.0))
    total = np.concatenate([[0.0], np.cumsum(density)])
    share = np.concatenate([[0.0], np.cumsum(weight) / weight.sum()])
    arc: Floats = np.interp(share * total[-1], total, path.arc)
    duration = np.exp(-faster) / np.sqrt(section.pace) * _draw_times(gait, len(weight), rng)
    marks = tuple((mark.name, int(np.argmin(np.abs(arc - mark.arc)))) for mark in path.landmarks)

    def go(number: Floats) -> tuple[Floats, Floats]:
        position, heading = path.at(np.interp(number, np.arange(len(arc)), arc))
        return position, heading + pose.heading - path.start.heading

    return Leg(go, duration, section.style, halves, marks)


def _draw_times(gait: Gait, count: int, rng: np.random.Generator) -> Floats:
    """Stride times (K,) s with the gait's variation, none beyond three standard deviations."""
    return gait.stride_s * (1 + gait.variation * np.clip(rng.standard_normal(count), -3.0, 3.0))


def _stands(sections: Sequence[Section], i: int) -> bool:
    """Whether the walker stands with feet together in section i, or where there is none."""
    return not 0 <= i < len(sections) or isinstance(sections[i], Stand | TurnOnSpot)


def _count_strides(section: Walk, gait: Gait, halves: tuple[bool, bool]) -> int:
    """How many strides a path takes: as asked for, else the number nearest to the gait's."""
    usual_m = gait.stride_m * np.sqrt(section.pace)
    count = section.strides or max(1, round(section.path.length_m / usual_m + sum(halves) / 2))
    if count > MAX_STRIDES:
        raise SimulationError(
            f"{section.path.length_m:g} m take {float(count):.3g} strides: ask for at most {MAX_STRIDES}."
        )
    mean_m = section.path.length_m / _weigh_strides(count, halves).sum()
    if mean_m > MAX_STRIDE * usual_m:
        raise SimulationError(
            f"{section.path.length_m:g} m in {count} strides makes strides of {mean_m:.3g} m: "
            f"ask for about {round(section.path.length_m / usual_m)}."
        )
    return count


def _weigh_strides(count: int, halves: tuple[bool, bool]) -> Floats:
    """Weights (K,) of strides: a half for the step out of standing and the one into it."""
    weight = np.ones(count)
    weight[0] = 0.5 if halves[0] else weight[0]
    weight[-1] = 0.5 if halves[1] else weight[-1]
    return weight


def _turn_at(pose: Pose, angle: float, count: int) -> Along:
    """Turn by `angle` rad in `count` strides."""
    return lambda number: (np.tile(pose.position, (len(number), 1)), pose.heading + angle * number / count)


def _climb_along(section: Stairs, trodden: Floats, pose: Pose) -> Along:
    """On stairs of which the right foot treads on those `trodden` (n,); halfway, on the last whole tread."""
    reached = np.concatenate([[0.0], trodden])

    def climb(number: Floats) -> tuple[Floats, Floats]:
        treads = np.floor(np.interp(number, np.arange(len(reached)), reached))
        return _climb(section, pose, treads), np.full(len(number), pose.heading)

    return climb


def _climb(section: Stairs, pose: Pose, treads: Floats) -> Floats:
    """Place (N, 3) m on the stairs after so many treads (N,)."""
    rise = section.rise_m if section.up else -section.rise_m
    step = [section.tread_m * np.sin(pose.heading), section.tread_m * np.cos(pose.heading), rise]
    place: Floats = pose.position + treads[:, None] * np.array(step)
    return place


def _draw_slow_change(sd: float, count: int, rng: np.random.Generator) -> Floats:
    """A stationary AR(1) process (count,) of strides, of this standard deviation."""
    keep = float(np.exp(-1 / SLOW_STRIDES))
    kick = sd * np.sqrt(1 - keep**2) * rng.standard_normal(count)
    kick[0] /= np.sqrt(1 - keep**2)
    return np.asarray(lfilter([1.0], [1.0, -keep], kick))


def _join_centers(legs: Sequence[Leg], start: Pose) -> tuple[Floats, Floats]:
    """Position (K + 1, 3) m and heading (K + 1,) rad of the center before the first stride and after each."""
    reached = [leg.along(np.arange(1.0, len(leg) + 1)) for leg in legs]
    position = np.vstack([start.position, *(position for position, _ in reached)])
    return position, np.concatenate([[start.heading], *(heading for _, heading in reached)])


def _make_strides(legs: Sequence[Leg], footprint: Floats, toe: Floats) -> Strides:
    """Legs, one after the other, as strides from footprint (K + 1, 3) m to footprint, with their times."""
    duration = np.concatenate([leg.duration for leg in legs])
    wait = np.zeros(len(duration) + 1)
    np.add.at(wait, _count_before(legs), [leg.wait_s for leg in legs])
    end = np.cumsum(wait[:-1] + duration)
    begin = np.concatenate([[0.0], end[:-1]]) + wait[:-1]
    return Strides(
        start=begin,
        duration=end - begin,
        footprint=footprint,
        heading=toe,
        style=np.concatenate([np.full(len(leg.duration), leg.style, dtype=np.int64) for leg in legs]),
        end_s=float(end[-1] + wait[-1]),
    )


def _count_before(legs: Sequence[Leg]) -> Ints:
    """How many strides (L,) come before each leg."""
    return np.cumsum([0, *(len(leg) for leg in legs[:-1])])


def place_foot(
    position: Floats, heading: Floats, aside_m: Floats, rng: np.random.Generator, scatter: Scatter
) -> tuple[Floats, Floats]:
    """Footprints (K + 1, 3) m and headings (K + 1,) rad of a foot that is `aside_m` (K + 1,) m right of the path."""
    count = len(heading)
    inside = np.ones(count)
    inside[[0, -1]] = 0.0
    right = np.stack([np.cos(heading), -np.sin(heading), np.zeros(count)], axis=1)
    footprint = position + aside_m[:, None] * right
    ahead = np.stack([np.sin(heading), np.cos(heading), np.zeros(count)], axis=1)
    off = scatter.footprint_m * inside[:, None] * rng.standard_normal((count, 2))
    footprint += off[:, :1] * right + off[:, 1:] * ahead
    toe = heading + scatter.heading_rad * inside * rng.standard_normal(count)
    # take the round-off from the end of a closed walk
    turned = float(wrap_angle(np.array(toe[-1] - toe[0])))
    if np.linalg.norm(footprint[-1] - footprint[0]) < GAP_M and abs(turned) < KINK_RAD:
        footprint[-1] = footprint[0]
        toe[-1] -= turned
    return footprint, toe
