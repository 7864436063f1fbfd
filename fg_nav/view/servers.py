"""The process that serves the lines of a walk and its page: clients and the walk share neither interpreter nor core.

    python -m fg_nav.view.servers LINES PAGE HOST      descriptors of the ports, -1 for none (`outlets.ListenerProcess`)

It reads one message a line, JSON: the method of `PageServer` that takes it and its argument, or `send_line` with a line
for the clients of lines and for the page. It answers with the number of open pages, whenever that changes, and ends
with its input, and so with the process of the walk, however that ends.

Each client of lines gets those made after its connection, written into the buffers of all clients at once. One whose
buffer exceeds `MAX_WAITING` does not read, and is disconnected, as is one that sends more than `MAX_RECEIVED`; input is
discarded. The page is files over HTTP and messages over a websocket (`/live`): docs/online.md has them. It does no
arithmetic: where a line changed the past, the whole path is sent again (`history`). A page that does not keep up gets
nothing until its buffer has drained, and then the history; one that sends anything is disconnected. Handshakes are
accepted only from pages served here, by the `Origin` and `Host` of the browser: no other open page can listen.
"""

from __future__ import annotations

import asyncio
import ipaddress
import json
import logging
import signal
import socket
import sys
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from http import HTTPStatus
from importlib import resources
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from websockets.asyncio.server import ServerConnection
from websockets.asyncio.server import serve as serve_page
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.frames import Frame, Opcode
from websockets.http11 import Request, Response
from websockets.protocol import State

from fg_nav.system.processes import collect_seldom
from fg_nav.text import to_json
from fg_nav.view.history import Walkers, turn_line
from fg_nav.view.outlets import BACKLOG

LIVE = "/live"

FILES = {
    "/": ("index.html", "text/html; charset=utf-8"),
    "/style.css": ("style.css", "text/css; charset=utf-8"),
    "/view.js": ("view.js", "text/javascript; charset=utf-8"),
}

MAX_WAITING = 1 << 18  # Bytes in the buffer of a client: ten minutes of lines, beside the system's; two histories.
MAX_RECEIVED = 1 << 16  # Bytes from a client of lines, which has nothing to send.
MAX_MESSAGE = 1024  # Bytes from a page, which sends none.
MAX_BYTES = 1 << 28  # Of a message of the walk: the revised path of a day.
MAX_REMARKS = 50
CLOSING_S = 1.0  # Timeout of the closing handshake with a page.
REDRAW_S = 0.05  # Changes of the past within this time are one message.
REPORT_S = 0.1  # Between two counts of the open pages.
HEADERS = {  # Of every response: no external resources, and no framing by other pages.
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self' ws://{host}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-cache",
    "Connection": "close",
}


class LineServer:
    """Serves lines to the clients of a listening socket, from an asyncio loop."""

    def __init__(self) -> None:
        self._clients: set[asyncio.StreamWriter] = set()

    @property
    def listeners(self) -> int:
        """Number of connected clients."""
        return len(self._clients)

    async def open(self, door: socket.socket) -> None:
        """Serve on a socket."""
        self._server = await asyncio.start_server(self._follow, sock=door, backlog=BACKLOG)

    async def _follow(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one client until it closes, or has sent too much."""
        self._clients.add(writer)
        received = 0
        with suppress(OSError):
            while received <= MAX_RECEIVED and (piece := await reader.read(MAX_RECEIVED)):
                received += len(piece)
        self._clients.discard(writer)
        writer.transport.abort()

    def send(self, line: str) -> None:
        """Send a line to all clients, without waiting."""
        data = (line + "\n").encode()
        for client in self._clients:
            client.write(data)
            if client.transport.get_write_buffer_size() > MAX_WAITING:
                client.transport.abort()

    async def close(self) -> None:
        """Free the port at once, and disconnect all, each after the lines that it takes at once."""
        self._server.close()
        for client in self._clients:
            client.close()
        for _ in range(20):
            if not self._clients:
                break
            await asyncio.sleep(0.05)


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

    n_walks = 1

    def __init__(self, host: str) -> None:
        self.host = host
        folder = resources.files("fg_nav.view").joinpath("page")
        self._files = {path: (folder.joinpath(name).read_bytes(), kind) for path, (name, kind) in FILES.items()}
        self._walkers = Walkers()
        self._status: dict[str, Any] | None = None
        self._remarks: deque[dict[str, Any]] = deque(maxlen=MAX_REMARKS)
        self._viewers: set[_Viewer] = set()
        self._plan = list[str]()  # The message on a plan, where there is one.
        self._redraws: asyncio.TimerHandle | None = None

    @property
    def viewers(self) -> int:
        """Number of open pages."""
        return len(self._viewers)

    async def open(self, door: socket.socket) -> None:
        """Serve on a socket."""
        logger = logging.getLogger(__name__)
        logger.disabled = True  # garbage on the port is no news
        self._server = await serve_page(
            self._follow,
            sock=door,
            backlog=BACKLOG,
            process_request=self._answer,
            compression=None,
            max_size=MAX_MESSAGE,
            close_timeout=CLOSING_S,
            server_header=None,
            logger=logger,
        )

    async def close(self) -> None:
        """Free the port at once, and disconnect all."""
        self._server.close()
        await self._server.wait_closed()

    def show_plan(self, plan: Sequence[Any]) -> None:
        """Serve a plan: its file, media type, and the message on how it lies (`fg_nav.view.plan`)."""
        path, kind, message = plan
        self._files["/plan"] = Path(path).read_bytes(), kind
        self._plan = [json.dumps(message)]

    def send(self, line: str) -> None:
        """Follow a line of the stream, and send it; where it changed the past, the history follows."""
        event = json.loads(line)
        changed, is_main = self._walkers.add(event)
        if event["kind"] == "turned" and is_main and self._status is not None:
            turn_line(self._status, event["angle_deg"])
        if event["kind"] in {"now", "turned", "retracted", "foot"}:
            self._send_to(self._viewers, line)
        if changed and self._redraws is None:
            self._redraws = asyncio.get_running_loop().call_later(REDRAW_S, self._redraw)

    def send_status(self, status: dict[str, Any]) -> None:
        """Send the state between footfalls."""
        history, t = self._walkers.main, status["t"] or 0.0
        known = {"distance_m": history.distance_m, "speed_m_s": history.speed_m_s(t)}
        known["standing_s"] = max(t - history.stepped_s, 0.0) if status["standing"] else 0.0
        self._status = {"kind": "status", **status, **{name: round(value, 3) for name, value in known.items()}}
        self._send_to(self._viewers, json.dumps(to_json(self._status), allow_nan=False))

    def send_remark(self, words: str) -> None:
        """Send a sentence for people."""
        self._remarks.append({"kind": "remark", "words": words})
        self._send_to(self._viewers, json.dumps(self._remarks[-1]))

    async def _follow(self, connection: ServerConnection) -> None:
        """Serve one page until it closes, or sends something."""
        viewer = _Viewer(connection)
        self._send_to([viewer], *self._plan, *self._describe())
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
        self._send_to(self._viewers, *self._describe())

    def _describe(self) -> list[str]:
        """Return the messages that show all that is known: `history`."""
        shown, remarks = self._walkers.describe(), list(self._remarks)
        content = {"kind": "history", **shown, "status": self._status, "remarks": remarks}
        return [json.dumps(to_json(content), allow_nan=False)]

    def _send_to(self, viewers: Sequence[_Viewer] | set[_Viewer], *messages: str) -> None:
        """Send to those that keep up; those that have caught up get the history instead."""
        late = [viewer for viewer in viewers if viewer.behind and viewer.waiting == 0]
        ready = [viewer for viewer in viewers if not viewer.behind]
        for group, told in ((ready, messages), (late, self._describe() if late else ())):
            frames = b"".join(Frame(Opcode.TEXT, one.encode()).serialize(mask=False) for one in told)  # alike for each
            for viewer in group:
                if viewer.connection.state is State.OPEN:
                    viewer.connection.transport.write(frames)
        for viewer in ready:
            viewer.behind = viewer.waiting > MAX_WAITING * self.n_walks
        for viewer in late:
            viewer.behind = False


# --- the process -----------------------------------------------------------------------------------------------------


async def _report(page: PageServer) -> None:
    """Print the number of open pages whenever it changes."""
    last = -1
    while True:
        if page.viewers != last:
            print(last := page.viewers, flush=True)  # noqa: T201
        await asyncio.sleep(REPORT_S)


async def serve(lines: LineServer | None, page: PageServer | None, doors: Sequence[socket.socket | None]) -> None:
    """Serve the messages on standard input, on the sockets of lines and page, until it ends."""
    loop, messages = asyncio.get_running_loop(), asyncio.StreamReader(MAX_BYTES)
    loop.set_exception_handler(lambda loop, context: None)  # a client's fault does not concern the walk
    servers = [(server, door) for server, door in zip((lines, page), doors, strict=True) if server and door]
    for server, door in servers:
        await server.open(door)
    reports = None if page is None else asyncio.create_task(_report(page))
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(messages), sys.stdin)
    async for message in messages:
        method, argument = json.loads(message)
        if method == "send_line" and lines is not None:
            lines.send(argument)
        if page is not None:
            getattr(page, "send" if method == "send_line" else method)(argument)
        await asyncio.sleep(0)  # see to the clients between two messages
    await asyncio.gather(*(server.close() for server, _ in servers))
    if reports is not None:
        reports.cancel()


def main() -> None:
    """Serve until the input ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process of the walk
    collect_seldom()  # a thousand pages are 300 000 objects, and a collection takes a tenth of a second
    doors = [None if word == "-1" else socket.socket(fileno=int(word)) for word in sys.argv[1:3]]
    lines, page = doors
    servers = LineServer() if lines else None, PageServer(sys.argv[3]) if page else None
    asyncio.run(serve(*servers, doors))


if __name__ == "__main__":
    main()
