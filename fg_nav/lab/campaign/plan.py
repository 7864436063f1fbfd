"""What a campaign is to make, from a TOML file (docs/campaigns.md); checked by types before anything is made.

Scenarios or recordings must be there, or both; methods must. Parameters of `iez` are for all its presets in the file,
those of `"iez:physical"` for that one alone.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from math import prod
from pathlib import Path
from typing import Annotated, Any, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from fg_nav.calibration.of_recording import read_calibration
from fg_nav.errors import CampaignError, FgNavError
from fg_nav.io.formats import list_formats
from fg_nav.lab.campaign.execute import Settings, recorded_keys, settings_of, simulated_keys
from fg_nav.lab.campaign.methods import method_of
from fg_nav.lab.campaign.walks import (
    LOOP,
    MAGNETOMETERS,
    MIXTURES,
    RECORDED,
    Reading,
    Recorded,
    Simulated,
    Source,
    UserScenario,
    find_walks,
)  # fmt: skip
from fg_nav.lab.simulation import scenario
from fg_nav.lab.simulation.checks import shorten
from fg_nav.lab.simulation.scenario_file import SUFFIX
from fg_nav.lab.simulation.scenarios import FIELDS
from fg_nav.lab.store.results import Key
from fg_nav.text import Scalar, read_small

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
    """All names are known, and all lists without repetition."""

    scenarios: tuple[str, ...]
    fields: tuple[str, ...]
    seeds: Sequence[int]
    methods: tuple[str, ...]  # Words (`fg_nav.lab.campaign.methods`), one for each point of a grid.
    magnetometers: tuple[str, ...]  # Of recorded walks too.
    walks: Mapping[tuple[str, str], Recorded]  # By folder and name.
    own: Mapping[str, UserScenario]  # The user's scenarios, by name among the others.

    def list_keys(self) -> list[Key]:
        """Return the keys of all results; raises `CampaignError` if two would be stored in one file."""
        recorded: dict[str, list[str]] = {}
        for group, name in self.walks:
            recorded.setdefault(group, []).append(name)
        calibrated = {group for (group, _), walk in self.walks.items() if walk.reading.calibration is not None}
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

    def settings(self, keys: Sequence[Key]) -> dict[Key, Settings]:
        """Return what each result is made with; the walks of one scenario share it."""
        files = {name: (walk.sums(), walk.reading) for name, walk in self.walks.items()}
        simulated = cache(settings_of)
        return {
            key: settings_of(key, True, *files[key.group, key.walk])
            if key.field == RECORDED
            else simulated(replace(key, walk=""), own=self.own.get(key.group))
            for key in keys
        }

    def find_source(self, key: Key) -> Source:
        """Return the walk of a result."""
        if key.field == RECORDED:
            return self.walks[key.group, key.walk]
        return Simulated(key.group, key.field, int(key.walk), self.own.get(key.group))


def read_plan(path: Path) -> Plan:
    """Read a plan, and look into its folders.

    Raises `CampaignError` if the file cannot be read, has unknown keys or names, or values of another type.
    """
    text = _read_text(path, "plan")
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise CampaignError(f"{path.name} is no TOML: {error}.") from None
    except (ValueError, RecursionError):  # Python reads so many digits only, and lists in so many lists
        raise CampaignError(f"{path.name} has a number too long or a list too deep to be read: correct it.") from None
    try:
        return _check_plan(PlanFile.model_validate(content), path.parent)
    except ValidationError as error:
        raise CampaignError(f"{path.name}: {_describe(error)}") from None
    except FgNavError as error:
        raise CampaignError(f"{path.name}: {error}") from None


def _read_text(path: Path, what: str) -> str:
    try:
        return read_small(path).decode("utf-8-sig")
    except OSError as error:
        raise CampaignError(f"the {what} {path} cannot be read ({error.strerror}): name a .toml file.") from None
    except UnicodeDecodeError as error:
        raise CampaignError(f"{path.name} is no TOML: {error}.") from None


def _describe(error: ValidationError) -> str:
    """Return one sentence on the first error: where, what stands there, and what to write."""
    first = error.errors()[0]
    name, *inner = map(str, first["loc"])
    key, where, known = name, "", PlanFile.model_fields
    if name == "reading" and len(inner) > 1:
        key, where, known = inner[1], f" of reading.{inner[0]}", ReadingTable.model_fields
    if first["type"] == "extra_forbidden":
        return f"there is no '{key}' in {where[4:] or 'a plan'}: it knows {', '.join(known)}."
    return f"{key}{where} cannot be {shorten(repr(first['input']))}: {known[key].description}."


def _check_plan(file: PlanFile, folder: Path) -> Plan:
    """Return the plan of a file with these folders beside it; raises `CampaignError` if it cannot be."""
    if not file.scenarios and not file.recordings:
        raise CampaignError("nothing to walk on: give scenarios or recordings.")
    if not file.scenarios and {"seeds", "first_seed", "fields"} & file.model_fields_set:
        raise CampaignError("seeds and fields are of scenarios, and there are none: give some, or leave those out.")
    # Scenarios, of ours and of the user's files.
    scenarios, own = {}, {}
    for given in dict.fromkeys(file.scenarios):
        name = Path(given).name if given.endswith(SUFFIX) else given
        if name in scenarios:
            raise CampaignError(f"two scenarios are named '{name}': rename one, results go by its name.")
        if given.endswith(SUFFIX):
            own[name] = UserScenario(name, _read_text(folder / given, "scenario"))
        scenarios[name] = own[name].scenario if name in own else scenario(name)
        if scenarios[name].worn not in ON_A_FOOT:
            worn = scenarios[name].worn
            raise CampaignError(f"the sensor of '{name}' is on no foot ({worn}): choose a scenario of a foot.")
    # Recordings, and how they are read.
    readings = {}
    for name, table in file.reading.items():
        if table.format is not None:
            _check_known("format", [table.format], tuple(list_formats()))
        calibration = None if table.calibration is None else read_calibration(folder / table.calibration)
        if calibration is not None and calibration.magnetometer is None:
            raise CampaignError(f"{table.calibration} has no magnetometer: calibrate on circles, or leave it out.")
        readings[name] = Reading(table.format, calibration)
    walks = find_walks([folder / name for name in dict.fromkeys(file.recordings)], readings)
    # All results.
    fields = _check_known("field", file.fields, (*FIELDS, *MIXTURES))
    magnetometers = _check_known("magnetometer", file.magnetometers, MAGNETOMETERS)
    seeds = _list_seeds(file) if scenarios else range(0)
    methods = _list_methods(list(dict.fromkeys(file.methods)), file.parameters)
    results = (len(scenarios) * len(fields) * len(seeds) + len(walks)) * len(magnetometers) * len(methods)
    if results > MAX_RESULTS:
        raise CampaignError(f"{results} results are too many: plan at most {MAX_RESULTS}.")
    return Plan(tuple(scenarios), fields, seeds, methods, magnetometers, walks, own)


def _check_known(what: str, given: Sequence[str], known: Sequence[str]) -> tuple[str, ...]:
    for one in given:
        if one not in known:
            raise CampaignError(f"there is no {what} '{one}': choose one of {', '.join(known)}.")
    return tuple(dict.fromkeys(given))


def _list_seeds(file: PlanFile) -> Sequence[int]:
    if file.seeds is None:
        raise CampaignError("no seeds: give how many walks of each scenario, seeds = 20, or a list.")
    if isinstance(file.seeds, list) and "first_seed" not in file.model_fields_set:
        return list(dict.fromkeys(file.seeds))
    if isinstance(file.seeds, list) or file.seeds == 0:
        raise CampaignError(f"seeds cannot be {file.seeds!r}: {_SEEDS}.")
    return range(file.first_seed, file.first_seed + file.seeds)


def _list_methods(words: Sequence[str], grids: Mapping[str, Mapping[str, Any]]) -> tuple[str, ...]:
    """Words of all methods, each with all points of its grids: that of all its presets, and that of its own."""
    if not words:
        raise CampaignError('no methods: give some, methods = ["smoother", "iez"].')
    found: list[str] = []
    unused = set(grids)
    for word in words:
        method = method_of(word)
        if method.changes or word.endswith(","):
            raise CampaignError(f"'{word}' has parameters in its name: write [parameters.{method.name}] below.")
        grid: dict[str, list[Scalar]] = {}
        for name in (method.name, f"{method.name}:{method.preset}"):
            grid |= _flatten(grids.get(name, {}), name)
            unused.discard(name)
        if (points := prod(len(values) for values in grid.values())) > MAX_RESULTS:
            raise CampaignError(f"{points} results are too many: plan at most {MAX_RESULTS}.")
        changes = (tuple(sorted(zip(grid, point, strict=True))) for point in product(*grid.values()))
        found += [replace(method, changes=some).checked().word for some in changes]
    if unused:
        raise CampaignError(f"parameters are given of '{min(unused)}', which is not among the methods: add it there.")
    return tuple(dict.fromkeys(found))


def _flatten(table: Mapping[str, Any], where: str, before: str = "") -> dict[str, list[Scalar]]:
    """Dotted names, each with its values."""
    flat: dict[str, list[Scalar]] = {}
    for key, value in table.items():
        name, values = f"{before}{key}", value if isinstance(value, list) else [value]
        if isinstance(value, Mapping):
            inner = _flatten(value, where, f"{name}.")
        elif values and all(type(one) in get_args(Scalar) for one in values):
            inner = {name: values}
        else:
            words = f"{name} of {where} cannot be {value!r}"
            raise CampaignError(f"{words}: give a number, true or false, a word, or a list.")
        if twice := flat.keys() & inner.keys():
            raise CampaignError(f"{min(twice)} of {where} is given twice, with and without quotes: give it once.")
        flat |= inner
    return flat
