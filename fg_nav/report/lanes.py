"""Lanes of verdicts over time, one a detector, its share beside it.

Where verdicts are denser than pixels their colours mix. Where there is none for a while, the lane is empty.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb

from fg_nav.arrays import Floats, Ints
from fg_nav.magnetic.quasi_static import OverThreshold
from fg_nav.report import style

ACCEPTED, REJECTED, UNJUDGED = style.GREEN, "#F3C6AE", style.GRID
"""Colours of the verdicts; also apart in grey."""

COLUMNS, FINE = 1000, 8
"""Cells of a lane over the whole walk, and parts of a cell: where verdicts are denser the colours mix."""

REACH_S, REACH_STEPS = 3.0, 2.0
"""A verdict colours the time around it, up to so many seconds, or of the usual time between two if that is longer."""

_LANE_IN = 0.21


def height_in(count: int) -> float:
    """Height of so many lanes, inches."""
    return _LANE_IN * count + 0.25


def draw_lanes(axes: Axes, t: Floats, verdicts: Mapping[str, OverThreshold], title: str) -> None:
    """Draw a lane for each detector's verdicts at the times `t` (F,) s."""
    nearest, far = _cells(t)
    lanes = np.stack([_lane(one, nearest, far) for one in verdicts.values()])
    axes.imshow(
        lanes, extent=(*span(t), len(lanes) - 0.5, -0.5), aspect="auto", interpolation="none", origin="upper",
    )  # fmt: skip
    words = [f"{name}  {100 * one.quasi_static.mean():.0f} %" for name, one in verdicts.items()]
    axes.set_yticks(range(len(lanes)), words)
    axes.set_yticks(np.arange(0.5, len(lanes) - 1), minor=True)
    axes.grid(visible=False)
    axes.grid(visible=True, which="minor", axis="y", color="white", linewidth=3.0)
    axes.tick_params(axis="y", which="both", length=0)
    for colour, label in ((ACCEPTED, "quasi-static"), (REJECTED, "disturbed"), (UNJUDGED, "not judged")):
        axes.plot([], [], "s", color=colour, markersize=7, label=label)
    style.head(axes, title)


def span(t: Floats) -> tuple[float, float]:
    """Time from half a step before the first to half a step after the last."""
    half = 0.5 * _step(t)
    return float(t[0]) - half, float(t[-1]) + half


def _step(t: Floats) -> float:
    return float(np.median(np.diff(t))) if len(t) > 1 else 1.0


def _cells(t: Floats) -> tuple[Ints, Floats]:
    """Which verdict is nearest (COLUMNS * FINE,) along the walk, and how far it is over its reach."""
    middle = np.linspace(*span(t), COLUMNS * FINE)
    nearest = np.searchsorted(0.5 * (t[1:] + t[:-1]), middle)
    return nearest, np.abs(middle - t[nearest]) / max(REACH_S, REACH_STEPS * _step(t))


def _lane(verdicts: OverThreshold, nearest: Ints, far: Floats) -> Floats:
    """Colours (COLUMNS, 3): in a cell of several verdicts, their mean."""
    colour = np.where(verdicts.quasi_static[:, None], to_rgb(ACCEPTED), to_rgb(REJECTED))
    colour = np.where(verdicts.judged[:, None], colour, to_rgb(UNJUDGED))[nearest]
    colour[far > 1.0] = 1.0
    return np.asarray(colour.reshape(COLUMNS, FINE, 3).mean(axis=1))
