"""A format of exports that another package brings is there for `export` and `Solution.save`, and in the refusals."""

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from fg_nav.errors import OutputError
from fg_nav.plugins import find_plugins
from fg_nav.report.export import find_export
from tests.command_line import FgNav
from tests.report.test_export import folder as folder  # a fixture: of a result
from tests.report.test_export import solution as solution
from tests.report.test_export import walked

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
