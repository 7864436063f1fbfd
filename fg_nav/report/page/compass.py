"""The compass against the gyroscope at the footfalls, and the strength of the field along the path."""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.frames import wrap_angle
from fg_nav.magnetic.footfall_field import FootfallField
from fg_nav.magnetic.quasi_static import DISTURBED, QUASI_STATIC
from fg_nav.report.page.figures import (
    BLUE,
    GRAY,
    GREEN,
    MAX_DOTS,
    OCHRE,
    VERMILION,
    Chart,
    Panel,
    Trace,
    dots,
    stack,
    thin,
    to_meters,
    to_numbers,
    to_seconds,
)
from fg_nav.solution import StanceTable

MIN_SPAN_UT, MIN_SPAN_DEG = 5.0, 5.0  # Of the axes of strength and inclination: noise is not to look like a disturbance

_GROUPS = ((GREEN, "undisturbed"), (VERMILION, "disturbed"), (GRAY, "not judged"))


def judge(field: FootfallField, table: StanceTable) -> list[tuple[Bools, str, str]]:
    """Footfalls (F,) by the verdict in the table of a solution, with color and word."""
    nearest = np.clip(np.searchsorted(table.t, field.t - 1e-6), 0, max(len(table) - 1, 0))
    words = np.array(table.field, dtype=object)[nearest] if len(table) else np.full(len(field), "", dtype=object)
    clear, disturbed = words == QUASI_STATIC, words == DISTURBED
    flags = (clear, disturbed, ~clear & ~disturbed)
    return [(flag, *group) for flag, group in zip(flags, _GROUPS, strict=True)]


def draw_compass(field: FootfallField, table: StanceTable) -> Chart:
    """Draw both headings, that of the gyroscope turned to lie on the compass, and their difference."""
    row, t = thin(field.t, MAX_DOTS), to_seconds(field.t[thin(field.t, MAX_DOTS)])
    turned = np.rad2deg(field.gyro_heading + field.mean_heading_difference)[row] % 360.0
    compass = np.rad2deg(field.magnetic_heading)[row] % 360.0
    above = [
        dots(t, to_numbers(turned, 2), OCHRE, "gyroscope, turned onto the compass", size=5),
        dots(t, to_numbers(compass, 2), BLUE, "compass", size=4),
    ]
    apart = np.rad2deg(wrap_angle(field.heading_difference - field.mean_heading_difference))
    below = [
        dots(to_seconds(field.t[use]), to_numbers(apart[use], 2), color, f"difference, field {word}", size=5)
        for use, color, word in _thin_groups(field, table)
    ]
    quarters = {"range": [-8, 368], "tickvals": [0, 90, 180, 270, 360]}
    panels = [Panel("heading (deg)", above, quarters, share=1.4), Panel("difference (deg)", below, share=1.2)]
    return stack("compass", panels, "At the footfalls, clockwise from magnetic north. Below, compass less gyroscope.")


def draw_strength(field: FootfallField, table: StanceTable) -> Chart:
    """Draw strength and inclination over the length of the path."""
    travelled = measure_travelled(field.t, table)
    rows = [
        ("strength (µT)", field.strength, MIN_SPAN_UT),
        ("inclination (deg)", np.rad2deg(field.inclination), MIN_SPAN_DEG),
    ]
    panels = [
        Panel(label, _draw_along(field, table, travelled, value), {"range": _span(value, least)})
        for label, value, least in rows
    ]
    return stack("strength", panels, "At the footfalls, along the path.", "length of the path (m)")


def measure_travelled(t: Floats, table: StanceTable) -> Floats:
    """Length of the path (F,) m at times `t` (F,) s, by the moves from stance to stance."""
    moves = np.linalg.norm(np.diff(table.position, axis=0), axis=1)
    return np.asarray(np.interp(t, table.t, np.concatenate([[0.0], np.cumsum(moves)])))


def _draw_along(field: FootfallField, table: StanceTable, travelled: Floats, value: Floats) -> list[Trace]:
    hover = "%{y:.2f} at %{x:.1f} m, t %{customdata:.1f} s<extra></extra>"
    return [
        dots(
            to_meters(travelled[use]), to_numbers(value[use]), color, word, size=5, hovertemplate=hover,
            customdata=to_seconds(field.t[use]),
        )
        for use, color, word in _thin_groups(field, table)
    ]  # fmt: skip


def _thin_groups(field: FootfallField, table: StanceTable) -> list[tuple[Bools, str, str]]:
    """Groups with a footfall, of those footfalls that are drawn."""
    drawn = np.zeros(len(field), dtype=bool)
    drawn[thin(field.t, MAX_DOTS)] = True
    return [(flag & drawn, color, word) for flag, color, word in judge(field, table) if (flag & drawn).any()]


def _span(value: Floats, least: float) -> list[float]:
    """Range of an axis that shows all values with a margin, and at least so much."""
    known = value[np.isfinite(value)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
    half = max(1.1 * (high - low), least) / 2
    return [(low + high) / 2 - half, (low + high) / 2 + half]
