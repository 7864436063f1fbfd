"""Where samples come from (docs/online.md); one asyncio loop reads all sources of a walk.

Standard input, files and recordings are read when their rows are needed. The others do not wait (`LiveSource`): a task
of the loop reads each into a queue while another thread computes the walk, for at 400 Hz a serial line would overflow
after a tenth of a second, the system's buffer for datagrams after some seconds.
"""

from __future__ import annotations

import asyncio
import os
import socket
import stat
import sys
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Awaitable, Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias
from urllib.parse import urlsplit

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import StreamError, describe_reason
from fg_nav.io import read
from fg_nav.online.buffer import rows_of
from fg_nav.online.rows import Columns, RowReader
from fg_nav.recording import Recording
from fg_nav.samples.readings import COLUMNS
from fg_nav.text import suggest_install

Remark = Callable[[str], None]  # Called with a sentence for people.
Connection: TypeAlias = tuple[Callable[[], Awaitable[bytes]], Callable[[], None]]  # Read, b"" at the end; close.

PIECE = 1 << 16  # bytes that are read and parsed at once, 15 ms of the loop; no datagram has more
POLL_S = 0.05  # period at which a file is checked for more
AS_FAST_AS_POSSIBLE = "max"  # in place of a speed
MAX_AT_ONCE = 1000  # samples of a recording, or datagrams, so that a stop is seen between two blocks
CONNECT_S = 10.0  # in which a server must answer; a sensor that has not connected by then is said not to be there
RETRY_S = 0.5  # between two attempts to connect
RESTARTED_S = 2.0  # silence after which another port of the same host is the same sensor, switched on again
REMARK_S = 10.0  # between two remarks about a line that breaks again and again
MAX_WAITING = 1 << 26  # bytes in the queue: ten minutes of a fast sensor
SYSTEM_BUFFER = 1 << 23  # bytes of datagrams requested from the system, which may give less
KEEPALIVE = {"TCP_KEEPIDLE": 4, "TCP_KEEPINTVL": 2, "TCP_KEEPCNT": 3}  # a dead peer is found within ten seconds
_SO_RCVBUFFORCE, _SO_RXQ_OVFL = 33, 40  # of Linux, without a name in Python: a larger buffer; count of datagrams lost


# --- samples ---------------------------------------------------------------------------------------------------------


class SampleSource(ABC):
    """A stream of samples; `name` is for messages, `lost` counts datagrams for which this machine had no room."""

    name: str
    lost = 0
    reader: RowReader | None = None  # Of text.

    def start(self) -> None:
        """Begin to receive, in the running loop."""
        return

    @abstractmethod
    async def read(self) -> Floats | None:
        """Return samples (n, 11) once some have come, None at the end; if it is cancelled, none is lost."""

    def finish(self) -> Floats:
        """Return what is left at the end; raises `FormatError` if nothing could be parsed."""
        return np.empty((0, COLUMNS))

    def close(self) -> None:
        """Close it, behind the end of the loop."""
        return


class TextSource(SampleSource):
    """Samples in lines of text."""

    reader: RowReader
    away_s, _has_ended = 0.0, False  # How long it was not connected before the bytes that were received last.

    def __init__(self, reader: RowReader) -> None:
        self.name, self._remark, self.reader = reader.name, reader.remark, reader

    async def read(self) -> Floats | None:
        """See `SampleSource`."""
        piece = await self._read_bytes()
        self._has_ended = piece is None
        return None if piece is None else self.reader.read(piece, self.away_s)

    def finish(self) -> Floats:
        """See `SampleSource`."""
        rows = self.reader.finish(is_cut=not self._has_ended)
        if self.reader.bad:
            self._remark(f"{self.reader.bad} rows were left out in all.")
        return rows

    @abstractmethod
    async def _read_bytes(self) -> bytes | None:
        """Return bytes once some have come, None at the end."""


class Replay(SampleSource):
    """The samples of a recording as of `fg_nav.io.read`, `speed` times as fast as they were measured."""

    def __init__(self, recording: Recording, speed: float, name: str) -> None:
        self.name, self._rows, self._given = name, rows_of(recording), 0
        self._due = (recording.t - recording.t[0]) / speed
        self._began: float | None = None

    async def read(self) -> Floats | None:
        """See `SampleSource`."""
        if self._given == len(self._rows):
            return None
        self._began = time.monotonic() if self._began is None else self._began
        wait_s = float(self._due[self._given]) + self._began - time.monotonic()
        if wait_s > 0.0:
            await asyncio.sleep(wait_s)
        until = int(np.searchsorted(self._due, time.monotonic() - self._began, side="right"))
        first, self._given = self._given, min(max(until, self._given), self._given + MAX_AT_ONCE)
        return self._rows[first : self._given]


def open_samples(word: str, columns: Columns | None, baud: int, speed: str | None, remark: Remark) -> SampleSource:
    """Open a source of samples: rows, or with a speed a recording; raises `FgNavError` if it cannot be opened."""
    if speed is None:
        return open_source(word, columns, baud, remark)
    if columns is not None:
        raise StreamError("--columns is for rows of a stream, and --speed replays a recording: leave one of them out.")
    if word == "-" or "://" in word:
        raise StreamError(f"--speed replays a recording, and {word} is none: name a file, or leave --speed out.")
    factor = np.nan
    with suppress(ValueError):
        factor = np.inf if speed == AS_FAST_AS_POSSIBLE else float(speed)
    if not factor > 0.0:
        raise StreamError(f"--speed {speed} is no factor: give one above zero, or {AS_FAST_AS_POSSIBLE}.")
    return Replay(read(Path(word)), factor, Path(word).name)


def open_source(word: str, columns: Columns | None, baud: int, remark: Remark) -> TextSource:
    """Open a source of rows by the name that the user gave; raises `StreamError` if it cannot be opened."""
    if word == "-":
        if sys.stdin is None:
            raise StreamError("there is no standard input: name another source.")
        return Pipe(RowReader("standard input", remark, columns), sys.stdin.fileno())
    reader = RowReader(word, remark, columns)
    scheme = word.partition("://")[0].lower() if "://" in word else ""
    kinds: dict[str, Callable[[RowReader, str, int], TextSource]]
    kinds = {"tcp": TcpClient, "tcp-listen": TcpListener, "udp": Datagrams}
    try:
        if scheme in kinds:
            port = None
            with suppress(ValueError):
                port = urlsplit(word).port
            if port is None:
                raise StreamError(f"{word} has no port: give {scheme}://host:port.")
            return kinds[scheme](reader, urlsplit(word).hostname or "127.0.0.1", port)
        if scheme:
            raise StreamError(
                f"{word} is no source: give -, a file, a serial device, or tcp, tcp-listen or udp and ://host:port."
            )
        mode = os.stat(word).st_mode
        if stat.S_ISCHR(mode) and word != os.devnull:
            return SerialDevice(reader, baud)
        if stat.S_ISFIFO(mode):
            return Pipe(reader, os.open(word, os.O_RDONLY | os.O_NONBLOCK))  # or it waits for a writer
        return GrowingFile(RowReader(Path(word).name, remark, columns), Path(word))
    except (OSError, UnicodeError) as error:  # the other is of a host that is no name
        reason = describe_reason(error)
        raise StreamError(f"{word} cannot be opened ({reason}): check its name, and that it is there.") from None


# --- pipes and files -------------------------------------------------------------------------------------------------


async def wait_readable(descriptor: int) -> None:
    """Return once a descriptor can be read; a file always can."""
    loop, ready = asyncio.get_running_loop(), asyncio.Event()
    try:
        loop.add_reader(descriptor, ready.set)
    except PermissionError:  # a file, as of `fg-nav stream - < walk.csv`
        return
    try:
        await ready.wait()
    finally:
        loop.remove_reader(descriptor)


class Pipe(TextSource):
    """A pipe, until its end."""

    def __init__(self, reader: RowReader, descriptor: int) -> None:
        super().__init__(reader)
        self._descriptor = descriptor

    async def _read_bytes(self) -> bytes | None:
        await wait_readable(self._descriptor)
        return os.read(self._descriptor, PIECE) or None


class GrowingFile(TextSource):
    """A file that is being written; it has no end, unless it is cut or removed."""

    def __init__(self, reader: RowReader, path: Path) -> None:
        super().__init__(reader)
        self._path, self._place = path, 0
        self._file = path.open("rb", buffering=0)

    async def _read_bytes(self) -> bytes | None:
        while not (piece := self._file.read(PIECE)):
            if os.fstat(self._file.fileno()).st_size < self._place or not self._path.exists():
                return None
            await asyncio.sleep(POLL_S)
        self._place += len(piece)
        return piece

    def close(self) -> None:
        """See `SampleSource`."""
        self._file.close()


# --- sensors that do not wait ----------------------------------------------------------------------------------------


class LiveSource(TextSource):
    """A source that a task reads into a queue, from `start` on."""

    def __init__(self, reader: RowReader) -> None:
        super().__init__(reader)
        self._waiting: deque[tuple[float, bytes]] = deque()
        self._size, self._senders = 0, SenderLock(self.name, self._remark)

    def start(self) -> None:
        """See `SampleSource`."""
        self._has_come, self._has_room = asyncio.Event(), asyncio.Event()
        self._task = asyncio.get_running_loop().create_task(self._receive())
        self._task.add_done_callback(lambda task: self._has_come.set())

    async def _read_bytes(self) -> bytes:
        """Return what waits, `PIECE` bytes at most, up to where the source was away."""
        await self._has_come.wait()
        if not self._waiting:
            self._task.result()  # raises what ended it
        self.away_s, data = self._waiting.popleft()
        while self._waiting and self._waiting[0][0] == 0.0 and len(data) + len(self._waiting[0][1]) <= PIECE:
            data += self._waiting.popleft()[1]
        self._size -= len(data)
        if not self._waiting and not self._task.done():
            self._has_come.clear()
        self._has_room.set()
        return data

    @abstractmethod
    async def _receive(self) -> None:
        """Put what comes into the queue, until it is cancelled."""

    def _put(self, away_s: float, piece: bytes) -> None:
        """Put what came after so long without a connection into the queue."""
        self._waiting.append((away_s, piece))
        self._size, self._senders.last = self._size + len(piece), time.monotonic()
        self._has_come.set()


class SenderLock:
    """Keeps a walk to one sender: the first one, and that of its host once the first is silent."""

    def __init__(self, name: str, remark: Remark) -> None:
        self._name, self._remark, self._others = name, remark, set[str]()
        self._host, self._port = "", 0  # A sender that was switched off and on has another port.
        self.last = -np.inf  # When the sender has sent something, by the monotonic clock.

    def accept(self, host: str, port: int, is_gone: bool = False) -> float | None:
        """Return how long the sender was away, s; None for another one. `is_gone`: the one before has ended."""
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


class Datagrams(LiveSource):
    """UDP on an address of this machine; each datagram holds whole lines. What is lost is lost, and counted."""

    def __init__(self, reader: RowReader, host: str, port: int) -> None:
        super().__init__(reader)
        kind = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._socket = socket.socket(kind, socket.SOCK_DGRAM)
        self._socket.bind((host, port))
        self._socket.setblocking(False)
        # A large buffer, and the count of datagrams without room. Without the right to force a buffer, the system gives
        # as much as it allows to anybody.
        options = [(socket.SO_RCVBUF, SYSTEM_BUFFER)]
        if sys.platform == "linux":
            options += [(_SO_RXQ_OVFL, 1), (_SO_RCVBUFFORCE, SYSTEM_BUFFER)]
        for option, value in options:
            with suppress(OSError):
                self._socket.setsockopt(socket.SOL_SOCKET, option, value)
        self._lost_in_system = self._lost_in_queue = 0

    def close(self) -> None:
        """See `SampleSource`."""
        self._socket.close()
        if self.lost:
            self._remark(f"{self.lost} datagrams from {self.name} found no room here in all.")

    async def _receive(self) -> None:
        loop = asyncio.get_running_loop()
        loop.add_reader(self._socket, self._take_datagrams)
        try:
            await asyncio.Event().wait()  # for ever
        finally:
            loop.remove_reader(self._socket)

    def _take_datagrams(self) -> None:
        """Put the datagrams that have come into the queue."""
        with suppress(BlockingIOError):
            for _ in range(MAX_AT_ONCE):
                piece, notes, _, sender = self._socket.recvmsg(PIECE, socket.CMSG_SPACE(4))
                for level, kind, value in notes:
                    if (level, kind) == (socket.SOL_SOCKET, _SO_RXQ_OVFL):  # all those the system had no room for
                        self._lost_in_system = int.from_bytes(value, sys.byteorder)
                away_s = self._senders.accept(sender[0], sender[1])
                if away_s is not None and self._size < MAX_WAITING:
                    self._put(away_s, piece if piece.endswith(b"\n") else piece + b"\n")
                elif away_s is not None:
                    self._lost_in_queue += 1
        was_complete, self.lost = self.lost == 0, self._lost_in_system + self._lost_in_queue
        if was_complete and self.lost:
            size = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
            self._remark(
                f"datagrams from {self.name} are lost here: this machine has too much to do, or its buffer of "
                f"{size >> 10} kB is too small (net.core.rmem_max)."
            )


class ConnectedSource(LiveSource):
    """A connection to a sensor, opened again whenever it breaks; the walk goes on."""

    _remarked = -np.inf  # When a remark was made on it.

    @abstractmethod
    async def _connect(self) -> Connection:
        """Open the connection; raises `OSError` while there is none."""

    async def _receive(self) -> None:
        lost_at: float | None = None
        while True:
            # Connect, the first time or again.
            try:
                async with asyncio.timeout(CONNECT_S):
                    read, close = await self._connect()
            except OSError:
                if lost_at is None:
                    self._remark_seldom(f"{self.name} is not there yet: waiting for it.")
                await asyncio.sleep(RETRY_S)
                continue
            # Read until it breaks; the first piece says for how long there was no connection.
            away_s = 0.0 if lost_at is None else time.monotonic() - lost_at
            try:
                with suppress(OSError):
                    while piece := await read():
                        self._put(away_s, piece)
                        away_s = 0.0
                        while self._size > MAX_WAITING:  # that holds a TCP sender up, and loses nothing
                            self._has_room.clear()
                            await self._has_room.wait()
            finally:
                with suppress(OSError):
                    close()
            lost_at = time.monotonic() if lost_at is None or away_s == 0.0 else lost_at
            self._remark_seldom(f"{self.name} broke off: waiting for it.")
            await asyncio.sleep(RETRY_S)

    def _remark_seldom(self, words: str) -> None:
        if time.monotonic() - self._remarked > REMARK_S:
            self._remarked = time.monotonic()
            self._remark(words)


class SerialDevice(ConnectedSource):
    """A serial device; raises `StreamError` if pyserial is not installed, or the device cannot be opened."""

    def __init__(self, reader: RowReader, baud: int) -> None:
        super().__init__(reader)
        missing = f"pyserial is not installed: {suggest_install('serial')}."
        try:
            import serial

            self._open: Callable[[], Any] = partial(serial.serial_for_url, self.name, baud, timeout=0)
            self._first: Any = self._open()
        except ImportError:
            raise StreamError(f"{self.name} is a serial device, and {missing}") from None
        except (OSError, ValueError) as error:
            reason = str(error).partition("\n")[0]
            words = f"{self.name} cannot be opened as a serial device ({reason}): check it and --baud."
            raise StreamError(words) from None

    async def _connect(self) -> Connection:
        port, self._first = self._first or self._open(), None

        async def read() -> bytes:
            await wait_readable(port.fileno())
            return bytes(port.read(PIECE))

        return read, port.close


class TcpClient(ConnectedSource):
    """The sensor is a server; raises `OSError` if its host has no address."""

    def __init__(self, reader: RowReader, host: str, port: int) -> None:
        super().__init__(reader)
        self._address = host, port
        socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)

    async def _connect(self) -> Connection:
        return _link(*await asyncio.open_connection(*self._address))


class TcpListener(ConnectedSource):
    """The sensor connects to an address of this machine; raises `OSError` if that is taken."""

    def __init__(self, reader: RowReader, host: str, port: int) -> None:
        super().__init__(reader)
        kind = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._listener = socket.create_server((host, port), family=kind)
        self._writer: asyncio.StreamWriter | None = None  # Of the newest connection.

    def close(self) -> None:
        """See `SampleSource`."""
        self._listener.close()

    async def _receive(self) -> None:
        self._accepted = asyncio.Queue[tuple[asyncio.StreamReader, asyncio.StreamWriter]]()
        server = await asyncio.start_server(self._accept, sock=self._listener)
        try:
            await super()._receive()
        finally:  # without `async with`, which would wait for the end of each connection
            server.close()
            while not self._accepted.empty():
                self._accepted.get_nowait()[1].close()

    async def _connect(self) -> Connection:
        return _link(*await self._accepted.get())

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Take a connection if it is that of the sensor, in place of its old one, else end it."""
        await asyncio.sleep(POLL_S)  # for the end of the old one, which came before
        host, port, *_ = writer.get_extra_info("peername")
        old = self._writer
        if self._senders.accept(host, port, old is None or old.is_closing()) is None:
            writer.close()
            return
        if old is not None:
            old.close()
        self._writer = writer
        self._accepted.put_nowait((reader, writer))


def _link(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> Connection:
    """Return a TCP connection; the system finds out where its other end is gone without a word."""
    connection: socket.socket = writer.get_extra_info("socket")
    with suppress(OSError):  # it is gone already
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for name, value in KEEPALIVE.items():
            if hasattr(socket, name):
                connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)
    return partial(reader.read, PIECE), writer.close
