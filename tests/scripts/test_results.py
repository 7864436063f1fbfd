"""The script that writes docs/results.md, and the page itself."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from fg_nav.errors import OutputError
from fg_nav.lab.reproduce.results import format_name, format_note
from tests.lab.reproduce.made import reproduction
from tests.scripts import load_script

ROOT = Path(__file__).parents[2]
script = load_script("write_results")

PAGE = ROOT / "docs" / "results.md"
STORE = sorted((PAGE.parent / "results").glob("*.json"))


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
    for path in (ROOT / "README.md", *(ROOT / "docs").glob("*.md"), *STORE):
        copy = tmp_path / path.relative_to(ROOT)
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_bytes(path.read_bytes())
    return tmp_path


def test_a_page_that_is_not_as_written_is_refused(project, capsys):
    pages = {project / name: (project / name).read_text() for name in ("docs/results.md", "README.md")}
    for page, written in pages.items():
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
    wanted = [("ma2018", "M-E1", "", [row]), ("another", "X-E1", "", ["end"])]
    both = ("ma2018", "M-E1", "both", [row, other])
    monkeypatch.setattr(script, "HEADLINES", {"a.md": [*wanted, both]})
    monkeypatch.setattr(script, "BESIDE", {"a.md": ("tuned",)})
    assert script.headlines([found], "a.md")[2:] == [
        "| ma2018, M-E1: end < error & more (m) | 0.50 | 0.10 (0.09 to 0.11) | - | 1.00 |",
        "| ma2018, M-E1: both (m) | 0.50 | 0.10 / 0.55 | - / - | 1.00 / 1.00 |",
    ]
    monkeypatch.setattr(script, "HEADLINES", {"a.md": [("ma2018", "M-E1", "", ["nowhere"])]})
    with pytest.raises(OutputError, match="no row 'nowhere' in M-E1"):
        script.headlines([replace(found, seeds=(1,))], "a.md")


def test_all_pages_are_what_the_script_writes_from_the_files():
    script.main(["--check"])
    assert all(path.stat().st_size < 200_000 for path in STORE)


def test_a_table_has_its_date_its_commit_and_whether_the_code_has_changed(monkeypatch):
    monkeypatch.setattr(script, "has_changed", lambda commit: commit == "abc")
    made = {
        "a": {"date": "2026-11-26", "commit": "abc", "seeds": "1 to 2"},
        "b": {"date": "2026-11-26", "commit": "def"},
    }
    words = script.describe_stamps("coverage", made)
    assert (
        words
        == "*`scripts/measure.py coverage`, 2026-11-26, commit abc and def, seeds 1 to 2. The code has changed since.*"
    )
    assert "changed" not in script.describe_stamps("coverage", {"b": made["b"]})
