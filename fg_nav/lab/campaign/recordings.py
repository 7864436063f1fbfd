"""Folders of recordings: each readable file is a walk, with its truth where that lies beside it.

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
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType

from fg_nav.errors import CampaignError
from fg_nav.lab.campaign.tables import RESULTS_CSV
from fg_nav.lab.campaign.walks import PLAIN_READING, Reading, Recorded
from fg_nav.lab.store.files import MARKERS

SUFFIXES = (".csv", ".txt", ".mat")

TRUTHS = (".tum", ".truth.tum", ".truth.csv", ".truth.mat")
"""Behind the name of the walk."""

SHARED_TRUTHS = ("truth.tum", "truth.csv", "truth.mat")
"""Of a walk alone in its folder."""

OUR_TABLES = ("landmarks.csv", "strides.csv", "online.csv", "comparison.csv", "field.csv", RESULTS_CSV)

RECORDED = "recorded"
"""In place of a field."""


@dataclass(frozen=True)
class Walk:
    """A recording in a folder: the folder's name, the file's name from there, and where it is read from."""

    group: str
    name: str
    source: Recorded

    def sums(self) -> dict[str, str]:
        """SHA-256 of each file by its name: a file that changed makes other results."""
        files = (self.source.path, *self.source.beside, self.source.truth)
        return {path.name: _sum(path) for path in files if path is not None}


def find_walks(folders: Sequence[Path], readings: Mapping[str, Reading] = MappingProxyType({})) -> tuple[Walk, ...]:
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


def _walks(group: str, folder: Path, reading: Reading) -> list[Walk]:
    paths = sorted(path for path in _files(folder) if _is_walk(path))
    if not paths:
        raise CampaignError(f"{folder} holds no recordings: a recording is a file {', '.join(SUFFIXES)}.")
    for path in paths:
        _check_name(path)
    alone = {path.parent for path in paths} - {a.parent for a, b in _pairs(paths) if a.parent == b.parent}
    shared = {path: path.parent in alone for path in paths}
    return [Walk(group, path.relative_to(folder).as_posix(), _source(path, shared[path], reading)) for path in paths]


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
