"""A campaign as a whole: what is made, what is joined, what is made anew, and that the tables do not tell how."""

import errno
import os
import signal
import subprocess
import sys
import time
import weakref
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
from pyarrow import parquet

from fg_nav import cli
from fg_nav.errors import CampaignError, OutputError
from fg_nav.lab.campaign import command
from fg_nav.lab.campaign import folder as table
from fg_nav.lab.campaign.command import Request, run_campaign
from fg_nav.lab.campaign.execute import run_task
from fg_nav.lab.campaign.folder import RESULTS, RESULTS_FOLDER, TABLES, TIMINGS, lock_folder, write_tables
from fg_nav.lab.campaign.plan import read_plan
from fg_nav.lab.campaign.walks import pack
from fg_nav.lab.store import code
from fg_nav.lab.store import results as store
from fg_nav.lab.store.files import CAMPAIGN_MARKER
from fg_nav.lab.verbs.experiments import describe_duration
from tests.command_line import FgNav, in_a_process
from tests.lab.campaign import fakes

ROOT = Path(cli.__file__).parents[1]

PLAN = 'scenarios = ["demo"]\nfields = ["smooth"]\nseeds = 2\nmethods = ["iez", "ma2018"]\nmagnetometers = ["raw"]\n'


@pytest.fixture
def plan(tmp_path):
    path = tmp_path / "plan.toml"
    path.write_text(PLAN)
    return path


@pytest.fixture
def made(monkeypatch):
    """Count the results that are made, here and without a cluster."""
    count = Counter()

    def dispatch(tasks, cluster, take, notify, show):
        for task in tasks:
            count.update(task.keys)
            take(task, run_task(replace(task, source=pack(task.source)) if cluster.remote else task))
            show(1)

    monkeypatch.setattr(command, "dispatch", dispatch)
    return count


def tables(folder):
    return {name: (folder / name).read_bytes() for name in TABLES if name != TIMINGS}


def rows(folder, name=RESULTS):
    return parquet.read_table(folder / name).to_pylist()


def run(plan, out, **more):
    return run_campaign(Request(plan, out, **more), lambda _: None, print)


def test_what_is_there_is_joined_and_the_tables_are_the_same_bytes(tmp_path, plan, made):
    one = run(plan, tmp_path / "one")
    assert (len(one.results), one.stored, sum(made.values())) == (4, 0, 4)
    for half in sorted((tmp_path / "one" / RESULTS_FOLDER).iterdir())[::2]:
        half.unlink()
    again = run(plan, tmp_path / "one")
    assert (again.stored, sum(made.values())) == (2, 6)
    first = tables(tmp_path / "one")
    run(plan, tmp_path / "two")
    assert tables(tmp_path / "two") == first
    timed = parquet.read_table(tmp_path / "one" / TIMINGS).to_pylist()
    assert all(row["runtime_s"] > 0.0 and row["code"] == code.code_sum() for row in timed)


def test_the_tables_tell_what_the_cells_hold(tmp_path, plan, made):
    done = run(plan, tmp_path / "one")
    rows = parquet.read_table(tmp_path / "one" / RESULTS).to_pylist()
    assert [(row["walk"], row["method"], row["alignment"]) for row in rows] == [
        (walk, method, mode) for walk in ("101", "102") for method in ("iez", "ma2018") for mode in ("origin", "yaw")
    ]
    by_key = {(one.key.walk, one.key.method): one for one in done.results}
    assert len(by_key) == 4
    for row in rows:
        errors = by_key[row["walk"], row["method"]].errors[row["alignment"]]
        assert row["rmse_m"] == errors.rmse_m
        assert row["end_percent"] == pytest.approx(100.0 * row["end_m"] / row["distance_m"])
        assert 50 < row["footfalls"] < 80
        assert row["failed"] == ""


def test_runtime_does_not_change_a_byte(tmp_path):
    results = [one for walk in "213" for one in fakes.results(fakes.task("demo", walk, "qsf", "iez"))]
    results[0] = replace(results[0], failed="no such walk.")
    for name, some, runtime in (("one", results, 1.0), ("two", results[::-1], 2.0)):
        (tmp_path / name).mkdir()
        ordered = sorted((replace(one, runtime_s=runtime, code=name) for one in some), key=lambda one: one.key)
        write_tables(tmp_path / name, ordered)
    assert tables(tmp_path / "one") == tables(tmp_path / "two")
    assert (tmp_path / "one" / TIMINGS).read_bytes() != (tmp_path / "two" / TIMINGS).read_bytes()
    with pytest.raises(OutputError, match="could not be written"):
        write_tables(tmp_path / "nowhere", results)


def test_only_some_results_are_held_at_a_time(tmp_path, plan, made, monkeypatch):
    """A cell has its paths; the tables are made of batches, and what is handed back has no paths."""
    done = run(plan, tmp_path / "one")
    held, most = set(), []
    monkeypatch.setattr(table, "BATCH", 2)
    read = store.read_result

    def counting(*some):
        result = read(*some)
        assert result.estimate
        number = len(most)
        held.add(number)
        weakref.finalize(result, held.discard, number)
        most.append(len(held))
        return result

    monkeypatch.setattr(store, "read_result", counting)
    again = run(plan, tmp_path / "one")
    assert len(most) == 8
    assert max(most) <= 3
    assert again.results == done.results
    assert not any(one.estimate or one.truth or one.whitened or one.parameters for one in again.results)
    rows = parquet.read_table(tmp_path / "one" / RESULTS).to_pylist()
    assert len(rows) == 8


def test_a_table_that_fails_half_way_leaves_all_as_they_were(tmp_path):
    def some():
        yield from fakes.results(fakes.task("demo", "1", "iez"))
        raise OutputError("gone.")

    write_tables(tmp_path, fakes.results(fakes.task("demo", "1", "qsf")))
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(OutputError, match="gone"):
        write_tables(tmp_path, some())
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    assert set(before) == set(TABLES)


def test_what_cannot_be_moved_to_its_place_leaves_nothing_beside(tmp_path):
    result = fakes.results(fakes.task("demo", "1"))[0]
    (tmp_path / result.key.file).mkdir()
    with pytest.raises(OutputError, match="could not be written"):
        store.write_result(tmp_path, result)
    assert [path.name for path in tmp_path.iterdir()] == [result.key.file]


@pytest.mark.parametrize(("number", "hint"), [(errno.ENOSPC, "make room"), (errno.EIO, "name another folder")])
def test_a_full_disk_is_no_reason_to_begin_elsewhere(tmp_path, monkeypatch, number, hint):
    def refused(*_, **__):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(Path, "replace", refused)
    with pytest.raises(OutputError, match=hint):
        store.write_result(tmp_path, fakes.results(fakes.task("demo", "1"))[0])


def test_a_changed_recording_is_made_anew_and_a_bad_one_is_told(tmp_path, made, fg_nav: FgNav):
    (tmp_path / "walks").mkdir()
    (tmp_path / "walks" / "bad.csv").write_text("time_s\n1\n")
    (tmp_path / "plan.toml").write_text('recordings = ["walks"]\nmethods = ["iez", "ma2018"]\n')
    for joined in (0, 2):
        ran = fg_nav("lab", "campaign", tmp_path / "plan.toml", "--out", tmp_path / "out")
        assert (ran.code, ran.err) == (0, "")
        assert f"2 results, {joined} of them from before" in ran.out
        assert "failed: walks, recorded, bad.csv, walk, iez: bad.csv" in ran.out
    assert sum(made.values()) == 2
    rows = parquet.read_table(tmp_path / "out" / RESULTS).to_pylist()
    assert [(row["walk"], row["method"], row["alignment"]) for row in rows] == [
        ("bad.csv", "iez", None),
        ("bad.csv", "ma2018", None),
    ]
    (tmp_path / "walks" / "bad.csv").write_text("time_s\n2\n")
    assert run(tmp_path / "plan.toml", tmp_path / "out").stored == 0
    assert run(tmp_path / "plan.toml", tmp_path / "out").stored == 2
    assert run(tmp_path / "plan.toml", tmp_path / "out", retry=True).stored == 0


def test_what_other_code_made_is_told_and_made_anew_if_wanted(tmp_path, plan, made, monkeypatch, fg_nav: FgNav):
    run(plan, tmp_path / "out")
    for place in ("lab.store.code", "lab.campaign.execute", "lab.verbs.experiments"):
        monkeypatch.setattr(f"fg_nav.{place}.code_sum", lambda: "other")
    assert "4 results made by other code or libraries" in fg_nav("lab", "campaign", plan, "--out", tmp_path / "out").out
    assert "by other code or libraries" not in fg_nav("lab", "campaign", plan, "--out", tmp_path / "out", "--renew").out
    assert sum(made.values()) == 8


def test_a_folder_of_something_else_is_left_alone(tmp_path, plan, made, fg_nav: FgNav):
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "a.png").touch()
    assert fg_nav("lab", "campaign", plan, "--out", tmp_path / "photos").refused("holds what is no campaign")
    assert fg_nav("lab", "campaign", plan, "--out", plan).refused("cannot be written")
    for folder, file in (
        ("letters", "letter.txt"),
        ("other", f"{RESULTS_FOLDER}/a.png"),
        ("paper", ".fg-nav-reproduce"),
    ):
        (tmp_path / folder / RESULTS_FOLDER).mkdir(parents=True)
        (tmp_path / folder / file).touch()
        assert fg_nav("lab", "campaign", plan, "--out", tmp_path / folder).refused(f"('{file}')")
    assert not made


def test_a_folder_of_ours_is_known_by_its_mark_or_by_having_nothing_else(tmp_path, plan, made):
    run(plan, tmp_path / "ours")
    (tmp_path / "ours" / "letter.txt").touch()
    assert run(plan, tmp_path / "ours").stored == 4
    (tmp_path / "ours" / "letter.txt").unlink()
    (tmp_path / "ours" / CAMPAIGN_MARKER).unlink()
    assert run(plan, tmp_path / "ours").stored == 4
    assert (tmp_path / "ours" / CAMPAIGN_MARKER).is_file()


def test_a_plan_may_grow_and_what_is_of_no_plan_any_more_is_told(tmp_path, plan, made, capsys):
    run(plan, tmp_path / "out")
    plan.write_text(PLAN.replace("seeds = 2", "seeds = 3"))
    assert run(plan, tmp_path / "out").stored == 4
    assert capsys.readouterr().out == ""
    other = tmp_path / "other.toml"
    other.write_text(PLAN.replace("seeds = 2", "seeds = 3\nfirst_seed = 102"))
    run(other, tmp_path / "out")
    said = capsys.readouterr().out
    words = "has 2 results of other plans than this"
    assert f"{words} (the last one there was {plan}): the tables leave them out" in said
    assert {row["walk"] for row in rows(tmp_path / "out")} == {"102", "103", "104"}
    assert run(plan, tmp_path / "out").stored == 6
    assert f"{words} (the last one there was {other}): the tables leave them out" in capsys.readouterr().out
    plan.write_text(PLAN.replace("seeds = 2", "seeds = 1"))
    run(plan, tmp_path / "out")
    assert f"{words.replace('2', '6')}: the tables" in capsys.readouterr().out


def test_a_campaign_holds_its_folder_until_it_ends_however_it_ends(tmp_path, plan, made, fg_nav: FgNav):
    out = tmp_path / "out"
    code = "import sys, time, pathlib; from fg_nav.lab.campaign.folder import lock_folder\n"
    code += "with lock_folder(*map(pathlib.Path, sys.argv[1:])):\n    print(1, flush=True); time.sleep(600)"
    words = [sys.executable, "-c", code, str(out), str(plan)]
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
    assert run(plan, out).stored == 0
    assert not [path for path in out.rglob("*") if path.name.endswith(".part")]


def test_without_locks_nobody_is_kept_out(tmp_path, plan, monkeypatch):
    def refuse(*given: object) -> None:
        raise OSError(errno.ENOTSUP, "no locks")

    monkeypatch.setattr("fcntl.flock", refuse)
    with lock_folder(tmp_path / "out", plan):
        (tmp_path / "out" / ".results.csv.1.part").touch()
        with lock_folder(tmp_path / "out", tmp_path / "other.toml") as again:
            assert again.before == str(plan)
    assert (tmp_path / "out" / ".results.csv.1.part").exists()


def test_tables_go_while_results_are_missing_and_who_stops_is_told(tmp_path, plan, made, monkeypatch, fg_nav: FgNav):
    out = tmp_path / "out"
    run(plan, out)
    plan.write_text(PLAN.replace("seeds = 2", "seeds = 4"))
    as_it_was = command.dispatch

    def stopped(tasks, *more):
        as_it_was(tasks[:1], *more)
        raise KeyboardInterrupt

    monkeypatch.setattr(command, "dispatch", stopped)
    ran = fg_nav("lab", "campaign", plan, "--out", out)
    assert (ran.code, ran.out) == (130, "")
    assert ran.err == "note: stopped: 6 of 8 results are kept, the same command goes on from there\n"
    assert not [name for name in TABLES if (out / name).exists()]
    monkeypatch.setattr(command, "dispatch", as_it_was)
    assert run(plan, out).stored == 6
    assert [name for name in TABLES if (out / name).exists()] == list(TABLES)


@pytest.mark.parametrize("harm", ["is not what was kept there", "was there and is gone"])
def test_what_another_program_does_to_a_cell_is_told(tmp_path, plan, made, monkeypatch, harm):
    def harmed(key):
        cell = tmp_path / "out" / RESULTS_FOLDER / key.file
        cell.unlink() if harm.endswith("gone") else cell.write_text("{}")
        return ()

    monkeypatch.setattr(command, "place_of", harmed)
    with pytest.raises(OutputError, match=f"101.json {harm}: run the same command again"):
        run(plan, tmp_path / "out")


def test_rows_are_in_the_order_of_their_first_columns(tmp_path, plan, made):
    """Words of methods are in another order: `iez:physical` is behind `iez,...`, its preset before `tuned`."""
    text = PLAN.replace('"ma2018"', '"iez:physical"').replace("seeds = 2", "seeds = [9, 10]")
    plan.write_text(f"{text}[parameters.iez]\nacc_density = [0.1, 10.0, 2.0]\n")
    run(plan, tmp_path / "out")
    for name in (RESULTS, TIMINGS):
        places = [tuple(row[word] for word in table.WORDS) for row in rows(tmp_path / "out", name)]
        assert places == sorted(places)
        assert len(set(places)) == 12


def test_without_dask_there_is_a_sentence(plan, monkeypatch, fg_nav: FgNav):
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert fg_nav("lab", "campaign", plan).refused("pip install 'fg-nav[campaign]'", "distributed")


def test_two_walks_that_would_be_one_file_are_refused(tmp_path):
    for name in ("a b/w.csv", "a-b/w.csv"):
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).write_text("x\n")
    (tmp_path / "plan.toml").write_text('recordings = ["a b", "a-b"]\nmethods = ["iez"]\n')
    with pytest.raises(
        CampaignError, match=r"'w\.csv' of 'a b' and 'w\.csv' of 'a-b' would be kept in one file: rename"
    ):
        read_plan(tmp_path / "plan.toml").list_keys()


def test_dask_is_loaded_by_nobody_else():
    code = "import sys, fg_nav, fg_nav.cli, fg_nav.walk, fg_nav.smoother; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "fg_nav.smoother" in loaded
    assert not {"dask", "distributed", "pyarrow.parquet"} & set(loaded)


def test_a_scheduler_that_is_not_there(tmp_path, plan, monkeypatch, fg_nav: FgNav):
    monkeypatch.setattr("fg_nav.lab.campaign.cluster.CONNECT_S", 0.2)
    refused = fg_nav("lab", "campaign", plan, "--out", tmp_path / "out", "--scheduler", "tcp://127.0.0.1:1")
    assert refused.refused("no Dask scheduler answers at tcp://127.0.0.1:1")
    assert fg_nav("lab", "campaign", plan, "--out", tmp_path / "out", "--scheduler", "moon").refused(
        "'moon' is no address"
    )


def test_a_word_that_is_no_address_is_refused_without_a_traceback_of_dask(tmp_path, plan):
    refused = in_a_process("lab", "campaign", str(plan), "--out", str(tmp_path / "out"), "--scheduler", "nonsense")
    assert refused.code == 1
    assert len(refused.err.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def start_held(plan, *words):
    """A campaign in a process of its own, once it has its first result; it never makes those of the last walk."""
    plan.write_text(PLAN.replace("seeds = 2", "seeds = 4"))
    code = "from tests.lab.campaign.fakes import run_held; run_held()"
    line = [sys.executable, "-c", code, *words]
    paths = os.pathsep.join(map(str, (ROOT, Path(__file__).parents[3])))
    variables = os.environ | {"PYTHONPATH": paths}
    process = subprocess.Popen(line, env=variables, start_new_session=True, stderr=subprocess.PIPE, text=True)
    results = Path(words[words.index("--out") + 1]) / RESULTS_FOLDER
    while process.poll() is None and not any(results.glob("*.json")):
        time.sleep(0.01)
    return process, results


def test_a_killed_campaign_goes_on(tmp_path, plan, made):
    """The program itself, with its own cluster, is killed with a cell done; its worker goes with it."""
    words = ["lab", "campaign", str(plan), "--out", str(tmp_path / "out"), "--workers", "1"]
    first, cells = start_held(plan, *words)
    first.send_signal(signal.SIGKILL)
    first.communicate()
    assert not (tmp_path / "out" / RESULTS).exists()
    fakes.until_gone(first.pid)
    there = {path: path.stat().st_mtime_ns for path in cells.glob("*.json")}
    assert 0 < len(there) < 8
    second = in_a_process(*words)
    assert (second.code, second.err) == (0, "")
    assert f"8 results, {len(there)} of them from before" in second.out
    assert {path: path.stat().st_mtime_ns for path in there} == there
    assert not made
    run(plan, tmp_path / "undisturbed")
    assert tables(tmp_path / "undisturbed") == tables(tmp_path / "out")


def test_ctrl_c_ends_the_campaign_and_its_workers_and_the_same_command_goes_on(tmp_path, plan, made):
    """All processes of a terminal get the signal; only the campaign says a word."""
    first, results = start_held(plan, "lab", "campaign", str(plan), "--out", str(tmp_path / "out"), "--workers", "1")
    os.killpg(first.pid, signal.SIGINT)
    _, said = first.communicate(timeout=90.0)
    assert first.returncode == 130
    stored = len(list(results.glob("*.json")))
    assert said == f"note: stopped: {stored} of 8 results are kept, the same command goes on from there\n"
    fakes.until_gone(first.pid)
    assert 0 < stored < 8
    assert run(plan, tmp_path / "out").stored == stored


def test_durations_are_said_as_people_do():
    assert [describe_duration(s) for s in (3.4, 61, 3599.9, 90061)] == [
        "3 s",
        "1 min 01 s",
        "1 h 00 min",
        "25 h 01 min",
    ]
