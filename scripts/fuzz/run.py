"""Broken inputs of every kind, given to the program: nothing may crash, hang, or come out wrong without a word.

    python scripts/fuzz/run.py [--inputs N] [--seed N] [--minutes M] [--jobs N] [--only KIND ...]
        [--bases DIR] [--json FILE]
    python scripts/fuzz/run.py --only KIND --seed N --case K [--keep DIR]

samples are pieces of 3 to 25 s of real and simulated recordings, their samples wrong; format, such pieces in each
format that is read, the file damaged; real, real files and folders, damaged; stream, wrong rows on standard input;
record, a walk resumed from a damaged record; truth, fixes, calibration, config, scenario, files that go with a walk;
options, words that cannot be meant. What is done to them stands in `mutations.py`, what is asked of the answer in
`cases.py`. Each input is run in one of `--jobs` processes, which may die. A fault is printed with what shows it again:
the second call runs one case in this process, prints what it did, and leaves its files in `--keep`.
"""

from __future__ import annotations

import faulthandler
import resource
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from threading import local

import numpy as np
import typer

sys.path.append(str(Path(__file__).resolve().parents[1]))

import harness
import walks
from fuzz.cases import KINDS, Case, Fate, Store, run_case
from harness import Figure, option

from fg_nav.errors import FgNavError, SimulationError
from fg_nav.online import follow
from fg_nav.report.terminal import progress
from fg_nav.verdict import UNUSABLE

FAULTS = ("crash", "hang", "exception", "warning", "not finite", "sigma", "absurd", "other")  # none is asked
LIMIT_S = 180.0  # on the wall, of an input
MEMORY_BYTES = 8 << 30  # of address space that a case may take


def main(arguments: Sequence[str] | None = None) -> None:
    """Run it, print the table, the faults and the figures."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        inputs=option(300, "how many, over all kinds by their shares", metavar="N"),
        seed=1,
        jobs=2,
        only=option(None, "these kinds only", nargs="+", choices=list(KINDS), metavar="KIND"),
        case=option(None, "this case only, of one kind", type=int, metavar="K"),
        keep=option(None, "of one case: leave its files here", type=Path, metavar="DIR"),
        minutes=option(None, "begin no more inputs after so long", type=float, metavar="M"),
        bases=option(None, "keep clean inputs here from run to run", type=Path, metavar="DIR"),
        data=None,
        json=None,
    )
    with tempfile.TemporaryDirectory(prefix="fg-nav-fuzz-") as folder:
        store = open_store(chosen.bases or Path(folder), chosen.data)
        if chosen.case is not None:
            if chosen.only is None or len(chosen.only) != 1:
                raise SimulationError("--case is of one kind: name it with --only.")
            fate = run_case(store, Case(chosen.only[0], chosen.seed, chosen.case), chosen.keep)
            print(f"{fate.what}\n{fate.command}\n{fate.outcome}: {fate.said} ({fate.seconds:.2f} s)")
            print(*fate.faults, sep="\n")
            return
        cases = list(draw_cases(chosen.only or list(KINDS), chosen.inputs, chosen.seed))
        due = np.inf if chosen.minutes is None else time.monotonic() + 60.0 * chosen.minutes
        fates = run_all(cases, store, chosen.jobs, LIMIT_S, due)
    harness.print_heading(f"{len(fates)} inputs, seed {chosen.seed}")
    print_fates(fates)
    sorts = [next((sort for sort in FAULTS if words.startswith(sort)), "other") for f in fates for words in f.faults]
    figures = [Figure("fuzz", s, "all", float(sorts.count(s)), high=0.0, pattern="{:.0f}") for s in FAULTS]
    harness.report_figures(figures, chosen.json, faults=[describe_fault(fate) for fate in fates if fate.faults])


def open_store(folder: Path, data: Path | None) -> Store:
    """Open the clean inputs, made where they are not there yet."""
    folder.mkdir(parents=True, exist_ok=True)
    try:
        store = Store(folder.resolve(), walks.data_folder(data))
    except FgNavError:
        if data is not None:
            raise
        print("the real recordings are not at hand: simulated ones only.")
        store = Store(folder.resolve(), None)
    prepare_process()
    if not (folder / "thigh").exists():
        store.make_companions()
    return store


@cache
def prepare_process(log: Path | None = None) -> None:
    """Make this process one that runs cases: bounded memory, no processes of a walk's own, the verbs loaded once."""
    if log is not None:
        faulthandler.enable(log.open("w"))
    with suppress(ValueError):
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, resource.RLIM_INFINITY))
    typer.main.get_command = cache(typer.main.get_command)
    whole = follow.StreamOptions
    # The answers of a walk that is solved again in this process are the same, and it needs no second to start.
    setattr(follow, "StreamOptions", lambda **given: whole(**{**given, "background": False}))  # noqa: B010


def draw_cases(kinds: Sequence[str], inputs: int, seed: int) -> Iterator[Case]:
    """Yield cases, one kind after the other in turn, so that each has its share at any moment."""
    shares = np.array([KINDS[kind][0] for kind in kinds], dtype=np.float64)
    wanted, given = shares / shares.sum(), np.zeros(len(kinds))
    for k in range(inputs):
        one = int(np.argmax(wanted * (k + 1) - given))
        yield Case(kinds[one], seed, int(given[one]))
        given[one] += 1


def run_all(cases: Sequence[Case], store: Store, jobs: int, limit_s: float, due_s: float = np.inf) -> list[Fate]:
    """Run cases until a time of the monotonic clock, each thread with a process of its own; print faults."""
    own, fates, context = local(), list[Fate](), get_context("spawn")

    def run(case: Case) -> Fate | None:
        if time.monotonic() > due_s:
            return None
        if getattr(own, "pool", None) is None:
            own.log = Path(tempfile.mkstemp(dir=store.folder, suffix=".log")[1])
            own.pool = ProcessPoolExecutor(1, context, prepare_process, (own.log,))
            own.pool.submit(prepare_process, own.log).result()  # what it loads is no time of the case
        (process,) = own.pool._processes.values()
        try:
            fate: Fate = own.pool.submit(run_case, store, case).result(limit_s)
            return fate
        except BrokenProcessPool:
            process.join()
            places = [line.strip() for line in own.log.read_text().splitlines() if "/fg_nav/" in line]
            words = f"crash: exit code {process.exitcode} {' '.join(places[:1])}"
        except TimeoutError:
            words = f"hang: more than {limit_s:g} s"
        except Exception as error:  # of the fuzz itself: the input was not made, and the others go on
            return Fate(case, faults=[f"not made: {type(error).__name__}: {error}"])
        process.kill()
        own.pool.shutdown(wait=False)
        own.pool = None
        return Fate(case, faults=[words])

    with ThreadPoolExecutor(jobs) as threads, progress(f"fuzz: {len(cases)}") as report:
        for number, fate in enumerate(threads.map(run, cases), 1):
            report(number / len(cases))
            if fate is not None:
                fates.append(fate)
                if fate.faults:
                    print(describe_fault(fate), flush=True)
    return sorted(fates, key=lambda fate: (list(KINDS).index(fate.case.kind), fate.case.number))


def describe_fault(fate: Fate) -> str:
    """Say in a line what is wrong, and how to see it again."""
    case = fate.case
    again = f"--only {case.kind} --seed {case.seed} --case {case.number}"
    return f"{again}: {'; '.join(fate.faults)[:400]} ({fate.what}; {fate.command})"


def print_fates(fates: Sequence[Fate]) -> None:
    """Print the table of kinds."""
    words, rows = ("refused", "accepted", "trusted", "doubtful", UNUSABLE), []
    for kind in (*KINDS, "all"):
        some = [fate for fate in fates if kind in (fate.case.kind, "all")]
        if not some:
            continue
        said = Counter(word for fate in some for word in (fate.outcome, fate.said))
        counts = [len(some), *(said[word] for word in words), sum(bool(fate.faults) for fate in some)]
        rows.append([kind, *map(str, counts), f"{max((fate.seconds for fate in some), default=0.0):.1f}"])
    harness.print_table(("kind", "inputs", *words, "faults", "longest, s"), rows)


if __name__ == "__main__":
    harness.run(main)
