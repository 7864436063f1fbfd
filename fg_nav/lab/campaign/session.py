"""Jobs on a Dask cluster: who gets which cell, and what is done where something goes wrong.

A worker is given one cell at a time (`fg_nav.lab.campaign.waiting`), and a cell is for one worker only, so that what
kills a worker is known: the cell that it was at. Results come back to this process, which keeps them, so the cluster
needs no disk in common with it.

============================ ========================================================================================
a worker dies                its cell is given to another, and our own cluster starts a new worker
a cell kills worker by       it becomes a result that failed
worker, `DEATHS` of them
a worker cannot work         is told; it is left alone for `REST_S` and its cell given to another; if `TROUBLES` of them
(its disk is full)           cannot work on one cell the campaign stops
a worker is paused, which    is told; it is given no cell until it goes on
Dask does to spare memory
the scheduler is gone        what had not come back is sent again once it is there again, for `patience_s`
there is no worker           is told, and waited for as long
another program there        the campaign stops, whether scheduler or workers have other code or none: what they
                             would bring is of another program
============================ ========================================================================================

Nothing is counted twice: a result that comes twice is the same file again.
"""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import CancelledError
from contextlib import suppress
from dataclasses import dataclass, field
from queue import Empty, Queue
from time import monotonic, sleep
from typing import Any, TypeAlias

from fg_nav.errors import CampaignError
from fg_nav.lab.campaign import kept
from fg_nav.lab.campaign.cluster import DEATHS, Cluster
from fg_nav.lab.campaign.crew import (
    LOOK_S,
    Client,
    Crew,
    LostError,
    Tell,
    check_code,
    in_a_line,
    is_of_another_program,
    other_program,
)
from fg_nav.lab.campaign.kept import Key
from fg_nav.lab.campaign.made import Job
from fg_nav.lab.campaign.parcel import KILLED, Brought, failed, parcel
from fg_nav.lab.campaign.waiting import Waiting

TROUBLES = 3
"""Times that workers may be unable to work on a cell."""

CONNECT_S = 10.0
FETCH_S = 120.0
"""For one result to come from the worker that has it."""

Take: TypeAlias = Callable[[Job, Brought, int], None]
"""Is given each cell, as a job of its own, with what came of it, and how many work at once."""

Look: TypeAlias = Callable[[int, Mapping[Key, float]], None]
"""Is given, every `LOOK_S` or sooner, how many work, and how long each cell in work has been (s)."""

Future: TypeAlias = Any


def _nobody_looks(workers: int, at: Mapping[Key, float]) -> None: ...


def on_cluster(jobs: Sequence[Job], cluster: Cluster, take: Take, tell: Tell, look: Look = _nobody_looks) -> None:
    """Make all jobs, and give what comes of each cell to `take`.

    Raises
    ------
    CampaignError
        If scheduler or workers are gone for longer than the cluster's patience, or have other code.
    """
    waiting = Waiting(jobs)
    with cluster.entered(jobs) as address:
        client = _connected(address)
        if client is None:
            raise CampaignError(
                f"no Dask scheduler answers at {address}: start one with `dask scheduler`, or leave --scheduler out."
            )
        while client is not None:
            try:
                Session(client, cluster, waiting, take, tell, look).work()
                return
            except LostError:
                tell(f"the scheduler at {address} is gone: trying again for {cluster.patience_s:.0f} s")
            finally:
                _close(client)
            client = _again(address, cluster.patience_s)
        raise CampaignError(
            f"the scheduler at {address} has been gone for {cluster.patience_s:.0f} s: "
            "what is done is kept, and the same command goes on from there."
        )


def _connected(address: str) -> Client | None:
    from distributed import Client

    try:
        return Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError, RuntimeError, ImportError):
        return None


def _again(address: str, patience_s: float) -> Client | None:
    """Connect anew, as often as it takes."""
    end = monotonic() + patience_s
    while monotonic() < end:
        client = _connected(address)
        if client is not None:
            return client
        sleep(LOOK_S)
    return None


def _close(client: Client) -> None:
    with suppress(Exception):  # of a connection that is gone there is nothing more to be had
        client.close(timeout=2.0)


@dataclass(frozen=True)
class _Sent:
    """A cell, the worker that it is for, and when it was sent."""

    cell: Job
    worker: str
    at: float = field(default_factory=monotonic)

    @property
    def key(self) -> Key:
        """Of its one result."""
        return self.cell.keys[0]


class Session:
    """Work on one connection to a scheduler, until all is done or the connection is gone."""

    def __init__(self, client: Client, cluster: Cluster, waiting: Waiting, take: Take, tell: Tell, look: Look) -> None:
        self._client, self._cluster, self._waiting = client, cluster, waiting
        self._take, self._tell, self._look = take, tell, look
        self._flying: dict[Future, _Sent] = {}
        self._landed: Queue[Future] = Queue()
        self._crew = Crew(client, cluster, tell)
        self._deaths: Counter[Key] = Counter()
        self._troubles: Counter[Key] = Counter()

    def work(self) -> None:
        """Do what waits; when the connection is lost all that did not come back waits again."""
        try:
            while self._waiting or self._flying:
                self._crew.see(idle=not self._flying)
                for future in [one for one, sent in self._flying.items() if sent.worker not in self._crew.there]:
                    self._died(future)
                busy = {sent.worker for sent in self._flying.values()}
                for worker in self._crew.able:
                    if self._waiting and worker not in busy:
                        self._send(worker)
                self._show()
                with suppress(Empty):
                    self._landed_one(self._landed.get(timeout=LOOK_S))
            self._show()
        finally:
            for sent in self._flying.values():
                self._left(sent)

    def _left(self, sent: _Sent) -> None:
        """Let a cell wait again, and its worker be at nothing."""
        self._waiting.leave(sent.worker)
        self._waiting.back(sent.cell)

    def _show(self) -> None:
        now = monotonic()
        self._look(len(self._crew.able), {sent.key: now - sent.at for sent in self._flying.values()})

    def _send(self, worker: str) -> None:
        cell = self._waiting.cell_for(worker)
        sent = _Sent(cell, worker)
        packed = parcel(cell, self._cluster.far, self._waiting.name_of(cell), self._waiting.is_at(worker, cell))
        self._waiting.begin(worker, cell)
        try:
            with warnings.catch_warnings():
                warnings.filterwarnings("ignore", message="Sending large graph")  # the files of a recorded walk
                future = self._client.submit(self._cluster.work, packed, pure=False, workers=[worker])
        except (OSError, RuntimeError, ValueError, CancelledError) as error:
            self._waiting.back(cell)
            raise LostError from error
        self._flying[future] = sent
        future.add_done_callback(self._landed.put)

    def _died(self, future: Future) -> None:
        """Give a cell whose worker is gone to another, too often killed by it as a result that failed."""
        if future.status == "error":  # what it is comes yet
            return
        sent = self._flying.pop(future)
        with suppress(OSError, RuntimeError, ValueError, CancelledError):
            future.cancel()
        self._deaths[sent.key] += future.status != "finished"
        if self._deaths[sent.key] >= DEATHS:
            self._waiting.leave(sent.worker)
            self._killed(sent)
        else:
            self._left(sent)

    def _killed(self, sent: _Sent) -> None:
        code = kept.code_sum()
        self._take(sent.cell, Brought((failed(sent.cell, KILLED, code),), code, None), len(self._crew.able))

    def _landed_one(self, future: Future) -> None:
        """Take what came of a cell, or let it wait again; one that was given to another is nothing any more."""
        from distributed.scheduler import KilledWorker

        sent = self._flying.pop(future, None)
        if sent is None:
            return
        ours = future.status == "error"  # and not one of fetching
        try:
            brought = future.exception(timeout=FETCH_S) if ours else future.result(timeout=FETCH_S)
        except (OSError, CancelledError):  # cancelled with the connection, or its worker died with the result
            self._left(sent)
            return
        except Exception as error:  # it was lost and made again, and then this
            brought, ours = error, True
        if isinstance(brought, KilledWorker):  # told by a scheduler that counts less than we do
            self._killed(sent)
        elif ours:  # what goes wrong in a cell is its result: this went wrong before it was begun
            self._troubled(sent, brought)
        else:
            self._came(sent, brought)

    def _came(self, sent: _Sent, brought: Brought) -> None:
        check_code(brought.code)
        if brought.results:
            self._take(sent.cell, brought, len(self._crew.able))
            return
        self._left(sent)  # it does not hold the walk

    def _troubled(self, sent: _Sent, error: Exception) -> None:
        """Give the cell to another worker, too often in trouble end the campaign."""
        if is_of_another_program(error):
            raise other_program(error)
        self._troubles[sent.key] += 1
        if self._troubles[sent.key] >= TROUBLES:
            raise CampaignError(
                f"the worker {sent.worker} cannot work ({in_a_line(error)}), nor could those tried before it: "
                "see to them, and the same command goes on from there."
            )
        self._crew.rest(sent.worker, in_a_line(error))
        self._left(sent)
