"""A format of exports that another package brings is there for `export` and `Solution.save`, and in the refusals."""

import json
import sys
from collections.abc import Iterator
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from fg_nav.errors import OutputError, PluginError
from fg_nav.plugins import find_plugins
from fg_nav.report.export import EXPORTS, Export, check_export, find_export
from tests.command_line import FgNav
from tests.report.test_export import MUNICH, walked
from tests.report.test_export import folder as folder  # a fixture: of a result
from tests.report.test_export import solution as solution

EXAMPLE = Path(__file__).parent / "plugins" / "example"


@pytest.fixture
def example(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Install the example package for a test."""
    monkeypatch.syspath_prepend(str(EXAMPLE))
    find_plugins.cache_clear()
    yield EXAMPLE
    find_plugins.cache_clear()
    sys.modules.pop("fg_nav_example", None)


@pytest.mark.usefixtures("example")
def test_the_command_writes_the_format_of_another_package(fg_nav: FgNav, folder: Path) -> None:
    ran = fg_nav("export", folder, "walk.wkt", "--json")
    assert ran.code == 0, ran.err
    assert json.loads(ran.out)["files"] == ["walk.wkt"]
    kind, _, points = Path("walk.wkt").read_text().strip().rstrip(")").partition(" (")
    assert kind == "LINESTRING Z"
    wanted = walked().stances.position
    np.testing.assert_allclose([[float(x) for x in row.split()] for row in points.split(", ")], wanted, atol=1e-3)
    assert fg_nav("export", folder, "walk.wkt").refused("walk.wkt already exists", "--force")
    assert fg_nav("export", folder, "walk.wkt", "--origin", "48,11", "--force").refused("leave --origin out")


@pytest.mark.usefixtures("example")
def test_a_solution_saves_itself_in_it_and_a_refusal_names_it(tmp_path: Path) -> None:
    assert walked().save(tmp_path / "walk.WKT").read_text().startswith("LINESTRING Z (")
    with pytest.raises(OutputError, match=r"\.rrd, \.wkt\."):
        find_export(tmp_path / "walk.shp")


def test_without_the_package_the_ending_is_unknown(tmp_path: Path) -> None:
    find_plugins.cache_clear()
    with pytest.raises(OutputError, match=r"'\.wkt': choose one of \.geojson"):
        find_export(tmp_path / "walk.wkt")


@pytest.mark.usefixtures("example")
def test_a_map_of_another_package_needs_an_origin_and_none_takes_an_ending_of_ours(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fg_nav_example = import_module("fg_nav_example")
    monkeypatch.setattr(fg_nav_example, "WKT", replace(fg_nav_example.WKT, needs_origin=True))
    with pytest.raises(OutputError, match="--origin"):
        check_export(tmp_path / "walk.wkt")
    check_export(tmp_path / "walk.wkt", MUNICH)
    find_plugins.cache_clear()
    monkeypatch.setattr(fg_nav_example, "WKT", Export(".kml", "another KML", print))
    assert find_export(tmp_path / "walk.kml") is EXPORTS[".kml"]


@pytest.mark.usefixtures("example")
def test_what_is_no_export_is_refused_in_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fg_nav_example = import_module("fg_nav_example")
    monkeypatch.setattr(fg_nav_example, "WKT", print)
    with pytest.raises(PluginError, match="wkt of the package fg-nav-example is no Export"):
        find_export(tmp_path / "walk.wkt")
