"""ROC curves of several detectors beside each other, one panel a case."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fg_nav.arrays import Floats
from fg_nav.evaluation import Roc
from fg_nav.report.plots import style

PRINTED = "-printed"
"""Ending of a detector's name that shares its colour with the one without it, and is drawn dashed."""

PANEL_IN = 3.4
"""Width and height of a panel."""


@dataclass(frozen=True)
class RocPanel:
    """Curves of one case.

    Attributes
    ----------
    title : the case.
    rocs : by detector, statistics over their thresholds, so that a detector's own threshold is 1.
    words : written at the own threshold of a detector, for those that are named.
    """

    title: str
    rocs: Mapping[str, Roc]
    words: Mapping[str, str] = field(default_factory=dict)


def plot_rocs(panels: Sequence[RocPanel], columns: int = 3) -> Figure:
    """Draw the panels in rows, with the band over walks of the detectors that are not as printed.

    A dot is a detector's own threshold; the dashed diagonal is guessing.
    """
    rows = -(-len(panels) // columns)
    with style.styled():
        figure = style.new_figure((PANEL_IN - 0.1) * rows + 0.95, width_in=PANEL_IN * columns)
        grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
        colour = _colours(panels)
        for axes, panel in zip(grid.flat, panels, strict=False):
            _draw(axes, panel, colour)
        for axes in grid.flat[len(panels) :]:
            axes.set_axis_off()
        for axes in grid[-1]:
            axes.set_xlabel("P_FA: a field that changes passes")
        for axes in grid[:, 0]:
            axes.set_ylabel("P_D: a quasi-static field passes")
        if colour:
            _draw_legend(figure, max(grid.flat, key=lambda axes: len(axes.lines)), list(colour))
    return figure


def _draw_legend(figure: Figure, axes: Axes, families: list[str]) -> None:
    """A column a family."""
    handles, labels = axes.get_legend_handles_labels()
    order = sorted(range(len(labels)), key=lambda i: families.index(labels[i].removesuffix(PRINTED)))
    figure.legend(
        [handles[i] for i in order],
        [labels[i] for i in order],
        loc="outside lower center",
        ncols=len(families),
        handlelength=2.4,
    )


def _colours(panels: Sequence[RocPanel]) -> dict[str, str]:
    families = list(dict.fromkeys(name.removesuffix(PRINTED) for panel in panels for name in panel.rocs))
    return dict(zip(families, style.colours(len(families)), strict=True))


def _draw(axes: Axes, panel: RocPanel, colour: Mapping[str, str]) -> None:
    axes.plot([0, 1], [0, 1], color=style.SOFT_INK, linewidth=0.8, linestyle=(0, (2, 3)))
    for name, roc in panel.rocs.items():
        shade, dashed = colour[name.removesuffix(PRINTED)], name.endswith(PRINTED)
        axes.plot(roc.p_fa, roc.p_d, color=shade, linestyle=(0, (4, 2)) if dashed else "-", label=name)
        if not dashed and roc.n_walks > 1:
            _draw_band(axes, roc, shade)
        p_d, p_fa = roc.at(1.0)
        face = "white" if dashed else shade
        axes.plot(p_fa, p_d, "o", color=shade, markersize=5.5, markerfacecolor=face, zorder=5, clip_on=False)
        if name in panel.words:
            _write(axes, panel.words[name], p_fa, p_d)
    axes.set(xlim=(0, 1), ylim=(0, 1), box_aspect=1)
    axes.set_title(panel.title)


def _draw_band(axes: Axes, roc: Roc, shade: str) -> None:
    p_fa: Floats = np.linspace(0.0, 1.0, 101)
    axes.fill_between(p_fa, *roc.curve_band(p_fa), color=shade, alpha=0.15, linewidth=0)


def _write(axes: Axes, words: str, p_fa: float, p_d: float) -> None:
    """Below the point and towards the middle of the panel."""
    left = p_fa > 0.5
    offset = (-8.0, -14.0) if left else (8.0, -12.0)
    side = "right" if left else "left"
    axes.annotate(
        words, (p_fa, p_d), xytext=offset, textcoords="offset points", ha=side, fontsize=8.0, color=style.INK, zorder=6
    )
