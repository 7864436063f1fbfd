"""Both feet of one person, each with a sensor: the walk of `simulate`, and the left foot beside it.

The right foot and its recording are those of `simulate` with the same seed, to the last bit. The left one alternates
with it on the same floor, in the same field. It has a sensor and a mounting of its own, from the same
priors; gait and shoe are the right one's in the mirror. Both sensors share a clock, but not the jitter of its stamps
nor the lost samples. Both truths are in one frame, whose origin is where the right sensor first is.

The person's truth is the middle of the feet, of the pivots under both insteps, with the mean of their headings:

    p(t) = (p_left(t) + p_right(t)) / 2,    nav_R_person(t) = Rz((yaw_left(t) + yaw_right(t)) / 2).

While the right foot swings the left one stands on a *stop*, halfway along the right one's stride; in the middle of that
stride it leaves, for the next stop. With c(n) the body's center on its path after n strides of the right foot, t_k and
T_k the start and the duration of its stride k (from 0 on), and cv the gait's variation, stop k is

    at c(k + 1/2 + e_k),    left at t_k + (1/2 + e'_k) T_k,    e, e' ~ N(0, (cv / 2)^2).

A left stride so lasts the mean of two right ones, with the variance cv^2 / 2 + 2 (cv / 2)^2 = cv^2 of a right one; its
length likewise. Where a walk begins or ends with the feet together, the stop is there: the left foot makes a stride
less, and no half ones. On stairs it takes the treads that the right foot leaves out. In a turn on the spot it is half a
stride ahead of the right one, for which it makes an *opening* stride before the first and a *closing* one after the
last. Where the person stands for so long that both find time, the feet are beside each other.

The person's center wanders off its path (`plan`) with both feet, and each foot scatters about its place by itself. The
feet are a step width apart that is the person's own, 0.15 +- 0.025 m (Schulz 2012: 0.14 +- 0.03 of the leg's length at
the heels; feet point a little outward, so the insteps are farther apart). It varies from step to step by the scatter of
both feet and a step's share of the wander, 2.1 to 2.4 cm (Skiadopoulos et al. 2020: young adults 2.0 to 2.5 cm;
Almarwani et al. 2016: 2.4 +- 0.6).

>>> feet = simulate_feet("office", seed=1)
>>> feet.left.recording, feet.right.recording, feet.person
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import SimulationError
from fg_nav.lab.simulation.foot import FootMotion
from fg_nav.lab.simulation.motion import Strides, Style
from fg_nav.lab.simulation.path import GAP_M, KINK_RAD
from fg_nav.lab.simulation.person import MOUNTS, Person, Scatter
from fg_nav.lab.simulation.plan import STEP_WIDTH_M, WalkPlan, place_foot
from fg_nav.lab.simulation.scenarios import Choices, Scenario
from fg_nav.lab.simulation.walk import (
    Carried,
    Outing,
    Progress,
    SimulatedWalk,
    build_foot,
    carry_sensor,
    record_walk,
    say_nothing,
)
from fg_nav.truth import TrajectoryTruth

USUAL_WIDTH_M, WIDTH_SD_M = 0.15, 0.025  # Step widths of persons, mean and standard deviation.
RAREST = 2.0  # No one treads wider or narrower by more standard deviations.

_RANK = np.array([0, 1, 3, 4, 2])
"""By `Style`: of the styles at both ends of a stride it has the higher one, stairs before turns before running."""


class _Stops(NamedTuple):
    """Where the left foot stands, S stops in order."""

    position: Floats  # (S, 3) m and (S,) rad of the body's center that belongs to each.
    heading: Floats
    number: Floats  # (S,) strides of the right foot until there, whole or not.
    arrives: Floats  # (S,) s, when the stride to it ends and the one from it begins.
    leaves: Floats
    style: Ints  # (S,) of `Style`, of the right foot's stride.


def draw_step_width(rng: np.random.Generator) -> float:
    """Draw how far apart a person's feet tread, m."""
    return USUAL_WIDTH_M + WIDTH_SD_M * float(np.clip(rng.standard_normal(), -RAREST, RAREST))


def plan_left_foot(
    plan: WalkPlan, person: Person, step_width_m: float, rng: np.random.Generator, scatter: Scatter = Scatter()
) -> Strides:
    """Draw the strides of the left foot beside those of the right one; the feet tread a step width apart."""
    # stops in the middle of right strides and where the person stands, in the order of time
    parts = _stop_halfway(plan, person, rng), _stop_standing(plan)
    order = np.argsort(np.concatenate([np.arange(len(plan.strides)) + 0.5, parts[1].number]))
    stops = _Stops(*(np.concatenate(column)[order] for column in zip(*parts, strict=True)))
    # strides where the next stop is another place or direction
    moved = np.linalg.norm(np.diff(stops.position, axis=0), axis=1) > GAP_M
    moves = moved | (np.abs(np.diff(stops.heading)) > KINK_RAD)
    stands = np.concatenate([[0], np.flatnonzero(moves) + 1])
    wander = np.interp(stops.number[stands], np.arange(len(plan.wander)), plan.wander)
    aside_m = wander - (step_width_m - STEP_WIDTH_M / 2)
    footprint, toe = place_foot(stops.position[stands], stops.heading[stands], aside_m, rng, scatter)
    start, end = stops.leaves[:-1][moves], stops.arrives[1:][moves]
    here, there = stops.style[:-1], stops.style[1:]
    style = np.where(_RANK[here] > _RANK[there], here, there)
    return Strides(start, end - start, footprint, toe, style[moves], plan.strides.end_s)


def _stop_halfway(plan: WalkPlan, person: Person, rng: np.random.Generator) -> _Stops:
    """One stop in each stride of the right foot, halfway, but where the feet are together."""
    strides, variation = plan.strides, np.array([gait.variation for gait in person.gaits])[plan.strides.style]
    vary = variation / 2 * np.clip(rng.standard_normal((2, len(strides))), -RAREST, RAREST)
    vary[0] *= np.isin(strides.style, (Style.WALK, Style.RUN))
    numbers, places, first = [], [], 0
    for leg in plan.legs:
        number = np.arange(len(leg)) + 0.5 + vary[0, first : first + len(leg)]
        number[-1:] = len(leg) if leg.halves[1] else number[-1:]
        number[:1] = 0.0 if leg.halves[0] else number[:1]
        places.append(leg.along(number))
        numbers.append(first + number)
        first += len(leg)
    leaves = strides.start + (0.5 + vary[1]) * strides.duration
    position, heading = (np.concatenate(column) for column in zip(*places, strict=True))
    return _Stops(position, heading, np.concatenate(numbers), leaves, leaves, strides.style)


def _stop_standing(plan: WalkPlan) -> _Stops:
    """Before the first stride, after the last, and in each pause that is long enough for a closing and an opening."""
    strides = plan.strides
    half, end = strides.duration / 2, strides.start + strides.duration
    closed = np.concatenate([[0.0], np.minimum(end + half, strides.end_s)])
    opened = np.append(np.maximum(strides.start - half, 0.0), strides.end_s)
    stands = closed <= opened
    stands[[0, -1]] = True
    position, heading = plan.center
    number = np.flatnonzero(stands)
    return _Stops(
        position[number], heading[number], number.astype(np.float64), closed[number], opened[number],
        np.full(len(number), Style.WALK, dtype=np.int64),
    )  # fmt: skip


@dataclass(frozen=True)
class SimulatedFeet:
    """Two recordings of one walk, and everything that is true about them."""

    left: SimulatedWalk  # Of each foot; the crossings of landmarks are the right one's.
    right: SimulatedWalk
    motions: tuple[FootMotion, FootMotion]  # Of the left and of the right foot, by true time in the course's frame.
    step_width_m: float  # How far apart the feet tread, in the mean of this person.

    @property
    def sides(self) -> Mapping[str, SimulatedWalk]:
        """Both by name."""
        return {"left": self.left, "right": self.right}

    def locate_feet(self, t: Floats) -> tuple[Floats, Floats]:
        """Places (2, N, 3) m of the left and of the right foot, and their yaw (2, N) rad, in nav.

        At rising instants `t` (N,) s of the recordings' clock.
        """
        clock_rate = 1.0 + self.right.drawn["sensor"]["clock_scale_error"]
        place, yaw = zip(*(motion.pivot_at(t / clock_rate) for motion in self.motions), strict=True)
        return np.stack(place) - self.right.origin, np.stack(yaw)

    def person_at(self, t: Floats) -> TrajectoryTruth:
        """The middle of the feet at rising instants `t` (N,) s of the recordings' clock."""
        place, yaw = self.locate_feet(t)
        level = Rotation.from_euler("Z", yaw.mean(axis=0)[:, None]).as_matrix()
        return TrajectoryTruth(t, place.mean(axis=0), level)

    @cached_property
    def person(self) -> TrajectoryTruth:
        """The middle of the feet at the samples of the right one."""
        return self.person_at(self.right.truth.t)


def simulate_feet(
    name: str | Scenario,
    seed: int,
    choices: Choices = Choices(),
    person: Person | None = None,
    progress: Progress = say_nothing,
) -> SimulatedFeet:
    """Simulate a scenario with a sensor on each foot; arguments as of `simulate`.

    Raises `SimulationError` as `simulate` does, and for a sensor that is not worn on a foot.

    Examples
    --------
    >>> feet = fg_nav.lab.simulation.simulate_feet("demo", seed=1)
    >>> feet.left.recording.truth.position[0], feet.person.position[0]  # beside the right foot's sensor, and between
    """
    outing = Outing.draw(name, seed, choices, person)
    if outing.scenario.worn not in MOUNTS:
        raise SimulationError(
            f"a sensor worn at '{outing.scenario.worn}' has none opposite: wear it at {' or '.join(MOUNTS)}."
        )
    step_width_m = draw_step_width(outing.streams.lasting("step width"))
    carried = carry_sensor(outing)
    opposite = carry_on_left(outing, carried, step_width_m)
    right = record_walk(outing, carried, progress=lambda done: progress(done / 2))
    left = record_walk(outing, opposite, right.origin, lambda done: progress(0.5 + done / 2))
    assert isinstance(opposite.motion, FootMotion)
    assert isinstance(carried.motion, FootMotion)
    return SimulatedFeet(left, right, (opposite.motion, carried.motion), step_width_m)


def carry_on_left(outing: Outing, right: Carried, step_width_m: float) -> Carried:
    """A sensor on the left foot of a person who carries one on the right one."""
    chosen, streams = outing.scenario, replace(outing.streams, of="left/")
    strides = plan_left_foot(outing.plan, outing.person, step_width_m, streams.of_this_walk("strides"))
    motion = build_foot(chosen, strides, outing.person.mirror(), MOUNTS[chosen.worn].mirror(), streams)
    sensor = replace(chosen.prior.draw(streams.lasting("sensor")), clock_scale_error=right.sensor.clock_scale_error)
    return Carried(sensor, strides, motion, motion.flat, streams, ())
