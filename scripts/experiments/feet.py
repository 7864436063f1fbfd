"""Two feet of one person in one graph, beside each foot alone.

All methods have the same stances, and of simulated walks the true heading of each foot at its start. What was tuned was
tuned on seeds 1 to 8.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import walks
from harness import Figure, option

from experiments import Asked, Column, Experiment, Found, Table, Task, attempt, find_truth, give_heading, list_seeds
from fg_nav import navigate_feet
from fg_nav.arrays import Floats
from fg_nav.detection import detect_stances
from fg_nav.evaluation.comparison import align
from fg_nav.frames import compute_heading, wrap_angle
from fg_nav.lab.consistency import compute_stance_nees
from fg_nav.lab.simulation import simulate_feet
from fg_nav.magnetic import average_footfall_field
from fg_nav.recording import Recording
from fg_nav.smoother import smooth
from fg_nav.smoother.batch import WalkInput
from fg_nav.smoother.feet import smooth_feet
from fg_nav.solution import Solution

SIDES = ("left", "right")


# --- simulated feet ---------------------------------------------------------------------------------------------------


def list_simulated(chosen: Namespace) -> list[Task]:
    """Each scenario without and with the magnetometer."""
    measures = {
        f"{name}, {words} magnetometer": partial(measure_pair, name, words == "with")
        for name in chosen.scenarios
        for words in ("without", "with")
    }
    return list_seeds(chosen, measures)


def measure_pair(name: str, with_mag: bool, seed: int) -> Found:
    """Smooth both feet of a walk, whose true heading at the start is known, alone and together."""
    walk, feet = simulate_feet(name, seed), dict[str, WalkInput]()
    for side in SIDES:
        recording = getattr(walk, side).recording
        stances, heading = detect_stances(recording), give_heading(recording).heading_rad
        field = average_footfall_field(recording, stances) if with_mag else None
        feet[side] = WalkInput(recording, stances, heading, field)
    solved = solve_pair(feet)
    return {f"{side} {how}": measure_foot(solution, feet[side].recording) for side, how, solution in solved}


def solve_pair(feet: Mapping[str, WalkInput]) -> Iterator[tuple[str, str, Solution]]:
    """Yield each foot's side and solution, alone and together with the other."""
    both = smooth_feet(feet["right"], feet["left"])
    for side, foot in feet.items():
        yield side, "alone", smooth(foot.recording, foot.stances, heading=foot.heading, field=foot.field)
        yield side, "together", getattr(both, side)


def measure_foot(solution: Solution, recording: Recording) -> dict[str, float]:
    """Errors of the footfalls: position after the best yaw and shift, m, heading less its mean, deg; and the claims."""
    (truth, nav_R_body), table = find_truth(recording), solution.stances
    turned = wrap_angle(compute_heading(table.nav_R_body) - compute_heading(nav_R_body[table.sample]))
    whole = float(np.angle(np.exp(1j * turned).mean()))
    return {
        "position (m)": rms_position(table.position, truth.position[table.sample]),
        "heading (deg)": float(np.degrees(np.sqrt(np.mean(wrap_angle(turned - whole) ** 2)))),
        "NEES": compute_stance_nees(table, truth).mean_ratio,
        "turn / sigma": whole / float(np.median(table.heading_sigma)),
    }


def rms_position(position: Floats, truth: Floats) -> float:
    """Rms over the ground, m, after the best yaw and shift, where the truth is known."""
    seen = np.isfinite(truth).all(axis=1)
    moved = align(position[seen], truth[seen], "yaw").apply(position[seen])
    return float(np.sqrt(np.mean(np.sum((moved - truth[seen])[:, :2] ** 2, axis=1))))


def judge_feet(table: Table) -> list[Figure]:
    """Both feet together over that foot alone which is the better one, each rms over the seeds."""
    figures = []
    for section in table.sections:
        for figure in ("position (m)", "heading (deg)"):
            values = {v: table.values(section, v, figure) for s, v in table.cases if s == section}
            rms = {variant: float(np.sqrt(np.mean(some**2))) for variant, some in values.items()}
            if len(rms) == 4:
                together = float(np.sqrt(np.mean([rms[f"{side} together"] ** 2 for side in SIDES])))
                share = together / min(rms[f"{side} alone"] for side in SIDES)
                high = 0.7 if "without" in section else 1.0
                figures.append(Figure(section, f"{figure} over the better foot", "together", share, high=high))
    return figures


# --- recorded feet ----------------------------------------------------------------------------------------------------

PAIRS: Mapping[str, tuple[str, Sequence[str]]] = {
    "feet_vicon": ("?_Foot", "LR"), "feet_2min": ("good_?foot", SIDES),
    "mems_foot": ("pair_?_1", SIDES), "feet_thighs": ("*_?", ("LF", "RF")),
}  # fmt: skip
"""Names of the recordings of each folder, with a `?` for the foot, and what is there for the left and the right one."""
INSTEP = 0.65  # Where the sensor of feet_vicon is, from ankle to toe.


def list_pairs(chosen: Namespace) -> list[Task]:
    """All pairs of feet, and the motion-captured ones of zupt_fgo."""
    data = walks.data_folder(chosen.data)
    tasks = [Task("zupt_fgo", "120 s in laps", partial(measure_captured, data / "two_feet" / "zupt_fgo"))]
    for folder, (pattern, sides) in PAIRS.items():
        for left in sorted((data / folder).glob(f"{pattern.replace('?', sides[0])}.csv.gz")):
            right = left.with_name(left.name.replace(sides[0], sides[1]))
            section = folder if folder != "feet_thighs" or "straight" in left.name else f"{folder}, closed"
            tasks.append(Task(section, left.name.split(".")[0], partial(measure_recorded, left, right)))
    return tasks


def measure_recorded(left: Path, right: Path) -> Found:
    """Start to end of each foot, m, or rms to motion capture; metres of the person, and what joins the feet."""

    def measure() -> dict[str, float | str]:
        result = navigate_feet(left, right, "inertial", sides="left,right")
        found: dict[str, float | str] = {"person (m)": result.metrics.distance_m, "cells": float(result.pairing.cells)}
        captured = left.with_name("vicon.npz")
        for side, foot in result.feet.items():
            end = float(np.linalg.norm(np.diff(foot.position[[0, -1], :2], axis=0)))
            if captured.exists():
                ankle, toe = (np.load(captured)[side[0].upper() + name] for name in ("TIO", "TOE"))
                end = rms_position(foot.position, ankle + INSTEP * (toe - ankle))
            found[f"{side} (m)"] = end
        return {**found, "drift (%)": 100.0 * result.pairing.clock_drift, "verdict": result.verdict.word}

    return {"together": attempt(measure)}


def measure_captured(folder: Path) -> Found:
    """Each foot alone and together against motion capture, m; the truth is left-handed."""
    places = np.genfromtxt(folder / "positionGt.csv", delimiter=",", skip_header=1)
    feet = {}
    for side in SIDES:
        rows = np.genfromtxt(folder / f"imuMeas{side.capitalize()}.csv", delimiter=",", skip_header=1)
        recording = Recording(rows[:, 0] / 60.0, rows[:, 1:4], rows[:, 4:7])
        feet[side] = WalkInput(recording, detect_stances(recording))
    found = dict[str, dict[str, float]](alone={}, together={})
    for side, how, solution in solve_pair(feet):
        first = 1 + 3 * SIDES.index(side)
        place = places[:, first : first + 3] * [1.0, -1.0, 1.0]
        found[how][f"{side} (m)"] = rms_position(solution.position, place)
    return found


EXPERIMENTS: Mapping[str, Experiment] = {
    "two-feet": Experiment(
        """Two feet in one graph beside each alone, simulated: errors of the footfalls, and whether the claims are true.

        Position after the best yaw and shift, heading less its mean; NEES of positions relative to the start, 1 where
        the claims are true; turn of the whole walk over the heading's sigma, rms. Errors of two sensors that are
        independent and of one size leave 0.71 of it in the mean of both; by walk the mean of two errors is 1.36 times
        the smaller one (median), as nothing shows which foot's that is.""",
        list_simulated,
        (
            Column("position (m)", "position (m)", "rms"),
            Column("heading (deg)", "heading (deg)", "rms"),
            Column("NEES", "NEES"),
            Column("turn / sigma", "turn / sigma", "rms", "{:.2f}"),
        ),
        seeds=20,
        options={"scenarios": option(["office", "mall", "teaching-building"], "walks", nargs="+", metavar="NAME")},
        judge=judge_feet,
    ),
    "real-feet": Experiment(
        "All recorded pairs of feet: start to end, m; of motion-captured ones the rms after the best yaw and shift, m.",
        list_pairs,
        (
            *(Column(f"{side} (m)", f"{side} (m)", "mean / worst") for side in SIDES),
            Column("person (m)", "person (m)", "mean", "{:.1f}"),
            Column("cells", "cells", "sum", "{:.0f}"),
        ),
        [
            *(Asked(f"{side} (m)", "worst", high=0.03, section="feet_vicon") for side in SIDES),
            *(Asked(f"{side} (m)", "mean", high=0.20, section="feet_thighs, closed") for side in SIDES),
        ],
    ),
}
