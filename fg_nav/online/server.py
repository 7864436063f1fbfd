"""Lines for whoever connects to a port of this machine, from the moment on at which they connect."""

from __future__ import annotations

import socket
import threading
from contextlib import suppress

from fg_nav.errors import StreamError

SLOW_S = 0.2
"""A listener who does not take a line for so long is let go: the walk does not wait."""


class LineServer:
    """Serves lines on 127.0.0.1 at a port; 0 for a free one. `port` is the one it has.

    Raises
    ------
    StreamError
        If the port is taken.
    """

    def __init__(self, port: int) -> None:
        self._lock = threading.Lock()
        self._listeners: list[socket.socket] = []
        try:
            self._door = socket.create_server(("127.0.0.1", port))
        except (OSError, OverflowError) as error:
            reason = (getattr(error, "strerror", None) or str(error)).lower()
            raise StreamError(f"port {port} cannot be served ({reason}): choose another --serve.") from None
        self.port = int(self._door.getsockname()[1])
        threading.Thread(target=self._welcome, daemon=True).start()

    def tell(self, line: str) -> None:
        """Send a line to all who listen."""
        data = (line + "\n").encode()
        with self._lock:
            self._listeners = [listener for listener in self._listeners if _sent(listener, data)]

    def close(self) -> None:
        """Say goodbye to all."""
        with suppress(OSError):
            self._door.shutdown(socket.SHUT_RDWR)
        self._door.close()
        with self._lock:
            for listener in self._listeners:
                listener.close()
            self._listeners = []

    def _welcome(self) -> None:
        while True:
            try:
                listener, _ = self._door.accept()
            except OSError:
                return
            listener.settimeout(SLOW_S)
            with self._lock:
                self._listeners.append(listener)


def _sent(listener: socket.socket, data: bytes) -> bool:
    try:
        listener.sendall(data)
    except OSError:
        listener.close()
        return False
    return True
