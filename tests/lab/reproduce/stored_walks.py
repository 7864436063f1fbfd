"""Results that stand in for walks, stored as a campaign would."""

from dataclasses import replace

import numpy as np

from fg_nav.lab.campaign.execute import settings_of, simulated_keys
from fg_nav.lab.reproduce.munoz_diaz2017 import Run
from fg_nav.lab.reproduce.munoz_diaz2017.walks import Setting
from fg_nav.lab.reproduce.results import read_table
from fg_nav.lab.store.results import Result, write_result
from fg_nav.lab.walked import AS_STARTED, BEST_YAW, WalkErrors

FOOTFALLS = 60

SHARES = {AS_STARTED: 1.0, BEST_YAW: 0.5}
"""What is left of a path's errors as it is laid on the truth; of those at its end all."""


def keys_of_paper(paper, seeds):
    """Every method on every walk of a paper's table."""
    table = read_table(paper)
    scenarios = [planned.scenario for planned in table.experiments if planned.scenario]
    return simulated_keys(scenarios, table.fields, ["loop"], table.methods, seeds)


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


def check_pictures(found, folder, figures):
    """These figures of the paper are drawn, and nothing else is there."""
    pictures = [picture for experiment in found.experiments for picture in experiment.pictures]
    numbers = [int(one.caption.partition("Fig. ")[2].partition(" ")[0]) for one in pictures]
    assert sorted(numbers) == figures
    assert {one.file for one in pictures} == {f"pictures/{path.name}" for path in folder.glob("pictures/*.png")}
    assert all((folder / one.file).read_bytes().startswith(b"\x89PNG") for one in pictures)


def rows_of(found):
    return {f"{one.name}: {row.quantity}": row for one in found.experiments for row in one.rows}


def run_with(minute, z=None, yaw=None):
    minute = np.asarray(minute, dtype=float)
    bias = np.zeros((len(minute), 3))
    bias[:, 2] = 0.0 if z is None else z
    yaw = np.zeros(len(minute)) if yaw is None else np.asarray(yaw, dtype=float)
    return Run(minute, bias, bias, yaw, None, np.zeros(len(minute), bool), np.zeros((1, 2)))


def setting_with(run, **columns):
    blank = Setting(*[np.zeros(1)] * 2, 1.0, np.zeros((1, 2)), np.zeros(4), np.zeros_like(run.bias))
    return replace(blank, **columns)
