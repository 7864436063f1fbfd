"""Sources that do not wait: what a sensor sends over UDP, TCP or a serial line while the walk is being computed.

Each is read in a thread of its own, into a queue: at 400 Hz a serial line would overflow after a tenth of a second, the
system's buffer for datagrams after some seconds. TCP and a serial line (`Connector`) are opened again whenever they
break.

One walk has one sender (`SenderLock`). Datagrams and connections of another are left out, with a remark that names it:
the stamps of two sensors would make one walk of two. A sender that was switched off and on has another port: its host
is accepted again once its old connection has ended, or nothing came for `RESTARTED_S`.
"""

from __future__ import annotations

import select
import socket
import sys
import threading
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from typing import Any

from fg_nav.errors import StreamError

Remark = Callable[[str], None]  # Called with a sentence for people.

PIECE = 1 << 16  # bytes that are read at once; no datagram has more
POLL_S = 0.2  # period at which a thread checks whether its source was closed
CONNECT_S = 10.0  # a server must answer within it
RETRY_S = 0.5  # between two attempts to connect
RESTARTED_S = 2.0  # silence after which another port of the same host is the same sensor, switched on again
REMARK_S = 10.0  # between two remarks about a line that breaks again and again
MAX_WAITING = 1 << 26  # bytes in the queue: ten minutes of a fast sensor
SYSTEM_BUFFER = 1 << 23  # bytes of datagrams requested from the system, which may give less
KEEPALIVE = {"TCP_KEEPIDLE": 4, "TCP_KEEPINTVL": 2, "TCP_KEEPCNT": 3}  # a dead peer is found within ten seconds

# Of Linux, and without a name in Python: more buffer than users may have, and the count of datagrams without room.
_SO_RCVBUFFORCE, _SO_RXQ_OVFL = 33, 40


class SenderLock:
    """Keeps a walk to one sender: the first one, and that of its host once the first is silent."""

    def __init__(self, name: str, remark: Remark) -> None:
        self._name, self._remark = name, remark
        self._host, self._port = "", 0
        self.last = -float("inf")  # When the sender has sent something, by the monotonic clock.
        self._others: set[str] = set()

    def accept(self, host: str, port: int, is_gone: bool = False) -> float | None:
        """Return how long the sender was away, s, 0 for one that goes on; None for another one, to be left out.

        `is_gone`: the sender of before is known to have ended.
        """
        now = time.monotonic()
        silent_s = now - self.last
        if (host, port) == (self._host, self._port) or not self._host:
            self._host, self._port, self.last = host, port, now
            return 0.0
        if host == self._host and (is_gone or silent_s > RESTARTED_S):
            self._port, self.last = port, now
            return silent_s
        if host not in self._others:
            self._others.add(host)
            self._remark(
                f"{self._name}: what {host} sends from port {port} is left out, for the walk is that of {self._host} "
                f"port {self._port}: a walk has one sensor."
            )
        return None


class Connector(ABC):
    """A connection to a sensor that may break, and be opened again."""

    @abstractmethod
    def connect(self) -> bool:
        """Open the connection; return whether there is one."""

    @abstractmethod
    def read(self) -> bytes | None:
        """Return what came within `POLL_S`, b"" if nothing did, None if the connection is broken."""

    @abstractmethod
    def disconnect(self) -> None:
        """Close the connection."""

    def close(self) -> None:  # noqa: B027
        """Close what accepts connections."""


class _TcpConnector(Connector):
    """An open TCP connection."""

    _socket: socket.socket

    def _hold(self, connection: socket.socket) -> None:
        self._socket = connection
        connection.settimeout(POLL_S)
        with suppress(OSError):  # it is gone already
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            for name, value in KEEPALIVE.items():
                if hasattr(socket, name):
                    connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)

    def read(self) -> bytes | None:
        try:
            return self._socket.recv(PIECE) or None
        except TimeoutError:
            return b""
        except OSError:
            return None

    def disconnect(self) -> None:
        self._socket.close()


class TcpClient(_TcpConnector):
    """The sensor is a server; raises `OSError` if its host has no address."""

    def __init__(self, host: str, port: int) -> None:
        self._address = host, port
        socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)

    def connect(self) -> bool:
        """See `Connector`."""
        try:
            self._hold(socket.create_connection(self._address, CONNECT_S))
        except OSError:
            return False
        return True


class TcpListener(_TcpConnector):
    """The sensor connects to an address of this machine; raises `OSError` if that is taken."""

    def __init__(self, name: str, host: str, port: int, remark: Remark) -> None:
        kind = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._listener = socket.create_server((host, port), family=kind)
        self._senders = SenderLock(name, remark)
        self._next: socket.socket | None = None

    def connect(self) -> bool:
        """See `Connector`."""
        self._accept(POLL_S, is_free=True)
        if self._next is None:
            return False
        self._hold(self._next)
        self._next = None
        return True

    def read(self) -> bytes | None:
        """See `Connector`; a sensor that has connected anew breaks its old connection."""
        self._accept(0.0, is_free=False)
        if self._next is not None:
            return None
        piece = super().read()
        if piece:
            self._senders.last = time.monotonic()
        return piece

    def close(self) -> None:
        """See `Connector`."""
        self._listener.close()

    def _accept(self, wait_s: float, is_free: bool) -> None:
        """Hold the next connection if it is that of the sensor, else end it."""
        if self._next is not None or not select.select([self._listener], [], [], wait_s)[0]:
            return
        try:
            connection, address = self._listener.accept()
        except OSError:  # it has gone already
            return
        if self._senders.accept(address[0], address[1], is_free) is None:
            connection.close()
        else:
            self._next = connection


class SerialDevice(Connector):
    """A serial device, opened at once and again when it is plugged in again; needs pyserial.

    Raises `StreamError` if pyserial is not installed, or the device cannot be opened.
    """

    def __init__(self, path: str, baud: int) -> None:
        try:
            import serial
        except ImportError:
            raise StreamError(
                f"{path} is a serial device, and pyserial is not installed: pip install 'fg-nav[serial]'."
            ) from None
        self._open: Callable[[], Any] = partial(serial.Serial, path, baud, timeout=POLL_S)
        try:
            self._port: Any = self._open()
        except (OSError, ValueError) as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise StreamError(f"{path} cannot be opened as a serial device ({reason}): check it and --baud.") from None
        self._is_first = True

    def connect(self) -> bool:
        """See `Connector`."""
        try:
            self._port = self._port if self._is_first else self._open()
        except (OSError, ValueError):
            return False
        self._is_first = False
        return True

    def read(self) -> bytes | None:
        """See `Connector`."""
        try:
            return bytes(self._port.read(max(1, self._port.in_waiting)))
        except (OSError, TypeError):  # of a port that went away pyserial raises either
            return None

    def disconnect(self) -> None:
        """See `Connector`."""
        with suppress(OSError):
            self._port.close()


class LiveSource(ABC):
    """A `ByteSource` that a thread reads, from its creation on."""

    def __init__(self, name: str, remark: Remark) -> None:
        self.name, self.away_s, self.lost = name, 0.0, 0
        self._remark = remark
        self._waiting: deque[tuple[float, bytes]] = deque()
        self._size = 0
        self._changed = threading.Condition()
        self._closed = threading.Event()
        self._failure: Exception | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

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
        """Wait for room for `size` bytes in the queue, or its closing; return whether the piece is put in."""
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
        except Exception as error:  # raised again where the source is read
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
        # A large buffer, and the count of datagrams without room. Without the right to force a buffer, the system gives
        # as much as it allows to anybody.
        is_linux = sys.platform == "linux"
        if is_linux:
            with suppress(OSError):
                self._socket.setsockopt(socket.SOL_SOCKET, _SO_RXQ_OVFL, 1)
        for option in (socket.SO_RCVBUF, *([_SO_RCVBUFFORCE] if is_linux else [])):
            with suppress(OSError):
                self._socket.setsockopt(socket.SOL_SOCKET, option, SYSTEM_BUFFER)
        self._buffer = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
        self._senders = SenderLock(name, remark)
        self._lost_in_system = self._lost_in_queue = 0
        super().__init__(name, remark)

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
            for level, kind, value in notes:
                if (level, kind) == (socket.SOL_SOCKET, _SO_RXQ_OVFL):  # the system's count of those it had no room for
                    self._note_lost(int.from_bytes(value, sys.byteorder), self._lost_in_queue)
            away_s = self._senders.accept(sender[0], sender[1])
            if away_s is not None:
                yield away_s, piece if piece.endswith(b"\n") else piece + b"\n"

    def _make_room(self, size: int) -> bool:
        """Return whether there is room; a datagram does not wait for it."""
        if self._size + size < MAX_WAITING:
            return True
        self._note_lost(self._lost_in_system, self._lost_in_queue + 1)
        return False

    def _note_lost(self, in_system: int, in_queue: int) -> None:
        if in_system + in_queue and not self.lost:
            self._remark(
                f"datagrams from {self.name} are lost here: this machine has too much to do, or its buffer of "
                f"{self._buffer >> 10} kB is too small (net.core.rmem_max)."
            )
        self._lost_in_system, self._lost_in_queue, self.lost = in_system, in_queue, in_system + in_queue


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
            # connect, the first time or again
            if not self._connector.connect():
                if lost_at is None:
                    self._remark_seldom(f"{self.name} is not there yet: waiting for it.")
                self._closed.wait(RETRY_S)
                continue
            # read until it breaks; the first piece says for how long there was no connection
            away_s = 0.0 if lost_at is None else time.monotonic() - lost_at
            try:
                while not self._closed.is_set() and (piece := self._connector.read()) is not None:
                    if piece:
                        yield away_s, piece
                        away_s = 0.0
            finally:
                self._connector.disconnect()
            lost_at = time.monotonic() if lost_at is None or away_s == 0.0 else lost_at
            if not self._closed.is_set():
                self._remark_seldom(f"{self.name} broke off: waiting for it.")
                self._closed.wait(RETRY_S)

    def _remark_seldom(self, words: str) -> None:
        now = time.monotonic()
        if now - self._remarked > REMARK_S:
            self._remarked = now
            self._remark(words)
