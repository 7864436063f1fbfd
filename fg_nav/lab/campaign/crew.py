"""Who is there to work on a cluster: workers that are able, and what there is to tell of the others.

A worker is able that is there, has the same code as this, is not paused by Dask to spare memory, and does not rest
after a trouble.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence, Set
from concurrent.futures import CancelledError
from time import monotonic
from typing import Any, TypeAlias

from fg_nav.errors import CampaignError
from fg_nav.lab.campaign import kept
from fg_nav.lab.campaign.cluster import Cluster

REST_S = 10.0
"""For a worker that could not work, so that it does not get through all cells at once."""

LOOK_S = 1.0
"""How often the connection is looked at while no result comes."""

Tell: TypeAlias = Callable[[str], None]
"""Tells the user a sentence."""

Client: TypeAlias = Any

_CODE_THERE = "__import__('fg_nav.lab.campaign.kept', fromlist=['code_sum']).code_sum()"


class LostError(Exception):
    """The scheduler does not answer."""


class Crew:
    """Who is there to work, and what there is to tell of them."""

    def __init__(self, client: Client, cluster: Cluster, tell: Tell) -> None:
        self._client, self._cluster, self._tell = client, cluster, tell
        self.there: Set[str] = frozenset()
        self.able: Sequence[str] = ()
        self._paused: Set[str] = frozenset()
        self._paused_at = float("-inf")
        self._resting: dict[str, float] = {}
        self._checked: set[str] = set()
        self._told: set[str] = set()
        self._idle_since: float | None = None

    def see(self, idle: bool) -> None:
        """See who is there, and that there is a scheduler; `idle` if nobody is at anything."""
        if self._client.status != "running":
            raise LostError
        try:
            threads = self._client.nthreads()
            self._see_paused()
        except (OSError, RuntimeError, ValueError, CancelledError) as error:
            raise LostError from error
        if any(count > 1 for count in threads.values()):
            self._tell_once("a worker with several threads is given one cell at a time: start workers by --nthreads 1")
        self.there = threads.keys()
        if self._cluster.far:
            self._check(self.there - self._checked)
        known = self._checked if self._cluster.far else self.there
        working = (self.there & known) - self._paused
        self.able = sorted(one for one in working if self._resting.get(one, 0.0) <= monotonic())
        self._wait(idle and not working)

    def rest(self, worker: str, reason: str) -> None:
        """Leave a worker alone for a time."""
        self._resting[worker] = monotonic() + REST_S
        self._tell_once(f"the worker {worker} cannot work ({reason}): what it was at goes to another")

    def _see_paused(self) -> None:
        if monotonic() - self._paused_at < LOOK_S:
            return
        found = self._client.scheduler_info(n_workers=-1)["workers"]
        self._paused = {worker for worker, about in found.items() if about.get("status") == "paused"}
        self._paused_at = monotonic()
        for worker in sorted(self._paused):
            self._tell_once(f"the worker {worker} is paused, short of memory: it is given no more until it goes on")

    def _wait(self, nobody: bool) -> None:
        """Tell once that there is nobody, and raise `CampaignError` where that lasts."""
        if not nobody:
            self._idle_since = None
            return
        what = "no workers but paused ones" if self._paused & self.there else "no workers"
        if self._idle_since is None:
            self._idle_since = monotonic()
            self._tell(f"the cluster has {what}: waiting for some")
        if monotonic() - self._idle_since > self._cluster.patience_s:
            raise CampaignError(
                f"the cluster has had {what} for {self._cluster.patience_s:.0f} s: start some "
                "(`dask worker ADDRESS --nthreads 1`, one a core), and the same command goes on from there."
            )

    def _check(self, workers: Set[str]) -> None:
        """Ask workers that are new for their code, in words that need none: one without the package ends by a task."""
        if not workers:
            return
        try:
            told = self._client.run(eval, _CODE_THERE, workers=sorted(workers), on_error="return")
        except (OSError, RuntimeError, ValueError, CancelledError):  # one went just now: asked again
            return
        for worker, code in told.items():
            if isinstance(code, ImportError | AttributeError):
                raise other_program(code)
            if isinstance(code, str):
                check_code(code)
                self._checked.add(worker)

    def _tell_once(self, words: str) -> None:
        if words not in self._told:
            self._told.add(words)
            self._tell(words)


def check_code(code: str) -> None:
    """Raise `CampaignError` where that is not the sum over our code."""
    if code != kept.code_sum():
        raise CampaignError(
            "the workers have another fg-nav, Python or libraries than this: install the same versions there."
        )


def other_program(error: object) -> CampaignError:
    """Return the end of a campaign on workers whose program is another, or none."""
    return CampaignError(
        f"the cluster cannot run fg-nav ({in_a_line(error)}): install the same version there, "
        "on the scheduler and on each worker."
    )


def is_of_another_program(error: object) -> bool:
    """Whether an error says that a task could not be read, there or by the scheduler."""
    return isinstance(error, ImportError | AttributeError) or "deserializ" in str(error)


def in_a_line(error: object) -> str:
    """What an error says, to the end of its first sentence: Dask's have several lines, and links."""
    first, *_ = " ".join(str(error).split()).split(". ")
    return f"{type(error).__name__}: {first}" if first else type(error).__name__
