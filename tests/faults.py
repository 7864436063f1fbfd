"""Faults put into the code, one at a time, to see whether the tests catch them.

`tests/faults.txt` has one a line, sorted: `file | old text | new text`, of which the old one is in the file once. It is
put into a copy of the package, and the tests of the checkout run against that to the first failure: those of its own
package, then of packages that use it, then all others. Nothing is kept.

`tests/equations.txt` has one for each row of docs/equations.md, in its order, that begins with the row's equation: it
breaks what the equation says in the code of the row, and the row's own tests alone must catch it. From the checkout:

    python -m tests.faults --check                        each of both has its place in the code, and is Python
    python -m tests.faults --list --only PATTERN          those with the regular expression in their line
    python -m tests.faults --sample 10 --seed 3 --jobs 2  ten of them by chance, two at a time
    python -m tests.faults --equations                    those of the equations
    python -m tests.faults --file OTHER.txt               those of another list

A line a fault says which test caught it, and after how long; the last lines count by package, and all.
"""

import argparse
import ast
import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import NamedTuple

from tests.test_equations import ROWS, places_in

ROOT = Path(__file__).parents[1]
LIST, EQUATIONS = ROOT / "tests/faults.txt", ROOT / "tests/equations.txt"
TESTS = {row[0]: [f"tests/{file}::{name}" for file, name in places_in(row[3])] for row in ROWS if places_in(row[3])}
BUDGET = "tests/test_laws.py::test_no_package_is_over_its_budget"  # Counts lines.
CAUGHT, NOT_CAUGHT, UNDECIDED = "caught", "NOT CAUGHT", "NOT DECIDED"
FIRST = {"factors": "factors smoother", "cli": "commands"}  # Tests of a package that are not in a folder of its name.
NEXT = {  # Tests of packages that use it.
    "detection": "ekf magnetic verdict smoother",
    "fg_nav": "ekf smoother pocket io commands",
    "lab": "lab commands",
    "magnetic": "ekf calibration smoother",
    "samples": "test_ io online",
}
OTHERS = "smoother online places feet commands test_"  # Of all other packages.
say = partial(print, flush=True)


class Fault(NamedTuple):
    file: str
    old: str
    new: str
    row: str = ""  # Equation of the row that it breaks.

    def __str__(self) -> str:
        return " | ".join(filter(None, (self.row, *self[:3])))

    @property
    def package(self) -> str:
        return Path(self.file).parts[:-1][:2][-1]


def read_faults(path: Path = LIST) -> list[Fault]:
    lines = (line.split(" | ") for line in path.read_text(encoding="utf-8").splitlines())
    return [Fault(*cells[-3:], *cells[:-3]) for cells in lines]


def find_problems(faults: Iterable[Fault]) -> Iterator[str]:
    for file, old, new, _ in faults:
        text = (ROOT / file).read_text(encoding="utf-8") if (ROOT / file).is_file() else ""
        try:
            ast.parse(text.replace(old, new))
        except SyntaxError as error:
            yield f"{file}: '{new}' is no Python ({error})"
        if text.count(old) != 1:
            yield f"{file}: '{old}' is there {text.count(old)} times"


def find_rows_without_one(faults: Sequence[Fault]) -> Iterator[str]:
    rows = Counter(fault.row for fault in faults)
    for row in TESTS.keys() | rows:
        if rows[row] != 1 or row not in TESTS:
            yield f"'{row}' has {rows[row]} faults, and docs/equations.md {len(TESTS.get(row, ()))} tests of it"


def order_tests(fault: Fault) -> Iterator[list[str]]:
    """Yield the files of tests, stage by stage; of an equation the tests of its row."""
    if fault.row:
        yield TESTS[fault.row]
        return
    left = [path.relative_to(ROOT / "tests").as_posix() for path in sorted((ROOT / "tests").rglob("test_*.py"))]
    parts = Path(fault.file).parts[1:-1]
    while parts and not any(path.startswith("/".join((*parts, ""))) for path in left):
        parts = parts[:-1]
    own = "/".join((*parts, "test_" if parts in ((), ("lab",)) else ""))
    for stage in (FIRST.get(fault.package, own), NEXT.get(fault.package, OTHERS), None):
        chosen = [path for path in left if stage is None or path.startswith(tuple(stage.split()))]
        left = [path for path in left if path not in chosen]
        if chosen:
            yield [f"tests/{path}" for path in chosen]


def put_in(fault: Fault, copy: Path) -> None:
    """Copy the package with the fault in it; what numba compiled comes too, where the fault is not in it."""
    subprocess.run(["cp", "-a", ROOT / "factors", ROOT / "fg_nav", copy], check=True)
    file = copy / fault.file
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace(fault.old, fault.new), encoding="utf-8")
    line = text[: text.index(fault.old)].count("\n") + 1
    functions = [one for one in ast.walk(ast.parse(text)) if isinstance(one, ast.FunctionDef)]
    around = [one for one in functions if one.lineno <= line <= (one.end_lineno or 0)]
    if around and not any("njit" in ast.unparse(word) for one in around for word in one.decorator_list):
        return
    # numba sees that a file has changed, and not that functions of others have its functions and constants in them.
    texts = {path: path.read_text(encoding="utf-8") for path in copy.glob("fg_nav/**/*.py")}
    stale = [file]
    for old in stale:
        words = f"from {'.'.join(old.relative_to(copy).with_suffix('').parts)} import"
        stale += [path for path, of in texts.items() if words in of and "@njit" in of and path not in stale]
    for cache in [cache for path in stale for cache in path.parent.glob(f"__pycache__/{path.stem}.*.nb?")]:
        cache.unlink()


def try_fault(fault: Fault, limit_s: float) -> tuple[str, float]:
    """Return the test that catches a fault, or that none does, and the time, s."""
    began, found = time.monotonic(), NOT_CAUGHT
    with tempfile.TemporaryDirectory(prefix="fg-nav-fault-", ignore_cleanup_errors=True) as folder:
        copy = Path(folder)
        put_in(fault, copy)
        for tests in order_tests(fault):
            found = run_tests(tests, copy, limit_s)
            if found != NOT_CAUGHT:
                break
    return found, time.monotonic() - began


def run_tests(tests: Sequence[str], copy: Path, limit_s: float) -> str:
    """Run tests of the checkout against the copy of the package; they write into the copy alone."""
    places = {"PYTHONPATH": f"{copy}{os.pathsep}{ROOT}", "HYPOTHESIS_STORAGE_DIRECTORY": f"{copy}/hypothesis"}
    places["PYTHONSAFEPATH"] = "1"  # other processes of a test run the copy too
    words = ["-x", "-rfE", "--tb=no", "-p", "no:cacheprovider", f"--basetemp={copy}/tests", f"--deselect={BUDGET}"]
    command = [sys.executable, "-P", "-m", "pytest", *words, *tests]
    with (copy / "said.txt").open("w+") as said:
        try:
            ended = subprocess.run(
                command, cwd=ROOT, env=os.environ | places, stdout=said, stderr=said, timeout=limit_s
            )
        except subprocess.TimeoutExpired:
            return f"{UNDECIDED}, it took too long"
        said.seek(0)
        failed = re.search(r"^(?:FAILED|ERROR) (.*?)(?: - |$)", said.read(), re.MULTILINE)
    if failed or (ended.returncode < 0 and ended.returncode != -signal.SIGTERM):  # which somebody sends
        return failed[1] if failed else f"a crash by signal {-ended.returncode}"
    return NOT_CAUGHT if ended.returncode == 0 else f"{UNDECIDED}, pytest ended with {ended.returncode}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--file", type=Path, default=LIST)
    parser.add_argument("--equations", action="store_const", const=EQUATIONS, dest="file")
    parser.add_argument("--only", default="", metavar="PATTERN")
    parser.add_argument("--sample", type=int, default=sys.maxsize, metavar="N")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--limit", type=float, default=3000.0, metavar="S", help="of each of the three stages")
    for option in ("--list", "--check"):
        parser.add_argument(option, action="store_true")
    given = parser.parse_args()
    every, of_rows = read_faults(given.file), read_faults(EQUATIONS)
    faults = [fault for fault in every if re.search(given.only, str(fault))]
    faults = sorted(random.Random(given.seed).sample(faults, min(given.sample, len(faults))), key=every.index)
    problems = [*find_problems(dict.fromkeys([*faults, *of_rows])), *find_rows_without_one(of_rows)]
    if given.list or given.check or problems:
        say(*(problems or [fault for fault in faults if given.list]), f"{len(faults)} faults", sep="\n")
        return bool(problems)
    kinds = {kind: Counter[str]() for kind in (NOT_CAUGHT, UNDECIDED, CAUGHT)}
    with ThreadPoolExecutor(given.jobs) as pool:
        tried = pool.map(lambda fault: try_fault(fault, given.limit), faults)
        for fault, (found, took_s) in zip(faults, tried, strict=True):
            kinds[next((kind for kind in kinds if found.startswith(kind)), CAUGHT)][fault.package] += 1
            say(f"{found}, {took_s:.0f} s: {fault}")
    for package in sorted({fault.package for fault in faults}):
        say(f"{package}: {', '.join(f'{count[package]} {kind}' for kind, count in kinds.items())}")
    say(f"all: {', '.join(f'{count.total()} {kind}' for kind, count in kinds.items())}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
