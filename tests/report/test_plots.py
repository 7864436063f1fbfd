"""Pictures show what they should; that they are pleasant to look at was judged by eye."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from fg_nav.evaluation import evaluate
from fg_nav.report.charts import (
    AlignedSolution,
    Chart,
    Paths,
    align_paths,
    describe_frame,
    draw_course,
    envelope,
    spread_rows,
)
from fg_nav.report.charts import find_ellipses as find
from fg_nav.report.plots import style
from fg_nav.report.plots.style import draw_walk
from fg_nav.report.series import draw_headings, find_range
from fg_nav.truth import TrajectoryTruth
from fg_nav.walk import Options, Outcome, Walk
from tests.pictures import sketch_pictures
from tests.report import walks


def view(walk: Walk, drift_deg: float = 2.0) -> AlignedSolution:
    outcome = walks.outcome(walk, drift_deg=drift_deg)
    return AlignedSolution(outcome.solution, walk.truth, outcome.comparison)


def course(view: AlignedSolution) -> Chart:
    """Chart of a path from above."""
    outcome = Outcome(view.solution, evaluate(view.solution), view.comparison)
    return draw_course(Paths({"smoother": view}, describe_frame(view, outcome, Options())))


def test_run_and_comparison_draw_their_pictures_with_any_truth(
    tmp_path: Path, walk: Walk, monkeypatch: pytest.MonkeyPatch
) -> None:
    outcomes = {name: walks.outcome(walk, name, drift) for name, drift in (("a", 1.0), ("b", 4.0))}
    surveyed, bare = walks.with_footprints(walk), walks.without_truth(walk)
    for name in outcomes:
        (tmp_path / name).mkdir()
    with monkeypatch.context() as patch:
        sketch_pictures(patch)
        draw_walk(tmp_path, walk, outcomes)
        drawn = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*.png")}
        for one in (surveyed, bare):
            draw_walk(tmp_path, one, {"smoother": walks.outcome(one)})
    per_method = {f"{m}/{p}.png" for m in "ab" for p in ("trajectory", "heading", "gyro_bias")}
    assert drawn == per_method | {"trajectories.png", "errors.png", "stance_statistic.png"}
    style.draw_paths(tmp_path / "whole.png", align_paths({"smoother": walks.outcome(walk)}, walk))
    for path in tmp_path.rglob("*.png"):
        pixels = imread(path)
        assert np.mean(pixels[..., :3].min(axis=2) < 0.9) > 0.005, path.name  # is inked
    assert imread(tmp_path / "whole.png").shape > (400, 1000)


def test_path_is_drawn_where_the_truth_is_and_ticks_are_round(walk: Walk) -> None:
    axes = style.render_matplotlib(course(view(walk, drift_deg=0.0)), title="").axes[0]
    lines = {line.get_label(): line.get_xydata() for line in axes.lines}
    np.testing.assert_allclose(lines["smoother"], lines["truth"], atol=1e-4)
    assert axes.get_aspect() == 1.0
    for extent_m in (1.0, 30.0, 70.0, 300.0):
        axes = style.new_figure(3.0).subplots()
        style.shape_map(axes, [0.0, extent_m], [0.0, 0.3 * extent_m])
        (x, *_), (y, *_) = (np.diff(ticks) for ticks in (axes.get_xticks(), axes.get_yticks()))
        assert x == pytest.approx(y)
        assert 3.0 < extent_m / x <= 8.001


def test_ellipses_hold_95_percent_and_turn_with_the_path(walk: Walk) -> None:
    solution = walks.outcome(walk).solution
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert isinstance(walk.truth, TrajectoryTruth)
    truth = replace(walk.truth, position=walk.truth.position @ turn.T, nav_R_body=None)
    straight = find(AlignedSolution(solution))
    turned = find(view(replace(walk, truth=truth), drift_deg=0.0))
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


def test_small_ellipses_are_enlarged_and_say_so(walk: Walk) -> None:
    outcome = walks.outcome(walk)
    stances = replace(outcome.solution.stances, position_cov=outcome.solution.stances.position_cov * 1e-4)
    chart = course(AlignedSolution(replace(outcome.solution, stances=stances)))
    labels = style.render_matplotlib(chart, title="").axes[0].get_legend_handles_labels()[1]
    assert any("times as large" in str(label) for label in labels)
    assert "95 % ellipses" not in labels


def test_heading_error_is_counted_from_the_start(walk: Walk) -> None:
    drawn = view(walk, drift_deg=3.0)
    (error,) = (trace["y"] for trace in draw_headings({"smoother": drawn}).data if trace["name"] == "error")
    t = drawn.solution.stances.t
    assert error[0] == pytest.approx(0.0, abs=1e-9)
    expected_deg = -3.0 * (t[-1] - t[0]) / drawn.solution.t[-1]  # counter-clockwise drift, clockwise heading
    assert error[-1] == pytest.approx(expected_deg, abs=1e-3)
    # with a compass it is counted as it stands: aligned as a whole, the walk begins with an error
    stances = replace(drawn.solution.stances, heading_sigma=np.full(len(t), 0.2))
    unsure = replace(drawn, solution=replace(drawn.solution, stances=stances))
    found = next(np.array(one["y"]) for one in draw_headings({"smoother": unsure}).data if one["name"] == "error")
    np.testing.assert_allclose(found - found[0], error, atol=2e-3)
    assert abs(found[0]) > 0.2


def test_the_range_of_an_axis_holds_all_values_in_its_middle() -> None:
    for value, middle in (([3.0, 9.0, np.nan], 6.0), ([-4.0, -4.1], -4.05), ([5.0], 5.0), ([np.nan], 0.0)):
        low, high = find_range(np.array(value), 2.0)
        assert high - low >= max(2.0, np.ptp(value) if len(value) == 2 else 0.0) - 1e-12
        assert not np.isfinite(value[0]) or low + high == pytest.approx(2.0 * middle)
        assert not np.isfinite(value[0]) or low <= np.nanmin(value) <= np.nanmax(value) <= high


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


def test_spread_rows_reach_both_ends_evenly() -> None:
    for n, at_most in ((1, 5), (5, 5), (6, 5), (62, 60), (1000, 7), (3, 1)):
        rows = spread_rows(n, at_most)
        assert (rows[0], rows[-1]) == (0, n - 1)
        assert len(rows) <= max(at_most, 2)
        assert len(set(np.diff(rows)[:-1])) <= 1
