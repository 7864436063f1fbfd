"""Charts as data, in the words of plotly's JSON, and the maps of a walk: paths, ellipses, footfalls, truth.

`render_plotly` gives the page its JSON; `fg_nav.report.plots.style.render_matplotlib` draws the same chart as a PNG.
A trace that is `LATER` is hidden on the page until its legend entry is clicked, and is not in a picture; the key
`PICTURE` of a trace, which plotly does not get, decides otherwise. Numbers are rounded to visible digits; non-finite
ones become null, which breaks a line. Colours are legible on white and on dark grey; text and grid are coloured by the
page.

A solution is drawn in the truth's frame where there is a truth, else in its own. Bands and ellipses are the estimator's
own uncertainty, relative to the first footfall and turned with the path. The turn that an alignment removes is removed
from the ellipses too: where the heading at the start is not sure, the whole path may be turned about it. With p the
position relative to the start, J p = (-p_y, p_x, 0) and psi the heading, an error e of such a turn moves pose (p, psi)
by v e, v = (J p, 1), and the rest of its covariance

    Q - s^2 v v^T >= 0    for s^2 <= 1 / (v^T Q^-1 v),

so s^2, the variance of the turn that all footfalls have in common, is the least of these bounds over the footfalls.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.evaluation.comparison import Comparison
from fg_nav.frames import compute_heading
from fg_nav.magnetic.detectors import DISTURBED, QUASI_STATIC
from fg_nav.samples.gaps import find_holes
from fg_nav.solution import Solution, StanceTable
from fg_nav.truth import Fix, FootprintTruth, TrajectoryTruth, Truth
from fg_nav.walk import Options, Outcome, Walk, find_origin

if TYPE_CHECKING:
    from fg_nav.both_feet import FeetResult

Trace: TypeAlias = dict[str, Any]  # One line, band or set of dots.
Digits: TypeAlias = tuple[int | None, int | None]  # Decimals of x and y; None for significant digits.

METERS = 4  # Decimals: tenths of millimetres.
IN_TIME: Digits = (3, None)  # Over time, to milliseconds;
ALONG_PATH: Digits = (METERS, None)  # over the length of the path;
ON_MAP: Digits = (METERS, METERS)  # from above.

BLUE, VERMILION, GREEN, PURPLE, OCHRE, TEAL = "#2a7fc9", "#d9601a", "#12946c", "#b8609c", "#b07d12", "#3a93b0"
CYCLE = (BLUE, VERMILION, GREEN, PURPLE, OCHRE, TEAL)  # Of methods and axes: Okabe and Ito, on white and dark.
GRAY = "#8a9096"  # Of a truth, and of footfalls without a verdict.
MAX_POINTS = 6000  # Of a line: a desk shows some 1200 pixels, and a reader zooms in by a factor of a few.
MAX_DOTS = 3000  # Dots with a label for the pointer: more of them make a page slow.
LATER = "legendonly"  # Visibility of a trace that is drawn on a touch on the legend.
PICTURE = "picture"  # Key of a trace: whether a picture has it, where this is not its visibility on the page.
BAND = 1.96  # Half width of a 95 % band, in standard deviations.
_DIGITS = 6  # Significant digits of what has no number of decimals.

START_M = 0.05  # Sigma of the first footfall, of a stance's length, where it is the origin; by fixes it is larger.
GAUGE_RAD = 0.02  # A heading surer than this at the start was given, or is zero by definition; no compass is as good.
ELLIPSE_RADIUS = float(np.sqrt(-2.0 * np.log(1.0 - 0.95)))  # 95 % ellipse of a 2-D normal distribution, sigmas.
REACH = 0.3  # Largest share of a map's extent that an ellipse adds to it: a huge one would hide the path.
ZOOMS = np.array([1, 2, 5, 10, 20, 50, 100, 200, 500, 1000])  # By which small ellipses are enlarged.
MAX_ELLIPSES = 250
MAX_WITH_ELLIPSES = 2  # Methods whose ellipses lie over one another and are still distinguishable.
MAX_TIES = 60  # Lines on the map from a footfall to the earlier one at its place.
_MIN_POINTS = 4  # Of a stride, for a line drawn by samples; with fewer it is drawn through the footfalls.
_HOW_TO = "Drag to zoom, double-click for all of it; a touch on the legend hides and shows."

_HOVER = (
    "footfall %{customdata[0]}, t %{customdata[1]:.2f} s<br>"
    "{x} %{x:.3r} ± %{customdata[2]:.2r} m<br>{y} %{y:.3r} ± %{customdata[3]:.2r} m<br>"
    "up %{customdata[4]:.2f} ± %{customdata[5]:.2r} m<br>heading %{customdata[6]:.1f} ± %{customdata[7]:.1f}°<br>"
    "field %{customdata[8]}<extra>{name}</extra>"
)


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


def spread_rows(n: int, at_most: int = MAX_POINTS) -> Ints:
    """At most `at_most` of `n` rows, evenly spread, the first and the last among them."""
    rows = np.arange(0, n, max(-(-(n - 1) // max(at_most - 1, 1)), 1))
    return rows if not n or rows[-1] == n - 1 else np.append(rows, n - 1)


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
    return line(*envelope(t, value, MAX_POINTS // 2), color, name, **more)


def dots(x: Floats, y: Floats, color: str, name: str, digits: Digits = IN_TIME, **more: Any) -> Trace:
    """Return dots at x, y (N,)."""
    mark = {"color": color, "size": more.pop("size", 4.5)} | more.pop("style", {})
    points = {"x": to_numbers(x, digits[0]), "y": to_numbers(y, digits[1])}
    return {"type": "scatter", "mode": "markers", **points, "marker": mark, "name": name, **more}


def band(t: Floats, middle: Floats, half: Floats, color: str, name: str) -> Trace:
    """Return the area within `half` (N,) of `middle` (N,), thinned."""
    known = np.flatnonzero(np.isfinite(middle) & np.isfinite(half))
    row = known[spread_rows(len(known), MAX_POINTS // 2)]
    t, low, high = t[row], (middle - half)[row], (middle + half)[row]
    around = np.concatenate([t, t[::-1]]), np.concatenate([low, high[::-1]])
    return line(*around, color, name, width=0, fill="toself", fillcolor=fade(color, 0.2), hoverinfo="skip")


def level(t: Floats, value: float, color: str, name: str) -> Trace:
    """Return a horizontal line over the whole time."""
    return line(t[[0, -1]], np.array([value, value]), color, name, width=1.2, hoverinfo="skip")


def fade(color: str, opacity: float) -> str:
    """Return a colour "#rrggbb" with an opacity."""
    red, green, blue = (int(color[k : k + 2], 16) for k in (1, 3, 5))
    return f"rgba({red}, {green}, {blue}, {opacity:g})"


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


# --- a solution in the frame of its truth -----------------------------------------------------------------------------


@dataclass(frozen=True)
class AlignedSolution:
    """A solution in the frame of the picture; its truth and the comparison that aligns the two: both or neither."""

    solution: Solution
    truth: Truth | None = None
    comparison: Comparison | None = None

    def align_position(self, position: Floats) -> Floats:
        """Positions (N, 3) m in the frame of the picture."""
        return position if self.comparison is None else self.comparison.alignment.apply(position)

    def align_attitude(self, nav_R_body: Floats) -> Floats:
        """Attitudes (N, 3, 3) in the frame of the picture."""
        return nav_R_body if self.comparison is None else self.comparison.alignment.rotate(nav_R_body)

    def stance_position(self) -> Floats:
        """(K, 3) m of the stances."""
        return self.align_position(self.solution.stances.position)

    def position_cov(self) -> Floats:
        """(K, 3, 3) m^2, covariance of the stances' position."""
        cov = self.solution.stances.position_cov
        if self.comparison is None:
            return cov
        turn = self.comparison.alignment.truth_R_nav
        return turn @ cov @ turn.T

    @property
    def is_turned(self) -> bool:
        """Whether the path was turned onto its truth by a fit, so that its heading as a whole is no error."""
        return self.comparison is not None and self.comparison.alignment.mode in ("yaw", "se3")

    @cached_property
    def turn_variance(self) -> float:
        """Variance (rad^2) of the turn that the alignment removes: the most that all covariances allow; 0 for none."""
        table = self.solution.stances
        if not self.is_turned or has_sure_start(table):
            return 0.0
        moved = table.position - table.position[:1]
        v = np.column_stack([-moved[:, 1], moved[:, 0], np.zeros(len(table)), np.ones(len(table))])
        covariance = table.position_yaw_cov
        known = np.isfinite(covariance).all(axis=(1, 2))
        if not known.any():
            return 0.0
        inverse = np.linalg.pinv(covariance[known], hermitian=True)
        bound = 1.0 / np.maximum(np.einsum("ki,kij,kj->k", v[known], inverse, v[known]), 1e-12)
        return float(np.min(bound))

    @property
    def alignment_words(self) -> str:
        """The alignment with the truth, to follow a title; empty without a truth."""
        if self.comparison is None:
            return ""
        how = {"yaw": "aligned by yaw and shift", "se3": "aligned by rotation and shift", "none": "not aligned"}
        return f", {how.get(self.comparison.alignment.mode, 'aligned at the start')}"


def has_sure_start(table: StanceTable) -> bool:
    """Whether the heading at the start counts as sure."""
    return len(table) == 0 or bool(table.heading_sigma[0] < GAUGE_RAD)


def align_solution(walk: Walk | None, outcome: Outcome) -> AlignedSolution:
    """Return the solution with its truth, where the two were compared."""
    truth = None if walk is None or outcome.comparison is None else walk.truth
    return AlignedSolution(outcome.solution, truth, outcome.comparison)


# --- frame and alignment in words ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Frame:
    """Directions of a picture's axes: their names, the letters at the north arrow, and a sentence."""

    x: str
    y: str
    north: str
    words: str


def describe_frame(view: AlignedSolution, outcome: Outcome, options: Options, fixes: Sequence[Fix] = ()) -> Frame:
    """Frame of a drawn solution; two or more `fixes`, or a receiver's, determine north."""
    if isinstance(view.truth, FootprintTruth):
        return Frame("x", "y", "y", "The axes are those of the survey; its azimuth is not known.")
    if view.truth is not None:
        return Frame("east", "north", "N", "North is that of the truth.")
    if len(fixes) != 1 and find_origin(fixes, outcome.solution) is not None:
        return Frame("east", "north", "N", "North is true, by the fixes.")
    if len(fixes) > 1:
        return Frame("east", "north", "N", "North is that of the fixes.")
    if options.heading_deg is not None:
        given = f"North follows from the heading at the start, given as {options.heading_deg:g}°."
        return Frame("east", "north", "N", given)
    if outcome.field_used:
        return Frame("east", "north", "N mag", "North is magnetic, by the compass along the walk.")
    words = "North is not known: the arrow shows where the sensor's x axis pointed at the start."
    return Frame("x", "y", "start", words)


@dataclass(frozen=True)
class Paths:
    """Paths of one picture, by method or by foot; of two feet with that of the person between them."""

    views: Mapping[str, AlignedSolution]
    frame: Frame
    person: AlignedSolution | None = None

    @property
    def first(self) -> AlignedSolution:
        """The path whose ellipses, ends and truth are drawn: of two feet the person's."""
        return next(iter(self.views.values())) if self.person is None else self.person


def align_paths(outcomes: Mapping[str, Outcome], walk: Walk | None) -> Paths:
    """Align each method's path with the truth, if there is one; the frame is that of the first."""
    views = {name: align_solution(walk, outcome) for name, outcome in outcomes.items()}
    (first, *_), (outcome, *_) = views.values(), outcomes.values()
    options, fixes = (Options(), ()) if walk is None else (walk.options, walk.fixes)
    return Paths(views, describe_frame(first, outcome, options, fixes))


def align_feet(result: FeetResult) -> Paths:
    """Align the person; each foot, which stays as it is to the other, moves along. The frame is the left foot's."""
    comparison = result.outcome.comparison
    person = AlignedSolution(result, result.truth, comparison)
    views: dict[str, AlignedSolution] = {
        side: AlignedSolution(foot, None if comparison is None else foot.walk.truth, comparison)
        for side, foot in result.feet.items()
    }
    side, foot = next(iter(result.feet.items()))
    frame = describe_frame(person, foot.outcome, Options(heading_deg=result.pairing.heading_deg))
    words = f"{frame.words} The origin is where the {side} foot first stood."
    return Paths(views, replace(frame, words=words), person)


def describe_ellipses(view: AlignedSolution) -> str:
    """Content of the ellipses, and their reference, in words."""
    own, start = "Ellipses hold 95 % by the method's own covariance", view.solution.stances.position_cov[:1]
    if np.any(start[:, :2, :2] > START_M**2):
        return f"{own}, which includes the uncertainty of the start and of north."
    own += ", relative to the first footfall"
    if view.is_turned:
        return (
            f"{own} and to a path that is turned onto the truth: the uncertainty of north is not in them. Laid on "
            "the truth as a whole, the path may lie closer to it than they are large, and apart from it at the start."
        )
    if has_sure_start(view.solution.stances):
        return f"{own} and to the heading there, which counts as known."
    return f"{own}; the uncertainty of north is in them."


# --- 95 % ellipses from above -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Ellipses:
    """E ellipses on a map."""

    centre: Floats  # (E, 2) m
    semi: Floats  # (E, 2) m, minor and major semi-axes
    angle: Floats  # (E,) rad, of the major axis from east
    zoom: int  # factor that makes the largest visible on a map of the path, 1 where it is anyway

    @classmethod
    def of(cls, centre: Floats, cov: Floats, zoom: int = 1) -> Ellipses:
        """Return the 95 % ellipses of covariances (E, 2, 2) m^2 about centres (E, 2) m."""
        variance, direction = np.linalg.eigh(cov)
        semi = ELLIPSE_RADIUS * np.sqrt(np.maximum(variance, 0.0))
        return cls(centre, semi, np.arctan2(direction[:, 1, 1], direction[:, 0, 1]), zoom)

    def outline(self, points: int, factor: float = 1.0) -> Floats:
        """Closed outlines (E, points, 2) m, counter-clockwise."""
        around = np.linspace(0.0, 2 * np.pi, points) % (2 * np.pi)  # the last is the first
        along, across = np.cos(around) * self.semi[:, 1:], np.sin(around) * self.semi[:, :1]
        cos, sin = np.cos(self.angle)[:, None], np.sin(self.angle)[:, None]
        turned = np.stack([cos * along - sin * across, sin * along + cos * across], axis=-1)
        return self.centre[:, None, :] + factor * turned


def find_extent(points: Floats) -> float:
    """Larger side (m) of the box around points (N, 2 or 3), seen from above."""
    return float(np.max(np.ptp(points[:, :2], axis=0)))


def find_ellipses(view: AlignedSolution) -> Ellipses | None:
    """Ellipses of footfalls evenly spread along the path, fewer where they are huge; None without a covariance."""
    position = view.stance_position()
    # covariance without the turn that an alignment removes
    lever = np.cross([0.0, 0.0, 1.0], position - position[:1])
    remaining = np.asarray(view.position_cov() - view.turn_variance * lever[:, :, None] * lever[:, None, :])
    centre, cov = position[:, :2], remaining[:, :2, :2]
    claimed = np.flatnonzero(np.isfinite(cov).all(axis=(1, 2)))
    if not len(claimed):
        return None
    extent_m = find_extent(centre)
    largest_m = ELLIPSE_RADIUS * float(np.sqrt(np.max(np.linalg.eigvalsh(cov[claimed]))))
    fitting = int(np.clip(4 * extent_m / max(largest_m, 1e-9), 6, MAX_ELLIPSES))
    row = claimed[spread_rows(len(claimed), fitting)]
    # zoom the largest to a fiftieth of the extent at least
    wanted = 0.02 * extent_m / max(largest_m, 1e-9)
    zoom = int(ZOOMS[np.searchsorted(ZOOMS, min(wanted, 1000.0))]) if wanted > 2.0 else 1
    return Ellipses.of(centre[row], cov[row], zoom)


# --- maps ------------------------------------------------------------------------------------------------------------


def draw_course(paths: Paths) -> Chart:
    """Draw the paths of one or more methods, or of both feet and of the person between them."""
    first, alone, person = paths.first, len(paths.views) == 1 and paths.person is None, paths.person
    data = draw_truth(first.truth) + (_mark_returns(first) if alone else [])
    for k, (name, view) in enumerate(paths.views.items()):
        color, solution = CYCLE[k % len(CYCLE)], view.solution
        # path, of a foot below the person's; of an online method also its batch, and what it estimated at the moment
        label, shade, width = (name, color, 1.5) if person is None else (f"{name} foot", fade(color, 0.7), 1)
        data.append(draw_path(view, shade, label, width=width, legendgroup=label))
        if solution.polished is not None:
            batch = AlignedSolution(solution.polished, view.truth, view.comparison)
            data.append(draw_path(batch, GREEN, f"{name}, batch afterwards", width=1.2))
        if solution.moment is not None:
            at_moment = view.align_position(solution.moment.position)[spread_rows(len(solution.moment))]
            more: dict[str, Any] = {"style": {"dash": "dot"}, "hoverinfo": "skip", "visible": LATER}
            data.append(_path(at_moment, color, f"{name}, as known at the moment", **more))
        data += _draw_footfalls(view, label, color, paths.frame, alone)
        if person is None:
            data += _draw_ellipses(find_ellipses(view), color, k, len(paths.views))
    if person is not None:
        data.append(draw_path(person, GREEN, "person", width=1.4))
        data += _draw_ellipses(find_ellipses(person), GREEN, 0, 1)
    data += draw_ends(first.stance_position())
    return compose_map(data, [first, *paths.views.values()], paths.frame)


def compose_map(
    data: list[Trace], views: Sequence[AlignedSolution], frame: Frame, name: str = "path", caption: str = _HOW_TO
) -> Chart:
    """Put traces onto axes that show all of these paths."""
    points = [_choose_path(view) for view in views]
    if (truth := views[0].truth) is not None:
        points.append(truth.position[:, :2] if isinstance(truth, TrajectoryTruth) else truth.xy)
    if (found := find_ellipses(views[0])) is not None:
        reach = np.minimum(found.semi[:, 1:], REACH * find_extent(views[0].stance_position()))
        points += [found.centre - reach, found.centre + reach]
    every = np.vstack(points)
    low, high = np.nanmin(every, axis=0), np.nanmax(every, axis=0)
    margin = 0.06 * float(max(np.max(high - low), 0.5))
    low, high = low - margin, high + margin
    ranges = [[round(float(low[k]), 2), round(float(high[k]), 2)] for k in (0, 1)]
    shape = float((high[1] - low[1]) / (high[0] - low[0]))
    layout: dict[str, Any] = {
        "xaxis": axis(f"{frame.x} (m)", range=ranges[0], constrain="range"),
        "yaxis": axis(f"{frame.y} (m)", range=ranges[1], scaleanchor="x", scaleratio=1),
        "hovermode": "closest",
    }
    height = f"clamp(22rem, calc({shape:.3f} * min(100vw, 73rem) + 5rem), 44rem)"
    return Chart(name, data, layout, caption, height, scaled=True, north=frame.north)


def draw_path(view: AlignedSolution, color: str, name: str, **more: Any) -> Trace:
    """Draw the path of a solution."""
    return _path(_choose_path(view), color, name, hoverinfo="skip", **more)


def _path(xy: Floats, color: str, name: str, **more: Any) -> Trace:
    return line(xy[:, 0], xy[:, 1], color, name, ON_MAP, **more)


def mark_places(xy: Floats, color: str, name: str, **more: Any) -> Trace:
    """Return dots at places (N, 2 or 3) m."""
    return dots(xy[:, 0], xy[:, 1], color, name, ON_MAP, **more)


def _choose_path(view: AlignedSolution) -> Floats:
    """Points (M, 2) m: samples evenly spread, or the footfalls where there are too many of them; NaN in a hole."""
    solution, stances = view.solution, view.solution.stances
    t, dense = solution.t, solution.position
    if len(stances) * _MIN_POINTS > MAX_POINTS:
        t, dense = stances.t, stances.position
    row = spread_rows(len(dense))
    behind = np.searchsorted(t[row], solution.t[find_holes(solution.t) + 1])
    return np.insert(view.align_position(dense[row])[:, :2], behind, np.nan, axis=0)


def draw_truth(truth: Truth | None) -> list[Trace]:
    """Draw the true path or the surveyed footprints, if there are any."""
    if isinstance(truth, TrajectoryTruth):
        path = truth.position[spread_rows(len(truth.position))]
        return [_path(path, GRAY, "truth", width=5, opacity=0.6, hoverinfo="skip")]
    if truth is None:
        return []
    kind: dict[str, Any] = {
        "style": {"symbol": "square-open", "line": {"width": 2}},
        "size": 9,
        "hovertemplate": "surveyed footprint of stride %{customdata}<extra></extra>",
    }
    return [mark_places(truth.xy, GRAY, "surveyed footprints", customdata=truth.stride.tolist(), **kind)]


def _draw_ellipses(found: Ellipses | None, color: str, k: int, n_methods: int) -> list[Trace]:
    """The ellipses of method `k` to scale; of a single method, where they are small, also enlarged on demand.

    One entry of the legend is for the ellipses of all methods; of many methods they are drawn on demand.
    """
    if found is None:
        return []
    shown: dict[str, Any] = {} if n_methods <= MAX_WITH_ELLIPSES else {"visible": LATER}
    drawn = [(1, "95 % ellipses", {"showlegend": k == 0} | shown)]
    if found.zoom > 1 and n_methods == 1:
        drawn[0][2][PICTURE] = False
        drawn.append((found.zoom, f"ellipses {found.zoom} times as large", {"visible": LATER, PICTURE: True}))
    traces = []
    for factor, words, more in drawn:
        outline = found.outline(25, factor)
        broken = np.concatenate([outline, np.full((len(outline), 1, 2), np.nan)], axis=1).reshape(-1, 2)
        fill = {"fill": "toself", "fillcolor": fade(color, 0.18), "hoverinfo": "skip"}
        traces.append(_path(broken, color, words, width=0.6, legendgroup=words, **fill, **more))
    return traces


def group_by_verdict(words: np.ndarray[tuple[int], np.dtype[np.object_]]) -> list[tuple[Bools, str, str]]:
    """Group footfalls (F,) by the verdict on their field: which, with colour and word."""
    clear, disturbed = words == QUASI_STATIC, words == DISTURBED
    rest = ~clear & ~disturbed
    return [(clear, GREEN, "undisturbed"), (disturbed, VERMILION, "disturbed"), (rest, GRAY, "not judged")]


def _draw_footfalls(view: AlignedSolution, name: str, color: str, frame: Frame, alone: bool) -> list[Trace]:
    """Footfalls with labels for the pointer; of a single method coloured by the verdict on the field."""
    table = view.solution.stances
    row = spread_rows(len(table), MAX_DOTS)
    # labels, in the order of `_HOVER`
    sigma = np.sqrt(np.diagonal(view.position_cov(), axis1=1, axis2=2))
    heading_deg = np.rad2deg(compute_heading(view.align_attitude(table.nav_R_body))) % 360.0
    columns = [
        table.t, sigma[:, 0], sigma[:, 1], view.stance_position()[:, 2], sigma[:, 2], heading_deg,
        np.rad2deg(table.heading_sigma),
    ]  # fmt: skip
    figures = [to_numbers(column, METERS) for column in columns]
    verdicts = zip(table.field, table.field_reason, strict=True)
    field = [f"{word}: {reason}" if reason else word for word, reason in verdicts]
    labels = [[k, *values] for k, values in enumerate(zip(*figures, field, strict=True))]
    hover = _HOVER.replace("{x}", frame.x).replace("{y}", frame.y).replace("{name}", "" if alone else name)
    # groups
    groups: list[tuple[Bools, str, str]] = [(np.ones(len(row), dtype=bool), color, name)]
    entry: dict[str, Any] = {} if alone else {"legendgroup": name, "showlegend": False}
    if alone:
        *judged, (rest, _, _) = group_by_verdict(np.array(table.field, dtype=object)[row])
        what = "strides" if name == "pocket" else "footfalls"
        groups = [(rest, BLUE, what), *((use, shade, f"{what}, field {word}") for use, shade, word in judged)]
    position, size = view.stance_position()[row], 5 if len(row) < 500 else 4
    traces = []
    for use, mark, label in groups:
        if use.any():
            more: dict[str, Any] = {"hovertemplate": hover, "customdata": [labels[k] for k in row[use]], **entry}
            traces.append(mark_places(position[use], mark, label, size=size, **more))
    return traces


def draw_ends(stance: Floats) -> list[Trace]:
    """Mark the begin and the end of the walk."""
    apart = bool(np.linalg.norm(stance[-1, :2] - stance[0, :2]) > 0.05 * find_extent(stance))
    ends = stance[[0, -1], :2] if apart else stance[:1, :2]
    mark = {"symbol": ["circle-open", "square-open"][: len(ends)], "line": {"width": 2}}
    words = ["start", "end"] if apart else ["start, end"]
    places = ["top right", "bottom right"][: len(ends)]  # two close to one another are legible
    more: dict[str, Any] = {"mode": "markers+text", "text": words, "textposition": places, "hoverinfo": "skip"}
    return [mark_places(ends, GRAY, "start and end", size=10, style=mark, showlegend=False, **more)]


def _mark_returns(view: AlignedSolution) -> list[Trace]:
    """Draw on the map the footfalls at an earlier place of the walk, and lines to the earlier ones."""
    table = view.solution.stances
    if table.same_place is None:
        return []
    later = np.flatnonzero(table.same_place >= 0)
    if not len(later):
        return []
    position = view.stance_position()[:, :2]
    # stretches, with NaN between them
    breaks = np.flatnonzero(np.diff(later) > 1) + 1
    path = np.vstack([np.vstack([position[run], [[np.nan, np.nan]]]) for run in np.split(later, breaks)])
    # lines to the earlier footfalls
    chosen = later[spread_rows(len(later), MAX_TIES)]
    pairs = np.stack([position[chosen], position[table.same_place[chosen]], np.full((len(chosen), 2), np.nan)], axis=1)
    words = "recognized as walked before"
    wide = {"width": 9, "hoverinfo": "skip", "legendgroup": words}
    thin = {"width": 1.2, "showlegend": False, "hoverinfo": "skip", "legendgroup": words}
    return [_path(path, fade(PURPLE, 0.3), words, **wide), _path(pairs.reshape(-1, 2), TEAL, words, **thin)]
