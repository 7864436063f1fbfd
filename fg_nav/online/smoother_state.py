"""What a smoother of a walk in progress needs to go on: what is known, and what is being solved."""

from __future__ import annotations

from dataclasses import dataclass, replace

from fg_nav.online.anchor import AnchorState, Past
from fg_nav.online.buffer import ReportedFootfall
from fg_nav.online.estimates import EstimateRow
from fg_nav.online.solving import Task


@dataclass(frozen=True)
class Pending:
    """A solution of the first `footfalls`, and the task for it.

    `asked` are the lines before which it is asked for, each time with the footfalls up to there; it is taken over
    before the last of them, or later.
    """

    asked: tuple[int, ...]
    footfalls: int
    task: Task

    @property
    def due_at(self) -> int:
        """The last of these lines."""
        return self.asked[-1]

    def ask_at(self, line: int) -> Pending:
        """Return it, asked for before a line too."""
        return self if line == self.due_at else replace(self, asked=(*self.asked, line))


@dataclass(frozen=True)
class SmootherState:
    """All that a smoother needs to go on with the samples; what is in it does not change any more.

    The newest of the `starts` is what the newest window begins with; `discarded` footfalls have no samples any more.
    """

    told: tuple[EstimateRow, ...]
    reported_continues: tuple[bool, ...]
    footfalls: tuple[ReportedFootfall, ...]
    past: Past
    starts: tuple[AnchorState, ...]
    pending: Pending | None
    next: int
    doubted: tuple[int, ...]
    has_mag: bool
    discarded: int
