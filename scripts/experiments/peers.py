"""Other programs beside ours on the same samples: how fast, how far off, and what each leaves out.

All have the samples as recorded, default parameters, and the magnetometer where they use one. The others run in
an interpreter of their own (`--python`, with `pip install gaitmap vqf`), by `scripts/bench/peer_runner.py`.
"""

from __future__ import annotations

import subprocess
import tempfile
from argparse import Namespace
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import harness
import numpy as np
import walks
from harness import measure_cpu, option
from scipy.spatial.transform import Rotation
from walks import Real

from experiments import FAILURE, Column, Experiment, Figures, Found, Table, Task, attempt, write_row
from experiments.cost import run_bare_loop
from fg_nav.detection import detect_stances
from fg_nav.detection.stance import Stances
from fg_nav.ekf import run_iez
from fg_nav.errors import SimulationError
from fg_nav.evaluation.comparison import align, interpolate_truth
from fg_nav.lab.simulation import simulate
from fg_nav.pipeline import prepare_walk, run_method
from fg_nav.recording import Recording
from fg_nav.smoother import smooth
from fg_nav.solution import Solution
from fg_nav.truth import TrajectoryTruth
from fg_nav.walk import Options, Walk

RUNNER = Path(__file__).resolve().parents[1] / "bench" / "peer_runner.py"
LEFT_OUT: Mapping[str, str] = {
    "fg-nav smoother": "-",
    "fg-nav iez": "smoothing, field",
    "gaitmap": "gyro bias, field, gaps, clipping, verdict; the ground is level",
    "vqf": "position, sigmas of attitude",
}
"""What a program has no answer to, by the beginning of its name."""


def list_peers(chosen: Namespace) -> list[Task]:
    """Motion-captured trials, loops, and simulated walks of a minute, whose attitude is known."""
    data, measure = walks.data_folder(chosen.data), partial(measure_programs, chosen.python, chosen.repeats)
    real = [(name, one) for name in ("vicon", "openshoe") for one in walks.list_set(data, name)]
    tasks = [Task(name, one.name, partial(measure, one)) for name, one in real]
    return tasks + [Task("simulated", f"{seed}", partial(measure, seed)) for seed in harness.seeds_of(chosen)]


def measure_programs(python: str | None, repeats: int, source: Real | int) -> Found:
    """Run all programs on a walk, a recording or that of a seed; times over that of the bare loop."""
    if isinstance(source, Real):
        walk = source.prepare(labelled=source.path.suffix == ".mat")
        recording, stances = walk.recording, walk.stances
    else:
        recording = simulate("demo", source).recording
        stances = detect_stances(recording)
    others = ("gaitmap", "gaitmap, our stances", *(("vqf", "vqf offline") if isinstance(source, int) else ()))
    programs: dict[str, Callable[[], tuple[float, Rotation, Any]]] = {
        **{name: partial(run_ours, run, recording, stances, repeats) for name, run in OURS.items()},
        **{name: partial(run_peer, python, name, recording, stances, repeats) for name in others},
    }
    bare_s = min(measure_cpu(partial(run_bare_loop, recording)) for _ in range(repeats))

    def measure(run: Callable[[], tuple[float, Rotation, Any]]) -> Figures:
        seconds, nav_R_body, position = run()
        costs = {"over_bare": seconds / bare_s, "us_a_sample": 1e6 * seconds / len(recording)}
        return {**costs, **measure_errors(recording, nav_R_body, position)}

    return {name: attempt(partial(measure, run)) for name, run in programs.items()}


def run_smoother(recording: Recording, stances: Stances) -> Solution:
    """Run the smoother, with the magnetometer where there is one, as the filters of orientation have it."""
    if recording.mag is None:
        return smooth(recording, stances)
    return run_method(prepare_walk(Walk.of(recording, Options())), "smoother").solution


OURS: Mapping[str, Callable[[Recording, Stances], Solution]] = {"fg-nav smoother": run_smoother, "fg-nav iez": run_iez}


def run_ours(
    run: Callable[[Recording, Stances], Solution], recording: Recording, stances: Stances, repeats: int
) -> tuple[float, Rotation, Any]:
    """Processor time of a method of ours, the least behind a first call, attitudes and positions."""
    solution = run(recording, stances)
    seconds = min(measure_cpu(partial(run, recording, stances)) for _ in range(repeats))
    return seconds, Rotation.from_matrix(solution.nav_R_body), solution.position


def run_peer(
    python: str | None, name: str, recording: Recording, stances: Stances, repeats: int
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
    if position is not None and not isinstance(truth, TrajectoryTruth):
        errors["closure_m"] = float(np.linalg.norm(position[-1] - position[0]))
    elif position is not None and isinstance(truth, TrajectoryTruth):
        row, true = interpolate_truth(truth, recording.t)
        off = align(position[row], true).apply(position[row]) - true
        for key, part in (("rmse_2d_m", off[:, :2]), ("rmse_3d_m", off)):
            errors[key] = float(np.sqrt((part**2).sum(axis=1).mean()))
    if isinstance(truth, TrajectoryTruth) and truth.nav_R_body is not None and len(truth.t) == len(recording):
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


def write_peers(table: Table) -> list[str]:
    """Write speed, errors and scope of each program, one row a set."""
    lines = [write_row(["set", "program", "walks", *(column.head for column in COLUMNS), "leaves out"])]
    lines.append("|---|---|" + "---:|" * (1 + len(COLUMNS)) + "---|")
    for section, variant in table.cases:
        rows = list(table.of(section, variant).values())
        failure = next((row[FAILURE] for row in rows if row.get(FAILURE)), "")
        cells = ["-" if failure else column.write(table, section, variant) or "-" for column in COLUMNS]
        known = next((words for begin, words in LEFT_OUT.items() if variant.startswith(begin)), "")
        scope = failure or rows[0].get("leaves_out", known)
        lines.append(write_row([section, variant, f"{rows[0].get('walks', len(rows))}", *cells, scope]))
    return lines


EXPERIMENTS: Mapping[str, Experiment] = {
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
        options={
            "python": option(None, "the interpreter that has the others", metavar="PYTHON"),
            "repeats": option(3, "how often all is run", metavar="N"),
        },
        blocks={"peers": write_peers},
    )
}
