"""The laws of the house: imports run one way, nothing heavy is loaded unasked, everything public speaks for itself."""

import ast
import re
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LIBRARY = sorted({*ROOT.glob("fg_nav/**/*.py"), *ROOT.glob("fg_nav/factors/*.py")})
BELOW_ESTIMATORS = {
    *("fg_nav.io", "fg_nav.detection", "fg_nav.magnetic", "fg_nav.calibration", "fg_nav.evaluation"),
    *("fg_nav.samples", "fg_nav.columns"),
}
ESTIMATORS = {"fg_nav.ekf", "fg_nav.smoother"}
TOP = {
    *("fg_nav.cli", "fg_nav.commands", "fg_nav.pipeline", "fg_nav.report", "fg_nav.walk"),
    "fg_nav.estimators",
    "fg_nav.lab.campaign",
}
TEXT = {".py", ".md", ".toml", ".cfg", ".txt", ".yml", ".yaml", ".json", ".csv", ""}


def module_name(path):
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def imports_of(path):
    """Modules that a file imports anywhere, in functions and under TYPE_CHECKING too."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0 or path.parent.name == "factors", f"{path.name} imports relatively"
            module = f"fg_nav.factors.{node.module}" if node.level else node.module
            found |= {f"{module}.{alias.name}" for alias in node.names} | {module}
    return found


def unit(module):
    """The package or module of the first level that a module belongs to, in the laboratory of the second."""
    parts = module.split(".")
    deep = 3 if parts[:2] == ["fg_nav", "lab"] else 2
    return ".".join(parts[:deep]) if parts[0] == "fg_nav" else parts[0]


UNITS = {unit(module_name(path)) for path in LIBRARY} - {"fg_nav"}
IMPORTS = {path: {unit(name) for name in imports_of(path)} for path in LIBRARY}


def importers_of(name):
    return {unit(module_name(path)) for path, units in IMPORTS.items() if name in units}


def test_each_floor_imports_those_below_it_alone():
    """Factors need gtsam and numpy; the ground floor no estimator; estimators neither each other nor what uses them."""
    for path, units in IMPORTS.items():
        own, allowed = unit(module_name(path)), set(sys.stdlib_module_names) | {"fg_nav.factors", "gtsam", "numpy"}
        if own == "fg_nav.factors":
            assert units <= allowed, path.name
        if own in BELOW_ESTIMATORS:
            assert not units & (ESTIMATORS | TOP), path.name
        if own in ESTIMATORS:
            assert not units & ((ESTIMATORS | TOP) - {own}), path.name


COMMANDS = {"fg_nav.cli", "fg_nav.commands", "fg_nav.lab.verbs"}
DRAWING = {"fg_nav.lab.drawing"}  # Pictures of the laboratory.


def test_the_report_gtsam_and_matplotlib_each_have_their_place():
    """The laboratory draws too. `Solution.save` and `.plot` find the report by the package's names, as users do."""
    for name, allowed in (
        ("fg_nav.report", COMMANDS | {"fg_nav.report", "fg_nav.lab.reproduce", *DRAWING}),
        ("fg_nav.lab.reproduce", COMMANDS | {"fg_nav.lab.reproduce"}),
        ("fg_nav.lab.campaign", COMMANDS | {"fg_nav.lab.campaign", "fg_nav.lab.reproduce"}),
        ("fg_nav.commands", COMMANDS),
        ("fg_nav.cli", {"fg_nav.cli", "fg_nav.__main__"}),
        ("gtsam", {"fg_nav.smoother", "fg_nav.online", "fg_nav.factors"}),
        ("matplotlib", {"fg_nav.report", "fg_nav.lab.reproduce", *DRAWING}),
    ):
        assert importers_of(name) <= allowed, name


RUNS_CODE = {"pickle", "marshal", "shelve", "dill", "cloudpickle", "joblib", "code", "runpy"}


def test_what_could_run_code_of_a_file_is_not_there():
    """`docs/security.md`: a pool of our own processes pickles what goes between them, nothing else does."""
    for path, units in IMPORTS.items():
        assert not units & RUNS_CODE, path.name
        text = path.read_text()
        assert not re.search(r"\b(eval|exec)\(|allow_pickle=True|shell=True|os\.system\(", text), path.name
        assert "verify=False" not in text, path.name


def test_imports_run_one_way():
    """Between packages, and between modules of the smoother, there is no circle; the package itself is left out."""
    graph, of_smoother = {}, {}
    for path, units in IMPORTS.items():
        name = module_name(path)
        if unit(name) != "fg_nav":
            graph.setdefault(unit(name), set()).update(units & UNITS - {unit(name)})
        if name.startswith("fg_nav.smoother."):
            modules = {module_name(one) for one in LIBRARY} - {"fg_nav.smoother"}
            of_smoother[name] = {one for one in imports_of(path) & modules if one.startswith("fg_nav.smoother.")}
    assert len(graph) > 20
    assert len(of_smoother) > 10
    TopologicalSorter(graph).prepare()
    TopologicalSorter(of_smoother).prepare()


def loaded_by(statement):
    """Modules in memory after a statement, in an interpreter of its own."""
    code = f"import sys; {statement}; print(*sorted(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines()[-1].split())


@pytest.mark.parametrize(
    ("statement", "light"),
    [
        ("import fg_nav.factors", {"matplotlib", "scipy", "numba"}),
        ("import fg_nav", {"matplotlib", "gtsam", "numba", "pandas", "scipy"}),
        (
            "import fg_nav.io, fg_nav.detection, fg_nav.calibration, fg_nav.ekf, fg_nav.evaluation, "
            "fg_nav.lab.simulation",
            {"matplotlib", "gtsam"},
        ),
        (
            # numpy reads how many threads it has when it is loaded
            "import os; os.environ.pop('OPENBLAS_NUM_THREADS', None); import fg_nav.cli; "
            "assert os.environ['OPENBLAS_NUM_THREADS'] == '1'; fg_nav.cli.app(['--help'], standalone_mode=False)",
            {"numpy", "scipy", "pandas", "gtsam", "numba", "matplotlib", "jinja2", "pydantic"},
        ),
    ],
    ids=["factors", "fg_nav", "without the smoother", "help"],
)
def test_nothing_heavy_is_loaded_unasked(statement, light):
    assert not loaded_by(statement) & light


SLOW = {*(f"scipy.{name}" for name in ("stats", "signal", "spatial", "optimize", "sparse")), "matplotlib", "pydantic"}
"""Each takes a tenth of a second to half of one to load."""


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    """A file with twenty seconds of a walk."""
    from fg_nav.io import write_canonical
    from fg_nav.lab.simulation import simulate

    file = tmp_path_factory.mktemp("laws") / "walk.csv"
    write_canonical(simulate("demo", 1).recording.slice(0, 3000), file)
    return file


def test_a_walk_on_a_foot_needs_neither_pocket_nor_laboratory_nor_what_is_slow_to_load(walk, tmp_path):
    loaded = loaded_by(
        "import fg_nav; from fg_nav.pipeline import navigate; "
        f"fg_nav.navigate({str(walk)!r}, options=fg_nav.Options(mount='foot')).save({str(tmp_path / 'out')!r})"
    )
    assert {"fg_nav.smoother.batch", "fg_nav.report.page"} <= loaded
    # A walk with a magnetometer is calibrated by itself, which looks up who came by a place again in a tree.
    assert not loaded & SLOW - {"scipy.spatial", "scipy.sparse"}
    assert not [name for name in loaded if name.startswith(("fg_nav.pocket", "fg_nav.lab"))]


def test_no_module_assigns_a_name_twice():
    """Where two chapters are merged one constant could replace another, which ruff does not see."""
    for path in LIBRARY:
        names = []
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
                names.append(node.name)
            elif isinstance(node, ast.Assign | ast.AnnAssign):
                targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                parts = [part for target in targets for part in ast.walk(target) if isinstance(part, ast.Name)]
                names += [part.id for part in parts if isinstance(part.ctx, ast.Store)]
        assert not {name for name in names if names.count(name) > 1}, path.name


def our_files():
    """Files of the project, as git knows them where it is there."""
    try:
        command = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
        listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines()
    except (OSError, subprocess.CalledProcessError):
        listed = [str(path.relative_to(ROOT)) for path in [*LIBRARY, *ROOT.glob("tests/**/*.py")]]
    return [ROOT / name for name in listed if (ROOT / name).is_file()]


def test_no_file_names_a_path_of_a_machine_or_is_a_recording():
    somewhere = re.compile(r"(?<![\w.])/(?:work|root|home|Users|mnt|tmp)/\w")
    texts = [path for path in our_files() if path.suffix in TEXT]
    assert len(texts) > 100
    assert not [path.name for path in our_files() if path.suffix == ".mat" or path.stat().st_size >= 2**20]
    for path in texts:
        for number, line in enumerate(path.read_text().splitlines(), 1):
            assert not somewhere.search(line), f"{path.relative_to(ROOT)}:{number}: {line.strip()}"


# --- the budget: `docs/architecture.md` ------------------------------------------------------------------------------

SLACK = 0.03  # By which a count may lie under the budget before the budget is to be lowered.


def read_budget(title):
    """Rows of the table in docs/architecture.md whose first column is `title`, as numbers by their first cell."""
    text = (ROOT / "docs" / "architecture.md").read_text()
    table = text.partition(f"| {title} |")[2].split("\n\n")[0].splitlines()[2:]
    cells = [[cell.strip() for cell in row.strip("| ").split("|")] for row in table]
    return {name.strip("`"): [int(number) for number in numbers] for name, *numbers in cells}


def count_package(folder):
    """Lines, modules and functions of a package; of `fg_nav` itself those of its own files."""
    paths = sorted(folder.glob("*.py") if folder.name == "fg_nav" else folder.rglob("*.py"))
    texts = [path.read_text() for path in paths]
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef)
    functions = sum(isinstance(node, kinds) for text in texts for node in ast.walk(ast.parse(text)))
    return [sum(text.count("\n") for text in texts), len(paths), functions]


def is_within(counts, budget):
    """Whether no count is over its budget, nor so far under it that the budget says nothing."""
    return all(b * (1 - SLACK) - 2 <= c <= b for c, b in zip(counts, budget, strict=True))


def test_no_package_is_over_its_budget():
    """A number in the table falls, or rises by a commit that says why."""
    packages = [ROOT / "factors", ROOT / "fg_nav", *(ROOT / "fg_nav").iterdir()]
    counts = {
        str(p.relative_to(ROOT)): count_package(p) for p in packages if not p.is_symlink() and any(p.glob("*.py"))
    }
    budget = read_budget("package")
    assert budget.keys() == counts.keys()
    over = {name: (counts[name], budget[name]) for name in budget if not is_within(counts[name], budget[name])}
    assert not over, "counted, budget"


FILES_PASSED = """
import sys, threading
from importlib.util import find_spec
root, seen = find_spec("fg_nav").submodule_search_locations[0], set()  # As installed, which CI tests.
def note(frame, event, _):
    code = frame.f_code
    is_function = code.co_flags & 1 and not code.co_name.startswith("<")  # no class body, nor part of a module
    if event == "call" and is_function and code.co_filename.startswith(root):
        seen.add(code.co_filename)
def start():
    threading.setprofile(note)
    sys.setprofile(note)
"""

RUN = """
from fg_nav import cli
sys.argv = ["fg-nav", "run", sys.argv[1], "--out", sys.argv[2], "--quiet"]
start()
try:
    cli.main()
except SystemExit as left:
    assert not left.code
"""

FOOTFALL = """
from fg_nav import read
from fg_nav.online import OnlineNavigator
walk, at, navigator = read(sys.argv[1]), 0, OnlineNavigator(background=True)
for footfalls in (8, 9):
    while len(navigator.footfalls) < footfalls:
        part = slice(at, at + 10)
        navigator.push(walk.t[part], walk.acc[part], walk.gyr[part], walk.mag[part])
        at += 10
    if footfalls == 8:
        start()
sys.setprofile(None)
navigator.close()
"""


def test_the_way_through_the_files_is_within_its_budget(walk, tmp_path):
    """How many files a reader has to open who follows a recording through `run`, or one footfall online."""
    counts = {}
    for name, code in (("fg-nav run", RUN), ("one footfall online", FOOTFALL)):
        command = [sys.executable, "-c", f"{FILES_PASSED}{code}\nsys.setprofile(None)\nprint(len(seen))"]
        command += [str(walk), str(tmp_path / "out")]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
        counts[name] = [int(done.stdout.splitlines()[-1])]
    budget = read_budget("way")
    assert budget.keys() == counts.keys()
    assert {name: counts[name] for name in budget if not is_within(counts[name], budget[name])} == {}
