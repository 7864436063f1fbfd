"""Options of one sensor where there are two, on the command line: refused, or two files with a comma between."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from fg_nav.errors import EstimationError


def refuse_for_two(given: Mapping[str, object]) -> None:
    """Raise `EstimationError` for the first of these options, by name, that is not None."""
    for option, value in given.items():
        if value is not None:
            raise EstimationError(f"{option} is for one sensor: leave it out with --mount feet.")


def split_pair(files: Path) -> tuple[Path, Path] | None:
    """Split two files with a comma between; None where they are not two."""
    first, _, second = str(files).partition(",")
    if not (first and second) or "," in second:
        return None
    return Path(first), Path(second)
