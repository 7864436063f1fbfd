"""What is made of a task: a walk once for all its results, each for itself, with its files or without."""

from dataclasses import replace
from functools import partial
from unittest.mock import Mock

import numpy as np
import pytest

from fg_nav.errors import EstimationError
from fg_nav.io.writing import write_canonical
from fg_nav.lab.campaign import execute, walks
from fg_nav.lab.campaign.execute import BUG, Task, evaluate_outcome, make, run_task, tasks_of
from fg_nav.lab.campaign.methods import solve_by
from fg_nav.lab.campaign.walks import LOOP, RAW, Recorded, Simulated, pack, simulate_calibration
from fg_nav.lab.simulation import simulate
from fg_nav.lab.simulation.walk import Passing
from fg_nav.lab.store.results import Key, Result, read_result
from fg_nav.lab.walked import AS_STARTED, BEST_YAW, WalkErrors
from fg_nav.text import to_json
from tests.lab.campaign import fakes
from tests.lab.store.stored import check_that_it_alone_is_read


@pytest.fixture
def counted(monkeypatch):
    """Walks that are simulated or read, one after the other, but for the loops that calibrate."""
    some = []

    def count(call, what, *more):
        some.extend([] if getattr(what, "name", "") == "calibration-loop" else [what])
        return call(what, *more)

    for name in ("simulate", "read"):
        monkeypatch.setattr(walks, name, partial(count, getattr(walks, name)))
    return some


def task(magnetometers=(LOOP, RAW), methods=("iez", "ma2018"), source=None):
    keys = [Key("demo", "smooth", "101", one, method) for method in methods for one in magnetometers]
    return Task(source or Simulated("demo", "smooth", 101), {key: {"of": key.method} for key in keys})


def without_times(results):
    return [to_json(replace(one, runtime_s=0.0)) for one in results]


def test_results_one_by_one_are_those_of_the_walk_and_it_is_simulated_once(counted):
    together = run_task(task())
    assert len(together) == 4
    assert not any(one.failed for one in together)
    assert len(counted) == 1
    alone = {result.key: result for part in task().split() for result in run_task(part)}
    assert without_times(alone[one.key] for one in together) == without_times(together)


def test_each_seed_of_a_plan_is_a_walk_of_its_own():
    """Not the same one again: neither its recording nor the loop that its shoe is calibrated on."""
    keys = [Key("demo", "smooth", seed, RAW, method) for method in ("iez", "qsf") for seed in ("101", "102", "103")]
    tasks = tasks_of({key: {} for key in keys})
    assert [[key.walk for key in one.settings] for one in tasks] == [[seed] * 2 for seed in ("101", "102", "103")]
    recordings = [one.source.prepare(RAW).recording for one in tasks]
    for seed, recording in zip((101, 102, 103), recordings, strict=True):
        np.testing.assert_array_equal(recording.gyr, simulate("demo", seed).recording.gyr)
    loops = [Simulated("demo", "smooth", seed).prepare(LOOP).field.level_field for seed in (101, 102)]
    assert not np.array_equal(loops[0][:5], loops[1][:5])


def test_files_go_with_the_task_and_one_that_cannot_be_read_fails_in_the_same_words(tmp_path, counted, monkeypatch):
    path = tmp_path / "walk.csv"
    write_canonical(simulate("demo", 101).recording, path)
    whole = task((RAW,), source=Recorded(path))
    expected = run_task(whole)
    assert not any(one.failed for one in expected)
    counted.clear()
    sent = replace(whole, source=pack(whole.source))
    path.unlink()
    assert without_times(run_task(sent)) == without_times(expected)
    assert len(counted) == 1
    gone = pack(Recorded(path))
    assert "walk.csv" in run_task(task((RAW,), ("iez",), gone))[0].failed
    path.write_text("time_s\n1\n")
    [here], [there] = (run_task(task((RAW,), ("iez",), one)) for one in (Recorded(path), pack(Recorded(path))))
    assert here.failed == there.failed
    assert here.failed.startswith("walk.csv")
    # a full disk is the worker's trouble, and no result
    monkeypatch.setattr(walks.tempfile, "TemporaryDirectory", Mock(side_effect=OSError(28, "No space left")))
    with pytest.raises(OSError, match="No space left"):
        run_task(task(source=pack(Recorded(path))))


@pytest.mark.parametrize("error", [ZeroDivisionError("by nothing"), EstimationError("no stance.")])
def test_a_method_that_fails_or_has_a_bug_does_not_take_the_others_with_it(monkeypatch, error):
    was = execute.solve_by

    def solve_by(method, walk):
        if method == "iez":
            raise error
        return was(method, walk)

    monkeypatch.setattr(execute, "solve_by", solve_by)
    bug = isinstance(error, ZeroDivisionError)
    reason = "a bug (ZeroDivisionError: by nothing)" if bug else "no stance."
    assert [one.failed for one in run_task(task((RAW,)))] == [reason, ""]


def test_what_is_stored_holds_unless_it_is_to_be_made_again(tmp_path, monkeypatch):
    settings = {Key("demo", "smooth", "1", RAW, method): {"of": 1} for method in ("iez", "qsf", "ma2018")}
    reasons = {"iez": "", "qsf": "no stance.", "ma2018": f"{BUG} (ZeroDivisionError)"}
    made = []

    def run(tasks):
        made.clear()
        for one in tasks:
            made.extend(key.method for key in one.settings)
            yield [Result(key, of, "code", reasons[key.method]) for key, of in one.settings.items()]

    def again(asked=settings, **more):
        return list(make(asked, tmp_path, run, lambda key: fakes.Walk(), **more)), list(made)

    assert again() == ([(0, 3), (3, 3)], ["iez", "qsf", "ma2018"])
    assert read_result(tmp_path, *next(iter(settings.items()))).code == "code"
    assert again() == ([(2, 3), (3, 3)], ["ma2018"])  # what a bug ended is tried again
    assert again(retry=True)[1] == ["qsf", "ma2018"]
    assert again(renew=True)[1] == ["iez", "qsf", "ma2018"]
    monkeypatch.setattr(execute, "code_sum", lambda: "code")
    assert again(renew=True)[1] == ["ma2018"]
    assert again({key: {"of": 2} for key in settings})[1] == ["iez", "qsf", "ma2018"]


def test_what_was_stored_by_other_settings_or_in_another_form_or_is_damaged_is_none(tmp_path):
    key, settings = Key("mall", "indoor", "101", LOOP, "ma2018"), {"method": {"sigma": 0.1, "names": ["a", "b"]}}
    errors = WalkErrors(AS_STARTED, 100.0, 3.0, None, float("nan"))
    result = Result(key, settings, "code", errors={AS_STARTED: errors}, samples=1000, runtime_s=0.004)
    found = check_that_it_alone_is_read(tmp_path, result)
    assert to_json(found) == to_json(result)
    assert found.us_per_sample == 4.0


def test_errors_at_landmarks_are_those_of_the_path_there():
    """Landmarks where footfalls truly are: their errors are those of the footfalls, in both alignments."""
    walk = Simulated("demo", "smooth", 101).prepare("perfect")
    outcome = solve_by("iez", replace(walk, truth=None))
    stood = outcome.solution.stances.sample[5:40:7]

    class Marked(Simulated):
        landmarks = tuple(map(Passing, "ABCAB", walk.truth.t[stood], walk.truth.position[stood]))

    blank = Result(Key("demo", "smooth", "101", LOOP, "iez"), {}, "code")
    found = evaluate_outcome(blank, Marked("demo", "smooth", 101), walk, outcome)
    assert found.landmark == tuple("ABCAB")
    for mode in (AS_STARTED, BEST_YAW):
        apart = np.linalg.norm(np.array(found.estimate[mode]) - np.array(found.truth), axis=1)
        np.testing.assert_allclose(found.landmark_m[mode], apart[5:40:7], atol=0.02)
    assert found.landmark_m[AS_STARTED] != found.landmark_m[BEST_YAW]


def test_a_loop_with_the_same_shoe_takes_the_iron_off():
    sensor = simulate("demo", 101).drawn["sensor"]
    hard, soft = np.array(sensor["hard_iron_uT"]), np.array(sensor["soft_iron"])
    body_up = Simulated("demo", "smooth", 101).prepare(LOOP).field.nav_R_body[:, 2].mean(axis=0)
    body_up /= np.linalg.norm(body_up)
    level = np.eye(3) - np.outer(body_up, body_up)
    added = hard + (soft - np.eye(3)) @ (-43.14 * body_up)
    assert np.linalg.norm(level @ added) > 2.0
    found = simulate_calibration("demo", 101).magnetometer.hard_iron_uT
    assert np.linalg.norm(level @ (found - added)) < 1.0
