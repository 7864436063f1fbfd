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
BELOW_ESTIMATORS = ("io", "detection", "magnetic", "calibration", "evaluation", "samples", "columns")
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


def test_factors_need_gtsam_and_numpy_only():
    allowed = set(sys.stdlib_module_names) | {"fg_nav.factors", "gtsam", "numpy"}
    for path in LIBRARY:
        if unit(module_name(path)) == "fg_nav.factors":
            assert allowed >= IMPORTS[path], path.name


@pytest.mark.parametrize("package", BELOW_ESTIMATORS)
def test_the_ground_floor_knows_no_estimator(package):
    for path in (ROOT / "fg_nav" / package).rglob("*.py"):
        assert not IMPORTS[path] & (ESTIMATORS | TOP), path.name


def test_estimators_do_not_know_each_other_nor_what_uses_them():
    for path in LIBRARY:
        own = unit(module_name(path))
        if own in ESTIMATORS:
            assert not IMPORTS[path] & ((ESTIMATORS | TOP) - {own}), path.name


DRAWING = {"fg_nav.lab.drawing"}  # Pictures of the laboratory.


def test_the_report_is_imported_by_the_command_line_alone():
    """The laboratory draws too. `Solution.save` and `.plot` find it by the package's names, as users do."""
    commands = {"fg_nav.cli", "fg_nav.commands", "fg_nav.lab.verbs"}
    assert importers_of("fg_nav.report") <= commands | {"fg_nav.report", "fg_nav.lab.reproduce", *DRAWING}
    assert importers_of("fg_nav.lab.reproduce") <= commands | {"fg_nav.lab.reproduce"}
    assert importers_of("fg_nav.lab.campaign") <= commands | {"fg_nav.lab.campaign", "fg_nav.lab.reproduce"}
    assert importers_of("fg_nav.commands") <= commands
    assert importers_of("fg_nav.cli") <= {"fg_nav.cli"}


def test_gtsam_and_matplotlib_each_have_their_place():
    assert importers_of("gtsam") <= {"fg_nav.smoother", "fg_nav.online", "fg_nav.factors"}
    assert importers_of("matplotlib") <= {"fg_nav.report", "fg_nav.lab.reproduce", *DRAWING}


RUNS_CODE = {"pickle", "marshal", "shelve", "dill", "cloudpickle", "joblib", "code", "runpy"}


def test_what_could_run_code_of_a_file_is_not_there():
    """`docs/security.md`: a pool of our own processes pickles what goes between them, nothing else does."""
    for path, units in IMPORTS.items():
        assert not units & RUNS_CODE, path.name
        text = path.read_text()
        assert not re.search(r"\b(eval|exec)\(|allow_pickle=True|shell=True|os\.system\(", text), path.name
        assert "verify=False" not in text, path.name


def test_imports_run_one_way():
    """Between packages there is no circle; the package itself, which only names its public parts, is left out."""
    graph = {}
    for path, units in IMPORTS.items():
        own = unit(module_name(path))
        if own != "fg_nav":
            graph.setdefault(own, set()).update(units & UNITS - {own})
    assert len(graph) > 20
    TopologicalSorter(graph).prepare()


def test_modules_of_the_smoother_import_one_way():
    """Nor is there a circle between its modules, imports for types alone counted too."""
    graph = {}
    for path in LIBRARY:
        name = module_name(path)
        if name.startswith("fg_nav.smoother."):
            imports = (node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.ImportFrom))
            graph[name] = {node.module for node in imports if node.module.startswith("fg_nav.smoother.")}
    TopologicalSorter(graph).prepare()


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


SLOW = {
    "scipy.stats",
    "scipy.signal",
    "scipy.spatial",
    "scipy.optimize",
    "scipy.sparse",
    "matplotlib",
    "pydantic",
}
"""Each takes a tenth of a second to half of one to load."""


def test_a_walk_on_a_foot_needs_neither_pocket_nor_laboratory_nor_what_is_slow_to_load(tmp_path):
    from fg_nav.io import write_canonical
    from fg_nav.lab.simulation import simulate

    file = tmp_path / "walk.csv"
    write_canonical(simulate("demo", 1).recording.slice(0, 2000), file)
    loaded = loaded_by(
        "import fg_nav; from fg_nav.pipeline import navigate; "
        f"fg_nav.navigate({str(file)!r}, options=fg_nav.Options(mount='foot')).save({str(tmp_path / 'out')!r})"
    )
    assert {"fg_nav.smoother.batch", "fg_nav.report.page"} <= loaded
    # A walk with a magnetometer is calibrated by itself, which looks up who came by a place again in a tree.
    assert not loaded & SLOW - {"scipy.spatial", "scipy.sparse"}
    assert not [name for name in loaded if name.startswith(("fg_nav.pocket", "fg_nav.lab"))]


def list_names(tree):
    """Names that the body of a module assigns or defines, as often as it does."""
    names = []
    for node in tree.body:
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            names.append(node.name)
        elif isinstance(node, (ast.Assign, ast.AnnAssign)):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            parts = [part for target in targets for part in ast.walk(target) if isinstance(part, ast.Name)]
            names += [part.id for part in parts if isinstance(part.ctx, ast.Store)]
    return names


def test_no_module_assigns_a_name_twice():
    """Where two chapters are merged one constant could replace another, which ruff does not see."""
    for path in LIBRARY:
        names = list_names(ast.parse(path.read_text()))
        assert not {name for name in names if names.count(name) > 1}, path.name


def our_files():
    """Files of the project, as git knows them where it is there."""
    try:
        listed = subprocess.run(
            ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=True,
        ).stdout.splitlines()
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
def stop():
    sys.setprofile(None)
    print(len(seen))
"""


def count_files(code, *arguments):
    """Files of the library of which `code` runs a function between start() and stop(), in a process of its own."""
    command = [sys.executable, "-c", FILES_PASSED + code, *map(str, arguments)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    return int(done.stdout.splitlines()[-1])


RUN = """
from fg_nav import cli
sys.argv = ["fg-nav", "run", sys.argv[1], "--out", sys.argv[2], "--quiet"]
start()
try:
    cli.main()
except SystemExit as left:
    assert not left.code
stop()
"""

FOOTFALL = """
from fg_nav import read
from fg_nav.online import OnlineNavigator
walk, at = read(sys.argv[1]), 0
def push_until(footfalls):
    global at
    while len(navigator.footfalls) < footfalls:
        part = slice(at, at + 10)
        navigator.push(walk.t[part], walk.acc[part], walk.gyr[part], walk.mag[part])
        at += 10
navigator = OnlineNavigator(background=True)
push_until(8)
start()
push_until(9)
stop()
navigator.close()
"""


def test_the_way_through_the_files_is_within_its_budget(tmp_path):
    """How many files a reader has to open who follows a recording through `run`, or one footfall online."""
    from fg_nav.io import write_canonical
    from fg_nav.lab.simulation import simulate

    file = tmp_path / "walk.csv"
    write_canonical(simulate("demo", 1).recording.slice(0, 4000), file)
    counts = {
        "fg-nav run": [count_files(RUN, file, tmp_path / "out")],
        "one footfall online": [count_files(FOOTFALL, file)],
    }
    budget = read_budget("way")
    assert budget.keys() == counts.keys()
    assert {name: counts[name] for name in budget if not is_within(counts[name], budget[name])} == {}
