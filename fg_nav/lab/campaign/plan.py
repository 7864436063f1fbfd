"""What a campaign is to make, from a TOML file; checked before anything is made.

    scenarios = ["office", "my_walk.toml"]    # of `fg-nav simulate --list`, on a foot, or files with one (`own`)
    fields = ["smooth", "indoor"]             # without it: "indoor"
    seeds = 20                                # so many from first_seed on (101), or a list of them
    methods = ["smoother", "ma2018", "iez:physical"]
    magnetometers = ["loop"]                  # loop (without it), perfect, walk, raw or none (`sources`)
    recordings = ["walks"]                    # folders, from where the file is (`recordings`)

    [parameters.smoother]                     # a grid: each with each, in place of the method without
    magnetic.rounds = [1, 2, 3]
    walk.floors = [false, true]

    [reading.walks]                           # how the recordings of a folder are read (`reading`)
    format = "openshoe"

Scenarios or recordings must be there, or both; methods must. Parameters of `iez` go to all its presets in the file,
those of `"iez:physical"` to that one alone.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any, TypeGuard

from fg_nav.changes import SCALARS, Changes, Scalar
from fg_nav.errors import CampaignError, FgNavError
from fg_nav.lab.campaign.methods import Method, method_of
from fg_nav.lab.campaign.own import Own, read_own
from fg_nav.lab.campaign.reading import readings
from fg_nav.lab.campaign.recordings import Walk, walks_in
from fg_nav.lab.campaign.sources import LOOP, MAGNETOMETERS, MIXTURES
from fg_nav.lab.simulation import Scenario, scenario
from fg_nav.lab.simulation.scenario_file import SUFFIX
from fg_nav.lab.simulation.scenarios import FIELDS

FIRST_SEED = 101
"""Filters are tuned on seeds below 100."""

MOST_CELLS = 1_000_000

ON_A_FOOT = ("heel", "instep")

KNOWN = (
    "scenarios",
    "fields",
    "seeds",
    "first_seed",
    "methods",
    "magnetometers",
    "recordings",
    "reading",
    "parameters",
)


@dataclass(frozen=True)
class Plan:
    """All names are known, and all lists without repetition.

    Attributes
    ----------
    scenarios, fields, seeds, magnetometers : of the simulated walks; the last of the recorded ones too.
    methods : words, those with parameters one for each point of the grid (`fg_nav.lab.campaign.methods`).
    walks : recorded.
    own : the scenarios that are the user's own, by name among the others.
    """

    scenarios: tuple[str, ...]
    fields: tuple[str, ...]
    seeds: Sequence[int]
    methods: tuple[str, ...]
    magnetometers: tuple[str, ...]
    walks: tuple[Walk, ...] = ()
    own: tuple[Own, ...] = ()


def read_plan(path: Path) -> Plan:
    """Read a plan, and look into its folders.

    Raises
    ------
    CampaignError
        If the file cannot be read, knows words that we do not, or asks for what there is not.
    """
    content = _content(path)
    try:
        return _plan(content, path.parent)
    except FgNavError as error:
        raise CampaignError(f"{path.name}: {error}") from None


def _content(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise CampaignError(f"the plan {path} cannot be read ({error.strerror}): name a .toml file.") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise CampaignError(f"{path.name} is no TOML: {error}.") from None
    except (ValueError, RecursionError):  # Python reads so many digits only, and lists in so many lists
        raise CampaignError(f"{path.name} has a number too long or a list too deep to be read: correct it.") from None


def _plan(content: Mapping[str, Any], folder: Path) -> Plan:
    for name in content:
        if name not in KNOWN:
            raise CampaignError(f"there is no '{name}' in a plan: it knows {', '.join(KNOWN)}.")
    scenarios, recordings = _words(content, "scenarios", ()), _words(content, "recordings", ())
    if not scenarios and not recordings:
        raise CampaignError("nothing to walk on: give scenarios or recordings.")
    if not scenarios and {"seeds", "first_seed", "fields"} & content.keys():
        raise CampaignError("seeds and fields are of scenarios, and there are none: give some, or leave those out.")
    own = [read_own(folder / name) for name in scenarios if name.endswith(SUFFIX)]
    scenarios = _named(scenarios)
    by_name = {one.name: one.scenario for one in own}
    for name in scenarios:
        _check_scenario(name, by_name.get(name) or scenario(name))
    fields = _known(content, "fields", (*FIELDS, *MIXTURES), ("indoor",))
    magnetometers = _known(content, "magnetometers", MAGNETOMETERS, (LOOP,))
    seeds = _seeds(content) if scenarios else range(0)
    methods = _methods(_words(content, "methods", ()), content.get("parameters", {}))
    walks = walks_in([folder / name for name in recordings], readings(content.get("reading", {}), folder))
    _check_size((len(scenarios) * len(fields) * len(seeds) + len(walks)) * len(magnetometers) * len(methods))
    return Plan(scenarios, fields, seeds, methods, magnetometers, walks, tuple(own))


def _words(content: Mapping[str, Any], name: str, default: tuple[str, ...]) -> tuple[str, ...]:
    """Return a list of texts, each once."""
    if name not in content:
        return default
    given = content[name]
    if not isinstance(given, list) or not given or not all(isinstance(one, str) and one for one in given):
        raise CampaignError(f'{name} cannot be {given!r}: give a list of names, ["one", "another"].')
    return tuple(dict.fromkeys(given))


def _known(content: Mapping[str, Any], name: str, known: Sequence[str], default: tuple[str, ...]) -> tuple[str, ...]:
    given = _words(content, name, default)
    for one in given:
        if one not in known:
            raise CampaignError(f"there is no {name.removesuffix('s')} '{one}': choose one of {', '.join(known)}.")
    return given


def _named(scenarios: Sequence[str]) -> tuple[str, ...]:
    """Names of scenarios, that of the file where it is one; raises `CampaignError` where two have the same."""
    names = tuple(Path(one).name if one.endswith(SUFFIX) else one for one in scenarios)
    for name in names:
        if names.count(name) > 1:
            raise CampaignError(f"two scenarios are named '{name}': rename one, results go by its name.")
    return names


def _check_scenario(name: str, one: Scenario) -> None:
    if one.worn not in ON_A_FOOT:
        raise CampaignError(f"the sensor of '{name}' is on no foot ({one.worn}): choose a scenario of a foot.")


def _seeds(content: Mapping[str, Any]) -> Sequence[int]:
    given, first = content.get("seeds"), content.get("first_seed", FIRST_SEED)
    if given is None:
        raise CampaignError("no seeds: give how many walks of each scenario, seeds = 20, or a list.")
    if isinstance(given, list) and given and all(_is_count(seed) for seed in given) and "first_seed" not in content:
        return list(dict.fromkeys(given))
    if _is_count(given) and given > 0 and _is_count(first):
        _check_size(given)
        return range(first, first + given)
    raise CampaignError("seeds cannot be read: give seeds = 20 and, if you like, first_seed = 101; or seeds = [1, 2].")


def _is_count(value: object) -> TypeGuard[int]:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 2**63


def _check_size(cells: int) -> None:
    if cells > MOST_CELLS:
        raise CampaignError(f"{cells} results are too many: plan at most {MOST_CELLS}.")


def _methods(words: Sequence[str], grids: Any) -> tuple[str, ...]:
    """Words of all methods, each with all that its grids make of it."""
    if not words:
        raise CampaignError('no methods: give some, methods = ["smoother", "iez"].')
    if not isinstance(grids, Mapping) or not all(isinstance(grid, Mapping) for grid in grids.values()):
        raise CampaignError("parameters is no table: write [parameters.METHOD] and its parameters below.")
    plain = [_without_changes(word) for word in words]
    for name in grids:
        if not any(name in _names(one) for one in plain):
            raise CampaignError(f"parameters are given of '{name}', which is not among the methods: add it there.")
    all_of_them = [one.word for method in plain for one in _variants(method, grids)]
    return tuple(dict.fromkeys(all_of_them))


def _without_changes(word: str) -> Method:
    method = method_of(word)
    if method.changes or word.endswith(","):
        raise CampaignError(f"'{word}' has parameters in its name: write [parameters.{method.name}] below.")
    return method


def _variants(method: Method, grids: Mapping[str, Mapping[str, Any]]) -> Iterator[Method]:
    grid: dict[str, list[Scalar]] = {}
    for name in _names(method):
        grid |= _flat(grids.get(name, {}), name)
    size = 1
    for values in grid.values():
        size *= len(values)
        _check_size(size)
    for point in product(*grid.values()):
        changes: Changes = tuple(sorted(zip(grid, point, strict=True)))
        yield replace(method, changes=changes).checked()


def _names(method: Method) -> tuple[str, str]:
    """Names that its parameters can be given under, that of all presets first."""
    return method.name, f"{method.name}:{method.preset}"


def _flat(table: Mapping[str, Any], where: str) -> dict[str, list[Scalar]]:
    """Dotted names, each with its values."""
    flat: dict[str, list[Scalar]] = {}
    for name, value in _dotted(table):
        values = value if isinstance(value, list) else [value]
        if not values or not all(type(one) in SCALARS for one in values):
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
