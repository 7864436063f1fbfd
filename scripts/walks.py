"""The walks on which figures are measured: the real ones, each with its stances, and a simulated one of any length.

=================== ====================================================================================
vicon, labels       28 trials with motion capture; stances: `zv_shoe_opt`, the authors' own best labels
vicon, detected     the same with our detector
gdin                10 indoor walks with surveyed footprints
running             2 more that have running strides in them and a gyroscope that saturates
gdlbio              11 indoor walks with every footprint surveyed, and 7 that are run or clipped in every stride
loops               5 walks that end where they began
RECORDED            sets without a true path, most of them closed: one round and stairs (mti), a corridor, laps, squares
                    and rectangles (mems), corridors and stairs (mtig)
=================== ====================================================================================

The magnetometer is left out: these figures are inertial ones. All walks are prepared as `fg-nav run` does, so that a
large error of the accelerometer is taken off.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import scipy.io

from fg_nav.arrays import Floats, Ints
from fg_nav.detection.stance import Stances
from fg_nav.errors import FormatError, SimulationError
from fg_nav.io import Reading
from fg_nav.lab.pyshoe import read_pyshoe_labels, read_pyshoe_track
from fg_nav.lab.simulation import SCENARIOS, Choices, routes, simulate
from fg_nav.lab.simulation.plan import Stand
from fg_nav.pipeline import prepare_walk, read_walk
from fg_nav.recording import RawRecording, Recording
from fg_nav.report.terminal import console
from fg_nav.truth import TrajectoryTruth
from fg_nav.walk import Options

DEFAULT_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"

GDIN_WALKS = (15, 18, 20, 22, 24, 29, 31, 33, 36, 40)
RUNNING = (35, 43)
GDLBIO_WALKED = (48, 50, 58, 62, 64, 72, 74, 76, 78, 80, 82)
GDLBIO_RUN = (52, 54, 56, 60, 66, 68, 70)
NEWEST_OBSOLETE = 29  # gdin walks up to this one lie in a folder of their own.
SHOE_ERROR = 0  # Of the five errors stored with a trial: that of the detector whose labels are used.

LOOPS = {
    "openshoe 1": "openshoe/data_inert1.txt",
    "openshoe 7": "openshoe/data_inert7.txt",
    "openshoe 13": "openshoe/data_inert13.txt",
    "xio short": "xio/short_walk.csv",
    "xio long": "xio/long_walk.csv",
}

RECORDED: Mapping[str, Sequence[str]] = {
    "mti round": ("mti1_loops/hallway_*",),
    "mti stairs": ("mti1_loops/stairs_*",),
    "corridor": ("corridor_lab/*",),
    "mems": tuple(f"mems_foot/{name}" for name in ("lap_360m_*", "square_70m_*", "*rectangle_*", "c_shape_*")),
    "mtig": ("mtig710/*",),
}
"""Files of each set, without `.csv.gz`."""

MTI1_RATE_HZ = 100.0

GDIN, OPENSHOE = "gdin", "openshoe"

REAL_WALKS: Mapping[str, tuple[str, ...]] = {
    GDIN: tuple(str(number) for number in GDIN_WALKS),
    OPENSHOE: tuple(name.removeprefix("openshoe ") for name in LOOPS if name.startswith(OPENSHOE)),
}
"""Those with a magnetometer, by group."""


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

    Raises
    ------
    FormatError
        Where there is none.
    """
    folder = given or Path(os.environ.get("FG_NAV_DATA", DEFAULT_DATA))
    if not folder.is_dir():
        raise FormatError(f"the real recordings are not at {folder}: name their folder with --data or in FG_NAV_DATA.")
    return folder


def read_vicon_labelled(data: Path) -> list[Walk]:
    """Read the trials with the authors' labels as the stance mask, oldest first."""
    return [
        Walk(
            path.stem,
            _prepare(path.stem, path).recording,
            Stances.from_mask(read_pyshoe_labels(path)),
            stored_armse_m=float(scipy.io.loadmat(path)["trial_error"][0, SHOE_ERROR]),
        )
        for path in _vicon_paths(data)
    ]


def read_vicon_detected(data: Path) -> list[Walk]:
    """Read the trials with our own stances, oldest first."""
    return [_prepare(path.stem, path) for path in _vicon_paths(data)]


def read_gdin(data: Path, numbers: Sequence[int] = GDIN_WALKS) -> list[Walk]:
    """Read the indoor walks of these numbers."""
    return [_prepare(f"gdin {number}", gdin_path(data, number)) for number in numbers]


def read_gdlbio(data: Path, numbers: Sequence[int] = GDLBIO_WALKED) -> list[Walk]:
    """Read the surveyed walks of these numbers, with the path that is stored with them."""
    paths = {number: gdlbio_path(data, number) for number in numbers}
    return [replace(_prepare(f"gdlbio {n}", path), track=read_pyshoe_track(path)) for n, path in paths.items()]


def read_loops(data: Path, names: Sequence[str] = tuple(LOOPS)) -> list[Walk]:
    """Read walks that end where they began."""
    return [_prepare(name, data / LOOPS[name]) for name in names]


def read_recorded(data: Path, names: Sequence[str], with_barometer: bool = False) -> list[Walk]:
    """Read recordings such as those of `RECORDED`; with the barometer beside each, those of which it is usable."""
    found = [path for one in names for path in sorted(data.glob(f"{one}.csv.gz")) if path.name.count(".") == 2]
    if not found:
        raise FormatError(f"there is no recording {names[0]}.csv.gz in {data}: check the folder given with --data.")
    walks = []
    for path in found:
        air = path.with_name(path.name.replace(".csv", ".baro.csv")) if with_barometer else None
        try:
            walks.append(_prepare(path.name.partition(".")[0], path, air))
        except FormatError as error:
            if air is None:
                raise
            console().print(f"left out: {error}")
    return walks


def _prepare(name: str, path: Path, barometer: Path | None = None) -> Walk:
    """Read a walk and find its stances as `fg-nav run --no-mag` does."""
    is_table = path.match("mti1_loops/*")
    recording = Recording.from_raw(read_mti1(path)) if is_table else Reading(barometer=barometer).read(path)
    prepared = prepare_walk(read_walk(recording, Options(use_magnetometer=False)))
    return Walk(name, prepared.recording, prepared.stances)


def read_mti1(path: Path) -> RawRecording:
    """Read a table without stamps, whose first row is no sample."""
    rows = np.genfromtxt(path, delimiter=",", skip_header=2)
    return RawRecording(np.arange(len(rows)) / MTI1_RATE_HZ, rows[:, :3], rows[:, 3:6], np.arange(len(rows)) + 3)


def _vicon_paths(data: Path) -> list[Path]:
    paths = sorted((data / "vicon").glob("*.mat"))
    if not paths:
        raise FormatError(f"there is no trial in {data / 'vicon'}: check the folder given with --data.")
    return paths


def gdin_path(data: Path, number: int) -> Path:
    """File of an indoor walk."""
    folder = "own" if number > NEWEST_OBSOLETE else "own_obsolete"
    return data / "gdin" / folder / f"SensorConnectData_{number}.csv"


def gdlbio_path(data: Path, number: int) -> Path:
    """File of a surveyed walk."""
    return data / "gdlbio" / f"SensorConnectData_{number}_GDLBIO.mat"


def real_path(group: str, walk: str, data: Path) -> Path:
    """File of a walk of `REAL_WALKS`."""
    return data / LOOPS[f"{OPENSHOE} {walk}"] if group == OPENSHOE else gdin_path(data, int(walk))


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


STILL_RAD_S = 0.05  # No reading of a foot that stands is faster.

STILL_S = 1.0


@dataclass(frozen=True)
class RepeatedWalk:
    """A walk that goes on for ever: the samples from `begin` of a recording to its end, again and again.

    Its two ends are instants of two rests in which the foot stood alike, so that no sample leaps there.
    """

    recording: Recording
    begin: int

    @classmethod
    def of(cls, recording: Recording) -> RepeatedWalk:
        """Cut a recording of `simulate_long_walk`, with a field, at two rests: one in the first minutes, and one late.

        Raises `SimulationError` where it has not two.
        """
        length = max(1, round(STILL_S / recording.period_s))
        samples = np.column_stack([recording.acc, recording.gyr, recording.mag])
        seconds = samples[: len(samples) // length * length].reshape(-1, length, samples.shape[1])
        still = np.flatnonzero(np.abs(seconds[:, :, 3:6]).max(axis=(1, 2)) < STILL_RAD_S)
        rests = [part for part in np.split(still, np.flatnonzero(np.diff(still) > 1) + 1) if len(part) > 2]
        middle = np.array([part[len(part) // 2] for part in rests[1:]])
        if len(middle) < 2:
            raise SimulationError("the walk has not two rests to be joined at: ask for three minutes or more.")
        mean = seconds[middle].mean(axis=1)
        late = np.arange((len(middle) + 1) // 2, len(middle))
        # In m/s^2 and uT alike: a degree moves gravity by 0.2, and the field by 0.8.
        apart = np.linalg.norm((mean[late] - mean[0])[:, [0, 1, 2, 6, 7, 8]], axis=1)
        begin, end = int(middle[0]) * length, int(middle[late[np.argmin(apart)]]) * length
        return cls(recording.slice(0, end), begin)

    def number(self, index: Ints) -> Ints:
        """Return which sample (n,) of the recording is sample `index` (n,) of the walk."""
        end = len(self.recording)
        return np.where(index < end, index, self.begin + (index - self.begin) % (end - self.begin))
