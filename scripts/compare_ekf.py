"""The filters of the papers and our smoother on the papers' walks, by the papers' own figures, side by side.

    python scripts/compare_ekf.py --out DIR [--methods NAME ...] [--scenarios NAME ...] [--fields LEVEL ...]
        [--seeds N] [--first SEED] [--magnetometer loop|perfect|walk|raw|none ...] [--real gdin openshoe] [--jobs N]

NAME may have a preset behind it, `ma2018:as-printed`; without one it is `tuned`. Fields are the simulator's `smooth`
and `indoor`, and `between`, 0.65 of the first and 0.35 of the second (`field_roc`): a compass that waits for a quiet
field often finds it in the first and hardly ever in the second.

Every result is a file in DIR (`kept`): a run makes what is missing or has other parameters, and prints and draws all
that was asked for. What other code made is joined and told; `--renew` makes that anew. All
methods on a walk share recording, stances and field, and are told the heading at the start, the true one; Munich has
no declination, so that a compass and the truth have the same north. Seeds begin at 101: filters are tuned below 100.

What was known of the iron on the shoe is in `fg_nav.lab.campaign.walks`: `loop` is as Ma did it, and the default.
Real walks have no loop, and are `walk` unless they are to be `raw`.

Figures are medians over the walks (5 % to 95 %), of their size where they have a sign. A method that fails on a walk
is infinitely wrong there. `as started` and `yaw` are two ways to lay a path on the truth, see
`fg_nav.evaluation.walked`; the papers' figures stand below ours, and the papers do not say which of the two is theirs.
Real walks have no true heading at the start and are laid by the best yaw (gdin, surveyed footprints), or have no truth
but that they end where they began (openshoe).
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import harness
import numpy as np
import walks
from compare_tables import (
    BUILDING,
    MALL,
    OFFICE,
    OFFICE_OPEN,
    Case,
    by_case,
    judged,
    print_case,
    print_remarks,
    print_speed,
)
from walks import GDIN, OPENSHOE, REAL_WALKS

from fg_nav.errors import OutputError, SimulationError
from fg_nav.evaluation.walked import AS_STARTED, BEST_YAW, CLOSURE
from fg_nav.lab.campaign.execute import recorded_keys, settings_of, simulated_keys, store_task, tasks_of
from fg_nav.lab.campaign.methods import method_of
from fg_nav.lab.campaign.walks import LOOP, MAGNETOMETERS, MIXTURES, Recorded
from fg_nav.lab.processes import run_tasks
from fg_nav.lab.simulation import scenario
from fg_nav.lab.simulation.scenarios import FIELDS
from fg_nav.lab.store.code import code_sum
from fg_nav.lab.store.results import USED, Key, Result, read_result
from fg_nav.report.plots import style
from fg_nav.report.plots.methods import Track, plot_detection_maps, plot_error_over_distance, plot_paths
from fg_nav.report.terminal import progress

FIRST_SEED, SEEDS = 101, 20
REAL_FIELD = "real"

METHODS = ("iez", "qsf", "qsf-stance", "iqsf", "ma2018", "aiez", "matched", "matched-rts", "inertial", "smoother")
"""Where nothing else is said; `inertial` is the smoother without the field."""


@dataclass(frozen=True)
class Chosen:
    """What was asked for."""

    methods: Sequence[str]
    scenarios: Sequence[str]
    fields: Sequence[str]
    magnetometers: Sequence[str]
    seeds: Sequence[int]
    real: Sequence[str]
    out: Path
    jobs: int = 2
    renew: bool = False
    data: Path | None = None
    reference: str | None = None


def main(arguments: Sequence[str] | None = None) -> None:
    """Make what is missing, print, draw."""
    chosen = checked(_parse(arguments))
    results = make_missing(chosen)
    cases = by_case(results)
    for name, case in cases.items():
        print_case(name, case, chosen.reference)
        draw_case(chosen.out, name, case)
    print_speed(results)
    figures = judged(cases)
    if figures:
        harness.print_heading("What was asked")
        harness.print_figures([replace(one, name=f"{one.section}: {one.name}") for one in figures])
        harness.print_verdict(figures)
    print_remarks(results)


def make_missing(chosen: Chosen) -> list[Result]:
    """Return all results that were asked for, made now where they are missing."""
    keys = all_keys(chosen)
    settings = {key: settings_of(key, recorded=key.group in REAL_WALKS) for key in keys}
    real = {(key.group, key.walk) for key in keys if key.group in REAL_WALKS}
    recorded = {one: Recorded(walks.real_path(*one, walks.data_folder(chosen.data))) for one in real}
    found = {key: read_result(chosen.out, key, settings[key]) for key in keys}
    missing = [key for key, one in found.items() if one is None or (chosen.renew and one.code != code_sum())]
    tasks = [partial(store_task, task, chosen.out, code_sum()) for task in tasks_of(missing, settings, recorded)]
    if tasks:
        with progress(f"{len(tasks)} walks") as report:
            for done, _ in enumerate(run_tasks(tasks, chosen.jobs), start=1):
                report(done / len(tasks))
    found |= {key: read_result(chosen.out, key, settings[key]) for key in missing}
    return [one for one in found.values() if one is not None]


def _parse(arguments: Sequence[str] | None) -> Chosen:
    parser = argparse.ArgumentParser(description="The papers' filters and our smoother on the papers' walks.")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of results and pictures")
    parser.add_argument("--methods", nargs="+", default=list(METHODS), metavar="NAME[:PRESET]")
    parser.add_argument("--scenarios", nargs="*", default=[OFFICE, OFFICE_OPEN, BUILDING, MALL], metavar="NAME")
    parser.add_argument("--fields", nargs="+", default=["smooth", "between", "indoor"], metavar="LEVEL")
    parser.add_argument("--magnetometer", nargs="+", default=[LOOP], choices=MAGNETOMETERS)
    parser.add_argument("--seeds", type=int, default=SEEDS, metavar="N", help=f"walks of a scenario ({SEEDS})")
    parser.add_argument("--first", type=int, default=FIRST_SEED, metavar="SEED", help=f"the first ({FIRST_SEED})")
    parser.add_argument("--real", nargs="*", default=[], choices=(GDIN, OPENSHOE), help="real walks (none)")
    parser.add_argument("--data", type=Path, metavar="DIR", help="folder of the real walks")
    parser.add_argument("--reference", metavar="NAME", help="method that the reduction refers to")
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="processes (2)")
    parser.add_argument("--renew", action="store_true", help="make anew what other code made")
    given = parser.parse_args(arguments)
    return Chosen(
        methods=given.methods,
        scenarios=given.scenarios,
        fields=given.fields,
        magnetometers=given.magnetometer,
        seeds=range(given.first, given.first + given.seeds),
        real=given.real,
        out=given.out,
        jobs=given.jobs,
        renew=given.renew,
        data=given.data,
        reference=given.reference,
    )


def checked(chosen: Chosen) -> Chosen:
    """Refuse what cannot be before anything is simulated."""
    for method in chosen.methods:
        method_of(method)
    for name in chosen.scenarios:
        scenario(name)
    for level in chosen.fields:
        if level not in (*FIELDS, *MIXTURES):
            raise SimulationError(f"there is no field '{level}': choose one of {', '.join((*FIELDS, *MIXTURES))}.")
    if chosen.real:
        walks.data_folder(chosen.data)
    if not chosen.out.is_dir():
        raise OutputError(f"there is no folder {chosen.out} to keep results in: make it, or name another with --out.")
    return chosen


def all_keys(chosen: Chosen) -> list[Key]:
    """Everything asked for, method by method within a case."""
    real = {group: REAL_WALKS[group] for group in chosen.real}
    simulated = (chosen.scenarios, chosen.fields, chosen.magnetometers, chosen.methods, chosen.seeds)
    return simulated_keys(*simulated) + recorded_keys(real, REAL_FIELD, chosen.magnetometers, chosen.methods)


def draw_case(folder: Path, name: str, case: Case) -> None:
    """Draw paths, detection and errors; the first walk stands for all in the maps."""
    mode, words = _drawn_mode(case)
    tracks = {
        method: [track_of(result, mode) for result in results if mode in result.estimate]
        for method, results in case.items()
    }
    tracks = {method: some for method, some in tracks.items() if some}
    if not tracks:
        return
    first = [some[0] for some in tracks.values()]
    stem = name.replace(", magnetometer", "").replace(", ", "_").replace(" ", "_")
    walk = next(iter(case.values()))[0].key.walk
    style.save(plot_paths(first, f"{name}, walk {walk}, {words}"), folder / f"{stem}_paths.png")
    style.save(plot_detection_maps(first, f"{name}, walk {walk}"), folder / f"{stem}_detection.png")
    if all(track.every for some in tracks.values() for track in some):
        style.save(plot_error_over_distance(tracks, f"{name}, {words}"), folder / f"{stem}_errors.png")


def track_of(result: Result, mode: str) -> Track:
    """Return the walk to be drawn, laid on the truth by this alignment."""
    truth = np.array(result.truth, dtype=np.float64).reshape(-1, 2)
    used = np.array([flag == USED for flag in result.used], dtype=bool)
    return Track(result.key.method, np.array(result.estimate[mode], dtype=np.float64), used, truth, result.every)


def _drawn_mode(case: Case) -> tuple[str, str]:
    known = {mode for results in case.values() for result in results for mode in result.estimate}
    for mode, words in ((AS_STARTED, "as started"), (BEST_YAW, "best yaw")):
        if mode in known:
            return mode, words
    return CLOSURE, "own frames"


if __name__ == "__main__":
    harness.run(main)
