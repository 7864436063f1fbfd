"""An asyncio loop in a thread of its own, and sockets that listen on this machine.

Sockets are opened before the thread has them, so that a port that is taken is said at once.
"""

from __future__ import annotations

import asyncio
import contextlib
import ipaddress
import resource
import socket
import threading
from collections.abc import Callable, Coroutine
from typing import Any, TypeVar

from fg_nav.errors import StreamError

BACKLOG = 1024
"""Listeners that connect at the same instant."""

SPARE_DESCRIPTORS = 64
"""Of the process, left for the walk: its checkpoint, its source, its worker."""

CLOSING_S = 2.0
"""How long the end waits for listeners."""

Result = TypeVar("Result")


class LoopThread:
    """Runs an asyncio loop until it is closed."""

    def __init__(self, name: str) -> None:
        self.loop = asyncio.new_event_loop()
        self.loop.set_exception_handler(lambda loop, context: None)  # a listener's fault is no news for the walk
        self._thread = threading.Thread(target=self.loop.run_forever, name=name, daemon=True)
        self._thread.start()

    def run(self, work: Coroutine[Any, Any, Result]) -> Result:
        """Run a coroutine there, and wait for what it returns."""
        return asyncio.run_coroutine_threadsafe(work, self.loop).result()

    def post(self, call: Callable[..., object], *arguments: object) -> None:
        """Have a function called there, and do not wait; after the end nothing is."""
        with contextlib.suppress(RuntimeError):
            self.loop.call_soon_threadsafe(call, *arguments)

    def close(self) -> None:
        """Stop the loop."""
        self.post(self.loop.stop)
        self._thread.join(CLOSING_S)
        if not self._thread.is_alive():
            self.loop.close()


def open_port(host: str, port: int, option: str) -> socket.socket:
    """Return a socket that listens; port 0 asks for a free one.

    Raises
    ------
    StreamError
        If the port is taken, or is none; `option` is what chose it.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family, backlog=BACKLOG)
    except (OSError, OverflowError) as error:
        reason = (getattr(error, "strerror", None) or str(error)).lower()
        raise StreamError(f"port {port} cannot be served on {host} ({reason}): choose another {option}.") from None


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches an address."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def is_last_descriptor(descriptor: int) -> bool:
    """Whether a socket took one of the last descriptors that the process has: the lowest free one is always taken."""
    most = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    return most != resource.RLIM_INFINITY and descriptor >= most - SPARE_DESCRIPTORS
