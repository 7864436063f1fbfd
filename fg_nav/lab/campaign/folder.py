"""The folder of a campaign: marked as ours, held by one campaign at a time, and what is left in it of others.

The mark (`fg_nav.lab.campaign.mark`) names the plan that was last at work there. A lock on it keeps a second campaign
out meanwhile: the system lets it go when the process ends, however it ends. Where there are no such locks, on another
system or on some network disks, nobody is kept out.

Another plan is not refused in the folder: a plan grows, and results that are of no plan any more do no harm. Each is
kept by what it is of, and the tables are of the plan at hand alone. Who left some is told how many.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from fg_nav.errors import CampaignError, OutputError
from fg_nav.lab.campaign.mark import CAMPAIGN, stranger, visible
from fg_nav.lab.campaign.table import TABLES
from fg_nav.wording import counted

CELLS = "cells"

MARK = CAMPAIGN

PART = ".part"
"""End of a name while the file is written (`fg_nav.lab.campaign.whole`)."""


@dataclass(frozen=True)
class Folder:
    """Held by this campaign; `before` is the plan that was at work there last, empty where it was this or none."""

    out: Path
    before: str = ""

    @property
    def cells(self) -> Path:
        """Folder of the results."""
        return self.out / CELLS

    def others(self, files: Collection[str]) -> str:
        """One sentence where there are results of other files than these; empty where there are none."""
        number = sum(name.endswith(".json") and name not in files for name in os.listdir(self.cells))
        if number == 0:
            return ""
        last = f" (the last one there was {self.before})" if self.before else ""
        return f"{self.out} has {counted(number, 'result')} of other plans than this{last}: the tables leave them out"

    def written(self, files: Collection[str]) -> int:
        """How many of these results were written since the folder is held: by the clock of its own disk."""
        since = (self.out / MARK).stat().st_mtime_ns
        with os.scandir(self.cells) as entries:
            return sum(entry.name in files and entry.stat().st_mtime_ns >= since for entry in entries)

    def take_tables_away(self) -> None:
        """Remove tables, which would look finished beside results that they do not have."""
        for name in TABLES:
            (self.out / name).unlink(missing_ok=True)


@contextmanager
def held(out: Path, plan: Path) -> Iterator[Folder]:
    """Make the folder if need be, and hold it while the block runs.

    Raises
    ------
    CampaignError
        If another campaign is at work there.
    OutputError
        If the folder is something else's, or the system refuses.
    """
    try:
        found = stranger(out, MARK, (CELLS, *TABLES)) or _stranger_in(out)
        if found:
            raise OutputError(f"{out} holds what is no campaign's ('{found}'): choose another --out.")
        (out / CELLS).mkdir(parents=True, exist_ok=True)
        mark = (out / MARK).open("a+", encoding="utf-8", errors="surrogateescape")
    except OSError as error:
        raise OutputError(f"{out} cannot be written ({error.strerror}): choose another --out.") from None
    with mark:
        if _locked(mark, out):
            _sweep(out)
        yield Folder(out, _noted(mark, str(plan.resolve())))


def _stranger_in(out: Path) -> str:
    """Name of something among the cells of a folder without our mark, as they were made once, that is no cell."""
    if (out / MARK).is_file():
        return ""
    others = (name for name in visible(out / CELLS) if not name.endswith((".json", PART)))
    return next((f"{CELLS}/{name}" for name in others), "")


def _locked(file: IO[str], out: Path) -> bool:
    """Lock a file until it is closed; False where there are no locks."""
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
    except OSError:  # a disk that has none
        return False
    return True


def _sweep(out: Path) -> None:
    """Remove what campaigns that were killed had begun to write: with the lock, nobody else writes there."""
    for folder in (out, out / CELLS):
        for name in os.listdir(folder):
            if name.startswith(".") and name.endswith(PART):
                (folder / name).unlink(missing_ok=True)


def _noted(mark: IO[str], plan: str) -> str:
    """Put down the plan in the mark; returns the one that stood there if it was another."""
    mark.seek(0)
    before = mark.read().strip()
    mark.seek(0)
    mark.truncate()
    mark.write(f"{plan}\n")
    mark.flush()
    return "" if before == plan else before
