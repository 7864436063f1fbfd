"""The filters of the papers and our smoother on the papers' walks, by the papers' own figures, side by side.

    python scripts/compare_ekf.py --out DIR [--methods NAME ...] [--scenarios NAME ...] [--fields LEVEL ...]
        [--seeds N] [--first SEED] [--magnetometer loop|perfect|walk|raw|none ...] [--real gdin openshoe] [--jobs N]

NAME may have a preset behind it, `ma2018:as-printed`; without one it is `tuned`. Fields are the simulator's `smooth`
and `indoor`, and `between`, 0.65 of the first and 0.35 of the second: a compass that waits for a quiet field often
finds it in the first and hardly ever in the second.

Every result is a file in DIR: a run makes what is missing or has other parameters. What other code made is joined, with
a remark; `--renew` makes that again. All methods on a walk share recording, stances and field, and are given the true
heading at the start. Filters are tuned on seeds below 100. What was known of the iron on the shoe is in
`fg_nav.lab.campaign.walks`: `loop` is as Ma did it; real walks have none, and are `walk` or `raw`.

Figures are medians over the walks (5 % to 95 %), of their size where they have a sign; a reduction is that of one walk,
and keeps its sign. A method that fails on a walk is infinitely wrong there. `as started` and `yaw` are two ways to
align a path with the truth, see `fg_nav.lab.walked`; the papers, whose figures stand below ours, do not say
which is theirs. Real walks are aligned by the best yaw (gdin), or end where they began (openshoe).

Are the claims true? `fg_nav.lab.consistency` has the errors over their claim, their parts and the bands.
`end`: share of the walks whose NEES at the last footfall lies within the two-sided 95 % band; `mean`: the same of the
mean over four footfalls; `above`: share above the band. `error / sigma`: rms over walks and footfalls.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeAlias

import harness
import numpy as np
import walks
from harness import FIRST_SEED, format_number, option, spread
from method_plots import Track, plot_detection_maps, plot_error_over_distance, plot_paths
from walks import REAL_WALKS

from fg_nav.arrays import Floats
from fg_nav.errors import SimulationError
from fg_nav.lab.campaign.execute import find_simulated, make, recorded_keys, run_here, settings_of, simulated_keys
from fg_nav.lab.campaign.methods import method_of
from fg_nav.lab.campaign.walks import LOOP, MAGNETOMETERS, MIXTURES, WALK, Recorded, Source
from fg_nav.lab.consistency import PARTS, estimate_freedom_of_mean, nees_band, share_in_band
from fg_nav.lab.landmarks import error_reduction_percent
from fg_nav.lab.reproduce.walks import at_landmarks, mean, used_percent, walk_error
from fg_nav.lab.simulation import scenario
from fg_nav.lab.simulation.scenarios import FIELDS
from fg_nav.lab.store.code import code_sum
from fg_nav.lab.store.results import USED, Key, Result, read_result
from fg_nav.lab.walked import AS_STARTED, BEST_YAW, CLOSURE
from fg_nav.report.terminal import console, progress
from fg_nav.text import format_count

OFFICE, OFFICE_OPEN, MALL, BUILDING = SCENARIOS = ("office", "office-open", "mall", "teaching-building")
LEVELS = ("smooth", "between", "indoor")
METHODS = (
    "iez", "qsf", "qsf-stance", "iqsf", "ma2018", "aiez", "matched", "matched-rts", "inertial", "card", "smoother"
)  # fmt: skip
"""By default; `inertial` is the smoother without the field, `card` with compass and differential field alone."""

REFERENCE, OTHER_REFERENCE = {MALL: "iqsf"}, "iez"
"""Method whose errors the others reduce: on the mall as in the paper, elsewhere the other."""

OPPONENTS = ("ma2018", "matched", "matched-rts", "inertial")
"""Methods under the others' errors, walk by walk: what separates them is where a gain comes from."""

PRINTED: Mapping[tuple[str, str], tuple[str, Mapping[str, str]]] = {
    (OFFICE, "iez"): ("Ma 2018, pure ZUPT", {"end": "2", "heading": "14"}),
    (OFFICE, "iqsf"): ("Ma 2018, iQSF", {"end": "<= 0.5"}),
    (OFFICE, "ma2018"): ("Ma 2018, proposed", {"end": "<= 0.5"}),
    (MALL, "iqsf"): ("Ma 2018, iQSF", {"landmarks": "11.3", "max": "51"}),
    (MALL, "ma2018"): ("Ma 2018, proposed", {"landmarks": "1.5", "max": "3", "reduction": "85"}),
    (BUILDING, "iez"): ("Zhang 2017, IEZ", {"end": "9.49", "TTD": "1.84"}),
    (BUILDING, "qsf-stance"): ("Zhang 2017, + classical QMD", {"end": "7.09", "TTD": "1.38"}),
    (BUILDING, "aiez"): ("Zhang 2017, AIEZ", {"end": "0.79", "TTD": "0.15"}),
}
"""What a paper prints of a method: its words, and figures by the columns' names."""

Case: TypeAlias = Mapping[str, Sequence[Result]]
"""Results by method, of one group, field and magnetometer."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Make what is missing, print, draw."""
    chosen = parse(arguments)
    results = make_results(chosen)
    for name, case in group_cases(results).items():
        print_case(name, case)
        draw_case(chosen.out, name, case)
    print_speed(results)
    print_remarks(results)


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Parse the command line, and refuse what cannot be before anything is simulated."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        out=None,
        methods=METHODS,
        scenarios=SCENARIOS,
        fields=LEVELS,
        magnetometer=option([LOOP], "what is known of the iron", nargs="+", choices=MAGNETOMETERS),
        seeds=20,
        first=FIRST_SEED,
        real=option([], "real walks", nargs="*", choices=tuple(REAL_WALKS)),
        data=None,
        jobs=2,
        renew=option(False, "make again what other code made"),
    )
    for method in chosen.methods:
        method_of(method)
    for name in chosen.scenarios:
        scenario(name)
    for level in chosen.fields:
        if level not in (*FIELDS, *MIXTURES):
            raise SimulationError(f"there is no field '{level}': choose one of {', '.join((*FIELDS, *MIXTURES))}.")
    if chosen.real:
        walks.data_folder(chosen.data)
    harness.check_folder(chosen.out)
    return chosen


# --- results ---------------------------------------------------------------------------------------------------------


def make_results(chosen: argparse.Namespace) -> list[Result]:
    """Return all results that were asked for, made now where they are missing."""
    keys = list_keys(chosen)
    settings = {key: settings_of(key, recorded=key.group in REAL_WALKS) for key in keys}

    def find_source(key: Key) -> Source:
        if key.group in REAL_WALKS:
            return Recorded(walks.real_path(key.group, key.walk, walks.data_folder(chosen.data)))
        return find_simulated(key)

    execute = partial(run_here, workers=chosen.jobs)
    with progress(f"results: {len(keys)}") as report:
        for done, total in make(settings, chosen.out, execute, find_source, chosen.renew):
            report(done / total)
    found = [read_result(chosen.out, key, settings[key]) for key in keys]
    return [one for one in found if one is not None]


def list_keys(chosen: argparse.Namespace) -> list[Key]:
    """Everything asked for, method by method within a case."""
    real = {group: REAL_WALKS[group] for group in chosen.real}
    seeds = harness.seeds_of(chosen)
    simulated = simulated_keys(chosen.scenarios, chosen.fields, chosen.magnetometer, chosen.methods, seeds)
    return simulated + recorded_keys(real, "real", chosen.magnetometer, chosen.methods)


def group_cases(results: Sequence[Result]) -> dict[str, Case]:
    """Results of each case by method, in the order in which they come."""
    cases: dict[str, dict[str, list[Result]]] = {}
    for result in results:
        name = ", ".join((result.key.group, result.key.field, f"magnetometer {result.key.magnetometer}"))
        cases.setdefault(name, {}).setdefault(result.key.method, []).append(result)
    return dict(cases)


# --- figures of a walk -----------------------------------------------------------------------------------------------

Value: TypeAlias = Callable[[Result], float | None]
"""A figure of a result; None where it has none."""


@dataclass(frozen=True)
class Column:
    """A figure by the name that the papers' figures go by; with `of_two` of a walk's and the reference's together.

    `failed` is the figure of a walk on which the method failed: the worst there is, or None to leave the walk out.
    """

    head: str
    value: Value
    paper: str = ""
    failed: float | None = math.inf
    of_two: Callable[[float, float], float] | None = None
    against: str = ""


def error_of(name: str, mode: str = AS_STARTED) -> Value:
    """Size of an error of `WalkErrors` in this alignment."""
    return partial(walk_error, name=name, mode=mode)


def landmark_error(of: Callable[[Sequence[float]], float], mode: str = AS_STARTED) -> Value:
    """Mean or largest error at the crossings of landmarks."""
    return partial(at_landmarks, of=of, mode=mode)


END = Column("end, as started (m)", error_of("end_m"), "end")
HEADING_RMSE = Column("heading rmse (deg)", error_of("heading_rmse_deg"))
RMSE = Column("rmse, as started (m)", error_of("rmse_m"))
LANDMARK_MEAN = Column("mean, as started (m)", landmark_error(mean), "landmarks")
LANDMARK_MAX = Column("max, as started (m)", landmark_error(max))
REDUCED = "reduction of the mean (%)"
REDUCTION = partial(Column, REDUCED, failed=-math.inf, of_two=error_reduction_percent)

TABLES: Mapping[str, Sequence[Column]] = {
    "At the end": (
        END,
        Column("TTD (%)", error_of("end_percent"), "TTD"),
        Column("heading (deg)", error_of("heading_deg"), "heading"),
        Column("heading, aligned (deg)", error_of("heading_laid_deg")),
        Column("height (m)", error_of("end_height_m")),
        Column("end, yaw (m)", error_of("end_m", BEST_YAW)),
        Column("TTD, yaw (%)", error_of("end_percent", BEST_YAW)),
        Column("closure (m)", error_of("end_m", CLOSURE)),
        Column("TTD, closure (%)", error_of("end_percent", CLOSURE)),
    ),
    "Along the walk, at the footfalls": (
        RMSE,
        HEADING_RMSE,
        Column("mean, as started (m)", error_of("mean_m")),
        Column("max, as started (m)", error_of("max_m"), "max"),
        Column("mean, yaw (m)", error_of("mean_m", BEST_YAW)),
        Column("max, yaw (m)", error_of("max_m", BEST_YAW)),
        REDUCTION(value=error_of("mean_m")),
        Column("scale of strides (%)", error_of("length_percent", BEST_YAW)),
        Column("scale of path (%)", error_of("scale_percent", BEST_YAW)),
        Column("field used (%)", used_percent, failed=None),
    ),
    "At the landmarks": (
        LANDMARK_MEAN,
        LANDMARK_MAX,
        Column("mean, yaw (m)", landmark_error(mean, BEST_YAW)),
        Column("max, yaw (m)", landmark_error(max, BEST_YAW)),
        REDUCTION(value=landmark_error(mean), paper="reduction"),
    ),
}

RATIOS = "Error over that of others, walk by walk: at the landmarks, where there are any, else the rmse"


def ratio_columns(case: Case) -> list[Column]:
    """One column for each opponent that is there."""
    landmarks = any(result.landmark_m.get(AS_STARTED) for results in case.values() for result in results)
    value = LANDMARK_MEAN.value if landmarks else RMSE.value
    names = [name for name in OPPONENTS if name in case]
    return [Column(f"over {name}", value, of_two=lambda ours, theirs: ours / theirs, against=name) for name in names]


# --- tables ----------------------------------------------------------------------------------------------------------


def print_case(name: str, case: Case) -> None:
    """Print the tables of a case; one that would be empty is left out, and so is a column."""
    first = next(iter(case.values()))
    against = REFERENCE.get(group := first[0].key.group, OTHER_REFERENCE)
    count = max(len(results) for results in case.values())
    harness.print_heading(f"{name}: {format_count(count, 'walk')}, median (5 % to 95 %)")
    if first[0].key.magnetometer == WALK:
        known = sum(any(note.startswith("corrected by the calibration") for note in one.notes) for one in first)
        print(f"the walk shows its iron on {known} of {len(first)} walks")
    for title, columns in {**TABLES, RATIOS: ratio_columns(case)}.items():
        heads, rows = make_table(columns, case, group, against)
        if len(heads) > 1:
            words = f"; the reduction is against {against}, each preset against its own" if REDUCED in heads else ""
            print(f"\n{title}{words}")
            harness.print_table(heads, rows)
    heads, rows = make_honesty_table(case)
    if rows:
        print("\nAre the claims true: end / mean / above, and error / sigma")
        harness.print_table(heads, rows)


def make_table(columns: Sequence[Column], case: Case, group: str, against: str) -> tuple[list[str], list[list[str]]]:
    """Head and rows; the paper's row below the method's."""
    values = {
        column: {
            method: values_of(column, results, find_reference(case, method, column.against or against))
            for method, results in case.items()
        }
        for column in columns
    }
    shown = [column for column in columns if any(len(some) for some in values[column].values())]
    rows = []
    for method in case:
        rows.append([method, *(spread(values[column][method]) for column in shown)])
        words, printed = PRINTED.get((group, method_of(method).name), ("", {}))
        if any(column.paper in printed for column in shown):
            rows.append([f"  {words}", *(printed.get(column.paper, "") for column in shown)])
    return ["method", *(column.head for column in shown)], rows


def find_reference(case: Case, method: str, against: str) -> dict[str, Result]:
    """Results by walk of the method that this one is compared with: in its own preset, if there are any."""
    name, preset = method_of(method).name, method_of(method).preset
    alike = against if name == method else f"{against}:{preset}"
    return {result.key.walk: result for result in case.get(alike, case.get(against, ()))}


def values_of(column: Column, results: Sequence[Result], reference: Mapping[str, Result]) -> Floats:
    """Figures (W,) of the walks that have one, the worst where the method failed; none where it never has one."""
    some = [_value_of(column, result, reference.get(result.key.walk)) for result in results if not result.failed]
    known = [value for value in some if value is not None]
    failures = 0 if column.failed is None or not known else len(results) - len(some)
    return np.array(known + [column.failed] * failures, dtype=np.float64)


def _value_of(column: Column, result: Result, reference: Result | None) -> float | None:
    ours = column.value(result)
    if column.of_two is None:
        return ours
    if reference is None or reference is result or reference.failed:
        return None
    theirs = column.value(reference)
    return None if ours is None or not theirs else column.of_two(ours, theirs)


def print_speed(results: Sequence[Result]) -> None:
    """Print what a sample costs each method."""
    costs: dict[str, list[float]] = {}
    for result in results:
        if result.samples:
            costs.setdefault(result.key.method, []).append(result.us_per_sample)
    harness.print_heading("Microseconds a sample, of all walks: the least is what a method costs on an idle machine")
    rows = [(name, format_number(min(some)), spread(some)) for name, some in costs.items()]
    harness.print_table(("method", "least", "median (5 % to 95 %)"), rows)


def print_remarks(results: Sequence[Result]) -> None:
    """Print failures by their reason, and how many results are of other code."""
    out = console()
    failed = [result for result in results if result.failed]
    for result in failed[:10]:
        out.print(f"failed: {', '.join((result.key.group, result.key.walk, result.key.method))}: {result.failed}")
    if len(failed) > 10:
        out.print(f"and {len(failed) - 10} more failed")
    old = [result.key.method for result in results if result.code != code_sum()]
    if old:
        methods = ", ".join(dict.fromkeys(old))
        out.print(f"{len(old)} of {len(results)} results were made by other code ({methods}): --renew makes them again")


# --- are the claims true ---------------------------------------------------------------------------------------------


def make_honesty_table(case: Case) -> tuple[list[str], list[list[str]]]:
    """Head and one row a method that claims a covariance: shares within the band by part, and errors over sigmas."""
    rows = []
    for method, results in case.items():
        z = whitened_errors(results)
        if z:
            shares = [_percents(shares_inside(results, part)) if part in z else "-" for part in PARTS]
            sizes = [f"{np.sqrt(np.mean(z[part] ** 2)):.2f}" for part in ("horizontal", "heading", "up")]
            rows.append([method, *shares, *sizes])
    return ["method", *PARTS, "horizontal / sigma", "heading / sigma", "up / sigma"], rows


def _percents(shares: Sequence[float]) -> str:
    return " / ".join("-" if math.isnan(share) else f"{share:.0%}" for share in shares)


def whitened_errors(results: Sequence[Result]) -> dict[str, Floats]:
    """Errors over their claim (S, M, n) by part, of the walks that have one."""
    known = [result.whitened for result in results if result.whitened]
    shared = [part for part in PARTS if known and all(part in one for one in known)]
    return {part: np.array([one[part] for one in known], dtype=np.float64) for part in shared}


def shares_inside(results: Sequence[Result], part: str) -> tuple[float, float, float]:
    """Shares of the walks in the band at the last footfall and in the mean, and above it; a failed one is outside."""
    z = whitened_errors(results)[part]
    n, solved = z.shape[2], sum(not result.failed for result in results) / len(results)
    end = (z[:, -1] ** 2).sum(axis=1)
    of_mean = share_in_band((z**2).sum(axis=2).mean(axis=1), estimate_freedom_of_mean(z), n) if len(z) > 2 else math.nan
    return share_in_band(end, n, n) * solved, of_mean * solved, float(np.mean(end > nees_band(n, n)[1]))


# --- pictures --------------------------------------------------------------------------------------------------------


def draw_case(folder: Path, name: str, case: Case) -> None:
    """Draw paths, detection and errors; the first walk stands for all in the maps."""
    known = {mode for results in case.values() for result in results for mode in result.estimate}
    words_of = {AS_STARTED: "as started", BEST_YAW: "best yaw", CLOSURE: "own frames"}
    mode = next((mode for mode in words_of if mode in known), CLOSURE)
    every = {method: [track_of(one, mode) for one in some if mode in one.estimate] for method, some in case.items()}
    tracks = {method: some for method, some in every.items() if some}
    if not tracks:
        return
    first = [some[0] for some in tracks.values()]
    stem = name.replace(", magnetometer", "").replace(", ", "_").replace(" ", "_")
    walk, words = next(iter(case.values()))[0].key.walk, words_of[mode]
    harness.save_picture(plot_paths(first, f"{name}, walk {walk}, {words}"), folder / f"{stem}_paths.png")
    harness.save_picture(plot_detection_maps(first, f"{name}, walk {walk}"), folder / f"{stem}_detection.png")
    if all(track.every for some in tracks.values() for track in some):
        harness.save_picture(plot_error_over_distance(tracks, f"{name}, {words}"), folder / f"{stem}_errors.png")


def track_of(result: Result, mode: str) -> Track:
    """Return the walk to be drawn, in this alignment with the truth."""
    truth = np.array(result.truth, dtype=np.float64).reshape(-1, 2)
    used = np.array([flag == USED for flag in result.used], dtype=bool)
    return Track(result.key.method, np.array(result.estimate[mode], dtype=np.float64), used, truth, result.every)


if __name__ == "__main__":
    harness.run(main)
