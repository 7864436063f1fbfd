"""Jobs on a Dask cluster: one of our own on this machine, or theirs.

A job is a task that is sent when a worker is free to take it, so that what kills a worker is known: the task that it
was at. Results come back to this process, which keeps them, so the cluster needs no disk in common with it.

============================ ========================================================================================
a worker dies                Dask gives its task to another, and our own cluster starts a new worker
a task kills worker by       it is split into its cells, and a cell that does the same becomes a result that failed
worker, `DEATHS` of them
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
from collections import deque
from collections.abc import Callable, Iterator, Sequence, Set
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from queue import Empty, Queue
from time import monotonic, sleep
from typing import Any, TypeAlias

from fg_nav.campaign import kept
from fg_nav.campaign.made import Job
from fg_nav.campaign.parcel import Brought, Parcel, failed, in_cells, parcel, unpacked
from fg_nav.errors import CampaignError
from fg_nav.wording import counted

EXTRA = "campaign"

DEATHS = 3
"""Workers that a task may kill; on a cluster of others its own setting counts, one more by default."""

PATIENCE_S = 300.0
"""For a scheduler or workers that are gone: a restart takes seconds, a node of a queue minutes."""

CONNECT_S = 10.0
FETCH_S = 120.0
"""For one result to come from the worker that has it."""
LOOK_S = 1.0
"""How often the connection is looked at while no result comes."""

Take: TypeAlias = Callable[[Job, Brought, int], None]
"""Is given each job with what came of it, and how many work at once."""

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
    "distributed.scheduler.allowed-failures": DEATHS - 1,
    "distributed.scheduler.worker-saturation": 1.0,  # no task waits at a worker, to be blamed for another
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

    @contextmanager
    def entered(self) -> Iterator[str]:
        """Yield the scheduler's address, its cluster started if it is ours.

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
                    n_workers=self.workers,
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


def on_cluster(jobs: Sequence[Job], cluster: Cluster, take: Take, tell: Tell) -> None:
    """Make all jobs, and give what comes of each to `take`.

    Raises
    ------
    CampaignError
        If scheduler or workers are gone for longer than the cluster's patience, or have other code.
    """
    waiting = deque(jobs)
    with cluster.entered() as address:
        client = _connected(address)
        if client is None:
            raise CampaignError(
                f"no Dask scheduler answers at {address}: start one with `dask scheduler`, or leave --scheduler out."
            )
        while client is not None:
            try:
                _Session(client, cluster, take, tell).work(waiting)
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
        raise CampaignError("the workers have another fg-nav than this: install the same version there.")


def _other_program(error: object) -> CampaignError:
    return CampaignError(
        f"the cluster cannot run fg-nav ({_in_a_line(error)}): install the same version there, "
        "on the scheduler and on each worker."
    )


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


class _Session:
    """Work on one connection to a scheduler, until all is done or the connection is gone."""

    def __init__(self, client: Client, cluster: Cluster, take: Take, tell: Tell) -> None:
        self._client, self._cluster, self._take, self._tell = client, cluster, take, tell
        self._flying: dict[Future, Job] = {}
        self._landed: Queue[Future] = Queue()
        self._threads = 0
        self._idle_since: float | None = None
        self._checked: set[str] = set()

    def work(self, waiting: deque[Job]) -> None:
        """Do what waits; when the connection is lost all that did not come back waits again."""
        try:
            while waiting or self._flying:
                self._count()
                while waiting and len(self._flying) < self._threads:
                    self._send(waiting.popleft())
                with suppress(Empty):
                    future = self._landed.get(timeout=LOOK_S)
                    waiting.extend(self._ended(future, self._flying.pop(future)))
        finally:
            waiting.extendleft(self._flying.values())

    def _count(self) -> None:
        """See how many work, and that there is a scheduler."""
        if self._client.status != "running":
            raise _LostError
        try:
            threads = self._client.nthreads()
        except (OSError, RuntimeError, ValueError, CancelledError) as error:
            raise _LostError from error
        if self._cluster.far:
            self._check(threads.keys() - self._checked)
        self._threads = sum(threads.values())
        if self._threads:
            self._idle_since = None
            return
        if self._idle_since is None:
            self._idle_since = monotonic()
            self._tell("the cluster has no workers: waiting for some")
        if monotonic() - self._idle_since > self._cluster.patience_s:
            raise CampaignError(
                f"the cluster has had no workers for {self._cluster.patience_s:.0f} s: "
                "start some (`dask worker ADDRESS`), and the same command goes on from there."
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

    def _send(self, job: Job) -> None:
        try:
            with warnings.catch_warnings():
                warnings.filterwarnings("ignore", message="Sending large graph")  # the files of a recorded walk
                future = self._client.submit(self._cluster.work, parcel(job, self._cluster.far), pure=False)
        except (OSError, RuntimeError, ValueError, CancelledError) as error:
            self._flying[object()] = job
            raise _LostError from error
        self._flying[future] = job
        future.add_done_callback(self._landed.put)

    def _ended(self, future: Future, job: Job) -> list[Job]:
        """Take what came of a job, or return what is to be done of it again."""
        from distributed.scheduler import KilledWorker

        failed = future.status == "error"
        try:
            brought = future.exception(timeout=FETCH_S) if failed else future.result(timeout=FETCH_S)
        except (OSError, CancelledError):  # cancelled with the connection, or its worker died with the result
            return [job]
        if isinstance(brought, KilledWorker):
            return self._broken(job, "it ended its worker, again and again: out of memory, or a crash")
        if failed:  # what goes wrong in a cell is its result: this went wrong before a cell was begun
            raise _other_program(brought)
        _check_code(brought.code)
        self._take(job, brought, self._threads)
        return []

    def _broken(self, job: Job, reason: str) -> list[Job]:
        cells = in_cells(job)
        if len(cells) > 1:
            self._tell(
                f"{job.group}, {job.field}, {job.walk}: {reason}; trying its {counted(len(cells), 'cell')} alone"
            )
            return cells
        code = kept.code_sum()
        self._take(job, Brought((failed(job, reason, code),), code, 0.0), self._threads)
        return []
