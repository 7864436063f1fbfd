"""What pictures of several papers share: panels for fields, paths, flags along the walk, errors at landmarks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fg_nav.arrays import Bools, Floats
from fg_nav.lab import palette
from fg_nav.lab.reproduce.results import Picture
from fg_nav.lab.store.results import USED, Result
from fg_nav.lab.walked import AS_STARTED
from fg_nav.report.plots import style


@dataclass(frozen=True)
class Pictures:
    """Where the pictures of a paper go: `folder`, and the name that each file begins with."""

    folder: Path
    paper: str

    def keep(self, figure: Figure, number: int, what: str, ours: str) -> Picture:
        """Write the picture of a numbered figure of the paper; its caption says what that shows and what ours does."""
        file = f"{self.paper}_fig{number:02d}.png"
        style.save(figure, self.folder / file)
        return Picture(file, f"Fig. {number} of the paper: {what}; ours: {ours}")


def estimate_of(result: Result) -> Floats:
    """(K, 2) m, as started."""
    return np.array(result.estimate.get(AS_STARTED, []), dtype=np.float64).reshape(-1, 2)


def truth_of(result: Result) -> Floats:
    """(K, 2) m."""
    return np.array(result.truth, dtype=np.float64).reshape(-1, 2)


def used_of(result: Result) -> Bools:
    """(K,) where the method used the field."""
    return np.array([flag == USED for flag in result.used], dtype=bool)


def new_panels(
    rows: int, columns: int, height_in: float, width_in: float = style.WIDTH_IN
) -> tuple[Figure, list[Axes]]:
    """Return an empty figure and its panels, row by row; call it in a styled block."""
    figure = style.new_figure(height_in, width_in)
    return figure, list(figure.subplots(rows, columns, squeeze=False).flat)


def draw_path(axes: Axes, path: Floats, label: str, colour: str, truth: Floats | None = None) -> None:
    """Draw a path (K, 2) m from above on equal scales, over the truth; a square is where it ends."""
    axes.set_aspect("equal", adjustable="datalim")
    if truth is not None:
        axes.plot(*truth.T, **palette.TRUTH_LINE, zorder=1, label="truth")
    axes.plot(*path.T, "-", color=colour, linewidth=0.9, zorder=3, label=label)
    axes.plot(*path[-1:].T, "s", color=colour, markersize=4.5, markerfacecolor="white", zorder=5)
    axes.set(xlabel="east (m)", ylabel="north (m)")


def draw_flags(axes: Axes, used: Bools, title: str) -> None:
    """Draw the verdict along the walk, 1 where the field was used, as the papers do."""
    axes.fill_between(np.arange(len(used)), used.astype(float), step="mid", color=palette.BLUE, linewidth=0.0)
    axes.set(ylim=(-0.05, 1.15), yticks=(0, 1), xlim=(0, len(used)), ylabel="quasi-static")
    axes.grid(visible=False)
    axes.set_title(f"{title}: {100 * used.mean():.0f} % of the footfalls")


def draw_landmarks(axes: Axes, names: Sequence[str], errors: Mapping[str, Sequence[float]], title: str) -> None:
    """Draw the error at each crossing: the first method as bars, the others as marks above them."""
    place = np.arange(len(names))
    marks = zip(errors.items(), palette.colours(len(errors)), ("", "D", "o", "^"), strict=False)
    for (method, error), colour, mark in marks:
        label = f"{method}, mean {np.mean(error):.1f} m"
        if not mark:
            axes.bar(place, error, color=colour, width=0.75, label=label)
        else:
            axes.plot(place, error, mark, color=colour, markersize=3.5, label=label)
    axes.set(xlim=(-0.7, len(names) - 0.3), xticks=place, ylabel="error (m)")
    axes.set_xticklabels(names, fontsize=6.5)
    axes.grid(visible=False, axis="x")
    style.head(axes, title)
