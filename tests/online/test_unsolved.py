"""A graph without a solution: wherever it shows, `push` raises nothing, and the track goes on with larger sigmas."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import gtsam
import numpy as np
import pytest

from fg_nav.errors import EstimationError
from fg_nav.online import OnlineNavigator, smoother, window
from fg_nav.online import navigator as navigator_module
from fg_nav.online.buffer import rows_of
from fg_nav.online.navigator import finish_walk
from fg_nav.online.smoother import OnlineSmoother
from fg_nav.online.window import Window
from fg_nav.smoother.strides import WALKING_M_S, walk_for
from tests.online.walks import NORTH, push, short_walk, solve_only_at, spoil, walked

BEGINS = 7  # Footfall at which it begins to fail, behind the last solution of the whole in these tests.
SOLVED = 1, 2, 3, 4  # Footfalls.


@pytest.fixture(autouse=True)
def solved_early(monkeypatch):
    solve_only_at(monkeypatch, *SOLVED)


@pytest.fixture(scope="module")
def undisturbed():
    with pytest.MonkeyPatch.context() as patched:
        solve_only_at(patched, *SOLVED)
        return walk().causal()


def walk(rows: np.ndarray | None = None, remark: Callable[[str], None] = lambda words: None, **more) -> OnlineNavigator:
    rows = rows_of(short_walk()) if rows is None else rows
    return walked(rows, replace(NORTH, **more), remark, range(40, len(rows), 40))[0]


def break_at(monkeypatch, place: object, name: str, footfalls=1, calls=10**9, instead=None, begins=BEGINS) -> list[int]:
    """Break a function from a footfall on: for so many footfalls, and so many calls of each; of which it failed."""
    usual, added, failed = getattr(place, name), spoil(monkeypatch, OnlineSmoother, "add_footfall"), []

    def failing(*given, **named):
        now = len(added) - 1
        if now not in range(begins, begins + footfalls) or failed.count(now) >= calls:
            return usual(*given, **named)
        failed.append(now)
        if instead is None:
            raise RuntimeError("Indeterminate linear system detected")
        return instead(usual(*given, **named))

    monkeypatch.setattr(place, name, failing)
    return failed


NOT_A_NUMBER = partial(np.full_like, fill_value=np.nan)


@pytest.mark.parametrize(
    ("place", "name", "footfalls", "calls", "instead"),
    [
        (Window, "_update", 1, 1, None),  # the equations of a footfall
        (gtsam.ISAM2, "update", 1, 2, None),  # and those of the graph that begins again
        (gtsam.ISAM2, "marginalCovariance", 1, 1, None),
        (gtsam.ISAM2, "marginalCovariance", 1, 1, NOT_A_NUMBER),
        (window, "initialize_stride", 1, 2, None),  # nor has the stride alone
        (window, "initialize_stride", 3, 2, None),
    ],
)
def test_what_of_a_footfall_has_no_solution(monkeypatch, undisturbed, place, name, footfalls, calls, instead):
    """All footfalls given, finite; sigmas grow where it failed, and the strides behind that are those of the walk."""
    failed = break_at(monkeypatch, place, name, footfalls, calls, instead)
    navigator = walk()
    assert len(failed) == footfalls * calls
    table, smoothed = navigator.causal(), navigator.smoothed()
    assert len(table) == len(undisturbed)
    for column in (table.position, table.position_cov, table.heading_sigma, table.gyro_bias_sigma, table.nav_R_body):
        assert np.isfinite(column).all()
    variance = table.position_sigma[:, :2] ** 2
    grown, t = np.sqrt(variance[BEGINS] - variance[BEGINS - 1]), short_walk().t
    if place is window:  # Of a person who walked unseen from the end of one stance to the middle of the next.
        before, now = navigator.footfalls[BEGINS - 1 : BEGINS + 1]
        since = np.array([t[now.start[0]] - t[before.stop[-1]], table.t[BEGINS] - table.t[BEGINS - 1]])
        least, most = WALKING_M_S * walk_for(since)
        assert least < grown.min() < grown.max() < most
        assert table.heading_sigma[BEGINS] > 0.4
    assert table.position_sigma[-1].max() > 0.9 * undisturbed.position_sigma[-1].max()
    # As smoothed: positions of the moment, where a heading that was lost is found bit by bit, are not one path.
    stride, usual = (
        np.linalg.norm(np.diff(one.position[BEGINS + 3 :], axis=0), axis=1) for one in (smoothed, undisturbed)
    )
    np.testing.assert_allclose(stride, usual, atol=0.15)
    np.testing.assert_array_equal(smoothed.sample, table.sample)
    assert np.isfinite(smoothed.position).all()
    assert (smoothed.heading_sigma > 0.0).all()
    assert np.isfinite(navigator.finish().position).all()
    if name == "_update":
        assert table.field_reason[BEGINS] == window.REASON


def test_a_rest_of_an_update_that_failed_is_counted_with_the_next(monkeypatch):
    # The foot stands on at the end of the walk; with the noise of a shoe it shows less of the bias than a second of it.
    rows, rng = rows_of(short_walk()), np.random.default_rng(1)
    more = np.repeat(rows[-100:].mean(axis=0)[None], 600, axis=0)
    more[:, 1:10] += rng.normal(0.0, np.repeat([0.01, 0.001, 0.3], 3), (600, 9))
    more[:, 0] = rows[-1, 0] + 0.01 * np.arange(1, 601)
    given = np.concatenate([rows, more]), replace(NORTH.parameters, gyr_density_deg_s=0.015)
    usual = walk(given[0], parameters=given[1])
    first = next(k for k, footfall in enumerate(usual.footfalls) if footfall.continues)
    failed = break_at(monkeypatch, Window, "_update", calls=1, begins=first)
    found, expected = (n.causal().gyro_bias_sigma[:, 0] for n in (walk(given[0], parameters=given[1]), usual))
    assert failed == [first]
    assert found[first] > 1.1 * expected[first]  # two seconds show little beyond the standing before: slow sway
    assert expected[first + 1] <= found[first + 1] < 1.27 * expected[first + 1]


def test_the_smoothed_past_is_returned_though_it_cannot_be_solved(monkeypatch):
    navigator, rows = OnlineNavigator(NORTH), rows_of(short_walk())
    push(navigator, rows, range(40, len(rows), 40))
    expected = navigator.smoothed()
    spoil(monkeypatch, window, "find_minimum", lambda *_: True, ZeroDivisionError())
    told = navigator.smoothed()
    np.testing.assert_allclose(told.position, expected.position, atol=0.05)
    begun = navigator.smoother.initial.stance.number  # What is before it is known already.
    assert begun < len(told) - 1
    reported = navigator.causal()  # Those without a solution are as they were reported at the moment.
    np.testing.assert_array_equal(told.position[begun + 1 :], reported.position[begun + 1 :])
    np.testing.assert_array_equal(told.position_sigma[begun + 1 :], reported.position_sigma[begun + 1 :])
    assert np.isfinite(told.position_sigma).all()
    error = RuntimeError("Indeterminate linear system detected\nand more")
    spoil(monkeypatch, navigator_module, "smooth", lambda *_: True, error)
    ended = finish_walk(navigator, polish=True)
    assert any("Indeterminate" in note and "more" not in note for note in ended.notes)
    assert np.isfinite(ended.position).all()


@pytest.mark.parametrize(("fails", "lost"), [((1, 2), 2), ((3, 4), 0)], ids=["the first", "later ones"])
def test_a_solution_of_the_whole_that_is_not_found_is_left_out(monkeypatch, undisturbed, fails, lost):
    """A walk begins where it can: the first two footfalls cannot be leveled, say."""
    error, told = EstimationError("it has no up."), list[str]()
    spoil(monkeypatch, smoother, "solve_from_start", lambda number, *_: number in fails, error)
    navigator = walk(remark=told.append)
    assert ["does not begin yet" in words for words in told] == [True] * (lost > 0)
    table = navigator.causal()
    assert (lost > 0) <= len(undisturbed) - len(table) <= lost
    assert np.isfinite(table.position).all()
    stride, usual = (np.linalg.norm(np.diff(one.position[-6:], axis=0), axis=1) for one in (table, undisturbed))
    np.testing.assert_allclose(stride, usual, atol=0.1)
    assert np.isfinite(navigator.finish().position).all()
