"""What the estimators cost: a sample, a command from its start to its end, and other programs on the same samples.

Times are of the processor, and judged as ratios within one run: times differ between machines. What is repeated counts
by its least time, that of an idle machine. With `--jobs` of one alone they are true. Other programs have the samples as
recorded, default parameters, and the magnetometer where they use one; they run in an interpreter of their own
(`--python`, with `pip install gaitmap vqf`), by `scripts/bench/peer_runner.py`.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from argparse import Namespace
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

import gtsam
import numpy as np
import walks
from harness import FIRST_SEED, measure_cpu, option, seeds_of
from scipy.spatial.transform import Rotation
from stress import HEADER, Rows
from walks import Real, simulate_long_walk

from experiments import Asked, Column, Experiment, Figures, Found, Task
from fg_nav.detection import detect_stances
from fg_nav.detection.stance import Stances
from fg_nav.ekf import run_iez
from fg_nav.errors import SimulationError
from fg_nav.evaluation.comparison import align, interpolate_truth
from fg_nav.io import write_canonical
from fg_nav.lab.simulation import simulate
from fg_nav.online import OnlineNavigator
from fg_nav.online.buffer import OnlineOptions, rows_of
from fg_nav.pipeline import prepare_walk, run_method
from fg_nav.recording import Recording
from fg_nav.smoother import SmootherParameters, smooth
from fg_nav.smoother.strides import POSITION_DENSITY
from fg_nav.solution import Solution
from fg_nav.truth import TrajectoryTruth
from fg_nav.walk import Options, Walk

SEED, REPEATS = 1, 3

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


def list_samples(chosen: Namespace) -> list[Task]:
    """Walks of different length."""
    return [
        Task(f"{minutes:g} min", f"{SEED}", partial(measure_samples, minutes, chosen.ratio))
        for minutes in sorted(chosen.minutes or ((10.0, 20.0, 60.0) if chosen.ratio else (10.0, 20.0)))
    ]


def measure_samples(minutes: float, ratio: bool) -> Found:
    """Call all on one walk in turn, again and again, after a short one that compiles; least time of each, us."""
    recording = simulate_long_walk(minutes, SEED, RATE_HZ, None if ratio else "indoor")
    for call in list_calls(recording.slice(0, round(30 * RATE_HZ)), ratio).values():
        call()
    calls = list_calls(recording, ratio)
    least = np.min([[measure_cpu(call) for call in calls.values()] for _ in range(REPEATS)], axis=0)
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


# --- a command -------------------------------------------------------------------------------------------------------

LINES = 100_000  # written at once
HOUR = 'like = "mall"\ncourse = {points_m = [[0, 0], [0, 60], [110, 60], [110, 0], [0, 0]], laps = 15}\n'  # 5 km
CPU, WALL, MEMORY = "processor (s)", "wall (s)", "memory (MB)"
LAUNCHER = """
import json, resource, subprocess, sys
status = subprocess.call(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(json.dumps([status, used.ru_utime + used.ru_stime, used.ru_maxrss]))
"""  # A process begins with the memory of the one that starts it, as Linux counts: this one is small.


def run_command(*words: str, variables: Mapping[str, str] | None = None) -> dict[str, float]:
    """Run `fg-nav` with these words; its processor time, its time on the wall and its memory at its highest."""
    began, command = perf_counter(), [sys.executable, "-c", LAUNCHER, sys.executable, "-m", "fg_nav", *words]
    found = subprocess.run(command, capture_output=True, env={**os.environ, **(variables or {})}, check=True)
    status, processor_s, memory_kB = json.loads(found.stdout)
    if status:
        raise SimulationError(f"`fg-nav {' '.join(words)}` failed: run it by hand.")
    return {CPU: processor_s, WALL: perf_counter() - began, MEMORY: memory_kB / 1024}


def list_commands(chosen: Namespace) -> list[Task]:
    """The start of the command line, hours of walking, and simulations."""
    return [
        Task("start", "demo", measure_start),
        *(Task("hours", f"{hours:g}", partial(measure_hours, hours, chosen.no_field)) for hours in chosen.hours),
        Task("simulate", "mall and an hour", measure_simulator),
    ]


def measure_start() -> Found:
    """Help, a first run and one after it, with folders of each repeat for what is kept between runs."""
    spent = []
    with tempfile.TemporaryDirectory() as folder:
        write_canonical(simulate("demo", 1).recording, Path(folder) / "walk.csv")
        for k in range(REPEATS):
            kept = {"NUMBA_CACHE_DIR": f"{folder}/numba{k}", "MPLCONFIGDIR": f"{folder}/fonts{k}"}
            run = ("run", f"{folder}/walk.csv", "--force", "--out", f"{folder}/out")
            spent.append([run_command(*words, variables=kept) for words in (("--help",), run, run)])
    names = ("help", "first run", "warm run")
    return {name: {key: min(one[k][key] for one in spent) for key in spent[0][k]} for k, name in enumerate(names)}


def measure_hours(hours: float, no_field: bool) -> Found:
    """`fg-nav run` on a walk of these hours, written in pieces."""
    rows = Rows.simulate(FIRST_SEED, RATE_HZ)
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


# --- other programs --------------------------------------------------------------------------------------------------

RUNNER = Path(__file__).resolve().parents[1] / "bench" / "peer_runner.py"
OURS = ("smoother", "iez")
PEERS: Sequence[str] = ("gaitmap", "gaitmap, our stances", "vqf", "vqf offline")  # the last two have no position


def list_peers(chosen: Namespace) -> list[Task]:
    """Motion-captured trials, loops, and simulated walks of a minute, whose attitude is known."""
    data, measure = walks.data_folder(chosen.data), partial(measure_programs, chosen.python)
    real = [(name, one) for name in ("vicon", "openshoe") for one in walks.list_set(data, name)]
    tasks = [Task(name, one.name, partial(measure, one)) for name, one in real]
    return tasks + [Task("simulated", f"{seed}", partial(measure, seed)) for seed in seeds_of(chosen)]


def measure_programs(python: str | None, source: Real | int) -> Found:
    """Run all programs on a walk, a recording or that of a seed; times over that of the bare loop."""
    if isinstance(source, Real):
        walk = source.prepare(labelled=source.path.suffix == ".mat")
        recording, stances = walk.recording, walk.stances
    else:
        recording = simulate("demo", source).recording
        stances = detect_stances(recording)
    bare_s = min(measure_cpu(partial(run_bare_loop, recording)) for _ in range(REPEATS))

    def measure(run: Callable[[], tuple[float, Rotation, Any]]) -> Figures:
        seconds, nav_R_body, position = run()
        costs = {"over_bare": seconds / bare_s, "us_a_sample": 1e6 * seconds / len(recording)}
        return {**costs, **measure_errors(recording, nav_R_body, position)}

    others = PEERS[:2] if isinstance(source, Real) else PEERS
    return {
        **{f"fg-nav {name}": partial(measure, partial(run_ours, name, recording, stances)) for name in OURS},
        **{name: partial(measure, partial(run_peer, python, name, recording, stances)) for name in others},
    }


def run_ours(method: str, recording: Recording, stances: Stances) -> tuple[float, Rotation, Any]:
    """Processor time of a method of ours, the least behind a first call, attitudes and positions."""

    def run() -> Solution:
        if method == "iez" or recording.mag is None:
            return (run_iez if method == "iez" else smooth)(recording, stances)
        # with the magnetometer, as the filters of orientation have it, from the samples on
        return run_method(prepare_walk(Walk.of(recording)), method).solution

    solution = run()
    seconds = min(measure_cpu(run) for _ in range(REPEATS))
    return seconds, Rotation.from_matrix(solution.nav_R_body), solution.position


def run_peer(
    python: str | None, name: str, recording: Recording, stances: Stances, repeats: int = REPEATS
) -> tuple[float, Rotation, Any]:
    """Run another program in its interpreter; raises `SimulationError` where that is not to be had."""
    if python is None:
        raise SimulationError(f"{name} needs an interpreter that has it: name that with --python.")
    mag = np.zeros_like(recording.acc) if recording.mag is None else recording.mag.copy()
    seen = np.isfinite(mag).all(axis=1)  # a field is held until the next sample
    mag = mag[np.maximum.accumulate(np.where(seen, np.arange(len(mag)), np.argmax(seen)))]
    samples: dict[str, Any] = {"t": recording.t, "acc": recording.acc, "gyr": recording.gyr, "mag": mag}
    with tempfile.TemporaryDirectory() as folder:
        np.savez(f"{folder}/input.npz", still=stances.mask, repeats=repeats, **samples)
        ran = subprocess.run([python, str(RUNNER), name, folder], capture_output=True, text=True, check=False)
        if ran.returncode:
            raise SimulationError(f"{name} did not run: {(ran.stderr.strip().splitlines() or ['no word'])[-1][:200]}")
        output = dict(np.load(f"{folder}/output.npz"))
    return float(output["seconds"]), Rotation.from_quat(output["quaternion"]), output.get("position")


def measure_errors(recording: Recording, nav_R_body: Rotation, position: Any) -> dict[str, float]:
    """Errors of position, rms over the samples after a rotation about up and a shift, and of attitude."""
    errors, truth = dict[str, float](), recording.truth
    if not isinstance(truth, TrajectoryTruth):
        return {"closure_m": float(np.linalg.norm(position[-1] - position[0]))}
    if position is not None:
        row, true = interpolate_truth(truth, recording.t)
        off = align(position[row], true).apply(position[row]) - true
        for key, part in (("rmse_2d_m", off[:, :2]), ("rmse_3d_m", off)):
            errors[key] = float(np.sqrt((part**2).sum(axis=1).mean()))
    if truth.nav_R_body is not None and len(truth.t) == len(recording):
        turn = nav_R_body * Rotation.from_matrix(truth.nav_R_body).inv()  # in nav: about up, and the rest
        x, y, z, w = turn.as_quat().T
        heading = np.unwrap(2.0 * np.arctan2(z, w))
        tilt = 2.0 * np.arcsin(np.hypot(x, y).clip(max=1))
        errors["heading_deg"] = float(np.degrees((heading - heading.mean()).std()))
        errors["inclination_deg"] = float(np.degrees(np.sqrt(np.mean(tilt**2))))
    return errors


COLUMNS = tuple(
    Column(figure, head, "median", pattern)
    for figure, head, pattern in (
        ("over_bare", "over the bare loop", "{:.2f}"), ("us_a_sample", "us a sample", "{:.2f}"),
        ("rmse_2d_m", "2-D (m)", "{:.3f}"), ("rmse_3d_m", "3-D (m)", "{:.3f}"),
        ("closure_m", "start to end (m)", "{:.2f}"), ("heading_deg", "heading (deg)", "{:.2f}"),
        ("inclination_deg", "inclination (deg)", "{:.2f}"),
    )
)  # fmt: skip


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
        ],
        options={
            "ratio": option(False, "smooth over the bare loop alone"),
            "minutes": option(None, "of the walks", type=float, nargs="+", metavar="M"),
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
            "no_field": option(False, "without the magnetometer"),
        },
    ),
    "peers": Experiment(
        """Other programs beside ours on the same samples: how fast, how far off, and what each leaves out.

        vicon: trials of a foot with motion capture, stances by PyShoe's labels; openshoe: loops that end where they
        began; simulated: walks of the scenario `demo`, a minute each, indoor field, true attitude known. Time is of the
        processor, the least of the repeats behind a first call, over that of the bare loop on the same samples.
        Position: rms over the samples of what a rotation about up and a shift leave; attitude: rms, heading with its
        mean off, and inclination; medians over the walks.""",
        list_peers,
        COLUMNS,
        seeds=6,
        options={"python": option(None, "the interpreter that has the others", metavar="PYTHON")},
    ),
}  # fmt: skip
