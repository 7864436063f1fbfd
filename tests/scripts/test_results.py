"""The script that writes docs/results.md, and the page itself."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from fg_nav.errors import OutputError
from fg_nav.lab.reproduce.file import read_reproduction, written
from fg_nav.lab.reproduce.messages import named, remark
from tests.lab.reproduce.made import reproduction
from tests.scripts import load_script

ROOT = Path(__file__).parents[2]
script = load_script("write_results")

PAGE = ROOT / "docs" / "results.md"
FILES = [PAGE.parent / "results" / f"{name}.json" for name in ("ma2018", "aiez2017", "munoz-diaz2017")]


@pytest.fixture
def found(tmp_path):
    return reproduction(tmp_path)


@pytest.fixture
def file(found, tmp_path):
    path = tmp_path / "results.json"
    path.write_text(written(found))
    return path


def test_every_row_has_a_line_with_its_verdict_and_its_reason(found, file, tmp_path):
    script.main([str(file), "--out", str(tmp_path / "a.md")])
    text = (tmp_path / "a.md").read_text()
    lines = text.splitlines()
    for experiment in found.experiments:
        assert f"### {experiment.name}: {experiment.title}" in lines
        for row in experiment.rows:
            (line,) = [line for line in lines if line.startswith(f"| {named(row)} |")]
            assert len(re.findall(r"(?<!\\)\|", line)) == len(experiment.columns) + 4
            assert (f"**{row.verdict}**" in line) == bool(row.verdict)
            assert remark(row).replace("<is>", "&lt;is>") in line
    assert "| ma2018 | 101 to 103 | 1 | 1 | 1 | 2 |" in lines
    assert "`fg-nav reproduce ma2018 --seeds 3`, seeds 101 to 103." in text
    for words in (*found.differs, found.citation):
        assert words in lines


def test_a_page_that_is_not_as_written_is_refused(file, tmp_path, capsys):
    page = tmp_path / "a.md"
    with pytest.raises(OutputError, match="is not what is written"):
        script.main([str(file), "--check", str(page)])
    script.main([str(file), "--out", str(page)])
    script.main([str(file), "--check", str(page)])
    assert "as written" in capsys.readouterr().out
    page.write_text(page.read_text().replace("0.55", "0.50"))
    with pytest.raises(OutputError, match="is not what is written"):
        script.main([str(file), "--check", str(page)])


def test_the_lines_of_other_pages_name_paper_row_and_three_figures(found, file, capsys, monkeypatch):
    row, other = "end < error & more", "rmse"
    wanted = [script.Line("ma2018", "M-E1", "", [row]), script.Line("another", "X-E1", "", ["end"])]
    both = script.Line("ma2018", "M-E1", "both", [row, other])
    monkeypatch.setattr(script, "HEADLINES", {"a.md": [*wanted, both]})
    monkeypatch.setattr(script, "BESIDE", {"a.md": ("tuned",)})
    script.main([str(file), "--lines"])
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "a.md:"
    assert said[4:7] == [
        "| ma2018, M-E1: end < error & more (m) | 0.50 | 0.10 (0.09 to 0.11) | - | 1.00 |",
        "| ma2018, M-E1: both (m) | 0.50 | 0.10 / 0.55 | - / - | 1.00 / 1.00 |",
        "",
    ]
    monkeypatch.setattr(script, "HEADLINES", {"a.md": [script.Line("ma2018", "M-E1", "", ["nowhere"])]})
    with pytest.raises(OutputError, match="no row 'nowhere' in M-E1"):
        script.headlines([replace(found, seeds=(1,))], "a.md")


def test_the_page_is_what_the_script_writes_from_the_files_beside_it():
    script.main([*map(str, FILES), "--check", str(PAGE)])
    assert all(path.stat().st_size < 200_000 for path in FILES)


@pytest.mark.parametrize("page", script.HEADLINES)
def test_other_pages_have_the_lines_of_these_files(page):
    lines = script.headlines([read_reproduction(path) for path in FILES], page)
    assert len(lines) == 2 + len(script.HEADLINES[page])
    assert "\n".join(lines) in (ROOT / page).read_text(encoding="utf-8")
