"""The experiments of Munoz Diaz et al. (2017): what gravity and the field show of gyro biases in a pocket.

walks    two a seed stand for the paper's two recorded ones                             (`walks`)
runs     the paper's filter, as printed and corrected, and the graph, batch and online  (`runs`)
figures  what is read off them, row by row                                              (`runs`, `rows`)

Each seed leaves one small file, so that an ended run goes on. It holds as long as its settings are the same
(parameters, cases, readings, and the sources that make figures), and as long as its pictures are there, if it has any.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from fg_nav.arrays import Floats
from fg_nav.lab.allan import AllanCurve
from fg_nav.lab.processes import run_tasks
from fg_nav.lab.reproduce.munoz_diaz2017 import figures as pictures
from fg_nav.lab.reproduce.munoz_diaz2017 import rows as table
from fg_nav.lab.reproduce.munoz_diaz2017 import walks as simulated
from fg_nav.lab.reproduce.munoz_diaz2017.figures import FIGURES, file_of
from fg_nav.lab.reproduce.munoz_diaz2017.rows import PLAN, Planned, Reading
from fg_nav.lab.reproduce.munoz_diaz2017.runs import FILTERS, GRAPHS, Run, ratio, run_estimators
from fg_nav.lab.reproduce.munoz_diaz2017.text import CITATION, DIFFERS, TITLES
from fg_nav.lab.reproduce.munoz_diaz2017.walks import FIELDS_UT, AllanPair, Setting
from fg_nav.lab.reproduce.results import Experiment, Picture, Reproduction, Row, spread_of
from fg_nav.lab.reproduce.walks import RESULTS_FOLDER
from fg_nav.lab.store.code import code_sum, sum_sources
from fg_nav.lab.store.files import make_folder
from fg_nav.lab.store.results import Entry, Number, encode_number
from fg_nav.text import to_json

Values = dict[str, dict[str, Number]]
"""By row (`name_of`) and column; NaN where the walk has nothing to read it off, infinite where a method ended."""

Found = dict[str, dict[str, Run | None]]
"""By case and estimator; None where it ended."""

DRAWN = (simulated.FILTER, simulated.ONLINE)  # Estimators whose runs are drawn.
FOG_HOURS, ALLAN_HOURS = 1.0, 14.0  # As in the paper.


@dataclass(frozen=True)
class Wanted:
    """How a seed is made: as in `reproduce`, and whether its runs are drawn."""

    quick: bool = False
    drawn: bool = False
    leg_m: float | None = None


@dataclass(frozen=True)
class Stored:
    """Content of a seed's file."""

    pictures: list[str]
    values: Values


def name_of(experiment: str, reading: Reading) -> str:
    """Key of a row's values."""
    return f"{experiment}: {reading.row.quantity}"


def load_values(seed: int, wanted: Wanted, folder: Path) -> Values:
    """Return the figures of a seed; they are made and stored, and its pictures drawn, if they are missing."""
    stored = read_values(seed, wanted, folder)
    if stored is not None:
        return stored
    all_of = walk_seed(seed, wanted)
    values = values_of(all_of)
    drawn = _draw(folder, seed, all_of) if wanted.drawn else []
    plain_values = {row: {column: encode_number(one) for column, one in of.items()} for row, of in values.items()}
    make_folder(folder / RESULTS_FOLDER)
    _entry(seed, wanted, folder).write({"pictures": drawn, "values": plain_values})
    return values


def read_values(seed: int, wanted: Wanted, folder: Path) -> Values | None:
    """Return the stored figures of a seed; None if there are none that hold, or its pictures are missing."""
    content = _entry(seed, wanted, folder).read()
    try:
        stored = None if content is None else TypeAdapter(Stored).validate_python(content)
    except ValidationError:
        return None
    return stored.values if stored and all((folder / name).is_file() for name in stored.pictures) else None


def _entry(seed: int, wanted: Wanted, folder: Path) -> Entry:
    return Entry(folder / RESULTS_FOLDER / f"{seed}.json", settings_of(seed, wanted))


def settings_of(seed: int, wanted: Wanted) -> dict[str, Any]:
    """What a seed is made with, as JSON has it."""
    made_with = {
        "seed": seed,
        "wanted": asdict(wanted),
        "cases": simulated.list_cases(wanted.quick),
        "rows": [name_of(planned.name, reading) for planned in PLAN for reading in planned.readings],
        "parameters": describe_parameters(),
        "code": _code(),
    }
    return dict(to_json(made_with))


def describe_parameters() -> dict[str, Any]:
    """Effective parameters of the estimators; the noise of the magnetometer and the detector are those of the case."""
    filters = {name: parameters for name, (parameters, _) in FILTERS.items()}
    graphs = {
        f"{simulated.BATCH} and {simulated.ONLINE}, {walk} walk": GRAPHS[walk == "first"]
        for walk in ("first", "second")
    }
    return dict(to_json({**filters, **graphs}))


@cache
def _code() -> str:
    """Sum over the sources that make a figure; the texts make none."""
    own = sorted(path for path in Path(__file__).parent.glob("*.py") if path.stem != "text")
    return f"{code_sum()} {sum_sources(own)}"


@dataclass(frozen=True)
class Walked:
    """All of a seed: what is true of its walks, by case, what was made of them, and the gyroscopes at rest."""

    settings: Mapping[str, Setting]
    found: Found
    own: Mapping[str, float]
    across: Mapping[str, float]
    pair: AllanPair


def walk_seed(seed: int, wanted: Wanted) -> Walked:
    """Walk and estimate."""
    first = simulated.simulate_first(seed, wanted.leg_m)
    second = simulated.simulate_second(seed, simulated.SECOND_NOISES_UT[0], wanted.leg_m)
    settings: dict[str, Setting] = {}
    found: Found = {}
    for case in simulated.list_cases(wanted.quick):
        if case not in simulated.FIRST and case.mag_sigma_uT != simulated.noise_of(second):
            second = simulated.simulate_second(seed, case.mag_sigma_uT, wanted.leg_m)
        walk, recorded = (
            (first, simulated.record_first) if case in simulated.FIRST else (second, simulated.record_second)
        )
        settings[case.name] = simulated.read_setting(walk)
        found[case.name] = run_estimators(recorded(walk, case.name, seed), case, settings[case.name])
    whole = wanted.leg_m is None
    pair = simulated.measure_allan_pair(seed, ALLAN_HOURS if whole else 0.2)
    errors = simulated.measure_sensor_errors(first, second)
    fog = simulated.measure_fog_errors(seed, FOG_HOURS if whole else 0.02)
    across = dict(zip(FIELDS_UT, errors["across"], strict=True))
    return Walked(settings, found, {**_of_fog(fog), **_of_allan(pair), **_of_tables(errors)}, across, pair)


def _of_fog(fog: Mapping[str, float]) -> dict[str, float]:
    return {table.FOG[how]: angle for how, angle in fog.items()}


def _of_allan(pair: AllanPair) -> dict[str, float]:
    """What Figure 5 is read for: white noise, the lowest point, and where that lies, as decimal logarithms."""
    fog, mems = (np.median([_allan_points(curve) for curve in curves], axis=0) for curves in (pair.fog, pair.mems))
    white, lowest, at = np.log10(mems / fog)
    return {table.AT_A_SECOND: float(white), table.LOWEST: float(lowest), table.MIN_AT: -float(at)}


def _allan_points(curve: AllanCurve) -> tuple[float, float, float]:
    k = np.argmin(curve.deviation)
    return np.interp(1.0, curve.tau_s, curve.deviation), curve.deviation[k], curve.tau_s[k]


def _of_tables(errors: Mapping[str, Floats]) -> dict[str, float]:
    keys = {table.WHITE: "noise", table.FIRST_BIAS: "bias", table.SECOND_START: "start", table.SECOND_END: "end"}
    return {
        f"{words}, {axis}": float(value)
        for words, key in keys.items()
        for axis, value in zip(table.AXES, errors[key], strict=True)
    }


def values_of(all_of: Walked) -> Values:
    """Read every row off a seed."""
    values: Values = {}
    for planned in PLAN:
        for reading in planned.readings:
            name = name_of(planned.name, reading)
            if reading.row.judged == table.EXPECTED:
                continue
            if reading.measure is None:
                values[name] = {table.OURS: all_of.own[reading.row.quantity]}
            elif reading.case in all_of.found:
                values[name] = _read(reading, all_of)
    for site in FIELDS_UT:
        values[f"D-E2: {table.across_at(site)}"] = {table.EXPECTED: all_of.across[site]}
    for site in ("north-pole", "munich"):
        expected = (all_of.across["equator"] / all_of.across[site]) ** 2
        values[f"D-E2: {table.minutes_over(site)}"][table.EXPECTED] = float(expected)
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


def _draw(folder: Path, seed: int, all_of: Walked) -> list[str]:
    """Draw a seed, and return the names of the files."""
    names = pictures.draw_walk(folder, seed, all_of.settings["cars"], all_of.pair)
    for estimator in DRAWN:
        of = {case: by[estimator] for case, by in all_of.found.items() if estimator in by}
        names += pictures.draw_all(folder, estimator, seed, all_of.settings, of)
    return names


def reproduce(
    folder: Path,
    seeds: Sequence[int],
    workers: int,
    progress: Callable[[float], None],
    quick: bool,
    leg_m: float | None = None,
) -> Reproduction:
    """Make all experiments, as `fg_nav.lab.reproduce.command.Paper`; the first seed is drawn.

    `quick` leaves out the other noises of the second walk's magnetometer; `leg_m` (m) makes short legs, for tests.
    """
    wanted = {seed: Wanted(quick, seed == seeds[0], leg_m) for seed in seeds}
    found: dict[int, Values] = {}
    tasks = [partial(load_values, seed, how, folder) for seed, how in wanted.items()]
    for number, values in run_tasks(tasks, workers):
        found[seeds[number]] = values
        progress(len(found) / len(seeds))
    in_order = [found[seed] for seed in seeds]
    experiments = tuple(build_experiment(planned, in_order, seeds[0]) for planned in PLAN)
    return Reproduction("munoz-diaz2017", CITATION, tuple(seeds), experiments, DIFFERS, describe_parameters())


def build_experiment(planned: Planned, found: Sequence[Values], drawn_seed: int) -> Experiment:
    """One experiment from the figures of all seeds; rows that no seed has are left out."""
    rows = [_row(planned, reading, found) for reading in planned.readings]
    pictures = [picture for figure in planned.figures for picture in _pictures(figure, drawn_seed)]
    shown = tuple(row for row in rows if row.ours)
    return Experiment(planned.name, *TITLES[planned.name], tuple(planned.columns), shown, tuple(pictures))


def _row(planned: Planned, reading: Reading, found: Sequence[Values]) -> Row:
    """The median over the seeds; a figure that a walk has not is left out."""
    of_seeds = [values.get(name_of(planned.name, reading), {}) for values in found]
    values = {
        column: [of[column] for of in of_seeds if not math.isnan(of.get(column, math.nan))]
        for column in planned.columns
    }
    spreads = {column: spread_of(known) for column, known in values.items() if known}
    return replace(reading.row, ours=spreads)


def _pictures(figure: str, seed: int) -> Iterator[Picture]:
    """The paper's figure of each estimator that is drawn, or the one that needs none."""
    number = int(figure.removeprefix("figure-"))
    if figure in FIGURES:
        for estimator in DRAWN:
            words = f"Figure {number} as the {_WHO[estimator]} has it, seed {seed}: {FIGURES[figure]}."
            yield Picture(file_of(figure, seed, estimator), words)
    else:
        yield Picture(file_of(figure, seed), f"Figure {number}, seed {seed}: {_OTHERS[figure]}.")


_WHO = {"filter": "filter", "online": "online graph"}
_OTHERS = {
    "figure-04": "cars and lamps bend the field of the equator: strength in colours, arrows the way that it points",
    "figure-05": "Allan deviations of the fibre-optic gyroscope and of the MTw's",
    "figure-07": "the first walk, and the cars and lamps beside it",
}
