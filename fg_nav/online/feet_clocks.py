"""Whether the clocks of two feet in progress fit, by their first steps (`feet.clocks`).

Nothing is set on while it is walked; it is said once, with the offset to begin again with.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fg_nav.errors import EstimationError
from fg_nav.feet.clocks import Swings, match_swings
from fg_nav.feet.steps import SHORT_M, find_longest_stride
from fg_nav.frames import compute_heading
from fg_nav.online.estimates import EstimateRow, split_rows

ENOUGH_SWINGS = 20  # Of each foot, that show it; some of them in a bend.


def check_clocks(left: Sequence[EstimateRow], right: Sequence[EstimateRow], given_s: float) -> str | None:
    """Say that the clocks do not fit; empty where they do, None where the footfalls so far are too few to show it.

    `given_s` was added to the right foot's stamps.
    """
    swings = [list_told_swings(rows) for rows in (left, right)]
    if min(len(one.middle) for one in swings) < ENOUGH_SWINGS:
        return None
    try:
        clocks = match_swings(*swings)
    except EstimationError as error:
        return f"the clocks of both feet do not fit: {error}"
    if not clocks.note:
        return ""
    offset = clocks.offset_s
    fast = f" and drift by {100.0 * clocks.drift:+.2f} %, which a stream does not mend" if clocks.drift else ""
    return (
        f"the clocks of both feet are {abs(offset):.2f} s apart{fast}, as their steps show: begin again with "
        f"--clock-offset {given_s + offset:.2f}"
    )


def list_told_swings(rows: Sequence[EstimateRow]) -> Swings:
    """List the swings between footfalls that were told; who stands has footfalls without one, every two seconds."""
    known = split_rows(rows)
    middle = 0.5 * (known.t[1:] + known.t[:-1])
    moved = np.linalg.norm(np.diff(known.position[:, :2], axis=0), axis=1)
    took = np.diff(known.t)
    longest = find_longest_stride(known.t)
    is_swing = (moved > SHORT_M) & (took < longest)
    heading = -np.unwrap(compute_heading(known.nav_R_body))  # counter-clockwise
    begins = np.concatenate([[-np.inf], known.t[:-1][took > longest], known.t[-1:]])
    ends = np.concatenate([known.t[:1], known.t[1:][took > longest], [np.inf]])
    return Swings(middle[is_swing], known.t, heading, np.stack([begins, ends], axis=1))
