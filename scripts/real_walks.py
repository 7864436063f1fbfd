"""How good the estimators are on real walks: each figure asked for beside the figure measured.

    python scripts/real_walks.py [--data DIR] [--only vicon|gdin|loops] [--per-trial] [--ablation] [--json FILE]
    python scripts/real_walks.py --magnetometer [--data DIR] [--json FILE]

========= ==========================================================================================================
vicon     rmse over all samples after yaw and position alignment, scale, and NEES of the stance positions, with the
          labels of PyShoe as stances; then rmse with our own stances
gdin      rmse over surveyed footprints after a rigid fit, scale, and stride count
loops     distance from the first stance to the last, in percent of the distance travelled
ablation  what each part of the smoother brings: the same figures without it
magnetic  gdin and the openshoe loops with the magnetometer beside without it: as recorded, and corrected by what the
          walk tells of its iron, where it does (`fg_nav.calibration.walk`). Heading at the start unknown
========= ==========================================================================================================

Nothing is set by walk: every walk of every set runs with the same parameters. PyShoe (Wagstaff, Peretroukhin and
Kelly 2017) is its authors' own filter with the same labels, measured on the same 28 trials in the same way. A walk
that an estimator could not solve counts as infinitely bad.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import TypeAlias

import harness
import numpy as np
import walks
from harness import Figure
from walks import GDIN, OPENSHOE, REAL_WALKS, Walk

from fg_nav.arrays import Floats
from fg_nav.ekf import run_iez
from fg_nav.errors import EstimationError, EvaluationError
from fg_nav.evaluation import Consistency, Metrics, compute_stance_nees, evaluate
from fg_nav.lab.campaign.sources import RAW, WALK, Recorded
from fg_nav.recording import Recording, TrajectoryTruth
from fg_nav.report.terminal import console, progress
from fg_nav.session import Session, solve
from fg_nav.smoother import SmootherParameters, smooth
from fg_nav.smoother.parameters import PLAIN
from fg_nav.solution import Solution
from fg_nav.stances import Stances

Estimate: TypeAlias = Callable[[Recording, Stances], Solution]

METHODS: Mapping[str, Estimate] = {"smoother": smooth, "iez": run_iez}

SETS = ("vicon", "gdin", "loops")

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
CLOSURE_PERCENT = 0.7


@dataclass(frozen=True)
class Result:
    """What a method made of a walk; without `metrics` it failed, and `failure` says how."""

    section: str
    walk: str
    method: str
    metrics: Metrics | None
    consistency: Consistency | None = None
    failure: str = ""

    def value(self, name: str) -> float:
        """Figure of merit `name`, infinite where it could not be had."""
        found = getattr(self.metrics, name, None)
        return float("inf") if found is None else float(found)

    def nees(self, name: str) -> float:
        """Ratio `name` of the NEES of the stance positions to its expectation, infinite without a true path."""
        return float(getattr(self.consistency, name, float("inf")))

    @property
    def miscount(self) -> float:
        """Strides detected, less the true ones."""
        return self.value("strides_detected") - self.value("strides_true")

    def as_dict(self) -> dict[str, object]:
        """Ready for JSON."""
        known: dict[str, object] = {"section": self.section, "walk": self.walk, "method": self.method}
        if self.metrics is not None:
            known |= {name: harness.finite(value) for name, value in self.metrics.as_dict().items()}
        if self.consistency is not None:
            known |= {f"nees_{name}": self.nees(name) for name in ("median_ratio", "mean_ratio")}
        return known | ({"failure": self.failure} if self.failure else {})


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print, and write what was asked for."""
    chosen = _parse(arguments)
    data = walks.data_folder(chosen.data)
    if chosen.magnetometer:
        figures = measure_magnetic(data)
        harness.print_verdict(figures)
        if chosen.json:
            harness.write_json(chosen.json, {"figures": [figure.as_dict() for figure in figures]})
        return
    sets = (chosen.only,) if chosen.only else SETS
    results, figures = measure_sets(data, sets, chosen.per_trial)
    harness.print_verdict(figures)
    variants = ablate(data, sets) if chosen.ablation else []
    if chosen.json:
        content = {
            "figures": [figure.as_dict() for figure in figures],
            "walks": [result.as_dict() for result in results],
            "ablation": variants,
        }
        harness.write_json(chosen.json, content)


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Figures on real walks, asked for and measured.")
    parser.add_argument("--data", type=Path, metavar="DIR", help="folder with the recordings")
    parser.add_argument("--only", choices=SETS, help="one set of walks")
    parser.add_argument("--per-trial", action="store_true", help="a table of every Vicon trial as well")
    parser.add_argument("--magnetometer", action="store_true", help="with and without the magnetometer instead")
    parser.add_argument("--ablation", action="store_true", help="what each part of the smoother brings (slow)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures to this file")
    return parser.parse_args(arguments)


def measure_sets(data: Path, sets: Sequence[str], per_trial: bool = False) -> tuple[list[Result], list[Figure]]:
    """Measure and print each set of walks."""
    results: list[Result] = []
    figures: list[Figure] = []
    for name in sets:
        for rows, found in SECTIONS[name](data, per_trial):
            results += rows
            figures += found
            harness.print_figures(found)
    return results, figures


Section: TypeAlias = tuple[list[Result], list[Figure]]


def _vicon(data: Path, per_trial: bool) -> Iterator[Section]:
    for section, trials, judge in (
        ("Vicon, labels of PyShoe", walks.read_vicon_labelled, labelled_figures),
        ("Vicon, own stances", walks.read_vicon_detected, detected_figures),
    ):
        results = run(section, trials(data))
        harness.print_heading(section)
        if per_trial:
            print_trials(results)
        print_failures(results)
        yield results, judge(section, results)


def _gdin(data: Path, per_trial: bool) -> Iterator[Section]:
    section, aside = "gdin, own stances, no magnetometer", "gdin with running strides, for information"
    results, running = run(section, walks.read_gdin(data)), run(aside, walks.read_gdin(data, walks.RUNNING))
    for words, rows in ((aside, running), (section, results)):
        harness.print_heading(words)
        print_footprints(rows)
        print_failures(rows)
    yield [*results, *running], footprint_figures(section, results)


def _loops(data: Path, per_trial: bool) -> Iterator[Section]:
    section = "loops, own stances"
    results = run(section, walks.read_loops(data))
    harness.print_heading(section)
    print_closures(results)
    print_failures(results)
    yield results, closure_figures(section, results)


SECTIONS: Mapping[str, Callable[[Path, bool], Iterator[Section]]] = {
    "vicon": _vicon,
    "gdin": _gdin,
    "loops": _loops,
}


def run(section: str, chosen: Sequence[Walk], methods: Mapping[str, Estimate] = METHODS) -> list[Result]:
    """Run every method on every walk and measure it."""
    results = []
    with progress(section) as tell:
        for k, walk in enumerate(chosen):
            tell(k / len(chosen))
            results += [measured(section, walk, name, estimate) for name, estimate in methods.items()]
    return results


def measured(section: str, walk: Walk, method: str, estimate: Estimate) -> Result:
    """Run one method on one walk and compare it with the truth, if there is one."""
    truth = walk.recording.truth
    try:
        solution = estimate(walk.recording, walk.stances)
        metrics = evaluate(solution, truth)
        consistency = compute_stance_nees(solution.stances, truth) if isinstance(truth, TrajectoryTruth) else None
    except (EstimationError, EvaluationError) as error:
        return Result(section, walk.name, method, None, failure=str(error))
    return Result(section, walk.name, method, metrics, consistency)


def of_method(results: Sequence[Result], method: str) -> list[Result]:
    """Results of one method."""
    return [result for result in results if result.method == method]


def values(results: Sequence[Result], name: str) -> Floats:
    """Figure of merit `name` (W,) of each walk."""
    return np.array([result.value(name) for result in results])


def labelled_figures(section: str, results: Sequence[Result]) -> list[Figure]:
    """Accuracy, scale and honesty with given stances."""
    found = []
    for method in METHODS:
        rows = of_method(results, method)
        for statistic, summary in (("mean", np.mean), ("median", np.median)):
            bounds = ASKED_RMSE[method][statistic]
            for key, plane, bound in zip(("rmse_2d_m", "rmse_3d_m"), ("2-D", "3-D"), bounds, strict=True):
                beside = PYSHOE[statistic][plane == "3-D"]
                name = f"rmse {plane}, {statistic} (m), PyShoe {beside:.3f}"
                found.append(Figure(section, name, method, float(summary(values(rows, key))), high=bound))
        found += [_scale(section, rows, method), *_honesty(section, rows, method)]
    return found


def _scale(section: str, rows: Sequence[Result], method: str) -> Figure:
    low, high = (1 - SCALE_TOLERANCE, 1 + SCALE_TOLERANCE) if method == "smoother" else (-np.inf, np.inf)
    median = float(np.median(values(rows, "scale")))
    return Figure(section, SCALE, method, median, low, high, "{:.4f}")


def _honesty(section: str, rows: Sequence[Result], method: str) -> list[Figure]:
    """Summarise the NEES: the median over trials of each one's median, and of its mean, over expectation."""
    medians = float(np.median([row.nees("median_ratio") for row in rows]))
    means = float(np.median([row.nees("mean_ratio") for row in rows]))
    bounds = (1 / NEES_FACTOR, NEES_FACTOR)
    return [
        Figure(section, "NEES, median over expectation", method, medians, *bounds, pattern="{:.2f}"),
        Figure(section, "NEES, mean over expectation", method, means, pattern="{:.2f}"),
    ]


def detected_figures(section: str, results: Sequence[Result]) -> list[Figure]:
    """Accuracy with our own stances."""
    found = []
    for method in METHODS:
        rows = of_method(results, method)
        bounds = (OWN_DETECTOR_M, DIVERGED_M) if method == "smoother" else (np.inf, DIVERGED_M)
        flat, space = values(rows, "rmse_2d_m"), values(rows, "rmse_3d_m")
        found += [
            Figure(section, "rmse 2-D, median (m)", method, float(np.median(flat)), high=bounds[0]),
            Figure(section, "rmse 3-D, median (m)", method, float(np.median(space))),
            Figure(section, "rmse 3-D, worst trial (m)", method, float(space.max()), high=bounds[1]),
            Figure(section, "largest error, any trial (m)", method, float(values(rows, "max_error_m").max())),
            Figure(section, SCALE, method, float(np.median(values(rows, "scale"))), pattern="{:.4f}"),
        ]
    return found


def footprint_figures(section: str, results: Sequence[Result]) -> list[Figure]:
    """Accuracy at surveyed footprints, scale, stride count."""
    found = []
    for method in METHODS:
        rows = of_method(results, method)
        bound = FOOTPRINTS_M if method == "smoother" else np.inf
        rmse = values(rows, "rmse_2d_m")
        found += [
            Figure(section, "footprint rmse, mean (m)", method, float(rmse.mean()), high=bound),
            Figure(section, "footprint rmse, median (m)", method, float(np.median(rmse))),
            _scale(section, rows, method),
        ]
    first = of_method(results, next(iter(METHODS)))
    right = sum(abs(row.miscount) <= 1 for row in first)
    name = f"stride count within 1, walks of {len(first)}"
    return [*found, Figure(section, name, "both", right, low=RIGHT_COUNTS, pattern="{:.0f}")]


def closure_figures(section: str, results: Sequence[Result]) -> list[Figure]:
    """How far the end of a loop is from its beginning."""
    found = []
    for method in METHODS:
        percent = values(of_method(results, method), "closure_percent")
        bound = CLOSURE_PERCENT if method == "smoother" else np.inf
        found += [
            Figure(section, "closure, median (%)", method, float(np.median(percent)), high=bound),
            Figure(section, "closure, worst (%)", method, float(percent.max())),
        ]
    return found


def print_trials(results: Sequence[Result]) -> None:
    """One row a trial and method."""
    rows = [
        (
            r.walk,
            r.method,
            *(f"{r.value(name):.3f}" for name in ("rmse_2d_m", "rmse_3d_m", "max_error_m")),
            f"{r.value('scale'):.4f}",
            f"{r.nees('median_ratio'):.2f}",
            f"{r.value('strides_detected'):.0f}",
        )
        for r in results
    ]
    headers = ("trial", "method", "rmse 2-D (m)", "rmse 3-D (m)", "largest (m)", "scale", "NEES", "strides")
    harness.print_table(headers, rows)


def print_footprints(results: Sequence[Result]) -> None:
    """One row a walk and method."""
    rows = [
        (
            r.walk,
            r.method,
            f"{r.value('rmse_2d_m'):.3f}",
            f"{r.value('scale'):.4f}",
            f"{r.value('distance_m'):.1f}",
            f"{r.value('points'):.0f}/{r.value('footprints_surveyed'):.0f}",
            f"{r.value('strides_detected'):.0f}/{r.value('strides_true'):.0f}",
            "" if abs(r.miscount) <= 1 else f"{r.miscount:+.0f}",
        )
        for r in results
    ]
    headers = ("walk", "method", "rmse (m)", "scale", "distance (m)", "footprints", "strides", "")
    harness.print_table(headers, rows)


def print_closures(results: Sequence[Result]) -> None:
    """One row a walk and method."""
    rows = [
        (
            r.walk,
            r.method,
            f"{r.value('distance_m'):.1f}",
            f"{r.value('closure_m'):.3f}",
            f"{r.value('closure_percent'):.2f}",
            f"{r.value('strides_detected'):.0f}",
        )
        for r in results
    ]
    headers = ("walk", "method", "distance (m)", "closure (m)", "closure (%)", "strides")
    harness.print_table(headers, rows)


def print_failures(results: Sequence[Result]) -> None:
    """Name the walks without a result, and why."""
    for result in results:
        if result.failure:
            console().print(f"{result.walk}, {result.method}: {result.failure}")


# --- with the magnetometer -------------------------------------------------------------------------------------------

MAGNETIC_M, NO_WORSE, MAGNETIC_CLOSURE_PERCENT = 0.45, 1.10, 0.5
"""Mean footprint rmse, m; greatest ratio of any walk's to its own without the field; median closure, %."""

KNOWN_IRON: Mapping[str, str] = {RAW: "as recorded", WALK: "calibrated on the walk"}


@dataclass(frozen=True)
class Pair:
    """A figure of merit of one walk without the field and with it, by what was known of the iron; infinite: failed."""

    walk: str
    without: float
    with_field: Mapping[str, float]
    calibrated: bool

    def ratio(self, iron: str) -> float:
        """With the field over without it."""
        return self.with_field[iron] / self.without


def measure_magnetic(data: Path, names: Mapping[str, Sequence[str]] = REAL_WALKS) -> list[Figure]:
    """Measure and print; returns the figures."""
    figures = []
    for group, what in ((GDIN, "footprint rmse (m)"), (OPENSHOE, "closure (%)")):
        pairs = [pair(group, walk, data) for walk in names[group]]
        harness.print_heading(f"{group}: {what}, without the magnetometer and with it")
        print_pairs(pairs)
        found = [figure for iron in KNOWN_IRON for figure in pair_figures(group, pairs, iron)]
        harness.print_figures(found)
        figures += found
    return figures


def pair(group: str, walk: str, data: Path) -> Pair:
    """One walk without the field and with it."""
    source = Recorded(walks.real_path(group, walk, data))
    sessions = {iron: source.session(iron) for iron in KNOWN_IRON}
    return Pair(
        f"{group} {walk}",
        merit(sessions[RAW], "inertial"),
        {iron: merit(session, "smoother") for iron, session in sessions.items()},
        sessions[WALK].calibration is not None,
    )


def merit(session: Session, method: str) -> float:
    """Footprint rmse in m where there is a truth, else closure in percent; infinite where the method fails."""
    try:
        metrics = solve(session, method).metrics
    except (EstimationError, EvaluationError):
        return float("inf")
    value = metrics.closure_percent if session.truth is None else metrics.rmse_2d_m
    return float("inf") if value is None else value


def print_pairs(pairs: Sequence[Pair]) -> None:
    """One row a walk."""
    rows = [
        (
            one.walk,
            f"{one.without:.3f}",
            *(f"{one.with_field[iron]:.3f} ({one.ratio(iron):.2f})" for iron in KNOWN_IRON),
            "yes" if one.calibrated else "no",
        )
        for one in pairs
    ]
    harness.print_table(
        ("walk", "without", *(f"{words} (ratio)" for words in KNOWN_IRON.values()), "told its iron"), rows
    )


def pair_figures(group: str, pairs: Sequence[Pair], iron: str) -> list[Figure]:
    """What is asked with the magnetometer."""
    some = np.array([one.with_field[iron] for one in pairs])
    worst = max(one.ratio(iron) for one in pairs)
    name = f"{KNOWN_IRON[iron]}: greatest ratio to without"
    if group == OPENSHOE:
        median = float(np.median(some))
        words = f"{KNOWN_IRON[iron]}: closure, median (%)"
        return [
            Figure(group, words, "smoother", median, high=MAGNETIC_CLOSURE_PERCENT),
            Figure(group, name, "smoother", worst, pattern="{:.2f}"),
        ]
    return [
        Figure(group, f"{KNOWN_IRON[iron]}: rmse, mean (m)", "smoother", float(some.mean()), high=MAGNETIC_M),
        Figure(group, name, "smoother", worst, high=NO_WORSE, pattern="{:.2f}"),
    ]


# --- the smoother's parts --------------------------------------------------------------------------------------------

DEFAULT = SmootherParameters()

ABLATION: Mapping[str, SmootherParameters] = {
    f"default (nodes {DEFAULT.node_spacing_s:g} s apart)": DEFAULT,
    "foot does not roll (no lever)": replace(DEFAULT, known_lever=(0.0, 0.0, 0.0)),
    "sole does not settle": replace(DEFAULT, settling_m=0.0),
    "plain zero velocity": PLAIN,
    "one node a stance": replace(DEFAULT, shortest_interval_s=1e3),
    "nodes 0.05 s apart": replace(DEFAULT, node_spacing_s=0.05),
    "nodes 0.1 s apart": replace(DEFAULT, node_spacing_s=0.1),
    "nodes 0.2 s apart": replace(DEFAULT, node_spacing_s=0.2),
}
"""The smoother without one of its parts. No interval is as long as 1000 s: it then has a single node."""


def ablate(data: Path, sets: Sequence[str] = SETS) -> list[dict[str, object]]:
    """Measure and print every variant of the smoother on the same walks; returns the rows, ready for JSON."""
    chosen = _walks_of(data, sets)
    rows = [_variant(name, parameters, chosen) for name, parameters in ABLATION.items()]
    headers = list(dict.fromkeys(key for row in rows for key in row))
    cells = [[_cell(row[key]) for key in headers] for row in rows]
    harness.print_heading("What each part of the smoother brings")
    harness.print_table(headers, cells)
    return [{key: harness.finite(value) for key, value in row.items()} for row in rows]


def _walks_of(data: Path, sets: Sequence[str]) -> dict[str, list[Walk]]:
    load = {"vicon": walks.read_vicon_labelled, "gdin": walks.gdin, "loops": walks.read_loops}
    return {name: load[name](data) for name in sets}


def _variant(name: str, parameters: SmootherParameters, chosen: Mapping[str, Sequence[Walk]]) -> dict[str, object]:
    def estimate(recording: Recording, stances: Stances) -> Solution:
        return smooth(recording, stances, parameters)

    row: dict[str, object] = {"smoother": name}
    failed, began = 0, perf_counter()
    for section, some in chosen.items():
        results = run(f"{name}, {section}", some, {"smoother": estimate})
        row |= _summary(section, results)
        failed += sum(bool(result.failure) for result in results)
    return row | {"failed": failed, "time (s)": perf_counter() - began}


def _summary(section: str, results: Sequence[Result]) -> dict[str, float]:
    if section == "loops":
        return {"loops closure median (%)": float(np.median(values(results, "closure_percent")))}
    flat, scale = values(results, "rmse_2d_m"), float(np.median(values(results, "scale")))
    if section == "gdin":
        return {"gdin mean (m)": float(flat.mean()), "gdin median": float(np.median(flat)), "gdin scale": scale}
    space = values(results, "rmse_3d_m")
    return {
        "Vicon 2-D mean (m)": float(flat.mean()),
        "2-D median": float(np.median(flat)),
        "3-D mean": float(space.mean()),
        "3-D median": float(np.median(space)),
        "scale": scale,
        "NEES": float(np.median([result.nees("median_ratio") for result in results])),
    }


def _cell(value: object) -> str:
    return f"{value:.4f}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    harness.run(main)
