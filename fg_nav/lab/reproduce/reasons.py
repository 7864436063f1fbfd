"""Reasons why a figure of ours is off the printed one, each for the field and the side that it was looked at on.

A reason that was found for a filter that is worse than printed does not explain one that is better, and what holds on
one floor need not on another: there it is left out, and the figure stays unexplained.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from fg_nav.lab.reproduce.results import one_line

ABOVE, BELOW = 1, -1
"""Where ours lies of the printed figure."""


@dataclass(frozen=True)
class Reason:
    """A text, the side on which it was checked, and in which field; "" for each or for none."""

    text: str
    side: int
    field: str = ""


def reason_for(reasons: Sequence[Reason], field: str, off: float) -> str:
    """Text of the first reason for this field and a median so far above the printed figure; "" where there is none.

    A filter that failed is infinitely far off, and none of the reasons is of that.
    """
    held = (one.text for one in reasons if one.field in ("", field) and 0.0 < off * one.side < math.inf)
    return one_line(next(held, ""))
