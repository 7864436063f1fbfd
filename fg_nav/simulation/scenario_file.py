"""A scenario of your own, from a TOML file.

    like = "office"                     # where worn, sensor, site and field come from; all of them can be given too
    field = "smooth"

    [course]
    points_m = [[0, 0], [0, 25], [40, 25]]   # east and north of the corners
    corner_radius_m = 1.2
    laps = 1
    rest_s = 5.0
    pace = 1.0                          # times the person's usual speed
    run = false
    strides = 40                        # or as many as the way takes

    [sensor]                            # any parameter of `fg_nav.simulation.sensors.SensorPrior`, in SI units and uT
    rate_hz = 200
    [sensor.gyr]
    noise_density = 1e-4

Whatever is left out is as above, or as in the scenario it is like. A way whose last point is its first is closed: it
begins in the middle of its first leg, and all its corners are rounded.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, TypeVar, cast

from fg_nav.errors import SimulationError
from fg_nav.simulation.footsteps import Style
from fg_nav.simulation.path import polyline
from fg_nav.simulation.plan import Section, Stand, Walk
from fg_nav.simulation.scenarios import Scenario, scenario

SUFFIX = ".toml"

LONGEST_M = 100_000.0
"""A day of walking."""

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
        if not all(_is_point(point) for point in self.points_m):
            raise SimulationError("course.points_m cannot be read: give pairs of numbers, [[0, 0], [0, 25]].")
        if self.strides is not None and (not _is_number(self.strides) or self.strides != int(self.strides)):
            raise SimulationError(f"course.strides cannot be {self.strides!r}: give a whole number.")

    def sections(self) -> list[Section]:
        """Rest, walk, rest."""
        lap = polyline(_begun_midway(self.points_m), self.corner_radius_m)
        if lap.length_m * self.laps > LONGEST_M:
            raise SimulationError(f"{self.laps} laps of {lap.length_m:.3g} m are too long: at most {LONGEST_M:.0f} m.")
        path = lap.repeated(self.laps)
        rest = Stand(self.rest_s)
        return [rest, Walk(path, Style.RUN if self.run else Style.WALK, self.strides, self.pace), rest]


def read_scenario(path: Path) -> Scenario:
    """Read a scenario.

    Raises
    ------
    SimulationError
        If the file cannot be read, knows words that we do not, or describes what cannot be.
    """
    try:
        return _scenario(path.stem, tomllib.loads(path.read_text(encoding="utf-8")))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SimulationError(f"{path.name} is no TOML: {error}.") from None
    except SimulationError as error:
        raise SimulationError(f"{path.name}: {error}") from None


def _scenario(name: str, content: Mapping[str, Any]) -> Scenario:
    given = dict(content)
    like = scenario(given.pop("like", "demo"))
    course, sensor = given.pop("course", None), given.pop("sensor", like.sensor)
    if course is None:
        raise SimulationError("it has no table [course]: give its points_m.")
    sections = _changed(OwnCourse(), course, "course").sections()
    prior = sensor if isinstance(sensor, str) else _changed(like.prior, sensor, "sensor")
    changed = _changed(like, given, "the scenario")
    return replace(changed, name=name, summary=f"{name}{SUFFIX}", course=lambda _: sections, sensor=prior, magnets=())


def _begun_midway(points: Sequence[Sequence[float]]) -> Sequence[Sequence[float]]:
    """Let a closed way begin in the middle of its first leg; an open one begins where it does."""
    if len(points) < 3 or list(points[0]) != list(points[-1]):
        return points
    middle = [(a + b) / 2 for a, b in zip(points[0], points[1], strict=True)]
    return [middle, *points[1:], middle]


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
    if before is not None and not (_is_number(item) if type(before) is float else type(item) is type(before)):
        raise SimulationError(f"{where} cannot be {item!r}: give something like {_shown(before)}.")
    return item


def _shown(value: object) -> str:
    """How a value is written in TOML."""
    return str(value).lower() if isinstance(value, bool) else "a list" if isinstance(value, tuple) else repr(value)


def _is_point(item: object) -> bool:
    return isinstance(item, list | tuple) and len(item) == 2 and all(_is_number(x) for x in item)


def _is_number(item: object) -> bool:
    return isinstance(item, int | float) and not isinstance(item, bool)


def _check_table(kind: type, table: Any, where: str) -> None:
    if not isinstance(table, Mapping):
        raise SimulationError(f"{where} is no table: write [{where}] and its parameters below.")
    known = [item.name for item in fields(cast("Any", kind))]
    for name in table:
        if name not in known:
            raise SimulationError(f"{where} has no parameter '{name}': it knows {', '.join(known)}.")
