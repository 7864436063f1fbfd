"""Walks that methods are tried on, simulated or recorded, and how their magnetometer is calibrated.

============ ===================================================================================================
magnetometer calibration of the iron on the shoe
============ ===================================================================================================
loop         by the scenario `calibration-loop`, walked before with the same shoe and sensor (the ellipse,
             `fg_nav.calibration.ellipsoid`), as Ma et al. did it; of a recorded walk by a file, if one is given
perfect      there is no iron, and the walk's own fit finds 0.1 to 0.2 uT; simulated walks only
walk         by the walk itself as `fg-nav calibrate` does (`fg_nav.calibration.walk`); raw where that refuses
raw          none is given: the methods correct it by the walk itself, however well that shows the iron
none         none: the methods have no magnetometer
============ ===================================================================================================

A simulated walk starts with the true heading; that of a recorded one is not known.

Folders of recordings: each readable file is a walk, with its truth where that lies beside it.

A walk is a file `.csv`, `.txt` or `.mat` anywhere in the folder, but for hidden ones, truths, and the tables that
fg-nav itself writes (`OUR_TABLES`); nothing in the folder of a campaign or a reproduction is one, so that a campaign
may write beside its recordings. A `.mat` beside a `.csv` or `.txt` of the same name belongs to that walk, as a
truth or as nothing: the reader of the format knows. The truth of `walk.csv` is the first of `walk.tum`,
`walk.truth.tum`, `walk.truth.csv` and `walk.truth.mat` that is there, read as `fg-nav run --truth` reads it; a walk
that is alone in its folder may have `truth.tum`, `truth.csv` or `truth.mat`.

What is no recording is a result that failed, with the reason.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeAlias

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.calibration.ellipsoid import calibrate_on_loop
from fg_nav.calibration.of_recording import Calibration
from fg_nav.calibration.walk import calibrate_on_walk
from fg_nav.calibration.walk_model import read_strides
from fg_nav.detection import detect_stances
from fg_nav.errors import CalibrationError, CampaignError
from fg_nav.frames import compute_heading
from fg_nav.io import read, read_truth
from fg_nav.lab.campaign.folder import RESULTS_CSV
from fg_nav.lab.simulation import Choices, Scenario, SimulatedWalk, scenario, simulate
from fg_nav.lab.simulation.scenario_file import parse_scenario
from fg_nav.lab.store.files import MARKERS
from fg_nav.magnetic import average_footfall_field
from fg_nav.pipeline import prepare_walk
from fg_nav.recording import Recording
from fg_nav.truth import TrajectoryTruth
from fg_nav.walk import Options, Walk

LOOP, PERFECT, WALK, RAW, NONE = "loop", "perfect", "walk", "raw", "none"
MAGNETOMETERS = (LOOP, PERFECT, WALK, RAW, NONE)

MIXTURES: Mapping[str, float] = {"between": 0.35}
"""Share of the field `indoor` in a mixture with `smooth`: with one seed the two have the same steps and the same
noise, and the magnetometer's reading is linear in the field. The mixture has no truth of its own."""


@dataclass(frozen=True)
class UserScenario:
    """A scenario of the user: name and text of its file (`lab.simulation.scenario_file`), as workers get it."""

    name: str
    text: str

    @property
    def scenario(self) -> Scenario:
        """As the simulator takes it; raises `SimulationError` if the file describes what cannot be."""
        return parse_scenario(self.name, self.text)

    @property
    def course(self) -> Any:
        """The file's course, which nothing else of the scenario contains."""
        return tomllib.loads(self.text)["course"]


@dataclass(frozen=True)
class Reading:
    """How recordings are read: name of the format, None to recognize it; the calibration, None without.

    The calibration itself, not its file: a worker may have another disk.
    """

    format: str | None = None
    calibration: Calibration | None = None


PLAIN_READING = Reading()  # Of a folder for which the plan has no table.


@dataclass(frozen=True)
class Simulated:
    """The walk of one scenario, field and seed; simulated when first asked for. The scenario may be the user's."""

    name: str
    level: str
    seed: int
    own: UserScenario | None = None

    def prepare(self, magnetometer: str) -> Walk:
        """Input of all methods; raises `CalibrationError` if the loop does not calibrate."""
        walk = self._perfect if magnetometer == PERFECT else self._with_iron
        truth = walk.recording.truth
        assert isinstance(truth, TrajectoryTruth)
        assert truth.nav_R_body is not None
        heading_deg = float(np.rad2deg(compute_heading(truth.nav_R_body[0])))
        calibration = simulate_calibration(self._scenario, self.seed) if magnetometer == LOOP else None
        options = Options(use_magnetometer=magnetometer != NONE, heading_deg=heading_deg)
        prepared = prepare_walk(Walk.of(walk.recording, options, calibration))
        return calibrate_on_itself(prepared) if magnetometer == WALK else prepared

    @property
    def landmark(self) -> tuple[str, ...]:
        """Names of the landmarks, one a crossing."""
        return tuple(passing.landmark for passing in self._any.landmarks)

    @property
    def passed(self) -> tuple[Floats, Floats]:
        """When (L,) s and where (L, 3) m they are crossed."""
        passings = self._any.landmarks
        return np.array([p.time_s for p in passings]), np.array([p.position for p in passings])

    @property
    def _scenario(self) -> Scenario:
        return scenario(self.name) if self.own is None else self.own.scenario

    @property
    def _any(self) -> SimulatedWalk:
        """Landmarks are the same with and without iron."""
        return self._perfect if "_with_iron" not in self.__dict__ else self._with_iron

    @cached_property
    def _with_iron(self) -> SimulatedWalk:
        return simulate_walk(self._scenario, self.seed, self.level)

    @cached_property
    def _perfect(self) -> SimulatedWalk:
        return simulate_walk(self._scenario, self.seed, self.level, calibrated=True)


def simulate_walk(name: str | Scenario, seed: int, level: str, calibrated: bool = False) -> SimulatedWalk:
    """Simulate a walk in one of the simulator's fields, or in one of `MIXTURES`."""
    if level not in MIXTURES:
        return simulate(name, seed, Choices(field=level, calibrated=calibrated))
    smooth, indoor = (simulate(name, seed, Choices(field=one, calibrated=calibrated)) for one in ("smooth", "indoor"))
    one, other = smooth.recording.mag, indoor.recording.mag
    assert one is not None
    assert other is not None
    mixed = (1.0 - MIXTURES[level]) * one + MIXTURES[level] * other
    return replace(smooth, recording=replace(smooth.recording, mag=mixed))


def simulate_calibration(name: str | Scenario, seed: int) -> Calibration:
    """Calibrate the same shoe and sensor on a calibration loop; raises `CalibrationError` if it refuses."""
    one = scenario(name) if isinstance(name, str) else name
    loop = replace(scenario("calibration-loop"), sensor=one.sensor, worn=one.worn)
    recording = simulate(loop, seed).recording
    _, magnetometer = calibrate_on_loop(average_footfall_field(recording, detect_stances(recording)))
    return Calibration(magnetometer=magnetometer)


def calibrate_on_itself(walk: Walk) -> Walk:
    """Calibrate a walk by itself; unchanged if that is not enough, or there is no field."""
    if walk.field is None:
        return walk
    assert walk.sensed is not None
    try:
        calibration = Calibration(magnetometer=calibrate_on_walk(read_strides(walk.sensed, walk.stances)))
    except CalibrationError:
        return walk
    return prepare_walk(Walk.of(replace(walk.sensed, truth=walk.truth), walk.options, calibration))


@dataclass(frozen=True)
class Recorded:
    """A recorded walk, with its magnetometer.

    Attributes
    ----------
    path, truth : files of the recording and of its truth, if it has one.
    beside : other files that the reader looks at.
    reading : how it is read.
    contents : name and content of the files, for a worker with another disk (`pack`).
    landmark, passed : none.
    """

    path: Path
    truth: Path | None = None
    beside: tuple[Path, ...] = ()
    reading: Reading = PLAIN_READING
    contents: tuple[tuple[str, bytes], ...] = ()
    landmark: tuple[str, ...] = ()
    passed: tuple[Floats, Floats] = field(default_factory=lambda: (np.zeros(0), np.zeros((0, 3))))

    def prepare(self, magnetometer: str) -> Walk:
        """Input of all methods: the heading at the start is not known."""
        calibration = self.reading.calibration if magnetometer == LOOP else None
        walk = prepare_walk(Walk.of(self._recording, Options(use_magnetometer=magnetometer != NONE), calibration))
        return calibrate_on_itself(walk) if magnetometer == WALK else walk

    @cached_property
    def _recording(self) -> Recording:
        recording = read(self.path, self.reading.format)
        return recording if self.truth is None else replace(recording, truth=read_truth(self.truth))


Source: TypeAlias = Simulated | Recorded


def pack(source: Source) -> Source:
    """Return a source with the contents of its files; one that cannot be read is left out, and will be missed."""
    if not isinstance(source, Recorded):
        return source
    contents = []
    for path in {source.path, *source.beside, source.truth or source.path}:
        try:
            contents.append((path.name, path.read_bytes()))
        except OSError:
            continue
    return replace(source, contents=tuple(contents))


@contextmanager
def unpack(source: Source) -> Iterator[tuple[Source, str]]:
    """Yield a source whose packed files are on this machine's disk, and the folder of its files; empty for none."""
    if not isinstance(source, Recorded) or not source.contents:
        yield source, f"{source.path.parent}{os.sep}" if isinstance(source, Recorded) else ""
        return
    with tempfile.TemporaryDirectory(prefix="fg-nav-") as name:
        folder = Path(name)
        for file, content in source.contents:
            (folder / file).write_bytes(content)
        truth = source.truth and folder / source.truth.name
        yield replace(source, path=folder / source.path.name, truth=truth, contents=()), f"{folder}{os.sep}"


SUFFIXES = (".csv", ".txt", ".mat")

TRUTHS = (".tum", ".truth.tum", ".truth.csv", ".truth.mat")  # Behind the name of the walk.
SHARED_TRUTHS = ("truth.tum", "truth.csv", "truth.mat")  # Of a walk alone in its folder.

OUR_TABLES = (
    "landmarks.csv",
    "strides.csv",
    "strides_polished.csv",
    "person.csv",
    "strides_left.csv",
    "strides_right.csv",
    "online_left.csv",
    "online_right.csv",
    "online.csv",
    "comparison.csv",
    "field.csv",
    RESULTS_CSV,
)

RECORDED = "recorded"  # In place of a field.


@dataclass(frozen=True)
class WalkFile:
    """A recording in a folder: the folder's name, the file's name from there, and where it is read from."""

    group: str
    name: str
    source: Recorded

    def sums(self) -> dict[str, str]:
        """SHA-256 of each file by its name: a file that changed makes other results."""
        files = (self.source.path, *self.source.beside, self.source.truth)
        return {path.name: _sum(path) for path in files if path is not None}


def find_walks(folders: Sequence[Path], readings: Mapping[str, Reading] = MappingProxyType({})) -> tuple[WalkFile, ...]:
    """Find the walks of folders, sorted within each; `readings` are by the folders' names.

    Raises
    ------
    CampaignError
        If a folder is not there or holds no walk, two have the same name, a file's name is no text, or a reading is of
        no folder.
    """
    by_name: dict[str, Path] = {}
    for folder in folders:
        if not os.path.isdir(folder):  # unlike the path's own it has no error for a name that is too long
            raise CampaignError(f"there is no folder {folder} with recordings: name one that is there.")
        name = folder.resolve().name
        if name in by_name:
            raise CampaignError(f"two folders of recordings are named '{name}': rename one, results go by its name.")
        by_name[name] = folder
    for name in readings:
        if name not in by_name:
            raise CampaignError(f"reading is given of '{name}', which is no folder of recordings: add it there.")
    return tuple(
        walk for name, folder in by_name.items() for walk in _walks(name, folder, readings.get(name, PLAIN_READING))
    )


def _walks(group: str, folder: Path, reading: Reading) -> list[WalkFile]:
    paths = sorted(path for path in _files(folder) if _is_walk(path))
    if not paths:
        raise CampaignError(f"{folder} holds no recordings: a recording is a file {', '.join(SUFFIXES)}.")
    for path in paths:
        _check_name(path)
    alone = {path.parent for path in paths} - {a.parent for a, b in _pairs(paths) if a.parent == b.parent}
    shared = {path: path.parent in alone for path in paths}
    return [
        WalkFile(group, path.relative_to(folder).as_posix(), _source(path, shared[path], reading)) for path in paths
    ]


def _source(path: Path, alone: bool, reading: Reading) -> Recorded:
    truth = _truth(path, alone)
    return Recorded(path.resolve(), truth and truth.resolve(), _beside(path), reading)


def _pairs(paths: Sequence[Path]) -> list[tuple[Path, Path]]:
    """Neighbours in the list, by folder."""
    by_folder = sorted(paths, key=lambda path: path.parent)
    return list(pairwise(by_folder))


def _files(folder: Path) -> Iterator[Path]:
    """Yield the files below a folder, but for hidden ones and those in folders that a command of ours fills."""
    for where, folders, files in os.walk(folder):
        if not set(MARKERS).isdisjoint(files):
            folders.clear()
            continue
        folders[:] = [name for name in folders if not name.startswith(".")]
        yield from (Path(where, name) for name in files if not name.startswith("."))


def _check_name(path: Path) -> None:
    """Refuse a name that no table could have: bytes that are not UTF-8."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        raise CampaignError(f"the name of the recording {str(path)!r} is not UTF-8: rename it.") from None


def _is_walk(path: Path) -> bool:
    if path.suffix.lower() not in SUFFIXES or path.name in (*OUR_TABLES, *SHARED_TRUTHS):
        return False
    return path.is_file() and not path.name.endswith(TRUTHS) and not _belongs(path)


def _belongs(path: Path) -> bool:
    """Whether it is the `.mat` beside a walk of the same name."""
    return path.suffix == ".mat" and any(path.with_suffix(suffix).is_file() for suffix in (".csv", ".txt"))


def _beside(path: Path) -> tuple[Path, ...]:
    beside = path.with_suffix(".mat")
    return (beside,) if beside != path and beside.is_file() else ()


def _truth(path: Path, alone: bool) -> Path | None:
    own = [path.with_name(path.stem + end) for end in TRUTHS]
    shared = [path.with_name(name) for name in SHARED_TRUTHS] if alone else []
    return next((one for one in [*own, *shared] if one.is_file()), None)


def _sum(path: Path) -> str:
    """Sum of a file; empty of one that cannot be read, whose result gives the reason."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return ""
