"""Work for a cluster that takes no time, kills whoever does it where it is told to, or never ends."""

import os
import signal
import time
from pathlib import Path

import psutil

from fg_nav import cli
from fg_nav.lab.campaign import command
from fg_nav.lab.campaign.cluster import Cluster
from fg_nav.lab.campaign.execute import Task, TaskResults, run_task
from fg_nav.lab.campaign.walks import Simulated
from fg_nav.lab.store.code import code_sum
from fg_nav.lab.store.results import Result

CODE = "code"


def task(group: str, walk: str, *methods: str) -> Task:
    """Ask for these methods on a walk, with settings that say nothing."""
    source = Simulated(group, "smooth", int(walk) if walk.isdigit() else 0)
    return Task(group, "smooth", walk, source, {"loop": {method: {"of": method} for method in methods or ("iez",)}})


def results(asked: Task) -> tuple[Result, ...]:
    """One result a cell, without anything in it."""
    return tuple(Result(key, {"of": key.method}, CODE) for key in asked.keys)


def work(asked: Task, code: str | None = None) -> TaskResults:
    """Do nothing; die where the group or a method says so: always, or the first time (the walk names a file).

    Workers that are told the sum over the code do not take the seconds to make it.
    """
    if asked.group == "deadly" or any(key.method == "deadly" for key in asked.keys):
        os.kill(os.getpid(), signal.SIGKILL)
    if asked.group == "deadly once" and not Path(asked.walk).exists():
        Path(asked.walk).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if asked.group == "slow":
        time.sleep(0.3)
    return TaskResults(results(asked), code or code_sum(), 0.01)


LAST = "104"  # The walk that `hold` does not make.


def hold(asked: Task) -> TaskResults:
    """Make the results as a worker does, but those of the last walk only when the campaign is gone."""
    campaign = os.getppid()
    while asked.walk == LAST and os.getppid() == campaign:
        time.sleep(0.05)
    return run_task(asked)


def run_held():
    """The command line, whose campaigns hold the last walk."""
    command.choose_cluster = lambda request: Cluster(None, request.workers, work=hold)
    cli.main()


def until_gone(group):
    """Wait for the workers of a process that ended: they are of its process group."""
    end = time.monotonic() + 60.0
    while any(_is_of(process, group) for process in psutil.process_iter()):
        assert time.monotonic() < end, "workers outlive their parent"
        time.sleep(0.05)


def _is_of(process, group):
    try:
        return os.getpgid(process.pid) == group and process.status() != psutil.STATUS_ZOMBIE
    except (ProcessLookupError, psutil.NoSuchProcess):
        return False
