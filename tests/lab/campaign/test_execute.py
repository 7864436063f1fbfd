"""What a worker makes of a task: a walk once for all its results, each for itself."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.errors import EstimationError
from fg_nav.io.writing import write_canonical
from fg_nav.lab.campaign import execute, walks
from fg_nav.lab.campaign.execute import WorkerError, execute_task, run_task, tasks_of
from fg_nav.lab.campaign.walks import LOOP, RAW, Recorded, Simulated, pack
from fg_nav.lab.simulation import simulate
from fg_nav.lab.store.results import Key
from fg_nav.text import to_json

METHODS = ("iez", "ma2018")


@pytest.fixture
def counted(monkeypatch):
    """Walks that are simulated or read, one after the other."""
    some = []
    for name in ("simulate_walk", "read"):
        was = getattr(walks, name)
        monkeypatch.setattr(walks, name, lambda *what, was=was: some.append(what[0]) or was(*what))
    return some


def task(magnetometers=(LOOP, RAW), methods=METHODS, seed="101"):
    keys = [Key("demo", "smooth", seed, magnetometer, method) for magnetometer in magnetometers for method in methods]
    [whole] = tasks_of(keys, {key: {"of": key.method} for key in keys})
    return whole


def recorded(folder, content=None):
    """A walk in a file."""
    path = folder / "walk.csv"
    if content is None:
        write_canonical(simulate("demo", 101).recording, path)
    else:
        path.write_text(content)
    return replace(task((RAW,)), group="walks", field="recorded", walk="walk.csv", source=Recorded(path))


def without_times(results):
    return [to_json(replace(one, runtime_s=0.0)) for one in results]


def test_results_one_by_one_are_those_of_the_walk_and_it_is_simulated_once(counted):
    together = run_task(task()).results
    assert len(together) == 4
    assert not any(one.failed for one in together)
    assert len(counted) == 1
    alone = [one for part in task().split() for one in run_task(part).results]
    assert without_times(alone) == without_times(together)


def test_each_seed_of_a_plan_is_a_walk_of_its_own():
    """Not the same one again: neither its recording nor what a method makes of it."""
    keys = [Key("demo", "smooth", seed, RAW, "iez") for seed in ("101", "102", "103")]
    tasks = tasks_of(keys, {key: {} for key in keys})
    recordings = [one.source.prepare(RAW).recording for one in tasks]
    assert len({recording.gyr.tobytes() for recording in recordings}) == 3
    for one, recording in zip(tasks, recordings, strict=True):
        np.testing.assert_array_equal(recording.gyr, simulate("demo", int(one.walk)).recording.gyr)
    results = [run_task(one).results[0] for one in tasks]
    assert len({one.errors["origin"].end_m for one in results}) == 3
    assert len({str(one.truth) for one in results}) == 3
    loops = [Simulated("demo", "smooth", seed).prepare(LOOP).field.level_field for seed in (101, 102)]
    assert not np.array_equal(loops[0][:5], loops[1][:5])


def test_files_go_with_the_task(tmp_path, counted):
    whole = recorded(tmp_path)
    expected = run_task(whole).results
    assert not any(one.failed for one in expected)
    counted.clear()
    sent = replace(whole, source=pack(whole.source))
    (tmp_path / "walk.csv").unlink()
    assert without_times(run_task(sent).results) == without_times(expected)
    assert len(counted) == 1


def test_a_file_that_cannot_be_read_is_told_in_the_same_words_here_and_there(tmp_path):
    whole = recorded(tmp_path, "time_s\n1\n")
    here, there = (run_task(replace(whole, source=one)).results for one in (whole.source, pack(whole.source)))
    assert {one.failed for one in here} == {one.failed for one in there}
    assert here[0].failed.startswith("walk.csv")


@pytest.mark.parametrize("error", [ZeroDivisionError("by nothing"), EstimationError("no stance.")])
def test_a_method_that_fails_or_has_a_bug_does_not_take_the_others_with_it(monkeypatch, counted, error):
    was = execute.solve_by

    def solve_by(method, walk):
        if method == "iez":
            raise error
        return was(method, walk)

    monkeypatch.setattr(execute, "solve_by", solve_by)
    bug = isinstance(error, ZeroDivisionError)
    reason = "a bug (ZeroDivisionError: by nothing)" if bug else "no stance."
    assert [one.failed for one in run_task(task((RAW,))).results] == [reason, ""]
    assert len(counted) == 1
    if bug:
        with pytest.raises(ZeroDivisionError):
            list(execute_task(task((RAW,)), ""))


def test_a_walk_with_a_bug_fails_under_each_magnetometer(monkeypatch):
    def broken(*_):
        raise ZeroDivisionError("by nothing")

    monkeypatch.setattr(walks, "simulate_walk", broken)
    assert {one.failed for one in run_task(task()).results} == {"a bug (ZeroDivisionError: by nothing)"}


def test_a_disk_that_is_full_is_the_workers_trouble_and_no_result(tmp_path, monkeypatch):
    def full(*_, **__):
        raise OSError(28, "No space left")

    whole = recorded(tmp_path, "x\n")
    sent = replace(whole, source=pack(whole.source))
    monkeypatch.setattr(walks.tempfile, "TemporaryDirectory", full)
    monkeypatch.setattr(execute, "_address", lambda: "tcp://one:1")
    with pytest.raises(WorkerError) as told:
        run_task(sent)
    assert told.value.args == ("tcp://one:1", "OSError: [Errno 28] No space left")
