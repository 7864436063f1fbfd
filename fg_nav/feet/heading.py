"""How the sensors of two feet are turned to each other: by the directions of the steps that both take in turn."""

from __future__ import annotations

import numpy as np

from fg_nav.errors import EstimationError
from fg_nav.feet.steps import Footfalls, measure_turns

SPAN_S = 60.0  # From the first step on: later a path that was found alone is turned by the drift of its gyroscope.


def measure_relative_heading(right: Footfalls, left: Footfalls) -> float:
    """Heading of the right sensor's x axis at its start less that of the left one's, rad clockwise.

    Both paths begin with the same heading of their sensors. Behind a hole in a recording its path is turned by
    anything: steps before the first one are taken, where there are any.

    Raises `EstimationError` where no step of the one foot lies between two of the other.
    """
    t, turn = measure_turns(right, left)
    if not len(t):
        raise EstimationError(
            "the two feet take no step in turn: are they of one person at one time, and their clocks aligned? "
            "Run each of them by itself, or give --clock-offset."
        )
    first_hole = np.concatenate([right.holes, left.holes]).min(initial=np.inf)
    end = min(t[0] + SPAN_S, first_hole if first_hole > t[0] else np.inf)
    return float(np.angle(np.sum(turn[t < end])))
