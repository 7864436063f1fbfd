"""What a magnetometer is worth on real floors. What each factor brings: `scripts/plans/magnetic_parts.toml`."""

from __future__ import annotations

import math
from argparse import Namespace
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import walks
from walks import Real

from experiments import Asked, Column, Experiment, Figures, Found, Table, Task, attempt, write_table
from fg_nav.lab.campaign.walks import RAW, WALK, Recorded
from fg_nav.pipeline import run_method

# --- methods on real floors ------------------------------------------------------------------------------------------

FLOORS: Mapping[str, tuple[str, str]] = {
    "laps": ("mems", "lap_360m"), "squares": ("mems", ""), "hallway": ("mtig", "2022_1_14_hallway_walk3"),
    "openshoe": ("openshoe", ""), "gdin": ("gdin", ""),
}  # fmt: skip
"""Set of each section, and how the names of its walks begin."""
FLOOR_METHODS = ("inertial", "smoother", "smoother raw", "card", "smoother:directions", "iez", "qsf", "ma2018", "aiez")


def list_floors(chosen: Namespace) -> list[Task]:
    """All sets."""
    data = walks.data_folder(chosen.data)
    return [
        Task(section, one.name, partial(measure_methods, one, tuple(chosen.methods)))
        for section, (name, begin) in FLOORS.items()
        for one in walks.list_set(data, name)
        if one.name.startswith(begin) and not (section == "squares" and one.name.startswith(("lap", "c_shape")))
    ]


def measure_methods(real: Real, methods: Sequence[str]) -> Found:
    """Run all methods on a walk; `smoother raw` is given no calibration, all others that by the walk itself."""
    prepared = {iron: Recorded(real.path).prepare(iron) for iron in (RAW, WALK)}

    def measure(name: str) -> Figures:
        method, _, variant = name.removesuffix(" raw").partition(":")
        walk = prepared[RAW if name.endswith(" raw") else WALK]
        gate = variant.removeprefix("gate=") if variant.startswith("gate=") else walk.options.gate
        changes = (("smoother.walk.directions", True),) if variant == "directions" else ()
        outcome = run_method(replace(walk, options=replace(walk.options, gate=gate, changes=changes)), method)
        table, metrics = outcome.solution.stances, outcome.metrics
        end = (table.position[-1] - table.position[0])[:2]
        squared = float(end @ np.linalg.solve(table.position_cov[-1][:2, :2], end)) / 2.0
        error = metrics.closure_percent if walk.truth is None else metrics.rmse_2d_m
        sigmas = {} if walk.truth is not None else {"sigmas": math.sqrt(squared)}
        return {"error": error, **sigmas, "compass": int((outcome.solution.graph or {}).get("magnetic_heading", 0))}

    return {name: attempt(partial(measure, name)) for name in methods}


def write_pairs(table: Table) -> list[str]:
    """Each walk without and with the magnetometer."""
    rows = []
    for section, merit in (("gdin", "footprint rmse (m)"), ("openshoe", "closure (%)")):
        some = [table.of(section, variant) for variant in ("inertial", "smoother raw", "smoother")]
        errors = {walk: [of[walk]["error"] for of in some] for walk in some[0]}
        errors[f"{section}, mean: {merit}"] = np.mean(list(errors.values()), axis=0).tolist()
        rows += [[walk, *(f"{value:.3f}" for value in values)] for walk, values in errors.items()]
    return write_table(["walk", "without", "as recorded", "calibrated on the walk"], rows)


EXPERIMENTS: Mapping[str, Experiment] = {
    "real-magnetometers": Experiment(
        """Real walks with a magnetometer, method beside method.

        Laps of 355 m, squares and rectangles, a hallway and openshoe: closure over the ground, % of the way; gdin: rmse
        at the footprints, m. All methods have the magnetometer that the walk itself calibrates, but for `raw`, which
        finds the iron on its way. `sigmas`: error over claimed sigma of the last footfall, rms over walks and both
        axes.""",
        list_floors,
        (
            Column("error", "mean / median / worst", "mean / median / worst"),
            Column("sigmas", "sigmas", "rms", "{:.2f}"),
            Column("compass", "compass factors", "sum", "{:.0f}"),
        ),
        [
            Asked("error", "mean", high=0.45, section="gdin", variant="smoother"),
            Asked("error", "median", high=0.5, section="openshoe", variant="smoother"),
            Asked("error", "worst", high=1.10, section="gdin", variant="smoother", over="inertial"),
        ],
        options={"methods": FLOOR_METHODS},
        blocks={"magnetometer": write_pairs},
    )
}
