"""The field along a walk: strength, inclination, compass and gyroscope, and a lane of verdicts for each detector."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from fg_nav.arrays import Floats
from fg_nav.frames import wrap
from fg_nav.report import style
from fg_nav.report.field_survey import FieldSurvey
from fg_nav.report.lanes import ACCEPTED, draw_lanes, height_in, span

_DOTS = ((100, 5.0), (400, 3.6))
"""Up to so many footfalls, dots of this size in points; smaller ones for more."""

LEAST_SPAN_UT, LEAST_SPAN_DEG = 5.0, 5.0
"""Of the axes of strength and inclination."""

Curve = dict[str, Any]


def plot_field(survey: FieldSurvey) -> Figure:
    """Draw what the magnetometer shows at the footfalls, and below it what each detector makes of it."""
    lanes_in = height_in(len(survey.verdicts))
    with style.styled():
        figure = style.new_figure(7.0 + lanes_in)
        panels = figure.subplots(5, 1, sharex=True, height_ratios=[1.3, 1.3, 1.6, 1.6, lanes_in])
        _draw_strength(panels[0], survey)
        _draw_inclination(panels[1], survey)
        _draw_headings(panels[2], survey)
        _draw_difference(panels[3], survey)
        draw_lanes(panels[4], survey.field.t, survey.verdicts, "Verdicts, and the share of all footfalls that pass")
        panels[4].set_xlim(*span(survey.field.t))
        panels[4].set_xlabel("time (s)")
    return figure


def _dots(survey: FieldSurvey, colour: str, label: str = "") -> Curve:
    size = next((size for most, size in _DOTS if len(survey.field) <= most), 1.8)
    return {"marker": ".", "linestyle": "none", "color": colour, "markersize": size, "label": label or "_dots"}


def _draw_strength(axes: Axes, survey: FieldSurvey) -> None:
    axes.plot(survey.field.t, survey.field.strength, **_dots(survey, style.BLUE))
    if survey.earth is not None:
        _expect(axes, survey.earth.strength_uT, f"the Earth's, {survey.earth.strength_uT:.1f} uT")
    span_at_least(axes, LEAST_SPAN_UT)
    axes.set_ylabel("strength (uT)")
    style.head(axes, "Strength of the field at the footfalls")


def _draw_inclination(axes: Axes, survey: FieldSurvey) -> None:
    axes.plot(survey.field.t, np.degrees(survey.field.inclination), **_dots(survey, style.BLUE))
    if survey.earth is not None:
        dip_deg = float(np.degrees(survey.earth.inclination))
        _expect(axes, dip_deg, f"the Earth's, {dip_deg:.1f} deg")
    span_at_least(axes, LEAST_SPAN_DEG)
    axes.set_ylabel("inclination (deg)")
    style.head(axes, "Its inclination below the horizon")


def span_at_least(axes: Axes, span: float) -> None:
    """Widen an axis, so that noise does not look like a disturbance."""
    low, high = axes.get_ylim()
    middle, half = (low + high) / 2, max(high - low, span) / 2
    axes.set_ylim(middle - half, middle + half)


def _expect(axes: Axes, value: float, label: str) -> None:
    axes.axhline(value, color=style.ORANGE, linewidth=1.2, label=label)


def _draw_headings(axes: Axes, survey: FieldSurvey) -> None:
    """The gyroscope's are laid on the compass's: where north is it does not know."""
    t, laid = survey.field.t, survey.field.gyro_heading + survey.offset
    words = f"gyroscope, turned by {np.degrees(survey.offset):+.0f} deg to lie on the compass"
    axes.plot(t, np.degrees(laid) % 360.0, **_dots(survey, style.ORANGE, words))
    axes.plot(t, np.degrees(survey.compass_heading) % 360.0, **_dots(survey, style.BLUE, "compass"))
    axes.set_ylim(-8.0, 368.0)
    axes.yaxis.set_major_locator(MultipleLocator(90))
    axes.set_ylabel("heading (deg)")
    style.head(axes, f"Heading of the sensor's x axis, clockwise from {north_of(survey)}")


def _draw_difference(axes: Axes, survey: FieldSurvey) -> None:
    t, difference = survey.field.t, wrap(survey.difference - survey.offset)
    known = np.isfinite(difference)
    passed = survey.verdicts[survey.chosen].quasi_static
    axes.plot(t[known & ~passed], np.degrees(difference[known & ~passed]), **_dots(survey, style.TRUTH, "all others"))
    words = f"quasi-static by {survey.chosen}" + ("" if passed.any() else ": none")
    green = _dots(survey, ACCEPTED, words)
    axes.plot(t[passed], np.degrees(difference[passed]), **green | {"markersize": 1.5 * green["markersize"]})
    reach_deg = _half_circle_at_most(np.degrees(np.abs(difference[known])))
    axes.set_ylim(-1.05 * reach_deg, 1.05 * reach_deg)
    axes.yaxis.set_major_locator(MultipleLocator(reach_deg / 2))
    axes.set_ylabel("difference (deg)")
    style.head(axes, f"Compass less gyroscope, about their mean difference of {np.degrees(survey.offset):+.0f} deg")


def _half_circle_at_most(values_deg: Floats) -> float:
    """Least of a few round angles that holds them all."""
    largest = float(np.max(values_deg, initial=0.0))
    return next((angle for angle in (10.0, 20.0, 30.0, 60.0, 90.0) if largest <= angle), 180.0)


def north_of(survey: FieldSurvey) -> str:
    """Words for the compass's north."""
    if survey.earth is None:
        return "magnetic north"
    return f"north, declination {np.degrees(survey.declination):+.1f} deg"
