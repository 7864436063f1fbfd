"""Atomic results: a folder or a file appears whole or not at all, and never in place of something else.

New files are written into a hidden folder inside the target and moved to their places when all are complete,
`summary.json`, `comparison.json` or `detect.json` last: a folder with a summary is complete. With `force` the files of
an older result are kept aside until then, and restored if anything fails. Only names that this program writes are ever
replaced; hidden files are left alone, except those of a killed process:

    .fg-nav-new-*    its output: removed; moved on, if the move to its place had begun
    .fg-nav-old-*    an older result on its way aside: restored
    .fg-nav-past-*   one that was aside: removed, once the new one is in its place

A folder is locked (`fg_nav.system.processes`) from before the work until the result is complete: of two runs the
second is refused.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path

from fg_nav.errors import OutputError, describe_reason
from fg_nav.system.processes import lock_folder

_SUMMARIES = ("summary.json", "comparison.json", "detect.json")

# Every file name that a command writes.
RESULT_FILES = frozenset(
    {
        "trajectory.tum", "strides.csv", "online.csv", "summary.json", "config.json", "report.html",
        "trajectory_polished.tum", "strides_polished.csv",
        "trajectory.png", "heading.png", "gyro_bias.png", "stance_statistic.png",
        "comparison.csv", "comparison.json", "trajectories.png", "errors.png",
        "person.csv", "trajectory_left.tum", "trajectory_right.tum", "strides_left.csv", "strides_right.csv",
        "online_left.csv", "online_right.csv",
    }
)  # fmt: skip
SIMULATION_FILES = frozenset({"recording.csv", "truth.tum", "truth.json", "landmarks.csv", "map.png"})
FEET_FILES = frozenset(
    {
        "left.csv", "left.truth.tum", "left.truth.json", "right.csv", "right.truth.tum", "right.truth.json",
        "person.tum", "landmarks.csv", "map.png",
    }
)  # fmt: skip
DETECT_FILES = frozenset({"field.png", "field_map.png", "field.csv", "detect.json"})
ALLAN_FILES = frozenset({"allan.json", "allan.png"})
DEMO_FILES = RESULT_FILES | SIMULATION_FILES

NEW, OLD, PAST = (".fg-nav-new-", ".fg-nav-old-", ".fg-nav-past-")  # Prefixes of hidden folders.


@contextmanager
def result_folder(out: Path, force: bool = False) -> Iterator[Path]:
    """Yield an empty folder to write into; at the end of the block its content becomes that of `out`.

    With `force` an older result in it is replaced. Raises `OutputError` if `out` holds a
    result and `force` is not set, holds anything else, cannot be written, or another process is at work in it.
    """
    with hold_folder(out, force), fill_folder(out, force) as fresh:
        yield fresh


@contextmanager
def hold_folder(out: Path, force: bool = False, ours: frozenset[str] = RESULT_FILES) -> Iterator[None]:
    """Make a folder and lock it while the block runs, after repairing what a killed process left in it.

    `force`: an older result may be replaced; `ours`: names of files that make one.

    Raises `OutputError` as `result_folder` does. A folder that was made for the block is removed if it stays empty.
    """
    made = not out.exists()
    descriptor, is_locked = lock_result(out)
    try:
        if is_locked:
            # A killed process left the new files, the old ones, or both. A folder `PAST` means that the old ones were
            # all moved away: the new ones move in. Without it the old ones move back.
            new, old, past = _list_left(out), sorted(out.glob(f"{OLD}*")), sorted(out.glob(f"{PAST}*"))
            with suppress(OSError):
                for entry in _list_visible(*(old + new if past else old)):
                    os.replace(entry, out / entry.name)
                for folder in (*new, *old, *past):
                    shutil.rmtree(folder, ignore_errors=True)
        check_free(out, force, ours)
        yield
    finally:
        if made:
            with suppress(OSError):  # it is not empty: all went well
                out.rmdir()
        os.close(descriptor)


def lock_result(out: Path) -> tuple[int, bool]:
    """Make a folder of results if it is missing and lock it, as `lock_folder`, or raise `OutputError`."""
    _refuse_file(out)
    try:
        return lock_folder(out)
    except BlockingIOError:
        raise OutputError(f"another run is at work in {out}: wait until it is done, or choose another --out.") from None
    except OSError as error:
        raise unwritable(out, error) from None


@contextmanager
def fill_folder(out: Path, force: bool = False, ours: frozenset[str] = RESULT_FILES) -> Iterator[Path]:
    """Yield an empty folder to write into; at the end its content becomes that of `out`, which is held."""
    check_free(out, force, ours)
    try:
        with _open_fresh(out) as fresh:
            yield fresh
            _take_over(fresh, out)
    except OSError as error:
        raise unwritable(out, error) from None


@contextmanager
def _open_fresh(parent: Path) -> Iterator[Path]:
    """Yield a hidden folder, which is locked, and removed at the end of the block."""
    with tempfile.TemporaryDirectory(prefix=NEW, dir=parent, ignore_cleanup_errors=True) as name:
        descriptor, _ = lock_folder(Path(name))
        try:
            yield Path(name)
        finally:
            os.close(descriptor)


def _list_left(parent: Path) -> list[Path]:
    """Hidden folders of ended processes; none where the disk has no locks."""
    left = []
    for folder in sorted(parent.glob(f"{NEW}*")):
        with suppress(OSError):  # a running process
            descriptor, locks = lock_folder(folder)
            os.close(descriptor)
            left += [folder] * locks
    return left


def check_free(out: Path, force: bool = False, ours: frozenset[str] = RESULT_FILES) -> None:
    """Refuse early, before long work, an `out` that cannot be used; raises `OutputError` as `result_folder` does."""
    try:
        _refuse_file(out)
        present = _list_visible(out) if out.exists() else []
        foreign = []
        for entry in sorted(present):
            if entry.is_dir() and not entry.is_symlink():
                # the folder of a method
                inside = {child.name for child in entry.iterdir()} - {".DS_Store"}
                foreign += sorted(f"{entry.name}/{name}" for name in inside - RESULT_FILES)
                foreign += [] if inside else [entry.name]
            elif entry.name not in ours:
                foreign.append(entry.name)
    except OSError as error:
        raise unwritable(out, error) from None
    if foreign:
        raise OutputError(f"{out} holds '{foreign[0]}', which this command does not write: choose another --out.")
    if present and not force:
        raise OutputError(f"{out} already holds a result: choose another --out, or replace it with --force.")


def _refuse_file(out: Path) -> None:
    if out.exists() and not out.is_dir():
        raise OutputError(f"{out} is a file, not a folder: choose another --out.")


@contextmanager
def claim_folder(parent: Path, name: str) -> Iterator[Path]:
    """Make, hold and yield the first of `parent/name-1`, `-2`, ... that is new, or was left by a killed process.

    It is removed if it is empty at the end. Raises `OutputError` if none can be made.
    """
    for number in count(1):
        out = parent / f"{name}-{number}"
        try:
            out.mkdir(parents=True)  # of two processes one makes it, also on a disk without locks
            break
        except FileExistsError:
            with suppress(OutputError):
                if any(out.glob(f"{NEW}*")) and not _list_visible(out):
                    with hold_folder(out):
                        break
        except OSError as error:
            raise unwritable(parent, error) from None
    try:
        with hold_folder(out):
            yield out
    finally:
        with suppress(OSError):  # it is not empty: all went well
            out.rmdir()


def unwritable(out: Path, error: OSError) -> OutputError:
    """Return the error for a folder that cannot be written."""
    return OutputError(
        f"{out} cannot be written ({describe_reason(error)}): choose another --out, or make room for it."
    )


def _list_visible(*folders: Path) -> list[Path]:
    """Entries of folders in turn, by name, summaries last, without hidden ones."""
    found = [entry for folder in folders for entry in sorted(folder.iterdir()) if not entry.name.startswith(".")]
    return sorted(found, key=lambda entry: entry.name in _SUMMARIES)


def _take_over(fresh: Path, out: Path) -> None:
    """Move the new files to their places; undo everything if one cannot be moved."""
    aside = Path(tempfile.mkdtemp(prefix=OLD, dir=out))
    past = aside.with_name(aside.name.replace(OLD, PAST))
    # The name of the folder aside shows the progress, should the process be killed now.
    moves = [(entry, aside / entry.name) for entry in _list_visible(out)[::-1]]
    moves += [(aside, past)]
    moves += [(entry, out / entry.name) for entry in _list_visible(fresh)]
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
    shutil.rmtree(past, ignore_errors=True)


@contextmanager
def result_file(out: Path, ours: Callable[[Path], bool], force: bool = False) -> Iterator[Path]:
    """Yield a path to write to; at the end of the block that file takes the place of `out`, as in `result_files`."""
    with result_files([out], ours, force) as (fresh,):
        yield fresh


@contextmanager
def result_files(out: Sequence[Path], ours: Callable[[Path], bool], force: bool = False) -> Iterator[list[Path]]:
    """Yield paths to write to; at the end of the block these files take the places of `out`, all in one folder.

    With `force` existing files are replaced, if by `ours` they are older results. Raises `OutputError` if one exists
    and `force` is not set, is something else, or cannot be written.
    """
    for file in out:
        check_file_free(file, ours, force)
    try:
        out[0].parent.mkdir(parents=True, exist_ok=True)
        for left in _list_left(out[0].parent):
            shutil.rmtree(left, ignore_errors=True)
        with _open_fresh(out[0].parent) as folder:
            fresh = [folder / file.name for file in out]
            yield fresh
            for file in out:  # which another process may have made meanwhile
                check_file_free(file, ours, force)
            for made, file in zip(fresh, out, strict=True):
                if force:
                    os.replace(made, file)
                    continue
                try:
                    os.link(made, file)
                except FileExistsError:
                    raise OutputError(f"{file} was made by another meanwhile: name another file.") from None
                except OSError:  # a disk without links
                    os.replace(made, file)
    except OSError as error:
        raise unwritable(out[0], error) from None


def check_file_free(out: Path, ours: Callable[[Path], bool], force: bool = False) -> None:
    """Refuse early, before long work, an `out` that cannot be written; raises `OutputError` as `result_file` does."""
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
