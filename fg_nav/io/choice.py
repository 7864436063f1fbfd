"""One of several sensors in a file: the user names it, by its name or a part of it that no other has."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from fg_nav.errors import FormatError


def choose_sensor(
    names: Sequence[str], asked: str | None, path: Path, what: str = "sensors", before: str = "`--sensor "
) -> str:
    """Choose one of the names (at least one), or the only one there is; `before` it stands what the user is to type.

    Raises `FormatError` if there are several and none is asked for, or what is asked for is not one of them.
    """
    if asked is None:
        if len(names) == 1:
            return names[0]
        example = next((name for name in names if "foot" in name.lower()), names[0])
        raise FormatError(
            f"{path.name} holds {len(names)} {what} ({', '.join(names)}): name one, such as "
            f"{before}{shlex.quote(example)}`."
        )
    same = [name for name in names if name.lower() == asked.lower()]
    alike = same or [name for name in names if asked.lower() in name.lower()]
    if len(alike) != 1:
        raise FormatError(f"{path.name} has no one '{asked}' among its {what}: choose one of {', '.join(names)}.")
    return alike[0]
