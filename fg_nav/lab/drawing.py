"""Pictures of the laboratory.

A simulated walk from above: its true path in the colours of the field, and its landmarks. The noise of a sensor: Allan
deviations in the units of data sheets. The field that a sensor measures, with the detectors' verdicts: over time these
stand in lanes, one a detector, its share beside it. Where verdicts are denser than pixels their colours mix; where
there is none for a while, the lane is empty.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from fg_nav.arrays import Floats
from fg_nav.frames import GRAVITY_M_S2, wrap_angle
from fg_nav.lab import palette
from fg_nav.lab.field_survey import SAMPLEWISE, WINDOW_S, FieldSurvey, SampleSurvey
from fg_nav.magnetic.detectors import OverThreshold
from fg_nav.report import charts
from fg_nav.report.charts import BLUE, GRAY, OCHRE, AlignedSolution, Panel, Trace, dots, level, line, signal
from fg_nav.report.plots import style
from fg_nav.report.series import COMPASS_AXIS, MIN_SPAN_DEG, MIN_SPAN_UT, find_log_limits, find_range
from fg_nav.truth import FootprintTruth, TrajectoryTruth

if TYPE_CHECKING:
    from fg_nav.lab.allan import AllanCurve, NoiseFit, RecordingNoise
    from fg_nav.lab.simulation import SimulatedWalk
    from fg_nav.walk import Outcome, Walk

MAX_PIECES = 20_000  # Of a line in the colours of the field.
WIDEST_SCALE = (2.0, 98.0)  # Percentiles of the strength at the ends of the colours: a magnet would flatten all else.

ACCEPTED, REJECTED, UNJUDGED = palette.GREEN, "#F3C6AE", style.GRID  # Colours of the verdicts; also apart in grey.
CELLS, FINE = 1000, 8  # Cells of a lane over the whole walk, and parts of a cell, whose colours mix.
REACH_S, REACH_STEPS = 3.0, 2.0  # Time that a verdict colours around it, or of the usual step if that is longer.
_LANE_SHARE = 0.15  # Height of a lane over that of a panel.
_DOTS = ((60, 6.5), (200, 5.0), (600, 3.5), (1500, 2.7))  # Most footfalls, and the size of their dots in pixels.
MAPS, MAX_MAPS = 3, 6  # Maps beside each other, and of a course that is far longer than wide.
TALL = 2.0  # Height over width of such a course.
_MAP_HEIGHTS_IN = (1.1, 4.2)  # Of one map, inches.
MAP_TITLE = "Where each detector takes the field for quasi-static, and at what share of the footfalls"


# --- a simulated walk ------------------------------------------------------------------------------------------------


def plot_simulated_walk(walk: SimulatedWalk) -> Figure:
    """Draw the true path, the field on it, and the landmarks."""
    position = walk.truth.position
    path = position[charts.spread_rows(len(position), MAX_PIECES)]
    strength = np.linalg.norm(walk.field.at(path + walk.origin), axis=1)
    low, high = path[:, :2].min(axis=0), path[:, :2].max(axis=0)
    margin = 0.06 * max(*(high - low).tolist(), 0.5)
    with style.styled():
        figure = style.new_figure(style.find_map_height(*(high - low + 2 * margin)))
        axes = figure.subplots()
        # path in the colours of the field
        weakest, strongest = np.percentile(strength, WIDEST_SCALE)
        pieces = np.stack([path[:-1, :2], path[1:, :2]], axis=1)
        lines = LineCollection(
            list(pieces), array=(strength[1:] + strength[:-1]) / 2, cmap="viridis", linewidth=1.6,
            capstyle="round", clim=(weakest - 0.5, strongest + 0.5), zorder=3,
        )  # fmt: skip
        axes.add_collection(lines)
        figure.colorbar(lines, ax=axes, label="field at the sensor (uT)", shrink=0.75, pad=0.02)
        # landmarks, start and end
        places = {mark.landmark: mark.position for mark in walk.landmarks}
        if places:
            east, north, _ = np.array(list(places.values())).T
            mark: dict[str, Any] = {"color": style.INK, "markerfacecolor": "white", "markersize": 5}
            axes.plot(east, north, "D", **mark, zorder=5, label="landmark")
        style.draw_traces(axes, charts.draw_ends(path), lowest=6)
        axes.set(xlabel="east (m)", ylabel="north (m)")
        style.shape_map(axes, *np.stack([low - margin, high + margin], axis=1))
        style.head(axes, f"{walk.scenario.name}, seed {walk.seed}: {walk.scenario.field} field")
    return figure


# --- noise -----------------------------------------------------------------------------------------------------------

AXES = ("x", "y", "z")


@dataclass(frozen=True)
class SheetUnit:
    """What data sheets write for a sensor: words of its unit, SI units (or uT) in it, and for B and K the same."""

    title: str
    white: str
    per_white: float
    level: str
    per_level: float
    walk: str
    per_walk: float


_DEG, _PER_SQRT_HOUR = float(np.rad2deg(1.0)), 60.0
_MICRO_G = 1e6 / GRAVITY_M_S2

UNITS = {
    "gyr": SheetUnit(
        "gyroscope", "deg/s/√Hz", _DEG, "deg/h", 3600 * _DEG, "deg/h/√h", 3600 * _DEG * _PER_SQRT_HOUR
    ),
    "acc": SheetUnit("accelerometer", "µg/√Hz", _MICRO_G, "µg", _MICRO_G, "µg/√h", _MICRO_G * _PER_SQRT_HOUR),
    "mag": SheetUnit("magnetometer", "nT/√Hz", 1e3, "nT", 1e3, "nT/√h", 1e3 * _PER_SQRT_HOUR),
}  # fmt: skip


def plot_allan(noise: RecordingNoise) -> Figure:
    """Draw every axis: measured deviation with its band, fit, and the parts that were seen."""
    rows = len(noise.sensors)
    with style.styled():
        figure = style.new_figure(0.7 + 2.5 * rows)
        grid = figure.subplots(rows, 3, sharex=True, sharey="row", squeeze=False)
        for row, one in zip(grid, noise.sensors, strict=True):
            for axes, name, curve, fit in zip(row, AXES, one.curves, one.fits, strict=True):
                _draw(axes, curve, fit, UNITS[one.sensor].per_level)
                axes.set_title(f"{UNITS[one.sensor].title} {name}")
            # range of the measured deviations and their bands; the parts of the fit may leave it
            bounds = np.concatenate([bound for fit in one.fits for bound in (fit.low, fit.high)])
            seen = UNITS[one.sensor].per_level * bounds[bounds > 0.0]
            limits = (float(seen.min()) / 1.5, 1.5 * float(seen.max())) if len(seen) else (0.1, 1.0)
            row[0].set_ylim(*limits)
            row[0].set_ylabel(f"Allan deviation ({UNITS[one.sensor].level})")
        for axes in grid[-1]:
            axes.set_xlabel("averaging time (s)")
        handles = {
            label: handle for axes in grid.flat for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
        }
        figure.legend(handles.values(), handles.keys(), loc="outside upper left", ncols=6, handlelength=1.8)
    return figure


def _draw(axes: Axes, curve: AllanCurve, fit: NoiseFit, factor: float) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    if not curve.deviation.any():
        axes.text(0.5, 0.5, "constant", transform=axes.transAxes, ha="center", color=style.SOFT_INK)
        return
    tau = np.geomspace(fit.fitted_from_s, curve.tau_s[-1], 200)
    axes.fill_between(
        curve.tau_s, factor * fit.low, factor * fit.high, color=palette.SKY, alpha=0.35, linewidth=0, label="68 %"
    )
    axes.plot(curve.tau_s, factor * curve.deviation, ".", color=palette.BLUE, markersize=4, label="measured", zorder=4)
    axes.plot(tau, factor * np.linalg.norm(fit.laws_at(tau), axis=0), color=style.INK, linewidth=1.0, label="fit")
    axes.margins(x=0.02)
    names = ("N white noise", "B flicker", "K random walk")
    parts, colours = (fit.white, fit.flicker, fit.walk), (palette.VERMILION, palette.GREEN, palette.PURPLE)
    for name, part, law, colour in zip(names, parts, fit.laws_at(tau), colours, strict=True):
        if part.seen:
            axes.plot(tau, factor * law, "--", color=colour, linewidth=1.1, label=name, zorder=1)


# --- the field along a walk ------------------------------------------------------------------------------------------


def draw_survey(folder: Path, walk: Walk, survey: FieldSurvey, outcome: Outcome) -> None:
    """Draw the field along the walk and the detectors' verdicts."""
    style.save(plot_field(survey), folder / "field.png")
    style.save(plot_field_map(survey, charts.align_solution(walk, outcome)), folder / "field_map.png")


def plot_field(survey: FieldSurvey) -> Figure:
    """Draw the field at the footfalls, and below it the verdicts of each detector."""
    field, earth, size = survey.field, survey.earth, _find_size(len(survey.field))
    offset_deg, t = float(np.degrees(survey.offset)), field.t
    # strength and inclination, with those of the Earth
    strength_uT, dip_deg = (None, None) if earth is None else (earth.strength_uT, float(np.degrees(earth.inclination)))
    quantities = (
        ("strength (uT)", field.strength, strength_uT, "uT", MIN_SPAN_UT),
        ("inclination (deg)", np.degrees(field.inclination), dip_deg, "deg", MIN_SPAN_DEG),
    )
    panels = []
    for label, value, expected, unit, span in quantities:
        traces, shown = [dots(t, value, BLUE, "at the footfalls", size=size)], value
        if expected is not None:
            traces.append(level(field.t, expected, OCHRE, f"the Earth's, {expected:.1f} {unit}"))
            shown = np.append(value, expected)
        panels.append(Panel(label, traces, {"range": find_range(shown, span)}))
    # headings; the gyroscope's are turned onto the compass, as its north is unknown
    laid = np.degrees(field.gyro_heading + survey.offset) % 360.0
    words = f"gyroscope, turned by {offset_deg:+.0f} deg to lie on the compass"
    headings = [
        dots(t, laid, OCHRE, words, size=size),
        dots(t, np.degrees(survey.compass_heading) % 360.0, BLUE, "compass", size=size),
    ]
    panels.append(Panel("heading (deg)", headings, COMPASS_AXIS, share=1.2))
    # difference, on the least of a few round angles that hold it
    apart = np.degrees(wrap_angle(survey.difference - survey.offset))
    passed = survey.verdicts[survey.chosen].quasi_static
    green = f"quasi-static by {survey.chosen}" + ("" if passed.any() else ": none")
    groups = [(~passed, GRAY, "all others", 1.0), (passed, ACCEPTED, green, 1.5)]
    differences = [dots(t[use], apart[use], color, name, size=larger * size) for use, color, name, larger in groups]
    largest = float(np.max(np.abs(apart[np.isfinite(apart)]), initial=0.0))
    reach_deg = next((angle for angle in (10.0, 20.0, 30.0, 60.0, 90.0) if largest <= angle), 180.0)
    ticks = {"range": [-1.05 * reach_deg, 1.05 * reach_deg], "tickvals": [reach_deg * k / 2 for k in range(-2, 3)]}
    panels.append(Panel("difference (deg)", differences, ticks, share=1.2))
    # statistics over their thresholds, and the verdicts
    found = [(name, one.statistic) for name, one in survey.verdicts.items() if one.judged.any()]
    limits = find_log_limits(np.concatenate([statistic for _, statistic in found])) if found else (0.1, 10.0)
    statistics = [line(t, one, color, name, width=1) for (name, one), color in zip(found, cycle(charts.CYCLE))]
    statistics.append(level(t, 1.0, style.INK, "threshold"))
    panels.append(Panel("statistic / threshold", statistics, {"type": "log", "range": [*np.log10(limits)]}, share=1.2))
    panels.append(_draw_lanes(t, survey.verdicts))
    north = "magnetic north" if earth is None else f"north, declination {np.degrees(survey.declination):+.1f} deg"
    caption = (
        f"Heading of the sensor's x axis, clockwise from {north}; difference of compass less gyroscope, about their "
        f"mean of {offset_deg:+.0f} deg. Below, the statistics, which pass below 1, the verdicts, and the share of all "
        "footfalls that pass."
    )
    return style.render_matplotlib(charts.stack("field", panels, caption), title="Field at the footfalls")


def _find_size(footfalls: int) -> float:
    """Size of the dots of so many footfalls in pixels; smaller ones for more."""
    return next((size for most, size in _DOTS if footfalls <= most), 2.0)


def plot_field_map(survey: FieldSurvey, view: AlignedSolution) -> Figure:
    """Draw one map of the walk per detector, with the footfalls it accepts in colour."""
    found, stance = survey.coverage, view.align_position(survey.position)
    known = view.truth if isinstance(view.truth, TrajectoryTruth) else None
    lines = [*charts.draw_truth(known), charts.draw_path(view, GRAY, "path", width=0.6)]
    # rows and columns of maps, by the shape of the path
    width, height = np.ptp(view.align_position(survey.solution.position)[:, :2], axis=0)
    columns = min(MAX_MAPS if height > TALL * width else MAPS, len(found))
    rows = -(-len(found) // columns)
    low, high = _MAP_HEIGHTS_IN
    fitting = style.WIDTH_IN / columns * (height + 1e-9) / (width + 1e-9)
    map_in = float(np.clip(fitting, low, high if columns > 1 else 2 * high)) + 0.55
    with style.styled():
        figure = style.new_figure(rows * map_in + 0.75)
        grid = figure.subplots(rows, columns, squeeze=False)
        for axes, one in zip(grid.ravel(), found, strict=False):
            passed, size = survey.verdicts[one.detector].quasi_static, _find_size(len(stance))
            rejected = charts.mark_places(stance[~passed], REJECTED, "disturbed or not judged", size=size)
            accepted = charts.mark_places(stance[passed], ACCEPTED, "quasi-static", size=size + 1.3)
            style.draw_traces(axes, [*lines, rejected, accepted])
            axes.set_aspect("equal", adjustable="datalim")
            axes.margins(0.06)
            for axis in (axes.xaxis, axes.yaxis):
                axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
            axes.set_title(f"{one.detector}:{' ' if columns <= MAPS else chr(10)}{100 * one.share:.0f} %")
        for axes in grid.ravel()[len(found) :]:
            axes.set_visible(False)
        style.draw_traces(
            grid[0, 0], charts.draw_ends(stance), lowest=9
        )  # on the first map only: the labels would hide footfalls
        handles, labels = grid[0, 0].get_legend_handles_labels()
        looks = {"ncols": 4, "title": MAP_TITLE, "title_fontsize": 10.5, "alignment": "left"}
        figure.legend(handles, labels, loc="outside upper left", **looks)
        east, north = ("x", "y") if isinstance(view.truth, FootprintTruth) else ("east", "north")  # unknown azimuth
        figure.supxlabel(f"{east} (m)", fontsize=9.0, color=style.SOFT_INK)
        figure.supylabel(f"{north} (m)", fontsize=9.0, color=style.SOFT_INK)
    return figure


def plot_samples(survey: SampleSurvey) -> Figure:
    """Draw strength, statistic and verdicts over time."""
    limits = [float(end) for end in np.log10(find_log_limits(survey.statistic))]
    statistic = [
        signal(survey.t, survey.statistic, BLUE, "statistic", width=1),
        level(survey.t, 1.0, charts.VERMILION, "threshold: below it the field passes"),
    ]
    strength = signal(survey.t, survey.strength, BLUE, "strength", width=1)
    panels = [
        Panel("strength (uT)", [strength], {"range": find_range(survey.strength, MIN_SPAN_UT)}),
        Panel("statistic / threshold", statistic, {"type": "log", "range": limits}),
        _draw_lanes(survey.t, {SAMPLEWISE: survey}),
    ]
    caption = (
        f"Strength of the field at every sample, its scatter over the {WINDOW_S:g} s before, and the verdicts with the "
        f"share of all samples that pass; longest stretch {survey.longest_s:.0f} s."
    )
    return style.render_matplotlib(charts.stack("field", panels, caption), title="Field at every sample")


def _draw_lanes(t: Floats, verdicts: Mapping[str, OverThreshold]) -> Panel:
    """Draw a lane for each detector's verdicts at the times `t` (F,) s."""
    # half a step before the first to half a step after the last; for each cell the nearest verdict, and its distance
    step = float(np.median(np.diff(t))) if len(t) > 1 else 1.0
    begin, end = float(t[0]) - step / 2, float(t[-1]) + step / 2
    middle = np.linspace(begin, end, CELLS * FINE)
    nearest = np.searchsorted(0.5 * (t[1:] + t[:-1]), middle)
    far = np.abs(middle - t[nearest]) > max(REACH_S, REACH_STEPS * step)
    colours = {"quasi-static": ACCEPTED, "disturbed": REJECTED, "not judged": UNJUDGED}
    lanes: list[Trace] = [
        dots(t[:0], t[:0], color, name, size=9, style={"symbol": "square"}) for name, color in colours.items()
    ]
    for k, one in enumerate(verdicts.values()):
        color = np.where(one.quasi_static[:, None], to_rgb(ACCEPTED), to_rgb(REJECTED))
        color = np.where(one.judged[:, None], color, to_rgb(UNJUDGED))[nearest]
        color[far] = 1.0
        lane = color.reshape(1, CELLS, FINE, 3).mean(axis=2)
        lanes.append({"type": "image", "name": "", "z": lane, "extent": (begin, end, k + 0.42, k - 0.42)})
    words = [f"{name}  {100 * one.quasi_static.mean():.0f} %" for name, one in verdicts.items()]
    axis = {"range": [len(verdicts) - 0.5, -0.5], "tickvals": list(range(len(verdicts))), "ticktext": words}
    return Panel("", lanes, axis, share=_LANE_SHARE * (len(verdicts) + 1))
