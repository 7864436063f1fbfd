"""Methods next to each other on one walk: their paths, what they made of the field, and their errors along the path.

Everything is at the footfalls, from above, in the truth's frame.

The picture of the README: a real walk over surveyed footprints, and half an hour in a simulated mall.

    python scripts/method_plots.py --figure docs/demo.png [--data DIR]

Left walk 33 of gdin, a LORD GX5 on the instep, with its magnetometer as recorded. Right the scenario `mall`, seed 101,
with a calibrated magnetometer on the floor of a building (field `indoor`). Both paths are aligned with the truth by yaw
and shift.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import harness
import numpy as np
import walks
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fg_nav.arrays import Bools, Floats
from fg_nav.io import read
from fg_nav.lab import palette
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.pipeline import prepare_walk, run_method
from fg_nav.recording import Recording
from fg_nav.report.plots import style
from fg_nav.truth import FootprintTruth, TrajectoryTruth
from fg_nav.walk import Walk

PANEL_IN = 3.2  # Width of a panel.
GRID_POINTS = 400  # Of a curve over the distance.
LOW, HIGH = 5.0, 95.0  # Percentiles of a band over walks.

_LEGEND_COLUMNS = 8

_NOWHERE = np.zeros((0, 2))


@dataclass(frozen=True)
class Track:
    """One walk as one method has it.

    Attributes
    ----------
    method : its name.
    estimate : (K, 2) m east and north, laid on the truth.
    truth : (K, 2) m at the same footfalls; (M, 2) surveyed footprints; or none.
    used : (K,) True where the method used the field.
    every : whether the truth is that of every footfall.
    """

    method: str
    estimate: Floats
    used: Bools
    truth: Floats = field(default_factory=lambda: _NOWHERE)
    every: bool = True

    @property
    def distance_m(self) -> Floats:
        """(K,) truly walked up to each footfall, over the ground."""
        steps = np.linalg.norm(np.diff(self.truth, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    @property
    def error_m(self) -> Floats:
        """(K,) over the ground."""
        return np.asarray(np.linalg.norm(self.estimate - self.truth, axis=1))


def plot_paths(tracks: Sequence[Track], title: str) -> Figure:
    """Draw one panel a method, each over the truth, on common axes."""
    with style.styled():
        figure, panels = _panels(tracks, title)
        for axes, track, colour in zip(panels, tracks, palette.colours(len(tracks)), strict=True):
            _draw_truth(axes, track)
            axes.plot(*track.estimate.T, color=colour, linewidth=0.8, zorder=3)
            axes.plot(*track.estimate[-1], "s", color=style.INK, markersize=4.5, markerfacecolor="white", zorder=5)
            axes.set_title(track.method)
    return figure


def plot_detection_maps(tracks: Sequence[Track], title: str) -> Figure:
    """Draw where each method used the field: on the true path, or where there is none, on its own."""
    with style.styled():
        figure, panels = _panels([_on_the_way(track) for track in tracks], title)
        for axes, track in zip(panels, tracks, strict=True):
            place, used = _on_the_way(track).estimate, track.used
            axes.plot(*place[~used].T, ".", color=palette.TRUTH, markersize=2.0, label="not used")
            axes.plot(*place[used].T, ".", color=palette.VERMILION, markersize=3.0, label="used")
            axes.set_title(f"{track.method}: {100 * used.mean():.0f} % used")
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=2, markerscale=3.0)
    return figure


def plot_error_over_distance(walks: Mapping[str, Sequence[Track]], title: str) -> Figure:
    """Draw the error over the distance truly walked: the median over walks of each method, and its 5 to 95 % band."""
    with style.styled():
        figure = style.new_figure(3.8)
        axes = figure.subplots()
        for (method, tracks), colour, dash in zip(walks.items(), palette.colours(len(walks)), _dashes(), strict=False):
            distance, error = _on_one_grid(tracks)
            low, middle, high = np.percentile(error, [LOW, 50.0, HIGH], axis=0)
            axes.plot(distance, middle, dash, color=colour, label=method)
            if len(tracks) > 1:
                axes.fill_between(distance, low, high, color=colour, alpha=_band_alpha(len(walks)), linewidth=0)
        axes.set_ylim(bottom=0.0)
        axes.margins(x=0.01)
        of_many = f", median and {LOW:.0f} to {HIGH:.0f} %" if max(map(len, walks.values())) > 1 else ""
        axes.set(xlabel="distance walked (m)", ylabel=f"error over the ground (m){of_many}")
        style.head(axes, title, columns=_legend_columns(len(walks)))
    return figure


def _band_alpha(methods: int) -> float:
    """Paler where many bands lie over each other."""
    return 0.15 if methods <= 3 else 0.06


def _legend_columns(methods: int) -> int:
    """As many as make rows of the same length."""
    rows = -(-methods // _LEGEND_COLUMNS)
    return -(-methods // rows)


def _dashes() -> Iterator[str]:
    """Tell methods apart whose colours are the same: solid as long as colours last, then broken."""
    for dash in ("-", "--", ":"):
        yield from (dash for _ in palette.CYCLE)


def _panels(tracks: Sequence[Track], title: str) -> tuple[Figure, list[Axes]]:
    """One panel a track, at most three in a row, with equal scales."""
    columns = min(len(tracks), 3)
    rows = -(-len(tracks) // columns)
    width, height = np.ptp(np.vstack([np.vstack([t.estimate, t.truth]) for t in tracks]), axis=0) + 1e-9
    panel_in = float(np.clip(PANEL_IN * height / width, 0.8, 5.0)) + 0.45
    figure = style.new_figure(rows * panel_in + 0.7, width_in=max(PANEL_IN * columns, 4.5))
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    figure.suptitle(title, x=0.01, ha="left", fontsize=10.5, color=style.INK)
    for axes in grid.flat[len(tracks) :]:
        axes.set_axis_off()
    for axes in grid.flat[: len(tracks)]:
        axes.set_aspect("equal", adjustable="box")
    for axes in grid.flat[max(len(tracks) - columns, 0) : len(tracks)]:  # the lowest of each column
        axes.set_xlabel("east (m)")
        axes.tick_params(labelbottom=True)
    for axes in grid[:, 0]:
        axes.set_ylabel("north (m)")
    return figure, list(grid.flat[: len(tracks)])


def _draw_truth(axes: Axes, track: Track) -> None:
    if track.every:
        axes.plot(*track.truth.T, **palette.TRUTH_LINE, zorder=1)
    else:
        axes.plot(*track.truth.T, "s", color=palette.TRUTH, markersize=5, markerfacecolor="none", zorder=1)


def _on_the_way(track: Track) -> Track:
    """Put a track where it truly was, if that is known."""
    known = track.every and len(track.truth) == len(track.estimate)
    return Track(track.method, track.truth if known else track.estimate, track.used)


def _on_one_grid(tracks: Sequence[Track]) -> tuple[Floats, Floats]:
    """Distances (G,) m up to the shortest walk, and the error (W, G) m of each walk there."""
    distance: Floats = np.linspace(0.0, min(track.distance_m[-1] for track in tracks), GRID_POINTS)
    return distance, np.array([np.interp(distance, track.distance_m, track.error_m) for track in tracks])


WALK = 33
DRAWN = {"smoother": "fg-nav", "iez": "zero-velocity filter (IEZ)"}
COLORS = {"smoother": palette.BLUE, "iez": palette.VERMILION}
MAX_POINTS = 4000


def main(arguments: Sequence[str] | None = None) -> None:
    """Solve both walks and draw them."""
    chosen = harness.parse_arguments(__doc__, arguments, figure=None, data=None)
    real = read(walks.gdin_path(walks.data_folder(chosen.data), WALK))
    mall = simulate("mall", 101, Choices(calibrated=True)).recording
    with style.styled():
        picture = style.new_figure(4.2, width_in=10.5)
        left, right = picture.subplots(1, 2, width_ratios=(1.55, 1.0))
        errors = draw_walk(left, real, ("iez", "smoother"))
        words = f"{errors['smoother']:.2f} m rms, filter {errors['iez']:.2f}"
        left.set_title(f"A real walk of 64 m, with its magnetometer: {words}")
        errors = draw_walk(right, mall, ("iez", "smoother"))
        words = f"{errors['smoother']:.1f} m rms, filter {errors['iez']:.1f}"
        right.set_title(f"Simulated, 2.5 km: {words}")
        right.set_ylabel("")
    harness.save_picture(picture, chosen.figure)


def draw_walk(axes: Axes, recording: Recording, methods: Sequence[str]) -> Mapping[str, float]:
    """Draw the paths of the methods over the truth; returns the rmse of each, m."""
    walk, errors = prepare_walk(Walk.of(recording)), {}
    truth = walk.truth
    if isinstance(truth, TrajectoryTruth):
        path = truth.position[:: len(truth.position) // MAX_POINTS + 1]
        axes.plot(*path[:, :2].T, **palette.TRUTH_LINE, label="truth")
    elif isinstance(truth, FootprintTruth):
        axes.plot(*truth.xy.T, "s", color=palette.TRUTH, markersize=4.5, label="surveyed footprints")
    for method in methods:
        outcome = run_method(walk, method)
        assert outcome.comparison is not None
        position = outcome.comparison.alignment.apply(outcome.solution.position)
        path = position[:: len(position) // MAX_POINTS + 1]
        thin = 0.8 if method == "iez" else 1.2
        axes.plot(*path[:, :2].T, color=COLORS[method], linewidth=thin, label=DRAWN[method])
        errors[method] = float(np.asarray(outcome.metrics.rmse_2d_m))
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="m", ylabel="m")
    axes.legend(loc="best", frameon=False)
    return errors


if __name__ == "__main__":
    harness.run(main)
