"""Work for a cluster that takes no time, and kills whoever does it where it is told to."""

import os
import signal
import time
from pathlib import Path

import psutil

from fg_nav.lab.campaign.kept import Result, code_sum
from fg_nav.lab.campaign.made import Job
from fg_nav.lab.campaign.parcel import Brought, Parcel

CODE = "code"


def job(group: str, walk: str, *methods: str) -> Job:
    """Ask for these methods on a walk, with settings that say nothing."""
    return Job(group, "smooth", walk, {"loop": {method: {"of": method} for method in methods or ("iez",)}})


def results(asked: Job) -> tuple[Result, ...]:
    """One result a cell, without anything in it."""
    return tuple(Result(key, {"of": key.method}, CODE) for key in asked.keys)


def work(sent: Parcel) -> Brought:
    """Do nothing; die where the job's group says so: always, or the first time (the walk names a file to remember)."""
    asked = sent.job
    if asked.group == "deadly":
        os.kill(os.getpid(), signal.SIGKILL)
    if asked.group == "deadly once" and not Path(asked.walk).exists():
        Path(asked.walk).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if asked.group == "slow":
        time.sleep(0.3)
    return Brought(results(asked), code_sum(), 0.01)


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
