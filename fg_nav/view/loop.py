"""An asyncio loop in a thread of its own, and sockets that listen on this machine.

Sockets are opened before the loop has them, so that a port that is taken is said at once.
"""

from __future__ import annotations

import asyncio
import ipaddress
import resource
import socket
import threading
from collections.abc import Callable, Coroutine
from functools import cache
from typing import Any, TypeVar

from fg_nav.errors import StreamError

BACKLOG = 1024  # Listeners that connect at the same instant.

AT_ONCE = 8
"""Of these that the loop takes before it sees to other things: a thousand handshakes in one go hold up a line."""

SPARE_DESCRIPTORS = 64  # Of the process, left for the walk: its checkpoint, its source, its worker.

Result = TypeVar("Result")


@cache
def start_loop() -> asyncio.AbstractEventLoop:
    """Return the loop, which runs in a thread of its own until the process ends; one serves all ports."""
    loop = asyncio.new_event_loop()
    loop.set_exception_handler(lambda loop, context: None)  # a listener's fault is no news for the walk
    threading.Thread(target=loop.run_forever, name="listeners", daemon=True).start()
    return loop


def run_there(work: Coroutine[Any, Any, Result]) -> Result:
    """Run a coroutine in the loop, and wait for what it returns."""
    return asyncio.run_coroutine_threadsafe(work, start_loop()).result()


def call_there(call: Callable[..., object], *arguments: object) -> None:
    """Have a function called in the loop, and do not wait."""
    start_loop().call_soon_threadsafe(call, *arguments)


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
    except (OSError, OverflowError, UnicodeError) as error:
        reason = (getattr(error, "strerror", None) or str(error)).lower()
        raise StreamError(f"port {port} cannot be served on {host} ({reason}): choose another {option}.") from None


def format_address(host: str, port: int) -> str:
    """Return where a browser of this machine finds a page."""
    host = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)
    return f"http://[{host}]:{port}/" if ":" in host else f"http://{host}:{port}/"


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
