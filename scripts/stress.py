"""What `fg-nav stream` stands: a day of walking, kills, rubbish, datagrams on a busy machine, a thousand listeners.

    python scripts/stress.py hours|kills|rubbish|udp|listeners

hours      A simulated walk with a magnetometer, repeated as long as it takes, goes to standard input as fast as it is
           read: an hour a row, with its time, its memory, and the longest time that the command did not read.
kills      The same walk twice, once with `--record FILE --resume`, killed (SIGKILL) at random samples and begun again,
           in turn with all rows, as of a file, and with those from `AGAIN_S` before the last recorded one on, as of a
           logger: no line may be missing or told twice, and the whole must end the same.
rubbish    What a line of 100 MB, a million empty lines, bytes that are no text or NULs between the halves of a
           walk cost it in rows, footfalls and memory.
udp        Rows at 400 Hz in their time, one a datagram, `--hogs` busy loops beside: rows lost, and whether it is said.
listeners  A line a second and statuses to port and page, beside clients that read, that never do, and that send
           garbage: how long the thread of the walk is held up, and when a line arrives at an honest listener.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import re
import socket
import subprocess
import sys
import tempfile
import time
from argparse import Namespace
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing.synchronize import Event
from pathlib import Path
from time import perf_counter
from typing import Any

import harness
import numpy as np
from harness import FIRST_SEED, Figure, option
from walks import simulate_long_walk

from fg_nav.columns.mapping import CANONICAL
from fg_nav.errors import SimulationError
from fg_nav.io import read_raw
from fg_nav.io.writing import format_rows
from fg_nav.online.buffer import rows_of
from fg_nav.online.rows import RowReader
from fg_nav.view.outlets import STATUS_S, ListenerProcess, open_port
from fg_nav.view.servers import LIVE

HEADER = ",".join(CANONICAL[:10]).encode() + b"\n"
STILL_RAD_S = 0.05  # No reading of a foot that stands is faster.
PROCESSES = multiprocessing.get_context("spawn")


@dataclass(frozen=True)
class Rows:
    """A simulated walk that goes on for ever, as lines: its samples from `begin` to the end, again and again.

    Its two ends are instants of two rests in which the foot stood alike, so that no sample leaps there. `tails` are the
    lines without their stamps, which rise evenly.
    """

    tails: list[bytes]
    begin: int
    period_s: float

    @classmethod
    def simulate(cls, seed: int, rate_hz: float, minutes: float = 60.0) -> Rows:
        """Simulate a walk with a magnetometer; raises `SimulationError` where it has not two rests."""
        recording = simulate_long_walk(minutes, seed, rate_hz, "indoor")
        assert recording.mag is not None
        samples = np.column_stack([recording.acc, recording.gyr, recording.mag])
        # the middle of each rest but the first, in whole seconds
        length = round(rate_hz)
        seconds = samples[: len(samples) // length * length].reshape(-1, length, samples.shape[1])
        still = np.flatnonzero(np.abs(seconds[:, :, 3:6]).max(axis=(1, 2)) < STILL_RAD_S)
        rests = [part for part in np.split(still, np.flatnonzero(np.diff(still) > 1) + 1) if len(part) > 2]
        middle = np.array([part[len(part) // 2] for part in rests[1:]])
        if len(middle) < 2:
            raise SimulationError("the walk has not two rests to be joined at: ask for three minutes or more.")
        # the late one most like the early one; in m/s^2 and uT alike: a degree moves gravity by 0.2, the field by 0.8
        mean = seconds[middle].mean(axis=1)[:, [0, 1, 2, 6, 7, 8]]
        late = np.arange((len(middle) + 1) // 2, len(middle))
        end = int(middle[late[np.argmin(np.linalg.norm(mean[late] - mean[0], axis=1))]]) * length
        tails = "".join(format_rows(samples[:end], "%.9g", ",")).encode().splitlines(keepends=True)
        return cls(tails, int(middle[0]) * length, recording.period_s)

    def format(self, start: int, stop: int) -> bytes:
        """Return the lines of samples `start <= i < stop`."""
        index, end = np.arange(start, stop), len(self.tails)
        numbers = np.where(index < end, index, self.begin + (index - self.begin) % (end - self.begin)).tolist()
        return b"".join(b"%.6f,%b" % ((start + k) * self.period_s, self.tails[n]) for k, n in enumerate(numbers))


count = partial(Figure, pattern="{:.0f}")


class Follower:
    """A running `fg-nav stream SOURCE`: its highest memory, MB, and, once it has ended, its lines."""

    def __init__(self, source: str, words: Sequence[str]) -> None:
        self._out = tempfile.TemporaryFile()  # noqa: SIM115
        command = [sys.executable, "-m", "fg_nav", "stream", source, *words]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=self._out, stderr=subprocess.DEVNULL)
        assert self.process.stdin is not None
        self.stdin, self.highest_mb, self.lines = self.process.stdin, 0.0, list[dict[str, Any]]()

    def write(self, piece: bytes) -> float:
        """Write bytes; return how long they were not taken, s."""
        began = perf_counter()
        self.stdin.write(piece)
        self.stdin.flush()
        return perf_counter() - began

    def measure_memory(self) -> float:
        """Return MB of the command and of the process beside it, as Linux shows it."""
        pid, processes = self.process.pid, Path("/proc")
        pids = [f"{pid}", *(processes / f"{pid}/task/{pid}/children").read_text().split()]
        status = "".join((processes / one / "status").read_text() for one in pids)
        found = sum(int(kilobytes) for kilobytes in re.findall(r"VmRSS:\s+(\d+) kB", status)) / 1e3
        self.highest_mb = max(self.highest_mb, found)
        return found

    def end(self, kill: bool = False) -> None:
        """Close its input, or kill it, and wait for it."""
        if kill:
            self.process.kill()
        with suppress(BrokenPipeError):
            self.stdin.close()
        _, status, used = os.wait4(self.process.pid, 0)
        self.process.returncode = os.waitstatus_to_exitcode(status)
        self.highest_mb = max(self.highest_mb, used.ru_maxrss / 1e3)
        self._out.seek(0)
        for line in self._out:
            with suppress(ValueError):  # the kill cut it off
                self.lines.append(json.loads(line))


@contextmanager
def keep_busy(count: int) -> Iterator[None]:
    """Have so many processes that keep a core busy each."""
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for process in busy:
            process.kill()
            process.wait()


# --- hours and kills -------------------------------------------------------------------------------------------------

RATE_HZ, KILLS = 200.0, 20
BLOCK_S = 1.0  # samples written at once
AGAIN_S = 10.0  # samples before the last save that are sent again after a kill: less than the lag
MAX_DIFFERENCE = 0.1  # asked: sigmas at the end
SAME_S = 1e-6


def measure_hours(given: Namespace) -> list[Figure]:
    """Send a walk, an hour after the other."""
    rows, follower = Rows.simulate(FIRST_SEED, RATE_HZ), Follower("-", ["--lag", f"{given.lag:g}"])
    follower.write(HEADER)
    hour, block, samples = (round(s / rows.period_s) for s in (3600.0, BLOCK_S, 3600.0 * given.hours))
    took, waits = list[float](), list[float]()
    for begin in range(0, samples, hour):
        began, end = perf_counter(), min(begin + hour, samples)
        waits.append(max(follower.write(rows.format(k, min(k + block, end))) for k in range(begin, end, block)))
        took.append(perf_counter() - began)
        speed, memory_mb = (end - begin) * rows.period_s / took[-1], follower.measure_memory()
        print(f"hour {len(took)}: {speed:.1f} times faster, {memory_mb:.0f} MB, longest wait {waits[-1]:.2f} s")
    follower.end()
    name, speed = f"{given.hours:g} hours", 3600.0 * given.hours / sum(took)
    return [
        Figure(name, "times faster than walked", "stream", speed, low=1.0, pattern="{:.1f}"),
        Figure(name, "longest wait (s)", "stream", max(waits)),
        count(name, "lines", "stream", len(follower.lines)),
        count(name, "memory, highest (MB)", "stream", follower.highest_mb),
    ]


def measure_kills(given: Namespace) -> list[Figure]:
    """Send a walk to a command that is killed again and again, and to one that is not; compare their lines."""
    rows, figures = Rows.simulate(FIRST_SEED, RATE_HZ, max(3.0, 60.0 * min(given.hours, 1.0))), []
    block, again, samples = (round(s / rows.period_s) for s in (BLOCK_S, AGAIN_S, 3600.0 * given.hours))
    for mode, words in (("the whole walk", []), (f"a lag of {given.lag:g} s", ["--lag", f"{given.lag:g}"])):
        kills = np.sort(np.random.default_rng(FIRST_SEED).integers(samples // 20, samples, KILLS)).tolist()
        with keep_busy(given.hogs), tempfile.TemporaryDirectory() as name:
            record, told, begin = Path(name) / "walk.csv", list[dict[str, Any]](), 0
            for number, end in enumerate([samples, *kills, samples]):
                saved = ["--record", str(record), "--resume"] if number else []
                follower = Follower("-", [*words, *saved])
                follower.write(HEADER)
                for start in range(begin, end, block):
                    follower.write(rows.format(start, min(start + block, end)))
                follower.end(kill=end != samples)
                if number == 0:
                    whole = follower.lines
                    continue
                told += follower.lines
                known = record.read_bytes().count(b"\n") - 1 if record.exists() else 0
                begin = 0 if number % 2 else max(known - again, 0)
        missing, twice, difference = compare_lines(whole, told)
        high = np.inf if words else MAX_DIFFERENCE  # with a lag the end depends on when it was solved
        figures += [
            count(mode, "lines", "stream", len(whole), low=1),
            count(mode, "lines missing", "stream", missing, high=0),
            count(mode, "lines twice", "stream", twice, high=0),
            Figure(mode, "end, sigmas", "stream", difference, high=high),
        ]
    return figures


def compare_lines(whole: Sequence[dict[str, Any]], told: Sequence[dict[str, Any]]) -> tuple[int, int, float]:
    """Return how many footfalls have no line that stands, how many lines came twice, and the difference at the end."""
    stamps = []
    for lines in (whole, told):
        gone = {line["stance"] for line in lines if line["kind"] == "retracted"}
        stamps.append([line["t"] for line in lines if line["kind"] == "now" and line["stance"] not in gone])
    missing = sum(not any(abs(t - other) < SAME_S for other in stamps[1]) for t in stamps[0])
    numbers = [line["stance"] for line in told if line["kind"] == "now"]
    ends = [[line for line in lines if line["kind"] == "smoothed"] for lines in (whole, told)]
    place, other = (np.array([line["position_m"] for line in lines]) for lines in ends)
    sigma = np.maximum([line["position_sigma_m"] for line in ends[0]], 1e-3)
    difference = float((np.abs(other - place) / sigma).max()) if len(place) == len(other) > 0 else np.inf
    return missing, len(numbers) - len(set(numbers)), difference


# --- what a source may send ------------------------------------------------------------------------------------------

UDP_HZ, SILENCE_S, BEGIN_S = 400.0, "10", 60.0  # a walk ends after so long without a row; a port is open after so long
MAX_MORE_MB = 30.0  # asked: memory over that of a clean walk


def make_lines(seconds: float) -> list[bytes]:
    """Return lines at 400 Hz."""
    rows = Rows.simulate(FIRST_SEED, UDP_HZ, 4.0)
    return rows.format(0, round(seconds * UDP_HZ)).splitlines(keepends=True)


def compare_rows(lines: Sequence[bytes], record: Path) -> int:
    """Count the rows that were sent and not recorded."""
    came = {row.tobytes() for row in rows_of(read_raw(record))[:, :10]}
    sent = RowReader("what is sent").read(HEADER + b"".join(lines))[:, :10]
    return sum(row.tobytes() not in came for row in sent)


def measure_rubbish(given: Namespace) -> list[Figure]:
    """What rubbish between the halves of a walk does to it."""
    lines, figures = make_lines(20.0), list[Figure]()
    drawn, clean = np.random.default_rng(1).bytes(10 << 20), (0.0, 0)
    rubbish = {
        "none": b"",
        "a line of 100 MB": b"7" * (100 << 20) + b"\n",
        "1 million empty lines": b"\n" * 10**6,
        "10 MB of random bytes": drawn + b"\n",
        "10 MB of NULs": b"\0" * (10 << 20) + b"\n",
    }
    for name, between in rubbish.items():
        with tempfile.TemporaryDirectory() as folder:
            follower = Follower("-", ["--heading", "0", "--record", f"{folder}/record.csv"])
            for piece in (HEADER, *lines[: len(lines) // 2], between, *lines[len(lines) // 2 :]):
                follower.write(piece)
            follower.end()
            footfalls = sum(line["kind"] == "smoothed" for line in follower.lines)
            missing = compare_rows(lines, Path(folder) / "record.csv")
        clean = (follower.highest_mb, footfalls) if name == "none" else clean
        figures += [
            Figure("rubbish", "memory more, MB", name, follower.highest_mb - clean[0], high=MAX_MORE_MB),
            count("rubbish", "rows missing", name, missing, high=0),
            count("rubbish", "footfalls more", name, footfalls - clean[1], 0, 0),
        ]
    return figures


def measure_udp(given: Namespace) -> list[Figure]:
    """Rows lost of a walk that is sent in its own time to a busy machine, and what is said of it."""
    lines = make_lines(60.0 * given.minutes)
    with closing(socket.socket(type=socket.SOCK_DGRAM)) as out, tempfile.TemporaryDirectory() as folder:
        out.bind(("127.0.0.1", 0))
        host, port = out.getsockname()
        out.close()
        files = ["--record", f"{folder}/record.csv", "--out", f"{folder}/out", "--plots", "none"]
        follower = Follower(f"udp://{host}:{port}", ["--heading", "0", "--silence", SILENCE_S, *files])
        with keep_busy(given.hogs), closing(socket.socket(type=socket.SOCK_DGRAM)) as out:
            until = perf_counter() + BEGIN_S
            while not (Path(folder) / "record.csv").exists() and perf_counter() < until:
                time.sleep(0.1)
            time.sleep(2.0)  # its record is there, and the port nearly so
            began = perf_counter()
            for k, line in enumerate(lines):
                time.sleep(max(began + k / UDP_HZ - perf_counter(), 0.0))
                out.sendto(HEADER + line, (host, port))
            follower.end()
        lost = compare_rows(lines, Path(folder) / "record.csv")
        notes = json.loads((Path(folder) / "out" / "summary.json").read_text())["notes"]
    told = [words for words in notes if "were lost" in words or "no room" in words]
    case = f"{given.hogs} busy loops"
    return [
        count("udp", "rows sent", case, len(lines)),
        count("udp", "rows lost", case, lost, high=0),
        count("udp", "losses told wrongly", case, float((lost > 0) != bool(told)), high=0),
        count("udp", "footfalls", case, sum(line["kind"] == "smoothed" for line in follower.lines), low=1),
    ]


# --- listeners -------------------------------------------------------------------------------------------------------

TICK_S, TICKS_A_LINE, COMING_S, HELD_UP_MS = 0.02, 50, 0.003, 50.0  # of the walk's thread; a client to connect; asked
HOST, CLIENTS, CROWD_S = "127.0.0.1", 1000, 20.0  # on each server, for each kind of crowd
HANDSHAKE = (
    f"GET {LIVE} HTTP/1.1\r\nHost: {HOST}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
).encode()
GIANT_FRAME = b"\x82\xff" + (1 << 40).to_bytes(8, "big") + b"mask"
GARBAGE = (b"\xff" * (1 << 18), b"x" * (100 << 20), HANDSHAKE + GIANT_FRAME + b"x" * (1 << 20), HANDSHAKE[:-2])


def listen(ports: tuple[int, int], count: int, found: Any, ready: Event) -> None:
    """Be an honest listener of both ports; put when each line arrived after it was sent, ms."""
    from websockets.sync.client import connect

    delays: tuple[list[float], list[float]] = [], []
    with socket.create_connection((HOST, ports[0])) as lines, connect(f"ws://{HOST}:{ports[1]}{LIVE}") as page:
        file = lines.makefile()
        page.recv()
        ready.set()
        while len(delays[0]) < count:
            delays[0].append(1e3 * (time.monotonic() - json.loads(file.readline())["t"]))
            while (event := json.loads(page.recv()))["kind"] != "now":
                pass
            delays[1].append(1e3 * (time.monotonic() - event["t"]))
    found.put(delays)


def crowd(ports: tuple[int, int], clients: int, done: Event, reading: float) -> None:
    """Connect clients to both ports, of which this share reads what comes; a negative one sends garbage instead."""
    kept = []
    for k in range(2 * clients if reading >= 0.0 else 0):
        with suppress(OSError):
            kept.append(socket.create_connection((HOST, ports[k % 2]), 5.0))
            kept[-1].sendall(HANDSHAKE if k % 2 else b"")
            kept[-1].setblocking(False)
    while not done.wait(0.1):
        for one in kept[: int(len(kept) * reading)]:
            with suppress(OSError):
                one.recv(1 << 16)
        for k in range(50 if reading < 0.0 else 0):
            with suppress(OSError), socket.create_connection((HOST, ports[k % 2]), 1.0) as loud:
                loud.settimeout(0.2)
                loud.sendall(GARBAGE[k // 2 % len(GARBAGE)])


CROWDS = {"nobody": 0.0, "readers": 1.0, "most deaf": 0.1, "deaf": 0.0, "garbage": -1.0}


def measure_listeners(given: Namespace) -> list[Figure]:
    """Serve lines and page beside each kind of crowd; how long the walk is held up, and when lines arrive."""
    figures, lines = list[Figure](), int(CROWD_S / TICK_S / TICKS_A_LINE)
    for name, reading in CROWDS.items():
        doors = open_port(HOST, 0, "lines"), open_port(HOST, 0, "page")
        ports = doors[0].getsockname()[1], doors[1].getsockname()[1]
        ready, done, found = PROCESSES.Event(), PROCESSES.Event(), PROCESSES.Queue()
        clients = 0 if name == "nobody" else CLIENTS
        listener = PROCESSES.Process(target=listen, args=(ports, lines, found, ready), daemon=True)
        others = PROCESSES.Process(target=crowd, args=(ports, clients, done, reading), daemon=True)
        with closing(ListenerProcess(*doors, HOST, print)) as served:
            listener.start()
            ready.wait(30.0)
            others.start()
            time.sleep(1.0 + COMING_S * clients)
            held_up = send_lines(served, lines)
            delays = found.get(timeout=60.0)
        done.set()
        for process in (listener, others):
            process.join(10.0)
            process.kill()
        late = [float(np.quantile(ms, 0.99)) for ms in delays]
        figures.append(count(name, f"{name}: held up, most (ms)", "walk", max(held_up), high=HELD_UP_MS))
        for door, ms in zip(("port", "page"), late, strict=True):
            figures.append(count(name, f"{name}: lines arrive, 99 % (ms)", door, ms, high=HELD_UP_MS))
    return figures


def send_lines(served: ListenerProcess, lines: int) -> list[float]:
    """Send lines and statuses when they are due; return how long after that the thread went on, ms."""
    held_up, began, due_status = list[float](), time.monotonic(), 0.0
    place = {"position_m": [0.0] * 3, "heading_deg": 0.0}
    line = {"kind": "now", "continues": False, "field": "none", "field_reason": "x" * 200, **place}
    line |= {"position_sigma_m": [0.1] * 3, "east_north_cov_m2": 0.0, "heading_sigma_deg": 1.0}
    for k in range(lines * TICKS_A_LINE):
        due = began + k * TICK_S
        time.sleep(max(0.0, due - time.monotonic()))
        if k % TICKS_A_LINE == 0:
            served.send_line(json.dumps({**line, "stance": k, "t": time.monotonic()}))
        if due >= due_status:
            due_status = due + STATUS_S
            served.send_status({"t": due, "source": "ok", **place})
        held_up.append(1e3 * (time.monotonic() - due))
    return held_up


MEASURES: dict[str, Callable[[Namespace], list[Figure]]] = {
    "hours": measure_hours, "kills": measure_kills, "rubbish": measure_rubbish, "udp": measure_udp,
    "listeners": measure_listeners,
}  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> None:
    """Run it and print the figures."""
    given = harness.parse_arguments(
        __doc__,
        arguments,
        MEASURES,
        hours=option(24.0, "of walking", metavar="N"),
        minutes=option(10.0, "of sending", metavar="N"),
        lag=option(60.0, "fixed lag", metavar="SECONDS"),
        hogs=option(2, "processes that keep a core busy each", metavar="N"),
    )
    harness.report_figures(MEASURES[given.what](given))


if __name__ == "__main__":
    harness.run(main)
