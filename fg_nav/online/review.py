"""The footfalls of a walk in progress, seen again in hindsight: false ones are taken out, missed ones put in.

While a person walks a footfall is reported before it is known how the walk goes on. Stances are detected again in all
samples so far, as in a recording. A footfall that shares no sample with any of those was none. One of those that shares
none with a footfall was missed. What ends less than `OPEN_S` before the last sample stays as it was.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fg_nav.detection import detect_stances
from fg_nav.detection.causal import Footfall
from fg_nav.detection.stance import StanceParameters
from fg_nav.errors import DetectionError
from fg_nav.online.buffer import ReportedFootfall
from fg_nav.recording import Recording
from fg_nav.stances import Stances

OPEN_S = 1.5  # A swing and the beginning of the stance after it: by then a footfall has been seen from both sides.
UNTOLD = -1  # Number of the line of a footfall that had none.


def review_footfalls(
    recording: Recording, first: int, footfalls: Sequence[ReportedFootfall], parameters: StanceParameters
) -> list[ReportedFootfall]:
    """Return the footfalls of a walk as they are seen now.

    Parameters
    ----------
    recording : samples of the walk from number `first` on.
    footfalls : in it, in order.
    """
    try:
        stances = detect_stances(recording, parameters)
    except DetectionError:
        return list(footfalls)
    open_from = first + int(np.searchsorted(recording.t, recording.t[-1] - OPEN_S))
    seen = _list_footfalls(stances, recording, first)
    begins = np.array([int(one.start[0]) for one in seen])
    ends = np.array([int(one.stop[-1]) for one in seen])
    kept: list[ReportedFootfall] = []
    matched: set[int] = set()
    for one in footfalls:
        start, stop = int(one.footfall.start[0]), int(one.footfall.stop[-1])
        alike = np.arange(np.searchsorted(ends, start, side="right"), np.searchsorted(begins, stop, side="left"))
        matched.update(alike.tolist())
        if len(alike) or stop > open_from or start < first:
            kept.append(one)
    missed = [
        ReportedFootfall(footfall, UNTOLD, int(footfall.stop[-1]) + 1)
        for k, footfall in enumerate(seen)
        if k not in matched and footfall.stop[-1] <= open_from
    ]
    return _put_in(kept, missed)


def _list_footfalls(stances: Stances, recording: Recording, first: int) -> list[Footfall]:
    """Footfalls of stances that begin with sample `first` of the walk."""
    stillest = stances.stillest(recording.gyr) + first
    edges = np.searchsorted(stances.footfall, np.arange(1, stances.n_footfalls))
    threshold = np.full(len(stances), np.nan if stances.threshold is None else stances.threshold)
    parts = (np.split(part, edges) for part in (stances.start + first, stances.stop + first, threshold))
    rows = zip(*parts, stillest.tolist(), strict=True)
    return [Footfall(start, stop, level, at, continues=False) for start, stop, level, at in rows]


def _put_in(kept: list[ReportedFootfall], missed: list[ReportedFootfall]) -> list[ReportedFootfall]:
    """Put missed footfalls where they belong, but those that overlap the next one's samples or those before."""
    both = sorted([*kept, *missed], key=lambda one: int(one.footfall.start[0]))
    found: list[ReportedFootfall] = []
    for one in both:
        if found and one.footfall.start[0] < found[-1].footfall.stop[-1]:
            continue
        until = max(one.until, found[-1].until) if found else one.until
        found.append(ReportedFootfall(one.footfall, one.told, until))
    return found
