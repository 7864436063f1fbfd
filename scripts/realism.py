"""Whether the simulated foot and its field are as real ones, in fifteen facts that an estimator feels.

    python scripts/realism.py [--data DIR] [--seeds N]

Real: the ten gdin walks, indoors, 35 to 150 m, a LORD GX5 on the instep; the true speed is that of the Vicon trials of
walking. Simulated: straight lines and right-angled corners, as long, the same sensor of unlimited range, by persons and
mounts drawn about the default, in the field `indoor`. Stances and attitude come from the same detector and smoother for
all. A row is the median (least to most) over walks; `inside` where the simulated median lies within the real range.
Persons and floors were set with this table in view: it is a fit, not a validation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import TypeAlias

import harness
import numpy as np
import walks
from harness import FIRST_SEED

from fg_nav.arrays import interpolate_columns
from fg_nav.detection import detect_stances
from fg_nav.detection.rest import estimate_lever
from fg_nav.detection.stance import shoe
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.io import read
from fg_nav.lab.simulation import Scenario, simulate
from fg_nav.lab.simulation.path import polyline
from fg_nav.lab.simulation.plan import Section, Stand, Walk
from fg_nav.lab.simulation.sensors import preset
from fg_nav.pipeline import prepare_walk
from fg_nav.recording import Recording
from fg_nav.smoother import smooth
from fg_nav.truth import TrajectoryTruth
from fg_nav.walk import Options, read_walk

Facts: TypeAlias = Mapping[str, float]

OUTSIDE: Mapping[str, str] = {
    "stride time (s)": "the default is that of Ma et al., 5 km/h",
    "share of detected stance": "who walks faster stands for less of a stride",
}
"""Why a fact lies outside."""


STRIDE_S, MIN_M = (0.6, 1.8), 0.8  # of a stride of walking
STRAIGHT_DEG = 20.0  # yaw rates are of strides that turn by less
MID_STANCE_S = 0.1  # on either side of the stillest instant, where the velocity in stance is looked at
VICON_DAY, FEWEST = "2017-11-22", 8  # a day of walking; a trial with fewer strides shows none
COURSE_M = ((0.0, 0.0), (0.0, 25.0), (12.0, 25.0), (12.0, 5.0), (22.0, 5.0), (22.0, 30.0))
SPEED = "true speed at the stillest instant (mm/s)"


def compare_feet(data: Path, seeds: Sequence[int]) -> tuple[list[Facts], list[Facts]]:
    """Facts of real feet, and of those simulated on walks of their kind, with the sensor of their recordings."""
    real = [measure_foot(read(one.path)) for one in walks.list_set(data, walks.GDIN)]
    trials = [one for one in walks.list_set(data, "vicon") if one.name.startswith(VICON_DAY)]
    captured = [measure_foot(read(one.path)) for one in trials]
    real += [{SPEED: facts[SPEED]} for facts in captured if SPEED in facts]
    course: list[Section] = [Stand(1.5), Walk(polyline(np.array(COURSE_M), 0.8)), Stand(1.5)]
    sensor = preset("lord-gx5")
    sensor = replace(sensor, gyr=replace(sensor.gyr, limit=np.inf))  # at the default pace it saturates
    walked = Scenario("realism", "", lambda _: course, "instep", sensor, field="indoor")
    return real, [measure_foot(simulate(walked, seed).recording) for seed in seeds]


def measure_foot(recording: Recording) -> Facts:
    """Facts of a walk: medians over its strides, each from the stillest instant of a footfall to that of the next."""
    recording, mag = prepare_walk(read_walk(recording, Options(use_magnetometer=False))).recording, recording.mag
    stances = detect_stances(recording)
    solution, still, h = smooth(recording, stances), stances.stillest(recording.gyr), recording.period_s
    position, nav_R_body = solution.position, solution.nav_R_body
    strides = [
        (i, j)
        for i, j in pairwise(still)
        if STRIDE_S[0] < h * (j - i) < STRIDE_S[1] and np.linalg.norm(position[j] - position[i]) > MIN_M
    ]
    if len(strides) < FEWEST:
        return {}
    # Axes of the foot: up as the force in stance, left as the principal axis of the rate, forward ahead.
    rate = recording.gyr - solution.stances.gyro_bias.mean(axis=0)
    up = recording.acc[stances.mask].mean(axis=0)
    up /= np.linalg.norm(up)
    principal = np.linalg.eigh(rate.T @ rate)[1][:, -1]
    left = principal - (principal @ up) * up
    left *= np.sign(np.cross(left, up) @ np.einsum("nji,nj->i", nav_R_body, solution.velocity)) / np.linalg.norm(left)
    roll, pitch, yaw = (np.degrees(rate @ axis) for axis in (np.cross(left, up), left, up))
    straight_on = [(i, j) for i, j in strides if abs(yaw[i:j].sum()) * h < STRAIGHT_DEG]
    # The standing foot: its rate, its statistic, and its velocity against that at the stillest instant.
    feet, reach = np.array([i for i, _ in strides[1:]]), round(MID_STANCE_S / h)
    near = feet[:, None] + np.arange(-reach, reach + 1)
    force = np.einsum("knij,knj->kni", nav_R_body[near], recording.acc[near]) - [0.0, 0.0, GRAVITY_M_S2]
    velocity = np.cumsum(force, axis=1) * h
    velocity -= velocity[:, [reach]]
    facts = {
        "stride time (s)": np.median([h * (j - i) for i, j in strides]),
        "stride length (m)": np.median([np.linalg.norm(position[j] - position[i]) for i, j in strides]),
        "share of detected stance": stances.mask[still[0] : still[-1]].mean(),
        "peak rate, pitch (deg/s)": np.median([pitch[i:j].max() for i, j in strides]),
        "peak rate, roll (deg/s)": np.median([np.abs(roll[i:j]).max() for i, j in strides]),
        "peak rate, yaw, straight on (deg/s)": np.median([np.abs(yaw[i:j]).max() for i, j in straight_on or strides]),
        "peak force (m/s^2)": np.median([np.linalg.norm(recording.acc[i:j], axis=1).max() for i, j in strides]),
        "rate at the stillest instant (deg/s)": np.median(np.degrees(np.linalg.norm(rate[feet], axis=1))),
        "SHOE there (decades)": np.median(np.log10(shoe(recording.acc, recording.gyr, round(0.05 / h)))[feet]),
        "change of velocity in 0.1 s about it (mm/s)": np.median(1e3 * np.sqrt((velocity**2).sum(axis=2).mean(axis=1))),
        "sensor above the rolling point (cm)": 100.0 * estimate_lever(recording, stances).lever @ up,
    }
    if isinstance(recording.truth, TrajectoryTruth):
        place = interpolate_columns(recording.t, recording.truth.t, recording.truth.position)
        slope = np.arange(4, -5, -1) / (h * 60.0)  # of a line through nine positions: motion capture trembles by 0.1 mm
        true = np.stack([np.convolve(axis, slope, mode="same") for axis in place.T], axis=1)
        facts[SPEED] = 1e3 * np.median(np.linalg.norm(true[feet], axis=1))
    if mag is not None:
        felt = np.einsum("kij,kj->ki", nav_R_body[feet], mag[feet])
        felt = felt[np.isfinite(felt).all(axis=1)]
        resultant = np.abs(np.mean(np.exp(1j * np.arctan2(felt[:, 0], felt[:, 1]))))
        facts["strength of the field, sd (uT)"] = np.linalg.norm(felt, axis=1).std()
        facts["change from footfall to footfall (uT)"] = np.median(np.linalg.norm(np.diff(felt, axis=0), axis=1))
        facts["compass minus heading, circular sd (deg)"] = np.degrees(np.sqrt(-2 * np.log(resultant)))
    return {name: float(value) for name, value in facts.items()}


def judge_facts(real: Sequence[Facts], ours: Sequence[Facts]) -> list[list[str]]:
    """Return a row a fact: real and simulated, whether the median lies inside, and why not."""
    rows = []
    for name in ours[0]:
        values = [[f for facts in some if np.isfinite(f := facts.get(name, np.nan))] for some in (real, ours)]
        mark = "inside" if min(values[0]) <= np.median(values[1]) <= max(values[0]) else "outside"
        why = OUTSIDE.get(name, "") if mark == "outside" else ""
        rows.append([name, *(harness.spread(some, ends=(0.0, 100.0)) for some in values), mark, why])
    return rows


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    chosen = harness.parse_arguments(__doc__, arguments, data=None, seeds=5, first=FIRST_SEED)
    facts = compare_feet(walks.data_folder(chosen.data), harness.seeds_of(chosen))
    harness.print_table(("fact", "real", "simulated", "", ""), judge_facts(*facts))


if __name__ == "__main__":
    harness.run(main)
