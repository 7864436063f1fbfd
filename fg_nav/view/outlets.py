"""Where the lines of a walk and remarks on it go: a printer or a port, and a page for people.

`emit` gets the lines of the moment, `emit_end` those of the whole walk at its end, which are not served: a client of
the port follows a walk. The page gets all of them; `emit_end` is None if nothing takes those of the end. The page is
shown the status between footfalls too (its keys are in docs/online.md); what is not known yet is null.

The ports are opened here, so that an occupied one is reported at once, and the messages to `servers` are queued.
"""

from __future__ import annotations

import ipaddress
import json
import queue
import socket
import subprocess
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass
from typing import IO, Any

from fg_nav.errors import StreamError, describe_reason
from fg_nav.system.processes import start_module
from fg_nav.text import to_json
from fg_nav.view.plan import Plan

Say = Callable[[str], None]  # Called with a line, or a sentence for people.

HOST = "127.0.0.1"  # that serves lines
BACKLOG = 1024  # Clients that connect at the same instant.
RATE_S = 2.0  # in which samples are counted for their rate
SILENT_S = 1.5  # without samples, after which a source is called silent
STATUS_S = 0.2  # Between two statuses.
MAX_WAITING = 10_000  # Messages in the queue; more are dropped.
CLOSING_S = 5.0  # Timeout of the end of the process.


@dataclass(frozen=True)
class Outlets:
    """Where lines, those of the end, and remarks go; and the process that is sent the status."""

    emit: Say
    emit_end: Say | None
    remark: Say
    watcher: ListenerProcess | None = None


@contextmanager
def open_outlets(
    serve: int | None, view: tuple[str, int] | None, print_line: Say, remark: Say, plan: Plan | None = None
) -> Iterator[Outlets]:
    """Serve the lines, which are then not printed, on a port, and the page on host and port; None for neither.

    The page draws on the `plan`. Lines go to `print_line`, sentences for people to `remark`. Raises `StreamError` if a
    port cannot be served.
    """
    with ExitStack() as opened:
        lines = None if serve is None else opened.enter_context(open_port(HOST, serve, "--serve"))
        page = None if view is None else opened.enter_context(open_port(*view, "--port or --host"))
        if lines is not None:
            remark(f"lines are served on {HOST}:{lines.getsockname()[1]}.")
        if page is not None and view is not None:
            remark(f"the walk is shown on {describe_page(view[0], page)}.")
        if lines is None and page is None:
            yield Outlets(print_line, print_line, remark)
            return
        host = HOST if view is None else view[0]
        listeners = opened.enter_context(closing(ListenerProcess(lines, page, host, remark)))
        if plan is not None:
            listeners.show_plan(plan)
        emit = listeners.send_line if lines is not None else _both(print_line, listeners.send)
        if page is None:
            yield Outlets(emit, None, remark)
            return
        emit_end = listeners.send if lines is not None else emit
        yield Outlets(emit, emit_end, _both(remark, listeners.send_remark), listeners)


def _both(first: Say, second: Say) -> Say:
    def say(words: str) -> None:
        first(words)
        second(words)

    return say


def open_port(host: str, port: int, option: str) -> socket.socket:
    """Return a listening socket; port 0 chooses a free one.

    Raises `StreamError` if the port is taken, or is none; `option` is that of the command line which chose it.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family, backlog=BACKLOG)
    except (OSError, OverflowError, UnicodeError) as error:
        reason = describe_reason(error)
        raise StreamError(f"port {port} cannot be served on {host} ({reason}): choose another {option}.") from None


def format_address(host: str, port: int) -> str:
    """Return the address of a page for a browser of this machine."""
    host = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)
    return f"http://[{host}]:{port}/" if ":" in host else f"http://{host}:{port}/"


def describe_page(host: str, door: socket.socket) -> str:
    """Return the address of a page, and who reaches it, in words."""
    reach = "for all who reach this machine: there is no password, and no encryption"
    reach = "for this machine alone" if is_loopback(host) else reach
    return f"{format_address(host, door.getsockname()[1])} ({reach})"


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches an address."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


class ListenerProcess:
    """Passes lines, statuses and remarks to the process, without waiting.

    `lines` and `page` are listening sockets, which are closed here once the process has them; `host` the page's for the
    user; `remark` takes a sentence if the process ends before its time.
    """

    def __init__(
        self, lines: socket.socket | None, page: socket.socket | None, host: str, remark: Callable[[str], None]
    ) -> None:
        self.viewers = 0
        self._remark, self._closing, self._has_ended = remark, False, False
        self._messages: queue.Queue[bytes | None] = queue.Queue(MAX_WAITING)
        doors = [door for door in (lines, page) if door is not None]
        descriptors = [-1 if door is None else door.fileno() for door in (lines, page)]
        passed = [door.fileno() for door in doors]
        self._process = start_module("fg_nav.view.servers", *map(str, descriptors), host, pass_fds=passed)
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

    def show_plan(self, plan: Plan) -> None:
        """Draw a plan under the path."""
        self._put("show_plan", [str(plan.path.resolve()), plan.type, plan.describe()])

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
                self.viewers = int(answer)
        self.viewers = 0
        self._has_ended = True
        if not self._closing:
            self._remark("what serves the walk has ended: it goes on unseen.")


class StatusReporter:
    """Measures rate, latency and silence while a source is followed, and sends the status while somebody watches."""

    def __init__(self, watcher: ListenerProcess) -> None:
        self._watcher = watcher
        self._due = self._arrived = time.monotonic()
        self._silent_since: float | None = None
        self._counts: deque[tuple[float, int]] = deque()
        self._latency_ms: float | None = None

    def count_samples(self, count: int) -> None:
        """Note how many samples have come, at each read: one that finds none begins a silence."""
        now = time.monotonic()
        if count:
            self._arrived, self._silent_since = now, None
            self._counts.append((now, count))
        elif self._silent_since is None:
            self._silent_since = now

    def note_line(self) -> None:
        """Note that a line was just sent."""
        self._latency_ms = 1e3 * (time.monotonic() - self._arrived)

    def report(self, describe: Callable[[], dict[str, Any]], lost: Mapping[str, int], ended: bool = False) -> None:
        """Send the status if it is due and somebody watches; at the end always.

        `describe` returns what the samples so far show, in some milliseconds; `lost` is that of `LossCounter`.
        """
        now = time.monotonic()
        while self._counts and self._counts[0][0] < now - RATE_S:
            self._counts.popleft()
        if not (ended or (now >= self._due and self._watcher.viewers)):
            return
        self._due = now + STATUS_S
        silent_s = 0.0 if self._silent_since is None else now - self._silent_since
        source = "ok" if silent_s < SILENT_S else f"silent {silent_s:.0f} s"
        flow = {
            "latency_ms": None if ended or self._latency_ms is None else round(self._latency_ms, 1),
            "rate_hz": None if ended else round(sum(count for _, count in self._counts) / RATE_S, 1),
            "lost_samples": lost["samples"],
            "lost_datagrams": lost["datagrams"],
            "source": "ended" if ended else source,
        }
        self._watcher.send_status({**describe(), **flow})
