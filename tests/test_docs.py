"""What README and docs say is true of the code."""

import re
import tomllib
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
import typer

import fg_nav
from fg_nav import recording
from fg_nav.calibration import MagnetometerCalibration
from fg_nav.calibration.inertial import AccelerometerCalibration, GyroscopeCalibration
from fg_nav.calibration.of_recording import METHODS as CALIBRATIONS
from fg_nav.calibration.of_recording import Calibration
from fg_nav.cli import app
from fg_nav.commands import requests
from fg_nav.ekf.presets import PRESETS
from fg_nav.estimators import METHODS, RTS
from fg_nav.io import FORMATS, write_canonical
from fg_nav.lab import verbs as laboratory
from fg_nav.lab.field_survey import SURVEYED
from fg_nav.lab.simulation import SCENARIOS, simulate
from fg_nav.lab.simulation.scenarios import FIELDS
from fg_nav.lab.verbs.allan import ALLAN_FILES
from fg_nav.lab.verbs.detect import DETECT_FILES
from fg_nav.lab.verbs.simulate import FEET_FILES, SIMULATION_FILES
from fg_nav.magnetic.detectors import DEFAULT, GATES
from fg_nav.report.export import EXPORTS
from fg_nav.report.folder import RESULT_FILES
from fg_nav.samples import stamps
from fg_nav.smoother import SmootherParameters, graph, strides

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
FILTERS_PAGE = ROOT / "docs/filters.md"
MAGNETIC_PAGE = ROOT / "docs/magnetic.md"
NAMED = re.compile(r"scripts/([\w/]+)\.py")
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT = PYPROJECT["project"]
PAGES = (README, ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").glob("*.md")))


def list_commands() -> dict[str, Any]:
    """Commands by name, with those of the laboratory."""
    group: Any = typer.main.get_command(app)
    commands: dict[str, Any] = group.commands | group.commands["lab"].commands
    return {name: one for name, one in commands.items() if name != "lab"}


def rows_of(page: Path) -> list[list[str]]:
    """Cells of every row of every table."""
    lines = page.read_text(encoding="utf-8").splitlines()
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if line.startswith("|")]


def names_of(page: Path, head: str) -> list[str]:
    """Names in the first column of the tables with this head."""
    tables = re.findall(r"^(?:\|.*\n)+", page.read_text(encoding="utf-8"), re.MULTILINE)
    rows = [row for table in tables if table.startswith(f"| {head} |") for row in table.splitlines()[2:]]
    return [name for row in rows for name in re.findall(r"`([\w-]+)`", row.split("|")[1])]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    targets = re.findall(r"\]\(([^)]+)\)", text)
    for target in targets:
        place, _, anchor = target.partition("#")
        if place.startswith("http"):
            continue
        linked = page.parent / place if place else page
        assert linked.exists(), target
        if anchor:
            headings = re.findall(r"^#+ (.+)$", linked.read_text(encoding="utf-8"), re.MULTILINE)
            assert anchor in {re.sub(r"[^\w -]", "", h).lower().replace(" ", "-") for h in headings}, target


def test_every_page_stands_in_the_contents_of_the_site() -> None:
    listed = re.findall(r"^[\w/]+$", (ROOT / "docs/index.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert {page.stem for page in (ROOT / "docs").glob("*.md")} == {*listed, "index"} - {"gallery/index"}


def test_every_public_name_stands_in_the_reference() -> None:
    listed = re.findall(r"^   (\w+)$", (ROOT / "docs/api.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert [name for name in fg_nav.__all__ if name not in listed] == []


def test_every_format_has_its_row_and_is_named_on_the_first_page() -> None:
    listed = [row[0].strip("`") for row in rows_of(ROOT / "docs/formats.md") if row[0].strip("`") in FORMATS]
    assert listed == list(FORMATS)
    page = README.read_text(encoding="utf-8")
    assert [name for name in FORMATS if f"`{name}`" not in page] == []
    assert f"{len(FORMATS)} formats" in page


def test_parameters_have_the_values_that_the_page_tells() -> None:
    known = {f.name: f.default for f in fields(SmootherParameters)}
    for module in (graph, strides):
        known |= {name: value for name, value in vars(module).items() if name.isupper() and isinstance(value, float)}
    told: dict[str, float] = {}
    for first, value, *_ in rows_of(ROOT / "docs/models.md"):
        told |= {name: float(value) for name in re.findall(r"`(\w+)`", first) if name in known}
    assert told == {name: known[name] for name in told}
    untold = {name for name, value in known.items() if isinstance(value, float) and name.islower() and name not in told}
    assert untold <= {"gravity", "convergence"}


def test_what_is_mended_has_the_limits_of_the_code() -> None:
    text = (ROOT / "docs/formats.md").read_text(encoding="utf-8")
    assert f"up to {stamps.MAX_GAP_S:g} s kept" in text
    assert f"up to {stamps.MAX_BRIDGED_S:g} s bridged" in text
    assert f"above {100 * recording.MAX_MISSING_SHARE:g} % refused" in text
    assert f"fewer than {recording.MIN_SAMPLES} samples" in text


def test_every_file_of_a_result_is_explained() -> None:
    text = (ROOT / "docs/files.md").read_text(encoding="utf-8")
    ours = RESULT_FILES | DETECT_FILES | ALLAN_FILES
    assert not [name for name in ours if f"`{name}`" not in text]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_and_options_exist(page: Path) -> None:
    blocks = re.findall(r"```sh\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    lines = re.findall(r"(?:^|/|\| )fg-nav (?:lab )?(\w+)([^#\n]*)", "\n".join(blocks), re.MULTILINE)
    commands = list_commands()
    assert page != README or {name for name, _ in lines} == set(commands)
    for name, rest in lines:
        options = {option for parameter in commands[name].params for option in parameter.opts}
        assert set(re.findall(r"--[\w-]+", rest)) <= options


def test_every_option_is_explained() -> None:
    text = "\n".join(page.read_text(encoding="utf-8") for page in PAGES if page.name != "CHANGELOG.md")
    options = {name for one in list_commands().values() for parameter in one.params for name in parameter.opts}
    assert not [name for name in sorted(options) if name.startswith("--") and not re.search(f"{name}(?![\\w-])", text)]


def test_python_example_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    write_canonical(simulate("demo", 2).recording, tmp_path / "walk.csv")
    monkeypatch.chdir(tmp_path)
    exec(code, {})
    assert "strides_detected" in capsys.readouterr().out


def test_changelog_knows_the_version() -> None:
    assert f"## {PROJECT['version']}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_the_citation_has_the_version_and_the_licence() -> None:
    text = (ROOT / "docs/CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {PROJECT['version']}\n" in text
    assert f"\nlicense: {PROJECT['license']}\n" in text


def test_links_of_the_readme_are_absolute_in_the_package_index() -> None:
    text = README.read_text(encoding="utf-8")
    for rule in PYPROJECT["tool"]["hatch"]["metadata"]["hooks"]["fancy-pypi-readme"]["substitutions"]:
        text = re.sub(rule["pattern"], rule["replacement"], text)
        assert rule["replacement"].partition("](")[2].startswith(PROJECT["urls"]["Repository"])
    assert [target for target in re.findall(r"\]\(([^)]+)\)", text) if not re.match("https?://|#", target)] == []


def test_every_scenario_has_its_row() -> None:
    rows = rows_of(ROOT / "docs/simulation.md")
    told = {row[0].strip("`"): row[2:] for row in rows if row[0].strip("`") in SCENARIOS}
    known = {name: [f"{one.worn}, `{one.prior.name}`", f"`{one.field}`"] for name, one in SCENARIOS.items()}
    assert told == known


def test_every_format_of_exports_has_its_row_and_is_in_the_help() -> None:
    listed = [row[0].strip("`") for row in rows_of(ROOT / "docs/export.md") if row[0].startswith("`.")]
    assert listed == list(EXPORTS)
    out = next(one for one in typer.main.get_command(app).commands["export"].params if one.name == "out")
    assert re.findall(r"\.[a-z]+", out.help) == list(EXPORTS)


def test_every_file_of_a_simulation_is_explained() -> None:
    text = (ROOT / "docs/simulation.md").read_text(encoding="utf-8")
    assert not [name for name in SIMULATION_FILES | FEET_FILES if f"`{name}`" not in text]


def test_every_field_and_level_is_explained() -> None:
    text = (ROOT / "docs/simulation.md").read_text(encoding="utf-8")
    assert not [name for name in FIELDS if f"`{name}`" not in text]


def test_every_detector_and_method_of_calibration_has_its_row() -> None:
    assert names_of(MAGNETIC_PAGE, "detector") == list(SURVEYED)
    assert names_of(MAGNETIC_PAGE, "`--method`") == list(CALIBRATIONS)
    assert f"| `{DEFAULT}` |" in MAGNETIC_PAGE.read_text(encoding="utf-8")


def test_every_key_of_a_calibration_file_is_told() -> None:
    text = (ROOT / "docs/formats.md").read_text(encoding="utf-8")
    parts = (Calibration, MagnetometerCalibration, GyroscopeCalibration, AccelerometerCalibration)
    keys = {"format", "version", "made_by"} | {f.name for part in parts for f in fields(part)}
    assert not [key for key in keys if f"`{key}`" not in text]


def test_help_and_tables_have_every_method_and_preset() -> None:
    named = [name for name in METHODS["foot"] if not name.endswith(RTS)]
    filters = [name for name in named if name + RTS in METHODS["foot"]]
    assert requests.complete_foot_methods("") == list(METHODS["foot"])
    assert set(requests.complete_methods("")) == METHODS["foot"].keys() | METHODS["pocket"].keys()
    assert requests.complete_foot_methods("iez,qsf-s") == ["iez,qsf-stance", "iez,qsf-stance-rts"]
    assert set(named) <= set(re.findall(r"[\w-]+", requests.METHOD_NAMES))
    assert requests.PRESETS == PRESETS
    assert requests.GATES == GATES
    assert {*laboratory.SURVEYED} == {*SURVEYED, "all"}
    assert set(names_of(README, "method")) == {*named, RTS, f"iez{RTS}"}
    assert names_of(FILTERS_PAGE, "method") == filters
    assert names_of(FILTERS_PAGE, "preset") == list(PRESETS)
    assert not [name for name in PRESETS if f"`{name}`" not in README.read_text(encoding="utf-8")]


def test_pages_of_the_filters_exist() -> None:
    text = FILTERS_PAGE.read_text(encoding="utf-8")
    modules = re.findall(r"`(?:fg_nav/)?((?:ekf|magnetic|evaluation)/\w+\.py)`", text)
    assert modules
    assert not [name for name in modules if not (ROOT / "fg_nav" / name).exists()]


def test_the_readme_is_short_and_begins_with_a_picture() -> None:
    lines = README.read_text(encoding="utf-8").splitlines()
    assert len(lines) <= 200
    assert any(line.startswith("![") for line in lines[:20])


def test_scripts_that_pages_and_modules_name_exist() -> None:
    sources = [*PAGES, *(ROOT / "fg_nav").rglob("*.py"), *(ROOT / "scripts").rglob("*.py")]
    named = {name for page in sources if page.name != "CHANGELOG.md" for name in NAMED.findall(page.read_text("utf-8"))}
    assert "compare_ekf" in named
    assert not [name for name in sorted(named) if not (ROOT / "scripts" / f"{name}.py").exists()]


def test_files_that_the_architecture_names_exist() -> None:
    text = (ROOT / "docs/architecture.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`([\w/]+\.py)`", text))
    roots = (ROOT, ROOT / "fg_nav", ROOT / "fg_nav/lab", ROOT / "fg_nav/lab/simulation", ROOT / "scripts")
    assert not [name for name in sorted(named) if not any((root / name).exists() for root in roots)]
