"""How good the estimators are on real walks: each figure that is asked for next to the figure measured.

    python scripts/real_walks.py [--data DIR] [--only SET ...] [--jobs N] [--per-walk] [--ablation] [--bias-walk]
                                 [--json FILE]

============ =======================================================================================================
vicon        rmse over all samples after yaw and position alignment, scale, and NEES of the stance positions, with the
             labels of PyShoe as stances; then rmse with our own stances
gdin         rmse over surveyed footprints after a rigid fit, scale, and stride count; two walks with running strides
gdlbio       the same of 11 walks, and of 7 that are run or in which the gyroscope clips in every stride
loops        from the first stance to the last: over the ground and up, m, and over their sigmas (root of the mean
             square, 1 where these are as claimed)
mti          the same of 12 rounds at 100 Hz, walked and run, and of 12 walks on stairs up and down
corridor     the same of a corridor walked to and fro
mems         the same of laps, squares and rectangles on one floor, without the barometer and with it
mtig         from start to end of two passes of one corridor, of stairs, and of other ways, without and with barometer
magnetometer gdin and the openshoe loops with the magnetometer and without it: as recorded, and corrected by what the
             walk shows of its iron, where it does (`fg_nav.calibration.walk`). Heading at the start not given
ablation     what each part of the smoother contributes: the same figures without it (slow)
bias walk    error and sigma at the end of five walks at each level of the bias walk, in place of the level that the
             evidence chooses
============ =======================================================================================================

Nothing is set by walk: every walk of every set runs with the same parameters. PyShoe (Wagstaff, Peretroukhin and
Kelly 2017) is its authors' own filter with the same labels, measured on the same 28 trials in the same way; `stored` is
what came with the recordings (`beside.py`), and so are the sets in one table. A walk that an estimator could not solve
counts as infinitely bad.

`docs/results/real-walks.json` is what `--ablation --bias-walk --json` writes; what was not measured anew stays in the
file as it was, and `made` has the day of each part. `write_results.py` makes the docs' tables of it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import date
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import beside
import harness
import numpy as np
import walks
from beside import NEES, RMSE, SPACE, STORED, SUMMARIES, Result, results_of
from harness import Figure, option
from real_fields import measure_pairs, print_pairs
from walks import Walk

from fg_nav.arrays import Floats
from fg_nav.detection.stance import Stances
from fg_nav.ekf import run_iez
from fg_nav.errors import EstimationError, EvaluationError
from fg_nav.evaluation import evaluate
from fg_nav.lab.consistency import compute_stance_nees
from fg_nav.recording import Recording
from fg_nav.report.terminal import console
from fg_nav.smoother import SmootherParameters, smooth
from fg_nav.smoother.parameters import PLAIN, WalkParameters
from fg_nav.solution import Solution
from fg_nav.truth import TrajectoryTruth
from fg_nav.verdict import UNUSABLE, judge_path
from fg_nav.walk import Walk as PreparedWalk

Estimate: TypeAlias = Callable[[Recording, Stances], Solution]

SMOOTHER, IEZ = "smoother", "iez"
METHODS: Mapping[str, Estimate] = {SMOOTHER: smooth, IEZ: run_iez}
"""Neither has a magnetometer here: `smoother` is the method `inertial`."""

PYSHOE = {"mean": (0.079, 0.131), "median": (0.055, 0.087)}
"""Rmse in m, horizontal and in space, of PyShoe's own filter."""

RIGHT_COUNTS, RUN_COUNTS, RUN_COUNT_SHARE, INF = 8, 5, 0.03, np.inf

VICON_LABELLED, VICON_DETECTED = "Vicon, labels of PyShoe", "Vicon, own stances"
FOOTPRINTS, RUNNING = "gdin, own stances, no magnetometer", "gdin with running strides, for information"
SURVEYED, RUN = "gdlbio, walked", "gdlbio, run or clipped"
LOOPS, ROUND, STAIRS, CORRIDOR = "loops, own stances", "mti, round", "mti, stairs", "corridor"
MEMS, MTIG, AIR = "mems", "mtig", ", barometer"

SETS_BESIDE: Mapping[str, tuple[tuple[str, ...], str]] = {
    "vicon, labels": ((VICON_LABELLED,), ""),
    "vicon, own stances": ((VICON_DETECTED,), ""),
    "gdin": ((FOOTPRINTS, RUNNING), ""),
    SURVEYED: ((SURVEYED,), ""),
    RUN: ((RUN,), ""),
    "openshoe": ((LOOPS,), "openshoe"),
    "xio": ((LOOPS,), "xio"),
    **{name: ((name,), "") for name in (ROUND, STAIRS, CORRIDOR, MEMS)},
    "mtig, its round": ((MTIG,), "2022_1_14_hallway"),
}
"""Sections of each set, and how its walks' names begin."""

# --- what is printed and asked ---------------------------------------------------------------------------------------

Columns: TypeAlias = Mapping[str, Callable[[Result], str]]


def _column(name: str, pattern: str) -> Callable[[Result], str]:
    return lambda result: pattern.format(result.value(name)) if np.isfinite(result.value(name)) else "-"


TRIAL_COLUMNS: Columns = {
    "rmse 2-D (m)": _column(RMSE, "{:.3f}"),
    "rmse 3-D (m)": _column(SPACE, "{:.3f}"),
    "as PyShoe counts (m)": _column("armse_m", "{:.3f}"),
    "largest (m)": _column("max_error_m", "{:.3f}"),
    "scale": _column("scale", "{:.4f}"),
    "NEES": _column(NEES, "{:.2f}"),
    "strides": _column("strides_detected", "{:.0f}"),
    "verdict": lambda r: r.verdict,
}
FOOTPRINT_COLUMNS: Columns = {
    "rmse (m)": _column(RMSE, "{:.3f}"),
    "scale": _column("scale", "{:.4f}"),
    "distance (m)": _column("distance_m", "{:.1f}"),
    "footprints": lambda r: f"{r.value('points'):.0f}/{r.value('footprints_surveyed'):.0f}",
    "strides": lambda r: (
        "-" if r.method == STORED else f"{r.value('strides_detected'):.0f}/{r.value('strides_true'):.0f}"
    ),
    "verdict": lambda r: r.verdict,
    "": lambda r: "" if r.method == STORED or abs(r.miscount) <= 1 else f"{r.miscount:+.0f}",
}
END_COLUMNS: Columns = {
    "distance (m)": _column("distance_m", "{:.1f}"),
    "end, ground (m)": _column("ground_m", "{:.3f}"),
    "/ sigma": _column("ground_ratio", "{:.2f}"),
    "z (m)": _column("z_m", "{:+.3f}"),
    "/ its sigma": _column("z_ratio", "{:+.2f}"),
    "strides": _column("strides_detected", "{:.0f}"),
    "verdict": lambda r: r.verdict,
}


@dataclass(frozen=True)
class Merit:
    """A figure over the walks of a section: `summary` of the sizes of `key`, and its bounds for each method.

    `high` and `low` are for the smoother, `iez` is the upper one of the filter.
    """

    key: str
    summary: str
    high: float = np.inf
    low: float = -np.inf
    iez: float = np.inf

    def judge(self, section: str, results: Sequence[Result]) -> list[Figure]:
        """Return its figure for each method of the section that measures it."""
        words, pattern = WORDS[self.key]
        found = []
        for method in dict.fromkeys(row.method for row in results):
            measured = summarize(results_of(results, method), self.key, self.summary)
            low, high = (self.low, self.high) if method == SMOOTHER else (-np.inf, self.iez)
            if method != STORED or np.isfinite(measured):
                found.append(Figure(section, f"{words}, {self.summary}", method, measured, low, high, pattern))
        return found


WORDS = {
    RMSE: ("rmse 2-D (m)", "{:.3f}"),
    SPACE: ("rmse 3-D (m)", "{:.3f}"),
    "scale": ("best-fit scale", "{:.4f}"),
    NEES: ("NEES over expectation", "{:.2f}"),
    "closure_percent": ("closure (%)", "{:.2f}"),
    "ground_m": ("closure over the ground (m)", "{:.3f}"),
    "z_m": ("|z| (m)", "{:.3f}"),
    "ground_ratio": ("closure over sigma", "{:.2f}"),
    "z_ratio": ("z over sigma", "{:.2f}"),
}
"""Name and pattern of a figure."""

TRUE_SCALE = Merit("scale", "median", 1.01, 0.99)


def ask_closed(ground: float = INF, z: float = INF, ratio: float = INF, worst_z: float = INF) -> tuple[Merit, ...]:
    """Figures of closed walks, and upper bounds of their means and of the worst height."""
    low = 0.5 if np.isfinite(ratio) else -np.inf
    of_z = Merit("z_m", "mean", z), Merit("z_m", "worst", worst_z), Merit("z_ratio", "rms", ratio, low)
    return Merit("ground_m", "mean", ground), Merit("ground_m", "worst"), Merit("ground_ratio", "rms"), *of_z


@dataclass(frozen=True)
class Section:
    """Walks that are judged together: the option of `--only`, how they are read, what is printed and asked of them."""

    only: str
    read: Callable[[Path], list[Walk]]
    columns: Columns
    merits: Sequence[Merit] = ()
    methods: Mapping[str, Estimate] = field(default_factory=lambda: METHODS)
    more: Callable[[str, Sequence[Result]], list[Figure]] = lambda *_: []


def judge_counts(section: str, results: Sequence[Result]) -> list[Figure]:
    """In how many surveyed walks the strides are counted right, and how many ends are off unseen."""
    first = results_of(results, SMOOTHER)
    gdin = section == FOOTPRINTS
    right = sum(abs(row.miscount) <= (1 if gdin else RUN_COUNT_SHARE * row.value("strides_true")) for row in first)
    name = f"stride count within {'1' if gdin else f'{100 * RUN_COUNT_SHARE:.0f} %'}, walks of {len(first)}"
    bound = {FOOTPRINTS: RIGHT_COUNTS, RUN: RUN_COUNTS}.get(section, -np.inf)
    unseen = sum(row.is_off_unseen for row in results)
    return [
        Figure(section, name, "both", right, low=bound, pattern="{:.0f}"),
        Figure(section, "off by 3 sigmas at the end, and not named", "both", unseen, high=0, pattern="{:.0f}"),
    ]


def judge_passes(section: str, results: Sequence[Result]) -> list[Figure]:
    """How far passes of one corridor differ in length, and one staircase up from the same down."""
    ours = results_of(results, SMOOTHER)
    passes = np.array([row.value("ground_m") for row in ours if "_13_straight" in row.walk])
    stairs = [row.value("z_m") for row in ours if "_14_stair" in row.walk]
    return [
        Figure(section, f"{len(passes)} passes of a corridor, apart (%)", SMOOTHER, _apart_percent(passes), high=1.0),
        Figure(
            section, "stairs up and down, apart (m)", SMOOTHER, abs(sum(stairs)), high=0.15 if AIR in section else 0.3
        ),
    ]


def _apart_percent(lengths: Floats) -> float:
    return 100 * float(np.ptp(lengths) / lengths.mean()) if len(lengths) else np.inf


def judge_verdicts(only: str, results: Sequence[Result]) -> list[Figure]:
    """How many walks of a set are trusted and how many are not to be used."""
    words = [row.verdict for row in results_of(results, SMOOTHER)]
    least, most = (18, 1) if only == "mti" else (-np.inf, np.inf)
    return [
        Figure(only, f"trusted, walks of {len(words)}", SMOOTHER, words.count("trusted"), least, pattern="{:.0f}"),
        Figure(
            only, f"{UNUSABLE}, walks of {len(words)}", SMOOTHER, words.count(UNUSABLE), high=most, pattern="{:.0f}"
        ),
    ]


ONLY_SMOOTHER = {SMOOTHER: smooth}
LEVEL = ask_closed(worst_z=0.5)
SECTIONS: Mapping[str, Section] = {
    VICON_LABELLED: Section(
        "vicon",
        walks.read_vicon_labelled,
        TRIAL_COLUMNS,
        (
            Merit(RMSE, "mean", 0.060, iez=PYSHOE["mean"][0]),
            Merit(RMSE, "median", 0.045, iez=PYSHOE["median"][0]),
            Merit(SPACE, "mean", 0.100, iez=PYSHOE["mean"][1]),
            Merit(SPACE, "median", 0.070, iez=PYSHOE["median"][1]),
            Merit(SPACE, "p95"),
            TRUE_SCALE,
            Merit(NEES, "median", 3.0, 1 / 3.0),
        ),
    ),
    VICON_DETECTED: Section(
        "vicon",
        walks.read_vicon_detected,
        TRIAL_COLUMNS,
        (
            Merit(RMSE, "mean", 0.061),
            Merit(RMSE, "median", 0.043),
            Merit(SPACE, "mean", 0.078),
            Merit(SPACE, "median"),
            Merit(SPACE, "p95", 0.588),
            Merit(SPACE, "worst", 2.0),
        ),
    ),
    RUNNING: Section("gdin", partial(walks.read_gdin, numbers=walks.RUNNING), FOOTPRINT_COLUMNS),
    FOOTPRINTS: Section(
        "gdin",
        walks.read_gdin,
        FOOTPRINT_COLUMNS,
        (Merit(RMSE, "mean", 0.31), Merit(RMSE, "median"), TRUE_SCALE),
        more=judge_counts,
    ),
    SURVEYED: Section(
        "gdlbio",
        walks.read_gdlbio,
        FOOTPRINT_COLUMNS,
        (Merit(RMSE, "mean", 0.20), Merit(RMSE, "median", 0.10), Merit(RMSE, "worst")),
        more=judge_counts,
    ),
    RUN: Section(
        "gdlbio",
        partial(walks.read_gdlbio, numbers=walks.GDLBIO_RUN),
        FOOTPRINT_COLUMNS,
        (Merit(RMSE, "mean"), Merit(RMSE, "median", 1.5), Merit(RMSE, "worst")),
        more=judge_counts,
    ),
    LOOPS: Section(
        "loops",
        walks.read_loops,
        END_COLUMNS,
        (Merit("closure_percent", "median", 0.7), Merit("closure_percent", "worst"), *ask_closed()),
    ),
    ROUND: Section(
        "mti", partial(walks.read_recorded, names=walks.RECORDED["mti round"]), END_COLUMNS, ask_closed(0.15, 0.25, 1.5)
    ),
    STAIRS: Section(
        "mti",
        partial(walks.read_recorded, names=walks.RECORDED["mti stairs"]),
        END_COLUMNS,
        ask_closed(z=0.3, ratio=1.5),
    ),
    CORRIDOR: Section(
        "corridor", partial(walks.read_recorded, names=walks.RECORDED["corridor"]), END_COLUMNS, ask_closed(0.8)
    ),
    MEMS: Section("mems", partial(walks.read_recorded, names=walks.RECORDED["mems"]), END_COLUMNS, ask_closed()),
    MEMS + AIR: Section(
        "mems",
        partial(walks.read_recorded, names=walks.RECORDED["mems"], with_barometer=True),
        END_COLUMNS,
        LEVEL,
        ONLY_SMOOTHER,
    ),
    MTIG: Section("mtig", partial(walks.read_recorded, names=walks.RECORDED["mtig"]), END_COLUMNS, more=judge_passes),
    MTIG + AIR: Section(
        "mtig",
        partial(walks.read_recorded, names=walks.RECORDED["mtig"], with_barometer=True),
        END_COLUMNS,
        methods=ONLY_SMOOTHER,
        more=judge_passes,
    ),
}
MAGNETOMETER = "magnetometer"
SETS = (*dict.fromkeys(section.only for section in SECTIONS.values()), MAGNETOMETER)

# --- measuring -------------------------------------------------------------------------------------------------------


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print, and write what was asked for."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        data=None,
        only=option(list(SETS), "sets of walks", nargs="*", choices=SETS),
        jobs=1,
        per_walk=False,
        ablation=option(False, "what each part of the smoother contributes (slow)"),
        bias_walk=option(False, "error and sigma at each level of the bias walk"),
        json=None,
    )
    data = walks.data_folder(chosen.data)
    results, figures = measure_sets(data, chosen.only, chosen.per_walk, chosen.jobs)
    pairs = measure_pairs(data) if MAGNETOMETER in chosen.only else []
    figures += print_pairs(pairs)
    measured: dict[str, list[dict[str, Any]]] = {
        "figures": [figure.as_dict() for figure in figures],
        "walks": [result.as_dict() for result in results],
        "magnetometer": [pair.as_dict() for pair in pairs],
        "ablation": measure_ablation(data, chosen.jobs) if chosen.ablation else [],
        "bias_walk": measure_bias_walk(data, chosen.jobs) if chosen.bias_walk else [],
    }
    harness.print_verdict(figures)
    if chosen.json is not None:
        harness.write_json(chosen.json, keep_others(chosen.json, measured))


def keep_others(path: Path, measured: Mapping[str, list[dict[str, Any]]]) -> dict[str, Any]:
    """Return the content of a file with what was measured in place of what it says of the same sections and parts."""
    old = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    anew = {row["section"] for row in (*measured["figures"], *measured["walks"])}
    anew |= {name for name, rows in measured.items() if rows and name not in ("figures", "walks")}
    content: dict[str, Any] = {"made": old.get("made", {}) | dict.fromkeys(sorted(anew), date.today().isoformat())}
    for name, rows in measured.items():
        if name in ("figures", "walks"):
            kept = [row for row in old.get(name, []) if row["section"] not in anew] + rows
            order = {section: k for k, section in enumerate(SECTIONS)}
            content[name] = sorted(kept, key=lambda row: order.get(row["section"], len(order)))
        else:
            content[name] = rows or old.get(name, [])
    return content


def measure_sets(
    data: Path, sets: Sequence[str], per_walk: bool = False, jobs: int = 1
) -> tuple[list[Result], list[Figure]]:
    """Measure and print each section of these sets of walks, and all sets beside each other."""
    results: list[Result] = []
    figures: list[Figure] = []
    for only in sets:
        of_set: list[Result] = []
        for name, section in SECTIONS.items():
            if section.only == only:
                rows = run_methods(name, section.read(data), section.methods, jobs)
                print_walks(name, rows, section.columns if per_walk or only != "vicon" else {})
                found = [figure for merit in section.merits for figure in merit.judge(name, rows)]
                found += section.more(name, rows)
                harness.print_figures(found)
                figures, of_set = figures + found, of_set + rows
        found = judge_verdicts(only, of_set) if of_set else []
        harness.print_figures(found)
        figures, results = figures + found, results + of_set
    found = beside.judge_sets(results, SETS_BESIDE)
    harness.print_figures(found)
    return results, figures + found


def print_walks(section: str, results: Sequence[Result], columns: Columns) -> None:
    """Print a row a walk and method, and why a method failed."""
    harness.print_heading(section)
    if columns:
        rows = [[r.walk, r.method, *(cell(r) for cell in columns.values())] for r in results]
        harness.print_table(("walk", "method", *columns), rows)
    for result in results:
        if result.failure:
            console().print(f"{result.walk}, {result.method}: {result.failure}")


def run_methods(
    section: str, chosen: Sequence[Walk], methods: Mapping[str, Estimate] = METHODS, jobs: int = 1
) -> list[Result]:
    """Run every method on every walk and measure it, and what came with the recording."""
    tasks = [(walk, name, methods[name]) for walk in chosen for name in methods]
    found = harness.map_walks(partial(_measure_task, section), tasks, jobs, title=section)
    return found + [one for walk in chosen for one in beside.measure_stored(section, walk)]


def _measure_task(section: str, task: tuple[Walk, str, Estimate]) -> Result:
    return measure_walk(section, *task)


def measure_walk(section: str, walk: Walk, method: str, estimate: Estimate) -> Result:
    """Run one method on one walk and compare it with the truth, if there is one."""
    truth = walk.recording.truth
    try:
        solution = estimate(walk.recording, walk.stances)
        metrics = evaluate(solution, truth)
        seen = isinstance(truth, TrajectoryTruth)
        consistency = compute_stance_nees(solution.stances, truth) if seen else None
        armse_m = beside.measure_as_pyshoe(solution, truth) if seen else None
    except (EstimationError, EvaluationError) as error:
        return Result(section, walk.name, method, None, failure=str(error))
    verdict = judge_path(PreparedWalk(walk.recording, walk.stances, truth), solution).word
    return Result(section, walk.name, method, metrics, consistency, "", armse_m, beside.measure_end(solution), verdict)


def values(results: Sequence[Result], name: str) -> Floats:
    """Figure of merit `name` (W,) of each walk."""
    return np.array([result.value(name) for result in results])


def summarize(results: Sequence[Result], name: str, summary: str) -> float:
    """Mean, median, ... of the sizes of a figure of merit over the walks."""
    return SUMMARIES[summary](np.abs(values(results, name)))


# --- without one part ------------------------------------------------------------------------------------------------

DEFAULT = SmootherParameters()

ABLATION: Mapping[str, SmootherParameters] = {
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
    "one node a stance": replace(DEFAULT, shortest_interval_s=1e3),
    "nodes 0.05 s apart": replace(DEFAULT, node_spacing_s=0.05),
    "nodes 0.1 s apart": replace(DEFAULT, node_spacing_s=0.1),
}
"""The smoother without one of its parts. No interval is as long as 1000 s: it then has a single node."""

ABLATION_COLUMNS: Mapping[str, tuple[str, str, str]] = {
    "Vicon 2-D mean": (VICON_LABELLED, RMSE, "mean"),
    "2-D median": (VICON_LABELLED, RMSE, "median"),
    "3-D mean": (VICON_LABELLED, SPACE, "mean"),
    "3-D median": (VICON_LABELLED, SPACE, "median"),
    "scale": (VICON_LABELLED, "scale", "median"),
    "NEES": (VICON_LABELLED, NEES, "median"),
    "gdin mean": (FOOTPRINTS, RMSE, "mean"),
    "gdin median": (FOOTPRINTS, RMSE, "median"),
    "gdlbio mean": (SURVEYED, RMSE, "mean"),
    "gdlbio median": (SURVEYED, RMSE, "median"),
    "gdlbio run, median": (RUN, RMSE, "median"),
    "loops, %": (LOOPS, "closure_percent", "median"),
    "mti round, m": (ROUND, "ground_m", "mean"),
    "its z": (ROUND, "z_m", "mean"),
    "mti stairs, m": (STAIRS, "ground_m", "mean"),
    "their z": (STAIRS, "z_m", "mean"),
    "corridor, m": (CORRIDOR, "ground_m", "mean"),
    "mems, m": (MEMS, "ground_m", "mean"),
    "mems over sigma": (MEMS, "ground_ratio", "rms"),
    "mtig z over sigma": (MTIG, "z_ratio", "rms"),
}
"""Section, figure of merit and summary of each column."""


def measure_ablation(data: Path, jobs: int = 1) -> list[dict[str, Any]]:
    """Measure and print every variant of the smoother on the same walks; returns the rows, ready for JSON."""
    sections = dict.fromkeys(section for section, _, _ in ABLATION_COLUMNS.values())
    chosen = {section: SECTIONS[section].read(data) for section in sections}
    rows = [{"smoother": name, **measure_variant(p, chosen, jobs)} for name, p in ABLATION.items()]
    harness.print_heading("What each part of the smoother contributes")
    harness.print_table(list(rows[0]), [[str(cell) for cell in row.values()] for row in rows])
    return rows


def measure_variant(
    parameters: SmootherParameters, chosen: Mapping[str, Sequence[Walk]], jobs: int = 1
) -> dict[str, object]:
    """Figures of one variant on the walks of each section."""
    variant = {SMOOTHER: partial(smooth, parameters=parameters)}
    found = {
        section: results_of(run_methods(section, some, variant, jobs), SMOOTHER) for section, some in chosen.items()
    }
    columns = {name: summarize(found[section], key, how) for name, (section, key, how) in ABLATION_COLUMNS.items()}
    return {name: harness.finite(float(f"{value:.4g}")) for name, value in columns.items()}


BIAS_WALKS_DEG_S = 3e-4, 1e-3, 3e-3, 6e-3, 1e-2, 2e-2  # deg/s/sqrt(s)
BIAS_WALK_OF: Mapping[str, Callable[[Path], list[Walk]]] = {
    SURVEYED: partial(walks.read_gdlbio, numbers=(58, 74, 76)),
    CORRIDOR: SECTIONS[CORRIDOR].read,
    MEMS: partial(walks.read_recorded, names=["mems_foot/lap_360m_1"]),
}


def measure_bias_walk(data: Path, jobs: int = 1) -> list[dict[str, Any]]:
    """Measure and print the error and the sigma at the end of some walks, by the level of the bias walk."""
    levels: dict[str, SmootherParameters] = {
        f"{one:.0e}": replace(DEFAULT, gyro_bias_walk_deg_s=one, choose_bias_walk=False) for one in BIAS_WALKS_DEG_S
    }
    estimates = {name: partial(smooth, parameters=p) for name, p in {"as chosen": DEFAULT, **levels}.items()}
    rows = []
    for section, read in BIAS_WALK_OF.items():
        for row in (row for row in run_methods(section, read(data), estimates, jobs) if row.method != STORED):
            error = row.value("end_error_m" if np.isfinite(row.value("end_error_m")) else "ground_m")
            rows.append({"walk": row.walk, "level": row.method, "error_m": error, "sigma_m": row.value("end_sigma_m")})
    harness.print_heading("Error and sigma at the end over the ground, m, by the level of the bias walk, deg/s/sqrt(s)")
    cells = [[*(row["walk"], row["level"]), *(f"{row[name]:.3f}" for name in ("error_m", "sigma_m"))] for row in rows]
    harness.print_table(("walk", "level", "error (m)", "sigma (m)"), cells)
    return [{name: _round(value) for name, value in row.items()} for row in rows]


def _round(value: str | float) -> object:
    return value if isinstance(value, str) else harness.finite(float(f"{value:.4g}"))


if __name__ == "__main__":
    harness.run(main)
