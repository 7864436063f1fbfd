"""Does `fg-nav stream udp://...` lose anything on a busy machine? Rows at 400 Hz in real time beside busy loops.

    python scripts/online_udp.py [--minutes N] [--hogs N] [--buffer BYTES]

A simulated walk is sent again and again, each row a datagram with its header when its time has come, to the command in
a process of its own; `--hogs` processes (one a core) spin meanwhile. What the command recorded (`--record`) is compared
with what was sent, row by row. Reported too: what the command itself counted as lost, by the stamps and by the system,
and how long a datagram waited in the system's buffer before it was read, by the kernel's own stamps.

`--buffer` asks the system for no more than so many bytes, as it gives a user without rights (212992 on stock Linux).
"""

from __future__ import annotations

import json
import multiprocessing
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import harness
import numpy as np
from harness import Figure, option
from online_limits import busy, cut_datagrams, draw_walk, make_text, send

from fg_nav.arrays import Floats
from fg_nav.io import read_raw
from fg_nav.online.rows import RowReader

RATE_HZ = 400.0
WALK_S = 60.0
SILENCE_S = 10.0  # After which the walk ends.
BEGIN_S = 120.0  # A process may take to open its port on a busy machine.

PROGRAM = """
import json, socket, struct, sys, time
from fg_nav.online import sources
from fg_nav.cli import main

waited, buffer, timing = [0.0], int(sys.argv[1]), sys.argv[2]
plain = socket.socket

class Timed(plain):
    def recvmsg(self, *given):
        piece, notes, flags, sender = plain.recvmsg(self, given[0], 256)
        for level, kind, value in notes:
            if (level, kind) == (socket.SOL_SOCKET, 35):  # SO_TIMESTAMPNS
                seconds, nanoseconds = struct.unpack("qq", value[:16])
                waited[0] = max(waited[0], time.time() - seconds - 1e-9 * nanoseconds)
        return piece, notes, flags, sender

if buffer:
    sources.SYSTEM_BUFFER, sources._SO_RCVBUFFORCE = buffer, 9999

class Reported(sources.Datagrams):
    def __init__(self, *given):
        super().__init__(*given)
        self._socket.setsockopt(socket.SOL_SOCKET, 35, 1)
        given = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
        print(f"port {self._socket.getsockname()[1]} buffer {given}", file=sys.stderr, flush=True)

sources.Datagrams = Reported
socket.socket = Timed
sys.argv = ["fg-nav", *sys.argv[3:]]
try:
    main()
finally:
    with open(timing, "w") as file:
        json.dump(waited[0], file)
"""
"""The command, with the kernel's stamp of each datagram."""


def repeat_walk(seconds: float) -> Floats:
    """Return the rows (n, 10) of a walk that is walked again and again, on one clock."""
    rows = draw_walk(min(seconds, WALK_S), RATE_HZ)
    length_s = float(rows[-1, 0] - rows[0, 0]) + 1.0 / RATE_HZ
    times = int(np.ceil(seconds * RATE_HZ / len(rows)))
    whole = np.concatenate([rows + k * length_s * np.eye(10)[0] for k in range(times)])[: int(seconds * RATE_HZ)]
    whole[:, 0] = np.round(whole[:, 0], 4)
    return whole


def start_command(folder: Path, buffer: int) -> subprocess.Popen[bytes]:
    """Start the command on a free port."""
    walk = ["stream", "udp://127.0.0.1:0", "--heading", "0", "--silence", f"{SILENCE_S:g}"]
    files = ["--record", str(folder / "record.csv"), "--out", str(folder / "out")]
    with (folder / "remarks").open("w") as remarks:
        return subprocess.Popen(
            [sys.executable, "-c", PROGRAM, str(buffer), str(folder / "waited"), *walk, *files],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=remarks,
        )


def find_port(folder: Path, command: subprocess.Popen[bytes]) -> tuple[int, int]:
    """Wait until the command has opened its port; return it and the bytes of its buffer."""
    until = time.monotonic() + BEGIN_S
    while time.monotonic() < until and command.poll() is None:
        words = (folder / "remarks").read_text().split()
        if words[:1] == ["port"] and len(words) >= 4:
            return int(words[1]), int(words[3])
        time.sleep(0.1)
    raise SystemExit(f"the command did not start: {(folder / 'remarks').read_text()}")


def count_lost(sent: Floats, path: Path) -> int:
    """Count the rows that were sent and not recorded."""
    raw = read_raw(path)
    assert raw.mag is not None
    came = {row.tobytes() for row in np.column_stack([raw.t, raw.acc, raw.gyr, raw.mag])}
    return sum(row.tobytes() not in came for row in sent)


def measure(minutes: float, hogs: int, buffer: int) -> list[Figure]:
    """Send a walk, and compare what came with it."""
    rows = repeat_walk(60.0 * minutes)
    lines = make_text(rows)
    datagrams = cut_datagrams(lines, 1)
    sent = RowReader("what is sent").read(datagrams[0] + b"".join(lines[1:]))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        command = start_command(folder, buffer)
        port, given = find_port(folder, command)
        with busy(hogs):
            sender = multiprocessing.Process(target=send, args=(port, datagrams, 60.0 * minutes))
            sender.start()
            sender.join()
            command.wait()
        lost = count_lost(sent, folder / "record.csv")
        summary = json.loads((folder / "out" / "summary.json").read_text())
        waited_s = json.loads((folder / "waited").read_text())
        remarks = (folder / "remarks").read_text().splitlines()[1:]
    print("\n".join(remarks), file=sys.stderr)
    told = [words for words in summary["notes"] if "were lost" in words or "no room" in words]
    case = f"{hogs} busy loops, buffer {given >> 10} kB"
    return [
        Figure("udp", "rows sent", case, len(sent), pattern="{:.0f}"),
        Figure("udp", "rows lost", case, lost, high=0, pattern="{:.0f}"),
        Figure("udp", "losses told of none", case, len(told) if lost == 0 else 0, high=0, pattern="{:.0f}"),
        Figure("udp", "losses not told", case, float(lost > 0 and not told), high=0, pattern="{:.0f}"),
        Figure("udp", "longest in the buffer, ms", case, 1e3 * waited_s, pattern="{:.0f}"),
        Figure("udp", "footfalls", case, summary["strides"], low=1, pattern="{:.0f}"),
    ]


def main(arguments: Sequence[str] | None = None) -> None:
    """Run it and print the figures."""
    given = harness.parse_arguments(
        __doc__,
        arguments,
        minutes=option(10.0, "of sending", metavar="N"),
        hogs=option(os.cpu_count() or 1, "processes that keep the cores busy", metavar="N"),
        buffer=option(0, "asked of the system (0: as the command does)", metavar="BYTES"),
    )
    found = measure(given.minutes, given.hogs, given.buffer)
    harness.print_figures(found)
    harness.print_verdict(found)


if __name__ == "__main__":
    harness.run(main)
