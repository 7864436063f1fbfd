"""Every table of README and docs that has results in it, written from the files in `docs/results`.

    python scripts/write_results.py             write `docs/results.md` and the tables between marks in other pages
    python scripts/write_results.py --check     exit with 1 where a page is not what would be written

============================================= ======================================================================
`ma2018`, `aiez2017`, `munoz-diaz2017` .json  results.json of `fg-nav reproduce PAPER`
`real-walks.json`                             `python scripts/real_walks.py --ablation --json FILE`
============================================= ======================================================================

A table in a page stands between `<!-- written: NAME -->` and `<!-- end -->`; `BLOCKS` has the names.
"""

from __future__ import annotations

import json
import math
import re
import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import harness
import numpy as np
from real_fields import MERITS
from real_walks import (
    FOOTPRINTS,
    LOOPS,
    NEES,
    PYSHOE,
    RMSE,
    RUN,
    SPACE,
    STORED,
    SURVEYED,
    VICON_DETECTED,
    VICON_LABELLED,
)
from walks import GDIN

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

BESIDE = {"README.md": ("tuned", "matched, both ways")}
"""Columns that stand there between the paper's method and ours."""

OURS = ("smoother", "online", "graph")
"""Columns that they show beside the paper's method: the first there is."""

ROOT = Path(__file__).resolve().parents[1]
FOLDER = Path("docs/results")
PAPERS = ("ma2018", "aiez2017", "munoz-diaz2017")
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
        if chosen.check and read_page(page) != text:
            raise OutputError(f"{page} is not what is written from the files in {FOLDER}: run this without --check.")
        if not chosen.check:
            write_text(page, text)
        console().print(f"{'as written' if chosen.check else 'written'}: {page}", soft_wrap=True)


def write_pages(root: Path) -> dict[Path, str]:
    """Text of every page that has results in it."""
    papers = [read_reproduction(root / FOLDER / f"{name}.json") for name in PAPERS]
    walks = json.loads((root / FOLDER / "real-walks.json").read_text(encoding="utf-8"))
    blocks = {name: write_block(papers, walks) for name, write_block in BLOCKS.items()}
    pages = [root / "README.md", *sorted((root / "docs").glob("*.md"))]
    found = {page: fill_marks(read_page(page), blocks) for page in pages if MARKED.search(read_page(page))}
    return {root / "docs" / "results.md": document(papers), **found}


def read_page(page: Path) -> str:
    """Text of a page; none where it is not there."""
    return page.read_text(encoding="utf-8") if page.exists() else ""


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
    yield _line(["", "paper", *experiment.columns, "verdict"])
    yield "|---|" + "---:|" * (1 + len(experiment.columns)) + "---|"
    for row in experiment.rows:
        ours = [_figure(row, column, walks) for column in experiment.columns]
        verdict = f"**{row.verdict}**" if row.verdict else ""
        yield _line(
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
    what = format_name(replace(first, quantity=line.what or first.quantity))
    figures = [_figures(rows, column, walks) for column in (first.judged, *beside, ours)]
    return _line([f"{found.paper}, {experiment.name}: {what}", format_printed(first), *figures])


def _row_named(found: Reproduction, experiment: Experiment, name: str) -> Row:
    row = next((row for row in experiment.rows if row.quantity == name), None)
    if row is None:
        raise OutputError(f"{found.paper} has no row '{name}' in {experiment.name}: see HEADLINES in the script.")
    return row


def _figures(rows: Sequence[Row], column: str, walks: int) -> str:
    """Of one row with its spread, of several the medians."""
    figures = [format_spread(row, column, walks) for row in rows]
    return figures[0] if len(figures) == 1 else " / ".join(figure.partition(" (")[0] for figure in figures)


# --- real walks ------------------------------------------------------------------------------------------------------

Walks = Mapping[str, Any]
"""Content of `real-walks.json`."""

INERTIAL, IEZ = "smoother", "iez"


def write_summary(walks: Walks) -> list[str]:
    """Figures of all sets in three lines."""
    footprints = [of_pairs(walks, "without"), of_pairs(walks, "raw"), of(walks, FOOTPRINTS, IEZ, RMSE), "-"]
    vicon = [of(walks, VICON_LABELLED, method, RMSE) for method in (INERTIAL, IEZ)]
    loops = [of(walks, LOOPS, method, "closure_percent", "{:.2f}", WORST) for method in (INERTIAL, IEZ)]
    gdin = "10 indoor walks of 35 to 150 m (`gdin`): rmse at surveyed footprints, mean / median (m)"
    surveyed = {"11 indoor walks of 10 to 120 m": SURVEYED, "7 runs, or gyroscope clipped": RUN}
    return [
        "| | `inertial` | `smoother`, with the compass | `iez` | PyShoe |",
        "|---|---:|---:|---:|---:|",
        _line(["28 motion-captured trials: rmse 2-D, mean / median (m)", vicon[0], "-", vicon[1], PYSHOE_2D]),
        _line([gdin, *footprints]),
        *(_line([f"{what} (`gdlbio`): the same", *_of_stored(walks, part)]) for what, part in surveyed.items()),
        _line(["5 loops of 23 to 78 m: closure in % of the distance, median / worst", loops[0], "-", loops[1], "-"]),
    ]


def _of_stored(walks: Walks, section: str) -> tuple[str, ...]:
    ours, filtered, stored = (of(walks, section, method, RMSE) for method in (INERTIAL, IEZ, STORED))
    return ours, "-", filtered, stored


def write_vicon(walks: Walks) -> list[str]:
    """Figures of the motion-captured trials."""
    rows = {
        "PyShoe's labels as stances: rmse 2-D, mean / median (m)": (VICON_LABELLED, RMSE, "{:.3f}", MEAN, PYSHOE_2D),
        "the same, rmse 3-D": (VICON_LABELLED, SPACE, "{:.3f}", MEAN, PYSHOE_3D),
        "the same, best-fit scale, median": (VICON_LABELLED, "scale", "{:.4f}", MIDDLE, "-"),
        "the same, NEES of the positions over its expectation, median": (VICON_LABELLED, NEES, "{:.2f}", MIDDLE, "-"),
        "own stances: rmse 2-D, mean / median (m)": (VICON_DETECTED, RMSE, "{:.3f}", MEAN, "-"),
        "the same, rmse 3-D, median / worst trial": (VICON_DETECTED, SPACE, "{:.3f}", WORST, "-"),
    }
    return _of_both(walks, rows)


def write_indoor(walks: Walks) -> list[str]:
    """Figures of the indoor walks and loops."""
    rows = {
        "10 `gdin` walks of 35 to 150 m: footprint rmse, mean / median (m)": (FOOTPRINTS, RMSE, "{:.3f}", MEAN, ""),
        "the same, median / worst walk": (FOOTPRINTS, RMSE, "{:.2f}", WORST, ""),
        "the same, best-fit scale, median": (FOOTPRINTS, "scale", "{:.3f}", MIDDLE, ""),
        "5 loops of 23 to 78 m: closure in % of the distance, median / worst": (
            LOOPS, "closure_percent", "{:.2f}", WORST, "",
        ),
    }  # fmt: skip
    return _of_both(walks, rows)


def _of_both(walks: Walks, rows: Mapping[str, tuple[str, str, str, Sequence[Summary], str]]) -> list[str]:
    beside = any(row[-1] for row in rows.values())
    lines = ["| | `inertial` | `iez` |" + " PyShoe |" * beside, "|---|---:|---:|" + "---:|" * beside]
    for words, (section, name, pattern, summaries, other) in rows.items():
        both = [of(walks, section, method, name, pattern, summaries) for method in (INERTIAL, IEZ)]
        lines.append(_line([words, *both, *([other] if beside else [])]))
    return lines


def write_pairs(walks: Walks) -> list[str]:
    """Each walk without and with the magnetometer."""
    lines = ["| walk | without | as recorded | calibrated on the walk |", "|---|---:|---:|---:|"]
    for group, merit in MERITS.items():
        some = [pair for pair in walks["magnetometer"] if pair["group"] == group]
        rows = {f"{group} {pair['name']}": [pair[kind] for kind in KINDS] for pair in some}
        rows[f"{group}, mean: {merit}"] = np.mean(list(rows.values()), axis=0).tolist()
        lines += [_line([name, *(f"{value:.3f}" for value in values)]) for name, values in rows.items()]
    return lines


def write_ablation(walks: Walks) -> list[str]:
    """The smoother without one of its parts."""
    rows = walks["ablation"]
    lines = [_line(list(rows[0])), "|---|" + "---:|" * (len(rows[0]) - 1)]
    return lines + [_line([_cell(cell) for cell in row.values()]) for row in rows]


def _cell(value: object) -> str:
    return f"{value:.3f}" if isinstance(value, float) else str(value)


Summary = Callable[[Sequence[float]], float]
MEAN: Sequence[Summary] = (statistics.fmean, statistics.median)
WORST: Sequence[Summary] = (statistics.median, max)
MIDDLE: Sequence[Summary] = (statistics.median,)
KINDS = ("without", "raw", "walk")
PYSHOE_2D, PYSHOE_3D = (" / ".join(f"{PYSHOE[of][plane]:.3f}" for of in ("mean", "median")) for plane in (0, 1))


def of(
    walks: Walks,
    section: str,
    method: str,
    name: str,
    pattern: str = "{:.3f}",
    summaries: Sequence[Summary] = MEAN,
) -> str:
    """A figure of merit over the walks of a section; a walk that failed is infinitely bad."""
    rows = [one for one in walks["walks"] if (one["section"], one["method"]) == (section, method)]
    values = [one.get(name, math.inf) for one in rows]
    return " / ".join(pattern.format(summary(values)) for summary in summaries)


def of_pairs(walks: Walks, kind: str) -> str:
    """Mean and median over the gdin walks without the magnetometer, or with it."""
    values = [pair[kind] for pair in walks["magnetometer"] if pair["group"] == GDIN]
    return " / ".join(f"{summary(values):.3f}" for summary in MEAN)


BLOCKS: Mapping[str, Callable[[Sequence[Reproduction], Walks], list[str]]] = {
    "papers": lambda papers, _: headlines(papers, "README.md"),
    "pocket": lambda papers, _: headlines(papers, "docs/pocket.md"),
    "real-walks": lambda _, walks: write_summary(walks),
    "vicon": lambda _, walks: write_vicon(walks),
    "indoor": lambda _, walks: write_indoor(walks),
    "magnetometer": lambda _, walks: write_pairs(walks),
    "ablation": lambda _, walks: write_ablation(walks),
}
"""Tables of other pages by the names of their marks."""

if __name__ == "__main__":
    harness.run(main)
