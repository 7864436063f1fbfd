"""Serves the page of a walk: its files over HTTP, and messages over a websocket (`/live`).

A page first gets one message `history`, then the lines of the stream as they come:

========= =======================================================================================================
history   `path`, rows t, east, north, up, as it is now; `last`, the newest line; `status`; `remarks`; of two sensors
          `feet`, path and newest line of each by side, beside the person's. Sent again in place of `revised`, and
          after `turned` and `retracted`: the page does no arithmetic
now, turned, retracted    the lines, as `fg-nav stream` prints them
status    some five times a second while a page is open: the state between footfalls (`fg_nav.online.follow`)
remark    `words`: an irregularity, in a sentence
========= =======================================================================================================

A page that does not keep up gets nothing until its buffer has drained, and then the history. A page that sends anything
is disconnected. Handshakes are accepted only from pages served here, by the `Origin` and `Host` of the browser: no
other page that is open in it can listen.
"""

from __future__ import annotations

import asyncio
import ipaddress
import json
import logging
import socket
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from http import HTTPStatus
from importlib import resources
from time import perf_counter
from typing import Any
from urllib.parse import urlsplit

from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.frames import Frame, Opcode
from websockets.http11 import Request, Response
from websockets.protocol import State

from fg_nav.text import to_json
from fg_nav.view.history import Walkers, turn_moment
from fg_nav.view.line_server import AT_ONCE, BACKLOG, is_last_descriptor

LIVE = "/live"

FILES = {
    "/": ("index.html", "text/html; charset=utf-8"),
    "/style.css": ("style.css", "text/css; charset=utf-8"),
    "/view.js": ("view.js", "text/javascript; charset=utf-8"),
}

MAX_WAITING = 1 << 18  # Bytes in the buffer of a page that keeps up; two histories.
MAX_MESSAGE = 1024  # Bytes; pages send none.
MAX_REMARKS = 50
CLOSING_S = 1.0  # Timeout of the closing handshake with a page.
STATUS_S = 0.2  # Between two statuses.
STATUS_SHARE = 0.1  # Largest share of the time spent on them: with a thousand pages they are rarer.
REDRAW_S = 0.05  # Changes of the past within this time are one message.
HEADERS = {  # Of every response: no external resources, and no framing by other pages.
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self' ws://{host}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-cache",
    "Connection": "close",
}


@dataclass(eq=False)
class _Viewer:
    """An open page; `behind` once it has missed a message."""

    connection: ServerConnection
    behind: bool = False

    @property
    def waiting(self) -> int:
        """Bytes in its buffer."""
        return self.connection.transport.get_write_buffer_size()


class PageServer:
    """Serves the page to the clients of a listening socket, from an asyncio loop; `host` is its name for the user."""

    def __init__(self, host: str) -> None:
        self.host = host
        folder = resources.files("fg_nav.view").joinpath("page")
        self._files = {path: (folder.joinpath(name).read_bytes(), kind) for path, (name, kind) in FILES.items()}
        self._walkers = Walkers()
        self._status: dict[str, Any] | None = None
        self._remarks: deque[dict[str, Any]] = deque(maxlen=MAX_REMARKS)
        self._viewers: set[_Viewer] = set()
        self._redraws: asyncio.TimerHandle | None = None
        self.status_s = STATUS_S  # period of statuses that can be sent

    @property
    def viewers(self) -> int:
        """Number of open pages."""
        return len(self._viewers)

    async def open(self, door: socket.socket) -> None:
        """Serve on a socket."""
        logger = logging.getLogger(__name__)
        logger.disabled = True  # garbage on the port is no news
        self._server = await serve(
            self._follow,
            sock=door,
            backlog=AT_ONCE,
            process_request=self._answer,
            compression=None,
            max_size=MAX_MESSAGE,
            close_timeout=CLOSING_S,
            server_header=None,
            logger=logger,
        )
        door.listen(BACKLOG)  # again: asyncio has one number for both

    async def close(self) -> None:
        """Free the port at once, and disconnect all."""
        self._server.close()
        await self._server.wait_closed()

    def send(self, line: str) -> None:
        """Follow a line of the stream, and send it; where it changed the past, the history follows."""
        event = json.loads(line)
        changed, is_main = self._walkers.add(event)
        if event["kind"] == "turned" and is_main and self._status is not None:
            turn_moment(self._status, event["angle_deg"])
        if event["kind"] in {"now", "turned", "retracted", "foot"}:
            self._send_to(self._viewers, line)
        if changed and self._redraws is None:
            self._redraws = asyncio.get_running_loop().call_later(REDRAW_S, self._redraw)

    def send_status(self, status: dict[str, Any]) -> None:
        """Send the state between footfalls."""
        history = self._walkers.main
        known = {"distance_m": history.distance_m, "speed_m_s": history.speed_m_s(status["t"] or 0.0)}
        self._status = {"kind": "status", **status, **{name: round(value, 3) for name, value in known.items()}}
        began = perf_counter()
        self._send_to(self._viewers, json.dumps(to_json(self._status), allow_nan=False))
        self.status_s = max(STATUS_S, (perf_counter() - began) / STATUS_SHARE)

    def send_remark(self, words: str) -> None:
        """Send a sentence for people."""
        self._remarks.append({"kind": "remark", "words": words})
        self._send_to(self._viewers, json.dumps(self._remarks[-1]))

    async def _follow(self, connection: ServerConnection) -> None:
        """Serve one page until it closes, or sends something."""
        viewer = _Viewer(connection)
        self._send_to([viewer], self._describe())
        self._viewers.add(viewer)
        try:
            await connection.recv()
        except ConnectionClosed:
            pass
        finally:
            self._viewers.discard(viewer)

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return the requested file, or a refusal; None where a websocket is to be opened."""
        host = request.headers.get_all("Host")
        if len(host) != 1 or not self._is_ours(host[0]):
            return self._respond(HTTPStatus.FORBIDDEN, b"this page is not served under that name\n", "")
        path = request.path.partition("?")[0]
        if path == LIVE:
            origins = request.headers.get_all("Origin")
            if any(urlsplit(origin).netloc != host[0] for origin in origins):
                return self._respond(HTTPStatus.FORBIDDEN, b"that page did not come from here\n", host[0])
            if is_last_descriptor(connection.transport.get_extra_info("socket").fileno()):
                return self._respond(HTTPStatus.SERVICE_UNAVAILABLE, b"too many watch\n", host[0])
            return None
        if path not in self._files:
            return self._respond(HTTPStatus.NOT_FOUND, b"there is no such page\n", host[0])
        return self._respond(HTTPStatus.OK, *self._files[path], host=host[0])

    def _is_ours(self, host: str) -> bool:
        """Whether a browser named an address, this machine or the served name: no foreign name that resolves here."""
        try:
            name = urlsplit(f"//{host}").hostname or ""
            ipaddress.ip_address(name)
        except ValueError:
            own = socket.gethostname().lower()
            short = own.partition(".")[0]
            return name in {"localhost", self.host.lower(), own, short, f"{short}.local"}
        return True

    def _respond(
        self, status: HTTPStatus, body: bytes, kind: str = "text/plain; charset=utf-8", host: str = ""
    ) -> Response:
        headers = Headers({name: value.format(host=host) for name, value in HEADERS.items()})
        headers["Content-Type"] = kind
        headers["Content-Length"] = str(len(body))
        return Response(status.value, status.phrase, headers, body)

    def _redraw(self) -> None:
        self._redraws = None
        self._send_to(self._viewers, self._describe())

    def _describe(self) -> str:
        """Return the message `history`."""
        shown, remarks = self._walkers.describe(), list(self._remarks)
        content = {"kind": "history", **shown, "status": self._status, "remarks": remarks}
        return json.dumps(to_json(content), allow_nan=False)

    def _send_to(self, viewers: Sequence[_Viewer] | set[_Viewer], message: str) -> None:
        """Send to those that keep up; those that have caught up get the history instead."""
        late = [viewer for viewer in viewers if viewer.behind and viewer.waiting == 0]
        ready = [viewer for viewer in viewers if not viewer.behind]
        for group, words in ((ready, message), (late, self._describe() if late else "")):
            frame = Frame(Opcode.TEXT, words.encode()).serialize(mask=False)  # the same for each
            for viewer in group:
                if viewer.connection.state is State.OPEN:
                    viewer.connection.transport.write(frame)
        for viewer in ready:
            viewer.behind = viewer.waiting > MAX_WAITING
        for viewer in late:
            viewer.behind = False
