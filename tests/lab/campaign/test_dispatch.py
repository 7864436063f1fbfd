"""Work on Dask: workers and schedulers that go, tasks that kill, and that nothing is lost or stored twice."""

import socket
import subprocess
import sys
import time
from collections import Counter
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from distributed.scheduler import KilledWorker

from fg_nav.errors import CampaignError
from fg_nav.lab.campaign import cluster as module
from fg_nav.lab.campaign import dispatch as loop
from fg_nav.lab.campaign.cluster import Cluster, check_address, check_installed
from fg_nav.lab.campaign.dispatch import TaskQueue, dispatch
from fg_nav.lab.campaign.execute import TaskResults, WorkerError
from fg_nav.lab.campaign.walks import Recorded
from fg_nav.lab.store.code import code_sum
from tests.lab.campaign import fakes

KILLED = "it ended its worker, again and again: out of memory, or a crash"


class Taken:
    """Counts what comes."""

    def __init__(self):
        self.results = Counter()
        self.failed = {}
        self.notes = []

    def take(self, task, made):
        assert {result.key for result in made.results} == set(task.keys)
        for result in made.results:
            self.results[result.key] += 1
            if result.failed:
                self.failed[result.key.group, result.key.method] = result.failed

    def once(self, tasks):
        """Whether every result came, and once."""
        return self.results == Counter(key for task in tasks for key in task.keys)


def test_workers_that_die_are_replaced_and_only_the_result_that_kills_them_has_failed(tmp_path, monkeypatch):
    """One worker, and two deaths: Dask repeats what ended one, and gives up what ended another."""
    check_installed()
    monkeypatch.setitem(module._LOCAL, "distributed.scheduler.allowed-failures", 1)
    work = partial(fakes.work, code=code_sum())
    tasks = [fakes.task("walk", "1", "iez", "deadly")]
    tasks += [fakes.task("deadly once", str(tmp_path / "died"))]
    tasks += [fakes.task("quick", str(walk), "iez", "qsf") for walk in range(6)]
    taken = Taken()
    dispatch(tasks, Cluster(None, 1, 60.0, work), taken.take, taken.notes.append)
    assert (tmp_path / "died").exists()
    assert taken.once(tasks)
    assert taken.failed == {("walk", "deadly"): KILLED}


class Future:
    """Stands in for Dask's."""

    def __init__(self, status, value):
        self.status, self.value = status, value

    def add_done_callback(self, call):
        if self.status != "pending":
            call(self)

    def result(self, timeout):
        return self.value

    def exception(self, timeout):
        return self.value


class Scheduler:
    """Stands in for a client: answers `good` tasks, then is gone; `value` says what a task comes to."""

    def __init__(self, good=1000, workers=("one", "two"), value=None, code=None, threads=1):
        self.good, self.workers, self.value, self.threads, self.status = good, list(workers), value, threads, "running"
        self.code = code or code_sum()
        self.paused = set()
        self.sent, self.preferred = [], []

    def scheduler_info(self, n_workers):
        assert n_workers == -1
        return {
            "workers": {
                one: {"status": "paused" if one in self.paused else "running", "nthreads": self.threads}
                for one in self.workers
            }
        }

    def run(self, function, words, workers, on_error):
        return dict.fromkeys(workers, self.code)

    def submit(self, work, task, pure, workers=None, allow_other_workers=None):
        assert not pure
        assert allow_other_workers or workers is None
        self.sent.append(task)
        self.preferred.append(workers)
        if self.good == 0:
            self.status = "connecting"
            return Future("pending", None)
        self.good -= 1
        return self.ended(work, task)

    def ended(self, work, task):
        """What comes of a task."""
        return Future("error", self.value) if self.value is not None else Future("finished", work(task))

    def close(self, timeout):
        self.status = "closed"


@pytest.fixture
def connections(monkeypatch):
    """Clients that are handed out one after the other, and then none."""
    some = []
    monkeypatch.setattr(loop, "connect", lambda *_: some.pop(0) if some else None)
    for one in (loop, module):
        monkeypatch.setattr(one, "LOOK_S", 0.01)
    return some


def remote(patience_s=0.05, work=fakes.work):
    return Cluster("tcp://somewhere:1", 1, patience_s, work)


def test_a_scheduler_that_goes_gets_again_what_did_not_come_back(connections):
    connections += [Scheduler(good=2), Scheduler(good=0), Scheduler()]
    tasks = [fakes.task("quick", str(walk)) for walk in range(6)]
    taken = Taken()
    dispatch(tasks, remote(), taken.take, taken.notes.append)
    assert taken.once(tasks)
    assert len(taken.notes) == 2
    assert not connections


def test_one_that_stays_away_ends_the_campaign_with_what_to_do(connections):
    connections += [Scheduler(good=2)]
    taken = Taken()
    with pytest.raises(CampaignError, match="the same command goes on"):
        dispatch([fakes.task("quick", str(walk)) for walk in range(6)], remote(), taken.take, taken.notes.append)
    assert sum(taken.results.values()) == 2
    with pytest.raises(CampaignError, match="no Dask scheduler answers at tcp://somewhere:1"):
        dispatch([fakes.task("quick", "1")], remote(), taken.take, taken.notes.append)


def test_a_cluster_without_workers_is_waited_for_so_long(connections):
    connections += [Scheduler(workers=())]
    taken = Taken()
    with pytest.raises(CampaignError, match="has had no workers"):
        dispatch([fakes.task("quick", "1")], remote(), taken.take, taken.notes.append)
    assert taken.notes == ["the cluster has no workers: waiting for some"]


class Deserted(Scheduler):
    """Where all workers end with the first task."""

    def ended(self, work, task):
        self.workers.clear()
        return Future("pending", None)


def test_so_is_one_whose_workers_are_gone_with_what_they_were_given(connections):
    connections += [Deserted()]
    taken = Taken()
    with pytest.raises(CampaignError, match="has had no workers"):
        dispatch([fakes.task("quick", "1")], remote(), taken.take, taken.notes.append)
    assert taken.notes == ["the cluster has no workers: waiting for some"]


def test_what_dask_gives_up_is_made_one_by_one_when_nothing_else_runs(connections):
    """The scheduler blames all that a dead worker had: only what is alone again is the culprit."""

    class Killing(Scheduler):
        def ended(self, work, task):
            innocent = task.group == "quick" and task.walk == "0" and len(task.keys) == 2
            if innocent or any(key.method == "deadly" for key in task.keys):
                return Future("error", KilledWorker("task", None, 3))
            return super().ended(work, task)

    client, taken = Killing(), Taken()
    connections += [client]
    tasks = [fakes.task("walk", "1", "iez", "deadly"), *(fakes.task("quick", str(k), "iez", "qsf") for k in range(6))]
    dispatch(tasks, remote(), taken.take, taken.notes.append)
    assert taken.once(tasks)
    assert taken.failed == {("walk", "deadly"): KILLED}
    assert [len(one.keys) for one in client.sent] == [2] * 7 + [1] * 4


def test_a_task_that_was_not_alone_is_tried_again_before_it_is_blamed(connections):
    client, taken = Scheduler(), Taken()
    kills = iter([True, True])
    client.ended = lambda work, task: (
        Future("error", KilledWorker("task", None, 3)) if next(kills, False) else Future("finished", work(task))
    )
    connections += [client]
    tasks = [fakes.task("quick", str(walk)) for walk in range(4)]
    dispatch(tasks, remote(), taken.take, taken.notes.append)
    assert taken.once(tasks)
    assert not taken.failed


@pytest.mark.parametrize(
    ("value", "work", "words"),
    [
        (ModuleNotFoundError("No module named 'fg_nav'"), fakes.work, "cannot run fg-nav"),
        (RuntimeError("Error during deserialization. This\noccurs"), fakes.work, r"deserialization\): install"),
        (None, lambda task: TaskResults(fakes.results(task), "other", 0.0), "another fg-nav"),
    ],
    ids=["none", "not at the scheduler", "another"],
)
def test_workers_must_have_the_same_program(connections, value, work, words):
    connections += [Scheduler(value=value)]
    taken = Taken()
    with pytest.raises(CampaignError, match=words):
        dispatch([fakes.task("quick", "1")], remote(work=work), taken.take, print)
    assert not taken.results


def test_workers_are_asked_for_their_code_before_they_get_work(connections):
    for code, words in (("other", "another fg-nav"), (ModuleNotFoundError("no"), "cannot run fg-nav")):
        client = Scheduler(code=code)
        connections += [client]
        with pytest.raises(CampaignError, match=words):
            dispatch([fakes.task("quick", "1")], remote(), Taken().take, print)
        assert not client.sent


class Lost(Future):
    """A task that failed, and whose error went with its worker."""

    def exception(self, timeout):
        raise TimeoutError


def test_an_error_that_cannot_be_fetched_is_no_end_of_the_campaign(connections, monkeypatch):
    client, taken, lost = Scheduler(), Taken(), [Lost("error", None)]
    well = client.submit
    monkeypatch.setattr(client, "submit", lambda *some, **more: lost.pop() if lost else well(*some, **more))
    connections += [client]
    dispatch([fakes.task("quick", "1")], remote(), taken.take, taken.notes.append)
    assert taken.once([fakes.task("quick", "1")])


def test_no_more_is_sent_than_the_workers_have_ahead_and_threads_are_reported(connections):
    client, taken, shown = Scheduler(threads=4), Taken(), []
    client.ended = lambda work, task: Future("pending", None)
    connections += [client]

    def show(workers):
        shown.append((workers, len(client.sent)))
        if len(shown) == 5:
            client.status = "gone"

    with pytest.raises(CampaignError, match="has been gone"):
        dispatch([fakes.task("quick", str(k)) for k in range(9)], remote(), taken.take, taken.notes.append, show)
    assert max(shown) == (2, 2 * loop.AHEAD)
    assert sum("--nthreads 1" in words for words in taken.notes) == 1


def test_a_paused_worker_is_reported_and_does_not_count(connections):
    client, taken, shown = Scheduler(), Taken(), []
    client.paused = {"two"}
    connections += [client]
    tasks = [fakes.task("quick", str(walk)) for walk in range(4)]
    dispatch(tasks, remote(), taken.take, taken.notes.append, shown.append)
    assert set(shown) == {1}
    assert [words for words in taken.notes if "paused" in words] == taken.notes
    assert len(taken.notes) == 1


def test_a_cluster_of_paused_workers_is_waited_for_so_long(connections):
    client, taken = Scheduler(), Taken()
    client.paused = {"one", "two"}
    connections += [client]
    with pytest.raises(CampaignError, match="has had no workers but paused ones"):
        dispatch([fakes.task("quick", "1")], remote(), taken.take, taken.notes.append)


class FullDisk(Scheduler):
    """Where some workers can make no folder; a task goes to the first worker that it may."""

    def __init__(self, *full, **more):
        super().__init__(**more)
        self.full = full

    def ended(self, work, task):
        worker = (self.preferred[-1] or self.workers)[0]
        return Future("error", WorkerError(worker, "no space")) if worker in self.full else super().ended(work, task)


def test_what_a_worker_cannot_do_another_does(connections):
    client, taken = FullDisk("one"), Taken()
    connections += [client]
    tasks = [fakes.task("quick", str(walk)) for walk in range(6)]
    dispatch(tasks, remote(), taken.take, taken.notes.append)
    assert taken.once(tasks)
    assert not taken.failed
    assert taken.notes == ["the worker one cannot work (no space): its walk goes to another"]
    assert client.preferred.count(None) == 2 * loop.AHEAD
    assert set(map(str, client.preferred)) == {"None", "['two']"}


def test_where_no_worker_can_the_campaign_ends_and_names_it(connections):
    connections += [FullDisk("one", workers=("one",))]
    with pytest.raises(CampaignError, match=r"worker one cannot work \(no space\)"):
        dispatch([fakes.task("quick", "1")], remote(), Taken().take, print)
    connections += [Scheduler(value=MemoryError("none left"))]
    with pytest.raises(CampaignError, match=r"cannot work \(MemoryError: none left\)"):
        dispatch([fakes.task("quick", "1")], remote(), Taken().take, print)


class Killed(Future):
    """A task that was done, whose worker went with the result, and whose next workers went too."""

    def result(self, timeout):
        raise KilledWorker("task", None, 3)


def test_a_result_that_is_lost_and_then_kills_is_one_that_failed(connections):
    client, taken = Scheduler(), Taken()
    client.ended = lambda work, task: Killed("finished", None)
    connections += [client]
    dispatch([fakes.task("quick", "1")], remote(), taken.take, taken.notes.append)
    assert taken.failed == {("quick", "iez"): KILLED}


def test_files_go_to_remote_workers_only(connections, tmp_path):
    (tmp_path / "walk.csv").write_text("x\n")
    task = replace(fakes.task("walks", "walk.csv", "iez", "qsf"), source=Recorded(tmp_path / "walk.csv"))
    client = Scheduler(workers=("one",))
    connections += [client]
    dispatch([task], remote(), Taken().take, print)
    assert [one.source.contents for one in client.sent] == [(("walk.csv", b"x\n"),)]


def test_a_walk_is_shared_where_there_are_fewer_walks_than_workers():
    queue = TaskQueue([fakes.task("quick", "1", "iez", "qsf", "ma2018")])
    assert queue.next(0, 0) is None
    sent = [queue.next(k, 2) for k in range(4)]
    assert [len(one.keys) for one in sent if one] == [1, 1, 1]
    queue = TaskQueue([fakes.task("quick", str(k), "iez", "qsf") for k in range(2)])
    assert [len(queue.next(k, 2).keys) for k in range(2)] == [2, 2]


def test_no_more_processes_are_started_than_there_are_results():
    assert Cluster(None, 64).workers_for([fakes.task("quick", "1", "iez", "qsf")]) == 2
    assert Cluster(None, 2).workers_for([fakes.task("quick", "1", "iez", "qsf", "ma2018")]) == 2


BARE = """
import sys
from importlib import import_module
sys.modules["fg_nav"] = None
sys.argv = sys.argv[1:]
import_module(sys.argv[0]).main()
"""
"""Runs a module as `-m` does, without our package: an editable installation is on every path."""


@contextmanager
def dask(*words, bare=False):
    """Yield a process of Dask's own command line."""
    line = [sys.executable, *(("-c", BARE) if bare else ("-m",)), *words, "--no-dashboard"]
    process = subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def commands():
    """A free port, the address there, and the commands of a scheduler and of a worker of it."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        port = one.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    scheduler = ("distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", str(port))
    return port, address, scheduler, ("distributed.cli.dask_worker", address, "--nthreads", "1", "--no-nanny")


@pytest.mark.parametrize("bare", ["scheduler", "worker"])
def test_a_real_cluster_without_the_package_ends_the_campaign_and_nothing_is_taken(monkeypatch, bare):
    check_installed()
    port, address, scheduler, worker = commands()
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[3]))
    taken = Taken()
    with dask(*scheduler, bare=bare == "scheduler"), dask(*worker, bare=bare == "worker"):
        until_it_answers(port)
        with pytest.raises(CampaignError, match="install the same version there") as refused:
            dispatch([fakes.task("quick", "1")], Cluster(address, 1, 60.0, fakes.work), taken.take, print)
    assert not taken.results
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("address", ["nonsense", "localhost:8786", "tcp://host", "tcp://host:99999", "ws://a:1"])
def test_what_is_no_address_is_refused_before_anything_is_tried(address):
    with pytest.raises(CampaignError, match="is no address of a Dask scheduler"):
        check_address(address)


def test_addresses_that_can_be():
    for address in ("tcp://localhost:8786", "tcp://10.0.0.1:1", "tcp://[::1]:8786", "tcp://some-node.example:8786"):
        check_address(address)
    with pytest.raises(CampaignError, match="no certificates"):
        check_address("tls://localhost:8786")


class RealCluster:
    """A scheduler and a worker with four threads, processes of their own, which can be ended and started anew."""

    def __init__(self, started):
        self.port, self.address, scheduler, worker = commands()
        self._commands, self._started, self.running = (scheduler, (*worker[:2], "--nthreads", "4")), started, []

    def start(self):
        self.running = [self._started.enter_context(dask(*words)) for words in self._commands]

    def start_anew(self):
        """Its worker goes with the scheduler, as Dask's do, and another comes with the new one."""
        for process in self.running:
            process.kill()
            process.wait()
        self.start()

    def dispatch(self, tasks, take, notify):
        dispatch(tasks, Cluster(self.address, 1, 60.0, fakes.work), take, notify)


@pytest.fixture(scope="module")
def real_cluster():
    """One that gives up what ended a single worker."""
    with pytest.MonkeyPatch.context() as environment, ExitStack() as started:
        environment.setenv("PYTHONPATH", str(Path(__file__).parents[3]))
        environment.setenv("DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES", "0")
        cluster = RealCluster(started)
        cluster.start()
        until_it_answers(cluster.port)
        yield cluster


def test_a_deadly_walk_on_a_real_worker_with_threads_takes_no_other_with_it(real_cluster):
    tasks = [fakes.task("deadly", "1"), *(fakes.task("slow", str(walk)) for walk in range(3))]
    taken = Taken()
    real_cluster.dispatch(tasks, taken.take, taken.notes.append)
    assert taken.once(tasks)
    assert taken.failed == {("deadly", "iez"): KILLED}


def test_a_real_scheduler_started_anew_goes_on(real_cluster):
    tasks = [fakes.task("quick", str(walk)) for walk in range(30)]
    taken, before = Taken(), real_cluster.running

    def take(task, made):
        taken.take(task, made)
        if sum(taken.results.values()) == 5:
            real_cluster.start_anew()

    real_cluster.dispatch(tasks, take, taken.notes.append)
    assert taken.once(tasks)
    assert all(process.poll() is not None for process in before)
    assert any("is gone" in words for words in taken.notes)


def until_it_answers(port):
    end = time.monotonic() + 60.0
    while time.monotonic() < end:
        with socket.socket() as one:
            if one.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.1)
