"""Make results: each method on each walk, simulated or real, under what was known of the iron on the shoe.

A walk is simulated once for all that is asked of it. All methods share its recording, stances and field, and the
heading at the start: on a simulated walk the true one, on a real one nobody knows it. What a method cannot solve is a
result too, with the reason.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeAlias

import kept
import numpy as np
import walks
from kept import Key, Result

from fg_nav.arrays import Floats
from fg_nav.calibration.ellipse import ellipse_of_walk
from fg_nav.calibration.file import Calibration
from fg_nav.calibration.walk import calibrate_on_walk
from fg_nav.detection import detect_stances
from fg_nav.ekf.presets import TUNED, check_preset
from fg_nav.errors import CalibrationError, FgNavError
from fg_nav.estimators import estimator
from fg_nav.evaluation.landmarks import landmark_errors
from fg_nav.evaluation.pose_consistency import whitened_errors
from fg_nav.evaluation.walked import AS_STARTED, BEST_YAW, CLOSURE, at_footfalls, errors_of, walk_errors, way_m
from fg_nav.frames import heading_of
from fg_nav.io import read
from fg_nav.magnetic import footfall_field
from fg_nav.magnetic.verdicts import QUASI_STATIC
from fg_nav.recording import Recording, TrajectoryTruth
from fg_nav.session import Options, Outcome, Session, prepare, solve
from fg_nav.simulation import Choices, SimulatedWalk, scenario, simulate

LOOP, PERFECT, WALK, RAW = "loop", "perfect", "walk", "raw"
MAGNETOMETERS = (LOOP, PERFECT, WALK, RAW)

MIXTURES: Mapping[str, float] = {"between": 0.35}
"""Share of the field `indoor` in a mixture with `smooth`, as in `field_roc`: with one seed the two have the same steps
and the same noise, and what the magnetometer shows is linear in the field. The mixture's own truth is not kept."""

GDIN, OPENSHOE = "gdin", "openshoe"

REAL_WALKS: Mapping[str, tuple[str, ...]] = {
    GDIN: tuple(str(number) for number in walks.GDIN),
    OPENSHOE: tuple(name.removeprefix("openshoe ") for name in walks.LOOPS if name.startswith("openshoe")),
}


@dataclass(frozen=True)
class Job:
    """All that is missing of one walk: methods by magnetometer, and what each result is made with."""

    group: str
    field: str
    walk: str
    missing: Mapping[str, Mapping[str, Mapping[str, Any]]]


def jobs_of(missing: Sequence[Key], settings: Mapping[Key, Mapping[str, Any]]) -> list[Job]:
    """Put the results of one walk together: it is simulated once for all of them."""
    together: dict[tuple[str, str, str], dict[str, dict[str, Mapping[str, Any]]]] = {}
    for key in missing:
        of_walk = together.setdefault((key.group, key.field, key.walk), {})
        of_walk.setdefault(key.magnetometer, {})[key.method] = settings[key]
    return [Job(*walk, methods) for walk, methods in together.items()]


def made(job: Job, folder: Path, code: str, data: Path | None) -> None:
    """Make and keep all that is missing of one walk."""
    source = RealWalk(job.group, job.walk, data) if job.group in REAL_WALKS else Simulated(job)
    for magnetometer, methods in job.missing.items():
        session = _session_or_reason(source, magnetometer)
        for method, settings in methods.items():
            blank = Result(Key(job.group, job.field, job.walk, magnetometer, method), settings, code)
            kept.keep(folder, result_of(blank, source, session))


def _session_or_reason(source: Source, magnetometer: str) -> Session | str:
    try:
        return source.session(magnetometer)
    except FgNavError as error:
        return str(error)


def result_of(blank: Result, source: Source, session: Session | str) -> Result:
    """Run the method, and measure it; a failure is a result too."""
    if isinstance(session, str):
        return replace(blank, failed=session)
    try:
        # Without the truth: it is compared below, at the footfalls, and here only costs time.
        outcome = solved(replace(session, truth=None), blank.key.method)
        return measured(blank, source, session, outcome)
    except FgNavError as error:
        return replace(blank, failed=str(error))


def solved(session: Session, method: str) -> Outcome:
    """Run `NAME` or `NAME:PRESET`; raises as `fg_nav.session.solve`."""
    name, preset = name_and_preset(method)
    return solve(replace(session, options=replace(session.options, preset=preset)), name)


def name_and_preset(method: str) -> tuple[str, str]:
    """Split `NAME:PRESET`, the preset being `tuned` where there is none.

    Raises
    ------
    EstimationError
        If there is no such method or preset.
    """
    name, _, preset = method.partition(":")
    estimator(name)
    check_preset(preset or TUNED)
    return name, preset or TUNED


def measured(blank: Result, source: Source, session: Session, outcome: Outcome) -> Result:
    """All figures of one method on one walk, in each alignment."""
    solution, truth = outcome.solution, session.truth
    done = replace(
        blank,
        used=kept.marks([outcome.field_used and word == QUASI_STATIC for word in solution.stances.field]),
        samples=len(solution.t),
        runtime_s=solution.runtime_s,
        parameters=solution.parameters,
        notes=(*session.notes, *solution.notes),
    )
    place = solution.stances.position
    if truth is None:
        own = {CLOSURE: _rounded(place)}
        return replace(done, errors={CLOSURE: walk_errors(solution)}, estimate=own, every=False)
    errors, estimate, at_landmarks, whitened = {}, {}, {}, {}
    modes = (AS_STARTED, BEST_YAW) if isinstance(truth, TrajectoryTruth) else (BEST_YAW,)
    for mode in modes:
        laid = at_footfalls(solution, truth, mode)
        errors[mode] = errors_of(laid, way_m(place))
        estimate[mode] = _rounded(laid.estimate if not laid.planar else laid.alignment.apply(place))
        if mode == AS_STARTED:
            whitened = whitened_errors(laid, solution.stances)
        if source.landmark:
            crossed = landmark_errors(solution, source.landmark, *source.passed, laid.alignment)
            at_landmarks[mode] = crossed.error_m.tolist()
    return replace(
        done,
        errors=errors,
        whitened=whitened,
        estimate=estimate,
        truth=_rounded(laid.truth),
        every=not laid.planar,
        landmark=source.landmark,
        landmark_m=at_landmarks,
        notes=(*done.notes, *laid.notes),
    )


def _rounded(position: Floats) -> list[list[float]]:
    """Places over the ground to the centimetre."""
    return [[round(float(x), 2), round(float(y), 2)] for x, y in position[:, :2]]


@dataclass(frozen=True)
class Simulated:
    """The walk of one scenario, field and seed; simulated when first asked for."""

    job: Job

    def session(self, magnetometer: str) -> Session:
        """What all methods see; raises `CalibrationError` where the loop does not calibrate."""
        walk = self._perfect if magnetometer == PERFECT else self._with_iron
        truth = walk.recording.truth
        assert isinstance(truth, TrajectoryTruth)
        assert truth.nav_R_body is not None
        heading_deg = float(np.rad2deg(heading_of(truth.nav_R_body[0])))
        calibration = loop_calibration(self._name, int(self.job.walk)) if magnetometer == LOOP else None
        session = prepare(walk.recording, Options(heading_deg=heading_deg), calibration)
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
    def _name(self) -> str:
        return self.job.group

    @property
    def _any(self) -> SimulatedWalk:
        """Landmarks are the same with and without iron."""
        return self._perfect if "_with_iron" not in self.__dict__ else self._with_iron

    @cached_property
    def _with_iron(self) -> SimulatedWalk:
        return simulated(self._name, int(self.job.walk), self.job.field)

    @cached_property
    def _perfect(self) -> SimulatedWalk:
        return simulated(self._name, int(self.job.walk), self.job.field, calibrated=True)


def simulated(name: str, seed: int, level: str, calibrated: bool = False) -> SimulatedWalk:
    """Simulate a walk in one of the simulator's fields, or in one of `MIXTURES`."""
    if level not in MIXTURES:
        return simulate(name, seed, Choices(field=level, calibrated=calibrated))
    smooth, indoor = (simulate(name, seed, Choices(field=one, calibrated=calibrated)) for one in ("smooth", "indoor"))
    one, other = smooth.recording.mag, indoor.recording.mag
    assert one is not None
    assert other is not None
    mixed = (1.0 - MIXTURES[level]) * one + MIXTURES[level] * other
    return replace(smooth, recording=replace(smooth.recording, mag=mixed))


def loop_calibration(name: str, seed: int) -> Calibration:
    """What the same shoe and sensor tell on a calibration loop; raises `CalibrationError` where they do not."""
    one = scenario(name)
    loop = replace(scenario("calibration-loop"), sensor=one.sensor, worn=one.worn)
    recording = simulate(loop, seed).recording
    _, magnetometer = ellipse_of_walk(footfall_field(recording, detect_stances(recording)))
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
class RealWalk:
    """A recorded walk, with its magnetometer."""

    group: str
    walk: str
    data: Path | None
    landmark: tuple[str, ...] = ()
    passed: tuple[Floats, Floats] = field(default_factory=lambda: (np.zeros(0), np.zeros((0, 3))))

    def session(self, magnetometer: str) -> Session:
        """What all methods see: the heading at the start is not known."""
        session = prepare(self._recording, Options())
        return calibrated_on_itself(session) if magnetometer == WALK else session

    @cached_property
    def _recording(self) -> Recording:
        data = walks.data_folder(self.data)
        name = f"{self.group} {self.walk}"
        return read(data / walks.LOOPS[name] if self.group == OPENSHOE else walks.gdin_path(data, int(self.walk)))


Source: TypeAlias = Simulated | RealWalk
