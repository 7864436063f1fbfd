"""Jobs on a Dask cluster: one of our own on this machine, or theirs.

A worker is given one cell at a time (`fg_nav.campaign.waiting`), and a cell is for one worker only, so that what kills
a worker is known: the cell that it was at. Results come back to this process, which keeps them, so the cluster needs
no disk in common with it.

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

import logging
import re
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from queue import Empty, Queue
from time import monotonic, sleep
from typing import Any, TypeAlias

from fg_nav.campaign import kept
from fg_nav.campaign.kept import Key
from fg_nav.campaign.made import Job
from fg_nav.campaign.parcel import KILLED, Brought, Parcel, failed, parcel, unpacked
from fg_nav.campaign.waiting import Waiting
from fg_nav.errors import CampaignError

EXTRA = "campaign"

DEATHS = 3
"""Workers that a cell may kill."""

TROUBLES = 3
"""Times that workers may be unable to work on a cell."""

REST_S = 10.0
"""For a worker that could not work, so that it does not get through all cells at once."""

PATIENCE_S = 300.0
"""For a scheduler or workers that are gone: a restart takes seconds, a node of a queue minutes."""

CONNECT_S = 10.0
FETCH_S = 120.0
"""For one result to come from the worker that has it."""
LOOK_S = 1.0
"""How often the connection is looked at while no result comes."""

Take: TypeAlias = Callable[[Job, Brought, int], None]
"""Is given each cell, as a job of its own, with what came of it, and how many work at once."""

Look: TypeAlias = Callable[[int, Mapping[Key, float]], None]
"""Is given, every `LOOK_S` or sooner, how many work, and how long each cell in work has been (s)."""

Work: TypeAlias = Callable[[Parcel], Brought]
"""What a worker does; `unpacked` but in tests."""

Tell: TypeAlias = Callable[[str], None]
"""Tells the user a sentence."""

Future: TypeAlias = Any
Client: TypeAlias = Any

LAST_PORT = 65535

_ADDRESS = re.compile(r"(?P<by>tcp|tls)://(\[[0-9a-fA-F:.%]+\]|[\w.-]+):(?P<port>[0-9]+)")

_CODE_THERE = "__import__('fg_nav.campaign.kept', fromlist=['code_sum']).code_sum()"

_OURS = {
    "distributed.scheduler.allowed-failures": DEATHS,  # we count ourselves
    "distributed.worker.memory.target": False,  # nothing is stored there that could be put to disk
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,  # a paused worker would never be given work again
    "distributed.worker.memory.terminate": 0.95,
    # Ctrl-C goes to all processes of a terminal: the campaign ends its workers, which would complain of it
    "distributed.worker.preload": ["import signal\nsignal.signal(signal.SIGINT, signal.SIG_IGN)\n"],
}
"""Settings of our own cluster."""


class _LostError(Exception):
    """The scheduler does not answer."""


def check_installed() -> None:
    """Raise `CampaignError` if Dask or Arrow is not there."""
    try:
        import dask
        import distributed
        import pyarrow  # noqa: F401
    except ImportError as error:
        raise CampaignError(
            f"campaigns need Dask and Arrow, and {error.name} is not there: pip install 'fg-nav[{EXTRA}]'."
        ) from None
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # workers that die are our business
    dask.config.set({"logging.distributed": "critical"})
    del distributed


@dataclass(frozen=True)
class Cluster:
    """Where the work is done.

    Attributes
    ----------
    scheduler : address, `tcp://host:port`; None for a cluster of our own, as long as the campaign.
    workers : processes of our own cluster, one thread each.
    patience_s : how long to wait for a scheduler or workers that are gone.
    work : what they do.
    """

    scheduler: str | None = None
    workers: int = 1
    patience_s: float = PATIENCE_S
    work: Work = unpacked

    @property
    def far(self) -> bool:
        """Whether the workers may have other disks."""
        return self.scheduler is not None

    def workers_for(self, jobs: Sequence[Job]) -> int:
        """Number of processes of our own that these need: each gets its share of the memory."""
        return max(1, min(self.workers, sum(len(job.keys) for job in jobs)))

    @contextmanager
    def entered(self, jobs: Sequence[Job]) -> Iterator[str]:
        """Yield the scheduler's address, its cluster started for these jobs if it is ours.

        Raises
        ------
        CampaignError
            If there is no scheduler at the address, or no cluster can be started.
        """
        if self.scheduler is not None:
            yield self.scheduler
            return
        import dask
        from distributed import LocalCluster

        with dask.config.set(_OURS):
            try:
                ours = LocalCluster(
                    n_workers=self.workers_for(jobs),
                    threads_per_worker=1,
                    processes=True,
                    host="127.0.0.1",
                    dashboard_address="127.0.0.1:0",
                    silence_logs=logging.CRITICAL,
                )
            except (OSError, RuntimeError) as error:
                raise CampaignError(f"no Dask cluster could be started here ({error}): try fewer --workers.") from None
            with ours:
                yield ours.scheduler_address


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
                _Session(client, cluster, waiting, take, tell, look).work()
                return
            except _LostError:
                tell(f"the scheduler at {address} is gone: trying again for {cluster.patience_s:.0f} s")
            finally:
                _close(client)
            client = _again(address, cluster.patience_s)
        raise CampaignError(
            f"the scheduler at {address} has been gone for {cluster.patience_s:.0f} s: "
            "what is done is kept, and the same command goes on from there."
        )


def check_address(address: str) -> None:
    """Raise `CampaignError` where there can be no scheduler; Dask would tell it by a traceback of its own."""
    from distributed.security import Security

    found = _ADDRESS.fullmatch(address)
    if found is None or int(found["port"]) > LAST_PORT:
        raise CampaignError(f"'{address}' is no address of a Dask scheduler: write it as tcp://host:8786.")
    if found["by"] == "tls" and Security().get_connection_args("client").get("ssl_context") is None:
        raise CampaignError(f"Dask has no certificates for {address}: name them in its configuration, or use tcp.")


def _check_code(code: str) -> None:
    if code != kept.code_sum():
        raise CampaignError("the workers have another fg-nav, Python or libraries than this: install the same versions there.")


def _other_program(error: object) -> CampaignError:
    return CampaignError(
        f"the cluster cannot run fg-nav ({_in_a_line(error)}): install the same version there, "
        "on the scheduler and on each worker."
    )


def _is_of_another_program(error: object) -> bool:
    """Whether an error says that a task could not be read, there or by the scheduler."""
    return isinstance(error, ImportError | AttributeError) or "deserializ" in str(error)


def _in_a_line(error: object) -> str:
    """What an error says, to the end of its first sentence: Dask's have several lines, and links."""
    first, *_ = " ".join(str(error).split()).split(". ")
    return f"{type(error).__name__}: {first}" if first else type(error).__name__


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


class _Session:
    """Work on one connection to a scheduler, until all is done or the connection is gone."""

    def __init__(self, client: Client, cluster: Cluster, waiting: Waiting, take: Take, tell: Tell, look: Look) -> None:
        self._client, self._cluster, self._waiting = client, cluster, waiting
        self._take, self._tell, self._look = take, tell, look
        self._flying: dict[Future, _Sent] = {}
        self._landed: Queue[Future] = Queue()
        self._crew = _Crew(client, cluster, tell)
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
            raise _LostError from error
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
        _check_code(brought.code)
        if brought.results:
            self._take(sent.cell, brought, len(self._crew.able))
            return
        self._left(sent)  # it does not hold the walk

    def _troubled(self, sent: _Sent, error: Exception) -> None:
        """Give the cell to another worker, too often in trouble end the campaign."""
        if _is_of_another_program(error):
            raise _other_program(error)
        self._troubles[sent.key] += 1
        if self._troubles[sent.key] >= TROUBLES:
            raise CampaignError(
                f"the worker {sent.worker} cannot work ({_in_a_line(error)}), nor could those tried before it: "
                "see to them, and the same command goes on from there."
            )
        self._crew.rest(sent.worker, _in_a_line(error))
        self._left(sent)


class _Crew:
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
            raise _LostError
        try:
            threads = self._client.nthreads()
            self._see_paused()
        except (OSError, RuntimeError, ValueError, CancelledError) as error:
            raise _LostError from error
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
                raise _other_program(code)
            if isinstance(code, str):
                _check_code(code)
                self._checked.add(worker)

    def _tell_once(self, words: str) -> None:
        if words not in self._told:
            self._told.add(words)
            self._tell(words)
