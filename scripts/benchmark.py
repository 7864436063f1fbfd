"""How long the estimators take, as ratios within one run: absolute times differ from machine to machine.

    python scripts/benchmark.py [--long] [--filters] [--real FILE] [--repeats N] [--json FILE]

The yardstick is the bare loop that hands every sample to `integrateMeasurement` of the preintegration class which
the smoother uses, and does nothing else. Each repeat runs all calls on all walks, one after the other, so that what
else the machine does falls on all alike; ratios are taken within a repeat, and the median over the repeats counts.
The bare loop is timed before and after the smoother, and its mean taken. "best/best" is the least time of all
repeats over the bare loop's least: what an idle machine would show.

================= ==============================================================================================
bare loop         `integrateMeasurement` for every sample, into one measurement
smooth            `smooth(recording, stances)`: everything from the lever to the sigmas
detect + smooth   `detect_stances(recording)` as well
IEZ               `run_iez(recording, stances)`, compiled before
doubling          cost of a walk over the cost of one half as long
filters           each filter in its default preset, on half an hour at 400 Hz; stances and field are found before, and
                  the field is a homogeneous one laid about the walk, so that the compass is taken in at every footfall;
                  each runs in one thread and is judged by the time of the processor
stages            where the time of `smooth` goes, by the modules whose functions it calls, timed from outside
================= ==============================================================================================

Ratios to the bare loop are of wall time, within seconds of each other. A walk and its half run minutes apart, under
other loads, so doubling is judged by the time of the processor (all threads), with the wall time beside it.
"""

from __future__ import annotations

import argparse
import gc
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial, wraps
from itertools import pairwise
from pathlib import Path
from time import perf_counter, process_time
from types import FunctionType
from typing import Any, TypeAlias, TypeVar
from unittest.mock import patch

import figures as fig
import gtsam
import numpy as np
from figures import Figure
from long_walk import long_walk

from fg_nav.arrays import Floats
from fg_nav.detection import detect_stances
from fg_nav.ekf import run_iez
from fg_nav.ekf.presets import TUNED, run_filter
from fg_nav.evaluation import evaluate
from fg_nav.io import read
from fg_nav.lab.simulation.fields import SITES
from fg_nav.magnetic import footfall_field
from fg_nav.magnetic.attitude import inertial_attitude
from fg_nav.recording import Recording
from fg_nav.report.terminal import progress
from fg_nav.smoother import SmootherParameters, batch, smooth

SMOOTHER_RATIO, DOUBLING_RATIO, IEZ_US = 2.5, 2.3, 2.5
"""What is asked: smoother over bare loop, cost over that of half the walk, microseconds a sample."""

FILTER_US, FILTER_S = 4.0, 4.0
"""What is asked of a filter: microseconds a sample, and seconds for half an hour at 400 Hz."""

FILTERS = ("iez", "qsf", "iqsf", "ma2018", "aiez")
FILTER_MINUTES, FILTER_RATE_HZ = 30.0, 400.0

MINUTES, LONG_MINUTES = (10.0, 20.0), (7.5, 15.0, 30.0, 60.0, 120.0)
SEED = 1

T = TypeVar("T")


@dataclass(frozen=True)
class Time:
    """Seconds on the wall and of the processor."""

    wall: float
    cpu: float

    def __add__(self, other: Time) -> Time:
        return Time(self.wall + other.wall, self.cpu + other.cpu)


BARE, SMOOTH, BOTH, IEZ, DETECT = "bare loop", "smooth", "detect + smooth", "IEZ", "detection"

Repeat: TypeAlias = Mapping[str, Mapping[str, Time]]
"""Walk -> call -> time, of one repeat."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print, and write what was asked for."""
    chosen = _parse(arguments)
    some = recordings(chosen.long, chosen.real)
    warm_up()
    repeats = measure(some, chosen.repeats)
    figures = print_costs(some, repeats)
    stages = print_stages(some, chosen.repeats)
    print_found(some)
    if chosen.filters:
        figures += print_filters(long_walk(FILTER_MINUTES, SEED, FILTER_RATE_HZ), chosen.repeats)
    fig.print_verdict(figures)
    if chosen.json:
        times = [{walk: {call: vars(t) for call, t in of.items()} for walk, of in r.items()} for r in repeats]
        content = {"figures": [f.as_dict() for f in figures], "seconds": times, "stages_us_a_sample": stages}
        fig.write_json(chosen.json, content)


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Time the estimators against the bare preintegration loop.")
    parser.add_argument("--long", action="store_true", help="walks of 7.5 minutes to 2 hours, doubling each time")
    parser.add_argument("--filters", action="store_true", help="each filter on half an hour at 400 Hz as well")
    parser.add_argument("--real", type=Path, metavar="FILE", help="a recording in place of the simulated walks")
    parser.add_argument("--repeats", type=_count, default=5, metavar="N", help="how often all is run (5)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures to this file")
    return parser.parse_args(arguments)


def _count(words: str) -> int:
    if not (words.isdecimal() and int(words) > 0):
        raise argparse.ArgumentTypeError(f"'{words}' is no number of repeats: give 1 or more")
    return int(words)


def recordings(long: bool = False, real: Path | None = None) -> dict[str, Recording]:
    """Return walks by name, shortest first: the real one, or simulated ones each twice as long as the one before."""
    if real is not None:
        return {real.name: read(real)}
    minutes = LONG_MINUTES if long else MINUTES
    whole = long_walk(minutes[-1], SEED)
    share = [round(len(whole) * part / minutes[-1]) for part in minutes]
    return {f"{part:g} min": whole.slice(0, stop) for part, stop in zip(minutes, share, strict=True)}


def warm_up() -> None:
    """Compile and load everything once."""
    recording = long_walk(0.5, SEED)
    stances = detect_stances(recording)
    bare_loop(recording)
    smooth(recording, stances)
    run_iez(recording, stances)


def bare_loop(recording: Recording) -> None:
    """Hand every sample to the preintegration, over its own period."""
    p, identity = SmootherParameters(), np.eye(3)
    params = gtsam.PreintegrationParams.MakeSharedU(p.gravity)
    params.setIntegrationCovariance(identity * p.position_density**2)
    params.setAccelerometerCovariance(identity * p.acc_density**2)
    params.setGyroscopeCovariance(identity * np.radians(p.gyr_density_deg_s) ** 2)
    integrate = gtsam.PreintegratedImuMeasurementsG(params).integrateMeasurement
    period = np.diff(recording.t).tolist()
    for acc, gyr, h in zip(recording.acc[:-1], recording.gyr[:-1], period, strict=True):
        integrate(acc, gyr, h)


def measure(some: Mapping[str, Recording], repeats: int) -> list[Repeat]:
    """Time all calls on all walks, as often as told."""
    measured: list[Repeat] = []
    with progress("benchmark") as tell:
        for k in range(repeats):
            tell(k / repeats)
            measured.append({name: times(recording) for name, recording in some.items()})
    return measured


def times(recording: Recording) -> dict[str, Time]:
    """Time every call once, on one walk, and the bare loop before and after."""
    before, _ = timed(lambda: bare_loop(recording))
    detection, stances = timed(lambda: detect_stances(recording))
    smoothing, _ = timed(lambda: smooth(recording, stances))
    after, _ = timed(lambda: bare_loop(recording))
    filtering, _ = timed(lambda: run_iez(recording, stances))
    bare = Time((before.wall + after.wall) / 2, (before.cpu + after.cpu) / 2)
    return {BARE: bare, DETECT: detection, SMOOTH: smoothing, BOTH: detection + smoothing, IEZ: filtering}


def timed(call: Callable[[], T]) -> tuple[Time, T]:
    """Seconds a call takes, and its result."""
    gc.collect()
    wall, cpu = perf_counter(), process_time()
    result = call()
    return Time(perf_counter() - wall, process_time() - cpu), result


def print_costs(some: Mapping[str, Recording], repeats: Sequence[Repeat]) -> list[Figure]:
    """Print microseconds a sample, ratios and figures."""
    names = list(some)
    headers = ("call", "us a sample", "processor", "over bare loop", "least", "greatest", "processor's", "best/best")
    for name, recording in some.items():
        fig.print_heading(f"{name}: {len(recording)} samples, medians over {len(repeats)} repeats")
        rows = [_cost_row(call, name, len(recording), repeats) for call in (BARE, DETECT, SMOOTH, BOTH, IEZ)]
        fig.print_table(headers, rows)
    figures = [figure for name in names for figure in _figures(name, len(some[name]), repeats)]
    figures += [figure for half, name in pairwise(names) for figure in _doublings(half, name, repeats)]
    fig.print_heading("Figures (medians over the repeats)")
    fig.print_figures(figures)
    return figures


def _cost_row(call: str, name: str, samples: int, repeats: Sequence[Repeat]) -> list[str]:
    wall, cpu = seconds(repeats, name, call)
    bare_wall, bare_cpu = seconds(repeats, name, BARE)
    over = wall / bare_wall
    shown = [1e6 * np.median(wall) / samples, 1e6 * np.median(cpu) / samples]
    shown += [np.median(over), over.min(), over.max()]
    shown += [np.median(cpu / bare_cpu), wall.min() / bare_wall.min()]
    return [call, *(f"{value:.2f}" for value in shown)]


def seconds(repeats: Sequence[Repeat], walk: str, call: str) -> tuple[Floats, Floats]:
    """Wall and processor time (R,) of a call on a walk in each repeat."""
    spent = [repeat[walk][call] for repeat in repeats]
    return np.array([time.wall for time in spent]), np.array([time.cpu for time in spent])


def _figures(name: str, samples: int, repeats: Sequence[Repeat]) -> list[Figure]:
    bare, smoothing, both, filtering = (seconds(repeats, name, c)[0] for c in (BARE, SMOOTH, BOTH, IEZ))
    words = f"over bare loop, {name}"
    return [
        Figure(name, f"smooth {words}", "smoother", float(np.median(smoothing / bare)), high=SMOOTHER_RATIO),
        Figure(name, f"detect + smooth {words}", "smoother", float(np.median(both / bare))),
        Figure(name, f"us a sample, {name}", "iez", 1e6 * float(np.median(filtering)) / samples, high=IEZ_US),
    ]


def _doublings(half: str, name: str, repeats: Sequence[Repeat]) -> list[Figure]:
    words = f"smooth, {name} over {half}"
    wall, cpu = (
        float(np.median(whole / part))
        for whole, part in zip(seconds(repeats, name, SMOOTH), seconds(repeats, half, SMOOTH), strict=True)
    )
    return [
        Figure(name, f"{words}, processor", "smoother", cpu, high=DOUBLING_RATIO),
        Figure(name, f"{words}, wall", "smoother", wall),
    ]


def print_filters(recording: Recording, repeats: int) -> list[Figure]:
    """Print what each filter costs, and figures."""
    stances = detect_stances(recording)
    attitude = inertial_attitude(recording, stances)
    mag = np.einsum("nji,j->ni", attitude, SITES["munich"].vector)
    known = footfall_field(replace(recording, mag=mag), stances, nav_R_body=attitude)
    figures = []
    for method in FILTERS:
        run = partial(run_filter, method, TUNED, recording, stances, known, 0.0)
        run()  # compiled
        taken = [timed(run)[0] for _ in range(repeats)]
        wall, cpu = (float(np.median([getattr(time, of) for time in taken])) for of in ("wall", "cpu"))
        a_sample, half_an_hour = 1e6 / len(recording), 60 * FILTER_MINUTES * FILTER_RATE_HZ / len(recording)
        figures += [
            Figure("filters", "us a sample, processor", method, cpu * a_sample, high=FILTER_US),
            Figure("filters", "half an hour at 400 Hz, processor (s)", method, cpu * half_an_hour, high=FILTER_S),
            Figure("filters", "the same, wall (s)", method, wall * half_an_hour),
        ]
    fig.print_heading(f"Filters: {len(recording)} samples, medians over {repeats} repeats")
    fig.print_figures(figures)
    return figures


REST = "batch"
"""What is in no other stage: the module that calls them all."""


@dataclass
class StageClock:
    """Time spent in each stage, without that spent in a stage called from within it."""

    seconds: dict[str, float] = field(default_factory=lambda: {REST: 0.0})
    _open: list[str] = field(default_factory=lambda: [REST])
    _since: float = field(default_factory=lambda: perf_counter())

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Charge the block to a stage."""
        self._charge()
        self._open.append(name)
        try:
            yield
        finally:
            self._charge()
            self._open.pop()

    def _charge(self) -> None:
        now = perf_counter()
        stage = self._open[-1]
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self._since
        self._since = now

    def watch(self, stage: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Wrap a function so that its time is charged; an iterator it returns is charged at each step."""

        @wraps(function)
        def watched(*args: Any, **kwargs: Any) -> Any:
            with self.stage(stage):
                result = function(*args, **kwargs)
            return self._steps(stage, result) if isinstance(result, Iterator) else result

        return watched

    def _steps(self, stage: str, iterator: Iterator[T]) -> Iterator[T]:
        while True:
            with self.stage(stage):
                try:
                    item = next(iterator)
                except StopIteration:
                    return
            yield item


def stage_functions() -> Iterator[tuple[object, str, str]]:
    """Where each function that the smoother calls can be replaced: owner, name, and stage, the module it is from."""
    for name, thing in vars(batch).items():
        module = getattr(thing, "__module__", None) or ""
        if not module.startswith("fg_nav.") or module == batch.__name__:
            continue
        stage = module.rpartition(".")[2]
        if isinstance(thing, FunctionType):
            yield batch, name, stage
        elif isinstance(thing, type) and module.startswith("fg_nav.smoother."):
            methods = (n for n, m in vars(thing).items() if isinstance(m, FunctionType) and n[0] != "_")
            yield from ((thing, method, stage) for method in methods)


def stage_seconds(recording: Recording) -> dict[str, float]:
    """Seconds that each stage of `smooth` takes on this walk."""
    stances = detect_stances(recording)
    gc.collect()
    clock = StageClock()
    with ExitStack() as patches:
        for owner, name, stage in list(stage_functions()):
            watched = clock.watch(stage, getattr(owner, name))
            patches.enter_context(patch.object(owner, name, watched))
        with clock.stage(REST):
            smooth(recording, stances)
    return clock.seconds


def print_stages(some: Mapping[str, Recording], repeats: int) -> dict[str, dict[str, float]]:
    """Print where the time of `smooth` goes: microseconds a sample of each stage (median), walk by walk."""
    runs = [{name: stage_seconds(recording) for name, recording in some.items()} for _ in range(repeats)]
    stages = dict.fromkeys(stage for name in some for stage in runs[0][name])
    cost = {
        stage: {n: 1e6 * float(np.median([run[n].get(stage, 0.0) for run in runs])) / len(some[n]) for n in some}
        for stage in stages
    }
    longest = list(some)[-1]
    total = sum(of[longest] for of in cost.values())
    ranked = sorted(cost.items(), key=lambda item: -item[1][longest])
    rows = [[s, *(f"{us:.3f}" for us in of.values()), f"{100 * of[longest] / total:.1f}"] for s, of in ranked]
    fig.print_heading("Stages of smooth, us a sample")
    fig.print_table(("module", *some, f"share at {longest} (%)"), rows)
    return cost


def print_found(some: Mapping[str, Recording]) -> None:
    """Print what `smooth` found, so that it is known to have done its work."""
    rows = []
    for name, recording in some.items():
        solution = smooth(recording, detect_stances(recording))
        metrics = evaluate(solution, recording.truth)
        rmse = "-" if metrics.rmse_2d_m is None else f"{metrics.rmse_2d_m:.3f}"
        rows.append([name, f"{metrics.strides_detected}", f"{metrics.distance_m:.0f}", rmse, solution.notes[-1]])
    fig.print_heading("What smooth found")
    fig.print_table(("walk", "strides", "distance (m)", "rmse 2-D (m)", ""), rows)


if __name__ == "__main__":
    fig.leave_with(main)
