"""What listeners do to a walk in progress: how long its lines are held up, and when they arrive.

    python scripts/online_listeners.py [--clients N] [--seconds S]

A line is sent every second, and a status as often as the page asks for it, to lines and page, as `fg-nav stream --serve
--view` does; between them the thread that sends does a little every 20 ms. One honest listener of each, in a process of
its own, says when they arrive. Besides, in another process:

=========== ===========================================================================================
nobody      none: what the machine itself does
readers     N clients on each server, that read
deaf        N on each, that never read
most deaf   N on each, of which a tenth read and the others never do
garbage     fifty connections that are opened again and again with random bytes, a line of 100 MB without an end, a
            frame that claims 2^40 bytes, a handshake that is never finished
=========== ===========================================================================================

Held up: from when something was due to when the thread goes on. Asked: 50 ms at most.
"""

from __future__ import annotations

import json
import multiprocessing
import selectors
import socket
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.queues import Queue
from multiprocessing.synchronize import Event
from pathlib import Path

import harness
import numpy as np
from harness import Figure, option
from websockets.sync.client import connect

from fg_nav.arrays import Floats
from fg_nav.view.outlets import STATUS_S, ListenerProcess, open_port
from fg_nav.view.servers import LIVE

TICK_S, TICKS_A_LINE = 0.02, 50
COMING_S = 0.003  # For each client to connect.
HELD_UP_MS = 50.0
HOST = "127.0.0.1"
PROCESSES = multiprocessing.get_context("spawn")
HANDSHAKE = (
    f"GET {LIVE} HTTP/1.1\r\nHost: {HOST}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
).encode()
GIANT_FRAME = b"\x82\xff" + (1 << 40).to_bytes(8, "big") + b"mask"
HUNDRED_MB = 100


@dataclass(frozen=True)
class Ports:
    """Where lines and page are served."""

    lines: int
    page: int


@dataclass(frozen=True)
class Measured:
    """One kind of crowd: how long each line was held up, and when it arrived, ms; and who watched, most."""

    name: str
    held_up: Floats
    lines: Floats
    page: Floats
    watching: int
    memory_mb: float


def probe(ports: Ports, count: int, found: Queue[tuple[str, list[float]]], ready: Event) -> None:
    """Read lines and page until `count` lines have come on each; put when each arrived after it was sent, ms."""
    with (
        closing(socket.create_connection((HOST, ports.lines))) as lines,
        lines.makefile() as file,
        connect(f"ws://{HOST}:{ports.page}{LIVE}") as page,
    ):
        page.recv()
        ready.set()
        delays: dict[str, list[float]] = {"lines": [], "page": []}
        while len(delays["lines"]) < count:
            line = json.loads(file.readline())
            delays["lines"].append(1e3 * (time.monotonic() - line["t"]))
            event = json.loads(page.recv())
            while event["kind"] != "now":
                event = json.loads(page.recv())
            delays["page"].append(1e3 * (time.monotonic() - event["t"]))
        for name, values in delays.items():
            found.put((name, values))


def read_all(ports: Ports, clients: int, done: Event, reads: bool = True) -> None:
    """Connect many, and read what comes, or not."""
    with selectors.DefaultSelector() as selector:
        for port, greeting in ((ports.lines, b""), (ports.page, HANDSHAKE)):
            for _ in range(clients):
                with suppress(OSError):
                    listener = socket.create_connection((HOST, port), 5.0)
                    listener.sendall(greeting)
                    listener.setblocking(False)
                    selector.register(listener, selectors.EVENT_READ)
        while not done.is_set():
            if not reads:
                time.sleep(0.1)
                continue
            for key, _ in selector.select(0.1):
                assert isinstance(key.fileobj, socket.socket)
                with suppress(OSError):
                    if not key.fileobj.recv(1 << 16):
                        selector.unregister(key.fileobj)


def stay_deaf(ports: Ports, clients: int, done: Event) -> None:
    """Connect many, and never read."""
    read_all(ports, clients, done, reads=False)


def stay_mostly_deaf(ports: Ports, clients: int, done: Event) -> None:
    """Connect many, of which a tenth read."""
    readers = threading.Thread(target=read_all, args=(ports, clients // 10, done))
    readers.start()
    stay_deaf(ports, clients - clients // 10, done)
    readers.join()


def send_garbage(ports: Ports, clients: int, done: Event) -> None:
    """Say what is not asked for, as fast as it is taken."""
    rng = np.random.default_rng(1)
    while not done.is_set():
        for kind in range(50):
            with suppress(OSError), socket.create_connection((HOST, (ports.lines, ports.page)[kind % 2]), 1.0) as loud:
                loud.settimeout(0.2)
                for piece in _garbage(kind // 2, rng):
                    loud.sendall(piece)


def _garbage(kind: int, rng: np.random.Generator) -> Iterator[bytes]:
    if kind % 4 == 0:
        yield rng.bytes(1 << 18)
    elif kind % 4 == 1:
        yield from (b"x" * (1 << 20) for _ in range(HUNDRED_MB))
    elif kind % 4 == 2:
        yield HANDSHAKE + GIANT_FRAME
        yield from (b"x" * (1 << 20) for _ in range(HUNDRED_MB))
    else:
        yield HANDSHAKE[:-2]


CROWDS: dict[str, Callable[[Ports, int, Event], None] | None] = {
    "nobody": None,
    "readers": read_all,
    "deaf": stay_deaf,
    "most deaf": stay_mostly_deaf,
    "garbage": send_garbage,
}


def measure(name: str, clients: int, seconds: float) -> Measured:
    """Serve lines and page beside one kind of crowd."""
    count = int(seconds / TICK_S / TICKS_A_LINE)
    doors = open_port(HOST, 0, "lines"), open_port(HOST, 0, "page")
    ports = Ports(*(int(door.getsockname()[1]) for door in doors))
    served = ListenerProcess(*doors, HOST, print)
    with closing(served), listener(ports, count) as found, crowd(CROWDS[name], ports, clients):
        held_up, watching = send_lines(served, count)
        arrived = dict(found.get(timeout=60.0) for _ in range(2))
        memory = memory_of(served.pid)
    return Measured(name, held_up, np.array(arrived["lines"]), np.array(arrived["page"]), watching, memory)


def memory_of(process: int) -> float:
    """Memory of another process, MB; NaN where the system does not show it."""
    with suppress(OSError):
        words = Path(f"/proc/{process}/status").read_text(encoding="ascii").split("VmRSS:")[1].split()
        return float(words[0]) / 1024
    return float("nan")


def send_lines(served: ListenerProcess, count: int) -> tuple[Floats, int]:
    """Send lines when they are due; return how long the thread was held up, ms, and how many watched at most."""
    held_up, began, due_status, watching = [], time.monotonic(), 0.0, 0
    for k in range(count * TICKS_A_LINE):
        due = began + k * TICK_S
        time.sleep(max(0.0, due - time.monotonic()))
        if k % TICKS_A_LINE == 0:
            served.send_line(json.dumps(_line(k)))
        if due >= due_status:
            due_status = due + STATUS_S
            served.send_status({"t": due, "position_m": [0.0, 0.0, 0.0], "heading_deg": 0.0, "source": "ok"})
        held_up.append(1e3 * (time.monotonic() - due))
        watching = max(watching, served.viewers)
    return np.array(held_up), watching


def _line(k: int) -> dict[str, object]:
    return {
        "kind": "now", "stance": k, "continues": False, "t": time.monotonic(), "position_m": [0.01 * k, 0.0, 0.0],
        "heading_deg": 0.0, "position_sigma_m": [0.1, 0.1, 0.1], "east_north_cov_m2": 0.0, "heading_sigma_deg": 1.0,
        "field": "none", "field_reason": "a walk that is none " * 10,
    }  # fmt: skip


@contextmanager
def crowd(work: Callable[[Ports, int, Event], None] | None, ports: Ports, clients: int) -> Iterator[None]:
    """Run a crowd in a process of its own, and give it time to come."""
    if work is None:
        yield
        return
    done = PROCESSES.Event()
    process = PROCESSES.Process(target=work, args=(ports, clients, done), daemon=True)
    process.start()
    time.sleep(COMING_S * clients)
    yield
    done.set()
    process.join(10.0)
    process.kill()


@contextmanager
def listener(ports: Ports, count: int) -> Iterator[Queue[tuple[str, list[float]]]]:
    """Run the honest listener; yield what it puts its delays in."""
    ready, found = PROCESSES.Event(), PROCESSES.Queue()
    process = PROCESSES.Process(target=probe, args=(ports, count, found, ready), daemon=True)
    process.start()
    ready.wait(30.0)
    yield found
    process.join(10.0)
    process.kill()


def judge_all(found: Sequence[Measured]) -> list[Figure]:
    """Figures of all crowds."""
    figures = []
    for one in found:
        figures += [
            Figure(one.name, "held up, most (ms)", "walk", float(one.held_up.max()), high=HELD_UP_MS),
            Figure(one.name, "longest delay of a line (ms)", "lines", float(one.lines.max())),
            Figure(one.name, "lines arrive, 99 % (ms)", "lines", _late(one.lines), high=HELD_UP_MS),
            Figure(one.name, "lines arrive, 99 % (ms)", "page", _late(one.page), high=HELD_UP_MS),
        ]
    return figures


def main(arguments: Sequence[str] | None = None) -> None:
    """Run it and print the figures."""
    given = harness.parse_arguments(
        __doc__,
        arguments,
        clients=option(1000, "on each server"),
        seconds=option(20.0, "for each kind of crowd"),
        crowds=option(list(CROWDS), "kinds of crowd", nargs="+", choices=list(CROWDS)),
    )
    found = [measure(name, given.clients, given.seconds) for name in given.crowds]
    harness.print_heading(f"a line every {TICK_S * TICKS_A_LINE:g} s, {given.clients} clients on each server; ms")
    columns = (
        "crowd",
        "watching",
        "held up, p50",
        "p99",
        "most",
        "lines, p50",
        "p99",
        "most",
        "page, p50",
        "p99",
        "most",
    )
    rows = [(one.name, str(one.watching), *(w for x in (one.held_up, one.lines, one.page) for w in _cells(x)),
             f"{one.memory_mb:.0f}") for one in found]  # fmt: skip
    harness.print_table((*columns, "memory, MB"), rows)
    figures = judge_all(found)
    harness.print_figures(figures)
    harness.print_verdict(figures)


def _late(values: Floats) -> float:
    return float(np.quantile(values, 0.99))


def _cells(values: Floats) -> list[str]:
    return [f"{np.quantile(values, q):.1f}" for q in (0.5, 0.99, 1.0)]


if __name__ == "__main__":
    harness.run(main)
