"""The named scenarios: which course, worn where, on what sensor, in which field.

A scenario is a default for each of these; `Choices` replaces any of them. Sensor and place are those of the paper that
the scenario comes from. Ma's and Zhang's sensors sit in the heel of a shoe, Munoz Diaz' in the trouser pocket; the
others are on the instep, as in the real walks that this project is tested on.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import SimulationError
from fg_nav.lab.simulation import routes
from fg_nav.lab.simulation.checks import check_known
from fg_nav.lab.simulation.fields import (
    AS_PRINTED,
    LEVELS,
    PAST_CARS,
    PHYSICAL,
    TEMPLATE,
    Field,
    Homogeneous,
    Sum,
    draw_environment,
    magnet,
    street,
)
from fg_nav.lab.simulation.plan import Section
from fg_nav.lab.simulation.sensors import IronPrior, SensorPrior, preset

Worn: TypeAlias = Literal["heel", "instep", "pocket", "table"]
WORN: tuple[Worn, ...] = get_args(Worn)

Rests: TypeAlias = Literal["still", "rocking", "none"]
RESTS: tuple[Rests, ...] = get_args(Rests)

Feet: TypeAlias = Literal["still", "moving"]
FEET: tuple[Feet, ...] = get_args(Feet)

Route: TypeAlias = Callable[[np.random.Generator], Sequence[Section]]

STREET_FIELDS: Mapping[str, tuple[tuple[tuple[float, float, float], ...], float]] = {
    "street": (TEMPLATE, PHYSICAL),
    "street-as-printed": (TEMPLATE, AS_PRINTED),
    "past-cars": (PAST_CARS, PHYSICAL),
    "past-cars-as-printed": (PAST_CARS, AS_PRINTED),
}
"""Fields of lamps and parked cars: where these stand in a block, and the exponent of their decay."""

FIELDS = (*LEVELS, *STREET_FIELDS)

FLOOR_MAGNET_MOMENT = (0.0, 2.0, 1.0)
"""Of the magnet on the floor of the corridor, A m^2: a block of 3 cm^3 neodymium. Zhang gives none."""


@dataclass(frozen=True)
class Scenario:
    """A walk that can be simulated."""

    name: str  # For people.
    summary: str
    route: Route  # Draws the sections of the walk.
    worn: Worn  # Where the sensor is; on a table it goes nowhere.
    sensor: str | SensorPrior  # Its preset (`fg_nav.lab.simulation.sensors`), or a prior of your own.
    site: str = "munich"  # Where on Earth: a site of Munoz Diaz' Table 1 or `latitude,longitude,YYYY-MM-DD`.
    field: str = "indoor"  # One of `FIELDS`.
    magnets: tuple[tuple[float, float, float], ...] = ()  # Of `FLOOR_MAGNET_MOMENT` on the floor, m.
    aligned: bool = (
        False  # Whether a sensor in a pocket sits as the thigh does, as strapped to it, or as drawn by the seed.
    )
    rests: Rests = (
        "still"  # Whether the foot stands still between paths, rocks there, or does not stand at all, even at the ends.
    )
    feet: Feet = (
        "still"  # Whether feet that are walked on stand in stance, but for rolling and slip, or move on as real ones.
    )

    @property
    def prior(self) -> SensorPrior:
        """What the sensor is drawn from; raises `SimulationError` if there is no such preset."""
        return preset(self.sensor) if isinstance(self.sensor, str) else self.sensor


@dataclass(frozen=True)
class Choices:
    """What of a scenario is to be otherwise; None leaves it as it is."""

    sensor: str | None = None  # See `Scenario`.
    site: str | None = None
    field: str | None = None
    worn: Worn | None = None
    rate_hz: float | None = None  # Of the recording; None for the sensor's own.
    turned_deg: float = 0.0  # The whole course, clockwise.
    calibrated: bool = False  # Leave out the magnetometer's hard and soft iron.
    aligned: bool = False  # See `Scenario`; False leaves it as it is.
    rests: Rests | None = None
    feet: Feet | None = None

    def apply_to(self, scenario: Scenario) -> Scenario:
        """Return the scenario with what was chosen in place of its defaults.

        Raises `SimulationError` for a sensor, a place to wear it, a kind of rests or feet that does not exist, a rate
        or turn that cannot be, or the calibration of a magnetometer that the sensor has not.
        """
        chosen = {name: getattr(self, name) for name in ("sensor", "site", "field", "worn", "rests", "feet")}
        changed = replace(scenario, **{name: value for name, value in chosen.items() if value is not None})
        for what, one, known in (
            ("place to wear a sensor at", changed.worn, WORN),
            ("kind of rests", changed.rests, RESTS),
            ("kind of feet", changed.feet, FEET),
        ):
            check_known(what, one, known)
        prior = changed.prior if self.rate_hz is None else changed.prior.at_rate(self.rate_hz)
        if self.calibrated:
            if prior.mag is None:
                raise SimulationError(f"{prior.name} has no magnetometer to be calibrated: choose another sensor.")
            prior = prior.with_iron(IronPrior())
        changed = replace(changed, sensor=prior, aligned=changed.aligned or self.aligned)
        return _rotate_scenario(changed, self.turned_deg) if self.turned_deg else changed


def _rotate_scenario(scenario: Scenario, degrees: float) -> Scenario:
    if not np.isfinite(degrees):
        raise SimulationError(f"a course cannot be turned by {degrees} degrees: give a number.")
    angle = float(np.deg2rad(degrees))
    c, s = float(np.cos(angle)), float(np.sin(angle))
    magnets = tuple((c * east + s * north, c * north - s * east, up) for east, north, up in scenario.magnets)
    return replace(scenario, route=lambda rng: routes.rotate(scenario.route(rng), angle), magnets=magnets)


def _ignore_rng(route: Callable[[], Sequence[Section]]) -> Route:
    """Make a course that draws nothing look like one that does."""
    return lambda _: route()


def _offset_gyro(name: str, bias_deg_s: float, spread_deg_s: float) -> SensorPrior:
    """Return the sensor of this name with a turn-on bias of the gyroscope about its z axis."""
    prior, bias = preset(name), float(np.deg2rad(bias_deg_s))
    return replace(prior, gyr=replace(prior.gyr, bias=(0.0, 0.0, bias), bias_sd=float(np.deg2rad(spread_deg_s))))


_MA, _ZHANG, _MUNOZ_DIAZ, _LORD = "mpu-9250x8", "xsens-mtw", "munoz-diaz-table-2", "lord-gx5-900"
_SLOW = _offset_gyro("xsens-mtw", 0.25, 0.05)

_ROUTES: tuple[tuple[str, Route, Worn, str | SensorPrior, str, str], ...] = (
    ("office", routes.office, "heel", _MA, "indoor",
     "three equal loops through office corridors, 1018 m, 786 strides (Ma 2018)"),
    ("office-open", routes.office_open, "heel", _MA, "indoor",
     "as long as the office, ending far from the start: shows scale errors"),
    ("mall", routes.mall, "heel", _MA, "indoor",
     "three winding laps past 14 landmarks, 2480 m, 1920 strides (Ma 2018)"),
    ("mall-open", routes.mall_open, "heel", _MA, "indoor",
     "as long as the mall, past 42 landmarks, ending far from the start"),
    ("teaching-building", _ignore_rng(routes.teaching_building), "heel", _ZHANG, "indoor",
     "three cycles, 515.5 m in 7 minutes (Zhang, AIEZ)"),
    ("magnet-corridor", routes.magnet_corridor, "heel", _ZHANG, "smooth",
     "a corridor to and fro past a magnet on the floor (Zhang, AIEZ)"),
    ("calibration-loop", _ignore_rng(routes.calibration_loop), "heel", _MA, "homogeneous",
     "circles to the right and to the left, to calibrate a magnetometer (Ma 2018)"),
    ("pocket-street", routes.pocket_street, "pocket", _MUNOZ_DIAZ, "homogeneous",
     "three round trips in a street, 3 km in 39 minutes, in the pocket (Munoz Diaz 2017)"),
    ("pocket-past-cars", routes.past_cars, "pocket", _MUNOZ_DIAZ, "past-cars",
     "the same street at the equator, past cars at 16 and 32 min, lamps at 24 and 35"),
    ("pocket-long", routes.pocket_long, "pocket", "xsens-mtw", "homogeneous",
     "twelve round trips of 360 m in 44 minutes, in the pocket (Munoz Diaz 2017)"),
    ("stairs", _ignore_rng(routes.stairs), "instep", _LORD, "indoor",
     "two flights up, a corridor, and down again"),
    ("mixed-gait", _ignore_rng(routes.mixed_gait), "instep", _LORD, "indoor",
     "slow, usual and fast walking, running, standing and turning on the spot"),
    ("demo", _ignore_rng(routes.demo), "instep", _LORD, "indoor",
     "one minute round an L-shaped corridor"),
    ("building-loop", _ignore_rng(routes.building_loop), "heel", _SLOW, "indoor",
     "350 m round a floor in 4 minutes, gyroscope 0.25 deg/s off, which no rest shows"),
    ("at-rest", _ignore_rng(routes.at_rest), "table", "xsens-mtw", "homogeneous",
     "an hour on a table, for an Allan deviation"),
)  # fmt: skip

_SPECIAL: Mapping[str, dict[str, Any]] = {
    "magnet-corridor": {"magnets": (routes.MAGNET_POSITION,)},
    "pocket-past-cars": {"site": "equator", "aligned": True},
    "building-loop": {"rests": "none"},
}

SCENARIOS: Mapping[str, Scenario] = {
    name: Scenario(name, summary, route, worn, sensor, field=field, **_SPECIAL.get(name, {}))
    for name, route, worn, sensor, field, summary in _ROUTES
}
"""All scenarios by name."""


def scenario(name: str) -> Scenario:
    """Return the scenario of this name.

    Raises `SimulationError` for any other name.
    """
    check_known("scenario", name, SCENARIOS)
    return SCENARIOS[name]


def draw_surroundings(of: Scenario, earth: Homogeneous, points: Floats, rng: np.random.Generator) -> Field:
    """Draw the field about a scenario's course, whose feet come down at `points` (M, 3) m, in order, on the floor.

    `earth` is the field without all else. Raises `SimulationError` for a field that does not exist, or a street with
    iron on the path.
    """
    magnets = [magnet(np.array(place), np.array(FLOOR_MAGNET_MOMENT)) for place in of.magnets]
    return Sum([_draw_background(of.field, earth, points, rng), *magnets])


def _draw_background(name: str, earth: Homogeneous, points: Floats, rng: np.random.Generator) -> Field:
    check_known("field", name, FIELDS)
    if name not in STREET_FIELDS:
        return draw_environment(name, earth, points, rng)
    # the street goes from where the walk begins to the farthest of its places
    start = points[0, :2]
    way = points[np.argmax(np.linalg.norm(points[:, :2] - start, axis=1)), :2] - start
    length_m = float(np.linalg.norm(way))
    if length_m < 1.0:
        raise SimulationError("there is no street to put lamps and cars along: choose a longer course.")
    heading_deg = float(np.rad2deg(np.arctan2(way[0], way[1])))
    template, exponent = STREET_FIELDS[name]
    return street(
        earth,
        length_m,
        start=(float(start[0]), float(start[1])),
        heading_deg=heading_deg,
        exponent=exponent,
        template=template,
    )
