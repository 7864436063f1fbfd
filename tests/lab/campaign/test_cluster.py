"""Tasks on Dask: workers that die, schedulers that go, workers of other code; nothing is lost or stored twice."""

import os
import re
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import dask
import pytest

from fg_nav.errors import CampaignError
from fg_nav.lab.campaign import cluster
from fg_nav.lab.campaign.cluster import KILLED, choose_cluster, run_on_dask, wait_for_workers
from fg_nav.lab.campaign.walks import Recorded
from tests.lab.campaign import fakes


def test_a_dead_worker_is_replaced_and_only_the_result_that_kills_has_failed_so(tmp_path):
    """Here Dask gives up what ended one worker; then its results are made one by one."""
    choose_cluster(None, 1, print)  # loads Dask's own settings, before they are changed
    tasks = [
        fakes.task("deadly", fakes.Deadly("raw"), ("loop", "raw")),
        fakes.task("once", fakes.Deadly("raw", tmp_path / "died"), ("loop", "raw")),
        *(fakes.task(f"quick {k}") for k in range(4)),
    ]
    with dask.config.set({"distributed.scheduler.allowed-failures": 0}):
        made = [result for results in run_on_dask(tasks, None, 2, print) for result in results]
    assert (tmp_path / "died").exists()
    assert sorted(one.key for one in made) == sorted(key for task in tasks for key in task.settings)
    failed = {(one.key.group, one.key.magnetometer): one.failed for one in made}
    assert failed.pop(("deadly", "raw")) == KILLED
    assert set(failed.values()) == {"quick"}


@contextmanager
def started(*words):
    """A process of Dask's own command line, with the first line that it prints with an address."""
    line = [sys.executable, "-m", *words, "--no-dashboard"]
    places = os.environ.get("PYTHONPATH", ""), str(Path(__file__).parents[3])  # the walks of these tests are sent to it
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, places))}
    process = subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=paths)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def test_files_go_to_the_users_workers_of_the_same_code_and_a_lost_scheduler_ends_it(tmp_path, monkeypatch):
    (tmp_path / "walk.csv").write_text("time_s\n1\n")
    with started("distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0") as scheduler:
        address = next(found[0] for line in scheduler.stderr if (found := re.search(r"tcp://127.0.0.1:\d+", line)))
        with started("distributed.cli.dask_worker", address, "--nthreads", "1", "--no-nanny"):
            notes = []
            [[result]] = run_on_dask([fakes.task("walks", Recorded(tmp_path / "walk.csv"))], address, 1, notes.append)
            assert result.failed.startswith("walk.csv")
            assert set(notes) <= {"the cluster has no workers: waiting for some"}
            # Workers must have the same program.
            with monkeypatch.context() as patch:
                patch.setattr(cluster, "code_sum", lambda: "other")
                with pytest.raises(CampaignError, match=r"cannot run this fg-nav .*another version.*install the same"):
                    list(run_on_dask([fakes.task("quick")], address, 1, print))
            with pytest.raises(CampaignError, match=r"cannot run this fg-nav .*deserializ.*install the same"):
                list(run_on_dask([fakes.task("unknown", fakes.Unknown())], address, 1, print))
            # The scheduler is gone with a walk at work.
            running = run_on_dask([fakes.task("quick"), fakes.task("endless", fakes.Endless())], address, 1, print)
            assert [one.key.group for one in next(running)] == ["quick"]
            scheduler.kill()
            with pytest.raises(CampaignError, match=r"the scheduler is gone: .* the same command goes on from there"):
                next(running)
    monkeypatch.setattr(cluster, "CONNECT_S", 0.5)
    with pytest.raises(CampaignError, match=f"no Dask scheduler answers at {address}: start one"):
        list(run_on_dask([fakes.task("quick")], address, 1, print))


def test_a_cluster_without_workers_is_waited_for_so_long():
    def late(n_workers, timeout):
        raise TimeoutError

    client = SimpleNamespace(scheduler_info=lambda n_workers: {"workers": {}}, wait_for_workers=late)
    notes = []
    with pytest.raises(CampaignError, match="has had no workers for 300 s: start some"):
        wait_for_workers(client, notes.append)
    assert notes == ["the cluster has no workers: waiting for some"]


def test_what_is_no_address_is_refused_before_anything_is_tried():
    for address in ("tcp://10.0.0.1:1", "tcp://[::1]:8786", "tcp://some-node.example:8786"):
        choose_cluster(address, None, print)
    for address in ("nonsense", "localhost:8786", "tcp://host", "tcp://host:99999", "ws://a:1"):
        with pytest.raises(CampaignError, match="is no address of a Dask scheduler"):
            choose_cluster(address, None, print)
    with pytest.raises(CampaignError, match="no certificates"):
        choose_cluster("tls://localhost:8786", None, print)
