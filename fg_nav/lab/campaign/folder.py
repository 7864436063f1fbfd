"""The folder of a campaign: marked as ours, locked by one campaign at a time, and its results of other plans.

The marker file names the plan that was last run there. The lock on it keeps a second campaign out: the system releases
it when the process ends, however it ends. On a system or network disk without locks no campaign is kept out.

Another plan is not refused in the folder: a plan grows, and results that no plan has any more do no harm. Each result
is stored by its key, and the tables are of the present plan alone.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from fg_nav.errors import CampaignError, OutputError
from fg_nav.lab.campaign.tables import TABLES
from fg_nav.lab.store.files import CAMPAIGN_MARKER, PART, find_foreign, list_visible
from fg_nav.text import format_count

RESULTS_FOLDER = "cells"


@dataclass(frozen=True)
class Folder:
    """Locked by this campaign; `before` is the plan that was last run there, empty if it was this or none."""

    out: Path
    before: str = ""

    @property
    def results(self) -> Path:
        """Folder of the results."""
        return self.out / RESULTS_FOLDER

    def describe_others(self, files: Collection[str]) -> str:
        """Return one sentence if there are results in other files than these; or ""."""
        number = sum(name.endswith(".json") and name not in files for name in os.listdir(self.results))
        if number == 0:
            return ""
        last = f" (the last one there was {self.before})" if self.before else ""
        return (
            f"{self.out} has {format_count(number, 'result')} of other plans than this{last}: the tables leave them out"
        )

    def count_written(self, files: Collection[str]) -> int:
        """Return how many of these results were written since the folder is locked, by the clock of its own disk."""
        since = (self.out / CAMPAIGN_MARKER).stat().st_mtime_ns
        with os.scandir(self.results) as entries:
            return sum(entry.name in files and entry.stat().st_mtime_ns >= since for entry in entries)

    def remove_tables(self) -> None:
        """Remove tables, which would look complete next to results that they do not have."""
        for name in TABLES:
            (self.out / name).unlink(missing_ok=True)


@contextmanager
def lock_folder(out: Path, plan: Path) -> Iterator[Folder]:
    """Make the folder if it is missing, and lock it while the block runs.

    Raises
    ------
    CampaignError
        If another campaign runs there.
    OutputError
        If something else fills the folder, or the system refuses.
    """
    try:
        foreign = find_foreign(out, CAMPAIGN_MARKER, (RESULTS_FOLDER, *TABLES)) or _find_foreign_result(out)
        if foreign:
            raise OutputError(f"{out} holds what is no campaign's ('{foreign}'): choose another --out.")
        (out / RESULTS_FOLDER).mkdir(parents=True, exist_ok=True)
        marker = (out / CAMPAIGN_MARKER).open("a+", encoding="utf-8", errors="surrogateescape")
    except OSError as error:
        raise OutputError(f"{out} cannot be written ({error.strerror}): choose another --out.") from None
    with marker:
        if _lock(marker, out):
            _remove_parts(out)
        yield Folder(out, _note_plan(marker, str(plan.resolve())))


def _find_foreign_result(out: Path) -> str:
    """Return a name among the results of a folder without a marker that is no result, or ""."""
    if (out / CAMPAIGN_MARKER).is_file():
        return ""
    others = (name for name in list_visible(out / RESULTS_FOLDER) if not name.endswith((".json", PART)))
    return next((f"{RESULTS_FOLDER}/{name}" for name in others), "")


def _lock(file: IO[str], out: Path) -> bool:
    """Lock a file until it is closed; False if there are no locks."""
    try:
        import fcntl
    except ImportError:
        return False
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise CampaignError(
            f"another campaign is at work in {out}: wait until it is done, or choose another --out."
        ) from None
    except OSError:  # a disk without locks
        return False
    return True


def _remove_parts(out: Path) -> None:
    """Remove what killed campaigns left half written: with the lock, no other process writes there."""
    for folder in (out, out / RESULTS_FOLDER):
        for name in os.listdir(folder):
            if name.startswith(".") and name.endswith(PART):
                (folder / name).unlink(missing_ok=True)


def _note_plan(marker: IO[str], plan: str) -> str:
    """Write the plan into the marker; returns the one that stood there if it was another."""
    marker.seek(0)
    before = marker.read().strip()
    marker.seek(0)
    marker.truncate()
    marker.write(f"{plan}\n")
    marker.flush()
    return "" if before == plan else before
