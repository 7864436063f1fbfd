"""How far a campaign is, and how long it will still take.

A cell takes as long as those of its group and method took so far, on the mean; of a method without any there, as those
of the group, and of a group without any, as all. Points of a grid count as one method. A cell that somebody is at has
left what it has not had yet, or, where it is late, `LATE` of what it has had.

The time left is the sum over all cells, over how many work at once, if there are cells for so many; and never less
than that of the longest.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TypeAlias

from fg_nav.lab.campaign.kept import Key
from fg_nav.lab.campaign.made import Job

LATE = 0.1
"""Of the time that a cell has had: nobody knows how long one takes that is over the mean."""

Kind: TypeAlias = tuple[str, str]
"""Group and method, without parameters; or group and nothing, or neither, for the means over more."""

At: TypeAlias = Mapping[Key, float]
"""Seconds that each cell has had which somebody is at."""

NOBODY: At = MappingProxyType({})


@dataclass(frozen=True)
class Standing:
    """Cells done, those joined among them, and in all; seconds left, None where nothing is known yet; workers."""

    done: int
    joined: int
    total: int
    left_s: float | None
    workers: int


@dataclass
class Pace:
    """Counts what comes in."""

    joined: int
    missing: Counter[Kind]
    total: int
    _seconds: dict[Kind, float] = field(default_factory=dict)
    _cells: Counter[Kind] = field(default_factory=Counter)

    @classmethod
    def of(cls, joined: int, jobs: Sequence[Job]) -> Pace:
        """Begin with so many cells kept already, and these jobs missing."""
        missing = Counter(_kind(key) for job in jobs for key in job.keys)
        return cls(joined, missing, joined + missing.total())

    def came(self, keys: Iterable[Key], seconds: float | None) -> None:
        """Count cells, and what they took together; None where that is not known, as of one that killed workers."""
        kinds = [_kind(key) for key in keys]
        self.missing.subtract(kinds)
        if seconds is None:
            return
        for kind in kinds:
            for one in _wider(kind):
                self._cells[one] += 1
                self._seconds[one] = self._seconds.get(one, 0.0) + seconds / len(kinds)

    def standing(self, workers: int, at: At = NOBODY) -> Standing:
        """How far it is, with so many working, and at what."""
        missing = self.missing.total()
        return Standing(self.total - missing, self.joined, self.total, self._left_s(max(workers, 1), at), workers)

    def _left_s(self, workers: int, at: At) -> float | None:
        if not self._cells:
            return None
        waiting = self.missing - Counter(_kind(key) for key in at)
        left = [_left_s(self._cell_s(_kind(key)), had) for key, had in at.items()]
        total = sum(left) + sum(count * self._cell_s(kind) for kind, count in waiting.items())
        longest = max([*left, *(self._cell_s(kind) for kind in waiting)], default=0.0)
        return max(total / max(min(workers, len(left) + waiting.total()), 1), longest)

    def _cell_s(self, kind: Kind) -> float:
        known = next(one for one in _wider(kind) if one in self._cells)
        return self._seconds[known] / self._cells[known]


def _left_s(whole_s: float, had_s: float) -> float:
    return max(whole_s - had_s, LATE * had_s)


def _kind(key: Key) -> Kind:
    return key.group, key.method.partition(",")[0]


def _wider(kind: Kind) -> tuple[Kind, ...]:
    return kind, (kind[0], ""), ("", "")
