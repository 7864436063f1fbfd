"""`fg-nav stream --view` and `fg-nav demo --view`: what a page is told, and that it is told again after a kill."""

import json
import os
import signal
import socket
import subprocess
import sys
from contextlib import closing, contextmanager, suppress

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from fg_nav.io import write_canonical
from tests.online.walks import short_walk
from tests.view.test_servers import HOST, WAIT_S, read, wait_for


@pytest.fixture(scope="module")
def csv(tmp_path_factory):
    path = tmp_path_factory.mktemp("view") / "walk.csv"
    write_canonical(short_walk(), path)
    return path


@contextmanager
def started(*words, **more):
    command = [sys.executable, "-m", "fg_nav.cli", *map(str, words)]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True, **more)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def free_port():
    with closing(socket.create_server((HOST, 0))) as taken:
        return taken.getsockname()[1]


@contextmanager
def watching(port):
    """A page: it tries again until the server is there."""
    found = []

    def connects():
        try:
            found.append(connect(f"ws://{HOST}:{port}/live", open_timeout=WAIT_S))
        except OSError:
            return False
        return True

    wait_for(connects)
    with found[0] as page:
        yield page


def read_to_the_end(page):
    events = []
    with suppress(ConnectionClosed):
        while True:
            events.append(json.loads(page.recv(timeout=WAIT_S)))
    return events


def test_a_page_sees_all_of_a_walk_that_was_killed_and_resumed(csv, tmp_path):
    port, saved = free_port(), tmp_path / "walk.npz"
    words = ("stream", csv, "--checkpoint", saved, "--every", "0.2", "--view", "--port", port, "--no-mag")
    with started(*words) as process, watching(port) as page:
        while (told := read(page, {"history", "now"}))["kind"] == "history" and not told["path"]:
            pass
        wait_for(saved.exists)
        process.kill()
        process.wait()
        read_to_the_end(page)
    with started(*words) as process, watching(port) as page:
        while len(path := read(page, {"history"})["path"]) < 8:
            pass
        assert path[0][1:3] == pytest.approx([0.0, 0.0], abs=0.01)
        status = read(page, {"status"})
        assert status["distance_m"] > 5.0 or status["position_m"] is not None
        process.send_signal(signal.SIGINT)
        events = read_to_the_end(page)
        assert [event["source"] for event in events if event["kind"] == "status"][-1] == "ended"
        assert events[-1]["kind"] in {"history", "status"}
        assert process.wait(WAIT_S) == 0


def test_the_demo_needs_no_sensor(tmp_path):
    port = free_port()
    with started("demo", "--view", "--speed", "3", "--port", port, cwd=tmp_path) as process, watching(port) as page:
        first = read(page, {"now"})
        status = read(page, {"status"})
        while status["position_m"] is None or not status["rate_hz"]:
            status = read(page, {"status"})
        assert first["position_m"] == pytest.approx([0.0, 0.0, 0.0], abs=1.0)
        assert status["source"] == "ok"
        assert isinstance(status["standing"], bool)
        process.send_signal(signal.SIGINT)
        assert process.wait(WAIT_S) == 0
    assert not os.listdir(tmp_path)


@pytest.mark.parametrize("speed", ["0", "-1", "nan"])
def test_a_speed_that_is_none_is_refused(fg_nav, speed):
    assert fg_nav("demo", "--view", f"--speed={speed}", "--port", 0).refused("--speed")
