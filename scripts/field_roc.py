"""ROC of the quasi-static field detectors on the simulated `office` and `mall`: Ma et al. 2018, Figures 8, 13, 14.

    python scripts/field_roc.py [--seeds N] [--jobs N] [--scenarios NAME ...] [--out DIR] [--json FILE]

What is taken for the truth, and in which fields, is in `fg_nav.lab.reproduce.ma2018.detections`.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from pathlib import Path

import figures as fig
import numpy as np
from figures import Figure

from fg_nav.arrays import Bools, Floats
from fg_nav.errors import EvaluationError, OutputError
from fg_nav.evaluation import Band, Roc
from fg_nav.lab.reproduce.ma2018.detections import (
    CURVED_DEG,
    FEWEST,
    FIELDS,
    LIMIT_UT,
    MA,
    MA_P_D,
    MA_THRESHOLD,
    OURS,
    STRAIGHT_DEG,
    WINDOW,
    Case,
    Judged,
    by_steel,
    judged,
    stretches,
)
from fg_nav.magnetic import DETECTORS
from fg_nav.report import style
from fg_nav.report.roc import RocPanel, plot_rocs
from fg_nav.report.terminal import progress

FIRST_SEED, SEEDS = 101, 10
SCENARIOS = ("office", "mall")

TRUTHS = (
    ("vector", 2.0, "2 uT"),
    ("vector", 5.0, "5 uT"),
    ("vector", 10.0, "10 uT"),
    ("vector", 20.0, "20 uT"),
    ("heading", 5.0, "5 deg"),
    ("heading", 10.0, "10 deg"),
    ("compass", 5.0, "right"),
)
"""Measure, limit, and head of the column."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Simulate, judge, print, draw."""
    chosen = _parse(arguments)
    if chosen.out is not None and not chosen.out.is_dir():
        raise OutputError(f"there is no folder {chosen.out} to draw into: make it, or name another with --out.")
    seeds = range(FIRST_SEED, FIRST_SEED + chosen.seeds)
    every = all_cases(chosen.scenarios, seeds, chosen.jobs)
    cases = [case for case in every if case.field in FIELDS]
    print_truth(cases, len(seeds))
    for case in cases:
        print_rocs(case)
    print_iron(cases)
    print_threshold(every)
    for case in cases:
        if case.field != "indoor":  # there nothing passes, on whatever way
            print_stretches(case)
    print_worth(cases)
    figures = asked_of(cases)
    fig.print_heading("Against the paper")
    fig.print_figures(figures)
    fig.print_verdict(figures)
    if chosen.json:
        fig.write_json(chosen.json, {"figures": [f.as_dict() for f in figures]})
    if chosen.out is not None:
        style.save(plot_rocs([panel(case) for case in cases], len(FIELDS)), chosen.out / "field_roc.png")


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="ROC of the quasi-static field detectors on simulated walks.")
    parser.add_argument("--seeds", type=int, default=SEEDS, metavar="N", help=f"how many walks, 2 or more ({SEEDS})")
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="processes (2)")
    parser.add_argument("--scenarios", nargs="+", default=SCENARIOS, metavar="NAME", help="which (office, mall)")
    parser.add_argument("--out", type=Path, metavar="DIR", help="draw the curves into this folder")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures to this file")
    chosen = parser.parse_args(arguments)
    if chosen.seeds < 2:
        raise EvaluationError("a band over walks needs two seeds or more: give --seeds 2.")
    return chosen


def all_cases(scenarios: Sequence[str], seeds: Sequence[int], jobs: int) -> list[Case]:
    """Every scenario in every field, those of the sweep too."""
    wanted = [(scenario, seed) for scenario in scenarios for seed in seeds]
    found: list[dict[str, Judged]] = []
    with progress("walks") as report, ExitStack() as stack:
        mapped = map if jobs == 1 else stack.enter_context(ProcessPoolExecutor(jobs)).map
        for walks in mapped(judged, wanted):
            found.append(walks)
            report(len(found) / len(wanted))
    pairs = list(zip(wanted, found, strict=True))
    return [
        Case(scenario, field, [walks[field] for (of, _), walks in pairs if of == scenario])
        for scenario in scenarios
        for field in by_steel()
    ]


def print_truth(cases: Sequence[Case], seeds: int) -> None:
    """What is taken for the truth, and how much of it there is."""
    fig.print_heading(f"Truth: the field at the footfalls, over {WINDOW} strides ({WINDOW + 1} stances), {seeds} seeds")
    print(
        "quasi-static: the field vector (columns in uT), or its direction over the ground (columns in deg), differs\n"
        "by less between any two stances of the window; right: a perfect compass is less than 5 deg wrong here.\n"
        "P_D, P_FA: shares of the truly quasi-static and of the other stances that pass. Prevalence of each truth:"
    )
    rows = [
        (
            case.name,
            str(len(case.walk)),
            f"{np.nanmedian(case.vector_uT):.1f}",
            f"{np.nanmedian(case.heading_deg):.1f}",
            *(_share(case.within(measure, limit), np.isfinite(case.vector_uT)) for measure, limit, _ in TRUTHS),
        )
        for case in cases
    ]
    heads = ("case", "stances", "median uT", "median deg", *(head for *_, head in TRUTHS))
    fig.print_table(heads, rows)


def print_rocs(case: Case) -> None:
    """One row a detector: area, P_D and P_FA at its own threshold, and the area by the other truths."""
    limit = LIMIT_UT[case.field]
    fig.print_heading(f"{case.name}: truth is a change below {limit:g} uT; then the area by other truths")
    rows = []
    for name in DETECTORS:
        others = [case.roc(name, case.within(measure, other)) for measure, other, _ in TRUTHS]
        areas = [f"{roc.area:.2f}" if roc else "-" for roc in others]
        rows.append((name, *_told(case.roc(name)), _share(case.passes(name)), *areas))
    fig.print_table(("detector", "area", "P_D", "P_FA", "passes", *(head for *_, head in TRUTHS)), rows)


def _told(roc: Roc | None) -> tuple[str, str, str]:
    if roc is None:
        return "-", "-", "-"
    p_d, p_fa = roc.band_at(1.0)
    return _banded(roc.area_band()), _banded(p_d), _banded(p_fa)


def _banded(band: Band) -> str:
    return f"{band.value:.2f} ({band.low:.2f} to {band.high:.2f})"


def _share(chosen: Bools, of: Bools | None = None) -> str:
    """Share of those in `of`, or of all; nothing where there are few."""
    among = np.ones(len(chosen), dtype=bool) if of is None else of
    return f"{chosen[among].mean():.3f}" if among.sum() >= FEWEST else "-"


def print_iron(cases: Sequence[Case]) -> None:
    """What the iron of an uncalibrated magnetometer costs."""
    fig.print_heading("Area with a calibrated magnetometer, and with its hard and soft iron (as drawn, 10 uT an axis)")
    rows = []
    for name in DETECTORS:
        pairs = [(case.roc(name), case.roc(name, with_iron=True)) for case in cases]
        rows.append((name, *(f"{a.area:.2f}, {b.area:.2f}" if a and b else "-" for a, b in pairs)))
    fig.print_table(("detector", *(case.name for case in cases)), rows)


def print_threshold(cases: Sequence[Case]) -> None:
    """Where Ma's threshold lies."""
    fig.print_heading(f"Ma's detector as printed: threshold {MA_THRESHOLD:g} (paper: P_D about {MA_P_D:g} there)")
    print(
        "below: P_FA / P_D up to the threshold; beyond: the rise of P_FA over that of P_D from there on; knee: the\n"
        f"threshold at which P_D - P_FA is largest; {OURS}: its P_D at the same P_FA; limit: the truth's limit for\n"
        f"which P_D is {MA_P_D:g} (any: more passes whatever the limit)."
    )
    rows = []
    for case in cases:
        for limit in sorted({LIMIT_UT[case.field], LIMIT_UT["between"]}):
            if (roc := case.roc(MA, case.within("vector", limit))) is not None:
                ours = _at_the_same_p_fa(case.roc(OURS, case.within("vector", limit)), roc.at(1.0)[1])
                passes = _share(case.passes(MA))
                rows.append((case.name, f"{limit:g} uT", passes, *_threshold_row(roc), ours, _told_limit(case)))
    heads = (
        "case",
        "truth",
        "passes",
        "P_D",
        "P_FA",
        "below",
        "beyond",
        "knee",
        "P_D there",
        "P_FA there",
        OURS,
        "limit",
    )
    fig.print_table(heads, rows)


def _threshold_row(roc: Roc) -> tuple[str, ...]:
    p_d, p_fa = roc.band_at(1.0)
    statistic, knee_p_d, knee_p_fa = roc.knee
    below = p_fa.value / p_d.value if p_d.value else np.nan
    beyond = (1 - p_fa.value) / (1 - p_d.value) if p_d.value < 1 else np.nan
    knee = (f"{MA_THRESHOLD * statistic:.0f}", f"{knee_p_d:.2f}", f"{knee_p_fa:.2f}")
    return _banded(p_d), _banded(p_fa), f"{below:.2f}", f"{beyond:.2f}", *knee


def _at_the_same_p_fa(roc: Roc | None, p_fa: float) -> str:
    return f"{roc.p_d_at(np.array([p_fa]))[0]:.2f}" if roc else "-"


def _told_limit(case: Case) -> str:
    limit = limit_for(case.vector_uT, case.statistic(MA), MA_P_D)
    return f"{limit:.1f} uT" if np.isfinite(limit) else "any" if limit > 0 else "none"


def limit_for(change: Floats, statistic: Floats, p_d: float) -> float:
    """Largest limit on the true change for which this share of what is quasi-static passes; NaN if none is.

    Where more passes whatever the limit, it is infinite.
    """
    judged = np.isfinite(statistic) & np.isfinite(change)
    order = np.argsort(change[judged])
    passed = (statistic[judged] < 1.0)[order]
    enough = np.flatnonzero(np.cumsum(passed) >= p_d * np.arange(1, len(passed) + 1))
    enough = enough[enough >= FEWEST - 1]
    if not len(enough):
        return float("nan")
    return float("inf") if enough[-1] == len(passed) - 1 else float(change[judged][order][enough[-1]])


def print_stretches(case: Case) -> None:
    """Ma's Figures 13 and 14: what passes, by how straight the way is."""
    where = stretches(case)
    shares = ", ".join(f"{name} {part.mean():.2f}" for name, part in where.items())
    fig.print_heading(f"{case.name}: share that passes, by the course over the window ({shares} of the stances)")
    print(
        f"straight: the directions of the {WINDOW} strides differ by less than {STRAIGHT_DEG:g} deg; curved: by "
        f"{CURVED_DEG:g} deg or more.\nLast two columns: of what is truly static (below {LIMIT_UT[case.field]:g} uT)."
    )
    rows = []
    for name in DETECTORS:
        passes = case.passes(name)
        by_walk = [passes[case.walk == walk].mean() for walk in range(len(case.walks))]
        low, high = np.percentile(by_walk, [5, 95])
        static = [_share(passes, case.static & where[part]) for part in ("straight", "curved")]
        parts = [_share(passes, part) for part in where.values()]
        rows.append((name, f"{passes.mean():.3f} ({low:.3f} to {high:.3f})", *parts, *static))
    fig.print_table(("detector", "walk (5 to 95 % of seeds)", *where, "static, straight", "static, curved"), rows)


def print_worth(cases: Sequence[Case]) -> None:
    """What a stance that passes is worth."""
    fig.print_heading("Worth of what passes: median (90 %) true change of direction over the window and compass error")
    for case in cases:
        rows = [["(all stances)", "1.000", _spread(case.heading_deg), _spread(case.wrong_deg)]]
        for name in DETECTORS:
            passes = case.passes(name)
            spreads = [_spread(values[passes]) for values in (case.heading_deg, case.wrong_deg)]
            rows.append([name, f"{passes.mean():.3f}", *spreads])
        fig.print_table((case.name, "passes", "change (deg)", "compass error (deg)"), rows)


def _spread(values: Floats) -> str:
    known = values[np.isfinite(values)]
    if len(known) < FEWEST:
        return "-"
    middle, high = np.percentile(known, [50, 90])
    return f"{middle:.1f} ({high:.1f})"


def asked_of(cases: Sequence[Case]) -> list[Figure]:
    """Figures beside what the paper says."""
    found = []
    for case in cases:
        if case.field == "between" and (roc := case.roc(MA)) is not None:
            statement = f"{MA} at {MA_THRESHOLD:g}: P_D"
            found.append(Figure("Figure 8", statement, case.name, roc.at(1.0)[0], 0.7, 0.9))
        if case.scenario == "mall" and case.field == "smooth":
            found += _figures_13_14(case)
    return found


def _figures_13_14(case: Case) -> list[Figure]:
    where = stretches(case)
    asked = {"iqsf": (0.0, 0.5), "ma2018": (0.8, np.inf)}
    found = []
    for name, (low, high) in asked.items():
        for detector in (name, f"{name}-printed"):
            passes = case.passes(detector)
            straight, curved = (float(passes[where[part]].mean()) for part in ("straight", "curved"))
            kept = curved / straight if straight else np.inf
            found.append(Figure("Figures 13, 14", f"{detector}: curved over straight", case.name, kept, low, high))
    return found


def panel(case: Case) -> RocPanel:
    """The case's curves for the picture."""
    rocs = {name: case.roc(name) for name in DETECTORS}
    title = f"{case.name}: change below {LIMIT_UT[case.field]:g} uT"
    return RocPanel(title, {name: roc for name, roc in rocs.items() if roc}, {MA: f"{MA_THRESHOLD:g}"})


if __name__ == "__main__":
    fig.leave_with(main)
