"""Execute methods on walks: all that is missing of a walk is one task, so that it is simulated or read once.

All methods on a walk share its recording, stances and field, and the heading at the start. A method that fails is a
result too, with the reason, and the others of the walk are made all the same.

A Dask worker runs a task by `run_task`. It may share no disk with the campaign: the files of a recorded walk come with
the task, and its results go back. What goes wrong before a method starts, such as a full disk, is a `WorkerError`.
"""

from __future__ import annotations

import threading
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from time import perf_counter
from types import MappingProxyType
from typing import Any

from fg_nav.arrays import Floats
from fg_nav.calibration.walk import WalkCalibrationParameters
from fg_nav.detection import StanceParameters
from fg_nav.errors import EstimationError, FgNavError
from fg_nav.evaluation.comparison import compare_at_footfalls
from fg_nav.lab.campaign.methods import method_of, solve_by
from fg_nav.lab.campaign.walks import LOOP, MIXTURES, NONE, RAW, WALK, Reading, Simulated, Source, UserScenario, unpack
from fg_nav.lab.consistency import whiten_errors
from fg_nav.lab.landmarks import measure_landmarks
from fg_nav.lab.simulation import Choices, scenario, simulate
from fg_nav.lab.store.code import code_sum
from fg_nav.lab.store.results import Key, Result, encode_flags, write_result
from fg_nav.lab.walked import AS_STARTED, BEST_YAW, CLOSURE, measure_errors, measure_walk, path_length_m
from fg_nav.magnetic.detectors import QUASI_STATIC
from fg_nav.pipeline import prepare_walk
from fg_nav.text import to_json
from fg_nav.truth import TrajectoryTruth
from fg_nav.walk import Options, Outcome, Walk


@dataclass(frozen=True)
class Task:
    """All that is missing of one walk: settings by magnetometer and method."""

    group: str
    field: str
    walk: str
    source: Source
    missing: Mapping[str, Mapping[str, Mapping[str, Any]]]

    @property
    def keys(self) -> list[Key]:
        """Of its results."""
        walk = (self.group, self.field, self.walk)
        return [Key(*walk, magnetometer, method) for magnetometer, some in self.missing.items() for method in some]

    def split(self) -> list[Task]:
        """Return a task for each result."""
        return [
            replace(self, missing={magnetometer: {method: settings}})
            for magnetometer, methods in self.missing.items()
            for method, settings in methods.items()
        ]


def tasks_of(
    missing: Sequence[Key],
    settings: Mapping[Key, Mapping[str, Any]],
    sources: Mapping[tuple[str, str], Source] = MappingProxyType({}),
) -> list[Task]:
    """Gather the missing results of each walk; `sources`, by group and walk, are of walks that no scenario has."""
    walks: dict[tuple[str, str, str], dict[str, dict[str, Mapping[str, Any]]]] = {}
    for key in missing:
        of_walk = walks.setdefault((key.group, key.field, key.walk), {})
        of_walk.setdefault(key.magnetometer, {})[key.method] = settings[key]
    return [
        Task(group, field, walk, sources.get((group, walk)) or Simulated(group, field, int(walk)), methods)
        for (group, field, walk), methods in walks.items()
    ]


def simulated_keys(
    scenarios: Sequence[str],
    fields: Sequence[str],
    magnetometers: Sequence[str],
    methods: Sequence[str],
    seeds: Sequence[int],
) -> list[Key]:
    """Keys of simulated walks, method by method within a case."""
    return [
        Key(name, level, str(seed), magnetometer, method)
        for name in scenarios
        for level in fields
        for magnetometer in magnetometers
        for method in methods
        for seed in seeds
    ]


def recorded_keys(
    recorded: Mapping[str, Sequence[str]],
    field: str,
    magnetometers: Sequence[str],
    methods: Sequence[str],
    calibrated: Collection[str] = (),
) -> list[Key]:
    """Keys of recorded walks, by group.

    In place of a loop or a perfect magnetometer they are calibrated on themselves, or by the file of the groups that
    are `calibrated`.
    """
    return [
        Key(group, field, walk, magnetometer, method)
        for group, walks in recorded.items()
        for magnetometer in _possible(magnetometers, LOOP if group in calibrated else WALK)
        for method in methods
        for walk in walks
    ]


def _possible(magnetometers: Sequence[str], best: str) -> list[str]:
    """Calibrations that recorded walks can have, each once."""
    return list(dict.fromkeys(one if one in (WALK, RAW, NONE) else best for one in magnetometers))


def execute_task(task: Task, code: str, bugs: bool = False) -> Iterator[Result]:
    """Make all results of a walk; with `bugs` an unexpected error too is a result that failed."""
    for magnetometer, methods in task.missing.items():
        walk: Walk | str
        try:
            walk = task.source.prepare(magnetometer)
        except Exception as error:
            walk = _reason(error, bugs)
        for method, settings in methods.items():
            blank = Result(Key(task.group, task.field, task.walk, magnetometer, method), settings, code)
            yield _execute(blank, task.source, walk, bugs)


def _execute(blank: Result, source: Source, walk: Walk | str, bugs: bool) -> Result:
    if isinstance(walk, str):
        return replace(blank, failed=walk)
    try:
        # Without the truth: positions are compared below, at the footfalls, and here it only costs time.
        outcome = solve_by(blank.key.method, replace(walk, truth=None))
        return evaluate_outcome(blank, source, walk, outcome)
    except Exception as error:
        return replace(blank, failed=_reason(error, bugs))


def _reason(error: Exception, bugs: bool) -> str:
    """Why a result failed; what is no error of ours is raised again, or a bug of that result."""
    if isinstance(error, FgNavError):
        return str(error)
    if not bugs:
        raise error
    return f"a bug ({type(error).__name__}: {error})"


def store_task(task: Task, folder: Path, code: str) -> None:
    """Make and store all results of a walk."""
    for result in execute_task(task, code):
        write_result(folder, result)


_ONE_AT_A_TIME = threading.Lock()
"""A worker with several threads makes one walk at a time all the same: each is a lot of memory."""


@dataclass(frozen=True)
class TaskResults:
    """Results of a task, the sum over the code that made them, and the time it took."""

    results: tuple[Result, ...]
    code: str
    seconds: float


class WorkerError(Exception):
    """A worker, by its address, cannot start a task; the second argument is the reason."""


def run_task(task: Task) -> TaskResults:
    """Make the results of a walk on a worker; raises `WorkerError` if its files cannot be written there."""
    with _ONE_AT_A_TIME, ExitStack() as files:
        start = perf_counter()
        try:
            source, folder = files.enter_context(unpack(task.source))
        except OSError as error:
            raise WorkerError(_address(), describe_error(error)) from None
        results = tuple(execute_task(replace(task, source=source), code_sum(), bugs=True))
        if folder:
            results = tuple(replace(one, failed=one.failed.replace(folder, "")) for one in results)
        return TaskResults(results, code_sum(), perf_counter() - start)


def _address() -> str:
    from distributed import get_worker

    return str(get_worker().address)


def describe_error(error: object) -> str:
    """Return an error's name and its first sentence: Dask's have several lines, and links."""
    first, *_ = " ".join(str(error).split()).split(". ")
    return f"{type(error).__name__}: {first}" if first else type(error).__name__


def evaluate_outcome(blank: Result, source: Source, walk: Walk, outcome: Outcome) -> Result:
    """Compute all figures of one method on one walk, in each alignment."""
    solution, truth = outcome.solution, walk.truth
    done = replace(
        blank,
        used=encode_flags([outcome.field_used and word == QUASI_STATIC for word in solution.stances.field]),
        samples=len(solution.t),
        runtime_s=solution.runtime_s,
        parameters=solution.parameters,
        notes=(*walk.notes, *solution.notes),
    )
    place = solution.stances.position
    if truth is None:
        own = {CLOSURE: _round_positions(place)}
        return replace(done, errors={CLOSURE: measure_walk(solution)}, estimate=own, every=False)
    errors, estimate, at_landmarks, whitened = {}, {}, {}, {}
    modes = (AS_STARTED, BEST_YAW) if isinstance(truth, TrajectoryTruth) else (BEST_YAW,)
    for mode in modes:
        aligned = compare_at_footfalls(solution, truth, mode)
        errors[mode] = measure_errors(aligned, path_length_m(place))
        estimate[mode] = _round_positions(aligned.estimate if not aligned.planar else aligned.alignment.apply(place))
        if mode == AS_STARTED:
            whitened = whiten_errors(aligned, solution.stances)
        if source.landmark:
            crossed = measure_landmarks(solution, source.landmark, *source.passed, aligned.alignment)
            at_landmarks[mode] = crossed.error_m.tolist()
    return replace(
        done,
        errors=errors,
        whitened=whitened,
        estimate=estimate,
        truth=_round_positions(aligned.truth),
        every=not aligned.planar,
        landmark=source.landmark,
        landmark_m=at_landmarks,
        notes=(*done.notes, *aligned.notes),
    )


def _round_positions(position: Floats) -> list[list[float]]:
    """Positions over the ground, to the centimetre."""
    return [[round(float(x), 2), round(float(y), 2)] for x, y in position[:, :2]]


PROBE = ("demo", 1)  # A short walk that shows the effective parameters of a method, before it is run on long ones.


def settings_of(
    key: Key,
    recorded: bool = False,
    files: Mapping[str, str] | None = None,
    reading: Reading | None = None,
    own: UserScenario | None = None,
) -> dict[str, Any]:
    """Return what a result is made with, as JSON has it: a stored result with other settings does not hold.

    The walk is one of a scenario, perhaps the user's `own`, or `recorded` in `files` (SHA-256 by name).
    """
    loop = reading.calibration if recorded and reading else None
    settings: dict[str, Any] = {
        "method": parameters_of(key.method),
        "stances": StanceParameters(),
        "magnetometer": {LOOP: loop, WALK: WalkCalibrationParameters()}.get(key.magnetometer),
        "walk": files if recorded else _describe_scenario(key.group, key.field, own),
    }
    if reading is not None and reading.format is not None:
        settings["format"] = reading.format
    return dict(to_json(settings))


@cache
def parameters_of(method: str) -> Any:
    """Effective parameters of a method after a short walk, or why it has none.

    Changes stand next to the parameters of the same method without them: a grid needs no walk for each point.
    """
    one = method_of(method)
    if one.changes:
        return {"changed": to_json(parameters_of(one.base)), "changes": to_json(dict(one.changes))}
    try:
        return to_json(solve_by(method, _probe()).solution.parameters)
    except EstimationError as error:
        return str(error)


@cache
def _probe() -> Walk:
    return replace(prepare_walk(Walk.of(simulate(*PROBE).recording, Options(heading_deg=0.0))), truth=None)


@cache
def _describe_scenario(name: str, level: str, own: UserScenario | None) -> dict[str, Any]:
    one = Choices(field=level).apply_to(scenario(name) if own is None else own.scenario)
    description = {
        "worn": one.worn,
        "site": one.site,
        "field": (level, MIXTURES.get(level)),
        "magnets": one.magnets,
        "sensor": one.prior,
    }
    if own is not None:
        description |= {"course": own.course, "aligned": one.aligned}
    return dict(to_json(description))
