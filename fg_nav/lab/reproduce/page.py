"""A reproduction as one page, `report.html`: it needs no network and no other file, on a desk, a phone or paper.

The pictures stand in the page itself, their captions being their alternative texts. Wide tables scroll in their own
box; on a narrow screen each row becomes a list. The template is `page.html` beside this file.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template

from fg_nav.errors import OutputError
from fg_nav.lab.reproduce.messages import MEANINGS, counts, named, printed, remark, seeds_told, told
from fg_nav.lab.reproduce.results import (
    AS_ASKED,
    BETTER,
    EXPLAINED,
    NOT_REPRODUCED,
    PUT_IN,
    REPRODUCED,
    SHORT,
    TOLERANCE,
    Experiment,
    Picture,
    Reproduction,
    Row,
)
from fg_nav.plain import plain

_CLASSES = {
    REPRODUCED: "reproduced",
    BETTER: "better",
    EXPLAINED: "explained",
    NOT_REPRODUCED: "missed",
    PUT_IN: "aside",
    AS_ASKED: "reproduced",
    SHORT: "missed",
}
_SIGNS = {
    REPRODUCED: "=",
    BETTER: "+",
    EXPLAINED: "~",
    NOT_REPRODUCED: "\N{MULTIPLICATION SIGN}",
    PUT_IN: "\N{RIGHTWARDS ARROW}",
    AS_ASKED: "\N{CHECK MARK}",
    SHORT: "\N{MULTIPLICATION SIGN}",
}
"""Before the verdict: colour is not all that tells them apart."""

_PNG = b"\x89PNG\r\n\x1a\n"


def page(found: Reproduction, folder: Path) -> str:
    """Return the page; the pictures are read from the folder.

    Raises
    ------
    OutputError
        If a picture is not there, or is no PNG.
    """
    template = Template(files("fg_nav.lab.reproduce").joinpath("page.html").read_text(encoding="utf-8"))
    experiments = list(enumerate(found.experiments, start=1))
    return template.substitute(
        title=escape(f"{found.paper}: the paper's figures and ours"),
        citation=escape(found.citation),
        counts=_lines(_count(verdict, number) for verdict, number in counts(found).items()),
        seeds=escape(f"seeds {seeds_told(found)}"),
        tolerance=f"{100 * TOLERANCE:.0f} %",
        contents=_lines(_entry(k, experiment) for k, experiment in experiments),
        experiments=_lines(_section(k, experiment, len(found.seeds), folder) for k, experiment in experiments),
        differs=_paragraphs(found.differs),
        command=escape(found.command),
        seed_list=escape(", ".join(str(seed) for seed in found.seeds)),
        versions=escape(", ".join(f"{name} {number}" for name, number in found.versions.items())),
        parameters=_lines(_parameters(name, value) for name, value in found.parameters.items()),
    )


def _lines(parts: Iterable[str]) -> str:
    return "\n".join(parts)


def _paragraphs(texts: Iterable[str]) -> str:
    return _lines(f"<p>{escape(text)}</p>" for text in texts)


def _count(verdict: str, number: int) -> str:
    meaning = escape(MEANINGS[verdict])
    return f'<li class="{_CLASSES[verdict]}"><strong>{number}</strong>{verdict} <span>{meaning}</span></li>'


def _entry(k: int, experiment: Experiment) -> str:
    return f'<li><a href="#experiment-{k}">{_heading(experiment)}</a></li>'


def _heading(experiment: Experiment) -> str:
    return f'<span class="name">{escape(experiment.name)}</span>{escape(experiment.title)}'


def _section(k: int, experiment: Experiment, walks: int, folder: Path) -> str:
    parts = [
        f'<section id="experiment-{k}" aria-labelledby="heading-{k}">',
        f'<h2 id="heading-{k}">{_heading(experiment)}</h2>',
        *(f"<p>{escape(text)}</p>" for text in experiment.setting.split("\n\n") if text),
        _table(k, experiment, walks) if experiment.rows else "",
        *(_picture(picture, folder) for picture in experiment.pictures),
        "</section>",
    ]
    return _lines(part for part in parts if part)


def _table(k: int, experiment: Experiment, walks: int) -> str:
    """Roles are told: a table whose rows are folded into lists would otherwise be none to a screen reader."""
    headers = ["Figure", "Paper", *experiment.columns, "Verdict"]
    head = "".join(f'<th scope="col" role="columnheader">{escape(header)}</th>' for header in headers)
    return _lines(
        [
            f'<div class="scroll" role="region" aria-labelledby="heading-{k}" tabindex="0">',
            '<table role="table">',
            f'<thead role="rowgroup"><tr role="row">{head}</tr></thead>',
            '<tbody role="rowgroup">',
            *(_row(row, experiment.columns, walks) for row in experiment.rows),
            "</tbody></table></div>",
        ]
    )


def _row(row: Row, columns: Sequence[str], walks: int) -> str:
    cells = [_cell("Paper", printed(row), "")]
    cells += [_cell(column, told(row, column, walks), "judged" if column == row.judged else "") for column in columns]
    head = f'<th scope="row" role="rowheader">{escape(named(row))}</th>'
    return f'<tr role="row">{head}{"".join(cells)}<td role="cell">{_verdict(row)}</td></tr>'


def _cell(label: str, text: str, kind: str) -> str:
    """The median, and what belongs to it on a line of its own."""
    value, _, spread = text.partition(" (") if label != "Paper" else (text, "", "")
    wide = f'<span class="spread">({escape(spread)}</span>' if spread else ""
    classes = " ".join(word for word in (kind, "none" if text == "-" else "") if word)
    marked = f' class="{classes}"' if classes else ""
    inner = f'<span class="value">{escape(value)}</span>' if label != "Paper" else escape(value)
    return f'<td role="cell"{marked} data-label="{escape(label)}"><span>{inner}{wide}</span></td>'


def _verdict(row: Row) -> str:
    verdict = row.verdict
    why = f'<span class="why">{escape(remark(row))}</span>' if remark(row) else ""
    if not verdict:
        return why
    return f'<span class="verdict {_CLASSES[verdict]}">{_SIGNS[verdict]} {verdict}</span>{why}'


def _picture(picture: Picture, folder: Path) -> str:
    content = _png(folder / picture.file)
    width, height = (int.from_bytes(content[k : k + 4], "big") for k in (16, 20))
    source = f"data:image/png;base64,{base64.b64encode(content).decode('ascii')}"
    caption = escape(picture.caption)
    image = f'<img src="{source}" alt="{caption}" width="{width}" height="{height}">'
    return f'<figure><div class="picture">{image}</div><figcaption>{caption}</figcaption></figure>'


def _png(path: Path) -> bytes:
    try:
        content = path.read_bytes()
    except OSError:
        content = b""
    if not content.startswith(_PNG):
        raise OutputError(f"{path} is not there, or is no PNG: run the same command with --force to draw it anew.")
    return content


def _parameters(name: str, value: object) -> str:
    text = json.dumps(plain(value), indent=1, ensure_ascii=False)
    return f"<details><summary>{escape(name)}</summary><pre>{escape(text)}</pre></details>"
