"""Pictures `field` and `field_map`: the field along a walk, and each detector's verdicts, over time and from above.

Verdicts over time stand in lanes, one a detector, its share beside it. Where verdicts are denser than pixels their
colours mix; where there is none for a while, the lane is empty.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, MultipleLocator

from fg_nav.arrays import Floats
from fg_nav.evaluation.field_survey import SAMPLEWISE, Coverage, FieldSurvey, SampleSurvey
from fg_nav.frames import wrap_angle
from fg_nav.magnetic.quasi_static import WINDOW_S, OverThreshold
from fg_nav.report.drawn import AlignedSolution, align_solution, envelope, spread_rows
from fg_nav.report.plots import style
from fg_nav.report.plots.style import MAX_POINTS
from fg_nav.report.plots.walk import draw_ends
from fg_nav.truth import FootprintTruth, TrajectoryTruth

if TYPE_CHECKING:
    from fg_nav.walk import Outcome, Walk

_DOTS = ((100, 5.0), (400, 3.6))  # Most footfalls, and the size of their dots in points; smaller ones for more.
_MAP_DOTS = ((60, 5.0), (200, 3.6), (600, 2.6), (1500, 2.0))
MIN_SPAN_UT, MIN_SPAN_DEG = 5.0, 5.0  # Of the axes of strength and inclination: noise is not a disturbance.
ACCEPTED, REJECTED, UNJUDGED = style.GREEN, "#F3C6AE", style.GRID  # Colours of the verdicts; also apart in grey.
CELLS, FINE = 1000, 8  # Cells of a lane over the whole walk, and parts of a cell, whose colours mix.
REACH_S, REACH_STEPS = 3.0, 2.0  # Time that a verdict colours around it, or of the usual step if that is longer.
_LANE_IN = 0.21  # Height of a lane.
MAPS, MAX_MAPS = 3, 6  # Maps beside each other, and of a course that is far longer than wide.
TALL = 2.0  # Height over width of such a course.
_MAP_HEIGHTS_IN = (1.1, 4.2)  # Of one map, inches.
MAP_TITLE = "Where each detector takes the field for quasi-static, and at what share of the footfalls"

Curve = dict[str, Any]


def draw_survey(folder: Path, walk: Walk, survey: FieldSurvey, outcome: Outcome) -> None:
    """Draw the field along the walk and the detectors' verdicts."""
    style.save(plot_field(survey), folder / "field.png")
    style.save(plot_field_map(survey, align_solution(walk, outcome)), folder / "field_map.png")


def plot_field(survey: FieldSurvey) -> Figure:
    """Draw the field at the footfalls, and below it the verdicts of each detector."""
    lanes_in, field, earth = _LANE_IN * len(survey.verdicts) + 0.25, survey.field, survey.earth
    with style.styled():
        figure = style.new_figure(7.0 + lanes_in)
        panels = figure.subplots(5, 1, sharex=True, height_ratios=[1.3, 1.3, 1.6, 1.6, lanes_in])
        strength = None if earth is None else (earth.strength_uT, f"the Earth's, {earth.strength_uT:.1f} uT")
        _draw_quantity(panels[0], survey, field.strength, strength, MIN_SPAN_UT)
        panels[0].set_ylabel("strength (uT)")
        style.head(panels[0], "Strength of the field at the footfalls")
        dip_deg = 0.0 if earth is None else float(np.degrees(earth.inclination))
        dip = None if earth is None else (dip_deg, f"the Earth's, {dip_deg:.1f} deg")
        _draw_quantity(panels[1], survey, np.degrees(field.inclination), dip, MIN_SPAN_DEG)
        panels[1].set_ylabel("inclination (deg)")
        style.head(panels[1], "Its inclination below the horizon")
        # headings; the gyroscope's are turned onto the compass, as its north is unknown
        words = f"gyroscope, turned by {np.degrees(survey.offset):+.0f} deg to lie on the compass"
        laid = np.degrees(field.gyro_heading + survey.offset) % 360.0
        panels[2].plot(field.t, laid, **_dots(survey, style.ORANGE, words))
        compass = np.degrees(survey.compass_heading) % 360.0
        panels[2].plot(field.t, compass, **_dots(survey, style.BLUE, "compass"))
        panels[2].set_ylim(-8.0, 368.0)
        panels[2].yaxis.set_major_locator(MultipleLocator(90))
        panels[2].set_ylabel("heading (deg)")
        declination_deg = np.degrees(survey.declination)
        north = "magnetic north" if earth is None else f"north, declination {declination_deg:+.1f} deg"
        style.head(panels[2], f"Heading of the sensor's x axis, clockwise from {north}")
        _draw_difference(panels[3], survey)
        _draw_lanes(panels[4], field.t, survey.verdicts, "Verdicts, and the share of all footfalls that pass")
        panels[4].set_xlim(*_find_span(field.t))
        panels[4].set_xlabel("time (s)")
    return figure


def _dots(survey: FieldSurvey, colour: str, label: str = "") -> Curve:
    size = next((size for most, size in _DOTS if len(survey.field) <= most), 1.8)
    return {"marker": ".", "linestyle": "none", "color": colour, "markersize": size, "label": label or "_dots"}


def _draw_quantity(
    axes: Axes, survey: FieldSurvey, value: Floats, expected: tuple[float, str] | None, min_span: float
) -> None:
    axes.plot(survey.field.t, value, **_dots(survey, style.BLUE))
    if expected is not None:
        axes.axhline(expected[0], color=style.ORANGE, linewidth=1.2, label=expected[1])
    _widen(axes, min_span)


def _widen(axes: Axes, min_span: float) -> None:
    """Widen an axis to a span, so that noise does not look like a disturbance."""
    low, high = axes.get_ylim()
    middle, half = (low + high) / 2, max(high - low, min_span) / 2
    axes.set_ylim(middle - half, middle + half)


def _draw_difference(axes: Axes, survey: FieldSurvey) -> None:
    t, difference = survey.field.t, wrap_angle(survey.difference - survey.offset)
    known = np.isfinite(difference)
    passed = survey.verdicts[survey.chosen].quasi_static
    axes.plot(t[known & ~passed], np.degrees(difference[known & ~passed]), **_dots(survey, style.TRUTH, "all others"))
    words = f"quasi-static by {survey.chosen}" + ("" if passed.any() else ": none")
    green = _dots(survey, ACCEPTED, words)
    axes.plot(t[passed], np.degrees(difference[passed]), **green | {"markersize": 1.5 * green["markersize"]})
    # least of a few round angles that holds them all
    largest = float(np.max(np.degrees(np.abs(difference[known])), initial=0.0))
    reach_deg = next((angle for angle in (10.0, 20.0, 30.0, 60.0, 90.0) if largest <= angle), 180.0)
    axes.set_ylim(-1.05 * reach_deg, 1.05 * reach_deg)
    axes.yaxis.set_major_locator(MultipleLocator(reach_deg / 2))
    axes.set_ylabel("difference (deg)")
    style.head(axes, f"Compass less gyroscope, about their mean difference of {np.degrees(survey.offset):+.0f} deg")


def plot_field_map(survey: FieldSurvey, view: AlignedSolution) -> Figure:
    """Draw one map of the walk per detector, with the footfalls it accepts in colour."""
    found = survey.coverage
    path = view.align_position(survey.solution.position[spread_rows(len(survey.solution.position), MAX_POINTS)])[:, :2]
    width, height = np.ptp(path, axis=0)
    columns = min(MAX_MAPS if height > TALL * width else MAPS, len(found))
    rows = -(-len(found) // columns)
    fitting = style.WIDTH_IN / columns * (height + 1e-9) / (width + 1e-9)
    low, high = _MAP_HEIGHTS_IN
    map_in = float(np.clip(fitting, low, high if columns > 1 else 2 * high)) + 0.55
    with style.styled():
        figure = style.new_figure(rows * map_in + 0.75)
        grid = figure.subplots(rows, columns, squeeze=False)
        for axes, one in zip(grid.ravel(), found, strict=False):
            _draw_map(axes, survey, view, path, one, " " if columns <= MAPS else "\n")
        for axes in grid.ravel()[len(found) :]:
            axes.set_visible(False)
        draw_ends(
            grid[0, 0], view.align_position(survey.position)
        )  # on the first map only: the labels would hide footfalls
        # legend and labels of all maps
        for colour, label in ((ACCEPTED, "quasi-static"), (REJECTED, "disturbed or not judged")):
            grid[0, 0].plot([], [], "o", color=colour, markersize=6, label=label)
        handles, labels = grid[0, 0].get_legend_handles_labels()
        figure.legend(
            handles, labels, loc="outside upper left", ncols=3, title=MAP_TITLE, title_fontsize=10.5, alignment="left"
        )
        east, north = ("x", "y") if isinstance(view.truth, FootprintTruth) else ("east", "north")  # unknown azimuth
        figure.supxlabel(f"{east} (m)", fontsize=9.0, color=style.SOFT_INK)
        figure.supylabel(f"{north} (m)", fontsize=9.0, color=style.SOFT_INK)
    return figure


def _draw_map(
    axes: Axes, survey: FieldSurvey, view: AlignedSolution, path: Floats, found: Coverage, between: str
) -> None:
    stance = view.align_position(survey.position)
    passed = survey.verdicts[found.detector].quasi_static
    size = next((size for most, size in _MAP_DOTS if len(stance) <= most), 1.4)
    if isinstance(view.truth, TrajectoryTruth):
        true = view.truth.position[spread_rows(len(view.truth.position), MAX_POINTS)]
        line = style.TRUTH_LINE | {"linewidth": 2.0, "alpha": 0.45}
        axes.plot(true[:, 0], true[:, 1], **line, zorder=1, label="truth")
    axes.plot(path[:, 0], path[:, 1], color=style.TRUTH, linewidth=0.4, zorder=2)
    axes.plot(*stance[~passed, :2].T, "o", color=REJECTED, markersize=size, markeredgewidth=0, zorder=3)
    axes.plot(*stance[passed, :2].T, "o", color=ACCEPTED, markersize=size + 1.0, markeredgewidth=0, zorder=4)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.06)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
    axes.set_title(f"{found.detector}:{between}{100 * found.share:.0f} %")


def plot_samples(survey: SampleSurvey) -> Figure:
    """Draw strength, statistic and verdicts over time."""
    with style.styled():
        figure = style.new_figure(4.8)
        strength, statistic, lane = figure.subplots(3, 1, sharex=True, height_ratios=[6, 6, 1])
        strength.plot(*envelope(survey.t, survey.strength), color=style.BLUE, linewidth=0.8)
        _widen(strength, MIN_SPAN_UT)
        strength.set_ylabel("strength (uT)")
        style.head(strength, "Strength of the field at every sample")
        statistic.plot(*envelope(survey.t, survey.verdicts.statistic), color=style.BLUE, linewidth=0.8)
        statistic.axhline(1.0, color=style.VERMILION, linewidth=1.1, label="threshold: below it the field passes")
        statistic.set_yscale("log")
        statistic.set_ylabel("statistic / threshold")
        style.head(statistic, f"Scatter of the strength over the {WINDOW_S:g} s before")
        words = f"Verdicts, and the share of all samples that pass; longest stretch {survey.longest_s:.0f} s"
        _draw_lanes(lane, survey.t, {SAMPLEWISE: survey.verdicts}, words)
        lane.set_xlim(survey.t[0], survey.t[-1])
        lane.set_xlabel("time (s)")
    return figure


def _draw_lanes(axes: Axes, t: Floats, verdicts: Mapping[str, OverThreshold], title: str) -> None:
    """Draw a lane for each detector's verdicts at the times `t` (F,) s."""
    # for each cell the nearest verdict, and its distance over its reach
    middle = np.linspace(*_find_span(t), CELLS * FINE)
    nearest = np.searchsorted(0.5 * (t[1:] + t[:-1]), middle)
    far = np.abs(middle - t[nearest]) / max(REACH_S, REACH_STEPS * _find_step(t))
    lanes = []
    for one in verdicts.values():
        colour = np.where(one.quasi_static[:, None], to_rgb(ACCEPTED), to_rgb(REJECTED))
        colour = np.where(one.judged[:, None], colour, to_rgb(UNJUDGED))[nearest]
        colour[far > 1.0] = 1.0
        lanes.append(colour.reshape(CELLS, FINE, 3).mean(axis=1))
    extent = (*_find_span(t), len(lanes) - 0.5, -0.5)
    axes.imshow(np.stack(lanes), extent=extent, aspect="auto", interpolation="none", origin="upper")
    words = [f"{name}  {100 * one.quasi_static.mean():.0f} %" for name, one in verdicts.items()]
    axes.set_yticks(range(len(lanes)), words)
    axes.set_yticks(np.arange(0.5, len(lanes) - 1), minor=True)
    axes.grid(visible=False)
    axes.grid(visible=True, which="minor", axis="y", color="white", linewidth=3.0)
    axes.tick_params(axis="y", which="both", length=0)
    for shown, label in ((ACCEPTED, "quasi-static"), (REJECTED, "disturbed"), (UNJUDGED, "not judged")):
        axes.plot([], [], "s", color=shown, markersize=7, label=label)
    style.head(axes, title)


def _find_span(t: Floats) -> tuple[float, float]:
    """Time from half a step before the first to half a step after the last."""
    half = 0.5 * _find_step(t)
    return float(t[0]) - half, float(t[-1]) + half


def _find_step(t: Floats) -> float:
    return float(np.median(np.diff(t))) if len(t) > 1 else 1.0
