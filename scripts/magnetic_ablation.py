"""What each magnetic factor of the smoother contributes: each one left out, and each one alone, on the same walks.

    python scripts/magnetic_ablation.py --out DIR [--variants NAME ...] [--scenarios NAME ...] [--fields LEVEL ...]
        [--seeds N] [--first SEED] [--magnetometer loop|perfect] [--jobs N] [--list]

`inertial` is without the field, `default` the smoother as it comes. From there each switch is turned the other way
(`without X`, `with X`), and from all switches off each one is turned on (`only X`); `VARIANTS` has some more. All
variants of a walk share recording, stances, field and the true heading at the start.

Seeds below 100 are for choosing defaults, and are the default here; `--first 101` is for reports. Every result is a
file in DIR, and holds as long as its parameters are the same; results of other code are joined with a remark.

=============== =====================================================================================================
landmarks       mean and largest error over the ground, as started, m
rmse, heading   over the footfalls, m and deg; `end` over the ground, m. Medians over the seeds (5 % to 95 %)
NEES            of place and heading at the last footfall over its expectation, mean over the seeds: 1 for an honest
                claim (`fg_nav.evaluation.metrics`); where the claim has no cross terms, that of the two parts
used            share of footfalls whose field was used
cost            runtime over that of `inertial` on the same walk, median
over default    rmse over the default's on the same walk, geometric mean; in the summary over all scenarios and fields
=============== =====================================================================================================
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import harness
import numpy as np
from compare_ekf import (
    END,
    HEADING_RMSE,
    LANDMARK_MAX,
    LANDMARK_MEAN,
    RMSE,
    SCENARIOS,
    group_cases,
    print_remarks,
    values_of,
    whitened_errors,
)
from harness import option, spread

from fg_nav.errors import FgNavError
from fg_nav.evaluation import evaluate
from fg_nav.evaluation.metrics import PARTS
from fg_nav.lab.campaign.execute import evaluate_outcome
from fg_nav.lab.campaign.walks import LOOP, PERFECT, Simulated
from fg_nav.lab.simulation import scenario
from fg_nav.lab.store.code import code_sum
from fg_nav.lab.store.results import USED, Key, Result, read_result, write_result
from fg_nav.report.terminal import console
from fg_nav.smoother import SmootherParameters, smooth
from fg_nav.solution import Solution
from fg_nav.text import to_json
from fg_nav.walk import Outcome, Walk

VARIED = ("default", "inertial")
"""Always there: the one all are compared with, and the one without the field."""

DEFAULT = SmootherParameters()


@dataclass(frozen=True)
class Variant:
    """Parameters of the smoother, and whether it is given the field."""

    parameters: SmootherParameters = DEFAULT
    field: bool = True


def vary_magnetic(**changes: Any) -> Variant:
    """Return the smoother as it comes but for these magnetic parameters."""
    return Variant(replace(DEFAULT, magnetic=replace(DEFAULT.magnetic, **changes)))


def list_switches(parameters: Any) -> dict[str, bool]:
    """Parameters that are on or off."""
    values = {one.name: getattr(parameters, one.name) for one in fields(parameters)}
    return {name: value for name, value in values.items() if isinstance(value, bool)}


def turn_switches() -> dict[str, Variant]:
    """Each magnetic switch turned, from the default and from nothing; those of the walk from the default."""
    magnetic, walk = list_switches(DEFAULT.magnetic), list_switches(DEFAULT.walk)
    off = dict.fromkeys(magnetic, False)
    turned = {name: "without" if on else "with" for name, on in {**magnetic, **walk}.items()}
    return {
        **{f"{turned[name]} {name}": vary_magnetic(**{name: not on}) for name, on in magnetic.items()},
        **{f"only {name}": vary_magnetic(**{**off, name: True}) for name in off},
        **{
            f"{turned[name]} {name}": Variant(replace(DEFAULT, walk=replace(DEFAULT.walk, **{name: not on})))
            for name, on in walk.items()
        },
    }


SWING = {"choose_swing_noise": False}

VARIANTS: Mapping[str, Variant] = {
    "default": Variant(),
    "inertial": Variant(field=False),
    **turn_switches(),
    "noise of the first solution": vary_magnetic(rounds=1),
    "one round more": vary_magnetic(rounds=DEFAULT.magnetic.rounds + 1),
    **{f"gate {name}": vary_magnetic(gate=name) for name in ("none", "aiez", "qsf", "iqsf", "qsf-stance")},
    "gyro noise as for short walks": Variant(replace(DEFAULT, **SWING)),
    "gyro noise x 0.25": Variant(replace(DEFAULT, **SWING, gyr_relative_density=0.25 * DEFAULT.gyr_relative_density)),
}
"""By name. More are added here."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Make what is missing, and print."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        out=None,
        variants=option(list(VARIANTS), "of the smoother", nargs="+", choices=tuple(VARIANTS), metavar="NAME"),
        scenarios=SCENARIOS,
        fields=("smooth", "indoor"),
        seeds=6,
        first=1,
        magnetometer=option(LOOP, "what is known of the iron", choices=(LOOP, PERFECT)),
        jobs=2,
        list=option(False, "print the variants and what differs, and stop"),
    )
    if chosen.list:
        for name, variant in VARIANTS.items():
            console().print(f"{name}: {describe(variant)}")
        return
    harness.check_folder(chosen.out)
    for name in chosen.scenarios:
        scenario(name)
    keys = [
        Key(group, level, str(seed), chosen.magnetometer, name)
        for group in chosen.scenarios
        for level in chosen.fields
        for name in dict.fromkeys((*VARIED, *chosen.variants))
        for seed in harness.seeds_of(chosen)
    ]
    missing: dict[tuple[str, str, str], list[Key]] = {}
    for key in keys:
        if read_result(chosen.out, key, settings_of(key)) is None:
            missing.setdefault((key.group, key.field, key.walk), []).append(key)
    if missing:
        harness.map_walks(partial(make_walk, chosen.out, code_sum()), missing.values(), chosen.jobs)
    results = [found for key in keys if (found := read_result(chosen.out, key, settings_of(key))) is not None]
    print_all(results)
    print_remarks(results)


def describe(variant: Variant) -> str:
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
    return dict(to_json({"parameters": variant.parameters, "field": variant.field}))


def make_walk(folder: Path, code: str, keys: Sequence[Key]) -> None:
    """Simulate one walk and keep what each variant makes of it."""
    first = keys[0]
    source = Simulated(first.group, first.field, int(first.walk))
    walk = source.prepare(first.magnetometer)
    for key in keys:
        blank = Result(key, settings_of(key), code)
        try:
            solution = smooth_variant(walk, VARIANTS[key.method])
            outcome = Outcome(solution, evaluate(solution), None, field_used=True)
            result = evaluate_outcome(blank, source, walk, outcome)
        except FgNavError as error:
            result = replace(blank, failed=str(error))
        write_result(folder, result)


def smooth_variant(walk: Walk, variant: Variant) -> Solution:
    """Run the smoother on what the walk shows."""
    degrees = walk.options.heading_deg
    return smooth(
        walk.recording,
        walk.stances,
        variant.parameters,
        heading=None if degrees is None else float(np.deg2rad(degrees)),
        field=walk.field if variant.field else None,
    )


# --- tables ----------------------------------------------------------------------------------------------------------


def print_all(results: Sequence[Result]) -> None:
    """Print a table for each scenario and field, and the summary."""
    cases = group_cases(results)
    for name, case in cases.items():
        harness.print_heading(f"{name}: {max(map(len, case.values()))} walks, median (5 % to 95 %)")
        harness.print_table(*make_table(case))
    harness.print_heading("Geometric mean of the rmse over the default's")
    harness.print_table(("variant", "all", *cases), summarize(cases))


COLUMNS = (
    replace(LANDMARK_MEAN, head="landmarks, mean (m)"),
    replace(LANDMARK_MAX, head="max (m)"),
    replace(RMSE, head="rmse (m)"),
    HEADING_RMSE,
    replace(END, head="end (m)"),
)


def make_table(case: Mapping[str, Sequence[Result]]) -> tuple[list[str], list[list[str]]]:
    """Head and one row a variant."""
    values = {column: {name: values_of(column, some, {}) for name, some in case.items()} for column in COLUMNS}
    shown = [column for column in COLUMNS if any(len(some) for some in values[column].values())]
    rows = []
    for name, some in case.items():
        ratios = [nees_ratio(some), used_share(some), cost_ratio(case, name)]
        words = [*map(_number, ratios), _number(over_default(case, name), 3)]
        rows.append([name, *(spread(values[column][name]) for column in shown), *words])
    return ["variant", *(column.head for column in shown), "NEES", "used", "cost", "over default"], rows


def summarize(cases: Mapping[str, Mapping[str, Sequence[Result]]]) -> list[list[str]]:
    """One row a variant, best first."""
    names = dict.fromkeys(name for case in cases.values() for name in case)
    each = {name: [over_default(case, name) for case in cases.values()] for name in names}
    overall = {name: float(np.exp(np.mean(np.log(ratios)))) for name, ratios in each.items()}
    return [
        [name, _number(overall[name], 3), *(_number(one, 3) for one in each[name])]
        for name in sorted(names, key=lambda name: overall[name])
    ]


def nees_ratio(some: Sequence[Result]) -> float:
    """NEES of place and heading at the last footfall over its expectation, mean over the walks."""
    z = whitened_errors(some)
    parts = [part for part in (("pose",) if "pose" in z else ("position", "heading")) if part in z]
    squares = sum((z[part][:, -1] ** 2).sum(axis=1) for part in parts)
    return float(np.mean(squares) / sum(PARTS[part] for part in parts)) if parts else math.nan


def used_share(some: Sequence[Result]) -> float:
    """Share of footfalls whose field was used."""
    marks = "".join(result.used for result in some)
    return marks.count(USED) / len(marks) if marks else math.nan


def cost_ratio(case: Mapping[str, Sequence[Result]], name: str) -> float:
    """Runtime over that without the field on the same walk, median."""
    bare = {result.key.walk: result.runtime_s for result in case.get("inertial", ()) if not result.failed}
    some = [result for result in case[name] if not result.failed and result.key.walk in bare]
    return float(np.median([result.runtime_s / bare[result.key.walk] for result in some])) if some else math.nan


def over_default(case: Mapping[str, Sequence[Result]], name: str) -> float:
    """Rmse over the default's on the same walk, geometric mean; infinite where a walk failed."""
    default = {result.key.walk: RMSE.value(result) for result in case.get("default", ())}
    logs = []
    for result in case.get(name, ()):
        ours, theirs = RMSE.value(result), default.get(result.key.walk)
        logs.append(math.log(ours / theirs) if ours and theirs else math.inf)
    return math.exp(math.fsum(logs) / len(logs)) if logs else math.nan


def _number(value: float, digits: int = 2) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else "-"


if __name__ == "__main__":
    harness.run(main)
