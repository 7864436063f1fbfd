"""How long the estimators take, as ratios within one run, where times differ between machines.

    python scripts/bench/benchmark.py [--minutes M ...] [--repeats N] [--json FILE]
    python scripts/bench/benchmark.py --ratio [--repeats N]   smooth over the bare loop alone, at 10, 20 and 60 minutes

Each repeat runs all calls on all walks, parts of one simulated round in a corridor at 200 Hz, one after the other, so
that what else the machine does affects all alike. Ratios are of the least processor time of all repeats: what an idle
machine would show.

================= ==============================================================================================
bare loop         GTSAM's `integrateMeasurement` for every sample, into one measurement, and nothing else
smooth            `smooth(recording, stances)`: everything from the lever to the sigmas, without the magnetometer
detection         `detect_stances(recording)`
with, without     the smoother with and without the magnetometer, from the samples to the solution
online            a walk in progress, solved again in this process
filters           each in its default preset, and one with the way back; what is compiled is held against `iez`
doubling          cost of `smooth` on a walk over that on the walk before, per sample
================= ==============================================================================================
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import gtsam
import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[1]))

import harness
from harness import Figure, measure_time, option
from walks import simulate_long_walk

from fg_nav.detection import detect_stances
from fg_nav.online.buffer import OnlineOptions, rows_of
from fg_nav.online.navigator import OnlineNavigator
from fg_nav.pipeline import prepare_walk, run_method
from fg_nav.recording import Recording
from fg_nav.smoother import SmootherParameters, smooth
from fg_nav.smoother.strides import POSITION_DENSITY
from fg_nav.walk import Options, Walk

SEED, RATE_HZ, BLOCK = 1, 200.0, 64
FILTERS = ("iez", "iez-rts", "qsf", "iqsf", "ma2018", "aiez")
ASKED: Mapping[tuple[str, str], float] = {
    ("smooth", "bare loop"): 1.5,
    ("detection", "iez"): 1.0,
    ("ma2018", "iez"): 1.5,
    ("aiez", "iez"): 1.5,
    ("with", "without"): 1.8,
    ("online", "bare loop"): 60.0,
}
"""Call over another call: at most."""
DOUBLING, FILTER_US = 1.15, 4.0  # cost a sample over that of a shorter walk; of a filter, us a sample


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print, and write what was asked for."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        ratio=option(False, "smooth over the bare loop alone"),
        minutes=option(None, "of the walks", type=float, nargs="+", metavar="M"),
        repeats=3,
        json=None,
    )
    minutes = sorted(chosen.minutes or ((10.0, 20.0, 60.0) if chosen.ratio else (10.0, 20.0)))
    whole = simulate_long_walk(minutes[-1], SEED, RATE_HZ, None if chosen.ratio else "indoor")
    walks = {f"{m:g} min": whole.slice(0, round(len(whole) * m / minutes[-1])) for m in minutes}
    calls = {name: list_calls(recording, chosen.ratio) for name, recording in walks.items()}
    for call in list_calls(whole.slice(0, round(30 * RATE_HZ)), chosen.ratio).values():
        call()  # compiled
    cpu_s = {(walk, name): list[float]() for walk, of in calls.items() for name in of}
    for _ in range(chosen.repeats):
        for walk, name in cpu_s:
            cpu_s[walk, name].append(measure_time(calls[walk][name])[0].cpu)
    least_us = {
        walk: {name: 1e6 * min(cpu_s[walk, name]) / len(recording) for name in calls[walk]}
        for walk, recording in walks.items()
    }
    harness.print_heading(f"Processor time, us a sample, the least of {chosen.repeats} repeats")
    rows = [[name, *(f"{us[name]:.3f}" for us in least_us.values())] for name in calls[f"{minutes[0]:g} min"]]
    harness.print_table(("call", *walks), rows)
    figures = judge_costs(least_us)
    harness.print_figures(figures)
    harness.print_verdict(figures, chosen.json, us_a_sample=least_us)


def list_calls(recording: Recording, ratio: bool) -> dict[str, Callable[[], object]]:
    """Return what is timed on a walk, by name."""
    inertial = replace(recording, mag=None)
    stances = detect_stances(inertial)
    calls: dict[str, Callable[[], object]] = {
        "bare loop": partial(run_bare_loop, recording),
        "smooth": partial(smooth, inertial, stances),
    }
    if ratio:
        return calls
    walk = prepare_walk(Walk.of(recording, Options()))
    return calls | {
        "detection": partial(detect_stances, inertial),
        "with": lambda: run_method(prepare_walk(Walk.of(recording, Options())), "smoother"),
        "without": lambda: run_method(prepare_walk(Walk.of(recording, Options(use_magnetometer=False))), "smoother"),
        "online": partial(push_walk, recording),
        **{name: partial(run_method, walk, name) for name in FILTERS},
    }


def run_bare_loop(recording: Recording) -> None:
    """Integrate every sample by the class that the smoother uses, over its own period."""
    p, identity = SmootherParameters(), np.eye(3)
    params = gtsam.PreintegrationParams.MakeSharedU(p.gravity)
    params.setIntegrationCovariance(identity * POSITION_DENSITY**2)
    params.setAccelerometerCovariance(identity * p.acc_density**2)
    params.setGyroscopeCovariance(identity * np.radians(p.gyr_density_deg_s) ** 2)
    integrate = gtsam.PreintegratedImuMeasurementsG(params).integrateMeasurement
    for acc, gyr, h in zip(recording.acc[:-1], recording.gyr[:-1], np.diff(recording.t).tolist(), strict=True):
        integrate(acc, gyr, h)


def push_walk(recording: Recording) -> None:
    """Follow a recording as if it were being walked, solved again in this process."""
    navigator, rows = OnlineNavigator(OnlineOptions(heading_rad=None)), rows_of(recording)
    for start in range(0, len(rows), BLOCK):
        navigator.add_rows(rows[start : start + BLOCK])
    navigator.close()


def judge_costs(least_us: Mapping[str, Mapping[str, float]]) -> list[Figure]:
    """Compare the ratios of each walk, and of each walk over the one before, with what is asked."""
    figures = []
    for walk, us in least_us.items():
        for (name, by), high in ASKED.items():
            if name in us:
                figures.append(Figure(walk, f"{name} over {by}, {walk}", "ratio", us[name] / us[by], high=high))
        costs = {name: us[name] for name in FILTERS if name in us}
        figures += [Figure(walk, f"us a sample, {walk}", name, cost, high=FILTER_US) for name, cost in costs.items()]
    for half, whole in pairwise(least_us):
        growth = least_us[whole]["smooth"] / least_us[half]["smooth"]
        figures.append(Figure(whole, f"smooth a sample, {whole} over {half}", "ratio", growth, high=DOUBLING))
    return figures


if __name__ == "__main__":
    harness.run(main)
