"""The script that writes the pages of results, the pages themselves, and whether they are of the release's code."""

import json
import re
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

from fg_nav.errors import OutputError
from fg_nav.lab.reproduce.results import PAPERS, format_name, format_note, read_reproduction, write_reproduction
from fg_nav.lab.store.code import source_sum
from tests.lab.reproduce.made import reproduction
from tests.scripts import load_script

ROOT = Path(__file__).parents[2]
script = load_script("write_results")
experiments = load_script("experiments")

STORE = sorted((ROOT / "docs" / "results").glob("*.json"))
VERSION = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
MINOR = "{}.{}".format(*sys.version_info)
STAMPS = {
    "a": {"date": "2026-11-26", "commit": "abc", "seeds": "1 to 2", "command": "measure"},
    "b": {"date": "2026-11-26", "commit": "def", "command": "measure"},
}


@pytest.fixture
def found(tmp_path):
    return reproduction(tmp_path)


def test_every_row_has_a_line_with_its_verdict_and_its_reason(found):
    text = script.render("paper", found=found, made={})
    lines = text.splitlines()
    for experiment in found.experiments:
        assert f"## {experiment.name}: {experiment.title}" in lines
        for row in experiment.rows:
            (line,) = [line for line in lines if line.startswith(f"| {format_name(row)} |")]
            assert len(re.findall(r"(?<!\\)\|", line)) == len(experiment.columns) + 4
            assert (f"**{row.verdict}**" in line) == bool(row.verdict)
            assert format_note(row).replace("<is>", "&lt;is>") in line
    assert "`fg-nav lab reproduce ma2018 --seeds 3`, seeds 101 to 103." in text
    assert "![M-E1](ma2018-figure-one.png)" in lines
    listed = script.render("results", papers={"ma2018": found}, experiments={}, made={"ma2018": STAMPS})
    assert "| [ma2018](results/ma2018.md) | 101 to 103 | 1 | 1 | 1 | 2 | 2026-11-26 | abc and def |" in listed
    for words in (*found.differs, found.citation):
        assert words in lines


@pytest.fixture
def project(tmp_path):
    """The pages with results in them, and the files that they are written from."""
    docs = ROOT / "docs"
    for path in (ROOT / "README.md", *docs.glob("*.md"), *docs.glob("results/*.*")):
        copy = tmp_path / path.relative_to(ROOT)
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_bytes(path.read_bytes())
    return tmp_path


def test_a_page_that_is_not_as_written_is_refused(project, capsys):
    pages = {project / name: (project / name).read_text() for name in ("docs/results/ma2018.md", "README.md")}
    stale = project / "docs" / "results" / "an-old-name.md"
    stale.write_text("# What is measured no more\n")
    for page, written in pages.items():
        page.write_text(written.replace("|  | paper |", "|  | papers |"))
        with pytest.raises(OutputError, match="is not what is written"):
            script.main(["--check", "--root", str(project)])
        script.main(["--root", str(project)])
        assert page.read_text() == written
    script.main(["--check", "--root", str(project)])
    assert "as written" in capsys.readouterr().out
    assert not stale.exists()


def test_what_a_paper_came_to_is_taken_with_its_pictures_if_this_code_made_it(project, tmp_path, found):
    folder, store = tmp_path, project / "docs" / "results"
    (tmp_path / "results.json").write_text(write_reproduction(found))
    with pytest.raises(OutputError, match="made by other code"):
        script.take_paper(folder, store)
    made = replace(found, versions={**found.versions, "code": source_sum()})
    (tmp_path / "results.json").write_text(write_reproduction(made))
    script.take_paper(folder, store)
    [stamp] = json.loads((store / "ma2018.json").read_text())["made"].values()
    assert (stamp["code"], stamp["python"], stamp["seeds"]) == (source_sum(), MINOR, "101 to 103")
    assert read_reproduction(store / "ma2018.json") == read_reproduction(tmp_path / "results.json")
    assert (store / "ma2018-figure-one.png").read_bytes() == (tmp_path / "pictures" / "figure-one.png").read_bytes()


def test_a_block_that_is_not_there_is_named():
    with pytest.raises(OutputError, match="no block 'mistake': choose one of a"):
        script.fill_marks("<!-- written: mistake -->\n<!-- end -->\n", {"a": []})


def test_the_lines_of_other_pages_name_paper_row_and_three_figures(found, monkeypatch):
    row, other = "end < error & more", "rmse"
    wanted = [("ma2018", "M-E1", "", [row]), ("another", "X-E1", "", ["end"])]
    both = ("ma2018", "M-E1", "both", [row, other])
    monkeypatch.setattr(script, "HEADLINES", {"a.md": [*wanted, both]})
    monkeypatch.setattr(script, "BESIDE", {"a.md": ("tuned",)})
    assert script.headlines({"ma2018": found}, "a.md")[2:] == [
        "| ma2018, M-E1: end < error & more (m) | 0.50 | 0.10 (0.09 to 0.11) | - | 1.00 |",
        "| ma2018, M-E1: both (m) | 0.50 | 0.10 / 0.55 | - / - | 1.00 / 1.00 |",
    ]
    monkeypatch.setattr(script, "HEADLINES", {"a.md": [("ma2018", "M-E1", "", ["nowhere"])]})
    with pytest.raises(OutputError, match="no row 'nowhere' in M-E1"):
        script.headlines({"ma2018": replace(found, seeds=(1,))}, "a.md")


def test_all_pages_are_what_the_script_writes_from_the_files():
    script.main(["--check"])
    assert all(path.stat().st_size < 200_000 for path in STORE)


def test_a_table_says_when_at_which_commit_and_how_it_was_measured():
    assert script.describe_stamps(STAMPS) == "*2026-11-26, commit abc and def, seeds 1 to 2: `measure`.*"


ROWS = [
    {"section": section, "walk": walk, "variant": variant, "us": us}
    for section, walk, variant, us in (("10 min", "1", "iez", 1.0), ("10 min", "1", "bare loop", 200.0))
] + [{"section": "20 min", "walk": "1", "variant": "iez", "failure": "no such walk."}]


def test_a_page_has_question_picture_tables_failures_and_what_was_asked(tmp_path):
    page = script.write_page("cost", experiments.Table(ROWS), STAMPS)
    assert page.startswith("# What a sample costs each estimator, over other calls on the same samples\n\nRounds in")
    for line in ("![cost](cost.png)", "| 10 min | iez | 1 | 1.000 | 0.01 | 1.00 |", "- 20 min, 1, iez: no such walk."):
        assert line in page.splitlines()
    assert page.endswith("*2026-11-26, commit abc and def, seeds 1 to 2: `measure`.*\n")
    nothing = script.write_page("cost", experiments.Table([]), {})
    assert nothing.endswith("Not measured yet: `python scripts/measure.py cost --save`.\n")
    assert "![" not in nothing


def test_a_picture_is_drawn_of_walks_and_not_of_sums_or_counts(tmp_path):
    columns, pictures = script.EXPERIMENTS["cost"].columns, [tmp_path / "one.png", tmp_path / "two.png"]
    for path in pictures:
        script.draw_walks(experiments.Table(ROWS), columns, path)
    assert pictures[0].read_bytes() == pictures[1].read_bytes()
    sums = [{**row, "walk": "all"} for row in ROWS]
    counts = [{**row, "us": 1.0} for row in ROWS[:2]]
    assert [script.list_shown(columns, experiments.Table(rows)) for rows in (sums, counts, [])] == [[], [], []]


# --- the code that made the tables -----------------------------------------------------------------------------------


def list_others(version, code, store):
    """Files of the store that other code made: than this for a release, than the first one's while one is made."""
    stamps = [(name, stamp) for name, content in store.items() for stamp in content.get("made", {}).values()]
    wanted = code if "dev" not in version else next((stamp["code"] for _, stamp in stamps if "code" in stamp), code)
    others = {name for name, stamp in stamps if stamp.get("code") != wanted}
    # all have a stamp: papers, and each section of an experiment
    for name, content in store.items():
        sections = {row["section"] for row in content["rows"]} if "rows" in content else {name}
        others |= {name} if sections - content.get("made", {}).keys() else set()
    return sorted(others)


def test_files_of_other_code_are_found():
    def of(**codes):
        return {"made": {name: {"code": code} for name, code in codes.items()}, "rows": [{"section": s} for s in codes]}

    store = {"cost": of(a="1", b="1"), "gait": of(a="1"), "ma2018": {"made": {"ma2018": {"code": "1"}}}}
    mixed = {**store, "gait": of(a="2")}
    assert list_others("0.2.0", "1", store) == list_others("0.3.0.dev1", "2", store) == []
    assert list_others("0.2.0", "2", store) == ["cost", "gait", "ma2018"]
    assert list_others("0.2.0", "1", mixed) == list_others("0.3.0.dev1", "3", mixed) == ["gait"]
    assert list_others("0.2.0", "1", {"aiez2017": {}, "cost": {"made": {}, "rows": [{"section": "a"}]}}) == [
        "aiez2017",
        "cost",
    ]


def test_every_table_is_of_the_code_of_the_release():
    store = {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in STORE}
    assert set(store) <= {*PAPERS, *script.EXPERIMENTS}
    minors = {stamp["python"] for one in store.values() for stamp in one.get("made", {}).values() if "python" in stamp}
    if minors - {MINOR}:
        pytest.skip(f"the sums are of Python {', '.join(sorted(minors))}: this is {MINOR}, which gives others.")
    assert list_others(VERSION, source_sum(), store) == [], "measure again what other code made"
