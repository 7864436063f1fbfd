"""A reproduction as one page, `report.html`: it needs no network and no other file, on a desk, a phone or paper.

The pictures are in the page itself, with their captions as alternative texts. Wide tables scroll in their own box; on a
narrow screen each row becomes a list. The template is `page.html.j2` in this folder.
"""

from __future__ import annotations

import base64
import json
from functools import partial
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from fg_nav.errors import OutputError
from fg_nav.lab.reproduce.results import (
    AS_ASKED,
    BETTER,
    MEANINGS,
    MISSED,
    MISSED_EXPLAINED,
    PUT_IN,
    REPRODUCED,
    SHORT,
    TOLERANCE,
    Picture,
    Reproduction,
    count_verdicts,
    format_name,
    format_note,
    format_printed,
    format_seeds,
    format_spread,
)
from fg_nav.text import to_json

_CLASSES = {
    REPRODUCED: "reproduced",
    BETTER: "better",
    MISSED_EXPLAINED: "explained",
    MISSED: "missed",
    PUT_IN: "aside",
    AS_ASKED: "reproduced",
    SHORT: "missed",
}
_SIGNS = {
    REPRODUCED: "=",
    BETTER: "+",
    MISSED_EXPLAINED: "~",
    MISSED: "\N{MULTIPLICATION SIGN}",
    PUT_IN: "\N{RIGHTWARDS ARROW}",
    AS_ASKED: "\N{CHECK MARK}",
    SHORT: "\N{MULTIPLICATION SIGN}",
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
        loader=PackageLoader("fg_nav.lab.reproduce", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {
        "name": format_name,
        "printed": format_printed,
        "note": format_note,
        "spread": format_spread,
        "json": lambda value: json.dumps(to_json(value), indent=1, ensure_ascii=False),
        "load_png": partial(_load_png, folder),
    }
    return environment.get_template("page.html.j2").render(
        found=found,
        counts=count_verdicts(found),
        meanings=MEANINGS,
        classes=_CLASSES,
        signs=_SIGNS,
        seeds=format_seeds(found),
        tolerance=f"{100 * TOLERANCE:.0f} %",
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
