"""What the field is worth on real walks with a magnetometer, method beside method.

    python scripts/real_magnetometers.py [--sets NAME ...] [--methods NAME ...] [--jobs N] [--json FILE] [--per-walk]

================ ====================================================================================================
laps             mems_foot, three rounds of one floor, 355 m: closure over ground, % of the way
squares          mems_foot, six squares of 70 m and three rectangles: the same
hallway          mtig710, a round of one floor, 180 m: the same
openshoe         three loops of 78 m: the same
gdin             ten surveyed walks of 35 to 150 m: rmse at the footprints, m
================ ====================================================================================================

A method is one of `fg_nav.estimators` and what may follow it: `smoother:gate=aiez`, `smoother:directions`,
`inertial`, `card`, `qsf`. Filters are tuned, with the magnetometer that all methods share: by the walk itself.
"sigmas" is error over claimed sigma of the last footfall, rms over walks and both axes; of gdin it is left out.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import harness
import numpy as np
import walks
from harness import option

from fg_nav.errors import EstimationError
from fg_nav.pipeline import prepare_walk, run_method
from fg_nav.walk import Options, read_walk

MEMS, LAP = "mems_foot/{}.csv.gz", "lap_360m_{}"
RECTANGLES = "rectangle_1", "rectangle_3", "large_rectangle_1"

SETS: Mapping[str, tuple[str, ...]] = {
    "laps": tuple(MEMS.format(LAP.format(k)) for k in (1, 2, 3)),
    "squares": tuple(MEMS.format(name) for name in (*(f"square_70m_{k}" for k in range(1, 7)), *RECTANGLES)),
    "hallway": ("mtig710/2022_1_14_hallway_walk3.csv.gz",),
    "openshoe": tuple(path for name, path in walks.LOOPS.items() if name.startswith(walks.OPENSHOE)),
    walks.GDIN: tuple(str(number) for number in walks.GDIN_WALKS),
}

METHODS = ("inertial", "smoother", "card", "smoother:directions", "iez", "qsf", "ma2018", "aiez")

CHANGES = {"directions": (("smoother.walk.directions", True),)}


@dataclass(frozen=True)
class Measured:
    """Of a method on a walk: error, % of the way or m, squared error over variance, and factors of the compass."""

    error: float
    squared_sigmas: float
    compass: int


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        sets=option(list(SETS), "of walks", nargs="+", choices=tuple(SETS), metavar="NAME"),
        methods=list(METHODS),
        data=None,
        jobs=2,
        json=None,
        per_walk=False,
    )
    data = walks.data_folder(chosen.data)
    tasks = [(name, walk, method) for name in chosen.sets for walk in SETS[name] for method in chosen.methods]
    found = dict(zip(tasks, harness.map_walks(partial(measure, data=data), tasks, chosen.jobs), strict=True))
    for name in chosen.sets:
        print_set(name, found, chosen)
    if chosen.json is not None:
        harness.write_json(chosen.json, {" ".join(task): vars(one) for task, one in found.items()})


def measure(task: tuple[str, str, str], data: Path) -> Measured:
    """Run a method on a walk of a set."""
    name, walk, method = task
    method, _, variant = method.partition(":")
    truth = None
    path = data / walk
    if name == walks.GDIN:
        path = walks.gdin_path(data, int(walk))
        truth = path.with_suffix(".mat")
    gate = variant.removeprefix("gate=") if variant.startswith("gate=") else Options().gate
    options = Options(truth_path=truth, gate=gate, changes=CHANGES.get(variant, ()))
    try:
        outcome = run_method(prepare_walk(read_walk(path, options)), method)
    except EstimationError:  # a filter with a compass on a dead magnetometer
        return Measured(np.nan, np.nan, 0)
    table = outcome.solution.stances
    end, covariance = (table.position[-1] - table.position[0])[:2], table.position_cov[-1][:2, :2]
    metrics = outcome.metrics.as_dict()
    error = float(metrics["rmse_2d_m"]) if truth else 100.0 * float(np.hypot(*end)) / float(metrics["distance_m"])
    squared = float(end @ np.linalg.solve(covariance, end)) / 2.0
    return Measured(error, squared, int((outcome.solution.graph or {}).get("magnetic_heading", 0)))


def print_set(name: str, found: Mapping[tuple[str, str, str], Measured], chosen: argparse.Namespace) -> None:
    """Print the table of a set."""
    harness.print_heading(f"{name}, {'rmse, m' if name == walks.GDIN else 'closure, % of the way'}")
    rows = []
    for method in chosen.methods:
        some = [found[name, walk, method] for walk in SETS[name]]
        error = np.array([one.error for one in some])
        sigmas = "-" if name == walks.GDIN else f"{np.sqrt(np.nanmean([one.squared_sigmas for one in some])):.2f}"
        each = " ".join(f"{one:.2f}" for one in error)
        compass = str(sum(one.compass for one in some))
        rows.append(
            (
                method,
                f"{np.nanmean(error):.3f}",
                f"{np.nanmedian(error):.3f}",
                f"{np.nanmax(error):.2f}",
                sigmas,
                compass,
                each,
            )
        )
    harness.print_table(("method", "mean", "median", "worst", "sigmas", "compass factors", "walk by walk"), rows)


if __name__ == "__main__":
    harness.run(main)
