"""The strides of a walk: when the foot swings, where it comes down, and in which manner.

This is all that foot and thigh share, and what a plan of a walk comes down to.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from fg_nav.arrays import Floats, Ints


class Style(IntEnum):
    """The manner of a stride; the gait of a person has parameters for each."""

    WALK = 0
    RUN = 1
    STAIRS_UP = 2
    STAIRS_DOWN = 3
    TURN = 4  # on the spot


@dataclass(frozen=True)
class Strides:
    """K strides of one foot; in pauses between them it stands.

    Attributes
    ----------
    start, duration : (K,) s; a stride lasts from the beginning of its swing (heel-off) to the end of the stance
        after it, so that start[k] + duration[k] <= start[k + 1]; the rest is standing.
    footprint : (K + 1, 3) m, where the foot stands before stride 0 and after each; z is the height of the floor.
    heading : (K + 1,) rad clockwise from north, of the foot at each footprint; unwrapped.
    style : (K,) of `Style`.
    end_s : when the recording ends; the foot stands from the last stride's end to then.
    """

    start: Floats
    duration: Floats
    footprint: Floats
    heading: Floats
    style: Ints
    end_s: float

    def __len__(self) -> int:
        return len(self.start)
