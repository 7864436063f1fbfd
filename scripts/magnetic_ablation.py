"""What each magnetic factor and each gate of the smoother contributes, on simulated walks and on real ones.

    python scripts/magnetic_ablation.py --out DIR [--full] [--courses NAME ...] [--fields NAME ...]
        [--variants NAME ...] [--seeds N] [--first SEED] [--data DIR] [--no-real] [--jobs N]

`inertial` is without the field, `default` the smoother as it comes. From there each switch of the magnetic field is
turned off (`without X`), and the gate is another detector or none (`gate X`). All variants of a walk share recording,
stances and field; no heading is given. Every result is a file in DIR, and holds as long as its parameters and the code
are the same: what was stopped goes on.

Simulated (`magnetic_walks.py`), medians over the seeds (5 % to 95 %), footfalls aligned by yaw and position:

================ ====================================================================================================
rmse, end        over the ground, m
heading          rms, deg
bias 30, 60, 120 error of the gyro bias about up, deg/s, size, as known so many seconds after the start
over inertial    rmse over that of `inertial` on the same walk, geometric mean
cost             runtime over that of `inertial`, median
================ ====================================================================================================

Real: footprint rmse (gdin) or closure (openshoe) over that of `inertial` on the same walk, geometric mean (largest);
then the same where no rest is looked for and 0.3 deg/s were added about the vertical of the first stance.

The whole table: `--full`, all courses up to 2.5 km. At the end stands what was asked of the default: through cables at
most 1.3 times the rmse without them on the same course; no real walk worse than `inertial` by 5 % and 3 cm, nor the
mean; half of its error on openshoe with the bias; half as much time again.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import harness
import magnetic_walks
import numpy as np
import walks
from harness import Figure, option, spread
from magnetic_walks import COURSES, FIELDS, Case

from fg_nav.detection import RestParameters
from fg_nav.errors import FgNavError
from fg_nav.evaluation import evaluate
from fg_nav.lab.simulation import SimulatedWalk
from fg_nav.lab.store.code import code_sum
from fg_nav.lab.walked import measure_walk
from fg_nav.pipeline import prepare_walk
from fg_nav.smoother import SmootherParameters, smooth
from fg_nav.solution import Solution
from fg_nav.text import to_json
from fg_nav.walk import Options, Walk, read_walk

DEFAULT = SmootherParameters()
BIAS_AT_S = (30, 60, 120)
NO_RESTS = RestParameters(shortest_s=math.inf, shortest_at_end_s=math.inf)
ADDED_DEG_S = 0.3

CABLES_RATIO, COST_RATIO = 1.3, 1.5
WORSE_RATIO, WORSE_M = 1.05, 0.03
BIAS_RATIO: Mapping[str, float] = {walks.OPENSHOE: 0.5}


@dataclass(frozen=True)
class Variant:
    """Parameters of the smoother, and whether it is given the field."""

    parameters: SmootherParameters = DEFAULT
    field: bool = True

    def solve(self, walk: Walk) -> Solution:
        """Run the smoother on what the walk shows."""
        heading, field = walk.options.heading_rad, walk.field if self.field else None
        return smooth(walk.recording, walk.stances, self.parameters, heading=heading, field=field)


def vary_magnetic(**changes: Any) -> Variant:
    """Return the smoother as it comes but for these magnetic parameters."""
    return Variant(replace(DEFAULT, magnetic=replace(DEFAULT.magnetic, **changes)))


def list_factors() -> list[str]:
    """Magnetic factors that can be left out."""
    values = {one.name: getattr(DEFAULT.magnetic, one.name) for one in fields(DEFAULT.magnetic)}
    return [name for name, value in values.items() if value is True]


GATES = ("ma2018", "aiez", "qsf", "iqsf", "none")

INERTIAL, AS_IT_COMES = "inertial", "default"

VARIANTS: Mapping[str, Variant] = {
    INERTIAL: Variant(field=False),
    AS_IT_COMES: Variant(),
    **{f"without {name}": vary_magnetic(**{name: False}) for name in list_factors()},
    **{f"gate {name}": vary_magnetic(gate=name) for name in GATES if name != DEFAULT.magnetic.gate},
}
"""By name."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Make what is missing, and print."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        out=None,
        courses=option(["140 m", "360 m"], "of the simulated walks", nargs="*", choices=tuple(COURSES), metavar="NAME"),
        fields=FIELDS,
        variants=option(list(VARIANTS), "of the smoother", nargs="+", choices=tuple(VARIANTS), metavar="NAME"),
        seeds=4,
        first=harness.FIRST_SEED,
        full=option(False, "take all courses"),
        data=None,
        no_real=option(False, "leave the real walks out"),
        jobs=2,
    )
    store = Store(harness.check_folder(chosen.out), code_sum())
    names = tuple(dict.fromkeys((INERTIAL, AS_IT_COMES, *chosen.variants)))
    cases = list_cases(tuple(COURSES) if chosen.full else chosen.courses, chosen.fields)
    tasks: list[Callable[[], None]] = [
        partial(make_simulated, store, case, seed, names) for case in cases for seed in harness.seeds_of(chosen)
    ]
    real = [] if chosen.no_real else [(group, one) for group, some in walks.REAL_WALKS.items() for one in some]
    data = walks.data_folder(chosen.data) if real else Path()
    tasks += [partial(make_real, store, group, one, data, names) for group, one in real]
    harness.map_walks(_call, tasks, chosen.jobs)
    results = {
        case: {
            name: [store.read(name_simulated(case, seed), name) for seed in harness.seeds_of(chosen)] for name in names
        }
        for case in cases
    }
    for case, some in results.items():
        harness.print_heading(f"{case.name}: {chosen.seeds} walks")
        harness.print_table(*make_table(some))
    figures = judge_simulated(results)
    if real:
        found = {
            name: {group: [store.read(f"{g} {n}", name) for g, n in real if g == group] for group, _ in real}
            for name in names
        }
        print_real(found)
        figures += judge_real(found)
    harness.print_verdict(figures)


def list_cases(courses: Sequence[str], levels: Sequence[str]) -> list[Case]:
    """List all combinations; the corridor has its magnet in each field."""
    return [Case(course, level, rests) for course in courses for level in levels for rests in (True, False)]


def _call(task: Callable[[], None]) -> None:
    task()


# --- results ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Store:
    """A folder with one file a walk and variant; what other code made is made again."""

    folder: Path
    code: str

    def read(self, walk: str, variant: str) -> dict[str, float] | None:
        """Return the figures; None if there are none of this code and these parameters."""
        path = self._path(walk, variant)
        content = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
        return content["figures"] if content.get("settings") == self._describe(variant) else None

    def write(self, walk: str, variant: str, figures: Mapping[str, float]) -> None:
        """Keep the figures; an empty mapping says that the variant failed."""
        harness.write_json(self._path(walk, variant), {"settings": self._describe(variant), "figures": dict(figures)})

    def _path(self, walk: str, variant: str) -> Path:
        return self.folder / (re.sub(r"[^\w.-]+", "_", f"{walk} {variant}") + ".json")

    def _describe(self, variant: str) -> dict[str, Any]:
        one = VARIANTS[variant]
        return {"code": self.code, **dict(to_json({"parameters": one.parameters, "field": one.field}))}


def name_simulated(case: Case, seed: int) -> str:
    """Name a walk in the store."""
    return f"{case.name} {seed}"


def make_simulated(store: Store, case: Case, seed: int, names: Iterable[str]) -> None:
    """Simulate a walk and keep what each variant makes of it."""
    slug = name_simulated(case, seed)
    missing = [name for name in names if store.read(slug, name) is None]
    if not missing:
        return
    walk = magnetic_walks.make_walk(case, seed, magnetic_walks.make_sensor())
    prepared = magnetic_walks.prepare(walk)
    for name in missing:
        try:
            figures = measure_simulated(walk, prepared, VARIANTS[name])
        except FgNavError:
            figures = {}
        store.write(slug, name, figures)


def measure_simulated(walk: SimulatedWalk, prepared: Walk, variant: Variant) -> dict[str, float]:
    """Errors of a walk, and of the bias as it was known early on."""
    solution = variant.solve(prepared)
    errors = measure_walk(solution, walk.recording.truth, "yaw")
    assert errors.heading_rmse_deg is not None
    early = [after for after in BIAS_AT_S if after < walk.recording.duration_s]
    biases = {f"bias {after}": abs(magnetic_walks.measure_early_bias(walk, variant.solve, after)[0]) for after in early}
    return {
        "rmse": errors.rmse_m,
        "end": errors.end_m,
        "heading": errors.heading_rmse_deg,
        **biases,
        "runtime": solution.runtime_s,
    }


def make_real(store: Store, group: str, number: str, data: Path, names: Iterable[str]) -> None:
    """Read a real walk and keep what each variant makes of it, as it is and spoiled."""
    slug = f"{group} {number}"
    missing = [name for name in names if store.read(slug, name) is None]
    if not missing:
        return
    walk = read_walk(walks.real_path(group, number, data), Options())
    as_is, spoiled = prepare_walk(walk), prepare_walk(spoil(walk))
    for name in missing:
        variant = VARIANTS[name]
        without = replace(variant, parameters=replace(variant.parameters, rest=NO_RESTS))
        try:
            figures = {"merit": measure_real(as_is, variant), "spoiled": measure_real(spoiled, without)}
        except FgNavError:
            figures = {}
        store.write(slug, name, figures)


def spoil(walk: Walk) -> Walk:
    """Add a bias about the vertical of the first stance."""
    prepared = prepare_walk(walk)
    first = slice(int(prepared.stances.start[0]), int(prepared.stances.stop[0]))
    up = walk.recording.acc[first].mean(axis=0)
    added = np.deg2rad(ADDED_DEG_S) * up / np.linalg.norm(up)
    return replace(walk, recording=replace(walk.recording, gyr=walk.recording.gyr + added))


def measure_real(walk: Walk, variant: Variant) -> float:
    """Footprint rmse in m where there is a truth, else the closure in m."""
    metrics = evaluate(variant.solve(walk), walk.truth)
    return metrics.closure_m if metrics.rmse_2d_m is None else metrics.rmse_2d_m


# --- tables ----------------------------------------------------------------------------------------------------------

Results = Mapping[str, Sequence[Mapping[str, float] | None]]
"""By variant, those of the walks in order; None or empty: failed."""

COLUMNS: Mapping[str, str] = {
    "rmse": "rmse (m)",
    "end": "end (m)",
    "heading": "heading (deg)",
    **{f"bias {after}": f"bias {after} s (deg/s)" for after in BIAS_AT_S},
}


def make_table(results: Results) -> tuple[list[str], list[list[str]]]:
    """Head and one row a variant."""
    rows = []
    for name, some in results.items():
        cells = [spread(list_figures(some, key), "{:.3f}") for key in COLUMNS]
        mean, _ = compare_walks(some, results[INERTIAL], "rmse")
        times = [a["runtime"] / b["runtime"] for a, b in zip(some, results[INERTIAL], strict=True) if a and b]
        rows.append([name, *cells, f"{mean:.2f}", f"{np.median(times):.2f}" if times else "-"])
    return ["variant", *COLUMNS.values(), "over inertial", "cost"], rows


def list_figures(some: Sequence[Mapping[str, float] | None], key: str) -> list[float]:
    """List a figure of the walks that have it; infinite where one failed."""
    return [one[key] if one else math.inf for one in some if not one or key in one]


def compare_walks(
    ours: Sequence[Mapping[str, float] | None], theirs: Sequence[Mapping[str, float] | None], key: str
) -> tuple[float, float]:
    """Geometric mean and largest of a figure over another's on the same walk; infinite where one of ours failed."""
    ratios = [(a[key] / b[key] if a else math.inf) for a, b in zip(ours, theirs, strict=True) if b]
    return (float(np.exp(np.mean(np.log(ratios)))), max(ratios)) if ratios else (math.nan, math.nan)


def judge_simulated(results: Mapping[Case, Results]) -> list[Figure]:
    """What was asked of the default: through cables and without them, and its cost."""
    figures = []
    for case, some in results.items():
        bare = results.get(replace(case, field="indoor"))
        if case.field == magnetic_walks.CABLES and bare:
            ratio, _ = compare_walks(some[AS_IT_COMES], bare[AS_IT_COMES], "rmse")
            figures.append(Figure("cables", f"rmse over indoor, {case.name}", AS_IT_COMES, ratio, high=CABLES_RATIO))
        cost, _ = compare_walks(some[AS_IT_COMES], some[INERTIAL], "runtime")
        figures.append(Figure("cost", case.name, AS_IT_COMES, cost, high=COST_RATIO))
    return figures


RealResults = Mapping[str, Mapping[str, Sequence[Mapping[str, float] | None]]]
"""By variant and group of walks."""


def print_real(found: RealResults) -> None:
    """Print one row a variant."""
    rows = []
    for name, groups in found.items():
        pairs = [compare_walks(groups[g], found[INERTIAL][g], key) for g in groups for key in ("merit", "spoiled")]
        rows.append([name, *(f"{mean:.3f} ({worst:.2f})" for mean, worst in pairs)])
    harness.print_heading(f"Real walks, over inertial, mean (largest); bias: no rests, {ADDED_DEG_S} deg/s added")
    harness.print_table(("variant", *(f"{group}{more}" for group in found[INERTIAL] for more in ("", ", bias"))), rows)


def judge_real(found: RealResults) -> list[Figure]:
    """What was asked of the default on real walks."""
    figures = []
    for group, ours in found[AS_IT_COMES].items():
        theirs = found[INERTIAL][group]
        mean, _ = compare_walks(ours, theirs, "merit")
        figures.append(Figure("real", f"{group}: over inertial, mean", AS_IT_COMES, mean, high=1.0))
        worse = sum(is_worse(a, b) for a, b in zip(ours, theirs, strict=True))
        figures.append(Figure("real", f"{group}: walks worse", AS_IT_COMES, worse, high=0, pattern="{:.0f}"))
        spoiled, _ = compare_walks(ours, theirs, "spoiled")
        figures.append(
            Figure("real", f"{group}: with a bias", AS_IT_COMES, spoiled, high=BIAS_RATIO.get(group, math.inf))
        )
    return figures


def is_worse(ours: Mapping[str, float] | None, theirs: Mapping[str, float] | None) -> bool:
    """Whether a walk is worse by more than 5 % and 3 cm, or failed."""
    if not ours or not theirs:
        return bool(theirs)
    return ours["merit"] > max(WORSE_RATIO * theirs["merit"], theirs["merit"] + WORSE_M)


if __name__ == "__main__":
    harness.run(main)
