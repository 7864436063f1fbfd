"""The coordinate along magnetic north from the field alone, next to that of a trajectory."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fg_nav.arrays import Floats
from fg_nav.report.plots import style

HEIGHT_IN = 4.6


def plot_field_north(t: Floats, field: Floats, inertial: Floats, truth: Floats | None, title: str) -> Figure:
    """Draw the coordinates over time, and below by how much they differ.

    Parameters
    ----------
    t : (F,) s, of the footfalls.
    field, inertial : (F,) m towards magnetic north, from the field and from a trajectory without it.
    truth : (F,) m, if it is known; else the field is compared with the trajectory.
    title : of the walk.
    """
    with style.styled():
        figure = style.new_figure(HEIGHT_IN)
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        minutes = (t - t[0]) / 60.0
        if truth is not None:
            above.plot(minutes, truth, label="truth", **style.TRUTH_LINE)
        above.plot(minutes, inertial, color=style.VERMILION, label="without magnetometer")
        above.plot(minutes, field, ".", color=style.BLUE, markersize=2.5, label="field along the way")
        above.set_ylabel("towards magnetic north (m)")
        style.head(above, title)
        _draw_difference(below, minutes, field, inertial, truth)
        below.set_xlabel("time (min)")
    return figure


def _draw_difference(axes: Axes, minutes: Floats, field: Floats, inertial: Floats, truth: Floats | None) -> None:
    if truth is not None:
        axes.plot(minutes, inertial - truth, color=style.VERMILION)
    left = field - (inertial if truth is None else truth)
    axes.plot(minutes, left, ".-", color=style.BLUE, markersize=2.5, linewidth=0.6)
    axes.axhline(0.0, color=style.SOFT_INK, linewidth=0.7)
    axes.set_ylabel("less the truth (m)" if truth is not None else "field less trajectory (m)")
    axes.set_title(f"field: {np.sqrt(np.mean(left**2)):.2f} m rms", color=style.SOFT_INK, fontsize=9.0)
