"""Results that stand in for walks, stored as a campaign would."""

from dataclasses import replace

import numpy as np

from fg_nav.lab.campaign.execute import settings_of
from fg_nav.lab.reproduce.results import read_table
from fg_nav.lab.reproduce.runner import keys_of
from fg_nav.lab.store.results import Result, write_result
from fg_nav.lab.walked import AS_STARTED, BEST_YAW, WalkErrors

FOOTFALLS = 60

SHARES = {AS_STARTED: 1.0, BEST_YAW: 0.5}
"""What is left of a path's errors as it is laid on the truth; of those at its end all."""


def keys_of_paper(paper, seeds, quick=False):
    """Every method on every walk of a paper's table."""
    table = read_table(paper)
    levels = table.quick_fields if quick else table.fields
    scenarios = [planned.scenario for planned in table.experiments if planned.scenario]
    return [key for scenario in scenarios for key in keys_of(scenario, levels, table.methods, seeds)]


def store_walks(folder, keys, error_m, failing=()):
    """Store a walk for each key whose errors are all `error_m(key)`; `failing` are keys that could not be solved."""
    cells = folder / "cells"
    cells.mkdir(parents=True, exist_ok=True)
    for key in keys:
        blank = Result(key, settings_of(key), "some code")
        whole = replace(blank, failed="no such walk.") if key in failing else walk(blank, error_m(key))
        write_result(cells, whole)


def walk(blank, error_m):
    """A round of 1000 m, all of whose errors as started are so many metres and degrees."""
    angle = np.linspace(0.0, 2 * np.pi, FOOTFALLS)
    truth = 160.0 * np.column_stack([np.sin(angle), 1.0 - np.cos(angle)])
    errors = {
        mode: WalkErrors(mode, 1000.0, error_m, 0.0, -error_m, share * error_m, share * error_m, share * error_m)
        for mode, share in SHARES.items()
    }
    estimate = (truth + np.array([0.0, error_m])).round(2).tolist()
    return replace(
        blank,
        errors=errors,
        landmark=tuple(str(k % 14 + 1) for k in range(42)) if blank.key.group == "mall" else (),
        landmark_m={mode: [share * error_m] * 42 for mode, share in SHARES.items()}
        if blank.key.group == "mall"
        else {},
        estimate={AS_STARTED: estimate, BEST_YAW: estimate},
        truth=truth.round(2).tolist(),
        used="u--" * (FOOTFALLS // 3),
        samples=1000,
        runtime_s=0.01,
        parameters={"sigma": 1.0},
    )


def figures_of(found):
    """Numbers of the paper's figures that were drawn."""
    return sorted(
        int(picture.caption.partition("Fig. ")[2].partition(" ")[0])
        for experiment in found.experiments
        for picture in experiment.pictures
    )


def rows_of(found):
    return {f"{one.name}: {row.quantity}": row for one in found.experiments for row in one.rows}
