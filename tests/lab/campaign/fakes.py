"""Walks for a cluster that take no time, end whoever works on them, or never end."""

import os
import signal
import time
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import psutil

from fg_nav.errors import CalibrationError
from fg_nav.lab.campaign.execute import Task
from fg_nav.lab.store.results import Key


@dataclass(frozen=True)
class Walk:
    """Not walked: each of its results failed with a word."""

    def prepare(self, magnetometer):
        raise CalibrationError("quick")


@dataclass(frozen=True)
class Deadly(Walk):
    """Ends its worker under this magnetometer; where a file is named, only the first time."""

    magnetometer: str
    file: Path | None = None

    def prepare(self, magnetometer):
        if magnetometer == self.magnetometer and (self.file is None or not self.file.exists()):
            if self.file is not None:
                self.file.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return super().prepare(magnetometer)


@dataclass(frozen=True)
class Endless(Walk):
    """Is at work for as long as a test lasts."""

    def prepare(self, magnetometer):
        time.sleep(600.0)


@dataclass(frozen=True)
class Unknown(Walk):
    """Of a module that a worker does not have."""

    def __reduce__(self):
        return import_module, ("of_another_version",)


def task(name, source=Walk(), magnetometers=("loop",)):
    """Results of a method under each magnetometer."""
    return Task(source, {Key(name, "smooth", "1", one, "iez"): {"of": one} for one in magnetometers})


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
