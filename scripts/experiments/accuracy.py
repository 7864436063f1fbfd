"""How good the estimators are on real walks: errors and verdicts, with a magnetometer, and what each part brings there.

`inertial` is the smoother without a magnetometer, `iez` the zero-velocity filter. `stored`, of gdlbio, is the path that
the authors of the set had from PyShoe with its LSTM detector, laid on the same footprints at the same instants by the
same rigid fit as ours. What each magnetic factor brings: `scripts/plans/magnetic_parts.toml`.

References: Wagstaff, Peretroukhin, Kelly (2017), "Improving foot-mounted inertial navigation through real-time motion
classification"; code at github.com/utiasSTARS/pyshoe.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
import walks
from harness import option
from scipy.spatial.transform import Rotation
from walks import Real

from experiments import Asked, Column, Experiment, Figures, Found, Table, Task, write_table
from fg_nav.arrays import interpolate_columns
from fg_nav.detection import detect_stances
from fg_nav.detection.stance import Stances
from fg_nav.ekf import run_iez
from fg_nav.errors import FgNavError
from fg_nav.evaluation import evaluate
from fg_nav.evaluation.comparison import align, lift_to_space
from fg_nav.lab.campaign.walks import RAW, WALK, Recorded
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

Estimate = Callable[[Recording, Stances], Solution]

INERTIAL, IEZ, COMPASS, STORED = "inertial", "iez", "smoother", "stored"
METHODS: Mapping[str, Estimate] = {INERTIAL: smooth, IEZ: run_iez}

LABELLED, DETECTED = "vicon, labels", "vicon"
AIR = ", barometer"
SECTIONS: Mapping[str, Sequence[str]] = {
    LABELLED: ("vicon",),
    **{name: (name,) for name in ("vicon", "running", "gdin", "gdlbio", "gdlbio run")},
    "loops": ("openshoe", "xio"),
    **{name: (name,) for name in ("mti round", "mti stairs", "corridor", "mems", f"mems{AIR}", "mtig", f"mtig{AIR}")},
}
"""Sets of each section; those with a barometer are solved by the smoother alone."""

RMSE, SPACE, NEES, CLOSURE, GROUND, Z = "rmse_2d_m", "rmse_3d_m", "nees", "closure_percent", "ground_m", "z_m"
WORSE_SHARE, WORSE_M = 0.10, 0.03  # by which a walk is worse than by the filter


def list_tasks(sections: Sequence[str], estimates: Mapping[str, Estimate], chosen: Namespace) -> list[Task]:
    """All recordings of these sections, measured with these estimates."""
    data = walks.data_folder(chosen.data)
    return [
        Task(section, one.name, partial(measure_real, section, one, estimates))
        for section in sections
        for name in SECTIONS[section]
        for one in walks.list_set(data, name.removesuffix(AIR), AIR in section)
    ]


def measure_real(section: str, real: Real, estimates: Mapping[str, Estimate]) -> Found:
    """Run the estimates on a recording; beside the filter, what came with it and the smoother with the compass."""
    walk = real.prepare(labelled=section == LABELLED)
    some = {INERTIAL: estimates[INERTIAL]} if AIR in section else estimates
    found: dict[str, Any] = {name: partial(measure_solution, walk, one) for name, one in some.items()}
    if IEZ in some and isinstance(walk.truth, FootprintTruth) and walk.truth.t is not None:
        track = interpolate_columns(walk.truth.t, walk.recording.t, read_pyshoe_track(real.path))
        place, surveyed = lift_to_space(track), lift_to_space(walk.truth.xy)
        error = align(place, surveyed).apply(place) - surveyed
        found[STORED] = {RMSE: float(np.sqrt(np.mean(np.sum(error**2, axis=1))))}
    if IEZ in some and section == walks.GDIN:
        found[COMPASS] = lambda: {RMSE: run_method(real.prepare(Options()), COMPASS).metrics.rmse_2d_m}
    return found


def measure_solution(walk: Walk, estimate: Estimate) -> Figures:
    """Figures of a solution: errors where there is a truth, else the end of a walk that ends where it began."""
    solution = estimate(walk.recording, walk.stances)
    metrics: Mapping[str, Any] = evaluate(solution, walk.truth).as_dict()
    names = (RMSE, SPACE, "scale", CLOSURE, "strides_detected")
    found: dict[str, Any] = {name: metrics[name] for name in names if metrics.get(name) is not None}
    if isinstance(walk.truth, TrajectoryTruth):
        found[NEES] = compute_stance_nees(solution.stances, walk.truth).median_ratio
    if walk.truth is None:
        found |= measure_end(solution)
    return {**found, "verdict": judge_path(walk, solution).word}


def measure_end(solution: Solution) -> dict[str, float]:
    """Measure the last footfall from the first, m, and over its sigmas."""
    table = solution.stances
    move, covariance = table.position[-1] - table.position[0], table.position_cov[-1]
    squared = move[:2] @ np.linalg.pinv(covariance[:2, :2]) @ move[:2] / 2
    found = {GROUND: np.hypot(*move[:2]), Z: move[2], "ground_ratio": np.sqrt(squared)}
    return {name: float(value) for name, value in {**found, "z_ratio": move[2] / np.sqrt(covariance[2, 2])}.items()}


def list_behind(table: Table) -> list[tuple[str, str, float, float]]:
    """Walks on which the smoother is behind the filter: section, walk, and rmse or closure of both, m."""
    found = []
    for section in (one for one in table.sections if AIR not in one):
        ours, theirs = table.of(section, INERTIAL), table.of(section, IEZ)
        for walk, row in ours.items():
            one, other = (float(of.get(RMSE, of.get(GROUND, np.inf))) for of in (row, theirs.get(walk, {})))
            if section == "mtig" and "hallway" not in walk:
                continue  # no round
            if one > other * (1 + WORSE_SHARE) and one > other + WORSE_M:
                found.append((section, walk, one, other))
    return found


PYSHOE = {(RMSE, "mean"): 0.079, (RMSE, "median"): 0.055, (SPACE, "mean"): 0.131, (SPACE, "median"): 0.087}
"""Errors in m of PyShoe's own filter with the same labels on the same trials, `vicon, labels`."""

# --- tables of real walks --------------------------------------------------------------------------------------------

MEAN, WORST = "mean / median", "median / worst"
NAMES = {INERTIAL: "`inertial`", COMPASS: "`smoother`, with the compass", IEZ: "`iez`", STORED: "PyShoe"}
PATTERNS = {"scale": "{:.4f}", NEES: "{:.2f}", CLOSURE: "{:.2f}"}
CLOSED = {
    "mti round": "12 rounds of 43 m at 100 Hz, walked, run, mixed (`mti1_loops`)",
    "mti stairs": "12 walks on stairs of one to three floors, up and down (`mti1_loops`)",
    "corridor": "a corridor to and fro, 89 m (`corridor_lab`)",
    "mems": "13 laps, squares and rectangles of 38 to 365 m (`mems_foot`)",
    f"mems{AIR}": "the same with their barometer",
}


Line = tuple[str, str, str, str]
"""Words, sections (joined by a plus), figure and summary."""

SUMMARY: Sequence[Line] = (
    ("28 motion-captured trials: rmse 2-D, mean / median (m)", LABELLED, RMSE, MEAN),
    ("the same, own stances: rmse 3-D, mean / median / 95 % below (m)", DETECTED, SPACE, f"{MEAN} / p95"),
    ("10 indoor walks of 35 to 150 m (`gdin`): rmse at surveyed footprints, mean / median (m)", "gdin", RMSE, MEAN),
    ("11 indoor walks of 10 to 120 m (`gdlbio`): the same", "gdlbio", RMSE, MEAN),
    ("7 runs, or gyroscope clipped (`gdlbio`): the same", "gdlbio run", RMSE, MEAN),
    ("5 loops of 23 to 78 m: closure in % of the distance, median / worst", "loops", CLOSURE, WORST),
    ("12 rounds of 43 m / 12 walks on stairs, 100 Hz (`mti1_loops`): closure over the ground, mean (m)",
     "mti round+mti stairs", GROUND, "mean"),
    (f"{CLOSED['mems']}: the same, mean / median", "mems", GROUND, MEAN),
)  # fmt: skip
VICON: Sequence[Line] = (
    ("PyShoe's labels as stances: rmse 2-D, mean / median (m)", LABELLED, RMSE, MEAN),
    ("the same, rmse 3-D", LABELLED, SPACE, MEAN),
    ("the same, rmse 3-D, 95 % of the trials below", LABELLED, SPACE, "p95"),
    ("the same, best-fit scale, median", LABELLED, "scale", "median"),
    ("the same, NEES of the positions over its expectation, median", LABELLED, NEES, "median"),
    ("own stances: rmse 2-D, mean / median (m)", DETECTED, RMSE, MEAN),
    ("the same, rmse 3-D, mean / median", DETECTED, SPACE, MEAN),
    ("the same, rmse 3-D, 95 % of the trials below / worst", DETECTED, SPACE, "p95 / worst"),
)


def write_lines(lines: Sequence[Line], table: Table) -> list[str]:
    """Figures of all methods, a line each; methods that no line has are left out."""
    rows = []
    for words, sections, figure, summary in lines:
        column, cells = Column(figure, "", summary, PATTERNS.get(figure, "{:.3f}")), list[str]()
        for variant in NAMES:
            some = [column.write(table, section, variant) for section in sections.split("+")]
            cells.append(" / ".join(one for one in some if one) or "-")
        if sections == LABELLED and summary == MEAN:
            cells[-1] = " / ".join(f"{PYSHOE[figure, how]:.3f}" for how in ("mean", "median"))
        rows.append([words, *cells])
    kept = [k for k in range(5) if k == 0 or any(row[k] != "-" for row in rows)]
    heads = ["", *NAMES.values()]
    return write_table([heads[k] for k in kept], [[row[k] for k in kept] for row in rows])


def write_closed(table: Table) -> list[str]:
    """Ends of closed walks over the ground and up, each over its sigma, and the verdicts."""
    heads = ["", "method", "closure over the ground, mean / worst (m)", "over its sigma, rms",
             "height at the end, mean / worst (m)", "over its sigma, rms", "trusted / doubtful / unusable"]  # fmt: skip
    figures = ((GROUND, "mean / worst"), ("ground_ratio", "rms"), (Z, "mean / worst"), ("z_ratio", "rms"))
    rows = []
    for section, words in CLOSED.items():
        for method in [one for one in (INERTIAL, IEZ) if table.of(section, one)]:
            ends = [Column(key, "", how, "{:.2f}").write(table, section, method) for key, how in figures]
            verdicts = [row.get("verdict") for row in table.of(section, method).values()]
            counts = " / ".join(str(verdicts.count(word)) for word in ("trusted", "doubtful", UNUSABLE))
            rows.append([words, NAMES[method], *ends, counts])
    return write_table(heads, rows, words=2)


def write_passes(table: Table) -> list[str]:
    """Start to end of each recording of mtig."""
    heads = ["recording", "start to end (m)", "z (m)", "with barometer (m)", "z (m)", "`iez` (m)", "verdict"]
    plain, aided, filtered = table.of("mtig", INERTIAL), table.of(f"mtig{AIR}", INERTIAL), table.of("mtig", IEZ)
    rows = []
    for walk, row in plain.items():
        cells = []
        for one in (row, aided[walk]):
            cells += [f"{one[GROUND]:.2f}", f"{one[Z]:+.2f} ± {abs(one[Z] / one['z_ratio']):.2f}"]
        rows.append([f"`{walk}`", *cells, f"{filtered[walk].get(GROUND, np.inf):.2f}", row["verdict"]])
    return write_table(heads, rows)


def write_behind(table: Table) -> list[str]:
    """Walks on which the smoother is behind the filter."""
    rows = [[section, walk, f"{ours:.3f}", f"{theirs:.3f}"] for section, walk, ours, theirs in list_behind(table)]
    return write_table(["set", "walk", "`inertial`, m", "`iez`, m"], rows, words=2)


# --- without one part ------------------------------------------------------------------------------------------------

DEFAULT = SmootherParameters()
PARTS: Mapping[str, SmootherParameters] = {
    "default": DEFAULT,
    "no lever": replace(DEFAULT, known_lever=(0.0, 0.0, 0.0)),
    "rolling trusted": replace(DEFAULT, roll_sigma_m=0.05, gyr_density_deg_s=0.015),
    "no stance refused": replace(DEFAULT, refuse_stances=False),
    "moving foot not counted": replace(DEFAULT, moving_foot=False),
    "swing noise as given": replace(DEFAULT, choose_swing_noise=False),
    "bias walk as given": replace(DEFAULT, choose_bias_walk=False),
    "no floors": replace(DEFAULT, walk=WalkParameters(floors=False)),
    "no floors, 1.5 mm a sole": replace(DEFAULT, settling_m=0.0015, walk=WalkParameters(floors=False)),
    "plain zero velocity": PLAIN,
    "one node a stance": replace(DEFAULT, shortest_interval_s=1e3),  # no interval is as long
    "nodes 0.05 s apart": replace(DEFAULT, node_spacing_s=0.05),
    "nodes 0.1 s apart": replace(DEFAULT, node_spacing_s=0.1),
}
"""The smoother without one of its parts."""

PART_SECTIONS = (LABELLED, "gdin", "gdlbio", "gdlbio run", "loops")
PART_HEADS: Mapping[str, tuple[str, str]] = {
    "Vicon 2-D mean": (LABELLED, f"{RMSE} mean"), "2-D median": (LABELLED, f"{RMSE} median"),
    "3-D mean": (LABELLED, f"{SPACE} mean"), "3-D median": (LABELLED, f"{SPACE} median"),
    "scale": (LABELLED, "scale median"), "NEES": (LABELLED, f"{NEES} median"),
    "gdin mean": ("gdin", f"{RMSE} mean"), "gdin median": ("gdin", f"{RMSE} median"),
    "gdlbio mean": ("gdlbio", f"{RMSE} mean"), "gdlbio median": ("gdlbio", f"{RMSE} median"),
    "gdlbio run, median": ("gdlbio run", f"{RMSE} median"), "loops, %": ("loops", f"{CLOSURE} median"),
}  # fmt: skip
"""Section and sum of each column of the table in docs/models.md."""


def write_parts(table: Table) -> list[str]:
    """One row a variant."""
    rows = []
    for variant in dict.fromkeys(variant for _, variant in table.cases):
        cells = [Column(key, "", "mean").write(table, section, variant) for section, key in PART_HEADS.values()]
        rows.append([variant, *(cell or "-" for cell in cells)])
    return write_table(["smoother", *PART_HEADS], rows)


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


# --- methods on real floors ------------------------------------------------------------------------------------------

FLOORS: Mapping[str, str] = {"laps": "mems", "openshoe": "openshoe", "gdin": "gdin"}
"""Set of each section; of mems the laps alone."""
FLOOR_METHODS = ("inertial", "smoother", "smoother raw", "card", "smoother:directions", "iez", "qsf", "ma2018", "aiez")


def measure_methods(real: Real, methods: Sequence[str]) -> Found:
    """Run all methods on a walk; `smoother raw` is given no calibration, all others that by the walk itself."""
    prepared = {iron: Recorded(real.path).prepare(iron) for iron in (RAW, WALK)}

    def measure(name: str) -> Figures:
        method, _, variant = name.removesuffix(" raw").partition(":")
        walk = prepared[RAW if name.endswith(" raw") else WALK]
        gate = variant.removeprefix("gate=") if variant.startswith("gate=") else walk.options.gate
        changes = (("smoother.walk.directions", True),) if variant == "directions" else ()
        outcome = run_method(replace(walk, options=replace(walk.options, gate=gate, changes=changes)), method)
        if walk.truth is not None:
            return {"error": outcome.metrics.rmse_2d_m}
        return {"error": outcome.metrics.closure_percent, **measure_end(outcome.solution)}

    return {name: partial(measure, name) for name in methods}


def write_pairs(table: Table) -> list[str]:
    """Each walk without and with the magnetometer."""
    rows = []
    for section, merit in (("gdin", "footprint rmse (m)"), ("openshoe", "closure (%)")):
        some = [table.of(section, variant) for variant in ("inertial", "smoother raw", "smoother")]
        errors = {walk: [of[walk]["error"] for of in some] for walk in some[0]}
        errors[f"{section}, mean: {merit}"] = np.mean(list(errors.values()), axis=0).tolist()
        rows += [[walk, *(f"{value:.3f}" for value in values)] for walk, values in errors.items()]
    return write_table(["walk", "without", "as recorded", "calibrated on the walk"], rows)


EXPERIMENTS: Mapping[str, Experiment] = {
    "real-walks": Experiment(
        """Real walks by the smoother without a magnetometer, the filter, and what came with the recordings.

        rmse after yaw and position alignment, of footprints after a rigid fit; scale; NEES of the stance positions over
        its expectation. Of closed walks the distance from the first footfall to the last over the ground and up, m, and
        over their sigmas (root mean square: 1 where these are as claimed). Nothing is set by walk.""",
        partial(list_tasks, list(SECTIONS), METHODS),
        (
            Column(RMSE, "rmse 2-D (m)", MEAN),
            Column(SPACE, "3-D (m)", f"{MEAN} / p95"),
            Column("scale", "scale", "median", "{:.4f}"),
            Column(NEES, "NEES", "median", "{:.2f}"),
            Column(CLOSURE, "closure (%)", WORST, "{:.2f}"),
            Column(GROUND, "end (m)", "mean / worst"),
            Column("ground_ratio", "/ sigma", "rms", "{:.2f}"),
            Column(Z, "z (m)", "mean / worst"),
            Column("z_ratio", "/ its sigma", "rms", "{:.2f}"),
        ),
        [Asked(key, how, high=high, section=LABELLED, variant=INERTIAL) for (key, how), high in PYSHOE.items()],
        blocks={
            "real-walks": partial(write_lines, SUMMARY),
            "vicon": partial(write_lines, VICON),
            "closed": write_closed,
            "passes": write_passes,
            "behind": write_behind,
        },
    ),
    "parts": Experiment(
        "The smoother without one of its parts, on the same real walks (slow).",
        lambda chosen: list_tasks(
            PART_SECTIONS, {name: partial(smooth, parameters=PARTS[name]) for name in chosen.parts}, chosen
        ),
        [Column(key.split()[0], key, key.split()[1]) for key in dict.fromkeys(key for _, key in PART_HEADS.values())],
        options={"parts": option(list(PARTS), "variants", nargs="+", choices=tuple(PARTS), metavar="NAME")},
        blocks={"ablation": write_parts},
        keeps_walks=False,
    ),
    "real-magnetometers": Experiment(
        """Real walks with a magnetometer, method beside method.

        Laps of 355 m and openshoe: closure over the ground, % of the way; gdin: rmse at the footprints, m. All methods
        have the magnetometer that the walk itself calibrates, but for `raw`, which finds the iron on its way. `sigmas`:
        error over claimed sigma of the last footfall, rms over walks and both axes.""",
        lambda chosen: [
            Task(section, one.name, partial(measure_methods, one, tuple(chosen.methods)))
            for section, name in FLOORS.items()
            for one in walks.list_set(walks.data_folder(chosen.data), name)
            if section != "laps" or one.name.startswith("lap")
        ],
        (
            Column("error", "mean / median / worst", "mean / median / worst"),
            Column("ground_ratio", "sigmas", "rms", "{:.2f}"),
        ),
        options={"methods": FLOOR_METHODS},
        blocks={"magnetometer": write_pairs},
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
