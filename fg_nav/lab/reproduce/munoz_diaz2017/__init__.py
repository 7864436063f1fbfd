"""The results of Munoz Diaz et al. (2017) beside ours: what gravity and the field tell of gyro biases in a pocket.

walks    two a seed stand for the paper's two recorded ones                          (`walks`)
runs     the paper's filter, as printed and right, and the graph, in batch and online           (`runs`)
figures  what is read off them, row by row                                (`runs`, `rows`, `seed`)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from fg_nav.lab.processes import run_tasks
from fg_nav.lab.reproduce.munoz_diaz2017.figures import FIGURES, file_of
from fg_nav.lab.reproduce.munoz_diaz2017.rows import PLAN, Planned, Reading
from fg_nav.lab.reproduce.munoz_diaz2017.seed import DRAWN, Values, Wanted, load_values, name_of, parameters
from fg_nav.lab.reproduce.munoz_diaz2017.text import CITATION, DIFFERS, TITLES
from fg_nav.lab.reproduce.results import Experiment, Picture, Reproduction, Row, spread_of


def reproduce(
    folder: Path,
    seeds: Sequence[int],
    workers: int,
    progress: Callable[[float], None],
    quick: bool,
    leg_m: float | None = None,
) -> Reproduction:
    """Make all experiments; finished seeds are kept in the folder, and used if they were made with the same.

    Parameters
    ----------
    folder : for pictures and seeds.
    seeds : of the pairs of walks; the first one is drawn.
    workers : processes.
    progress : called with the fraction done.
    quick : without the other noises of the second walk's magnetometer.
    leg_m : legs of so many metres, m: shows that it runs, nothing else.
    """
    wanted = {seed: Wanted(quick, seed == seeds[0], leg_m) for seed in seeds}
    found: dict[int, Values] = {}
    for seed, values in _made(wanted, folder, workers):
        found[seed] = values
        progress(len(found) / len(seeds))
    in_order = [found[seed] for seed in seeds]
    experiments = tuple(experiment(planned, in_order, seeds[0]) for planned in PLAN)
    return Reproduction("munoz-diaz2017", CITATION, tuple(seeds), experiments, DIFFERS, parameters())


def _made(wanted: Mapping[int, Wanted], folder: Path, workers: int) -> Iterator[tuple[int, Values]]:
    """As they are done."""
    seeds = list(wanted)
    for number, values in run_tasks([partial(load_values, seed, how, folder) for seed, how in wanted.items()], workers):
        yield seeds[number], values


def experiment(planned: Planned, found: Sequence[Values], drawn_seed: int) -> Experiment:
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
