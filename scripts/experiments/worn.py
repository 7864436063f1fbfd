"""Sensors on both feet and in a trouser pocket: two feet in one graph, how fast a gyro bias is found, and real phones.

Of two feet all methods have the same stances, and of simulated walks the true heading of each foot at its start. What
was tuned was tuned on seeds 1 to 8.
"""

from __future__ import annotations

import math
from argparse import Namespace
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import walks
from harness import Figure, option
from pymap3d import geodetic2enu

from experiments import Asked, Column, Experiment, Figures, Found, Table, Task, find_truth, give_heading, list_seeds
from fg_nav import navigate_feet, pocket
from fg_nav.arrays import Bools, Floats, interpolate_columns
from fg_nav.detection import detect_stances
from fg_nav.evaluation.comparison import align, yaw_between
from fg_nav.frames import compute_heading, wrap_angle, yaw_rotation
from fg_nav.io import read, read_gnss
from fg_nav.lab.consistency import compute_stance_nees
from fg_nav.lab.follow_pocket import follow_pocket
from fg_nav.lab.reproduce.munoz_diaz2017.walks import FIELDS_UT, replace_field
from fg_nav.lab.simulation import Choices, simulate, simulate_feet
from fg_nav.lab.simulation.fields import Field, Homogeneous, street
from fg_nav.magnetic import average_footfall_field
from fg_nav.pipeline import Result, navigate
from fg_nav.recording import Recording
from fg_nav.smoother import smooth
from fg_nav.smoother.batch import WalkInput
from fg_nav.smoother.feet import smooth_feet
from fg_nav.solution import Solution
from fg_nav.truth import FixColumns, Gnss, find_turn
from fg_nav.walk import Options, Walk

SIDES = ("left", "right")


# --- simulated feet ---------------------------------------------------------------------------------------------------


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
        found: dict[str, float | str] = {"person (m)": result.metrics.distance_m}
        captured = left.with_name("vicon.npz")
        for side, foot in result.feet.items():
            end = float(np.linalg.norm(np.diff(foot.position[[0, -1], :2], axis=0)))
            if captured.exists():
                ankle, toe = (np.load(captured)[side[0].upper() + name] for name in ("TIO", "TOE"))
                end = rms_position(foot.position, ankle + INSTEP * (toe - ankle))
            found[f"{side} (m)"] = end
        return {**found, "drift (%)": 100.0 * result.pairing.clock_drift, "verdict": result.verdict.word}

    return {"together": measure}


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


# --- gyro bias -------------------------------------------------------------------------------------------------------

WITHIN_DEG_S, FROM_S, STREET_M, NOISE_UT = 0.02, 60.0, 500.0, 0.5  # the noise is that of a sample
AFTER_S = (60, 2300)
FIELDS = ("equator", "munich", "street", "past-cars")


def find_bias(name: str, seed: int) -> Found:
    """What each method, given the noise of the magnetometer, finds in a field."""
    if name == "past-cars":
        walk = simulate("pocket-past-cars", seed)
        field: Field = walk.field
    else:
        walk = simulate("pocket-street", seed, Choices(aligned=True))
        field = Homogeneous(FIELDS_UT["equator" if name == "street" else name])
        field = street(field, STREET_M) if name == "street" else field
    recording = replace_field(walk, field, NOISE_UT, np.random.default_rng((seed, FIELDS.index(name))))
    nav_R_body = find_truth(recording)[1]
    start = pocket.PocketStart(nav_R_body[0], math.radians(0.5))
    graph = pocket.PocketSmootherParameters(mag_sigma_uT=NOISE_UT)
    methods: Mapping[str, Callable[[], pocket.PocketTrack]] = {
        "online": partial(follow_pocket, recording, graph, start),
        "batch": partial(pocket.smooth_pocket, recording, graph, start),
        "paper": partial(pocket.estimate_pocket, recording, pocket.PocketParameters(mag_sigma_uT=NOISE_UT), start),
    }

    def judge(run: Callable[[], pocket.PocketTrack]) -> Figures:
        track = run()
        off = track.gyro_bias - interpolate_columns(track.t, walk.biases.t, walk.biases.gyr)
        # the error of the z bias each second, and from when on it is within what is asked for good
        z = np.degrees(off[np.searchsorted(track.t, np.arange(track.t[0], track.t[-1], 1.0)), 2])
        outside = np.flatnonzero(~(np.abs(z) <= WITHIN_DEG_S))
        since = float(outside[-1] + 1) if len(outside) else 0.0
        yaw = float(np.degrees(yaw_between(nav_R_body[-1], track.nav_R_body[-1])))
        kept = track.t[track.covariance_sample] >= FROM_S
        e, P = off[track.covariance_sample[kept]], track.covariance[kept, 3:, 3:]
        nees = float(np.einsum("ni,ni->n", e, np.linalg.solve(P, e[:, :, None])[:, :, 0]).mean())
        after = {f"{s} s": float(z[min(s, len(z) - 1)]) for s in AFTER_S}
        return {**after, "found (s)": since if since < len(z) else math.inf, "yaw (deg)": yaw, "NEES of 3": nees}

    return {method: partial(judge, run) for method, run in methods.items()}


# --- real pockets and thighs -----------------------------------------------------------------------------------------

MAX_ACCURACY_M, DECLINATION_DEG = 15.0, -6.0  # Of a fix; of magnetic north, where the phones were carried.


def list_pockets(chosen: Namespace) -> list[Task]:
    """Phones in trouser pockets outdoors."""
    data = walks.data_folder(chosen.data)
    phones = sorted((data / "pocket_gnss").glob("*.zip"))
    return [Task("pockets", path.stem.removeprefix("pocket_"), partial(measure_pocket, path)) for path in phones]


def measure_pocket(path: Path) -> Found:
    """Figures of one phone."""
    recording, everything = read(path), read_gnss(path)
    kept = tuple(fix for fix in everything.fixes if fix.horizontal_sigma_m < MAX_ACCURACY_M)
    gnss, t = replace(everything, fixes=kept), np.array([fix.time_s for fix in kept])
    place, sigma = np.array([fix.position[:2] for fix in kept]), np.array([fix.horizontal_sigma_m for fix in kept])
    first, half, minute = t < t[0] + 0.1 * (t[-1] - t[0]), np.arange(len(t)) % 2 == 0, (t // 30.0) % 2 == 0

    def distance(path: Floats, where: Bools) -> float:
        return float(np.linalg.norm(path - place, axis=1)[where].mean())

    def solve(gnss: Gnss | None) -> tuple[Result, Floats]:
        found = navigate(replace(Walk.of(recording, Options(mount="pocket")), gnss=gnss), "pocket")
        return found, interpolate_columns(t, found.t, found.position[:, :2])

    def by_sensor() -> Figures:
        found, walked = solve(None)
        turn, shift = find_turn(walked[first], FixColumns(t[first], place[first], sigma[first]))
        north = walked @ yaw_rotation(np.radians(-DECLINATION_DEG))[:2, :2].T
        return {
            "metres": found.metrics.distance_m / float(np.linalg.norm(np.diff(place[::5], axis=0), axis=1).sum()),
            "rigid (m)": distance(walked @ yaw_rotation(turn)[:2, :2].T + shift, ~first),
            "north (m)": distance(north + np.median((place - north)[first], axis=0), ~first),
        }

    def by_fixes() -> Figures:
        figures = dict[str, float]()
        for name, used in (("first (m)", first), ("held (m)", half), ("30 s (m)", minute)):
            found, fused = solve(replace(gnss, fixes=tuple(fix for fix, use in zip(kept, used, strict=True) if use)))
            start: Any = found.parameters["gnss_start"]  # in the axes of the fixes
            origin = gnss.latitude_deg, gnss.longitude_deg, 0.0
            shift = geodetic2enu(start["latitude_deg"], start["longitude_deg"], 0.0, *origin)[:2]
            figures[name] = distance(fused + np.array(shift), ~used)
        return figures

    return {"sensor": by_sensor, "with fixes": by_fixes}


EXPERIMENTS: Mapping[str, Experiment] = {
    "two-feet": Experiment(
        """Two feet in one graph beside each alone, simulated: errors of the footfalls, and whether the claims are true.

        Position after the best yaw and shift, heading less its mean; NEES of positions relative to the start, 1 where
        the claims are true; turn of the whole walk over the heading's sigma, rms. Errors of two sensors that are
        independent and of one size leave 0.71 of it in the mean of both; by walk the mean of two errors is 1.36 times
        the smaller one (median), as nothing shows which foot's that is.""",
        lambda chosen: list_seeds(
            chosen,
            {
                f"{name}, {words} magnetometer": partial(measure_pair, name, words == "with")
                for name in chosen.scenarios
                for words in ("without", "with")
            },
        ),
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
        ),
        [
            *(Asked(f"{side} (m)", "worst", high=0.03, section="feet_vicon") for side in SIDES),
            *(Asked(f"{side} (m)", "mean", high=0.20, section="feet_thighs, closed") for side in SIDES),
        ],
    ),
    "pocket-bias": Experiment(
        """How fast a gyro bias is found in a trouser pocket, and how far off the heading is after 39 minutes
        (simulated).

        The 3 km of `pocket-street` with the errors of Table 2 of Munoz Diaz et al. (2017), biases of 0.1 deg/s not
        given, in the fields of their Table 1; `street`: lamps and parked cars in every block; `past-cars`: as in their
        Figures 7b and 10. Error of the z bias after so many seconds, deg/s; found: from when on it stays within 0.02
        deg/s for good.""",
        lambda chosen: list_seeds(chosen, {name: partial(find_bias, name) for name in FIELDS}),
        (
            *(Column(f"{s} s", f"{s} s", "median / p95", "{:.4f}") for s in AFTER_S),
            Column("found (s)", "found (s)", pattern="{:.0f}"),
            Column("yaw (deg)", "yaw (deg)", pattern="{:.2f}"),
            Column("NEES of 3", "NEES of 3", "mean", "{:.1f}"),
        ),
        [
            Asked(figure, "median", high=high, section=name, variant=variant)
            for name, found, yaw in (("equator", 60, 3), ("munich", 60, 3), ("street", 300, 6), ("past-cars", 300, 6))
            for figure, high, variants in (("found (s)", found, ["online"]), ("yaw (deg)", yaw, ["online", "batch"]))
            for variant in variants
        ],
        seeds=20,
    ),
    "real-pockets": Experiment(
        """Phones in real trouser pockets beside GNSS: how far, which way, how near.

        Metres over the way along the fixes. Mean distances, m, to the fixes of
        the last 90 %: the path laid on those of the first 10 % (rigid), the same by the compass and a shift (north),
        those fixes given (first); to every second fix, or second half minute, the others given (held, 30 s).""",
        list_pockets,
        tuple(
            Column(name, name, "median / worst", "{:.2f}")
            for name in ("metres", "rigid (m)", "north (m)", "first (m)", "held (m)", "30 s (m)")
        ),
    ),
}
