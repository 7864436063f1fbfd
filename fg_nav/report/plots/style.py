"""Common style of all pictures: quiet axes, a palette for all eyes, one width.

The palette is that of Okabe and Ito (Color Universal Design, 2008), in an order that keeps neighbours apart also in
grey; truth is always the same wide grey line below the others. No global state of matplotlib is touched beyond the
`styled` block, and no window system is needed.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imsave

BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"
CYCLE = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)  # Colours of methods or axes, in order.

INK, SOFT_INK, GRID, TRUTH = "#222222", "#6B6B6B", "#E6E6E6", "#9A9A9A"
TRUTH_LINE: dict[str, Any] = {"color": TRUTH, "linewidth": 3.0, "alpha": 0.7}
SHADE = "#DCE9F2"  # Background of a stance.

WIDTH_IN, DPI = 8.0, 150
MAX_POINTS = 60_000  # Of a line: at walking speed ten points a stride over two hours. A PNG is 1200 pixels wide.
_LINE_LETTERS, _HANDLE_LETTERS = 105, 5  # Letters of a legend over the width of a picture, and width of its signs.

_RC: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.titlesize": 10.5,
    "axes.titlelocation": "left",
    "axes.titlecolor": INK,
    "axes.labelsize": 9.0,
    "axes.labelcolor": SOFT_INK,
    "axes.edgecolor": SOFT_INK,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.7,
    "xtick.color": SOFT_INK,
    "ytick.color": SOFT_INK,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "xtick.major.size": 3.0,
    "ytick.major.size": 3.0,
    "lines.linewidth": 1.3,
    "lines.solid_joinstyle": "round",
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "legend.labelcolor": INK,
    "path.simplify": True,
    "path.simplify_threshold": 0.3,
    "agg.path.chunksize": 20000,
}


def colours(count: int) -> list[str]:
    """Return one colour a method; after six they begin again."""
    return [CYCLE[i % len(CYCLE)] for i in range(count)]


@contextmanager
def styled() -> Iterator[None]:
    """Apply the style inside the block."""
    with mpl.rc_context(_RC):
        yield


def new_figure(height_in: float, width_in: float = WIDTH_IN) -> Figure:
    """Return an empty figure with its own canvas: no pyplot, nothing to close."""
    figure = Figure(figsize=(width_in, height_in), dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save(figure: Figure, path: Path) -> None:
    """Write a PNG, drawn once, where `savefig` draws for the layout too."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    imsave(path, canvas.buffer_rgba(), dpi=DPI, metadata={"Software": "fg-nav"})


def head(axes: Axes, title: str, columns: int = 6) -> None:
    """Put the title above the axes and the legend, if anything is labelled, in rows between the two."""
    handles, labels = axes.get_legend_handles_labels()
    # columns that fit side by side over a picture; they are filled from top to bottom
    columns = min(columns, max(len(labels), 1))
    while columns > 1:
        widest = (column.max() for column in np.array_split([len(label) for label in labels], columns))
        if sum(_HANDLE_LETTERS + letters for letters in widest) <= _LINE_LETTERS:
            break
        columns -= 1
    rows = -(-len(handles) // columns)
    axes.set_title(title, pad=8.0 + 15.0 * rows)
    if handles:
        place: dict[str, Any] = {"loc": "lower left", "bbox_to_anchor": (-0.008, 1.0), "borderaxespad": 0.0}
        axes.legend(handles, labels, **place, ncols=columns, handlelength=1.6, columnspacing=1.6)
