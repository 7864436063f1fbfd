"""`fg-nav lab reproduce`: make all experiments of a paper, and lay them beside it on the terminal and in a folder.

The folder holds `report.html`, `results.json`, the pictures, and what each walk came to: a run that was ended goes on
from there. `results.json` is written last, so a folder with it is complete.

A reproduction as one page, `report.html`: it needs no network and no other file, on a desk, a phone or paper.

The pictures are in the page itself, with their captions as alternative texts. Wide tables scroll in their own box; on a
narrow screen each row becomes a list. The template is `page.html.j2` in this folder.
"""

from __future__ import annotations

import base64
import json
import os
import platform
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from importlib import import_module, metadata
from pathlib import Path

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from rich.text import Text

from fg_nav.errors import OutputError
from fg_nav.lab.reproduce import results
from fg_nav.lab.reproduce.results import (
    MISSED,
    MISSED_EXPLAINED,
    Experiment,
    Picture,
    Reproduction,
    describe_counts,
    format_name,
    format_note,
    format_printed,
    format_spread,
    write_reproduction,
)
from fg_nav.lab.store.files import REPRODUCTION_MARKER, list_visible, read_marker, write_text
from fg_nav.report.folder import lock_result, unwritable
from fg_nav.report.terminal import console, progress, ruled_table
from fg_nav.text import find_version, to_json

PAPERS = ("ma2018", "aiez2017", "munoz-diaz2017")

FIRST_SEED, SEEDS, QUICK_SEEDS = 101, 50, 3  # As in docs/results.md. Smaller seeds are those that anything was tuned on

REPORT, RESULTS = "report.html", "results.json"

MARK = REPRODUCTION_MARKER
"""File in a folder of ours; it names the paper, and below it pictures of an older result while a new one is made."""

_LIBRARIES = ("numpy", "scipy", "gtsam", "numba", "matplotlib")

_ENDED = "a worker was ended from outside, perhaps for want of memory: run the same command again, it goes on."

Paper = Callable[[Path, Sequence[int], int, Callable[[float], None], bool], Reproduction]
"""Of a folder (walks in `cells`, measurements in `parts`, and pictures), the seeds of the simulated walks, processes,
a function of the fraction done, and whether it is to be quick; OutputError where it cannot be written."""


def reproduce(
    paper: str,
    out: Path,
    seeds: int | None = None,
    first: int = FIRST_SEED,
    workers: int | None = None,
    quick: bool = False,
    force: bool = False,
) -> Reproduction:
    """Make a paper's experiments into a folder.

    Parameters
    ----------
    paper : one of `PAPERS`.
    out : the folder: new, empty, or of the same paper.
    seeds, first : how many walks of each kind, `SEEDS` or quick `QUICK_SEEDS` by default, and the first of their seeds.
    workers : processes; None for one a core.
    quick : fewer walks, and whatever else the paper's experiments leave out then.
    force : replace the result in the folder; finished walks are kept and used.

    Raises
    ------
    OutputError
        If the folder holds something else, or a result and `force` is not set, or cannot be written.
    """
    number = (QUICK_SEEDS if quick else SEEDS) if seeds is None else seeds
    with claim_folder(out, paper, force):
        with progress(f"{paper}, {number} seeds") as show_done:
            try:
                made = _load_paper(paper)(out, range(first, first + number), workers or count_cores(), show_done, quick)
            except BrokenProcessPool:
                raise OutputError(_ENDED) from None
        command = f"fg-nav lab reproduce {paper} --seeds {number} --first {first}{' --quick' if quick else ''}"
        found = replace(made, command=command, versions=list_versions(), parameters=to_json(made.parameters))
        write_folder(found, out)
    return found


def count_cores() -> int:
    """How many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _load_paper(name: str) -> Paper:
    made: Paper = import_module(f"fg_nav.lab.reproduce.{name.replace('-', '_')}").reproduce
    return made


def list_versions() -> dict[str, str]:
    """Of this package, of Python, and of the libraries that figures depend on."""
    return {
        "fg-nav": find_version(),
        "Python": platform.python_version(),
        **{name: metadata.version(name) for name in _LIBRARIES},
    }


@contextmanager
def claim_folder(out: Path, paper: str, force: bool) -> Iterator[None]:
    """Make the folder ours while the block runs, or refuse; with `force` take the old report out of it."""
    descriptor, _ = lock_result(out)
    try:
        _mark_folder(out, paper, force)
        yield
    finally:
        os.close(descriptor)


def _mark_folder(out: Path, paper: str, force: bool) -> None:
    try:
        held, *stale = read_marker(out, MARK) or [""]
        present = list_visible(out)
        if held != paper and present:
            what = f"the results of {held}" if held else f"'{present[0]}', which this command does not write"
            raise OutputError(f"{out} holds {what}: choose another --out.")
        if (out / RESULTS).exists() and not force:
            raise OutputError(f"{out} already holds a result: choose another --out, or replace it with --force.")
        _write_marker(out, paper, {*stale, *_list_pictures(out / RESULTS)} if held == paper else ())
        for name in (RESULTS, REPORT):
            (out / name).unlink(missing_ok=True)
    except OSError as error:
        raise unwritable(out, error) from None


def _write_marker(out: Path, paper: str, stale: Collection[str]) -> None:
    """Put down whose folder it is, and which pictures are of a result that is no more."""
    write_text(out / MARK, "\n".join([paper, *sorted(stale)]) + "\n")


def _list_pictures(results: Path) -> set[str]:
    """Names of a result's pictures, beside it; none where it cannot be read."""
    try:
        experiments = json.loads(results.read_text(encoding="utf-8"))["experiments"]
        names = {str(picture["file"]) for experiment in experiments for picture in experiment["pictures"]}
    except (OSError, ValueError, KeyError, TypeError):
        return set()
    return {name for name in names if name.endswith(".png") and Path(name).name == name}


def write_folder(found: Reproduction, out: Path) -> None:
    """Write the page, take away pictures that only an older result names, and write the results last."""
    write_text(out / REPORT, write_page(found, out))
    paper, *stale = read_marker(out, MARK)
    named_here = {picture.file for experiment in found.experiments for picture in experiment.pictures}
    for name in set(stale) - named_here:
        with suppress(OSError):
            (out / name).unlink()
    write_text(out / RESULTS, write_reproduction(found))
    _write_marker(out, paper, ())


def print_rows(found: Reproduction, out: Path) -> None:
    """Print the rows of each experiment, what is off and why, and where the files are."""
    screen = console()
    screen.print(found.citation, soft_wrap=True)
    for experiment in found.experiments:
        screen.print(f"\n{experiment.name}  {experiment.title}", style="bold", soft_wrap=True)
        if experiment.rows:
            screen.print(_make_table(experiment, len(found.seeds)))
    reasons = [
        ": ".join(part for part in (row.verdict, f"{experiment.name}, {format_name(row)}", format_note(row)) if part)
        for experiment in found.experiments
        for row in experiment.rows
        if row.verdict in (MISSED_EXPLAINED, MISSED)
    ]
    for words in [
        "",
        *reasons,
        *([""] if reasons else []),
        describe_counts(found),
        f"report: {out / REPORT}",
        f"files: {out}",
    ]:
        screen.print(words, soft_wrap=True)


def _make_table(experiment: Experiment, walks: int) -> object:
    table = ruled_table("", "paper", *experiment.columns, "verdict")
    for row in experiment.rows:
        ours = (Text(format_spread(row, column, walks)) for column in experiment.columns)
        style = "bold red" if row.verdict == MISSED else ""
        table.add_row(Text(format_name(row)), Text(format_printed(row)), *ours, Text(row.verdict, style=style))
    return table


_CLASSES = {
    results.REPRODUCED: "good",
    results.BETTER: "better",
    results.MISSED_EXPLAINED: "caution",
    results.MISSED: "bad",
    results.PUT_IN: "aside",
    results.AS_ASKED: "good",
    results.SHORT: "bad",
}
_SIGNS = {
    results.REPRODUCED: "=",
    results.BETTER: "+",
    results.MISSED_EXPLAINED: "~",
    results.MISSED: "\N{MULTIPLICATION SIGN}",
    results.PUT_IN: "\N{RIGHTWARDS ARROW}",
    results.AS_ASKED: "\N{CHECK MARK}",
    results.SHORT: "\N{MULTIPLICATION SIGN}",
}
"""Before the verdict: color is not all that distinguishes them."""

_PNG = b"\x89PNG\r\n\x1a\n"


def write_page(found: Reproduction, folder: Path) -> str:
    """Return the page; the pictures are read from the folder.

    Raises
    ------
    OutputError
        If a picture is not there, or is no PNG.
    """
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
        classes=_CLASSES,
        signs=_SIGNS,
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
