"""Walks that methods are tried on, simulated or recorded, and what is known of the iron on the shoe.

A simulated walk starts with the true heading; that of a recorded one is not known. Which files of a folder are walks
and which their truths is in docs/campaigns.md; a `.mat` beside a `.csv` or `.txt` of the same name belongs to that
walk, as a truth or as nothing: the reader of the format knows.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, TypeAlias

import numpy as np

from fg_nav.calibration.ellipsoid import calibrate_on_loop
from fg_nav.calibration.of_recording import Calibration
from fg_nav.calibration.walk import calibrate_on_walk
from fg_nav.calibration.walk_model import read_strides
from fg_nav.detection import detect_stances
from fg_nav.errors import CalibrationError, CampaignError
from fg_nav.frames import compute_heading
from fg_nav.io import read, read_truth
from fg_nav.lab.simulation import Choices, Scenario, SimulatedWalk, scenario, simulate
from fg_nav.lab.simulation.scenario_file import parse_scenario
from fg_nav.lab.simulation.walk import Passing
from fg_nav.lab.store.files import MARKERS
from fg_nav.magnetic import average_footfall_field
from fg_nav.pipeline import prepare_walk
from fg_nav.recording import Recording
from fg_nav.text import parse_toml
from fg_nav.walk import Options, Walk

LOOP = "loop"  # Calibrated on `calibration-loop` with the same shoe and sensor, as Ma et al. did; recorded, by a file.
PERFECT = "perfect"  # There is no iron; simulated walks only.
WALK = "walk"  # Calibrated by the walk itself as `fg-nav calibrate` does; raw where that refuses.
RAW = "raw"  # No calibration is given: the methods correct it by the walk itself, however well that shows the iron.
NONE = "none"  # No magnetometer.
MAGNETOMETERS = (LOOP, PERFECT, WALK, RAW, NONE)


@dataclass(frozen=True)
class Reading:
    """How recordings are read."""

    format: str | None = None  # Its name; None to recognize it.
    calibration: Calibration | None = None  # Not its file: a worker may have another disk.


@dataclass(frozen=True)
class Simulated:
    """The walk of one scenario, field and seed; simulated when first asked for.

    A scenario of the user has the `content` of its file (`lab.simulation.scenario_file`), as workers get it.
    """

    name: str
    level: str
    seed: int
    content: bytes | None = None
    _walks: dict[bool, SimulatedWalk] = field(default_factory=dict, compare=False, repr=False)  # Without iron, or with.
    reading: ClassVar[Reading] = Reading()  # Nothing is read.

    @property
    def scenario(self) -> Scenario:
        """As the simulator takes it; raises `SimulationError` if the file describes what cannot be."""
        return scenario(self.name) if self.content is None else parse_scenario(self.name, self.content)

    @property
    def description(self) -> dict[str, Any]:
        """All that decides what is simulated, but for the seed."""
        one = Choices(field=self.level).apply_to(self.scenario)
        walk: dict[str, Any] = {name: getattr(one, name) for name in ("worn", "site", "magnets")}
        walk |= {"field": self.level, "sensor": one.prior}
        own = {} if self.content is None else {"course": parse_toml(self.content)["course"], "aligned": one.aligned}
        return walk | own

    def prepare(self, magnetometer: str) -> Walk:
        """Input of all methods; raises `CalibrationError` if the loop does not calibrate."""
        one, perfect = self.scenario, magnetometer == PERFECT
        if perfect not in self._walks:
            self._walks[perfect] = simulate(one, self.seed, Choices(field=self.level, calibrated=perfect))
        walked = self._walks[perfect]
        heading_deg = float(np.rad2deg(compute_heading(walked.attitude[0])))
        calibration = simulate_calibration(one, self.seed) if magnetometer == LOOP else None
        options = Options(use_magnetometer=magnetometer != NONE, heading_deg=heading_deg)
        prepared = prepare_walk(Walk.of(walked.recording, options, calibration))
        return calibrate_on_itself(prepared) if magnetometer == WALK else prepared

    @property
    def landmarks(self) -> Sequence[Passing]:
        """Crossings of landmarks of the prepared walk: with and without iron they are the same."""
        return next(iter(self._walks.values())).landmarks


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
    """A recorded walk, with its magnetometer."""

    path: Path
    truth: Path | None = None  # File of its truth, if it has one.
    beside: tuple[Path, ...] = ()  # Other files that the reader looks at.
    reading: Reading = Reading()
    contents: tuple[tuple[str, bytes], ...] = ()  # Of its files by name, for a worker with another disk (`pack`).
    landmarks: ClassVar[Sequence[Passing]] = ()

    @property
    def files(self) -> list[Path]:
        """All of its files, the recording first."""
        return [self.path, *self.beside, *([] if self.truth is None else [self.truth])]

    @cached_property
    def description(self) -> dict[str, str]:
        """SHA-256 of each file by its name, empty of one that cannot be read: a file that changed makes others."""
        sums = dict.fromkeys((path.name for path in self.files), "")
        for path in self.files:
            with suppress(OSError), path.open("rb") as file:
                sums[path.name] = hashlib.file_digest(file, "sha256").hexdigest()
        return sums

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
    for path in source.files:
        with suppress(OSError):
            contents.append((path.name, path.read_bytes()))
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


# --- folders of recordings -------------------------------------------------------------------------------------------

SUFFIXES = (".csv", ".txt", ".mat")

TRUTHS = (".tum", ".truth.tum", ".truth.csv", ".truth.mat")  # Behind the name of the walk.
SHARED_TRUTHS = ("truth.tum", "truth.csv", "truth.mat")  # Of a walk alone in its folder.

OUR_TABLES = (
    "landmarks.csv", "gait.csv", "strides.csv", "strides_polished.csv", "person.csv", "strides_left.csv",
    "strides_right.csv", "online_left.csv", "online_right.csv", "online.csv", "comparison.csv", "field.csv",
    "results.csv",
)  # fmt: skip

RECORDED = "recorded"  # In place of a field.


def find_walks(
    folders: Sequence[Path], readings: Mapping[str, Reading] = MappingProxyType({})
) -> dict[tuple[str, str], Recorded]:
    """Find the walks of folders by the folder's name and the file's from there; `readings` are by the folders' names.

    Raises `CampaignError` if a folder is not there or holds no walk, two have the same name, a file's name is no text,
    or a reading is of no folder.
    """
    found: dict[tuple[str, str], Recorded] = {}
    groups: set[str] = set()
    for folder in folders:
        if not os.path.isdir(folder):  # unlike the path's own it has no error for a name that is too long
            raise CampaignError(f"there is no folder {folder} with recordings: name one that is there.")
        group = folder.resolve().name
        if group in groups:
            raise CampaignError(f"two folders of recordings are named '{group}': rename one, results go by its name.")
        groups.add(group)
        paths = sorted(_list_walks(folder))
        if not paths:
            raise CampaignError(f"{folder} holds no recordings: a recording is a file {', '.join(SUFFIXES)}.")
        walks_in = Counter(path.parent for path in paths)
        for path in paths:
            try:
                str(path).encode()
            except UnicodeEncodeError:  # no table could have it
                raise CampaignError(f"the name of the recording {str(path)!r} is not UTF-8: rename it.") from None
            # Its truth, and the `.mat` of the same name.
            truths = [path.with_name(path.stem + end) for end in TRUTHS]
            if walks_in[path.parent] == 1:
                truths += [path.with_name(name) for name in SHARED_TRUTHS]
            truth = next((one.resolve() for one in truths if one.is_file()), None)
            beside = path.with_suffix(".mat")
            others = (beside,) if beside != path and beside.is_file() else ()
            source = Recorded(path.resolve(), truth, others, readings.get(group, Reading()))
            found[group, path.relative_to(folder).as_posix()] = source
    for name in readings:
        if name not in groups:
            raise CampaignError(f"reading is given of '{name}', which is no folder of recordings: add it there.")
    return found


def _list_walks(folder: Path) -> Iterator[Path]:
    """Yield the walks below a folder, but for hidden files and those in folders that a command of ours fills."""
    for where, folders, files in os.walk(folder):
        if not set(MARKERS).isdisjoint(files):
            folders.clear()
            continue
        folders[:] = [name for name in folders if not name.startswith(".")]
        for name in files:
            path = Path(where, name)
            other = name.startswith(".") or name.endswith(TRUTHS) or name in (*OUR_TABLES, *SHARED_TRUTHS)
            belongs = path.suffix == ".mat" and any(path.with_suffix(end).is_file() for end in (".csv", ".txt"))
            if path.suffix.lower() in SUFFIXES and not other and not belongs and path.is_file():
                yield path
