"""The walks on which figures are measured: the real ones, by sets, and a simulated one of any length.

A walk is read where it is measured. By default the magnetometer is left out: figures are inertial ones unless they say
so. All walks are prepared as `fg-nav run` does, so that a large error of the accelerometer is taken off.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fg_nav.detection.stance import Stances
from fg_nav.errors import FormatError
from fg_nav.io import Reading, read_raw
from fg_nav.lab.pyshoe import read_pyshoe_labels
from fg_nav.lab.simulation import SCENARIOS, Choices, routes, simulate
from fg_nav.lab.simulation.plan import Stand
from fg_nav.pipeline import prepare_walk
from fg_nav.recording import RawRecording, Recording
from fg_nav.truth import TrajectoryTruth
from fg_nav.walk import Options, Walk, read_walk

DEFAULT_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
MTI1, MTI1_RATE_HZ = "mti1_loops", 100.0

GDIN, GDLBIO, OPENSHOE = "gdin", "gdlbio", "openshoe"
SURVEYED = {GDIN: "gdin/own*/SensorConnectData_{}.csv", GDLBIO: "gdlbio/SensorConnectData_{}_GDLBIO.mat"}
SETS: Mapping[str, tuple[str, str]] = {
    "vicon": ("vicon/{}.mat", "*"),  # trials with motion capture
    GDIN: (SURVEYED[GDIN], "15 18 20 22 24 29 31 33 36 40"),  # indoor walks with surveyed footprints
    "running": (SURVEYED[GDIN], "35 43"),  # that have running strides in them and a gyroscope that saturates
    GDLBIO: (SURVEYED[GDLBIO], "48 50 58 62 64 72 74 76 78 80 82"),  # indoor walks with every footprint surveyed
    "gdlbio run": (SURVEYED[GDLBIO], "52 54 56 60 66 68 70"),  # that are run or clipped in every stride
    OPENSHOE: ("openshoe/data_inert{}.txt", "1 7 13"),  # walks that end where they began
    "xio": ("xio/{}_walk.csv", "short long"),  # likewise
    "mti round": ("mti1_loops/{}.csv.gz", "hallway_*"),  # rounds of one floor, walked and run, 100 Hz
    "mti stairs": ("mti1_loops/{}.csv.gz", "stairs_*"),
    "corridor": ("corridor_lab/{}.csv.gz", "*"),  # to and fro
    "mems": ("mems_foot/{}.csv.gz", "lap_360m_* square_70m_* *rectangle_* c_shape_*"),  # closed, a raw sensor
    "all of mems": ("mems_foot/{}.csv.gz", "*"),
    "mtig round": ("mtig710/{}.csv.gz", "*hallway*"),
    "mtig": ("mtig710/{}.csv.gz", "*"),  # passes of a corridor, stairs and other ways
    "feet": ("feet_thighs/{}.csv.gz", "rectangle*F circle*F"),  # closed, each foot
    "by hand": ("broad/{}.mat", "*"),  # a sensor that is turned and moved by hand
    "crawling": ("vicon/{}.mat", "2018-02-09*"),  # and ladders
    "leg": ("ridi_leg/{}.csv", "*"),  # a phone in a trouser leg
}
"""Files of each set, and the words that stand in their names, or a pattern of these."""


@dataclass(frozen=True)
class Real:
    """A recording: its name, its file, and the barometer beside it where that is asked for."""

    name: str
    path: Path
    barometer: Path | None = None

    def read_raw(self) -> RawRecording:
        """Read the samples as they stand in the file, without the magnetometer; those of mti1_loops have no stamps."""
        if self.path.parent.name != MTI1:
            return replace(read_raw(self.path), mag=None)
        rows = np.genfromtxt(self.path, delimiter=",", skip_header=2)  # a header, and a row that is no sample
        return RawRecording(np.arange(len(rows)) / MTI1_RATE_HZ, rows[:, :3], rows[:, 3:6], np.arange(len(rows)) + 3)

    def prepare(self, options: Options | None = None, labelled: bool = False) -> Walk:
        """Read a walk and find its stances as `fg-nav run --no-mag` does, or by these options, or PyShoe's labels."""
        read = Reading(barometer=self.barometer).read
        recording = Recording.from_raw(self.read_raw()) if self.path.parent.name == MTI1 else read(self.path)
        walk = prepare_walk(read_walk(recording, options or Options(use_magnetometer=False)))
        return replace(walk, stances=Stances.from_mask(read_pyshoe_labels(self.path))) if labelled else walk


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
    (files, words), found = SETS[name], list[Real]()
    for word in words.split():
        paths = [path for path in sorted(data.glob(files.format(word))) if path.name.count(".") <= 2]
        for path in paths:  # more dots have the files beside, of barometer and receiver
            known = path.name.partition(".")[0] if "*" in word else f"{files.partition('/')[0]} {word}"
            air = path.with_name(path.name.replace(".csv", ".baro.csv"))
            if not with_barometer or air.exists():
                found.append(Real(known, path, air if with_barometer else None))
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
