"""The field along a path, by the distance that was walked.

Symbols: distance d (m, horizontal, along the path), position p (m), attitude R = nav_R_body, body field m (uT),
direction of walking u (unit vector, level), l to its left. Frames: nav is East-North-Up (`fg_nav`).

The field is averaged over distance, not over time. Over a piece of the path from d to d + D

    b(d) = (1 / D) integral of R m dd        over all samples between,

so that a foot counts while it moves and a stance, however long, is one point of the path. By components

    b_along = b . u,    b_left = b . l,    b_up.

D b_along is the step of the magnetic potential, which does not depend on the way between its ends, nor much on the
height of the swing. This mean repeats; the value at a footfall does not: on simulated rough floors whose passes lie
0.35 m (rms) aside of each other, the coherence of two passes at wavelengths of 5 to 10 m is 0.92-0.95, 0.7-0.8,
0.6-0.9 (along, left, up) of the mean over distance, and 0.70, 0.5, 0.6 of footfall values
(`scripts/place_recognition.py coherence`).

The components turn with the path. A heading of the path that is wrong by a constant or a slow drift changes none of
them. The walking direction is that of a chord of 3 m, which does not follow the steps. In reverse of the walk b_along
and b_left change sign and b_up does not.

What the Earth's field adds to b_along and b_left follows from the direction of walking alone; it is left in here and
taken out, with the iron of the shoe, in `whitening`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Bools, Floats, interpolate_columns
from fg_nav.system.spilled import BLOCK_ROWS, drop_pages, empty_column

SPACING_M = 0.5  # Of the points along the path: four to the shortest wavelength that repeats (`whitening`).
BLOCK = 8  # Points of a block, 4 m, the smallest piece that candidates are made of.
CHORD_M = 3.0  # Whose direction is that of walking: two strides.

MAX_UNREAD_M = 0.5
"""Distance from a point to the nearest reading of the magnetometer, beyond which the field there is not known."""

MIN_POINTS = 40  # A path of less than 20 m is no path to return on.


@dataclass(frozen=True)
class Signature:
    """The field along a path, at K points that are `SPACING_M` apart.

    Attributes
    ----------
    distance_m : (K,) walked so far.
    t : (K,) s, when the middle of the piece was passed.
    position : (K, 3) m in nav.
    heading : (K,) rad, counterclockwise from east: the direction of walking.
    field : (K, 3) uT along the walking direction, to its left, and up.
    seen : (K,) whether the magnetometer read there.
    """

    distance_m: Floats
    t: Floats
    position: Floats
    heading: Floats
    field: Floats
    seen: Bools

    def __len__(self) -> int:
        return len(self.t)


def trace_signature(t: Floats, position: Floats, nav_R_body: Floats, mag: Floats) -> Signature:
    """Average the field over the distance along a path.

    Parameters
    ----------
    t : (N,) s, rising.
    position : (N, 3) m in nav, of the sensor at each sample.
    nav_R_body : (N, 3, 3) its attitude.
    mag : (N, 3) uT, calibrated body field; NaN rows where there is no reading.
    """
    read = np.asarray(np.isfinite(mag).all(axis=1))
    walked = _measure_walked(position)
    edges = np.arange(0.0, walked[-1], SPACING_M)
    if read.sum() < 2 or len(edges) <= MIN_POINTS:
        return _empty_signature()
    nav_field = _turn_into_nav(t, nav_R_body, mag, read)
    # Of each piece the means over distance: exact differences of line integrals, whatever the sample rate.
    middle = 0.5 * (edges[1:] + edges[:-1])
    place, field = _average(walked, position, edges), _average(walked, nav_field, edges)
    u = _walking_direction(place[:, :2])
    seen = _distance_to_nearest(middle, walked[read]) < MAX_UNREAD_M
    return Signature(
        distance_m=middle,
        t=_at_distance(walked, t[:, None], middle)[:, 0],
        position=place,
        heading=np.unwrap(np.arctan2(u[:, 1], u[:, 0])),
        field=_resolve(field, u),
        seen=seen,
    )


def _list_blocks(count: int) -> Iterator[slice]:
    """Yield blocks of rows that each begin with the last of the one before."""
    return (slice(start, start + BLOCK_ROWS + 1) for start in range(0, max(count - 1, 1), BLOCK_ROWS))


def _measure_walked(position: Floats) -> Floats:
    """Distance (N,) m over ground along a path (N, 3)."""
    walked = np.zeros(len(position))
    for part in _list_blocks(len(position)):
        place = position[part, :2]
        walked[part][1:] = walked[part.start] + np.cumsum(np.linalg.norm(np.diff(place, axis=0), axis=1))
        drop_pages()
    return walked


def _turn_into_nav(t: Floats, nav_R_body: Floats, mag: Floats, read: Bools) -> Floats:
    """Field (N, 3) in nav at all samples, where there is no reading by those around."""
    field = empty_column(len(t), 3)
    for part in _list_blocks(len(t)):
        field[part] = np.einsum("nij,nj->ni", nav_R_body[part], mag[part])
        drop_pages()
    if not read.all():
        for column in field.T:
            column[~read] = np.interp(t[~read], t[read], column[read])
    return field


def _resolve(nav_field: Floats, u: Floats) -> Floats:
    """Components (K, 3) of a field in nav (K, 3) along directions (K, 2), to their left, and up."""
    along = (nav_field[:, :2] * u).sum(axis=1)
    left = u[:, 0] * nav_field[:, 1] - u[:, 1] * nav_field[:, 0]
    return np.stack([along, left, nav_field[:, 2]], axis=1)


def _average(walked: Floats, values: Floats, edges: Floats) -> Floats:
    """Means (K, c) over distance of values (N, c) that were read at distances (N,), between edges (K + 1,)."""
    integral, total = np.zeros((len(edges), values.shape[1])), np.zeros((1, values.shape[1]))
    for part in _list_blocks(len(walked)):
        d, value = walked[part], values[part]
        steps = 0.5 * (value[1:] + value[:-1]) * np.diff(d)[:, None]
        sums = np.concatenate([total, total + np.cumsum(steps, axis=0)])
        inside = (edges >= d[0]) & (edges <= d[-1])
        integral[inside] = _at_distance(d, sums, edges[inside])
        total = sums[-1:]
        drop_pages()
    return np.asarray(np.diff(integral, axis=0) / SPACING_M)


def _at_distance(walked: Floats, values: Floats, asked: Floats) -> Floats:
    """Values (K, c) at distances (K,); those of a standing are those of its begin."""
    distinct, first = np.unique(walked, return_index=True)
    return interpolate_columns(asked, distinct, values[first])


def _walking_direction(place: Floats) -> Floats:
    """Unit vectors (K, 2) of chords about places (K, 2)."""
    reach, last = round(CHORD_M / SPACING_M / 2), len(place) - 1
    i = np.arange(len(place))
    chord = place[np.minimum(i + reach, last)] - place[np.maximum(i - reach, 0)]
    length = np.linalg.norm(chord, axis=1, keepdims=True)
    return np.asarray(np.where(length > 0.0, chord / np.maximum(length, 1e-9), [1.0, 0.0]))


def _distance_to_nearest(asked: Floats, known: Floats) -> Floats:
    after = np.clip(np.searchsorted(known, asked), 1, len(known) - 1)
    return np.minimum(np.abs(asked - known[after - 1]), np.abs(asked - known[after]))


def _empty_signature() -> Signature:
    none = np.zeros(0)
    return Signature(none, none, np.zeros((0, 3)), none, np.zeros((0, 3)), np.zeros(0, dtype=bool))
