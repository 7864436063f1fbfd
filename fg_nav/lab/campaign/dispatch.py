"""Run tasks on a Dask cluster and hand over their outcomes; Dask schedules, balances, and repeats what a worker lost.

============================ ========================================================================================
a worker dies                Dask runs its task on another; a local cluster starts a new worker
a task ends worker after     Dask gives it up; its results are then made one by one, when nothing else runs, and one
worker                       that again ends worker after worker is a result that failed
a worker cannot start a task it is reported and avoided for `REST_S`, the task goes to another; after `TROUBLES` of them
(its disk is full)           the campaign stops
a worker is paused, which    it is reported; Dask gives it nothing until it goes on
Dask does to spare memory
the scheduler is gone        what has not come back is sent again when it is there again, for `patience_s`
there is no worker           it is reported, and waited for as long
scheduler or workers have    the campaign stops: what they would bring is of another program
other code, or none
Ctrl-C                       the campaign stops before the next outcome, within a second or two; a second Ctrl-C
                             interrupts at once
============================ ========================================================================================

An outcome that comes twice is the same files again.
"""

from __future__ import annotations

import signal
import warnings
from collections import Counter, deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import CancelledError
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from queue import Empty, Queue
from threading import Event
from time import monotonic
from typing import Any, TypeAlias

from fg_nav.errors import CampaignError
from fg_nav.lab.campaign.cluster import (
    BROKEN,
    LOOK_S,
    Client,
    Cluster,
    LostError,
    Notify,
    Workers,
    check_code,
    check_stop,
    connect,
    disconnect,
    is_of_other_code,
    other_code,
)
from fg_nav.lab.campaign.execute import Task, TaskResults, WorkerError, describe_error
from fg_nav.lab.campaign.walks import pack
from fg_nav.lab.store.code import code_sum
from fg_nav.lab.store.results import Key, Result
from fg_nav.system.processes import catch_signals

KILLED = "it ended its worker, again and again: out of memory, or a crash"
"""Why there is nothing of a result that ended too many workers."""

TROUBLES = 3  # Times that workers may be unable to start a task.
FETCH_S = 120.0  # For one outcome to come from its worker.
AHEAD = 2  # Tasks sent for each worker: one that runs, and one that waits.

Take: TypeAlias = Callable[[Task, TaskResults], None]
"""Takes each outcome."""

Show: TypeAlias = Callable[[int], None]
"""Shows how far it is, with so many workers."""


def dispatch(
    tasks: Sequence[Task], cluster: Cluster, take: Take, notify: Notify, show: Show = lambda workers: None
) -> None:
    """Run all tasks, and hand each outcome to `take`.

    Raises
    ------
    CampaignError
        If scheduler or workers are gone for longer than the cluster's patience, or have other code.
    KeyboardInterrupt
        After Ctrl-C.
    """
    queue = TaskQueue(tasks)
    with catch_signals(signal.SIGINT) as stop:
        with cluster.start(tasks) as address:
            begin = partial(Dispatcher, cluster=cluster, queue=queue, take=take, notify=notify, show=show)
            _run_at(address, cluster, notify, stop, begin)
        check_stop(stop)


def _run_at(address: str, cluster: Cluster, notify: Notify, stop: Event, begin: Callable[[Client], Dispatcher]) -> None:
    """Let dispatchers work at this scheduler, one after the other while it is lost and found again."""
    client = connect(address, stop)
    if client is None:
        raise CampaignError(
            f"no Dask scheduler answers at {address}: start one with `dask scheduler`, or leave --scheduler out."
        )
    while client is not None:
        try:
            begin(client).run(stop)
            return
        except LostError:
            notify(f"the scheduler at {address} is gone: trying again for {cluster.patience_s:.0f} s")
        finally:
            disconnect(client)
        client = connect(address, stop, cluster.patience_s)
    raise CampaignError(
        f"the scheduler at {address} has been gone for {cluster.patience_s:.0f} s: "
        "what is done is stored, and the same command goes on from there."
    )


class TaskQueue:
    """Tasks to be sent: walks, and after all of them the single results of walks that ended their workers."""

    def __init__(self, tasks: Iterable[Task]) -> None:
        self.walks = deque(tasks)
        self.suspects: deque[Task] = deque()

    def __bool__(self) -> bool:
        return bool(self.walks or self.suspects)

    def next(self, running: int, workers: int) -> Task | None:
        """Take out the task to be sent while so many run; None if there is none now."""
        if 0 < len(self.walks) + running < workers:  # each walk is shared by several workers
            self.walks = deque(one for task in self.walks for one in task.split())
        if self.walks:
            return self.walks.popleft() if running < AHEAD * workers else None
        return self.suspects.popleft() if self.suspects and not running and workers else None

    def put_back(self, task: Task) -> None:
        """Send a task again, before the others."""
        self.walks.appendleft(task)


@dataclass(frozen=True)
class _Sent:
    """A task that was sent, and whether no other was: what ends its worker then is this one."""

    task: Task
    alone: bool


class Dispatcher:
    """Sends tasks over one connection to a scheduler, until all are done or the connection is lost."""

    def __init__(
        self, client: Client, cluster: Cluster, queue: TaskQueue, take: Take, notify: Notify, show: Show
    ) -> None:
        self._client, self._cluster, self._queue = client, cluster, queue
        self._take, self._notify, self._show = take, notify, show
        self._sent: dict[Any, _Sent] = {}
        self._done: Queue[Any] = Queue()
        self._troubles: Counter[Key] = Counter()
        self._workers = Workers(client, cluster, notify)

    def run(self, stop: Event) -> None:
        """Run the queue until it is empty or `stop` is set; what has not come back is put back."""
        try:
            while self._queue or self._sent:
                check_stop(stop)
                self._workers.look(idle=not self._sent)
                while task := self._queue.next(len(self._sent), len(self._workers.able)):
                    self._send(task)
                self._show(len(self._workers.able))
                with suppress(Empty):
                    self._receive(self._done.get(timeout=LOOK_S))
                    while True:
                        check_stop(stop)
                        self._receive(self._done.get_nowait())
            check_stop(stop)
            self._show(len(self._workers.able))
        finally:
            for sent in self._sent.values():
                self._queue.put_back(sent.task)

    def _send(self, task: Task) -> None:
        alone = not self._queue.walks and not self._sent and len(task.keys) == 1
        packed = replace(task, source=pack(task.source)) if self._cluster.remote else task
        avoided = self._workers.avoided()
        others = {"workers": sorted(self._workers.able - avoided), "allow_other_workers": True} if avoided else {}
        try:
            with warnings.catch_warnings():
                warnings.filterwarnings("ignore", message="Sending large graph")  # the files of a recorded walk
                future = self._client.submit(self._cluster.work, packed, pure=False, **others)
        except BROKEN as error:
            self._queue.put_back(task)
            raise LostError from error
        self._sent[future] = _Sent(task, alone)
        future.add_done_callback(self._done.put)

    def _receive(self, future: Any) -> None:
        """Take an outcome, or put the task back."""
        from distributed.scheduler import KilledWorker

        sent = self._sent.pop(future)
        try:
            outcome = future.exception(timeout=FETCH_S) if future.status == "error" else future.result(timeout=FETCH_S)
        except (OSError, CancelledError):  # cancelled with the connection, or its worker died with the outcome
            self._queue.put_back(sent.task)
            return
        except Exception as error:  # it was lost and made again, and then this
            outcome = error
        if isinstance(outcome, KilledWorker):
            self._give_up(sent)
        elif isinstance(outcome, TaskResults):
            check_code(outcome.code)
            self._take(sent.task, outcome)
        else:
            self._try_elsewhere(sent.task, outcome)

    def _give_up(self, sent: _Sent) -> None:
        """Make the results of a task that ended its workers one by one; one that was alone then has failed."""
        if not sent.alone:
            self._queue.suspects.extend(sent.task.split())
            return
        [key] = sent.task.keys
        settings = sent.task.missing[key.magnetometer][key.method]
        self._take(sent.task, TaskResults((Result(key, settings, code_sum(), KILLED),), code_sum(), 0.0))

    def _try_elsewhere(self, task: Task, error: BaseException) -> None:
        """Avoid the worker that could not start a task; too often in trouble end the campaign."""
        if is_of_other_code(error):
            raise other_code(error)
        worker, reason = error.args if isinstance(error, WorkerError) else ("that had it", describe_error(error))
        self._troubles[task.keys[0]] += 1
        if self._troubles[task.keys[0]] >= TROUBLES:
            raise CampaignError(
                f"the worker {worker} cannot work ({reason}), nor could those tried before it: "
                "see to them, and the same command goes on from there."
            )
        self._workers.avoid(worker, reason)
        self._queue.put_back(task)


LATE = 0.1  # Share of the remaining time that is shown at least, while an outcome is late.


@dataclass(frozen=True)
class Progress:
    """Results that are there, and in all; seconds left, None if nothing is known yet; workers."""

    done: int
    total: int
    left_s: float | None
    workers: int


class RemainingTime:
    """Time left: a result takes as long as those of its group did on the mean, and of a new group as all did.

    It is the sum over all missing results over the workers, and no less than that of the longest walk.
    """

    def __init__(self, stored: int, tasks: Iterable[Task]) -> None:
        """Start with so many results stored, and these tasks missing."""
        self._missing = Counter(_walk(key) for task in tasks for key in task.keys)
        self._total = stored + self._missing.total()
        self._seconds: Counter[str] = Counter()
        self._results: Counter[str] = Counter()
        self._last = monotonic()

    def count(self, keys: Sequence[Key], seconds: float) -> None:
        """Count results, and what they took together; zero if that is not known."""
        self._missing.subtract(_walk(key) for key in keys)
        self._last = monotonic()
        for group in (keys[0].group, "") if seconds else ():
            self._seconds[group] += seconds  # type: ignore[assignment]
            self._results[group] += len(keys)

    def progress(self, workers: int) -> Progress:
        """Return how far it is, with so many workers."""
        missing = self._missing.total()
        return Progress(self._total - missing, self._total, self._left_s(max(workers, 1)), workers)

    def _left_s(self, workers: int) -> float | None:
        if not self._results:
            return None
        walks = [count * self._mean_s(group) for (group, *_), count in self._missing.items() if count]
        if not walks:
            return 0.0
        left = max(sum(walks) / min(workers, len(walks)), max(walks))
        return max(left - (monotonic() - self._last), LATE * left)

    def _mean_s(self, group: str) -> float:
        known = group if group in self._results else ""
        return self._seconds[known] / self._results[known]


def _walk(key: Key) -> tuple[str, str, str]:
    return key.group, key.field, key.walk
