"""Walks that methods are tried on, simulated or recorded, with what was known of the iron on the shoe.

============ ===================================================================================================
magnetometer what was known of the iron
============ ===================================================================================================
loop         what the scenario `calibration-loop` told, walked before with the same shoe and sensor (the ellipse,
             `fg_nav.calibration.ellipse_fit`), as Ma et al. did it; of a recorded walk what a given file holds
perfect      all of it: there is none; simulated walks only
walk         what the walk itself told (`fg_nav.calibration.walk`); where that refuses, nothing
raw          nothing
none         nobody looked: the methods have no magnetometer
============ ===================================================================================================

A simulated walk starts with the true heading; of a recorded one nobody knows it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TypeAlias

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.calibration.ellipse_fit import calibrate_on_loop
from fg_nav.calibration.file import Calibration
from fg_nav.calibration.walk import calibrate_on_walk
from fg_nav.detection import detect_stances
from fg_nav.errors import CalibrationError
from fg_nav.frames import heading_of
from fg_nav.io import read, read_truth
from fg_nav.lab.campaign.own import Own
from fg_nav.lab.campaign.reading import AS_IT_IS, Reading
from fg_nav.lab.simulation import Choices, Scenario, SimulatedWalk, scenario, simulate
from fg_nav.magnetic import average_footfall_field
from fg_nav.recording import Recording, TrajectoryTruth
from fg_nav.session import Options, Session, prepare

LOOP, PERFECT, WALK, RAW, NONE = "loop", "perfect", "walk", "raw", "none"
MAGNETOMETERS = (LOOP, PERFECT, WALK, RAW, NONE)

MIXTURES: Mapping[str, float] = {"between": 0.35}
"""Share of the field `indoor` in a mixture with `smooth`: with one seed the two have the same steps and the same
noise, and what the magnetometer shows is linear in the field. The mixture's own truth is not kept."""


@dataclass(frozen=True)
class Simulated:
    """The walk of one scenario, field and seed; simulated when first asked for. The scenario may be the user's own."""

    name: str
    level: str
    seed: int
    own: Own | None = None

    def session(self, magnetometer: str) -> Session:
        """What all methods see; raises `CalibrationError` where the loop does not calibrate."""
        walk = self._perfect if magnetometer == PERFECT else self._with_iron
        truth = walk.recording.truth
        assert isinstance(truth, TrajectoryTruth)
        assert truth.nav_R_body is not None
        heading_deg = float(np.rad2deg(heading_of(truth.nav_R_body[0])))
        calibration = loop_calibration(self._scenario, self.seed) if magnetometer == LOOP else None
        options = Options(use_magnetometer=magnetometer != NONE, heading_deg=heading_deg)
        session = prepare(walk.recording, options, calibration)
        return calibrated_on_itself(session) if magnetometer == WALK else session

    @property
    def landmark(self) -> tuple[str, ...]:
        """Names of the landmarks, one a crossing."""
        return tuple(passing.landmark for passing in self._any.landmarks)

    @property
    def passed(self) -> tuple[Floats, Floats]:
        """When (L,) s and where (L, 3) m they are crossed."""
        passings = self._any.landmarks
        return np.array([p.time_s for p in passings]), np.array([p.position for p in passings])

    @property
    def _scenario(self) -> Scenario:
        return scenario(self.name) if self.own is None else self.own.scenario

    @property
    def _any(self) -> SimulatedWalk:
        """Landmarks are the same with and without iron."""
        return self._perfect if "_with_iron" not in self.__dict__ else self._with_iron

    @cached_property
    def _with_iron(self) -> SimulatedWalk:
        return simulated(self._scenario, self.seed, self.level)

    @cached_property
    def _perfect(self) -> SimulatedWalk:
        return simulated(self._scenario, self.seed, self.level, calibrated=True)


def simulated(name: str | Scenario, seed: int, level: str, calibrated: bool = False) -> SimulatedWalk:
    """Simulate a walk in one of the simulator's fields, or in one of `MIXTURES`."""
    if level not in MIXTURES:
        return simulate(name, seed, Choices(field=level, calibrated=calibrated))
    smooth, indoor = (simulate(name, seed, Choices(field=one, calibrated=calibrated)) for one in ("smooth", "indoor"))
    one, other = smooth.recording.mag, indoor.recording.mag
    assert one is not None
    assert other is not None
    mixed = (1.0 - MIXTURES[level]) * one + MIXTURES[level] * other
    return replace(smooth, recording=replace(smooth.recording, mag=mixed))


def loop_calibration(name: str | Scenario, seed: int) -> Calibration:
    """What the same shoe and sensor tell on a calibration loop; raises `CalibrationError` where they do not."""
    one = scenario(name) if isinstance(name, str) else name
    loop = replace(scenario("calibration-loop"), sensor=one.sensor, worn=one.worn)
    recording = simulate(loop, seed).recording
    _, magnetometer = calibrate_on_loop(average_footfall_field(recording, detect_stances(recording)))
    return Calibration(magnetometer=magnetometer)


def calibrated_on_itself(session: Session) -> Session:
    """The session with what its walk tells of the iron; as it is where that is not enough, or there is no field."""
    if session.field is None:
        return session
    try:
        calibration = Calibration(magnetometer=calibrate_on_walk(session.field))
    except CalibrationError:
        return session
    return prepare(replace(session.recording, truth=session.truth), session.options, calibration)


@dataclass(frozen=True)
class Recorded:
    """A recorded walk, with its magnetometer; with the truth of a file, if one is named."""

    path: Path
    landmark: tuple[str, ...] = ()
    passed: tuple[Floats, Floats] = field(default_factory=lambda: (np.zeros(0), np.zeros((0, 3))))
    truth: Path | None = None
    reading: Reading = AS_IT_IS

    def session(self, magnetometer: str) -> Session:
        """What all methods see: the heading at the start is not known."""
        calibration = self.reading.calibration if magnetometer == LOOP else None
        session = prepare(self._recording, Options(use_magnetometer=magnetometer != NONE), calibration)
        return calibrated_on_itself(session) if magnetometer == WALK else session

    @cached_property
    def _recording(self) -> Recording:
        recording = read(self.path, self.reading.format)
        return recording if self.truth is None else replace(recording, truth=read_truth(self.truth))


Source: TypeAlias = Simulated | Recorded
