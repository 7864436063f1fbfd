"""The pages of results, and every table of README and docs that has results in it, from the store, `docs/results`.

    python scripts/write_results.py                   write the pages, their pictures, and the tables between marks
    python scripts/write_results.py --take FOLDER     first take a finished `fg-nav lab reproduce PAPER --out FOLDER`
    python scripts/write_results.py --check           exit with 1 where a page is not what would be written

`NAME.json` there is of an experiment, by `scripts/measure.py NAME --save`, or of a paper, by `--take`. Each has a page,
`docs/results.md` lists them, `scripts/pages` has the templates. A table in another page stands between
`<!-- written: NAME -->` and `<!-- end -->`. Below all is when, at which commit, on which seeds and how it was measured.
A picture is drawn where its page does not say yet that it was drawn of these rows.
"""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import harness
import numpy as np
from experiments import ALL, Column, Table, sum_up, write_table
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from measure import EXPERIMENTS, ROOT, make_stamp

from fg_nav.errors import OutputError
from fg_nav.lab.palette import CYCLE
from fg_nav.lab.reproduce import results
from fg_nav.lab.reproduce.results import PICTURES, Reproduction, format_name, format_printed, format_spread
from fg_nav.lab.store.files import write_text
from fg_nav.report.plots import style
from fg_nav.report.terminal import console

Made: TypeAlias = Mapping[str, Mapping[str, str]]  # Stamps by section, of a paper by its name.
Block: TypeAlias = tuple[Callable[[], list[str]], Made]  # What writes the lines between marks, and of what they are.

PAGES = ROOT / "scripts" / "pages"
HEADLINES: Mapping[str, Any] = tomllib.loads((PAGES / "headlines.toml").read_text(encoding="utf-8"))
BESIDE = {"README.md": ("tuned", "matched, both ways", "without places")}  # Columns there, before ours.
OURS = ("smoother", "online", "graph")  # Columns that they show beside the paper's method: the first there is.

FOLDER = Path("docs/results")
MARKED = re.compile(r"(<!-- written: ([\w-]+) -->\n).*?(<!-- end -->)", re.DOTALL)


def main(arguments: Sequence[str] | None = None) -> None:
    """Take what was made, and write or check all pages."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        check=harness.option(False, "refuse pages that are not what would be written"),
        take=harness.option([], "folders of finished papers", type=Path, nargs="+", metavar="FOLDER"),
        root=harness.option(ROOT, "of the project", type=Path, metavar="DIR"),
    )
    root, store = chosen.root, chosen.root / FOLDER
    for folder in chosen.take:
        take_paper(folder, store)
    # the store: papers, rows of experiments, stamps of both
    papers = {name: results.read_reproduction(store / f"{name}.json") for name in results.PAPERS}
    content = {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in store.glob("*.json")}
    made: dict[str, Made] = {name: content.get(name, {}).get("made", {}) for name in (*papers, *EXPERIMENTS)}
    tables = {name: Table(content.get(name, {}).get("rows", [])) for name in EXPERIMENTS}
    # the pages of each, their list, and the pages with marks
    old = {
        page: page.read_text(encoding="utf-8")
        for page in (root / "README.md", *root.glob("docs/*.md"), *store.glob("*.md"))
    }
    new = {store / f"{name}.md": render("paper", found=found, made=made[name]) for name, found in papers.items()}
    new |= {store / f"{name}.md": write_page(name, tables[name], made[name]) for name in EXPERIMENTS}
    new[root / "docs" / "results.md"] = render("results", papers=papers, experiments=EXPERIMENTS, made=made)
    blocks: dict[str, Block] = {}
    for mark, page in (("papers", "README.md"), ("pocket", "docs/pocket.md")):
        of_lines = {name: stamp for paper, *_ in HEADLINES[page] for name, stamp in made[paper].items()}
        blocks[mark] = partial(headlines, papers, page), of_lines
    for name, one in EXPERIMENTS.items():
        blocks |= {mark: (partial(write, tables[name]), made[name]) for mark, write in one.blocks.items()}
    new |= {page: fill_marks(text, blocks) for page, text in old.items() if MARKED.search(text)}
    for page in (one for one in old if one.parent == store and one not in new and not chosen.check):
        page.unlink()
        page.with_suffix(".png").unlink(missing_ok=True)
    for page, text in new.items():
        if chosen.check and old.get(page) != text:
            raise OutputError(f"{page} is not what is written from the files in {FOLDER}: run this without --check.")
        if not chosen.check:
            drawn = re.search("<!-- drawn: .*", text)
            if drawn and not (drawn[0] in old.get(page, "") and page.with_suffix(".png").exists()):
                draw_walks(tables[page.stem], EXPERIMENTS[page.stem].columns, page.with_suffix(".png"))
            write_text(page, text)
        console().print(f"{'as written' if chosen.check else 'written'}: {page}", soft_wrap=True)


def take_paper(folder: Path, store: Path) -> None:
    """Copy the results of a paper into the store, with a stamp, and its pictures; refuses those of other code."""
    found = results.read_reproduction(path := folder / "results.json")
    stamp = make_stamp(found.command, results.format_seeds(found))
    if found.versions.get("code") != stamp["code"]:
        raise OutputError(f"{folder} was made by other code than this: make it again.")
    content = {**json.loads(path.read_text(encoding="utf-8")), "made": {found.paper: stamp}}
    write_text(store / f"{found.paper}.json", json.dumps(content, indent=1, ensure_ascii=False) + "\n")
    for path in (folder / PICTURES).glob("*.png"):
        shutil.copy(path, store / f"{found.paper}-{path.name}")


def join(made: Made, key: str, pattern: str = "{}") -> str:
    """Join what the stamps say, each once."""
    return " and ".join(dict.fromkeys(pattern.format(one[key]) for one in made.values() if key in one))


def describe_stamps(made: Made) -> str:
    """Write when, at which commits, on which seeds and how it was measured."""
    seeds, command = join(made, "seeds"), join(made, "command", "`{}`")
    words = f"{join(made, 'date')}, commit {join(made, 'commit')}{f', seeds {seeds}' if seeds else ''}"
    return f"*{words}{f': {command}' if command else ''}.*"


def fill_marks(text: str, blocks: Mapping[str, Block]) -> str:
    """Return the page with the blocks between its marks."""

    def fill(mark: re.Match[str]) -> str:
        if mark[2] not in blocks:
            raise OutputError(f"there is no block '{mark[2]}': choose one of {', '.join(blocks)}.")
        write, made = blocks[mark[2]]
        lines = "\n".join([*write(), *(["", describe_stamps(made)] if made else [])])
        return f"{mark[1]}\n{lines}\n\n{mark[3]}"

    return MARKED.sub(fill, text)


# --- pages -----------------------------------------------------------------------------------------------------------


def render(template: str, **known: Any) -> str:
    """Fill a template of `scripts/pages`."""
    environment = Environment(
        loader=FileSystemLoader(PAGES), undefined=StrictUndefined, trim_blocks=True, keep_trailing_newline=True
    )
    shared = {"results": results, "join": join, "stamps": describe_stamps, "list_rows": list_rows}
    shared["table"] = lambda *given: "\n".join(write_table(*given))
    return environment.get_template(f"{template}.md.j2").render(shared, **known)


def write_page(name: str, table: Table, made: Made) -> str:
    """Return the page of an experiment; a picture that it has is named after the rows."""
    one, drawn = EXPERIMENTS[name], hashlib.sha256(json.dumps(table.rows).encode()).hexdigest()[:16]
    figures = [figure for asked in one.asked for figure in asked.judge(table)]
    summary = one.blocks[name](table) if table.rows and name in one.blocks else []
    known = {"tables": sum_up(table, one.columns), "summary": summary, "figures": figures, "made": made}
    return render(
        "experiment",
        name=name,
        experiment=one,
        rows=table.rows,
        drawn=list_shown(one.columns, table) and drawn,
        **known,
    )


def list_rows(experiment: results.Experiment, walks: int) -> list[list[str]]:
    """Return the rows of an experiment of a paper; the judged column of a row is in bold."""
    rows = []
    for row in experiment.rows:
        figures = {column: format_spread(row, column, walks) for column in experiment.columns}
        if row.verdict and row.judged in figures:
            figures[row.judged] = f"**{figures[row.judged]}**"
        words = [f"**{row.verdict}**" if row.verdict else "", results.format_note(row)]
        rows.append([format_name(row), format_printed(row), *figures.values(), ": ".join(filter(None, words))])
    return rows


def headlines(papers: Mapping[str, Reproduction], page: str) -> list[str]:
    """Return the lines of another page, of one row with its spread, of several their medians."""
    beside = BESIDE.get(page, ())
    lines = list[list[str]]()
    by_name = {
        (one.paper, experiment.name): (one, experiment) for one in papers.values() for experiment in one.experiments
    }
    for paper, name, what, wanted in HEADLINES[page]:
        if (paper, name) not in by_name:
            continue
        reproduction, experiment = by_name[paper, name]
        known = {row.quantity: row for row in reversed(experiment.rows)}
        for missing in [row for row in wanted if row not in known]:
            raise OutputError(f"{paper} has no row '{missing}' in {name}: see `scripts/pages/headlines.toml`.")
        rows = [known[row] for row in wanted]
        first, figures = rows[0], list[str]()
        ours = next((column for column in OURS if column in first.ours), "")
        for column in (first.judged, *beside, ours):
            some = [format_spread(row, column, len(reproduction.seeds)) for row in rows]
            figures.append(some[0] if len(some) == 1 else " / ".join(one.partition(" (")[0] for one in some))
        words = f"{paper}, {name}: {format_name(replace(first, quantity=what or first.quantity))}"
        lines.append([words, format_printed(first), *figures])
    return write_table(["", "paper", "its method here", *beside, "ours"], lines)


# --- pictures --------------------------------------------------------------------------------------------------------

DECADES = 30.0  # Largest over smallest value of an axis that is logarithmic.


def list_shown(columns: Sequence[Column], table: Table) -> list[tuple[str, Column]]:
    """Sections, each with the first column that it has; none of sums, nor columns of counts or of one value alone."""
    sections = table.sections if {row["walk"] for row in table.rows} != {ALL} else []
    found = {(c, s): np.concatenate([table.values(*case, c.figure) for case in table.select(s).cases])
             for c in columns for s in sections}  # fmt: skip
    values = {c: {x for s in sections for x in found[c, s]} for c in columns}
    told = [c for c in columns if len(values[c]) > 1 and values[c] - {0.0, 1.0, np.inf}]
    first = {s: next((c for c in told if len(found[c, s])), None) for s in sections}
    return [(section, column) for section, column in first.items() if column]


def draw_walks(table: Table, columns: Sequence[Column], path: Path) -> None:
    """Draw a row a section: walks are dots, their median a bar, variants below one another in their colours."""
    shown, variants = list_shown(columns, table), list(dict.fromkeys(variant for _, variant in table.cases))
    found = {s: {v: x for v in variants if len(x := table.values(s, v, c.figure))} for s, c in shown}
    known = np.concatenate([x for of_section in found.values() for x in of_section.values()])
    finite = known[np.isfinite(known)]
    is_log = finite.min() > 0.0 and finite.max() > DECADES * finite.min()
    edge = finite.max() * (1.5 if is_log else 1.1)  # where infinite values are
    with style.styled():
        figure = style.new_figure(0.9 + max(0.25, 0.1 + 0.05 * max(map(len, found.values()))) * len(shown))
        axes = figure.subplots()
        looks = {v: (CYCLE[n % len(CYCLE)], "osD"[n // len(CYCLE) % 3]) for n, v in enumerate(variants)}
        for variant, (color, marker) in looks.items():
            axes.plot([], [], marker, color=color, markersize=4, label=variant)
        for k, of_section in enumerate(found.values()):
            for j, (variant, values) in enumerate(of_section.items()):
                color, marker = looks[variant]
                some, place = np.minimum(values, edge), k + 0.8 * ((j + 0.5) / len(of_section) - 0.5)
                axes.plot(some, np.full_like(some, place), marker, color=color, markersize=3, alpha=0.5)
                axes.plot(np.median(some), place, "|", color=color, markersize=9, markeredgewidth=2.5)
        names = [section if column == shown[0][1] else f"{section}: {column.head}" for section, column in shown]
        axes.set(xscale="log" if is_log else "linear", xlabel=shown[0][1].head, ylim=(len(shown) - 0.5, -0.5))
        axes.set_yticks(range(len(shown)), names)
        style.head(axes, "", 2 if len(looks) > 8 else 6)  # beside the names of sections
    style.save(figure, path)


if __name__ == "__main__":
    harness.run(main)
