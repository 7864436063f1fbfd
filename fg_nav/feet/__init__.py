"""Two feet of one person: their steps, the clocks of their sensors, and which foot is which.

========= ================================================================================================
`steps`   which footfalls are beside each other, in the mean over cells; how both sensors are turned by them
`clocks`  offset and rate of one sensor's clock against the other's, by the swings
`person`  the path between both feet
========= ================================================================================================

Everything here is numpy: no graph and no estimator. The two feet in one graph are `fg_nav.smoother.feet`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Literal, TypeAlias

from fg_nav.errors import EstimationError

Side: TypeAlias = Literal["left", "right"]

SIDES: tuple[Side, Side] = ("left", "right")  # Where both are listed, the left one is first.


def refuse_for_two(given: Mapping[str, object]) -> None:
    """Raise `EstimationError` for the first of these options of one sensor, by name, that is not None."""
    for option, value in given.items():
        if value is not None:
            raise EstimationError(f"{option} is for one sensor: leave it out with --mount feet.")


def split_pair(files: Path) -> tuple[Path, Path] | None:
    """Split two files with a comma between; None where they are not two."""
    first, _, second = str(files).partition(",")
    if not (first and second) or "," in second:
        return None
    return Path(first), Path(second)
