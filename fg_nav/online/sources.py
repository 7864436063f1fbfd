"""Where samples come from: bytes of a source as they arrive, and the rows of the canonical format in them.

==================== =====================================================================================
-                    standard input, until its end
a file               from its beginning, and on as it grows
a serial device      such as /dev/ttyUSB0; needs pyserial
tcp://host:port      from a server, until it closes
udp://host:port      datagrams sent to that address of this machine; each holds whole lines
==================== =====================================================================================

`read(wait_s)` of a source returns bytes, none of them (b"") if nothing came within the time, or None at the end.
`RowReader` makes samples of them.
"""

from __future__ import annotations

import os
import select
import socket
import stat
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol
from urllib.parse import urlsplit

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import FormatError, StreamError
from fg_nav.io.canonical import ACC, GYR, MAG, TIME
from fg_nav.io.content import find_column
from fg_nav.online.buffer import COLUMNS

PIECE = 1 << 16
"""Bytes that are read at once."""

POLL_S = 0.05
"""How often a file is looked at for more."""

CONNECT_S = 10.0
"""How long a server may take to answer."""

LONGEST_LINE = 1 << 16
"""Bytes; a longer one has lost its end."""

MOST_BEFORE_HEADER = 20
"""Lines that may come before the header: what was left in a device's buffer."""


class Source(Protocol):
    """A stream of bytes; `name` is for messages."""

    name: str

    def read(self, wait_s: float) -> bytes | None:
        """Return what has come, b"" if nothing came within `wait_s`, None at the end."""
        ...

    def close(self) -> None:
        """Close it."""
        ...


def open_source(word: str, baud: int = 115200) -> Source:
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
    """With-statement for a source."""

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


def _open_socket(word: str, scheme: str) -> Source:
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


class RowReader:
    """Turns bytes into samples: bytes in pieces of any length, rows (n, 10) out.

    The first line that names canonical columns is the header; the same line again is passed over. Then each line is a
    row. A row that has another number of fields than the header, or a field that is no number, is left out and counted
    in `bad`; an empty field is NaN. The last line waits for its end.

    Where a walk resumes its header is known. A source that sent it before and goes on with rows is read by that; one
    that begins again sends it again, and it must name the same columns, in any order.

    Parameters
    ----------
    name
        Of the source, for messages.
    remark
        Given a sentence about the first bad row.
    header
        Names of the columns, where they are known from before; None where the source must send them.

    Raises
    ------
    FormatError
        From `read`, where no header comes, or one without the columns of a recording, or with others than before.
    """

    def __init__(
        self, name: str, remark: Callable[[str], None] = lambda words: None, header: list[str] | None = None
    ) -> None:
        self.bad = 0
        self._name, self._remark = name, remark
        self._rest = b""
        self._line = 0
        self._header: list[str] | None = None
        self._positions: list[int] = []
        self._to_confirm = header is not None
        if header is not None:
            self._use_header(header)

    def read(self, piece: bytes) -> Floats:
        """Return the samples (n, 10) whose rows end in this piece: t, acc, gyr, mag (NaN without one)."""
        *lines, self._rest = (self._rest + piece).split(b"\n")
        if len(self._rest) > LONGEST_LINE:
            lines, self._rest = [*lines, self._rest], b""
        rows = [row for line in lines if (row := self._parse(line)) is not None]
        return np.array(rows, dtype=np.float64).reshape(-1, COLUMNS)

    def finish(self) -> Floats:
        """Return the sample of a last line without an end, (0, 10) or (1, 10)."""
        rest, self._rest = self._rest, b""
        return self.read(rest + b"\n") if rest and self._header is not None else np.empty((0, COLUMNS))

    @property
    def header(self) -> list[str] | None:
        """Names of the columns; None before they are known."""
        return self._header

    def _parse(self, line: bytes) -> list[float] | None:
        self._line += 1
        fields = [field.strip() for field in line.decode("utf-8", "replace").strip("\ufeff\r\n ").split(",")]
        if self._header is None:
            self._begin(fields)
            return None
        if self._to_confirm and not {*TIME, *ACC, *GYR}.isdisjoint(fields):
            self._confirm(fields)
            return None
        if fields == self._header or fields == [""]:
            return None
        if len(fields) == len(self._header) + 1 and not fields[-1]:
            fields.pop()  # a separator at the end of the row
        if len(fields) != len(self._header):
            self._leave_out(f"it has {len(fields)} fields and the header {len(self._header)}")
            return None
        try:
            return [float(fields[i]) if i >= 0 and fields[i] else np.nan for i in self._positions]
        except ValueError:
            self._leave_out("a field is not a number")
            return None

    def _begin(self, fields: list[str]) -> None:
        """Take the header, if it is one."""
        if {*TIME, *ACC, *GYR}.isdisjoint(fields):
            if self._line > MOST_BEFORE_HEADER:
                raise FormatError(
                    f"{self._name} sends no header: its first line must name the columns ({TIME[0]},{ACC[0]},...)."
                )
            return
        self._use_header(fields)

    def _confirm(self, fields: list[str]) -> None:
        """Take the header of a source that begins again."""
        assert self._header is not None
        names = {*TIME, *ACC, *GYR, *MAG}
        if names.intersection(fields) != names.intersection(self._header):
            raise FormatError(
                f"{self._name} names other columns than before the walk resumed: name another checkpoint."
            )
        self._to_confirm = False
        self._use_header(fields)

    def _use_header(self, fields: list[str]) -> None:
        place = Path(self._name)
        names = TIME + ACC + GYR + (() if set(MAG).isdisjoint(fields) else MAG)
        positions = [find_column(name, fields, place) for name in names]
        self._positions = positions + [-1] * (COLUMNS - len(positions))
        self._header = fields if fields[-1] else fields[:-1]

    def _leave_out(self, why: str) -> None:
        if self.bad == 0:
            self._remark(f"rows that cannot be read are left out, the first in line {self._line}: {why}.")
        self.bad += 1
