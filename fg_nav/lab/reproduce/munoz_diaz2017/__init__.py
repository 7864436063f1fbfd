"""The experiments of Munoz Diaz et al. (2017): what gravity and the field show of gyro biases in a pocket.

`walks` has two walks a seed, which stand for the paper's two recorded ones; `runs` what the estimators make of them:
the paper's filter, as printed and corrected, and the graph, batch and online. Here figures are read off these runs.
Biases are in deg/s, axis z along the thigh. MD (21) as printed is a case of its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.lab.reproduce.drawing import Pictures
from fg_nav.lab.reproduce.munoz_diaz2017 import figures
from fg_nav.lab.reproduce.munoz_diaz2017.runs import FILTERS, GRAPHS, Run, Seed, measure_seed, seed_of
from fg_nav.lab.reproduce.munoz_diaz2017.walks import BATCH, FIELDS_UT, ONLINE, Setting
from fg_nav.lab.reproduce.results import Picture, Spread, spread_of
from fg_nav.lab.reproduce.runner import Found, Made, Paper, Parts
from fg_nav.lab.reproduce.table import Line
from fg_nav.lab.store.code import sum_sources
from fg_nav.lab.store.results import Measurement
from fg_nav.text import to_json

OURS, EXPECTED = "ours", "by the field"  # Columns of what no estimator has a hand in.


def list_parts(seeds: Sequence[int], quick: bool) -> Parts:
    """One measurement a seed; quick without the other noises of the second walk's magnetometer."""
    names = {seed: f"munoz-diaz2017_{seed}_{'quick_' if quick else ''}{_code()}" for seed in seeds}
    return {"seed": [Measurement(name, partial(measure_seed, seed, quick)) for seed, name in names.items()]}


@cache
def _code() -> str:
    """Sum over all sources that make a run: a measurement's own is over one module."""
    folder = Path(__file__).parent
    return sum_sources([folder / f"{name}.py" for name in ("as_printed", "runs", "walks")])


def read_run(made: Made) -> Found:
    """Figures of each seed, and the pictures of the first."""
    lines = [line for planned in made.table.experiments for line in planned.lines(made.levels)]
    values: dict[object, dict[str, list[float]]] = {_what(line): {} for line in lines}
    drawn: dict[str, list[Picture]] = {}
    for part in made.parts["seed"]:
        seed = seed_of(part.load(made.folder))
        drawn = drawn or figures.draw_all(Pictures(made.folder), seed)
        for line in lines:
            for column, value in read_line(seed, line).items():
                if not math.isnan(value):
                    values[_what(line)].setdefault(column, []).append(value)

    def measure(line: Line) -> dict[str, Spread]:
        return {column: spread_of(of_seeds) for column, of_seeds in values[_what(line)].items()}

    return Found({str(line.measure[0]): measure for line in lines}, drawn, describe_parameters())


PAPER = Paper(list_parts, read_run)


def _what(line: Line) -> object:
    return line.measure, line.of, line.over


def describe_parameters() -> dict[str, Any]:
    """Effective parameters of the estimators; the noise of the magnetometer and the detector are those of the case."""
    filters = {name: parameters for name, (parameters, _) in FILTERS.items()}
    graphs = {f"{BATCH} and {ONLINE}, {walk} walk": GRAPHS[walk == "first"] for walk in ("first", "second")}
    return dict(to_json({**filters, **graphs}))


def read_line(seed: Seed, line: Line) -> dict[str, float]:
    """A row of one seed, by column: NaN where the walk has nothing to read it off, infinite where a method ended."""
    what, *arguments = line.measure
    if what in OWN:
        column = EXPECTED if what == "across" else OURS
        return {column: OWN[str(what)](seed, *arguments)}
    if line.of not in seed.runs:
        return {}
    ours = _of_case(seed, line.of, str(what), arguments)
    if line.over:
        other = _of_case(seed, line.over, str(what), arguments)
        ours = {name: ratio(value, other[name]) for name, value in ours.items() if name in other}
    if line.over and line.of in FIELDS_UT:  # the mean square of the field across the thigh sets the time it takes
        ours[EXPECTED] = (field_across(seed, line.over) / field_across(seed, line.of)) ** 2
    return ours


def _of_case(seed: Seed, case: str, what: str, arguments: Sequence[str | float]) -> dict[str, float]:
    axes = [AXES.index(one) if isinstance(one, str) else one for one in arguments]
    return {
        name: math.inf if run is None else float(MEASURES[what](run, seed.settings[case], *axes))
        for name, run in seed.runs[case].items()
    }


# --- what no estimator has a hand in ---------------------------------------------------------------------------------

AXES = "xyz"


def rest_figure(seed: Seed, what: str) -> float:
    """Largest angle of an hour at rest, deg, by how; or what Figure 5 is read for, as decimal logarithms of a ratio.

    Of the MTw's over the FOG's: white noise at 1 s, lowest point, and, of the FOG over the MTw, where that lies.
    """
    if f"rest/{what}" in seed.own:
        return float(seed.own[f"rest/{what}"])
    tau_s = seed.own["allan/tau_s"]

    def read(deviation: Floats) -> tuple[float, float, float]:
        k = int(np.argmin(deviation))
        return float(np.interp(1.0, tau_s, deviation)), float(deviation[k]), float(tau_s[k])

    fog, mems = (np.median([read(axis) for axis in seed.own[f"allan/{name}"]], axis=0) for name in ("fog", "mems"))
    white, lowest, at = np.log10(mems / fog)
    return float({"white": white, "lowest": lowest, "at": -at}[what])


def sensor_figure(seed: Seed, what: str, axis: str) -> float:
    """Errors of Tables 2 and 3, deg/s."""
    return float(seed.own[f"sensor/{what}"][AXES.index(axis)])


def field_across(seed: Seed, site: str) -> float:
    """Rms field across the thigh, uT."""
    return float(seed.own["sensor/across"][list(FIELDS_UT).index(site)])


OWN: Mapping[str, Callable[..., float]] = {"rest": rest_figure, "sensor": sensor_figure, "across": field_across}


# --- what is read off a run ------------------------------------------------------------------------------------------


def reached(run: Run, _: Setting, axis: int, level: float) -> float:
    """Minute at which a bias first is as far from zero as `level`, to the same side; infinite for never."""
    there = np.flatnonzero(run.bias[:, axis] * np.sign(level) >= abs(level))
    return float(run.minute[there[0]]) if len(there) else math.inf


def for_good(run: Run, _: Setting, axis: int, level: float) -> float:
    """As `reached`, but the minute from which on it stays so; infinite where it does not at the end."""
    short = np.flatnonzero(run.bias[:, axis] * np.sign(level) < abs(level))
    first = short[-1] + 1 if len(short) else 0
    return float(run.minute[first]) if first < len(run.minute) else math.inf


def at_end(run: Run, _: Setting, axis: int) -> float:
    """Bias of the last minute."""
    return float(run.bias[run.minute > run.minute[-1] - 1.0, axis].mean())


def from_zero(run: Run, setting: Setting, axis: int) -> float:
    """How far a bias of the last minute is from zero."""
    return abs(at_end(run, setting, axis))


def at_minute(run: Run, _: Setting, axis: int, minute: float) -> float:
    """Bias at a minute."""
    return float(np.interp(minute, run.minute, run.bias[:, axis]))


def largest(run: Run, setting: Setting, axis: int, from_min: float = 0.0) -> float:
    """How far a bias is from the true one at most; which way depends on the iron."""
    return float(np.abs(run.bias - setting.bias)[run.minute >= from_min, axis].max(initial=0.0))


def share_used(run: Run, _: Setting) -> float:
    """Share of the seconds in which the field was used."""
    return float(run.used.mean())


def jump(run: Run, setting: Setting, event: float) -> float:
    """How far the z bias goes to and fro while one passes: within 0.3 min of it."""
    near = np.abs(run.minute - setting.passed_min[int(event)]) < 0.3
    return float(np.ptp(run.bias[near, 2])) if near.any() else math.nan


def yaw_at_end(run: Run, _: Setting) -> float:
    """Yaw error, deg, without its sign."""
    return float(abs(run.yaw_error[-1]))


def yaw_after(run: Run, setting: Setting, legs: float) -> float:
    """Yaw error after so many ways along the street, deg, without its sign."""
    end = setting.ends[setting.legs < legs][-1] / 60.0
    return float(abs(np.interp(end, run.minute, run.yaw_error)))


def away_after(run: Run, setting: Setting, legs: float) -> float:
    """Distance from the first place to that after so many ways along the street, m; truly none."""
    return float(np.linalg.norm(run.path[np.flatnonzero(setting.legs < legs)[-1]]))


def yaw_range(run: Run, _: Setting, begin: float, end: float) -> float:
    """How far the yaw error goes to and fro between two minutes, deg."""
    part = (run.minute >= begin) & (run.minute <= end)
    return float(np.ptp(run.yaw_error[part])) if part.any() else math.nan


def yaw_wander(run: Run, _: Setting, begin: float, end: float, blunt_min: float = 0.5) -> float:
    """How far the yaw error goes up and down over how far it gets, between two minutes: 1 where it goes one way.

    Means over half a minute, in which strides do not count.
    """
    part = (run.minute >= begin) & (run.minute <= end)
    place = (run.minute[part] / blunt_min).astype(int)
    at, count = np.unique(place, return_inverse=True, return_counts=True)[1:]
    means = np.bincount(at, run.yaw_error[part]) / count
    return ratio(float(np.abs(np.diff(means)).sum()), float(np.ptp(means))) if len(means) > 1 else math.nan


def yaw_grown(run: Run, _: Setting, begin: float, end: float) -> float:
    """How much farther the yaw is off from one share of the time to another, deg."""
    at = np.interp(np.array([begin, end]) * run.minute[-1], run.minute, run.yaw_error)
    return float(abs(at[1]) - abs(at[0]))


def over(read: Callable[..., float], run: Run, setting: Setting, *spans: float) -> float:
    """A figure of the first two minutes or shares over that of the next two."""
    return ratio(read(run, setting, *spans[:2]), read(run, setting, *spans[2:]))


def ratio(one: float, other: float) -> float:
    """NaN where neither came, or there is nothing to divide by."""
    if other == 0.0 or (math.isinf(one) and math.isinf(other)):
        return math.nan
    return one / other


_READ = (reached, for_good, at_end, from_zero, at_minute, largest, share_used, jump)
_READ_YAW = (yaw_at_end, yaw_after, away_after, yaw_range, yaw_wander)
MEASURES: Mapping[str, Callable[..., float]] = {
    **{read.__name__: read for read in (*_READ, *_READ_YAW)},
    "yaw_range_over": partial(over, yaw_range),
    "yaw_grown_over": partial(over, yaw_grown),
}
"""By the names that the table has for them."""
