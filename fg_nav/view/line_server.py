"""Ports of this machine, and the server of JSON lines.

Each client of lines gets those made after its connection, written into the buffers of all clients at once. A client
whose buffer exceeds `MAX_WAITING` does not read, and is disconnected, as is one that sends more than `MAX_RECEIVED`;
input is discarded.
"""

from __future__ import annotations

import asyncio
import ipaddress
import resource
import socket
from typing import cast

from fg_nav.errors import StreamError

BACKLOG = 1024  # Clients that connect at the same instant.
AT_ONCE = 8  # Of these accepted in one pass of the loop: a thousand handshakes in one go delay a line.
SPARE_DESCRIPTORS = 64  # Of the process, left for the walk: its record, its source, its worker.
MAX_WAITING = 1 << 18  # Bytes; ten minutes of walking, beside the buffer of the system.
MAX_RECEIVED = 1 << 16  # Bytes from a client, which has nothing to send.


def open_port(host: str, port: int, option: str) -> socket.socket:
    """Return a listening socket; port 0 chooses a free one.

    Raises `StreamError` if the port is taken, or is none; `option` is that of the command line which chose it.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family, backlog=BACKLOG)
    except (OSError, OverflowError, UnicodeError) as error:
        reason = (getattr(error, "strerror", None) or str(error)).lower()
        raise StreamError(f"port {port} cannot be served on {host} ({reason}): choose another {option}.") from None


def format_address(host: str, port: int) -> str:
    """Return the address of a page for a browser of this machine."""
    host = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)
    return f"http://[{host}]:{port}/" if ":" in host else f"http://{host}:{port}/"


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches an address."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def is_last_descriptor(descriptor: int) -> bool:
    """Whether a socket has one of the last descriptors of the process, which assigns the lowest free one."""
    most = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    return most != resource.RLIM_INFINITY and descriptor >= most - SPARE_DESCRIPTORS


class LineServer:
    """Serves lines to the clients of a listening socket, from an asyncio loop."""

    def __init__(self) -> None:
        self._clients: set[asyncio.Transport] = set()

    @property
    def listeners(self) -> int:
        """Number of connected clients."""
        return len(self._clients)

    async def open(self, door: socket.socket) -> None:
        """Serve on a socket."""
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(lambda: _Client(self._clients), sock=door, backlog=AT_ONCE)
        door.listen(BACKLOG)  # again: asyncio has one number for both

    def send(self, line: str) -> None:
        """Send a line to all clients, without waiting."""
        data = (line + "\n").encode()
        for client in list(self._clients):
            client.write(data)
            if client.get_write_buffer_size() > MAX_WAITING:
                client.abort()

    async def close(self) -> None:
        """Free the port at once, and disconnect all, each after the lines that it takes at once."""
        self._server.close()
        for client in self._clients:
            client.close()
        for _ in range(20):
            if not self._clients:
                break
            await asyncio.sleep(0.05)


class _Client(asyncio.Protocol):
    def __init__(self, clients: set[asyncio.Transport]) -> None:
        self._clients, self._received = clients, 0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast(asyncio.Transport, transport)
        if is_last_descriptor(transport.get_extra_info("socket").fileno()):
            self._transport.abort()
        else:
            self._clients.add(self._transport)

    def data_received(self, data: bytes) -> None:
        self._received += len(data)
        if self._received > MAX_RECEIVED:
            self._transport.abort()

    def connection_lost(self, error: Exception | None) -> None:
        self._clients.discard(self._transport)
