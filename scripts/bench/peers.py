"""Other programs beside ours on the same samples: how fast, how far off, and what each leaves out.

    python scripts/bench/peers.py --python PYTHON [--save] [--repeats N] [--data DIR]

============ ======================================================================================================
vicon        28 trials of a foot with motion capture; stances by PyShoe's labels for all that take stances
openshoe     3 loops that end where they began; our stances
simulated    6 walks of the scenario `demo`, a minute each, indoor field; our stances, and the true attitude
============ ======================================================================================================

All have the samples as they were recorded and default parameters; the magnetometer where they use one. `PYTHON` is an
interpreter in which the others are installed (`pip install gaitmap vqf`). Time is of the processor, the least of the
repeats behind a first call, as a multiple of the bare loop (`benchmark.py`) on the same samples in the same run.
Errors: position, rms over the samples of what a rotation about up and a shift leave, over the ground and in space;
openshoe, distance from start to end; attitude, rms over the samples, heading with its mean off, and inclination.
`--save` writes `docs/results/benchmark.json`, of which `write_results.py` makes the table.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import date
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

sys.path.append(str(Path(__file__).resolve().parents[1]))

import harness
import walks
from bench.benchmark import run_bare_loop
from harness import FIRST_SEED, measure_time, option

from fg_nav.detection import detect_stances
from fg_nav.detection.stance import Stances
from fg_nav.ekf import run_iez
from fg_nav.errors import FgNavError
from fg_nav.evaluation.comparison import align, interpolate_truth
from fg_nav.lab.pyshoe import read_pyshoe_labels
from fg_nav.lab.simulation import simulate
from fg_nav.pipeline import prepare_walk, run_method
from fg_nav.recording import Recording
from fg_nav.smoother import smooth
from fg_nav.solution import Solution
from fg_nav.truth import TrajectoryTruth
from fg_nav.walk import Options, Walk, read_walk

STORE = Path(__file__).resolve().parents[2] / "docs" / "results" / "benchmark.json"
SIMULATED = 6
LEFT_OUT: Mapping[str, str] = {
    "fg-nav smoother": "-",
    "fg-nav iez": "smoothing, field",
    "gaitmap": "gyro bias, field, gaps, clipping, verdict; the ground is level",
    "vqf": "position, sigmas of attitude",
}
"""What a program has no answer to, by the beginning of its name."""
ERRORS = ("rmse_2d_m", "rmse_3d_m", "closure_m", "heading_deg", "inclination_deg")


def list_walks(name: str, data: Path) -> Iterator[tuple[Recording, Stances]]:
    """Yield the walks of a set with their stances."""
    if name == "simulated":
        for seed in range(FIRST_SEED, FIRST_SEED + SIMULATED):
            recording = simulate("demo", seed).recording
            yield recording, detect_stances(recording)
    files = {"vicon": "vicon/*.mat", "openshoe": "openshoe/data_inert*.txt"}
    for path in sorted(data.glob(files[name])) if name in files else ():
        walk = prepare_walk(read_walk(path, Options(use_magnetometer=False)))
        labels = Stances.from_mask(read_pyshoe_labels(path)) if name == "vicon" else walk.stances
        yield walk.recording, labels


def run_smoother(recording: Recording, stances: Stances) -> Solution:
    """Run the smoother, with the magnetometer where there is one, as the filters of orientation have it."""
    if recording.mag is None:
        return smooth(recording, stances)
    return run_method(prepare_walk(Walk.of(recording, Options())), "smoother").solution


OURS: Mapping[str, Callable[[Recording, Stances], Solution]] = {"fg-nav smoother": run_smoother, "fg-nav iez": run_iez}


def measure_set(
    name: str, some: Sequence[tuple[Recording, Stances]], python: str | None, repeats: int
) -> list[dict[str, Any]]:
    """Run all programs on the walks of a set; a row each, medians over the walks."""

    def least(call: Callable[[], object]) -> float:
        return min(measure_time(call)[0].cpu for _ in range(repeats))

    bare_s = [least(partial(run_bare_loop, recording)) for recording, _ in some]
    peers = ("gaitmap", "gaitmap, our stances", *(("vqf", "vqf offline") if name == "simulated" else ()))
    rows = []
    for method in (*OURS, *peers):
        found, missing, version = list[dict[str, float | None]](), "", ""
        with tempfile.TemporaryDirectory() as folder:
            outputs = run_peer(python, method, Path(folder), some, repeats) if method in peers else iter(())
            for (recording, stances), bare in zip(some, bare_s, strict=True):
                if method in peers:
                    output = next(outputs)
                    if isinstance(output, str):
                        missing = output
                        continue
                    seconds, version = float(output["seconds"]), str(output["version"])
                    attitude, position = Rotation.from_quat(output["quaternion"]), output.get("position")
                else:
                    call = partial(OURS[method], recording, stances)
                    solution, seconds = call(), least(call)
                    attitude, position = Rotation.from_matrix(solution.nav_R_body), solution.position
                costs = {"over_bare": seconds / bare, "us_a_sample": 1e6 * seconds / len(recording)}
                found.append({**costs, **measure_errors(recording, attitude, position)})
        of = {
            key: [value for one in found if (value := one[key]) is not None]
            for key in ("over_bare", "us_a_sample", *ERRORS)
        }
        medians = {key: float(f"{np.median(some):.4g}") if some else None for key, some in of.items()}
        scope = next(words for begin, words in LEFT_OUT.items() if method.startswith(begin))
        row = {"set": name, "method": method, "version": version, "walks": len(found), **medians}
        rows.append({**row, "missing": missing, "leaves_out": scope})
    return rows


def run_peer(
    python: str | None, method: str, folder: Path, some: Sequence[tuple[Recording, Stances]], repeats: int
) -> Iterator[dict[str, Any] | str]:
    """Run another program in its own process; yield what it made of each walk, or words in place of it."""
    for k, (recording, stances) in enumerate(some):
        mag = np.zeros_like(recording.acc) if recording.mag is None else recording.mag.copy()
        seen = np.isfinite(mag).all(axis=1)  # a field is held until the next sample
        mag = mag[np.maximum.accumulate(np.where(seen, np.arange(len(mag)), np.argmax(seen)))]
        samples: dict[str, Any] = {"t": recording.t, "acc": recording.acc, "gyr": recording.gyr, "mag": mag}
        samples |= {"still": stances.mask, "repeats": repeats}
        np.savez(folder / f"input-{k:03}.npz", **samples)
    words = "no --python"
    if python is not None:
        runner = Path(__file__).with_name("peer_runner.py")
        ran = subprocess.run([python, runner, method, folder], capture_output=True, text=True, check=False)
        words = (ran.stderr.strip().splitlines() or ["no word"])[-1][:200]
    for k in range(len(some)):
        path = folder / f"output-{k:03}.npz"
        yield dict(np.load(path)) if path.exists() else words


def measure_errors(recording: Recording, nav_R_body: Rotation, position: Any) -> dict[str, float | None]:
    """Return errors of position and attitude, None where there is nothing to measure."""
    errors, truth = dict[str, float | None].fromkeys(ERRORS), recording.truth
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
        errors["heading_deg"] = float(np.degrees((heading - heading.mean()).std()))
        errors["inclination_deg"] = float(
            np.degrees(np.sqrt(np.mean((2.0 * np.arcsin(np.hypot(x, y).clip(max=1))) ** 2)))
        )
    return errors


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print, and keep what was asked for."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        python=option(None, "the interpreter that has the others", metavar="PYTHON"),
        save=option(False, "keep it for the table in the docs"),
        data=None,
        repeats=3,
    )
    rows = []
    for name in ("vicon", "openshoe", "simulated"):
        try:
            some = list(list_walks(name, Path() if name == "simulated" else walks.data_folder(chosen.data)))
            rows += measure_set(name, some, chosen.python, chosen.repeats)
        except FgNavError as error:
            print(f"{name}: {error}")
    cells = [["-" if value is None else f"{value}" for value in row.values()] for row in rows]
    harness.print_table(tuple(rows[0]), cells)
    if chosen.save:
        harness.write_json(STORE, {"measured": f"{date.today()}", "peers": rows})


if __name__ == "__main__":
    harness.run(main)
