"""A package of somebody else adds to this one by its entry points (`tests/plugins/example`)."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from fg_nav.commands.requests import complete_formats
from fg_nav.errors import FormatError, MagneticError, OutputError
from fg_nav.io import FORMATS, read_raw, write_canonical
from fg_nav.io.formats import list_formats
from fg_nav.lab.field_survey import parse_detectors
from fg_nav.lab.simulation import simulate
from fg_nav.magnetic.detectors import choose_gate, count_needed, find_gate
from fg_nav.plugins import find_plugins
from fg_nav.report.export import find_export
from tests.command_line import FgNav, in_a_process
from tests.io.samples import tilting
from tests.report.test_export import folder as folder  # a fixture: of a result
from tests.report.test_export import solution as solution
from tests.report.test_export import walked

ROOT = Path(__file__).parents[1]
EXAMPLE = ROOT / "tests" / "plugins" / "example"
RAW = tilting(np.random.default_rng(1))


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The example as if it were installed."""
    monkeypatch.syspath_prepend(str(EXAMPLE))
    find_plugins.cache_clear()
    yield
    find_plugins.cache_clear()
    sys.modules.pop("fg_nav_example", None)


def write_example(path: Path) -> Path:
    rows = np.column_stack([RAW.t, RAW.acc, RAW.gyr])
    path.write_text("\n".join(["example log", *("|".join(float(v).hex() for v in row) for row in rows)]) + "\n")
    return path


@pytest.mark.usefixtures("installed")
def test_a_method_of_another_package_is_run_by_its_name_and_refuses_what_it_does_not_use(
    fg_nav: FgNav, tmp_path: Path
) -> None:
    walk, out = tmp_path / "walk.csv", tmp_path / "out"
    write_canonical(simulate("demo", 1).recording.slice(0, 2000), walk)
    ran = fg_nav("run", walk, "--method", "standing", "--out", out, "--json").succeeded()
    summary = json.loads(ran.out)
    assert (summary["method"], summary["distance_m"]) == ("standing", 0.0)
    again = fg_nav("run", walk, "--config", out / "config.json", "--out", tmp_path / "again", "--json")
    assert json.loads(again.out)["method"] == "standing", again.err
    assert fg_nav("run", walk, "--method", "standin").refused("standing")
    assert fg_nav("run", walk, "--method", "standing", "--polish").refused("standing makes no use of --polish")
    # in a process of its own, as it is installed
    path = os.pathsep.join((str(ROOT), str(EXAMPLE)))
    assert in_a_process("run", walk, "--method", "standing", "--polish", PYTHONPATH=path).refused(
        "standing makes no use"
    )


@pytest.mark.usefixtures("installed")
def test_a_format_of_another_package_is_recognized_chosen_and_listed(tmp_path: Path) -> None:
    for format in (None, "example"):
        raw = read_raw(write_example(tmp_path / "walk.log"), format)
        assert raw.provenance.format == "example"
        np.testing.assert_array_equal(np.hstack([raw.acc, raw.gyr]), np.hstack([RAW.acc, RAW.gyr]))
    assert list(list_formats()) == [*FORMATS, "example"]
    assert complete_formats("exam") == ["example"]
    with pytest.raises(FormatError, match=r"choose one of canonical.*, tables, example\.$"):
        read_raw("walk.csv", "nonsense")


@pytest.mark.usefixtures("installed")
def test_a_detector_of_another_package_is_a_gate() -> None:
    assert choose_gate("strict") == "strict"
    assert choose_gate("strict:hard") == "strict:hard"
    assert find_gate("strict:hard").channels[0].sigma == 0.1
    assert count_needed("strict") == find_gate("strict").max_strides + 1
    assert parse_detectors("strict,qsf") == ["strict", "qsf"]
    with pytest.raises(MagneticError, match=r"no gate 'lax': choose one of qsf.*, strict\.$"):
        choose_gate("lax")


@pytest.mark.usefixtures("installed")
def test_an_export_of_another_package_is_there_for_the_command_and_for_a_solution(
    fg_nav: FgNav, folder: Path, tmp_path: Path
) -> None:
    ran = fg_nav("export", folder, "walk.wkt", "--json").succeeded()
    assert json.loads(ran.out)["files"] == ["walk.wkt"]
    kind, _, points = Path("walk.wkt").read_text().strip().rstrip(")").partition(" (")
    assert kind == "LINESTRING Z"
    wanted = walked().stances.position
    np.testing.assert_allclose([[float(x) for x in row.split()] for row in points.split(", ")], wanted, atol=1e-3)
    assert fg_nav("export", folder, "walk.wkt").refused("walk.wkt already exists", "--force")
    assert fg_nav("export", folder, "walk.wkt", "--origin", "48,11", "--force").refused("leave --origin out")
    assert walked().save(tmp_path / "walk.WKT").read_text().startswith("LINESTRING Z (")
    with pytest.raises(OutputError, match=r"\.rrd, \.wkt\."):
        find_export(tmp_path / "walk.shp")


def test_without_the_package_its_names_are_unknown(fg_nav: FgNav, tmp_path: Path) -> None:
    find_plugins.cache_clear()
    path = write_example(tmp_path / "walk.log")
    assert fg_nav("run", path, "--method", "standing").refused("standing")
    for error, words, call, arguments in (
        (FormatError, f"none of the {len(FORMATS)} formats", read_raw, (path,)),
        (FormatError, "there is no format 'example'", read_raw, (path, "example")),
        (MagneticError, "there is no gate 'strict'", choose_gate, ("strict",)),
        (OutputError, r"'\.wkt': choose one of \.geojson", find_export, (tmp_path / "walk.wkt",)),
    ):
        with pytest.raises(error, match=words):
            call(*arguments)
