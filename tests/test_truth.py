"""Fixes that contradict each other, the clock, the start or the path are refused in one sentence."""

from __future__ import annotations

import numpy as np
import pytest

from fg_nav.errors import EstimationError
from fg_nav.online.buffer import OnlineOptions
from fg_nav.pipeline import prepare_walk
from fg_nav.recording import Recording
from fg_nav.truth import Fix, FixColumns, check_fixes, check_fixes_on_path, find_turn
from fg_nav.walk import Walk, add_known
from tests.io.samples import tilting

T = np.arange(0.0, 100.0, 0.01)


def fix(time_s: float, x: float, y: float = 0.0, z: float = 0.0, sigma: float = 0.1, vertical: float = np.inf) -> Fix:
    return Fix(time_s, np.array([x, y, z]), sigma, vertical)


def test_true_fixes_pass_whatever_their_order_and_those_of_a_lift() -> None:
    walked = [fix(80.0, 90.0), fix(30.0, 40.0), fix(30.2, 40.0, sigma=5.0), fix(90.0, 90.0, z=120.0, vertical=1.0)]
    check_fixes(walked, T)
    check_fixes([])
    path = np.outer([0.0, 39.0, 89.0, 90.0], [1.0, 0.0, 0.0])
    check_fixes_on_path(walked, np.array([0.0, 30.0, 80.0, 99.0]), path, np.zeros(4))


def test_a_third_of_the_fixes_off_by_fifty_sigmas_moves_a_walk_by_a_tenth_of_one() -> None:
    k, sigma_m = np.arange(40.0), 0.01
    walked = np.column_stack([k, 5.0 * np.sin(0.3 * k)])
    place = -walked + np.outer(k % 3 == 0, [50.0 * sigma_m, 0.0])  # turned by half a turn
    turn, shift = find_turn(walked, FixColumns(k, place, np.full(40, sigma_m)))
    assert abs(turn) == pytest.approx(np.pi)
    assert np.linalg.norm(shift) < 0.1 * sigma_m


def test_fixes_that_cannot_be() -> None:
    for fixes, words in (
        ([fix(50.0, 0.0), fix(50.5, 1000.0)], "50.50 s is 1000 m from that at 50.00 s, in 0.5 s, faster than anyone"),
        ([fix(50.0, 0.0), fix(50.0, 5.0)], "is 5 m from that at 50.00 s"),
        ([fix(50.0, 0.0), fix(50.1, 0.0, sigma=99.0), fix(50.2, 80.0)], "50.20 s is 80 m from that at 50.00 s"),
        ([fix(10.0, 300.0)], "300 m from the start, in 10 s"),
        ([fix(10.0, 11.6, 48.1, 520.0, vertical=0.1)], "522.3 m from the start"),
        ([fix(150.0, 0.0)], "is outside the walk"),
        ([fix(50.0, 1e300)], "cannot be: give its place within 1e[+]07 m"),
        ([fix(50.0, 1.0, sigma=1e300)], "a sigma from 0.0001 to 1e[+]07 m"),
        ([fix(50.0, np.nan)], "finite position"),
    ):
        with pytest.raises(EstimationError, match=rf"^[^\n]*{words}[^\n]*$"):
            check_fixes(fixes, T)


def test_a_fix_is_no_farther_than_what_was_walked_or_could_have_been_in_a_gap() -> None:
    # places in degrees pass by time alone; so does another walk's
    t, path = np.array([0.0, 50.0, 99.0]), np.outer([0.0, 20.0, 40.0], [1.0, 0.0, 0.0])
    for far in ([fix(60.0, 11.6, 48.1)], [fix(60.0, 24.0), fix(70.0, 60.0)]):
        check_fixes(far, T)
        with pytest.raises(EstimationError, match="m were walked: give places in m from the start"):
            check_fixes_on_path(far, t, path, np.zeros(3))
    # ten seconds without samples, in which the path stays where it was
    t, path, unseen_s = np.array([0.0, 50.0, 60.0, 99.0]), np.zeros((4, 3)), np.array([0.0, 0.0, 10.0, 10.0])
    check_fixes_on_path([fix(61.0, 60.0)], t, path, unseen_s)
    with pytest.raises(EstimationError, match="0 m were walked"):
        check_fixes_on_path([fix(49.0, 60.0)], t, path, unseen_s)


def test_fixes_are_judged_before_the_walk_is_solved_and_before_a_stream_begins() -> None:
    recording = Recording.from_raw(tilting(np.random.default_rng(3), duration_s=3.0))
    walk = add_known(Walk.of(recording), None, None, [fix(1.0, 1000.0)])
    with pytest.raises(EstimationError, match="1000 m from the start"):
        prepare_walk(walk)
    with pytest.raises(EstimationError, match="faster than anyone runs"):
        OnlineOptions(fixes=(fix(1.0, 0.0), fix(1.5, 1000.0)))
