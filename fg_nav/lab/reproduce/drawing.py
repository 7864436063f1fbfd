"""What pictures of several papers share: where they go, panels, and paths from above."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fg_nav.lab import palette
from fg_nav.lab.reproduce.results import Picture
from fg_nav.lab.reproduce.runner import Made
from fg_nav.lab.walked import AS_STARTED
from fg_nav.report.plots import style

COLOURS = (palette.ORANGE, palette.VERMILION, palette.BLUE)  # Of a paper's filters, its own last.
PICTURES = "pictures"  # Folder of the pictures of a reproduction.


@dataclass(frozen=True)
class Pictures:
    """Where the pictures of a paper go: the folder of the reproduction."""

    folder: Path

    def keep(self, figure: Figure, number: int, what: str, ours: str, of: str = "") -> Picture:
        """Write the picture of a numbered figure of the paper; its caption says what that shows and what ours does."""
        file = f"{PICTURES}/figure-{number:02d}{f'-{of}' if of else ''}.png"
        style.save(figure, self.folder / file)
        return Picture(file, f"Fig. {number} of the paper: {what}; ours: {ours}")

    def keep_paths(self, made: Made, scenario: str, names: Mapping[str, str], number: int, what: str) -> Picture:
        """Draw the first walk by filters as printed, from above over the truth, a panel a field; squares are ends."""
        with style.styled():
            figure, panels = new_panels(1, len(made.levels), 5.2, 4.8 * len(made.levels) + 0.4)
            for axes, level in zip(panels, made.levels, strict=True):
                axes.set_aspect("equal", adjustable="datalim")
                for (name, words), colour in zip(names.items(), COLOURS, strict=True):
                    of_filter = made.of(scenario, level, made.table.filters[name]["as printed"])
                    result = next((one for one in of_filter if not one.failed), None)
                    if result is None:
                        continue
                    if not axes.lines:
                        axes.plot(*np.array(result.truth).T, **palette.TRUTH_LINE, zorder=1, label="truth")
                    path = np.array(result.estimate[AS_STARTED])
                    axes.plot(*path.T, "-", color=colour, linewidth=0.9, zorder=3, label=words)
                    axes.plot(*path[-1:].T, "s", color=colour, markersize=4.5, markerfacecolor="white", zorder=5)
                axes.set(xlabel="east (m)", ylabel="north (m)")
                style.head(axes, f"The {scenario.replace('-', ' ')}, field {level}", columns=2)
        return self.keep(figure, number, f"trajectories of {what}", "the filters as printed; squares: ends")


def new_panels(
    rows: int, columns: int, height_in: float, width_in: float = style.WIDTH_IN
) -> tuple[Figure, list[Axes]]:
    """Return an empty figure and its panels, row by row; call it in a styled block."""
    figure = style.new_figure(height_in, width_in)
    return figure, list(figure.subplots(rows, columns, squeeze=False).flat)
