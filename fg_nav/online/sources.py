"""Where samples come from.

======================== =================================================================================
-                        standard input, until its end
a file                   from its beginning, and on as it grows
a serial device          such as /dev/ttyUSB0; again when it is plugged in again; needs pyserial
tcp://host:port          from a server, and again when it is there again
tcp-listen://host:port   from a sensor that connects to that address of this machine, and again
udp://host:port          datagrams sent to that address of this machine; each holds whole lines
a recording, --speed     each sample when its time has come, at the speed of the walk or a faster one
======================== =================================================================================

The host is 127.0.0.1 if none is given; 0.0.0.0 is heard by other machines too. Standard input, files and recordings
wait for us; the others do not, and a thread reads them (`live`). These have no end but Ctrl-C and --silence.

A `SampleSource` gives samples: `TextSource` parses those of a `ByteSource` by a `RowReader`, `Replay` has a recording.
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

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import StreamError
from fg_nav.io import read
from fg_nav.online.buffer import rows_of
from fg_nav.online.live import PIECE, Connector, Datagrams, Reconnected, SerialDevice, TcpClient, TcpListener
from fg_nav.online.rows import Columns, RowReader
from fg_nav.recording import Recording
from fg_nav.samples.readings import COLUMNS

POLL_S = 0.05  # period at which a file is checked for more
AS_FAST_AS_POSSIBLE = "max"  # in place of a speed
MAX_AT_ONCE = 1000  # samples of a recording, so that a stop is seen between two blocks


class ByteSource(Protocol):
    """A stream of bytes; `name` is for messages, `away_s` how long it was not connected before what was read."""

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
        """Names of the columns that it sends; None if it sends none, or before they are known."""
        return None

    @property
    def lost(self) -> int:
        """Datagrams for which this machine had no room."""
        return 0

    def resume(self, header: Sequence[str]) -> None:
        """Use the header from before an interruption, where a walk is resumed."""
        return

    def read(self, wait_s: float) -> Floats | None:
        """Return the samples (n, 11) that have come, n = 0 if none came within `wait_s`, None at the end."""
        ...

    def finish(self) -> Floats:
        """Return what is left at the end; raises `FormatError` if nothing could be parsed."""
        return np.empty((0, COLUMNS))

    def close(self) -> None:
        """Close it."""
        return


class TextSource(SampleSource):
    """Samples in the text of a source; `remark` is called with a sentence about the first row that is not one."""

    def __init__(self, source: ByteSource, remark: Callable[[str], None], columns: Columns | None = None) -> None:
        self.name = source.name
        self._source, self._remark = source, remark
        self._reader, self._has_ended = RowReader(source.name, remark, columns), False

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
        self._has_ended = piece is None
        return None if piece is None else self._reader.read(piece, self._source.away_s)

    def finish(self) -> Floats:
        """See `SampleSource`."""
        rows = self._reader.finish(is_cut=not self._has_ended)
        if self._reader.bad:
            self._remark(f"{self._reader.bad} rows were left out in all.")
        return rows

    def close(self) -> None:
        """See `SampleSource`."""
        self._source.close()


class Replay(SampleSource):
    """The samples of a recording as of `fg_nav.io.read`, `speed` times as fast as they were measured."""

    def __init__(self, recording: Recording, speed: float, name: str) -> None:
        self.name = name
        self._rows = rows_of(recording)
        self._due = (recording.t - recording.t[0]) / speed
        self._given = 0
        self._began: float | None = None

    def read(self, wait_s: float) -> Floats | None:
        """See `SampleSource`."""
        if self._given == len(self._rows):
            return None
        self._began = time.monotonic() if self._began is None else self._began
        due = float(self._due[self._given]) + self._began
        time.sleep(min(max(due - time.monotonic(), 0.0), wait_s))
        until = int(np.searchsorted(self._due, time.monotonic() - self._began, side="right"))
        first, self._given = self._given, min(max(until, self._given), self._given + MAX_AT_ONCE)
        return self._rows[first : self._given]


def parse_speed(words: str) -> float:
    """Return a speed in multiples of that of the walk; raises `StreamError` for what is no factor."""
    try:
        speed = np.inf if words == AS_FAST_AS_POSSIBLE else float(words)
    except ValueError:
        speed = np.nan
    if not speed > 0.0:
        raise StreamError(f"--speed {words} is no factor: give one above zero, or {AS_FAST_AS_POSSIBLE}.")
    return speed


def open_samples(
    word: str, columns: Columns | None, baud: int, speed: str | None, remark: Callable[[str], None]
) -> SampleSource:
    """Open a source of samples: the rows of `open_source`, or with a speed the samples of a recording.

    Raises `StreamError`, `FormatError`, `RecordingError` if it cannot be opened, or is not what it is said to be.
    """
    if speed is None:
        return TextSource(open_source(word, baud, remark), remark, columns)
    if columns is not None:
        raise StreamError("--columns is for rows of a stream, and --speed replays a recording: leave one of them out.")
    if word == "-" or "://" in word:
        raise StreamError(f"--speed replays a recording, and {word} is none: name a file, or leave --speed out.")
    return Replay(read(Path(word)), parse_speed(speed), Path(word).name)


def open_source(word: str, baud: int, remark: Callable[[str], None]) -> ByteSource:
    """Open a source by the name that the user gave; `remark` is called with sentences about its connection.

    Raises `StreamError` if it cannot be opened: what is wrong, and what to try.
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
    connector: Connector = TcpClient(host, port) if scheme == "tcp" else TcpListener(word, host, port, remark)
    return Reconnected(word, connector, remark)


class _Descriptor:
    """A pipe."""

    away_s, lost = 0.0, 0

    def __init__(self, name: str, descriptor: int) -> None:
        self.name, self._descriptor = name, descriptor

    def read(self, wait_s: float) -> bytes | None:
        ready, _, _ = select.select([self._descriptor], [], [], wait_s)
        return (os.read(self._descriptor, PIECE) or None) if ready else b""

    def close(self) -> None:
        pass


class _GrowingFile:
    """A file that is being written; it has no end, unless it is cut or removed."""

    away_s, lost = 0.0, 0

    def __init__(self, path: Path) -> None:
        self.name = path.name
        self._path = path
        self._file = path.open("rb", buffering=0)
        self._place = 0

    def read(self, wait_s: float) -> bytes | None:
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
        self._file.close()
