"""What a campaign is to make, from a TOML file (docs/campaigns.md); checked by types before anything is made.

Scenarios or recordings must be there, or both; methods must. Parameters of `iez` are for all its presets in the file,
those of `"iez:physical"` for that one alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from math import prod
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from fg_nav.calibration.of_recording import read_calibration
from fg_nav.errors import CampaignError, FgNavError
from fg_nav.io.formats import list_formats
from fg_nav.lab.campaign.execute import Settings, recorded_keys, settings_of, simulated_keys
from fg_nav.lab.campaign.methods import method_of
from fg_nav.lab.campaign.walks import (
    LOOP,
    MAGNETOMETERS,
    RECORDED,
    Reading,
    Recorded,
    Simulated,
    Source,
    find_walks,
)  # fmt: skip
from fg_nav.lab.simulation.checks import Table, check_known
from fg_nav.lab.simulation.person import MOUNTS
from fg_nav.lab.simulation.scenario_file import SUFFIX
from fg_nav.lab.simulation.scenarios import FIELDS
from fg_nav.lab.store.results import Key
from fg_nav.text import Scalar, flatten, parse_toml, read_small

FIRST_SEED = 101  # Filters are tuned on seeds below 100.

MAX_RESULTS = 1_000_000

Names = Annotated[tuple[Annotated[str, Field(min_length=1)], ...], Field(min_length=1)]

Seed = Annotated[int, Field(ge=0, lt=2**63)]


class ReadingTable(Table):
    """Options of a folder of recordings, as `fg-nav run` has them."""

    format: str | None = None
    calibration: str | None = None


class PlanFile(Table):
    """The file."""

    scenarios: Names = ()
    fields: Names = ("indoor",)
    seeds: Annotated[Seed, Field(ge=1)] | Annotated[tuple[Seed, ...], Field(min_length=1)] | None = None
    first_seed: Seed = FIRST_SEED
    methods: Names = ()
    magnetometers: Names = (LOOP,)
    recordings: Names = ()
    reading: dict[str, ReadingTable] = Field(default_factory=dict)
    parameters: dict[str, dict[str, Any]] = Field(default_factory=dict)


@dataclass(frozen=True)
class Plan:
    """Results that are asked for, and where their walks are from."""

    keys: Sequence[Key]
    walks: Mapping[tuple[str, str], Recorded]  # By folder and name.
    own: Mapping[str, bytes]  # Files of the user's scenarios, by name.

    def settings(self) -> dict[Key, Settings]:
        """Return what each result is made with; the walks of one scenario share it."""
        shared = cache(lambda key: settings_of(key, self.find_source(key)))
        return {key: shared(key if key.field == RECORDED else replace(key, walk="0")) for key in self.keys}

    def find_source(self, key: Key) -> Source:
        """Return the walk of a result."""
        if key.field == RECORDED:
            return self.walks[key.group, key.walk]
        return Simulated(key.group, key.field, int(key.walk), self.own.get(key.group))


def read_plan(path: Path) -> Plan:
    """Read a plan, and look into its folders.

    Raises `CampaignError` if the file cannot be read, has unknown keys or names, or values of another type.
    """
    content = _read(path, "plan")
    try:
        return _check_plan(PlanFile.read(parse_toml(content)), path.parent)
    except FgNavError as error:
        raise CampaignError(f"{path.name}: {error}") from None


def _read(path: Path, what: str) -> bytes:
    try:
        return read_small(path)
    except OSError as error:
        raise CampaignError(f"the {what} {path} cannot be read ({error.strerror}): name a .toml file.") from None


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
            own[name] = _read(folder / given, "scenario")
        scenarios[name] = Simulated(name, "", 0, own.get(name)).scenario
        if (worn := scenarios[name].worn) not in MOUNTS:
            raise CampaignError(f"the sensor of '{name}' is on no foot ({worn}): choose a scenario of a foot.")
    # Recordings, and how they are read.
    readings = {}
    for name, table in file.reading.items():
        if table.format is not None:
            check_known("format", table.format, list_formats())
        calibration = None if table.calibration is None else read_calibration(folder / table.calibration)
        if calibration is not None and calibration.magnetometer is None:
            raise CampaignError(f"{table.calibration} has no magnetometer: calibrate on circles, or leave it out.")
        readings[name] = Reading(table.format, calibration)
    walks = find_walks([folder / name for name in dict.fromkeys(file.recordings)], readings)
    # All results; two must not be stored in one file.
    fields, magnetometers = (list(dict.fromkeys(names)) for names in (file.fields, file.magnetometers))
    for what, names, known in (("field", fields, FIELDS), ("magnetometer", magnetometers, MAGNETOMETERS)):
        for one in names:
            check_known(what, one, known)
    seeds = _list_seeds(file) if scenarios else range(0)
    methods = _list_methods(list(dict.fromkeys(file.methods)), file.parameters)
    results = (len(scenarios) * len(fields) * len(seeds) + len(walks)) * len(magnetometers) * len(methods)
    if results > MAX_RESULTS:
        raise CampaignError(f"{results} results are too many: plan at most {MAX_RESULTS}.")
    by_group: dict[str, list[str]] = {}
    for group, walk in walks:
        by_group.setdefault(group, []).append(walk)
    calibrated = {group for (group, _), walk in walks.items() if walk.reading.calibration is not None}
    keys = simulated_keys(list(scenarios), fields, magnetometers, methods, seeds)
    keys += recorded_keys(by_group, RECORDED, magnetometers, methods, calibrated)
    by_file: dict[str, Key] = {}
    for key in keys:
        other = by_file.setdefault(key.file.casefold(), key)
        if other is not key:
            both = f"'{other.walk}' of '{other.group}' and '{key.walk}' of '{key.group}'"
            raise CampaignError(f"{both} would be kept in one file: rename one.")
    return Plan(keys, walks, own)


def _list_seeds(file: PlanFile) -> Sequence[int]:
    if file.seeds is None:
        raise CampaignError("no seeds: give how many walks of each scenario, seeds = 20, or a list.")
    if isinstance(file.seeds, int):
        return range(file.first_seed, file.first_seed + file.seeds)
    if "first_seed" in file.model_fields_set:
        raise CampaignError("first_seed is of a number of seeds, and there is a list of them: leave it out.")
    return list(dict.fromkeys(file.seeds))


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
            grid |= _read_grid(grids.get(name, {}), name)
            unused.discard(name)
        if (points := prod(len(values) for values in grid.values())) > MAX_RESULTS:
            raise CampaignError(f"{points} results are too many: plan at most {MAX_RESULTS}.")
        changes = (tuple(sorted(zip(grid, point, strict=True))) for point in product(*grid.values()))
        found += [replace(method, changes=some).checked().word for some in changes]
    if unused:
        raise CampaignError(f"parameters are given of '{min(unused)}', which is not among the methods: add it there.")
    return tuple(dict.fromkeys(found))


def _read_grid(table: Mapping[str, Any], where: str) -> dict[str, list[Scalar]]:
    """Dotted names, each with its values."""
    grid: dict[str, list[Scalar]] = {}
    for whole, value in flatten(table, where):
        name, values = whole.removeprefix(f"{where}."), value if isinstance(value, list) else [value]
        known = [one for one in values if isinstance(one, Scalar)]
        if not values or len(known) < len(values):
            words = f"{name} of {where} cannot be {value!r}"
            raise CampaignError(f"{words}: give a number, true or false, a word, or a list.")
        if name in grid:
            raise CampaignError(f"{name} of {where} is given twice, with and without quotes: give it once.")
        grid[name] = known
    return grid
