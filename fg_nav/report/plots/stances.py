"""The stance statistic over its threshold."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fg_nav.arrays import Floats
from fg_nav.report.plots import style
from fg_nav.report.plots.style import envelope
from fg_nav.stances import Stances

MAX_STANCES_AS_LINE = 150
"""With more stances than this the line of the statistic would fill the picture."""

EXCERPT_S = 10.0
"""Length of the close-up: about ten strides."""


def plot_stance_statistic(t: Floats, stances: Stances) -> Figure:
    """Draw the detector's statistic over its threshold: the whole walk above, ten seconds of it below.

    `t` (N,) s. The stances must have a statistic.
    """
    if stances.statistic is None:
        raise ValueError("these stances have no statistic to draw")
    excerpt = _excerpt(t, stances)
    with style.styled():
        figure = style.new_figure(5.0)
        whole, close = figure.subplots(2, 1, sharey=True)
        _draw_overview(whole, t, stances, stances.statistic)
        whole.axvspan(t[excerpt.start], t[excerpt.stop - 1], color=style.ORANGE, alpha=0.3, linewidth=0)
        middle = (t[excerpt.start] + t[excerpt.stop - 1]) / 2
        pointer = {"transform": whole.get_xaxis_transform(), "clip_on": False}
        whole.plot(middle, 1.0, "v", color=style.ORANGE, markersize=7, **pointer)
        style.head(whole, f"Stance detection ({stances.detector}): {stances.n_footfalls} footfalls")
        whole.set_ylim(*_log_limits(stances.statistic))
        _shade_stances(close, t, stances, excerpt)
        _draw_statistic(close, t[excerpt], stances.statistic[excerpt], linewidth=1.0)
        close.set_xlim(t[excerpt.start], t[excerpt.stop - 1])
        close.set_xlabel("time (s)")
        style.head(close, "Close-up of the marked stretch")
    return figure


def _excerpt(t: Floats, stances: Stances) -> slice:
    """Choose the samples of the close-up: around the middle stance, where the walk is in full swing."""
    k = len(stances) // 2
    centre = t[stances.start[k]] if len(stances) else t[len(t) // 2]
    begin = min(max(centre - EXCERPT_S / 2, t[0]), max(t[-1] - EXCERPT_S, t[0]))
    return slice(int(np.searchsorted(t, begin)), int(np.searchsorted(t, begin + EXCERPT_S, side="right")))


def _shade_stances(axes: Axes, t: Floats, stances: Stances, part: slice) -> None:
    label = "stance"
    for start, stop in zip(stances.start, stances.stop, strict=True):
        if stop > part.start and start < part.stop:
            axes.axvspan(t[start], t[stop - 1], color=style.SHADE, linewidth=0, label=label)
            label = "_another"


def _draw_overview(axes: Axes, t: Floats, stances: Stances, statistic: Floats) -> None:
    """Draw the whole statistic; of a long walk, whose line is a block, a dot for each stance and swing."""
    if len(stances) <= MAX_STANCES_AS_LINE:
        _draw_statistic(axes, *envelope(t, statistic), linewidth=0.5)
        return
    ends = np.stack([stances.start, stances.stop], axis=1).ravel()[:-1]  # stance, swing, stance, ...
    low, high = np.fmin.reduceat(statistic, ends)[0::2], np.fmax.reduceat(statistic, ends)[1::2]
    axes.plot(t[ends[1::2]], high, ".", color=style.SKY, markersize=2.5, label="largest of each swing")
    axes.plot(t[ends[0::2]], low, ".", color=style.BLUE, markersize=2.5, label="smallest of each stance")
    _draw_statistic(axes, t[:0], statistic[:0], linewidth=0.5)


def _draw_statistic(axes: Axes, t: Floats, statistic: Floats, linewidth: float) -> None:
    axes.plot(t, statistic, color=style.BLUE, linewidth=linewidth)
    axes.axhline(1.0, color=style.VERMILION, linewidth=1.1, label="threshold")
    axes.set_yscale("log")
    axes.margins(x=0.01)
    axes.set_ylabel("statistic / threshold")


def _log_limits(statistic: Floats) -> tuple[float, float]:
    positive = statistic[np.isfinite(statistic) & (statistic > 0)]
    if not len(positive):
        return 0.1, 10.0
    low, high = np.percentile(positive, [0.5, 100.0])
    return min(float(low) / 2, 0.5), max(float(high) * 2, 2.0)
