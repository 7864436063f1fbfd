"""Zhang's Figures 5, 6 and 7: the corridor with its magnet, what the detectors make of it, and the building."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from fg_nav.arrays import Bools, Floats
from fg_nav.lab.reproduce.aiez2017.corridor import CLASSICAL, DETECTOR_OF, PHYSICAL
from fg_nav.lab.reproduce.aiez2017.corridor import PRINTED as AS_PRINTED
from fg_nav.lab.reproduce.aiez2017.magnet import NEAR
from fg_nav.lab.reproduce.aiez2017.walks import BUILDING, NAMES, PRINTED, columns_of
from fg_nav.lab.reproduce.drawing import Pictures, draw_path, estimate_of, new_panels, truth_of
from fg_nav.lab.reproduce.results import Picture
from fg_nav.lab.reproduce.walks import Walks
from fg_nav.lab.store.entries import Arrays
from fg_nav.report.plots import style

ZOOM_S = 8.0
"""Before and after the footfall that the magnet turns most."""


def figure_5(pictures: Pictures, walk: Arrays) -> Picture:
    """The corridor from above: footfalls, and where the magnet lies."""
    near = walk["turned_deg"] > NEAR[0]
    with style.styled():
        figure, [axes] = new_panels(1, 1, 2.6)
        for places, mark, colour, size, label in (
            (walk["place"], ".", style.TRUTH, 4.0, "footfalls"),
            (walk["place"][near], "o", style.VERMILION, 5.0, "turned by over 10 deg"),
            (walk["magnet"][None, :2], "s", style.INK, 7.0, "magnet"),
        ):
            axes.plot(places[:, 1], places[:, 0], mark, color=colour, markersize=size, label=label)
        axes.set(xlabel="along the corridor, north (m)", ylabel="across, east (m)", ylim=(1.5, -1.5))
        style.head(axes, "The corridor with the magnet on the floor, from above")
    return pictures.keep(
        figure,
        5,
        "walking past a magnet on the floor (a photograph)",
        "the simulated corridor, ten magnets in one place",
    )


_DRAWN = {
    "classical QMD": CLASSICAL,
    "proposed, as printed": AS_PRINTED,
    "proposed, with the sigmas of physics": PHYSICAL,
}


def figure_6(pictures: Pictures, walk: Arrays) -> Picture:
    """Headings by compass and gyroscope, and what each detector believes; to the right the magnet from close by."""
    whole = np.ones(len(walk["t"]), dtype=bool)
    worst = walk["t"][np.nanargmax(walk["turned_deg"])]
    close = np.abs(walk["t"] - worst) < ZOOM_S
    with style.styled():
        figure, panels = new_panels(len(_DRAWN), 2, 3.0 * len(_DRAWN), 10.0)
        for row, (words, column) in enumerate(_DRAWN.items()):
            believed = walk[f"statistic {DETECTOR_OF[column]}"] < 1.0
            for part, axes in zip((whole, close), panels[2 * row :], strict=False):
                _draw_verdicts(axes, walk, part, believed)
            style.head(panels[2 * row], words, columns=2)
            panels[2 * row + 1].set_title("beside the magnet")
        for axes in panels[-2:]:
            axes.set_xlabel("time (s)")
    return pictures.keep(
        figure,
        6,
        "detection by classical QMD and by the proposed method beside the magnet",
        "past ten magnets in one place; dots: believed, red circles: turned by the magnet by more than 10 deg",
    )


def _draw_verdicts(axes: Axes, walk: Arrays, part: Bools, believed: Bools) -> None:
    """Draw the headings of those footfalls, in deg about the gyroscope's, unwrapped."""
    t, smooth = walk["t"][part], np.unwrap(walk["gyroscope"])[part]
    compass: Floats = np.degrees(smooth + np.angle(np.exp(1j * (walk["compass"][part] - smooth))))
    near = (walk["turned_deg"] > NEAR[0])[part]
    axes.plot(t, np.degrees(smooth), color=style.INK, linewidth=1.2, label="INS heading")
    axes.plot(t, compass, color=style.ORANGE, linewidth=0.9, label="magnetic heading")
    axes.plot(t[believed[part]], compass[believed[part]], "o", color=style.BLUE, markersize=3.0, label="believed")
    axes.plot(
        t[near], compass[near], "o", color="red", markersize=9.0, markerfacecolor="none", label="disturbed", zorder=5
    )
    axes.set_ylabel("heading (deg)")
    axes.margins(x=0.02)


def figure_7(pictures: Pictures, walks: Walks, fields: Sequence[str]) -> Picture:
    """Trajectories of the three filters in the building."""
    with style.styled():
        figure, panels = new_panels(1, len(fields), 5.0, 4.8 * len(fields) + 0.4)
        for axes, field in zip(panels, fields, strict=True):
            colours = (style.ORANGE, style.VERMILION, style.BLUE)
            for (name, words), colour in zip(NAMES.items(), colours, strict=True):
                results = walks.of(BUILDING, field, columns_of(name).get(PRINTED, name))
                result = next((result for result in results if not result.failed), None)
                if result is not None:
                    truth = truth_of(result) if not axes.lines else None
                    draw_path(axes, estimate_of(result), words, colour, truth)
            style.head(axes, f"The teaching building, field {field}", columns=2)
    return pictures.keep(
        figure, 7, "trajectories of IEZ, IEZ + classical QMD and AIEZ", f"the filters {PRINTED}; squares: ends"
    )
