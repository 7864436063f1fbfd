"""What waits to be made on a cluster, and which worker takes which cell.

A worker takes one cell at a time and keeps what it made ready of the walk: the simulation or the file, its stances and
its field. So it goes on with the walk that it is at, then begins one that nobody has begun. Where there is none it
takes one that was left by a worker that is gone, and at last helps with the walk of which most is left, from the other
end. While there are walks enough each is made ready once; a single walk is shared by all workers.
"""

from __future__ import annotations

import uuid
from collections import deque
from collections.abc import Iterable
from typing import TypeAlias

from fg_nav.lab.campaign.made import Job
from fg_nav.lab.campaign.parcel import in_cells

Walk: TypeAlias = tuple[str, str, str]
"""Group, field and name of a walk."""


def walk_of(job: Job) -> Walk:
    """Which walk a job is on."""
    return job.group, job.field, job.walk


class Waiting:
    """Cells that wait, walk by walk, and the walk that each worker took a cell of last."""

    def __init__(self, jobs: Iterable[Job]) -> None:
        self._untouched = deque(jobs)
        self._begun: dict[Walk, deque[Job]] = {}
        self._at: dict[str, Walk] = {}
        self._campaign = uuid.uuid4().hex

    def __bool__(self) -> bool:
        return bool(self._untouched or self._begun)

    def name_of(self, job: Job) -> tuple[str, ...]:
        """Name of its walk for workers, which no other campaign gives."""
        return self._campaign, *walk_of(job)

    def is_at(self, worker: str, job: Job) -> bool:
        """Whether the worker took a cell of this walk last, so that it should hold it."""
        return self._at.get(worker) == walk_of(job)

    def leave(self, worker: str) -> None:
        """Forget what the worker is at."""
        self._at.pop(worker, None)

    def cell_for(self, worker: str) -> Job:
        """Take out the cell that this worker should make; there must be one. It is at its walk once it has it."""
        own = self._at.get(worker)
        if own in self._begun:
            return self._taken(own)
        if self._untouched:
            job = self._untouched.popleft()
            self._begun[walk_of(job)] = deque(in_cells(job))
            return self._taken(walk_of(job))
        manned = set(self._at.values())
        most = max(self._begun, key=lambda walk: (walk not in manned, len(self._begun[walk])))
        return self._taken(most, last=most in manned)

    def begin(self, worker: str, job: Job) -> None:
        """Note that the worker is at the walk of this cell."""
        self._at[worker] = walk_of(job)

    def back(self, cell: Job) -> None:
        """Let a cell wait again, before the others of its walk."""
        self._begun.setdefault(walk_of(cell), deque()).appendleft(cell)

    def _taken(self, walk: Walk, last: bool = False) -> Job:
        cells = self._begun[walk]
        cell = cells.pop() if last else cells.popleft()
        if not cells:
            del self._begun[walk]
        return cell
