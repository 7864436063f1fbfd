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
from fg_nav.lab.reproduce import results
from fg_nav.lab.reproduce.results import Picture, Reproduction
from fg_nav.text import to_json

_CLASSES = {
    results.REPRODUCED: "reproduced",
    results.BETTER: "better",
    results.MISSED_EXPLAINED: "explained",
    results.MISSED: "missed",
    results.PUT_IN: "aside",
    results.AS_ASKED: "reproduced",
    results.SHORT: "missed",
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
        loader=PackageLoader("fg_nav.lab.reproduce", "."),
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
