"""How good the estimators are on real walks: each figure that is asked for next to the figure measured.

    python scripts/real_walks.py [--data DIR] [--only SET ...] [--per-walk] [--ablation] [--json FILE]

============ =======================================================================================================
vicon        rmse over all samples after yaw and position alignment, scale, and NEES of the stance positions, with the
             labels of PyShoe as stances; then rmse with our own stances
gdin         rmse over surveyed footprints after a rigid fit, scale, and stride count; two walks with running strides
gdlbio       the same of 11 walks, and of 7 that are run or in which the gyroscope clips in every stride
loops        distance from the first stance to the last, in percent of the distance travelled
magnetometer gdin and the openshoe loops with the magnetometer and without it: as recorded, and corrected by what the
             walk shows of its iron, where it does (`fg_nav.calibration.walk`). Heading at the start not given
ablation     what each part of the smoother contributes: the same figures without it (slow)
============ =======================================================================================================

Nothing is set by walk: every walk of every set runs with the same parameters. PyShoe (Wagstaff, Peretroukhin and
Kelly 2017) is its authors' own filter with the same labels, measured on the same 28 trials in the same way; `stored` is
what came with the recordings (`beside.py`), and so are the sets in one table. A walk that an estimator could not solve
counts as infinitely bad.

`docs/results/real-walks.json` is what `--ablation --json` writes; `write_results.py` makes the docs' tables of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import TypeAlias

import beside
import harness
import numpy as np
import walks
from beside import NEES, RMSE, SPACE, STORED, Result, results_of
from harness import Figure, option
from real_fields import Pair, measure_pairs, print_pairs
from walks import Walk

from fg_nav.arrays import Floats
from fg_nav.ekf import run_iez
from fg_nav.errors import EstimationError, EvaluationError
from fg_nav.evaluation import evaluate
from fg_nav.evaluation.metrics import compute_stance_nees
from fg_nav.recording import Recording
from fg_nav.report.terminal import console
from fg_nav.smoother import SmootherParameters, smooth
from fg_nav.smoother.parameters import PLAIN, WalkParameters
from fg_nav.solution import Solution
from fg_nav.stances import Stances
from fg_nav.truth import TrajectoryTruth
from fg_nav.verdict import judge_path
from fg_nav.walk import Walk as PreparedWalk

Estimate: TypeAlias = Callable[[Recording, Stances], Solution]

METHODS: Mapping[str, Estimate] = {"smoother": smooth, "iez": run_iez}
"""Neither has a magnetometer here: `smoother` is the method `inertial`."""

PYSHOE = {"mean": (0.079, 0.131), "median": (0.055, 0.087)}
"""Rmse in m, horizontal and in space, of PyShoe's own filter."""

ASKED_RMSE = {
    "smoother": {"mean": (0.060, 0.100), "median": (0.045, 0.070)},
    "iez": PYSHOE,
}
SCALE, SCALE_TOLERANCE = "best-fit scale, median", 0.01
NEES_FACTOR = 3.0
OWN_DETECTOR_M, DIVERGED_M = 0.08, 2.0
FOOTPRINTS_M, RIGHT_COUNTS = 0.60, 8
SURVEYED_MEAN_M, SURVEYED_MEDIAN_M, RUN_M, RUN_COUNT_SHARE, RUN_COUNTS = 0.18, 0.12, 1.5, 0.03, 5
CLOSURE_PERCENT = 0.7

VICON_LABELLED, VICON_DETECTED = "Vicon, labels of PyShoe", "Vicon, own stances"
FOOTPRINTS, RUNNING = "gdin, own stances, no magnetometer", "gdin with running strides, for information"
LOOPS = "loops, own stances"
SURVEYED, RUN = "gdlbio, walked", "gdlbio, run or clipped"

SETS_BESIDE: Mapping[str, tuple[tuple[str, ...], str]] = {
    "vicon, labels": ((VICON_LABELLED,), ""),
    "vicon, own stances": ((VICON_DETECTED,), ""),
    "gdin": ((FOOTPRINTS, RUNNING), ""),
    SURVEYED: ((SURVEYED,), ""),
    RUN: ((RUN,), ""),
    "openshoe": ((LOOPS,), "openshoe"),
    "xio": ((LOOPS,), "xio"),
}
"""Sections of each set, and how its walks' names begin."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print, and write what was asked for."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        data=None,
        only=option(list(SETS), "sets of walks", nargs="+", choices=tuple(SETS)),
        per_walk=False,
        ablation=option(False, "what each part of the smoother contributes (slow)"),
        json=None,
    )
    data = walks.data_folder(chosen.data)
    results, figures, pairs = measure_sets(data, chosen.only, chosen.per_walk)
    variants = measure_ablation(data) if chosen.ablation else []
    content = {
        "made": date.today().isoformat(),
        "walks": [result.as_dict() for result in results],
        "magnetometer": [pair.as_dict() for pair in pairs],
        "ablation": variants,
    }
    harness.print_verdict(figures, chosen.json, **content)


Section: TypeAlias = tuple[list[Result], list[Figure]]


def measure_sets(
    data: Path, sets: Sequence[str], per_walk: bool = False
) -> tuple[list[Result], list[Figure], list[Pair]]:
    """Measure and print each set of walks."""
    results: list[Result] = []
    figures: list[Figure] = []
    for name in (name for name in sets if name != "magnetometer"):
        for rows, found in SETS[name](data, per_walk):
            results += rows
            figures += found
            harness.print_figures(found)
    found = beside.judge_sets(results, SETS_BESIDE)
    figures += found
    harness.print_figures(found)
    pairs = measure_pairs(data) if "magnetometer" in sets else []
    return results, figures + print_pairs(pairs), pairs


def _measure_vicon(data: Path, per_walk: bool) -> Iterator[Section]:
    for section, trials, judge in (
        (VICON_LABELLED, walks.read_vicon_labelled, judge_labelled),
        (VICON_DETECTED, walks.read_vicon_detected, judge_detected),
    ):
        yield _measure_section(section, trials(data), TRIAL_COLUMNS if per_walk else None, judge)


def _measure_gdin(data: Path, _: bool) -> Iterator[Section]:
    yield _measure_section(RUNNING, walks.read_gdin(data, walks.RUNNING), FOOTPRINT_COLUMNS, lambda *_: [])
    yield _measure_section(FOOTPRINTS, walks.read_gdin(data), FOOTPRINT_COLUMNS, judge_footprints)


def _measure_gdlbio(data: Path, _: bool) -> Iterator[Section]:
    for section, numbers in ((SURVEYED, walks.GDLBIO_WALKED), (RUN, walks.GDLBIO_RUN)):
        yield _measure_section(section, walks.read_gdlbio(data, numbers), FOOTPRINT_COLUMNS, judge_surveyed)


def _measure_loops(data: Path, _: bool) -> Iterator[Section]:
    yield _measure_section(LOOPS, walks.read_loops(data), CLOSURE_COLUMNS, judge_closures)


def _measure_section(
    section: str,
    chosen: Sequence[Walk],
    columns: Columns | None,
    judge: Callable[[str, Sequence[Result]], list[Figure]],
) -> Section:
    results = run_methods(section, chosen)
    harness.print_heading(section)
    if columns is not None:
        rows = [[r.walk, r.method, *(cell(r) for cell in columns.values())] for r in results]
        harness.print_table(("walk", "method", *columns), rows)
    for result in results:
        if result.failure:
            console().print(f"{result.walk}, {result.method}: {result.failure}")
    return results, judge(section, results)


SETS: Mapping[str, Callable[[Path, bool], Iterator[Section]]] = {
    "vicon": _measure_vicon,
    "gdin": _measure_gdin,
    "gdlbio": _measure_gdlbio,
    "loops": _measure_loops,
    "magnetometer": lambda *_: iter(()),
}


def run_methods(section: str, chosen: Sequence[Walk], methods: Mapping[str, Estimate] = METHODS) -> list[Result]:
    """Run every method on every walk and measure it, and what came with the recording."""
    pairs = [(walk, name) for walk in chosen for name in methods]
    found = harness.map_walks(lambda pair: measure_walk(section, *pair, methods[pair[1]]), pairs, title=section)
    return found + [one for walk in chosen for one in beside.measure_stored(section, walk)]


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
    sigma = float(np.hypot(*solution.stances.position_sigma[-1, :2]))
    verdict = judge_path(PreparedWalk(walk.recording, walk.stances, truth), solution).word
    return Result(section, walk.name, method, metrics, consistency, "", armse_m, sigma, verdict)


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
CLOSURE_COLUMNS: Columns = {
    "distance (m)": _column("distance_m", "{:.1f}"),
    "closure (m)": _column("closure_m", "{:.3f}"),
    "closure (%)": _column("closure_percent", "{:.2f}"),
    "strides": _column("strides_detected", "{:.0f}"),
    "verdict": lambda r: r.verdict,
}


def values(results: Sequence[Result], name: str) -> Floats:
    """Figure of merit `name` (W,) of each walk."""
    return np.array([result.value(name) for result in results])


def median(results: Sequence[Result], name: str) -> float:
    """Median of a figure of merit over the walks."""
    return float(np.median(values(results, name)))


def judge_labelled(section: str, results: Sequence[Result]) -> list[Figure]:
    """Accuracy, scale and honesty with given stances."""
    found = []
    for method in METHODS:
        rows = results_of(results, method)
        for statistic, summary in (("mean", np.mean), ("median", np.median)):
            bounds = ASKED_RMSE[method][statistic]
            for key, plane, bound in zip((RMSE, SPACE), ("2-D", "3-D"), bounds, strict=True):
                name = f"rmse {plane}, {statistic} (m), PyShoe {PYSHOE[statistic][plane == '3-D']:.3f}"
                found.append(Figure(section, name, method, float(summary(values(rows, key))), high=bound))
        low, high, words = 1 / NEES_FACTOR, NEES_FACTOR, "over expectation"
        found += [
            _judge_scale(section, rows, method),
            Figure(section, f"NEES, median {words}", method, median(rows, NEES), low, high, "{:.2f}"),
            Figure(section, f"NEES, mean {words}", method, median(rows, "mean_ratio"), pattern="{:.2f}"),
        ]
    return found


def _judge_scale(section: str, rows: Sequence[Result], method: str) -> Figure:
    low, high = (1 - SCALE_TOLERANCE, 1 + SCALE_TOLERANCE) if method == "smoother" else (-np.inf, np.inf)
    return Figure(section, SCALE, method, median(rows, "scale"), low, high, "{:.4f}")


def judge_detected(section: str, results: Sequence[Result]) -> list[Figure]:
    """Accuracy with our own stances."""
    found = []
    for method in METHODS:
        rows = results_of(results, method)
        asked = OWN_DETECTOR_M if method == "smoother" else np.inf
        found += [
            Figure(section, "rmse 2-D, median (m)", method, median(rows, RMSE), high=asked),
            Figure(section, "rmse 3-D, median (m)", method, median(rows, SPACE)),
            Figure(section, "rmse 3-D, worst trial (m)", method, float(values(rows, SPACE).max()), high=DIVERGED_M),
            Figure(section, "largest error, any trial (m)", method, float(values(rows, "max_error_m").max())),
            Figure(section, SCALE, method, median(rows, "scale"), pattern="{:.4f}"),
        ]
    return found


def judge_footprints(section: str, results: Sequence[Result]) -> list[Figure]:
    """Accuracy at surveyed footprints, scale, stride count."""
    found = []
    for method in METHODS:
        rows = results_of(results, method)
        bound = FOOTPRINTS_M if method == "smoother" else np.inf
        found += [
            Figure(section, "footprint rmse, mean (m)", method, float(values(rows, RMSE).mean()), high=bound),
            Figure(section, "footprint rmse, median (m)", method, median(rows, RMSE)),
            _judge_scale(section, rows, method),
        ]
    first = results_of(results, next(iter(METHODS)))
    right = sum(abs(row.miscount) <= 1 for row in first)
    name = f"stride count within 1, walks of {len(first)}"
    return [*found, Figure(section, name, "both", right, low=RIGHT_COUNTS, pattern="{:.0f}")]


def judge_surveyed(section: str, results: Sequence[Result]) -> list[Figure]:
    """Accuracy at the footprints of walks of which each has its instant, and how many strides were found."""
    asked = {"mean": SURVEYED_MEAN_M, "median": SURVEYED_MEDIAN_M} if section == SURVEYED else {"median": RUN_M}
    found = []
    for method in (*METHODS, STORED):
        rmse = values(results_of(results, method), RMSE)
        for name, summary in (("mean", np.mean), ("median", np.median), ("worst", np.max)):
            bound = asked.get(name, np.inf) if method == "smoother" else np.inf
            found.append(Figure(section, f"footprint rmse, {name} (m)", method, float(summary(rmse)), high=bound))
    first = results_of(results, next(iter(METHODS)))
    right = sum(abs(row.miscount) <= RUN_COUNT_SHARE * row.value("strides_true") for row in first)
    bound = RUN_COUNTS if section == RUN else -np.inf
    unseen = sum(row.is_off_unseen for row in results)
    found.append(Figure(section, "off by 3 sigmas at the end, and not named", "both", unseen, high=0, pattern="{:.0f}"))
    name = f"stride count within {100 * RUN_COUNT_SHARE:.0f} %, walks of {len(first)}"
    return [*found, Figure(section, name, "both", right, low=bound, pattern="{:.0f}")]


def judge_closures(section: str, results: Sequence[Result]) -> list[Figure]:
    """How far the end of a loop is from its beginning."""
    found = []
    for method in METHODS:
        percent = values(results_of(results, method), "closure_percent")
        bound = CLOSURE_PERCENT if method == "smoother" else np.inf
        found += [
            Figure(section, "closure, median (%)", method, float(np.median(percent)), high=bound),
            Figure(section, "closure, worst (%)", method, float(percent.max())),
        ]
    return found


DEFAULT = SmootherParameters()

ABLATION: Mapping[str, SmootherParameters] = {
    "default": DEFAULT,
    "no lever": replace(DEFAULT, known_lever=(0.0, 0.0, 0.0)),
    "rolling trusted": replace(DEFAULT, roll_sigma_m=0.05, gyr_density_deg_s=0.015),
    "no stance refused": replace(DEFAULT, refuse_stances=False),
    "moving foot not counted": replace(DEFAULT, moving_foot=False),
    "no floors": replace(DEFAULT, walk=WalkParameters(floors=False)),
    "no floors, 1.5 mm a sole": replace(DEFAULT, settling_m=0.0015, walk=WalkParameters(floors=False)),
    "plain zero velocity": PLAIN,
    "one node a stance": replace(DEFAULT, shortest_interval_s=1e3),
    "nodes 0.05 s apart": replace(DEFAULT, node_spacing_s=0.05),
    "nodes 0.1 s apart": replace(DEFAULT, node_spacing_s=0.1),
}
"""The smoother without one of its parts. No interval is as long as 1000 s: it then has a single node."""


def measure_ablation(data: Path) -> list[dict[str, object]]:
    """Measure and print every variant of the smoother on the same walks; returns the rows, ready for JSON."""
    readers = walks.read_vicon_labelled, walks.read_gdin, walks.read_loops, walks.read_gdlbio
    chosen = [*(read(data) for read in readers), walks.read_gdlbio(data, walks.GDLBIO_RUN)]
    rows = [{"smoother": name, **measure_variant(name, p, chosen)} for name, p in ABLATION.items()]
    harness.print_heading("What each part of the smoother contributes")
    harness.print_table(list(rows[0]), [[str(cell) for cell in row.values()] for row in rows])
    return rows


def measure_variant(name: str, parameters: SmootherParameters, chosen: Sequence[Sequence[Walk]]) -> dict[str, object]:
    """Figures of one variant on the Vicon trials, the gdin walks, the loops, and gdlbio's walks and runs."""

    def estimate(recording: Recording, stances: Stances) -> Solution:
        return smooth(recording, stances, parameters)

    vicon, gdin, loops, gdlbio, run = (
        results_of(run_methods(name, some, {"smoother": estimate}), "smoother") for some in chosen
    )
    found = {
        "Vicon 2-D mean": float(values(vicon, RMSE).mean()),
        "2-D median": median(vicon, RMSE),
        "3-D mean": float(values(vicon, SPACE).mean()),
        "3-D median": median(vicon, SPACE),
        "scale": median(vicon, "scale"),
        "NEES": median(vicon, NEES),
        "gdin mean": float(values(gdin, RMSE).mean()),
        "gdin median": median(gdin, RMSE),
        "loops, %": median(loops, "closure_percent"),
        "gdlbio mean": float(values(gdlbio, RMSE).mean()),
        "gdlbio median": median(gdlbio, RMSE),
        "gdlbio run, median": median(run, RMSE),
    }
    return {name: harness.finite(float(f"{value:.4g}")) for name, value in found.items()}


if __name__ == "__main__":
    harness.run(main)
