"""From a scenario and a seed to a recording with all its truth: the simulator, put together.

    route -> strides -> motion of foot or thigh -> rate, force
                     -> field of the surroundings -> body field  -> sensor -> recording

Strides and field are drawn first (`Outing`); any sensor carried along (`Carried`) records them (`record_walk`).

One seed has many independent streams of random numbers, each named by its purpose (`Streams`). The same seed is the
same sensor on the same person in every scenario: what a calibration loop finds holds in the office of that seed. The
walk, the field, the biases at switch-on and the noise are new in every scenario.

The motion is known at any instant; the sensor samples it in blocks, so that memory grows with the recording alone.
The truth is on the recording's clock, scale error and all, but not late by the delays that jitter its stamps. The
origin of the recording's truth is where the sensor first is; the field was drawn about the route before that, and
`origin` is the position of the one in the other. A sensor on a table has a constant pose, the truth of an Allan
deviation.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Brief, Floats, Ints
from fg_nav.errors import SimulationError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.lab.simulation.fields import Field, Homogeneous, find_earth_field
from fg_nav.lab.simulation.foot import FootMotion, build_foot_motion
from fg_nav.lab.simulation.motion import Kinematics, Motion, Strides
from fg_nav.lab.simulation.path import Pose
from fg_nav.lab.simulation.person import MOUNTS, Mount, Person
from fg_nav.lab.simulation.plan import Crossing, Stand, WalkPlan, plan_walk
from fg_nav.lab.simulation.routes import remove_rests
from fg_nav.lab.simulation.scenarios import Choices, Scenario, draw_surroundings, scenario
from fg_nav.lab.simulation.sensors import BiasTruth, Sensor, SensorRun
from fg_nav.lab.simulation.thigh import Pocket, build_thigh_motion
from fg_nav.recording import MIN_SAMPLES, Provenance, Recording
from fg_nav.truth import TrajectoryTruth

MAX_SEED = 2**63 - 1


@dataclass(frozen=True)
class Streams:
    """The generators of one seed and one scenario; `of` sets those of a second sensor apart."""

    seed: int
    scenario: str
    of: str = ""

    def __post_init__(self) -> None:
        if not 0 <= self.seed <= MAX_SEED:
            raise SimulationError(f"{self.seed} is no seed: give a whole number from 0 to 2^63 - 1.")

    def lasting(self, purpose: str) -> np.random.Generator:
        """For what stays the same from scenario to scenario."""
        return self._generator(purpose)

    def of_this_walk(self, purpose: str) -> np.random.Generator:
        """For what is new in every scenario."""
        return self._generator(f"{self.scenario}/{purpose}")

    def _generator(self, name: str) -> np.random.Generator:
        return np.random.default_rng([self.seed, zlib.crc32(f"{self.of}{name}".encode())])


BLOCK = 50_000  # Samples worked on at a time.

MAX_SAMPLES = 20_000_000
"""Three of Munoz Diaz' walks in a row at 2 kHz; 5 GB, for at its peak a sample takes 260 bytes."""

Progress: TypeAlias = Callable[[float], None]


@dataclass(frozen=True)
class Passing:
    """A landmark that is passed: at `time_s`, the foot being flat, the sensor is at `position` (3,) m."""

    landmark: str
    time_s: float
    position: Floats


@dataclass(frozen=True)
class SimulatedWalk(Brief):
    """A recording, and everything that is true about it.

    All times are on the recording's clock.
    """

    scenario: Scenario  # What was asked for, and as it was in effect.
    choices: Choices
    seed: int
    recording: Recording  # With `TrajectoryTruth`.
    biases: BiasTruth  # Once a second.
    strides: Strides  # Of the foot; for a pocket, of the foot below; none on a table.
    flat: Floats | None  # (K + 1, 2) s, from when to when the foot stands flat; None for a pocket and a table.
    landmarks: tuple[Passing, ...]  # In the order in which they are passed.
    field: Field  # Of the surroundings and without them, by places in the course's frame.
    earth: Homogeneous
    origin: Floats  # (3,) m, the origin of the recording's truth in the course's frame.
    drawn: dict[str, Any]  # The sensor as drawn and as switched on, for JSON.
    person: Person  # Who walked.

    @property
    def truth(self) -> TrajectoryTruth:
        """The recording's."""
        assert isinstance(self.recording.truth, TrajectoryTruth)
        return self.recording.truth

    @property
    def attitude(self) -> Floats:
        """True nav_R_body (N, 3, 3)."""
        assert self.truth.nav_R_body is not None
        return self.truth.nav_R_body

    @property
    def mag(self) -> Floats:
        """The recording's field (N, 3) uT in the body frame, of a sensor with a magnetometer."""
        assert self.recording.mag is not None
        return self.recording.mag

    def nav_field(self, sample: Ints) -> Floats:
        """True field (F, 3) uT in nav where the sensor is at these samples (F,) of the recording."""
        return self.field.at(self.truth.position[sample] + self.origin)


def say_nothing(_: float) -> None:
    """Report no progress."""


def simulate(
    name: str | Scenario,
    seed: int,
    choices: Choices = Choices(),
    person: Person | None = None,
    progress: Progress = say_nothing,
) -> SimulatedWalk:
    """Simulate a scenario, by name or one of your own, with what of it is to be otherwise.

    The seed draws everything; sensor, mount and leg are the same in all scenarios of a seed. `person` is who walks,
    drawn by the seed if left out; `progress` is called with the fraction done.

    Raises `SimulationError` for names that do not exist and walks, sensors or fields that cannot be.

    Examples
    --------
    >>> walk = fg_nav.simulate("demo", seed=1)
    >>> round(walk.recording.duration_s), walk.recording.truth.position.shape == walk.recording.acc.shape
    (63, True)
    """
    outing = Outing.draw(name, seed, choices, person)
    return record_walk(outing, carry_sensor(outing), progress=progress)


@dataclass(frozen=True)
class Outing:
    """A walk before any sensor records it: who goes where in which field.

    `choices` and `scenario` as in `SimulatedWalk`; `streams` of its random numbers.
    """

    scenario: Scenario
    choices: Choices
    streams: Streams
    person: Person
    plan: WalkPlan
    earth: Homogeneous
    field: Field

    @classmethod
    def draw(cls, name: str | Scenario, seed: int, choices: Choices, person: Person | None) -> Outing:
        """Draw person, strides and field; arguments and errors of `simulate`."""
        chosen = choices.apply_to(scenario(name) if isinstance(name, str) else name)
        streams = Streams(seed, chosen.name)
        person = Person().draw(streams.lasting("person")) if person is None else person
        person = person.with_moving_feet(streams.lasting("feet")) if chosen.feet == "moving" else person
        earth = find_earth_field(chosen.site)
        plan = _plan_strides(chosen, person, streams)
        # not too long, nor too short
        end_s, rate_hz = plan.strides.end_s, chosen.prior.rate_hz
        size = f"{end_s / 60:.1f} minutes at {rate_hz:g} Hz are {end_s * rate_hz:.2g} samples"
        if not end_s * rate_hz <= MAX_SAMPLES:
            raise SimulationError(f"{size}: make the walk shorter or the rate lower, for at most {MAX_SAMPLES}.")
        if int(end_s * rate_hz) < MIN_SAMPLES:
            raise SimulationError(f"{size}: make the walk longer or the rate higher, for at least {MIN_SAMPLES}.")
        field = draw_surroundings(chosen, earth, plan.strides.footprint, streams.of_this_walk("field"))
        return cls(chosen, choices, streams, person, plan, earth, field)


@dataclass(frozen=True)
class Carried:
    """A sensor on a walk."""

    sensor: Sensor  # As drawn.
    strides: Strides  # Of the foot that it is on, or below the pocket.
    motion: Motion  # Of the sensor.
    flat: Floats | None  # (K + 1, 2) s, from when to when the foot stands flat; None where it is on none.
    streams: Streams  # Of what is new on this walk.
    crossings: tuple[Crossing, ...]  # Of landmarks by that foot.


def carry_sensor(outing: Outing) -> Carried:
    """The scenario's sensor where it is worn: on a table, in the right pocket or on the right foot."""
    chosen, strides, streams = outing.scenario, outing.plan.strides, outing.streams
    sensor, flat = chosen.prior.draw(streams.lasting("sensor")), None
    motion: Motion
    if chosen.worn == "table":
        tilt = streams.of_this_walk("table").normal(0.0, TABLE_TILT_RAD, 3)
        motion = Lying(np.asarray(Rotation.from_rotvec(tilt).as_matrix()))
    elif chosen.worn == "pocket":
        pocket = Pocket(tilt_rad=0.0) if chosen.aligned else Pocket()
        motion = build_thigh_motion(strides, pocket, streams.of_this_walk("leg"), streams.lasting("leg"))
    else:
        motion = foot = build_foot(chosen, strides, outing.person, MOUNTS[chosen.worn], streams)
        flat = foot.flat
    return Carried(sensor, strides, motion, flat, streams, outing.plan.crossings)


def record_walk(
    outing: Outing, carried: Carried, origin: Floats | None = None, progress: Progress = say_nothing
) -> SimulatedWalk:
    """What a sensor records; the truth's `origin` (3,) m in the course's frame is where it first is, or as given."""
    run, strides = carried.sensor.switch_on(carried.streams.of_this_walk("switched on")), carried.strides
    rows = _measure_blocks(run, carried.motion, outing.field, strides.end_s, progress)
    position = rows["position"]
    origin = position[0].copy() if origin is None else origin
    position -= origin
    name, seed = outing.scenario.name, outing.streams.seed
    provenance = Provenance(format="simulated", notes=(f"simulated: {name}, seed {seed}",))
    # the truth is on the recording's clock, but without the delay of the stamps
    truth = TrajectoryTruth(rows["taken"], position, rows["nav_R_body"])
    clock_rate = 1.0 + run.sensor.clock_scale_error
    seconds = np.arange(0.0, strides.end_s)
    return SimulatedWalk(
        scenario=outing.scenario,
        choices=outing.choices,
        seed=seed,
        recording=Recording(rows["t"], rows["acc"], rows["gyr"], rows.get("mag"), truth, provenance),
        biases=replace(run.biases_at(seconds), t=seconds * clock_rate),
        strides=replace(
            strides, **{name: clock_rate * getattr(strides, name) for name in ("start", "duration", "end_s")}
        ),
        flat=None if carried.flat is None else carried.flat * clock_rate,
        landmarks=tuple(
            Passing(c.landmark, c.time_s * clock_rate, carried.motion.at(np.array([c.time_s])).position[0] - origin)
            for c in carried.crossings
        ),
        field=outing.field,
        earth=outing.earth,
        origin=origin,
        drawn={"sensor": run.sensor.as_dict(), "switched_on": run.as_dict()},
        person=outing.person,
    )


def _plan_strides(chosen: Scenario, person: Person, streams: Streams) -> WalkPlan:
    sections = chosen.route(streams.of_this_walk("course"))
    sections = remove_rests(sections) if chosen.rests == "none" else sections
    if chosen.worn == "table":
        seconds = [section.seconds for section in sections if isinstance(section, Stand)]
        if len(seconds) < len(sections):
            raise SimulationError("a sensor on a table goes nowhere: wear it, or choose a course without strides.")
        none, place = np.zeros(0), np.zeros((1, 3))
        strides = Strides(none, none, place, np.zeros(1), none.astype(np.int64), float(sum(seconds)))
        return WalkPlan(strides, (), (), Pose(place[0], 0.0), np.zeros(1))
    return plan_walk(sections, person, streams.of_this_walk("strides"))


def build_foot(chosen: Scenario, strides: Strides, person: Person, mount: Mount, streams: Streams) -> FootMotion:
    """Motion of a sensor that is mounted so on the foot of a person."""
    drawn = mount.draw(streams.lasting("mount"))
    return build_foot_motion(strides, person, drawn, streams.of_this_walk("foot"), chosen.rests != "still")


def _measure_blocks(
    run: SensorRun, motion: Motion, field: Field, end_s: float, progress: Progress
) -> dict[str, npt.NDArray[Any]]:
    """Columns of what the sensor records of a motion, block after block, with the true pose at each sample."""
    period_s = run.sensor.prior.period_s
    count = int(end_s * run.sensor.prior.rate_hz)
    columns: dict[str, list[npt.NDArray[Any]]] = {}

    def body_field(instants: Floats) -> Floats:
        state = motion.at(instants)
        return np.asarray(np.einsum("nji,nj->ni", state.nav_R_body, field.at(state.position)))

    for begin in range(0, count, BLOCK):
        t = np.arange(begin, min(begin + BLOCK, count), dtype=np.float64) * period_s
        state = motion.at(t)
        samples = run.measure(t, *motion.sampled(t, period_s), body_field)
        parts = {name: getattr(samples, name) for name in ("t", "taken", "acc", "gyr", "mag")}
        parts |= {"position": state.position[samples.row], "nav_R_body": state.nav_R_body[samples.row]}
        for name, part in parts.items():
            if part is not None:
                columns.setdefault(name, []).append(part)
        progress((begin + len(t)) / count)
    return {name: np.concatenate(columns.pop(name)) for name in tuple(columns)}


TABLE_TILT_RAD = 0.01  # About each axis, standard deviation: tables and cases are level to half a degree (assumed).


@dataclass(frozen=True)
class Lying:
    """Motion of a sensor that does not move, at the origin in the attitude `nav_R_body` (3, 3)."""

    nav_R_body: Floats

    def at(self, t: Floats) -> Kinematics:
        """Exact state at instants `t` (N,) s."""
        nothing, force = np.zeros((len(t), 3)), np.tile(GRAVITY_M_S2 * self.nav_R_body[2], (len(t), 1))
        return Kinematics(nothing, nothing.copy(), np.tile(self.nav_R_body, (len(t), 1, 1)), nothing.copy(), force)

    def sampled(self, t: Floats, period_s: float) -> tuple[Floats, Floats]:
        """Rate (N, 3) rad/s and specific force (N, 3) m/s^2, each the mean over [t, t + period]."""
        state = self.at(t)
        return state.rate, state.force
