"""A graph without a solution: wherever it shows, `push` raises nothing, and the track goes on with larger sigmas."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import gtsam
import numpy as np
import pytest

from fg_nav.errors import EstimationError
from fg_nav.online import OnlineNavigator, smoother, window
from fg_nav.online.buffer import rows_of
from fg_nav.online.navigator import finish_walk
from fg_nav.online.smoother import OnlineSmoother
from fg_nav.online.window import Window
from fg_nav.smoother import SmootherParameters
from tests.online.walks import NORTH, push, short_walk, solve_only_at

BEGINS = 7  # Footfall at which it begins to fail, behind the last solution of the whole in these tests.


@pytest.fixture(autouse=True)
def solved_early(monkeypatch):
    solve_only_at(monkeypatch, 1, 2, 3, 4)


@pytest.fixture(scope="module")
def undisturbed():
    with pytest.MonkeyPatch.context() as patched:
        solve_only_at(patched, 1, 2, 3, 4)
        return walked().causal()


DEFAULT = SmootherParameters()
QUIET = replace(DEFAULT, gyr_density_deg_s=0.015)
"""Noise of the simulated gyroscope: with that of a shoe the walk shows less of the bias than a second of rest."""


def walked(
    remark: Callable[[str], None] = lambda words: None,
    heading_rad: float | None = 0.0,
    standing_s: float = 0.0,
    parameters: SmootherParameters = DEFAULT,
    ends: bool = True,
) -> OnlineNavigator:
    options = replace(NORTH, heading_rad=heading_rad, parameters=parameters)
    navigator = OnlineNavigator(options, remark)
    rows = stand_on(rows_of(short_walk()), standing_s)
    push(navigator, rows, range(40, len(rows), 40))
    if ends:
        navigator.close()
    return navigator


def stand_on(rows: np.ndarray, seconds: float) -> np.ndarray:
    """Rows of a walk whose foot stands on at its end, at 100 Hz."""
    n, rng = round(100.0 * seconds), np.random.default_rng(1)
    more = np.repeat(rows[-100:].mean(axis=0)[None], n, axis=0)
    more[:, 1:10] += rng.normal(0.0, np.repeat([0.01, 0.001, 0.3], 3), (n, 9))
    more[:, 0] = rows[-1, 0] + 0.01 * np.arange(1, n + 1)
    return np.concatenate([rows, more])


class Failing:
    """Breaks a function from footfall `BEGINS` on: for so many footfalls, or so many calls of one footfall."""

    def __init__(
        self,
        monkeypatch,
        footfalls: int = 1,
        calls: int = 10**9,
        begins: int = BEGINS,
    ):
        self._monkeypatch = monkeypatch
        self._footfalls, self._calls = range(begins, begins + footfalls), calls
        self._now, self.failed = -1, 0
        add = OnlineSmoother.add_footfall

        def counted(smoother: OnlineSmoother, *given):
            self._now, self._left = smoother.n_reported, self._calls
            try:
                return add(smoother, *given)
            finally:
                self._now = -1

        monkeypatch.setattr(OnlineSmoother, "add_footfall", counted)

    def breaks(self, place: object, name: str, instead: Callable | None = None) -> None:
        whole = getattr(place, name)

        def failing(*given, **named):
            if self._now in self._footfalls and self._left > 0:
                self._left -= 1
                self.failed += 1
                if instead is None:
                    raise RuntimeError("Indeterminate linear system detected")
                return instead(whole(*given, **named))
            return whole(*given, **named)

        self._monkeypatch.setattr(place, name, failing)


def goes_on(navigator: OnlineNavigator, expected, least_growth: float) -> None:
    """All footfalls given, finite; sigmas grow where it failed, and the strides behind that are those of the walk."""
    table = navigator.causal()
    assert len(table) == len(expected)
    for column in (table.position, table.position_cov, table.heading_sigma, table.gyro_bias_sigma, table.nav_R_body):
        assert np.isfinite(column).all()
    sigma = table.position_sigma.max(axis=1)
    assert sigma[BEGINS] > least_growth * sigma[BEGINS - 1]
    assert sigma[-1] > 0.9 * expected.position_sigma[-1].max()
    smoothed = navigator.smoothed()
    # As smoothed: positions of the moment, where a heading that was lost is found bit by bit, are not one path.
    stride = np.linalg.norm(np.diff(smoothed.position[BEGINS + 3 :], axis=0), axis=1)
    usual = np.linalg.norm(np.diff(expected.position[BEGINS + 3 :], axis=0), axis=1)
    np.testing.assert_allclose(stride, usual, atol=0.15)
    np.testing.assert_array_equal(smoothed.sample, table.sample)
    assert np.isfinite(smoothed.position).all()
    assert (smoothed.heading_sigma > 0.0).all()
    assert np.isfinite(navigator.finish().position).all()


NOT_A_NUMBER = partial(np.full_like, fill_value=np.nan)


@pytest.mark.parametrize(
    ("place", "name", "footfalls", "calls", "instead", "growth"),
    [
        (Window, "_update", 1, 1, None, 1.0),  # the equations of a footfall
        (gtsam.ISAM2, "update", 1, 2, None, 1.0),  # and those of the graph that begins again
        (gtsam.ISAM2, "marginalCovariance", 1, 1, None, 1.0),
        (gtsam.ISAM2, "marginalCovariance", 1, 1, NOT_A_NUMBER, 1.0),
        (window, "initialize_stride", 1, 2, None, 6.0),  # nor has the stride alone: sigmas of a second unseen
        (window, "initialize_stride", 3, 2, None, 6.0),
    ],
)
def test_what_of_a_footfall_has_no_solution(monkeypatch, undisturbed, place, name, footfalls, calls, instead, growth):
    fault = Failing(monkeypatch, footfalls, calls)
    fault.breaks(place, name, instead)
    navigator = walked()
    assert fault.failed == footfalls * calls
    goes_on(navigator, undisturbed, growth)
    if name == "_update":
        assert navigator.causal().field_reason[BEGINS] == window.REASON
    if growth > 1.0:
        assert navigator.causal().heading_sigma[BEGINS] > 0.4


def test_a_rest_of_an_update_that_failed_is_counted_with_the_next(monkeypatch):
    usual = walked(standing_s=6.0, parameters=QUIET)
    first = next(k for k, footfall in enumerate(usual.footfalls) if footfall.continues)
    fault = Failing(monkeypatch, calls=1, begins=first)
    fault.breaks(Window, "_update")
    found, expected = (n.causal().gyro_bias_sigma[:, 0] for n in (walked(standing_s=6.0, parameters=QUIET), usual))
    assert fault.failed == 1
    assert found[first] > 1.1 * expected[first]  # two seconds show little beyond the standing before: slow sway
    assert expected[first + 1] <= found[first + 1] < 1.27 * expected[first + 1]


def test_the_smoothed_past_is_returned_though_it_cannot_be_solved(monkeypatch, undisturbed):
    navigator = walked(ends=False)
    expected = navigator.smoothed()

    def never(*_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(window, "find_minimum", never)
    told = navigator.smoothed()
    np.testing.assert_allclose(told.position, expected.position, atol=0.05)
    begun = navigator.smoother.initial.stance.number  # What is before it is known already.
    assert begun < len(told) - 1
    reported = navigator.causal()  # Those without a solution are as they were reported at the moment.
    np.testing.assert_array_equal(told.position[begun + 1 :], reported.position[begun + 1 :])
    np.testing.assert_array_equal(told.position_sigma[begun + 1 :], reported.position_sigma[begun + 1 :])
    assert np.isfinite(told.position_sigma).all()

    def no_batch(*_: object) -> None:
        raise RuntimeError("Indeterminate linear system detected\nand more")

    monkeypatch.setattr("fg_nav.online.navigator.smooth", no_batch)
    ended = finish_walk(navigator, polish=True)
    assert any("Indeterminate" in note and "more" not in note for note in ended.notes)
    assert np.isfinite(ended.position).all()


@pytest.mark.parametrize(("fails", "lost"), [((1, 2), 2), ((3, 4), 0)], ids=["the first", "later ones"])
def test_a_solution_of_the_whole_that_is_not_found_is_left_out(monkeypatch, undisturbed, fails, lost):
    """A walk begins where it can: the first two footfalls cannot be leveled, say."""
    solve, calls = smoother.solve_from_start, []

    def failing(*given):
        calls.append(0)
        if len(calls) in fails:
            raise EstimationError("it has no up.")
        return solve(*given)

    monkeypatch.setattr(smoother, "solve_from_start", failing)
    told = []
    navigator = walked(told.append)
    assert ["does not begin yet" in words for words in told] == [True] * (lost > 0)
    table, expected = navigator.causal(), undisturbed
    assert (lost > 0) <= len(expected) - len(table) <= lost
    assert np.isfinite(table.position).all()
    stride, usual = (np.linalg.norm(np.diff(one.position[-6:], axis=0), axis=1) for one in (table, expected))
    np.testing.assert_allclose(stride, usual, atol=0.1)
    assert np.isfinite(navigator.finish().position).all()
