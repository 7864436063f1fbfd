"""The process that serves a walk: what is handed to it arrives, and neither of the two holds the other."""

import json
import os
import signal
import socket
from contextlib import closing

import pytest
from websockets.sync.client import connect

from fg_nav.errors import StreamError
from fg_nav.view.outlets import open_outlets
from tests.view.lines import circle, now, status
from tests.view.test_servers import HOST, WAIT_S, read, wait_for


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


def test_a_port_that_is_taken_is_refused():
    with closing(socket.create_server((HOST, 0))) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(StreamError, match="--serve"), Outlets(port, None):
            pass
        with pytest.raises(StreamError, match="--port"), Outlets(None, (HOST, port)):
            pass
    with pytest.raises(StreamError, match="--host"), Outlets(None, ("a..b", 0)):
        pass


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
