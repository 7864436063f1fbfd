"""What a campaign is to make, from a TOML file; checked before anything is made.

    scenarios = ["office", "my_walk.toml"]    # of `fg-nav simulate --list`, on a foot, or files of the user's own
    fields = ["smooth", "indoor"]             # without it: "indoor"
    seeds = 20                                # so many from first_seed on (101), or a list of them
    methods = ["smoother", "ma2018", "iez:physical"]
    magnetometers = ["loop"]                  # loop (without it), perfect, walk, raw or none (`walks`)
    recordings = ["walks"]                    # folders, from where the file is (`walks`)

    [parameters.smoother]                     # a grid: each with each, in place of the method without
    magnetic.rounds = [1, 2, 3]
    walk.floors = [false, true]

    [reading.walks]                           # how the recordings of a folder are read
    format = "openshoe"                       # without it the format is recognized from the content
    calibration = "foot.json"                 # of `fg-nav calibrate`, from where the file is: `loop` of these walks

Scenarios or recordings must be there, or both; methods must. Parameters of `iez` are for all its presets in the file,
those of `"iez:physical"` for that one alone.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from pathlib import Path
from typing import Annotated, Any, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from fg_nav.calibration.of_recording import Calibration, read_calibration
from fg_nav.errors import CampaignError, FgNavError
from fg_nav.io.formats import list_formats
from fg_nav.lab.campaign.execute import Task, recorded_keys, settings_of, simulated_keys, tasks_of
from fg_nav.lab.campaign.methods import Method, method_of
from fg_nav.lab.campaign.walks import (
    LOOP,
    MAGNETOMETERS,
    MIXTURES,
    RECORDED,
    Reading,
    Simulated,
    Source,
    UserScenario,
    WalkFile,
    find_walks,
)
from fg_nav.lab.simulation import Scenario, scenario
from fg_nav.lab.simulation.scenario_file import SUFFIX, shorten
from fg_nav.lab.simulation.scenarios import FIELDS
from fg_nav.lab.store.results import Key
from fg_nav.text import Changes, Scalar, read_small

FIRST_SEED = 101  # Filters are tuned on seeds below 100.

MAX_RESULTS = 1_000_000

ON_A_FOOT = ("heel", "instep")

Names = Annotated[
    list[Annotated[str, Field(min_length=1)]],
    Field(min_length=1, description='give a list of names, ["one", "another"]'),
]

Seed = Annotated[int, Field(ge=0, lt=2**63)]

_SEEDS = "give seeds = 20 and, if you like, first_seed = 101; or seeds = [1, 2]"
_GRIDS = "write [parameters.METHOD] and its parameters below"
_READINGS = "write [reading.FOLDER] and its options below"


class _Strict(BaseModel):
    """A table of the file: no other keys, and no value of another type."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class ReadingTable(_Strict):
    """Options of a folder of recordings, as `fg-nav run` has them."""

    format: Annotated[str | None, Field(description="give a name")] = None
    calibration: Annotated[str | None, Field(description="give a name")] = None


class PlanFile(_Strict):
    """The file: each field's description says what to write."""

    scenarios: Names = []
    fields: Names = ["indoor"]
    seeds: Annotated[Seed | Annotated[list[Seed], Field(min_length=1)] | None, Field(description=_SEEDS)] = None
    first_seed: Annotated[Seed, Field(description=_SEEDS)] = FIRST_SEED
    methods: Names = []
    magnetometers: Names = [LOOP]
    recordings: Names = []
    reading: Annotated[dict[str, ReadingTable], Field(description=_READINGS)] = {}
    parameters: Annotated[dict[str, dict[str, Any]], Field(description=_GRIDS)] = {}


@dataclass(frozen=True)
class Plan:
    """All names are known, and all lists without repetition.

    Attributes
    ----------
    scenarios, fields, seeds, magnetometers : of the simulated walks; the last of the recorded ones too.
    methods : words, those with parameters one for each point of the grid (`fg_nav.lab.campaign.methods`).
    walks : recorded.
    own : the user's scenarios, by name among the others.
    """

    scenarios: tuple[str, ...]
    fields: tuple[str, ...]
    seeds: Sequence[int]
    methods: tuple[str, ...]
    magnetometers: tuple[str, ...]
    walks: tuple[WalkFile, ...] = ()
    own: tuple[UserScenario, ...] = ()

    def list_keys(self) -> list[Key]:
        """Return the keys of all results; raises `CampaignError` if two would be stored in one file."""
        recorded: dict[str, list[str]] = {}
        for walk in self.walks:
            recorded.setdefault(walk.group, []).append(walk.name)
        calibrated = {walk.group for walk in self.walks if walk.source.reading.calibration is not None}
        keys = [
            *simulated_keys(self.scenarios, self.fields, self.magnetometers, self.methods, self.seeds),
            *recorded_keys(recorded, RECORDED, self.magnetometers, self.methods, calibrated),
        ]
        by_file: dict[str, Key] = {}
        for key in keys:
            other = by_file.setdefault(key.file.casefold(), key)
            if other is not key:
                raise CampaignError(
                    f"'{other.walk}' of '{other.group}' and '{key.walk}' of '{key.group}' would be kept in one file: "
                    "rename one."
                )
        return keys

    def settings(self, keys: Sequence[Key]) -> dict[Key, Mapping[str, Any]]:
        """Return what each result is made with; the walks of one scenario share it."""
        files = {(walk.group, walk.name): (walk.sums(), walk.source.reading) for walk in self.walks}
        own = {one.name: one for one in self.own}
        simulated = cache(settings_of)
        return {
            key: settings_of(key, True, *files[key.group, key.walk])
            if key.field == RECORDED
            else simulated(replace(key, walk=""), own=own.get(key.group))
            for key in keys
        }

    def tasks(self, missing: Sequence[Key], settings: Mapping[Key, Mapping[str, Any]]) -> list[Task]:
        """Return what is missing, walk by walk."""
        recorded: dict[tuple[str, str], Source] = {(walk.group, walk.name): walk.source for walk in self.walks}
        own = {one.name: one for one in self.own}
        return [
            replace(task, source=Simulated(task.group, task.field, int(task.walk), own[task.group]))
            if task.group in own and task.field != RECORDED
            else task
            for task in tasks_of(missing, settings, recorded)
        ]


def read_plan(path: Path) -> Plan:
    """Read a plan, and look into its folders.

    Raises
    ------
    CampaignError
        If the file cannot be read, has unknown keys or names, or values of another type.
    """
    content = _read_toml(path)
    try:
        return _plan(_validate(content), path.parent)
    except FgNavError as error:
        raise CampaignError(f"{path.name}: {error}") from None


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(read_small(path).decode("utf-8-sig"))
    except OSError as error:
        raise CampaignError(f"the plan {path} cannot be read ({error.strerror}): name a .toml file.") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise CampaignError(f"{path.name} is no TOML: {error}.") from None
    except (ValueError, RecursionError):  # Python reads so many digits only, and lists in so many lists
        raise CampaignError(f"{path.name} has a number too long or a list too deep to be read: correct it.") from None


def _validate(content: Mapping[str, Any]) -> PlanFile:
    try:
        return PlanFile.model_validate(content)
    except ValidationError as error:
        raise CampaignError(_describe(error, content)) from None


def _describe(error: ValidationError, content: Mapping[str, Any]) -> str:
    """Return one sentence on the first error: where, what stands there, and what to write."""
    first = error.errors()[0]
    name, *inner = first["loc"]
    table = ReadingTable if name == "reading" and len(inner) > 1 else PlanFile
    key, where = (inner[1], f"reading.{inner[0]}") if table is ReadingTable else (name, "a plan")
    if first["type"] == "extra_forbidden":
        return f"there is no '{key}' in {where}: it knows {', '.join(table.model_fields)}."
    value = content["reading"][inner[0]][key] if table is ReadingTable else content[str(name)]
    place = f"{key} of {where}" if table is ReadingTable else key
    return f"{place} cannot be {shorten(repr(value))}: {table.model_fields[str(key)].description}."


def _plan(file: PlanFile, folder: Path) -> Plan:
    given = file.model_fields_set
    if not file.scenarios and not file.recordings:
        raise CampaignError("nothing to walk on: give scenarios or recordings.")
    if not file.scenarios and {"seeds", "first_seed", "fields"} & given:
        raise CampaignError("seeds and fields are of scenarios, and there are none: give some, or leave those out.")
    scenarios = tuple(dict.fromkeys(file.scenarios))
    own = [_read_scenario(folder / name) for name in scenarios if name.endswith(SUFFIX)]
    names = _names(scenarios)
    by_name = {one.name: one.scenario for one in own}
    for name in names:
        _check_scenario(name, by_name.get(name) or scenario(name))
    fields = _check_known("field", file.fields, (*FIELDS, *MIXTURES))
    magnetometers = _check_known("magnetometer", file.magnetometers, MAGNETOMETERS)
    seeds = _seeds(file) if scenarios else range(0)
    methods = _methods(list(dict.fromkeys(file.methods)), file.parameters)
    readings = {name: _reading(table, folder) for name, table in file.reading.items()}
    walks = find_walks([folder / name for name in dict.fromkeys(file.recordings)], readings)
    _check_size((len(names) * len(fields) * len(seeds) + len(walks)) * len(magnetometers) * len(methods))
    return Plan(names, fields, seeds, methods, magnetometers, walks, tuple(own))


def _check_known(what: str, given: Sequence[str], known: Sequence[str]) -> tuple[str, ...]:
    for one in given:
        if one not in known:
            raise CampaignError(f"there is no {what} '{one}': choose one of {', '.join(known)}.")
    return tuple(dict.fromkeys(given))


def _names(scenarios: Sequence[str]) -> tuple[str, ...]:
    """Names of scenarios, that of the file if it is one; raises `CampaignError` if two have the same."""
    names = tuple(Path(one).name if one.endswith(SUFFIX) else one for one in scenarios)
    for name in names:
        if names.count(name) > 1:
            raise CampaignError(f"two scenarios are named '{name}': rename one, results go by its name.")
    return names


def _read_scenario(path: Path) -> UserScenario:
    """Read a file, and check its scenario; raises `CampaignError` or `SimulationError`."""
    try:
        own = UserScenario(path.name, read_small(path).decode("utf-8"))
    except OSError as error:
        raise CampaignError(f"the scenario {path} cannot be read ({error.strerror}): name a file that can.") from None
    except UnicodeDecodeError as error:
        raise CampaignError(f"{path.name} is no TOML: {error}.") from None
    _ = own.scenario
    return own


def _check_scenario(name: str, one: Scenario) -> None:
    if one.worn not in ON_A_FOOT:
        raise CampaignError(f"the sensor of '{name}' is on no foot ({one.worn}): choose a scenario of a foot.")


def _reading(table: ReadingTable, folder: Path) -> Reading:
    if table.format is not None:
        _check_known("format", [table.format], tuple(list_formats()))
    return Reading(table.format, None if table.calibration is None else _calibration(folder / table.calibration))


def _calibration(path: Path) -> Calibration:
    calibration = read_calibration(path)
    if calibration.magnetometer is None:
        raise CampaignError(f"{path.name} has no magnetometer: calibrate on circles, or leave it out.")
    return calibration


def _seeds(file: PlanFile) -> Sequence[int]:
    if file.seeds is None:
        raise CampaignError("no seeds: give how many walks of each scenario, seeds = 20, or a list.")
    if isinstance(file.seeds, list) and "first_seed" not in file.model_fields_set:
        return list(dict.fromkeys(file.seeds))
    if isinstance(file.seeds, list) or file.seeds == 0:
        raise CampaignError(f"seeds cannot be {file.seeds!r}: {_SEEDS}.")
    _check_size(file.seeds)
    return range(file.first_seed, file.first_seed + file.seeds)


def _check_size(results: int) -> None:
    if results > MAX_RESULTS:
        raise CampaignError(f"{results} results are too many: plan at most {MAX_RESULTS}.")


def _methods(words: Sequence[str], grids: Mapping[str, Mapping[str, Any]]) -> tuple[str, ...]:
    """Words of all methods, each with all points of its grids."""
    if not words:
        raise CampaignError('no methods: give some, methods = ["smoother", "iez"].')
    methods = [_method(word) for word in words]
    for name in grids:
        if not any(name in _grid_names(one) for one in methods):
            raise CampaignError(f"parameters are given of '{name}', which is not among the methods: add it there.")
    return tuple(dict.fromkeys(one.word for method in methods for one in _grid_points(method, grids)))


def _method(word: str) -> Method:
    method = method_of(word)
    if method.changes or word.endswith(","):
        raise CampaignError(f"'{word}' has parameters in its name: write [parameters.{method.name}] below.")
    return method


def _grid_points(method: Method, grids: Mapping[str, Mapping[str, Any]]) -> Iterator[Method]:
    grid: dict[str, list[Scalar]] = {}
    for name in _grid_names(method):
        grid |= _flatten(grids.get(name, {}), name)
    size = 1
    for values in grid.values():
        size *= len(values)
        _check_size(size)
    for point in product(*grid.values()):
        changes: Changes = tuple(sorted(zip(grid, point, strict=True)))
        yield replace(method, changes=changes).checked()


def _grid_names(method: Method) -> tuple[str, str]:
    """Names of its tables of parameters, that of all presets first."""
    return method.name, f"{method.name}:{method.preset}"


def _flatten(table: Mapping[str, Any], where: str) -> dict[str, list[Scalar]]:
    """Dotted names, each with its values."""
    flat: dict[str, list[Scalar]] = {}
    for name, value in _dotted(table):
        values = value if isinstance(value, list) else [value]
        if not values or not all(type(one) in get_args(Scalar) for one in values):
            raise CampaignError(
                f"{name} of {where} cannot be {value!r}: give a number, true or false, a word, or a list."
            )
        if name in flat:
            raise CampaignError(f"{name} of {where} is given twice, with and without quotes: give it once.")
        flat[name] = values
    return flat


def _dotted(table: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in table.items():
        if isinstance(value, Mapping):
            yield from _dotted(value, f"{before}{name}.")
        else:
            yield f"{before}{name}", value
