"""Make results: each method on each walk, simulated or real, under what was known of the iron on the shoe.

A walk is simulated once for all that is asked of it in one place. All methods share its recording, stances and field,
and the heading at the start: on a simulated walk the true one, on a real one nobody knows it. What a method cannot
solve is a result too, with the reason.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from fg_nav.arrays import Floats
from fg_nav.errors import FgNavError
from fg_nav.evaluation.consistency import whiten_errors
from fg_nav.evaluation.walked import (
    AS_STARTED,
    BEST_YAW,
    CLOSURE,
    compare_at_footfalls,
    measure_errors,
    measure_landmarks,
    measure_walk,
    path_length_m,
)
from fg_nav.lab.campaign import kept
from fg_nav.lab.campaign.kept import Key, Result
from fg_nav.lab.campaign.methods import method_of
from fg_nav.lab.campaign.own import Own
from fg_nav.lab.campaign.reading import AS_IT_IS, Reading
from fg_nav.lab.campaign.sources import Recorded, Simulated, Source
from fg_nav.magnetic.quasi_static import QUASI_STATIC
from fg_nav.recording import TrajectoryTruth
from fg_nav.session import Outcome, Session, solve


@dataclass(frozen=True)
class Job:
    """All that is missing of one walk: methods by magnetometer, and what each result is made with.

    A recorded walk has a `path`, and may have a file with its `truth` and others `beside` it that its reader looks at;
    of a simulated one the walk is the seed, and the scenario may be the user's `own`.
    """

    group: str
    field: str
    walk: str
    missing: Mapping[str, Mapping[str, Mapping[str, Any]]]
    path: Path | None = None
    truth: Path | None = None
    beside: tuple[Path, ...] = ()
    reading: Reading = AS_IT_IS
    own: Own | None = None

    @property
    def source(self) -> Source:
        """Where the walk comes from."""
        if self.path is not None:
            return Recorded(self.path, truth=self.truth, reading=self.reading)
        return Simulated(self.group, self.field, int(self.walk), self.own)

    @property
    def keys(self) -> list[Key]:
        """Of all results that it is to make."""
        walk = (self.group, self.field, self.walk)
        return [Key(*walk, magnetometer, method) for magnetometer, some in self.missing.items() for method in some]


def jobs_of(
    missing: Sequence[Key],
    settings: Mapping[Key, Mapping[str, Any]],
    recorded: Mapping[tuple[str, str], Path] = MappingProxyType({}),
) -> list[Job]:
    """Put the results of one walk together: it is simulated once for all of them.

    `recorded` are the files of the recorded walks, by group and walk.
    """
    together: dict[tuple[str, str, str], dict[str, dict[str, Mapping[str, Any]]]] = {}
    for key in missing:
        of_walk = together.setdefault((key.group, key.field, key.walk), {})
        of_walk.setdefault(key.magnetometer, {})[key.method] = settings[key]
    return [Job(*walk, methods, recorded.get((walk[0], walk[2]))) for walk, methods in together.items()]


def made(job: Job, folder: Path, code: str) -> None:
    """Make and keep all that is missing of one walk."""
    for result in results_of(job, code):
        kept.keep(folder, result)


@dataclass
class Ready:
    """A walk made ready: its source, and the session that all methods share under the magnetometer asked for last."""

    source: Source
    _magnetometer: str | None = None
    _session: Session | str = ""

    def session(self, magnetometer: str) -> Session | str:
        """Return the session, or why there is none."""
        if magnetometer != self._magnetometer:
            self._magnetometer, self._session = None, ""  # not to hold two
            self._session = _session_or_reason(self.source, magnetometer)
            self._magnetometer = magnetometer
        return self._session

    @property
    def refused(self) -> bool:
        """Whether there was no session."""
        return isinstance(self._session, str)


def results_of(job: Job, code: str, ready: Ready | None = None) -> Iterator[Result]:
    """Make all that is missing of one walk, one after the other; of what is `ready` of it, if anything is."""
    ready = ready or Ready(job.source)
    for magnetometer, methods in job.missing.items():
        session = ready.session(magnetometer)
        for method, settings in methods.items():
            blank = Result(Key(job.group, job.field, job.walk, magnetometer, method), settings, code)
            yield result_of(blank, ready.source, session)


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
    """Run a method by its word (`fg_nav.lab.campaign.methods`); raises as `fg_nav.session.solve`."""
    one = method_of(method)
    return solve(replace(session, options=replace(session.options, preset=one.preset, changes=one.changes)), one.name)


def name_and_preset(method: str) -> tuple[str, str]:
    """Split `NAME:PRESET`, the preset being `tuned` where there is none.

    Raises
    ------
    EstimationError
        If there is no such method or preset.
    """
    one = method_of(method)
    return one.name, one.preset


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
        return replace(done, errors={CLOSURE: measure_walk(solution)}, estimate=own, every=False)
    errors, estimate, at_landmarks, whitened = {}, {}, {}, {}
    modes = (AS_STARTED, BEST_YAW) if isinstance(truth, TrajectoryTruth) else (BEST_YAW,)
    for mode in modes:
        laid = compare_at_footfalls(solution, truth, mode)
        errors[mode] = measure_errors(laid, path_length_m(place))
        estimate[mode] = _rounded(laid.estimate if not laid.planar else laid.alignment.apply(place))
        if mode == AS_STARTED:
            whitened = whiten_errors(laid, solution.stances)
        if source.landmark:
            crossed = measure_landmarks(solution, source.landmark, *source.passed, laid.alignment)
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
