"""Whether the simulated foot, field and thigh are as real ones, in what an estimator feels of them.

    python scripts/realism.py foot|floors|thigh [--data DIR] [--seeds N]

foot     Real: the ten gdin walks, indoors, 35 to 150 m, a LORD GX5 on the instep; the true speed is that of the Vicon
         trials of walking. Simulated: straight lines and right-angled corners, as long, the same sensor of unlimited
         range, by persons and mounts drawn about the default. Stances and attitude come from the same detector and
         smoother for all; the field is `indoor`.
floors   Real: 18 walks on one floor of a building each, the magnetometer corrected by the walk itself. Simulated: the
         same paths, each in so many buildings of `indoor`.
thigh    Real: both thighs of the one subject of `qmt_fullbody` in 40 s of walking, at 100 Hz. Simulated: 300 m straight
         ahead with the default pocket, without noise. A stride begins where the foot begins to push off.

A row is the median [least, most] over walks, or over strides its 5 and 95 %; `inside` where the simulated median lies
within the real range. Persons, floors and pocket were set with these tables in view: they are a fit, not a validation.
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
from harness import FIRST_SEED, option
from scipy.io import loadmat
from scipy.signal import butter, filtfilt, find_peaks
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Floats, Ints
from fg_nav.detection import detect_stances
from fg_nav.detection.rest import estimate_lever
from fg_nav.detection.stance import shoe
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.io import read
from fg_nav.lab.simulation import Person, Scenario, simulate
from fg_nav.lab.simulation.fields import SITES, draw_environment
from fg_nav.lab.simulation.path import polyline, straight
from fg_nav.lab.simulation.plan import Section, Stand, Walk, plan
from fg_nav.lab.simulation.sensors import preset
from fg_nav.lab.simulation.thigh import Pocket, build_thigh_motion
from fg_nav.pipeline import prepare_walk, run_method
from fg_nav.recording import Recording
from fg_nav.smoother import smooth
from fg_nav.truth import TrajectoryTruth
from fg_nav.walk import Options, read_walk

Facts: TypeAlias = Mapping[str, float]

OUTSIDE: Mapping[str, str] = {
    "stride time (s)": "the default is that of Ma et al., 5 km/h",
    "share of detected stance": "who walks faster stands for less of a stride",
    "peak rate across (deg/s)": "a strap adds motion: a guess, not tested",
    "rate along the bone, rms (deg/s)": "a strap adds motion: a guess, not tested",
}
"""Why a fact lies outside."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    what = option(None, "what to compare", choices=("foot", "floors", "thigh"), positional=True)
    chosen = harness.parse_arguments(__doc__, arguments, what=what, data=None, seeds=5)
    measure = {"foot": compare_feet, "floors": compare_floors, "thigh": compare_thighs}[chosen.what]
    real, ours = measure(walks.data_folder(chosen.data), range(FIRST_SEED, FIRST_SEED + chosen.seeds))
    ends = (5.0, 95.0) if chosen.what == "thigh" else (0.0, 100.0)
    harness.print_table(("fact", "real", "simulated", "", ""), judge_facts(real, ours, ends))


def judge_facts(real: Sequence[Facts], ours: Sequence[Facts], ends: tuple[float, float]) -> list[list[str]]:
    """Return a row a fact: real and simulated, whether the median lies inside, and why not."""
    rows = []
    for name in ours[0]:
        values = [[f for facts in some if np.isfinite(f := facts.get(name, np.nan))] for some in (real, ours)]
        (low, _, high), (_, middle, _) = (np.percentile(some, [ends[0], 50.0, ends[1]]) for some in values)
        mark = "inside" if low <= middle <= high else "outside"
        rows.append([name, *(harness.spread(some, ends=ends) for some in values), mark])
        rows[-1].append(OUTSIDE.get(name, "") if mark == "outside" else "")
    return rows


# --- foot ------------------------------------------------------------------------------------------------------------

STRIDE_S, MIN_M, STRAIGHT_DEG = (
    (0.6, 1.8),
    0.8,
    20.0,
)  # of a stride of walking; yaw rates are of those that turn by less
MID_STANCE_S = 0.1  # on either side of the stillest instant, where the velocity in stance is looked at
VICON_DAY, FEWEST = "2017-11-22", 8  # a day of walking; a trial with fewer strides shows none
COURSE_M = ((0.0, 0.0), (0.0, 25.0), (12.0, 25.0), (12.0, 5.0), (22.0, 5.0), (22.0, 30.0))
SPEED = "true speed at the stillest instant (mm/s)"


def compare_feet(data: Path, seeds: Sequence[int]) -> tuple[list[Facts], list[Facts]]:
    """Facts of real and simulated feet."""
    real = [measure_foot(read(walks.gdin_path(data, number))) for number in walks.GDIN_WALKS]
    captured = [measure_foot(read(path)) for path in sorted((data / "vicon").glob(f"{VICON_DAY}*.mat"))]
    real = [{key: value for key, value in facts.items() if key != SPEED} for facts in real]
    real += [{SPEED: facts[SPEED]} for facts in captured if SPEED in facts]
    return real, [measure_foot(simulate_walk(seed)) for seed in seeds]


def simulate_walk(seed: int) -> Recording:
    """Simulate a walk of the kind of the real ones, on the sensor with which they were recorded."""
    course: list[Section] = [Stand(1.5), Walk(polyline(np.array(COURSE_M), 0.8)), Stand(1.5)]
    sensor = preset("lord-gx5")
    sensor = replace(sensor, gyr=replace(sensor.gyr, limit=np.inf))  # at the default pace it saturates
    return simulate(Scenario("realism", "", lambda _: course, "instep", sensor, field="indoor"), seed).recording


def measure_foot(recording: Recording) -> Facts:
    """Facts of a walk: medians over its strides, each from the stillest instant of a footfall to that of the next."""
    recording, mag = prepare_walk(read_walk(recording, Options(use_magnetometer=False))).recording, recording.mag
    stances = detect_stances(recording)
    solution, still, h = smooth(recording, stances), stances.stillest(recording.gyr), recording.period_s
    position, nav_R_body = solution.position, solution.nav_R_body
    long = [
        STRIDE_S[0] < h * (j - i) < STRIDE_S[1] and np.linalg.norm(position[j] - position[i]) > MIN_M
        for i, j in pairwise(still)
    ]
    strides = [stride for stride, kept in zip(pairwise(still), long, strict=True) if kept]
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
        t = recording.t
        place = np.stack([np.interp(t, recording.truth.t, axis) for axis in recording.truth.position.T], axis=1)
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


# --- floors ----------------------------------------------------------------------------------------------------------

FLOORS = (
    *(f"gdin/own/SensorConnectData_{n}.csv" for n in (31, 33, 36, 40)),
    *(f"gdin/own_obsolete/SensorConnectData_{n}.csv" for n in (15, 18, 20, 22, 24, 29)),
    *(f"openshoe/data_inert{n}.txt" for n in (1, 7, 13)),
    *("mtig710/2022_1_14_hallway_walk3.csv.gz", "mtig710/2022_1_13_straight_walk_foot1.csv.gz"),
    *(f"mems_foot/lap_360m_{n}.csv.gz" for n in (1, 2, 3)),
)
SENSOR_M = 0.1  # height of a standing foot's sensor


def compare_floors(data: Path, seeds: Sequence[int]) -> tuple[list[Facts], list[Facts]]:
    """Facts of real floors, and of simulated ones about the very same paths."""
    real, ours = list[Facts](), list[Facts]()
    for name in FLOORS:
        walk = prepare_walk(read_walk(data / name, Options()))
        solution, mag = run_method(walk, "smoother").solution, walk.recording.mag
        assert mag is not None
        known = np.flatnonzero(np.isfinite(mag).all(axis=1))
        feet = np.unique(np.searchsorted(known, walk.stances.stillest(walk.recording.gyr)).clip(max=len(known) - 1))
        place = solution.position[known]
        real.append(measure_floor(place, np.einsum("nij,nj->ni", solution.nav_R_body[known], mag[known]), feet))
        lifted = place[:, 2] - np.interp(np.arange(len(known)), feet, place[feet, 2])
        path = np.column_stack([place[:, :2], SENSOR_M + np.maximum(lifted, 0.0)])
        for seed in seeds:
            field = draw_environment("indoor", SITES["munich"], path[feet] * [1, 1, 0], np.random.default_rng(seed))
            ours.append(measure_floor(path, field.at(path), feet))
    return real, ours


def measure_floor(position: Floats, nav_field: Floats, feet: Ints) -> Facts:
    """Facts of the field (N, 3) along a path (N, 3) m, deviations from its mean; footfalls where the foot moved on."""
    moved = np.linalg.norm(np.diff(position[feet, :2], axis=0, prepend=np.inf), axis=1) > 0.5
    feet = feet[moved]
    felt = nav_field[feet, :2] - nav_field[feet, :2].mean(axis=0)
    step, middle = np.diff(position, axis=0), (nav_field[1:] + nav_field[:-1]) / 2
    length = np.linalg.norm(step[:, :2], axis=1, keepdims=True)
    sums = np.hstack([middle[:, :2] * length, length, np.sum(middle * step, axis=1, keepdims=True)])
    at = np.vstack([np.zeros(4), np.cumsum(sums, axis=0)])[feet]
    mean = np.diff(at[:, :2], axis=0) / np.diff(at[:, 2:3], axis=0)
    homogeneous = np.column_stack([position[feet], np.ones(len(feet))])
    potential = at[:, 3] - homogeneous @ np.linalg.lstsq(homogeneous, at[:, 3], rcond=None)[0]
    sd = float(np.sqrt(np.mean(felt**2)))
    return {
        "sd per axis over ground (uT)": sd,
        "sd of the vertical (uT)": float(nav_field[feet, 2].std()),
        "correlation, 1 stride apart": float(np.mean(felt[1:] * felt[:-1]) / sd**2),
        "sd of the mean along a stride / at the footfalls": float(
            np.sqrt(np.mean((mean - mean.mean(axis=0)) ** 2)) / sd
        ),
        "sd of the potential / of the field (m)": float(potential.std() / sd),
    }


# --- thigh -----------------------------------------------------------------------------------------------------------

RATE_HZ, SITTING_S, WALKING_S, THIGH_STRIDE_S = 100.0, (60.0, 70.0), (97.0, 138.0), (0.8, 1.1)


def compare_thighs(data: Path, seeds: Sequence[int]) -> tuple[list[Facts], list[Facts]]:
    """Facts of each stride of both real thighs, and of a simulated one: flexion, rates and force of the thigh."""
    path = data / "qmt_fullbody" / "full_body_example_data.mat"
    body, real = loadmat(path, squeeze_me=True, struct_as_record=False), list[Facts]()
    inside, sitting = ((body["t"] > a) & (body["t"] < b) for a, b in (WALKING_S, SITTING_S))
    for side in ("left", "right"):
        leg, foot = body[f"upper_leg_{side}"], body[f"foot_{side}"].gyr[inside]
        forward = np.sign(leg.acc[sitting, 1].mean())  # the thigh of one who sits points forward
        # Up: the force, slow in the frame that the gyroscope carries on (as VQF does); x is up the bone, z across.
        steps = Rotation.from_rotvec(leg.gyr / RATE_HZ)
        attitude = [Rotation.identity()]
        for step in steps[:-1]:
            attitude.append(attitude[-1] * step)
        still_R_body = Rotation.concatenate(attitude)
        up = still_R_body.inv().apply(low_pass(still_R_body.apply(leg.acc), 0.1))[inside]
        # A foot pushes off where its rate passes 60 deg/s before the peak.
        across = low_pass(foot[:, 1], 12.0)
        peaks, _ = find_peaks(
            -across if -across.min() > across.max() else across, height=np.radians(400.0), distance=60
        )
        calm = np.flatnonzero(np.linalg.norm(foot, axis=1) < np.radians(60.0))
        flexion = np.degrees(np.arctan2(forward * up[:, 1], up[:, 0]))
        real += measure_thigh(
            flexion, leg.gyr[inside][:, [2, 0]], leg.acc[inside], calm[np.searchsorted(calm, peaks) - 1]
        )
    rng = np.random.default_rng(seeds[0])
    strides = plan([Stand(2.0), Walk(straight(300.0)), Stand(2.0)], Person(), rng)
    motion, t = build_thigh_motion(strides, Pocket(), rng), np.arange(0.0, strides.end_s, 1 / RATE_HZ)
    rate, force = motion.sampled(t, 1 / RATE_HZ)
    up = motion.at(t).nav_R_body[:, 2] @ motion.thigh_R_body.T
    flexion, rate = np.degrees(np.arctan2(up[:, 0], up[:, 2])), rate @ motion.thigh_R_body.T
    return real, measure_thigh(flexion, rate[:, 1:], force, np.searchsorted(t, strides.start[2:-2]))


def measure_thigh(flexion: Floats, rate: Floats, force: Floats, push_off: Ints) -> list[Facts]:
    """Facts of each stride: of the flexion (N,) deg, rates (N, 2) rad/s across and along the bone, force (N, 3)."""
    rate, size, found = np.degrees(rate), np.linalg.norm(force, axis=1), list[Facts]()
    for i, j in pairwise(push_off):
        if THIGH_STRIDE_S[0] < (j - i) / RATE_HZ < THIGH_STRIDE_S[1]:
            found.append(
                {
                    "stride (s)": (j - i) / RATE_HZ,
                    "swing of flexion (deg)": float(np.ptp(flexion[i:j])),
                    "peak rate across (deg/s)": float(np.abs(rate[i:j, 0]).max()),
                    "rate across, rms (deg/s)": float(np.sqrt(np.mean(rate[i:j, 0] ** 2))),
                    "rate along the bone, rms (deg/s)": float(np.sqrt(np.mean(rate[i:j, 1] ** 2))),
                    "least force (m/s^2)": float(size[i:j].min()),
                    "peak force (m/s^2)": float(size[i:j].max()),
                }
            )
    return found


def low_pass(values: Floats, below_hz: float) -> Floats:
    """Keep what is slower."""
    return np.asarray(filtfilt(*butter(2, below_hz, fs=RATE_HZ), values, axis=0))


if __name__ == "__main__":
    harness.run(main)
