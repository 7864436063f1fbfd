"""Pictures show what they should; that they are pleasant to look at was judged by eye."""

import subprocess
import sys
import time
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.image import imread

from fg_nav.detection.stance import Stances
from fg_nav.evaluation import evaluate
from fg_nav.recording import Recording
from fg_nav.report.charts import (
    AlignedSolution,
    Chart,
    Paths,
    Trace,
    describe_frame,
    draw_course,
    envelope,
    find_ellipses,
    spread_rows,
)
from fg_nav.report.plots import style
from fg_nav.report.plots.style import draw_walk
from fg_nav.report.series import draw_headings
from fg_nav.solution import Solution, StanceTable
from fg_nav.truth import TrajectoryTruth
from fg_nav.walk import Options, Outcome, Walk
from tests.report import walks


def view(walk: Walk, drift_deg: float = 2.0) -> AlignedSolution:
    outcome = walks.outcome(walk, drift_deg=drift_deg)
    return AlignedSolution(outcome.solution, walk.truth, outcome.comparison)


def course(view: AlignedSolution) -> Chart:
    """Chart of a path from above."""
    outcome = Outcome(view.solution, evaluate(view.solution), view.comparison)
    return draw_course(Paths({"smoother": view}, describe_frame(view, outcome, Options())))


def trace(chart: Chart, name: str) -> Trace:
    return next(trace for trace in chart.data if trace["name"] == name)


def is_a_picture(path: Path) -> bool:
    pixels = imread(path)
    inked = float(np.mean(pixels[..., :3].min(axis=2) < 0.9))
    return pixels.shape[0] > 400 and pixels.shape[1] > 1000 and inked > 0.005


def test_run_and_comparison_draw_their_pictures(tmp_path: Path, walk: Walk) -> None:
    outcomes = {name: walks.outcome(walk, name, drift) for name, drift in (("a", 1.0), ("b", 4.0))}
    for name in outcomes:
        (tmp_path / name).mkdir()
    draw_walk(tmp_path, walk, outcomes)
    drawn = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*.png")}
    per_method = {f"{m}/{p}.png" for m in "ab" for p in ("trajectory", "heading", "gyro_bias")}
    assert drawn == per_method | {"trajectories.png", "errors.png", "stance_statistic.png"}
    assert all(is_a_picture(tmp_path / name) for name in drawn)


@pytest.mark.parametrize("change", [walks.without_truth, walks.with_footprints], ids=lambda f: f.__name__)
def test_walks_with_less_truth_are_drawn_too(tmp_path: Path, walk: Walk, change: object) -> None:
    changed = change(walk)  # type: ignore[operator]
    draw_walk(tmp_path, changed, {"smoother": walks.outcome(changed)})
    assert all(is_a_picture(path) for path in tmp_path.glob("*.png"))


def test_stances_without_statistic_are_not_drawn(tmp_path: Path, walk: Walk) -> None:
    silent = replace(walk, stances=replace(walk.stances, statistic=None))
    draw_walk(tmp_path, silent, {"smoother": walks.outcome(walk)})
    assert {path.name for path in tmp_path.iterdir()} == {"trajectory.png", "heading.png", "gyro_bias.png"}


def test_path_is_drawn_where_the_truth_is(walk: Walk) -> None:
    axes = style.render_matplotlib(course(view(walk, drift_deg=0.0)), title="").axes[0]
    lines = {line.get_label(): line.get_xydata() for line in axes.lines}
    np.testing.assert_allclose(lines["smoother"], lines["truth"], atol=1e-4)
    assert axes.get_aspect() == 1.0


def test_ellipses_hold_95_percent_and_turn_with_the_path(walk: Walk) -> None:
    solution = walks.outcome(walk).solution
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert isinstance(walk.truth, TrajectoryTruth)
    truth = replace(walk.truth, position=walk.truth.position @ turn.T, nav_R_body=None)
    straight = find_ellipses(AlignedSolution(solution))
    turned = find_ellipses(view(replace(walk, truth=truth), drift_deg=0.0))
    assert straight is not None
    assert turned is not None
    np.testing.assert_allclose((np.rad2deg(turned.angle - straight.angle) + 90) % 180, 0.0, atol=1e-6)
    covariance = solution.stances.position_cov[-1, :2, :2]
    samples = np.random.default_rng(0).multivariate_normal(np.zeros(2), covariance, 100_000)
    short, long = straight.semi[-1]
    a = straight.angle[-1]
    along, across = samples @ [np.cos(a), np.sin(a)], samples @ [-np.sin(a), np.cos(a)]
    assert np.mean((along / long) ** 2 + (across / short) ** 2 < 1) == pytest.approx(0.95, abs=0.003)
    outline = straight.outline(400)[-1] - straight.centre[-1]
    np.testing.assert_allclose(np.ptp(np.linalg.norm(outline, axis=1)), long - short, rtol=1e-3)


def test_walk_of_one_stance_without_claims_is_drawn(tmp_path: Path, walk: Walk) -> None:
    statistic = walk.stances.statistic
    one = Stances(np.array([0]), np.array([500]), np.array([0]), len(walk.recording), statistic=statistic)
    alone = replace(walks.without_truth(walk), stances=one)
    solution = walks.drifting(alone.recording, one)
    solution = replace(solution, stances=replace(solution.stances, position_cov=np.full((1, 3, 3), np.nan)))
    draw_walk(tmp_path, alone, {"smoother": Outcome(solution, evaluate(solution), None)})
    assert all(is_a_picture(path) for path in tmp_path.glob("*.png"))


def test_small_ellipses_are_enlarged_and_say_so(walk: Walk) -> None:
    outcome = walks.outcome(walk)
    stances = replace(outcome.solution.stances, position_cov=outcome.solution.stances.position_cov * 1e-4)
    chart = course(AlignedSolution(replace(outcome.solution, stances=stances)))
    labels = style.render_matplotlib(chart, title="").axes[0].get_legend_handles_labels()[1]
    assert any("times as large" in str(label) for label in labels)
    assert "95 % ellipses" not in labels


def test_heading_error_is_counted_from_the_start(walk: Walk) -> None:
    drawn = view(walk, drift_deg=3.0)
    error = trace(draw_headings({"smoother": drawn}), "error")["y"]
    t = drawn.solution.stances.t
    assert error[0] == pytest.approx(0.0, abs=1e-9)
    expected_deg = -3.0 * (t[-1] - t[0]) / drawn.solution.t[-1]  # counter-clockwise drift, clockwise heading
    assert error[-1] == pytest.approx(expected_deg, abs=1e-3)


def test_the_heading_error_of_a_compass_is_counted_as_it_stands(walk: Walk) -> None:
    drawn = view(walk, drift_deg=3.0)
    stances = replace(drawn.solution.stances, heading_sigma=np.full(len(drawn.solution.stances), 0.2))
    unsure = replace(drawn, solution=replace(drawn.solution, stances=stances))
    given, found = (np.array(trace(draw_headings({"smoother": one}), "error")["y"]) for one in (drawn, unsure))
    np.testing.assert_allclose(found - found[0], given, atol=2e-3)
    assert abs(found[0]) > 0.2  # aligned as a whole, the walk begins with an error


@pytest.mark.parametrize(("letters", "columns"), [(5, 5), (20, 4), (30, 3), (60, 1)])
def test_a_legend_keeps_within_the_picture(letters: int, columns: int) -> None:
    axes = style.new_figure(3.0).subplots()
    for number in range(5):
        axes.plot([0, 1], [0, number], label=f"{number}" * letters)
    style.head(axes, "title")
    legend = axes.get_legend()
    assert legend is not None
    assert legend._ncols == columns


def test_two_hours_are_drawn_quickly(tmp_path: Path, walk: Walk) -> None:
    long, outcome = lengthened(walk, 115)
    assert len(outcome.solution.t) > 1_400_000
    start = time.process_time()
    draw_walk(tmp_path, long, {"smoother": outcome})
    assert time.process_time() - start < 12
    assert all(is_a_picture(path) for path in tmp_path.glob("*.png"))
    assert len(list(tmp_path.glob("*.png"))) == 4


def lengthened(walk: Walk, times: int) -> tuple[Walk, Outcome]:
    """Return the closed walk, walked again and again."""
    short, found = walks.outcome(walk).solution, walk.stances
    n = len(short.t)
    t = np.arange(times * n) * walk.recording.period_s
    lap = n * np.repeat(np.arange(times), len(found))
    told = (f.name for f in fields(StanceTable) if getattr(short.stances, f.name) is not None)
    table = {name: tiled(getattr(short.stances, name), times) for name in told}
    table["sample"] = table["sample"] + lap
    table["t"] = t[table["sample"]]
    path = {name: tiled(getattr(short, name), times) for name in ("position", "velocity", "nav_R_body")}
    long = Solution("smoother", t=t, **path, stances=StanceTable(**table), runtime_s=1.0)
    start, stop, statistic = (tiled(rows, times) for rows in (found.start, found.stop, found.statistic))
    footfall = np.arange(times * len(found))
    stances = Stances(start + lap, stop + lap, footfall, len(t), "TRUE SPEED", walks.STILL_M_S, statistic)
    recording = Recording(t, np.zeros((len(t), 3)), np.zeros((len(t), 3)))
    return Walk(recording, stances, None, Options()), Outcome(long, evaluate(long), None)


def tiled(rows: Any, times: int) -> Any:
    return rows * times if isinstance(rows, tuple) else np.tile(rows, (times, *[1] * (rows.ndim - 1)))


def test_envelope_keeps_every_extreme() -> None:
    t = np.arange(100_000) / 200
    value = np.zeros(len(t))
    value[[4_321, 77_777]] = [9.0, -5.0]
    value[50_000:50_500] = np.nan
    short_t, short = envelope(t, value, bins=500)
    assert len(short) == 1000
    assert (np.nanmax(short), np.nanmin(short)) == (9.0, -5.0)
    assert short_t[np.nanargmax(short)] == pytest.approx(t[4_321], abs=1.0)
    assert np.all(np.diff(short_t) >= 0)
    same_t, same = envelope(t[:100], value[:100])
    np.testing.assert_array_equal(same, value[:100])
    np.testing.assert_array_equal(same_t, t[:100])


@pytest.mark.parametrize(("n", "at_most"), [(1, 5), (5, 5), (6, 5), (62, 60), (1000, 7), (3, 1)])
def test_spread_rows_reach_both_ends_evenly(n: int, at_most: int) -> None:
    rows = spread_rows(n, at_most)
    assert (rows[0], rows[-1]) == (0, n - 1)
    assert len(rows) <= max(at_most, 2)
    assert len(set(np.diff(rows)[:-1])) <= 1


def test_style_leaves_matplotlib_as_it_was() -> None:
    before = dict(mpl.rcParams)
    with style.styled():
        assert mpl.rcParams["axes.spines.top"] is False
    assert dict(mpl.rcParams) == before


def test_neither_library_nor_command_line_import_matplotlib() -> None:
    modules = "fg_nav.cli, fg_nav.io, fg_nav.evaluation, fg_nav.report.files"
    code = f"import sys, {modules}; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
