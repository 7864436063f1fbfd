"""What a smoother of a walk in progress needs to go on: what is known, and what is being solved."""

from __future__ import annotations

from dataclasses import dataclass

from fg_nav.online.buffer import ToldFootfall
from fg_nav.online.estimates import EstimateRow
from fg_nav.online.handover import Handover, Past
from fg_nav.online.solving import Task


@dataclass(frozen=True)
class Pending:
    """A solution of the first `footfalls` that is taken over when `due_at` lines were told; the task for it.

    It was begun at `clock_s` of this machine, when `t` was the stamp of the walk, s.
    """

    due_at: int
    footfalls: int
    task: Task
    clock_s: float
    t: float


@dataclass(frozen=True)
class SmootherState:
    """All that a smoother needs to go on with the samples; what is in it does not change any more.

    The newest of the `starts` is what the newest stretch begins with; `discarded` footfalls have no samples any more.
    """

    told: tuple[EstimateRow, ...]
    told_continues: tuple[bool, ...]
    footfalls: tuple[ToldFootfall, ...]
    past: Past
    starts: tuple[Handover, ...]
    pending: Pending | None
    next: int
    doubted: tuple[int, ...]
    has_mag: bool
    discarded: int
