"""Charts as data: lines, bands and dots in panels over one another, in the words of plotly's JSON.

`render_plotly` gives the page its JSON; `fg_nav.report.plots.style.render_matplotlib` draws the same chart as a PNG.
A trace that is `LATER` is hidden on the page until its legend entry is clicked, and is not in a picture; the key
`PICTURE` of a trace, which plotly does not get, decides otherwise.

Numbers are rounded to visible digits; non-finite ones become null, which breaks a line. Colours are legible on white
and on dark grey; text and grid are coloured by the page.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

from fg_nav.arrays import Floats, Ints

Trace: TypeAlias = dict[str, Any]
"""One line, band or set of dots."""

Digits: TypeAlias = tuple[int | None, int | None]
"""Decimals of x and y; None for significant digits."""

METERS = 4  # Decimals: tenths of millimetres.
IN_TIME: Digits = (3, None)  # Over time, to milliseconds;
ALONG_PATH: Digits = (METERS, None)  # over the length of the path;
ON_MAP: Digits = (METERS, METERS)  # from above.

BLUE, VERMILION, GREEN, PURPLE, OCHRE, TEAL = "#2a7fc9", "#d9601a", "#12946c", "#b8609c", "#b07d12", "#3a93b0"
CYCLE = (BLUE, VERMILION, GREEN, PURPLE, OCHRE, TEAL)  # Of methods and axes: Okabe and Ito, on white and dark.
GRAY = "#8a9096"  # Of a truth, and of footfalls without a verdict.
SHADE = "rgba(42, 127, 201, 0.16)"  # Background of a stance.
MAX_POINTS = 6000  # Of a line: a desk shows some 1200 pixels, and a reader zooms in by a factor of a few.
MAX_DOTS = 3000  # Dots with a label for the pointer: more of them make a page slow.
LATER = "legendonly"  # Visibility of a trace that is drawn on a touch on the legend.
PICTURE = "picture"  # Key of a trace: whether a picture has it, where this is not its visibility on the page.
BAND = 1.96  # Half width of a 95 % band, in standard deviations.
_DIGITS = 6  # Significant digits of what has no number of decimals.


@dataclass(frozen=True)
class Panel:
    """One pair of axes of a figure: label of its y axis, traces, further attributes of the y axis, share of height."""

    label: str
    traces: Sequence[Trace]
    axis: Mapping[str, Any] = field(default_factory=dict)
    share: float = 1.0


@dataclass(frozen=True)
class Chart:
    """A figure: its name on the page, traces and axes, caption, and height on the page in CSS.

    A map is `scaled`: a scale bar and a north arrow go with it, `north` the letters at that arrow.
    """

    name: str
    data: list[Trace]
    layout: dict[str, Any]
    caption: str
    height: str
    scaled: bool = False
    north: str = ""


def render_plotly(chart: Chart) -> dict[str, Any]:
    """Return a chart for plotly.js, ready for JSON."""
    data = [{key: value for key, value in trace.items() if key != PICTURE} for trace in chart.data]
    return {"data": data, "layout": chart.layout, "scaled": chart.scaled, "north": chart.north}


def spread_rows(n: int, at_most: int) -> Ints:
    """At most `at_most` of `n` rows, evenly spread, the first and the last among them."""
    rows = np.arange(0, n, max(-(-(n - 1) // max(at_most - 1, 1)), 1))
    return rows if rows[-1] == n - 1 else np.append(rows, n - 1)


def envelope(t: Floats, value: Floats, bins: int = 2000) -> tuple[Floats, Floats]:
    """Smallest and largest value of each of `bins` slices, in turn: as a line it looks like the whole signal.

    `t`, `value` (N,); returns at most (2 bins,) of each. NaN is left out; a slice without a number stays NaN.
    """
    if len(t) <= 2 * bins:
        return t, value
    edge = np.linspace(0, len(t), bins, endpoint=False).astype(np.int64)
    low, high = np.fmin.reduceat(value, edge), np.fmax.reduceat(value, edge)
    middle = t[(edge + np.append(edge[1:], len(t))) // 2]
    return np.repeat(middle, 2), np.stack([low, high], axis=1).ravel()


def to_numbers(values: Floats, decimals: int | None = None) -> list[float | None]:
    """Round to so many decimals, or to some significant digits; null where not finite."""
    values = np.asarray(values, dtype=np.float64)
    if decimals is None:
        with np.errstate(divide="ignore", invalid="ignore"):
            largest = np.log10(np.abs(values))
        finite = largest[np.isfinite(largest)]
        decimals = _DIGITS - 1 - int(np.ceil(np.median(finite))) if len(finite) else 0
    return [value if np.isfinite(value) else None for value in np.round(values, decimals).tolist()]


def line(x: Floats, y: Floats, color: str, name: str, digits: Digits = IN_TIME, **more: Any) -> Trace:
    """Return a line through points x, y (N,)."""
    style = {"color": color, "width": more.pop("width", 1.5)} | more.pop("style", {})
    points = {"x": to_numbers(x, digits[0]), "y": to_numbers(y, digits[1])}
    return {"type": "scatter", "mode": "lines", **points, "line": style, "name": name, **more}


def signal(t: Floats, value: Floats, color: str, name: str, **more: Any) -> Trace:
    """Return the line of a signal over time; of a long one its envelope."""
    if len(t) > MAX_POINTS:
        t, value = envelope(t, value, MAX_POINTS // 2)
    return line(t, value, color, name, **more)


def dots(x: Floats, y: Floats, color: str, name: str, digits: Digits = IN_TIME, **more: Any) -> Trace:
    """Return dots at x, y (N,)."""
    mark = {"color": color, "size": more.pop("size", 4.5)} | more.pop("style", {})
    points = {"x": to_numbers(x, digits[0]), "y": to_numbers(y, digits[1])}
    return {"type": "scatter", "mode": "markers", **points, "marker": mark, "name": name, **more}


def band(t: Floats, middle: Floats, half: Floats, color: str, name: str, **more: Any) -> Trace:
    """Return the area within `half` (N,) of `middle` (N,), thinned."""
    known = np.flatnonzero(np.isfinite(middle) & np.isfinite(half))
    row = known[spread_rows(len(known), MAX_POINTS // 2)] if len(known) else known
    t, low, high = t[row], (middle - half)[row], (middle + half)[row]
    around = np.concatenate([t, t[::-1]]), np.concatenate([low, high[::-1]])
    return line(*around, color, name, width=0, fill="toself", fillcolor=fade(color, 0.2), hoverinfo="skip", **more)


def level(t: Floats, value: float, color: str, name: str, **more: Any) -> Trace:
    """Return a horizontal line over the whole time."""
    return line(t[[0, -1]], np.array([value, value]), color, name, width=1.2, hoverinfo="skip", **more)


def fade(color: str, opacity: float) -> str:
    """Return a colour "#rrggbb" with an opacity."""
    red, green, blue = (int(color[k : k + 2], 16) for k in (1, 3, 5))
    return f"rgba({red}, {green}, {blue}, {opacity:g})"


def thin(t: Floats, at_most: int = MAX_POINTS) -> Ints:
    """Rows of a series to draw."""
    return spread_rows(len(t), at_most) if len(t) else np.zeros(0, dtype=np.int64)


def stack(name: str, panels: Sequence[Panel], caption: str, x_label: str = "time (s)") -> Chart:
    """Stack panels on a shared x axis; the legend names each trace once."""
    ends = ["" if k == 0 else str(k + 1) for k in range(len(panels))]  # of the names of axes
    layout: dict[str, Any] = {"xaxis": axis(x_label, anchor=f"y{ends[-1]}")}
    gap = 0.09 if len(panels) > 1 else 0.0
    whole, top = sum(panel.share for panel in panels), 1.0
    room = (1.0 - gap * (len(panels) - 1)) / whole
    data: list[Trace] = []
    for k, panel in enumerate(panels):
        bottom = max(top - room * panel.share, 0.0)
        layout[f"yaxis{ends[k]}"] = axis(panel.label, domain=[bottom, top], **panel.axis)
        data += [trace | {"xaxis": "x", "yaxis": f"y{ends[k]}"} for trace in panel.traces]
        top = bottom - gap
    # One entry of the legend hides and shows all traces of a name. It looks like the last line or dots of that name in
    # the uppermost panel, not like a band.
    entry: dict[str, int] = {}
    for k, trace in enumerate(data):
        kept = entry.setdefault(trace["name"], k)
        if "fill" not in trace and trace["yaxis"] == data[kept]["yaxis"]:
            entry[trace["name"]] = k
    named = [
        {"legendgroup": trace["name"], **trace, **({} if entry[trace["name"]] == k else {"showlegend": False})}
        for k, trace in enumerate(data)
    ]
    return Chart(name, named, layout, caption, f"{90 + 170 * round(max(whole, 1.4), 1):.0f}px")


def axis(label: str, **more: Any) -> dict[str, Any]:
    """Return an axis with a label."""
    return {"title": {"text": label, "standoff": 6}, "zeroline": False, "automargin": True, **more}
