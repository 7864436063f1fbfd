"""A graph without a solution: wherever it shows, `push` raises nothing, and the track goes on with larger sigmas."""

from collections.abc import Callable
from dataclasses import replace

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
        error: type[Exception] = RuntimeError,
        begins: int = BEGINS,
    ):
        self._monkeypatch, self._error = monkeypatch, error
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
                    raise self._error("Indeterminate linear system detected")
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


@pytest.mark.parametrize("error", [RuntimeError, ValueError, np.linalg.LinAlgError])
def test_the_equations_of_a_footfall_have_no_solution(monkeypatch, undisturbed, error):
    fault = Failing(monkeypatch, calls=1, error=error)
    fault.breaks(Window, "_update")
    navigator = walked()
    assert fault.failed == 1
    goes_on(navigator, undisturbed, 1.0)
    assert navigator.causal().field_reason[BEGINS] == window.REASON


def test_the_uncertainty_about_north_outlasts_a_recovery(monkeypatch):
    """Of a heading that was not given: as much of it, and once."""
    expected = walked(heading_rad=None).causal()
    fault = Failing(monkeypatch, calls=1)
    fault.breaks(Window, "_update")
    found = walked(heading_rad=None).causal()
    assert fault.failed == 1
    # A footfall that had no solution shows nothing more of north than those before it.
    least, most = expected.heading_sigma[BEGINS], expected.heading_sigma[BEGINS - 1]
    assert 0.95 * least < found.heading_sigma[BEGINS] < 1.05 * most
    assert np.degrees(expected.heading_sigma[BEGINS]) > 0.1


def test_a_rest_of_an_update_that_failed_is_counted_with_the_next(monkeypatch):
    """The first piece of the standing at the end fails; the second shows what both show, and shows it once."""
    usual = walked(standing_s=6.0, parameters=QUIET)
    first = next(k for k, footfall in enumerate(usual.footfalls) if footfall.continues)
    fault = Failing(monkeypatch, calls=1, begins=first)
    fault.breaks(Window, "_update")
    found, expected = (n.causal().gyro_bias_sigma[:, 0] for n in (walked(standing_s=6.0, parameters=QUIET), usual))
    assert fault.failed == 1
    assert found[first] > 1.1 * expected[first]  # two seconds show little beyond the standing before: slow sway
    assert expected[first + 1] <= found[first + 1] < 1.27 * expected[first + 1]


@pytest.mark.parametrize("footfalls", [1, 3])
def test_nothing_of_a_footfall_has_a_solution(monkeypatch, undisturbed, footfalls):
    """Nor the stride alone: then it goes on with the sigmas of a person who was not seen in that second."""
    fault = Failing(monkeypatch, footfalls)
    fault.breaks(window, "initialize_stride")
    navigator = walked()
    assert fault.failed == 2 * footfalls
    goes_on(navigator, undisturbed, 5.0)
    assert navigator.causal().heading_sigma[BEGINS] > 0.4


@pytest.mark.parametrize("calls", [1, 2])
def test_an_update_and_that_of_the_graph_that_begins_again_have_no_solution(monkeypatch, undisturbed, calls):
    fault = Failing(monkeypatch, calls=calls)
    fault.breaks(gtsam.ISAM2, "update")
    goes_on(walked(), undisturbed, 1.0)
    assert fault.failed == calls


@pytest.mark.parametrize("instead", [None, lambda found: np.full_like(found, np.nan)])
def test_a_covariance_is_not_found_or_is_no_number(monkeypatch, undisturbed, instead):
    fault = Failing(monkeypatch, calls=1)
    fault.breaks(gtsam.ISAM2, "marginalCovariance", instead)
    goes_on(walked(), undisturbed, 1.0)
    assert fault.failed == 1


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


def test_a_solution_of_the_whole_that_is_not_found_is_left_out(monkeypatch, undisturbed):
    solve, calls = smoother.solve_from_start, []

    def failing(*given):
        calls.append(0)
        if len(calls) in (3, 4):
            raise RuntimeError("Indeterminate linear system detected")
        return solve(*given)

    monkeypatch.setattr(smoother, "solve_from_start", failing)
    navigator = walked()
    assert len(navigator.causal()) == len(undisturbed)
    np.testing.assert_allclose(navigator.causal().position, undisturbed.position, atol=0.5)


def test_a_walk_begins_where_it_can(monkeypatch, undisturbed):
    """The first two footfalls cannot be leveled, say; the third is the first."""
    solve, calls = smoother.solve_from_start, []

    def failing(*given):
        calls.append(0)
        if len(calls) <= 2:
            raise EstimationError("it has no up.")
        return solve(*given)

    monkeypatch.setattr(smoother, "solve_from_start", failing)
    told = []
    navigator = walked(told.append)
    assert len(told) == 1
    assert "does not begin yet" in told[0]
    table, expected = navigator.causal(), undisturbed
    assert 0 < len(expected) - len(table) <= 2
    assert np.isfinite(table.position).all()
    stride, usual = (np.linalg.norm(np.diff(one.position[-6:], axis=0), axis=1) for one in (table, expected))
    np.testing.assert_allclose(stride, usual, atol=0.1)
    assert np.isfinite(navigator.finish().position).all()
