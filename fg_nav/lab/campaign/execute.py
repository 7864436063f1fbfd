"""Make results: methods on walks. All that is missing of a walk is one task, so that it is simulated or read once.

All methods on a walk share its recording, stances and field, and the heading at the start. A method that fails is a
result too, with the reason, and the others of the walk are made all the same.

Tasks are executed on processes of this machine (`run_here`) or on Dask (`fg_nav.lab.campaign.cluster`), whose workers
may share no disk with us: there the files of a recorded walk come with the task. The results come back and are
written here.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import groupby, product
from operator import attrgetter
from pathlib import Path
from typing import Any, TypeAlias

from fg_nav.arrays import Floats
from fg_nav.calibration.walk import WalkCalibrationParameters
from fg_nav.detection import StanceParameters
from fg_nav.errors import EstimationError, FgNavError
from fg_nav.evaluation.comparison import compare_at_footfalls
from fg_nav.lab.campaign.methods import method_of, solve_by
from fg_nav.lab.campaign.walks import LOOP, NONE, RAW, WALK, Simulated, Source, unpack
from fg_nav.lab.consistency import whiten_errors
from fg_nav.lab.processes import run_tasks
from fg_nav.lab.simulation import simulate
from fg_nav.lab.store.code import code_sum
from fg_nav.lab.store.results import NOT_USED, USED, Key, Result, read_result, write_result
from fg_nav.lab.walked import (
    AS_STARTED,
    BEST_YAW,
    CLOSURE,
    measure_errors,
    measure_landmarks,
    measure_walk,
    path_length_m,
)  # fmt: skip
from fg_nav.magnetic.detectors import QUASI_STATIC
from fg_nav.pipeline import prepare_walk
from fg_nav.text import to_json
from fg_nav.truth import TrajectoryTruth
from fg_nav.walk import Options, Outcome, Walk

BUG = "a bug"  # Begins the reason of a result that no error of ours ended; such a result is made again the next time.

Settings: TypeAlias = Mapping[str, Any]

_ONE_AT_A_TIME = threading.Lock()  # A worker with several threads makes one walk at a time: each is a lot of memory.


@dataclass(frozen=True)
class Task:
    """Results of one walk that are missing: the settings of each."""

    source: Source
    settings: Mapping[Key, Settings]

    def split(self) -> list[Task]:
        """Return a task for each result."""
        return [Task(self.source, {key: of}) for key, of in self.settings.items()]


Execute: TypeAlias = Callable[[Sequence[Task]], Iterable[Sequence[Result]]]  # The results of each when they are made.


def find_simulated(key: Key) -> Source:
    """Return the walk of one of our scenarios."""
    return Simulated(key.group, key.field, int(key.walk))


def make(
    settings: Mapping[Key, Settings],
    folder: Path,
    execute: Execute,
    find_source: Callable[[Key], Source] = find_simulated,
    renew: bool = False,
    retry: bool = False,
) -> Iterator[tuple[int, int]]:
    """Make the results that a folder lacks, and write them there; yields how many there are, of how many.

    A stored result holds with the same settings: with `renew` not one that other code made, with `retry` not one that
    failed. Raises `OutputError` if one cannot be written, and what `execute` raises.
    """

    def holds(key: Key) -> bool:
        found = read_result(folder, key, settings[key])
        if found is None or found.failed.startswith(BUG):
            return False
        return not (renew and found.code != code_sum()) and not (retry and found.failed)

    missing = {key: of for key, of in settings.items() if not holds(key)}
    done = len(settings) - len(missing)
    yield done, len(settings)
    for results in execute(tasks_of(missing, find_source)):
        for result in results:
            write_result(folder, result)
        done += len(results)
        yield done, len(settings)


def tasks_of(missing: Mapping[Key, Settings], find_source: Callable[[Key], Source] = find_simulated) -> list[Task]:
    """Gather the missing results of each walk."""
    walks: dict[tuple[str, str, str], dict[Key, Settings]] = {}
    for key, of in missing.items():
        walks.setdefault((key.group, key.field, key.walk), {})[key] = of
    return [Task(find_source(next(iter(some))), some) for some in walks.values()]


def run_here(tasks: Sequence[Task], workers: int) -> Iterator[tuple[Result, ...]]:
    """Execute tasks on so many processes of this machine; in this one if that is enough."""
    for _, results in run_tasks([partial(run_task, task) for task in tasks], workers):
        yield results


def run_task(task: Task) -> tuple[Result, ...]:
    """Make the results of a walk; raises `OSError` if its files cannot be written for it."""
    with _ONE_AT_A_TIME, unpack(task.source) as (source, folder):
        results = []
        by_magnetometer = attrgetter("magnetometer")
        for magnetometer, keys in groupby(sorted(task.settings, key=by_magnetometer), by_magnetometer):
            # The input of all methods.
            walk, failed = None, ""
            try:
                walk = source.prepare(magnetometer)
            except Exception as error:
                failed = _explain(error)
            # Each method; without the truth, which only costs time there: positions are compared at the footfalls.
            for key in keys:
                result = Result(key, task.settings[key], code_sum(), failed)
                if walk is not None:
                    try:
                        outcome = solve_by(key.method, replace(walk, truth=None))
                        result = evaluate_outcome(result, source, walk, outcome)
                    except Exception as error:
                        result = replace(result, failed=_explain(error))
                results.append(replace(result, failed=result.failed.replace(folder, "")))
    return tuple(results)


def _explain(error: Exception) -> str:
    """Why a result failed."""
    return str(error) if isinstance(error, FgNavError) else f"{BUG} ({type(error).__name__}: {error})"


def evaluate_outcome(blank: Result, source: Source, walk: Walk, outcome: Outcome) -> Result:
    """Compute all figures of one method on one walk, in each alignment."""
    solution, truth = outcome.solution, walk.truth
    used = (outcome.field_used and word == QUASI_STATIC for word in solution.stances.field)
    done = replace(
        blank,
        used="".join(USED if one else NOT_USED for one in used),
        samples=len(solution.t),
        runtime_s=solution.runtime_s,
        parameters=solution.parameters,
        notes=(*walk.notes, *solution.notes),
    )
    place = solution.stances.position
    if truth is None:
        own = {CLOSURE: _round_positions(place)}
        return replace(done, errors={CLOSURE: measure_walk(solution)}, estimate=own)
    errors, estimate, at_landmarks, whitened = {}, {}, {}, {}
    modes = (AS_STARTED, BEST_YAW) if isinstance(truth, TrajectoryTruth) else (BEST_YAW,)
    for mode in modes:
        aligned = compare_at_footfalls(solution, truth, mode)
        errors[mode] = measure_errors(aligned, path_length_m(place))
        estimate[mode] = _round_positions(aligned.estimate if not aligned.planar else aligned.alignment.apply(place))
        if mode == AS_STARTED:
            whitened = whiten_errors(aligned, solution.stances)
        if source.landmarks:
            at_landmarks[mode] = measure_landmarks(solution, source.landmarks, aligned.alignment).tolist()
    return replace(
        done,
        errors=errors,
        whitened=whitened,
        estimate=estimate,
        truth=_round_positions(aligned.truth),
        landmark=tuple(one.landmark for one in source.landmarks),
        landmark_m=at_landmarks,
        notes=(*done.notes, *aligned.notes),
    )


def _round_positions(position: Floats) -> list[list[float]]:
    """Positions over the ground, to the centimetre."""
    return [[round(float(x), 2), round(float(y), 2)] for x, y in position[:, :2]]


# --- what is asked for, and with what --------------------------------------------------------------------------------


def simulated_keys(
    scenarios: Sequence[str],
    fields: Sequence[str],
    magnetometers: Sequence[str],
    methods: Sequence[str],
    seeds: Sequence[int],
) -> list[Key]:
    """Keys of simulated walks, method by method within a case."""
    cases = product(scenarios, fields, magnetometers, methods, seeds)
    return [Key(name, level, str(seed), magnetometer, method) for name, level, magnetometer, method, seed in cases]


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
    keys = []
    for group, walks in recorded.items():
        best = LOOP if group in calibrated else WALK
        possible = [one if one in (WALK, RAW, NONE) else best for one in magnetometers]
        keys += [Key(group, field, walk, *case) for *case, walk in product(possible, methods, walks)]
    return list(dict.fromkeys(keys))


def settings_of(key: Key, source: Source | None = None) -> dict[str, Any]:
    """Return what a result is made with, as JSON has it: a stored result with other settings does not hold.

    The walk is that of one of our scenarios if left out.
    """
    source = find_simulated(key) if source is None else source
    magnetometer = {LOOP: source.reading.calibration, WALK: WalkCalibrationParameters()}.get(key.magnetometer)
    settings: dict[str, Any] = {"method": parameters_of(key.method), "stances": StanceParameters()}
    settings |= {"magnetometer": magnetometer, "walk": source.description}
    if source.reading.format is not None:
        settings["format"] = source.reading.format
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
def _probe() -> Walk:  # short, before the method is run on long ones
    return replace(prepare_walk(Walk.of(simulate("demo", 1).recording, Options(heading_deg=0.0))), truth=None)
