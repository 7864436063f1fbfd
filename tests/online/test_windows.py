"""A long walk is solved again window by window: it stays where the whole is, and what it holds is bounded."""

import os
import pickle
import signal
from concurrent.futures import Future
from dataclasses import replace
from functools import cache

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import B, M, V, X

from fg_nav.online import buffer as online_buffer
from fg_nav.online import resolve, smoother, strides
from fg_nav.online.buffer import UNSEEN, OnlineOptions, Pace, PartialWalk, SampleBuffer
from fg_nav.online.estimates import EstimateRow, Past, PathNodes
from fg_nav.online.resolve import Solver, SolverProcess, Task, WalkSolver, solve_so_far
from fg_nav.online.smoother import OnlineSmoother, window_anchors
from fg_nav.online.strides import StanceNodes, list_stances, list_variables
from fg_nav.online.window import MarginalPrior, Window, _pose_noise, marginalize
from fg_nav.smoother.square_root import LinearWalk, stack_factors
from tests.online.walks import (
    FOOTFALLS,
    add,
    buffer_of,
    farthest,
    fed,
    in_field,
    known_until,
    solve_in_windows,
    whole,
)
from tests.smoother.walks import FREE, demo, ordering_of, part

BEHIND, WINDOW = 12, 16


@pytest.fixture
def windows(monkeypatch):
    for with_field in (False, True):  # before it sets in
        whole(with_field)
    solve_in_windows(monkeypatch, BEHIND, WINDOW)


@cache
def in_windows(with_field: bool, lag_s: float | None) -> OnlineSmoother:
    return fed(in_field() if with_field else demo(), OnlineOptions(lag_s=lag_s))


@pytest.mark.usefixtures("windows")
@pytest.mark.parametrize("with_field", [False, True])
def test_it_stays_where_the_whole_is(with_field):
    """By its sigmas, which are larger: what a dozen footfalls showed of the sensor is all that it knows of it."""
    online, expected = in_windows(with_field, None), whole(with_field)
    assert online.initial.first > 0
    table, other = online.smoothed(), expected.smoothed()
    np.testing.assert_array_equal(table.sample, other.sample)
    apart = np.abs(table.position - other.position)
    assert (apart <= table.position_sigma).all()
    assert apart[:, :2].max() < (0.7 if with_field else 0.02)
    assert 0.9 < table.heading_sigma[-1] / other.heading_sigma[-1] < 4.0


@pytest.mark.usefixtures("windows")
def test_with_a_lag_it_stays_where_it_is_without():
    online, expected = in_windows(True, 12.0), in_windows(True, None)
    assert online.initial.first > 0
    table, other = online.smoothed(), expected.smoothed()
    np.testing.assert_array_equal(table.sample, other.sample)
    assert farthest(table, other) < 0.10
    np.testing.assert_allclose(table.heading_sigma[-1], other.heading_sigma[-1], rtol=0.1)


@pytest.mark.usefixtures("windows")
def test_anchor_states_behind_footfalls_that_were_taken_back_are_left_out():
    """Also where there are fewer footfalls now than such a handover had."""
    online, starts = in_windows(False, None), in_windows(False, None).anchors
    footfalls = online.footfalls[: starts[-1].stance.number]
    earlier = replace(online.initial, stance=starts[-2].stance)
    kept = window_anchors(starts, earlier, footfalls, None, WINDOW)
    assert [one.stance for one in kept] == [one.stance for one in [*starts[:-1], earlier]]
    # Those are kept that are not farther back than the last one that is a whole window, or a lag, back.
    newest, one = online.initial.stance, starts[-2].stance
    for lag_s, window in ((None, newest.number - one.number), (newest.t - one.t, WINDOW)):
        kept = window_anchors(starts[:-1], online.initial, online.footfalls, lag_s, window)
        assert [anchor.stance for anchor in kept] == [one, newest]


# --- in another process ----------------------------------------------------------------------------------------------


class InPieces:
    """In place of the other process, with samples of its own; calls go through pickle as over a pipe."""

    is_closed = False

    def __init__(self, options, monkeypatch):
        monkeypatch.setattr(resolve, "NICENESS", 0)
        monkeypatch.setattr(resolve, "_solvers", {})
        resolve._set_up({None: options})
        self.pace, self.fails = Pace(), False

    @property
    def buffer(self):
        return resolve._solvers[None].buffer

    def submit(self, *arguments):
        future = Future()
        if self.fails and isinstance(arguments[-1], Task):
            future.set_exception(MemoryError())
        else:
            future.set_result(pickle.loads(pickle.dumps(resolve._run(*pickle.loads(pickle.dumps(arguments))))))
        return future

    def close(self): ...


@pytest.mark.usefixtures("windows")
@pytest.mark.parametrize("lag_s", [None, 12.0])
def test_what_solves_beside_holds_a_window_of_samples_and_says_the_same(monkeypatch, lag_s):
    options, here = OnlineOptions(lag_s=lag_s), in_windows(True, lag_s)
    for owner, context_s in ((smoother, 3.0), (resolve, 3.0), (strides, 2.0)):
        monkeypatch.setattr(owner, "CONTEXT_S", context_s)
    beside, buffer = InPieces(options, monkeypatch), SampleBuffer()
    there = OnlineSmoother(options, buffer, solver=Solver(WalkSolver(options, buffer), beside))
    buffer.append(buffer_of(in_field()).between(0, len(in_field().recording)))
    kept = []
    for k in range(FOOTFALLS):
        add(there, in_field(), k)
        kept.append(known_until(in_field(), k) - beside.buffer.first)
    np.testing.assert_array_equal(here.causal().position, there.causal().position)
    np.testing.assert_array_equal(here.smoothed().pose_cov, there.smoothed().pose_cov)
    assert max(kept[-10:]) / 200.0 < 28.0 < in_field().recording.t[known_until(in_field(), FOOTFALLS - 1)] - 10.0
    assert (buffer.first > 0) == (lag_s is not None)


class Late(Solver):
    """Each of its solutions is there so many footfalls later than it is due."""

    late = 0

    def begin(self, task):
        self._missed = 0
        super().begin(task)

    def is_ready(self):
        self._missed += 1
        return self._missed > self.late


@pytest.mark.usefixtures("windows")
@pytest.mark.parametrize("late", [3, smoother.MAX_LATE + 3])
def test_a_walk_goes_on_without_a_solution_that_is_late(monkeypatch, late):
    """What came in the meantime is added to it when it is there: here, or where it is solved if that is much."""
    usual = in_windows(False, None)
    monkeypatch.setattr(smoother, "FAST", np.inf)
    monkeypatch.setattr(Late, "late", late)
    options, buffer = OnlineOptions(), buffer_of(demo())
    beside = InPieces(options, monkeypatch)
    online = OnlineSmoother(options, buffer, solver=Late(WalkSolver(options, buffer), beside))
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


@pytest.mark.parametrize("case", ["not begun", "answered the first part", "failed"])
def test_what_came_after_a_solution_that_was_late_or_failed_is_not_lost(monkeypatch, case):
    """It is asked for in two parts; what failed beside is solved here, with what was requested after it."""
    told, buffer, remarks = whole(False).footfalls[:20], buffer_of(demo()), []
    here, beside = WalkSolver(OnlineOptions(), buffer), None
    if case == "failed":
        beside = InPieces(OnlineOptions(), monkeypatch)
        beside.fails = True
    solver = Solver(here, beside, remarks.append)
    solver.begin(Task(None, tuple(told[:14]), UNSEEN, since=0))
    if case == "not begun":
        assert here.run(()) is None  # the line at which it begins does not wait for it
    solver.request(told[14:17])
    if case == "answered the first part":
        solver.take()
    solver.request(told[17:])
    anchor = solver.take()
    assert [one.line for one in anchor.footfalls] == list(range(20))
    latest = Window(anchor, PartialWalk(buffer, footfalls=told)).latest
    np.testing.assert_allclose(latest.position, whole(False).smoothed().position[19], atol=0.1)
    assert ["has failed (MemoryError)" in words for words in remarks] == [True] * (case == "failed")
    assert solver.is_here


def test_a_process_beside_says_the_same_and_is_replaced_where_it_dies(monkeypatch, tmp_path):
    """It is killed once it has answered; the walk goes on to the bit, with one remark.

    Modules in the folder that the user is in are none of its own.
    """
    monkeypatch.setattr(smoother, "FAST", 0.0)  # solutions are waited for, however slow the machine
    (tmp_path / "numpy.py").write_text("raise ImportError\n")
    monkeypatch.chdir(tmp_path)
    options, buffer, remarks = OnlineOptions(), buffer_of(demo()), []
    here, process = fed(demo(), options, 32), SolverProcess({None: options})
    solver = Solver(WalkSolver(options, buffer), process, remarks.append)
    assert process.pid is None
    try:
        there = OnlineSmoother(options, buffer, solver=solver)
        for k in range(32):
            if k == 26:
                assert (there.initial.stance.number, remarks) == (19, [])
                os.kill(process.pid, signal.SIGKILL)
            add(there, demo(), k)
    finally:
        solver.close()
    assert ["has died" in words for words in remarks] == [True]
    np.testing.assert_array_equal(here.causal().position, there.causal().position)
    np.testing.assert_array_equal(here.causal().pose_cov, there.causal().pose_cov)
    np.testing.assert_array_equal(here.smoothed().position, there.smoothed().position)


def test_a_process_beside_that_was_stopped_is_not_waited_for_for_ever(monkeypatch):
    monkeypatch.setattr(resolve, "MAX_S", 0.1)
    remarks, process = [], SolverProcess({None: OnlineOptions()})
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
    (words,) = remarks
    assert words.endswith("has not answered for 0 s: this one does its work from here on.")


def test_what_the_machine_takes_is_no_waiting_for_samples(monkeypatch):
    """Else a recording on a slow machine would be taken for a walk in progress, whose solutions are not waited for."""
    clock = iter([0.0, 1.0, 5.0, 6.0, 9.0])
    monkeypatch.setattr(online_buffer.time, "monotonic", lambda: next(clock))
    pace = Pace()
    for _ in range(2):
        with pace:
            pass
    assert pace.idle_s == 2.0


# --- what a window hands over ----------------------------------------------------------------------------------------


KEYS = X(3), V(3), M(2), B(1)
DIMS = 6, 3, 9, 6


def moved(values: gtsam.Values, step: np.ndarray) -> gtsam.Values:
    delta = gtsam.VectorValues()
    for key, one in zip(KEYS, np.split(step, np.cumsum(DIMS)[:-1]), strict=True):
        delta.insert(key, one)
    return values.retract(delta)


@pytest.mark.parametrize("far", [0.0, 0.4])
def test_the_jacobian_of_an_anchor_is_the_derivative_of_its_error(far: float) -> None:
    def error_at(values: gtsam.Values) -> np.ndarray:
        return -np.asarray(factor.linearize(values).jacobian()[1])

    rng = np.random.default_rng(3)
    pose = gtsam.Pose3(gtsam.Rot3.RzRyRx(*rng.normal(size=3)), rng.normal(size=3))
    values = (np.array(pose.matrix()), *(rng.normal(size=d) for d in DIMS[1:]))
    anchor = MarginalPrior(KEYS, values, rng.normal(size=(sum(DIMS), sum(DIMS))))
    factor, there = anchor.factor(), moved(anchor.initial_values(), far * rng.normal(size=sum(DIMS)))
    analytic, h = np.asarray(factor.linearize(there).jacobian()[0]), 1e-5
    steps = h * np.eye(sum(DIMS))
    numeric = [(error_at(moved(there, d)) - error_at(moved(there, -d))) / (2 * h) for d in steps]
    np.testing.assert_allclose(analytic, np.transpose(numeric), atol=1e-6)
    A, b = factor.linearize(anchor.initial_values()).jacobian()  # what was eliminated
    np.testing.assert_allclose(A, anchor.A, atol=1e-12)
    np.testing.assert_allclose(b, 0.0, atol=1e-12)


def test_an_anchor_and_the_strides_behind_it_say_what_the_whole_graph_says() -> None:
    """Of the newest footfall, to the precision of the arithmetic: where it is linearized nothing is lost."""
    walk, at = part(demo(), 16), 9
    found = solve_so_far(walk.recording, walk.stances, OnlineOptions(use_field=False, parameters=FREE)).walk
    stances, values = list_stances(found.problem.nodes, walk.recording.t), found.solved.values
    linear = found.problem.factors().linearize(values)
    past = {key for stance in stances[: at + 1] for key in list_variables(stance, values)}
    before, behind = [], gtsam.GaussianFactorGraph()
    for factor in (linear.at(i) for i in range(linear.size())):
        if set(factor.keys()) <= past:
            before.append(factor)
        else:
            behind.push_back(factor)
    keys, keep = found.problem.time_order.tolist(), list_variables(stances[at], values)
    of_past = np.array([key for key in keys if key in past], dtype=np.uint64)
    root, _ = LinearWalk.of(stack_factors(before), of_past).eliminate()
    behind.push_back(marginalize(root, values, keep).factor().linearize(values))
    later, newest = ordering_of(key for key in keys if key not in past or key in keep), X(stances[-1].result)
    tree = behind.eliminateMultifrontal(later, gtsam.EliminateQR)
    whole = linear.eliminateMultifrontal(ordering_of(keys), gtsam.EliminateQR)
    covariances = [one.marginalCovariance(newest) for one in (tree, whole)]
    np.testing.assert_allclose(*covariances, rtol=1e-6, atol=1e-12)
    assert np.abs(tree.optimize().at(newest)).max() < 1e-3  # the minimum of the whole is that of both parts


def test_an_anchor_state_is_the_newest_estimate_of_the_walk_that_it_leaves_as_it_is() -> None:
    online, other = (fed(in_field(), footfalls=12) for _ in range(2))
    anchor = online.window.to_anchor()
    again = Window(anchor, online.walk).latest
    np.testing.assert_allclose(again.position, online.latest.position, atol=2e-3)
    sigma = np.sqrt(np.diagonal(online.latest.pose_cov))
    assert (np.abs(again.pose_cov - online.latest.pose_cov) < 0.005 * np.outer(sigma, sigma)).all()
    assert len(anchor.past.rows) == anchor.stance.number - anchor.past.first
    short = anchor.without_past()
    assert (short.past.rows, short.footfalls) == ((), anchor.footfalls[-1:])
    np.testing.assert_array_equal(Window(short, online.walk).latest.position, again.position)
    for k in range(12, 15):
        add(online, in_field(), k)
        add(other, in_field(), k)
    np.testing.assert_array_equal(online.smoothed().position, other.smoothed().position)


def past(first: int, names: str, *sample: int) -> Past:
    n = len(sample)
    zero = np.zeros((n, 3))
    nodes = PathNodes(np.array(sample, dtype=np.int64), zero, zero, np.zeros((n, 3, 3)), zero, zero)
    return Past(first, tuple(EstimateRow(np.zeros(1), name, "") for name in names), nodes)


def test_a_later_past_takes_the_place_of_what_it_knows_again() -> None:
    known, later = past(0, "abcd", 0, 9, 10, 19, 20, 29, 30, 39), past(2, "CDE", 21, 28, 30, 39, 40, 49)
    joined = known.join(later)
    assert "".join(row.field for row in joined.rows) == "abCDE"
    assert joined.nodes.sample.tolist() == [0, 9, 10, 19, 20, 21, 28, 30, 39, 40, 49]
    assert known.join(Past(3)).rows == known.rows[:3]
    assert Past().join(known).rows == known.rows
    before = later.before(StanceNodes(3, 8, 10, 8, 0, 0.0, 34, 3.4, (30, 39)))
    assert ([row.field for row in before.rows], before.nodes.sample.tolist()) == (["C"], [21, 28])


def test_the_prior_of_a_pose_has_its_covariance_in_the_walks_axes():
    cov = np.diag([4.0, 1.0, 0.25, 0.01]) + 0.1  # east, north, up and yaw
    pose = gtsam.Pose3(gtsam.Rot3.Ypr(0.5, 0.2, -0.3), np.ones(3))
    found, R = _pose_noise(pose, cov, 0.05).covariance(), pose.rotation().matrix()
    np.testing.assert_allclose(R @ found[3:, 3:] @ R.T, cov[:3, :3], atol=1e-9)
    assert (R @ found[:3, :3] @ R.T)[2, 2] == pytest.approx(0.11)
