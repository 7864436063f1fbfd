"""The process of a background solve: what reaches it, what its failures are, and that none is left."""

import os
import signal
import subprocess
import sys
import time

import pytest

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
    """An interpreter that ends does not wait for one that is stopped; one that is killed or interrupted leaves none."""
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
