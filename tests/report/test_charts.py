"""Pages and pictures show what they should, and a page asks nothing of a network; how they look was judged by eye."""

import json
import re
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread

from fg_nav.evaluation import evaluate
from fg_nav.frames import yaw_rotation
from fg_nav.report.charts import (
    AlignedSolution,
    Chart,
    Paths,
    align_paths,
    describe_frame,
    draw_course,
    envelope,
    find_ellipses,
    spread_rows,
)
from fg_nav.report.charts import find_ellipses as find
from fg_nav.report.files import write_comparison, write_lagged, write_run
from fg_nav.report.page import compose_page, describe_graph
from fg_nav.report.plots import style
from fg_nav.report.plots.style import draw_walk
from fg_nav.report.series import HEAVIEST, draw_graph, draw_headings
from fg_nav.solution import Solution
from fg_nav.text import format_digits
from fg_nav.truth import Fix, TrajectoryTruth
from fg_nav.walk import Options, Outcome, Walk
from tests.browser import open_browser
from tests.pictures import sketch_pictures
from tests.report import walks

SECTIONS = ["path", "graph", "height", "sigma", "stances", "bias", "heading", "strength", "returns", "errors"]
HOSTILE = "</script><img src=x onerror=alert(1)>'\".csv"


@pytest.fixture(scope="module")
def folder(walk: Walk, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the page of a walk whose file has a hostile name."""
    folder = tmp_path_factory.mktemp("page")
    provenance = replace(walk.recording.provenance, path=Path(HOSTILE))
    write_run(folder, replace(walk, recording=replace(walk.recording, provenance=provenance)), walks.outcome(walk))
    return folder


@pytest.fixture(scope="module")
def text(folder: Path) -> str:
    return (folder / "report.html").read_text(encoding="utf-8")


def charts_of(text: str) -> dict[str, Any]:
    found = re.search(r'<script type="application/json" id="charts">(.*?)</script>', text, re.DOTALL)
    assert found is not None
    charts: dict[str, Any] = json.loads(found[1])
    return charts


def test_figures_of_the_page_are_those_of_the_summary(folder: Path, text: str) -> None:
    summary = json.loads((folder / "summary.json").read_text())
    cells = dict(re.findall(r'data-key="(\w+)" data-value="([^"]*)"', text))
    assert {"distance_m", "closure_m", "rmse_2d_m", "end_error_m", "scale"} <= cells.keys()
    for key, value in cells.items():
        assert value == str(summary[key]), key
    assert re.findall(r'data-verdict="([^"]*)"', text) == [summary["verdict"]]
    assert f"{format_digits(summary['rmse_2d_m'])} m</strong>" in text


def test_the_page_is_small_a_hostile_name_is_text_and_the_path_that_of_the_solution(walk: Walk, text: str) -> None:
    assert len(text.encode()) < 3e6
    assert "<img" not in text.replace("<img/>", "")
    assert "&lt;img src=x onerror=alert(1)&gt;" in text
    assert len(re.findall(r"<script", text)) == 3
    outcome = walks.outcome(walk)
    path = next(trace for trace in charts_of(text)["path"]["data"] if trace["name"] == "smoother")
    aligned = outcome.comparison.alignment.apply(outcome.solution.position)
    assert len(path["x"]) <= 6001
    np.testing.assert_allclose([path["x"][-1], path["y"][-1]], aligned[-1, :2], atol=1e-4)


def test_an_alignment_takes_the_common_turn_out_of_the_ellipses(walk: Walk) -> None:
    outcome = walks.outcome(walk)
    table, turn = outcome.solution.stances, np.deg2rad(5.0)
    moved = table.position - table.position[0]
    v = np.column_stack([-moved[:, 1], moved[:, 0], np.zeros(len(table)), np.ones(len(table))])
    own = np.diag([1e-4, 1e-4, 1e-4, 1e-10])
    pose = turn**2 * v[:, :, None] * v[:, None, :] + own
    stances = replace(table, pose_cov=pose, position_cov=pose[:, :3, :3], heading_sigma=np.sqrt(pose[:, 3, 3]))
    solution = replace(outcome.solution, stances=stances)
    alone, aligned = AlignedSolution(solution), AlignedSolution(solution, walk.truth, outcome.comparison)
    assert aligned.turn_variance == pytest.approx(turn**2, rel=1e-3)
    assert alone.turn_variance == 0.0
    largest = [float(np.max(found.semi)) for view in (alone, aligned) if (found := find_ellipses(view))]
    assert largest[0] > 1.0
    assert largest[1] == pytest.approx(2.448 * 0.01, rel=0.05)


def with_graph(walk: Walk) -> Solution:
    """A solution by an online graph, whose compass weighs most at footfalls 10 to 20."""
    solution = walks.outcome(walk).solution
    table = solution.stances
    number = np.arange(len(table))
    weight = np.where((number >= 10) & (number <= 20), 1.0, 0.2)
    weight[0], statistic = 0.0, 3.0 / np.maximum(weight, 0.1)
    statistic[0] = np.nan
    sigma = np.deg2rad(np.where(number < 30, 1.0, 2.0))
    stances = replace(table, compass_weight=weight, field_statistic=statistic, differential_sigma=sigma)
    moment = replace(table, position=table.position + np.array([3.0, 4.0, 0.0]))
    graph = {"imu": 178, "zero_velocity": 179, "magnetic_heading": 59, "own": 2, "gated_out": 1}
    return replace(solution, stances=stances, moment=moment, graph=graph)


def test_the_graph_of_a_solution_is_told_and_drawn(walk: Walk) -> None:
    solution = with_graph(walk)
    view = AlignedSolution(solution)
    (words,) = describe_graph({"smoother": solution})
    assert words.startswith(
        "Factors of smoother by kind: inertial 178, zero velocity 179, magnetic heading 59, your own 2"
    )
    assert "418 in all. The gate left out the compass of 1 footfall." in words
    frame = describe_frame(view, walks.outcome(walk), walk.options)
    fixes = tuple(Fix(float(k), np.zeros(3), 1.0, origin=(48.0, 11.0, 500.0)) for k in range(2))
    for given, words in (((), "not known"), (fixes, "true, by the fixes")):
        one = replace(walks.without_truth(walk), fixes=given)
        assert words in align_paths({"iez": walks.outcome(one, "iez")}, one).frame.words
    charts = {chart.name: chart for chart in draw_graph(view, frame)}
    assert list(charts) == ["weights", "heaviest", "bias-up", "moment"]
    marked = {trace["name"]: trace for trace in charts["heaviest"].data}
    of_compass, of_differential = (
        marked[f"{what} weighs most"]["customdata"] for what in ("compass", "differential field")
    )
    assert len(of_compass) == round(HEAVIEST * len(solution.stances))
    assert set(of_compass) <= set(range(10, 21))
    assert set(of_differential) <= set(range(30))
    apart = next(trace for trace in charts["moment"].data if trace["name"] == "moment less batch")
    np.testing.assert_allclose(apart["y"], 5.0)
    # Without a reading and without a graph there is nothing to draw.
    assert draw_graph(AlignedSolution(walks.outcome(walk).solution), frame) == []
    assert describe_graph({"iez": walks.outcome(walk, "iez").solution}) == []


@pytest.mark.parametrize("change", [walks.without_truth, walks.with_footprints], ids=lambda f: f.__name__)
def test_no_section_is_empty(walk: Walk, change: Any) -> None:
    changed = change(walk)
    summary = {"method": "smoother", "strides": 3, "end_sigma_m": [0.1, 0.1, 0.1], "notes": []}
    page = compose_page({"smoother": walks.outcome(changed)}, [summary], {"smoother": {}}, {"smoother": changed})
    missing = {"graph", "strength", "returns", *(["errors"] if change is walks.without_truth else [])}
    assert [section.name for section in page.sections] == [name for name in SECTIONS if name not in missing]
    assert all(section.charts for section in page.sections)
    assert page.sections[0].charts[0].north == ("y" if change is walks.with_footprints else "start")


def test_methods_stand_side_by_side_and_a_walk_without_samples_has_a_page(walk: Walk, tmp_path: Path) -> None:
    write_comparison(tmp_path, walk, {"smoother": walks.outcome(walk), "iez": walks.outcome(walk, "iez", 4.0)})
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Methods side by side" in text
    links = re.findall(r'<li><a href="#([a-z-]+)">', text)
    assert links == [name for name in re.findall(r'<section id="([a-z-]+)"', text) if name in links]
    assert {"smoother", "iez"} <= {trace["name"] for trace in charts_of(text)["path"]["data"]}
    for name in ("path", "height", "bias", "heading"):
        entries = [one["name"] for one in charts_of(text)[name]["data"] if one.get("showlegend", True)]
        assert sorted(set(entries) - {"truth", "95 % ellipses"}) == ["iez", "smoother"], name
        assert len(entries) == len(set(entries)), name
    (tmp_path / "lag").mkdir()
    write_lagged(tmp_path / "lag", walks.outcome(walk).solution)
    lagged = (tmp_path / "lag" / "report.html").read_text(encoding="utf-8")
    assert 'data-verdict="trusted"' in lagged
    assert "stances" not in charts_of(lagged)


def wait(shown: Any, condition: str) -> None:
    """Ask until it holds: the policy of the page lets no condition be evaluated in it."""
    until = time.monotonic() + 20.0
    while not shown.evaluate(condition):
        assert time.monotonic() < until, condition
        shown.wait_for_timeout(50)


def test_a_real_browser_draws_all_charts_and_asks_for_nothing(folder: Path, text: str) -> None:
    with open_browser() as browser:
        shown = browser.new_page(viewport={"width": 1280, "height": 900})
        said: list[str] = []
        asked: list[str] = []
        shown.on("console", lambda message: said.append(message.text))
        shown.on("pageerror", lambda error: said.append(str(error)))
        shown.on("request", lambda request: asked.append(request.url))
        shown.goto((folder / "report.html").as_uri())
        wait(shown, "document.documentElement.dataset.drawn === 'yes'")
        drawn = shown.evaluate(
            "Object.fromEntries(Array.from(document.querySelectorAll('.chart'),"
            " chart => [chart.id.slice(6), chart.querySelectorAll('.scatterlayer .trace').length]))"
        )
        assert drawn.keys() == charts_of(text).keys()
        assert all(drawn.values()), drawn
        assert shown.evaluate("document.querySelectorAll('#chart-path .shapelayer path').length") == 3
        for width, height in ((1280, 800), (390, 844)):
            shown.set_viewport_size({"width": width, "height": height})
            wait(shown, f"document.documentElement.scrollWidth <= {width}")  # the charts follow a little later
            box = shown.locator("#chart-path").bounding_box()
            assert box["y"] + box["height"] <= height, "the path is above the fold"
        chart = shown.locator("#chart-path")
        legend, tools = (chart.locator(name).bounding_box() for name in (".legend", ".modebar"))
        assert legend["y"] + legend["height"] <= tools["y"]
        assert said == []
        assert [url for url in asked if not url.startswith(("file:", "data:"))] == []


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
    # also from where it is half a turn
    turned = replace(stances, nav_R_body=yaw_rotation(np.pi - 1e-3) @ stances.nav_R_body, heading_sigma=0.0 * t)
    opposite = replace(drawn, solution=replace(drawn.solution, stances=turned))
    found = next(np.array(one["y"]) for one in draw_headings({"smoother": opposite}).data if one["name"] == "error")
    np.testing.assert_allclose(found, error, atol=2e-3)


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


def test_spread_rows_reach_both_ends_evenly() -> None:
    for n, at_most in ((1, 5), (5, 5), (6, 5), (62, 60), (1000, 7), (3, 1)):
        rows = spread_rows(n, at_most)
        assert (rows[0], rows[-1]) == (0, n - 1)
        assert len(rows) <= max(at_most, 2)
        assert len(set(np.diff(rows)[:-1])) <= 1
