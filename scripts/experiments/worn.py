"""Sensors on both feet and in a trouser pocket: two feet in one graph, how fast a gyro bias is found, and real phones.

Of two feet all methods have the same stances, and of simulated walks the true heading of each foot at its start. What
was tuned was tuned on seeds 1 to 8.
"""

from __future__ import annotations

import math
from argparse import Namespace
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import walks
from pymap3d import geodetic2enu

from experiments import Asked, Column, Experiment, Figures, Found, Task, find_truth, give_heading, list_seeds
from fg_nav import pocket
from fg_nav.arrays import Bools, Floats, interpolate_columns
from fg_nav.detection import detect_stances
from fg_nav.evaluation.comparison import align, yaw_between
from fg_nav.frames import yaw_rotation
from fg_nav.io import Reading, read, read_gnss
from fg_nav.lab.follow_pocket import follow_pocket
from fg_nav.lab.reproduce.munoz_diaz2017.walks import FIELDS_UT, replace_field
from fg_nav.lab.simulation import Choices, simulate, simulate_feet
from fg_nav.lab.simulation.fields import Field, Homogeneous, street
from fg_nav.magnetic import average_footfall_field
from fg_nav.pipeline import Result, navigate, prepare_walk, run_method
from fg_nav.recording import Recording
from fg_nav.smoother import smooth
from fg_nav.smoother.batch import WalkInput
from fg_nav.smoother.feet import smooth_feet
from fg_nav.solution import Solution
from fg_nav.truth import FixColumns, Gnss, find_turn
from fg_nav.walk import Options, Walk, read_walk

# --- two feet --------------------------------------------------------------------------------------------------------

SIDES = ("left", "right")


def measure_pair(name: str, with_mag: bool, seed: int) -> Found:
    """Smooth both feet of a simulated walk, whose true heading at the start is known, alone and together."""
    walk, feet, places = simulate_feet(name, seed), dict[str, WalkInput](), dict[str, Floats]()
    for side in SIDES:
        recording = getattr(walk, side).recording
        stances, heading = detect_stances(recording), give_heading(recording).heading_rad
        field = average_footfall_field(recording, stances) if with_mag else None
        feet[side] = WalkInput(recording, stances, heading, field)
        places[side] = find_truth(recording)[0].position
    return measure_feet(feet, places)


def list_worn(chosen: Namespace) -> list[Task]:
    """Real pairs of feet and real pockets: sections of the table of all real sets."""
    data = walks.data_folder(chosen.data)
    sets = (
        ("two feet, captured", measure_captured, "two_feet/zupt_fgo"),
        ("two feet", measure_closed, "feet_thighs/[rc]*_LF.csv.gz"),
        ("pocket", measure_pocket, "pocket_gnss/*.zip"),
    )
    return [Task(section, path.name.partition(".")[0], partial(measure, path))
            for section, measure, files in sets for path in sorted(data.glob(files))]  # fmt: skip


def measure_captured(folder: Path) -> Found:
    """Smooth both motion-captured feet; the truth is left-handed. Rms of both feet, m."""
    captured, feet, places = np.genfromtxt(folder / "positionGt.csv", delimiter=",", skip_header=1), {}, {}
    for k, side in enumerate(SIDES):
        rows = np.genfromtxt(folder / f"imuMeas{side.capitalize()}.csv", delimiter=",", skip_header=1)
        recording = Recording(rows[:, 0] / 60.0, rows[:, 1:4], rows[:, 4:7])
        feet[side] = WalkInput(recording, detect_stances(recording))
        places[side] = captured[:, 1 + 3 * k : 4 + 3 * k] * [1.0, -1.0, 1.0]
    found = measure_feet(feet, places)
    return {how: {"rmse_2d_m": float(np.sqrt(np.mean(np.square(list(of.values())))))} for how, of in found.items()}


def measure_closed(left: Path) -> Found:
    """Smooth both feet of a walk that ends where it began: distance from start to end, mean of both, m."""
    paths = {"left": left, "right": left.with_name(left.name.replace("_LF", "_RF"))}
    feet = {side: prepare_walk(read_walk(Reading().read(path), Options())) for side, path in paths.items()}
    inputs = {side: WalkInput(walk.recording, walk.stances, 0.0, walk.field) for side, walk in feet.items()}

    def measure(solutions: Iterable[Solution]) -> Figures:
        ends = [solution.stances.position[-1] - solution.stances.position[0] for solution in solutions]
        return {"ground_m": float(np.mean([np.hypot(*end[:2]) for end in ends]))}

    def together() -> Figures:
        both = smooth_feet(inputs["right"], inputs["left"])
        return measure(getattr(both, side) for side in SIDES)

    return {"alone": lambda: measure(run_method(walk, "smoother").solution for walk in feet.values()),
            "together": together}  # fmt: skip


def measure_feet(feet: Mapping[str, WalkInput], places: Mapping[str, Floats]) -> Mapping[str, dict[str, float]]:
    """Rms over the ground, m, after the best yaw and shift, of each foot alone and both together."""
    both, found = smooth_feet(feet["right"], feet["left"]), dict[str, dict[str, float]](alone={}, together={})
    for side, foot in feet.items():
        alone = smooth(foot.recording, foot.stances, heading=foot.heading, field=foot.field)
        for how, solution in (("alone", alone), ("together", getattr(both, side))):
            seen = np.isfinite(places[side]).all(axis=1)
            path, place = solution.position[seen], places[side][seen]
            off = align(path, place, "yaw").apply(path) - place
            found[how][f"{side} (m)"] = float(np.sqrt(np.mean(np.sum(off[:, :2] ** 2, axis=1))))
    return found


# --- gyro bias -------------------------------------------------------------------------------------------------------

WITHIN_DEG_S, STREET_M, NOISE_UT = 0.02, 500.0, 0.5  # the noise is that of a sample
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
        return {"found (s)": since if since < len(z) else math.inf, "yaw (deg)": yaw}

    return {method: partial(judge, run) for method, run in methods.items()}


# --- real pockets ----------------------------------------------------------------------------------------------------

MAX_ACCURACY_M = 15.0  # of a fix


def measure_pocket(path: Path) -> Found:
    """Distance of a phone's path from fixes that it was not given, m."""
    recording, everything = read(path), read_gnss(path)
    kept = tuple(fix for fix in everything.fixes if fix.horizontal_sigma_m < MAX_ACCURACY_M)
    gnss, t = replace(everything, fixes=kept), np.array([fix.time_s for fix in kept])
    place, sigma = np.array([fix.position[:2] for fix in kept]), np.array([fix.horizontal_sigma_m for fix in kept])
    first, half = t < t[0] + 0.1 * (t[-1] - t[0]), np.arange(len(t)) % 2 == 0

    def solve(given: Gnss | None) -> tuple[Result, Floats]:
        found = navigate(replace(Walk.of(recording, Options(mount="pocket")), gnss=given), "pocket")
        return found, interpolate_columns(t, found.t, found.position[:, :2])

    def distance(path: Floats, where: Bools) -> float:
        return float(np.linalg.norm(path - place, axis=1)[where].mean())

    def by_sensor() -> Figures:
        _, walked = solve(None)
        turn, shift = find_turn(walked[first], FixColumns(t[first], place[first], sigma[first]))
        return {"gnss_m": distance(walked @ yaw_rotation(turn)[:2, :2].T + shift, ~first)}

    def by_fixes() -> Figures:
        found, fused = solve(replace(gnss, fixes=kept[::2]))
        start: Any = found.parameters["gnss_start"]  # in the axes of the fixes
        origin = gnss.latitude_deg, gnss.longitude_deg, 0.0
        shift = geodetic2enu(start["latitude_deg"], start["longitude_deg"], 0.0, *origin)[:2]
        return {"gnss_m": distance(fused + np.array(shift), ~half)}

    return {"sensor": by_sensor, "with fixes": by_fixes}


EXPERIMENTS: Mapping[str, Experiment] = {
    "two-feet": Experiment(
        """Two feet in one graph beside each alone, simulated.

        Position after the best yaw and shift, rms. Errors of two sensors that are independent and of one size leave
        0.71 of it in both; by walk the mean of two errors is 1.36 times the smaller one (median), as nothing shows
        which foot's that is.""",
        lambda chosen: list_seeds(
            chosen,
            {
                f"{name}, {words} magnetometer": partial(measure_pair, name, words == "with")
                for name in chosen.scenarios
                for words in ("without", "with")
            },
        ),
        [Column(f"{side} (m)", f"{side} (m)", "rms") for side in SIDES],
        seeds=20,
        options={"scenarios": ["office", "mall", "teaching-building"]},
    ),
    "pocket-bias": Experiment(
        """How fast a gyro bias is found in a trouser pocket, and how far off the heading is after 39 minutes
        (simulated).

        The 3 km of `pocket-street` with the errors of Table 2 of Munoz Diaz et al. (2017), biases of 0.1 deg/s not
        given, in the fields of their Table 1; `street`: lamps and parked cars in every block; `past-cars`: as in their
        Figures 7b and 10. Found: from when on the error of the z bias stays within 0.02 deg/s for good.""",
        lambda chosen: list_seeds(chosen, {name: partial(find_bias, name) for name in FIELDS}),
        (Column("found (s)", "found (s)", pattern="{:.0f}"), Column("yaw (deg)", "yaw (deg)", pattern="{:.2f}")),
        [
            Asked(figure, "median", high=high, section=name, variant=variant)
            for name, found, yaw in (("equator", 60, 3), ("munich", 60, 3), ("street", 300, 6), ("past-cars", 300, 6))
            for figure, high, variants in (("found (s)", found, ["online"]), ("yaw (deg)", yaw, ["online", "batch"]))
            for variant in variants
        ],
        seeds=20,
    ),
}
