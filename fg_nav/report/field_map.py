"""Where along the way each detector trusts the field: one small map a detector."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from fg_nav.arrays import Floats
from fg_nav.recording import FootprintTruth, TrajectoryTruth
from fg_nav.report import style
from fg_nav.report.field_survey import Coverage, FieldSurvey
from fg_nav.report.lanes import ACCEPTED, REJECTED
from fg_nav.report.maps import draw_ends
from fg_nav.report.thinning import MAX_POINTS, spread_rows
from fg_nav.report.view import View

COLUMNS, MOST_COLUMNS = 3, 6
"""Maps beside each other, and as many of a course that is far longer than wide."""

TALL = 2.0
"""Height over width of a course from which on it is."""

_HEIGHTS = (1.1, 4.2)
"""Of one map, inches."""

TITLE = "Where each detector takes the field for quasi-static, and at what share of the footfalls"

_DOTS = ((60, 5.0), (200, 3.6), (600, 2.6), (1500, 2.0))
"""Up to so many footfalls, dots of this size in points."""


def plot_field_map(survey: FieldSurvey, view: View) -> Figure:
    """Draw the walk once for each detector, the footfalls whose field passes in colour."""
    found = survey.coverage
    path = view.placed(survey.solution.position[spread_rows(len(survey.solution.position), MAX_POINTS)])[:, :2]
    columns = _columns(path, len(found))
    rows = -(-len(found) // columns)
    with style.styled():
        figure = style.new_figure(rows * _map_height(path, columns) + 0.75)
        grid = figure.subplots(rows, columns, squeeze=False)
        for axes, one in zip(grid.ravel(), found, strict=False):
            _draw_map(axes, survey, view, path, one, " " if columns <= COLUMNS else "\n")
        for axes in grid.ravel()[len(found) :]:
            axes.set_visible(False)
        draw_ends(grid[0, 0], view.placed(survey.position))  # its words would hide footfalls in all of them
        _label(figure, grid[0, 0], view)
    return figure


def _columns(path: Floats, maps: int) -> int:
    width, height = np.ptp(path, axis=0)
    return min(MOST_COLUMNS if height > TALL * width else COLUMNS, maps)


def _map_height(path: Floats, columns: int) -> float:
    width, height = np.ptp(path, axis=0) + 1e-9
    fitting = style.WIDTH_IN / columns * height / width
    low, high = _HEIGHTS
    return float(np.clip(fitting, low, high if columns > 1 else 2 * high)) + 0.55


def _draw_map(axes: Axes, survey: FieldSurvey, view: View, path: Floats, found: Coverage, between: str) -> None:
    stance = view.placed(survey.position)
    passed = survey.verdicts[found.detector].quasi_static
    size = next((size for most, size in _DOTS if len(stance) <= most), 1.4)
    if isinstance(view.truth, TrajectoryTruth):
        true = view.truth.position[spread_rows(len(view.truth.position), MAX_POINTS)]
        axes.plot(
            true[:, 0], true[:, 1], **style.TRUTH_LINE | {"linewidth": 2.0, "alpha": 0.45}, zorder=1, label="truth"
        )
    axes.plot(path[:, 0], path[:, 1], color=style.TRUTH, linewidth=0.4, zorder=2)
    axes.plot(*stance[~passed, :2].T, "o", color=REJECTED, markersize=size, markeredgewidth=0, zorder=3)
    axes.plot(*stance[passed, :2].T, "o", color=ACCEPTED, markersize=size + 1.0, markeredgewidth=0, zorder=4)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.06)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
    axes.set_title(f"{found.detector}:{between}{100 * found.share:.0f} %")


def _label(figure: Figure, axes: Axes, view: View) -> None:
    for colour, label in ((ACCEPTED, "quasi-static"), (REJECTED, "disturbed or not judged")):
        axes.plot([], [], "o", color=colour, markersize=6, label=label)
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside upper left", ncols=3, title=TITLE, title_fontsize=10.5, alignment="left"
    )
    east, north = ("x", "y") if isinstance(view.truth, FootprintTruth) else ("east", "north")  # of unknown azimuth
    figure.supxlabel(f"{east} (m)", fontsize=9.0, color=style.SOFT_INK)
    figure.supylabel(f"{north} (m)", fontsize=9.0, color=style.SOFT_INK)
