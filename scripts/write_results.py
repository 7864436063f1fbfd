"""Every table of README and docs that has results in it, written from the store, `docs/results`.

    python scripts/write_results.py             write `docs/results.md` and the tables between marks in other pages
    python scripts/write_results.py --check     exit with 1 where a page is not what would be written

============================================= ======================================================================
`ma2018`, `aiez2017`, `munoz-diaz2017` .json  results.json of `fg-nav lab reproduce PAPER`
`benchmark.json`                              the peers, by `benchmark_peers.py` of commit b894e160
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
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import harness
from experiments import Block, Table, sum_up, write_row, write_table
from measure import EXPERIMENTS, ROOT

from fg_nav.errors import OutputError
from fg_nav.lab.reproduce.results import (
    HIGH_PERCENT,
    LOW_PERCENT,
    MEANINGS,
    TOLERANCE,
    VERDICTS,
    Experiment,
    Reproduction,
    Row,
    count_verdicts,
    describe_counts,
    format_name,
    format_note,
    format_printed,
    format_seeds,
    format_spread,
    read_reproduction,
)
from fg_nav.lab.store.files import write_text
from fg_nav.report.terminal import console

HEAD = f"""# The papers' figures and ours

Written by `scripts/write_results.py`, never by hand, from the files in `docs/results`. All walks are simulated. A
figure is the median over the walks, with {LOW_PERCENT:.0f} to {HIGH_PERCENT:.0f} % behind it. The column that is \
judged, by its median,
is in bold: the paper's own method as printed; of munoz-diaz2017, which as printed goes off by tens of degrees, the
filter with misprints corrected and gravity as a mean over two strides. Ours is without the places that the smoother now
recognizes: what these change on such walks is in measured.md. Verdicts:
"""

POCKET = "munoz-diaz2017"


@dataclass(frozen=True)
class Line:
    """A line of another page: paper, experiment, what it is, and the rows that it is of, such as one a field."""

    paper: str
    experiment: str
    what: str
    rows: Sequence[str]


def _of(experiment: str, *rows: str) -> list[Line]:
    """Lines of the pocket's paper, of one row each."""
    return [Line(POCKET, experiment, "", [row]) for row in rows]


def _fields(paper: str, experiment: str, row: str) -> Line:
    return Line(paper, experiment, f"{row}, smooth / indoor", [f"{row}, {field}" for field in ("smooth", "indoor")])


HEADLINES = {
    "README.md": [
        _fields("ma2018", "M-E3", "final position error, proposed"),
        _fields("ma2018", "M-E4", "mean error at 42 landmarks, proposed"),
        _fields("aiez2017", "Z-E2", "position error, AIEZ"),
        *_of("D-E6", "both updates: displacement after it"),
    ],
    "docs/pocket.md": [
        *_of("D-E1", "z off zero at the end, truly 0.1"),
        *_of("D-E2", *(f"z is at -0.08 deg/s after, {site}" for site in ("north-pole", "equator", "munich"))),
        *_of("D-E2", "z at the end, north-pole, truly -0.1"),
        *_of("D-E3", "detector: z is at -0.08 deg/s after"),
        *_of("D-E3", "detector, MD (21) as printed: z is at -0.08 deg/s after"),
        *_of("D-E5", "uncalibrated: z off at most, after 3 min"),
        *_of(
            "D-E6",
            *(
                f"{how}: {what}"
                for how in ("both updates", "gravity only")
                for what in ("yaw error after the first round trip", "displacement after it")
            ),
        ),
    ],
}
"""Lines of other pages."""

BESIDE = {"README.md": ("tuned", "matched, both ways")}  # Columns that stand there between the paper's method and ours.
OURS = ("smoother", "online", "graph")  # Columns that they show beside the paper's method: the first there is.

FOLDER = Path("docs/results")
PAPERS = ("ma2018", "aiez2017", "munoz-diaz2017")
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
    for page, text in write_pages(chosen.root).items():
        if chosen.check and read_page(page).replace(CHANGED, "") != text.replace(CHANGED, ""):
            raise OutputError(f"{page} is not what is written from the files in {FOLDER}: run this without --check.")
        if not chosen.check:
            write_text(page, text)
        console().print(f"{'as written' if chosen.check else 'written'}: {page}", soft_wrap=True)


def write_pages(root: Path) -> dict[Path, str]:
    """Text of every page that has results in it."""
    papers = [read_reproduction(root / FOLDER / f"{name}.json") for name in PAPERS]
    blocks = {"papers": headlines(papers, "README.md"), "pocket": headlines(papers, "docs/pocket.md")}
    blocks |= {name: lines for path in sorted((root / FOLDER).glob("*.json")) for name, lines in write_blocks(path)}
    pages = [root / "README.md", *sorted((root / "docs").glob("*.md"))]
    found = {page: fill_marks(read_page(page), blocks) for page in pages if MARKED.search(read_page(page))}
    return {root / "docs" / "results.md": document(papers), **found}


def read_page(page: Path) -> str:
    """Text of a page; none where it is not there."""
    return page.read_text(encoding="utf-8") if page.exists() else ""


def write_blocks(path: Path) -> Iterator[tuple[str, list[str]]]:
    """Yield the tables of a file of the store: an experiment's own, and the sums of all its columns by its name."""
    if path.stem not in (*EXPERIMENTS, "benchmark"):
        return
    content = json.loads(path.read_text(encoding="utf-8"))
    if path.stem == "benchmark":
        yield "peers", write_peers(content["peers"])
        return
    experiment, table = EXPERIMENTS[path.stem], Table(content["rows"])

    def write_sums(table: Table) -> list[str]:
        heads, *rows = sum_up(table, experiment.columns)
        return write_table(heads, rows, words=2)

    blocks: Mapping[str, Block] = {path.stem: write_sums, **experiment.blocks}
    for name, write in blocks.items():
        yield name, [*write(table), "", describe_stamps(path.stem, content["made"])]


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


PEER_COLUMNS = {
    "walks": ("walks", "{}"), "over_bare": ("over the bare loop", "{:.2f}"), "us_a_sample": ("us a sample", "{:.2f}"),
    "rmse_2d_m": ("2-D (m)", "{:.3f}"), "rmse_3d_m": ("3-D (m)", "{:.3f}"), "closure_m": ("start to end (m)", "{:.2f}"),
    "heading_deg": ("heading (deg)", "{:.2f}"), "inclination_deg": ("inclination (deg)", "{:.2f}"),
}  # fmt: skip


def write_peers(peers: Sequence[Mapping[str, Any]]) -> list[str]:
    """Write speed, errors and scope of each program, one row a set."""
    lines = [write_row(["set", "program", *(head for head, _ in PEER_COLUMNS.values()), "leaves out"])]
    lines.append("|---|---|" + "---:|" * len(PEER_COLUMNS) + "---|")
    for row in peers:
        cells = ["-" if row[name] is None else pattern.format(row[name]) for name, (_, pattern) in PEER_COLUMNS.items()]
        scope = f"not measured: {row['missing']}" if row["over_bare"] is None else row["leaves_out"]
        lines.append(write_row([row["set"], f"{row['method']} {row['version']}".strip(), *cells, scope]))
    return lines


# --- the papers ------------------------------------------------------------------------------------------------------


def document(found: Sequence[Reproduction]) -> str:
    """Return the page."""
    meanings = [f"* {verdict}: {meaning}" for verdict, meaning in MEANINGS.items()]
    lines = [
        HEAD,
        *meanings,
        "",
        f"The tolerance is {100 * TOLERANCE:.0f} % unless a row has its own.",
        "",
    ]
    lines += ["| paper | seeds | " + " | ".join(VERDICTS) + " |", "|---|---|" + "---|" * len(VERDICTS)]
    lines += [_counts(one) for one in found]
    for one in found:
        lines += ["", *_paper(one)]
    return "\n".join(lines) + "\n"


def _counts(found: Reproduction) -> str:
    return (
        f"| {found.paper} | {format_seeds(found)} | "
        + " | ".join(str(n) for n in count_verdicts(found).values())
        + " |"
    )


def _paper(found: Reproduction) -> Iterator[str]:
    yield f"## {found.paper}"
    yield from ("", found.citation, "", f"`{found.command}`, seeds {format_seeds(found)}. {describe_counts(found)}")
    yield from ("", "With " + ", ".join(f"{name} {number}" for name, number in found.versions.items()) + ".")
    for experiment in found.experiments:
        yield from ("", f"### {experiment.name}: {experiment.title}", "", experiment.setting, "")
        yield from _table(experiment, len(found.seeds))
    yield from ("", "### What differs", "")
    yield "\n\n".join(found.differs)


def _table(experiment: Experiment, walks: int) -> Iterator[str]:
    yield write_row(["", "paper", *experiment.columns, "verdict"])
    yield "|---|" + "---:|" * (1 + len(experiment.columns)) + "---|"
    for row in experiment.rows:
        ours = [_figure(row, column, walks) for column in experiment.columns]
        verdict = f"**{row.verdict}**" if row.verdict else ""
        yield write_row(
            [
                format_name(row),
                format_printed(row),
                *ours,
                ": ".join(word for word in (verdict, format_note(row)) if word),
            ]
        )


def _figure(row: Row, column: str, walks: int) -> str:
    figure = format_spread(row, column, walks)
    return f"**{figure}**" if column == row.judged and row.verdict else figure


def headlines(found: Sequence[Reproduction], page: str) -> list[str]:
    """Return the lines of another page, of the papers that are there."""
    beside = BESIDE.get(page, ())
    lines = [write_row(["", "paper", "its method here", *beside, "ours"]), "|---|" + "---:|" * (3 + len(beside))]
    by_name = {(one.paper, experiment.name): (one, experiment) for one in found for experiment in one.experiments}
    there = (line for line in HEADLINES[page] if (line.paper, line.experiment) in by_name)
    return [*lines, *(_headline(*by_name[line.paper, line.experiment], line, beside) for line in there)]


def _headline(found: Reproduction, experiment: Experiment, line: Line, beside: Sequence[str]) -> str:
    rows = [_row_named(found, experiment, name) for name in line.rows]
    first, walks = rows[0], len(found.seeds)
    ours = next((column for column in OURS if column in first.ours), "")
    what = format_name(replace(first, quantity=line.what or first.quantity))
    figures = [_figures(rows, column, walks) for column in (first.judged, *beside, ours)]
    return write_row([f"{found.paper}, {experiment.name}: {what}", format_printed(first), *figures])


def _row_named(found: Reproduction, experiment: Experiment, name: str) -> Row:
    row = next((row for row in experiment.rows if row.quantity == name), None)
    if row is None:
        raise OutputError(f"{found.paper} has no row '{name}' in {experiment.name}: see HEADLINES in the script.")
    return row


def _figures(rows: Sequence[Row], column: str, walks: int) -> str:
    """Of one row with its spread, of several the medians."""
    figures = [format_spread(row, column, walks) for row in rows]
    return figures[0] if len(figures) == 1 else " / ".join(figure.partition(" (")[0] for figure in figures)


if __name__ == "__main__":
    harness.run(main)
