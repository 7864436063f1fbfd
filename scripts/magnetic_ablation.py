"""What each magnetic factor of the smoother brings: each one left out, and each one alone, on the same walks.

    python scripts/magnetic_ablation.py --out DIR [--variants NAME ...] [--scenarios NAME ...] [--fields LEVEL ...]
        [--seeds N] [--first SEED] [--magnetometer loop|perfect] [--jobs N] [--list]

`inertial` is without the field, `default` the smoother as it comes. From there each switch is turned the other way
(`without X`, `with X`), and from all switches off each one is turned on (`only X`); `VARIANTS` has some more. All
variants of a walk share recording, stances, field and the true heading at the start.

Seeds below 100 are for choosing defaults, and are what is run if nothing is said; `--first 101` is for reports. Every
result is a file in DIR (`kept`), and holds as long as its parameters are the same; results of other code are told.

=============== =====================================================================================================
landmarks       mean and largest error over the ground, laid as started, m
rmse, heading   over the footfalls, m and deg; `end` over the ground, m. Medians over the seeds (5 % to 95 %)
NEES            of place and heading at the last footfall over its expectation, mean over the seeds: 1 for an honest
                claim (`fg_nav.evaluation.consistency`); where the claim has no cross terms, that of the two parts
used            share of footfalls whose field was used
cost            runtime over that of `inertial` on the same walk, median
over default    rmse over the default's on the same walk, geometric mean; in the summary over all scenarios and fields
=============== =====================================================================================================
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import harness
import numpy as np
from compare_tables import (
    BUILDING,
    END,
    HEADING_RMSE,
    LANDMARK_MAX,
    LANDMARK_MEAN,
    MALL,
    OFFICE,
    OFFICE_OPEN,
    RMSE,
    STARTED_RMSE,
    Column,
    print_remarks,
    spread,
)

from fg_nav.errors import FgNavError, OutputError
from fg_nav.evaluation import evaluate
from fg_nav.evaluation.consistency import PARTS
from fg_nav.lab.campaign.execute import evaluate_outcome
from fg_nav.lab.campaign.walks import LOOP, PERFECT, Simulated
from fg_nav.lab.simulation import scenario
from fg_nav.lab.store.code import code_sum
from fg_nav.lab.store.results import USED, Key, Result, read_result, write_result
from fg_nav.plain import plain
from fg_nav.report.terminal import console, progress
from fg_nav.smoother import SmootherParameters, smooth
from fg_nav.solution import Solution
from fg_nav.walk import Outcome, Walk

FIRST_SEED, SEEDS = 1, 6
SCENARIOS, FIELDS = (OFFICE, OFFICE_OPEN, BUILDING, MALL), ("smooth", "indoor")

VARIED = ("default", "inertial")
"""Always there: the one all are held against, and the one without the field."""

DEFAULT = SmootherParameters()

Value = Callable[[Result, Result | None], float | None]


@dataclass(frozen=True)
class Variant:
    """Parameters of the smoother, and whether it is given the field."""

    parameters: SmootherParameters = DEFAULT
    field: bool = True


def magnetic(**changes: Any) -> Variant:
    """Return the smoother as it comes but for these magnetic parameters."""
    return Variant(replace(DEFAULT, magnetic=replace(DEFAULT.magnetic, **changes)))


def inertial(**changes: Any) -> Variant:
    """Return the smoother as it comes but for these parameters of sensor and foot."""
    return Variant(replace(DEFAULT, **changes))


def switches() -> list[str]:
    """Names of the magnetic parameters that are on or off."""
    return [one.name for one in fields(DEFAULT.magnetic) if isinstance(getattr(DEFAULT.magnetic, one.name), bool)]


def one_at_a_time() -> dict[str, Variant]:
    """Each magnetic switch turned, from the default and from nothing; those of the walk from the default."""
    off = dict.fromkeys(switches(), False)
    variants = {
        _turned(name, DEFAULT.magnetic): magnetic(**{name: not getattr(DEFAULT.magnetic, name)}) for name in off
    }
    variants |= {f"only {name}": magnetic(**{**off, name: True}) for name in off}
    return variants | {_turned(name, DEFAULT.walk): of_walk(**{name: not on}) for name, on in walk_switches().items()}


def walk_switches() -> dict[str, bool]:
    """Parameters of people and buildings that are on or off."""
    values = {one.name: getattr(DEFAULT.walk, one.name) for one in fields(DEFAULT.walk)}
    return {name: value for name, value in values.items() if isinstance(value, bool)}


def of_walk(**changes: Any) -> Variant:
    """Return the smoother as it comes but for these parameters of people and buildings."""
    return inertial(walk=replace(DEFAULT.walk, **changes))


def _turned(name: str, parameters: object) -> str:
    return f"{'without' if getattr(parameters, name) else 'with'} {name}"


VARIANTS: Mapping[str, Variant] = {
    "default": Variant(),
    "inertial": Variant(field=False),
    **one_at_a_time(),
    "noise of the first solution": magnetic(rounds=1),
    "one round more": magnetic(rounds=DEFAULT.magnetic.rounds + 1),
    "gate qsf-stance": magnetic(gate="qsf-stance"),
    "gate ma2018": magnetic(gate="ma2018"),
    "gate ma2018, hard": magnetic(gate="ma2018", outside_gate=math.inf),
    "gate aiez": magnetic(gate="aiez"),
    "gyro noise as for short walks": inertial(choose_swing_noise=False),
    "gyro noise x 0.25": inertial(choose_swing_noise=False, gyr_relative_density=0.25 * DEFAULT.gyr_relative_density),
    "no outliers": magnetic(outlier_sigmas=1e6),
}
"""By name. More are added here."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Make what is missing, and print."""
    chosen = _parse(arguments)
    if chosen.list:
        for name, variant in VARIANTS.items():
            console().print(f"{name}: {differing(variant)}")
        return
    if chosen.out is None or not chosen.out.is_dir():
        raise OutputError(f"there is no folder {chosen.out} to keep results in: make it, and name it with --out.")
    for name in chosen.scenarios:
        scenario(name)
    names = list(dict.fromkeys((*VARIED, *chosen.variants)))
    keys = [
        Key(group, level, str(seed), chosen.magnetometer, name)
        for group in chosen.scenarios
        for level in chosen.fields
        for name in names
        for seed in range(chosen.first, chosen.first + chosen.seeds)
    ]
    make([key for key in keys if read_result(chosen.out, key, settings_of(key)) is None], chosen.out, chosen.jobs)
    results = [found for key in keys if (found := read_result(chosen.out, key, settings_of(key))) is not None]
    print_all(results)
    print_remarks(results)


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="What each magnetic factor brings.")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder of the results")
    parser.add_argument("--variants", nargs="+", choices=tuple(VARIANTS), default=tuple(VARIANTS), metavar="NAME")
    parser.add_argument("--scenarios", nargs="+", default=SCENARIOS, metavar="NAME")
    parser.add_argument("--fields", nargs="+", default=FIELDS, metavar="LEVEL")
    parser.add_argument("--seeds", type=int, default=SEEDS, metavar="N", help=f"walks of a scenario ({SEEDS})")
    parser.add_argument("--first", type=int, default=FIRST_SEED, metavar="SEED", help=f"the first ({FIRST_SEED})")
    parser.add_argument("--magnetometer", default=LOOP, choices=(LOOP, PERFECT))
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="processes (2)")
    parser.add_argument("--list", action="store_true", help="print the variants and what differs, and stop")
    return parser.parse_args(arguments)


def differing(variant: Variant) -> str:
    """What is not as in the default, in words."""
    if not variant.field:
        return "the field is not given"
    ours, theirs = (
        {**vars(p), **vars(p.magnetic), **vars(p.walk), "magnetic": None, "walk": None}
        for p in (variant.parameters, DEFAULT)
    )
    changed = [name for name in ours if ours[name] != theirs[name]]
    return ", ".join(f"{name} {ours[name]!r}" for name in changed) or "as it comes"


def settings_of(key: Key) -> dict[str, Any]:
    """What a result is made with."""
    variant = VARIANTS[key.method]
    return dict(plain({"parameters": variant.parameters, "field": variant.field}))


def make(missing: Sequence[Key], folder: Path, jobs: int) -> None:
    """Make results, a walk at a time in each process."""
    together: dict[tuple[str, str, str], list[Key]] = {}
    for key in missing:
        together.setdefault((key.group, key.field, key.walk), []).append(key)
    if not together:
        return
    code = code_sum()
    with progress(f"{len(together)} walks") as tell, ProcessPoolExecutor(min(jobs, len(together))) as pool:
        todo = [pool.submit(made, keys, folder, code) for keys in together.values()]
        for done, future in enumerate(as_completed(todo), start=1):
            future.result()
            tell(done / len(todo))


def made(keys: Sequence[Key], folder: Path, code: str) -> None:
    """Simulate one walk and keep what each variant makes of it."""
    first = keys[0]
    source = Simulated(first.group, first.field, int(first.walk))
    session = source.session(first.magnetometer)
    for key in keys:
        blank = Result(key, settings_of(key), code)
        try:
            solution = smoothed(session, VARIANTS[key.method])
            outcome = Outcome(solution, evaluate(solution), None, field_used=True)
            result = evaluate_outcome(blank, source, session, outcome)
        except FgNavError as error:
            result = replace(blank, failed=str(error))
        write_result(folder, result)


def smoothed(session: Walk, variant: Variant) -> Solution:
    """Run the smoother on what the session knows."""
    heading = session.options.heading_deg
    return smooth(
        session.recording,
        session.stances,
        variant.parameters,
        heading=None if heading is None else float(np.deg2rad(heading)),
        field=session.field if variant.field else None,
    )


# --- tables ----------------------------------------------------------------------------------------------------------


def print_all(results: Sequence[Result]) -> None:
    """Print a table for each scenario and field, and the summary."""
    cases: dict[str, dict[str, list[Result]]] = {}
    for result in results:
        key = result.key
        name = f"{key.group}, {key.field}, magnetometer {key.magnetometer}"
        cases.setdefault(name, {}).setdefault(key.method, []).append(result)
    for name, case in cases.items():
        harness.print_heading(f"{name}: {max(map(len, case.values()))} walks, median (5 % to 95 %)")
        harness.print_table(*table(case))
    harness.print_heading("Geometric mean of the rmse over the default's")
    harness.print_table(("variant", "all", *cases), summary(cases))


COLUMNS: Sequence[Column] = (
    replace(LANDMARK_MEAN, head="landmarks, mean (m)"),
    replace(LANDMARK_MAX, head="max (m)"),
    replace(RMSE, head="rmse (m)"),
    HEADING_RMSE,
    replace(END, head="end (m)"),
)


def table(case: Mapping[str, Sequence[Result]]) -> tuple[list[str], list[list[str]]]:
    """Head and one row a variant."""
    values = {
        column: {name: np.array(_values(column.value, some)) for name, some in case.items()} for column in COLUMNS
    }
    shown = [column for column in COLUMNS if any(len(some) for some in values[column].values())]
    rows = [
        [
            name,
            *(spread(values[column][name]) for column in shown),
            _number(nees_ratio(case[name])),
            _number(used_share(case[name])),
            _number(cost_ratio(case, name)),
            _number(over_default(case, name), 3),
        ]
        for name in case
    ]
    return ["variant", *(column.head for column in shown), "NEES", "used", "cost", "over default"], rows


def summary(cases: Mapping[str, Mapping[str, Sequence[Result]]]) -> list[list[str]]:
    """One row a variant, best first."""
    names = dict.fromkeys(name for case in cases.values() for name in case)
    each = {name: [over_default(case, name) for case in cases.values()] for name in names}
    overall = {name: float(np.exp(np.mean(np.log(ratios)))) for name, ratios in each.items()}
    return [
        [name, _number(overall[name], 3), *(_number(one, 3) for one in each[name])]
        for name in sorted(names, key=lambda name: overall[name])
    ]


def _values(value: Value, some: Sequence[Result]) -> list[float]:
    found = [math.inf if result.failed else value(result, None) for result in some]
    return [one for one in found if one is not None] if any(one not in (None, math.inf) for one in found) else []


def nees_ratio(some: Sequence[Result]) -> float:
    """NEES of place and heading at the last footfall over its expectation, mean over the walks."""
    totals = []
    for result in (one for one in some if one.whitened):
        parts = ("pose",) if "pose" in result.whitened else ("position", "heading")
        squares = sum(float(np.sum(np.square(result.whitened[part][-1]))) for part in parts)
        totals.append(squares / sum(PARTS[part] for part in parts))
    return float(np.mean(totals)) if totals else math.nan


def used_share(some: Sequence[Result]) -> float:
    """Share of footfalls whose field was used."""
    marks = "".join(result.used for result in some)
    return marks.count(USED) / len(marks) if marks else math.nan


def cost_ratio(case: Mapping[str, Sequence[Result]], name: str) -> float:
    """Runtime over that without the field on the same walk, median."""
    bare = {result.key.walk: result.runtime_s for result in case.get("inertial", ()) if not result.failed}
    ratios = [
        result.runtime_s / bare[result.key.walk]
        for result in case[name]
        if not result.failed and result.key.walk in bare
    ]
    return float(np.median(ratios)) if ratios else math.nan


def over_default(case: Mapping[str, Sequence[Result]], name: str) -> float:
    """Rmse over the default's on the same walk, geometric mean; infinite where a walk failed."""
    default = {result.key.walk: STARTED_RMSE(result) for result in case.get("default", ())}
    logs = []
    for result in case.get(name, ()):
        ours, theirs = STARTED_RMSE(result), default.get(result.key.walk)
        logs.append(math.log(ours / theirs) if ours and theirs else math.inf)
    return math.exp(math.fsum(logs) / len(logs)) if logs else math.nan


def _number(value: float, digits: int = 2) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else "-"


if __name__ == "__main__":
    harness.run(main)
