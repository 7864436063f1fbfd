"""Measure what README and docs say of the estimators, and keep it for their tables.

    python scripts/measure.py                                   what there is to measure
    python scripts/measure.py real-walks --only gdin --per-walk
    python scripts/measure.py coverage --seeds 20 --jobs 2 --save

Without `--save` figures are printed alone. With it the rows go to the store, `docs/results/NAME.json`, section by
section, each with date, commit, sum of the code, seeds and command; others stay as they were. `write_results.py` makes
the pages of it. `--store DIR` is another store, for trials.

Parameters were chosen on plateaus seen on the same recordings. Seeds from 101 on are reported.
"""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
from argparse import Namespace
from collections.abc import Mapping, Sequence
from datetime import date
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import harness
from experiments import FAILURE, Experiment, Table, Task, measure_variants, sum_up
from harness import option

from fg_nav.errors import SimulationError
from fg_nav.lab.store.code import source_sum
from fg_nav.lab.store.files import make_folder, write_text
from fg_nav.report.terminal import console

MODULES = ("accuracy", "coverage", "places", "worn", "gait", "online", "cost")
EXPERIMENTS: Mapping[str, Experiment] = {
    name: one for module in MODULES for name, one in import_module(f"experiments.{module}").EXPERIMENTS.items()
}
ROOT = Path(__file__).resolve().parents[1]
STORE = ROOT / "docs" / "results"
OF_A_RUN = ("only", "data", "jobs", "per_walk", "save", "store")  # Options that change no figure.


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print, judge and store one experiment, or list them."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    if not given or given[0] not in EXPERIMENTS:
        if given and not given[0].startswith("-"):
            raise SimulationError(f"there is no experiment '{given[0]}': choose one of {', '.join(EXPERIMENTS)}.")
        print(__doc__)
        harness.print_table(("experiment", ""), [(name, one.question) for name, one in EXPERIMENTS.items()])
        return
    name, experiment = given[0], EXPERIMENTS[given[0]]
    chosen = parse(experiment, given[1:])
    seeds = f"{chosen.first} to {chosen.first + chosen.seeds - 1}" if experiment.seeds else ""
    stamp = make_stamp(write_command(name, experiment, chosen), seeds)
    table = run_tasks(select_tasks(experiment, chosen), chosen.jobs)
    print_sums(experiment, table)
    if chosen.per_walk:
        print_walks(table)
    harness.report_figures([figure for asked in experiment.asked for figure in asked.judge(table)])
    if chosen.save:
        path = save(chosen.store, name, experiment, table, stamp)
        console().print(f"stored: {path}", soft_wrap=True)


def parse(experiment: Experiment, arguments: Sequence[str]) -> Namespace:
    """Parse the options that all experiments have, and the experiment's own."""
    seeds: dict[str, Any] = {"seeds": experiment.seeds, "first": experiment.first} if experiment.seeds else {}
    return harness.parse_arguments(
        experiment.about,
        arguments,
        **seeds,
        only=option(None, "sections whose names begin so", nargs="+", metavar="SECTION"),
        data=None,
        jobs=1,
        per_walk=option(False, "figures of each walk too"),
        save=option(False, "keep the rows in the store"),
        store=option(STORE, "the store", type=Path, metavar="DIR"),
        **experiment.options,
    )


def select_tasks(experiment: Experiment, chosen: Namespace) -> list[Task]:
    """List the walks that were asked for."""
    tasks = [
        task
        for task in experiment.list_tasks(chosen)
        if chosen.only is None or any(task.section.startswith(begin) for begin in chosen.only)
    ]
    if not tasks:
        raise SimulationError("there is no such section: see the first column of the table without --only.")
    return tasks


def run_tasks(tasks: Sequence[Task], jobs: int) -> Table:
    """Measure all walks, in their order."""
    found = harness.map_walks(measure_variants, [task.measure for task in tasks], jobs)
    return Table(
        [
            {"section": task.section, "walk": task.walk, "variant": variant, **figures}
            for task, variants in zip(tasks, found, strict=True)
            for variant, figures in variants.items()
        ]
    )


def print_sums(experiment: Experiment, table: Table) -> None:
    """Print a table of each group of sections that have the same columns, and why figures are missing."""
    for heads, rows in sum_up(table, experiment.columns).items():
        print()
        harness.print_table(heads, rows)
    for row in table.rows:
        if row.get(FAILURE):
            console().print(f"{row['section']}, {row['walk']}, {row['variant']}: {row[FAILURE]}", soft_wrap=True)


def print_walks(table: Table) -> None:
    """Print every figure of every walk."""

    def write(value: object) -> str:
        return "-" if value is None else f"{value:.4g}" if isinstance(value, float) else str(value)

    for section in table.sections:
        some = table.select(section).rows
        names = list(dict.fromkeys(name for row in some for name in row if name != "section"))
        harness.print_heading(section)
        harness.print_table(names, [[write(row.get(name)) for name in names] for row in some])


# --- the store -------------------------------------------------------------------------------------------------------


def save(folder: Path, name: str, experiment: Experiment, table: Table, stamp: Mapping[str, str]) -> Path:
    """Put the sections that were measured in place of what the store has of them; returns the file."""
    path = folder / f"{name}.json"
    old = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {"made": {}, "rows": []}
    rows = [row for row in old["rows"] if row["section"] not in table.sections]
    for row in table.rows:
        known = {key: one for key, one in row.items() if one is not None}
        rows.append({key: float(f"{one:.5g}") if isinstance(one, float) else one for key, one in known.items()})
    made = json.dumps(old["made"] | dict.fromkeys(table.sections, stamp), indent=1)
    lines = ",\n".join(map(json.dumps, rows))  # a line for each, as they are compared
    write_text(make_folder(folder) / path.name, f'{{"made": {made},\n"rows": [\n{lines}\n]}}\n')
    return path


def make_stamp(command: str, seeds: str) -> dict[str, str]:
    """When, by which code and how something is measured; the sum is of one minor version of Python."""
    minor = "{}.{}".format(*sys.version_info)
    stamp = {"date": date.today().isoformat(), "commit": read_commit(), "code": source_sum(), "python": minor}
    return stamp | {"command": command, **({"seeds": seeds} if seeds else {})}


def write_command(name: str, experiment: Experiment, chosen: Namespace) -> str:
    """Words that measure it again: the seeds, and options that are not as by default; an interpreter is one's own."""
    default, words = vars(parse(experiment, [])), ["python", "scripts/measure.py", name]
    for key, value in vars(chosen).items():
        if key in OF_A_RUN or (value == default[key] and key not in ("seeds", "first")):
            continue
        values = ["PYTHON"] if key == "python" else value if isinstance(value, list) else [value]
        words += [f"--{key.replace('_', '-')}", *(f"{one}" for one in values if one is not True)]
    return shlex.join(words)


def read_commit() -> str:
    """Commit of the checkout, with a plus where files differ from it; none outside of one."""
    git = partial(subprocess.run, cwd=ROOT, capture_output=True, text=True)
    commit = git(["git", "rev-parse", "--short=8", "HEAD"]).stdout.strip()
    changed = git(["git", "status", "--porcelain", "--", "fg_nav", "factors", "scripts"]).stdout.strip()
    return f"{commit}+" if commit and changed else commit


if __name__ == "__main__":
    harness.run(main)
