"""What a source may send to `fg-nav stream`: how fast, how long, how broken; and that nothing is lost of it.

    python scripts/online_limits.py [--seconds N] [--hogs N] [--megabytes N]

Each walk goes through the command, a process of its own: what it recorded (`--record`) is compared with what was sent.

read       rows a second that become samples, in blocks and one by one
rubbish    between the halves of a walk come a line of 100 MB, a million empty lines, bytes that are no text, or NULs:
           memory of the process over that of a clean walk, rows that are missing, footfalls that are more
datagrams  at 400 Hz, in datagrams of 64 kB, and at 4 kHz, while other processes keep all cores busy: rows lost
"""

from __future__ import annotations

import json
import multiprocessing
import re
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

import harness
import numpy as np
from harness import Figure, option

from fg_nav.arrays import Floats
from fg_nav.columns.mapping import CANONICAL
from fg_nav.io import read_raw
from fg_nav.io.writing import format_rows
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.online.buffer import rows_of
from fg_nav.online.rows import RowReader

HEADER = ",".join(CANONICAL).encode() + b"\n"
MEGABYTE = 1 << 20
PIECE = 1 << 16
MAX_DATAGRAM = 65507
SILENCE_S = 10.0  # After which the walk ends.
BEGIN_S = 60.0  # A process may take to open its port.


@dataclass(frozen=True)
class Streamed:
    """What became of a walk: samples recorded (n, 10), footfalls, memory at its highest, what was remarked."""

    rows: Floats
    footfalls: int
    peak_mb: float
    remarks: str


class Command:
    """A running `fg-nav stream`."""

    def __init__(self, source: str) -> None:
        self._folder = tempfile.TemporaryDirectory()
        folder = Path(self._folder.name)
        self.record, self._lines, self._remarks = (folder / name for name in ("record.csv", "lines", "remarks"))
        words = [sys.executable, "-m", "fg_nav.cli", "stream", source, "--heading", "0", "--silence", f"{SILENCE_S:g}"]
        with self._lines.open("w") as lines, self._remarks.open("w") as remarks:
            self.process = subprocess.Popen(
                [*words, "--record", str(self.record)],
                stdin=subprocess.PIPE if source == "-" else subprocess.DEVNULL,
                stdout=lines,
                stderr=remarks,
            )

    def wait_for_record(self, n: int) -> None:
        """Wait until so many bytes are recorded, or the process has ended."""
        until = time.monotonic() + BEGIN_S
        while time.monotonic() < until and self.process.poll() is None:
            if self.record.exists() and self.record.stat().st_size > n:
                return
            time.sleep(0.05)

    def finish(self) -> Streamed:
        """Wait for its end."""
        peak_mb = float("nan")
        while self.process.poll() is None:
            peak_mb = read_peak_mb(self.process.pid, peak_mb)
            time.sleep(0.02)
        kinds = [json.loads(line)["kind"] for line in self._lines.read_text().splitlines()]
        raw = read_raw(self.record)
        assert raw.mag is not None
        rows = np.column_stack([raw.t, raw.acc, raw.gyr, raw.mag])
        remarks = self._remarks.read_text()
        self._folder.cleanup()
        return Streamed(rows, kinds.count("smoothed"), peak_mb, remarks)


def read_peak_mb(process: int, before: float) -> float:
    """Return the memory of a process at its highest so far, where the system tells it and the process is there."""
    try:
        words = Path(f"/proc/{process}/status").read_text()
    except OSError:
        return before
    found = re.search(r"VmHWM:\s+(\d+) kB", words)
    return float(found.group(1)) / 1024 if found else before


def make_text(rows: Floats) -> list[bytes]:
    """Return the lines of samples."""
    return "".join(format_rows(rows, "%.9g", ",")).replace("nan", "").encode().splitlines(keepends=True)


def draw_walk(seconds: float, rate_hz: float) -> Floats:
    """Return the samples of a simulated walk, as they are once they were written."""
    rows = rows_of(simulate("demo", 1, Choices(rate_hz=min(rate_hz, 400.0))).recording)
    rows = rows[: int(seconds * 400.0)]
    t = np.arange(int(len(rows) * rate_hz / 400.0)) / rate_hz
    rows = np.column_stack([t, *(np.interp(t, rows[:, 0] - rows[0, 0], axis) for axis in rows[:, 1:].T)])
    return RowReader("a walk").read(HEADER + b"".join(make_text(rows)))


def measure_reading(rows: Floats) -> list[Figure]:
    """Rows a second."""
    found = []
    for digits, form in (("9 digits", "%.9g"), ("17 digits", "%r")):
        text = HEADER + "".join(format_rows(rows, form, ",")).replace("nan", "").encode()
        for size, pieces in (("64 kB", PIECE), ("a row", 0)):
            reader, cut = RowReader("text"), text.splitlines(keepends=True)
            if pieces:
                cut = [text[k : k + pieces] for k in range(0, len(text), pieces)]
            began = time.perf_counter()
            n = sum(len(reader.read(piece)) for piece in cut)
            rate = n / (time.perf_counter() - began)
            name = f"rows/s, {digits}, {size} at once"
            found.append(Figure("read", name, "RowReader", rate, 20_000.0, pattern="{:.0f}"))
    return found


def make_rubbish(megabytes: int) -> dict[str, bytes]:
    """What may come between two rows."""
    drawn = np.random.default_rng(1).integers(0, 256, 10 * MEGABYTE, dtype=np.uint8).tobytes()
    return {
        f"a line of {megabytes} MB": b"7" * (megabytes * MEGABYTE) + b"\n",
        "1 million empty lines": b"\n" * 10**6,
        "10 MB of random bytes": drawn + b"\n",
        "10 MB of NULs": b"\0" * (10 * MEGABYTE) + b"\n",
    }


def stream_text(pieces: Sequence[bytes]) -> Streamed:
    """Send bytes through a pipe."""
    command = Command("-")
    assert command.process.stdin is not None
    for piece in pieces:
        command.process.stdin.write(piece)
    command.process.stdin.close()
    return command.finish()


def measure_rubbish(rows: Floats, megabytes: int) -> list[Figure]:
    """What rubbish between the halves of a walk does to it."""
    text = make_text(rows)
    halves = HEADER + b"".join(text[: len(text) // 2]), b"".join(text[len(text) // 2 :])
    clean = stream_text(halves)
    found = [Figure("rubbish", "memory, MB", "none", clean.peak_mb, pattern="{:.0f}")]
    for name, rubbish in make_rubbish(megabytes).items():
        walk = stream_text([halves[0], rubbish, halves[1]])
        more = walk.peak_mb - clean.peak_mb
        missing = len(rows) - len({row.tobytes() for row in walk.rows} & {row.tobytes() for row in rows})
        found += [
            Figure("rubbish", "memory more, MB", name, more, high=30.0, pattern="{:.0f}"),
            Figure("rubbish", "rows missing", name, missing, high=0, pattern="{:.0f}"),
            Figure("rubbish", "footfalls more", name, walk.footfalls - clean.footfalls, 0, 0, "{:.0f}"),
        ]
    return found


def _spin() -> None:
    while True:
        pass


@contextmanager
def busy(hogs: int) -> Iterator[None]:
    """Keep the cores busy by other processes."""
    spinning = [multiprocessing.Process(target=_spin, daemon=True) for _ in range(hogs)]
    for one in spinning:
        one.start()
    try:
        yield
    finally:
        for one in spinning:
            one.kill()
            one.join()


def cut_datagrams(lines: Sequence[bytes], at_once: int) -> list[bytes]:
    """Put so many lines into a datagram, the header before them."""
    return [HEADER + b"".join(lines[k : k + at_once]) for k in range(0, len(lines), at_once)]


def send(port: int, datagrams: Sequence[bytes], seconds: float) -> None:
    """Send datagrams evenly within a time."""
    with closing(socket.socket(type=socket.SOCK_DGRAM)) as out:
        began = time.monotonic()
        for k, datagram in enumerate(datagrams):
            time.sleep(max(began + seconds * k / len(datagrams) - time.monotonic(), 0.0))
            out.sendto(datagram, ("127.0.0.1", port))


def measure_datagrams(name: str, rows: Floats, at_once: int, hogs: int) -> list[Figure]:
    """Rows lost of a walk that is sent in its own time to a busy machine."""
    with closing(socket.socket(type=socket.SOCK_DGRAM)) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = Command(f"udp://127.0.0.1:{port}")
    command.wait_for_record(0)  # its header is written once the port is open, nearly
    time.sleep(2.0)
    datagrams = cut_datagrams(make_text(rows), at_once)
    with busy(hogs):
        sender = multiprocessing.Process(target=send, args=(port, datagrams, float(rows[-1, 0] - rows[0, 0])))
        sender.start()
        sender.join()
        walk = command.finish()
    lost = len(rows) - len(walk.rows)
    longest = max(map(len, datagrams))
    assert longest <= MAX_DATAGRAM
    return [
        Figure("datagrams", "rows sent", name, len(rows), pattern="{:.0f}"),
        Figure("datagrams", "largest, bytes", name, longest, pattern="{:.0f}"),
        Figure("datagrams", "rows lost", name, lost, high=0, pattern="{:.0f}"),
        Figure("datagrams", "footfalls", name, walk.footfalls, pattern="{:.0f}"),
    ]


def main(arguments: Sequence[str] | None = None) -> None:
    """Run it and print the figures."""
    given = harness.parse_arguments(
        __doc__,
        arguments,
        seconds=option(20.0, "of each walk", metavar="N"),
        hogs=option(4, "processes that keep the cores busy", metavar="N"),
        megabytes=option(100, "of the longest line", metavar="N"),
    )
    rows = draw_walk(given.seconds, 400.0)
    fast = draw_walk(given.seconds, 4000.0)
    measures = (
        lambda: measure_reading(rows),
        lambda: measure_rubbish(rows, given.megabytes),
        lambda: measure_datagrams("400 Hz, a row each", rows, 1, given.hogs),
        lambda: measure_datagrams("400 Hz, 64 kB", rows, 720, given.hogs),
        lambda: measure_datagrams("4 kHz, 4 rows each", fast, 4, given.hogs),
    )
    found = []
    for measure in measures:
        part = measure()
        harness.print_figures(part)
        found += part
    harness.print_verdict(found)


if __name__ == "__main__":
    harness.run(main)
