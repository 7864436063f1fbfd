"""`fg-nav stream --view` and `fg-nav demo --view`: what a page is told, and that it is told again after a kill."""

import json
import re
import signal
import subprocess
import sys
import threading
from contextlib import contextmanager, suppress

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from fg_nav.io import write_canonical
from tests.online.walks import short_walk
from tests.view.test_servers import HOST, WAIT_S, read, read_until, wait_for


@pytest.fixture(scope="module")
def csv(tmp_path_factory):
    path = tmp_path_factory.mktemp("view") / "walk.csv"
    write_canonical(short_walk(), path)
    return path


@contextmanager
def started(*words):
    command = [sys.executable, "-m", "fg_nav.cli", *map(str, words)]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
    limit = threading.Timer(4 * WAIT_S, process.kill)  # so that no line of it is waited for without end
    limit.start()
    try:
        yield process
    finally:
        limit.cancel()
        process.kill()
        process.communicate()


def port_of(process):
    """The port of the page, as the process says it; waits until it does."""
    said = []
    while line := process.stderr.readline():
        said.append(line)
        if found := re.search(r"is shown on http://127\.0\.0\.1:(\d+)/", line):
            return int(found[1])
    raise AssertionError("".join(said))


def watch(process):
    return connect(f"ws://{HOST}:{port_of(process)}/live", open_timeout=WAIT_S)


def read_to_the_end(page):
    events = []
    with suppress(ConnectionClosed):
        while True:
            events.append(json.loads(page.recv(timeout=WAIT_S)))
    return events


def test_a_page_sees_all_of_a_walk_that_was_killed_and_resumed(csv, tmp_path):
    saved = tmp_path / "record.csv"
    words = ("stream", csv, "--record", saved, "--resume", "--view", "--no-mag", "--port")
    with started(*words, 0) as process, watch(process) as page:
        port = page.remote_address[1]
        read_until(page, lambda event: event["kind"] == "now" or event.get("path"))
        wait_for(saved.exists)
        process.kill()
        process.wait()
        read_to_the_end(page)
    with started(*words, port) as process, watch(process) as page:
        path = read_until(page, lambda event: len(event.get("path", ())) >= 8)["path"]
        assert path[0][1:3] == pytest.approx([0.0, 0.0], abs=0.01)
        status = read(page, {"status"})
        assert status["distance_m"] > 5.0 or status["position_m"] is not None
        process.send_signal(signal.SIGINT)
        events = read_to_the_end(page)
        assert [event["source"] for event in events if event["kind"] == "status"][-1] == "ended"
        assert events[-1]["kind"] in {"history", "status"}
        assert process.wait(WAIT_S) == 0


def test_the_demo_needs_no_sensor():
    with started("demo", "--view", "--speed", "3", "--port", 0) as process, watch(process) as page:
        first = read(page, {"now"})
        status = read_until(page, lambda event: event.get("position_m") is not None and event.get("rate_hz"))
        assert first["position_m"] == pytest.approx([0.0, 0.0, 0.0], abs=1.0)
        assert status["source"] == "ok"
        assert isinstance(status["standing"], bool)
        process.send_signal(signal.SIGINT)
        assert process.wait(WAIT_S) == 0
