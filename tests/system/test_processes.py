"""The process of a background solve: what reaches it, and what its failures are."""

import subprocess
import sys

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


def test_ctrl_c_of_a_terminal_does_not_reach_the_worker():
    """It goes to all processes of the group; the walk still has its last solution to come."""
    command = [sys.executable, "-c", INTERRUPTED]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, start_new_session=True, check=False)
    assert (done.stdout, done.stderr, done.returncode) == ("True\n", "", 0)
