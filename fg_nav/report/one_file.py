"""A result that is a single file appears whole or not at all, and never in place of something else."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from fg_nav.errors import OutputError
from fg_nav.report.folder import unwritable


@contextmanager
def result_file(out: Path, ours: Callable[[Path], bool], force: bool = False) -> Iterator[Path]:
    """Yield a path to write to; at the end of the block that file takes the place of `out`.

    Parameters
    ----------
    out : the file to make.
    ours : tells whether an existing file is an older result, and so may be replaced.
    force : replace an older result.

    Raises
    ------
    OutputError
        If `out` exists and `force` is not set, if it is something else, or cannot be written.
    """
    check_file_free(out, ours, force)
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".fg-nav-new-", dir=out.parent) as folder:
            fresh = Path(folder) / out.name
            yield fresh
            os.replace(fresh, out)
    except OSError as error:
        raise unwritable(out, error) from None


def check_file_free(out: Path, ours: Callable[[Path], bool], force: bool = False) -> None:
    """Say now, before long work, whether `out` can be written; raises `OutputError` as `result_file` does."""
    try:
        if out.is_dir():
            raise OutputError(f"{out} is a folder: name the file to write with --out.")
        if out.parent.exists() and not out.parent.is_dir():
            raise OutputError(f"{out.parent} is no folder: choose another --out.")
        if out.exists() and not ours(out):
            raise OutputError(f"{out} holds what this command does not write: choose another --out.")
        if out.exists() and not force:
            raise OutputError(f"{out} already exists: choose another --out, or replace it with --force.")
    except OSError as error:
        raise unwritable(out, error) from None
