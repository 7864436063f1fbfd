"""Clean inputs of the fuzz campaign: pieces of real and simulated walks, and the files that go with one.

Each is made by whoever needs it first, and stored in a folder that all workers share. Recordings are rows (n, 10) of
t s, acc m/s^2, gyr rad/s, mag uT, NaN where there is no sample; all else is bytes.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Sequence
from contextlib import closing
from functools import cache, partial
from pathlib import Path

import numpy as np
from online_fuzz import draw_walk
from walks import LOOPS, gdin_path, gdlbio_path

from fg_nav.arrays import Floats
from fg_nav.calibration.of_recording import calibrate, write_calibration
from fg_nav.errors import FgNavError
from fg_nav.io import read, write_canonical, write_tum
from fg_nav.lab.simulation import SCENARIOS, Choices, SimulatedWalk, simulate
from fg_nav.online.buffer import OnlineOptions, rows_of
from fg_nav.online.follow import Sensor, StreamOptions, follow
from fg_nav.online.record import LINES, Record
from fg_nav.online.sources import Replay
from fg_nav.pipeline import navigate
from fg_nav.recording import RawRecording, Recording
from fg_nav.report.files import write_run
from fg_nav.truth import TrajectoryTruth
from fg_nav.view.outlets import Outlets

MAX_S = 90.0  # Of a recording from which pieces are cut.

BASE_S, BASE_HZ, RECORDED_S = 16.0, 100.0, 12.0
"""The walk that companions and records are of: its duration, its rate, and how much of it is recorded."""

SIMULATED = 8  # Random walks (`online_fuzz`).

SCENARIO = b"""like = "office"
field = "smooth"
rests = "none"
feet = "moving"
magnets = [[1.5, 10.0, 0.0]]

[course]
points_m = [[0, 0], [0, 7], [6, 7]]
corner_radius_m = 1.2
laps = 1
rest_s = 2.0
pace = 1.0
run = false

[sensor]
rate_hz = 100
[sensor.gyr]
noise_density = 1e-4
"""


def list_real(data: Path | None) -> dict[str, Path]:
    """Return the real recordings from which pieces are cut, by name; none without their folder."""
    if data is None:
        return {}
    vicon = sorted((data / "vicon").glob("*.mat"))[::9]
    found = {
        **{f"gdin {number}": gdin_path(data, number) for number in (15, 31, 43)},
        **{f"gdlbio {number}": gdlbio_path(data, number) for number in (48, 52, 64)},
        **{f"vicon {path.stem}": path for path in vicon},
        **{name: data / place for name, place in LOOPS.items() if name in ("openshoe 13", "xio short")},
        "ridi leg": data / "ridi_leg" / "zhicheng_leg2.csv",
        "broad": data / "broad" / "24_disturbed_tapping_A.mat",
    }
    return {name: path for name, path in found.items() if path.exists()}


class Store:
    """Clean inputs in a folder; `data` holds the real recordings, None where they are not at hand."""

    def __init__(self, folder: Path, data: Path | None) -> None:
        self._folder, self._data, self._real = folder, data, list_real(data)
        thighs = {"pocket-street": "thigh"}
        self._simulated = {f"simulated {k}": partial(draw_random, k) for k in range(SIMULATED)}
        self._simulated |= {name: partial(draw_scenario, scenario) for scenario, name in thighs.items()}

    @property
    def recordings(self) -> list[str]:
        """Names of the recordings."""
        return [*self._real, *self._simulated]

    @property
    def data(self) -> Path | None:
        """Folder of the real recordings."""
        return self._data

    def rows(self, name: str) -> Floats:
        """Return a recording by its name, as rows (n, 10)."""
        path = self._folder / f"{name.replace(' ', '_')}.npy"
        if not path.exists():
            rows = rows_of(self._read(name) if name in self._real else self._simulated[name]())
            write_whole(path, lambda fresh: np.save(fresh, rows))
        return np.asarray(np.load(path))

    def _read(self, name: str) -> Recording:
        recording = read(self._real[name])
        return recording.slice(0, int(np.searchsorted(recording.t, recording.t[0] + MAX_S)))

    def keep_readable(self, name: str, sources: Sequence[Path]) -> list[Path]:
        """Return those of the real files or folders of this name that are read as they are."""
        path = self._folder / f"readable-{name}.txt"
        if not path.exists():
            found = [str(source) for source in sources if _is_readable(source)]
            write_whole(path, lambda fresh: fresh.write_text("\n".join(found)))
        return [Path(line) for line in path.read_text().splitlines()]

    def companion(self, name: str) -> bytes:
        """Return the file of this name that goes with the base walk; see `COMPANIONS`."""
        path = self._folder / name
        if not path.exists():
            content = COMPANIONS[name](self._folder)
            write_whole(path, lambda fresh: fresh.write_bytes(content))
        return path.read_bytes()


def _is_readable(source: Path) -> bool:
    try:
        read(source)
    except FgNavError:
        return False
    return True


def write_whole(path: Path, write: Callable[[Path], object]) -> None:
    """Write a file that is there as a whole or not at all, whoever else writes it."""
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        fresh = Path(folder) / path.name
        write(fresh)
        os.replace(fresh, path)


def draw_random(seed: int) -> Recording:
    """Simulate a random walk."""
    return draw_walk(seed, np.random.default_rng(seed))


def draw_scenario(name: str) -> Recording:
    """Simulate the first minute and a half of a scenario."""
    whole = simulate(SCENARIOS[name], 1, Choices(rate_hz=BASE_HZ)).recording
    return whole.slice(0, round(MAX_S * BASE_HZ))


# --- the files that go with the base walk ----------------------------------------------------------------------------


@cache
def simulate_base() -> SimulatedWalk:
    """Simulate the base walk."""
    return simulate(SCENARIOS["demo"], 1, Choices(rate_hz=BASE_HZ))


def base_recording() -> Recording:
    """Return its recording."""
    return simulate_base().recording.slice(0, round(BASE_S * BASE_HZ))


def base_thigh() -> Recording:
    """Return a recording in a pocket."""
    return draw_scenario("pocket-street")


def raw_of(rows: Floats) -> RawRecording:
    """Rows (n, 10) as a recording that was not judged; without a magnetometer where it has no sample."""
    mag = None if np.isnan(rows[:, 7:10]).all() else rows[:, 7:10]
    return RawRecording(t=rows[:, 0], acc=rows[:, 1:4], gyr=rows[:, 4:7], mag=mag, row=np.arange(2, len(rows) + 2))


def _write_walk(folder: Path) -> bytes:
    return _written(lambda path: write_canonical(raw_of(rows_of(base_recording())), path))


def _write_rest(saved: Callable[[], Recording], folder: Path) -> bytes:
    """A walk from somewhat before the last save on."""
    rows = rows_of(saved())[round((RECORDED_S - 1.0) * BASE_HZ) : round(BASE_S * BASE_HZ)]
    return _written(lambda path: write_canonical(raw_of(rows), path))


def _write_truth(folder: Path) -> bytes:
    truth = base_recording().truth
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    t, position, nav_R_body = truth.t[::10], truth.position[::10], truth.nav_R_body[::10]
    return _written(lambda path: write_tum(path, t, position, nav_R_body))


def _write_footprints(folder: Path) -> bytes:
    places = simulate_base().strides.footprint[:10]
    rows = [f"{k},{place[0]:.3f},{place[1]:.3f}" for k, place in enumerate(places)]
    return "\n".join(["stride,x_m,y_m", *rows, ""]).encode()


def _write_fixes(folder: Path) -> bytes:
    truth = base_recording().truth
    assert isinstance(truth, TrajectoryTruth)
    rows = [
        f"{truth.t[k]:.2f},{x:.2f},{y:.2f},{'' if k % 300 else f'{z:.2f}'},0.3"
        for k in range(300, round(BASE_S * BASE_HZ) - 50, 200)
        for x, y, z in [truth.position[k] - truth.position[0]]
    ]
    return "\n".join(["time_s,x_m,y_m,z_m,sigma_m", *rows, ""]).encode()


def _write_calibration(folder: Path) -> bytes:
    walk = simulate(SCENARIOS["calibration-loop"], 1, Choices(rate_hz=BASE_HZ))
    found = calibrate(walk.recording, "levelled").calibration
    return _written(lambda path: write_calibration(path, found))


def _write_config(method: str, folder: Path) -> bytes:
    result = navigate(base_recording(), method, heading_deg=10.0)
    with tempfile.TemporaryDirectory() as name:
        write_run(Path(name), result.walk, result.outcome, "none")
        return (Path(name) / "config.json").read_bytes()


def _write_record(options: OnlineOptions, end: str, folder: Path) -> bytes:
    """What the record of the beginning of the base walk, or of a thigh, has in the file with this end of its name."""
    known = base_thigh() if options.mount == "pocket" else base_recording()
    begin = known.slice(0, round(RECORDED_S * BASE_HZ))
    with tempfile.TemporaryDirectory() as name:
        record = Record(Path(name) / "record.csv", False, False, lambda words: None)
        with closing(record):
            source = Replay(begin, np.inf, "a walk")
            sensor = Sensor(source, StreamOptions(online=options), record)
            follow({None: sensor}, Outlets(lambda line: None, None, lambda words: None))
        return (Path(name) / f"record.csv{end}").read_bytes()


def _written(write: Callable[[Path], object]) -> bytes:
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "file"
        write(path)
        return path.read_bytes()


HEADER = [
    "time_s",
    *(f"acc_{axis}_m_s2" for axis in "xyz"),
    *(f"gyr_{axis}_rad_s" for axis in "xyz"),
    *(f"mag_{axis}_uT" for axis in "xyz"),
]
"""Of canonical rows."""

FOOT, LAGGED = OnlineOptions(heading_rad=None), OnlineOptions(heading_rad=None, lag_s=12.0)
THIGH = OnlineOptions(heading_rad=None, mount="pocket")

CONFIGURED = {
    "config.json": "smoother",
    "config-iez.json": "iez",
    "config-qsf.json": "qsf",
    "config-online.json": "online",
}
"""Files for --config, and the methods that they are of."""

COMPANIONS: dict[str, Callable[[Path], bytes]] = {
    "walk.csv": _write_walk,
    "foot-rest.csv": partial(_write_rest, base_recording),
    "thigh-rest.csv": partial(_write_rest, base_thigh),
    "truth.tum": _write_truth,
    "footprints.csv": _write_footprints,
    "fixes.csv": _write_fixes,
    "sensor.json": _write_calibration,
    **{name: partial(_write_config, method) for name, method in CONFIGURED.items()},
    "scenario.toml": lambda folder: SCENARIO,
    **{
        f"{name}.record{end}": partial(_write_record, options, end)
        for name, options in (("foot", FOOT), ("lagged", LAGGED), ("thigh", THIGH))
        for end in ("", LINES)
    },
}
"""Clean files by name, and how each is made."""
