"""A scenario of the user's own, from a TOML file.

    like = "office"                     # where worn, sensor, site and field come from; all of them can be given too
    field = "smooth"
    rests = "none"                      # the foot stands still, rocking, or not at all ("none")
    feet = "moving"                     # in stance the foot comes to a stand ("still") or moves on, as real ones do
    magnets = [[1.5, 10.0, 0.0]]        # east, north, up of permanent magnets, m

    [course]
    points_m = [[0, 0], [0, 25], [40, 25]]   # east and north of the corners
    corner_radius_m = 1.2
    laps = 1
    rest_s = 5.0
    pace = 1.0                          # times the person's usual speed
    run = false
    strides = 40                        # or as many as the path takes

    [sensor]                            # any parameter of `lab.simulation.sensors.SensorPrior`, in SI units and uT
    rate_hz = 200
    [sensor.gyr]
    noise_density = 1e-4

Whatever is left out is as above, or as in the scenario it is like; `points_m` must be there. A path whose last point is
its first is closed: it begins in the middle of its first leg, all its corners are rounded, and it can have laps.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path as File
from typing import Annotated, Any, TypeAlias

from pydantic import Field

from fg_nav.errors import FgNavError, SimulationError
from fg_nav.lab.simulation.checks import Table
from fg_nav.lab.simulation.motion import Style
from fg_nav.lab.simulation.path import polyline
from fg_nav.lab.simulation.plan import Section, Stand, Walk
from fg_nav.lab.simulation.scenarios import Feet, Rests, Scenario, Worn, scenario
from fg_nav.lab.simulation.sensors import read_sensor
from fg_nav.text import parse_toml, read_small

SUFFIX = ".toml"

MAX_M = 100_000.0  # A day of walking.
MAX_REST_S = 86_400.0  # A day.
LARGEST = 1e100  # No number is larger.
MOST = 1_000_000  # Laps and strides: more than in a day of walking.

Number: TypeAlias = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]


class RouteTable(Table):
    """The table `course` of the file."""

    points_m: Annotated[tuple[tuple[Number, Number], ...], Field(min_length=2)]
    corner_radius_m: Annotated[float, Field(gt=0.0, le=LARGEST)] = 1.2
    laps: Annotated[int, Field(ge=1, le=MOST)] = 1
    rest_s: Annotated[float, Field(ge=0.0, le=MAX_REST_S)] = 5.0
    pace: Number = 1.0
    run: bool = False
    strides: Annotated[int, Field(ge=1, le=MOST)] | None = None

    def make_sections(self) -> list[Section]:
        """Rest, walk, rest; a closed path begins in the middle of its first leg, so that its first corner is round."""
        points = list(self.points_m)
        is_closed = len(points) > 3 and points[0] == points[-1]
        if self.laps > 1 and not is_closed:
            raise SimulationError("course.laps needs a closed path: let the last of points_m be the first.")
        if is_closed:
            (a, b), (c, d) = points[:2]
            middle = ((a + c) / 2, (b + d) / 2)
            points = [middle, *points[1:], middle]
        lap = polyline(points, self.corner_radius_m)
        if lap.length_m * self.laps > MAX_M:
            raise SimulationError(f"{self.laps} laps of {lap.length_m:.3g} m are too long: at most {MAX_M:.0f} m.")
        walk = Walk(lap.repeat(self.laps), Style.RUN if self.run else Style.WALK, self.strides, self.pace)
        return [Stand(self.rest_s), walk, Stand(self.rest_s)]


class ScenarioTable(Table):
    """The whole file; None is as in the scenario it is like."""

    course: RouteTable
    like: str = "demo"
    worn: Worn | None = None
    site: str | None = None
    field: str | None = None
    magnets: tuple[tuple[Number, Number, Number], ...] = ()
    aligned: bool | None = None
    rests: Rests | None = None
    feet: Feet | None = None
    sensor: str | dict[str, Any] = Field(default_factory=dict)


def read_scenario(path: File) -> Scenario:
    """Read a scenario.

    Raises `SimulationError` if the file cannot be read, has unknown parameters, or describes what cannot be.
    """
    return parse_scenario(path.name, read_small(path))


def parse_scenario(file: str, content: bytes) -> Scenario:
    """Return the scenario of a file's content; raises as `read_scenario` does."""
    try:
        return _make_scenario(File(file).stem, parse_toml(content))
    except FgNavError as error:
        raise SimulationError(f"{file}: {error}") from None


def _make_scenario(name: str, content: Mapping[str, Any]) -> Scenario:
    if "course" not in content:
        raise SimulationError("it has no table [course]: give its points_m.")
    table = ScenarioTable.read(content)
    like = scenario(table.like)
    sensor = table.sensor if isinstance(table.sensor, str) else read_sensor(table.sensor, like.prior)
    sections = table.course.make_sections()
    given = table.model_dump(exclude={"course", "like", "sensor"}, exclude_none=True)
    return replace(like, name=name, summary=f"{name}{SUFFIX}", route=lambda _: sections, sensor=sensor, **given)
