"""The papers' filters, ours and the smoother on the papers' walks, by the papers' own figures, side by side.

    python scripts/compare_ekf.py --quick                 a minute: two walks of a minute each
    python scripts/compare_ekf.py [--methods NAME ...] [--scenarios NAME ...] [--fields LEVEL ...] [--seeds N]
        [--magnetometer loop|perfect|walk|raw|none ...] [--real gdin openshoe] [--jobs N] [--out DIR]

Methods are those of `fg-nav compare`: the filters `iez`, `qsf`, `qsf-stance`, `iqsf`, `ma2018`, `aiez`, `matched` and
any of them with `-rts`; `smoother`, the same without the field (`inertial`), with compass and differential field alone
(`card`, as `--magnetic card`), and `online`. NAME may have a preset behind it, `ma2018:as-printed`; without one it is
`tuned`. All methods on a walk share recording, stances and field, and are given the true heading at the start. Filters
are tuned on seeds below 100.

Each result is a file in the folder, which is made: a run makes what is missing or has other parameters. What other code
made is shown, with a remark; `--renew` makes it again. Fields are the simulator's `smooth` and `indoor`, and `between`,
0.6 of the first and 0.4 of the second. What was known of the iron on the shoe is in `fg_nav.lab.campaign.walks`.

Figures are medians over the walks (5 % to 95 %), of their size. A method that fails on a walk is infinitely wrong
there. `end`, `heading` and `rmse` are as started, over the ground; TTD: the end in % of the distance; `over NAME`: the
rmse, at the landmarks where there are any, over that of another method on the same walk; `sigmas`: error over claimed
sigma of the footfalls, rms. Real walks are laid by the best yaw (gdin), or end where they began (openshoe). What a
paper prints stands below its method. Pictures of a walk: `fg-nav compare RECORDING --plots all`.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import harness
import numpy as np
import walks
from experiments import FAILURE, Column, Table
from harness import FIRST_SEED, option

from fg_nav.lab.campaign.execute import find_simulated, make, recorded_keys, run_here, settings_of, simulated_keys
from fg_nav.lab.campaign.methods import method_of
from fg_nav.lab.campaign.walks import LOOP, MAGNETOMETERS, Recorded, Source
from fg_nav.lab.reproduce.runner import at_landmarks, mean, walk_error
from fg_nav.lab.simulation import scenario
from fg_nav.lab.simulation.scenarios import FIELDS
from fg_nav.lab.store.code import code_sum
from fg_nav.lab.store.files import make_folder
from fg_nav.lab.store.results import Key, Result, read_result
from fg_nav.lab.walked import AS_STARTED, BEST_YAW, CLOSURE
from fg_nav.report.terminal import console, progress
from fg_nav.text import format_count

OFFICE, MALL, BUILDING = "office", "mall", "teaching-building"
SCENARIOS = (OFFICE, "office-open", MALL, BUILDING)
METHODS = (
    "iez", "qsf", "qsf-stance", "iqsf", "ma2018", "aiez", "matched", "matched-rts", "inertial", "card", "smoother",
    "online",
)  # fmt: skip
QUICK = {
    "scenarios": ("demo",), "fields": ("indoor",), "seeds": 2, "magnetometer": ["perfect"], "jobs": 1,
    "methods": ("iez", "ma2018", "ma2018:as-printed", "aiez", "inertial", "card", "smoother", "online"),
}  # fmt: skip
REAL = (walks.GDIN, walks.OPENSHOE)

PRINTED: Mapping[tuple[str, str], tuple[str, Mapping[str, str]]] = {
    (OFFICE, "iez"): ("Ma 2018, pure ZUPT", {"end (m)": "2", "heading (deg)": "14"}),
    (OFFICE, "iqsf"): ("Ma 2018, iQSF", {"end (m)": "<= 0.5"}),
    (OFFICE, "ma2018"): ("Ma 2018, proposed", {"end (m)": "<= 0.5"}),
    (MALL, "iqsf"): ("Ma 2018, iQSF", {"landmarks (m)": "11.3", "most (m)": "51"}),
    (MALL, "ma2018"): ("Ma 2018, proposed", {"landmarks (m)": "1.5", "most (m)": "3"}),
    (BUILDING, "iez"): ("Zhang 2017, IEZ", {"end (m)": "9.49", "TTD (%)": "1.84"}),
    (BUILDING, "qsf-stance"): ("Zhang 2017, + classical QMD", {"end (m)": "7.09", "TTD (%)": "1.38"}),
    (BUILDING, "aiez"): ("Zhang 2017, AIEZ", {"end (m)": "0.79", "TTD (%)": "0.15"}),
}
"""What a paper prints of a method: its words, and figures by the columns' names."""

LANDMARKS, MERIT = "landmarks (m)", "merit"
ERRORS = {"end (m)": "end_m", "TTD (%)": "end_percent", "heading (deg)": "heading_deg", "rmse (m)": "rmse_m",
          "most (m)": "max_m"}  # fmt: skip
COLUMNS = (
    *(Column(head, head, pattern="") for head in (*ERRORS, LANDMARKS, "sigmas")),
    *(Column(MERIT, f"over {method}", pattern="", over=method) for method in ("iez", "ma2018", "inertial")),
)


def main(arguments: Sequence[str] | None = None) -> None:
    """Make what is missing, and print."""
    chosen = parse(arguments)
    results = make_results(chosen)
    print_cases(results)
    print_remarks(results)
    words = "sigmas: rms of errors over their claimed sigmas; over NAME: error over that of NAME on the same walk\n"
    if chosen.quick:
        words += "two walks of a minute rank no methods; where headings drift: --scenarios building-loop\n"
    console().print(f"{words}results: {chosen.out}", soft_wrap=True)


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Parse the command line, and refuse what cannot be before anything is simulated."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        quick=option(False, "two short walks and eight methods, in a minute"),
        out=option(Path("comparison"), "folder of the results", type=Path, metavar="DIR"),
        methods=METHODS,
        scenarios=SCENARIOS,
        fields=option(["smooth", "between", "indoor"], "levels of the field", nargs="+", choices=FIELDS),
        magnetometer=option([LOOP], "what is known of the iron", nargs="+", choices=MAGNETOMETERS),
        seeds=20,
        first=FIRST_SEED,
        real=option([], "real walks", nargs="*", choices=REAL),
        data=None,
        jobs=2,
        renew=option(False, "make again what other code made"),
    )
    if chosen.quick:
        vars(chosen).update(QUICK)
    for method in chosen.methods:
        method_of(method)
    for name in chosen.scenarios:
        scenario(name)
    return chosen


def make_results(chosen: argparse.Namespace) -> list[Result]:
    """Return all results that were asked for, method by method within a case, made now where they are missing."""
    recorded = {
        (name, one.name.removeprefix(f"{name} ")): Recorded(one.path)
        for name in chosen.real
        for one in walks.list_set(walks.data_folder(chosen.data), name)
    }
    named = {name: [walk for group, walk in recorded if group == name] for name in chosen.real}
    seeds = harness.seeds_of(chosen)
    keys = simulated_keys(chosen.scenarios, chosen.fields, chosen.magnetometer, chosen.methods, seeds)
    keys += recorded_keys(named, "real", chosen.magnetometer, chosen.methods)
    folder = make_folder(chosen.out)

    def find_source(key: Key) -> Source:
        """Return a recorded walk, or one of a scenario."""
        return recorded.get((key.group, key.walk)) or find_simulated(key)

    settings = {key: settings_of(key, find_source(key)) for key in keys}
    execute = partial(run_here, workers=chosen.jobs)
    with progress("methods on walks") as report:
        for done, total in make(settings, folder, execute, find_source, renew=chosen.renew):
            report(done / total)
    found = [read_result(folder, key, settings[key]) for key in keys]
    return [one for one in found if one is not None]


# --- tables ----------------------------------------------------------------------------------------------------------


def figures_of(result: Result) -> dict[str, float | str]:
    """Figures of a walk that it has, by the heads of their columns; or why it failed."""
    if result.failed:
        return {FAILURE: result.failed}
    z = result.whitened.get("horizontal")
    # as started; of a real walk by the best yaw, or of its closure
    mode = next((mode for mode in (AS_STARTED, BEST_YAW, CLOSURE) if mode in result.errors), "")
    found = {head: walk_error(result, name, mode) if mode else None for head, name in ERRORS.items()}
    found[LANDMARKS] = at_landmarks(result, mean)
    found |= {} if z is None else {"sigmas": float(np.sqrt(np.mean(np.square(np.asarray(z, dtype=np.float64)))))}
    merit = (found[LANDMARKS], found["rmse (m)"], found["end (m)"])
    found[MERIT] = next((value for value in merit if value is not None), None)
    return {head: value for head, value in found.items() if value is not None}


def print_cases(results: Sequence[Result]) -> None:
    """Print the figures of each group, field and magnetometer, in as many tables as the terminal's width asks for."""
    rows, groups = list[dict[str, Any]](), dict[str, str]()
    for result in results:
        case = f"{result.key.group}, {result.key.field}, magnetometer {result.key.magnetometer}"
        groups[case] = result.key.group
        rows.append({"section": case, "walk": result.key.walk, "variant": result.key.method, **figures_of(result)})
    table = Table(rows)
    for case, group in groups.items():
        methods, names, columns = [v for s, v in table.cases if s == case], list[str](), dict[str, list[str]]()
        count = max(len(table.of(case, method)) for method in methods)
        harness.print_heading(f"{case}: {format_count(count, 'walk')}, median (5 % to 95 %)")
        for method in methods:
            words, printed = PRINTED.get((group, method_of(method).name), ("", {}))
            names += [method, *([f"  {words}"] if printed else [])]
            for column in COLUMNS:
                shown = column.over != method and (not column.over or column.over in methods)
                cells = columns.setdefault(column.head, [])
                cells += [column.write(table, case, method) if shown else ""]
                cells += [printed.get(column.head, "")] if printed else []
        columns = {head: [cell or "-" for cell in cells] for head, cells in columns.items() if any(cells)}
        for heads in fit_columns(names, columns, console().width):
            harness.print_table(("method", *heads), zip(names, *(columns[head] for head in heads), strict=True))
            print()


def fit_columns(names: Sequence[str], columns: Mapping[str, Sequence[str]], width: int) -> list[list[str]]:
    """Group columns so that each group fits in so many characters beside the names."""
    groups, left = list[list[str]](), 0
    for head, cells in columns.items():
        wide = max(map(len, (head, *cells))) + 3
        if not groups or wide > left:
            groups.append([])
            left = width - max(map(len, names)) - 3
        groups[-1].append(head)
        left -= wide
    return groups


def print_remarks(results: Sequence[Result]) -> None:
    """Print failures by their reason, and how many results are of other code."""
    for one in (result for result in results if result.failed):
        console().print(f"failed: {one.key.group}, {one.key.walk}, {one.key.method}: {one.failed}", soft_wrap=True)
    old = [result for result in results if result.code != code_sum()]
    if old:
        methods = ", ".join(dict.fromkeys(result.key.method for result in old))
        words = f"{len(old)} of {len(results)} results were made by other code ({methods}): --renew makes them again"
        console().print(words, soft_wrap=True)


if __name__ == "__main__":
    harness.run(main)
