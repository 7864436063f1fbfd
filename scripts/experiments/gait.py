"""Gait parameters beside motion capture and gaitmap, stride by stride.

Motion capture: the parameters of a marker's path, from footfall to footfall at our times. Its height is moved to the
sensor, rigidly, as fits the heights within the strides best; turns are those of two markers.
"""

import subprocess
from argparse import Namespace
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import walks
from harness import option

from experiments import ALL, Column, Experiment, Found, Table, Task, write_table
from experiments.worn import SIDES
from fg_nav import FeetResult, Options, Recording, Solution, TrajectoryTruth, navigate, navigate_feet
from fg_nav.arrays import Floats, interpolate_columns
from fg_nav.errors import SimulationError
from fg_nav.gait import tabulate_gait

RATE_HZ, CAPTURED_HZ = 204.8, 100.0  # Of gaitmap's sample, and of its markers, mm.
RUNNER = Path(__file__).resolve().parents[1] / "bench" / "gaitmap_gait.py"
INSTEP = 0.65  # Where the sensor of feet_vicon is, from ankle to toe.
BY_PLACE = ["length_m", "clearance_m", "step_length_m", "step_width_m"]


def list_references(chosen: Namespace) -> list[Task]:
    """Each reference on all that it has."""
    data = walks.data_folder(chosen.data)
    measures = {
        "vicon, walked": partial(measure_trials, sorted((data / "vicon").glob("2017-11-22*"))),
        "vicon, run and mixed": partial(measure_trials, sorted((data / "vicon").glob("2017-11-27*"))),
        "feet_vicon": partial(measure_markers, data / "feet_vicon"),
        "gaitmap's sample": partial(measure_markers, data / "two_feet" / "gaitmap"),
        "gaitmap on its sample": partial(measure_gaitmap, data / "two_feet" / "gaitmap", chosen.python),
    }
    return [Task(name, ALL, measure) for name, measure in measures.items()]


def compare(ours: pd.DataFrame, theirs: pd.DataFrame) -> Found:
    """Differences of ours from the reference in each of its columns; rows are alike."""
    off = (ours[theirs.columns] - theirs).dropna(axis=1, how="all")
    sums = {"strides": off.count(), "bias": off.mean(), "sd": off.std(), "typical": off.abs().median()}
    return {name: {key: of[name].item() for key, of in sums.items()} for name in map(str, off)}


def tabulate(feet: Mapping[Any, Solution]) -> pd.DataFrame:
    """Strides of feet by `foot` and `index`."""
    return tabulate_gait(feet, beside=len(feet) > 1).set_index(["foot", "index"])


def follow_marker(foot: Solution, marker: Floats) -> Solution:
    """Return the solution of a foot that goes as a marker (N, 3) m does, its height moved to the sensor."""
    sample, up, off = foot.stances.sample, foot.nav_R_body[:, 2], marker[:, 2] - foot.position[:, 2]
    first = sample[np.clip(np.searchsorted(sample, np.arange(len(up)), side="right") - 1, 0, None)]
    lever = np.linalg.lstsq(up - up[first], off - off[first], rcond=None)[0]
    place = np.column_stack([marker[:, :2], marker[:, 2] - up @ lever])
    return replace(foot, position=place, stances=replace(foot.stances, position=place[sample]))


def measure_trials(trials: Sequence[Path]) -> Found:
    """Measure trials of one foot."""
    tables = []
    for trial in trials:
        foot = navigate(trial, "inertial", options=Options(use_magnetometer=False, mount="foot"))
        assert isinstance(foot.walk.truth, TrajectoryTruth)
        marker = interpolate_columns(foot.t, foot.walk.truth.t, foot.walk.truth.position)
        tables.append([tabulate({trial.name: one}) for one in (foot, follow_marker(foot, marker))])
    ours, theirs = (pd.concat(of) for of in zip(*tables, strict=True))
    return compare(ours, theirs[BY_PLACE])


def navigate_pair(folder: Path) -> FeetResult:
    """Navigate both feet of a folder, those of gaitmap's sample in its axes."""
    feet: list[Path | Recording] = [folder / f"{side}_Foot.csv.gz" for side in "LR"]
    if (folder / "imu_sample.csv").exists():
        table = pd.read_csv(folder / "imu_sample.csv", header=[0, 1], index_col=0)
        columns = [f"{sensor}_{axis}" for sensor in ("acc", "gyr") for axis in "xyz"]
        samples = [table[f"{side}_sensor"][columns].to_numpy() for side in SIDES]
        feet = [Recording(np.arange(len(x)) / RATE_HZ, x[:, :3], np.radians(x[:, 3:])) for x in samples]
    return navigate_feet(feet[0], feet[1], "inertial", sides="left,right", clock_offset_s=0.0)


def measure_markers(folder: Path) -> Found:
    """Measure both feet beside markers at ankle or heel and at the toe, and the instep between."""
    result, feet, heading = navigate_pair(folder), dict[str, Solution](), dict[str, Floats]()
    for side, foot in result.feet.items():
        if (folder / "vicon.npz").exists():
            heel, toe = (np.load(folder / "vicon.npz")[side[0].upper() + name] for name in ("TIO", "TOE"))
        else:
            table = 1e-3 * pd.read_csv(folder / "mocap_sample.csv", header=[0, 1], index_col=0)
            markers = (table[f"{side[0].upper()}_{name}"].to_numpy() for name in ("FCC", "TOE"))
            heel, toe = (interpolate_columns(foot.t, np.arange(len(table)) / CAPTURED_HZ, one) for one in markers)
        feet[side] = follow_marker(foot, heel + INSTEP * (toe - heel))
        heading[side] = np.unwrap(np.arctan2(*(toe - heel)[foot.stances.sample, :2].T))
    captured = tabulate(feet)[BY_PLACE]
    turns = [np.degrees(heading[side][k + 1] - heading[side][k]) for side, k in captured.index]
    return compare(tabulate(result.feet), captured.assign(turning_deg=turns))


def measure_gaitmap(folder: Path, python: str | None) -> Found:
    """Measure beside gaitmap on the same strides; raises `SimulationError` where it does not run."""
    ours, theirs = tabulate(navigate_pair(folder).feet).dropna(subset="stance_share"), []
    for side in SIDES:
        at = ours.loc[side, ["start_s", "end_s", "toe_off_s", "contact_s", "duration_s"]]
        at["duration_s"] = at.contact_s - at.duration_s  # the contact before
        samples = (at * RATE_HZ).round().astype(int).set_axis(["start", "end", "tc", "ic", "pre_ic"], axis=1)
        command = [python or "python", str(RUNNER), str(folder / "imu_sample.csv"), f"{side}_sensor"]
        ran = subprocess.run(command, input=samples.to_csv(index=False), capture_output=True, text=True, check=False)
        if ran.returncode:
            raise SimulationError(f"gaitmap did not run, see --python: {ran.stderr.strip()[-200:]}")
        theirs.append(pd.read_csv(StringIO(ran.stdout)))
    return compare(ours, pd.concat(theirs).set_index(ours.index))


def write_references(table: Table) -> list[str]:
    """Write a row each reference and parameter."""
    known = [row for row in table.rows if "bias" in row]
    cells = [[row["section"], f"`{row['variant']}`", f"{row['strides']}"] for row in known]
    figures = [[f"{row['bias']:+.3f}", f"{row['sd']:.3f}"] for row in known]
    heads = ("beside", "parameter", "strides", "bias", "sd")
    return write_table(heads, (a + b for a, b in zip(cells, figures, strict=True)), words=2)


EXPERIMENTS: Mapping[str, Experiment] = {
    "gait": Experiment(
        "Gait parameters of strides less those of a reference: number, median size and standard deviation.",
        list_references,
        [Column("strides", "strides", "sum", "{:.0f}"), *(Column(key, key, "sum") for key in ("typical", "sd"))],
        options={"python": option(None, "the interpreter that has gaitmap", metavar="PYTHON")},
        blocks={"gait-references": write_references},
    )
}
