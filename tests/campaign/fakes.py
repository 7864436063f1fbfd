"""Work for a cluster that takes no time, and kills whoever does it where it is told to."""

import os
import signal
from pathlib import Path

from fg_nav.campaign.kept import Result, code_sum
from fg_nav.campaign.made import Job
from fg_nav.campaign.parcel import Brought, Parcel

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
    return Brought(results(asked), code_sum(), 0.01)
