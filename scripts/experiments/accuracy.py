"""How good the estimators are on real walks, whether sigmas hold 95 % of the errors, and what the verdicts are worth.

`inertial` is the smoother without a magnetometer, `iez` the zero-velocity filter. `stored` came with the recordings:
of gdlbio the path that the authors of the set had from PyShoe with its LSTM detector, laid on the same footprints at
the same instants by the same rigid fit as ours; of vicon PyShoe's error with the labels of `zv_shoe_opt`. PyShoe's
count (`armse_m`): start laid on start, heading from the first place 0.8 m away from it, and with e_k the error over the
ground, mean |e_k| / sqrt 2. It falls below an rmse after a best fit where errors grow along the walk.

References: Wagstaff, Peretroukhin, Kelly (2017), "Improving foot-mounted inertial navigation through real-time motion
classification"; code at github.com/utiasSTARS/pyshoe.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import harness
import joint_errors
import numpy as np
import walks
from harness import Figure, option
from joint_errors import FEWEST, FREEDOM, Seen
from walks import Real

from experiments import Asked, Column, Experiment, Figures, Found, Table, Task, attempt, write_table
from fg_nav.arrays import Floats, Ints
from fg_nav.detection.stance import Stances
from fg_nav.ekf import run_iez
from fg_nav.errors import EvaluationError
from fg_nav.evaluation import evaluate
from fg_nav.evaluation.comparison import align, fit_scale, interpolate_truth, lift_to_space, match_footprints
from fg_nav.frames import compute_heading
from fg_nav.lab.consistency import compute_stance_nees
from fg_nav.lab.simulation import Choices, scenario, simulate
from fg_nav.lab.simulation.path import polyline
from fg_nav.lab.simulation.plan import Section, Stand
from fg_nav.lab.simulation.plan import Walk as Walking
from fg_nav.lab.simulation.scenarios import FEET
from fg_nav.lab.simulation.sensors import preset
from fg_nav.lab.simulation.sensors.triad import Drift
from fg_nav.pipeline import prepare_walk, run_method
from fg_nav.recording import Recording
from fg_nav.smoother import SmootherParameters, smooth
from fg_nav.smoother.batch import smooth_graph
from fg_nav.smoother.parameters import PLAIN, WalkParameters
from fg_nav.solution import Solution
from fg_nav.truth import FootprintTruth, TrajectoryTruth, Truth
from fg_nav.verdict import UNUSABLE, judge_path
from fg_nav.walk import Options, Walk

# --- real walks ------------------------------------------------------------------------------------------------------

Estimate = Callable[[Recording, Stances], Solution]

INERTIAL, IEZ, COMPASS, STORED = "inertial", "iez", "smoother", "stored"
METHODS: Mapping[str, Estimate] = {INERTIAL: smooth, IEZ: run_iez}

PYSHOE = {"mean": (0.079, 0.131), "median": (0.055, 0.087)}
"""Rmse in m, horizontal and in space, of PyShoe's own filter with the same labels on the same trials."""

LABELLED, DETECTED = "vicon, labels", "vicon"
AIR = ", barometer"
SECTIONS: Mapping[str, Sequence[str]] = {
    LABELLED: ("vicon",),
    **{name: (name,) for name in ("vicon", "running", "gdin", "gdlbio", "gdlbio run")},
    "loops": ("openshoe", "xio"),
    **{name: (name,) for name in ("mti round", "mti stairs", "corridor", "mems", f"mems{AIR}", "mtig", f"mtig{AIR}")},
}
"""Sets of each section; those with a barometer are solved by the smoother alone."""

RMSE, SPACE, NEES, GROUND, Z = "rmse_2d_m", "rmse_3d_m", "nees", "ground_m", "z_m"
WORSE_SHARE, WORSE_M, MAX_WORSE = (
    0.10,
    0.03,
    3,
)  # By which a walk is worse than by the filter, and on how many it may be.


def list_real(section: str, chosen: Namespace) -> list[Real]:
    """Recordings of a section."""
    data = walks.data_folder(chosen.data)
    return [one for name in SECTIONS[section] for one in walks.list_set(data, name.removesuffix(AIR), AIR in section)]


def read_real(section: str, real: Real) -> walks.Walk:
    """Read a recording, with the stances of its section."""
    return real.read_labelled() if section == LABELLED else real.read()


def list_tasks(
    sections: Sequence[str],
    measure: Callable[[str, Real, Mapping[str, Estimate]], Found],
    estimates: Mapping[str, Estimate],
    chosen: Namespace,
) -> list[Task]:
    """All recordings of these sections, measured with these estimates."""
    return [
        Task(section, one.name, partial(measure, section, one, estimates))
        for section in sections
        for one in list_real(section, chosen)
    ]


def list_real_walks(chosen: Namespace) -> list[Task]:
    """All sections, by both methods."""
    return list_tasks(list(SECTIONS), measure_real, METHODS, chosen)


def measure_real(section: str, real: Real, methods: Mapping[str, Estimate]) -> Found:
    """Run the methods on a recording, and measure what came with it."""
    walk = read_real(section, real)
    some = {INERTIAL: methods[INERTIAL]} if AIR in section else methods
    found: dict[str, Figures] = {name: attempt(partial(measure_solution, walk, one)) for name, one in some.items()}
    truth = walk.recording.truth
    if walk.track is not None and isinstance(truth, FootprintTruth):
        found[STORED] = measure_track(walk, walk.track, truth)
    if walk.stored_armse_m is not None:
        found[STORED] = {"armse_m": walk.stored_armse_m}
    if section == walks.GDIN:  # with the magnetometer as recorded
        found[COMPASS] = attempt(lambda: {RMSE: run_method(real.prepare(Options()), COMPASS).metrics.rmse_2d_m})
    return found


def measure_solution(walk: walks.Walk, estimate: Estimate) -> Figures:
    """Figures of a solution: errors where there is a truth, else the end of a walk that ends where it began."""
    solution, truth = estimate(walk.recording, walk.stances), walk.recording.truth
    metrics: Mapping[str, Any] = evaluate(solution, truth).as_dict()
    names = (RMSE, SPACE, "max_error_m", "scale", "distance_m", "closure_m", "closure_percent", "points",
             "footprints_surveyed", "strides_detected", "strides_true")  # fmt: skip
    found: dict[str, Any] = {name: metrics[name] for name in names if metrics.get(name) is not None}
    if isinstance(truth, TrajectoryTruth):
        found |= {NEES: compute_stance_nees(solution.stances, truth).median_ratio}
        found |= {"armse_m": measure_as_pyshoe(solution, truth)}
    end = measure_end(solution)
    off = metrics.get("end_error_m")
    found |= end if truth is None else {"end_error_m": off, "end_sigma_m": end["end_sigma_m"]}
    word = judge_path(Walk(walk.recording, walk.stances, truth), solution).word
    beyond = off is not None and off > 3.0 * end["end_sigma_m"] and word != UNUSABLE
    if metrics.get("strides_true") is not None:
        found["miscount"] = metrics["strides_detected"] - metrics["strides_true"]
        found["miscounted"] = int(abs(found["miscount"]) > max(1.0, 0.03 * metrics["strides_true"]))
    return {**found, "verdict": word, "trusted": int(word == "trusted"), UNUSABLE: int(word == UNUSABLE),
            "off, unseen": int(beyond)}  # fmt: skip


def measure_end(solution: Solution) -> dict[str, float]:
    """Measure the last footfall from the first, m, and over its sigmas."""
    table = solution.stances
    move, covariance = table.position[-1] - table.position[0], table.position_cov[-1]
    squared = move[:2] @ np.linalg.pinv(covariance[:2, :2]) @ move[:2] / 2
    sigma, z = np.sqrt(np.trace(covariance[:2, :2])), np.sqrt(covariance[2, 2])
    found = {GROUND: np.hypot(*move[:2]), Z: move[2], "end_sigma_m": sigma, "ground_ratio": np.sqrt(squared)}
    return {name: float(value) for name, value in {**found, "z_ratio": move[2] / z}.items()}


def measure_track(walk: walks.Walk, track: Floats, truth: FootprintTruth) -> Figures:
    """Lay a stored path (N, 2) m, one place a sample, on footprints with their times."""
    assert truth.t is not None
    place = lift_to_space(np.column_stack([np.interp(truth.t, walk.recording.t, axis) for axis in track.T]))
    surveyed = lift_to_space(truth.xy)
    error = np.linalg.norm(align(place, surveyed).apply(place) - surveyed, axis=1)
    rmse = float(np.sqrt(np.mean(error**2)))
    return {RMSE: rmse, "max_error_m": float(error.max()), "scale": fit_scale(place, surveyed), "points": len(surveyed)}


HEADING_M, HEADING_SAMPLE = 0.8, 300  # PyShoe takes the heading from where a path first is so far away, or from there.


def measure_as_pyshoe(solution: Solution, truth: TrajectoryTruth) -> float:
    """Measure a solution as PyShoe's authors do (`compute_error`, `align_plots`); m."""
    row, true_position = interpolate_truth(truth, solution.t)
    p, q = ((path[:, :2] - path[0, :2]) @ np.array([1.0, 1j]) for path in (solution.position[row], true_position))
    away = np.abs(p) >= HEADING_M
    at = int(np.argmax(away)) if away.any() else min(HEADING_SAMPLE, len(p) - 1)
    turn = np.exp(1j * (np.angle(q[at]) - np.angle(p[at])))
    return float(np.mean(np.abs(turn * p - q)) / np.sqrt(2))


def error_m(row: Mapping[str, Any]) -> float:
    """Rmse over the ground where there is a truth, else the closure over the ground, m; infinite where it failed."""
    return float(row.get(RMSE, row.get(GROUND, np.inf)))


def list_behind(table: Table) -> list[tuple[str, str, float, float]]:
    """Walks on which the smoother is behind the filter: section, walk, and both errors, m."""
    found = []
    for section in (one for one in table.sections if AIR not in one):
        ours, theirs = table.of(section, INERTIAL), table.of(section, IEZ)
        for walk, row in ours.items():
            one, other = error_m(row), error_m(theirs.get(walk, {}))
            if section == "mtig" and "hallway" not in walk:
                continue  # no round
            if one > other * (1 + WORSE_SHARE) and one > other + WORSE_M:
                found.append((section, walk, one, other))
    return found


def judge_real_walks(table: Table) -> list[Figure]:
    """Return the figures that are no sum over a section."""
    behind = list_behind(table)
    name = f"worse than iez by {100 * WORSE_SHARE:.0f} % and {100 * WORSE_M:.0f} cm"
    figures = [Figure("all", name, INERTIAL, len(behind), high=MAX_WORSE, pattern="{:.0f}")]
    for section in table.sections:
        key = RMSE if len(table.values(section, INERTIAL, RMSE)) else GROUND
        both = [table.values(section, method, key) for method in (INERTIAL, IEZ)]
        if len(both[0]) and len(both[1]):
            ratio = float(np.mean(both[0]) / np.mean(both[1]))
            figures.append(Figure(section, f"{key}, mean, over the mean of iez", INERTIAL, ratio, high=1.0))
    for section, high in (("mtig", 0.3), (f"mtig{AIR}", 0.15)):
        rows = table.of(section, INERTIAL)
        passes = np.array([row.get(GROUND, np.inf) for walk, row in rows.items() if "_13_straight" in walk])
        stairs = [row.get(Z, np.inf) for walk, row in rows.items() if "_14_stair" in walk]
        if len(passes) and stairs:
            apart = 100 * float(np.ptp(passes) / passes.mean())
            figures.append(Figure(section, f"{len(passes)} passes of a corridor, apart (%)", INERTIAL, apart, high=1.0))
            figures.append(Figure(section, "stairs up and down, apart (m)", INERTIAL, abs(sum(stairs)), high=high))
    return figures


def ask_real_walks() -> list[Asked]:
    """All bounds."""
    ours = partial(Asked, variant=INERTIAL)
    found = [
        Asked(key, how, high=PYSHOE[how][k], section=LABELLED, variant=IEZ)
        for k, key in enumerate((RMSE, SPACE))
        for how in PYSHOE
    ]
    bounds = [
        (LABELLED, RMSE, 0.060, 0.045), (LABELLED, SPACE, 0.100, 0.070), (DETECTED, RMSE, 0.061, 0.043),
        (DETECTED, SPACE, 0.078, np.inf), ("gdin", RMSE, 0.31, np.inf), ("gdlbio", RMSE, 0.20, 0.10),
        ("gdlbio run", RMSE, np.inf, 1.5),
    ]  # fmt: skip
    for section, key, mean, median in bounds:
        found += [ours(key, "mean", high=mean, section=section), ours(key, "median", high=median, section=section)]
    for section in (LABELLED, "gdin"):
        found.append(ours("scale", "median", 0.99, 1.01, section))
    found += [
        ours(NEES, "median", 1 / 3.0, 3.0, LABELLED),
        ours(SPACE, "p95", high=0.588, section=DETECTED),
        ours(SPACE, "worst", high=2.0, section=DETECTED),
        ours("miscounted", "sum", high=2, section="gdin", pattern="{:.0f}"),
        ours("miscounted", "sum", high=2, section="gdlbio run", pattern="{:.0f}"),
        ours("off, unseen", "sum", high=0, pattern="{:.0f}"),
        ours("closure_percent", "median", high=0.7, section="loops"),
        ours(GROUND, "mean", high=0.15, section="mti round"),
        ours(GROUND, "mean", high=0.8, section="corridor"),
        ours(Z, "mean", high=0.25, section="mti round"),
        ours(Z, "mean", high=0.3, section="mti stairs"),
        ours(Z, "worst", high=0.5, section=f"mems{AIR}"),
        *(ours("z_ratio", "rms", 0.5, 1.5, section) for section in ("mti round", "mti stairs")),
        *(ours(UNUSABLE, "sum", high=1, section=s, pattern="{:.0f}") for s in ("mti round", "mti stairs")),
        *(ours("trusted", "sum", 9, section=s, pattern="{:.0f}") for s in ("mti round", "mti stairs")),
    ]
    return found


# --- tables of real walks --------------------------------------------------------------------------------------------

MEAN, WORST = "mean / median", "median / worst"
NAMES = {INERTIAL: "`inertial`", IEZ: "`iez`"}
PYSHOE_2D, PYSHOE_3D = (" / ".join(f"{PYSHOE[of][plane]:.3f}" for of in ("mean", "median")) for plane in (0, 1))
CLOSED = {
    "mti round": "12 rounds of 43 m at 100 Hz, walked, run, mixed (`mti1_loops`)",
    "mti stairs": "12 walks on stairs of one to three floors, up and down (`mti1_loops`)",
    "corridor": "a corridor to and fro, 89 m (`corridor_lab`)",
    "mems": "13 laps, squares and rectangles of 38 to 365 m (`mems_foot`)",
    f"mems{AIR}": "the same with their barometer",
}


Line = tuple[str, str, str, str, str, str]
"""Words, sections (joined by a plus), figure, summary, pattern, and what PyShoe's own filter has if not stored."""

SUMMARY: Sequence[Line] = (
    ("28 motion-captured trials: rmse 2-D, mean / median (m)", LABELLED, RMSE, MEAN, "{:.3f}", PYSHOE_2D),
    ("the same, own stances: rmse 3-D, mean / median / 95 % below (m)", DETECTED, SPACE, f"{MEAN} / p95", "{:.3f}", ""),
    ("10 indoor walks of 35 to 150 m (`gdin`): rmse at surveyed footprints, mean / median (m)", "gdin", RMSE, MEAN,
     "{:.3f}", ""),
    ("11 indoor walks of 10 to 120 m (`gdlbio`): the same", "gdlbio", RMSE, MEAN, "{:.3f}", ""),
    ("7 runs, or gyroscope clipped (`gdlbio`): the same", "gdlbio run", RMSE, MEAN, "{:.3f}", ""),
    ("5 loops of 23 to 78 m: closure in % of the distance, median / worst", "loops", "closure_percent", WORST,
     "{:.2f}", ""),
    ("12 rounds of 43 m / 12 walks on stairs, 100 Hz (`mti1_loops`): closure over the ground, mean (m)",
     "mti round+mti stairs", GROUND, "mean", "{:.3f}", ""),
    (f"{CLOSED['mems']}: the same, mean / median", "mems", GROUND, MEAN, "{:.3f}", ""),
)  # fmt: skip
VICON: Sequence[Line] = (
    ("PyShoe's labels as stances: rmse 2-D, mean / median (m)", LABELLED, RMSE, MEAN, "{:.3f}", PYSHOE_2D),
    ("the same, rmse 3-D", LABELLED, SPACE, MEAN, "{:.3f}", PYSHOE_3D),
    ("the same, rmse 3-D, 95 % of the trials below", LABELLED, SPACE, "p95", "{:.3f}", ""),
    ("the same, best-fit scale, median", LABELLED, "scale", "median", "{:.4f}", ""),
    ("the same, NEES of the positions over its expectation, median", LABELLED, NEES, "median", "{:.2f}", ""),
    ("own stances: rmse 2-D, mean / median (m)", DETECTED, RMSE, MEAN, "{:.3f}", ""),
    ("the same, rmse 3-D, mean / median", DETECTED, SPACE, MEAN, "{:.3f}", ""),
    ("the same, rmse 3-D, 95 % of the trials below / worst", DETECTED, SPACE, "p95 / worst", "{:.3f}", ""),
)


def write_lines(lines: Sequence[Line], table: Table) -> list[str]:
    """Figures of all methods, a line each; methods that no line has are left out."""
    names = {INERTIAL: "`inertial`", COMPASS: "`smoother`, with the compass", IEZ: "`iez`", STORED: "PyShoe"}
    rows = []
    for words, sections, figure, summary, pattern, pyshoe in lines:
        column, cells = Column(figure, "", summary, pattern), list[str]()
        for variant in names:
            some = [column.write(table, section, variant) for section in sections.split("+")]
            cells.append(" / ".join(one for one in some if one) or "-")
        rows.append([words, *cells[:-1], pyshoe or cells[-1]])
    kept = [k for k in range(5) if k == 0 or any(row[k] != "-" for row in rows)]
    heads = ["", *names.values()]
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
        cells = [cell for one in (row, aided[walk]) for cell in (f"{one[GROUND]:.2f}", _height(one))]
        rows.append([f"`{walk}`", *cells, f"{filtered[walk].get(GROUND, np.inf):.2f}", row["verdict"]])
    return write_table(heads, rows)


def _height(row: Mapping[str, Any]) -> str:
    return f"{row[Z]:+.2f} ± {abs(row[Z] / row['z_ratio']):.2f}"


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

PART_SECTIONS = (
    LABELLED,
    "gdin",
    "gdlbio",
    "gdlbio run",
    "loops",
    "mti round",
    "mti stairs",
    "corridor",
    "mems",
    "mtig",
)
PART_COLUMNS = (
    *(Column(key, f"{key} {how}", how) for key in (RMSE, SPACE) for how in ("mean", "median")),
    *(Column(key, f"{key} median", "median", "{:.4f}") for key in ("scale", NEES, "closure_percent")),
    *(Column(key, f"{key} mean", "mean") for key in (GROUND, Z)),
    *(Column(key, f"{key} rms", "rms", "{:.2f}") for key in ("ground_ratio", "z_ratio")),
)
PART_HEADS: Mapping[str, tuple[str, str]] = {
    "Vicon 2-D mean": (LABELLED, f"{RMSE} mean"), "2-D median": (LABELLED, f"{RMSE} median"),
    "3-D mean": (LABELLED, f"{SPACE} mean"), "3-D median": (LABELLED, f"{SPACE} median"),
    "scale": (LABELLED, "scale median"), "NEES": (LABELLED, f"{NEES} median"),
    "gdin mean": ("gdin", f"{RMSE} mean"), "gdin median": ("gdin", f"{RMSE} median"),
    "gdlbio mean": ("gdlbio", f"{RMSE} mean"), "gdlbio median": ("gdlbio", f"{RMSE} median"),
    "gdlbio run, median": ("gdlbio run", f"{RMSE} median"), "loops, %": ("loops", "closure_percent median"),
    "mti round, m": ("mti round", f"{GROUND} mean"), "its z": ("mti round", f"{Z} mean"),
    "mti stairs, m": ("mti stairs", f"{GROUND} mean"), "their z": ("mti stairs", f"{Z} mean"),
    "corridor, m": ("corridor", f"{GROUND} mean"), "mems, m": ("mems", f"{GROUND} mean"),
    "mems over sigma": ("mems", "ground_ratio rms"), "mtig z over sigma": ("mtig", "z_ratio rms"),
}  # fmt: skip
"""Section and sum of each column of the table in docs/models.md; those that were not measured are left out."""


def list_parts(chosen: Namespace) -> list[Task]:
    """Every variant of the smoother on the same walks."""
    variants = {name: partial(smooth, parameters=PARTS[name]) for name in chosen.parts}
    return list_tasks(PART_SECTIONS, measure_parts, variants, chosen)


def measure_parts(section: str, real: Real, variants: Mapping[str, Estimate]) -> Found:
    """Figures of each variant on a walk."""
    walk = read_real(section, real)
    return {name: attempt(partial(measure_solution, walk, one)) for name, one in variants.items()}


def write_parts(table: Table) -> list[str]:
    """One row a variant."""
    cells: dict[str, dict[str, float]] = {}
    for row in table.rows:
        for head, (section, key) in PART_HEADS.items():
            if row["section"] == section and row.get(key) is not None:
                cells.setdefault(row["variant"], {})[head] = row[key]
    heads = [head for head in PART_HEADS if any(head in one for one in cells.values())]
    rows = [[name, *(f"{one[head]:.3f}" if head in one else "-" for head in heads)] for name, one in cells.items()]
    return write_table(["smoother", *heads], rows)


# --- do the sigmas hold ----------------------------------------------------------------------------------------------

FOOTPRINT_SIGMA_M, CAPTURE_SIGMA_M = 0.01, 0.001  # A foot on a mark on the floor, and a marker on a shoe.
LEGS_M, TURNED_DEG = (50.0, 120.0), 60.0
WITHIN_S = 0.3  # A footprint is that of the stance so near to its instant; else its stance was not found.
SIMULATED = {
    f"simulated, {field or 'no magnetometer'}, heading {'given' if given else 'not given'}": (field, given)
    for field in (None, "smooth", "indoor")
    for given in (True, False)
}


def list_coverage(chosen: Namespace) -> list[Task]:
    """Real walks without their magnetometer, gdin with it too, and simulated ways."""
    data, tasks = walks.data_folder(chosen.data), []
    for section, with_mag in (("vicon", False), ("gdin", False), ("gdin, magnetometer", True), ("gdlbio", False)):
        some = walks.list_set(data, section.partition(",")[0])
        tasks += [Task(section, one.name, partial(cover_real, one, with_mag)) for one in some]
    for section, (field, given) in SIMULATED.items():
        way = partial(cover_way, chosen.length, chosen.feet, field, given)
        tasks += [Task(section, f"{seed}", partial(way, seed)) for seed in harness.seeds_of(chosen)]
    return tasks


def cover_real(real: Real, with_mag: bool) -> Found:
    """Measure one real walk; with its magnetometer the heading at the start is not given."""
    walk = real.prepare(Options() if with_mag else None)
    return {"smoother": attempt(partial(cover, walk, None if with_mag else 0.0, None))}


def cover_way(length_m: float, feet: Any, field: str | None, given: bool, seed: int) -> Found:
    """Measure one simulated way; without a field the heading given or not differs in what is open alone."""
    demo = preset("demo")
    assert demo.mag is not None
    gyr = replace(demo.gyr, bias_sd=float(np.deg2rad(0.15)), drift=Drift(walk=float(np.deg2rad(6e-4))), scale_sd=0.0)
    sensor = replace(demo, rate_hz=100.0, gyr=gyr, mag=replace(demo.mag, rate_hz=100.0, noise_sd_uT=0.5))

    def draw_route(rng: np.random.Generator) -> list[Section]:
        """Straight legs, standing before and after."""
        legs = max(round(length_m / float(np.mean(LEGS_M))), 1)
        heading = np.deg2rad(rng.uniform(-TURNED_DEG, TURNED_DEG, legs))
        moves = rng.uniform(*LEGS_M, legs)[:, None] * np.stack([np.sin(heading), np.cos(heading)], axis=1)
        path = polyline(np.vstack([np.zeros(2), np.cumsum(moves, axis=0)]), 1.2).scale_to(length_m)
        return [Stand(5.0), Walking(path), Stand(5.0)]

    base = replace(
        scenario("demo"),
        name="way",
        route=draw_route,
        worn="heel",
        sensor=sensor if field else replace(sensor, mag=None),
    )
    recording = simulate(base, seed, Choices(field=field or "homogeneous", feet=feet)).recording
    assert isinstance(recording.truth, TrajectoryTruth)
    assert recording.truth.nav_R_body is not None
    heading_deg = float(np.rad2deg(compute_heading(recording.truth.nav_R_body[0])))
    options = Options(heading_deg=heading_deg if given or field is None else None)
    walk = prepare_walk(Walk.of(recording, options))
    return {"smoother": attempt(partial(cover, walk, walk.options.heading_rad, field is not None or given))}


def cover(walk: Walk, heading: float | None, is_aligned: bool | None) -> Figures:
    """Smooth a walk, and measure its errors over their claim where the truth saw it.

    `is_aligned` is that of a simulated truth, which saw all footfalls with their attitudes; None with a real one, which
    has a frame of its own. Raises `EvaluationError` where that saw fewer than `FEWEST`.
    """
    smoothed = smooth_graph(walk.recording, walk.stances, heading=heading, field=walk.field)
    solution = smoothed.solution
    truth = walk.recording.truth if walk.truth is None else walk.truth
    assert truth is not None
    row, place = find_seen(solution, walk.stances, truth)
    if len(row) < FEWEST:
        raise EvaluationError(f"the truth saw {len(row)} footfalls: {FEWEST} are needed.")
    if is_aligned is None:
        planar = isinstance(truth, FootprintTruth)
        seen = Seen(row, place, FOOTPRINT_SIGMA_M if planar else CAPTURE_SIGMA_M, not planar, None, False)
    else:
        assert isinstance(truth, TrajectoryTruth)
        assert truth.nav_R_body is not None
        seen = Seen(row, place, 0.0, True, truth.nav_R_body[solution.stances.sample[row]], is_aligned)
    found = joint_errors.measure_errors(solution.stances, smoothed.joint, seen)
    return {
        name: value
        for kind, one in found.items()
        for name, value in ((kind, one.inside), (f"{kind} end", float(one.ends_inside)), (f"{kind} ratio", one.ratio))
    }


def find_seen(solution: Solution, stances: Stances, truth: Truth) -> tuple[Ints, Floats]:
    """Rows of the stance table that a truth saw, and true places (M, 3) m, of footprints with heights of zero."""
    if isinstance(truth, TrajectoryTruth):
        return interpolate_truth(truth, solution.stances.t)
    if truth.t is None:
        match = match_footprints(solution.stances.position[:, :2], truth)
        return match.stance[match.found], lift_to_space(truth.xy[match.found])
    instant = truth.t[:, None]
    outside = np.maximum(solution.t[stances.start] - instant, instant - solution.t[stances.stop - 1])
    nearest = outside.argmin(axis=1)
    found = outside.min(axis=1) < WITHIN_S
    row, first = np.unique(stances.footfall[nearest[found]], return_index=True)
    return row, lift_to_space(truth.xy[found][first])


def write_coverage(table: Table) -> list[str]:
    """Shares in the region of 95 % and error over sigma, one row a section."""
    rows = []
    for section in table.sections:
        cells = []
        for kind in FREEDOM:
            inside = table.values(section, "smoother", kind)
            ratio = table.values(section, "smoother", f"{kind} ratio")
            missed = "" if not len(inside) or COVERED[0] <= inside.mean() <= COVERED[1] else ", missed"
            cells.append(f"{inside.mean():.0%}, {np.median(ratio):.2f}{missed}" if len(inside) else "-")
        rows.append([section, f"{len(table.of(section, 'smoother'))}", *cells])
    return write_table(["", "walks", *FREEDOM], rows)


COVERED = 0.88, 0.99  # Asked of each share.


EXPERIMENTS: Mapping[str, Experiment] = {
    "real-walks": Experiment(
        """Real walks by the smoother without a magnetometer, the filter, and what came with the recordings.

        rmse after yaw and position alignment, of footprints after a rigid fit; scale; NEES of the stance positions over
        its expectation. Of closed walks the distance from the first footfall to the last over the ground and up, m, and
        over their sigmas (root mean square: 1 where these are as claimed). Nothing is set by walk.""",
        list_real_walks,
        (
            Column(RMSE, "rmse 2-D (m)", MEAN),
            Column(SPACE, "3-D (m)", f"{MEAN} / p95"),
            Column("armse_m", "as PyShoe counts (m)", MEAN),
            Column("scale", "scale", "median", "{:.4f}"),
            Column(NEES, "NEES", "median", "{:.2f}"),
            Column("closure_percent", "closure (%)", WORST, "{:.2f}"),
            Column(GROUND, "end (m)", "mean / worst"),
            Column("ground_ratio", "/ sigma", "rms", "{:.2f}"),
            Column(Z, "z (m)", "mean / worst"),
            Column("z_ratio", "/ its sigma", "rms", "{:.2f}"),
            Column("miscounted", "miscounted", "sum", "{:.0f}"),
            Column("trusted", "trusted", "sum", "{:.0f}"),
        ),
        ask_real_walks(),
        judge=judge_real_walks,
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
        list_parts,
        PART_COLUMNS,
        options={"parts": option(list(PARTS), "variants", nargs="+", choices=tuple(PARTS), metavar="NAME")},
        blocks={"ablation": write_parts},
        keeps_walks=False,
    ),
    "coverage": Experiment(
        """Do the sigmas hold 95 % of the errors: real walks, and simulated ways that do not come back.

        Ways of 700 m, a sensor in the heel, feet that move on in stance as real ones do. Share of the footfalls whose
        error lies in the region of 95 %, after the gauge that the walk leaves open (`joint_errors.py`), the mean over
        the walks; then error over sigma, rms over the footfalls, median over the walks: 1 for true sigmas.""",
        list_coverage,
        tuple(
            column
            for kind in FREEDOM
            for column in (Column(kind, kind, "mean", "{:.2f}"), Column(f"{kind} ratio", "/ sigma", "median", "{:.2f}"))
        ),
        [Asked(kind, "mean", *COVERED, pattern="{:.2f}") for kind in FREEDOM],
        seeds=20,
        first=401,  # of ways that no estimator was tuned on
        options={
            "length": option(700.0, "of the simulated ways, m", metavar="M"),
            "feet": option("moving", "of the simulated ways", choices=FEET),
        },
        blocks={"coverage": write_coverage},
    ),
}
