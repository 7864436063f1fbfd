"""A hidden file in a folder tells which command filled it: what others put there is not touched, nor written beside."""

from __future__ import annotations

from collections.abc import Container
from pathlib import Path

CAMPAIGN, REPRODUCTION = ".fg-nav-campaign", ".fg-nav-reproduce"
MARKS = (CAMPAIGN, REPRODUCTION)


def lines_of(out: Path, mark: str) -> list[str]:
    """Return what the mark of a folder says; nothing where there is none."""
    path = out / mark
    return path.read_text(encoding="utf-8").splitlines() if path.is_file() else []


def visible(out: Path) -> list[str]:
    """Names in a folder that are not hidden, sorted; none where there is no folder."""
    return sorted(entry.name for entry in out.iterdir() if not entry.name.startswith(".")) if out.exists() else []


def stranger(out: Path, mark: str, ours: Container[str] = ()) -> str:
    """Name of something in a folder without our mark that is not ours, the mark of another command first."""
    if (out / mark).is_file():
        return ""
    others = [other for other in MARKS if other != mark and (out / other).is_file()]
    return next(iter([*others, *(name for name in visible(out) if name not in ours)]), "")
