"""Where a filter begins: attitude and gyro bias from the first stance, and how far they can be trusted.

The foot stands, so the mean specific force points up and levels the sensor; the heading is given, or zero. A rest
(`fg_nav.detection.rest`) in the first footfall shows the gyro bias, and in the first stance it levels better.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.detection import Rest, RestParameters, find_rests
from fg_nav.errors import EstimationError
from fg_nav.frames import levelled
from fg_nav.recording import Recording
from fg_nav.stances import Stances

LEAST_FORCE_M_S2 = 1.0
"""A mean specific force below this has no direction worth the name."""


@dataclass(frozen=True)
class Start:
    """Where navigation begins: at sample `row` with this attitude.

    `rest` is the rest of the first footfall, if there is one, and `rests` are those of the whole recording.
    """

    row: int
    nav_R_body: Floats
    levelled_at_rest: bool
    rest: Rest | None
    rests: tuple[Rest, ...]


def starting_point(
    recording: Recording,
    stances: Stances,
    heading: float = 0.0,
    parameters: RestParameters = RestParameters(),
) -> Start:
    """Level the sensor in its first stance, and find the rest in it.

    Parameters
    ----------
    recording, stances
        Of the same length.
    heading : float
        Of the body's x axis at the start, rad clockwise from north.
    parameters : RestParameters

    Raises
    ------
    EstimationError
        Without a stance, on stances of another recording, or where the specific force vanishes.
    """
    first = first_stance(recording, stances)
    footfall = slice(first.start, int(stances.stop[stances.footfall == 0][-1]))
    rests = find_rests(recording, parameters)
    level, rest = _longest_within(first, rests), _longest_within(footfall, rests)
    force = recording.acc[first].mean(axis=0) if level is None else level.force
    if np.linalg.norm(force) < LEAST_FORCE_M_S2:
        raise EstimationError(
            f"the mean specific force in the first stance, at {recording.t[first.start]:.3f} s, is "
            f"{np.linalg.norm(force):.2f} m/s^2, so there is no up: accelerations must include gravity."
        )
    return Start(first.start, levelled(force, heading), level is not None, rest, rests)


def first_stance(recording: Recording, stances: Stances) -> slice:
    """Return the samples of the first stance; `EstimationError` without one, or with stances of another walk."""
    if stances.n_samples != len(recording):
        raise EstimationError(
            f"the stances belong to {stances.n_samples} samples and the recording has {len(recording)}: "
            "detect the stances on this recording."
        )
    if len(stances) == 0:
        raise EstimationError("there is no stance to start from: check the stance detection.")
    return slice(int(stances.start[0]), int(stances.stop[0]))


def _longest_within(span: slice, rests: tuple[Rest, ...]) -> Rest | None:
    """Return the longest rest with its middle in a span of samples."""
    inside = [rest for rest in rests if span.start <= (rest.start + rest.stop) // 2 < span.stop]
    return max(inside, key=lambda rest: rest.stop - rest.start, default=None)
