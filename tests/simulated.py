"""Simulated walks for tests: whose foot, what sensor on it, and all that is true about it.

`PERSON` is the library's default person, whose foot is hit and slips. Tests of what an estimator can know
take the `QUIET` one, whose foot rolls about its pivot on a soft sole and does nothing else. `RIGID` has a hard sole.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Floats
from fg_nav.lab.simulation import routes
from fg_nav.lab.simulation.foot import FootMotion, build_foot_motion
from fg_nav.lab.simulation.motion import Ramps, Strides, Style
from fg_nav.lab.simulation.path import straight
from fg_nav.lab.simulation.person import INSTEP, Gait, Mount, Person
from fg_nav.lab.simulation.plan import Section, Stand, Walk, plan
from fg_nav.lab.simulation.sensors import SensorPrior, preset
from fg_nav.recording import Recording
from fg_nav.truth import TrajectoryTruth


def every_gait(person: Person, **changes: object) -> Person:
    """The person with these changes to all of its gaits."""
    gaits = {f.name: gait for f in fields(person) if isinstance(gait := getattr(person, f.name), Gait)}
    return replace(person, **{name: replace(gait, **changes) for name, gait in gaits.items()})


PERSON = Person()
QUIET = every_gait(PERSON, slip_m=0.0, slip_sd_m=0.0, shock_m_s2=0.0, shock_rad_s=0.0)
RIGID = every_gait(QUIET, sole_m=0.0)

FIRM = replace(INSTEP, lever_sd_m=(0.0, 0.0, 0.0), tilt_sd_rad=(0.0, 0.0, 0.0))
"""On the instep as the library has it, the same in all walks."""

LEVER = tuple(float(x) for x in FIRM.foot_R_body.T @ FIRM.lever_m)
"""From the pivot to a `FIRM` sensor, in the sensor's axes."""

WALKERS = pytest.mark.parametrize(("person", "mount"), [(QUIET, FIRM), (PERSON, INSTEP)], ids=["quiet", "real"])
"""One whose foot rolls and does nothing else, and one whose foot is hit and slips."""

INDUSTRIAL = replace(preset("demo"), mag=None)  # White noise and constant biases.

IDEAL = replace(preset("ideal"), mag=None)


@dataclass(frozen=True)
class SimulatedFoot:
    """A recording, how the foot moved, and its true gyro bias (3,) rad/s."""

    recording: Recording
    strides: Strides
    motion: FootMotion
    gyro_bias: Floats

    @property
    def speed(self) -> Floats:
        """True speed (N,) m/s of the sensor at each sample."""
        return np.linalg.norm(self.motion.at(self.recording.t).velocity, axis=1)

    @cached_property
    def swing(self) -> Floats:
        """Between which times (K, 2) s the foot swings, those swings that lie in the recording as a whole."""
        swing = np.stack([self.motion.flat[:-1, 1], self.motion.flat[1:, 0]], axis=1)
        t = self.recording.t
        return swing[(swing[:, 0] >= t[0]) & (swing[:, 1] <= t[-1])]

    def part(self, start: int, stop: int) -> SimulatedFoot:
        """The samples `start <= i < stop`."""
        return replace(self, recording=self.recording.slice(start, stop))


def simulated(
    sections: Sequence[Section],
    person: Person = QUIET,
    mount: Mount = FIRM,
    sensor: SensorPrior = INDUSTRIAL,
    seed: int = 0,
) -> SimulatedFoot:
    """What a sensor on the foot of this person records, and the truth about it."""
    rng = np.random.default_rng(seed)
    strides = plan(sections, person, rng)
    motion = build_foot_motion(strides, person, mount, rng)
    t = np.arange(int(strides.end_s * sensor.rate_hz)) / sensor.rate_hz
    run = sensor.draw(rng).switch_on(rng)
    samples = run.measure(t, *motion.sampled(t, sensor.period_s))
    state = motion.at(t)
    truth = TrajectoryTruth(t, state.position, state.nav_R_body)
    recording = Recording(samples.t, samples.acc, samples.gyr, truth=truth)
    return SimulatedFoot(recording, strides, motion, run.biases_at(t[:1]).gyr[0])


def corridor(
    person: Person = QUIET,
    mount: Mount = FIRM,
    sensor: SensorPrior = INDUSTRIAL,
    seed: int = 0,
    rate_hz: float = 200.0,
) -> SimulatedFoot:
    """A minute round the corridor of the demonstration."""
    return simulated(routes.demo(), person, mount, sensor.at_rate(rate_hz), seed)


def straight_walk(
    person: Person = QUIET,
    style: Style = Style.WALK,
    strides: int = 12,
    standing_s: float = 2.0,
    rate_hz: float = 200.0,
    noise: float = 1.0,
    seed: int = 0,
    mount: Mount = FIRM,
    pace: float = 1.0,
) -> SimulatedFoot:
    """Straight ahead, standing before and after; `noise` scales that of a sensor without bias."""
    length_m = person.gait(style).stride_m * np.sqrt(pace) * (strides - 1)  # a step out of standing and one into it
    rest = [Stand(standing_s)] if standing_s else []
    course = [*rest, Walk(straight(length_m), style, strides, pace), *rest]
    return simulated(course, person, mount, loud(noise).at_rate(rate_hz), seed)


def loud(noise: float) -> SensorPrior:
    """A sensor without bias and with so many times the noise of an industrial one."""
    gyr, acc = (
        replace(triad, bias_sd=0.0, noise_density=noise * triad.noise_density)
        for triad in (INDUSTRIAL.gyr, INDUSTRIAL.acc)
    )
    return replace(INDUSTRIAL, gyr=gyr, acc=acc)


def mounted(recording: Recording, body_R_sensor: Rotation) -> Recording:
    """What the same sensor reads when it is mounted turned."""
    acc, gyr = (body_R_sensor.inv().apply(samples) for samples in (recording.acc, recording.gyr))
    return Recording(t=recording.t, acc=acc, gyr=gyr)


def turning_foot(lever_m: Sequence[float] | Floats, turns: Sequence[Ramps], up: Ramps | None = None) -> FootMotion:
    """A foot that turns by these ramps of roll, pitch and yaw about a pivot that only rises and sinks."""
    nothing = np.zeros(0)
    still = Ramps(nothing, nothing, nothing)
    up = still if up is None else up
    return FootMotion(still, still, up, *turns, np.array(lever_m), np.eye(3), np.zeros((0, 2)))
