"""One mean of the gyroscope's bias for a sensor, from its other walks: what it does to real walks.

    python scripts/sensor_bias.py [--data DIR] [--json FILE]

Each walk is solved three times: as it comes; under a wide prior, by which it shows its own bias
(`calibration.inertial.read_walk_bias`); and with mean and sigma of the bias from the *other* walks of the set, as a
calibration file gives them. Own stances, no magnetometer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date

import harness
import numpy as np
import walks
from harness import Figure
from walks import Walk

from fg_nav.arrays import Floats
from fg_nav.calibration.inertial import ALONE, average_gyroscopes, read_walk_bias
from fg_nav.estimators import choose_parameters
from fg_nav.evaluation import evaluate
from fg_nav.smoother import SmootherParameters, smooth
from fg_nav.solution import Solution
from fg_nav.text import to_json
from fg_nav.walk import Options

ASKED_GDIN_M = 0.31


@dataclass(frozen=True)
class Row:
    """A walk: its bias by itself, the prior from the others and what is found with it, deg/s; rmse (2,) m."""

    walk: str
    alone_deg_s: Floats
    mean_deg_s: Floats
    sigma_deg_s: float
    found_deg_s: Floats
    rmse_m: tuple[float, float]


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print, and write what was asked for."""
    chosen = harness.parse_arguments(__doc__, arguments, data=None, json=None)
    data = walks.data_folder(chosen.data)
    figures, content = [], {}
    for name, read, asked in (("gdin", walks.read_gdin, ASKED_GDIN_M), ("gdlbio, walked", walks.read_gdlbio, np.inf)):
        rows = measure_set(read(data))
        content[name] = [to_json(one) for one in rows]
        harness.print_heading(name)
        columns = ("walk", "bias alone (deg/s)", "mean of the others", "sigma", "found with it", "rmse (m)", "with it")
        harness.print_table(columns, [_words(one) for one in rows])
        rmse = np.array([one.rmse_m for one in rows])
        for label, errors, high in (("alone", rmse[:, 0], np.inf), ("mean of the others", rmse[:, 1], asked)):
            figures.append(Figure(name, "footprint rmse, mean (m)", label, float(errors.mean()), high=high))
            figures.append(Figure(name, "footprint rmse, median (m)", label, float(np.median(errors))))
    harness.print_verdict(figures, chosen.json, made=date.today().isoformat(), walks=content)


def measure_set(chosen: Sequence[Walk]) -> list[Row]:
    """Solve the walks of one sensor alone, and each with what the others show of the bias."""
    p = SmootherParameters(), choose_parameters(Options(changes=ALONE))
    as_it_comes, alone = ([_solve(walk, given) for walk in chosen] for given in p)
    shown = [read_walk_bias(one) for one in alone]
    rows = []
    for k, walk in enumerate(chosen):
        prior = average_gyroscopes([*shown[:k], *shown[k + 1 :]]).prior
        found = _solve(walk, SmootherParameters(**prior))
        rmse = _rmse(walk, as_it_comes[k]), _rmse(walk, found)
        before, after = (np.degrees(one.bias) for one in (shown[k], read_walk_bias(found)))
        mean, sigma = np.array(prior["gyro_bias_deg_s"]), prior["gyro_bias_sigma_deg_s"]
        rows.append(Row(walk.name, before, mean, sigma, after, rmse))
    return rows


def _solve(walk: Walk, p: SmootherParameters) -> Solution:
    return smooth(walk.recording, walk.stances, p)


def _rmse(walk: Walk, solution: Solution) -> float:
    error = evaluate(solution, walk.recording.truth).rmse_2d_m
    return np.inf if error is None else error


def _words(row: Row) -> list[str]:
    biases = [" ".join(f"{x:.3f}" for x in one) for one in (row.alone_deg_s, row.mean_deg_s, row.found_deg_s)]
    return [row.walk, biases[0], biases[1], f"{row.sigma_deg_s:.3f}", biases[2], *(f"{x:.3f}" for x in row.rmse_m)]


if __name__ == "__main__":
    main()
