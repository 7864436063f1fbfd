"""Tasks on a Dask cluster: a local one for as long as they run, or the user's by the address of its scheduler.

Dask gives the tasks to workers, balances them, and repeats what a dead worker had. A task that ends worker after worker
is given up; its results are then made one by one, and one that is given up alone is a result that failed. Nothing is
lost with a scheduler, since each walk is stored when it is done: the campaign ends with a sentence, and goes on with
the same command.
"""

from __future__ import annotations

import logging
import re
import signal
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from functools import partial
from typing import Any, TypeAlias

from fg_nav.errors import CampaignError
from fg_nav.lab.campaign.execute import Execute, Task, run_task
from fg_nav.lab.campaign.walks import pack
from fg_nav.lab.store.code import code_sum
from fg_nav.lab.store.results import Result
from fg_nav.system.processes import catch_signals
from fg_nav.text import suggest_install

KILLED = "it ended its worker, again and again: out of memory, or a crash"  # Reason of a result that was given up.

RETRIES = 2  # Of a task that could not be started, on a disk that is full for example: mostly on another worker.
CONNECT_S = 30.0  # A busy machine takes long to answer.
PATIENCE_S = 300.0  # For the first worker: a node of a queue takes minutes.
TICK_S = 0.2  # Between two looks at what is done, and at Ctrl-C.
LAST_PORT = 65535
ADDRESS = re.compile(r"(?P<by>tcp|tls)://(\[[0-9a-fA-F:.%]+\]|[\w.-]+):(?P<port>[0-9]+)")
GOES_ON = "and the same command goes on from there"
OTHER_CODE = (
    "the workers cannot run this fg-nav ({}): install the same version there, on the scheduler and on each worker."
)

Client: TypeAlias = Any
Notify: TypeAlias = Callable[[str], None]  # Shows the user a sentence.

_LOCAL = {
    "distributed.deploy.lost-worker-timeout": f"{PATIENCE_S:.0f}s",  # a busy machine takes long to start another
    "distributed.scheduler.worker-saturation": 1.0,  # no walk waits on a worker, and is blamed for its death
    "distributed.worker.memory.target": False,  # nothing is stored there that could be put to disk
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,  # a paused worker would never be given work again
    "distributed.worker.memory.terminate": 0.95,
    # Ctrl-C goes to all processes of a terminal: the campaign ends its workers, which would print tracebacks
    "distributed.worker.preload": ["import signal\nsignal.signal(signal.SIGINT, signal.SIG_IGN)\n"],
}  # Settings of a local cluster.


def choose_cluster(scheduler: str | None, workers: int | None, notify: Notify) -> Execute:
    """Return what executes tasks on a cluster; raises `CampaignError` if it cannot be, or without Dask or Arrow."""
    try:
        import dask
        import distributed  # noqa: F401
        import pyarrow  # noqa: F401
        from distributed.security import Security
    except ImportError as error:
        words = f"campaigns need Dask and Arrow, and {error.name} is not there: {suggest_install('campaign')}."
        raise CampaignError(words) from None
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # workers that die are handled here
    dask.config.set({"logging.distributed": "critical"})
    # an address that Dask would print a traceback of its own for
    if scheduler is not None:
        if workers is not None:
            raise CampaignError("--workers is for a cluster of our own: leave it out with --scheduler.")
        found = ADDRESS.fullmatch(scheduler)
        if found is None or int(found["port"]) > LAST_PORT:
            raise CampaignError(f"'{scheduler}' is no address of a Dask scheduler: write it as tcp://host:8786.")
        if found["by"] == "tls" and Security().get_connection_args("client").get("ssl_context") is None:
            raise CampaignError(
                f"Dask has no certificates for {scheduler}: name them in its configuration, or use tcp."
            )
    return partial(run_on_dask, scheduler=scheduler, workers=workers or dask.system.CPU_COUNT, notify=notify)


def run_on_dask(
    tasks: Sequence[Task], scheduler: str | None, workers: int, notify: Notify
) -> Iterator[tuple[Result, ...]]:
    """Execute tasks on the cluster of a scheduler, or on so many local workers; yields the results of each.

    Raises `CampaignError` if scheduler or workers are gone, or cannot run a task, and `KeyboardInterrupt` after Ctrl-C,
    before the next results.
    """
    from distributed import as_completed
    from distributed.scheduler import KilledWorker

    if not tasks:
        return
    workers = min(workers, sum(len(task.settings) for task in tasks))
    with _connect(scheduler, workers) as client:
        # Wait for the user's workers, which have none of our files.
        if scheduler is not None:
            workers = wait_for_workers(client, notify)
            tasks = [replace(task, source=pack(task.source)) for task in tasks]
        # Send all walks; where there are fewer than workers, each result by itself.
        if len(tasks) < workers:
            tasks = [one for task in tasks for one in task.split()]
        sent = _send(client, tasks)
        done = as_completed(sent, loop=client.loop)
        with catch_signals(signal.SIGINT) as stop:
            while not (done.is_empty() or stop.is_set()):
                for future in done.next_batch(block=False):
                    task = sent.pop(future)
                    try:
                        results = future.result()
                    except KilledWorker:
                        if len(task.settings) > 1:
                            again = _send(client, task.split())
                            sent |= again
                            done.update(again)
                            continue
                        results = tuple(Result(key, of, code_sum(), KILLED) for key, of in task.settings.items())
                    except Exception as error:
                        lost = future.status in ("cancelled", "lost") or client.status != "running"
                        raise _explain(error, lost) from None
                    if any(result.code != code_sum() for result in results):
                        raise CampaignError(OTHER_CODE.format("another version of it, of Python or of libraries"))
                    yield results
                stop.wait(TICK_S)
            if stop.is_set():
                raise KeyboardInterrupt


@contextmanager
def _connect(scheduler: str | None, workers: int) -> Iterator[Client]:
    """Yield a client of the user's scheduler, or of a local cluster that runs as long as the block."""
    import dask
    from distributed import Client, LocalCluster

    with ExitStack() as opened:
        try:
            place: Any = scheduler
            if scheduler is None:
                opened.enter_context(dask.config.set(_LOCAL))
                looks = {"dashboard_address": "127.0.0.1:0", "silence_logs": logging.CRITICAL}
                place = LocalCluster(n_workers=workers, threads_per_worker=1, host="127.0.0.1", **looks)
                opened.enter_context(place)
            client = Client(place, timeout=CONNECT_S, set_as_default=False)
        except (OSError, RuntimeError, ValueError, ImportError) as error:
            words = f"no Dask cluster could be started here ({error}): try fewer --workers."
            if scheduler is not None:
                there = f"no Dask scheduler answers at {scheduler}"
                words = f"{there}: start one with `dask scheduler`, or leave --scheduler out."
            raise CampaignError(words) from None
        try:
            yield client
        finally:
            with suppress(Exception):  # nothing more can be done with a lost connection
                client.close(timeout=2.0)


def wait_for_workers(client: Client, notify: Notify) -> int:
    """Return how many workers there are, as soon as there is one."""
    if not client.scheduler_info(n_workers=-1)["workers"]:
        notify("the cluster has no workers: waiting for some")
    try:
        client.wait_for_workers(1, timeout=PATIENCE_S)
    except TimeoutError:
        start = "start some (`dask worker ADDRESS --nthreads 1`, one a core)"
        raise CampaignError(f"the cluster has had no workers for {PATIENCE_S:.0f} s: {start}, {GOES_ON}.") from None
    return len(client.scheduler_info(n_workers=-1)["workers"])


def _send(client: Client, tasks: Sequence[Task]) -> dict[Any, Task]:
    """Send tasks, each by its future."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Sending large graph")  # the files of recorded walks
        return dict(zip(client.map(run_task, tasks, retries=RETRIES, pure=False), tasks, strict=True))


def _explain(error: Exception, lost: bool) -> CampaignError:
    """Return what ends a campaign: a lost scheduler, other code, or a worker that cannot work."""
    if lost:
        return CampaignError(f"the scheduler is gone: what is done is stored, {GOES_ON}.")
    first, *_ = " ".join(str(error).split()).split(". ")  # Dask's errors have several lines, and links
    words = f"{type(error).__name__}: {first}"
    if isinstance(error, ImportError | AttributeError) or "deserializ" in words:
        return CampaignError(OTHER_CODE.format(words))
    return CampaignError(f"a worker cannot work ({words}): see to it, {GOES_ON}.")
