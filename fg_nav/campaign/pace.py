"""How far a campaign is, and how long it will still take.

The time of a job is that of its cells, and a cell takes as long as those of its group took so far, on the mean; of a
group without any, as those of all. The time left is the sum over what is missing, over how many work at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from fg_nav.campaign.made import Job


@dataclass(frozen=True)
class Standing:
    """Cells done, those joined among them, and in all; seconds left, None where nothing is known yet."""

    done: int
    joined: int
    total: int
    left_s: float | None
    workers: int


@dataclass
class Pace:
    """Counts what comes in."""

    joined: int
    missing: dict[str, int]
    total: int
    _seconds: dict[str, float] = field(default_factory=dict)
    _cells: dict[str, int] = field(default_factory=dict)

    @classmethod
    def of(cls, joined: int, jobs: Sequence[Job]) -> Pace:
        """Begin with so many cells kept already, and these jobs missing."""
        missing: dict[str, int] = {}
        for job in jobs:
            missing[job.group] = missing.get(job.group, 0) + len(job.keys)
        return cls(joined, missing, joined + sum(missing.values()))

    def came(self, group: str, cells: int, seconds: float) -> None:
        """Count the cells of a job, and what they took."""
        self.missing[group] -= cells
        self._cells[group] = self._cells.get(group, 0) + cells
        self._seconds[group] = self._seconds.get(group, 0.0) + seconds

    def standing(self, workers: int) -> Standing:
        """How far it is, with so many at work."""
        missing = sum(self.missing.values())
        return Standing(self.total - missing, self.joined, self.total, self._left_s(max(workers, 1)), workers)

    def _left_s(self, workers: int) -> float | None:
        cells = sum(self._cells.values())
        if cells == 0:
            return None
        mean = sum(self._seconds.values()) / cells
        return sum(count * self._cell_s(group, mean) for group, count in self.missing.items()) / workers

    def _cell_s(self, group: str, mean: float) -> float:
        known = self._cells.get(group, 0)
        return self._seconds[group] / known if known else mean
