"""The experiments of Zhang et al. (AIEZ, 2017): Z-E1 the magnet on the floor of a corridor, Z-E2 the teaching building.

Z-E1. A foot that stands beside a magnet stands in a field that is wrong and does not change. The classical detector
tests the rate of the strength within a stance (`qsf-stance`) and accepts it; AIEZ (17) compares compass and inertial
heading. The paper shows one drawing (Figure 6) and no number; what stands for one, and what near and far mean, is in
`table.toml`. The area under the ROC is what a detector could do at best, whatever its threshold.

Z-E2 is three cycles (Figure 7, Table I), each filter beside ours. The filter as printed has what would break it
corrected: AIEZ (20), (22), (25), (27), (29).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from fg_nav.arrays import Floats
from fg_nav.detection import detect_stances
from fg_nav.frames import compute_heading, wrap_angle
from fg_nav.lab import palette
from fg_nav.lab.campaign.walks import LOOP
from fg_nav.lab.field_survey import measure_compass_deviation
from fg_nav.lab.reproduce.drawing import new_panels
from fg_nav.lab.reproduce.results import NOTHING, Line, Spread
from fg_nav.lab.reproduce.roc import make_roc
from fg_nav.lab.reproduce.runner import Found, Made, Paper, Parts, describe_walks
from fg_nav.lab.simulation import SCENARIOS, simulate
from fg_nav.lab.simulation.fields import Sum
from fg_nav.lab.simulation.scenarios import Choices
from fg_nav.lab.store.results import Arrays, Key, Measurement
from fg_nav.magnetic import DETECTORS, average_footfall_field, judge_field
from fg_nav.report.plots import style

SCENARIO = SCENARIOS["magnet-corridor"]
CORRIDORS = 20  # The first seeds of a run that are enough: of walks past the magnet.
STRENGTHS = (1, 10)  # Magnets in one place.
FAR, NEAR = (0.0, 2.0), (10.0, math.inf)  # Degrees.
CLOSE_S = 8.0  # What is drawn: before and after the footfall that the magnet turns most.

COLUMNS = {"classical": "qsf-stance", "as printed": "aiez-printed", "physical": "aiez"}  # Detectors of Z-E1.
TITLES = ("classical QMD", "proposed, as printed", "proposed, with the sigmas of physics")  # Of the same.


def list_parts(seeds: Sequence[int], quick: bool) -> Parts:
    """Walks past the magnet, as it is and ten times as strong."""
    return {f"{strength}": [magnet_part(strength, seed) for seed in seeds[:CORRIDORS]] for strength in STRENGTHS}


def magnet_part(strength: int, seed: int) -> Measurement:
    """One walk with a calibrated magnetometer."""
    return Measurement(f"aiez2017_magnet_{strength}x_{seed}", partial(walk_past, strength, seed))


def walk_past(strength: int, seed: int) -> Arrays:
    """Statistics, headings (F,) rad, times (F,) s and true places (F, 2) m at the footfalls past so many magnets.

    `turned_deg` (F,) is how far the magnet turns the field; the gyroscope's heading begins at the true one.
    """
    walk = simulate(replace(SCENARIO, magnets=SCENARIO.magnets * strength), seed, Choices(calibrated=True))
    assert isinstance(walk.field, Sum)
    start = float(compute_heading(walk.attitude[0]))
    field = average_footfall_field(walk.recording, detect_stances(walk.recording), start)
    arrays = {f"statistic {name}": judge_field(field, name).statistic for name in DETECTORS}
    place = walk.truth.position[field.sample] + walk.origin
    turned = measure_compass_deviation(walk.field.at(place), walk.field.parts[0].at(place))
    places = {"place": walk.truth.position[field.sample, :2], "magnet": np.array(SCENARIO.magnets[0]) - walk.origin}
    headings = {"t": field.t, "compass": field.force_heading, "gyroscope": field.gyro_heading}
    return arrays | places | headings | {"turned_deg": np.degrees(np.abs(turned))}


def read_run(made: Made) -> Found:
    """Shares accepted near and far from the magnet, and pictures."""
    past = {strength: made.load(f"{strength}") for strength in STRENGTHS}
    figures = {"Z-E1": {"": draw_verdicts(past[STRENGTHS[-1]][0])}}
    measures = dict.fromkeys(("number", "near", "far", "area"), partial(measure_past, past))
    corridor = Key(SCENARIO.name, made.levels[0], "0", LOOP, "iez")  # its walks are kept as parts, not as results
    return Found(measures, figures, describe_walks([corridor], ()))


PAPER = Paper(list_parts, read_run)


def measure_past(past: Mapping[int, Sequence[Arrays]], line: Line) -> dict[str, Spread]:
    """A figure of the walks past so many magnets, by column; of no walk where there is no footfall."""
    what, walks = line.measure[0], past[int(line.measure[1])]
    found = {}
    for column, detector in COLUMNS.items():
        near, far = ([statistics_in(walk, detector, *zone) for walk in walks] for zone in (NEAR, FAR))
        if what in ("near", "far"):  # share accepted of the footfalls of all walks, and the spread over single walks
            zone = near if what == "near" else far
            each = [float((part < 1.0).mean()) for part in zone if len(part)]
            low, high = np.percentile(each, [5.0, 95.0]).tolist() if each else (0.0, 0.0)
            share = float((np.concatenate(zone) < 1.0).mean()) if each else 0.0
            found[column] = Spread(share, low, high, len(each)) if each else NOTHING
        else:
            value = float(sum(map(len, near))) if what == "number" else separation(np.hstack(near), np.hstack(far))
            found[column] = Spread(value, value, value, len(walks) if np.isfinite(value) else 0)
    return found


def statistics_in(walk: Arrays, detector: str, low_deg: float, high_deg: float) -> Floats:
    """Statistic over its threshold of each footfall judged, where the magnet turns the field that far."""
    statistic = walk[f"statistic {detector}"][(walk["turned_deg"] >= low_deg) & (walk["turned_deg"] < high_deg)]
    return np.asarray(statistic[np.isfinite(statistic)])


def separation(near: Floats, far: Floats) -> float:
    """Probability that the statistic of a footfall near is above that of one far: the area under the ROC."""
    if not (len(near) and len(far)):
        return math.inf
    return make_roc(np.concatenate([far, near]), np.arange(len(far) + len(near)) < len(far)).area


def draw_verdicts(walk: Arrays) -> Figure:
    """Headings by compass and gyroscope beside the magnet, in deg, unwrapped, and what each detector accepts."""
    close = np.abs(walk["t"] - walk["t"][np.nanargmax(walk["turned_deg"])]) < CLOSE_S
    t, gyroscope, near = walk["t"][close], walk["gyroscope"][close], walk["turned_deg"][close] > NEAR[0]
    inertial = np.degrees(np.unwrap(gyroscope))
    compass = inertial + np.degrees(wrap_angle(walk["compass"][close] - gyroscope))
    figure, panels = new_panels(len(COLUMNS), 1, 3.0 * len(COLUMNS))
    for axes, title, detector in zip(panels, TITLES, COLUMNS.values(), strict=True):
        used = walk[f"statistic {detector}"][close] < 1.0
        axes.plot(t, inertial, color=style.INK, linewidth=1.2, label="INS heading")
        axes.plot(t, compass, color=palette.ORANGE, linewidth=0.9, label="magnetic heading")
        axes.plot(t[used], compass[used], "o", color=palette.BLUE, markersize=3.0, label="accepted")
        axes.plot(t[near], compass[near], "o", mfc="none", mec="red", markersize=9.0, label="disturbed", zorder=5)
        axes.set_ylabel("heading (deg)")
        style.head(axes, title, columns=2)
    panels[-1].set_xlabel("time (s)")
    return figure
