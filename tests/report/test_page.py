"""The page of a result: its figures are the summary's, its charts are drawn, and nothing is asked of a network."""

import json
import re
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fg_nav.report.charts import AlignedSolution, describe_frame, find_ellipses
from fg_nav.report.files import write_comparison, write_lagged, write_run
from fg_nav.report.page import compose_page, describe_graph
from fg_nav.report.series import HEAVIEST, draw_graph
from fg_nav.solution import Solution
from fg_nav.text import format_digits
from fg_nav.walk import Walk
from tests.browser import open_browser
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
    """A covariance that is nothing but a turn about the start is gone; without a truth it stays."""
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
