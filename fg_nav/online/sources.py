"""Where samples come from.

======================== =================================================================================
-                        standard input, until its end
a file                   from its beginning, and on as it grows
a serial device          such as /dev/ttyUSB0; again when it is plugged in again; needs pyserial
tcp://host:port          from a server, and again when it is there again
tcp-listen://host:port   from a sensor that connects to that address of this machine, and again
udp://host:port          datagrams sent to that address of this machine; each holds whole lines
======================== =================================================================================

The host is 127.0.0.1 if none is given; 0.0.0.0 is heard by other machines too. Standard input, files and recordings
(`replay`) wait for us; the others do not, and a thread reads them (`live`). These have no end but Ctrl-C and --silence.

A `SampleSource` gives samples. `TextSource` reads them from a `ByteSource`, one of these, by a `RowReader`.
"""

from __future__ import annotations

import os
import select
import stat
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol
from urllib.parse import urlsplit

from fg_nav.arrays import Floats
from fg_nav.errors import StreamError
from fg_nav.io import read
from fg_nav.online.connections import PIECE, SerialDevice, Server, TcpListener
from fg_nav.online.live import Datagrams, Reconnected
from fg_nav.online.replay import Replay, parse_speed
from fg_nav.online.rows import Columns, RowReader

POLL_S = 0.05  # How often a file is looked at for more.


class ByteSource(Protocol):
    """A stream of bytes; `name` is for messages, `away_s` for how long it was not connected before what was read."""

    name: str
    away_s: float

    @property
    def lost(self) -> int:
        """Datagrams for which this machine had no room."""
        ...

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

    @property
    def lost(self) -> int:
        """Datagrams for which this machine had no room."""
        ...

    def resume(self, header: Sequence[str]) -> None:
        """Go on by the header of before, where a walk is resumed."""
        ...

    def read(self, wait_s: float) -> Floats | None:
        """Return the samples (n, 11) that have come, n = 0 if none came within `wait_s`, None at the end."""
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

    @property
    def lost(self) -> int:
        """See `SampleSource`."""
        return self._source.lost

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


def open_samples(
    word: str, columns: Columns | None, baud: int, speed: str | None, remark: Callable[[str], None]
) -> SampleSource:
    """Open a source of samples: the rows of `open_source`, or with a speed the samples of a recording.

    Raises
    ------
    StreamError, FormatError, RecordingError
        If it cannot be opened, or is not what it is said to be.
    """
    if speed is None:
        return TextSource(open_source(word, baud, remark), remark, columns)
    if columns is not None:
        raise StreamError("--columns is for rows of a stream, and --speed replays a recording: leave one of them out.")
    if word == "-" or "://" in word:
        raise StreamError(f"--speed replays a recording, and {word} is none: name a file, or leave --speed out.")
    return Replay(read(Path(word)), parse_speed(speed), Path(word).name)


def open_source(word: str, baud: int, remark: Callable[[str], None]) -> ByteSource:
    """Open a source by the name that the user gave; what becomes of it is remarked.

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
        if scheme in ("tcp", "tcp-listen", "udp"):
            return _open_socket(word, scheme, remark)
        if scheme:
            raise StreamError(
                f"{word} is no source: give -, a file, a serial device, or tcp, tcp-listen or udp and ://host:port."
            )
        mode = os.stat(word).st_mode
        if stat.S_ISCHR(mode) and word != os.devnull:
            return Reconnected(word, SerialDevice(word, baud), remark)
        if stat.S_ISFIFO(mode):
            return _Descriptor(word, os.open(word, os.O_RDONLY | os.O_NONBLOCK))  # or it waits for a writer
        return _GrowingFile(Path(word))
    except (OSError, UnicodeError) as error:  # the other is of a host that is no name
        reason = (getattr(error, "strerror", None) or str(error) or type(error).__name__).lower()
        raise StreamError(f"{word} cannot be opened ({reason}): check its name, and that it is there.") from None


class _Descriptor:
    """A pipe."""

    away_s, lost = 0.0, 0

    def __init__(self, name: str, descriptor: int) -> None:
        self.name, self._descriptor = name, descriptor

    def read(self, wait_s: float) -> bytes | None:
        """See `ByteSource`."""
        ready, _, _ = select.select([self._descriptor], [], [], wait_s)
        return (os.read(self._descriptor, PIECE) or None) if ready else b""

    def close(self) -> None:
        """See `ByteSource`."""


class _GrowingFile:
    """A file that is being written; it has no end, unless it is cut or removed."""

    away_s, lost = 0.0, 0

    def __init__(self, path: Path) -> None:
        self.name = path.name
        self._path = path
        self._file = path.open("rb", buffering=0)
        self._place = 0

    def read(self, wait_s: float) -> bytes | None:
        """See `ByteSource`."""
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


def _open_socket(word: str, scheme: str, remark: Callable[[str], None]) -> ByteSource:
    try:
        address = urlsplit(word)
        host, port = address.hostname or "127.0.0.1", address.port
    except ValueError:
        port = None
    if port is None:
        raise StreamError(f"{word} has no port: give {scheme}://host:port.")
    if scheme == "udp":
        return Datagrams(word, host, port, remark)
    connector = Server(host, port) if scheme == "tcp" else TcpListener(word, host, port, remark)
    return Reconnected(word, connector, remark)
