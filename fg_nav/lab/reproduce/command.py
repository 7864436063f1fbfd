"""`fg-nav lab reproduce`: make all experiments of a paper, and lay them beside it on the terminal and in a folder.

The folder holds `report.html`, `results.json`, the pictures, and what each walk came to: a run that was ended goes on
from there. `results.json` is written last, so a folder with it is complete. The page needs no network and no other
file, on a desk, a phone or paper: the pictures are in it, with their captions as alternative texts.
"""

from __future__ import annotations

import base64
import json
import os
import platform
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from functools import partial
from importlib import metadata
from pathlib import Path

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from rich.text import Text

from fg_nav.errors import OutputError
from fg_nav.lab.reproduce import results
from fg_nav.lab.reproduce.results import MISSED, MISSED_EXPLAINED, PICTURES, Picture, Reproduction
from fg_nav.lab.reproduce.runner import run_paper
from fg_nav.lab.store.code import source_sum
from fg_nav.lab.store.files import REPRODUCTION_MARKER, list_visible, make_folder, write_text
from fg_nav.report.folder import lock_result, unwritable
from fg_nav.report.terminal import console, progress, ruled_table
from fg_nav.text import find_version, to_json

FIRST_SEED, SEEDS, QUICK_SEEDS = 101, 50, 3  # As in docs/results.md. Smaller seeds are those that anything was tuned on

REPORT, RESULTS = "report.html", "results.json"

_LIBRARIES = ("numpy", "scipy", "gtsam", "numba", "matplotlib")  # That figures depend on.

_ENDED = "a worker was ended from outside, perhaps for want of memory: run the same command again, it goes on."


def reproduce(
    paper: str,
    out: Path,
    seeds: int | None = None,
    first: int = FIRST_SEED,
    workers: int | None = None,
    quick: bool = False,
    force: bool = False,
) -> Reproduction:
    """Make the experiments of one of `PAPERS` into a folder that is new, empty, or of the same paper.

    `seeds` is how many walks there are of each kind, `first` the first of their seeds. With `force` the result in the
    folder is replaced; finished walks are kept and used. Raises `OutputError` if the folder holds something else, or a
    result and `force` is not set, or cannot be written.
    """
    number = (QUICK_SEEDS if quick else SEEDS) if seeds is None else seeds
    descriptor, _ = lock_result(out)
    try:
        _mark_folder(out, paper, force)
        versions = {"fg-nav": find_version(), "code": source_sum(), "Python": platform.python_version()}
        versions |= {name: metadata.version(name) for name in _LIBRARIES}
        # make the experiments, whose pictures are all in a folder of their own
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        with progress(f"{paper}, {number} seeds") as show_done:
            make_folder(out / PICTURES)
            made = run_paper(paper, out, range(first, first + number), workers or cores, show_done, quick)
        # write the page, then the results
        command = f"fg-nav lab reproduce {paper} --seeds {number} --first {first}{' --quick' if quick else ''}"
        found = replace(made, command=command, versions=versions, parameters=to_json(made.parameters))
        write_text(out / REPORT, write_page(found, out))
        write_text(out / RESULTS, results.write_reproduction(found))
        return found
    except BrokenProcessPool:
        raise OutputError(_ENDED) from None
    finally:
        os.close(descriptor)


def _mark_folder(out: Path, paper: str, force: bool) -> None:
    """Put down whose folder it is, and take away what is of a result that is no more."""
    try:
        marker = out / REPRODUCTION_MARKER
        held = marker.read_text(encoding="utf-8").strip() if marker.is_file() else ""
        present = list_visible(out)
        if held != paper and present:
            what = f"the results of {held}" if held else f"'{present[0]}', which this command does not write"
            raise OutputError(f"{out} holds {what}: choose another --out.")
        if (out / RESULTS).exists() and not force:
            raise OutputError(f"{out} already holds a result: choose another --out, or replace it with --force.")
        write_text(marker, f"{paper}\n")
        for path in (out / RESULTS, out / REPORT, *(out / PICTURES).glob("figure-*.png")):
            path.unlink(missing_ok=True)
    except OSError as error:
        raise unwritable(out, error) from None


def print_rows(found: Reproduction, out: Path) -> None:
    """Print the rows of each experiment, what is off and why, and where the files are."""
    screen = console()
    screen.print(found.citation, soft_wrap=True)
    reasons = []
    for experiment in found.experiments:
        screen.print(f"\n{experiment.name}  {experiment.title}", style="bold", soft_wrap=True)
        table = ruled_table("", "paper", *experiment.columns, "verdict")
        for row in experiment.rows:
            name, columns = results.format_name(row), experiment.columns
            ours = (Text(results.format_spread(row, column, len(found.seeds))) for column in columns)
            style = "bold red" if row.verdict == MISSED else ""
            table.add_row(Text(name), Text(results.format_printed(row)), *ours, Text(row.verdict, style=style))
            if row.verdict in (MISSED_EXPLAINED, MISSED):
                parts = (row.verdict, f"{experiment.name}, {name}", results.format_note(row))
                reasons.append(": ".join(part for part in parts if part))
        if experiment.rows:
            screen.print(table)
    said = [*reasons, ""] if reasons else []
    for words in ["", *said, results.describe_counts(found), f"report: {out / REPORT}", f"files: {out}"]:
        screen.print(words, soft_wrap=True)


_PNG = b"\x89PNG\r\n\x1a\n"


def write_page(found: Reproduction, folder: Path) -> str:
    """Return the page; the pictures are read from the folder. Raises `OutputError` if one is not there, or no PNG."""
    environment = Environment(
        loader=ChoiceLoader([PackageLoader(place, ".") for place in ("fg_nav.lab.reproduce", "fg_nav.report.page")]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {
        "name": results.format_name,
        "printed": results.format_printed,
        "note": results.format_note,
        "spread": results.format_spread,
        "json": lambda value: json.dumps(to_json(value), indent=1, ensure_ascii=False),
        "load_png": partial(_load_png, folder),
    }
    return environment.get_template("page.html.j2").render(
        found=found,
        counts=results.count_verdicts(found),
        meanings=results.MEANINGS,
        seeds=results.format_seeds(found),
        tolerance=f"{100 * results.TOLERANCE:.0f} %",
    )


def _load_png(folder: Path, picture: Picture) -> dict[str, str | int]:
    """Return the source, width and height of a picture, to be put into the page."""
    path = folder / picture.file
    try:
        content = path.read_bytes()
    except OSError:
        content = b""
    if not content.startswith(_PNG):
        raise OutputError(f"{path} is not there, or is no PNG: run the same command with --force to draw it again.")
    width, height = (int.from_bytes(content[k : k + 4], "big") for k in (16, 20))
    source = f"data:image/png;base64,{base64.b64encode(content).decode('ascii')}"
    return {"source": source, "width": width, "height": height}
