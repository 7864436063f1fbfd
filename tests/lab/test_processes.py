"""Tasks on processes: all are done, and an error or Ctrl-C ends what waits and what is at work."""

import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest

from fg_nav.lab.processes import run_tasks
from tests.lab import tasks
from tests.lab.campaign.fakes import until_gone
from tests.lab.tasks import slow, square

SCRIPT = """
import signal
import sys
from functools import partial
from pathlib import Path
from fg_nav.lab.processes import run_tasks
from tests.lab.tasks import slow

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell starts what is in its background deaf to it
    for _ in run_tasks([partial(slow, Path(sys.argv[1]), n, 600.0) for n in range(8)], 2):
        pass
"""


def test_all_tasks_are_done_here_or_by_others_that_are_no_copies_of_this_process():
    """What its threads hold would be held for ever in a copy."""
    for workers in (1, 2):
        found = dict(run_tasks([partial(square, number) for number in range(6)], workers))
        assert {number: value for number, (value, _) in found.items()} == {n: n * n for n in range(6)}
        assert ({pid for _, pid in found.values()} == {os.getpid()}) == (workers == 1)
    tasks.MINE.append("here")
    assert dict(run_tasks([tasks.list_of_mine] * 2, 2)) == {0: [], 1: []}


def test_after_an_error_and_for_who_wants_no_more_nothing_goes_on(tmp_path):
    with pytest.raises(ValueError, match="bad"):
        list(run_tasks([partial(slow, tmp_path, name, 600.0) for name in ("bad", *range(20))], 2))
    done = run_tasks([partial(slow, tmp_path, f"b{n}", 0.0 if n == 0 else 600.0) for n in range(20)], 2)
    assert next(done)[0] == 0
    done.close()
    names = {path.name for path in tmp_path.iterdir()}
    assert len(names) < 12
    assert {name for name in names if name.endswith("done")} == {"b0.done"}


def test_ctrl_c_ends_all_and_only_the_parent_tells(tmp_path):
    """As a terminal does it: the signal goes to the parent and its workers."""
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    variables = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    words = [sys.executable, str(script), str(tmp_path)]
    ran = subprocess.Popen(words, stderr=subprocess.PIPE, text=True, env=variables, start_new_session=True)
    end = time.monotonic() + 60.0
    while len(list(tmp_path.glob("*.begun"))) < 2:
        assert time.monotonic() < end
        time.sleep(0.05)
    os.killpg(ran.pid, signal.SIGINT)
    _, told = ran.communicate(timeout=90.0)
    assert ran.returncode != 0
    assert told.count("KeyboardInterrupt") == 1
    assert len(list(tmp_path.glob("*.begun"))) == 2
    until_gone(ran.pid)
