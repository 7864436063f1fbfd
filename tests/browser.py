"""A real browser without a window, for tests of pages: that of the system, or playwright's own."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

NAMES = ("chromium", "chromium-headless-shell", "chromium-browser", "google-chrome", "google-chrome-stable")


@contextmanager
def open_browser() -> Iterator[Any]:
    """Open it; skip the test where there is none."""
    driver = pytest.importorskip("playwright.sync_api", reason="playwright (extra `checks`) is not installed")
    system = next(filter(None, map(shutil.which, NAMES)), None)
    with driver.sync_playwright() as playwright:
        own = playwright.chromium.executable_path
        if system is None and not Path(own).exists():
            pytest.skip("there is no Chromium: install the system's, or `playwright install chromium`")
        opened = playwright.chromium.launch(executable_path=system, args=["--no-sandbox"])
        yield opened
        opened.close()
