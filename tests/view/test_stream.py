"""`fg-nav stream --view` and `fg-nav demo --view`: what a page is told, and that it is told again after a kill."""

import json
import os
import re
import signal
import subprocess
import sys
import threading
from contextlib import suppress
from queue import Queue

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from fg_nav.commands import stream
from fg_nav.io import write_canonical
from fg_nav.lab.verbs import simulate
from fg_nav.view import outlets
from fg_nav.view.outlets import StatusReporter
from tests.online.walks import short_walk
from tests.view.test_servers import HOST, WAIT_S, read, read_until, wait_for

ADDRESS = re.compile(r"is shown on http://127\.0\.0\.1:(\d+)/")


@pytest.fixture
def csv(tmp_path):
    write_canonical(short_walk(), tmp_path / "walk.csv")
    return tmp_path / "walk.csv"


def open_page(port):
    return connect(f"ws://{HOST}:{port}/live", open_timeout=WAIT_S)


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
                with open_page(ports.get(timeout=WAIT_S)) as page:
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
        with open_page(int(found[1])) as page:
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
    given = simulate.simulate_named
    monkeypatch.setattr(simulate, "simulate_named", lambda simulate, scenario, seed: given(simulate, "demo", seed))

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
    now, watcher = [50.0], Watcher()
    monkeypatch.setattr(outlets.time, "monotonic", lambda: now[0])
    reporter = StatusReporter(watcher)
    lost = {"samples": 3, "datagrams": 2}

    def report(t, count, ended=False):
        now[0] = t
        reporter.count_samples(count)
        reporter.report(lambda: {"t": t}, lost, ended)

    for k in range(32):
        report(50.0 + 0.125 * k, 25)
    assert len(watcher.sent) == 16  # every fifth of a second at most
    assert watcher.sent[0] | {"t": 0} == {
        "t": 0, "latency_ms": None, "rate_hz": 12.5, "lost_samples": 3, "lost_datagrams": 2, "source": "ok",
    }  # fmt: skip
    now[0] = 53.8875
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
