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

import numpy as np
import walks
from harness import Figure, option
from walks import Real

from experiments import Asked, Column, Experiment, Figures, Found, Table, Task, attempt, write_table
from fg_nav.arrays import Floats
from fg_nav.detection.stance import Stances
from fg_nav.ekf import run_iez
from fg_nav.evaluation import evaluate
from fg_nav.evaluation.comparison import align, fit_scale, interpolate_truth, lift_to_space
from fg_nav.lab.consistency import compute_stance_nees
from fg_nav.pipeline import run_method
from fg_nav.recording import Recording
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
WORSE_SHARE, WORSE_M, MAX_WORSE = 0.10, 0.03, 3  # By which a walk is worse than by the filter, and on how many.


def list_tasks(
    sections: Sequence[str],
    measure: Callable[[str, Real, Mapping[str, Estimate]], Found],
    estimates: Mapping[str, Estimate],
    chosen: Namespace,
) -> list[Task]:
    """All recordings of these sections, measured with these estimates."""
    data = walks.data_folder(chosen.data)
    return [
        Task(section, one.name, partial(measure, section, one, estimates))
        for section in sections
        for name in SECTIONS[section]
        for one in walks.list_set(data, name.removesuffix(AIR), AIR in section)
    ]


def read_real(section: str, real: Real) -> walks.Walk:
    """Read a recording, with the stances of its section."""
    return real.read_labelled() if section == LABELLED else real.read()


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


OURS = partial(Asked, variant=INERTIAL)
BOUNDS = {  # mean and median
    (LABELLED, RMSE): (0.060, 0.045), (LABELLED, SPACE): (0.100, 0.070), (DETECTED, RMSE): (0.061, 0.043),
    (DETECTED, SPACE): (0.078, np.inf), ("gdin", RMSE): (0.31, np.inf), ("gdlbio", RMSE): (0.20, 0.10),
    ("gdlbio run", RMSE): (np.inf, 1.5),
}  # fmt: skip
REAL_ASKED = (
    *(
        Asked(key, how, high=PYSHOE[how][k], section=LABELLED, variant=IEZ)
        for k, key in enumerate((RMSE, SPACE))
        for how in PYSHOE
    ),
    *(
        OURS(key, how, high=high, section=section)
        for (section, key), both in BOUNDS.items()
        for how, high in zip(("mean", "median"), both, strict=True)
    ),
    *(OURS("scale", "median", 0.99, 1.01, section) for section in (LABELLED, "gdin")),
    OURS(NEES, "median", 1 / 3.0, 3.0, LABELLED),
    OURS(SPACE, "p95", high=0.588, section=DETECTED),
    OURS(SPACE, "worst", high=2.0, section=DETECTED),
    *(OURS("miscounted", "sum", high=2, section=one, pattern="{:.0f}") for one in ("gdin", "gdlbio run")),
    OURS("off, unseen", "sum", high=0, pattern="{:.0f}"),
    OURS("closure_percent", "median", high=0.7, section="loops"),
    OURS(GROUND, "mean", high=0.15, section="mti round"),
    OURS(GROUND, "mean", high=0.8, section="corridor"),
    OURS(Z, "mean", high=0.25, section="mti round"),
    OURS(Z, "mean", high=0.3, section="mti stairs"),
    OURS(Z, "worst", high=0.5, section=f"mems{AIR}"),
    *(OURS("z_ratio", "rms", 0.5, 1.5, section) for section in ("mti round", "mti stairs")),
    *(OURS(UNUSABLE, "sum", high=1, section=s, pattern="{:.0f}") for s in ("mti round", "mti stairs")),
    *(OURS("trusted", "sum", 9, section=s, pattern="{:.0f}") for s in ("mti round", "mti stairs")),
)

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

PART_SECTIONS = [one for one in SECTIONS if AIR not in one and one not in (DETECTED, "running")]
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


EXPERIMENTS: Mapping[str, Experiment] = {
    "real-walks": Experiment(
        """Real walks by the smoother without a magnetometer, the filter, and what came with the recordings.

        rmse after yaw and position alignment, of footprints after a rigid fit; scale; NEES of the stance positions over
        its expectation. Of closed walks the distance from the first footfall to the last over the ground and up, m, and
        over their sigmas (root mean square: 1 where these are as claimed). Nothing is set by walk.""",
        partial(list_tasks, list(SECTIONS), measure_real, METHODS),
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
        REAL_ASKED,
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
}
