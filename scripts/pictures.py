"""The pictures of README and docs.

    python scripts/pictures.py walks|report|view --figure FILE [--seed N] [--data DIR]

walks    a real walk over surveyed footprints, and half an hour in a simulated mall, from above, on the truth by yaw and
         shift: walk 33 of gdin, a LORD GX5 on the instep, with its magnetometer as recorded; the scenario `mall` with a
         calibrated magnetometer on the floor of a building (field `indoor`)
report   the page of a result, of a simulated minute of walking with its truth: head and path, and on a phone the height
view     the page of a walk in progress, through a simulated office

Pages are as a Chromium without a window shows them on a desk and on a phone: playwright (extra `checks`) and a Chromium
are needed, the system's or playwright's own.
"""

from __future__ import annotations

import shutil
import tempfile
from argparse import Namespace
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import harness
import numpy as np
import walks
from harness import option
from matplotlib.axes import Axes
from PIL import Image

from fg_nav.io import read, write_canonical
from fg_nav.lab import palette
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.online.buffer import OnlineOptions
from fg_nav.online.follow import Sensor, StreamOptions, follow
from fg_nav.online.sources import Replay
from fg_nav.pipeline import navigate, prepare_walk, run_method
from fg_nav.recording import Recording
from fg_nav.report import REPORT
from fg_nav.report.plots import style
from fg_nav.truth import FootprintTruth, TrajectoryTruth
from fg_nav.view.outlets import ListenerProcess, Outlets, format_address, open_port
from fg_nav.walk import Walk

HOST, WALKED_S = "127.0.0.1", 203.0
DESK_PX, PHONE_PX, BETWEEN_PX, COLORS = 1120, 390, 16, 200


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


def photograph(pages: Sequence[Any], path: Path) -> None:
    """Write what pages show, side by side, in few colours."""
    joined = Image.new("RGB", (DESK_PX + BETWEEN_PX + PHONE_PX, pages[0].viewport_size["height"]), "white")
    for page, left in zip(pages, (0, DESK_PX + BETWEEN_PX), strict=True):
        page.wait_for_timeout(500)
        joined.paste(Image.open(BytesIO(page.screenshot())).convert("RGB"), (left, 0))
    joined.quantize(COLORS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(path, optimize=True)


def draw_report(chosen: Namespace) -> None:
    """Draw the page of a result."""
    with tempfile.TemporaryDirectory() as name:
        write_canonical(simulate("demo", chosen.seed).recording, Path(name) / "walk.csv")
        navigate(Path(name) / "walk.csv").save(Path(name) / "out")
        with open_pages((Path(name) / "out" / REPORT).as_uri(), 1000, ("light", "dark")) as pages:
            for page, part in zip(pages, ("body", "#height"), strict=True):
                page.locator("html[data-drawn=yes]").wait_for()
                page.locator(part).evaluate("part => part.scrollIntoView({behavior: 'instant'})")
            photograph(pages, chosen.figure)


def draw_view(chosen: Namespace) -> None:
    """Draw the page of a walk in progress, which takes as long as the walk."""
    recording = simulate("office", chosen.seed).recording
    recording = recording.slice(0, int(np.searchsorted(recording.t, recording.t[0] + WALKED_S)))
    door = open_port(HOST, 0, "--port")
    address = format_address(HOST, door.getsockname()[1])
    with closing(Unended(None, door, HOST, print)) as server, open_pages(address, 750, ("dark", "light")) as pages:
        options = StreamOptions(OnlineOptions(heading_rad=None), background=True)
        sensor = Sensor(Replay(recording, 1.0, "a simulated office"), options)
        outlets = Outlets(server.send, None, server.send_remark, server)
        with ThreadPoolExecutor(1) as thread:  # the pages have an event loop in this one
            thread.submit(follow, {None: sensor}, outlets).result()
        photograph(pages, chosen.figure)


WALK, MAX_POINTS = "gdin 33", 4000
LINES = {"iez": ("zero-velocity filter (IEZ)", palette.VERMILION, 0.8), "smoother": ("fg-nav", palette.BLUE, 1.2)}


def draw_walks(chosen: Namespace) -> None:
    """Draw a real and a simulated walk."""
    real = next(one for one in walks.list_set(walks.data_folder(chosen.data), walks.GDIN) if one.name == WALK)
    mall = simulate("mall", chosen.seed, Choices(calibrated=True)).recording
    with style.styled():
        picture = style.new_figure(4.2, width_in=10.5)
        left, right = picture.subplots(1, 2, width_ratios=(1.55, 1.0))
        ours, filtered = draw_walk(left, read(real.path))
        left.set_title(f"A real walk of 64 m, with its magnetometer: {ours:.2f} m rms, filter {filtered:.2f}")
        ours, filtered = draw_walk(right, mall)
        right.set_title(f"Simulated, 2.5 km: {ours:.1f} m rms, filter {filtered:.1f}")
        right.set_ylabel("")
    style.save(picture, chosen.figure)


def draw_walk(axes: Axes, recording: Recording) -> tuple[float, float]:
    """Draw both paths over the truth; returns the rmse of the smoother and of the filter, m."""
    walk, errors = prepare_walk(Walk.of(recording)), {}
    if isinstance(walk.truth, TrajectoryTruth):
        path = walk.truth.position[:: len(walk.truth.position) // MAX_POINTS + 1]
        axes.plot(*path[:, :2].T, **palette.TRUTH_LINE, label="truth")
    elif isinstance(walk.truth, FootprintTruth):
        axes.plot(*walk.truth.xy.T, "s", color=palette.TRUTH, markersize=4.5, label="surveyed footprints")
    for method, (words, color, width) in LINES.items():
        outcome = run_method(walk, method)
        assert outcome.comparison is not None
        path = outcome.comparison.alignment.apply(outcome.solution.position)
        axes.plot(*path[:: len(path) // MAX_POINTS + 1, :2].T, color=color, linewidth=width, label=words)
        errors[method] = float(np.asarray(outcome.metrics.rmse_2d_m))
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="m", ylabel="m")
    axes.legend(loc="best", frameon=False)
    return errors["smoother"], errors["iez"]


DRAWN = {"walks": draw_walks, "report": draw_report, "view": draw_view}


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw one."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        DRAWN,
        seed=harness.FIRST_SEED,
        figure=option(Path("picture.png"), "draw into this file", type=Path, metavar="FILE"),
        data=None,
    )
    DRAWN[chosen.what](chosen)


if __name__ == "__main__":
    harness.run(main)
