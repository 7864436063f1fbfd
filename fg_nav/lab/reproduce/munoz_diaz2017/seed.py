"""Both walks of a seed: every figure that is read off them, one small file a seed, so that an ended run goes on.

A kept seed holds as long as what it was made with is the same: form, parameters, cases and readings, and the sources
that make figures (`code_sum`); and as long as its pictures are there, if it has any.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import fg_nav
from fg_nav.arrays import Floats
from fg_nav.calibration.allan import AllanCurve
from fg_nav.lab.campaign.kept import sum_over
from fg_nav.lab.reproduce.file import from_json, in_json, write_whole
from fg_nav.lab.reproduce.munoz_diaz2017 import figures as pictures
from fg_nav.lab.reproduce.munoz_diaz2017.paper import FIELDS_UT
from fg_nav.lab.reproduce.munoz_diaz2017.rows import (
    AT_A_SECOND,
    AXES,
    EXPECTED,
    FIRST_BIAS,
    FOG,
    LOWEST,
    LOWEST_AT,
    OURS,
    PLAN,
    SECOND_END,
    SECOND_START,
    WHITE,
    Reading,
    across_at,
    errors_of,
    minutes_over,
)
from fg_nav.lab.reproduce.munoz_diaz2017.runs import GRAPHS, PRESET_NAMES, Run, ratio, runs
from fg_nav.lab.reproduce.munoz_diaz2017.walks import (
    BATCH,
    FILTER,
    FIRST,
    ONLINE,
    SECOND_NOISES_UT,
    AllanPair,
    Setting,
    allan_pair,
    cases,
    first_recording,
    first_walk,
    fog_errors,
    noise_of,
    second_recording,
    second_walk,
    sensor_errors,
    setting_of,
)
from fg_nav.plain import plain
from fg_nav.pocket import PRESETS

FORM = 1

Values = dict[str, dict[str, float]]
"""By row (`name_of`) and column; NaN where the walk has nothing to read it off, infinite where a method ended."""

Found = dict[str, dict[str, Run | None]]
"""By case and estimator; None where it ended."""

DRAWN = (FILTER, ONLINE)
"""Estimators whose runs are drawn."""

FOG_HOURS, ALLAN_HOURS = 1.0, 14.0
"""As in the paper."""

_TEXT = "text"
"""Module that no figure depends on."""

_SEEN_ONLY = ("report/", "commands/", "lab/reproduce/", "lab/campaign/", "cli.py")
"""Of the package's sources what makes no figure, beside the modules of this paper."""


@dataclass(frozen=True)
class Wanted:
    """How a seed is made.

    Attributes
    ----------
    quick : without the other noises of the second walk's magnetometer.
    drawn : whether its runs are drawn.
    leg_m : legs of so many metres, m, for tests; None for the paper's.
    """

    quick: bool = False
    drawn: bool = False
    leg_m: float | None = None


def name_of(experiment: str, reading: Reading) -> str:
    """Key of a row's values."""
    return f"{experiment}: {reading.row.quantity}"


def made(seed: int, wanted: Wanted, folder: Path) -> Values:
    """Figures of a seed, made and kept in the folder, and its pictures drawn there, unless they are there already."""
    there = kept(seed, wanted, folder)
    if there is not None:
        return there
    all_of = walked(seed, wanted)
    values = values_of(all_of)
    drawn = _drawn(folder, seed, all_of) if wanted.drawn else []
    content = {"settings": settings_of(seed, wanted), "pictures": drawn, "values": _plain(values)}
    place = folder / _file(seed)
    place.parent.mkdir(exist_ok=True)
    write_whole(place, json.dumps(content, indent=1) + "\n")
    return values


def kept(seed: int, wanted: Wanted, folder: Path) -> Values | None:
    """What is kept of a seed; None if that is nothing, of other settings, damaged, or without its pictures."""
    try:
        content = json.loads((folder / _file(seed)).read_text(encoding="utf-8"))
        if content["settings"] != settings_of(seed, wanted) or not all(
            (folder / name).is_file() for name in content["pictures"]
        ):
            return None
        return {row: {column: from_json(one) for column, one in of.items()} for row, of in content["values"].items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def _file(seed: int) -> str:
    return f"cells/{seed}.json"


def _plain(values: Values) -> dict[str, dict[str, float | str | None]]:
    return {row: {column: in_json(one) for column, one in of.items()} for row, of in values.items()}


def settings_of(seed: int, wanted: Wanted) -> dict[str, Any]:
    """What a seed is made with, as JSON has it."""
    made_with = {
        "form": FORM,
        "seed": seed,
        "wanted": asdict(wanted),
        "cases": cases(wanted.quick),
        "rows": [name_of(planned.name, reading) for planned in PLAN for reading in planned.readings],
        "parameters": parameters(),
        "code": code_sum(),
    }
    return dict(plain(made_with))


def parameters() -> dict[str, Any]:
    """Effective parameters of the estimators; the noise of the magnetometer and the detector are those of the case."""
    filters = {name: PRESETS[preset] for name, preset in PRESET_NAMES.items()}
    graphs = {f"{BATCH} and {ONLINE}, {walk} walk": GRAPHS[walk == "first"] for walk in ("first", "second")}
    return dict(plain({**filters, **graphs}))


@cache
def code_sum() -> str:
    """Sum over the sources that make a figure, and what they run on."""
    root = Path(str(fg_nav.__file__)).parent
    sources = {
        *(path for path in root.rglob("*.py") if not path.relative_to(root).as_posix().startswith(_SEEN_ONLY)),
        *(path for path in (root / "lab" / "reproduce").glob("munoz_diaz2017/*.py") if path.stem != _TEXT),
        *root.glob("factors/*.py"),
    }
    return sum_over(sorted(sources))


@dataclass(frozen=True)
class Walked:
    """All of a seed: what is true of its walks, by case, what was made of them, and the gyroscopes at rest."""

    settings: Mapping[str, Setting]
    found: Found
    own: Mapping[str, float]
    across: Mapping[str, float]
    pair: AllanPair


def walked(seed: int, wanted: Wanted) -> Walked:
    """Walk and estimate."""
    first = first_walk(seed, wanted.leg_m)
    second = second_walk(seed, SECOND_NOISES_UT[0], wanted.leg_m)
    settings: dict[str, Setting] = {}
    found: Found = {}
    for case in cases(wanted.quick):
        if case not in FIRST and case.mag_sigma_uT != noise_of(second):
            second = second_walk(seed, case.mag_sigma_uT, wanted.leg_m)
        walk, recorded = (first, first_recording) if case in FIRST else (second, second_recording)
        settings[case.name] = setting_of(walk)
        found[case.name] = runs(recorded(walk, case.name, seed), case, settings[case.name])
    whole = wanted.leg_m is None
    pair = allan_pair(seed, ALLAN_HOURS if whole else 0.2)
    errors = sensor_errors(first, second)
    fog = fog_errors(seed, FOG_HOURS if whole else 0.02)
    across = dict(zip(FIELDS_UT, errors["across"], strict=True))
    return Walked(settings, found, {**_of_fog(fog), **_of_allan(pair), **_of_tables(errors)}, across, pair)


def _of_fog(fog: Mapping[str, float]) -> dict[str, float]:
    return {FOG[how]: angle for how, angle in fog.items()}


def _of_allan(pair: AllanPair) -> dict[str, float]:
    """What Figure 5 is read for: white noise, the lowest point, and where that lies, as decimal logarithms."""
    fog, mems = (np.median([_allan_points(curve) for curve in curves], axis=0) for curves in (pair.fog, pair.mems))
    white, lowest, at = np.log10(mems / fog)
    return {AT_A_SECOND: float(white), LOWEST: float(lowest), LOWEST_AT: -float(at)}


def _allan_points(curve: AllanCurve) -> tuple[float, float, float]:
    k = np.argmin(curve.deviation)
    return np.interp(1.0, curve.tau_s, curve.deviation), curve.deviation[k], curve.tau_s[k]


def _of_tables(errors: Mapping[str, Floats]) -> dict[str, float]:
    keys = {WHITE: "noise", FIRST_BIAS: "bias", SECOND_START: "start", SECOND_END: "end"}
    return {
        errors_of(words, axis): float(value)
        for words, key in keys.items()
        for axis, value in zip(AXES, errors[key], strict=True)
    }


def values_of(all_of: Walked) -> Values:
    """Read every row off a seed."""
    values: Values = {}
    for planned in PLAN:
        for reading in planned.readings:
            name = name_of(planned.name, reading)
            if reading.row.judged == EXPECTED:
                continue
            if reading.measure is None:
                values[name] = {OURS: all_of.own[reading.row.quantity]}
            elif reading.case in all_of.found:
                values[name] = _read(reading, all_of)
    for site in FIELDS_UT:
        values[f"D-E2: {across_at(site)}"] = {EXPECTED: all_of.across[site]}
    for site in ("north-pole", "munich"):
        expected = (all_of.across["equator"] / all_of.across[site]) ** 2
        values[f"D-E2: {minutes_over(site)}"][EXPECTED] = float(expected)
    return values


def _read(reading: Reading, all_of: Walked) -> dict[str, float]:
    ours = {who: value for who, value in _of_case(reading, reading.case, all_of).items() if who not in reading.without}
    if not reading.over_case:
        return ours
    beside = _of_case(reading, reading.over_case, all_of)
    return {name: ratio(value, beside[name]) for name, value in ours.items() if name in beside}


def _of_case(reading: Reading, case: str, all_of: Walked) -> dict[str, float]:
    assert reading.measure is not None
    setting = all_of.settings[case]
    return {
        name: math.inf if run is None else reading.measure(run, setting) for name, run in all_of.found[case].items()
    }


def _drawn(folder: Path, seed: int, all_of: Walked) -> list[str]:
    """Draw a seed, and return the names of the files."""
    names = pictures.draw_walk(folder, seed, all_of.settings["cars"], all_of.pair)
    for estimator in DRAWN:
        of = {case: by[estimator] for case, by in all_of.found.items() if estimator in by}
        names += pictures.draw_all(folder, estimator, seed, all_of.settings, of)
    return names
