"""The experiments of Zhang et al. (AIEZ, 2017): Z-E1 the magnet on the floor of a corridor, Z-E2 the teaching building.

Z-E1. A foot that stands beside a magnet stands in a field that is wrong and does not change. The classical detector
tests the rate of the strength within a stance (`qsf-stance`) and accepts it; AIEZ (17) compares compass and inertial
heading. The paper shows one drawing and no number. As bounds: at least 80 % of the footfalls beside the magnet
accepted, and at most 20 %. The area under the ROC is what a detector could do at best, whatever its threshold.

Z-E2 is three cycles (Figure 7, Table I), each filter beside ours.

The filter as printed has what would break it corrected: AIEZ (20), (22), (25), (27), (29).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from fg_nav.frames import wrap_angle
from fg_nav.lab import palette
from fg_nav.lab.campaign.walks import LOOP
from fg_nav.lab.reproduce.aiez2017.magnet import (
    FAR,
    NEAR,
    SCENARIO,
    STRONGER,
    Judged,
    judged_of,
    magnet_part,
    measure_separation,
    pool,
)
from fg_nav.lab.reproduce.drawing import Pictures, draw_paths, new_panels
from fg_nav.lab.reproduce.results import Picture, Spread
from fg_nav.lab.reproduce.runner import Found, Made, Paper, Parts
from fg_nav.lab.reproduce.table import Line
from fg_nav.lab.reproduce.walks import describe_walks
from fg_nav.lab.store.results import Arrays, Key
from fg_nav.report.plots import style

CORRIDORS = 20  # The first seeds of a run that are enough: of walks past the magnet.
STRENGTHS = (1, STRONGER)

DETECTORS = {"classical": "qsf-stance", "as printed": "aiez-printed", "physical": "aiez"}  # By column of Z-E1.
NAMES = {"iez": "IEZ", "qsf-stance": "IEZ + classical QMD", "aiez": "AIEZ"}


def list_parts(seeds: Sequence[int], quick: bool) -> Parts:
    """Walks past the magnet, as it is and ten times as strong."""
    return {f"{strength}": [magnet_part(strength, seed) for seed in seeds[:CORRIDORS]] for strength in STRENGTHS}


def read_run(made: Made) -> Found:
    """Shares accepted near and far from the magnet, and pictures."""
    strongest = made.load(f"{STRONGER}")
    past = {strength: [judged_of(one) for one in made.load(f"{strength}")] for strength in STRENGTHS}
    pictures = Pictures(made.folder)
    what, ours = "trajectories of IEZ, IEZ + classical QMD and AIEZ", "the filters as printed; squares: ends"
    building = pictures.keep(draw_paths(made, "teaching-building", NAMES, "The teaching building"), 7, what, ours)
    drawn = {"Z-E1": [draw_verdicts(pictures, strongest[0])], "Z-E2": [building]}
    measures = {name: partial(_measure, past, name) for name in ("number", "near", "far", "area")}
    corridor = Key(SCENARIO.name, made.levels[0], "", LOOP, "iez")  # its walks are kept as parts, not as results
    return Found(measures, drawn, describe_walks([corridor], ()))


PAPER = Paper(list_parts, read_run)


def _measure(past: Mapping[int, Sequence[Judged]], what: str, line: Line) -> dict[str, Spread]:
    """By column; of no walk where there is no footfall."""
    walks = past[int(line.measure[1])]
    found = {}
    for column, detector in DETECTORS.items():
        if what in ("near", "far"):
            found[column] = _share(walks, NEAR if what == "near" else FAR, detector)
        else:
            near = pool(walks, detector, NEAR)
            value = float(len(near)) if what == "number" else measure_separation(walks, detector)
            found[column] = Spread(value, value, value, len(walks) if np.isfinite(value) else 0)
    return found


def _share(walks: Sequence[Judged], zone: tuple[float, float], name: str) -> Spread:
    """Share accepted of the footfalls of all walks, and the spread over single walks."""
    each = [float((part < 1.0).mean()) for walk in walks if len(part := walk.between(name, *zone))]
    if not each:
        return Spread(np.nan, np.nan, np.nan, 0)
    low, high = np.percentile(each, [5.0, 95.0])
    return Spread(float((pool(walks, name, zone) < 1.0).mean()), float(low), float(high), len(each))


# --- pictures --------------------------------------------------------------------------------------------------------

CLOSE_S = 8.0  # What is drawn: before and after the footfall that the magnet turns most.

_TITLES = ("classical QMD", "proposed, as printed", "proposed, with the sigmas of physics")  # Of the `DETECTORS`.


def draw_verdicts(pictures: Pictures, walk: Arrays) -> Picture:
    """Headings by compass and gyroscope beside the magnet, in deg, unwrapped, and what each detector accepts."""
    close = np.abs(walk["t"] - walk["t"][np.nanargmax(walk["turned_deg"])]) < CLOSE_S
    t, gyroscope, near = walk["t"][close], walk["gyroscope"][close], walk["turned_deg"][close] > NEAR[0]
    inertial = np.degrees(np.unwrap(gyroscope))
    compass = inertial + np.degrees(wrap_angle(walk["compass"][close] - gyroscope))
    with style.styled():
        figure, panels = new_panels(len(DETECTORS), 1, 3.0 * len(DETECTORS))
        for axes, title, detector in zip(panels, _TITLES, DETECTORS.values(), strict=True):
            used = walk[f"statistic {detector}"][close] < 1.0
            axes.plot(t, inertial, color=style.INK, linewidth=1.2, label="INS heading")
            axes.plot(t, compass, color=palette.ORANGE, linewidth=0.9, label="magnetic heading")
            axes.plot(t[used], compass[used], "o", color=palette.BLUE, markersize=3.0, label="accepted")
            axes.plot(t[near], compass[near], "o", mfc="none", mec="red", markersize=9.0, label="disturbed", zorder=5)
            axes.set_ylabel("heading (deg)")
            style.head(axes, title, columns=2)
        panels[-1].set_xlabel("time (s)")
    what = "detection by classical QMD and by the proposed method beside the magnet"
    ours = "past ten magnets in one place; dots: accepted, red circles: turned by the magnet by more than 10 deg"
    return pictures.keep(figure, 6, what, ours)
