"""Whether the clocks of two feet in progress fit, by their first steps (`feet.clocks`).

Nothing is set on while it is walked; it is said once, with the offset to begin again with.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fg_nav.errors import EstimationError
from fg_nav.feet.clocks import Swings, match_swings
from fg_nav.feet.steps import LONGEST_S, STRIDE_M
from fg_nav.frames import compute_heading
from fg_nav.online.estimates import EstimateRow, split_rows

ENOUGH_SWINGS = 20
"""Of each foot, that show it; some of them in a bend."""


def check_clocks(left: Sequence[EstimateRow], right: Sequence[EstimateRow], given_s: float) -> str | None:
    """Say that the clocks do not fit; empty where they do, None where the footfalls so far are too few to show it.

    `given_s` was added to the right foot's stamps.
    """
    swings = [list_told_swings(rows) for rows in (left, right)]
    if min(len(one.middle) for one in swings) < ENOUGH_SWINGS:
        return None
    try:
        offset = match_swings(*swings).offset_s
    except EstimationError as error:
        return f"the clocks of both feet do not fit: {error}"
    if offset == 0.0:
        return ""
    return (
        f"the clocks of both feet are {abs(offset):.2f} s apart, as their steps show: begin again with "
        f"--clock-offset {given_s + offset:.2f}"
    )


def list_told_swings(rows: Sequence[EstimateRow]) -> Swings:
    """List the swings between footfalls that were told; who stands has footfalls without one, every two seconds."""
    known = split_rows(rows)
    middle = 0.5 * (known.t[1:] + known.t[:-1])
    moved = np.linalg.norm(np.diff(known.position[:, :2], axis=0), axis=1)
    is_swing = (moved > STRIDE_M[0]) & (np.diff(known.t) < LONGEST_S)
    heading = -np.unwrap(compute_heading(known.nav_R_body))  # counter-clockwise
    unseen = np.diff(known.t) > LONGEST_S
    return Swings(middle[is_swing], known.t, heading, np.stack([known.t[:-1], known.t[1:]], axis=1)[unseen])
