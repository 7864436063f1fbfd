"""The stances over specific force, rate and the detector's statistic: the whole walk, and ten seconds of it."""

from __future__ import annotations

from typing import Any

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.recording import Recording
from fg_nav.report.excerpt import choose_excerpt, find_log_limits
from fg_nav.report.page.figures import (
    BLUE,
    GREEN,
    PURPLE,
    SHADE,
    VERMILION,
    Chart,
    Panel,
    Trace,
    level,
    line,
    signal,
    stack,
    to_numbers,
    to_seconds,
)
from fg_nav.stances import Stances
from fg_nav.system.spilled import measure_rows

MAX_SHADED = 2000  # More stances than this are less than a pixel wide in a walk, and make a page slow.


def draw_samples(recording: Recording, stances: Stances) -> list[Chart]:
    """Draw the whole walk, and the close-up in which single samples show."""
    part = choose_excerpt(recording.t, stances)
    few = len(stances) <= MAX_SHADED
    words = "The whole walk."
    if len(stances):
        words = "Shaded where the foot was taken to stand" + ("." if few else ", in the close-up only.")
    whole = slice(0, len(recording))
    begin, end = recording.t[part.start], recording.t[part.stop - 1]
    close = f"Close-up of {begin:.1f} to {end:.1f} s, every sample."
    return [
        _draw("stances", recording, stances, whole, few, words),
        _draw("close-up", recording, stances, part, True, close),
    ]


def _draw(name: str, recording: Recording, stances: Stances, part: slice, shaded: bool, caption: str) -> Chart:
    t = recording.t[part]
    rows = [
        ("|acc| (m/s²)", measure_rows(recording.acc[part]), BLUE, "|acc|"),
        ("|gyr| (rad/s)", measure_rows(recording.gyr[part]), PURPLE, "|gyr|"),
    ]
    shade = [_shade(recording.t, stances, part)] if shaded and len(stances) else []
    panels = [Panel(label, [*shade, signal(t, value, color, words, width=1)]) for label, value, color, words in rows]
    if stances.statistic is not None:
        panels.append(_draw_statistic(t, stances.statistic, part, shade))
    return stack(name, [_hold(panel) for panel in panels] if shade else panels, caption)


def _draw_statistic(t: Floats, statistic: Floats, part: slice, shade: list[Trace]) -> Panel:
    low, high = find_log_limits(statistic)
    with np.errstate(divide="ignore", invalid="ignore"):
        value = np.where(statistic[part] > 0, statistic[part], np.nan)
    traces = [*shade, signal(t, value, GREEN, "statistic", width=1), level(t, 1.0, VERMILION, "threshold")]
    limits = [float(np.log10(low)), float(np.log10(high))]
    return Panel("statistic / threshold", traces, {"type": "log", "range": limits, "exponentformat": "power"})


def _hold(panel: Panel) -> Panel:
    """Fix the range of a panel to its signals, and draw the shade over all of it."""
    if "range" in panel.axis:
        low, high = (10.0**end for end in panel.axis["range"])
        axis: dict[str, Any] = dict(panel.axis)
    else:
        values = [value for trace in panel.traces[1:] for value in trace["y"] if value is not None]
        low, high = 0.0, 1.05 * max(values, default=1.0)
        axis = {"range": [low, high]}
    shade = panel.traces[0]
    ends = [None if value is None else (high if value else low) for value in shade["y"]]
    return Panel(panel.label, [shade | {"y": ends}, *panel.traces[1:]], axis, panel.share)


def _shade(t: Floats, stances: Stances, part: slice) -> Trace:
    """Boxes from 0 to 1, one a stance, with gaps between them."""
    use = (stances.stop > part.start) & (stances.start < part.stop)
    start, stop = t[stances.start[use]], t[stances.stop[use] - 1]
    gap = np.full(len(start), np.nan)
    x = np.stack([start, start, stop, stop, start, gap], axis=1).ravel()
    y = np.tile([0.0, 1.0, 1.0, 0.0, 0.0, np.nan], len(start))
    more = {"fill": "toself", "fillcolor": SHADE, "hoverinfo": "skip"}
    return line(to_seconds(x), to_numbers(y, 0), SHADE, "stance", width=0, **more)
