"""The script that writes docs/results.md, and the page itself."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fg_nav.errors import OutputError
from fg_nav.lab.reproduce.results import format_name, format_note
from tests.lab.reproduce.made import reproduction
from tests.scripts import load_script

ROOT = Path(__file__).parents[2]
script = load_script("write_results")
tables = load_script("walk_tables")

PAGE = ROOT / "docs" / "results.md"
FILES = [PAGE.parent / "results" / f"{name}.json" for name in ("ma2018", "aiez2017", "munoz-diaz2017")]
WALKS, COVERAGE, BENCHMARK = (PAGE.parent / "results" / f"{name}.json" for name in script.MEASURED)


@pytest.fixture
def found(tmp_path):
    return reproduction(tmp_path)


def test_every_row_has_a_line_with_its_verdict_and_its_reason(found):
    text = script.document([found])
    lines = text.splitlines()
    for experiment in found.experiments:
        assert f"### {experiment.name}: {experiment.title}" in lines
        for row in experiment.rows:
            (line,) = [line for line in lines if line.startswith(f"| {format_name(row)} |")]
            assert len(re.findall(r"(?<!\\)\|", line)) == len(experiment.columns) + 4
            assert (f"**{row.verdict}**" in line) == bool(row.verdict)
            assert format_note(row).replace("<is>", "&lt;is>") in line
    assert "| ma2018 | 101 to 103 | 1 | 1 | 1 | 2 |" in lines
    assert "`fg-nav lab reproduce ma2018 --seeds 3`, seeds 101 to 103." in text
    for words in (*found.differs, found.citation):
        assert words in lines


@pytest.fixture
def project(tmp_path):
    """The pages with results in them, and the files that they are written from."""
    for path in (ROOT / "README.md", *(ROOT / "docs").glob("*.md"), *FILES, WALKS, COVERAGE, BENCHMARK):
        copy = tmp_path / path.relative_to(ROOT)
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_bytes(path.read_bytes())
    return tmp_path


@pytest.mark.parametrize("name", ["docs/results.md", "README.md"])
def test_a_page_that_is_not_as_written_is_refused(project, capsys, name):
    page = project / name
    written = page.read_text()
    page.write_text(written.replace("0.56", "0.50"))
    with pytest.raises(OutputError, match="is not what is written"):
        script.main(["--check", "--root", str(project)])
    script.main(["--root", str(project)])
    assert page.read_text() == written
    script.main(["--check", "--root", str(project)])
    assert "as written" in capsys.readouterr().out


def test_a_block_that_is_not_there_is_named():
    with pytest.raises(OutputError, match="no block 'mistake': choose one of a"):
        script.fill_marks("<!-- written: mistake -->\n<!-- end -->\n", {"a": []})


def test_the_lines_of_other_pages_name_paper_row_and_three_figures(found, monkeypatch):
    row, other = "end < error & more", "rmse"
    wanted = [script.Line("ma2018", "M-E1", "", [row]), script.Line("another", "X-E1", "", ["end"])]
    both = script.Line("ma2018", "M-E1", "both", [row, other])
    monkeypatch.setattr(script, "HEADLINES", {"a.md": [*wanted, both]})
    monkeypatch.setattr(script, "BESIDE", {"a.md": ("tuned",)})
    assert script.headlines([found], "a.md")[2:] == [
        "| ma2018, M-E1: end < error & more (m) | 0.50 | 0.10 (0.09 to 0.11) | - | 1.00 |",
        "| ma2018, M-E1: both (m) | 0.50 | 0.10 / 0.55 | - / - | 1.00 / 1.00 |",
    ]
    monkeypatch.setattr(script, "HEADLINES", {"a.md": [script.Line("ma2018", "M-E1", "", ["nowhere"])]})
    with pytest.raises(OutputError, match="no row 'nowhere' in M-E1"):
        script.headlines([replace(found, seeds=(1,))], "a.md")


def test_all_pages_are_what_the_script_writes_from_the_files():
    script.main(["--check"])
    assert all(path.stat().st_size < 200_000 for path in (*FILES, WALKS, COVERAGE, BENCHMARK))


def test_every_block_stands_in_one_page():
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
    found = [name for page in pages for name in re.findall(r"<!-- written: ([\w-]+) -->", page.read_text("utf-8"))]
    assert sorted(found) == sorted(script.BLOCKS)


def test_figures_of_the_real_walks_are_their_means_and_medians():
    walks = json.loads(WALKS.read_text())
    rmse = [one["rmse_2d_m"] for one in walks["walks"] if (one["section"], one["method"]) == (tables.FOOTPRINTS, "iez")]
    assert tables.of(walks, tables.FOOTPRINTS, "iez", "rmse_2d_m") == f"{np.mean(rmse):.3f} / {np.median(rmse):.3f}"
    without = [one["without"] for one in walks["magnetometer"] if one["group"] == "gdin"]
    inertial = [
        one["rmse_2d_m"]
        for one in walks["walks"]
        if (one["section"], one["method"]) == (tables.FOOTPRINTS, tables.INERTIAL)
    ]
    assert without == pytest.approx(inertial, abs=1e-4)  # two ways to the same figure


def test_ends_walks_behind_and_levels_are_written(monkeypatch):
    def row(section, walk, method, **more):
        return {"section": section, "walk": walk, "method": method, "verdict": "trusted", **more}

    ends = {"ground_m": 0.30, "z_m": -0.5, "ground_ratio": 1.0, "z_ratio": -2.0}
    mtig = [row(part, "up", "smoother", **ends) for part in (tables.MTIG, tables.MTIG + tables.AIR)]
    rounds = [row(tables.ROUND, "a", "smoother", **ends), row(tables.ROUND, "a", "iez", ground_m=0.26)]
    rounds += [row(tables.ROUND, "b", "smoother", **ends | {"z_m": 0.7}), row(tables.ROUND, "b", "iez", ground_m=0.28)]
    walks = {"walks": [*mtig, row(tables.MTIG, "up", "iez", ground_m=0.4), *rounds]}
    assert tables.write_passes(walks)[2] == "| `up` | 0.30 | -0.50 ± 0.25 | 0.30 | -0.50 ± 0.25 | 0.40 | trusted |"
    assert tables.write_behind(walks)[2:] == ["| mti, round | a | 0.300 | 0.260 |"]  # b is behind by 2 cm
    monkeypatch.setattr(tables, "CLOSED", {tables.ROUND: "rounds"})
    closed = [*rounds, row(tables.MEMS + tables.AIR, "c", "smoother", **ends)]
    [ours] = [line for line in tables.write_closed({"walks": closed}) if "rounds" in line and "`inertial`" in line]
    assert ours.endswith("| `inertial` | 0.30 / 0.30 | 1.00 | 0.60 / 0.70 | 2.00 | 2 / 0 / 0 |")
    levels = [{"walk": "a", "level": level, "error_m": 1.0, "sigma_m": 2.0} for level in ("as chosen", "3e-04")]
    assert tables.write_bias_walk({"bias_walk": levels}) == [
        "| end off / sigma, m | as chosen | 3e-04 |",
        "|---|---:|---:|",
        "| a | 1.00 / 2.00 | 1.00 / 2.00 |",
    ]


def test_no_page_has_a_figure_of_the_real_walks_but_in_the_tables_that_are_written():
    """A mean or median over the gdin walks in prose would be another source of it."""
    for page in (ROOT / "README.md", ROOT / "CHANGELOG.md", *(ROOT / "docs").glob("*.md")):
        prose = script.MARKED.sub("", page.read_text(encoding="utf-8"))
        paragraphs = [one for one in re.split(r"\n\s*\n|\n(?=- )", prose) if "gap" not in one]
        figures = [re.findall(r"\bgdin\b[^;|]{0,100}?\b0\.\d\d+ (?:m|in|with|for|to)\b", one) for one in paragraphs]
        assert not any(figures), page.name
