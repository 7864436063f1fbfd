"""Processes of background solves, and functions compiled where nothing can be written or what was kept is damaged."""

import os
import signal
import subprocess
import sys
import time

import numba
import pytest
from numba.core import caching

from fg_nav.system import compiled, processes

INTERRUPTED = """
import os, signal
from fg_nav.system.processes import Worker, catch_signals

with catch_signals(signal.SIGINT) as stop:
    worker = Worker(os.getpid)
    assert worker.submit(os.getppid).result(60.0) == os.getpid()
    os.killpg(0, signal.SIGINT)
    assert stop.wait(10.0)
    print(worker.submit(os.getppid).result(60.0) == os.getpid())
worker.kill()
"""

LEFT_RUNNING = """
import os, signal, sys
from fg_nav.system.processes import Worker
signal.signal(signal.SIGINT, signal.default_int_handler)  # A shell may have it ignored in the background.
worker = Worker(os.getpid)
pid = worker.submit(os.getpid).result(60.0)
print(pid, flush=True)
os.kill(pid if sys.argv[1] == "SIGSTOP" else os.getpid(), getattr(signal, sys.argv[1]))
"""


def test_ctrl_c_of_a_terminal_does_not_reach_the_worker():
    """It goes to all processes of the group; the walk still has its last solution to come."""
    command = [sys.executable, "-c", INTERRUPTED]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, start_new_session=True, check=False)
    assert (done.stdout, done.stderr, done.returncode) == ("True\n", "", 0)


@pytest.mark.parametrize("how", ["SIGSTOP", "SIGKILL", "SIGINT"])
def test_no_process_is_left(tmp_path, how):
    script = tmp_path / "script.py"
    script.write_text(LEFT_RUNNING)
    done = subprocess.run([sys.executable, script, how], capture_output=True, text=True, timeout=60.0, check=False)
    assert (done.returncode == 0) == (how == "SIGSTOP"), done.stderr
    pid, until = int(done.stdout), time.monotonic() + 20.0
    while time.monotonic() < until:
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return
        time.sleep(0.02)
    os.kill(pid, signal.SIGKILL)
    pytest.fail("it is still there")


def add(a, b):
    return a + b


@pytest.fixture
def unwritable(monkeypatch, tmp_path):
    """Leave numba no place but one that is named: neither the installation nor a home; yield that for ours."""
    monkeypatch.setattr(caching.CacheImpl, "_locator_classes", [caching.UserProvidedCacheLocator])
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    with pytest.raises(RuntimeError, match="no locator"):
        numba.njit(cache=True)(add)
    monkeypatch.setattr(compiled, "find_scratch", lambda: tmp_path)
    return tmp_path


def test_a_read_only_installation_keeps_what_it_compiled_among_temporary_files(unwritable):
    assert compiled.njit(cache=True)(add)(1, 2) == 3
    files = [path for path in unwritable.rglob("*") if path.is_file()]
    assert {path.suffix for path in files} == {".nbi", ".nbc"}
    assert numba.config.CACHE_DIR == ""
    for path in files:  # a machine that lost its power
        path.write_bytes(path.read_bytes()[:9])
    assert compiled.njit(cache=True)(add)(1, 2) == 3


def test_where_nothing_at_all_can_be_written_nothing_is_kept(unwritable, monkeypatch):
    monkeypatch.setattr(compiled, "find_scratch", lambda: None)
    function = compiled.njit(cache=True)(add)
    assert (function(1, 2), function.stats.cache_path) == (3, None)


@pytest.mark.parametrize("case", ["ours", "open to others", "a link", "somebody else's", "a file", "no room"])
def test_a_folder_that_others_may_write_is_not_trusted(case, tmp_path, monkeypatch):
    monkeypatch.setattr(processes.tempfile, "gettempdir", lambda: str(tmp_path))
    place = tmp_path / f"fg-nav-{os.geteuid()}"
    match case:
        case "open to others":
            place.mkdir()
            place.chmod(0o770)
        case "a link":
            (tmp_path / "theirs").mkdir(0o700)
            place.symlink_to(tmp_path / "theirs")
        case "somebody else's":
            uid = os.geteuid()
            place.mkdir(0o700)
            monkeypatch.setattr(processes.os, "geteuid", lambda: uid + 1)
            place.rename(tmp_path / f"fg-nav-{uid + 1}")
        case "a file":
            place.write_text("")
        case "no room":
            monkeypatch.setattr(processes.tempfile, "gettempdir", lambda: str(tmp_path / "none"))
    found = processes.find_scratch.__wrapped__()
    assert found == (place if case == "ours" else None)
    if case == "ours":
        assert found.stat().st_mode & 0o777 == 0o700
        assert processes.find_scratch.__wrapped__() == place
