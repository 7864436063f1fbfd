"""The estimate at the moment: how good it is, and how far the online graph is from the batch solution.

    python scripts/online_accuracy.py [--scenarios NAME ...] [--fields LEVEL ...] [--seeds N] [--first SEED]
        [--real] [--jobs N] [--json FILE]

Simulated walks, their magnetometer calibrated on a loop and their heading given, are pushed through `OnlineNavigator`
in blocks of half a second, stances found on the way. Beside it `ma2018` as tuned, a filter without a way back: its
estimate at a footfall is that of the moment too. Both laid as started; errors over the ground at the footfalls.

=========== ============================================================================================================
moment      error of the estimates as reported, rms over the footfalls, m
ma2018      the same of the filter, and ours over it, walk by walk
smoothed    the past as the online graph has it at the end
batch       the polished solution
gap before  largest distance of smoothed and batch at the same samples, m; asked below 0.1
gap after   of the polished solution and `smoother` on the recording, m; asked below 0.02
found       share of the batch's footfalls that were reported on the way
=========== ============================================================================================================

Medians over the seeds, 5 and 95 % behind. `--real`: the gaps on the gdin walks and openshoe loops (FG_NAV_DATA).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import harness
import numpy as np
from harness import FIRST_SEED, Figure, option, spread
from walks import GDIN, OPENSHOE, REAL_WALKS, data_folder, real_path

from fg_nav.evaluation.comparison import compare_at_footfalls
from fg_nav.lab.campaign.methods import solve_by
from fg_nav.lab.campaign.walks import LOOP, Recorded, Simulated, Source
from fg_nav.lab.walked import AS_STARTED
from fg_nav.online import OnlineNavigator
from fg_nav.online.buffer import OnlineOptions
from fg_nav.solution import Solution, StanceTable
from fg_nav.truth import Truth
from fg_nav.walk import Walk

SCENARIOS, FIELDS = ("office", "mall"), ("smooth", "indoor")
BLOCK_S = 0.5
OVER_FILTER, GAP_BEFORE_M, GAP_AFTER_M = 0.7, 0.1, 0.02
SAME_FOOTFALL_S = 0.3  # The stillest samples of one footfall, found on the way and in hindsight, are not farther apart.


@dataclass(frozen=True)
class Walked:
    """Errors (m) of one walk, NaN without a truth; gaps (m); share of the footfalls that were reported."""

    moment: float
    filtered: float
    smoothed: float
    batch: float
    gap_before: float
    gap_after: float
    found: float


def main(arguments: Sequence[str] | None = None) -> None:
    """Walk, print."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        scenarios=SCENARIOS,
        fields=FIELDS,
        seeds=20,
        first=FIRST_SEED,
        real=option(False, "the gaps on real walks instead"),
        data=None,
        jobs=1,
        json=None,
    )
    seeds = [str(seed) for seed in harness.seeds_of(chosen)]
    if chosen.real:
        cases = {f"{group}, real": [(group, "", walk, chosen.data) for walk in REAL_WALKS[group]] for group in REAL}
    else:
        cases = {
            f"{name}, {level}": [(name, level, seed, None) for seed in seeds]
            for name in chosen.scenarios
            for level in chosen.fields
        }
    figures: list[Figure] = []
    for section, walks in cases.items():
        found = harness.map_walks(estimate_online, walks, chosen.jobs, section)
        figures += print_case(section, [walk[2] for walk in walks], found)
    harness.print_figures(figures)
    harness.print_verdict(figures, chosen.json)


REAL = (GDIN, OPENSHOE)


def source_of(group: str, level: str, name: str, data: Path | None) -> Source:
    """Walk `name` of a group of recorded walks, or the seed of a scenario."""
    if group in REAL_WALKS:
        return Recorded(real_path(group, name, data_folder(data)))
    return Simulated(group, level, int(name))


def estimate_online(walk: tuple[str, str, str, Path | None]) -> Walked:
    """Push one walk through, and run filter and batch on it."""
    group, level, name, data = walk
    prepared = source_of(group, level, name, data).prepare(LOOP)
    navigator = push_blocks(prepared)
    found, batch = navigator.finish(), navigator.polish()
    hindsight = solve_by("smoother", replace(prepared, truth=None)).solution
    past = found.stances
    gap, share = gap_between(past, batch.stances)
    after, _ = gap_between(batch.stances, hindsight.stances)
    truth = prepared.truth if level else None
    errors = [np.nan] * 4
    if truth is not None:
        filtered = solve_by("ma2018", replace(prepared, truth=None)).solution
        assert found.moment is not None
        tables = (found.moment, filtered.stances, past, batch.stances)
        errors = [rms_error(batch, table, truth) for table in tables]
    return Walked(*errors, gap, after, share)


def push_blocks(walk: Walk) -> OnlineNavigator:
    """Push a recording through in blocks."""
    recording, degrees = walk.recording, walk.options.heading_deg
    navigator = OnlineNavigator(OnlineOptions(heading_rad=None if degrees is None else float(np.radians(degrees))))
    block = max(1, round(BLOCK_S / recording.period_s))
    for start in range(0, len(recording), block):
        part = np.s_[start : start + block]
        mag = None if recording.mag is None else recording.mag[part]
        navigator.push(recording.t[part], recording.acc[part], recording.gyr[part], mag)
    return navigator


def gap_between(one: StanceTable, other: StanceTable) -> tuple[float, float]:
    """Largest distance (m) of two tables at the footfalls of `other` that are in both, and the share of these."""
    nearest = np.abs(one.t[:, None] - other.t).argmin(axis=0) if len(one.t) else np.zeros(len(other.t), dtype=int)
    exact = one.sample[nearest] == other.sample
    same = np.abs(one.t[nearest] - other.t) < SAME_FOOTFALL_S
    apart = np.linalg.norm(one.position[nearest] - other.position, axis=1)[exact]
    return float(apart.max(initial=0.0)), float(same.mean())


def rms_error(solution: Solution, table: StanceTable, truth: Truth) -> float:
    """Over the ground, laid as started, m."""
    laid = compare_at_footfalls(replace(solution, stances=table), truth, AS_STARTED)
    return float(np.sqrt(np.mean((laid.error[:, :2] ** 2).sum(axis=1))))


def print_case(section: str, names: Sequence[str], found: Sequence[Walked]) -> list[Figure]:
    """One row of medians; returns the figures."""
    columns_of = {
        "moment (m)": np.array([one.moment for one in found]),
        "ma2018 (m)": np.array([one.filtered for one in found]),
        "moment/ma2018": np.array([one.moment / one.filtered for one in found]),
        "smoothed (m)": np.array([one.smoothed for one in found]),
        "batch (m)": np.array([one.batch for one in found]),
        "gap before (m)": np.array([one.gap_before for one in found]),
        "gap after (m)": np.array([one.gap_after for one in found]),
        "found (%)": np.array([100 * one.found for one in found]),
    }
    columns_of = {name: column for name, column in columns_of.items() if not np.isnan(column).all()}
    harness.print_heading(f"{section}: {len(found)} walks ({names[0]} to {names[-1]})")
    harness.print_table(list(columns_of), [[spread(column) for column in columns_of.values()]])
    ratio = float(np.median([one.moment / one.filtered for one in found]))
    asked = [
        ("gap before the polish, most (m)", float(columns_of["gap before (m)"].max()), GAP_BEFORE_M),
        ("gap after the polish, most (m)", float(columns_of["gap after (m)"].max()), GAP_AFTER_M),
    ]
    if np.isfinite(ratio):
        asked.append(("error at the moment over ma2018's, median", ratio, OVER_FILTER))
    return [Figure(section, f"{section}: {name}", "online", value, high=high) for name, value, high in asked]


if __name__ == "__main__":
    harness.run(main)
