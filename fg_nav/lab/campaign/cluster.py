"""The Dask cluster that a campaign works on, local for its own time or the user's by its address, and its workers."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from threading import Event
from time import monotonic
from typing import Any, TypeAlias

from fg_nav.errors import CampaignError
from fg_nav.lab.campaign.execute import Task, TaskResults, describe_error, run_task
from fg_nav.lab.store.code import code_sum

EXTRA = "campaign"

DEATHS = 3  # Workers that a task may end on a local cluster; on the user's, its scheduler counts.
PATIENCE_S = 300.0  # For a scheduler or workers that are gone: a restart takes seconds, a node of a queue minutes.

CONNECT_S = 10.0
RETRY_S = 1.0

LAST_PORT = 65535

REST_S = 10.0  # For a worker that could not start a task.
LOOK_S = 1.0  # How often the workers are looked at.

Client: TypeAlias = Any

Notify: TypeAlias = Callable[[str], None]
"""Shows the user a sentence."""

BROKEN = (OSError, RuntimeError, ValueError, CancelledError)  # What Dask raises if a connection breaks.

_CODE_THERE = "__import__('fg_nav.lab.store.code', fromlist=['code_sum']).code_sum()"

_ADDRESS = re.compile(r"(?P<by>tcp|tls)://(\[[0-9a-fA-F:.%]+\]|[\w.-]+):(?P<port>[0-9]+)")

_LOCAL = {
    "distributed.deploy.lost-worker-timeout": f"{PATIENCE_S:.0f}s",  # a busy machine takes long to start another
    "distributed.scheduler.allowed-failures": DEATHS - 1,
    "distributed.scheduler.worker-saturation": 1.0,
    "distributed.worker.memory.target": False,  # nothing is stored there that could be put to disk
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,  # a paused worker would never be given work again
    "distributed.worker.memory.terminate": 0.95,
    # Ctrl-C goes to all processes of a terminal: the campaign ends its workers, which would print tracebacks
    "distributed.worker.preload": ["import signal\nsignal.signal(signal.SIGINT, signal.SIG_IGN)\n"],
}
"""Settings of a local cluster."""


def check_installed() -> None:
    """Raise `CampaignError` if Dask or Arrow is not installed."""
    try:
        import dask
        import distributed
        import pyarrow  # noqa: F401
    except ImportError as error:
        raise CampaignError(
            f"campaigns need Dask and Arrow, and {error.name} is not there: pip install 'fg-nav[{EXTRA}]'."
        ) from None
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # workers that die are handled here
    dask.config.set({"logging.distributed": "critical"})
    del distributed


def check_address(address: str) -> None:
    """Raise `CampaignError` if there can be no scheduler; Dask would print a traceback of its own."""
    from distributed.security import Security

    found = _ADDRESS.fullmatch(address)
    if found is None or int(found["port"]) > LAST_PORT:
        raise CampaignError(f"'{address}' is no address of a Dask scheduler: write it as tcp://host:8786.")
    if found["by"] == "tls" and Security().get_connection_args("client").get("ssl_context") is None:
        raise CampaignError(f"Dask has no certificates for {address}: name them in its configuration, or use tcp.")


@dataclass(frozen=True)
class Cluster:
    """Where the tasks run.

    Attributes
    ----------
    scheduler : address, `tcp://host:port`; None for a local cluster.
    workers : processes of a local cluster, one thread each.
    patience_s : how long to wait for a scheduler or workers that are gone.
    work : what a worker runs; `run_task` but in tests.
    """

    scheduler: str | None = None
    workers: int = 1
    patience_s: float = PATIENCE_S
    work: Callable[[Task], TaskResults] = run_task

    @property
    def remote(self) -> bool:
        """Whether the workers may have other disks and other code."""
        return self.scheduler is not None

    def workers_for(self, tasks: Sequence[Task]) -> int:
        """Return how many local processes these tasks need: each gets its share of the memory."""
        return max(1, min(self.workers, sum(len(task.keys) for task in tasks)))

    @contextmanager
    def start(self, tasks: Sequence[Task]) -> Iterator[str]:
        """Yield the scheduler's address; a local cluster runs as long as the block.

        Raises
        ------
        CampaignError
            If no local cluster can be started.
        """
        if self.scheduler is not None:
            yield self.scheduler
            return
        import dask
        from distributed import LocalCluster

        with dask.config.set(_LOCAL):
            try:
                local = LocalCluster(
                    n_workers=self.workers_for(tasks),
                    threads_per_worker=1,
                    processes=True,
                    host="127.0.0.1",
                    dashboard_address="127.0.0.1:0",
                    silence_logs=logging.CRITICAL,
                )
            except (OSError, RuntimeError) as error:
                raise CampaignError(f"no Dask cluster could be started here ({error}): try fewer --workers.") from None
            with local:
                yield local.scheduler_address


def connect(address: str, stop: Event, patience_s: float = 0.0) -> Client | None:
    """Return a client of a scheduler, or None if it does not answer for so long; interrupted if `stop` is set."""
    end = monotonic() + patience_s
    client = _connect_once(address)
    while client is None and monotonic() < end:
        stop.wait(RETRY_S)
        check_stop(stop)
        client = _connect_once(address)
    return client


def check_stop(stop: Event) -> None:
    """Raise `KeyboardInterrupt` if Ctrl-C was pressed: here it cannot get lost."""
    if stop.is_set():
        raise KeyboardInterrupt


def _connect_once(address: str) -> Client | None:
    from distributed import Client

    try:
        return Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError, RuntimeError, ImportError):
        return None


def disconnect(client: Client) -> None:
    """Close a client, whose connection may be gone."""
    with suppress(Exception):  # nothing more can be done with a lost connection
        client.close(timeout=2.0)


class LostError(Exception):
    """The scheduler does not answer."""


class Workers:
    """Who is there to work, and what the user should know of them."""

    def __init__(self, client: Client, cluster: Cluster, notify: Notify) -> None:
        self._client, self._cluster, self._notify = client, cluster, notify
        self.able: frozenset[str] = frozenset()
        self._looked_at = float("-inf")
        self._avoided: dict[str, float] = {}
        self._checked: set[str] = set()
        self._noted: set[str] = set()
        self._idle_since: float | None = None

    def look(self, idle: bool) -> None:
        """See that there is a scheduler, and which workers are able; `idle` if no task is sent."""
        if self._client.status != "running":
            raise LostError
        if monotonic() - self._looked_at < LOOK_S and self.able:
            return
        try:
            found = self._client.scheduler_info(n_workers=-1)["workers"]
        except BROKEN as error:
            raise LostError from error
        self._looked_at = monotonic()
        paused = {worker for worker, about in found.items() if about.get("status") == "paused"}
        for worker in sorted(paused):
            self._note(f"the worker {worker} is paused, short of memory: it is given no more until it goes on")
        if any(about.get("nthreads", 1) > 1 for about in found.values()):
            self._note("a worker with several threads makes one walk at a time: start workers by --nthreads 1")
        if self._cluster.remote:
            self._check(found.keys() - self._checked)
        known = self._checked if self._cluster.remote else found.keys()
        self.able = frozenset((found.keys() & known) - paused)
        nobody = not found or (idle and not self.able)  # a paused one ends what it has begun
        self._wait(nobody, "no workers but paused ones" if paused else "no workers")

    def avoid(self, worker: str, reason: str) -> None:
        """Give a worker nothing for a time."""
        self._avoided[worker] = monotonic() + REST_S
        self._note(f"the worker {worker} cannot work ({reason}): its walk goes to another")

    def avoided(self) -> frozenset[str]:
        """Return the workers to be avoided now; none where that would be all."""
        avoided = frozenset(worker for worker, until in self._avoided.items() if until > monotonic()) & self.able
        return avoided if self.able - avoided else frozenset()

    def _wait(self, none_able: bool, what: str) -> None:
        """Note once that there is no worker, and raise `CampaignError` where that lasts."""
        if not none_able:
            self._idle_since = None
            return
        if self._idle_since is None:
            self._idle_since = monotonic()
            self._notify(f"the cluster has {what}: waiting for some")
        if monotonic() - self._idle_since > self._cluster.patience_s:
            raise CampaignError(
                f"the cluster has had {what} for {self._cluster.patience_s:.0f} s: start some "
                "(`dask worker ADDRESS --nthreads 1`, one a core), and the same command goes on from there."
            )

    def _check(self, workers: Collection[str]) -> None:
        """Compare the code of new workers with ours, in words that need none: a task would end one without it."""
        if not workers:
            return
        try:
            answers = self._client.run(eval, _CODE_THERE, workers=sorted(workers), on_error="return")
        except BROKEN:  # one went just now: asked again
            return
        for worker, code in answers.items():
            if isinstance(code, ImportError | AttributeError):
                raise other_code(code)
            if isinstance(code, str):
                check_code(code)
                self._checked.add(worker)

    def _note(self, words: str) -> None:
        if words not in self._noted:
            self._noted.add(words)
            self._notify(words)


def check_code(code: str) -> None:
    """Raise `CampaignError` if that is not the sum over our code."""
    if code != code_sum():
        raise CampaignError(
            "the workers have another fg-nav, Python or libraries than this: install the same versions there."
        )


def other_code(error: object) -> CampaignError:
    """Return the end of a campaign on workers with another program, or none."""
    return CampaignError(
        f"the cluster cannot run fg-nav ({describe_error(error)}): install the same version there, "
        "on the scheduler and on each worker."
    )


def is_of_other_code(error: object) -> bool:
    """Whether a task could not be read, by a worker or by the scheduler."""
    return isinstance(error, ImportError | AttributeError) or "deserializ" in str(error)
