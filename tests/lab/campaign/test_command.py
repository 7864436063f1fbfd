"""A campaign as a whole: what is made, what is joined, what is made anew, and that the tables do not show how."""

import errno
import os
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import pytest
from pyarrow import parquet

from fg_nav.errors import OutputError
from fg_nav.lab.campaign import command as table
from fg_nav.lab.campaign.cluster import KILLED
from fg_nav.lab.campaign.command import RESULTS, RESULTS_FOLDER, TABLES, TIMINGS, run_campaign, write_tables
from fg_nav.lab.campaign.execute import run_task
from fg_nav.lab.store import code
from fg_nav.lab.store.results import Key, Result, write_result
from fg_nav.lab.verbs import experiments
from fg_nav.lab.verbs.experiments import print_campaign
from tests.command_line import FgNav
from tests.lab.campaign.fakes import until_gone

ROOT = Path(__file__).parents[3]
PLAN = 'scenarios = ["demo"]\nfields = ["smooth"]\nseeds = 2\nmethods = ["iez", "ma2018"]\nmagnetometers = ["raw"]\n'


@pytest.fixture
def plan(tmp_path):
    path = tmp_path / "plan.toml"
    path.write_text(PLAN)
    return path


@pytest.fixture
def made(monkeypatch):
    """Results that are made, here and without a cluster, by the command line too."""
    count = Counter()

    def execute(tasks):
        for task in tasks:
            count.update(list(task.settings))
            yield run_task(task)

    monkeypatch.setattr(experiments, "choose_cluster", lambda *_: execute)
    count.execute = execute
    return count


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The folder of the plan above, finished."""
    folder = tmp_path_factory.mktemp("finished")
    (folder / "plan.toml").write_text(PLAN)
    run_campaign(folder / "plan.toml", folder / "out", lambda tasks: map(run_task, tasks))
    return folder / "out"


@pytest.fixture
def out(finished, tmp_path):
    """A copy of it."""
    return Path(shutil.copytree(finished, tmp_path / "out"))


def run(plan, out, made, **more):
    return run_campaign(plan, out, made.execute, notify=print, **more)


def tables(folder):
    return {name: (folder / name).read_bytes() for name in TABLES if name != TIMINGS}


def rows(folder, name=RESULTS):
    return parquet.read_table(folder / name).to_pylist()


def blank(walk, failed="", code="code", group="demo"):
    return Result(Key(group, "smooth", walk, "loop", "iez"), {}, code, failed)


def test_what_is_there_is_joined_and_the_tables_are_the_same_bytes(tmp_path, plan, made, finished):
    shown = []
    found, stored = run(plan, tmp_path / "one", made, show=lambda *some: shown.append(some))
    assert (len(found), stored, sum(made.values())) == (4, 0, 4)
    assert shown == [(0, 4), (2, 4), (4, 4)]
    for half in sorted((tmp_path / "one" / RESULTS_FOLDER).iterdir())[::2]:
        half.unlink()
    again, stored = run(plan, tmp_path / "one", made)
    assert (stored, sum(made.values())) == (2, 6)
    assert tables(tmp_path / "one") == tables(finished)
    timed = rows(tmp_path / "one", TIMINGS)
    assert all(row["runtime_s"] > 0.0 and row["code"] == code.code_sum() for row in timed)
    # The tables have what the results have, in the order of their first columns.
    found = rows(tmp_path / "one")
    assert [(row["walk"], row["method"], row["alignment"]) for row in found] == [
        (walk, method, mode) for walk in ("101", "102") for method in ("iez", "ma2018") for mode in ("origin", "yaw")
    ]
    by_key = {(one.key.walk, one.key.method): one for one in again}
    for row in found:
        errors = by_key[row["walk"], row["method"]].errors[row["alignment"]]
        assert row["rmse_m"] == errors.rmse_m
        assert row["end_percent"] == pytest.approx(100.0 * row["end_m"] / row["distance_m"])
        assert 50 < row["footfalls"] < 80
        assert row["used_footfalls"] == 0 if row["method"] == "iez" else 0 < row["used_footfalls"] < row["footfalls"]
        assert row["failed"] == ""


def test_rows_are_in_the_order_of_their_first_columns():
    """Words of methods are in another order: `iez:physical` is behind `iez,...`, its preset before `tuned`."""
    words = ("iez,acc_density=2.0", "iez,acc_density=10.0", "iez:physical,acc_density=0.1", "ma2018")
    keys = [Key("demo", "smooth", walk, "raw", word) for walk in ("9", "10") for word in words]
    first = ("demo", "smooth", "10", "raw", "iez")
    assert [table.place_of(key) for key in sorted(keys, key=table.place_of)][:3] == [
        (*first, "physical", '{"acc_density": 0.1}'),
        (*first, "tuned", '{"acc_density": 10.0}'),
        (*first, "tuned", '{"acc_density": 2.0}'),
    ]


def test_runtime_does_not_change_a_byte_and_a_table_that_fails_leaves_all_as_they_were(tmp_path):
    results = [blank("1", failed="no such walk."), blank("2"), blank("3")]
    for name, runtime in (("one", 1.0), ("two", 2.0)):
        (tmp_path / name).mkdir()
        write_tables(tmp_path / name, [replace(one, runtime_s=runtime, code=name) for one in results])
    assert tables(tmp_path / "one") == tables(tmp_path / "two")
    assert (tmp_path / "one" / TIMINGS).read_bytes() != (tmp_path / "two" / TIMINGS).read_bytes()

    def some():
        yield blank("4")
        raise OutputError("gone.")

    before = {path.name: path.read_bytes() for path in (tmp_path / "one").iterdir()}
    with pytest.raises(OutputError, match="gone"):
        write_tables(tmp_path / "one", some())
    assert {path.name: path.read_bytes() for path in (tmp_path / "one").iterdir()} == before
    with pytest.raises(OutputError, match="could not be written"):
        write_tables(tmp_path / "nowhere", results)


def test_a_changed_recording_is_made_anew_and_a_bad_one_has_its_reason(tmp_path, made, fg_nav: FgNav):
    (tmp_path / "walks").mkdir()
    (tmp_path / "walks" / "bad.csv").write_text("time_s\n1\n")
    plan = tmp_path / "plan.toml"
    plan.write_text('recordings = ["walks"]\nmethods = ["iez", "ma2018"]\n')
    for joined in (0, 2):
        ran = fg_nav("lab", "campaign", plan, "--out", tmp_path / "out")
        assert (ran.code, ran.err) == (0, "")
        assert f"2 results, {joined} of them from before" in ran.out
        assert "failed: walks, recorded, bad.csv, walk, iez: bad.csv" in ran.out
    assert sum(made.values()) == 2
    found = [(row["walk"], row["method"], row["alignment"]) for row in rows(tmp_path / "out")]
    assert found == [("bad.csv", "iez", None), ("bad.csv", "ma2018", None)]
    (tmp_path / "walks" / "bad.csv").write_text("time_s\n2\n")
    assert run(plan, tmp_path / "out", made)[1] == 0


def test_what_other_code_made_is_reported_and_made_anew_if_wanted(out, plan, made, monkeypatch, fg_nav: FgNav):
    for place in ("store.code", "campaign.execute", "verbs.experiments"):
        monkeypatch.setattr(f"fg_nav.lab.{place}.code_sum", lambda: "other")
    assert "4 results made by other code or libraries" in fg_nav("lab", "campaign", plan, "--out", out).out
    assert not made
    assert "by other code or libraries" not in fg_nav("lab", "campaign", plan, "--out", out, "--renew").out
    assert sum(made.values()) == 4


def test_a_folder_of_something_else_is_left_alone(tmp_path, plan, made, fg_nav: FgNav):
    for folder, file in (("photos", "a.png"), ("letters", "cells/../letter.txt"), ("paper", ".fg-nav-reproduce")):
        (tmp_path / folder / RESULTS_FOLDER).mkdir(parents=True)
        (tmp_path / folder / file).touch()
        ran = fg_nav("lab", "campaign", plan, "--out", tmp_path / folder)
        assert ran.refused("holds what is no campaign", f"('{Path(file).name}')")
    assert fg_nav("lab", "campaign", plan, "--out", plan).refused("cannot be written")
    assert not made


def test_a_plan_may_grow_and_results_of_no_plan_any_more_are_reported(out, plan, made, capsys):
    plan.write_text(PLAN.replace("seeds = 2", "seeds = 3"))
    assert run(plan, out, made)[1] == 4
    assert capsys.readouterr().out == ""
    plan.write_text(PLAN.replace("seeds = 2", "seeds = 2\nfirst_seed = 102"))
    run(plan, out, made)
    assert "has 2 results of other plans than this: the tables leave them out" in capsys.readouterr().out
    assert {row["walk"] for row in rows(out)} == {"102", "103"}


def test_a_campaign_holds_its_folder_until_it_ends_however_it_ends(tmp_path, plan, made, fg_nav: FgNav):
    out = tmp_path / "out"
    script = "import sys, time, pathlib; from fg_nav.lab.campaign.command import lock_folder\n"
    script += "with lock_folder(pathlib.Path(sys.argv[1])):\n    print(1, flush=True); time.sleep(600)"
    words = [sys.executable, "-c", script, str(out)]
    other = subprocess.Popen(words, env=os.environ | {"PYTHONPATH": str(ROOT)}, stdout=subprocess.PIPE)
    try:
        assert other.stdout.readline() == b"1\n"
        assert fg_nav("lab", "campaign", plan, "--out", out).refused("another campaign is at work in")
        assert not made
    finally:
        other.kill()
        other.communicate()
    for half in (".results.csv.1.part", f"{RESULTS_FOLDER}/.a.json.1.part"):
        (out / half).touch()
    assert run(plan, out, made)[1] == 0
    assert not [path for path in out.rglob("*") if path.name.endswith(".part")]


def test_tables_go_while_results_are_missing_and_a_stop_is_reported(out, plan, made, monkeypatch, fg_nav: FgNav):
    plan.write_text(PLAN.replace("seeds = 2", "seeds = 4"))

    def stopped(tasks):
        yield from made.execute(tasks[:1])
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(experiments, "choose_cluster", lambda *_: stopped)
        ran = fg_nav("lab", "campaign", plan, "--out", out)
    assert (ran.code, ran.out) == (130, "")
    assert ran.err == "note: stopped: 6 of 8 results are kept, the same command goes on from there\n"
    assert not [name for name in TABLES if (out / name).exists()]
    assert run(plan, out, made)[1] == 6
    assert [name for name in TABLES if (out / name).exists()] == list(TABLES)


def test_a_full_disk_is_no_reason_to_begin_elsewhere(tmp_path, monkeypatch):
    for number, hint in ((errno.ENOSPC, "make room"), (errno.EIO, "name another folder")):
        refused = OSError(number, os.strerror(number))
        monkeypatch.setattr(Path, "replace", Mock(side_effect=refused))
        with pytest.raises(OutputError, match=hint):
            write_result(tmp_path, blank("1"))
        assert not list(tmp_path.iterdir())


def test_the_end_names_what_failed_and_what_to_do(capsys):
    def printed(*reasons):
        print_campaign([blank(str(k), reason) for k, reason in enumerate(reasons)], 0, Path("out"))
        return capsys.readouterr().out

    out = printed("no stance.")
    assert "failed: demo, smooth, 0, loop, iez: no stance." in out
    assert "1 result failed: --retry makes them again\n" in out
    assert "2 results failed: --retry makes them again, with fewer --workers" in printed("no stance.", KILLED)
    out = printed(*[KILLED] * 12)
    assert out.count("failed: demo") == 10
    assert "and 2 more failed" in out


def test_a_cluster_that_cannot_be_is_refused(tmp_path, plan, monkeypatch, fg_nav: FgNav):
    def asked(*more):
        return fg_nav("lab", "campaign", plan, "--out", tmp_path / "out", *more)

    assert asked("--scheduler", "moon").refused("'moon' is no address")
    assert asked("--scheduler", "tcp://127.0.0.1:1", "--workers", 2).refused("--workers")
    assert not (tmp_path / "out").exists()
    monkeypatch.setattr("fg_nav.lab.campaign.cluster.CONNECT_S", 0.2)
    assert asked("--scheduler", "tcp://127.0.0.1:1").refused("no Dask scheduler answers at tcp://127.0.0.1:1")
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert asked().refused("pip install 'dask[distributed]>=2025.1' 'pyarrow>=18'", "distributed is not there")


def test_ctrl_c_ends_the_campaign_and_its_workers_and_the_same_command_goes_on(tmp_path, plan, made):
    """All processes of a terminal get the signal; only the campaign prints a sentence."""
    out = tmp_path / "out"
    plan.write_text(PLAN.replace("seeds = 2", "seeds = 1000"))
    words = ["-m", "fg_nav", "lab", "campaign", str(plan), "--out", str(out), "--workers", "1"]
    variables = os.environ | {"PYTHONPATH": str(ROOT)}
    first = subprocess.Popen([sys.executable, *words], env=variables, start_new_session=True, stderr=-1, text=True)
    while first.poll() is None and not any((out / RESULTS_FOLDER).glob("*.json")):
        time.sleep(0.05)
    os.killpg(first.pid, signal.SIGINT)
    _, said = first.communicate(timeout=90.0)
    assert first.returncode == 130
    stored = len(list((out / RESULTS_FOLDER).glob("*.json")))
    assert said == f"note: stopped: {stored} of 2000 results are kept, the same command goes on from there\n"
    until_gone(first.pid)
    plan.write_text(PLAN.replace("seeds = 2", "seeds = 1"))
    assert run(plan, out, made)[1] == 2
