"""Connections to a sensor, which may break: TCP, from us or to us, and a serial line; and who is heard.

One walk has one sender. Datagrams and connections of another are left out, with a remark that names it: the stamps of
two sensors would make one walk of two. A sender that was switched off and on has another port: its host is taken again
once its old connection has ended, or nothing came for `RESTARTED_S`.
"""

from __future__ import annotations

import select
import socket
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Protocol

from fg_nav.errors import StreamError

Remark = Callable[[str], None]
"""Takes a sentence for people."""

PIECE = 1 << 16  # Bytes that are read at once; no datagram has more.
POLL_S = 0.2  # How often a thread looks whether its source was closed.
CONNECT_S = 10.0  # How long a server may take to answer.
RESTARTED_S = 2.0  # Silence after which another port of the same host is the same sensor, switched on again.


class Link(Protocol):
    """An open connection."""

    def read(self) -> bytes | None:
        """Return what came within `POLL_S`, b"" if nothing did, None where it is broken."""
        ...

    def close(self) -> None:
        """Close it."""
        ...


class Connector(Protocol):
    """What opens a connection."""

    def connect(self) -> Link | None:
        """Return an open connection, or None where there is none yet."""
        ...

    def close(self) -> None:
        """Close what it holds open itself."""
        ...


class SenderLock:
    """Whose datagrams or connections a walk is made of: the first one's, and those of its host once it is silent."""

    def __init__(self, name: str, remark: Remark) -> None:
        self._name, self._remark = name, remark
        self._host, self._port = "", 0
        self._last = -float("inf")
        self._others: set[str] = set()

    def admit(self, host: str, port: int, is_gone: bool = False) -> float | None:
        """Return None for another sender; else how long this one was away before, 0 for one that goes on.

        `is_gone` says that the sender of before is known to have ended.
        """
        now = time.monotonic()
        silent_s = now - self._last
        if (host, port) == (self._host, self._port) or not self._host:
            self._host, self._port, self._last = host, port, now
            return 0.0
        if host == self._host and (is_gone or silent_s > RESTARTED_S):
            self._port, self._last = port, now
            return silent_s
        if host not in self._others:
            self._others.add(host)
            self._remark(
                f"{self._name}: what {host} sends from port {port} is left out, for the walk is that of {self._host} "
                f"port {self._port}: a walk has one sensor."
            )
        return None

    def note(self) -> None:
        """Note that the sender has sent something."""
        self._last = time.monotonic()


class SocketLink:
    """A TCP connection."""

    def __init__(self, connection: socket.socket) -> None:
        self._socket = connection
        self._socket.settimeout(POLL_S)
        _detect_dead_peer(connection)

    def read(self) -> bytes | None:
        """See `Link`."""
        try:
            return self._socket.recv(PIECE) or None
        except TimeoutError:
            return b""
        except OSError:
            return None

    def close(self) -> None:
        """Close it."""
        self._socket.close()


def _detect_dead_peer(connection: socket.socket) -> None:
    """Let the system find out within some ten seconds that a peer is gone without a word."""
    with suppress(OSError):  # it is gone already
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for name, value in (("TCP_KEEPIDLE", 4), ("TCP_KEEPINTVL", 2), ("TCP_KEEPCNT", 3)):
            if hasattr(socket, name):
                connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)


class Server:
    """The sensor is a server, to which we connect; raises `OSError` where its host has no address."""

    def __init__(self, host: str, port: int) -> None:
        self._address = host, port
        socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)

    def connect(self) -> Link | None:
        """See `Connector`."""
        try:
            return SocketLink(socket.create_connection(self._address, CONNECT_S))
        except OSError:
            return None

    def close(self) -> None:
        """See `Connector`."""


class TcpListener:
    """The sensor connects to us, at an address of this machine; raises `OSError` where it is taken."""

    def __init__(self, name: str, host: str, port: int, remark: Remark) -> None:
        kind = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._socket = socket.create_server((host, port), family=kind)
        self._senders = SenderLock(name, remark)
        self._next: socket.socket | None = None

    def connect(self) -> Link | None:
        """See `Connector`."""
        self._admit_next(POLL_S, is_free=True)
        connection, self._next = self._next, None
        return None if connection is None else TcpConnection(connection, self)

    def is_replaced(self) -> bool:
        """Return whether the sensor has connected anew while its old connection was still open."""
        self._admit_next(0.0, is_free=False)
        return self._next is not None

    def note(self) -> None:
        """Note that the sensor has sent something."""
        self._senders.note()

    def close(self) -> None:
        """See `Connector`."""
        self._socket.close()

    def _admit_next(self, wait_s: float, is_free: bool) -> None:
        """Hold the next connection if it is that of the sensor, else end it."""
        if self._next is not None or not select.select([self._socket], [], [], wait_s)[0]:
            return
        try:
            connection, address = self._socket.accept()
        except OSError:  # it has gone already
            return
        if self._senders.admit(address[0], address[1], is_free) is None:
            connection.close()
        else:
            self._next = connection


class TcpConnection(SocketLink):
    """The connection of a sensor at a door."""

    def __init__(self, connection: socket.socket, door: TcpListener) -> None:
        super().__init__(connection)
        self._door = door

    def read(self) -> bytes | None:
        """See `Link`."""
        if self._door.is_replaced():
            return None
        piece = super().read()
        if piece:
            self._door.note()
        return piece


class SerialDevice:
    """A serial device, opened at once and again when it is plugged in again; needs pyserial.

    Raises
    ------
    StreamError
        Where pyserial is not installed, or the device cannot be opened.
    """

    def __init__(self, path: str, baud: int) -> None:
        try:
            import serial
        except ImportError:
            raise StreamError(
                f"{path} is a serial device, and pyserial is not installed: pip install 'fg-nav[serial]'."
            ) from None
        self._path, self._baud, self._serial = path, baud, serial
        try:
            self._first: Link | None = self._open()
        except (OSError, ValueError) as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise StreamError(f"{path} cannot be opened as a serial device ({reason}): check it and --baud.") from None

    def connect(self) -> Link | None:
        """See `Connector`."""
        link, self._first = self._first, None
        if link is not None:
            return link
        try:
            return self._open()
        except (OSError, ValueError):
            return None

    def close(self) -> None:
        """See `Connector`."""

    def _open(self) -> Link:
        return _SerialLink(self._serial.Serial(self._path, self._baud, timeout=POLL_S))


class _SerialLink:
    """An open serial device."""

    def __init__(self, port: Any) -> None:
        self._port = port

    def read(self) -> bytes | None:
        """See `Link`."""
        try:
            return bytes(self._port.read(max(1, self._port.in_waiting)))
        except (OSError, TypeError):  # pyserial's own is an OSError; the other is its own, of a port that went away
            return None

    def close(self) -> None:
        """Close it."""
        with suppress(OSError):
            self._port.close()
