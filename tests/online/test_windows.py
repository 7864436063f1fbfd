"""A long walk is solved again window by window: it stays where the whole is, and what it holds is bounded."""

import os
import pickle
import signal
import subprocess
import sys
import time
from concurrent.futures import Future
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from fg_nav.online import buffer as online_buffer
from fg_nav.online import resolve, smoother, strides
from fg_nav.online.buffer import LEAD_S, UNSEEN, OnlineOptions, Pace, PartialWalk, SampleBuffer, rows_of
from fg_nav.online.resolve import Solver, SolverProcess, Task, WalkSolver
from fg_nav.online.smoother import OnlineSmoother, window_anchors
from fg_nav.online.window import Window
from tests.online.test_online_smoother import (
    FOOTFALLS,
    add,
    farthest,
    fed,
    in_field,
    whole,
    whole_in_field,
)
from tests.online.walks import solve_in_windows
from tests.smoother.walks import demo

BEHIND, WINDOW = 12, 16


@pytest.fixture
def windows(monkeypatch: pytest.MonkeyPatch) -> None:
    solve_in_windows(monkeypatch, BEHIND, WINDOW)


@pytest.fixture(scope="module")
def solved_as_a_whole() -> dict[bool, OnlineSmoother]:
    """The walks without and with the field; made before `windows` sets in."""
    return {False: whole(), True: whole_in_field()}


@cache
def in_windows(with_field: bool = False, lag_s: float | None = None) -> OnlineSmoother:
    """The same under `windows`."""
    if with_field:
        return fed(in_field(), OnlineOptions(lag_s=lag_s))
    return fed(demo(), OnlineOptions(lag_s=lag_s))


@pytest.mark.usefixtures("windows")
@pytest.mark.parametrize("with_field", [False, True])
def test_it_stays_where_the_whole_is(solved_as_a_whole: dict[bool, OnlineSmoother], with_field: bool) -> None:
    """By its sigmas, which are larger: what a dozen footfalls showed of the sensor is all that it knows of it."""
    online, expected = in_windows(with_field), solved_as_a_whole[with_field]
    assert online.initial.first > 0
    table, other = online.smoothed(), expected.smoothed()
    np.testing.assert_array_equal(table.sample, other.sample)
    apart = np.abs(table.position - other.position)
    assert (apart <= table.position_sigma).all()
    assert apart[:, :2].max() < (0.7 if with_field else 0.02)
    assert 0.9 < table.heading_sigma[-1] / other.heading_sigma[-1] < 4.0


@pytest.mark.usefixtures("windows")
@pytest.mark.parametrize("with_field", [False, True])
def test_with_a_lag_it_stays_where_it_is_without(with_field: bool) -> None:
    online, expected = in_windows(with_field, 12.0), in_windows(with_field)
    assert online.initial.first > 0
    table, other = online.smoothed(), expected.smoothed()
    np.testing.assert_array_equal(table.sample, other.sample)
    assert farthest(table, other) < 0.10
    np.testing.assert_allclose(table.heading_sigma[-1], other.heading_sigma[-1], rtol=0.1)


class InPieces:
    """In place of the other process, with samples of its own; calls go through pickle as over a pipe."""

    is_closed = False

    def __init__(self, options: OnlineOptions, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(resolve, "NICENESS", 0)
        monkeypatch.setattr(resolve, "_solvers", {})
        resolve._set_up({None: options})
        self.pace = Pace()

    @property
    def buffer(self) -> SampleBuffer:
        return resolve._solvers[None].buffer

    def submit(self, *arguments: object) -> Future[object]:
        future: Future[object] = Future()
        future.set_result(pickle.loads(pickle.dumps(resolve._run(*pickle.loads(pickle.dumps(arguments))))))
        return future

    def close(self) -> None: ...


@pytest.mark.usefixtures("windows")
@pytest.mark.parametrize("lag_s", [None, 12.0])
def test_what_solves_beside_holds_a_window_of_samples_and_says_the_same(
    monkeypatch: pytest.MonkeyPatch, lag_s: float | None
) -> None:
    for owner, context_s in ((smoother, 3.0), (resolve, 3.0), (strides, 2.0)):
        monkeypatch.setattr(owner, "CONTEXT_S", context_s)
    options = OnlineOptions(lag_s=lag_s)
    here, buffer = fed(in_field(), options), SampleBuffer()
    beside = InPieces(options, monkeypatch)
    rows = rows_of(in_field().recording)
    solver = Solver(WalkSolver(options, buffer), beside)
    there = OnlineSmoother(options, buffer, solver=solver)
    buffer.append(rows)
    kept = []
    for k in range(FOOTFALLS):
        until = add(there, in_field(), k)
        kept.append((until - beside.buffer.first, until - buffer.first))
    np.testing.assert_array_equal(here.causal().position, there.causal().position)
    np.testing.assert_array_equal(here.smoothed().pose_cov, there.smoothed().pose_cov)
    seconds = np.array(kept)[-10:] / 200.0
    assert seconds[:, 0].max() < 28.0 < in_field().recording.t[until] - 10.0
    assert (buffer.first > 0) == (lag_s is not None)


class Late(Solver):
    """Each of its solutions is there so many footfalls later than it is due."""

    late = 0

    def begin(self, task: Task) -> None:
        self._missed = 0
        super().begin(task)

    def is_ready(self) -> bool:
        self._missed += 1
        return self._missed > self.late


@pytest.mark.usefixtures("windows")
@pytest.mark.parametrize("late", [3, smoother.MAX_LATE + 3])
def test_a_walk_goes_on_without_a_solution_that_is_late(monkeypatch: pytest.MonkeyPatch, late: int) -> None:
    """What came in the meantime is added to it when it is there: here, or where it is solved if that is much."""
    usual = in_windows()
    monkeypatch.setattr(smoother, "FAST", np.inf)
    monkeypatch.setattr(Late, "late", late)
    options, buffer = OnlineOptions(), SampleBuffer()
    solver = Late(WalkSolver(options, buffer), InPieces(options, monkeypatch))
    online = OnlineSmoother(options, buffer, solver=solver)
    buffer.append(rows_of(demo().recording))
    begun = []
    for k in range(FOOTFALLS):
        online.prepare()
        add(online, demo(), k)
        begun.append(online.initial.stance.number)
    assert begun[11 + late] < 11 <= begun[13 + late]
    assert begun[-1] > 11 + late
    assert [one.line for one in online.footfalls] == list(range(FOOTFALLS))
    np.testing.assert_array_equal(online.smoothed().sample, usual.smoothed().sample)
    assert farthest(online.smoothed(), usual.smoothed()) < 0.10
    np.testing.assert_allclose(online.latest.position, online.smoothed().position[-1], atol=1e-3)


def test_what_came_after_a_solution_that_was_late_is_not_lost() -> None:
    """It is asked for in two parts, of a solver that has not begun, and of one that has answered the first."""
    walk = demo()
    told = fed(walk, footfalls=20).footfalls
    buffer, found = SampleBuffer(), []
    buffer.append(rows_of(walk.recording))
    for waits in (False, True):
        here = WalkSolver(OnlineOptions(), buffer)
        solver = Solver(here)
        solver.begin(Task(None, tuple(told[:14]), UNSEEN, since=0))
        assert here.run(()) is None  # the line at which it begins does not wait for it
        solver.request(told[14:17])
        if waits:
            solver.take()
        solver.request(told[17:])
        anchor = solver.take()
        assert [one.line for one in anchor.footfalls] == list(range(20))
        found.append(Window(anchor, PartialWalk(buffer, footfalls=told)).latest)
    np.testing.assert_array_equal(found[0].position, found[1].position)


def test_what_is_kept_before_a_window_is_all_that_its_strides_look_at() -> None:
    """Else a process that discarded the rest would say something else than one that has it."""
    assert resolve.CONTEXT_S >= strides.CONTEXT_S + LEAD_S


@pytest.mark.usefixtures("windows")
def test_anchor_states_behind_footfalls_that_were_taken_back_are_left_out() -> None:
    """Also where there are fewer footfalls now than such a handover had."""
    online = fed(demo(), footfalls=30)
    newest, starts = online.initial, list(online.anchors)
    del online.footfalls[starts[-1].stance.number :]
    earlier = replace(newest, stance=starts[-2].stance)
    kept = window_anchors(starts, earlier, online.footfalls, None, smoother.WINDOW)
    assert [one.stance for one in kept] == [one.stance for one in [*starts[:-1], earlier]]


def test_a_process_beside_says_the_same_and_is_replaced_where_it_dies(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """It is killed once it has answered; the walk goes on to the bit, with one remark.

    Modules in the folder that the user is in are none of its own.
    """
    monkeypatch.setattr(smoother, "FAST", 0.0)  # solutions are waited for, however slow the machine
    (tmp_path / "numpy.py").write_text("raise ImportError\n")
    monkeypatch.chdir(tmp_path)
    walk, buffer, remarks = in_field(), SampleBuffer(), []
    options = OnlineOptions()
    here = fed(walk, options, 32)
    buffer.append(rows_of(walk.recording))
    process = SolverProcess({None: options})
    solver = Solver(WalkSolver(options, buffer), process, remarks.append)
    assert process.pid is None
    try:
        there = OnlineSmoother(options, buffer, solver=solver)
        for k in range(26):
            add(there, walk, k)
        assert there.initial.stance.number == 19
        assert remarks == []
        os.kill(process.pid, signal.SIGKILL)
        for k in range(26, 32):
            add(there, walk, k)
    finally:
        solver.close()
    assert len(remarks) == 1
    assert "has died" in remarks[0]
    np.testing.assert_array_equal(here.causal().position, there.causal().position)
    np.testing.assert_array_equal(here.causal().pose_cov, there.causal().pose_cov)
    np.testing.assert_array_equal(here.smoothed().position, there.smoothed().position)


def test_a_process_beside_that_was_stopped_is_not_waited_for_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resolve, "MAX_S", 0.1)
    remarks: list[str] = []
    process = SolverProcess({None: OnlineOptions()})
    here = WalkSolver(OnlineOptions(), SampleBuffer())
    solver = Solver(here, process, remarks.append)
    try:
        solver.start()
        os.kill(process.pid, signal.SIGSTOP)
        monkeypatch.setattr(here, "run", lambda work: None)
        solver.request(())
        assert not solver.is_ready()
        assert [solver.take(), solver.take()] == [None, None]
        assert solver.is_here
    finally:
        solver.close()
    assert remarks == [
        "the process that solves the walk again has not answered for 0 s: this one does its work from here on."
    ]


def test_a_task_that_failed_beside_is_solved_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where what was requested after it has no answer and did not fail."""
    walk, remarks = demo(), []
    told, buffer = fed(walk, footfalls=20).footfalls, SampleBuffer()
    buffer.append(rows_of(walk.recording))
    process = InPieces(OnlineOptions(), monkeypatch)
    submit = process.submit

    def failing(side: object, first: int, rows: object, work: object) -> Future[object]:
        if not isinstance(work, Task):
            return submit(side, first, rows, work)
        future: Future[object] = Future()
        future.set_exception(MemoryError())
        return future

    monkeypatch.setattr(process, "submit", failing)
    solver = Solver(WalkSolver(OnlineOptions(), buffer), process, remarks.append)
    solver.begin(Task(None, tuple(told[:14]), UNSEEN, since=0))
    solver.request(told[14:])
    anchor = solver.take()
    assert [one.line for one in anchor.footfalls] == list(range(20))
    assert solver.is_here
    assert ["has failed (MemoryError)" in words for words in remarks] == [True]


def test_what_the_machine_takes_is_no_waiting_for_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    """Else a recording on a slow machine would be taken for a walk in progress, whose solutions are not waited for."""
    clock = iter([0.0, 1.0, 5.0, 6.0, 9.0])
    monkeypatch.setattr(online_buffer.time, "monotonic", lambda: next(clock))
    pace = Pace()
    for _ in range(2):
        with pace:
            pass
    assert pace.idle_s == 2.0


LEFT_RUNNING = """
import os, signal, sys
from fg_nav.online.buffer import OnlineOptions
from fg_nav.online.resolve import SolverProcess
signal.signal(signal.SIGINT, signal.default_int_handler)  # A shell may have it ignored in the background.
process = SolverProcess({None: OnlineOptions()})
process._worker.submit(os.getpid).result()
print(process.pid, flush=True)
os.kill(process.pid if sys.argv[1] == "stopped" else os.getpid(), getattr(signal, sys.argv[2]))
"""


@pytest.mark.parametrize(("who", "how"), [("stopped", "SIGSTOP"), ("killed", "SIGKILL"), ("interrupted", "SIGINT")])
def test_no_process_is_left(tmp_path: Path, who: str, how: str) -> None:
    """An interpreter that ends does not wait for one that is stopped, and one that is killed leaves none."""
    script = tmp_path / "script.py"
    script.write_text(LEFT_RUNNING)
    done = subprocess.run([sys.executable, script, who, how], capture_output=True, text=True, timeout=60.0)
    assert (done.returncode == 0) == (who == "stopped"), done.stderr
    pid, until = int(done.stdout), time.monotonic() + 20.0
    while time.monotonic() < until:
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return
        time.sleep(0.05)
    os.kill(pid, signal.SIGKILL)
    pytest.fail("it is still there")


@pytest.mark.usefixtures("windows")
def test_a_footfall_that_had_no_solution_has_one_in_hindsight(monkeypatch: pytest.MonkeyPatch) -> None:
    usual, update, failed = in_windows(), Window._update, []

    def failing(window: Window, *given: object) -> None:
        if window._stances[-1].number == 22 and not failed:
            failed.append(22)
            raise RuntimeError("Indeterminate linear system detected")
        update(window, *given)

    monkeypatch.setattr(Window, "_update", failing)
    online = fed(demo())
    assert failed
    assert farthest(online.causal(), usual.causal()) > 1e-6
    assert farthest(online.smoothed(), usual.smoothed()) < 0.02
