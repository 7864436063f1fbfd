"""How good the estimators are on real walks: errors and verdicts, with a magnetometer, and what each part brings there.

One table of all real sets has every method on the same stances of the same samples:

=========================== ===========================================================================================
`smoother`                  as `fg-nav run`: with the magnetometer where there is one, as recorded
`inertial`, `iez`           the same and the zero-velocity filter, without it
`qsf`, `ma2018`, `aiez`     the papers' filters, tuned, with the magnetometer that the walk itself calibrates
`gtsam iekf`                GTSAM's invariant EKF (`NavStateImuEKF`): attitude, velocity and place, zero velocity in
                            stance, noise of OpenShoe, the gyro bias of the first rest taken off
`gaitmap`                   its error-state filter with RTS smoothing, run by `--python`
`stored`                    of gdlbio: its authors' path by PyShoe with an LSTM detector, laid on the same footprints at
                            the same instants by the same rigid fit
=========================== ===========================================================================================

What each magnetic factor brings: `scripts/plans/magnetic_parts.toml`.

References: Wagstaff, Peretroukhin, Kelly (2017), "Improving foot-mounted inertial navigation through real-time motion
classification"; code at github.com/utiasSTARS/pyshoe. Barrau, Bonnabel (2017), "The invariant extended Kalman filter as
a stable observer".
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import gtsam
import numpy as np
import scipy.io
import walks
from harness import option
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from walks import Real

from experiments import Asked, Column, Experiment, Figures, Found, Table, Task, write_table
from experiments.cost import run_peer
from experiments.worn import list_worn
from fg_nav.arrays import Floats, interpolate_columns
from fg_nav.detection import detect_stances
from fg_nav.detection.rest import find_start
from fg_nav.detection.stance import Stances
from fg_nav.ekf import run_iez
from fg_nav.ekf.core import OPENSHOE
from fg_nav.errors import FgNavError
from fg_nav.evaluation import evaluate
from fg_nav.evaluation.comparison import align, compare_at_footfalls, lift_to_space
from fg_nav.factors.rotation import skew
from fg_nav.lab.campaign.walks import calibrate_on_itself
from fg_nav.lab.consistency import compute_stance_nees
from fg_nav.lab.pyshoe import read_pyshoe_track
from fg_nav.lab.simulation import simulate
from fg_nav.pipeline import prepare_walk, run_method
from fg_nav.recording import RawRecording, Recording
from fg_nav.smoother import SmootherParameters, smooth
from fg_nav.smoother.parameters import PLAIN, WalkParameters
from fg_nav.solution import Solution
from fg_nav.truth import FootprintTruth, TrajectoryTruth
from fg_nav.verdict import UNUSABLE, judge_path
from fg_nav.walk import Options, Walk

# --- real walks ------------------------------------------------------------------------------------------------------

SMOOTHER, INERTIAL, IEZ, IEKF, GAITMAP, STORED = "smoother", "inertial", "iez", "gtsam iekf", "gaitmap", "stored"
FILTERS = ("qsf", "ma2018", "aiez")  # Of the papers.

LABELLED, DETECTED = "vicon, labels", "vicon"
AIR = ", barometer"
MAGNETIC = ("gdin", "running", "openshoe", "mems", "mtig round", "feet")  # Sections whose sensor has a magnetometer.
SECTIONS = (LABELLED, DETECTED, "running", "gdin", "gdlbio", "gdlbio run", "openshoe", "xio", "mti round", "mti stairs",
            "corridor", "mems", f"mems{AIR}", "mtig round", "feet")  # fmt: skip
"""Sets by name; with a barometer they are solved by the smoother without magnetometer alone."""

RMSE, SPACE, NEES, CLOSURE, GROUND, Z = "rmse_2d_m", "rmse_3d_m", "nees", "closure_percent", "ground_m", "z_m"
FIXES = "gnss_m"  # Mean distance to fixes that were not given.
INSIDE, REGION = "inside", 0.95  # Share of the footfalls inside their claimed region, over the ground.


def list_tasks(sections: Sequence[str], measure: Callable[[str, Real], Found], chosen: Namespace) -> list[Task]:
    """All recordings of these sections."""
    data = walks.data_folder(chosen.data)
    return [
        Task(section, one.name, partial(measure, section, one))
        for section in sections
        for one in walks.list_set(data, section.partition(", ")[0], AIR in section)
    ]


def measure_real(python: str | None, section: str, real: Real) -> Found:
    """Run all methods on a recording, each on the same stances."""
    plain = real.prepare(labelled=section == LABELLED)
    recording, stances = plain.recording, plain.stances
    found: dict[str, Any] = {INERTIAL: partial(measure_method, plain, INERTIAL)}
    if AIR in section:
        return found
    found[IEZ] = partial(measure_method, plain, IEZ)
    # with the magnetometer
    if section in MAGNETIC:
        walk = real.prepare(Options())
        found[SMOOTHER] = partial(measure_method, walk, SMOOTHER)
        if walk.field is not None:
            calibrated = calibrate_on_itself(walk)
            found |= {name: partial(measure_method, calibrated, name) for name in FILTERS}
    # others
    found[IEKF] = lambda: measure_solution(plain, run_invariant(recording, stances))
    if python is not None:
        found[GAITMAP] = lambda: measure_path(plain, run_peer(python, "gaitmap, our stances", recording, stances, 1)[2])
    if isinstance(plain.truth, FootprintTruth) and plain.truth.t is not None:
        track = interpolate_columns(plain.truth.t, recording.t, read_pyshoe_track(real.path))
        place, surveyed = lift_to_space(track), lift_to_space(plain.truth.xy)
        error = align(place, surveyed).apply(place) - surveyed
        found[STORED] = {RMSE: float(np.sqrt(np.mean(np.sum(error**2, axis=1))))}
    return found


def measure_method(walk: Walk, method: str) -> Figures:
    """Figures and verdict of a method of ours."""
    solution = run_method(walk, method).solution
    word = judge_path(walk, solution).word
    return {**measure_solution(walk, solution), **{one: int(one == word) for one in WORDS[:3]}}


def measure_solution(walk: Walk, solution: Solution) -> Figures:
    """Figures of a solution: errors where there is a truth, else the end of a walk that ends where it began."""
    metrics: Mapping[str, Any] = evaluate(solution, walk.truth).as_dict()
    names = (RMSE, SPACE, "scale", CLOSURE, "strides_detected")
    found: dict[str, Any] = {name: metrics[name] for name in names if metrics.get(name) is not None}
    if walk.truth is None:
        return found | measure_end(solution)
    if isinstance(walk.truth, TrajectoryTruth):
        found[NEES] = compute_stance_nees(solution.stances, walk.truth).median_ratio
    if len(solution.stances) < 4:  # too few to be laid on a truth
        return found
    compared = compare_at_footfalls(solution, walk.truth, "yaw")
    row = np.abs(solution.stances.t[:, None] - compared.t).argmin(axis=0)  # footfalls at the compared points
    error, covariance = compared.error[:, :2], solution.stances.position_cov[row, :2, :2]
    squared = np.einsum("ki,kij,kj->k", error - error[0], np.linalg.pinv(covariance), error - error[0])
    return {**found, INSIDE: float(np.mean(squared[1:] < chi2.ppf(REGION, 2)))}


def measure_end(solution: Solution) -> dict[str, float]:
    """Measure the last footfall from the first, m, and over its sigmas."""
    table = solution.stances
    move, covariance = table.position[-1] - table.position[0], table.position_cov[-1]
    squared = move[:2] @ np.linalg.pinv(covariance[:2, :2]) @ move[:2]
    found = {GROUND: np.hypot(*move[:2]), Z: move[2], "ground_ratio": np.sqrt(squared / 2)}
    found |= {"z_ratio": move[2] / np.sqrt(covariance[2, 2]), INSIDE: squared < chi2.ppf(REGION, 2)}
    return {name: float(value) for name, value in found.items()}


def measure_path(walk: Walk, position: Floats) -> Figures:
    """Figures of another program's path (N, 3) m, which has no sigmas."""
    ours = run_iez(walk.recording, walk.stances)
    table = replace(ours.stances, position=position[ours.stances.sample])
    found = measure_solution(walk, replace(ours, position=position, stances=table))
    return {name: value for name, value in found.items() if name in (RMSE, SPACE, "scale", CLOSURE, GROUND, Z)}


def run_invariant(recording: Recording, stances: Stances) -> Solution:
    """Left-invariant EKF of GTSAM, updated by zero velocity at every sample of a stance."""
    start, noise, identity = find_start(recording, stances), OPENSHOE, np.eye(3)
    params = gtsam.PreintegrationParams.MakeSharedU(noise.gravity)
    params.setAccelerometerCovariance(identity * noise.acc_density**2)
    params.setGyroscopeCovariance(identity * np.radians(noise.gyr_density_deg) ** 2)
    params.setIntegrationCovariance(identity * 1e-8**2)
    # start: levelled; heading and place are the gauge
    tilt = np.radians(noise.tilt_sigma_rest_deg if start.levelled_at_rest else noise.tilt_sigma_deg)
    R, covariance = start.nav_R_body, np.diag([0.0] * 6 + [1e-4] * 3)
    covariance[:3, :3] = R.T @ np.diag([tilt, tilt, 1e-4]) ** 2 @ R
    state = gtsam.NavState(gtsam.Rot3(R), np.zeros(3), np.zeros(3))
    ekf = gtsam.NavStateImuEKF(state, covariance + 1e-12 * np.eye(9), params)
    gyr = recording.gyr - (0.0 if start.rest is None else start.rest.rate)
    # pass
    n, steps, stands = len(recording), np.diff(recording.t, append=recording.t[-1] + recording.period_s), stances.mask
    position, nav_R_body, covariances = np.zeros((n, 3)), np.tile(R, (n, 1, 1)), np.zeros((n, 3, 3))
    H, stance_noise = np.hstack([np.zeros((3, 6)), identity]), noise.zero_velocity_density**2 * identity
    for k in range(start.row, n):
        if stands[k]:
            velocity = ekf.state().attitude().unrotate(ekf.state().velocity())
            H[:, :3] = skew(velocity)
            ekf.updateWithVector(velocity, H, np.zeros(3), stance_noise / steps[k])
        nav_R_body[k], position[k] = ekf.state().attitude().matrix(), ekf.state().position()
        covariances[k] = nav_R_body[k] @ ekf.covariance()[3:6, 3:6] @ nav_R_body[k].T
        ekf.predict(gyr[k], recording.acc[k], steps[k])
    ours = run_iez(recording, stances)
    rows = ours.stances.sample
    table = replace(ours.stances, position=position[rows], nav_R_body=nav_R_body[rows], position_cov=covariances[rows])
    return replace(ours, method=IEKF, position=position, nav_R_body=nav_R_body, stances=table)


PYSHOE = {(RMSE, "mean"): 0.079, (RMSE, "median"): 0.055, (SPACE, "mean"): 0.131, (SPACE, "median"): 0.087}
"""Errors in m of PyShoe's own filter with the same labels on the same trials, `vicon, labels`."""

# --- table of all real sets ------------------------------------------------------------------------------------------

MEAN, END = "mean / median", "start to end"
SUMMARY: Mapping[str, tuple[str, str]] = {
    LABELLED: ("motion-captured trials, labelled stances (`vicon`)", RMSE),
    DETECTED: ("the same, own stances", RMSE),
    "gdin": ("surveyed footprints, 35 to 150 m (`gdin`)", RMSE),
    "running": ("the same with running", RMSE),
    "gdlbio": ("every footprint surveyed, 10 to 120 m (`gdlbio`)", RMSE),
    "gdlbio run": ("runs, or gyroscope clipped (`gdlbio`)", RMSE),
    "openshoe": ("loops of 78 m (`openshoe`)", GROUND),
    "xio": ("loops of 25 and 60 m (`xio`)", GROUND),
    "mti round": ("rounds of 43 m at 100 Hz (`mti1_loops`)", GROUND),
    "mti stairs": ("stairs up and down, 100 Hz (`mti1_loops`)", GROUND),
    "corridor": ("a corridor to and fro, 89 m (`corridor_lab`)", GROUND),
    "mems": ("laps, squares, rectangles of 38 to 365 m, raw MEMS (`mems_foot`)", GROUND),
    "mtig round": ("a round of 180 m, 400 Hz, gyroscope clipped (`mtig710`)", GROUND),
    "feet": ("rectangles of 16 m, circles of 11 m (`feet_thighs`)", GROUND),
    "two feet, captured": ("both feet in one graph, motion capture (`two_feet`); beside: each alone", RMSE),
    "two feet": ("both feet in one graph, the same rectangles and circles; beside: each alone", GROUND),
    "pocket": ("phones in a trouser pocket beside GNSS, 290 to 1000 m (`pocket_gnss`)", FIXES),
}
"""Sections, what they are, and the figure, m: rmse beside a truth, distance from start to end or to fixes."""


HEADLINE = (LABELLED, "gdin", "gdlbio", "gdlbio run", "openshoe", "mti round", "mti stairs", "mems", "pocket")
"""Sections of README's table."""


def write_sets(sections: Sequence[str], table: Table) -> list[str]:
    """Write a row each set: mean / median of each method; of the papers' filters the best by the median.

    Without a magnetometer the smoother is `inertial`.
    """
    heads = ["m", "walks", SMOOTHER, INERTIAL, IEZ, "best paper filter", "PyShoe", GAITMAP, IEKF]
    rows = []
    for section in [one for one in sections if one in table.sections]:
        words, figure = SUMMARY[section]
        write = partial(Column(figure, "", MEAN, "{:.3f}" if figure == RMSE else "{:.2f}").write, table, section)
        known = {name: np.median(some) for name in FILTERS if len(some := table.values(section, name, figure))}
        best = min(known, key=lambda name: known[name], default="")
        pyshoe = " / ".join(f"{PYSHOE[figure, how]:.3f}" for how in MEAN.split(" / ")) if section == LABELLED else ""
        ours = write(SMOOTHER) or write("together") or write("sensor") or write(INERTIAL)
        cells = [ours, write(INERTIAL) or write("alone"), write(IEZ), f"{write(best)} {best}".strip()]
        cells += [pyshoe or write(STORED), write(GAITMAP), write(IEKF)]
        number = len({row["walk"] for row in table.select(section).rows})
        end = f", {END}" if figure == GROUND else ""
        rows.append([f"{words}{end}", f"{number}", *(cell or "-" for cell in cells)])
    return write_table(heads, rows)


# --- without one part ------------------------------------------------------------------------------------------------

DEFAULT = SmootherParameters()
PARTS: Mapping[str, SmootherParameters] = {
    "default": DEFAULT,
    "no lever": replace(DEFAULT, known_lever=(0.0, 0.0, 0.0)),
    "rolling trusted": replace(DEFAULT, roll_sigma_m=0.05, gyr_density_deg_s=0.015),
    "no stance refused": replace(DEFAULT, refuse_stances=False),
    "moving foot not counted": replace(DEFAULT, moving_foot=False),
    "swing noise as given": replace(DEFAULT, choose_swing_noise=False),
    "swing noise of simulated sensors": replace(DEFAULT, choose_swing_noise=False, gyr_relative_density=2e-4),
    "bias walk as given": replace(DEFAULT, choose_bias_walk=False),
    "no floors": replace(DEFAULT, walk=WalkParameters(floors=False)),
    "no floors, 1.5 mm a sole": replace(DEFAULT, settling_m=0.0015, walk=WalkParameters(floors=False)),
    "plain zero velocity": PLAIN,
    "one node a stance": replace(DEFAULT, shortest_interval_s=1e3),  # no interval is as long
    "nodes 0.05 s apart": replace(DEFAULT, node_spacing_s=0.05),
    "nodes 0.1 s apart": replace(DEFAULT, node_spacing_s=0.1),
}
"""The smoother without one of its parts."""

PART_SECTIONS = (LABELLED, "gdin", "gdlbio", "gdlbio run", "openshoe", "xio")
PART_COLUMNS = [Column(RMSE, "rmse 2-D (m)", MEAN), Column(SPACE, "3-D (m)", MEAN), Column("scale", "scale", "median"),
                Column(NEES, "NEES", "median"), Column(CLOSURE, "closure (%)", "median")]  # fmt: skip


def measure_parts(parts: Sequence[str], section: str, real: Real) -> Found:
    """Smooth a walk without one of the parts, each in turn."""
    walk = real.prepare(labelled=section == LABELLED)

    def measure(part: str) -> Figures:
        return measure_solution(walk, smooth(walk.recording, walk.stances, parameters=PARTS[part]))

    return {part: partial(measure, part) for part in parts}


# --- verdicts --------------------------------------------------------------------------------------------------------

TRUSTED, DOUBTFUL, REFUSED = "trusted", "doubtful", "refused"
WORDS = (TRUSTED, DOUBTFUL, UNUSABLE, REFUSED)
GOOD, ELSEWHERE, MTI1 = "good", "worn elsewhere", "mti1_loops"
CLIPPED, THIN, LOOSE, CROSSED = "clipped", "20 Hz", "loose", "wrong axes"
WRONGLY = "wrong, trusted"
NO_WALKS = ("by hand", "crawling", ELSEWHERE, "high-passed", THIN, LOOSE, CROSSED)
ENDS_AT_START = ("square", "rectangle", "large", "c_shape", "lap_360", "five_small", "hallway", "stairs",
                 "lab_corridor", "openshoe", "xio")  # fmt: skip
SEGMENTS = ("upper_leg_left", "upper_leg_right", "hand_right", "forearm_left", "head", "hip")
OTHERS: Mapping[str, str] = {
    "mti round": MTI1, "mti stairs": MTI1, "gdlbio run": "gdlbio run", "all of mems": "mems_foot", "mtig": "mtig710",
    "corridor": "corridor_lab", "by hand": "by hand", "crawling": "crawling", "leg": ELSEWHERE,
}  # fmt: skip
"""Kind of each set but the good ones."""
SIMULATED_SEEDS = range(301, 308)

Load = Callable[[], RawRecording]


def list_verdicts(chosen: Namespace) -> list[Task]:
    """All recordings, good ones first."""
    data = walks.data_folder(chosen.data)
    simulated = [(f"simulated {seed}", partial(simulate_demo, seed)) for seed in SIMULATED_SEEDS]
    sets = ("vicon", "gdin", "running", "gdlbio", "openshoe", "xio")
    real = [one for name in sets for one in walks.list_set(data, name) if not one.name.startswith("2018-02-09")]
    cases: list[tuple[str, str, Load]] = [(GOOD, one.name, one.read_raw) for one in real]
    cases += [(GOOD, *one) for one in simulated]
    for name, kind in OTHERS.items():
        for one in (one for one in walks.list_set(data, name) if "still" not in one.name):
            cases.append(("high-passed" if one.name == "lap_high_passed" else kind, one.name, one.read_raw))
    cases += [(ELSEWHERE, segment, partial(read_segment, data, segment)) for segment in SEGMENTS]
    for k, one in enumerate(real[::8][:6]):
        cases += [(kind, one.name, partial(spoil, kind, k, one.read_raw)) for kind in (CLIPPED, THIN, CROSSED)]
        cases.append((LOOSE, simulated[k][0], partial(spoil, LOOSE, k, simulated[k][1])))
    return [Task(kind, name, partial(judge_walk, name, load, chosen.methods)) for kind, name, load in cases]


def judge_walk(name: str, load: Load, methods: Sequence[str]) -> Found:
    """Estimate a recording by each method: word, reasons, error and sigma of the end and the way, m."""

    def judge(method: str) -> Figures:
        try:
            walk = prepare_walk(Walk.of(Recording.from_raw(load()), Options(mount="foot")))
            outcome = run_method(walk, method)
            verdict = judge_path(walk, outcome.solution)
        except FgNavError as refusal:
            return {**dict.fromkeys(WORDS, 0), REFUSED: 1, "reasons": str(refusal)}
        table, error = outcome.solution.stances, outcome.metrics.end_error_m
        if error is None and any(word in name for word in ENDS_AT_START):
            error = float(np.hypot(*(table.position[-1] - table.position[0])[:2]))
        way = float(np.hypot(*np.diff(table.position[:, :2], axis=0).T).sum())
        sigma = float(np.hypot(*table.position_sigma[-1, :2]))
        wrong = error is not None and (error > 3.0 * np.hypot(sigma, 0.01 * way / 3.0) or error > 0.1 * way)
        words = {word: int(verdict.word == word) for word in WORDS}
        return {**words, "error_m": error, "sigma_m": sigma, "way_m": way, "wrong": int(wrong),
                WRONGLY: int(wrong and verdict.word == TRUSTED), "reasons": "; ".join(verdict.reasons)}  # fmt: skip

    return {method: judge(method) for method in methods}


def read_segment(data: Path, name: str) -> RawRecording:
    """Read the sensor of one segment of the whole body."""
    body = scipy.io.loadmat(data / "qmt_fullbody" / "full_body_example_data.mat", simplify_cells=True)
    within = (body["t"] >= 40.0) & (body["t"] <= 140.0)
    acc, gyr = (np.asarray(body[name][sensor], dtype=np.float64)[within] for sensor in ("acc", "gyr"))
    return RawRecording(body["t"][within] - body["t"][within][0], acc, gyr, np.arange(len(acc)))


def simulate_demo(seed: int) -> RawRecording:
    """Simulate a good walk."""
    recording = simulate("demo", seed).recording
    return RawRecording(recording.t, recording.acc, recording.gyr, np.arange(len(recording)), truth=recording.truth)


SLACK_RAD, RING_HZ, RING_S = np.radians(8.0), 9.0, 0.15  # Of a loose sensor: how far it turns, and how it rings.


def spoil(kind: str, k: int, load: Load) -> RawRecording:
    """Read a recording and spoil it; `k` draws how."""
    raw = load()
    # gyroscope and accelerometer cut at half of the largest reading of any axis
    if kind == CLIPPED:
        acc, gyr = (np.clip(x, -0.5 * np.abs(x).max(), 0.5 * np.abs(x).max()) for x in (raw.acc, raw.gyr))
        return replace(raw, acc=acc, gyr=gyr)
    # a sensor of 20 Hz, each sample the reading of an instant
    if kind == THIN:
        kept = np.s_[:: max(1, round(1.0 / (20.0 * float(np.median(np.diff(raw.t))))))]
        return replace(raw, t=raw.t[kept], acc=raw.acc[kept], gyr=raw.gyr[kept], row=raw.row[kept])
    # a gyroscope with other axes than the accelerometer
    if kind == CROSSED:
        return replace(raw, gyr=raw.gyr @ (-np.eye(3), np.eye(3)[[1, 0, 2]], np.diag([1.0, 1.0, -1.0]))[k % 3])
    # a sensor that turns on the shoe to another angle within its slack in each swing, and rings as it comes to rest
    rng, stances = np.random.default_rng(k), detect_stances(Recording.from_raw(raw))
    slack, angle = np.zeros((len(raw.t), 3)), np.zeros(3)
    for start, stop in zip(stances.stop[:-1], stances.start[1:], strict=True):
        target = SLACK_RAD * rng.uniform(-1.0, 1.0, 3)
        share = np.linspace(0.0, 1.0, stop - start)[:, None]
        slack[start:stop] = angle + (target - angle) * (3 - 2 * share) * share**2
        slack[stop:] = target
        late = raw.t[stop:] - raw.t[stop]
        ring = 0.5 * SLACK_RAD * np.exp(-late / RING_S) * np.sin(2 * np.pi * RING_HZ * late)
        slack[stop:] += ring[:, None] * rng.uniform(-1.0, 1.0, 3)
        angle = target
    body_R_loose = Rotation.from_rotvec(slack)
    step = (body_R_loose[:-1].inv() * body_R_loose[1:]).as_rotvec() / np.diff(raw.t)[:, None]
    gyr = body_R_loose.inv().apply(raw.gyr) + np.vstack([step, np.zeros(3)])
    return replace(raw, acc=body_R_loose.inv().apply(raw.acc), gyr=gyr)


EXPERIMENTS: Mapping[str, Experiment] = {
    "real-walks": Experiment(
        """All real sets, every method on the same stances: feet, pairs of feet, trouser pockets.

        rmse after yaw and position alignment, of footprints after a rigid fit; NEES of the stance positions over its
        expectation. Of closed walks the distance from the first footfall to the last over the ground and up, m, and
        over their sigmas (root mean square: 1 where these are as claimed). Inside: share of the footfalls, or of the
        ends, inside the claimed 95 % region. Pockets: mean distance to fixes, the path laid on those of the first
        10 % of the time, or every second one given. Nothing is set by walk. `smoother` has the magnetometer where
        there is one; qsf, ma2018 and aiez have it calibrated by the walk itself; labels are PyShoe's.""",
        lambda chosen: list_tasks(SECTIONS, partial(measure_real, chosen.python), chosen) + list_worn(chosen),
        (
            *(
                Column(figure, head, f"{MEAN} / p95")
                for figure, head in (
                    (RMSE, "rmse 2-D (m)"),
                    (SPACE, "3-D (m)"),
                    (GROUND, "end (m)"),
                    (Z, "z (m)"),
                    (FIXES, "fixes (m)"),
                )
            ),
            Column("ground_ratio", "end / sigma", "rms", "{:.2f}"),
            Column("z_ratio", "z / sigma", "rms", "{:.2f}"),
            Column(NEES, "NEES", "median", "{:.2f}"),
            Column("scale", "scale", "median", "{:.4f}"),
            Column(CLOSURE, "closure (%)", MEAN, "{:.2f}"),
            Column(INSIDE, "inside", "mean", "{:.2f}"),
            *(Column(word, word, "sum", "{:.0f}") for word in WORDS[:3]),
        ),
        [Asked(key, how, high=high, section=LABELLED, variant=INERTIAL) for (key, how), high in PYSHOE.items()],
        options={"python": option(None, "the interpreter that has gaitmap", metavar="PYTHON")},
        blocks={"real-walks": partial(write_sets, list(SUMMARY)), "accuracy": partial(write_sets, HEADLINE)},
    ),
    "parts": Experiment(
        """The smoother without one of its parts, on the same real walks.

        Errors are mean / median over the walks, the other figures medians.""",
        lambda chosen: list_tasks(PART_SECTIONS, partial(measure_parts, chosen.parts), chosen),
        PART_COLUMNS,
        options={"parts": option(list(PARTS), "variants", nargs="+", choices=tuple(PARTS), metavar="NAME")},
    ),
    "verdicts": Experiment(
        """Verdicts on walks, with the error of their paths, and on recordings that are no walk or were spoiled.

        Good: vicon (ordinary trials), gdin, gdlbio walked, openshoe, xio; simulated walks. By hand: BROAD, a sensor
        that is turned and moved by hand. Crawling: vicon 2018-02-09, with ladders. Worn elsewhere: qmt_fullbody, thigh,
        hand, forearm, head, hip; a phone in a trouser leg. Clipped: gyroscope and accelerometer cut at half of the
        largest reading. 20 Hz: one sample in ten. Loose: a simulated sensor that turns on the shoe by some degrees in
        every swing and rings after it. Wrong axes: the gyroscope negated, two axes exchanged, or one negated.

        A spoiled recording goes through the door of a file (`Recording.from_raw`) and may be refused there. The error
        is that of the end, over the ground: from the truth, or of a walk that ends where it began from the start. A
        path is wrong where it is off by a tenth of the way, or by three sigmas and 1 % of the way.""",
        list_verdicts,
        tuple(Column(word, word, "sum", "{:.0f}") for word in (*WORDS, "wrong", WRONGLY)),
        [
            Asked(TRUSTED, "mean", 0.95, section=GOOD),
            Asked(WRONGLY, "sum", high=0, pattern="{:.0f}"),
            *(Asked(TRUSTED, "sum", high=1, section=kind, pattern="{:.0f}") for kind in NO_WALKS),
        ],
        options={"methods": ["smoother"]},
    ),
}
