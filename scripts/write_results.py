"""Every table of README and docs that has results in it, written from the store, `docs/results`.

    python scripts/write_results.py             write `docs/results.md` and the tables between marks in other pages
    python scripts/write_results.py --check     exit with 1 where a page is not what would be written

============================================= ======================================================================
`ma2018`, `aiez2017`, `munoz-diaz2017` .json  results.json of `fg-nav lab reproduce PAPER`
any other                                     `python scripts/measure.py NAME --save`
============================================= ======================================================================

A table in a page stands between `<!-- written: NAME -->` and `<!-- end -->`. Below it is when, at which commit and on
which seeds it was measured, and whether the code has changed since, as the checkout shows it: `--check` asks for all
but that.
"""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TypeAlias

import harness
from experiments import Table, write_table
from measure import EXPERIMENTS, ROOT

from fg_nav.errors import OutputError
from fg_nav.lab.reproduce import results
from fg_nav.lab.reproduce.results import Experiment, Reproduction, format_name, format_printed, format_spread
from fg_nav.lab.store.files import write_text
from fg_nav.report.terminal import console

HEAD = f"""# The papers' figures and ours

Written by `scripts/write_results.py`, never by hand, from the files in `docs/results`. All walks are simulated. A
figure is the median over the walks, with {results.LOW_PERCENT:.0f} to {results.HIGH_PERCENT:.0f} % behind it. \
The column that is judged, by its median,
is in bold: the paper's own method as printed; of munoz-diaz2017, which as printed goes off by tens of degrees, the
filter with misprints corrected and gravity as a mean over two strides. Ours is without the places that the smoother now
recognizes: what these change on such walks is in measured.md. Verdicts:
"""

POCKET = "munoz-diaz2017"


Line: TypeAlias = tuple[str, str, str, Sequence[str]]
"""A line of another page: paper, experiment, what it is, and the rows that it is of, such as one a field."""


def over_fields(paper: str, experiment: str, row: str) -> Line:
    """A line of both fields."""
    return paper, experiment, f"{row}, smooth / indoor", [f"{row}, {field}" for field in ("smooth", "indoor")]


POCKET_ROWS = {
    "D-E1": ["z off zero at the end, truly 0.1"],
    "D-E2": [*(f"z is at -0.08 deg/s after, {site}" for site in ("north-pole", "equator", "munich")),
             "z at the end, north-pole, truly -0.1"],
    "D-E3": ["detector: z is at -0.08 deg/s after", "detector, MD (21) as printed: z is at -0.08 deg/s after"],
    "D-E5": ["uncalibrated: z off at most, after 3 min"],
    "D-E6": [f"{how}: {what}" for how in ("both updates", "gravity only")
             for what in ("yaw error after the first round trip", "displacement after it")],
}  # fmt: skip
HEADLINES: Mapping[str, list[Line]] = {
    "README.md": [
        over_fields("ma2018", "M-E3", "final position error, proposed"),
        over_fields("ma2018", "M-E4", "mean error at 42 landmarks, proposed"),
        over_fields("aiez2017", "Z-E2", "position error, AIEZ"),
        (POCKET, "D-E6", "", ["both updates: displacement after it"]),
    ],
    "docs/pocket.md": [(POCKET, name, "", [row]) for name, rows in POCKET_ROWS.items() for row in rows],
}
"""Lines of other pages."""

BESIDE = {"README.md": ("tuned", "matched, both ways")}  # Columns that stand there between the paper's method and ours.
OURS = ("smoother", "online", "graph")  # Columns that they show beside the paper's method: the first there is.

FOLDER = Path("docs/results")
CHANGED = " The code has changed since."

MARKED = re.compile(r"(<!-- written: ([\w-]+) -->\n).*?(<!-- end -->)", re.DOTALL)


def main(arguments: Sequence[str] | None = None) -> None:
    """Write or check all pages."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        check=harness.option(False, "refuse pages that are not what would be written"),
        root=harness.option(ROOT, "of the project", type=Path, metavar="DIR"),
    )
    root: Path = chosen.root
    # the papers, and the tables that experiments make of their files in the store
    papers = [results.read_reproduction(root / FOLDER / f"{name}.json") for name in results.PAPERS]
    blocks = {"papers": headlines(papers, "README.md"), "pocket": headlines(papers, "docs/pocket.md")}
    for name, experiment in EXPERIMENTS.items():
        path = root / FOLDER / f"{name}.json"
        if experiment.blocks and path.exists():
            content = json.loads(path.read_text(encoding="utf-8"))
            stamps = ["", describe_stamps(name, content["made"])] if content["made"] else []
            blocks |= {mark: [*write(Table(content["rows"])), *stamps] for mark, write in experiment.blocks.items()}
    # the pages with marks, and the papers' own
    old = {page: page.read_text(encoding="utf-8") for page in (root / "README.md", *sorted(root.glob("docs/*.md")))}
    new = {page: fill_marks(text, blocks) for page, text in old.items() if MARKED.search(text)}
    for page, text in {root / "docs" / "results.md": document(papers), **new}.items():
        if chosen.check and old.get(page, "").replace(CHANGED, "") != text.replace(CHANGED, ""):
            raise OutputError(f"{page} is not what is written from the files in {FOLDER}: run this without --check.")
        if not chosen.check:
            write_text(page, text)
        console().print(f"{'as written' if chosen.check else 'written'}: {page}", soft_wrap=True)


def describe_stamps(name: str, made: Mapping[str, Mapping[str, str]]) -> str:
    """Write when, at which commits and on which seeds it was measured, and whether the code has changed since."""
    dates, commits, seeds = (
        list(dict.fromkeys(one[key] for one in made.values() if one.get(key))) for key in ("date", "commit", "seeds")
    )
    words = [f"`scripts/measure.py {name}`, {' and '.join(dates)}", f"commit {' and '.join(commits)}"]
    words += [f"seeds {' and '.join(seeds)}"] if seeds else []
    return f"*{', '.join(words)}.{CHANGED if any(map(has_changed, commits)) else ''}*"


@cache
def has_changed(commit: str) -> bool:
    """Whether the package differs from a commit; unknown, as in a copy without its history, is no."""
    command = ["git", "diff", "--quiet", commit.removesuffix("+"), "--", "fg_nav", "factors"]
    return subprocess.run(command, cwd=ROOT, capture_output=True).returncode == 1


def fill_marks(text: str, blocks: Mapping[str, Sequence[str]]) -> str:
    """Return the page with the blocks between its marks."""

    def fill(mark: re.Match[str]) -> str:
        if mark[2] not in blocks:
            raise OutputError(f"there is no block '{mark[2]}': choose one of {', '.join(blocks)}.")
        lines = "\n".join(blocks[mark[2]])
        return f"{mark[1]}\n{lines}\n\n{mark[3]}"

    return MARKED.sub(fill, text)


# --- the papers ------------------------------------------------------------------------------------------------------


def document(found: Sequence[Reproduction]) -> str:
    """Return the page."""
    lines = [HEAD, *(f"* {verdict}: {meaning}" for verdict, meaning in results.MEANINGS.items()), ""]
    lines += [f"The tolerance is {100 * results.TOLERANCE:.0f} % unless a row has its own.", ""]
    counts = [[one.paper, results.format_seeds(one), *map(str, results.count_verdicts(one).values())] for one in found]
    lines += write_table(["paper", "seeds", *results.VERDICTS], counts, words=2)
    for one in found:
        lines += ["", f"## {one.paper}", "", one.citation, ""]
        lines += [f"`{one.command}`, seeds {results.format_seeds(one)}. {results.describe_counts(one)}", ""]
        lines += ["With " + ", ".join(f"{name} {number}" for name, number in one.versions.items()) + "."]
        for experiment in one.experiments:
            lines += ["", f"### {experiment.name}: {experiment.title}", "", experiment.setting, ""]
            lines += write_experiment(experiment, len(one.seeds))
        lines += ["", "### What differs", "", "\n\n".join(one.differs)]
    return "\n".join(lines) + "\n"


def write_experiment(experiment: Experiment, walks: int) -> list[str]:
    """Return the table of an experiment; the judged column of a row is in bold."""
    rows = []
    for row in experiment.rows:
        figures = {column: format_spread(row, column, walks) for column in experiment.columns}
        if row.verdict and row.judged in figures:
            figures[row.judged] = f"**{figures[row.judged]}**"
        words = [f"**{row.verdict}**" if row.verdict else "", results.format_note(row)]
        rows.append([format_name(row), format_printed(row), *figures.values(), ": ".join(filter(None, words))])
    return write_table(["", "paper", *experiment.columns, "verdict"], rows, last=1)


def headlines(found: Sequence[Reproduction], page: str) -> list[str]:
    """Return the lines of another page, of one row with its spread, of several their medians."""
    beside = BESIDE.get(page, ())
    lines = list[list[str]]()
    by_name = {(one.paper, experiment.name): (one, experiment) for one in found for experiment in one.experiments}
    for paper, name, what, wanted in HEADLINES[page]:
        if (paper, name) not in by_name:
            continue
        reproduction, experiment = by_name[paper, name]
        known = {row.quantity: row for row in reversed(experiment.rows)}
        for missing in [row for row in wanted if row not in known]:
            raise OutputError(f"{paper} has no row '{missing}' in {name}: see HEADLINES in the script.")
        rows = [known[row] for row in wanted]
        first, figures = rows[0], list[str]()
        ours = next((column for column in OURS if column in first.ours), "")
        for column in (first.judged, *beside, ours):
            some = [format_spread(row, column, len(reproduction.seeds)) for row in rows]
            figures.append(some[0] if len(some) == 1 else " / ".join(one.partition(" (")[0] for one in some))
        words = f"{paper}, {name}: {format_name(replace(first, quantity=what or first.quantity))}"
        lines.append([words, format_printed(first), *figures])
    return write_table(["", "paper", "its method here", *beside, "ours"], lines)


if __name__ == "__main__":
    harness.run(main)
