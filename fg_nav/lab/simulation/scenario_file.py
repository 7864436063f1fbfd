"""A scenario of your own, from a TOML file.

    like = "office"                     # where worn, sensor, site and field come from; all of them can be given too
    field = "smooth"
    magnets = [[1.5, 10.0, 0.0]]        # east, north, up of permanent magnets, m

    [course]
    points_m = [[0, 0], [0, 25], [40, 25]]   # east and north of the corners
    corner_radius_m = 1.2
    laps = 1
    rest_s = 5.0
    pace = 1.0                          # times the person's usual speed
    run = false
    strides = 40                        # or as many as the way takes

    [sensor]                            # any parameter of `lab.simulation.sensors.SensorPrior`, in SI units and uT
    rate_hz = 200
    [sensor.gyr]
    noise_density = 1e-4

Whatever is left out is as above, or as in the scenario it is like; `points_m` must be there. A way whose last point is
its first is closed: it begins in the middle of its first leg, all its corners are rounded, and it can have laps.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path as File
from typing import Any, TypeVar, cast

from fg_nav.errors import SimulationError
from fg_nav.lab.simulation.motion import Style
from fg_nav.lab.simulation.path import Path, polyline
from fg_nav.lab.simulation.plan import Section, Stand, Walk
from fg_nav.lab.simulation.scenarios import Scenario, Worn, scenario

SUFFIX = ".toml"

LONGEST_M = 100_000.0
"""A day of walking."""

LARGEST = 1e100
"""No parameter is larger; whole numbers beyond a float's range would not even compare."""

_ANY_WAY = ((0.0, 0.0), (1.0, 0.0))
"""In place of the way that a file must give."""

T = TypeVar("T")


@dataclass(frozen=True)
class OwnCourse:
    """The table `course` of the file; see there."""

    points_m: Sequence[Sequence[float]] = ()
    corner_radius_m: float = 1.2
    laps: int = 1
    rest_s: float = 5.0
    pace: float = 1.0
    run: bool = False
    strides: int | None = None

    def __post_init__(self) -> None:
        if len(self.points_m) < 2 or not all(_is_place(point, 2) for point in self.points_m):
            raise SimulationError(
                "course.points_m cannot be read: give two pairs of numbers or more, [[0, 0], [0, 25]]."
            )
        if self.strides is not None and type(self.strides) is not int:
            raise SimulationError(f"course.strides cannot be {self.strides!r}: give a whole number.")
        if self.laps > 1 and not self.is_closed:
            raise SimulationError("course.laps needs a closed way: let the last of points_m be the first.")

    @property
    def is_closed(self) -> bool:
        """Whether the way ends where it begins, and has a round to it."""
        return len(self.points_m) > 3 and list(self.points_m[0]) == list(self.points_m[-1])

    def sections(self) -> list[Section]:
        """Rest, walk, rest."""
        rest = Stand(self.rest_s)
        return [rest, Walk(self._path(), Style.RUN if self.run else Style.WALK, self.strides, self.pace), rest]

    def _path(self) -> Path:
        """All laps; a closed way begins in the middle of its first leg, so that its first corner is round too."""
        points = list(self.points_m)
        if self.is_closed:
            middle = [(a + b) / 2 for a, b in zip(points[0], points[1], strict=True)]
            points = [middle, *points[1:], middle]
        lap = polyline(points, self.corner_radius_m)
        if lap.length_m * self.laps > LONGEST_M:
            raise SimulationError(f"{self.laps} laps of {lap.length_m:.3g} m are too long: at most {LONGEST_M:.0f} m.")
        return lap.repeated(self.laps)


@dataclass(frozen=True)
class Surroundings:
    """What stands at the head of the file beside `like`, `course` and `sensor`; see there."""

    worn: Worn
    site: str
    field: str
    magnets: tuple[tuple[float, float, float], ...] = ()
    aligned: bool = False

    def __post_init__(self) -> None:
        if not all(_is_place(place, 3) for place in self.magnets):
            raise SimulationError("magnets cannot be read: give places of three numbers, [[1.5, 0, 0]].")


def read_scenario(path: File) -> Scenario:
    """Read a scenario.

    Raises
    ------
    SimulationError
        If the file cannot be read, knows words that we do not, or describes what cannot be.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise SimulationError(f"{path.name} is no TOML: {error}.") from None
    return scenario_of(path.name, text)


def scenario_of(file: str, text: str) -> Scenario:
    """Return the scenario of a file that was read already; raises as `read_scenario` does."""
    try:
        return _scenario(File(file).stem, tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise SimulationError(f"{file} is no TOML: {error}.") from None
    except SimulationError as error:
        raise SimulationError(f"{file}: {error}") from None


def _scenario(name: str, content: Mapping[str, Any]) -> Scenario:
    given = dict(content)
    like = _like(given.pop("like", "demo"))
    if "course" not in given:
        raise SimulationError("it has no table [course]: give its points_m.")
    sections = _changed(OwnCourse(_ANY_WAY), given.pop("course"), "course").sections()
    sensor = given.pop("sensor", {})
    prior = sensor if isinstance(sensor, str) else _changed(like.prior, sensor, "sensor")
    place = _changed(Surroundings(like.worn, like.site, like.field, aligned=like.aligned), given, "the file")
    summary = f"{name}{SUFFIX}"
    where = place.worn, prior, place.site, place.field, place.magnets, place.aligned
    return Scenario(name, summary, lambda _: sections, *where)


def _like(name: object) -> Scenario:
    if not isinstance(name, str):
        raise SimulationError(f"like cannot be {name!r}: give the name of a scenario.")
    return scenario(name)


def _changed(value: T, table: Any, where: str) -> T:
    """Return a dataclass with the fields that a table names replaced, those of dataclasses in it too."""
    _check_table(type(value), table, where)
    given = {name: _converted(getattr(value, name), item, f"{where}.{name}") for name, item in table.items()}
    return cast("T", replace(cast("Any", value), **given))


def _converted(before: object, item: Any, where: str) -> Any:
    if is_dataclass(before):
        return _changed(before, item, where)
    if isinstance(item, list):
        return tuple(item)
    if before is not None and not (_is_number(item) if isinstance(before, float) else type(item) is type(before)):
        raise SimulationError(f"{where} cannot be {item!r}: give something like {_shown(before)}.")
    return item


def _shown(value: object) -> str:
    """How a value is written in TOML."""
    return str(value).lower() if isinstance(value, bool) else "a list" if isinstance(value, tuple) else repr(value)


def _is_place(item: object, size: int) -> bool:
    return isinstance(item, list | tuple) and len(item) == size and all(_is_number(x) for x in item)


def _is_number(item: object) -> bool:
    return isinstance(item, int | float) and not isinstance(item, bool) and abs(item) < LARGEST


def _check_table(kind: type, table: Any, where: str) -> None:
    if not isinstance(table, Mapping):
        raise SimulationError(f"{where} is no table: write [{where}] and its parameters below.")
    known = [item.name for item in fields(cast("Any", kind))]
    for name in table:
        if name not in known:
            raise SimulationError(f"{where} has no parameter '{name}': it knows {', '.join(known)}.")
