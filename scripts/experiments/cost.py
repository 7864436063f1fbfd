"""What the estimators cost: a sample, a footfall of a walk in progress, and a command from its start to its end.

Times are of the processor, and judged as ratios within one run: times differ between machines. What is repeated counts
by its least time, that of an idle machine. With `--jobs` of one alone they are true.
"""

from __future__ import annotations

import os
import sys
import tempfile
from argparse import Namespace
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from subprocess import DEVNULL, Popen
from time import perf_counter, sleep
from typing import Any

import gtsam
import numpy as np
from harness import FIRST_SEED, Figure, measure_cpu, option
from stress import HEADER, Rows, read_memory_mb
from walks import simulate_long_walk

from experiments import Asked, Column, Experiment, Figures, Found, Table, Task
from fg_nav.detection import detect_stances
from fg_nav.errors import SimulationError
from fg_nav.io import write_canonical
from fg_nav.lab.simulation import simulate
from fg_nav.online import OnlineNavigator
from fg_nav.online.buffer import OnlineOptions, rows_of
from fg_nav.online.estimates import StanceEstimate
from fg_nav.online.resolve import Solver, SolverProcess, WalkSolver
from fg_nav.online.resolve import Task as Solving
from fg_nav.online.window import AnchorState
from fg_nav.pipeline import prepare_walk, run_method
from fg_nav.recording import Recording
from fg_nav.smoother import SmootherParameters, smooth
from fg_nav.smoother.strides import POSITION_DENSITY
from fg_nav.walk import Options, Walk

SEED = 1

# --- a sample --------------------------------------------------------------------------------------------------------

RATE_HZ, BLOCK = 200.0, 64
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


def list_samples(chosen: Namespace) -> list[Task]:
    """Walks of different length."""
    return [
        Task(f"{minutes:g} min", f"{SEED}", partial(measure_samples, minutes, chosen.ratio, chosen.repeats))
        for minutes in sorted(chosen.minutes or ((10.0, 20.0, 60.0) if chosen.ratio else (10.0, 20.0)))
    ]


def measure_samples(minutes: float, ratio: bool, repeats: int) -> Found:
    """Call all on one walk in turn, as often as asked, after a short one that compiles; least time of each, us."""
    recording = simulate_long_walk(minutes, SEED, RATE_HZ, None if ratio else "indoor")
    for call in list_calls(recording.slice(0, round(30 * RATE_HZ)), ratio).values():
        call()
    calls = list_calls(recording, ratio)
    least = np.min([[measure_cpu(call)[0] for call in calls.values()] for _ in range(repeats)], axis=0)
    return {name: {"us": float(us)} for name, us in zip(calls, 1e6 * least / len(recording), strict=True)}


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
        "online": partial(follow_walk, recording),
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


def follow_walk(recording: Recording) -> None:
    """Follow a recording as if it were being walked, solved again in this process."""
    navigator, rows = OnlineNavigator(OnlineOptions(heading_rad=None)), rows_of(recording)
    for start in range(0, len(rows), BLOCK):
        navigator.add_rows(rows[start : start + BLOCK])
    navigator.close()


def judge_samples(table: Table) -> list[Figure]:
    """Compare the cost of a sample with that on the walk before."""
    cost = {walk: table.values(walk, "smooth", "us")[0] for walk in table.sections}
    return [
        Figure(whole, f"smooth a sample, over {half}", "smooth", float(cost[whole] / cost[half]), high=DOUBLING)
        for half, whole in pairwise(table.sections)
    ]


# --- a footfall ------------------------------------------------------------------------------------------------------

BLOCK_S = 0.1  # samples that come at once
EVERY, EARLY = 1000, slice(500, 1500)


def list_footfalls(chosen: Namespace) -> list[Task]:
    """One walk in progress."""
    mode = "the whole walk" if chosen.lag is None else f"a lag of {chosen.lag:g} s"
    return [Task(mode, f"{chosen.minutes:g} min", partial(measure_footfalls, chosen.minutes, chosen.rate, chosen.lag))]


def measure_footfalls(minutes: float, rate_hz: float, lag_s: float | None) -> Found:
    """Time each push that returns a line, and what the memory of both processes is then; by the thousand, and all."""
    recording = simulate_long_walk(minutes, SEED, rate_hz, "indoor")
    navigator, ms, mb = OnlineNavigator(OnlineOptions(heading_rad=0.0, lag_s=lag_s)), list[float](), list[float]()
    solver = PacedSolver(navigator)
    block = max(1, round(BLOCK_S / recording.period_s))
    for start in range(0, len(recording), block):
        part, idle_s = np.s_[start : start + block], solver.idle_s
        mag = None if recording.mag is None else recording.mag[part]
        began = perf_counter()
        lines = navigator.push(recording.t[part], recording.acc[part], recording.gyr[part], mag)
        elapsed_s = perf_counter() - began - (solver.idle_s - idle_s)
        if any(isinstance(line, StanceEstimate) for line in lines):
            ms.append(1e3 * elapsed_s)
            mb.append(read_memory_mb("self") + read_memory_mb(solver.process.pid or 0))
    solver.close()
    if len(ms) <= EARLY.start:
        raise SimulationError(f"{len(ms)} footfalls are too few for a trend: ask for 12 minutes or more.")
    parts: dict[str, Any] = {f"{k} to {k + EVERY}": slice(k, k + EVERY) for k in range(0, len(ms), EVERY)}
    parts["all"] = slice(None)
    found: dict[str, dict[str, float]] = {}
    for name, some in parts.items():
        found[name] = {f"p{q}": float(np.percentile(ms[some], q)) for q in (50, 99, 100)} | {"memory": mb[some][-1]}
    if lag_s is not None:
        late, early = np.percentile(ms[-EVERY:], 99), np.percentile(ms[EARLY], 99)
        found["all"] |= {"late / early": float(late / early), "growth": mb[-1] / mb[len(mb) // 2]}
    return found


class PacedSolver(Solver):
    """Is given the time that it would have had; `idle_s` is how long it was waited for within that."""

    def __init__(self, navigator: OnlineNavigator) -> None:
        options, self._buffer = navigator.options, navigator.buffer
        self.process = SolverProcess({None: options})
        super().__init__(WalkSolver(options, self._buffer), self.process)
        self.idle_s, self._begun = 0.0, (0.0, 0.0)
        navigator._solver = navigator.smoother.solver = self

    def begin(self, task: Solving) -> None:
        """As it does, and note when."""
        self._begun = perf_counter(), self._buffer.newest_s
        super().begin(task)

    def take(self) -> AnchorState | None:
        """As it does, after as long as the walk took since the task."""
        began = perf_counter()
        due = self._begun[0] + self._buffer.newest_s - self._begun[1]
        while not self.is_ready() and perf_counter() < due:
            sleep(0.001)
        self.idle_s += perf_counter() - began
        return super().take()


# --- a command -------------------------------------------------------------------------------------------------------

LINES = 100_000  # written at once
HOUR = 'like = "mall"\ncourse = {points_m = [[0, 0], [0, 60], [110, 60], [110, 0], [0, 0]], laps = 15}\n'  # 5 km
CPU, WALL, MEMORY = "processor (s)", "wall (s)", "memory (MB)"


def run_command(*words: str, variables: Mapping[str, str] | None = None) -> dict[str, float]:
    """Run `fg-nav` with these words; its processor time, its time on the wall and its memory at its highest."""
    began, command = perf_counter(), [sys.executable, "-m", "fg_nav", *words]
    process = Popen(command, stdout=DEVNULL, stderr=DEVNULL, env={**os.environ, **(variables or {})})
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SimulationError(f"`fg-nav {' '.join(words)}` failed: run it by hand.")
    return {CPU: used.ru_utime + used.ru_stime, WALL: perf_counter() - began, MEMORY: used.ru_maxrss / 1024}


def list_commands(chosen: Namespace) -> list[Task]:
    """The start of the command line, hours of walking, and simulations."""
    return [
        Task("start", "demo", partial(measure_start, chosen.repeats)),
        *(Task("hours", f"{h:g}", partial(measure_hours, h, chosen.rate, chosen.no_field)) for h in chosen.hours),
        Task("simulate", "mall and an hour", measure_simulator),
    ]


def measure_start(repeats: int) -> Found:
    """Help, a first run and one after it, with folders of each repeat for what is kept between runs."""
    spent = []
    with tempfile.TemporaryDirectory() as folder:
        write_canonical(simulate("demo", 1).recording, Path(folder) / "walk.csv")
        for k in range(repeats):
            kept = {"NUMBA_CACHE_DIR": f"{folder}/numba{k}", "MPLCONFIGDIR": f"{folder}/fonts{k}"}
            run = ("run", f"{folder}/walk.csv", "--force", "--out", f"{folder}/out")
            spent.append([run_command(*words, variables=kept) for words in (("--help",), run, run)])
    names = ("help", "first run", "warm run")
    return {name: {key: min(one[k][key] for one in spent) for key in spent[0][k]} for k, name in enumerate(names)}


def measure_hours(hours: float, rate_hz: float, no_field: bool) -> Found:
    """`fg-nav run` on a walk of these hours, written in pieces."""
    rows = Rows.simulate(FIRST_SEED, rate_hz)
    count = round(3600.0 * hours / rows.period_s)
    with tempfile.TemporaryDirectory() as folder:
        with open(f"{folder}/walk.csv", "wb") as file:
            file.write(HEADER)
            file.writelines(rows.format(k, min(k + LINES, count)) for k in range(0, count, LINES))
        words = ["run", f"{folder}/walk.csv", "--out", f"{folder}/out", *(["--no-mag"] if no_field else [])]
        found = run_command(*words)
    return {"without field" if no_field else "with field": {**found, "us a sample": 1e6 * found[CPU] / count}}


def measure_simulator() -> Found:
    """`fg-nav simulate`, its files included, after a short simulation that compiles."""
    with tempfile.TemporaryDirectory() as folder:
        (scenario := Path(folder) / "hour.toml").write_text(HOUR)
        runs: dict[str, Figures] = {
            name: run_command("simulate", words, "--seed", "1", "--out", f"{folder}/{name}")
            for name, words in (("demo", "demo"), ("mall", "mall"), ("one hour", f"{scenario}"))
        }
    return runs


def judge_hours(table: Table) -> list[Figure]:
    """Compare walks with those of half their length."""
    figures = []
    for mode in table.variants("hours"):
        cost = {float(walk): row.get(CPU, np.inf) for walk, row in table.of("hours", mode).items()}
        for hours in [one for one in cost if one / 2.0 in cost]:
            growth = cost[hours] / cost[hours / 2.0]
            figures.append(Figure("hours", f"doubling to {hours:g} h", mode, growth, high=2.2))
    return figures


EXPERIMENTS: Mapping[str, Experiment] = {
    "cost": Experiment(
        """What a sample costs each estimator, over other calls on the same samples.

        Rounds in a corridor at 200 Hz; least processor time of the repeats, us. Bare loop: GTSAM's
        `integrateMeasurement` for every sample, into one measurement, and nothing else; smooth: from the lever to the
        sigmas, without the magnetometer; with, without: the smoother with the magnetometer and without, from the
        samples to the solution; online: a walk in progress, solved again in this process; filters in their presets.
        `--ratio`: smooth over the bare loop alone, at 10, 20 and 60 minutes.""",
        list_samples,
        (
            Column("us", "us a sample", "mean"),
            *(Column("us", f"over {by}", "mean", "{:.2f}", by) for by in ("bare loop", "iez", "without")),
        ),
        [
            *(Asked("us", "mean", high=high, variant=name, over=by) for (name, by), high in ASKED.items()),
            *(Asked("us", "mean", high=FILTER_US, variant=name) for name in FILTERS),
        ],
        options={
            "ratio": option(False, "smooth over the bare loop alone"),
            "minutes": option(None, "of the walks", type=float, nargs="+", metavar="M"),
            "repeats": option(3, "how often all is run", metavar="N"),
        },
        judge=judge_samples,
    ),
    "footfalls": Experiment(
        """What a footfall costs online, however long the walk, from the push that completes it to its line, ms.

        `OnlineNavigator.push` for hours round a corridor with a magnetometer, a tenth of a second at a time, solved
        again in a process beside it; a row each thousand lines, and memory of both processes, MB. The walk is pushed
        faster than it was walked, so where it waits for the other process, the time that this would have had is not
        counted. With a lag: p99 of the last thousand lines over that of lines 500 to 1500, memory over that at half of
        the walk.""",
        list_footfalls,
        (
            *(Column(f"p{q}", name, "mean", "{:.1f}") for q, name in ((50, "p50"), (99, "p99"), (100, "longest"))),
            Column("memory", "memory", "mean", "{:.0f}"),
            Column("late / early", "late / early", "mean", "{:.2f}"),
            Column("growth", "growth", "mean", "{:.2f}"),
        ),
        [
            Asked(figure, "mean", high=high, variant="all")
            for figure, high in (("p50", 10), ("p99", 60), ("p100", 250), ("late / early", 1.3), ("growth", 1.05))
        ],
        options={
            "minutes": option(20.0, "of walking", metavar="N"),
            "lag": option(None, "fixed lag (none: the whole walk)", type=float, metavar="SECONDS"),
            "rate": option(100.0, "of the samples", metavar="HZ"),
        },
    ),
    "commands": Experiment(
        """What commands cost, each a process of its own: processor time, time on the wall, memory at its highest.

        start: `fg-nav --help`, the first `fg-nav run` after installing (nothing is compiled, matplotlib has not listed
        its fonts), and the same again, on the minute of walking of the scenario `demo`; of the repeats the least.
        hours: `fg-nav run` on hours of a simulated walk with a magnetometer, all files written; and the processor time
        over that of half the walk, where both are measured. simulate: `fg-nav simulate mall`, half an hour at 400 Hz
        with eight units averaged, and an hour by a scenario file.""",
        list_commands,
        tuple(Column(name, name, "mean", "{:.1f}") for name in (CPU, WALL, MEMORY, "us a sample")),
        [
            *(Asked(CPU, "mean", high=high, section="start", variant=name)
              for name, high in (("help", 0.3), ("first run", 15.0), ("warm run", 3.0))),
            Asked(WALL, "mean", high=20.0, section="simulate", variant="mall"),
            Asked(MEMORY, "mean", high=2000.0, section="simulate", variant="one hour"),
        ],
        options={
            "hours": option([1.0, 2.0], "of walking", type=float, nargs="+", metavar="H"),
            "rate": option(200.0, "of the samples", metavar="HZ"),
            "no_field": option(False, "without the magnetometer"),
            "repeats": option(3, "how often the start is measured", metavar="N"),
        },
        judge=judge_hours,
    ),
}  # fmt: skip
