"""Work on Dask: workers and schedulers that go, tasks that kill, and that nothing is lost or made twice."""

import socket
import subprocess
import sys
import time
from collections import Counter
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from distributed.scheduler import KilledWorker

from fg_nav.errors import CampaignError
from fg_nav.lab.campaign import crew, session
from fg_nav.lab.campaign.cluster import DEATHS, Cluster, check_address, check_installed
from fg_nav.lab.campaign.kept import code_sum
from fg_nav.lab.campaign.parcel import Brought
from fg_nav.lab.campaign.session import on_cluster
from tests.lab.campaign import fakes


class Taken:
    """Counts what comes."""

    def __init__(self):
        self.cells = Counter()
        self.failed = {}
        self.told = []

    def take(self, job, brought, workers):
        assert workers >= 0
        for result in brought.results:
            self.cells[result.key] += 1
            if result.failed:
                self.failed[result.key.group] = result.failed

    def once(self, jobs):
        """Whether every cell came, and once."""
        return self.cells == Counter(key for job in jobs for key in job.keys)


def test_workers_that_die_are_replaced_and_a_task_that_kills_them_is_a_result(tmp_path):
    check_installed()
    jobs = [fakes.job("deadly", "1")]
    jobs += [fakes.job("deadly once", str(tmp_path / "died"))]
    jobs += [fakes.job("quick", str(walk), "iez", "qsf") for walk in range(6)]
    taken = Taken()
    on_cluster(jobs, Cluster(None, 2, 60.0, fakes.work), taken.take, taken.told.append)
    assert (tmp_path / "died").exists()
    assert taken.once(jobs)
    assert taken.failed == {"deadly": "it ended its worker, again and again: out of memory, or a crash"}


class Task:
    """Stands in for a future."""

    def __init__(self, status, value):
        self.status, self.value = status, value

    def add_done_callback(self, call):
        if self.status != "pending":
            call(self)

    def cancel(self):
        self.status = "cancelled"

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
        self.sent = []

    def nthreads(self):
        return dict.fromkeys(self.workers, self.threads)

    def scheduler_info(self, n_workers):
        assert n_workers == -1
        return {"workers": {one: {"status": "paused" if one in self.paused else "running"} for one in self.workers}}

    def run(self, function, words, workers, on_error):
        return dict.fromkeys(workers, self.code)

    def submit(self, work, sent, pure, workers):
        assert not pure
        [worker] = workers
        assert worker in self.workers
        self.sent.append((worker, sent))
        if self.good == 0:
            self.status = "connecting"
            return Task("pending", None)
        self.good -= 1
        return self.ended(worker, work, sent)

    def ended(self, worker, work, sent):
        """What comes of a task."""
        return Task("error", self.value) if self.value is not None else Task("finished", work(sent))

    def close(self, timeout):
        self.status = "closed"


@pytest.fixture
def connections(monkeypatch):
    """Clients that are handed out one after the other, and then none."""
    some = []
    monkeypatch.setattr(session, "_connected", lambda _: some.pop(0) if some else None)
    for module in (session, crew):
        monkeypatch.setattr(module, "LOOK_S", 0.01)
    return some


def far(patience_s=0.05, work=fakes.work):
    return Cluster("tcp://somewhere:1", 1, patience_s, work)


def test_a_scheduler_that_goes_gets_again_what_did_not_come_back(connections):
    connections += [Scheduler(good=2), Scheduler(good=0), Scheduler()]
    jobs = [fakes.job("quick", str(walk)) for walk in range(6)]
    taken = Taken()
    on_cluster(jobs, far(), taken.take, taken.told.append)
    assert taken.once(jobs)
    assert len(taken.told) == 2
    assert not connections


def test_one_that_stays_away_ends_the_campaign_with_what_to_do(connections):
    connections += [Scheduler(good=2)]
    taken = Taken()
    with pytest.raises(CampaignError, match="the same command goes on"):
        on_cluster([fakes.job("quick", str(walk)) for walk in range(6)], far(), taken.take, taken.told.append)
    assert sum(taken.cells.values()) == 2
    with pytest.raises(CampaignError, match="no Dask scheduler answers at tcp://somewhere:1"):
        on_cluster([fakes.job("quick", "1")], far(), taken.take, taken.told.append)


def test_a_cluster_without_workers_is_waited_for_so_long(connections):
    connections += [Scheduler(workers=())]
    taken = Taken()
    with pytest.raises(CampaignError, match="has had no workers"):
        on_cluster([fakes.job("quick", "1")], far(), taken.take, taken.told.append)
    assert taken.told == ["the cluster has no workers: waiting for some"]


def test_a_scheduler_that_counts_deaths_itself_is_believed(connections):
    connections += [Scheduler(value=KilledWorker("task", None, 3))]
    jobs = [fakes.job("deadly", "1", "iez", "qsf")]
    taken = Taken()
    on_cluster(jobs, far(), taken.take, taken.told.append)
    assert taken.once(jobs)
    assert "ended its worker" in taken.failed["deadly"]


@pytest.mark.parametrize(
    ("value", "work", "words"),
    [
        (ModuleNotFoundError("No module named 'fg_nav'"), fakes.work, "cannot run fg-nav"),
        (RuntimeError("Error during deserialization. This\noccurs"), fakes.work, r"deserialization\): install"),
        (None, lambda sent: Brought(fakes.results(sent.job), "other", 0.0), "another fg-nav"),
    ],
    ids=["none", "not at the scheduler", "another"],
)
def test_workers_must_have_the_same_program(connections, value, work, words):
    connections += [Scheduler(value=value)]
    with pytest.raises(CampaignError, match=words):
        on_cluster([fakes.job("quick", "1")], far(work=work), Taken().take, print)


def test_workers_are_asked_for_their_code_before_they_get_work(connections):
    for code, words in (("other", "another fg-nav"), (ModuleNotFoundError("no"), "cannot run fg-nav")):
        connections += [Scheduler(good=0, code=code)]
        with pytest.raises(CampaignError, match=words):
            on_cluster([fakes.job("quick", "1")], far(), Taken().take, print)


class Lost(Task):
    """A task that failed, and whose error went with its worker."""

    def exception(self, timeout):
        raise TimeoutError


def test_an_error_that_cannot_be_fetched_is_no_end_of_the_campaign(connections, monkeypatch):
    client, taken, lost = Scheduler(), Taken(), [Lost("error", None)]
    well = client.submit
    monkeypatch.setattr(client, "submit", lambda *some, **more: lost.pop() if lost else well(*some, **more))
    connections += [client]
    on_cluster([fakes.job("quick", "1")], far(), taken.take, taken.told.append)
    assert taken.once([fakes.job("quick", "1")])


class Mortal(Scheduler):
    """Its worker `two` dies of what it is sent, the first two times, and comes again as another."""

    def ended(self, worker, work, sent):
        if worker in ("two", "two+"):
            self.workers[self.workers.index(worker)] = f"{worker}+"
            return Task("pending", None)
        return super().ended(worker, work, sent)


def test_a_cell_whose_worker_dies_goes_to_another(connections):
    client, taken = Mortal(), Taken()
    connections += [client]
    jobs = [fakes.job("quick", str(walk), "iez", "qsf") for walk in range(6)]
    on_cluster(jobs, far(), taken.take, taken.told.append)
    assert taken.once(jobs)
    assert not taken.failed
    assert len(client.sent) == 12 + 2


def test_a_cell_that_ends_every_worker_is_a_result_and_the_others_are_made(connections):
    class Killing(Scheduler):
        def ended(self, worker, work, sent):
            if sent.job.group == "deadly":
                self.workers[self.workers.index(worker)] = f"{worker}+"
                return Task("pending", None)
            return super().ended(worker, work, sent)

    client, taken = Killing(), Taken()
    connections += [client]
    jobs = [fakes.job("deadly", "1"), *(fakes.job("quick", str(walk)) for walk in range(6))]
    on_cluster(jobs, far(), taken.take, taken.told.append)
    assert taken.once(jobs)
    assert list(taken.failed) == ["deadly"]
    assert sum(sent.job.group == "deadly" for _, sent in client.sent) == DEATHS


def test_no_worker_has_two_cells_and_one_with_threads_is_told_of(connections):
    client, taken, most = Scheduler(threads=4), Taken(), []
    client.ended = lambda worker, work, sent: Task("pending", None)
    connections += [client]

    def look(workers, at):
        most.append((workers, len(at)))
        if len(most) == 5:
            client.status = "gone"

    with pytest.raises(CampaignError, match="has been gone"):
        on_cluster([fakes.job("quick", "1", "iez", "qsf", "ma2018")], far(), taken.take, taken.told.append, look)
    assert max(most) == (2, 2)
    assert sum("--nthreads 1" in words for words in taken.told) == 1


def test_a_paused_worker_is_told_of_and_given_nothing(connections):
    client, taken = Scheduler(), Taken()
    client.paused = {"two"}
    connections += [client]
    on_cluster([fakes.job("quick", str(walk)) for walk in range(4)], far(), taken.take, taken.told.append)
    assert {worker for worker, _ in client.sent} == {"one"}
    assert [words for words in taken.told if "paused" in words] == taken.told
    assert len(taken.told) == 1


def test_a_cluster_of_paused_workers_is_waited_for_so_long(connections):
    client, taken = Scheduler(), Taken()
    client.paused = {"one", "two"}
    connections += [client]
    with pytest.raises(CampaignError, match="has had no workers but paused ones"):
        on_cluster([fakes.job("quick", "1")], far(), taken.take, taken.told.append)


class FullDisk(Scheduler):
    """Where some workers can make no folder."""

    def __init__(self, *full, **more):
        super().__init__(**more)
        self.full = full

    def ended(self, worker, work, sent):
        return Task("error", OSError(28, "No space left")) if worker in self.full else super().ended(worker, work, sent)


def test_what_a_worker_cannot_do_another_does(connections):
    client, taken = FullDisk("two"), Taken()
    connections += [client]
    jobs = [fakes.job("quick", str(walk)) for walk in range(6)]
    on_cluster(jobs, far(), taken.take, taken.told.append)
    assert taken.once(jobs)
    assert not taken.failed
    assert taken.told == [
        "the worker two cannot work (OSError: [Errno 28] No space left): what it was at goes to another"
    ]
    assert sum(worker == "two" for worker, _ in client.sent) == 1


def test_where_no_worker_can_the_campaign_ends_and_names_it(connections, monkeypatch):
    monkeypatch.setattr(crew, "REST_S", 0.01)
    connections += [FullDisk("one", workers=("one",))]
    with pytest.raises(CampaignError, match=r"worker one cannot work \(OSError: \[Errno 28\] No space left\)"):
        on_cluster([fakes.job("quick", "1")], far(), Taken().take, print)


class Killed(Task):
    """A task that was done, whose worker went with the result, and whose next workers went too."""

    def result(self, timeout):
        raise KilledWorker("task", None, 3)


def test_a_result_that_is_lost_and_then_kills_is_one_that_failed(connections):
    client, taken = Scheduler(), Taken()
    client.ended = lambda worker, work, sent: Killed("finished", None)
    connections += [client]
    on_cluster([fakes.job("quick", "1")], far(), taken.take, taken.told.append)
    assert "ended its worker" in taken.failed["quick"]


def test_a_worker_that_does_not_hold_the_walk_is_sent_its_files(connections, tmp_path):
    (tmp_path / "walk.csv").write_text("x\n")
    job = replace(fakes.job("walks", "walk.csv", "iez", "qsf", "ma2018"), path=tmp_path / "walk.csv")
    came = iter([True, False, True, True])

    def work(sent):
        return Brought(fakes.results(sent.job) if next(came) else (), code_sum(), 0.0)

    client, taken = Scheduler(workers=("one",)), Taken()
    connections += [client]
    on_cluster([job], far(work=work), taken.take, taken.told.append)
    assert taken.once([job])
    assert [bool(sent.files) for _, sent in client.sent] == [True, False, True, False]


def test_no_more_processes_are_started_than_there_are_cells():
    assert Cluster(None, 64).workers_for([fakes.job("quick", "1", "iez", "qsf")]) == 2
    assert Cluster(None, 2).workers_for([fakes.job("quick", "1", "iez", "qsf", "ma2018")]) == 2


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
            on_cluster([fakes.job("quick", "1")], Cluster(address, 1, 60.0, fakes.work), taken.take, print)
    assert not taken.cells
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


def test_a_real_scheduler_started_anew_goes_on():
    """Its worker goes with it, as Dask's do, and another comes with the new one."""
    port, address, scheduler, worker = commands()
    jobs = [fakes.job("quick", str(walk)) for walk in range(30)]
    taken, running = Taken(), []
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv("PYTHONPATH", str(Path(__file__).parents[3]))

        def start():
            running.extend(started.enter_context(dask(*words)) for words in (scheduler, worker))

        def take(job, brought, workers):
            taken.take(job, brought, workers)
            if sum(taken.cells.values()) == 5:
                for process in running:
                    process.kill()
                    process.wait()
                start()

        with ExitStack() as started:
            start()
            until_it_answers(port)
            on_cluster(jobs, Cluster(address, 1, 60.0, fakes.work), take, taken.told.append)
    assert taken.once(jobs)
    assert len(running) == 4
    assert any("is gone" in words for words in taken.told)


def test_a_deadly_cell_on_a_real_worker_with_threads_takes_no_other_with_it(monkeypatch):
    port, address, scheduler, worker = commands()
    jobs = [fakes.job("deadly", "1"), *(fakes.job("slow", str(walk)) for walk in range(3))]
    taken = Taken()
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[3]))
    monkeypatch.setattr(session, "DEATHS", 2)
    with dask(*scheduler), dask(*worker[:2], "--nthreads", "4"):
        until_it_answers(port)
        on_cluster(jobs, Cluster(address, 1, 60.0, fakes.work), taken.take, taken.told.append)
    assert taken.once(jobs)
    assert list(taken.failed) == ["deadly"]


def until_it_answers(port):
    end = time.monotonic() + 60.0
    while time.monotonic() < end:
        with socket.socket() as one:
            if one.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.1)
