"""Whether the smoother's sigmas are true, and how soon it knows the gyro bias: simulated walks with a magnetometer.

    python scripts/consistency.py --out DIR [--seeds N] [--bias-seeds N] [--first SEED] [--course NAME] [--jobs N]

NEES. Every combination of: heading at the start given or not; rests or none; bias walk 2e-4, 6e-4, 2e-3 deg/s/sqrt(s);
scale error of the gyroscope 0 or 1 % (one standard deviation); field homogeneous, smooth, indoor (`magnetic_walks.py`),
as many seeds of each. The walks of a seed are of one person, with one error of the height: a few seeds show few. A walk
is inside where its squared error over the claimed covariance at the last footfall lies in the two-sided 95 % band of a
chi-square of so many degrees of freedom (Bar-Shalom et al. 2001, 5.4):

=========== ========================================================================================================
position    east, north, up from the first footfall (3)
heading     about up (1); the field's mean points to true north in these walks
bias        of the gyroscope (3), its axes as independent: no more is claimed
=========== ========================================================================================================

and is counted with each of its conditions. `error / sigma` is the rms per component: 1 for true sigmas.

Bias. From what was recorded until 60 s after the start, no rest, heading not given, magnetometer of 0.5 uT a sample:
error of the bias about up and its claimed sigma, bias walk 6e-4.

Every result is a file in DIR and holds as long as the code is the same. Asked: 80 % of the walks of each condition
inside; a bias within 0.02 deg/s on 90 % of the walks (homogeneous) or 0.1 deg/s (smooth, indoor), error over sigma
within a factor of 1.3.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import harness
import magnetic_walks
import numpy as np
from harness import Figure, option, spread
from magnetic_walks import COURSES, Case

from fg_nav.arrays import Floats
from fg_nav.errors import FgNavError
from fg_nav.evaluation.comparison import compare_at_footfalls
from fg_nav.lab.consistency import share_in_band, whiten_errors
from fg_nav.lab.simulation import SimulatedWalk
from fg_nav.lab.store.code import code_sum
from fg_nav.lab.walked import AS_STARTED
from fg_nav.smoother import smooth
from fg_nav.solution import Solution
from fg_nav.walk import Walk

FIELDS = ("homogeneous", "smooth", "indoor")
BIAS_WALKS_DEG_S = (2e-4, 6e-4, 2e-3)
SCALES = (0.0, 0.01)
PARTS: Mapping[str, int] = {"position": 3, "heading": 1, "bias": 3}  # Degrees of freedom.

MIN_INSIDE, BAND = 0.8, 0.95
BIAS_AT_S, BIAS_SHARE, BIAS_FACTOR = 60.0, 0.9, 1.3
BIAS_WITHIN_DEG_S: Mapping[str, float] = {"homogeneous": 0.02, "smooth": 0.1, "indoor": 0.1}


@dataclass(frozen=True)
class Condition:
    """Of a walk."""

    heading: bool
    rests: bool
    bias_walk_deg_s: float
    scale: float
    field: str

    @property
    def levels(self) -> tuple[str, ...]:
        """In words, one a factor."""
        return (
            "heading given" if self.heading else "heading not given",
            "rests" if self.rests else "no rests",
            f"bias walk {self.bias_walk_deg_s:g}",
            f"scale error {self.scale:.0%}",
            self.field,
        )


def main(arguments: Sequence[str] | None = None) -> None:
    """Make what is missing, print and judge."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        out=None,
        seeds=10,
        bias_seeds=option(20, "how many walks of each field for the bias", metavar="N"),
        first=harness.FIRST_SEED,
        course=option("140 m", "of the walks", choices=tuple(COURSES), metavar="NAME"),
        jobs=2,
        json=None,
    )
    folder = harness.check_folder(chosen.out)
    seeds = harness.seeds_of(chosen)
    walks = [
        (Condition(*levels), seed)
        for levels in product((True, False), (True, False), BIAS_WALKS_DEG_S, SCALES, FIELDS)
        for seed in seeds
    ]
    early = [(field, seed) for field in FIELDS for seed in range(chosen.first, chosen.first + chosen.bias_seeds)]
    measure = partial(measure_kept, folder, code_sum(), chosen.course)
    results = harness.map_walks(measure, [*walks, *early], chosen.jobs)
    figures = judge_nees([condition for condition, _ in walks], results[: len(walks)])
    figures += judge_bias([field for field, _ in early], results[len(walks) :])
    harness.print_verdict(figures, chosen.json)


def measure_kept(folder: Path, code: str, course: str, walk: tuple[Condition | str, int]) -> dict[str, Any]:
    """Return what a walk shows, from its file if it is there; empty where the smoother failed."""
    what, seed = walk
    words = [what, "early"] if isinstance(what, str) else [*what.levels]
    path = folder / ("_".join([course, *words, str(seed)]).replace(" ", "-").replace("%", "") + ".json")
    content = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    if content.get("code") != code:
        content = {"code": code, "found": measure_walk(course, what, seed)}
        harness.write_json(path, content)
    return dict(content["found"])


def measure_walk(course: str, what: Condition | str, seed: int) -> dict[str, Any]:
    """Whitened errors of a walk by part, or error and sigma of its early bias."""
    try:
        if isinstance(what, str):
            walk = magnetic_walks.make_walk(Case(course, what, rests=False), seed, magnetic_walks.make_sensor())
            error, sigma = magnetic_walks.measure_early_bias(walk, solve, BIAS_AT_S)
            return {"error": error, "sigma": sigma}
        sensor = magnetic_walks.make_sensor(what.bias_walk_deg_s, what.scale)
        walk = magnetic_walks.make_walk(Case(course, what.field, what.rests), seed, sensor)
        return whiten(walk, solve(magnetic_walks.prepare(walk, what.heading)))
    except FgNavError:
        return {}


def solve(walk: Walk) -> Solution:
    """Run the smoother on what the walk shows."""
    return smooth(walk.recording, walk.stances, heading=walk.options.heading_rad, field=walk.field)


def whiten(walk: SimulatedWalk, solution: Solution) -> dict[str, Any]:
    """Errors over their claim at the last footfall, by part."""
    found = compare_at_footfalls(solution, magnetic_walks.read_truth(walk), AS_STARTED)
    pose = whiten_errors(found, solution.stances, places=(1.0,))
    end = solution.stances
    true = np.array([np.interp(end.t[-1], walk.biases.t, axis) for axis in walk.biases.gyr.T])
    bias = (end.gyro_bias[-1] - true) / end.gyro_bias_sigma[-1]
    return {"position": pose["position"][0], "heading": pose["heading"][0], "bias": bias.tolist()}


# --- tables ----------------------------------------------------------------------------------------------------------


def judge_nees(conditions: Sequence[Condition], results: Sequence[Mapping[str, Any]]) -> list[Figure]:
    """Print one row a condition: shares inside the band, and rms of error over sigma."""
    rows, figures = [], []
    factors = zip(*(condition.levels for condition in conditions), strict=True)
    for level in (level for factor in factors for level in dict.fromkeys(factor)):
        some = [one for condition, one in zip(conditions, results, strict=True) if level in condition.levels]
        solved = [one for one in some if one]
        z = {
            part: np.array([one[part] for one in solved], dtype=np.float64).reshape(-1, n) for part, n in PARTS.items()
        }
        inside = {part: count_inside(z[part]) * len(solved) / len(some) for part in PARTS}
        rows.append(
            [
                level,
                str(len(some)),
                *(f"{one:.0%}" for one in inside.values()),
                *(f"{rms(z[part]):.2f}" for part in PARTS),
            ]
        )
        figures += [Figure("NEES", part, level, one, MIN_INSIDE, pattern="{:.2f}") for part, one in inside.items()]
    harness.print_heading("Walks inside the 95 % band, and rms of error over sigma, at the last footfall")
    harness.print_table(("condition", "walks", *PARTS, *(f"{part} / sigma" for part in PARTS)), rows)
    return figures


def count_inside(z: Floats) -> float:
    """Share of walks whose NEES is inside the band, from whitened errors (S, n)."""
    freedom = z.shape[1]
    return share_in_band((z**2).sum(axis=1), freedom, freedom, BAND) if len(z) else 0.0


def rms(z: Floats) -> float:
    """Root mean square; infinite without any."""
    return float(np.sqrt(np.mean(z**2))) if z.size else math.inf


def judge_bias(fields: Sequence[str], results: Sequence[Mapping[str, Any]]) -> list[Figure]:
    """Print one row a field: error of the bias about up, sigma, and what was asked."""
    rows, figures = [], []
    for field in dict.fromkeys(fields):
        some = [one for name, one in zip(fields, results, strict=True) if name == field]
        error = np.array([abs(one["error"]) if one else math.inf for one in some])
        sigma = np.array([one["sigma"] for one in some if one])
        ratio = rms(np.array([one["error"] / one["sigma"] for one in some if one]))
        share = float(np.mean(error <= BIAS_WITHIN_DEG_S[field]))
        rows.append([field, spread(error, "{:.3f}"), spread(sigma, "{:.3f}"), f"{share:.0%}", f"{ratio:.2f}"])
        name = f"bias within {BIAS_WITHIN_DEG_S[field]:g} deg/s"
        figures += [
            Figure("bias", name, field, share, BIAS_SHARE, pattern="{:.2f}"),
            Figure("bias", "error over sigma", field, ratio, 1 / BIAS_FACTOR, BIAS_FACTOR, "{:.2f}"),
        ]
    harness.print_heading(f"Gyro bias about up {BIAS_AT_S:.0f} s after the start, no rest (deg/s)")
    harness.print_table(("field", "error", "sigma", "share within", "error / sigma"), rows)
    return figures


if __name__ == "__main__":
    harness.run(main)
