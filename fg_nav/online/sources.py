"""Where samples come from.

==================== =====================================================================================
-                    standard input, until its end
a file               from its beginning, and on as it grows
a serial device      such as /dev/ttyUSB0; needs pyserial
tcp://host:port      from a server, until it closes
udp://host:port      datagrams sent to that address of this machine; each holds whole lines
==================== =====================================================================================

A `SampleSource` gives samples. `TextSource` reads them from a `ByteSource`, one of these, by a `RowReader`.
"""

from __future__ import annotations

import os
import select
import socket
import stat
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol
from urllib.parse import urlsplit

from fg_nav.arrays import Floats
from fg_nav.errors import StreamError
from fg_nav.online.rows import Columns, RowReader

PIECE = 1 << 16
"""Bytes that are read at once."""

POLL_S = 0.05
"""How often a file is looked at for more."""

CONNECT_S = 10.0
"""How long a server may take to answer."""


class ByteSource(Protocol):
    """A stream of bytes; `name` is for messages, `away_s` for how long it was not connected before what was read."""

    name: str
    away_s: float

    def read(self, wait_s: float) -> bytes | None:
        """Return what has come, b"" if nothing came within `wait_s`, None at the end."""
        ...

    def close(self) -> None:
        """Close it."""
        ...


class SampleSource(Protocol):
    """A stream of samples; `name` is for messages."""

    name: str

    @property
    def header(self) -> list[str] | None:
        """Names of the columns that it sends; None where it sends none, or before they are known."""
        ...

    def resume(self, header: Sequence[str]) -> None:
        """Go on by the header of before, where a walk is resumed."""
        ...

    def read(self, wait_s: float) -> Floats | None:
        """Return the samples (n, 10) that have come, n = 0 if none came within `wait_s`, None at the end."""
        ...

    def finish(self) -> Floats:
        """Return what is left at the end; raises `FormatError` where nothing was understood."""
        ...

    def close(self) -> None:
        """Close it."""
        ...


class TextSource:
    """Samples in the text of a source; takes a sentence for people about the first row that it cannot read."""

    def __init__(self, source: ByteSource, remark: Callable[[str], None], columns: Columns | None = None) -> None:
        self.name = source.name
        self._source, self._remark = source, remark
        self._reader = RowReader(source.name, remark, columns)

    @property
    def header(self) -> list[str] | None:
        """See `SampleSource`."""
        return self._reader.header

    def resume(self, header: Sequence[str]) -> None:
        """See `SampleSource`."""
        self._reader.resume(header)

    def read(self, wait_s: float) -> Floats | None:
        """See `SampleSource`."""
        piece = self._source.read(wait_s)
        return None if piece is None else self._reader.read(piece, self._source.away_s)

    def finish(self) -> Floats:
        """See `SampleSource`."""
        rows = self._reader.finish()
        if self._reader.bad:
            self._remark(f"{self._reader.bad} rows were left out in all.")
        return rows

    def close(self) -> None:
        """See `SampleSource`."""
        self._source.close()


def open_source(word: str, baud: int = 115200) -> ByteSource:
    """Open a source by the name that the user gave.

    Raises
    ------
    StreamError
        If it cannot be opened: what is wrong, and what to try.
    """
    if word == "-":
        if sys.stdin is None:
            raise StreamError("there is no standard input: name another source.")
        return _Descriptor("standard input", sys.stdin.fileno())
    scheme = word.partition("://")[0].lower() if "://" in word else ""
    try:
        if scheme in ("tcp", "udp"):
            return _open_socket(word, scheme)
        if scheme:
            raise StreamError(
                f"{word} is no source: give -, a file, a serial device, tcp://host:port or udp://host:port."
            )
        mode = os.stat(word).st_mode
        if stat.S_ISCHR(mode) and word != os.devnull:
            return _Serial(word, baud)
        if stat.S_ISFIFO(mode):
            return _Descriptor(word, os.open(word, os.O_RDONLY | os.O_NONBLOCK))  # or it waits for a writer
        return _GrowingFile(Path(word))
    except OSError as error:
        reason = (error.strerror or str(error) or type(error).__name__).lower()
        raise StreamError(f"{word} cannot be opened ({reason}): check its name, and that it is there.") from None


class _Closing:
    """With-statement for a source; it is always connected."""

    away_s = 0.0

    def __enter__(self) -> Any:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Close it."""


class _Descriptor(_Closing):
    """A pipe."""

    def __init__(self, name: str, descriptor: int) -> None:
        self.name, self._descriptor = name, descriptor

    def read(self, wait_s: float) -> bytes | None:
        """See `Source`."""
        ready, _, _ = select.select([self._descriptor], [], [], wait_s)
        return (os.read(self._descriptor, PIECE) or None) if ready else b""


class _GrowingFile(_Closing):
    """A file that is being written; it has no end, unless it is cut or removed."""

    def __init__(self, path: Path) -> None:
        self.name = path.name
        self._path = path
        self._file = path.open("rb", buffering=0)
        self._place = 0

    def read(self, wait_s: float) -> bytes | None:
        """See `Source`."""
        until = time.monotonic() + wait_s
        while True:
            piece = self._file.read(PIECE)
            if piece:
                self._place += len(piece)
                return piece
            if os.fstat(self._file.fileno()).st_size < self._place or not self._path.exists():
                return None
            if time.monotonic() >= until:
                return b""
            time.sleep(POLL_S)

    def close(self) -> None:
        """Close it."""
        self._file.close()


class _Connection(_Closing):
    """A TCP connection."""

    def __init__(self, name: str, connection: socket.socket) -> None:
        self.name, self._socket = name, connection

    def read(self, wait_s: float) -> bytes | None:
        """See `Source`."""
        self._socket.settimeout(wait_s)
        try:
            return self._socket.recv(PIECE) or None
        except TimeoutError:
            return b""
        except OSError:
            return None

    def close(self) -> None:
        """Close it."""
        self._socket.close()


class _Datagrams(_Connection):
    """UDP: what is lost is lost, and there is no end."""

    def read(self, wait_s: float) -> bytes | None:
        """See `Source`."""
        piece = super().read(wait_s)
        if not piece:
            return b""
        return piece if piece.endswith(b"\n") else piece + b"\n"


class _Serial(_Closing):
    """A serial device; it ends when it is unplugged."""

    def __init__(self, path: str, baud: int) -> None:
        try:
            import serial
        except ImportError:
            raise StreamError(
                f"{path} is a serial device, and pyserial is not installed: pip install 'fg-nav[serial]'."
            ) from None
        self.name = path
        self._lost: type[Exception] = serial.SerialException
        try:
            self._port = serial.Serial(path, baud)
        except (serial.SerialException, ValueError) as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise StreamError(f"{path} cannot be opened as a serial device ({reason}): check it and --baud.") from None

    def read(self, wait_s: float) -> bytes | None:
        """See `Source`."""
        try:
            self._port.timeout = wait_s
            return bytes(self._port.read(max(1, self._port.in_waiting)))
        except (self._lost, OSError):
            return None

    def close(self) -> None:
        """Close it."""
        self._port.close()


def _open_socket(word: str, scheme: str) -> ByteSource:
    try:
        address = urlsplit(word)
        host, port = address.hostname or "127.0.0.1", address.port
    except ValueError:
        port = None
    if port is None:
        raise StreamError(f"{word} has no port: give {scheme}://host:port.")
    if scheme == "tcp":
        return _Connection(word, socket.create_connection((host, port), CONNECT_S))
    kind = socket.AF_INET6 if ":" in host else socket.AF_INET
    receiver = socket.socket(kind, socket.SOCK_DGRAM)
    try:
        receiver.bind((host, port))
    except OSError:
        receiver.close()
        raise
    return _Datagrams(word, receiver)
