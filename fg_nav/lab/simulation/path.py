"""A path over the ground by arc length: where a walk goes, before anybody walks it.

Symbols: arc length s (m, as on a map: height does not count), position (x, y, z) in nav, heading h (rad, clockwise
from north, unwrapped), curvature dh/ds (1/m, positive to the right). A path is a row of knots (s, position, heading).
Between two of them the heading is linear in s and the position the cubic with the knots' tangents (Hermite), dx/ds =
sin h and dy/ds = cos h; the height is linear. A piece of constant curvature dh/ds has the chord

    ds sinc(dh / 2) in the direction of its mean heading,    sinc(a) = sin(a) / a,

by which straight lines and arcs close exactly; on an arc with knots every 0.05 rad the cubic is within 1e-8 of the
radius. Winding paths are periodic cubic splines through their points, their length by Gauss-Legendre quadrature.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from fg_nav.arrays import Floats
from fg_nav.errors import SimulationError
from fg_nav.frames import wrap_angle

KNOT_RAD = 0.05  # Between the knots of an arc.
KNOT_M = 0.05  # Between the knots of a winding path.

GAP_M = 1e-3
KINK_RAD = 1e-3  # Paths join when they fit to within these: far above rounding, far below a foot.


@dataclass(frozen=True)
class Pose:
    """A place on the ground and a direction: `position` (3,) m in nav, `heading` rad clockwise from north."""

    position: Floats
    heading: float


def check_joint(what: str, end: Pose, start: Pose) -> float:
    """Return by how many rad the next path sets out to another side than the last one ended, next to none.

    Raises `SimulationError` for a gap of more than 1 mm or a kink of more than 1 mrad.
    """
    gap = float(np.linalg.norm(start.position - end.position))
    if gap > GAP_M:
        raise SimulationError(f"{what} leave a gap of {gap:.3g} m: move the second to the end of the first.")
    kink = float(wrap_angle(np.array(start.heading - end.heading)))
    if abs(kink) > KINK_RAD:
        raise SimulationError(
            f"{what} meet at an angle of {np.degrees(kink):.3g} deg: round the corner or turn on the spot."
        )
    return kink


@dataclass(frozen=True)
class Landmark:
    """A marked place of a path: its `name` and its arc length `arc` in m."""

    name: str
    arc: float


@dataclass(frozen=True)
class Path:
    """A curve over the ground."""

    arc: Floats  # (M,) m, rising from 0.
    position: Floats  # (M, 3) m.
    heading: Floats  # (M,) rad clockwise from north, unwrapped: the direction of the tangent.
    landmarks: tuple[Landmark, ...] = ()  # Marked places.

    @property
    def length_m(self) -> float:
        """Length in m, as on a map."""
        return float(self.arc[-1])

    @property
    def start(self) -> Pose:
        """Where the path begins."""
        return Pose(self.position[0], float(self.heading[0]))

    @property
    def end(self) -> Pose:
        """Where the path ends."""
        return Pose(self.position[-1], float(self.heading[-1]))

    def at(self, arc: ArrayLike) -> tuple[Floats, Floats]:
        """Position (N, 3) m and heading (N,) rad at arc lengths (N,) m; beyond the ends, those of the ends."""
        s = np.clip(np.asarray(arc, dtype=np.float64), 0.0, self.length_m)
        height = np.interp(s, self.arc, self.position[:, 2])
        return np.column_stack([self._level(s), height]), np.interp(s, self.arc, self.heading)

    @cached_property
    def _level(self) -> CubicHermiteSpline:
        tangent = np.stack([np.sin(self.heading), np.cos(self.heading)], axis=1)
        return CubicHermiteSpline(self.arc, self.position[:, :2], tangent)

    def curvature(self, arc: ArrayLike) -> Floats:
        """Curvature (N,) 1/m at `arc` (N,) m: constant between knots, positive to the right."""
        k = np.searchsorted(self.arc, np.asarray(arc, dtype=np.float64), side="right") - 1
        curvature: Floats = np.diff(self.heading) / np.diff(self.arc)
        return curvature[np.clip(k, 0, len(curvature) - 1)]

    def translate(self, by: Sequence[float] | Floats) -> Path:
        """The path moved by a vector (2,) or (3,) m."""
        shift = _as_points(np.asarray(by, dtype=np.float64)[None])[0]
        return replace(self, position=self.position + shift)

    def rotate(self, angle: float) -> Path:
        """The path turned clockwise by `angle` rad about the origin of nav, so that whole routes turn alike."""
        c, s = np.cos(angle), np.sin(angle)
        turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        return replace(self, position=self.position @ turn.T, heading=self.heading + angle)

    def place(self, pose: Pose) -> Path:
        """The path turned and moved so that it begins at `pose`."""
        turned = self.rotate(pose.heading - self.start.heading)
        return turned.translate(pose.position - turned.position[0])

    def reverse(self) -> Path:
        """The path in the opposite direction."""
        marks = tuple(replace(mark, arc=self.length_m - mark.arc) for mark in self.landmarks[::-1])
        return Path(self.length_m - self.arc[::-1], self.position[::-1], self.heading[::-1] + np.pi, marks)

    def then(self, other: Path) -> Path:
        """The path and then `other`, which begins where this one ends, in the same direction.

        Raises `SimulationError` for a gap of more than 1 mm, or a kink of more than 1 mrad, where they meet.
        """
        kink = check_joint("Joined paths", self.end, other.start)
        rounds = self.end.heading + kink - other.start.heading
        return Path(
            np.concatenate([self.arc, self.length_m + other.arc[1:]]),
            np.vstack([self.position, other.position[1:]]),
            np.concatenate([self.heading, other.heading[1:] + rounds]),
            self.landmarks + tuple(replace(mark, arc=self.length_m + mark.arc) for mark in other.landmarks),
        )

    def repeat(self, n: int) -> Path:
        """`n` laps of a path that ends where, and as, it begins; each crosses the landmarks again."""
        if n == 1:
            return self
        half = self.repeat(n // 2)
        return half.then(half) if n % 2 == 0 else half.then(half).then(self)

    def part(self, begin: float, end: float) -> Path:
        """The stretch between two arc lengths in m, with its landmarks."""
        inside = (self.arc > begin) & (self.arc < end)
        arc = np.concatenate([[begin], self.arc[inside], [min(end, self.length_m)]])
        marks = tuple(replace(m, arc=m.arc - begin) for m in self.landmarks if begin <= m.arc <= arc[-1])
        return Path(arc - begin, *self.at(arc), marks)

    def scale_to(self, length_m: float) -> Path:
        """The path drawn larger or smaller about its start until it has this positive length, corners and all."""
        factor = length_m / self.length_m
        position = self.position[0] + factor * (self.position - self.position[0])
        marks = tuple(replace(mark, arc=min(factor * mark.arc, length_m)) for mark in self.landmarks)
        arc = factor * self.arc
        arc[-1] = length_m
        return Path(arc, position, self.heading, marks)

    def with_landmarks(self, arcs: Sequence[float] | Floats, names: Sequence[str] | None = None) -> Path:
        """The path with landmarks at these arc lengths (m) only, and their names (1, 2, ... without)."""
        names = [str(i + 1) for i in range(len(arcs))] if names is None else names
        marks = tuple(Landmark(name, float(arc)) for name, arc in zip(names, arcs, strict=True))
        return replace(self, landmarks=marks)


def straight(length_m: float) -> Path:
    """A line from the origin to the north."""
    return _bend(np.array([length_m]), np.array([0.0]))


def arc(radius_m: float, angle: float) -> Path:
    """An arc from the origin that sets out to the north and turns by `angle` rad, clockwise if positive."""
    return _bend(np.array([radius_m * abs(angle)]), np.array([angle]))


def polyline(points: ArrayLike, corner_radius_m: float) -> Path:
    """Straight legs from point to point (K, 2 or 3) m in nav, the corners between them rounded; heights are linear.

    Raises `SimulationError` for repeated points, a corner that does not fit between its neighbours, or a leg that goes
    straight back.
    """
    vertex = _as_points(points)
    _check_distinct(vertex)
    leg = np.diff(vertex[:, :2], axis=0)
    leg_m = np.linalg.norm(leg, axis=1)
    route = np.unwrap(np.arctan2(leg[:, 0], leg[:, 1]))
    turn = np.diff(route)
    cut = _cut_corners(turn, leg_m, corner_radius_m)
    straights = leg_m - cut[:-1] - cut[1:]
    corners = corner_radius_m * np.abs(turn)
    bent = _bend(_interleave(straights, corners), _interleave(np.zeros(len(leg_m)), turn))
    placed = bent.rotate(float(route[0])).translate(vertex[0])
    # heights along legs (even pieces) and corners (odd ones): a vertex is in the middle of its corner
    along = np.concatenate([[0.0], np.cumsum(_interleave(straights, corners))])
    at_vertex = np.concatenate([[0.0], (along[1:-1:2] + along[2:-1:2]) / 2, [along[-1]]])
    placed.position[:, 2] = np.interp(placed.arc, at_vertex, vertex[:, 2])
    return placed


def closed_curve(points: ArrayLike) -> Path:
    """A smooth closed curve through K >= 3 points (K, 2 or 3) m; the first is not repeated at the end."""
    vertex = _as_points(points)
    return _fit_curve(np.vstack([vertex, vertex[:1]]), "periodic")


def open_curve(points: ArrayLike) -> Path:
    """A smooth curve through points (K, 2 or 3) m, from the first to the last."""
    return _fit_curve(_as_points(points), "natural")


def _fit_curve(vertex: Floats, ends: Literal["periodic", "natural"]) -> Path:
    """The cubic spline through points, by the length of their chords."""
    chord = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(vertex[:, :2], axis=0), axis=1))])
    spline = CubicSpline(chord, vertex, bc_type=ends)
    knots = np.linspace(0.0, chord[-1], max(2, round(chord[-1] / KNOT_M)) + 1)
    tangent = spline(knots, 1)
    heading = np.unwrap(np.arctan2(tangent[:, 0], tangent[:, 1]))
    position = spline(knots)
    if ends == "periodic":
        position[-1] = position[0]
    return Path(_integrate_length(spline, knots), position, heading)


def _integrate_length(spline: CubicSpline, knots: Floats) -> Floats:
    """Arc length (M,) m at the knots of a curve, by three-point Gauss-Legendre quadrature of its speed."""
    node, weight = np.polynomial.legendre.leggauss(3)
    half = np.diff(knots) / 2
    speed = [np.linalg.norm(spline(knots[:-1] + half * (1 + x), 1)[:, :2], axis=1) for x in node]
    return np.concatenate([[0.0], np.cumsum(half * (weight @ np.array(speed)))])


def _bend(length: Floats, turn: Floats) -> Path:
    """Pieces of constant curvature one after the other, from the origin to the north; (P,) m and rad, one each."""
    length, turn = length[length > 0], turn[length > 0]
    count = np.maximum(1, np.ceil(np.abs(turn) / KNOT_RAD).astype(int))
    ds, dh = np.repeat(length / count, count), np.repeat(turn / count, count)
    heading = np.concatenate([[0.0], np.cumsum(dh)])
    mean = (heading[1:] + heading[:-1]) / 2
    chord = ds * np.sinc(dh / 2 / np.pi)
    step = np.stack([chord * np.sin(mean), chord * np.cos(mean), np.zeros(len(ds))], axis=1)
    return Path(np.concatenate([[0.0], np.cumsum(ds)]), np.vstack([np.zeros(3), np.cumsum(step, axis=0)]), heading)


def _cut_corners(turn: Floats, leg_m: Floats, radius_m: float) -> Floats:
    """What each corner takes from its legs (K,) m, nothing at the ends of the path: r tan(turn / 2)."""
    back = np.abs(np.abs(turn) - np.pi) < 1e-6
    if back.any():
        raise SimulationError(
            f"The path goes straight back at point {int(np.argmax(back)) + 1}: end it there and turn on the spot."
        )
    cut = np.concatenate([[0.0], radius_m * np.tan(np.abs(turn) / 2), [0.0]])
    short = leg_m - cut[:-1] - cut[1:]
    worst = int(np.argmin(short))
    if short[worst] < -1e-9:
        raise SimulationError(
            f"Corners of radius {radius_m:g} m do not fit on the leg of {leg_m[worst]:.3g} m "
            f"from point {worst} to point {worst + 1}: make the radius smaller or the leg longer."
        )
    return cut


def _interleave(even: Floats, odd: Floats) -> Floats:
    """even[0], odd[0], even[1], ..., even[-1]; round-off below nothing becomes nothing."""
    both = np.zeros(len(even) + len(odd))
    both[::2], both[1::2] = np.where(np.abs(even) < 1e-9, 0.0, even), odd
    return both


def _as_points(points: ArrayLike) -> Floats:
    """Points as (K, 3), height nought where there is none."""
    rows = np.asarray(points, dtype=np.float64)
    return np.hstack([rows, np.zeros((len(rows), 3 - rows.shape[1]))])


def _check_distinct(vertex: Floats) -> None:
    same = np.linalg.norm(np.diff(vertex[:, :2], axis=0), axis=1) < GAP_M
    if same.any():
        k = int(np.argmax(same))
        raise SimulationError(f"Points {k} and {k + 1} of the path are the same place: leave one of them out.")
