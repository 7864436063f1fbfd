"""Where the walks of the papers' experiments go: the geometry of each scenario, as sections of a plan.

Lengths, numbers of strides and durations are the papers'; the maps, which they do not give, are ours. Every course
starts at the origin, begins and ends with a rest, and ends as it began unless it says otherwise. What varies from
building to building is drawn. Sources: Ma et al. 2018 (office, mall, calibration loop), Zhang et al. (teaching
building, magnet corridor), Munoz Diaz et al. 2017 (street and long walk with the sensor in the pocket).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from fg_nav.errors import SimulationError
from fg_nav.lab.simulation.motion import Style
from fg_nav.lab.simulation.path import Path, Pose, arc, closed_curve, open_curve, polyline, straight
from fg_nav.lab.simulation.person import Person
from fg_nav.lab.simulation.plan import Section, Stairs, Stand, TurnOnSpot, Walk, end_of

REST_S = 5.0
LONG_REST_S = 10.0  # Rests at both ends; the longer one for walks of more than ten minutes.
STANCE_S = 0.35  # What a walk without rests begins and ends with: the stance of a usual stride.
CORNER_M = 1.2  # Radius at which people take a corner of a corridor.

MAGNET_POSITION = (0.45, 15.0, 0.0)
"""Of the magnet on the floor of the corridor, m: a foot's length to the right of a right foot on its way north."""

CLOSE_TO = {2: (230.0, 5.0), 3: (147.0, 4.25), 4: (470.0, 5.0), 5: (297.0, 4.25)}
"""By leg of `past_cars`: how far along the street one has come how far to its left, m; two cars, two lights."""

TIGHTEST_M = 1.5  # Smallest radius of a winding path: below it a walker turns on the spot.


def office(rng: np.random.Generator) -> list[Section]:
    """Three equal loops to the right through the corridors of a floor: 1018 m in 786 strides."""
    return _add_rests(Walk(_office_loop(rng).scale_to(1018 / 3).repeat(3), strides=786), LONG_REST_S)


def office_open(rng: np.random.Generator) -> list[Section]:
    """As long as `office`, through one wing after the other; it ends hundreds of meters to the east."""
    along, across = rng.uniform(30.0, 70.0, 12), rng.uniform(10.0, 45.0, 11) * rng.choice([-1.0, 1.0], 11)
    legs = np.zeros((23, 2))
    legs[::2, 0], legs[1::2, 1] = along, across
    path = polyline(np.vstack([np.zeros(2), np.cumsum(legs, axis=0)]), CORNER_M)
    return _add_rests(Walk(path.scale_to(1018.0), strides=786), LONG_REST_S)


def mall(rng: np.random.Generator) -> list[Section]:
    """Three laps of a winding path past 14 landmarks, 42 in all: 2480 m in 1920 strides."""
    lap = _draw_winding(closed_curve(_CONCOURSES), 2480 / 3, rng)
    return _add_rests(Walk(_mark_landmarks(lap, 14, rng).repeat(3), strides=1920), LONG_REST_S)


def mall_open(rng: np.random.Generator) -> list[Section]:
    """As long and winding as `mall`, past 42 landmarks, each once: up and down seven aisles to the far corner."""
    along = np.array([[0.0, 80.0, 160.0, 240.0, 320.0], [325.0, 245.0, 165.0, 85.0, 5.0]])
    middle = open_curve([(x, 56.0 * row) for row in range(7) for x in along[row % 2]])
    path = _draw_winding(middle, 2480.0, rng)
    return _add_rests(Walk(_mark_landmarks(path, 42, rng), strides=1920), LONG_REST_S)


def teaching_building() -> list[Section]:
    """Three cycles to the left through the corridors of a building with a lobby: 515.5 m in 7 minutes."""
    corners = [(0, 0), (0, 18), (-24, 18), (-24, 24), (-34, 24), (-34, 18), (-50, 18), (-50, -8), (0, -8), (0, 0)]
    cycle = polyline(corners, CORNER_M).scale_to(515.5 / 3)
    return _add_rests(Walk(cycle.repeat(3), pace=_find_pace(515.5, 7 * 60 - 2 * REST_S)), REST_S)


def magnet_corridor(rng: np.random.Generator) -> list[Section]:
    """Eight times along a corridor of 30 m, to and fro, past the magnet at `MAGNET_POSITION`."""
    return _walk_to_and_fro(straight(30.0), 4, rng, REST_S)


def calibration_loop() -> list[Section]:
    """Three circles to the right and three to the left in which a stride turns by 25 degrees (Ma: 15 to 35)."""
    radius_m = Person().walk.stride_m / np.deg2rad(25.0)
    circles = arc(radius_m, 2 * np.pi).repeat(3)
    return _add_rests(Walk(circles.then(arc(radius_m, -2 * np.pi).repeat(3))), REST_S)


def pocket_street(rng: np.random.Generator) -> list[Section]:
    """Three times along a street to the east and back, 500 m in each direction: 3 km in 39 minutes.

    The paper prints legs of 600 m, which its total and its duration contradict. `turned` makes it north-south.
    """
    return _walk_to_and_fro(straight(500.0).rotate(np.pi / 2), 3, rng, LONG_REST_S, 39 * 60)


def past_cars(rng: np.random.Generator) -> list[Section]:
    """As `pocket_street`, but coming close to what stands along it at four places (Munoz Diaz 2017, Figures 7b and 10).

    In a street with the template `PAST_CARS` one passes a parked car 16 and 32 minutes after the start and a light
    after 24 and 35, at the usual pace, and keeps away from all others. The sideways steps are ours.
    """
    paths = [_bend_aside(*CLOSE_TO.get(leg, (0.0, 0.0))) for leg in range(6)]
    return _walk_and_turn(
        [path.reverse() if leg % 2 else path for leg, path in enumerate(paths)], rng, LONG_REST_S, 39 * 60
    )


def pocket_long(rng: np.random.Generator, trips: int = 12) -> list[Section]:
    """So many round trips on a straight path to the east: 4.3 km in 44 minutes.

    Sections of 360 m "repeated 12 times" may be 12 round trips of 360 m, or 6 of 720 m; the latter fits the 50 deg that
    the paper's yaw is off after the first, by 0.12 deg/s (Table 3): `fg-nav lab reproduce munoz-diaz2017`.
    """
    return _walk_to_and_fro(straight(2160.0 / trips).rotate(np.pi / 2), trips, rng, LONG_REST_S, 44 * 60)


def stairs() -> list[Section]:
    """A corridor, two flights up with a landing between, the corridor above, and the same path back down."""
    corridor = straight(12.0).then(_join_paths(straight(12.0), arc(CORNER_M, np.pi / 2), straight(8.0)))
    landing = straight(0.4).then(_join_paths(straight(0.4), arc(0.75, -np.pi), straight(0.4)))
    above = straight(6.0).then(_join_paths(straight(6.0), arc(CORNER_M, np.pi / 2), straight(12.0)))
    up: list[Section] = [Walk(corridor), Stairs(10), Walk(landing, pace=0.7), Stairs(10), Walk(above)]
    down: list[Section] = [
        replace(one, path=one.path.reverse()) if isinstance(one, Walk) else Stairs(one.treads, up=False)
        for one in up[::-1]
        if isinstance(one, Walk | Stairs)
    ]
    # each moved to where the one before ended
    pose, placed = Pose(np.zeros(3), 0.0), []
    for section in [Stand(REST_S), *up, TurnOnSpot(np.pi), *down, TurnOnSpot(np.pi), Stand(REST_S)]:
        here = replace(section, path=section.path.place(pose)) if isinstance(section, Walk) else section
        placed.append(here)
        pose = end_of(here, pose)
    return placed


def mixed_gait() -> list[Section]:
    """Two rounds of a yard: slow, usual and fast walking, running, standing about and turning on the spot."""
    lap = polyline([(0, 0), (0, 30), (60, 30), (60, -15), (0, -15), (0, 0)], 2.0)
    slow, usual, run, fast, last = (lap.part(a * lap.length_m, b * lap.length_m) for a, b in pairwise(_SHARES))
    quarter = TurnOnSpot(np.pi / 2), TurnOnSpot(-np.pi / 2)
    first: list[Section] = [Walk(slow, pace=0.7), Walk(usual), Stand(6.0), Walk(run, Style.RUN), Walk(fast, pace=1.3)]
    second: list[Section] = [
        Walk(slow),
        Walk(usual, pace=1.25),
        Walk(run, Style.RUN, pace=1.15),
        Stand(3.0),
        Walk(fast),
    ]
    about: list[Section] = [*quarter, Stand(4.0), TurnOnSpot(2 * np.pi)]
    return [Stand(REST_S), *first, *about, Walk(last), *second, *about, Walk(last, pace=0.8), Stand(REST_S)]


def demo() -> list[Section]:
    """About one minute round an L-shaped corridor of 77 m."""
    corners = [(0, 0), (0, 11), (9, 11), (9, 0), (19, 0), (19, -10), (0, -10), (0, 0)]
    return _add_rests(Walk(polyline(corners, 1.2)), REST_S)


def building_loop(length_m: float = 350.0) -> list[Section]:
    """Once round a winding corridor of a floor of 75 m by 70 m, in four minutes."""
    corners = [(0, 0), (0, 45), (30, 45), (30, 70), (75, 70), (75, 20), (40, 20), (40, 0), (0, 0)]
    return _add_rests(Walk(polyline(corners, 1.2).scale_to(length_m)), REST_S)


def at_rest() -> list[Section]:
    """An hour in one place: only for a sensor on a table."""
    return [Stand(3600.0)]


def remove_rests(sections: Sequence[Section]) -> list[Section]:
    """Leave out all standing but a stance before the first stride and after the last.

    Raises `SimulationError` if there is nothing but standing.
    """
    moving: list[Section] = [section for section in sections if not isinstance(section, Stand)]
    if not moving:
        raise SimulationError("nothing is left of a course without its rests: choose one that goes somewhere.")
    return [Stand(STANCE_S), *moving, Stand(STANCE_S)]


def rotate(sections: Sequence[Section], angle: float) -> list[Section]:
    """A course turned clockwise by `angle` rad about the origin."""
    return [replace(s, path=s.path.rotate(angle)) if isinstance(s, Walk) else s for s in sections]


_SHARES = (0.0, 0.12, 0.30, 0.55, 0.75, 1.0)  # Where the manner of going changes in a round of `mixed_gait`.

_CONCOURSES = np.array(
    [
        *[(0.0, 0.0), (5.0, 60.0), (45.0, 95.0), (95.0, 80.0), (125.0, 110.0), (180.0, 115.0), (215.0, 75.0)],
        *[(190.0, 30.0), (205.0, -25.0), (160.0, -60.0), (115.0, -30.0), (75.0, -70.0), (25.0, -55.0)],
    ]
)
"""Round a mall, m: clockwise, along galleries that bend to either side."""


def _office_loop(rng: np.random.Generator) -> Path:
    """One loop through all corridors of a floor, some 80 m by 50 m, from its middle; where walls stand is drawn.

    The paper ends 2 m from its start with its heading 14 degrees off. An error that grows steadily turns a loop about
    the mean of its places, so the start was some 8 m from there (2 m / 14 degrees): a path that folds back on itself.
    """
    east = np.array([0.0, 18.0, 28.0, 37.0, 59.0, 81.0]) + rng.uniform(-2.0, 2.0, 6)
    north = np.array([0.0, 15.0, 22.0, 27.0, 31.0, 52.0]) + rng.uniform(-1.5, 1.5, 6)
    corner = np.stack([east[_OFFICE_EAST], north[_OFFICE_NORTH]], axis=1)
    return polyline(corner - corner[0], CORNER_M)


_OFFICE_EAST = [3, 3, 5, 5, 4, 4, 0, 0, 1, 1, 2, 2, 3, 3]
_OFFICE_NORTH = [4, 5, 5, 3, 3, 0, 0, 2, 2, 5, 5, 1, 1, 4]  # Which wall each corner of the office stands at.


def _draw_winding(
    middle: Path, length_m: float, rng: np.random.Generator, every_m: float = 8.0, sway_m: float = 1.7
) -> Path:
    """A path of this length that is never straight: round people and displays, left and right of `middle`.

    Draws until no bend is tighter than `TIGHTEST_M`.
    """
    closed = np.allclose(middle.position[0], middle.position[-1])
    count = round(middle.length_m / every_m)
    while True:
        along = (np.arange(count) + rng.uniform(-0.25, 0.25, count)) * middle.length_m / count
        along[0] = 0.0
        position, heading = middle.at(along)
        right = np.stack([np.cos(heading), -np.sin(heading)], axis=1)
        swayed = position[:, :2] + np.clip(rng.normal(0.0, sway_m, count), -2 * sway_m, 2 * sway_m)[:, None] * right
        swayed[0] = position[0, :2]
        path = (closed_curve(swayed) if closed else open_curve(swayed)).scale_to(length_m)
        if np.abs(path.curvature(path.arc)).max() < 1 / TIGHTEST_M:
            return path


def _mark_landmarks(path: Path, count: int, rng: np.random.Generator) -> Path:
    """A path with landmarks somewhere in each of `count` equal stretches, away from their ends."""
    return path.with_landmarks((np.arange(count) + rng.uniform(0.25, 0.75, count)) * path.length_m / count)


def _walk_to_and_fro(
    path: Path, trips: int, rng: np.random.Generator, rest_s: float, total_s: float | None = None
) -> list[Section]:
    """Round trips along a path, turning about at the ends to the side one likes; in `total_s`, or at the usual pace."""
    return _walk_and_turn([path, path.reverse()] * trips, rng, rest_s, total_s)


def _walk_and_turn(
    paths: Sequence[Path], rng: np.random.Generator, rest_s: float, total_s: float | None = None
) -> list[Section]:
    """Paths one after the other with a turn about after each, to the side one likes; in `total_s`, or as usual."""
    about = [TurnOnSpot(np.pi * side) for side in rng.choice([-1.0, 1.0], len(paths))]
    gait = Person().gait(Style.TURN)
    turning_s = 3 * gait.stride_s * len(about)
    length_m = sum(path.length_m for path in paths)
    pace = 1.0 if total_s is None else _find_pace(length_m, total_s - 2 * rest_s - turning_s, len(about))
    sections: list[Section] = [Stand(rest_s)]
    for path, turn in zip(paths, about, strict=True):
        sections += [Walk(path, pace=pace), turn]
    return [*sections, Stand(rest_s)]


def _bend_aside(where_m: float, aside_m: float) -> Path:
    """The street of 500 m to the east; at `where_m` one has come `aside_m` to the left, in 20 m, and then goes back."""
    along = np.arange(0.0, 500.1, 2.0)
    share = np.clip((along - where_m) / 20.0, -1.0, 1.0)
    return open_curve(np.stack([along, aside_m / 2 * (1 + np.cos(np.pi * share))], axis=1))


def _find_pace(length_m: float, seconds: float, walks: int = 1) -> float:
    """Pace at which one walks so far in so long; each walk from standing to standing takes one stride more."""
    gait = Person().walk
    extra_s = walks * gait.stride_s
    return length_m / (seconds - extra_s) * gait.stride_s / gait.stride_m


def _add_rests(walk: Walk, rest_s: float) -> list[Section]:
    return [Stand(rest_s), walk, Stand(rest_s)]


def _join_paths(before: Path, *paths: Path) -> Path:
    """Paths one after the other, the first where `before` ends."""
    pose, whole = before.end, None
    for path in paths:
        placed = path.place(pose)
        whole = placed if whole is None else whole.then(placed)
        pose = placed.end
    assert whole is not None
    return whole
