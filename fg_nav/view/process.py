"""The process that serves lines and page: clients and the walk share neither interpreter nor core.

    python -m fg_nav.view.process LINES PAGE HOST      descriptors of the ports, -1 for none (`ListenerProcess`)

The parent opens the ports, so that an occupied one is reported at once, and writes one message a line, JSON: the method
of `PageServer` that takes it and its argument, or `send_line` with a line for the clients of lines and for the page.

It answers with two numbers a line, whenever they change: the number of open pages, and the period of statuses (s). It
ends with its input, and so with the parent, however that ends.
"""

from __future__ import annotations

import asyncio
import json
import queue
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import IO, Any

from fg_nav.system.processes import collect_seldom, start_module
from fg_nav.text import to_json
from fg_nav.view.line_server import LineServer
from fg_nav.view.page_server import STATUS_S, PageServer

MAX_WAITING = 10_000  # Messages in the queue; more are dropped.
MAX_BYTES = 1 << 28  # Of a message: the revised path of a walk of a day.
CLOSING_S = 5.0  # Timeout of the end of the process.
REPORT_S = 0.1  # Between two counts of the open pages.


class ListenerProcess:
    """Passes lines, statuses and remarks to the process, without waiting.

    `lines` and `page` are listening sockets, which are closed here once the process has them; `host` the page's for the
    user; `remark` takes a sentence if the process ends before its time.
    """

    def __init__(
        self, lines: socket.socket | None, page: socket.socket | None, host: str, remark: Callable[[str], None]
    ) -> None:
        self.viewers, self.status_s = 0, STATUS_S
        self._remark, self._closing, self._has_ended = remark, False, False
        self._messages: queue.Queue[bytes | None] = queue.Queue(MAX_WAITING)
        doors = [door for door in (lines, page) if door is not None]
        descriptors = [-1 if door is None else door.fileno() for door in (lines, page)]
        passed = [door.fileno() for door in doors]
        self._process = start_module(__name__, *map(str, descriptors), host, pass_fds=passed)
        for door in doors:
            door.close()
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._threads = [
            threading.Thread(target=self._write, args=(self._process.stdin,), daemon=True),
            threading.Thread(target=self._read, args=(self._process.stdout,), daemon=True),
        ]
        for thread in self._threads:
            thread.start()

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    def send_line(self, line: str) -> None:
        """Send a line to clients and page."""
        self._put("send_line", line)

    def send(self, line: str) -> None:
        """Send a line to the page alone."""
        self._put("send", line)

    def send_status(self, status: dict[str, Any]) -> None:
        """Send the state between footfalls."""
        self._put("send_status", to_json(status))

    def send_remark(self, words: str) -> None:
        """Send a sentence for people."""
        self._put("send_remark", words)

    def close(self) -> None:
        """End the process once it has read all messages."""
        self._closing = True
        with suppress(queue.Full):
            self._messages.put(None, timeout=CLOSING_S)
        try:
            self._process.wait(CLOSING_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        for thread in self._threads:
            thread.join()

    def _put(self, method: str, argument: object) -> None:
        if self._has_ended:
            return
        with suppress(queue.Full):
            self._messages.put_nowait(json.dumps([method, argument], allow_nan=False).encode() + b"\n")

    def _write(self, pipe: IO[bytes]) -> None:
        with suppress(OSError), pipe:
            while (message := self._messages.get()) is not None:
                pipe.write(message)
                pipe.flush()

    def _read(self, pipe: IO[bytes]) -> None:
        with pipe:
            for answer in pipe:
                viewers, status_s = answer.split()
                self.viewers, self.status_s = int(viewers), float(status_s)
        self.viewers = 0
        self._has_ended = True
        if not self._closing:
            self._remark("what serves the walk has ended: it goes on unseen.")


async def _report(page: PageServer) -> None:
    """Print the number of open pages and the period of statuses whenever one changes."""
    last = ""
    while True:
        now = f"{page.viewers} {page.status_s:.3f}"
        if now != last:
            print(now, flush=True)  # noqa: T201
            last = now
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
