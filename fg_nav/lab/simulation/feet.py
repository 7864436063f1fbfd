"""Both feet of one person, each with a sensor: the walk of `simulate`, and the left foot beside it.

The right foot and its recording are those of `simulate` with the same seed, to the last bit. The left one alternates
with it (`left_foot`) on the same floor, in the same field. It has a sensor and a mounting of its own, from the same
priors; gait and shoe are the right one's in the mirror. Both sensors share a clock, but not the jitter of its stamps
nor the lost samples. Both truths are in one frame, whose origin is where the right sensor first is.

The person's truth is the middle of the feet, of the pivots under both insteps, with the mean of their headings:

    p(t) = (p_left(t) + p_right(t)) / 2,    nav_R_person(t) = Rz((yaw_left(t) + yaw_right(t)) / 2).

>>> feet = simulate_feet("office", seed=1)
>>> feet.left.recording, feet.right.recording, feet.person
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Floats
from fg_nav.errors import SimulationError
from fg_nav.lab.simulation.foot import FootMotion
from fg_nav.lab.simulation.left_foot import draw_step_width, plan_left_foot
from fg_nav.lab.simulation.mount import MOUNTS
from fg_nav.lab.simulation.person import Person
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


@dataclass(frozen=True)
class SimulatedFeet:
    """Two recordings of one walk, and everything that is true about them.

    Attributes
    ----------
    left, right : of each foot; the crossings of landmarks are the right one's.
    motions : of the left and of the right foot, by true time in the course's frame.
    step_width_m : how far apart the feet tread, in the mean of this person.
    """

    left: SimulatedWalk
    right: SimulatedWalk
    motions: tuple[FootMotion, FootMotion]
    step_width_m: float

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
        truth = self.right.recording.truth
        assert isinstance(truth, TrajectoryTruth)
        return self.person_at(truth.t)


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
    sensor = replace(chosen.prior.draw(streams.lasting("sensor")), clock=right.sensor.clock)
    return Carried(sensor, strides, motion, motion.flat, streams, ())
