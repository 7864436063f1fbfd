"""Real pockets and thighs: which run, how far, which way, and how near to GNSS.

    python scripts/real_pockets.py [--data DIR] [--json FILE]

`pocket_gnss`, phones in trouser pockets outdoors: fixes better than 15 m; the declination there is -6 deg.

======== ==============================================================================================================
metres   walked, over the way along the fixes 5 s apart
heading  at the start by the compass: course of the path less that of the fixes, over the first 30 s of walking
rigid    mean distance to the fixes of the last 90 % of the time, the path laid on those of the first 10 % by turn and
         shift (no scale), of Cauchy's errors by their accuracies; no fix is in the estimate
north    the same with the compass's turn and the declination: the first 10 % give the shift alone
first    the same, the fixes of the first 10 % given to the estimate (`--gnss`), the path as it comes
others   published for these files, given the first 10 %
held     mean distance to every second fix, the others given
30 s     the same to the fixes of every second half minute, the others given
======== ==============================================================================================================

Thighs, by the default step constant: metres over the mean of both feet by our smoother, or over the true path, from the
first stride of the thigh to the last.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import harness
import numpy as np
import walks
from scipy.io import loadmat

from fg_nav.arrays import Bools, Floats
from fg_nav.detection import detect_stances
from fg_nav.errors import FgNavError
from fg_nav.frames import yaw_rotation
from fg_nav.io import read, read_gnss, read_truth
from fg_nav.pipeline import Result, navigate
from fg_nav.recording import Recording
from fg_nav.smoother import smooth
from fg_nav.truth import FixColumns, Gnss, TrajectoryTruth, find_turn
from fg_nav.walk import Options, Walk

MAX_ACCURACY_M = 15.0
DECLINATION_DEG = -6.0
START_S, COURSE_S, WALKING_M_S = 30.0, 4.0, 0.7
OTHERS_M = {
    "pace_01_002": 46.7, "pace_01_004": 50.0, "walk_03_003": 79.6, "walk_03_005": 11.0,
    "walk_03_007": 52.2, "walk_03_009": 90.7, "walk_09_001": 62.5,
}  # fmt: skip
QMT_S = (40.0, 140.0)
POCKET = Options(mount="pocket")


def solve(recording: Recording, gnss: Gnss | None, at: Floats) -> tuple[Floats, float]:
    """Places (K, 2) m at times (K,) s, and the metres walked."""
    walk = replace(Walk.of(recording, POCKET), gnss=gnss)
    found = navigate(walk, "pocket")
    place = np.stack([np.interp(at, found.t, axis) for axis in found.position[:, :2].T], axis=1)
    return place, found.metrics.distance_m


def measure_pocket(path: Path) -> dict[str, float]:
    """Figures of one phone."""
    recording, all_fixes = read(path), read_gnss(path)
    kept = tuple(fix for fix in all_fixes.fixes if fix.horizontal_sigma_m < MAX_ACCURACY_M)
    gnss = replace(all_fixes, fixes=kept)
    t = np.array([fix.time_s for fix in kept])
    place = np.array([fix.position[:2] for fix in kept])
    fixes = FixColumns(t, place, np.array([fix.horizontal_sigma_m for fix in kept]))
    first = t < t[0] + 0.1 * (t[-1] - t[0])
    # by the sensor alone
    walked, metres = solve(recording, None, t)
    given = FixColumns(t[first], place[first], fixes.sigma[first])
    turn, shift = find_turn(walked[first], given)
    north = walked @ yaw_rotation(np.radians(-DECLINATION_DEG))[:2, :2].T
    found = {
        "metres": metres / float(np.linalg.norm(np.diff(place[::5], axis=0), axis=1).sum()),
        "heading": measure_start_heading(t, north, place),
        "rigid": mean_distance(walked @ yaw_rotation(turn)[:2, :2].T + shift, place, ~first),
        "north": mean_distance(north + robust_shift(north[first], given), place, ~first),
    }
    # with fixes: their origin is that of the fixes given
    half, minute = np.arange(len(t)) % 2 == 0, (t // 30.0) % 2 == 0
    for name, used in (("first", first), ("held", half), ("30 s", minute)):
        some = replace(gnss, fixes=tuple(fix for fix, use in zip(kept, used, strict=True) if use))
        fused, start = solve_on_fixes(recording, some, t)
        found[name] = mean_distance(fused + start, place, ~used)
    return {**found, "others": OTHERS_M.get(path.stem.removeprefix("pocket_"), np.nan)}


def solve_on_fixes(recording: Recording, gnss: Gnss, at: Floats) -> tuple[Floats, Floats]:
    """Places (K, 2) m from the start at times (K,) s, and the start (2,) m in the axes of the fixes."""
    from pymap3d import geodetic2enu

    found = navigate(replace(Walk.of(recording, POCKET), gnss=gnss), "pocket")
    start = found.parameters["gnss_start"]
    assert isinstance(start, dict)
    degrees = start["latitude_deg"], start["longitude_deg"]
    east, north, _ = geodetic2enu(*degrees, 0.0, gnss.latitude_deg, gnss.longitude_deg, 0.0)
    place = np.stack([np.interp(at, found.t, axis) for axis in found.position[:, :2].T], axis=1)
    return place, np.array([east, north])


def mean_distance(path: Floats, place: Floats, where: Bools) -> float:
    """Mean distance, m, to places (K, 2) where asked for."""
    return float(np.linalg.norm(path - place, axis=1)[where].mean())


def robust_shift(path: Floats, fixes: FixColumns) -> Floats:
    """Shift (2,) m that lays a path (K, 2) on fixes, of Cauchy's errors."""
    miss = fixes.place - path
    shift = np.median(miss, axis=0)
    for _ in range(20):
        weight = 1.0 / (fixes.sigma**2 + ((miss - shift) ** 2).sum(axis=1) / 4.0)
        shift = weight @ miss / weight.sum()
    return np.asarray(shift)


def measure_start_heading(t: Floats, path: Floats, place: Floats) -> float:
    """Mean course of the path less that of the fixes, deg, over the first `START_S` in which both walk."""
    courses = []
    for track in (path, place):
        ends = [
            np.stack([np.interp(t + lag, t, axis) for axis in track.T], axis=1) @ np.array([1j, 1.0])
            for lag in (-COURSE_S, COURSE_S)
        ]
        courses.append((ends[1] - ends[0]) / (2 * COURSE_S))
    walking = np.flatnonzero((np.abs(courses[0]) > WALKING_M_S) & (np.abs(courses[1]) > WALKING_M_S))
    walking = walking[t[walking] < t[walking[0]] + START_S]
    off = courses[0][walking] / courses[1][walking]
    return float(np.degrees(np.angle((off / np.abs(off)).mean())))


def list_thighs(data: Path) -> Iterator[tuple[str, Recording, list[Recording]]]:
    """Yield name, recording and those of both feet, if there are any, of the thighs."""
    for path in sorted((data / "feet_thighs").glob("*T.csv.gz")):
        walk = path.name.rpartition("_")[0]
        feet = [read(path.with_name(f"{walk}_{foot}.csv.gz")) for foot in ("LF", "RF")]
        yield path.name.removesuffix(".csv.gz"), read(path), feet
    for side in "LR":
        feet = [read(data / "feet_vicon" / f"{foot}_Foot.csv.gz") for foot in "LR"]
        yield f"feet_vicon_{side}", read(data / "feet_vicon" / f"{side}_UpLeg.csv.gz"), feet
    body = loadmat(data / "qmt_fullbody" / "full_body_example_data.mat", simplify_cells=True)
    inside = (body["t"] > QMT_S[0]) & (body["t"] < QMT_S[1])
    one = {
        name: Recording(body["t"][inside], body[name]["acc"][inside], body[name]["gyr"][inside])
        for name in ("upper_leg_left", "upper_leg_right", "foot_left", "foot_right")
    }
    for side in ("left", "right"):
        yield f"qmt_{side}", one[f"upper_leg_{side}"], [one["foot_left"], one["foot_right"]]
    path = data / "ridi_leg" / "zhicheng_leg2.csv"
    yield "ridi_leg2", replace(read(path), truth=read_truth(path.with_suffix(".tum"))), []


def measure_thigh(recording: Recording, feet: list[Recording]) -> tuple[Result, float]:
    """Walk of a thigh, and its metres over those known."""
    found = navigate(recording, "pocket", options=POCKET)
    t, known = found.stances.t[[0, -1]], []
    for foot in feet:
        solved = smooth(foot, detect_stances(foot))
        known.append(count_metres(solved.stances.t, solved.stances.position, t))
    if isinstance(recording.truth, TrajectoryTruth):
        at = np.arange(recording.truth.t[0], recording.truth.t[-1], 0.5)  # the sensor itself goes to and fro
        path = [np.interp(at, recording.truth.t, axis) for axis in recording.truth.position.T]
        known.append(count_metres(at, np.stack(path, axis=1), t))
    return found, found.metrics.distance_m / float(np.mean(known))


def count_metres(t: Floats, position: Floats, between: Floats) -> float:
    """Metres over ground of a path (K, 3) between two times."""
    gone = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(position[:, :2], axis=0), axis=1)))
    return float(np.diff(np.interp(between, t, gone))[0])


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure all and print."""
    given = harness.parse_arguments(__doc__, arguments, data=None, json=None)
    data = walks.data_folder(given.data)
    pockets: dict[str, dict[str, float]] = {}
    for path in sorted((data / "pocket_gnss").glob("*.zip")):
        name = path.stem.removeprefix("pocket_")
        try:
            pockets[name] = measure_pocket(path)
            print(f"{name:14s}", *(f"{key} {value:.2f}" for key, value in pockets[name].items()), sep="  ", flush=True)
        except FgNavError as error:
            print(f"{name:14s}  {error}")
    medians = {key: float(np.median([abs(one[key]) for one in pockets.values()])) for key in ("metres", *KEYS)}
    print(f"{'median of size':14s}", *(f"{key} {value:.2f}" for key, value in medians.items()), sep="  ")
    thighs: dict[str, float] = {}
    for name, recording, feet in list_thighs(data):
        try:
            found, thighs[name] = measure_thigh(recording, feet)
            print(
                f"{name:20s}  {found.metrics.distance_m:.1f} m, {thighs[name]:.2f} of those known, {found.verdict.word}"
            )
        except FgNavError as error:
            print(f"{name:20s}  {error}")
    off = np.array(list(thighs.values()))
    print(f"{len(off)} thighs: mean {off.mean():.3f}, scatter {off.std():.3f} of the metres known")
    if given.json is not None:
        harness.write_json(given.json, {"pockets": pockets, "thighs": thighs})


KEYS = ("heading", "rigid", "north", "first", "held", "30 s")

if __name__ == "__main__":
    harness.run(main)
