"""What pictures of several papers share: panels, and paths from above."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fg_nav.lab import palette
from fg_nav.lab.walked import AS_STARTED
from fg_nav.report.plots import style

if TYPE_CHECKING:
    from fg_nav.lab.reproduce.results import Planned
    from fg_nav.lab.reproduce.runner import Made

COLOURS = (palette.ORANGE, palette.VERMILION, palette.BLUE)  # Of a paper's filters, its own last.


def draw_paths(made: Made, planned: Planned) -> Figure:
    """Draw the first walk by filters as printed, from above over the truth, a panel a field; squares are ends."""
    figure, panels = new_panels(1, len(made.levels), 5.2, 4.8 * len(made.levels) + 0.4)
    for axes, level in zip(panels, made.levels, strict=True):
        axes.set_aspect("equal", adjustable="datalim")
        for (name, words), colour in zip(planned.labels.items(), COLOURS, strict=True):
            of_filter = made.of(planned.scenario, level, made.table.filters[name]["as printed"])
            result = next((one for one in of_filter if not one.failed), None)
            if result is None:
                continue
            if not axes.lines:
                axes.plot(*np.array(result.truth).T, **palette.TRUTH_LINE, zorder=1, label="truth")
            path = np.array(result.estimate[AS_STARTED])
            axes.plot(*path.T, "-", color=colour, linewidth=0.9, zorder=3, label=words)
            axes.plot(*path[-1:].T, "s", color=colour, markersize=4.5, markerfacecolor="white", zorder=5)
        axes.set(xlabel="east (m)", ylabel="north (m)")
        style.head(axes, f"The {planned.scenario.replace('-', ' ')}, field {level}", columns=2)
    return figure


def new_panels(
    rows: int, columns: int, height_in: float, width_in: float = style.WIDTH_IN
) -> tuple[Figure, list[Axes]]:
    """Return an empty figure and its panels, row by row."""
    figure = style.new_figure(height_in, width_in)
    return figure, list(figure.subplots(rows, columns, squeeze=False).flat)
