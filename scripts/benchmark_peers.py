"""Other programs beside ours on the same samples: how fast, how far off, and what each leaves out.

    python scripts/benchmark.py --peers PYTHON [--save] [--repeats N] [--data DIR]

============ ======================================================================================================
vicon        28 trials of a foot with motion capture; stances by PyShoe's labels for all that take stances
openshoe     3 loops that end where they began; our stances
simulated    6 walks of the scenario `demo`, a minute each, indoor field; our stances, and the true attitude
broad        6 hand-moved trials with an optical truth; orientation alone (`broad_orientation.py`)
============ ======================================================================================================

All have the samples as they were recorded and default parameters; the magnetometer where they use one. `PYTHON` is an
interpreter in which the others are installed (`pip install gaitmap vqf imufusion`), in its own process, as they need
other versions than ours; one that is not there has a row that says so. Time is of the processor, the least of the
repeats behind a first call, as a multiple of the bare loop (`benchmark.py`) on the same samples in the same run.

Errors: position, rms over the samples of what a rotation about up and a shift leave, over the ground and in space;
openshoe, distance from start to end. Attitude, rms over the samples: heading with its mean off, and inclination.
"""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import broad_orientation as broad
import harness
import numpy as np
import walks
from benchmark import run_bare_loop
from harness import FIRST_SEED, measure_time
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Bools, Floats
from fg_nav.detection import detect_stances
from fg_nav.detection.stance import Stances
from fg_nav.ekf import run_iez
from fg_nav.errors import FgNavError
from fg_nav.evaluation.comparison import align, interpolate_truth
from fg_nav.lab.follow_pocket import follow_pocket
from fg_nav.lab.simulation import simulate
from fg_nav.pipeline import prepare_walk, run_method
from fg_nav.pocket.iterated_smoother import PocketSmootherParameters, smooth_pocket
from fg_nav.recording import Recording
from fg_nav.smoother import smooth
from fg_nav.truth import TrajectoryTruth
from fg_nav.walk import Options, Walk

RUNNER = Path(__file__).with_name("peer_runner.py")

SIMULATED = 6

LEFT_OUT: Mapping[str, str] = {
    "fg-nav smoother": "-",
    "fg-nav iez": "smoothing, field",
    "gaitmap": "gyro bias, field, gaps, clipping, verdict; the ground is level",
    "vqf": "position, sigmas of attitude",
    "imufusion": "position, sigmas, all that follows a sample",
    "fg-nav pocket": "-",
    "fg-nav pocket, causal": "all that follows a sample",
}
"""What a program has no answer to, by the beginning of its name."""


@dataclass(frozen=True)
class Found:
    """What a program made of a walk: attitude (N,), `position` (N, 3) m and `bias` (N, 3) rad/s where it has them."""

    seconds: float
    nav_R_body: Rotation
    position: Floats | None = None
    bias: Floats | None = None
    version: str = ""


@dataclass(frozen=True)
class Row:
    """Of the table: medians over the walks of a set; None where there is nothing to measure, or nobody to do it."""

    set: str
    method: str
    version: str
    walks: int
    over_bare: float | None = None
    us_a_sample: float | None = None
    rmse_2d_m: float | None = None
    rmse_3d_m: float | None = None
    closure_m: float | None = None
    heading_deg: float | None = None
    inclination_deg: float | None = None
    missing: str = ""
    leaves_out: str = ""


@dataclass(frozen=True)
class Job:
    """A walk of a set, and who runs on it: ours by name, others by their names in `peer_runner.RUNS`."""

    name: str
    recording: Recording
    still: Bools
    ours: Mapping[str, Callable[[], Found]]
    peers: Sequence[str]
    nav_R_true: Rotation | None = None
    moving: Bools | None = None


# --- sets ------------------------------------------------------------------------------------------------------------


def list_vicon(data: Path) -> Iterator[Job]:
    """Yield the trials."""
    for walk in (one.read_labelled() for one in walks.list_set(data, "vicon")):
        yield _foot_job(walk.name, walk.recording, walk.stances)


def list_openshoe(data: Path) -> Iterator[Job]:
    """Yield the loops."""
    for walk in (one.read() for one in walks.list_set(data, walks.OPENSHOE)):
        yield _foot_job(walk.name, walk.recording, walk.stances)


def _foot_job(name: str, recording: Recording, stances: Stances) -> Job:
    ours = {
        "fg-nav smoother": lambda: _of_solution(smooth(recording, stances)),
        "fg-nav iez": lambda: _of_solution(run_iez(recording, stances)),
    }
    return Job(name, recording, stances.mask, ours, ("gaitmap", "gaitmap, our stances"))


def list_simulated(data: Path | None) -> Iterator[Job]:
    """Yield simulated walks, of which the attitude is known."""
    for seed in range(FIRST_SEED, FIRST_SEED + SIMULATED):
        recording = simulate("demo", seed).recording
        truth, stances = recording.truth, detect_stances(recording)
        assert isinstance(truth, TrajectoryTruth)
        assert truth.nav_R_body is not None
        job = _foot_job(f"demo {seed}", recording, stances)
        ours = {**job.ours, "fg-nav smoother": lambda recording=recording: _navigate(recording)}
        peers = (*job.peers, "vqf", "vqf offline", "imufusion")
        yield replace(job, ours=ours, peers=peers, nav_R_true=Rotation.from_matrix(truth.nav_R_body))


def _navigate(recording: Recording) -> Found:
    """With the magnetometer, as the filters of orientation have it."""
    return _of_solution(run_method(prepare_walk(Walk.of(recording, Options())), "smoother").solution)


def list_broad(data: Path) -> Iterator[Job]:
    """Yield the hand-moved trials."""
    for trial in broad.read_trials(data):
        held = broad.hold_rates(trial.recording)
        parameters = PocketSmootherParameters(mag_sigma_uT=broad.field_sigma_uT(trial))
        ours = {
            "fg-nav pocket": lambda held=held, given=parameters: _of_track(smooth_pocket(held, given)),
            "fg-nav pocket, causal": lambda held=held, given=parameters: _of_track(follow_pocket(held, given)),
        }
        recording = replace(trial.recording, mag=trial.field)
        still = np.zeros(len(recording), dtype=np.bool_)
        peers = ("vqf offline", "vqf", "imufusion")
        yield Job(trial.name, recording, still, ours, peers, trial.nav_R_true, trial.moving)


def _of_solution(solution) -> Found:
    return Found(0.0, Rotation.from_matrix(solution.nav_R_body), solution.position)


def _of_track(track) -> Found:
    return Found(0.0, Rotation.from_matrix(track.nav_R_body), bias=track.gyro_bias)


SETS: Mapping[str, Callable[[Path], Iterator[Job]]] = {
    "vicon": list_vicon,
    "openshoe": list_openshoe,
    "simulated": list_simulated,
    "broad": list_broad,
}

# --- measuring -------------------------------------------------------------------------------------------------------


def measure_set(name: str, jobs: Sequence[Job], python: str | None, repeats: int) -> list[Row]:
    """Run all programs on the walks of a set; a row each."""
    bare_s = [min(measure_time(partial(run_bare_loop, job.recording))[0].cpu for _ in range(repeats)) for job in jobs]
    found = {method: [_run_ours(job.ours[method], repeats) for job in jobs] for method in jobs[0].ours}
    with tempfile.TemporaryDirectory() as folder:
        for k, job in enumerate(jobs):
            write_input(Path(folder) / f"input-{k:03}.npz", job, repeats)
        found |= {method: run_peer(python, method, Path(folder), len(jobs)) for method in jobs[0].peers}
    return [
        _summarize([_judge(name, method, *of) for of in zip(jobs, made, bare_s, strict=True)])
        for method, made in found.items()
    ]


def _judge(name: str, method: str, job: Job, found: Found | str, bare_s: float) -> Row:
    if isinstance(found, str):
        return Row(name, method, "", 1, missing=found)
    row = Row(name, method, found.version, 1, found.seconds / bare_s, 1e6 * found.seconds / len(job.recording))
    row = replace(row, leaves_out=describe_scope(method))
    return replace(row, **_position_errors(job.recording, found), **_attitude_errors(job, found))


def _run_ours(call: Callable[[], Found], repeats: int) -> Found | str:
    try:
        found = call()
        seconds = min(measure_time(call)[0].cpu for _ in range(repeats))
    except FgNavError as error:
        return str(error)
    return replace(found, seconds=seconds)


def write_input(path: Path, job: Job, repeats: int) -> None:
    """Write what `peer_runner` is given."""
    recording = job.recording
    mag = np.zeros((len(recording), 3)) if recording.mag is None else hold_field(recording.mag)
    samples = {"t": recording.t, "acc": recording.acc, "gyr": recording.gyr, "mag": mag}
    np.savez(path, **samples, still=job.still, repeats=repeats)


def run_peer(python: str | None, method: str, folder: Path, count: int) -> list[Found | str]:
    """Run another program on the inputs of a folder, in its own process; words in place of what did not come."""
    if python is None:
        return ["no --peers"] * count
    ran = subprocess.run([python, RUNNER, method, folder], capture_output=True, text=True, check=False)
    words = (ran.stderr.strip().splitlines() or ["no word"])[-1][:200]
    outputs = [folder / f"output-{method}-{k:03}.npz" for k in range(count)]
    return [_read_output(path) if path.exists() else words for path in outputs]


def _read_output(path: Path) -> Found:
    of = dict(np.load(path))
    attitude = Rotation.from_quat(of["quaternion"])
    return Found(float(of["seconds"]), attitude, of.get("position"), of.get("bias"), str(of["version"]))


def hold_field(mag: Floats) -> Floats:
    """Hold samples (N, 3) of a magnetometer until the next."""
    seen = np.isfinite(mag).all(axis=1)
    last = np.maximum.accumulate(np.where(seen, np.arange(len(mag)), 0))
    return np.asarray(np.where(seen.any(), mag[np.maximum(last, np.argmax(seen))], 0.0))


def _position_errors(recording: Recording, found: Found) -> dict[str, float]:
    if found.position is None:
        return {}
    if not isinstance(recording.truth, TrajectoryTruth):
        return {"closure_m": float(np.linalg.norm(found.position[-1] - found.position[0]))}
    row, true = interpolate_truth(recording.truth, recording.t)
    error = align(found.position[row], true).apply(found.position[row]) - true
    of = {"rmse_2d_m": error[:, :2], "rmse_3d_m": error}
    return {name: float(np.sqrt((part**2).sum(axis=1).mean())) for name, part in of.items()}


def _attitude_errors(job: Job, found: Found) -> dict[str, float]:
    if job.nav_R_true is None:
        return {}
    n = len(job.recording)
    moving = np.ones(n, dtype=np.bool_) if job.moving is None else job.moving
    trial = SimpleNamespace(moving=moving, nav_R_true=job.nav_R_true, bias=np.zeros(3))
    errors = broad.errors_of(trial, broad.Estimate(found.nav_R_body, np.zeros((n, 3))))
    return {"heading_deg": errors["heading"], "inclination_deg": errors["inclination"]}


NUMBERS = ("over_bare", "us_a_sample", "rmse_2d_m", "rmse_3d_m", "closure_m", "heading_deg", "inclination_deg")


def _summarize(some: Sequence[Row]) -> Row:
    """Medians over walks; what is missing on one is said."""
    there = [row for row in some if not row.missing]
    if not there:
        return some[0]
    middle = {}
    for name in NUMBERS:
        values = [getattr(row, name) for row in there]
        middle[name] = None if None in values else float(f"{np.median(values):.4g}")
    failed = len(some) - len(there)
    return replace(there[0], **middle, walks=len(there), missing=f"{failed} failed" if failed else "")


def describe_scope(method: str) -> str:
    """Say what a program leaves out."""
    return next(words for name, words in reversed(LEFT_OUT.items()) if method.startswith(name))


def measure_peers(sets: Sequence[str], data: Path | None, python: str | None, repeats: int) -> list[Row]:
    """Run all programs on all sets; those without their recordings are left out, and said to be."""
    rows: list[Row] = []
    for name in sets:
        try:
            jobs = list(SETS[name](walks.data_folder(data) if name != "simulated" else Path()))
        except FgNavError as error:
            print(f"{name}: {error}")
            continue
        rows += measure_set(name, jobs, python, repeats)
    return [*rows, Row("simulated", "pyins", "", 0, missing="not on the package index")]


HEADERS = ("set", "program", "walks", "over bare loop", "us a sample", "2-D, m", "3-D, m", "closure, m", "heading, deg",
           "inclination, deg", "leaves out")  # fmt: skip


def table_rows(rows: Sequence[Row]) -> Iterator[list[str]]:
    """Yield the cells of the table."""
    for row in rows:
        numbers = [getattr(row, name) for name in NUMBERS]
        cells = ["-" if value is None else harness.format_number(value, "{:.3g}") for value in numbers]
        scope = f"missing: {row.missing}" if row.over_bare is None else row.leaves_out
        yield [row.set, f"{row.method} {row.version}".strip(), str(row.walks), *cells, scope]


def print_peers(rows: Sequence[Row]) -> None:
    """Print the table."""
    harness.print_heading("Other programs on the same samples")
    harness.print_table(HEADERS, table_rows(rows))
