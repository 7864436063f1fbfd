"""Whether a field was truly quasi-static, from the field itself at the footfalls.

A detector looks at the N steps between the N + 1 stances up to the one it judges. The field of such a window is
truly quasi-static if it is the same at all of its stances, up to a limit: with b_i the true field there, in nav,

    change_k = max |b_i - b_j|    over all pairs    k - N <= i < j <= k.

All pairs, and not the steps alone: a field that creeps one way is not static, and a compass that was trusted over the
window is off by the whole change. Two measures are offered, and the parts of the first:

============= ===== ===============================================================================================
vector_uT     uT    of the whole vector. Nothing that a magnetometer could see changed by more
heading       rad   of its direction over the ground: by how much a compass changes its mind, the foot held still
inclination   rad   of its angle below the horizon
strength_uT   uT    of its length
============= ===== ===============================================================================================

A limit on the vector bounds the rest: with horizontal strength H, heading changes by asin(limit / H) at most.
Static is not right: a field can differ from the Earth's and stay so. By how much a compass is then wrong is
`compass_deviation`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations
from typing import TypeAlias

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.errors import EvaluationError
from fg_nav.frames import wrap
from fg_nav.magnetic.compass import inclination_of

_Distance: TypeAlias = Callable[[Floats, Floats], Floats]


@dataclass(frozen=True)
class FieldChange:
    """Largest changes (F,) of the true field over the window of each stance; NaN before the first whole window."""

    vector_uT: Floats
    heading: Floats
    inclination: Floats
    strength_uT: Floats

    @property
    def known(self) -> Bools:
        """(F,) True where the window was whole."""
        return np.isfinite(self.vector_uT)


def field_change(nav_field: Floats, window: int) -> FieldChange:
    """Follow the true field from stance to stance.

    Parameters
    ----------
    nav_field : (F, 3) uT, true, in nav, at the footfalls.
    window : N, the steps in it.

    Raises
    ------
    EvaluationError
        For a window of no step, or a walk that is shorter than one window.
    """
    if window < 1 or len(nav_field) <= window:
        raise EvaluationError(
            f"a window of {window} steps cannot be laid over {len(nav_field)} stances: "
            f"it needs one step, and {window + 1} stances."
        )
    strength = np.linalg.norm(nav_field, axis=1)
    return FieldChange(
        vector_uT=_largest(nav_field, window, lambda a, b: np.linalg.norm(a - b, axis=1)),
        heading=_largest(_bearing(nav_field), window, lambda a, b: np.abs(wrap(a - b))),
        inclination=_largest(inclination_of(nav_field), window, lambda a, b: np.abs(a - b)),
        strength_uT=_largest(strength, window, lambda a, b: np.abs(a - b)),
    )


def compass_deviation(nav_field: Floats, earth_field: Floats) -> Floats:
    """Error (F,) rad of the heading that a perfect compass shows in `nav_field` (F, 3) uT, clockwise.

    `earth_field` (3,) or (F, 3) is the field without what deviates it.
    """
    return wrap(_bearing(earth_field) - _bearing(nav_field))


def course_change(position: Floats, window: int) -> Floats:
    """Largest difference (F,) rad between the directions of any two of a window's N steps; NaN before the first.

    `position` (F, 3) m, true, at the footfalls. With one step in the window it is 0.

    Raises
    ------
    EvaluationError
        As `field_change`.
    """
    if window < 1 or len(position) <= window:
        raise EvaluationError(f"a window of {window} steps cannot be laid over {len(position)} stances: walk farther.")
    course = _bearing(np.diff(position, axis=0))
    change = _largest(course, window - 1, lambda a, b: np.abs(wrap(a - b)))
    return np.concatenate([[np.nan], change])


def _bearing(vector: Floats) -> Floats:
    """Direction (...,) rad over the ground of (..., 3), clockwise from north."""
    return np.asarray(np.arctan2(vector[..., 0], vector[..., 1]))


def _largest(values: Floats, window: int, distance: _Distance) -> Floats:
    """Largest distance (F,) between any two of the `window` + 1 values up to each; NaN before."""
    count = len(values) - window
    at = [values[lag : lag + count] for lag in range(window + 1)]
    largest = np.zeros(count)
    for a, b in combinations(at, 2):
        largest = np.maximum(largest, distance(a, b))
    return np.concatenate([np.full(window, np.nan), largest])
