"""Broken inputs of every kind, given to the program: nothing may crash, hang, or come out wrong without a word.

    python scripts/fuzz.py [--inputs N] [--seed N] [--minutes M] [--jobs N] [--only KIND ...]
        [--limit S] [--bases DIR] [--json FILE]
    python scripts/fuzz.py --only KIND --seed N --case K [--keep DIR]

=========== ==========================================================================================================
samples     pieces of 3 to 25 s of real and simulated recordings, their samples wrong (`fuzz_mutations`)
format      such pieces in each of the formats that are read, the file damaged
real        real files, and folders of files that belong together, damaged
stream      rows on standard input of `fg-nav stream`, wrong as samples or as text
record      a walk resumed from a record that is damaged, its samples or its lines
truth, fixes, calibration, config, scenario    files that go with a walk, damaged or absurd
options     words of the command line that cannot be meant
=========== ==========================================================================================================

What is done to them breaks their form (`fuzz_mutations`), or leaves it readable with other numbers (`fuzz_variations`).
Methods are drawn among the smoother, filters with and without a compass, online and pocket. Each input is run by the
entry point of the command line (`fuzz_cases` says what is held against its answer) in one of `--jobs` processes, which
may die. A fault is printed with what shows it again: the second call above runs one case in this process, prints what
it did, and leaves its files and its result in `--keep`.
"""

from __future__ import annotations

import contextlib
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import takewhile
from pathlib import Path

import harness
import numpy as np
import walks
from fuzz_cases import KINDS, Case, Fate, prepare_process, run_case
from fuzz_inputs import Store
from fuzz_pool import Pool
from harness import Figure, option

from fg_nav.errors import FgNavError, SimulationError
from fg_nav.report.terminal import progress
from fg_nav.verdict import UNUSABLE

FAULTS = ("crash", "hang", "exception", "warning", "not finite", "sigma", "absurd")
"""First words of faults, each a figure that is asked to be zero; all others are `other`."""


TOLD_EVERY = 250  # Inputs, after which it is said how far it is.


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
        limit=option(180.0, "seconds an input may take, on the wall", metavar="S"),
        bases=option(None, "keep clean inputs here from run to run", type=Path, metavar="DIR"),
        data=None,
        json=None,
    )
    with contextlib.ExitStack() as opened:
        folder = Path(opened.enter_context(tempfile.TemporaryDirectory(prefix="fg-nav-fuzz-")))
        store = open_store(chosen.bases or folder, chosen.data)
        if chosen.case is not None:
            show_case(Case(only_kind(chosen.only), chosen.seed, chosen.case), store, chosen.keep)
            return
        cases = list(draw_cases(chosen.only or list(KINDS), chosen.inputs, chosen.seed))
        due = np.inf if chosen.minutes is None else time.monotonic() + 60.0 * chosen.minutes
        fates = run_all(cases, store, chosen.jobs, chosen.limit, folder, due)
    harness.print_heading(f"{len(fates)} inputs, seed {chosen.seed}")
    print_fates(fates)
    figures = list(judge_all(fates))
    harness.print_figures(figures)
    harness.print_verdict(figures, chosen.json, faults=[describe_fault(fate) for fate in fates if fate.faults])


def open_store(folder: Path, data: Path | None) -> Store:
    """Open the clean inputs, made where they are not there yet."""
    folder.mkdir(parents=True, exist_ok=True)
    try:
        return Store(folder, walks.data_folder(data))
    except FgNavError:
        if data is not None:
            raise
        print("the real recordings are not at hand: simulated ones only.")
        return Store(folder, None)


def only_kind(only: Sequence[str] | None) -> str:
    """Return the one kind that was asked for; raises `SimulationError` where that is not one."""
    if only is None or len(only) != 1:
        raise SimulationError("--case is of one kind: name it with --only.")
    return str(only[0])


def draw_cases(kinds: Sequence[str], inputs: int, seed: int) -> Iterator[Case]:
    """Yield cases, one kind after the other in turn, so that each has its share at any moment."""
    shares = np.array([KINDS[kind][0] for kind in kinds], dtype=np.float64)
    wanted, given = shares / shares.sum(), np.zeros(len(kinds))
    for k in range(inputs):
        one = int(np.argmax(wanted * (k + 1) - given))
        yield Case(kinds[one], seed, int(given[one]))
        given[one] += 1


def run_all(
    cases: Sequence[Case], store: Store, jobs: int, limit_s: float, folder: Path, due_s: float = np.inf
) -> list[Fate]:
    """Run cases on processes that may die, until a time of the monotonic clock; each fault is printed as it comes."""
    pool: Pool[Case, Fate] = Pool(partial(run_in_worker, store), note_death, jobs, limit_s, folder)
    fates = []
    with progress(f"fuzz: {len(cases)}") as report:
        for fate in pool.map(takewhile(lambda _: time.monotonic() < due_s, cases)):
            fates.append(fate)
            if fate.faults:
                print(describe_fault(fate), flush=True)
            report(len(fates) / len(cases))
            if len(fates) % TOLD_EVERY == 0:
                print(f"{len(fates)} inputs, {sum(bool(one.faults) for one in fates)} with faults", flush=True)
    return sorted(fates, key=lambda fate: (list(KINDS).index(fate.case.kind), fate.case.number))


def run_in_worker(store: Store, case: Case) -> Fate:
    """Run a case in a process that is there for nothing else."""
    prepare_process()
    return run_case(case, store)


def note_death(case: Case, words: str) -> Fate:
    """Return the fate of a case that took its process with it."""
    return Fate(case, faults=[words])


def show_case(case: Case, store: Store, keep: Path | None) -> None:
    """Run one case here, and print what it did."""
    prepare_process()
    fate = run_case(case, store, keep)
    print(f"{fate.what}\n{fate.command}\n{fate.outcome}: {fate.said} ({fate.seconds:.2f} s)")
    for fault in fate.faults:
        print(fault)


def print_fates(fates: Sequence[Fate]) -> None:
    """Print the table of kinds."""
    rows = [_kind_row(kind, [fate for fate in fates if fate.case.kind == kind]) for kind in KINDS]
    rows = [row for row in rows if row[1] != "0"]
    harness.print_table(
        ("kind", "inputs", "refused", "accepted", "trusted", "doubtful", UNUSABLE, "faults", "CPU s", "longest"),
        [*rows, _kind_row("all", fates)],
    )


def _kind_row(kind: str, fates: Sequence[Fate]) -> list[str]:
    outcomes, said = Counter(fate.outcome for fate in fates), Counter(fate.said for fate in fates)
    seconds = [fate.seconds for fate in fates] or [0.0]
    counts = [outcomes["refused"], outcomes["accepted"], said["trusted"], said["doubtful"], said[UNUSABLE]]
    counts = [len(fates), *counts, sum(bool(fate.faults) for fate in fates)]
    return [kind, *map(str, counts), f"{np.median(seconds):.2f}", f"{max(seconds):.1f}"]


def describe_fault(fate: Fate) -> str:
    """Say in a line what is wrong, and how to see it again."""
    case = fate.case
    again = f"--only {case.kind} --seed {case.seed} --case {case.number}"
    return f"{again}: {'; '.join(fate.faults)[:400]} ({fate.what}; {fate.command})"


def judge_all(fates: Sequence[Fate]) -> Iterator[Figure]:
    """Yield how many faults of each sort there are: none is asked."""
    sorts = [next((sort for sort in FAULTS if fault.startswith(sort)), "other") for f in fates for fault in f.faults]
    for sort in (*FAULTS, "other"):
        yield Figure("fuzz", sort, "all", float(sorts.count(sort)), high=0.0, pattern="{:.0f}")


if __name__ == "__main__":
    harness.run(main)
