"""What comes before the first footfall and after the last: motion that nothing bounds.

Within the longest swing of the outermost stances the samples are integrated like any others. Beyond, the error of a
free strapdown grows with the square of the time, to kilometres in half a minute: the path is held where it was.
"""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.detection.footfalls import LONGEST_SWING_S
from fg_nav.stances import Stances

LONGEST_FREE_S = LONGEST_SWING_S
"""No foot of a walking or running person is in the air for longer."""


def hold_tails(t: Floats, stances: Stances, position: Floats, velocity: Floats) -> tuple[str, ...]:
    """Hold position (N, 3) and velocity (N, 3) in place beyond the outermost stances; notes of how long."""
    first = int(np.searchsorted(t, t[stances.start[0]] - LONGEST_FREE_S))
    last = int(np.searchsorted(t, t[stances.stop[-1] - 1] + LONGEST_FREE_S, side="right")) - 1
    position[:first], velocity[:first] = position[first], 0.0
    position[last + 1 :], velocity[last + 1 :] = position[last], 0.0
    held = ((t[first] - t[0], "before the first"), (t[-1] - t[last], "after the last"))
    return tuple(f"{seconds:.1f} s {where} footfall are not navigated" for seconds, where in held if seconds > 0)
