"""The first and the last stance: where navigation begins, and beyond which it is frozen.

In the first the foot stands, so the mean specific force points up and levels the sensor; the heading is given, or zero.
A rest (`fg_nav.detection.rest`) in the first footfall shows the gyro bias, and in the first stance it levels better.

Before the first stance and after the last nothing bounds the motion. Within the longest swing of them the samples are
integrated like any others. Beyond, the error of a free strapdown grows with the square of the time, to kilometres in
half a minute: the path is frozen where it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.detection import Rest, RestParameters, find_rests
from fg_nav.detection.footfalls import LONGEST_SWING_S
from fg_nav.errors import EstimationError
from fg_nav.frames import levelled
from fg_nav.recording import Recording
from fg_nav.stances import Stances

LEAST_FORCE_M_S2 = 1.0
"""A mean specific force below this has no direction worth the name."""


LONGEST_FREE_S = LONGEST_SWING_S
"""No foot of a walking or running person is in the air for longer."""


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


def find_start(
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
    first = find_first_stance(recording, stances)
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


def find_first_stance(recording: Recording, stances: Stances) -> slice:
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


def freeze_ends(t: Floats, stances: Stances, position: Floats, velocity: Floats) -> tuple[str, ...]:
    """Freeze position (N, 3) and velocity (N, 3) beyond the outermost stances; notes of how long."""
    first = int(np.searchsorted(t, t[stances.start[0]] - LONGEST_FREE_S))
    last = int(np.searchsorted(t, t[stances.stop[-1] - 1] + LONGEST_FREE_S, side="right")) - 1
    position[:first], velocity[:first] = position[first], 0.0
    position[last + 1 :], velocity[last + 1 :] = position[last], 0.0
    held = ((t[first] - t[0], "before the first"), (t[-1] - t[last], "after the last"))
    return tuple(f"{seconds:.1f} s {where} footfall are not navigated" for seconds, where in held if seconds > 0)
