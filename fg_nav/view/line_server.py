"""Serves lines at a port, to each listener from its connection on.

A line is written into the buffers of all listeners at once. One whose buffer holds more than `MAX_WAITING` bytes does
not read, and is disconnected; what listeners send is thrown away, and who sends much is disconnected too.
"""

from __future__ import annotations

import asyncio
import socket
from typing import cast

from fg_nav.view.loop import AT_ONCE, BACKLOG, call_there, is_last_descriptor, run_there, start_loop

MAX_WAITING = 1 << 18  # Bytes; ten minutes of walking, and what the system holds comes on top.
MAX_RECEIVED = 1 << 16  # Bytes from a listener, which has nothing to say.


class LineServer:
    """Serves lines to who connects to a socket that listens."""

    def __init__(self, door: socket.socket) -> None:
        self.port = int(door.getsockname()[1])
        self._listeners: set[asyncio.Transport] = set()
        self._server = run_there(
            start_loop().create_server(lambda: _Listener(self._listeners), sock=door, backlog=AT_ONCE)
        )
        door.listen(BACKLOG)  # again: asyncio has one number for both

    @property
    def listeners(self) -> int:
        """How many are connected."""
        return len(self._listeners)

    def send(self, line: str) -> None:
        """Send a line to all listeners; does not wait for them."""
        call_there(self._write, (line + "\n").encode())

    def close(self) -> None:
        """Disconnect all, each after the lines that it takes at once."""
        run_there(self.end())

    def _write(self, data: bytes) -> None:
        for listener in list(self._listeners):
            listener.write(data)
            if listener.get_write_buffer_size() > MAX_WAITING:
                listener.abort()

    async def end(self) -> None:
        """Give the port back at once, and disconnect all."""
        self._server.close()
        for listener in self._listeners:
            listener.close()
        for _ in range(20):
            if not self._listeners:
                break
            await asyncio.sleep(0.05)


class _Listener(asyncio.Protocol):
    def __init__(self, listeners: set[asyncio.Transport]) -> None:
        self._listeners = listeners
        self._received = 0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast(asyncio.Transport, transport)
        if is_last_descriptor(transport.get_extra_info("socket").fileno()):
            self._transport.abort()
        else:
            self._listeners.add(self._transport)

    def data_received(self, data: bytes) -> None:
        self._received += len(data)
        if self._received > MAX_RECEIVED:
            self._transport.abort()

    def connection_lost(self, error: Exception | None) -> None:
        self._listeners.discard(self._transport)
