"""The page of the papers' equations against code and tests: each has a row, and what the row names is there."""

import ast
import re
from collections import defaultdict
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs/equations.md"
EQUATIONS = {"Ma": 39, "AIEZ": 32, "MD": 27}  # Of each paper the numbered ones.

CITATION = re.compile(r"\b(Ma|AIEZ|MD) (\(\d+\)(?:-\(\d+\))?(?:,\s+\(\d+\)(?:-\(\d+\))?)*)")
READINGS = ("as printed", "same", "corrected: ", "replaced: ", "left out: ")


def cited_in(text):
    """Pairs of paper and number that a text cites."""
    pairs = set()
    for paper, numbers in CITATION.findall(text):
        for first, last in re.findall(r"\((\d+)\)(?:-\((\d+)\))?", numbers):
            pairs |= {(paper, number) for number in range(int(first), int(last or first) + 1)}
    return pairs


def rows_of_page():
    """Cells of the rows that begin with an equation, and of those that begin with a module."""
    equations, modules = [], []
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip().strip("|").split(" | ")]
        if line.startswith("|") and len(cells) == 5 and cited_in(cells[0]):
            equations.append(cells)
        elif line.startswith("| `") and len(cells) == 2:
            modules.append(cells)
    return equations, modules


ROWS, MODULES = rows_of_page()


def path_of(name):
    return ROOT / name if name.startswith("factors/") else ROOT / "fg_nav" / name


def places_in(cell):
    """File and name of each place that a cell names as `file.py::name`."""
    return re.findall(r"`([\w/]+\.py)::([\w.]+)`", cell)


@cache
def names_in(path):
    """Docstring of each function, class, method and constant of a module, by its dotted name."""
    docs = {}

    def visit(body, prefix):
        for node, after in zip(body, [*body[1:], None], strict=True):
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                docs[prefix + node.name] = ast.get_docstring(node) or ""
                if isinstance(node, ast.ClassDef):
                    visit(node.body, f"{prefix}{node.name}.")
            elif isinstance(node, ast.Assign | ast.AnnAssign):
                described = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
                for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
                    if isinstance(target, ast.Name):
                        docs[prefix + target.id] = str(after.value.value) if described else ""

    visit(ast.parse(path.read_text(encoding="utf-8")).body, "")
    return docs


def test_every_equation_has_one_row():
    seen = [pair for row in ROWS for pair in cited_in(row[0])]
    wanted = {(paper, number) for paper, last in EQUATIONS.items() for number in range(1, last + 1)}
    missing, strange = sorted(wanted - set(seen)), sorted(set(seen) - wanted)
    twice = sorted({pair for pair in seen if seen.count(pair) > 1})
    assert not missing, f"give docs/equations.md a row for {missing}"
    assert not strange, f"docs/equations.md has rows for {strange}, which no paper has"
    assert not twice, f"docs/equations.md has more than one row for {twice}"


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0])
def test_code_and_test_are_there_and_the_code_cites_the_equation(row):
    assert row[4].startswith(READINGS), f"{row[0]}: begin the last cell with one of {READINGS}"
    tests, places = places_in(row[3]), places_in(row[2])
    assert row[4].startswith("left out: ") or (tests and places), f"name code and test of {row[0]} as `file.py::name`"
    for file, name in tests:
        path = ROOT / "tests" / file
        assert path.exists(), f"{row[0]}: there is no tests/{file}; put its new place into docs/equations.md"
        assert name in names_in(path), f"{row[0]}: tests/{file} has no {name}; put its new name into docs/equations.md"
    for file, name in places:
        path = path_of(file)
        assert path.exists(), f"{row[0]}: there is no fg_nav/{file}; put its new place into docs/equations.md"
        docs = names_in(path)
        assert name in docs, f"{row[0]}: {file} has no {name}; put its new name into docs/equations.md"
        header = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
        uncited = sorted(cited_in(row[0]) - cited_in(header) - cited_in(docs[name]))
        assert not uncited, f"cite {uncited} in the docstring of {file} or of its {name}, in the style `Ma (26)`"


def test_every_citation_in_the_code_has_a_row_that_names_its_file():
    named = defaultdict(set)
    for row in ROWS:
        for file, _ in places_in(row[2]):
            named[path_of(file)] |= cited_in(row[0])
    for cell, cites in MODULES:
        for code in re.findall(r"`([^`]+)`", cell):
            path = path_of(code)
            assert path.exists(), f"there is no {code}; put its new place into docs/equations.md, under Further"
            stale = sorted(cited_in(cites) - cited_in(path.read_text(encoding="utf-8")))
            assert not stale, f"{code} no longer cites {stale}: strike them from docs/equations.md, under Further"
            named[path] |= cited_in(cites)
    sources = [*(ROOT / "fg_nav").rglob("*.py"), *(ROOT / "factors").glob("*.py")]
    for path in sources:
        if "factors" in path.relative_to(ROOT).parts[1:]:
            continue  # the link to the folder beside
        missing = sorted(cited_in(path.read_text(encoding="utf-8")) - named[path])
        shown = path.relative_to(ROOT)
        assert not missing, f"{shown} cites {missing}: name it in their rows of docs/equations.md, or under Further"


def test_equations_are_cited_in_one_style():
    other = re.compile(r"\b(?:Ma|AIEZ|Zhang|Munoz Diaz|MD)(?:'s)?(?: \d{4})?,? (?:Eqs?\.|[Ee]quations?) ?\(?\d+")
    for path in (
        path for folder in ("fg_nav", "factors", "tests", "scripts") for path in (ROOT / folder).rglob("*.py")
    ):
        found = other.findall(path.read_text(encoding="utf-8"))
        assert not found, f"{path.relative_to(ROOT)}: write {found} in the style `Ma (26)`"
