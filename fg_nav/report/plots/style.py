"""Common style of all pictures, charts (`fg_nav.report.charts`) drawn by matplotlib, and the pictures of a walk.

Quiet axes, one width. No global state of matplotlib is touched beyond the `styled` block, and no window system is
needed. Pictures of a walk are charts of the page as PNG (docs/files.md).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.image import imsave
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator, MultipleLocator, NullLocator

from fg_nav.arrays import Floats
from fg_nav.report.charts import (
    PICTURE,
    Chart,
    Paths,
    Trace,
    align_feet,
    align_paths,
    describe_ellipses,
    draw_course,
)
from fg_nav.report.series import draw_errors, draw_gyro_bias, draw_headings, draw_samples

if TYPE_CHECKING:
    from fg_nav.both_feet import FeetResult
    from fg_nav.walk import Outcome, Walk

INK, SOFT_INK, GRID = "#222222", "#6B6B6B", "#E6E6E6"
WIDTH_IN, DPI = 8.0, 150
_LINE_LETTERS, _HANDLE_LETTERS = 105, 5  # Letters of a legend over the width of a picture, and width of its signs.
_CAPTION_LETTERS = 128  # Of a caption over the width of a picture.
_PIXEL = 0.75  # Points of a pixel of the page, whose lines and dots are as wide on paper.
_PAGE_PER_IN = 100.0  # Pixels of the page for the height of a picture.
_SYMBOLS = {"circle": "o", "square": "s", "diamond": "D"}
_WIDE_DEG, _ROUND_DEG = 90.0, (1, 1.5, 3, 4.5, 6, 9, 10)  # An axis of angles that is wider has ticks like 45, 90, 180.

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


# --- charts ----------------------------------------------------------------------------------------------------------


def render_matplotlib(*charts: Chart, title: str, caption: str | None = None) -> Figure:
    """Draw charts below one another; a `caption` other than theirs goes below the last."""
    heights = [find_height(chart) for chart in charts]
    with styled():
        figure = new_figure(sum(heights))
        parts = figure.subfigures(len(charts), 1, squeeze=False, height_ratios=heights)[:, 0]
        for k, (part, chart) in enumerate(zip(parts, charts, strict=True)):
            # panels below one another, the title above the first, a legend above each
            names = [name for name in chart.layout if name.startswith("yaxis")]
            shares = [float(np.ptp(chart.layout[name].get("domain", (0.0, 1.0)))) for name in names]
            panels = part.subplots(len(names), 1, sharex=True, squeeze=False, height_ratios=shares)[:, 0]
            for axes, name in zip(panels, names, strict=True):
                draw_panel(axes, chart, name)
                axes.label_outer()
                head(axes, title if k == 0 and axes is panels[0] else "")
            words = chart.caption if caption is None else caption
            if caption is None or k == len(charts) - 1:
                below: dict[str, Any] = {"x": 0.01, "ha": "left", "fontsize": 8.5, "color": SOFT_INK}
                part.supxlabel(fill(words, _CAPTION_LETTERS), **below)
    return figure


def find_height(chart: Chart) -> float:
    """Height of a picture in inches: of a map by its shape, else as on the page."""
    if not chart.scaled:
        return float(chart.height.removesuffix("px")) / _PAGE_PER_IN
    return find_map_height(*(float(np.ptp(chart.layout[name]["range"])) for name in ("xaxis", "yaxis")))


def find_map_height(width_m: float, height_m: float) -> float:
    """Height of a picture in inches of a map of this extent."""
    return float(np.clip(WIDTH_IN * height_m / width_m, 3.5, 8.0)) + 0.9


def draw_panel(axes: Axes, chart: Chart, name: str = "yaxis") -> None:
    """Draw the panel of a chart with this y axis, over what the axes show already."""
    before = axes.dataLim.frozen() if axes.has_data() else None
    draw_traces(axes, [trace for trace in chart.data if trace.get("yaxis", "y") == name.replace("axis", "")])
    x, y = chart.layout["xaxis"], chart.layout[name]
    axes.set(xlabel=x["title"]["text"], ylabel=y["title"]["text"])
    axes.margins(x=0.01)
    if chart.scaled:
        shape_map(axes, x["range"], y["range"])
        if before is not None:
            axes.update_datalim(before.get_points())
            axes.autoscale_view()
        arrow = {"arrowstyle": "-|>", "color": INK}
        place: dict[str, Any] = {"xycoords": "axes fraction", "textcoords": "offset points", "ha": "center"}
        axes.annotate(
            chart.north, (1.03, 1.0), (0, -40), arrowprops=arrow, fontsize=8.5, annotation_clip=False, **place
        )
        return
    if y.get("type") == "log":
        axes.set_yscale("log")
        axes.yaxis.set_minor_locator(NullLocator())
    if "range" in y and y["range"][0] != y["range"][1]:
        axes.set_ylim(*(10.0 ** np.array(y["range"]) if y.get("type") == "log" else y["range"]))
    elif y.get("rangemode") == "tozero":
        axes.set_ylim(bottom=0.0)
    if "tickvals" in y:
        axes.set_yticks(y["tickvals"], y.get("ticktext"))
    elif "(deg)" in y["title"]["text"] and np.ptp(axes.get_ylim()) > _WIDE_DEG:
        axes.yaxis.set_major_locator(MaxNLocator(9, steps=_ROUND_DEG))


def shape_map(axes: Axes, x: Sequence[float], y: Sequence[float]) -> None:
    """Give a map of these ranges equal scales, and the same round ticks on both axes."""
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.0)
    axes.dataLim.set_points(np.array([x, y]).T)
    axes.autoscale_view()
    wanted = max(float(np.ptp(x)), float(np.ptp(y)), 0.1) / 8
    power = 10.0 ** np.floor(np.log10(wanted))
    step_m = float(power * min(s for s in (1, 2, 5, 10) if power * s >= wanted))
    axes.xaxis.set_major_locator(MultipleLocator(step_m))
    axes.yaxis.set_major_locator(MultipleLocator(step_m))


def draw_traces(axes: Axes, traces: Sequence[Trace], lowest: int = 2) -> None:
    """Draw traces, each over those before, from the z-order `lowest` on, except for those that no picture has."""
    for order, trace in enumerate(traces, start=lowest):
        if not trace.get(PICTURE, trace.get("visible", True) is True):
            continue
        label = trace["name"] if trace.get("showlegend", True) else "_"
        kind: dict[str, Any] = {"label": label, "zorder": order, "alpha": trace.get("opacity")}
        if trace["type"] == "image":
            axes.imshow(trace["z"], extent=trace["extent"], aspect="auto", interpolation="none", zorder=order)
            continue
        points = np.array([trace["x"], trace["y"]], dtype=np.float64).T
        if "fill" in trace:
            _fill(axes, points, trace, kind)
        else:
            _draw_points(axes, points, trace, kind)
    axes.autoscale_view()


def _fill(axes: Axes, points: Floats, trace: Trace, kind: dict[str, Any]) -> None:
    """Draw areas, between which the points (N, 2) are NaN."""
    known = np.isfinite(points).all(axis=1)
    areas = [points[run] for run in np.split(np.arange(len(points)), np.flatnonzero(~known))]
    edge = {"edgecolor": _read_color(trace["line"]["color"]), "linewidth": trace["line"]["width"] * _PIXEL}
    found = [area[np.isfinite(area).all(axis=1)] for area in areas]
    shown = [area for area in found if len(area)]
    axes.add_collection(PolyCollection(shown, facecolor=_read_color(trace["fillcolor"]), **edge, **kind))


def _draw_points(axes: Axes, points: Floats, trace: Trace, kind: dict[str, Any]) -> None:
    """Draw a line, markers, or both, with their text."""
    line, marker, mode = trace.get("line", {}), trace.get("marker", {}), trace["mode"]
    color = _read_color(marker.get("color", line.get("color")))
    kind |= {"color": color, "linestyle": "none"}
    if "lines" in mode:
        dash = {"dot": ":", "dash": "--"}.get(line.get("dash", ""), "-")
        kind |= {"color": _read_color(line["color"]), "linewidth": line["width"] * _PIXEL, "linestyle": dash}
    symbols = marker.get("symbol", "circle")
    # one symbol of all points, or one of each
    parts = [(points, symbols)] if isinstance(symbols, str) else zip(points[:, None], symbols, strict=True)
    for part, symbol in parts:
        if "markers" in mode:
            kind |= {"marker": _SYMBOLS[symbol.removesuffix("-open")], "markersize": marker["size"] * _PIXEL}
            kind |= {"markeredgewidth": marker.get("line", {}).get("width", 0.0) * _PIXEL}
            kind |= {"markerfacecolor": "white" if symbol.endswith("-open") else color}
        axes.plot(*part.T, **kind)
    halo: dict[str, Any] = {"path_effects": [withStroke(linewidth=2.5, foreground="white")], "zorder": kind["zorder"]}
    for words, place, point in zip(trace.get("text", ()), trace.get("textposition", ()), points, strict=False):
        height: dict[str, Any] = {"va": "bottom"} if place.startswith("top") else {"va": "top"}
        offset = (5, 4 if place.startswith("top") else -4)
        axes.annotate(words, tuple(point), offset, textcoords="offset points", fontsize=8.5, **height, **halo)


def _read_color(words: str) -> Any:
    """Return a colour of plotly for matplotlib."""
    if not words.startswith("rgba"):
        return words
    red, green, blue, opacity = (float(number) for number in words[5:-1].split(","))
    return red / 255, green / 255, blue / 255, opacity


def draw_walk(folder: Path, walk: Walk, outcomes: Mapping[str, Outcome], both: FeetResult | None = None) -> None:
    """Draw one method, or several over each other and each into its own folder, or the paths of both feet."""
    if both is not None:
        draw_paths(folder / "trajectory.png", align_feet(both))
        return
    if len(outcomes) > 1:
        paths = align_paths(outcomes, walk)
        draw_paths(folder / "trajectories.png", paths)
        if all(view.comparison is not None for view in paths.views.values()):
            _write(folder / "errors.png", f"Position error{paths.first.alignment_words}", draw_errors(paths.views))
    for name, outcome in outcomes.items():
        paths, place = align_paths({name: outcome}, walk), folder if len(outcomes) == 1 else folder / name
        draw_paths(place / "trajectory.png", paths)
        _write(place / "heading.png", f"Heading{paths.first.alignment_words}", draw_headings(paths.views))
        _write(place / "gyro_bias.png", "Gyroscope bias", draw_gyro_bias(paths.views))
    # the detection, where the detector left a statistic
    found = walk.stances
    if found.statistic is not None:
        title = f"Stance detection ({found.detector}): {found.n_footfalls} footfalls"
        _write(folder / "stance_statistic.png", title, *draw_samples(walk.recording, found))


def _write(file: Path, title: str, *charts: Chart, caption: str | None = None) -> None:
    save(render_matplotlib(*charts, title=title, caption=caption), file)


def draw_paths(file: Path, paths: Paths) -> None:
    """Draw paths from above."""
    caption = f"{paths.frame.words} {describe_ellipses(paths.first)}"
    _write(file, f"Path{paths.first.alignment_words}", draw_course(paths), caption=caption)


def draw_on_screen(paths: Paths, axes: Axes | None = None) -> Axes:
    """Draw paths from above into these axes, or into a new figure of pyplot, which windows and notebooks show."""
    from matplotlib import pyplot

    chart = draw_course(paths)
    with styled():
        if axes is None:
            axes = pyplot.figure(figsize=(WIDTH_IN, find_height(chart)), layout="constrained").subplots()
        draw_panel(axes, chart)
        head(axes, f"Path{paths.first.alignment_words}")
    return axes
