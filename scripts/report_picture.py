"""The picture of the page of a result: its head and path on a desk, light, and further down on a phone, dark.

    python scripts/report_picture.py --figure docs/report.png [--seed N]

A simulated minute of walking goes through the smoother, with its truth, into a folder that is thrown away; a Chromium
without a window shows its page. It needs playwright (extra `checks`) and a Chromium, the system's or playwright's own.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import harness
from PIL import Image

from fg_nav.errors import OutputError
from fg_nav.io import write_canonical
from fg_nav.lab.simulation import simulate
from fg_nav.pipeline import navigate
from fg_nav.report import REPORT

SCENARIO = "demo"
DESK, PHONE, BETWEEN, COLORS = (1120, 1000), (390, 1000), 16, 200
SHOWN = ((DESK, "light", "body"), (PHONE, "dark", "#height"))
"""Size, color scheme, and the part of the page that is seen first."""


def draw_pages(page: Path) -> Image.Image:
    """Show the page as on a desk and on a phone, and return what is seen."""
    from playwright.sync_api import sync_playwright

    system = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    joined = Image.new("RGB", (DESK[0] + BETWEEN + PHONE[0], DESK[1]), "white")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=system, args=["--no-sandbox"])
        for left, ((width, height), scheme, part) in zip((0, DESK[0] + BETWEEN), SHOWN, strict=True):
            shown = browser.new_page(viewport={"width": width, "height": height}, color_scheme=scheme)
            shown.goto(page.as_uri())
            joined.paste(photograph(shown, part), (left, 0))
        browser.close()
    return joined.quantize(COLORS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)


def photograph(shown: Any, part: str) -> Image.Image:
    """Wait for the charts, scroll to a part of the page, and return what is seen."""
    shown.locator("html[data-drawn=yes]").wait_for()
    shown.locator(part).evaluate("part => part.scrollIntoView({behavior: 'instant'})")
    shown.wait_for_timeout(300)
    return Image.open(BytesIO(shown.screenshot())).convert("RGB")


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw it."""
    chosen = harness.parse_arguments(__doc__, arguments, seed=harness.FIRST_SEED, figure=Path("report.png"))
    with tempfile.TemporaryDirectory() as name:
        file, out = Path(name) / "walk.csv", Path(name) / "out"
        write_canonical(simulate(SCENARIO, chosen.seed).recording, file)
        navigate(file).save(out)
        picture = draw_pages(out / REPORT)
    try:
        picture.save(chosen.figure, optimize=True)
    except OSError as error:
        raise OutputError(f"{chosen.figure} cannot be written ({error.strerror}).") from None


if __name__ == "__main__":
    harness.run(main)
