"""The real walks on which the figures are measured, each with its stances.

=================== ====================================================================================
vicon, labels       28 trials with motion capture; stances: `zv_shoe_opt`, the authors' own best labels
vicon, detected     the same with our detector
gdin                10 indoor walks with surveyed footprints
running             2 more that have running strides in them and a gyroscope that saturates
loops               5 walks that end where they began
=================== ====================================================================================

The magnetometer is taken off: these figures are inertial ones.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from fg_nav.detection import detect_stances
from fg_nav.errors import FormatError
from fg_nav.io import read, read_pyshoe_labels
from fg_nav.recording import Recording
from fg_nav.stances import Stances

DEFAULT_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"

GDIN_WALKS = (15, 18, 20, 22, 24, 29, 31, 33, 36, 40)
RUNNING = (35, 43)
NEWEST_OBSOLETE = 29
"""gdin walks up to this one lie in a folder of their own."""

LOOPS = {
    "openshoe 1": "openshoe/data_inert1.txt",
    "openshoe 7": "openshoe/data_inert7.txt",
    "openshoe 13": "openshoe/data_inert13.txt",
    "xio short": "xio/short_walk.csv",
    "xio long": "xio/long_walk.csv",
}

GDIN, OPENSHOE = "gdin", "openshoe"

REAL_WALKS: Mapping[str, tuple[str, ...]] = {
    GDIN: tuple(str(number) for number in GDIN_WALKS),
    OPENSHOE: tuple(name.removeprefix("openshoe ") for name in LOOPS if name.startswith(OPENSHOE)),
}
"""Those with a magnetometer, by group."""


@dataclass(frozen=True)
class Walk:
    """A recording and when the foot stood in it."""

    name: str
    recording: Recording
    stances: Stances


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


def vicon_labelled(data: Path) -> list[Walk]:
    """Trials with the authors' labels as the stance mask, oldest first."""
    return [
        Walk(path.stem, _inertial(path), Stances.from_mask(read_pyshoe_labels(path))) for path in _vicon_paths(data)
    ]


def vicon_detected(data: Path) -> list[Walk]:
    """Trials with our own stances, oldest first."""
    return [_detected(path.stem, path) for path in _vicon_paths(data)]


def gdin(data: Path, numbers: Sequence[int] = GDIN_WALKS) -> list[Walk]:
    """Indoor walks by number."""
    return [_detected(f"gdin {number}", gdin_path(data, number)) for number in numbers]


def loops(data: Path, names: Sequence[str] = tuple(LOOPS)) -> list[Walk]:
    """Read walks that end where they began."""
    return [_detected(name, data / LOOPS[name]) for name in names]


def _detected(name: str, path: Path) -> Walk:
    recording = _inertial(path)
    return Walk(name, recording, detect_stances(recording))


def _inertial(path: Path) -> Recording:
    return replace(read(path), mag=None)


def _vicon_paths(data: Path) -> list[Path]:
    paths = sorted((data / "vicon").glob("*.mat"))
    if not paths:
        raise FormatError(f"there is no trial in {data / 'vicon'}: check the folder given with --data.")
    return paths


def gdin_path(data: Path, number: int) -> Path:
    """File of an indoor walk."""
    folder = "own" if number > NEWEST_OBSOLETE else "own_obsolete"
    return data / "gdin" / folder / f"SensorConnectData_{number}.csv"


def real_path(group: str, walk: str, data: Path) -> Path:
    """File of a walk of `REAL_WALKS`."""
    return data / LOOPS[f"{OPENSHOE} {walk}"] if group == OPENSHOE else gdin_path(data, int(walk))
