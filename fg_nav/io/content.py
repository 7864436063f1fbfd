"""What can be told of a file before it is read: its first lines, or the names of its variables.

Formats are recognised from this alone, never from the file's name.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

from fg_nav.errors import FormatError
from fg_nav.io.mat import is_mat, variable_names

_HEAD_BYTES = 65536


@dataclass(frozen=True)
class Content:
    """The beginning of a file: `lines` of text or `variables` of a MATLAB file; both empty for neither."""

    path: Path
    lines: tuple[str, ...] = ()
    variables: frozenset[str] = frozenset()

    def fields(self, line: int = 0) -> list[str]:
        """Comma-separated fields of one of the first lines, stripped; empty if there is no such line."""
        return split_fields(self.lines[line]) if line < len(self.lines) else []


def split_fields(line: str) -> list[str]:
    """Comma-separated fields of a line, quotes and surrounding blanks removed."""
    try:
        return [field.strip() for field in next(csv.reader([line]), [])]
    except csv.Error:
        return []


def look(path: Path) -> Content:
    """Open a file and see what it is made of.

    Raises
    ------
    FormatError
        If the path is no readable file, or the file is empty.
    """
    head = _head(path)
    if not head.strip():
        raise FormatError(f"{path.name} is empty: record or export it again.")
    if is_mat(head):
        return Content(path, variables=variable_names(path))
    if b"\0" in head:
        return Content(path)
    return Content(path, lines=tuple(_decoded(head).splitlines()))


def _head(path: Path) -> bytes:
    if path.is_dir():
        raise FormatError(f"{path} is a directory: give one of the files in it.")
    try:
        with path.open("rb") as file:
            return file.read(_HEAD_BYTES)
    except FileNotFoundError:
        raise FormatError(f"{path} does not exist: check the path.") from None
    except PermissionError:
        raise FormatError(f"{path} may not be read: check its permissions.") from None
    except (OSError, ValueError) as error:
        raise FormatError(f"{path} cannot be opened ({error}): check the path.") from None


def _decoded(head: bytes) -> str:
    """Text of the head. A byte that is no UTF-8 (a degree or micro sign, mostly) is taken as Latin-1."""
    if len(head) == _HEAD_BYTES:  # a character may be cut in two at the end
        head = head[: head.rfind(b"\n") + 1] or head
    try:
        return head.decode("utf-8-sig")
    except UnicodeDecodeError:
        return head.decode("latin-1").removeprefix("ï»¿")
