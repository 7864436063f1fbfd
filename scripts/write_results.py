"""The page `docs/results.md` from the files of `fg-nav reproduce`: every table, with its command and its seeds.

    python scripts/write_results.py RESULTS.json ... --out FILE     write the page
    python scripts/write_results.py RESULTS.json ... --check FILE   exit with 1 where it is not what would be written
    python scripts/write_results.py RESULTS.json ... --lines        print the lines that stand in other pages

The files that the page in the project is made from are kept in `docs/results`, so that it can be checked.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import harness

from fg_nav.errors import OutputError
from fg_nav.lab.reproduce.file import read_reproduction, write_whole
from fg_nav.lab.reproduce.messages import (
    MEANINGS,
    VERDICTS,
    counted,
    counts,
    named,
    printed,
    remark,
    seeds_told,
    told,
)
from fg_nav.lab.reproduce.results import HIGH_PERCENT, LOW_PERCENT, TOLERANCE, Experiment, Reproduction, Row
from fg_nav.report.terminal import console

HEAD = f"""# The papers' figures and ours

Written by `scripts/write_results.py`, never by hand, from the files in `docs/results`. All walks are simulated. A
figure is the median over the walks, with {LOW_PERCENT:.0f} to {HIGH_PERCENT:.0f} % behind it. The column that is \
judged, by its median,
is in bold: the paper's own method as printed; of munoz-diaz2017, which as printed goes off by tens of degrees, the
filter with misprints corrected and gravity as a mean over two strides. Verdicts:
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
        *_of("D-E3", "detector, Eq. 21 as printed: z is at -0.08 deg/s after"),
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

BESIDE = {"README.md": ("tuned", "matched, both ways")}
"""Columns that stand there between the paper's method and ours."""

OURS = ("smoother", "online", "graph")
"""Columns that they show beside the paper's method: the first there is."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Read, write or check."""
    chosen = _parse(arguments)
    found = [read_reproduction(path) for path in chosen.files]
    if chosen.lines:
        for page in HEADLINES:
            console().print("\n".join([f"{page}:", "", *headlines(found, page), ""]), soft_wrap=True)
    if chosen.out:
        write_whole(chosen.out, document(found))
        console().print(f"written: {chosen.out}", soft_wrap=True)
    if chosen.check:
        _check(chosen.check, document(found))


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="The page docs/results.md from the files of `fg-nav reproduce`.")
    parser.add_argument("files", nargs="+", type=Path, metavar="RESULTS.json", help="one a paper, in their order")
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--out", type=Path, metavar="FILE", help="write the page")
    what.add_argument("--check", type=Path, metavar="FILE", help="refuse a page that is not what would be written")
    what.add_argument("--lines", action="store_true", help="print the lines of other pages")
    return parser.parse_args(arguments)


def _check(path: Path, text: str) -> None:
    try:
        there = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        there = ""
    if there != text:
        raise OutputError(f"{path} is not what is written from these files: write it anew with --out.")
    console().print(f"as written: {path}", soft_wrap=True)


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
    return f"| {found.paper} | {seeds_told(found)} | " + " | ".join(str(n) for n in counts(found).values()) + " |"


def _paper(found: Reproduction) -> Iterator[str]:
    yield f"## {found.paper}"
    yield from ("", found.citation, "", f"`{found.command}`, seeds {seeds_told(found)}. {counted(found)}")
    yield from ("", "With " + ", ".join(f"{name} {number}" for name, number in found.versions.items()) + ".")
    for experiment in found.experiments:
        yield from ("", f"### {experiment.name}: {experiment.title}", "", experiment.setting, "")
        yield from _table(experiment, len(found.seeds))
    yield from ("", "### What differs", "")
    yield "\n\n".join(found.differs)


def _table(experiment: Experiment, walks: int) -> Iterator[str]:
    yield _line(["", "paper", *experiment.columns, "verdict"])
    yield "|---|" + "---:|" * (1 + len(experiment.columns)) + "---|"
    for row in experiment.rows:
        ours = [_figure(row, column, walks) for column in experiment.columns]
        verdict = f"**{row.verdict}**" if row.verdict else ""
        yield _line([named(row), printed(row), *ours, ": ".join(word for word in (verdict, remark(row)) if word)])


def _figure(row: Row, column: str, walks: int) -> str:
    figure = told(row, column, walks)
    return f"**{figure}**" if column == row.judged and row.verdict else figure


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(_in_table(cell) for cell in cells) + " |"


def _in_table(text: str) -> str:
    """What would end a cell, or be taken for a tag, is written so that it is not."""
    return re.sub(r"<(?=[A-Za-z/!])", "&lt;", text.replace("|", "\\|").replace("\n", " "))


def headlines(found: Sequence[Reproduction], page: str) -> list[str]:
    """Return the lines of another page, of the papers that are there."""
    beside = BESIDE.get(page, ())
    lines = [_line(["", "paper", "its method here", *beside, "ours"]), "|---|" + "---:|" * (3 + len(beside))]
    by_name = {(one.paper, experiment.name): (one, experiment) for one in found for experiment in one.experiments}
    there = (line for line in HEADLINES[page] if (line.paper, line.experiment) in by_name)
    return [*lines, *(_headline(*by_name[line.paper, line.experiment], line, beside) for line in there)]


def _headline(found: Reproduction, experiment: Experiment, line: Line, beside: Sequence[str]) -> str:
    rows = [_row_named(found, experiment, name) for name in line.rows]
    first, walks = rows[0], len(found.seeds)
    ours = next((column for column in OURS if column in first.ours), "")
    what = named(replace(first, quantity=line.what or first.quantity))
    figures = [_figures(rows, column, walks) for column in (first.judged, *beside, ours)]
    return _line([f"{found.paper}, {experiment.name}: {what}", printed(first), *figures])


def _row_named(found: Reproduction, experiment: Experiment, name: str) -> Row:
    row = next((row for row in experiment.rows if row.quantity == name), None)
    if row is None:
        raise OutputError(f"{found.paper} has no row '{name}' in {experiment.name}: see HEADLINES in the script.")
    return row


def _figures(rows: Sequence[Row], column: str, walks: int) -> str:
    """Of one row with its spread, of several the medians."""
    figures = [told(row, column, walks) for row in rows]
    return figures[0] if len(figures) == 1 else " / ".join(figure.partition(" (")[0] for figure in figures)


if __name__ == "__main__":
    harness.run(main)
