"""How long the estimators and the simulator take, as ratios within one run where times differ between machines.

    python scripts/benchmark.py [--long] [--filters] [--real FILE] [--repeats N] [--json FILE]
    python scripts/benchmark.py --ratio [--repeats N]    smooth over the bare loop alone, at 10, 20 and 60 minutes
    python scripts/benchmark.py --simulator [--json FILE]
    python scripts/benchmark.py --gate [--quick]         against the baseline (`benchmark_gate.py`)
    python scripts/benchmark.py --peers PYTHON           beside other programs (`benchmark_peers.py`)

The yardstick is the bare loop that gives every sample to `integrateMeasurement` of the preintegration class which
the smoother uses, and does nothing else. Each repeat runs all calls on all walks, one after the other, so that what
else the machine does affects all alike; ratios are taken within a repeat, and the median over the repeats counts.
The bare loop is timed before and after the smoother, and its mean taken. "best/best" is the least time of all
repeats over the bare loop's least: what an idle machine would show.

================= ==============================================================================================
bare loop         `integrateMeasurement` for every sample, into one measurement
smooth            `smooth(recording, stances)`: everything from the lever to the sigmas
detect + smooth   `detect_stances(recording)` as well
IEZ               `run_iez(recording, stances)`, compiled before
doubling          cost of a walk over the cost of one half as long, by the time of the processor
filters           each filter in its default preset, on half an hour at 400 Hz; stances and field are found before, and
                  the field is homogeneous, so that the compass is used at every footfall; time of the processor
simulator         `fg-nav simulate`, its files included, each in a process of its own: `mall` (half an hour at 400 Hz,
                  eight sensors averaged) and an hour by a scenario file. Memory is the peak of the process
================= ==============================================================================================
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
from argparse import Namespace
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from time import perf_counter
from typing import TypeAlias

import gtsam
import harness
import numpy as np
from harness import Figure, Time, measure_time, option
from walks import simulate_long_walk

from fg_nav.arrays import Floats
from fg_nav.detection import detect_stances
from fg_nav.ekf import run_iez
from fg_nav.ekf.presets import TUNED, run_filter
from fg_nav.errors import OutputError
from fg_nav.evaluation import evaluate
from fg_nav.io import read
from fg_nav.lab.simulation.fields import SITES
from fg_nav.magnetic import average_footfall_field
from fg_nav.magnetic.footfall_field import integrate_attitude
from fg_nav.recording import Recording
from fg_nav.smoother import SmootherParameters, smooth
from fg_nav.smoother.strides import POSITION_DENSITY

SMOOTHER_RATIO, DOUBLING_RATIO, IEZ_US = 1.5, 2.3, 2.5
"""What is asked: smoother over bare loop, cost over that of half the walk, microseconds a sample."""

MINUTES, LONG_MINUTES = (10.0, 20.0), (7.5, 15.0, 30.0, 60.0, 120.0)
RATIO_MINUTES = (10.0, 20.0, 60.0)
SEED = 1
BARE, SMOOTH, BOTH, IEZ, DETECT = "bare loop", "smooth", "detect + smooth", "IEZ", "detection"

Repeat: TypeAlias = Mapping[str, Mapping[str, Time]]
"""Walk -> call -> time, of one repeat."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print, and write what was asked for."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        long=option(False, "walks of 7.5 minutes to 2 hours, doubling each time"),
        filters=option(False, "each filter on half an hour at 400 Hz as well"),
        ratio=option(False, "smooth over the bare loop alone, walks of 10, 20 and 60 minutes, processor time"),
        real=option(None, "a recording in place of the simulated walks", type=Path, metavar="FILE"),
        simulator=option(False, "what a simulation costs instead"),
        gate=option(False, "compare with the baseline instead; exit with 1 where a metric is worse"),
        quick=option(False, "of the gate, what takes a minute"),
        save=option(False, "make what is measured the baseline"),
        baseline=option(None, "of the gate (docs/results/benchmark.json)", type=Path, metavar="FILE"),
        peers=option(None, "other programs instead, by the interpreter that has them", metavar="PYTHON"),
        data=None,
        repeats=5,
        json=None,
    )
    if chosen.gate or chosen.quick or chosen.save or chosen.peers:
        guard_baseline(chosen)
        return
    if chosen.simulator:
        figures = measure_simulator()
        harness.print_figures(figures)
        harness.print_verdict(figures, chosen.json)
        return
    minutes = RATIO_MINUTES if chosen.ratio else LONG_MINUTES if chosen.long else MINUTES
    some = read_or_simulate(minutes, chosen.real)
    compile_all()
    if chosen.ratio:
        figures = measure_ratios(some, chosen.repeats)
        harness.print_figures(figures)
        harness.print_verdict(figures, chosen.json)
        return
    repeats = harness.repeat_measurement(measure_calls, some, chosen.repeats)
    figures = print_costs(some, repeats)
    print_solutions(some)
    if chosen.filters:
        figures += measure_filters(simulate_long_walk(FILTER_MINUTES, SEED, FILTER_RATE_HZ), chosen.repeats)
    times = [{walk: {call: vars(t) for call, t in of.items()} for walk, of in r.items()} for r in repeats]
    harness.print_verdict(figures, chosen.json, seconds=times)


def guard_baseline(chosen: Namespace) -> None:
    """Measure the metrics, or other programs; compare them with the baseline, or make them part of it."""
    import benchmark_gate as gate
    import benchmark_peers as peers

    path = chosen.baseline or gate.BASELINE
    if chosen.peers:
        rows = peers.measure_peers(list(peers.SETS), chosen.data, chosen.peers, chosen.repeats)
        peers.print_peers(rows)
        if chosen.save:
            gate.save_peers([vars(row) for row in rows], path)
        return
    metrics = gate.measure_metrics(chosen.quick, chosen.repeats, chosen.data)
    worse = gate.compare_baseline(metrics, gate.read_baseline(path) if chosen.gate else {})
    if chosen.save:
        gate.save_metrics(metrics, path)
    if chosen.gate and worse:
        raise OutputError(f"worse than the baseline: {', '.join(metric.name for metric in worse)}.")


# --- the smoother ----------------------------------------------------------------------------------------------------


def read_or_simulate(minutes: Sequence[float], real: Path | None = None) -> dict[str, Recording]:
    """Return walks by name, shortest first: the real one, or simulated ones of these lengths, parts of one."""
    if real is not None:
        return {real.name: read(real)}
    whole = simulate_long_walk(minutes[-1], SEED)
    share = [round(len(whole) * part / minutes[-1]) for part in minutes]
    return {f"{part:g} min": whole.slice(0, stop) for part, stop in zip(minutes, share, strict=True)}


def compile_all() -> None:
    """Compile and load everything once."""
    recording = simulate_long_walk(0.5, SEED)
    stances = detect_stances(recording)
    run_bare_loop(recording)
    smooth(recording, stances)
    run_iez(recording, stances)


def run_bare_loop(recording: Recording) -> None:
    """Give every sample to the preintegration, over its own period."""
    p, identity = SmootherParameters(), np.eye(3)
    params = gtsam.PreintegrationParams.MakeSharedU(p.gravity)
    params.setIntegrationCovariance(identity * POSITION_DENSITY**2)
    params.setAccelerometerCovariance(identity * p.acc_density**2)
    params.setGyroscopeCovariance(identity * np.radians(p.gyr_density_deg_s) ** 2)
    integrate = gtsam.PreintegratedImuMeasurementsG(params).integrateMeasurement
    period = np.diff(recording.t).tolist()
    for acc, gyr, h in zip(recording.acc[:-1], recording.gyr[:-1], period, strict=True):
        integrate(acc, gyr, h)


def measure_calls(recording: Recording) -> dict[str, Time]:
    """Time every call once, on one walk, and the bare loop before and after."""
    before, _ = measure_time(lambda: run_bare_loop(recording))
    detection, stances = measure_time(lambda: detect_stances(recording))
    smoothing, _ = measure_time(lambda: smooth(recording, stances))
    after, _ = measure_time(lambda: run_bare_loop(recording))
    filtering, _ = measure_time(lambda: run_iez(recording, stances))
    bare = Time((before.wall + after.wall) / 2, (before.cpu + after.cpu) / 2)
    return {BARE: bare, DETECT: detection, SMOOTH: smoothing, BOTH: detection + smoothing, IEZ: filtering}


def measure_ratios(some: Mapping[str, Recording], repeats: int) -> list[Figure]:
    """Measure `smooth` over the bare loop in turn with it, by the least time of the processor of each."""
    figures = []
    for name, recording in some.items():
        calls = partial(run_bare_loop, recording), partial(smooth, recording, detect_stances(recording))
        bare, smoothing = np.min([[measure_time(call)[0].cpu for call in calls] for _ in range(repeats)], axis=0)
        words = f"smooth over bare loop, {name}, processor"
        figures.append(Figure(name, words, "smoother", float(smoothing / bare), high=SMOOTHER_RATIO))
    return figures


def print_costs(some: Mapping[str, Recording], repeats: Sequence[Repeat]) -> list[Figure]:
    """Print microseconds a sample, ratios and figures."""
    names = list(some)
    headers = ("call", "us a sample", "processor", "over bare loop", "least", "greatest", "processor's", "best/best")
    for name, recording in some.items():
        harness.print_heading(f"{name}: {len(recording)} samples, medians over {len(repeats)} repeats")
        rows = [_cost_row(call, name, len(recording), repeats) for call in (BARE, DETECT, SMOOTH, BOTH, IEZ)]
        harness.print_table(headers, rows)
    figures = [figure for name in names for figure in _cost_figures(name, len(some[name]), repeats)]
    figures += [figure for half, name in pairwise(names) for figure in _doubling_figures(half, name, repeats)]
    harness.print_heading("Figures (medians over the repeats)")
    harness.print_figures(figures)
    return figures


def _cost_row(call: str, name: str, samples: int, repeats: Sequence[Repeat]) -> list[str]:
    wall, cpu = seconds_of(repeats, name, call)
    bare_wall, bare_cpu = seconds_of(repeats, name, BARE)
    over = wall / bare_wall
    shown = [1e6 * np.median(wall) / samples, 1e6 * np.median(cpu) / samples]
    shown += [np.median(over), over.min(), over.max()]
    shown += [np.median(cpu / bare_cpu), wall.min() / bare_wall.min()]
    return [call, *(f"{value:.2f}" for value in shown)]


def seconds_of(repeats: Sequence[Repeat], walk: str, call: str) -> tuple[Floats, Floats]:
    """Wall and processor time (R,) of a call on a walk in each repeat."""
    spent = [repeat[walk][call] for repeat in repeats]
    return np.array([time.wall for time in spent]), np.array([time.cpu for time in spent])


def _cost_figures(name: str, samples: int, repeats: Sequence[Repeat]) -> list[Figure]:
    bare, smoothing, both, filtering = (seconds_of(repeats, name, c)[0] for c in (BARE, SMOOTH, BOTH, IEZ))
    words = f"over bare loop, {name}"
    return [
        Figure(name, f"smooth {words}", "smoother", float(np.median(smoothing / bare)), high=SMOOTHER_RATIO),
        Figure(name, f"detect + smooth {words}", "smoother", float(np.median(both / bare))),
        Figure(name, f"us a sample, {name}", "iez", 1e6 * float(np.median(filtering)) / samples, high=IEZ_US),
    ]


def _doubling_figures(half: str, name: str, repeats: Sequence[Repeat]) -> list[Figure]:
    words = f"smooth, {name} over {half}"
    wall, cpu = (
        float(np.median(whole / part))
        for whole, part in zip(seconds_of(repeats, name, SMOOTH), seconds_of(repeats, half, SMOOTH), strict=True)
    )
    return [
        Figure(name, f"{words}, processor", "smoother", cpu, high=DOUBLING_RATIO),
        Figure(name, f"{words}, wall", "smoother", wall),
    ]


def print_solutions(some: Mapping[str, Recording]) -> None:
    """Print what `smooth` found, so that it is known to have done its work."""
    rows = []
    for name, recording in some.items():
        solution = smooth(recording, detect_stances(recording))
        metrics = evaluate(solution, recording.truth)
        rmse = "-" if metrics.rmse_2d_m is None else f"{metrics.rmse_2d_m:.3f}"
        rows.append([name, f"{metrics.strides_detected}", f"{metrics.distance_m:.0f}", rmse, solution.notes[-1]])
    harness.print_heading("What smooth found")
    harness.print_table(("walk", "strides", "distance (m)", "rmse 2-D (m)", ""), rows)


# --- the filters -----------------------------------------------------------------------------------------------------

FILTER_US, FILTER_S = 4.0, 4.0
"""What is asked of a filter: microseconds a sample, and seconds for half an hour at 400 Hz."""

FILTERS = ("iez", "qsf", "iqsf", "ma2018", "aiez")
FILTER_MINUTES, FILTER_RATE_HZ = 30.0, 400.0


def measure_filters(recording: Recording, repeats: int) -> list[Figure]:
    """Print what each filter costs, and return the figures."""
    stances = detect_stances(recording)
    attitude = integrate_attitude(recording, stances)
    mag = np.einsum("nji,j->ni", attitude, SITES["munich"].vector)
    known = average_footfall_field(replace(recording, mag=mag), stances, nav_R_body=attitude)
    figures = []
    for method in FILTERS:
        run = partial(run_filter, method, TUNED, recording, stances, known, 0.0)
        run()  # compiled
        taken = [measure_time(run)[0] for _ in range(repeats)]
        wall, cpu = (float(np.median([getattr(time, of) for time in taken])) for of in ("wall", "cpu"))
        a_sample, half_an_hour = 1e6 / len(recording), 60 * FILTER_MINUTES * FILTER_RATE_HZ / len(recording)
        figures += [
            Figure("filters", "us a sample, processor", method, cpu * a_sample, high=FILTER_US),
            Figure("filters", "half an hour at 400 Hz, processor (s)", method, cpu * half_an_hour, high=FILTER_S),
            Figure("filters", "the same, wall (s)", method, wall * half_an_hour),
        ]
    harness.print_heading(f"Filters: {len(recording)} samples, medians over {repeats} repeats")
    harness.print_figures(figures)
    return figures


# --- the simulator ---------------------------------------------------------------------------------------------------

MALL_S, HOUR_MB = 20.0, 2000.0  # What is asked of `mall`, s, and of an hour, MB.

HOUR = """
like = "mall"
[course]
points_m = [[0, 0], [0, 60], [110, 60], [110, 0], [0, 0]]
laps = 15
"""
"""5 km at 1.39 m/s."""


def measure_simulator() -> list[Figure]:
    """Seconds and memory of `fg-nav simulate`, after one short simulation that compiles."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "hour.toml").write_text(HOUR)
        run_simulate(folder, "demo")
        mall, hour = run_simulate(folder, "mall", "--seed", "1"), run_simulate(folder, str(folder / "hour.toml"))
    return [
        Figure("simulate", "mall, time, s", "wall", mall[0], high=MALL_S, pattern="{:.1f}"),
        Figure("simulate", "mall, memory, MB", "peak", mall[1], pattern="{:.0f}"),
        Figure("simulate", "one hour, time, s", "wall", hour[0], pattern="{:.1f}"),
        Figure("simulate", "one hour, memory, MB", "peak", hour[1], high=HOUR_MB, pattern="{:.0f}"),
    ]


def run_simulate(folder: Path, *arguments: str) -> tuple[float, float]:
    """Simulate into the folder; returns seconds on the wall, and the largest memory of any such run so far in MB."""
    out = folder / f"out-{len(list(folder.iterdir()))}"
    command: Sequence[str] = [sys.executable, "-m", "fg_nav.cli", "simulate", *arguments, "--out", str(out)]
    begin = perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024


if __name__ == "__main__":
    harness.run(main)
