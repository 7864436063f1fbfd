"""The picture of the page that shows a walk in progress: on a desk, dark, and on a phone, light.

    python scripts/view_picture.py --figure docs/view.png [--seed N]

A simulated walk through an office goes through the online navigator: most of it at once, its last seconds at their own
speed, onto the page in a Chromium without a window. What this then shows is put into one picture. It needs playwright
(extra `checks`) and a Chromium, the system's or playwright's own.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from contextlib import closing
from io import BytesIO
from pathlib import Path
from typing import Any

import harness
import numpy as np
from PIL import Image

from fg_nav.arrays import Floats
from fg_nav.errors import OutputError
from fg_nav.lab.simulation import simulate
from fg_nav.online.buffer import OnlineOptions
from fg_nav.online.follow import Sensor, StreamOptions, follow
from fg_nav.online.sources import Replay
from fg_nav.recording import Recording
from fg_nav.view.outlets import ListenerProcess, Outlets, format_address, open_port

HOST = "127.0.0.1"
SCENARIO, WALKED_S, PLAYED_S = "office", 200.0, 12.0
DESK, PHONE, BETWEEN, COLORS = (1120, 700), (340, 700), 16, 200


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


def draw_page(recording: Recording, heading_rad: float | None) -> Image.Image:
    """Show the walk on the page, and return what is seen."""
    from playwright.sync_api import sync_playwright

    system = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    door = open_port(HOST, 0, "--port")
    address = format_address(HOST, door.getsockname()[1])
    with closing(Unended(None, door, HOST, print)) as server, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=system, args=["--no-sandbox"])
        pages = []
        for (width, height), scheme in ((DESK, "dark"), (PHONE, "light")):
            page = browser.new_page(viewport={"width": width, "height": height}, color_scheme=scheme)
            page.goto(address)
            pages.append(page)
        options = StreamOptions(online=OnlineOptions(heading_rad=heading_rad), background=True)
        outlets = Outlets(server.send, None, server.send_remark, server)
        follow({None: Sensor(LateReplay(recording), options)}, outlets)
        shots = []
        for page in pages:
            page.wait_for_timeout(500)
            shots.append(Image.open(BytesIO(page.screenshot())).convert("RGB"))
        browser.close()
    joined = Image.new("RGB", (DESK[0] + BETWEEN + PHONE[0], DESK[1]), "white")
    joined.paste(shots[0], (0, 0))
    joined.paste(shots[1], (DESK[0] + BETWEEN, 0))
    return joined.quantize(COLORS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw it."""
    chosen = harness.parse_arguments(__doc__, arguments, seed=harness.FIRST_SEED, figure=Path("view.png"))
    recording = simulate(SCENARIO, chosen.seed).recording
    walked = recording.slice(0, int(np.searchsorted(recording.t, recording.t[0] + WALKED_S)))
    try:
        draw_page(walked, None).save(chosen.figure, optimize=True)
    except OSError as error:
        raise OutputError(f"{chosen.figure} cannot be written ({error.strerror}).") from None


if __name__ == "__main__":
    harness.run(main)
