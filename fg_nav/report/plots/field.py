"""The field along a walk, and what each detector makes of it: over time, from above, and sample by sample.

Verdicts over time stand in lanes, one a detector, its share beside it. Where verdicts are denser than pixels their
colours mix. Where there is none for a while, the lane is empty.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, MultipleLocator

from fg_nav.arrays import Floats, Ints
from fg_nav.evaluation.field_survey import SAMPLEWISE, Coverage, FieldSurvey, SampleSurvey
from fg_nav.frames import wrap_angle
from fg_nav.magnetic.quasi_static import WINDOW_S, OverThreshold
from fg_nav.report.aligned import AlignedSolution
from fg_nav.report.decimation import envelope, spread_rows
from fg_nav.report.plots import style
from fg_nav.report.plots.maps import draw_ends
from fg_nav.report.plots.style import MAX_POINTS
from fg_nav.truth import FootprintTruth, TrajectoryTruth

_DOTS = ((100, 5.0), (400, 3.6))  # Up to so many footfalls, dots of this size in points; smaller ones for more.
MIN_SPAN_UT, MIN_SPAN_DEG = 5.0, 5.0  # Of the axes of strength and inclination.

ACCEPTED, REJECTED, UNJUDGED = style.GREEN, "#F3C6AE", style.GRID
"""Colours of the verdicts; also apart in grey."""

CELLS, FINE = 1000, 8
"""Cells of a lane over the whole walk, and parts of a cell: where verdicts are denser the colours mix."""

REACH_S, REACH_STEPS = 3.0, 2.0
"""A verdict colours the time around it, up to so many seconds, or of the usual time between two if that is longer."""

_LANE_IN = 0.21

MAPS, MAX_MAPS = 3, 6  # Maps beside each other, and as many of a course that is far longer than wide.
TALL = 2.0  # Height over width of a course from which on it is.
_MAP_HEIGHTS_IN = (1.1, 4.2)  # Of one map, inches.

MAP_TITLE = "Where each detector takes the field for quasi-static, and at what share of the footfalls"

_MAP_DOTS = ((60, 5.0), (200, 3.6), (600, 2.6), (1500, 2.0))  # Up to so many footfalls, dots of this size in points.

Curve = dict[str, Any]


def plot_field(survey: FieldSurvey) -> Figure:
    """Draw what the magnetometer shows at the footfalls, and below it what each detector makes of it."""
    lanes_in = lanes_height_in(len(survey.verdicts))
    with style.styled():
        figure = style.new_figure(7.0 + lanes_in)
        panels = figure.subplots(5, 1, sharex=True, height_ratios=[1.3, 1.3, 1.6, 1.6, lanes_in])
        _draw_strength(panels[0], survey)
        _draw_inclination(panels[1], survey)
        _draw_headings(panels[2], survey)
        _draw_difference(panels[3], survey)
        draw_lanes(panels[4], survey.field.t, survey.verdicts, "Verdicts, and the share of all footfalls that pass")
        panels[4].set_xlim(*span_of(survey.field.t))
        panels[4].set_xlabel("time (s)")
    return figure


def _dots(survey: FieldSurvey, colour: str, label: str = "") -> Curve:
    size = next((size for most, size in _DOTS if len(survey.field) <= most), 1.8)
    return {"marker": ".", "linestyle": "none", "color": colour, "markersize": size, "label": label or "_dots"}


def _draw_strength(axes: Axes, survey: FieldSurvey) -> None:
    axes.plot(survey.field.t, survey.field.strength, **_dots(survey, style.BLUE))
    if survey.earth is not None:
        _expect(axes, survey.earth.strength_uT, f"the Earth's, {survey.earth.strength_uT:.1f} uT")
    span_at_least(axes, MIN_SPAN_UT)
    axes.set_ylabel("strength (uT)")
    style.head(axes, "Strength of the field at the footfalls")


def _draw_inclination(axes: Axes, survey: FieldSurvey) -> None:
    axes.plot(survey.field.t, np.degrees(survey.field.inclination), **_dots(survey, style.BLUE))
    if survey.earth is not None:
        dip_deg = float(np.degrees(survey.earth.inclination))
        _expect(axes, dip_deg, f"the Earth's, {dip_deg:.1f} deg")
    span_at_least(axes, MIN_SPAN_DEG)
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
    t, difference = survey.field.t, wrap_angle(survey.difference - survey.offset)
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


def plot_field_map(survey: FieldSurvey, view: AlignedSolution) -> Figure:
    """Draw the walk once for each detector, the footfalls whose field passes in colour."""
    found = survey.coverage
    path = view.align_position(survey.solution.position[spread_rows(len(survey.solution.position), MAX_POINTS)])[:, :2]
    columns = _map_columns(path, len(found))
    rows = -(-len(found) // columns)
    with style.styled():
        figure = style.new_figure(rows * _map_height(path, columns) + 0.75)
        grid = figure.subplots(rows, columns, squeeze=False)
        for axes, one in zip(grid.ravel(), found, strict=False):
            _draw_map(axes, survey, view, path, one, " " if columns <= MAPS else "\n")
        for axes in grid.ravel()[len(found) :]:
            axes.set_visible(False)
        draw_ends(grid[0, 0], view.align_position(survey.position))  # its words would hide footfalls in all of them
        _label_map(figure, grid[0, 0], view)
    return figure


def _map_columns(path: Floats, maps: int) -> int:
    width, height = np.ptp(path, axis=0)
    return min(MAX_MAPS if height > TALL * width else MAPS, maps)


def _map_height(path: Floats, columns: int) -> float:
    width, height = np.ptp(path, axis=0) + 1e-9
    fitting = style.WIDTH_IN / columns * height / width
    low, high = _MAP_HEIGHTS_IN
    return float(np.clip(fitting, low, high if columns > 1 else 2 * high)) + 0.55


def _draw_map(
    axes: Axes, survey: FieldSurvey, view: AlignedSolution, path: Floats, found: Coverage, between: str
) -> None:
    stance = view.align_position(survey.position)
    passed = survey.verdicts[found.detector].quasi_static
    size = next((size for most, size in _MAP_DOTS if len(stance) <= most), 1.4)
    if isinstance(view.truth, TrajectoryTruth):
        true = view.truth.position[spread_rows(len(view.truth.position), MAX_POINTS)]
        axes.plot(
            true[:, 0], true[:, 1], **style.TRUTH_LINE | {"linewidth": 2.0, "alpha": 0.45}, zorder=1, label="truth"
        )
    axes.plot(path[:, 0], path[:, 1], color=style.TRUTH, linewidth=0.4, zorder=2)
    axes.plot(*stance[~passed, :2].T, "o", color=REJECTED, markersize=size, markeredgewidth=0, zorder=3)
    axes.plot(*stance[passed, :2].T, "o", color=ACCEPTED, markersize=size + 1.0, markeredgewidth=0, zorder=4)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.06)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
    axes.set_title(f"{found.detector}:{between}{100 * found.share:.0f} %")


def _label_map(figure: Figure, axes: Axes, view: AlignedSolution) -> None:
    for colour, label in ((ACCEPTED, "quasi-static"), (REJECTED, "disturbed or not judged")):
        axes.plot([], [], "o", color=colour, markersize=6, label=label)
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside upper left", ncols=3, title=MAP_TITLE, title_fontsize=10.5, alignment="left"
    )
    east, north = ("x", "y") if isinstance(view.truth, FootprintTruth) else ("east", "north")  # of unknown azimuth
    figure.supxlabel(f"{east} (m)", fontsize=9.0, color=style.SOFT_INK)
    figure.supylabel(f"{north} (m)", fontsize=9.0, color=style.SOFT_INK)


def plot_samples(survey: SampleSurvey) -> Figure:
    """Draw strength, statistic and verdicts over time."""
    with style.styled():
        figure = style.new_figure(4.8)
        strength, statistic, lane = figure.subplots(3, 1, sharex=True, height_ratios=[6, 6, 1])
        strength.plot(*envelope(survey.t, survey.strength), color=style.BLUE, linewidth=0.8)
        span_at_least(strength, MIN_SPAN_UT)
        strength.set_ylabel("strength (uT)")
        style.head(strength, "Strength of the field at every sample")
        _draw_sample_statistic(statistic, survey)
        words = f"Verdicts, and the share of all samples that pass; longest stretch {survey.longest_s:.0f} s"
        draw_lanes(lane, survey.t, {SAMPLEWISE: survey.verdicts}, words)
        lane.set_xlim(survey.t[0], survey.t[-1])
        lane.set_xlabel("time (s)")
    return figure


def _draw_sample_statistic(axes: Axes, survey: SampleSurvey) -> None:
    axes.plot(*envelope(survey.t, survey.verdicts.statistic), color=style.BLUE, linewidth=0.8)
    axes.axhline(1.0, color=style.VERMILION, linewidth=1.1, label="threshold: below it the field passes")
    axes.set_yscale("log")
    axes.set_ylabel("statistic / threshold")
    style.head(axes, f"Scatter of the strength over the {WINDOW_S:g} s before")


def lanes_height_in(count: int) -> float:
    """Height of so many lanes, inches."""
    return _LANE_IN * count + 0.25


def draw_lanes(axes: Axes, t: Floats, verdicts: Mapping[str, OverThreshold], title: str) -> None:
    """Draw a lane for each detector's verdicts at the times `t` (F,) s."""
    nearest, far = _cells(t)
    lanes = np.stack([_lane(one, nearest, far) for one in verdicts.values()])
    axes.imshow(
        lanes, extent=(*span_of(t), len(lanes) - 0.5, -0.5), aspect="auto", interpolation="none", origin="upper",
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


def span_of(t: Floats) -> tuple[float, float]:
    """Time from half a step before the first to half a step after the last."""
    half = 0.5 * _step(t)
    return float(t[0]) - half, float(t[-1]) + half


def _step(t: Floats) -> float:
    return float(np.median(np.diff(t))) if len(t) > 1 else 1.0


def _cells(t: Floats) -> tuple[Ints, Floats]:
    """Which verdict is nearest (CELLS * FINE,) along the walk, and how far it is over its reach."""
    middle = np.linspace(*span_of(t), CELLS * FINE)
    nearest = np.searchsorted(0.5 * (t[1:] + t[:-1]), middle)
    return nearest, np.abs(middle - t[nearest]) / max(REACH_S, REACH_STEPS * _step(t))


def _lane(verdicts: OverThreshold, nearest: Ints, far: Floats) -> Floats:
    """Colours (CELLS, 3): in a cell of several verdicts, their mean."""
    colour = np.where(verdicts.quasi_static[:, None], to_rgb(ACCEPTED), to_rgb(REJECTED))
    colour = np.where(verdicts.judged[:, None], colour, to_rgb(UNJUDGED))[nearest]
    colour[far > 1.0] = 1.0
    return np.asarray(colour.reshape(CELLS, FINE, 3).mean(axis=1))
