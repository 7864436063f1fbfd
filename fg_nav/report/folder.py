"""Atomic results: a folder or a file appears whole or not at all, and never in place of something else.

New files are written into a hidden folder inside the target and moved to their places when all are complete,
`summary.json`, `comparison.json` or `detect.json` last: a folder with a summary is complete. With `force` the files of
an older result are first moved aside into it, and back if that fails. Only names that this program writes are ever
replaced; other hidden files are left alone. What a killed process, or a disk that failed, left is settled by the next:

    .fg-nav-new-*          its output: removed
    .fg-nav-new-*/.old     an older result on its way aside: restored
    .fg-nav-new-*/.past    an older result that is aside: the new files move on to their places

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

# Every file name that a command of the library writes into the folder of a result.
RESULT_FILES = frozenset(
    {
        "trajectory.tum", "strides.csv", "gait.csv", "online.csv", "summary.json", "config.json", "report.html",
        "trajectory_polished.tum", "strides_polished.csv",
        "trajectory.png", "heading.png", "gyro_bias.png", "stance_statistic.png",
        "comparison.csv", "comparison.json", "trajectories.png", "errors.png",
        "person.csv", "trajectory_left.tum", "trajectory_right.tum", "strides_left.csv", "strides_right.csv",
        "online_left.csv", "online_right.csv",
    }
)  # fmt: skip

NEW, OLD, PAST = ".fg-nav-new-", ".old", ".past"  # Prefix of a hidden folder, and folders in it.


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
    """Make a folder and lock it while the block runs, after settling what a killed process left in it.

    `force`: an older result may be replaced; `ours`: names of files that make one.

    Raises `OutputError` as `result_folder` does. A folder that was made for the block is removed if it stays empty.
    """
    made = not out.exists()
    descriptor, _ = lock_result(out)
    try:
        with suppress(OSError):
            _settle_left(out)
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
            # the older result aside, its summary first; from the last move on the new one takes its place
            (fresh / OLD).mkdir()
            try:
                for entry in reversed(_list_visible(out)):
                    os.replace(entry, fresh / OLD / entry.name)
                os.replace(fresh / OLD, fresh / PAST)
            finally:
                try:
                    _settle(fresh, out)
                except OSError as error:
                    aside = fresh / (PAST if (fresh / PAST).exists() else OLD)
                    where = f" Files of the older result are in {aside}." if any(aside.iterdir()) else ""
                    raise OutputError(f"{unwritable(out, error)}{where}") from None
    except OSError as error:
        raise unwritable(out, error) from None


@contextmanager
def _open_fresh(parent: Path) -> Iterator[Path]:
    """Yield a hidden folder, which is locked, and removed at the end unless files of a result are still to be moved."""
    fresh = Path(tempfile.mkdtemp(prefix=NEW, dir=parent))
    descriptor, _ = lock_folder(fresh)
    try:
        yield fresh
    finally:
        if not any((fresh / name).exists() for name in (OLD, PAST)):
            shutil.rmtree(fresh, ignore_errors=True)
        os.close(descriptor)


def _settle(fresh: Path, out: Path) -> None:
    """Move the older result back, or the new one on, as far as each was moved; remove the hidden folder."""
    for entry in _list_visible(fresh if (fresh / PAST).exists() else fresh / OLD):
        os.replace(entry, out / entry.name)
    shutil.rmtree(fresh, ignore_errors=True)


def _settle_left(parent: Path) -> None:
    """Settle the hidden folders of ended processes; none where the disk has no locks."""
    for fresh in sorted(parent.glob(f"{NEW}*")):
        with suppress(OSError):  # a running process, or another user's
            descriptor, locks = lock_folder(fresh)
            try:
                if locks:
                    _settle(fresh, parent)
            finally:
                os.close(descriptor)


def check_free(out: Path, force: bool = False, ours: frozenset[str] = RESULT_FILES) -> None:
    """Refuse early, before long work, an `out` that cannot be used; raises `OutputError` as `result_folder` does."""
    try:
        _refuse_file(out)
        present, foreign = _list_visible(out), []
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
    """Make, hold and yield the first of `parent/name-1`, `-2`, ... that is new; it is removed if it stays empty.

    Raises `OutputError` if none can be made.
    """
    for number in count(1):
        out = parent / f"{name}-{number}"
        try:
            out.mkdir(parents=True)  # of two processes one makes it, also on a disk without locks
            break
        except FileExistsError:
            continue
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


def _list_visible(folder: Path) -> list[Path]:
    """Entries of a folder by name, summaries last, without hidden ones; none where there is no such folder."""
    entries = sorted(folder.iterdir()) if folder.exists() else []
    found = [entry for entry in entries if not entry.name.startswith(".")]
    return sorted(found, key=lambda entry: entry.name in _SUMMARIES)


@contextmanager
def result_file(out: Path, ours: Callable[[Path], bool], force: bool = False) -> Iterator[Path]:
    """Yield a path to write to; at the end of the block that file takes the place of `out`, as in `result_files`."""
    with result_files([out], ours, force) as (fresh,):
        yield fresh


@contextmanager
def result_files(out: Sequence[Path], ours: Callable[[Path], bool], force: bool = False) -> Iterator[list[Path]]:
    """Yield paths to write to; at the end of the block these files take the places of `out`, all in one folder.

    With `force` existing files are replaced, if by `ours` they are older results. Raises `OutputError` if one exists
    and `force` is not set, or is something else: then none of them takes its place. Where the disk fails while they are
    moved, those moved before stay. A file that another process makes between the last check and the move is replaced.
    """
    for file in out:
        check_file_free(file, ours, force)
    parent = out[0].parent
    try:
        parent.mkdir(parents=True, exist_ok=True)
        _settle_left(parent)
        with _open_fresh(parent) as folder:
            fresh = [folder / file.name for file in out]
            yield fresh
            for file in out:  # which another process may have made meanwhile
                check_file_free(file, ours, force)
            for made, file in zip(fresh, out, strict=True):
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
