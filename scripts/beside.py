"""Every set of real walks side by side: the smoother, the filter `iez`, and what came with the recordings.

============ =====================================================================================================
stored       gdlbio: the path that the authors of the set had from PyShoe with its LSTM detector (`pyshoeTrajectory`),
             laid on the same footprints at the same instants by the same rigid fit as ours. Vicon: PyShoe's error with
             the labels of `zv_shoe_opt` (`trial_error`), a number that its authors stored; ours beside it is counted as
             theirs (below)
end          of the last footfall from the first: `ground_m`, `z_m`, and over their sigmas `ground_ratio`, the root of
             half of d' C^-1 d of the horizontal d with its covariance C, and `z_ratio`
worse        a walk on which the error of the smoother is more than `WORSE_SHARE` and `WORSE_M` above that of the filter
============ =====================================================================================================

PyShoe's count (`ARMSE`, its `compute_error` and `align_plots`): start laid on start, heading from the first place 0.8 m
away from it, and with e_k the error over the ground, mean |e_k| / sqrt 2. It falls below an rmse after a best fit where
errors grow along the walk, and above it where the first stride misleads the heading.

Reference: Wagstaff, Peretroukhin, Kelly (2017), "Improving foot-mounted inertial navigation through real-time motion
classification"; code at github.com/utiasSTARS/pyshoe.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import harness
import numpy as np
from harness import Figure
from walks import Walk

from fg_nav.arrays import Floats
from fg_nav.evaluation import Metrics
from fg_nav.evaluation.comparison import align, fit_scale, interpolate_truth, lift_to_space
from fg_nav.lab.consistency import Consistency
from fg_nav.report.terminal import console
from fg_nav.solution import Solution
from fg_nav.truth import FootprintTruth, TrajectoryTruth
from fg_nav.verdict import UNUSABLE

STORED = "stored"  # In place of a method: what came with the recording.

WORSE_SHARE, WORSE_M, MAX_WORSE = 0.10, 0.03, 3
WORSE = f"worse than iez by {100 * WORSE_SHARE:.0f} % and {100 * WORSE_M:.0f} cm"

RMSE, SPACE, NEES = "rmse_2d_m", "rmse_3d_m", "median_ratio"
WRITTEN = (RMSE, SPACE, "max_error_m", "scale", "distance_m", "closure_m", "closure_percent", "points", "armse_m")
WRITTEN += ("footprints_surveyed", "strides_detected", "strides_true", NEES)
ENDS = ("ground_m", "z_m", "end_sigma_m", "ground_ratio", "z_ratio")  # Figures of merit that are written to the file.


@dataclass(frozen=True)
class Track:
    """Figures of a stored path: see `fg_nav.evaluation.metrics`."""

    rmse_2d_m: float
    max_error_m: float
    scale: float
    points: int
    footprints_surveyed: int


@dataclass(frozen=True)
class Result:
    """What a method made of a walk; without `metrics` it failed, and `failure` says how.

    `armse_m` is the error as PyShoe counts it, for walks with a true path; `end` what `measure_end` says of the last
    footfall; `verdict` the word for the path.
    """

    section: str
    walk: str
    method: str
    metrics: Metrics | Track | None
    consistency: Consistency | None = None
    failure: str = ""
    armse_m: float | None = None
    end: Mapping[str, float] = field(default_factory=dict)
    verdict: str = ""

    def value(self, name: str) -> float:
        """Figure of merit `name`, infinite where it could not be had; of the NEES over its expectation too."""
        if name in ENDS:
            return self.end.get(name, float("inf"))
        of = self if name == "armse_m" else self.consistency if name.endswith("_ratio") else self.metrics
        found = getattr(of, name, None)
        return float("inf") if found is None else float(found)

    @property
    def is_off_unseen(self) -> bool:
        """Whether the end of a path is off by more than three of its sigmas, and the verdict lets it be used."""
        off = 3.0 * self.value("end_sigma_m") < self.value("end_error_m") < np.inf
        return self.method != STORED and off and self.verdict != UNUSABLE

    @property
    def miscount(self) -> float:
        """Strides detected, less the true ones."""
        return self.value("strides_detected") - self.value("strides_true")

    def as_dict(self) -> dict[str, object]:
        """Ready for JSON."""
        known: dict[str, object] = {"section": self.section, "walk": self.walk, "method": self.method}
        for name in (*WRITTEN, *(ENDS if self.value(RMSE) == np.inf else ())):
            value = self.value(name)
            known |= {name: float(f"{value:.5g}")} if np.isfinite(value) else {}
        words = {"verdict": self.verdict, "failure": self.failure}
        return known | {name: word for name, word in words.items() if word}


def results_of(results: Sequence[Result], method: str) -> list[Result]:
    """Results of one method."""
    return [result for result in results if result.method == method]


def measure_end(solution: Solution) -> dict[str, float]:
    """Measure the last footfall from the first, m, and over the sigmas: `ENDS`."""
    table = solution.stances
    move, covariance = table.position[-1] - table.position[0], table.position_cov[-1]
    squared = move[:2] @ np.linalg.pinv(covariance[:2, :2]) @ move[:2] / 2
    sigma, z = np.sqrt(np.trace(covariance[:2, :2])), np.sqrt(covariance[2, 2])
    found = np.hypot(*move[:2]), move[2], sigma, np.sqrt(squared), move[2] / z if z > 0 else np.inf
    return dict(zip(ENDS, map(float, found), strict=True))


# --- what came with the recordings -----------------------------------------------------------------------------------


def measure_stored(section: str, walk: Walk) -> list[Result]:
    """Measure what is stored with a walk, if anything is."""
    truth = walk.recording.truth
    if walk.track is not None and isinstance(truth, FootprintTruth):
        return [Result(section, walk.name, STORED, measure_track(walk, walk.track, truth))]
    if walk.stored_armse_m is not None:
        return [Result(section, walk.name, STORED, None, armse_m=walk.stored_armse_m)]
    return []


def measure_track(walk: Walk, track: Floats, truth: FootprintTruth) -> Track:
    """Lay a stored path (N, 2) m, one place a sample, on footprints with their times."""
    assert truth.t is not None
    place = lift_to_space(np.column_stack([np.interp(truth.t, walk.recording.t, axis) for axis in track.T]))
    surveyed = lift_to_space(truth.xy)
    error = np.linalg.norm(align(place, surveyed).apply(place) - surveyed, axis=1)
    rmse = float(np.sqrt(np.mean(error**2)))
    return Track(rmse, float(error.max()), fit_scale(place, surveyed), len(surveyed), len(surveyed))


HEADING_M, HEADING_SAMPLE = 0.8, 300
"""PyShoe takes the heading of a path from where it first is so far from its start, or from this sample."""


def measure_as_pyshoe(solution: Solution, truth: TrajectoryTruth) -> float:
    """Measure a solution as PyShoe's authors do; m."""
    row, true_position = interpolate_truth(truth, solution.t)
    p, q = (
        (path[:, 0] - path[0, 0]) + 1j * (path[:, 1] - path[0, 1]) for path in (solution.position[row], true_position)
    )
    away = np.abs(p) >= HEADING_M
    at = int(np.argmax(away)) if away.any() else min(HEADING_SAMPLE, len(p) - 1)
    turn = np.exp(1j * (np.angle(q[at]) - np.angle(p[at])))
    return float(np.mean(np.abs(turn * p - q)) / np.sqrt(2))


# --- sets ------------------------------------------------------------------------------------------------------------

Sets = Mapping[str, tuple[tuple[str, ...], str]]
"""Name of a set -> sections of its results, and how the names of its walks begin."""

SUMMARIES: Mapping[str, Callable[[Floats], float]] = {
    "mean": lambda some: float(np.mean(some)),
    "median": lambda some: float(np.median(some)),
    "worst": lambda some: float(np.max(some)),
    "p95": lambda some: float(np.percentile(some, 95, method="linear" if np.isfinite(some).all() else "higher")),
    "rms": lambda some: float(np.sqrt(np.mean(np.square(some)))),
}
SHOWN = ("mean", "median", "worst")


def judge_sets(results: Sequence[Result], sets: Sets) -> list[Figure]:
    """Print all sets in one table and the walks on which the filter is better; return what is asked of each set."""
    of_set = {name: [r for r in results if r.section in some and r.walk.startswith(begin)]
              for name, (some, begin) in sets.items()}  # fmt: skip
    there = {name: rows for name, rows in of_set.items() if rows}
    if not there:
        return []
    harness.print_heading("All sets")
    lines = [line for name, rows in there.items() for line in _lines_of(name, rows)]
    harness.print_table(("set", "error", "method", "walks", *SHOWN), lines)
    worse, figures = set[str](), list[Figure]()
    for name, rows in there.items():
        behind, found = _judge_set(name, rows)
        worse, figures = worse.union(behind), figures + found
    walked = {row.walk for rows in there.values() for row in rows}
    words = f"all sets: {WORSE}, of {len(walked)} walks"
    return [*figures, Figure("all sets", words, "smoother", len(worse), high=MAX_WORSE, pattern="{:.0f}")]


def _lines_of(name: str, rows: Sequence[Result]) -> list[list[str]]:
    """One line a kind of error and method."""
    lines = []
    for words, key, unit in (("rmse (m)", RMSE, "{:.3f}"), ("as PyShoe counts (m)", "armse_m", "{:.3f}"),
                             ("closure over the ground (m)", "ground_m", "{:.3f}")):  # fmt: skip
        if key == "ground_m" and np.isfinite([row.value(RMSE) for row in rows]).any():
            continue  # with a truth the closure is no error
        for method in dict.fromkeys(row.method for row in rows):
            some = np.array([row.value(key) for row in rows if row.method == method])
            if np.isfinite(some).any():
                cells = [harness.format_number(SUMMARIES[summary](some), unit) for summary in SHOWN]
                lines.append([name, words, method, str(len(some)), *cells])
    return lines


def _judge_set(name: str, rows: Sequence[Result]) -> tuple[list[str], list[Figure]]:
    """The smoother beside the filter: the walks on which it is worse; mean, median, and how many these are."""
    errors = {(row.walk, row.method): error_m(row) for row in rows if row.method != STORED}
    names = list(dict.fromkeys(walk for walk, _ in errors))
    smoother, iez = (np.array([errors[walk, method] for walk in names]) for method in ("smoother", "iez"))
    found = [
        Figure(
            name,
            f"{name}: smoother over iez, {words}",
            "smoother",
            SUMMARIES[words](smoother) / SUMMARIES[words](iez),
            high=1.0,
        )
        for words in ("mean", "median")
    ]
    worse = [walk for walk, one, other in zip(names, smoother, iez, strict=True) if is_worse(one, other)]
    for walk in worse:
        console().print(f"{name}, {walk}: smoother {errors[walk, 'smoother']:.3f} m, iez {errors[walk, 'iez']:.3f} m")
    words = f"{name}: {WORSE}, walks of {len(names)}"
    return worse, [*found, Figure(name, words, "smoother", len(worse), pattern="{:.0f}")]


def error_m(row: Result) -> float:
    """Rmse over the ground where there is a truth, else the closure over the ground; m."""
    rmse = row.value(RMSE)
    return rmse if np.isfinite(rmse) or row.metrics is None else row.value("ground_m")


def is_worse(smoother_m: float, iez_m: float) -> bool:
    """Whether a walk's error is above the filter's by more than is let pass."""
    return smoother_m > iez_m * (1 + WORSE_SHARE) and smoother_m > iez_m + WORSE_M
