"""Which detectors trust the field beside a magnet on the floor: Figure 6 of AIEZ (Zhang), on `magnet-corridor`.

    python scripts/magnet_corridor.py [--seeds N] [--json FILE] [--sigmas | --steps] [--jobs N]

A foot that stands beside a magnet stands in a field that is wrong and does not change: the classical detector, which
asks for the rate of the strength within a stance (`qsf-stance`), trusts it; AIEZ compares compass and inertial heading.
Those that look from stride to stride stand beside them.

Footfalls are sorted by how far the magnet turns the field over the ground, where the sensor is: `near` by more than
10 deg, `far` by less than 2. Shares are of those footfalls of all seeds that were judged; behind them, the least and
the most of single walks that have any. Zhang does not describe the magnet. The scenario's turns the field at hardly any
footfall by 10 deg, for these come down a stride apart; so it is laid there ten times over as well. The magnetometer is
calibrated, or has the hard and soft iron of its shoe. Seeds begin at 101.

`near told from far` is the probability that the statistic is greater at a footfall near than at one far (the area
under the ROC): what a detector could do at best, whatever its threshold; 0.5 is a coin.

`--steps` shows what estimators make of it, told the true heading at the start: the largest change of the heading error
from one footfall to the next, and the share of the footfalls `far` that were used. No step above 1 deg, with 80 % of
what is undisturbed in use, is what the smoother is asked. A radio that loses samples in a swing makes steps that no
field has to do with; so beside it is the step `by the field`, that of the heading less the heading of the same
estimator without the field (`inertial`; for the filters, `iez`): a magnet that was believed shows there.

`--sigmas` measures what the sigmas of the presets rest on: the scatter of the channels' values from footfall to
footfall in a homogeneous field, over sqrt 2, on seeds 1 to 4: by the median, which is that of the straights, and by
the standard deviation, which is that of the turns.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import figures as fig
import numpy as np
from compare_tables import spread
from figures import Figure

from fg_nav.arrays import Bools, Floats
from fg_nav.detection import detect_stances
from fg_nav.evaluation.walked import AS_STARTED, at_footfalls
from fg_nav.frames import heading_of, wrap
from fg_nav.lab.reproduce.aiez2017.magnet import (
    FAR,
    NEAR,
    SCENARIO,
    STRONGER,
    Judged,
    judged,
    pooled,
    told_apart,
    turned_by_magnet,
)
from fg_nav.lab.simulation import simulate
from fg_nav.lab.simulation.scenarios import Choices
from fg_nav.magnetic import DETECTORS, footfall_field
from fg_nav.magnetic.channels import SIGNALS
from fg_nav.magnetic.verdicts import QUASI_STATIC
from fg_nav.recording import TrajectoryTruth
from fg_nav.session import Options, Outcome, prepare, solve

FIRST_SEED, SEEDS = 101, 20
EDGES_DEG = (0.0, 2.0, 5.0, 10.0, 20.0, 45.0, 180.0)
MOST, LEAST = 0.2, 0.8
"""Shares: AIEZ is to accept at most the one of what is near, and both detectors at least the other of all else."""

METHODS = ("iez", "qsf-stance", "ma2018", "aiez", "matched", "matched-rts", "inertial", "smoother")
"""Estimators whose steps are measured."""

STEP_COLUMNS: Mapping[str, str] = {
    "step_deg": "largest step (deg)",
    "by_field_deg": "by the field (deg)",
    "rmse_deg": "heading rmse (deg)",
}

MOST_STEP_DEG = 1.0

SIGMA_SEEDS, SIGMA_SENSORS = range(1, 5), ("mpu-9250x8", "xsens-mtw", "lord-gx5-900")
SIGMA_SCENARIO = "teaching-building"

MAGNETOMETERS: Mapping[str, bool] = {"calibrated": True, "as is": False}


def main(arguments: Sequence[str] | None = None) -> None:
    """Simulate, judge, print."""
    chosen = _parse(arguments)
    if chosen.sigmas:
        print_sigmas()
        return
    seeds = range(FIRST_SEED, FIRST_SEED + chosen.seeds)
    figures = measured_steps(seeds, chosen.jobs) if chosen.steps else measured_shares(seeds)
    fig.print_verdict(figures)
    if chosen.json:
        fig.write_json(chosen.json, {"figures": [f.as_dict() for f in figures]})


def measured_shares(seeds: Sequence[int]) -> list[Figure]:
    """Judge, print, and return the figures of the detectors."""
    figures: list[Figure] = []
    for strength in (1, STRONGER):
        for name, calibrated in MAGNETOMETERS.items():
            walks = [judged(strength, calibrated, seed) for seed in seeds]
            words = f"magnet {strength} x, magnetometer {name}"
            fig.print_heading(f"{words}: share accepted, by how far the magnet turns the field")
            print_shares(walks)
            if calibrated:
                found = figures_of(words, walks)
                fig.print_figures(found)
                figures += found
    return figures


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Which detectors trust the field beside a magnet.")
    parser.add_argument("--seeds", type=int, default=SEEDS, metavar="N", help=f"how many walks ({SEEDS})")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures to this file")
    instead = parser.add_mutually_exclusive_group()
    instead.add_argument("--sigmas", action="store_true", help="measure the scatter of the channels instead")
    instead.add_argument("--steps", action="store_true", help="measure the steps of the estimators' headings instead")
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="processes of --steps (2)")
    return parser.parse_args(arguments)


def print_shares(walks: Sequence[Judged]) -> None:
    """One row a detector; over it, how many footfalls there are."""
    zones = list(pairwise(EDGES_DEG))
    counts = [f"{sum(len(walk.between('qsf-stance', *zone)) for walk in walks)}" for zone in zones]
    rows = [("footfalls", *counts)] + [(name, *(share(walks, name, *zone) for zone in zones)) for name in DETECTORS]
    fig.print_table(("detector", *(f"{low:.0f} to {high:.0f} deg" for low, high in zones)), rows)


def share(walks: Sequence[Judged], name: str, low_deg: float, high_deg: float) -> str:
    """Share accepted of all, and the range over the walks, in words."""
    found = [part for walk in walks if len(part := walk.between(name, low_deg, high_deg))]
    if not found:
        return "-"
    each = [float((part < 1.0).mean()) for part in found]
    return f"{(np.concatenate(found) < 1.0).mean():.0%} ({min(each):.0%}-{max(each):.0%})"


def figures_of(section: str, walks: Sequence[Judged]) -> list[Figure]:
    """What Figure 6 shows, as figures to be met."""

    def figure(name: str, zone: str, low: float = -math.inf, high: float = math.inf) -> Figure:
        statistic = pooled(walks, name, NEAR if zone == "near" else FAR)
        measured = float((statistic < 1.0).mean()) if len(statistic) else math.inf
        return Figure(section, f"{zone} accepted", name, measured, low, high, "{:.1%}")

    return [
        figure("qsf-stance", "near", low=LEAST),
        figure("aiez", "near", high=MOST),
        figure("qsf-stance", "far", low=LEAST),
        figure("aiez", "far", low=LEAST),
        *(Figure(section, "near told from far", name, told_apart(walks, name), pattern="{:.2f}") for name in DETECTORS),
    ]


# --- what estimators make of it --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Stepped:
    """Of one method on one walk: largest steps between footfalls, deg, rmse of the heading, and share of `far` used."""

    step_deg: float
    by_field_deg: float
    rmse_deg: float
    used_far: float


def measured_steps(seeds: Sequence[int], jobs: int) -> list[Figure]:
    """Run the estimators, print, and return the figures."""
    figures: list[Figure] = []
    with ProcessPoolExecutor(jobs) as pool:
        for strength in (1, STRONGER):
            walks = list(pool.map(partial(stepped, strength), seeds))
            section = f"magnet {strength} x, magnetometer calibrated"
            fig.print_heading(f"{section}: steps of the heading error, {len(walks)} walks, median (5 % to 95 %)")
            rows = [
                (
                    method,
                    *(spread(np.array([getattr(walk[method], name) for walk in walks])) for name in STEP_COLUMNS),
                    spread(np.array([100.0 * walk[method].used_far for walk in walks])),
                )
                for method in METHODS
            ]
            fig.print_table(("method", *STEP_COLUMNS.values(), "far used (%)"), rows)
            figures += step_figures(section, [walk["smoother"] for walk in walks])
    fig.print_figures(figures)
    return figures


def step_figures(section: str, walks: Sequence[Stepped]) -> list[Figure]:
    """What is asked of the smoother: of every walk, not of the median."""
    most = {name: max(getattr(walk, name) for walk in walks) for name in ("step_deg", "by_field_deg")}
    least = min(walk.used_far for walk in walks)
    return [
        Figure(section, "largest step of any walk (deg)", "smoother", most["step_deg"], high=MOST_STEP_DEG),
        Figure(section, "the same, by the field (deg)", "smoother", most["by_field_deg"], high=MOST_STEP_DEG),
        Figure(section, "far used, least of any walk", "smoother", least, LEAST, pattern="{:.0%}"),
    ]


def stepped(strength: int, seed: int) -> dict[str, Stepped]:
    """Each method on one walk with so many magnets in one place."""
    walk = simulate(replace(SCENARIO, magnets=SCENARIO.magnets * strength), seed, Choices(calibrated=True))
    truth = walk.recording.truth
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    heading_deg = float(np.degrees(heading_of(truth.nav_R_body[0])))
    session = replace(prepare(walk.recording, Options(heading_deg=heading_deg)), truth=None)
    far = np.abs(turned_by_magnet(walk, session.known_field())) < np.radians(FAR[1])
    outcomes = {method: solve(session, method) for method in METHODS}
    errors = {method: heading_error(outcome, truth) for method, outcome in outcomes.items()}
    return {
        method: Stepped(
            step_deg=largest_step_deg(errors[method]),
            by_field_deg=largest_step_deg(errors[method] - errors["inertial" if method == "smoother" else "iez"]),
            rmse_deg=float(np.degrees(np.sqrt(np.mean(errors[method] ** 2)))),
            used_far=float(used(outcome)[far].mean()),
        )
        for method, outcome in outcomes.items()
    }


def heading_error(outcome: Outcome, truth: TrajectoryTruth) -> Floats:
    """Yaw error (F,) rad at the footfalls, as started."""
    error = at_footfalls(outcome.solution, truth, AS_STARTED).yaw_error
    assert error is not None
    return error


def largest_step_deg(error: Floats) -> float:
    """Largest change of a yaw error (F,) rad from one footfall to the next."""
    return float(np.degrees(np.abs(wrap(np.diff(error))).max()))


def used(outcome: Outcome) -> Bools:
    """Whether the method took in the field of each footfall (F,)."""
    passed = [word == QUASI_STATIC for word in outcome.solution.stances.field]
    return np.array(passed) & outcome.field_used


# --- what the sigmas rest on -----------------------------------------------------------------------------------------


def print_sigmas() -> None:
    """Scatter of each channel's value, for each sensor, calibrated or not."""
    fig.print_heading(f"scatter of one stance's value in a homogeneous field, {SIGMA_SCENARIO}: straights / all")
    rows = [
        (f"{sensor}, {name}", *scatter(sensor, calibrated))
        for sensor in SIGMA_SENSORS
        for name, calibrated in MAGNETOMETERS.items()
    ]
    fig.print_table(("sensor", *(f"{name}, {signal.unit}" for name, signal in SIGNALS.items())), rows)


def scatter(sensor: str, calibrated: bool) -> list[str]:
    """Of each signal, in words; median over the seeds."""
    found = []
    for seed in SIGMA_SEEDS:
        walk = simulate(SIGMA_SCENARIO, seed, Choices(sensor=sensor, field="homogeneous", calibrated=calibrated))
        field = footfall_field(walk.recording, detect_stances(walk.recording))
        found.append([_scatter_of(signal.of(field), signal.angle, signal.scale) for signal in SIGNALS.values()])
    return [f"{straight:.2g} / {all_of_it:.2g}" for straight, all_of_it in np.median(found, axis=0)]


def _scatter_of(value: Floats, angle: bool, scale: float) -> tuple[float, float]:
    change = np.diff(value)
    change = (wrap(change) if angle else change) * scale / np.sqrt(2.0)
    middle = np.nanmedian(np.abs(change - np.nanmedian(change)))
    return float(1.4826 * middle), float(np.nanstd(change))


if __name__ == "__main__":
    fig.leave_with(main)
