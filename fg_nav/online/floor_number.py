"""Which floor of a building the newest footfall is on: 0 where the walk began, +1 the next above, -1 the next below.

A walk that is solved as a whole shows level floors (`smoother.floors`) and their heights; footfalls since are followed
by their heights z, m, less a drift that all of them share and that those on a floor show:

    on a floor       while z changes by less than `STEP_M` from one footfall to the next, and is within `SAME_M` of it
    on none          otherwise: on stairs or a ramp, or in a lift
    on one again     once `FEWEST` footfalls are within `STEP_M`: on the nearest within `SAME_M`, else on a new one

Floors are numbered from the start outward, up and down: the next number begins `STOREY_M` above the lowest floor of the
one before, and a landing from `LANDING_M` on below that has none. So a kerb, and a floor that is met again at another
height, begin no new number; a storey that is passed without four footfalls on it is left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.smoother.floors import FEWEST

STEP_M = 0.08  # Between two footfalls on one floor: half a riser.
SAME_M = 0.5  # A floor is found again within this: by so much heights drift on a way over stairs.
DRIFT_SHARE = 0.1  # Of a footfall's height above its floor that is drift: a slope of 4 % is followed at `SAME_M`.
STOREY_M = 2.0  # From a storey to the next at least: a low cellar.
LANDING_M = 1.0  # From a storey to a landing at least: they are halfway.


@dataclass(frozen=True)
class FloorTrack:
    """Heights m of the floors so far, the first that of the start; on which of them the newest footfall is.

    `on` is None on no floor; `drift` m is that of heights since; `recent` are those of the newest `FEWEST` footfalls.
    """

    floors: tuple[float, ...] = (0.0,)
    on: int | None = 0
    drift: float = 0.0
    recent: tuple[float, ...] = (0.0,) * FEWEST

    def add(self, height: float) -> FloorTrack:
        """Return it with the next footfall, at a height in m."""
        recent = (*self.recent[1:], height)
        if self.on is not None and abs(height - self.recent[-1]) < STEP_M:
            above = height - self.drift - self.floors[self.on]
            if abs(above) < SAME_M:
                return replace(self, drift=self.drift + DRIFT_SHARE * above, recent=recent)
        if max(recent) - min(recent) > STEP_M:
            return replace(self, on=None, recent=recent)
        # On a floor again: the nearest, or a new one.
        level = float(np.mean(recent)) - self.drift
        nearest = min(range(len(self.floors)), key=lambda k: abs(self.floors[k] - level))
        if abs(self.floors[nearest] - level) < SAME_M:
            return replace(self, on=nearest, recent=recent)
        return FloorTrack((*self.floors, level), len(self.floors), self.drift, recent)

    @property
    def number(self) -> int | None:
        """Number of the floor of the newest footfall; None where it is on none."""
        return None if self.on is None else number_floors(self.floors)[self.on]


def track_floors(heights: Floats, floor: Ints | None, is_piece: Sequence[bool] | Bools) -> FloorTrack:
    """Return the floor track of a walk solved as a whole, at its newest footfall.

    Parameters
    ----------
    heights : (F,) m of its footfalls.
    floor : (F,) number of the level floor of each, -1 on none; None where they were not looked for.
    is_piece : (F,) which footfalls are further pieces of a standing: they say nothing of the ground.
    """
    floor = np.full(len(heights), -1) if floor is None else floor
    levels = tuple(float(heights[floor == k].mean()) for k in range(floor.max(initial=-1) + 1))
    track = FloorTrack((0.0, *levels))
    for height, label, piece in zip(heights.tolist(), floor.tolist(), is_piece, strict=True):
        track = track if piece else track.add(height)
        track = track if label < 0 else replace(track, on=label + 1, drift=0.0)
    return track


def number_floors(heights: Sequence[float]) -> list[int | None]:
    """Return the number of each floor at these heights, m above the start; None for a landing between storeys."""
    z = np.array(heights)
    number: list[int | None] = [0] * len(z)
    for way in (1, -1):
        lowest, count = 0.0, 0
        for k in np.argsort(way * z).tolist():
            above = way * z[k] - lowest
            if above >= STOREY_M:
                lowest, count, above = way * z[k], count + way, 0.0
            if way * z[k] > 0.0:
                number[k] = None if above > LANDING_M else count
    return number
