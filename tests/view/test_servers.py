"""Lines and page for many who connect: nothing that one of them does, or their process, reaches the walk.

`fg-nav stream --view` and `fg-nav demo --view`: what a page is told, and that it is told again after a kill.
"""

import http.client
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import closing, suppress
from queue import Queue

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from fg_nav.commands import stream
from fg_nav.errors import StreamError
from fg_nav.io import write_canonical
from fg_nav.lab.verbs import simulate
from fg_nav.view import outlets, servers
from fg_nav.view.outlets import StatusReporter, open_outlets, open_port
from fg_nav.view.servers import FILES, LineServer, PageServer
from tests.online.walks import short_walk
from tests.view.lines import circle, now, status
from tests.view.serving import Served

HOST = "127.0.0.1"

WAIT_S = 30.0  # Longer than any machine takes: a test waits so long only where it fails.


def wait_for(condition):
    deadline = time.monotonic() + WAIT_S
    while not condition():
        assert time.monotonic() < deadline, "it has not come about"
        time.sleep(0.005)


@pytest.fixture
def lines():
    with closing(Served(LineServer(), open_port(HOST, 0, "--serve"))) as server:
        yield server


@pytest.fixture
def page():
    with closing(Served(PageServer(HOST), open_port(HOST, 0, "--port"))) as server:
        yield server


def listen(server):
    return socket.create_connection(("127.0.0.1", server.port), WAIT_S)


def watch(page, **more):
    return connect(f"ws://127.0.0.1:{page.port}/live", open_timeout=WAIT_S, **more)


def get(page, path, **headers):
    with closing(http.client.HTTPConnection("127.0.0.1", page.port, timeout=WAIT_S)) as connection:
        connection.request("GET", path, headers=headers)
        answer = connection.getresponse()
        return answer, answer.read()


def read(socket_, kinds=None):
    """The next message, of some kinds only."""
    return read_until(socket_, lambda event: kinds is None or event["kind"] in kinds)


def read_until(socket_, condition):
    """The next message of which it holds."""
    deadline = time.monotonic() + WAIT_S
    while not condition(event := json.loads(socket_.recv(timeout=WAIT_S))):
        assert time.monotonic() < deadline, "it has not come"
    return event


# --- lines


def test_lines_go_to_all_who_are_connected(lines):
    with closing(listen(lines)) as one, closing(listen(lines)) as other, other.makefile() as file:
        wait_for(lambda: lines.listeners == 2)
        lines.send("one")
        one.close()
        lines.send("two")
        lines.send("three")
        assert [file.readline() for _ in range(3)] == ["one\n", "two\n", "three\n"]


def test_who_does_not_read_is_disconnected_and_others_read_on(lines, monkeypatch):
    monkeypatch.setattr(servers, "MAX_WAITING", 1 << 16)
    with closing(listen(lines)) as deaf, closing(listen(lines)) as reader, reader.makefile() as file:
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        wait_for(lambda: lines.listeners == 2)
        sent = 0
        while lines.listeners == 2:
            lines.send(f"{sent} " + "x" * 50_000)
            assert file.readline().startswith(f"{sent} ")
            sent += 1
            assert sent < 2000
        lines.send("still here")
        assert file.readline() == "still here\n"


def test_who_says_much_is_disconnected(lines):
    with closing(listen(lines)) as loud, closing(listen(lines)) as reader, reader.makefile() as file:
        wait_for(lambda: lines.listeners == 2)
        with suppress(OSError):
            for _ in range(100):
                loud.sendall(os.urandom(1 << 16))
        wait_for(lambda: lines.listeners == 1)
        lines.send("on")
        assert file.readline() == "on\n"


# --- page


def test_files_are_served_with_their_kind_and_nothing_from_elsewhere(page):
    for path in FILES:
        answer, body = get(page, path)
        assert (answer.status, len(body)) == (200, int(answer.headers["Content-Length"]))
        policy = answer.headers["Content-Security-Policy"]
        assert policy.startswith("default-src 'none'; script-src 'self'; style-src 'self';")
        assert f"ws://127.0.0.1:{page.port};" in policy
        assert answer.headers["X-Content-Type-Options"] == "nosniff"
        foreign = re.findall(rb"(?:https?:)?//(?!www\.w3\.org/2000/svg)[a-z]+\.[a-z]", body)
        assert not foreign
        assert not re.search(rb"<script>|style=|onclick=|@import|eval\(|innerHTML", body)
    assert get(page, "/?anything")[0].status == 200


@pytest.mark.parametrize(
    "path", ["/nothing", "/../history.py", "/page/../../history.py", "/%2e%2e/history.py", "//etc/passwd", "/view.js/"]
)
def test_nothing_else_is_served(page, path):
    answer, body = get(page, path)
    assert (answer.status, body) == (404, b"there is no such page\n")


@pytest.mark.parametrize(
    ("host", "port", "option"),
    [(HOST, 99_999, "--serve"), (HOST, -1, "--serve"), ("no-such-host.invalid", 0, "--port"), (HOST, None, "--port")],
)
def test_a_port_that_is_none_or_taken_is_refused(page, host, port, option):
    with pytest.raises(StreamError, match=rf"[^)]\): choose another {option}"):
        open_port(host, page.port if port is None else port, option)
    with pytest.raises(StreamError, match="--host"), Outlets(None, ("a..b", 0)):
        pass


def test_pages_from_elsewhere_cannot_listen_nor_a_name_that_only_leads_here(page):
    hosts = {"evil.example": 403, f"localhost:{page.port}": 200, f"[::1]:{page.port}": 200}
    assert {host: get(page, "/", Host=host)[0].status for host in hosts} == hosts
    with pytest.raises(InvalidStatus, match="403"):
        watch(page, origin="http://evil.example")
    with pytest.raises(InvalidStatus, match="403"):
        watch(page, origin=f"http://127.0.0.1:{page.port + 1}")
    with watch(page, origin=f"http://127.0.0.1:{page.port}") as mine:
        assert read(mine)["kind"] == "history"


def test_who_comes_late_is_told_the_past(page):
    for line in circle(30):
        page.send(line)
    page.send_remark("something is odd.")
    page.send_status(status(29.5, [1.0, 2.0, 3.0]))
    with watch(page) as late:
        told = read(late, {"history"})
        assert [row[0] for row in told["path"]] == [float(k) for k in range(30)]
        assert told["last"]["stance"] == 29
        assert told["status"]["position_m"] == [1.0, 2.0, 3.0]
        assert told["status"]["distance_m"] == told["distance_m"] > 20.0
        assert [remark["words"] for remark in told["remarks"]] == ["something is odd."]
        page.send(now(30, 0.0, 0.0))
        assert read(late)["stance"] == 30


def test_a_changed_past_is_sent_as_a_whole(page):
    with watch(page) as viewer:
        assert read(viewer)["path"] == []
        for line in circle(10):
            page.send(line)
        page.send_status(status(9.0, [0.0, 1.0, 0.0]))
        page.send(json.dumps({"kind": "turned", "t": 9.0, "angle_deg": 90.0}))
        page.send(json.dumps({"kind": "retracted", "stance": 4, "t": 4.0}))
        page.send(json.dumps({"kind": "revised", "t": 9.0, "path": [[0.0, 1.0, 1.0, 1.0], [9.0, 2.0, 2.0, 2.0]]}))
        kinds = [read(viewer)["kind"] for _ in range(13)]
        assert kinds == ["now"] * 10 + ["status", "turned", "retracted"]
        told = read(viewer)
        assert told["kind"] == "history"
        assert [row[0] for row in told["path"]] == [0.0, 1.0, 2.0, 3.0, 5.0, 6.0, 7.0, 8.0, 9.0]
        assert (told["path"][0][1:], told["path"][-1][1:]) == ([1.0] * 3, [2.0] * 3)
        assert told["status"]["position_m"] == pytest.approx([1.0, 0.0, 0.0])
        assert told["status"]["heading_deg"] == pytest.approx(180.0)
        assert told["last"]["position_sigma_m"] == pytest.approx([0.2, 0.1, 0.05])


def test_who_does_not_keep_up_gets_the_whole_path_later(page, monkeypatch):
    monkeypatch.setattr(servers, "MAX_WAITING", 1 << 14)
    padded = json.dumps({"kind": "turned", "t": 0.0, "angle_deg": 0.0, "more": "x" * 100_000})
    with watch(page, max_queue=1, close_timeout=0.1) as slow:
        wait_for(lambda: page.viewers == 1)
        (viewer,) = page._viewers
        for _ in range(2000):  # of a tenth of a megabyte each
            if viewer.behind:
                break
            page.send(padded)
            time.sleep(0.001)
        assert viewer.behind
        for line in circle(20):
            page.send(line)
        seen, deadline = [], time.monotonic() + WAIT_S
        while not (seen and seen[-1]["kind"] == "history" and len(seen[-1]["path"]) == 20):
            assert time.monotonic() < deadline, "the whole path has not come"
            page.send_status(status(20.0, [0.0, 0.0, 0.0]))
            seen.append(read(slow))
        assert {event["kind"] for event in seen} <= {"turned", "history"}


def test_a_page_that_talks_is_disconnected(page):
    for said in ("hello", "x" * 100_000, b"\0" * 10):
        with watch(page) as loud:
            read(loud)
            with suppress(ConnectionClosed):
                loud.send(said)
            with pytest.raises(ConnectionClosed):
                loud.recv(timeout=WAIT_S)
    wait_for(lambda: page.viewers == 0)


@pytest.mark.parametrize(
    "garbage", [b"\0" * 100_000, b"GET / HTTP/1.1\r\n" + b"a: b\r\n" * 10_000, b"POST / HTTP/1.1\r\n\r\n"]
)
def test_garbage_on_the_port_is_no_news(page, garbage, capfd):
    with closing(listen(page)) as loud, suppress(OSError):
        loud.sendall(garbage)
        loud.shutdown(socket.SHUT_WR)
        loud.recv(1 << 16)
    with watch(page) as viewer:
        assert read(viewer)["kind"] == "history"
    assert capfd.readouterr().err == ""


# --- the process that serves -----------------------------------------------------------------------------------------


class Outlets:
    """Outlets with what was printed and remarked."""

    def __init__(self, serve, view):
        self.printed, self.remarks = [], []
        self.opened = open_outlets(serve, view, self.printed.append, self.remarks.append)

    def __enter__(self):
        self.outlets = self.opened.__enter__()
        return self

    def __exit__(self, *error):
        self.opened.__exit__(*error)

    def port(self, number):
        return int(self.remarks[number].rstrip(".").split(":")[-1].split("/")[0])


def connect_to(port):
    return connect(f"ws://{HOST}:{port}/live", open_timeout=WAIT_S)


def test_lines_and_page_are_served_and_the_end_is_for_the_page():
    with Outlets(0, (HOST, 0)) as made:
        assert made.remarks[0].startswith(f"lines are served on {HOST}:")
        assert made.remarks[1].endswith("(for this machine alone).")
        page_port = int(made.remarks[1].split("/ ")[0].split(":")[-1])
        outlets, watcher = made.outlets, made.outlets.watcher
        with (
            closing(socket.create_connection((HOST, made.port(0)), WAIT_S)) as listener,
            listener.makefile() as file,
            connect_to(page_port) as page,
        ):
            assert read(page)["path"] == []
            wait_for(lambda: watcher.viewers == 1)
            outlets.emit(now(0, 0.0, 0.0))
            outlets.remark("this is odd.")
            watcher.send_status(status(0.5, [0.0, float("nan"), 0.0]))
            assert json.loads(file.readline())["kind"] == "now"
            assert [read(page)["kind"] for _ in range(3)] == ["now", "remark", "status"]
            outlets.emit_end(json.dumps({**json.loads(now(0, 0.0, 0.0)), "kind": "smoothed"}))
            outlets.emit(now(1, 0.0, 1.0))
            assert json.loads(file.readline())["stance"] == 1
            assert len(read(page, {"history"})["path"]) in (1, 2)
        wait_for(lambda: watcher.viewers == 0)
    assert made.printed == []
    assert made.remarks[2:] == ["this is odd."]


def test_without_page_and_port_there_is_no_process():
    with Outlets(None, None) as made:
        assert made.outlets.watcher is None
        made.outlets.emit("a line")
    assert made.printed == ["a line"]
    with Outlets(None, ("0.0.0.0", 0)) as made:
        made.outlets.emit("{}")
        made.outlets.emit_end("{}")
    assert made.printed == ["{}", "{}"]
    assert made.remarks[0].endswith("(for all who reach this machine: there is no password, and no encryption).")


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_the_walk_goes_on_where_the_process_is_killed_or_stands_still(number):
    with Outlets(None, (HOST, 0)) as made:
        pid = made.outlets.watcher.pid
        os.kill(pid, number)
        if number == signal.SIGKILL:
            wait_for(lambda: len(made.remarks) == 2)
            assert made.remarks[1] == "what serves the walk has ended: it goes on unseen."
        for line in circle(20_000):
            made.outlets.emit(line)
        if number == signal.SIGSTOP:
            os.kill(pid, signal.SIGCONT)
    assert len(made.printed) == 20_000


def test_modules_in_the_folder_of_the_user_are_not_imported(tmp_path, monkeypatch):
    (tmp_path / "queue.py").write_text("raise SystemExit(1)")
    monkeypatch.chdir(tmp_path)
    with Outlets(None, (HOST, 0)) as made, connect_to(made.port(0)) as page:
        assert read(page)["path"] == []


ADDRESS = re.compile(r"is shown on http://127\.0\.0\.1:(\d+)/")


@pytest.fixture
def csv(tmp_path):
    write_canonical(short_walk(), tmp_path / "walk.csv")
    return tmp_path / "walk.csv"


def read_to_the_end(page):
    events = []
    with suppress(ConnectionClosed):
        while len(events) < 10_000:
            events.append(json.loads(page.recv(timeout=WAIT_S)))
    return events


@pytest.fixture
def shown(fg_nav, monkeypatch):
    """Run a verb whose page is watched in a thread, and ended by Ctrl-C once that has seen enough; the rest it sees."""
    ports: Queue[int] = Queue()

    def note(words):
        if found := ADDRESS.search(words):
            ports.put(int(found[1]))

    for module in (stream, simulate):
        monkeypatch.setattr(module, "remark", note)

    def run(watch, *words):
        events, errors = [], []

        def look():
            try:
                with connect_to(ports.get(timeout=WAIT_S)) as page:
                    try:
                        watch(page)
                    finally:
                        os.kill(os.getpid(), signal.SIGINT)
                    events.extend(read_to_the_end(page))
            except BaseException as error:
                errors.append(error)

        viewer = threading.Thread(target=look)
        viewer.start()
        ran = fg_nav(*words)
        viewer.join(2 * WAIT_S)
        assert errors == []
        assert ran.code == 0, ran.err
        return events

    return run


@pytest.mark.usefixtures("solved_here")
def test_a_page_sees_all_of_a_walk_that_was_killed_and_resumed(shown, csv, tmp_path):
    saved = tmp_path / "record.csv"
    words = ("stream", csv, "--record", saved, "--resume", "--view", "--no-mag", "--port")
    command = [sys.executable, "-m", "fg_nav", *map(str, words), "0"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as process:
        limit = threading.Timer(4 * WAIT_S, process.kill)  # so that no line of it is waited for without end
        limit.start()
        found = next(filter(None, map(ADDRESS.search, process.stderr)))
        with connect_to(int(found[1])) as page:
            read_until(page, lambda event: event["kind"] == "now" or event.get("path"))
            wait_for(saved.exists)
            process.kill()
            read_to_the_end(page)  # nothing that served it is left
        limit.cancel()

    def watch(page):
        path = read_until(page, lambda event: len(event.get("path", ())) >= 8)["path"]
        assert path[0][1:3] == pytest.approx([0.0, 0.0], abs=0.01)
        status = read(page, {"status"})
        assert status["distance_m"] > 5.0 or status["position_m"] is not None

    events = shown(watch, *words, found[1])
    assert [event["source"] for event in events if event["kind"] == "status"][-1] == "ended"
    assert events[-1]["kind"] in {"history", "status"}


def test_the_demo_needs_no_sensor(shown, monkeypatch):
    monkeypatch.setattr(simulate, "DEMO_SCENARIO", "demo")

    def watch(page):
        first = read(page, {"now"})
        status = read_until(page, lambda event: event.get("position_m") is not None and event.get("rate_hz"))
        assert first["position_m"] == pytest.approx([0.0, 0.0, 0.0], abs=1.0)
        assert status["source"] == "ok"
        assert isinstance(status["standing"], bool)

    shown(watch, "demo", "--view", "--speed", "5", "--port", 0)


class Watcher:
    """What is sent to a page while somebody watches."""

    def __init__(self):
        self.viewers, self.sent = 1, []
        self.send_status = self.sent.append


def test_a_status_has_rate_latency_and_silence(monkeypatch):
    clock, watcher = [50.0], Watcher()
    monkeypatch.setattr(outlets.time, "monotonic", lambda: clock[0])
    reporter = StatusReporter(watcher)
    lost = {"samples": 3, "datagrams": 2}

    def report(t, count, ended=False):
        clock[0] = t
        reporter.count_samples(count)
        reporter.report(lambda: {"t": t}, lost, ended)

    for k in range(32):
        report(50.0 + 0.125 * k, 25)
    assert len(watcher.sent) == 16  # every fifth of a second at most
    assert watcher.sent[0] | {"t": 0} == {
        "t": 0, "latency_ms": None, "rate_hz": 12.5, "lost_samples": 3, "lost_datagrams": 2, "source": "ok",
    }  # fmt: skip
    clock[0] = 53.8875
    reporter.note_line()
    assert watcher.sent[-1]["rate_hz"] == pytest.approx(200.0, abs=13.0)
    for t in (54.0, 55.4, 57.6):
        report(t, 0)
    assert [one["source"] for one in watcher.sent[-3:]] == ["ok", "ok", "silent 4 s"]
    assert (watcher.sent[-1]["latency_ms"], watcher.sent[-1]["rate_hz"]) == (12.5, 0.0)
    watcher.viewers = 0
    report(59.0, 5)  # nobody watches
    assert watcher.sent[-1]["t"] == 57.6
    report(59.1, 0, ended=True)
    assert (watcher.sent[-1]["t"], watcher.sent[-1]["source"]) == (59.1, "ended")
    assert (watcher.sent[-1]["latency_ms"], watcher.sent[-1]["rate_hz"]) == (None, None)
