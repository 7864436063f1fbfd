"""Two feet of one person in one graph, beside each foot alone.

    python scripts/two_feet.py [--sections NAME ...] [--scenarios NAME ...] [--seeds N] [--first SEED] [--data DIR]
                               [--jobs N] [--json FILE]

Simulated walks begin at seed 101; what was tuned was tuned on seeds 1 to 8. All methods have the same stances, and the
true heading of each foot at its start.

========= ===========================================================================================================
simulated office, mall and teaching-building, without and with the magnetometer. Position: rms over the footfalls
          after the best yaw and shift; heading: rms less its mean. Of both feet, rms over the seeds; over the better
          foot: over that foot alone which is the better one in this rms. Errors of two sensors that are independent and
          of one size leave 0.71 of it in the mean of both; by walk the mean of two errors is 1.36 times the smaller
          one (median), as nothing shows which foot's that is. NEES: of positions relative to the start, 1 where the
          claimed covariances are true (mean over 3 degrees of freedom). Turn: of the whole walk about its start, the
          mean error of the heading over its sigma, rms over walks and feet: with a field nearly all that NEES shows
real      the motion-captured feet of zupt_fgo and gaitmap: rms of all samples after the best yaw and shift (m). And all
          pairs of shared/data as `navigate_feet` has them: rms to motion capture, or start to end, of each foot (m)
faults    the right foot's samples missing from 60 to 120 s: rms of its footfalls (m), alone and together. Feet swapped:
          the width that is found, over its sigma, negative where the recording called right is of the left foot
clocks    offsets that were put between the clocks of both feet, and what is found
steps     the footfalls of motion-captured feet against the middle of the other foot's stride (m)
cost      time of the processor of both feet over that of one, in the mean of both: of the solver, and of a run from the
          samples to the verdict; the least of `REPEATS` in turn
========= ===========================================================================================================
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import harness
import numpy as np
import walks
from harness import Figure, option, spread

from fg_nav import navigate, navigate_feet
from fg_nav.arrays import Floats, interpolate_columns
from fg_nav.detection import detect_stances
from fg_nav.errors import EstimationError, FgNavError
from fg_nav.evaluation.comparison import align
from fg_nav.feet.clocks import list_swings, match_swings
from fg_nav.feet.person import FeetSolution
from fg_nav.feet.steps import Footfalls, find_steps
from fg_nav.frames import compute_heading, wrap_angle
from fg_nav.lab.consistency import compute_stance_nees
from fg_nav.lab.simulation import simulate_feet
from fg_nav.magnetic import average_footfall_field
from fg_nav.recording import Recording
from fg_nav.smoother import smooth
from fg_nav.smoother.batch import WalkInput
from fg_nav.smoother.feet import smooth_feet
from fg_nav.solution import Solution
from fg_nav.truth import TrajectoryTruth
from fg_nav.walk import Options

SECTIONS = ("simulated", "real", "faults", "clocks", "steps", "cost")
SIDES = ("left", "right")
SENSORS = {False: "without", True: "with"}

SHARE_WITHOUT, SHARE_WITH, COST = 0.7, 1.0, 2.3
"""Asked of the errors over those of the better foot without and with the magnetometer, and of the cost."""

REPEATS = 5  # Of each call whose time is measured.

OFFSETS_S = (0.0, 0.3, -0.3, 0.6, -1.1, 5.0, -20.0, 4000.0)


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        sections=option(SECTIONS, "which", nargs="+", choices=SECTIONS),
        scenarios=["office", "mall", "teaching-building"],
        seeds=20,
        first=harness.FIRST_SEED,
        data=None,
        jobs=1,
        json=None,
    )
    figures = [figure for name in chosen.sections for figure in MEASURE[name](chosen)]
    harness.print_verdict(figures, chosen.json)


# --- simulated feet ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Errors:
    """Of one foot: rms of position, m, and heading, deg, the NEES, and the whole walk's turn over its sigma."""

    position_m: float
    heading_deg: float
    nees: float
    turn: float


Case = tuple[bool, bool, str]
"""Whether with the magnetometer, whether both feet are in one graph, and the side."""


def draw_feet(name: str, seed: int, with_mag: bool) -> dict[str, WalkInput]:
    """Simulate a walk with a sensor on each foot."""
    walk = simulate_feet(name, seed)
    return {side: prepare_foot(getattr(walk, side).recording, with_mag) for side in SIDES}


def prepare_foot(recording: Recording, with_mag: bool) -> WalkInput:
    """Find the stances and the field of a foot, whose true heading at the start is known."""
    truth, stances = recording.truth, detect_stances(recording)
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    field = average_footfall_field(recording, stances) if with_mag else None
    return WalkInput(recording, stances, float(compute_heading(truth.nav_R_body[0])), field)


def measure_walk(name: str, seed: int) -> dict[Case, Errors]:
    """Smooth both feet of a walk alone and together, without and with the magnetometer."""
    feet, found = draw_feet(name, seed, True), {}
    for with_mag in SENSORS:
        some = feet if with_mag else {side: replace(foot, field=None) for side, foot in feet.items()}
        both = smooth_feet(some["right"], some["left"])
        for side, foot in some.items():
            alone = smooth(foot.recording, foot.stances, heading=foot.heading, field=foot.field)
            found[with_mag, False, side] = measure_errors(alone, foot.recording)
            found[with_mag, True, side] = measure_errors(getattr(both, side), foot.recording)
    return found


def measure_errors(solution: Solution, recording: Recording) -> Errors:
    """Measure the footfalls of a foot against its truth."""
    truth, table = recording.truth, solution.stances
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    place = truth.position[table.sample]
    turned = wrap_angle(compute_heading(table.nav_R_body) - compute_heading(truth.nav_R_body[table.sample]))
    whole = float(np.angle(np.exp(1j * turned).mean()))
    turned = wrap_angle(turned - whole)
    return Errors(
        measure_position(table.position, place),
        float(np.degrees(np.sqrt(np.mean(turned**2)))),
        compute_stance_nees(table, truth).mean_ratio,
        whole / float(np.median(table.heading_sigma)),
    )


def measure_position(position: Floats, truth: Floats) -> float:
    """Rms over the ground, m, after the best yaw and shift."""
    moved = align(position, truth, "yaw").apply(position)
    return float(np.sqrt(np.mean(np.sum((moved - truth)[:, :2] ** 2, axis=1))))


def measure_simulated(chosen: argparse.Namespace) -> list[Figure]:
    """All scenarios."""
    rows, figures = [], []
    for name in chosen.scenarios:
        seen = harness.map_walks(partial(measure_walk, name), harness.seeds_of(chosen), chosen.jobs, name)
        for with_mag, words in SENSORS.items():
            for what, unit in (("position_m", "m"), ("heading_deg", "deg")):
                row, figure = compare_feet(name, seen, with_mag, what, unit, words)
                rows.append(row)
                figures.append(figure)
    harness.print_heading(f"Two feet, {chosen.seeds} seeds: rms over the seeds, and by walk median (5 to 95 %)")
    heads = ["walk, magnetometer", "left alone", "right alone", "both together", "over both alone",
             "over the better foot", "by walk, over the better", "by walk, over the rms of both", "NEES alone",
             "NEES together", "turn alone", "turn together"]  # fmt: skip
    harness.print_table(heads, rows)
    return figures


def compare_feet(
    scenario: str, seen: Sequence[Mapping[Case, Errors]], with_mag: bool, what: str, unit: str, words: str
) -> tuple[list[str], Figure]:
    """Compare both feet with each alone."""
    alone, both = (
        np.array([[getattr(one[with_mag, together, side], what) for side in SIDES] for one in seen])
        for together in (False, True)
    )
    nees, turn = (
        [[getattr(one[with_mag, together, side], name) for one in seen for side in SIDES] for together in (False, True)]
        for name in ("nees", "turn")
    )
    rms_alone, rms_both = np.sqrt(np.mean(alone**2, axis=0)), float(np.sqrt(np.mean(both**2)))
    share = rms_both / float(rms_alone.min())
    by_walk = np.sqrt(np.mean(both**2, axis=1))
    row = [
        f"{scenario}, {words}, {unit}",
        *(f"{value:.3f}" for value in rms_alone),
        f"{rms_both:.3f}",
        f"{rms_both / np.sqrt(np.mean(rms_alone**2)):.2f}",
        f"{share:.2f}",
        spread(by_walk / alone.min(axis=1)),
        spread(by_walk / np.sqrt(np.mean(alone**2, axis=1))),
        *(spread(one) for one in nees),
        *(f"{np.sqrt(np.mean(np.square(one))):.2f}" for one in turn),
    ]
    high = SHARE_WITH if with_mag else SHARE_WITHOUT
    return row, Figure("simulated", f"{scenario}, {words}, {unit}, over the better foot", "both", share, high=high)


# --- motion-captured feet ---------------------------------------------------------------------------------------------

Captured = dict[str, tuple[Recording, Floats]]
"""Of each side the recording, and true places (N, 3) m at its samples, NaN where they are not known."""


def read_captured(data: Path | None) -> Captured:
    """Read the feet of zupt_fgo."""
    folder = walks.data_folder(data) / "two_feet" / "zupt_fgo"
    places = np.genfromtxt(folder / "positionGt.csv", delimiter=",", skip_header=1)
    found = {}
    for k, side in enumerate(SIDES):
        rows = np.genfromtxt(folder / f"imuMeas{side.capitalize()}.csv", delimiter=",", skip_header=1)
        place = places[:, 1 + 3 * k : 4 + 3 * k] * [1.0, -1.0, 1.0]  # the truth is left-handed
        found[side] = Recording(rows[:, 0] / 60.0, rows[:, 1:4], rows[:, 4:7]), place
    return found


def read_columns(path: Path) -> dict[tuple[str, str], Floats]:
    """Read a table with two rows of names."""
    with path.open(encoding="utf-8") as file:
        first, second, *rows = list(csv.reader(file))
    values = np.array([[float(cell) if cell else np.nan for cell in row] for row in rows if any(row[1:])])
    return {(first[k], second[k]): values[:, k] for k in range(1, len(first))}


def read_gaitmap(data: Path | None, name: str, with_markers: bool) -> Captured:
    """Read feet of gaitmap, and the markers of their heels where there are any: in mm, at 100 Hz."""
    folder = walks.data_folder(data) / "two_feet" / "gaitmap"
    table, found = read_columns(folder / name), {}
    heels = read_columns(folder / "mocap_sample.csv") if with_markers else {}
    for side in SIDES:
        acc, gyr = (
            np.stack([table[f"{side}_sensor", f"{what}_{axis}"] for axis in "xyz"], axis=1) for what in ("acc", "gyr")
        )
        t, place = np.arange(len(acc)) / 204.8, np.full(acc.shape, np.nan)
        for axis, name_of in enumerate("xyz" if heels else ""):
            marker = 1e-3 * heels[f"{side[0].upper()}_FCC", name_of]
            place[:, axis] = np.interp(t, np.arange(len(marker)) / 100.0, marker, right=np.nan)
        found[side] = Recording(t, acc, np.radians(gyr)), place
    return found


REAL: Mapping[str, Callable[[Path | None], Captured]] = {
    "zupt_fgo, 120 s in laps": read_captured,
    "gaitmap, 39 s to and fro": partial(read_gaitmap, name="imu_sample.csv", with_markers=True),
    "gaitmap, stairs": partial(read_gaitmap, name="imu_sample_healthy_stair_up.csv", with_markers=False),
}


def measure_real(chosen: argparse.Namespace) -> list[Figure]:
    """The motion-captured feet alone and together."""
    from fg_nav.ekf.core import run_iez

    rows, figures = [], []
    for name, read in REAL.items():
        captured = read(chosen.data)
        feet = {side: WalkInput(one, detect_stances(one)) for side, (one, _) in captured.items()}
        both = smooth_feet(feet["right"], feet["left"])
        apart = measure_apart(both, feet)
        for side, foot in feet.items():
            alone = (run_iez(foot.recording, foot.stances), smooth(foot.recording, foot.stances))
            errors = [measure_captured(one, captured[side][1]) for one in (*alone, getattr(both, side))]
            width = f"{both.width_m:.2f} +- {both.width_sigma_m:.2f}"
            rows.append([f"{name}, {side}", *map(format_error, errors), width, f"{both.cells}", f"{apart:.2f}"])
        figures.append(Figure("real", f"{name}, largest distance of standing feet (m)", "both", apart, high=1.3))
    harness.print_heading("Motion-captured feet: rms after the best yaw and shift (m)")
    heads = ["foot", "iez alone", "smoother alone", "both together", "width (m)", "cells", "furthest apart (m)"]
    harness.print_table(heads, rows)
    return [*figures, *measure_pairs(chosen)]


PAIRS = {
    "feet_vicon": ("?_Foot", "LR"), "feet_2min": ("good_?foot", ("left", "right")),
    "mems_foot": ("pair_?_1", ("left", "right")), "feet_thighs": ("*_?", ("LF", "RF")),
}  # fmt: skip
"""Names of the recordings of each folder, with a `?` for the foot, and what is there for the left and the right one."""

CAPTURED_M, CLOSURE_M, INSTEP = 0.03, 0.20, 0.65
"""Asked of motion-captured feet, and of closed walks in the mean; and where the sensor is, from ankle to toe."""


def measure_pairs(chosen: argparse.Namespace) -> list[Figure]:
    """All pairs of feet, without the magnetometer, with what is known of their ends."""
    rows, figures, closed = [], [], []
    for folder, (pattern, sides) in PAIRS.items():
        place = walks.data_folder(chosen.data) / folder
        for left in sorted(place.glob(f"{pattern.replace('?', sides[0])}.csv.gz")):
            right = left.with_name(left.name.replace(sides[0], sides[1]))
            name = f"{folder}, {left.name.split('.')[0]}"
            try:
                result = navigate_feet(left, right, "inertial", sides="left,right")
            except FgNavError as error:
                rows.append([name, str(error), "", "", "", "", ""])
                figures.append(Figure("real", f"{name}, refused", "both", 1.0, high=0.0))
                continue
            ends = [float(np.linalg.norm(np.diff(foot.position[[0, -1], :2], axis=0))) for foot in result.feet.values()]
            if folder == "feet_thighs" and "straight" not in name:
                closed += ends
            if folder == "feet_vicon":
                ends = [measure_captured(foot, read_vicon(place, side)) for side, foot in result.feet.items()]
                figures.append(Figure("real", "feet_vicon, rms (m)", "both", max(ends), high=CAPTURED_M))
            pairing = result.pairing
            clock = f"{pairing.clock_offset_s:+.2f} s, {100.0 * pairing.clock_drift:+.2f} %"
            distance = f"{result.metrics.distance_m:.1f}"
            rows.append([name, distance, *map(format_error, ends), f"{pairing.cells}", clock, result.verdict.word])
    if closed:
        figures.append(
            Figure("real", "feet_thighs, start to end (m), mean", "both", float(np.mean(closed)), high=CLOSURE_M)
        )
    harness.print_heading("All pairs of feet: start to end, of feet_vicon rms (m)")
    harness.print_table(["walk", "person (m)", "left", "right", "cells", "clock", "verdict"], rows)
    return figures


def read_vicon(folder: Path, side: str) -> Floats:
    """Read where the instep (N, 3) m of a foot was at its samples."""
    truth = np.load(folder / "vicon.npz")
    ankle, toe = (truth[side[0].upper() + name] for name in ("TIO", "TOE"))
    return np.asarray(ankle + INSTEP * (toe - ankle))


def measure_captured(solution: Solution, place: Floats) -> float:
    """Measure all samples of a foot against true places, where these are known."""
    seen = np.isfinite(place).all(axis=1)
    return measure_position(solution.position[seen], place[seen]) if seen.any() else float("nan")


def format_error(error: float) -> str:
    """Write an error; of a walk without a truth there is none."""
    return f"{error:.3f}" if np.isfinite(error) else "-"


def measure_apart(both: FeetSolution, feet: Mapping[str, WalkInput]) -> float:
    """Return the largest distance of both feet while both stand, m."""
    t = feet["left"].recording.t
    stands = feet["left"].stances.mask & (np.interp(t, feet["right"].recording.t, feet["right"].stances.mask) == 1.0)
    right = interpolate_columns(t, both.right.t, both.right.position)
    return float(np.linalg.norm(both.left.position - right, axis=1)[stands].max())


def measure_steps(chosen: argparse.Namespace) -> list[Figure]:
    """Footfalls of motion-captured feet against the middle of the other foot's stride."""
    falls = {}
    for side, (recording, place) in read_captured(chosen.data).items():
        stances = detect_stances(recording)
        sample = stances.stillest(recording.gyr)
        falls[side] = Footfalls(recording.t[sample], place[sample])
    rows = []
    for side, other in (("left", "right"), ("right", "left")):
        one, two = falls[side], falls[other]
        steps = find_steps(one, two)
        d = one.position[steps.at] - 0.5 * (two.position[steps.before] + two.position[steps.before + 1])
        u = np.stack([steps.left_normal[:, 1], -steps.left_normal[:, 0]], axis=1)
        parts = (np.sum(d[:, :2] * u, axis=1), np.sum(d[:, :2] * steps.left_normal, axis=1), d[:, 2])
        rows.append([side, str(len(d)), *(f"{part.mean():+.3f} +- {part.std():.3f}" for part in parts)])
    harness.print_heading("Steps of motion-captured feet (m)")
    harness.print_table(["foot", "steps", "along", "left", "up"], rows)
    return []


# --- faults -----------------------------------------------------------------------------------------------------------

LOST_S = (60.0, 120.0)  # When a foot's sensor was silent.


@dataclass(frozen=True)
class Faults:
    """Rms of the lost foot, m, alone and together, of the other one together, and width over sigma of swapped feet."""

    alone_m: float
    together_m: float
    other_m: float
    swapped: float


def measure_fault(name: str, seed: int) -> Faults:
    """Lose one foot for a while, and swap both."""
    feet = draw_feet(name, seed, False)
    whole = feet["right"].recording
    kept = (whole.t < LOST_S[0]) | (whole.t > LOST_S[1])
    cut = Recording(whole.t[kept], whole.acc[kept], whole.gyr[kept], truth=whole.truth)
    lost = replace(feet["right"], recording=cut, stances=detect_stances(cut))
    both, swapped = smooth_feet(lost, feet["left"]), smooth_feet(feet["left"], feet["right"])
    return Faults(
        measure_footfalls(smooth_alone(lost), whole),
        measure_footfalls(both.right, whole),
        measure_footfalls(both.left, feet["left"].recording),
        swapped.width_m / swapped.width_sigma_m,
    )


def measure_footfalls(solution: Solution, recording: Recording) -> float:
    """Rms of the footfalls, m, by their times, after the best yaw and shift."""
    truth, table = recording.truth, solution.stances
    assert isinstance(truth, TrajectoryTruth)
    place = interpolate_columns(table.t, truth.t, truth.position)
    return measure_position(table.position, place)


def measure_faults(chosen: argparse.Namespace) -> list[Figure]:
    """A foot lost for a while, and feet that are swapped."""
    rows = []
    for name in chosen.scenarios:
        found = harness.map_walks(partial(measure_fault, name), harness.seeds_of(chosen), chosen.jobs, name)
        columns = [[getattr(one, what) for one in found] for what in ("alone_m", "together_m", "other_m", "swapped")]
        rows.append([name, *map(spread, columns)])
    harness.print_heading(
        f"The right foot lost for {LOST_S[1] - LOST_S[0]:.0f} s, and feet swapped, {chosen.seeds} seeds"
    )
    heads = ["walk", "right alone (m)", "right together (m)", "left together (m)", "swapped: width over sigma"]
    harness.print_table(heads, rows)
    return []


# --- clocks, cost -----------------------------------------------------------------------------------------------------


def measure_clocks(chosen: argparse.Namespace) -> list[Figure]:
    """Offsets of the clocks."""
    rows, figures = [], []
    for name in (*chosen.scenarios, "captured"):
        if name == "captured":
            feet = {side: one for side, (one, _) in read_captured(chosen.data).items()}
        else:
            walk = simulate_feet(name, chosen.first)
            feet = {side: getattr(walk, side).recording for side in SIDES}
        left, right = (replace(feet[side], truth=None) for side in SIDES)
        stances = [detect_stances(one) for one in (left, right)]
        errors = []
        for offset in OFFSETS_S:
            try:
                found = match_swings(
                    list_swings(left, stances[0]), list_swings(replace(right, t=right.t + offset), stances[1])
                ).offset_s
                errors.append(abs(found + offset))
            except EstimationError:
                errors.append(np.inf)
        rows.append([name, *(f"{e:.3f}" if np.isfinite(e) else "refused" for e in errors)])
        figures.append(Figure("clocks", f"{name}, largest error (s)", "both", max(errors), high=0.1))
    harness.print_heading("Error of the clocks' offset (s), by the offset")
    harness.print_table(["walk", *(f"{offset:+g}" for offset in OFFSETS_S)], rows)
    return figures


def measure_cost(chosen: argparse.Namespace) -> list[Figure]:
    """Time of the processor, of the solver and of a whole run."""
    rows, figures = [], []
    for name in chosen.scenarios:
        feet = draw_feet(name, chosen.first, True)
        for with_mag, words in SENSORS.items():
            some = feet if with_mag else {side: replace(foot, field=None) for side, foot in feet.items()}
            one, both = measure_least(smooth_alone, smooth_feet, some)
            rows.append([f"{name}, {words}, solver", f"{one:.2f}", f"{both:.2f}", f"{both / one:.2f}"])
            figures.append(Figure("cost", f"{name}, {words}, solver over one foot", "both", both / one, high=COST))
            one, both = measure_least(partial(run_alone, with_mag), partial(run_both, with_mag), feet)
            rows.append([f"{name}, {words}, run", f"{one:.2f}", f"{both:.2f}", f"{both / one:.2f}"])
            figures.append(Figure("cost", f"{name}, {words}, run over one foot", "both", both / one, high=COST))
    harness.print_heading("Time of the processor (s)")
    harness.print_table(["walk, magnetometer", "one foot", "both", "ratio"], rows)
    return figures


def measure_least(
    alone: Callable[[WalkInput], object], both: Callable[[WalkInput, WalkInput], object], feet: Mapping[str, WalkInput]
) -> tuple[float, float]:
    """Least times, s, of one foot alone, in the mean of both, and of both together, repeated in turn."""
    calls = [*(partial(alone, foot) for foot in feet.values()), partial(both, feet["right"], feet["left"])]
    least = np.min([[harness.measure_time(call)[0].cpu for call in calls] for _ in range(REPEATS)], axis=0)
    return 0.5 * float(least[0] + least[1]), float(least[2])


def run_alone(with_mag: bool, foot: WalkInput) -> object:
    """Navigate a recording of one foot up to the verdict."""
    return navigate(replace(foot.recording, truth=None), options=Options(use_magnetometer=with_mag)).verdict


def run_both(with_mag: bool, right: WalkInput, left: WalkInput) -> object:
    """Navigate the recordings of both feet up to the verdict."""
    recordings = (replace(one.recording, truth=None) for one in (left, right))
    return navigate_feet(*recordings, options=Options(use_magnetometer=with_mag), sides="left,right").verdict


def smooth_alone(foot: WalkInput) -> Solution:
    """Smooth one foot."""
    return smooth(foot.recording, foot.stances, heading=foot.heading, field=foot.field)


MEASURE: Mapping[str, Callable[[argparse.Namespace], list[Figure]]] = {
    "simulated": measure_simulated,
    "real": measure_real,
    "faults": measure_faults,
    "clocks": measure_clocks,
    "steps": measure_steps,
    "cost": measure_cost,
}

if __name__ == "__main__":
    harness.run(main)
