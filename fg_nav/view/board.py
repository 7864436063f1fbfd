"""A page of several walks: each is followed from the page of its own `fg-nav stream --view`, here or elsewhere.

Each message of a walk's page is relayed with `walker`, its name, added. A page that opens gets what is known of each
walk, and then the message `walker`: `walker`, `address`, `start_m` (east and north of its first footfall on the map),
`heard_s` (how long ago its page was heard; null: never). A page that is gone is asked for every second, and sends the
whole path once it is back.
"""

from __future__ import annotations

import asyncio
import json
import logging
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

from websockets.asyncio.client import connect
from websockets.exceptions import WebSocketException

from fg_nav.errors import StreamError
from fg_nav.view.servers import LIVE, MAX_BYTES, PageServer

RETRY_S = 1.0  # Between two attempts to reach a page.
SILENT_S = 10.0  # Without a word, after which a connection is dead: a page tells its status five times a second.


@dataclass(frozen=True)
class Walker:
    """A walk on the page: its name, the host and port of its own page, and where it began, m east and north."""

    name: str
    address: str
    start_m: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def parse(cls, words: str) -> Walker:
        """Return the walker of NAME=HOST:PORT@EAST,NORTH, with or without host and place; raises `StreamError`."""
        name, _, rest = words.partition("=")
        place, _, start = rest.partition("@")
        try:
            found = urlsplit(place if "://" in place else f"//127.0.0.1:{place}" if place.isdigit() else f"//{place}")
            east, north = (float(one) for one in (start or "0,0").split(","))
            if not (name and found.hostname and found.port and found.scheme in ("", "http")):
                raise ValueError
        except ValueError:
            raise StreamError(
                f"{words} is no walker: give NAME=HOST:PORT of the page of its `fg-nav stream --view`, and where it "
                "began elsewhere than the others m east and north of there, as anna=10.0.0.5:8642@12,-3."
            ) from None
        host = f"[{found.hostname}]" if ":" in found.hostname else found.hostname
        return cls(name, f"{host}:{found.port}", (east, north))


class BoardServer(PageServer):
    """Serves the page of several walks."""

    def __init__(self, host: str, walkers: Sequence[Walker]) -> None:
        super().__init__(host)
        self.n_walks = len(walkers)
        self._walkers_by_name = {one.name: one for one in walkers}
        self._told: dict[str, list[str]] = {one.name: [] for one in walkers}  # From the newest history on.
        self._statuses: dict[str, str] = {}
        self._heard: dict[str, float] = {}

    async def follow(self, walker: Walker) -> None:
        """Follow a walk, until it is cancelled."""
        quiet = logging.getLogger(__name__)
        quiet.disabled = True
        while True:
            with suppress(OSError, WebSocketException, KeyError, TypeError, ValueError):  # or it is no page of ours
                options: dict[str, Any] = {"proxy": None, "max_size": MAX_BYTES, "compression": None, "logger": quiet}
                async with connect(f"ws://{walker.address}{LIVE}", **options) as connection:
                    while True:
                        async with asyncio.timeout(SILENT_S):
                            message = await connection.recv()
                        self._relay(walker.name, json.loads(message))
            await asyncio.sleep(RETRY_S)

    def _relay(self, name: str, event: dict[str, Any]) -> None:
        """Pass on a message of a walk, and keep what shows it to a page that opens later."""
        self._heard[name] = time.monotonic()
        kind, message = event["kind"], json.dumps({**event, "walker": name})
        if kind == "plan":  # of another page
            return
        if kind == "status":
            self._statuses[name] = message
        else:
            self._told[name] = [message] if kind == "history" else [*self._told[name], message]
        self._send_to(self._viewers, message)

    def _describe(self) -> list[str]:
        """Return the messages that show all walks as they are known."""
        found, now = list[str](), time.monotonic()
        for name, one in self._walkers_by_name.items():
            heard_s = now - self._heard[name] if name in self._heard else None
            known = {"walker": name, "address": one.address, "start_m": one.start_m, "heard_s": heard_s}
            status = [self._statuses[name]] if name in self._statuses else []
            found += [*self._told[name], *status, json.dumps({"kind": "walker", **known})]
        return found
