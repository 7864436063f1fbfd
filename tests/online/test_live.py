"""Sources that do not wait: what breaks is taken up again, what is lost is counted, and a walk has one sender."""

import asyncio
import os
import socket
import sys
import time
from collections.abc import Callable, Coroutine
from contextlib import asynccontextmanager, closing
from functools import wraps

import numpy as np
import pytest

from fg_nav.columns.mapping import CANONICAL
from fg_nav.errors import StreamError
from fg_nav.online import sources
from fg_nav.online.rows import RowReader
from fg_nav.online.sources import LiveSource, SenderLock, open_source

HEADER = ",".join(CANONICAL[:7]).encode() + b"\n"
PATIENCE_S = 30.0

both_kinds = pytest.mark.parametrize("scheme", ["udp", "tcp-listen"])


@pytest.fixture(autouse=True)
def hurry(monkeypatch):
    monkeypatch.setattr(sources, "RETRY_S", 0.02)
    monkeypatch.setattr(sources, "POLL_S", 0.02)


def row(k: int) -> bytes:
    return b"%d.5,0,0,9.8,0,0,0\n" % k


def in_loop(test: Callable[..., Coroutine[None, None, None]]) -> Callable[..., None]:
    """Run a test in a loop of its own, for so long at most."""

    @wraps(test)
    def run(*given, **named) -> None:
        async def limited() -> None:
            async with asyncio.timeout(2.0 * PATIENCE_S):
                await test(*given, **named)

        asyncio.run(limited())

    return run


async def read(source, wait_s: float) -> np.ndarray:
    try:
        async with asyncio.timeout(wait_s):
            return await source.read()
    except TimeoutError:
        return np.empty((0, 11))


async def collect(source, n: int) -> list[float]:
    """Stamps of the first n samples that come, less the half second."""
    stamps, deadline = [], time.monotonic() + PATIENCE_S
    while len(stamps) < n and time.monotonic() < deadline:
        stamps += ((await read(source, 0.05))[:, 0] - 0.5).tolist()
    return stamps


async def wait_for(condition) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline
        await asyncio.sleep(0.01)


@asynccontextmanager
async def opening(word: str):
    """A source by its name, and what is said of it."""
    said = list[str]()
    source = open_source(word, None, 115200, said.append)
    source.start()
    try:
        yield source, said
    finally:
        source._task.cancel()
        await asyncio.gather(source._task, return_exceptions=True)
        source.close()


def port_of(source) -> int:
    """Which the system chose for port 0."""
    return (source._socket if hasattr(source, "_socket") else source._listener).getsockname()[1]


def connect(scheme: str, source) -> socket.socket:
    one = socket.socket(type=socket.SOCK_DGRAM if scheme == "udp" else socket.SOCK_STREAM)
    one.connect(("127.0.0.1", port_of(source)))
    return one


class Burst(LiveSource):
    """Pieces that are all there when the first is read."""

    async def _receive(self) -> None:
        for start in range(0, len(self.data), 10_000):
            self._put(0.0, self.data[start : start + 10_000])
        await asyncio.Event().wait()


@in_loop
async def test_a_backlog_is_read_in_pieces_and_nothing_is_lost():
    """So that the loop goes on to the other sources between them, and no foot runs ahead of the other."""
    source = Burst(RowReader("a test", print))
    source.data = HEADER + b"".join(map(row, range(10_000)))
    source.start()
    stamps, most = [], 0
    while len(stamps) < 10_000:
        rows = await read(source, PATIENCE_S)
        assert len(rows), "nothing comes any more"
        stamps += rows[:, 0].tolist()
        most = max(most, len(rows))
    assert stamps == [k + 0.5 for k in range(10_000)]
    assert most <= sources.PIECE / len(row(0))
    source._task.cancel()


@both_kinds
@in_loop
async def test_a_second_sender_is_left_out_until_the_first_has_ended_or_fell_silent(scheme, monkeypatch):
    """As of a foot and a pocket that send to one port; and of a foot that is switched off and on."""
    async with opening(f"{scheme}://127.0.0.1:0") as (source, said):
        foot = connect(scheme, source)
        foot.sendall(HEADER + row(0))
        assert await collect(source, 1) == [0]
        with closing(connect(scheme, source)) as pocket:
            pocket.sendall(row(1000))
            await wait_for(lambda: said)
            assert str(pocket.getsockname()[1]) in said[0]
        foot.sendall(row(1))
        assert await collect(source, 1) == [1]
        if scheme == "tcp-listen":  # whose end is seen: the sensor may connect again at once
            foot.close()
            foot = connect(scheme, source)
            foot.sendall(HEADER + row(2))
            assert await collect(source, 1) == [2]
        # Out of reach: its old connection is never closed.
        monkeypatch.setattr(sources, "RESTARTED_S", 0.2)
        await wait_for(lambda: time.monotonic() - source._senders.last > 0.25)
        with closing(connect(scheme, source)) as new:
            new.sendall(row(3))
            assert await collect(source, 1) == [3]
        assert scheme != "udp" or 0.25 <= source.away_s < PATIENCE_S
        assert not [words for words in said[1:] if "is left out" in words]
        foot.close()


def test_a_walk_is_that_of_its_first_sender_and_of_its_host_alone(monkeypatch):
    """Another host is none of it, however long the first is silent; who is back was away since it last sent."""
    now, said = [100.0], []
    monkeypatch.setattr(sources.time, "monotonic", lambda: now[0])
    lock = SenderLock("a test", said.append)
    for t, host, port, is_gone, away_s in (
        (100.0, "foot", 1, False, 0.0),
        (100.5, "foot", 1, False, 0.0),
        (101.0, "foot", 2, False, None),  # of the same host while the first one sends
        (101.0, "foot", 2, True, 0.5),  # but not once that has ended
        (101.5, "foot", 1, False, None),
        (900.0, "pocket", 2, True, None),
        (901.0, "pocket", 2, False, None),
        (902.0, "foot", 3, False, 801.0),
    ):
        now[0] = t
        assert lock.accept(host, port, is_gone) == away_s, (t, host, port)
    assert [words.split("what ")[1].split(" sends")[0] for words in said] == ["foot", "pocket"]


@pytest.mark.skipif(sys.platform != "linux", reason="the system does not count them")
@in_loop
async def test_datagrams_that_find_no_room_are_counted_and_said_once(monkeypatch):
    monkeypatch.setattr(sources, "SYSTEM_BUFFER", 4096)
    async with opening("udp://127.0.0.1:0") as (source, said):
        with closing(connect("udp", source)) as out:
            out.send(HEADER)
            for k in range(500):  # the loop is busy meanwhile
                out.send(row(k))
            sent, deadline = 500, time.monotonic() + PATIENCE_S
            while not source.lost or sent < 510:  # the next that has room brings the count
                assert time.monotonic() < deadline
                await asyncio.sleep(0.02)
                out.send(row(sent))
                sent += 1
            came: list[float] = []
            while len(came) < sent and len(piece := await read(source, 0.3)):
                came += piece[:, 0].tolist()
            assert 0 < source.lost == sent - len(came)
    assert ["lost here" in words for words in said] == [True, False]
    assert str(source.lost) in said[-1]


@in_loop
async def test_a_server_that_comes_later_and_breaks_off_is_waited_for():
    """The row that was cut off is left out; the header may come again, and in another order.

    A connection that brings nothing is none: the source is away until something comes.
    """

    def serve(data: bytes) -> None:
        connection, _ = door.accept()
        with closing(connection):
            connection.sendall(data)

    with closing(socket.socket()) as door:
        door.bind(("127.0.0.1", 0))  # which refuses until it listens
        door.settimeout(PATIENCE_S)
        async with opening(f"tcp://127.0.0.1:{door.getsockname()[1]}") as (source, said):
            await wait_for(lambda: said)
            assert "not there yet" in said[0]
            door.listen()
            backward = b",".join(reversed(HEADER.strip().split(b","))) + b"\n"
            for data, stamps in (
                (HEADER + row(0) + row(1) + row(2)[:7], [0, 1]),
                (backward + b"0,0,0,9.8,0,0,3.5\n" + b"0,0,0,9.8,0,0,4.5\n", [3, 4]),
                (b"", []),
                (HEADER + row(5), [5]),
            ):
                await asyncio.sleep(0.0 if stamps else 0.3)
                await asyncio.to_thread(serve, data)
                assert await collect(source, len(stamps)) == stamps
            assert 0.15 < source.away_s < PATIENCE_S
        assert len(said) == 1


@in_loop
async def test_more_than_may_wait_holds_up_the_server_and_loses_nothing(monkeypatch):
    monkeypatch.setattr(sources, "MAX_WAITING", 100_000)
    n = 100_000
    async with opening("tcp-listen://127.0.0.1:0") as (source, _):

        def send() -> None:
            with closing(connect("tcp-listen", source)) as out:
                out.sendall(HEADER + b"".join(map(row, range(n))))

        sending = asyncio.create_task(asyncio.to_thread(send))
        await wait_for(lambda: source._size > 30_000)
        assert np.array_equal(await collect(source, n), np.arange(n))
        await sending


@in_loop
async def test_a_serial_device_is_read_again_when_it_is_plugged_in_again(tmp_path):
    pytest.importorskip("serial")
    place = tmp_path / "sensor"

    def plug_in() -> tuple[int, int]:
        ends = os.openpty()
        place.symlink_to(os.ttyname(ends[1]))
        return ends

    device = plug_in()
    async with opening(str(place)) as (source, said):
        os.write(device[0], HEADER + row(0))
        assert await collect(source, 1) == [0]
        place.unlink()
        for end in device:
            os.close(end)
        await wait_for(lambda: said)
        assert "broke off" in said[0]
        device, came = plug_in(), list[float]()
        for k in range(1000):  # what is sent before it is opened is lost
            os.write(device[0], row(k))
            came += (await read(source, 0.01))[:, 0].tolist()
            if len(came) > 5:
                break
        assert np.array_equal(np.diff(came), np.ones(len(came) - 1))
    for end in device:
        os.close(end)


@both_kinds
def test_an_address_that_is_taken_is_refused(scheme):
    with closing(socket.socket(type=socket.SOCK_DGRAM if scheme == "udp" else socket.SOCK_STREAM)) as taken:
        taken.bind(("127.0.0.1", 0))
        if scheme != "udp":
            taken.listen()
        with pytest.raises(StreamError, match="in use"):
            open_source(f"{scheme}://127.0.0.1:{taken.getsockname()[1]}", None, 115200, print)
