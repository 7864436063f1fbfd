"""The pictures of README and docs, of pages as a Chromium without a window shows them on a desk and on a phone.

    python scripts/pictures.py report --figure docs/report.png [--seed N]
    python scripts/pictures.py view --figure docs/view.png [--seed N]

report   the page of a result, of a simulated minute of walking with its truth: head and path, and on a phone the height
view     the page of a walk in progress, through a simulated office: most of it at once, its last seconds at their speed

It needs playwright (extra `checks`) and a Chromium, the system's or playwright's own.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import harness
import numpy as np
from harness import option
from PIL import Image

from fg_nav.arrays import Floats
from fg_nav.errors import OutputError
from fg_nav.io import write_canonical
from fg_nav.lab.simulation import simulate
from fg_nav.online.buffer import OnlineOptions
from fg_nav.online.follow import Sensor, StreamOptions, follow
from fg_nav.online.sources import Replay
from fg_nav.pipeline import navigate
from fg_nav.recording import Recording
from fg_nav.report import REPORT
from fg_nav.view.outlets import ListenerProcess, Outlets, format_address, open_port

HOST, WALKED_S, PLAYED_S = "127.0.0.1", 200.0, 12.0
DESK_PX, PHONE_PX, BETWEEN_PX, COLORS = 1120, 390, 16, 200


class LateReplay(Replay):
    """The samples of a recording: all but those of the last seconds at once, and then these at their own speed."""

    def __init__(self, recording: Recording) -> None:
        name, at = "a simulated office", int(np.searchsorted(recording.t, recording.t[-1] - PLAYED_S))
        super().__init__(recording.slice(at, len(recording)), 1.0, name)
        self._before = Replay(recording.slice(0, at), np.inf, name)

    async def read(self) -> Floats | None:
        """See `SampleSource`."""
        rows = await self._before.read()
        return await super().read() if rows is None else rows


class Unended(ListenerProcess):
    """A page that is not told of the end."""

    def send_status(self, status: dict[str, Any]) -> None:
        """Send it, unless it is that of the end."""
        if status["source"] != "ended":
            super().send_status(status)


@contextmanager
def open_pages(address: str, height_px: int, schemes: tuple[str, str]) -> Iterator[list[Any]]:
    """Show an address on a desk and on a phone, in these colour schemes."""
    from playwright.sync_api import sync_playwright

    system = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    with sync_playwright() as playwright:
        chromium: Any = playwright.chromium  # its types are there only where playwright is
        with chromium.launch(executable_path=system, args=["--no-sandbox"]) as browser:
            sizes = [{"width": width, "height": height_px} for width in (DESK_PX, PHONE_PX)]
            pages = [browser.new_page(viewport=s, color_scheme=c) for s, c in zip(sizes, schemes, strict=True)]
            for page in pages:
                page.goto(address)
            yield pages


def photograph(pages: Sequence[Any]) -> Image.Image:
    """Return what pages show, side by side, in few colours."""
    shots = []
    for page in pages:
        page.wait_for_timeout(500)
        shots.append(Image.open(BytesIO(page.screenshot())).convert("RGB"))
    joined = Image.new("RGB", (DESK_PX + BETWEEN_PX + PHONE_PX, shots[0].height), "white")
    joined.paste(shots[0], (0, 0))
    joined.paste(shots[1], (DESK_PX + BETWEEN_PX, 0))
    return joined.quantize(COLORS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)


def draw_report(seed: int) -> Image.Image:
    """Draw the page of a result."""
    with tempfile.TemporaryDirectory() as name:
        write_canonical(simulate("demo", seed).recording, Path(name) / "walk.csv")
        navigate(Path(name) / "walk.csv").save(Path(name) / "out")
        with open_pages((Path(name) / "out" / REPORT).as_uri(), 1000, ("light", "dark")) as pages:
            for page, part in zip(pages, ("body", "#height"), strict=True):
                page.locator("html[data-drawn=yes]").wait_for()
                page.locator(part).evaluate("part => part.scrollIntoView({behavior: 'instant'})")
            return photograph(pages)


def draw_view(seed: int) -> Image.Image:
    """Draw the page of a walk in progress."""
    recording = simulate("office", seed).recording
    recording = recording.slice(0, int(np.searchsorted(recording.t, recording.t[0] + WALKED_S)))
    door = open_port(HOST, 0, "--port")
    address = format_address(HOST, door.getsockname()[1])
    with closing(Unended(None, door, HOST, print)) as server, open_pages(address, 700, ("dark", "light")) as pages:
        options = StreamOptions(online=OnlineOptions(heading_rad=None), background=True)
        outlets = Outlets(server.send, None, server.send_remark, server)
        follow({None: Sensor(LateReplay(recording), options)}, outlets)
        return photograph(pages)


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw it."""
    what = option(None, "which page", choices=("report", "view"), positional=True)
    chosen = harness.parse_arguments(__doc__, arguments, what=what, seed=harness.FIRST_SEED, figure=Path("page.png"))
    picture = draw_report(chosen.seed) if chosen.what == "report" else draw_view(chosen.seed)
    try:
        picture.save(chosen.figure, optimize=True)
    except OSError as error:
        raise OutputError(f"{chosen.figure} cannot be written ({error.strerror}).") from None


if __name__ == "__main__":
    harness.run(main)
