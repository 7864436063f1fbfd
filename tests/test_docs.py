"""What README and docs say is true of the code."""

import re
import tomllib
from dataclasses import fields
from pathlib import Path
from typing import Any

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
from fg_nav.io import FORMATS
from fg_nav.lab import verbs as laboratory
from fg_nav.lab.field_survey import SURVEYED
from fg_nav.lab.simulation import SCENARIOS
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
PAGES = (README, ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").glob("*.md")), *sorted(ROOT.glob("docs/results/*.md")))


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


def test_links_lead_somewhere_also_from_the_package_index() -> None:
    for page in PAGES:
        for target in re.findall(r"\]\(([^)]+)\)", page.read_text(encoding="utf-8")):
            place, _, anchor = target.partition("#")
            if place.startswith("http"):
                continue
            linked = page.parent / place if place else page
            assert linked.exists(), f"{page.name}: {target}"
            headings = re.findall(r"^#+ (.+)$", linked.read_text(encoding="utf-8"), re.MULTILINE) if anchor else []
            anchors = {re.sub(r"[^\w -]", "", heading).lower().replace(" ", "-") for heading in headings}
            assert not anchor or anchor in anchors, f"{page.name}: {target}"
    text = README.read_text(encoding="utf-8")
    for rule in PYPROJECT["tool"]["hatch"]["metadata"]["hooks"]["fancy-pypi-readme"]["substitutions"]:
        text = re.sub(rule["pattern"], rule["replacement"], text)
        assert rule["replacement"].partition("](")[2].startswith(PROJECT["urls"]["Repository"])
    assert [target for target in re.findall(r"\]\(([^)]+)\)", text) if not re.match("https?://|#", target)] == []


def list_named() -> dict[str, tuple[Path, set[str]]]:
    """Page that has to name each of these words, by what they are."""
    docs, parts = ROOT / "docs", (Calibration, MagnetometerCalibration, GyroscopeCalibration, AccelerometerCalibration)
    limits = (
        *(f"{stamps.MAX_GAP_S:g} s kept", f"{stamps.MAX_BRIDGED_S:g} s bridged"),
        *(f"{100 * recording.MAX_MISSING_SHARE:g} % refused", f"fewer than {recording.MIN_SAMPLES} samples"),
    )
    return {
        "pages of the site": (docs / "index.md", {page.stem for page in docs.glob("*.md")} - {"index"}),
        "public names": (docs / "api.md", set(fg_nav.__all__)),
        "limits of what is mended": (docs / "formats.md", set(limits)),
        "files of a result": (docs / "files.md", {f"`{one}`" for one in RESULT_FILES | DETECT_FILES | ALLAN_FILES}),
        "the version": (ROOT / "CHANGELOG.md", {f"## {PROJECT['version']}"}),
        "the citation": (docs / "CITATION.cff", {f"version: {PROJECT['version']}", f"license: {PROJECT['license']}"}),
        "files of a simulation": (docs / "simulation.md", {f"`{name}`" for name in SIMULATION_FILES | FEET_FILES}),
        "fields of a simulation": (docs / "simulation.md", {f"`{name}`" for name in FIELDS}),
        "keys of a calibration": (docs / "formats.md", {f"`{f.name}`" for part in parts for f in fields(part)}),
        "formats": (README, {f"{len(FORMATS)} formats"}),
        "the default gate": (MAGNETIC_PAGE, {f"| `{DEFAULT}` |"}),
    }


def test_pages_name_all_that_there_is() -> None:
    for kind, (page, words) in list_named().items():
        text = page.read_text(encoding="utf-8")
        assert sorted(word for word in words if word not in text) == [], kind


def test_tables_have_a_row_for_each_in_their_order() -> None:
    docs = ROOT / "docs"
    for page, known in (("formats.md", FORMATS), ("export.md", EXPORTS)):
        cells = [row[0].strip("`") for row in rows_of(docs / page)]
        assert [name for name in cells if name in known] == list(known)
    out = next(one for one in typer.main.get_command(app).commands["export"].params if one.name == "out")
    assert re.findall(r"\.[a-z]+", out.help) == list(EXPORTS)
    assert names_of(MAGNETIC_PAGE, "detector") == list(SURVEYED)
    assert names_of(MAGNETIC_PAGE, "`--method`") == list(CALIBRATIONS)
    told = {row[0].strip("`"): row[2:] for row in rows_of(docs / "simulation.md") if row[0].strip("`") in SCENARIOS}
    known = {name: [f"{one.worn}, `{one.prior.name}`", f"`{one.field}`"] for name, one in SCENARIOS.items()}
    assert told == known


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


def test_pages_name_every_option_and_no_other() -> None:
    commands, pages = list_commands(), {page: page.read_text(encoding="utf-8") for page in PAGES}
    laboratory_alone = {"allan", "campaign", "reproduce"}
    options = {name: {opt for parameter in one.params for opt in parameter.opts} for name, one in commands.items()}
    for page, text in pages.items():
        blocks = "\n".join(re.findall(r"```sh\n(.*?)```", text, re.DOTALL))
        lines = re.findall(r"(?:^|/|\| )fg-nav (?:lab )?(\w+)([^#\n]*)", blocks, re.MULTILINE)
        assert page != README or {name for name, _ in lines} == commands.keys() - laboratory_alone
        for name, rest in lines:
            assert set(re.findall(r"--[\w-]+", rest)) <= options[name], f"{page.name}: {name}{rest}"
    told = "\n".join(text for page, text in pages.items() if page.name != "CHANGELOG.md")
    every = sorted({opt for own in options.values() for opt in own if opt.startswith("--")})
    assert [opt for opt in every if not re.search(f"{opt}(?![\\w-])", told)] == []


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


def test_files_that_pages_and_modules_name_exist() -> None:
    sources = [*PAGES, *(ROOT / "fg_nav").rglob("*.py"), *(ROOT / "scripts").rglob("*.py")]
    named = {name for page in sources if page.name != "CHANGELOG.md" for name in NAMED.findall(page.read_text("utf-8"))}
    assert "compare_ekf" in named
    assert not [name for name in sorted(named) if not (ROOT / "scripts" / f"{name}.py").exists()]
    named = set(re.findall(r"`([\w/]+\.py)`", (ROOT / "docs/architecture.md").read_text(encoding="utf-8")))
    roots = (ROOT, ROOT / "fg_nav", ROOT / "fg_nav/lab", ROOT / "fg_nav/lab/simulation", ROOT / "scripts")
    assert not [name for name in sorted(named) if not any((root / name).exists() for root in roots)]
