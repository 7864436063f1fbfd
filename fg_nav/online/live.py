"""Sources that do not wait: what a sensor sends over UDP, TCP or a serial line while the walk is being computed.

Each is read in a thread of its own, into a queue: at 400 Hz a serial line would overflow after a tenth of a second, the
system's buffer for datagrams after some seconds. TCP and a serial line are opened again whenever they break.
"""

from __future__ import annotations

import socket
import sys
import threading
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Iterator
from contextlib import suppress

from fg_nav.online.connections import PIECE, POLL_S, Connector, Remark, SenderLock

RETRY_S = 0.5  # Between two attempts to connect.
REMARK_S = 10.0  # Between two remarks about a line that breaks again and again.
MAX_WAITING = 1 << 26  # Bytes in the queue: ten minutes of a fast sensor.
SYSTEM_BUFFER = 1 << 23  # Bytes that the system is asked to keep of datagrams; it may give less.

_SO_RCVBUFFORCE, _SO_RXQ_OVFL = 33, 40
"""Of Linux, which Python does not name: more buffer than users have, and the count of datagrams without room."""


class LiveSource(ABC):
    """A `ByteSource` that a thread reads; who makes one starts it."""

    def __init__(self, name: str, remark: Remark) -> None:
        self.name, self.away_s = name, 0.0
        self._remark = remark
        self._waiting: deque[tuple[float, bytes]] = deque()
        self._size = 0
        self._changed = threading.Condition()
        self._closed = threading.Event()
        self._failure: Exception | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    @property
    def lost(self) -> int:
        """See `ByteSource`: a stream of bytes loses none."""
        return 0

    def read(self, wait_s: float) -> bytes | None:
        """See `ByteSource`: all that waits, up to where the source was away."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._failure is not None, wait_s)
            if self._failure is not None and not self._waiting:
                raise self._failure
            self.away_s = 0.0
            pieces: list[bytes] = []
            while self._waiting and not (pieces and self._waiting[0][0] > 0.0):
                away_s, piece = self._waiting.popleft()
                self.away_s += away_s
                self._size -= len(piece)
                pieces.append(piece)
            self._changed.notify_all()
        return b"".join(pieces)

    def close(self) -> None:
        """Close it."""
        self._closed.set()
        with self._changed:
            self._changed.notify_all()
        self._thread.join(4.0 * POLL_S)

    @abstractmethod
    def _receive(self) -> Iterator[tuple[float, bytes]]:
        """Yield how long the source was away, s, and what came then, until it is closed."""

    def _make_room(self, size: int) -> bool:
        """Return whether a piece of some bytes is put into the queue, once there is room."""
        with self._changed:
            return self._changed.wait_for(lambda: self._size + size < MAX_WAITING or self._closed.is_set())

    def _run(self) -> None:
        try:
            for away_s, piece in self._receive():
                if self._make_room(len(piece)):
                    with self._changed:
                        self._waiting.append((away_s, piece))
                        self._size += len(piece)
                        self._changed.notify_all()
        except Exception as error:  # it rises where the source is read
            with self._changed:
                self._failure = error
                self._changed.notify_all()


class Datagrams(LiveSource):
    """UDP on an address of this machine; each datagram holds whole lines. What is lost is lost, and counted."""

    def __init__(self, name: str, host: str, port: int, remark: Remark) -> None:
        kind = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._socket = socket.socket(kind, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except (OSError, OverflowError):
            self._socket.close()
            raise
        self._socket.settimeout(POLL_S)
        self._buffer = _enlarge_buffer(self._socket)
        self._senders = SenderLock(name, remark)
        self._lost_in_system = self._lost_in_queue = 0
        super().__init__(name, remark)

    @property
    def lost(self) -> int:
        """Datagrams for which neither the system's buffer nor the queue had room."""
        return self._lost_in_system + self._lost_in_queue

    def close(self) -> None:
        """Close it."""
        super().close()
        self._socket.close()
        if self.lost:
            self._remark(f"{self.lost} datagrams from {self.name} found no room here in all.")

    def _receive(self) -> Iterator[tuple[float, bytes]]:
        while not self._closed.is_set():
            try:
                piece, notes, _, sender = self._socket.recvmsg(PIECE, socket.CMSG_SPACE(4))
            except TimeoutError:
                continue
            self._count_lost(notes)
            away_s = self._senders.admit(sender[0], sender[1])
            if away_s is not None:
                yield away_s, piece if piece.endswith(b"\n") else piece + b"\n"

    def _make_room(self, size: int) -> bool:
        """Return whether there is room; a datagram does not wait for it."""
        if self._size + size < MAX_WAITING:
            return True
        self._note_lost(self._lost_in_system, self._lost_in_queue + 1)
        return False

    def _count_lost(self, notes: list[tuple[int, int, bytes]]) -> None:
        """Take the system's count of the datagrams that it had no room for."""
        for level, kind, value in notes:
            if (level, kind) == (socket.SOL_SOCKET, _SO_RXQ_OVFL):
                self._note_lost(int.from_bytes(value, sys.byteorder), self._lost_in_queue)

    def _note_lost(self, in_system: int, in_queue: int) -> None:
        if in_system + in_queue and not self.lost:
            self._remark(
                f"datagrams from {self.name} are lost here: this machine has too much to do, or its buffer of "
                f"{self._buffer >> 10} kB is too small (net.core.rmem_max)."
            )
        self._lost_in_system, self._lost_in_queue = in_system, in_queue


def _enlarge_buffer(receiver: socket.socket) -> int:
    """Ask for a large buffer, and for the count of what it has no room for, where the system has them.

    Returns the bytes that the system gave, its own for each datagram among them.
    """
    if sys.platform == "linux":
        with suppress(OSError):
            receiver.setsockopt(socket.SOL_SOCKET, _SO_RXQ_OVFL, 1)
    # Without the right to force a buffer, the system gives as much as it allows to anybody.
    for option in (socket.SO_RCVBUF, *([_SO_RCVBUFFORCE] if sys.platform == "linux" else [])):
        with suppress(OSError):
            receiver.setsockopt(socket.SOL_SOCKET, option, SYSTEM_BUFFER)
    return receiver.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)


class Reconnected(LiveSource):
    """A connection that is opened again whenever it breaks; the walk goes on."""

    def __init__(self, name: str, connector: Connector, remark: Remark) -> None:
        self._connector = connector
        self._remarked = -float("inf")
        super().__init__(name, remark)

    def close(self) -> None:
        """Close it."""
        super().close()
        self._connector.close()

    def _receive(self) -> Iterator[tuple[float, bytes]]:
        lost_at: float | None = None
        while not self._closed.is_set():
            # Connect, the first time or again.
            link = self._connector.connect()
            if link is None:
                if lost_at is None:
                    self._remark_seldom(f"{self.name} is not there yet: waiting for it.")
                self._closed.wait(RETRY_S)
                continue
            # Read until it breaks; the first piece says for how long there was no connection.
            away_s = 0.0 if lost_at is None else time.monotonic() - lost_at
            try:
                while not self._closed.is_set() and (piece := link.read()) is not None:
                    if piece:
                        yield away_s, piece
                        away_s = 0.0
            finally:
                link.close()
            lost_at = time.monotonic() if lost_at is None or away_s == 0.0 else lost_at
            if not self._closed.is_set():
                self._remark_seldom(f"{self.name} broke off: waiting for it.")
                self._closed.wait(RETRY_S)

    def _remark_seldom(self, words: str) -> None:
        now = time.monotonic()
        if now - self._remarked > REMARK_S:
            self._remarked = now
            self._remark(words)
