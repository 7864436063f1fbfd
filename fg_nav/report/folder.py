"""A result, a folder or a single file, appears whole or not at all, and never in place of something else.

New files are written into a hidden folder inside the target and moved to their places when all are there,
`summary.json`, `comparison.json` or `detect.json` last: a folder with a summary is complete. With `force` the
files of an older result are kept aside until then, and put back if anything fails. Only names that this
program writes are ever replaced; hidden files are left alone.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from fg_nav.errors import OutputError

_SUMMARIES = ("summary.json", "comparison.json", "detect.json")

RESULT_FILES = frozenset(
    {
        "trajectory.tum", "strides.csv", "online.csv", "summary.json", "config.json", "report.html",
        "trajectory_polished.tum", "strides_polished.csv",
        "trajectory.png", "heading.png", "gyro_bias.png", "stance_statistic.png",
        "comparison.csv", "comparison.json", "trajectories.png", "errors.png",
    }
)  # fmt: skip
"""Every file name that a run or a comparison writes."""

SIMULATION_FILES = frozenset({"recording.csv", "truth.tum", "truth.json", "landmarks.csv", "map.png"})
"""Every file name that a simulation writes."""

DETECT_FILES = frozenset({"field.png", "field_map.png", "field.csv", "detect.json"})
"""Every file name that a look at the field writes."""

ALLAN_FILES = frozenset({"allan.json", "allan.png"})
"""Every file name that an Allan deviation writes."""

DEMO_FILES = RESULT_FILES | SIMULATION_FILES
"""And the demonstration, which does both."""


@contextmanager
def result_folder(
    out: Path, force: bool = False, ours: frozenset[str] = RESULT_FILES, claimed: bool = False
) -> Iterator[Path]:
    """Yield an empty folder to write into; at the end of the block its content becomes that of `out`.

    Parameters
    ----------
    out : the folder to make, or an empty one, or with `force` one that holds an older result.
    force : replace an older result.
    ours : file names that may be replaced.
    claimed : `out` was made for this result (`claim_folder`), and goes away with it if it fails.

    Raises
    ------
    OutputError
        If `out` holds a result and `force` is not set, if it holds anything else, or cannot be written.
    """
    check_free(out, force, ours)
    try:
        temporary = claimed or not out.exists()
        out.mkdir(parents=True, exist_ok=True)
        fresh = Path(tempfile.mkdtemp(prefix=".fg-nav-new-", dir=out))
    except OSError as error:
        raise unwritable(out, error) from None
    try:
        yield fresh
        _take_over(fresh, out)
    except OSError as error:
        raise unwritable(out, error) from None
    finally:
        shutil.rmtree(fresh, ignore_errors=True)
        if temporary:
            with suppress(OSError):  # it is not empty: all went well
                out.rmdir()


def check_free(out: Path, force: bool = False, ours: frozenset[str] = RESULT_FILES) -> None:
    """Say now, before long work, whether `out` can be used; raises `OutputError` as `result_folder` does."""
    try:
        if out.exists() and not out.is_dir():
            raise OutputError(f"{out} is a file, not a folder: choose another --out.")
        present = _visible(out) if out.exists() else []
        foreign = _foreign(present, ours)
    except OSError as error:
        raise unwritable(out, error) from None
    if foreign:
        raise OutputError(f"{out} holds '{foreign[0]}', which this command does not write: choose another --out.")
    if present and not force:
        raise OutputError(f"{out} already holds a result: choose another --out, or replace it with --force.")


def claim_folder(parent: Path, name: str) -> Path:
    """Make and return the first of `parent/name-1`, `-2`, ... that does not exist; raises `OutputError`."""
    number = 1
    while True:
        try:
            parent.mkdir(parents=True, exist_ok=True)
            (parent / f"{name}-{number}").mkdir()
            return parent / f"{name}-{number}"
        except FileExistsError as error:
            if not parent.is_dir():
                raise unwritable(parent, error) from None
            number += 1
        except OSError as error:
            raise unwritable(parent, error) from None


def unwritable(out: Path, error: OSError) -> OutputError:
    """Return the sentence for a folder that the system does not let us write."""
    reason = (error.strerror or type(error).__name__).lower()
    return OutputError(f"{out} cannot be written ({reason}): choose another --out, or make room for it.")


def _visible(folder: Path) -> list[Path]:
    return sorted(entry for entry in folder.iterdir() if not entry.name.startswith("."))


def _foreign(entries: list[Path], ours: frozenset[str]) -> list[str]:
    """Names that are not ours, here or inside the folders of methods."""
    names = []
    for entry in entries:
        if entry.is_dir() and not entry.is_symlink():
            inside = {child.name for child in entry.iterdir()} - {".DS_Store"}
            names += sorted(f"{entry.name}/{name}" for name in inside - RESULT_FILES)
            names += [] if inside else [entry.name]
        elif entry.name not in ours:
            names.append(entry.name)
    return names


def _take_over(fresh: Path, out: Path) -> None:
    """Move the new files to their places; undo everything if one cannot be moved."""
    aside = Path(tempfile.mkdtemp(prefix=".fg-nav-old-", dir=out))
    moves = [(entry, aside / entry.name) for entry in sorted(_visible(out), key=_is_summary, reverse=True)]
    moves += [(entry, out / entry.name) for entry in sorted(_visible(fresh), key=_is_summary)]
    done: list[tuple[Path, Path]] = []
    try:
        for origin, place in moves:
            os.replace(origin, place)
            done.append((origin, place))
    except BaseException:
        for origin, place in reversed(done):
            os.replace(place, origin)
        aside.rmdir()
        raise
    shutil.rmtree(aside, ignore_errors=True)


def _is_summary(entry: Path) -> bool:
    return entry.name in _SUMMARIES


@contextmanager
def result_file(out: Path, ours: Callable[[Path], bool], force: bool = False) -> Iterator[Path]:
    """Yield a path to write to; at the end of the block that file takes the place of `out`, as in `result_files`."""
    with result_files([out], ours, force) as (fresh,):
        yield fresh


@contextmanager
def result_files(out: Sequence[Path], ours: Callable[[Path], bool], force: bool = False) -> Iterator[list[Path]]:
    """Yield paths to write to; at the end of the block these files take the places of `out`.

    Parameters
    ----------
    out : the files to make, in one folder.
    ours : whether an existing file is an older result, and so may be replaced.
    force : replace an older result.

    Raises
    ------
    OutputError
        If one exists and `force` is not set, if it is something else, or cannot be written.
    """
    for file in out:
        check_file_free(file, ours, force)
    try:
        out[0].parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".fg-nav-new-", dir=out[0].parent) as folder:
            fresh = [Path(folder) / file.name for file in out]
            yield fresh
            for made, file in zip(fresh, out, strict=True):
                os.replace(made, file)
    except OSError as error:
        raise unwritable(out[0], error) from None


def check_file_free(out: Path, ours: Callable[[Path], bool], force: bool = False) -> None:
    """Say now, before long work, whether `out` can be written; raises `OutputError` as `result_file` does."""
    try:
        if out.is_dir():
            raise OutputError(f"{out} is a folder: name a file to write.")
        if out.parent.exists() and not out.parent.is_dir():
            raise OutputError(f"{out.parent} is no folder: name another file.")
        if out.exists() and not ours(out):
            raise OutputError(f"{out} holds what this command does not write: name another file.")
        if out.exists() and not force:
            raise OutputError(f"{out} already exists: name another file, or replace it with --force.")
    except OSError as error:
        raise unwritable(out, error) from None
