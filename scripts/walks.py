"""The walks on which figures are measured: the real ones, by sets, and a simulated one of any length.

=================== ====================================================================================
vicon               28 trials with motion capture
gdin                10 indoor walks with surveyed footprints
running             2 more that have running strides in them and a gyroscope that saturates
gdlbio              11 indoor walks with every footprint surveyed
gdlbio run          7 that are run or clipped in every stride
openshoe, xio       walks that end where they began, three and two
mti round, stairs   12 rounds of one floor and 12 walks on stairs, walked and run, 100 Hz
corridor            a corridor to and fro
mems                laps, squares and rectangles
mtig                passes of a corridor, stairs and other ways
=================== ====================================================================================

A walk is read where it is measured. By default the magnetometer is left out: figures are inertial ones unless they say
so. All walks are prepared as `fg-nav run` does, so that a large error of the accelerometer is taken off.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import scipy.io

from fg_nav.arrays import Floats
from fg_nav.detection.stance import Stances
from fg_nav.errors import FormatError
from fg_nav.io import Reading, read_raw
from fg_nav.lab.pyshoe import read_pyshoe_labels, read_pyshoe_track
from fg_nav.lab.simulation import SCENARIOS, Choices, routes, simulate
from fg_nav.lab.simulation.plan import Stand
from fg_nav.pipeline import prepare_walk
from fg_nav.recording import RawRecording, Recording
from fg_nav.truth import TrajectoryTruth
from fg_nav.walk import Options, read_walk
from fg_nav.walk import Walk as Prepared

DEFAULT_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
SHOE_ERROR = 0  # Of the five errors stored with a trial: that of the detector whose labels are used.
MTI1_RATE_HZ = 100.0

GDIN, OPENSHOE = "gdin", "openshoe"
GDIN_WALKS = (15, 18, 20, 22, 24, 29, 31, 33, 36, 40)
LOOPS = {
    **{f"openshoe {n}": f"openshoe/data_inert{n}.txt" for n in (1, 7, 13)},
    **{f"xio {length}": f"xio/{length}_walk.csv" for length in ("short", "long")},
}


def gdin_path(data: Path, number: int) -> Path:
    """File of an indoor walk; those up to 29 lie in a folder of their own."""
    return data / "gdin" / ("own" if number > 29 else "own_obsolete") / f"SensorConnectData_{number}.csv"


NUMBERED: Mapping[str, tuple[str, Sequence[int]]] = {
    GDIN: ("gdin", GDIN_WALKS),
    "running": ("gdin", (35, 43)),
    "gdlbio": ("gdlbio", (48, 50, 58, 62, 64, 72, 74, 76, 78, 80, 82)),
    "gdlbio run": ("gdlbio", (52, 54, 56, 60, 66, 68, 70)),
}
FILES: Mapping[str, Sequence[str]] = {
    "vicon": ("vicon/*.mat",),
    "mti round": ("mti1_loops/hallway_*",),
    "mti stairs": ("mti1_loops/stairs_*",),
    "corridor": ("corridor_lab/*",),
    "mems": tuple(f"mems_foot/{name}" for name in ("lap_360m_*", "square_70m_*", "*rectangle_*", "c_shape_*")),
    "mtig": ("mtig710/*",),
}
"""Patterns of each set, without `.csv.gz`."""


@dataclass(frozen=True)
class Real:
    """A recording: its name, its file, and the barometer beside it where that is asked for."""

    name: str
    path: Path
    barometer: Path | None = None

    def read_raw(self) -> RawRecording:
        """Read the samples as they stand in the file, without the magnetometer; those of mti1_loops have no stamps."""
        if self.path.parent.name != "mti1_loops":
            return replace(read_raw(self.path), mag=None)
        rows = np.genfromtxt(self.path, delimiter=",", skip_header=2)  # a header, and a row that is no sample
        return RawRecording(np.arange(len(rows)) / MTI1_RATE_HZ, rows[:, :3], rows[:, 3:6], np.arange(len(rows)) + 3)

    def prepare(self, options: Options | None = None) -> Prepared:
        """Read a walk and find its stances as `fg-nav run --no-mag` does, or by these options."""
        source: Path | Recording = self.path
        if self.path.parent.name == "mti1_loops":
            source = Recording.from_raw(self.read_raw())
        elif self.barometer is not None:
            source = Reading(barometer=self.barometer).read(self.path)
        return prepare_walk(read_walk(source, options or Options(use_magnetometer=False)))

    def read(self) -> Walk:
        """Read a walk with what is stored with it."""
        prepared = self.prepare()
        track = read_pyshoe_track(self.path) if self.path.parent.name == "gdlbio" else None
        return Walk(self.name, prepared.recording, prepared.stances, track)

    def read_labelled(self) -> Walk:
        """Read a trial with the authors' labels as the stance mask."""
        stored = float(scipy.io.loadmat(self.path)["trial_error"][0, SHOE_ERROR])
        walk = replace(self.read(), stances=Stances.from_mask(read_pyshoe_labels(self.path)))
        return replace(walk, stored_armse_m=stored)


@dataclass(frozen=True)
class Walk:
    """A recording and when the foot stood in it.

    `track` (N, 2) m and `stored_armse_m` are what the authors of a set stored with it: a path at every sample, and
    PyShoe's error with its own labels.
    """

    name: str
    recording: Recording
    stances: Stances
    track: Floats | None = None
    stored_armse_m: float | None = None


def data_folder(given: Path | None) -> Path:
    """Folder with the recordings: the given one, else $FG_NAV_DATA, else ../shared/data beside the repository.

    Raises `FormatError` where there is none.
    """
    folder = given or Path(os.environ.get("FG_NAV_DATA", DEFAULT_DATA))
    if not folder.is_dir():
        raise FormatError(f"the real recordings are not at {folder}: name their folder with --data or in FG_NAV_DATA.")
    return folder


def list_set(data: Path, name: str, with_barometer: bool = False) -> list[Real]:
    """List the recordings of a set; with the barometer those that have one.

    Raises `FormatError` where none is there.
    """
    if name in LOOPS or name in (OPENSHOE, "xio"):
        found = [Real(one, data / path) for one, path in LOOPS.items() if one.startswith(name)]
    elif name in NUMBERED:
        group, numbers = NUMBERED[name]
        surveyed = "gdlbio/SensorConnectData_{}_GDLBIO.mat"
        paths = [gdin_path(data, n) if group == GDIN else data / surveyed.format(n) for n in numbers]
        found = [Real(f"{group} {number}", path) for number, path in zip(numbers, paths, strict=True)]
    else:
        ends = "" if name == "vicon" else ".csv.gz"
        paths = [path for one in FILES[name] for path in sorted(data.glob(one + ends)) if path.name.count(".") <= 2]
        found = [Real(path.name.partition(".")[0], path) for path in paths]
        if with_barometer:
            beside = [one.path.with_name(one.path.name.replace(".csv", ".baro.csv")) for one in found]
            found = [replace(one, barometer=air) for one, air in zip(found, beside, strict=True) if air.exists()]
    found = [one for one in found if one.path.exists()]
    if not found:
        raise FormatError(f"there is no recording of the set {name} in {data}: check the folder given with --data.")
    return found


# --- simulated -------------------------------------------------------------------------------------------------------

PAUSE_S = 10.0
MIN_ROUND_S = 55.0  # A round of 61 strides takes some 57 s, and a pause follows.


def simulate_long_walk(minutes: float, seed: int, rate_hz: float = 200.0, field: str | None = None) -> Recording:
    """Simulate rounds of the demonstration's corridor, a rest of ten seconds after each; the truth is the true path.

    Parameters
    ----------
    minutes : duration; the last round is cut off where the time is over, be it in a swing.
    seed : draws gait, biases and noise.
    rate_hz : sample rate.
    field : level of the magnetic field; without one there is no magnetometer.
    """
    rounds = int(np.ceil(60 * minutes / MIN_ROUND_S))
    demo = SCENARIOS["demo"]
    rest, around, _ = routes.demo()
    scenario = replace(
        demo,
        name=f"{rounds} rounds",
        route=lambda _: [rest, *[around, Stand(PAUSE_S)] * rounds],
        sensor=demo.sensor if field else replace(demo.prior, mag=None),
        field=field or "homogeneous",
    )
    whole = simulate(scenario, seed, Choices(rate_hz=rate_hz)).recording
    truth, stop = whole.truth, round(60 * minutes * rate_hz)
    assert isinstance(truth, TrajectoryTruth)
    return replace(whole.slice(0, stop), truth=TrajectoryTruth(truth.t[:stop], truth.position[:stop]))
