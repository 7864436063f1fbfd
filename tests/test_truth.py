"""A truth or fixes that cannot be of a walk, its clock, its start or its path are refused in one sentence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fg_nav.errors import EstimationError, EvaluationError
from fg_nav.evaluation.comparison import compare, match_footprints
from fg_nav.evaluation.metrics import evaluate
from fg_nav.online.buffer import OnlineOptions
from fg_nav.pipeline import prepare_walk
from fg_nav.recording import Recording
from fg_nav.truth import (
    Fix,
    FixColumns,
    FootprintTruth,
    TrajectoryTruth,
    check_fixes,
    check_fixes_on_path,
    check_truth,
    find_turn,
)
from fg_nav.walk import Options, Walk, add_known
from tests.evaluation.walks import solution
from tests.io.samples import tilting

FIX_T = np.arange(0.0, 100.0, 0.01)


def fix(time_s: float, x: float, y: float = 0.0, z: float = 0.0, sigma: float = 0.1, vertical: float = np.inf) -> Fix:
    return Fix(time_s, np.array([x, y, z]), sigma, vertical)


def test_true_fixes_pass_whatever_their_order_and_those_of_a_lift() -> None:
    walked = [fix(80.0, 90.0), fix(30.0, 40.0), fix(30.2, 40.0, sigma=5.0), fix(90.0, 90.0, z=120.0, vertical=1.0)]
    check_fixes(walked, FIX_T)
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
            check_fixes(fixes, FIX_T)


def test_a_fix_is_no_farther_than_what_was_walked_or_could_have_been_in_a_gap() -> None:
    # places in degrees pass by time alone; so does another walk's
    t, path = np.array([0.0, 50.0, 99.0]), np.outer([0.0, 20.0, 40.0], [1.0, 0.0, 0.0])
    for far in ([fix(60.0, 11.6, 48.1)], [fix(60.0, 24.0), fix(70.0, 60.0)]):
        check_fixes(far, FIX_T)
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


T = np.arange(0.0, 20.0, 0.1)
PATH = np.column_stack([1.3 * T, np.sin(T), 0.05 * np.sin(9.0 * T)])
JUMPED = PATH + 500.0 * (np.arange(len(T)) == 70)[:, None]
STRIDES = np.arange(0, 16, 5)
PRINTS = np.column_stack([1.3 * STRIDES, np.sin(STRIDES)])
OFTEN = np.arange(0.0, 20.0, 0.005)


@pytest.mark.parametrize(
    ("truth", "words"),
    [
        (TrajectoryTruth(T, 1000.0 * PATH), "faster than anyone runs: it seems to be in mm, divide by 1000"),
        (TrajectoryTruth(T, JUMPED), "m/s from 6.000 s on, faster than anyone runs: correct that row"),
        (TrajectoryTruth(T, 1e300 * PATH), "faster than anyone runs: correct that row"),
        (TrajectoryTruth(T, 1e-5 * PATH + [11.5, 48.1, 500.0]), "give places in m, not degrees"),
        (TrajectoryTruth(T, np.ones_like(PATH)), "moves by 0 m over ground in the 19.9 s"),
        (TrajectoryTruth(1000.0 * OFTEN, np.outer(OFTEN, [1.3, 0.0, 0.0])), "stamps in s of the recording's clock"),
        (FootprintTruth(STRIDES, 1000.0 * PRINTS, None), "farther than anyone runs: it seems to be in mm"),
        (FootprintTruth(STRIDES, 1e200 * PRINTS, None), "farther than anyone runs: correct that row"),
        (FootprintTruth(STRIDES, 1e-5 * PRINTS, None), "give their places in m, not degrees"),
        (FootprintTruth(100 * STRIDES, PRINTS, None), "counts 1500 strides, and in 19.9 s a foot makes at most 63"),
        (FootprintTruth(STRIDES, PRINTS, 10**9), "counts 1000000000 strides"),
    ],
    ids=lambda one: one[:40] if isinstance(one, str) else "",
)
def test_what_no_one_walks(truth, words):
    for possible in (TrajectoryTruth(T, PATH), FootprintTruth(STRIDES, PRINTS, 15)):
        check_truth(possible, T)
    with pytest.raises(EvaluationError, match=words):
        check_truth(truth, T)


def test_footprints_are_not_matched_over_a_hundred_strides():
    with pytest.raises(EvaluationError, match="counts 115 strides, and 15 were found, too many apart"):
        match_footprints(np.zeros((16, 2)), FootprintTruth(STRIDES, PRINTS, 115))


def test_a_named_truth_is_judged_before_the_walk_is_solved():
    recording = Recording.from_raw(tilting(np.random.default_rng(3), duration_s=3.0))
    path = np.column_stack([1000.0 * recording.t, recording.t, recording.t])
    walk = Walk.of(recording, Options(truth_path=Path("truth.tum")))
    for t, words in ((recording.t, "faster than anyone"), (recording.t + 1e9, "share no time")):
        with pytest.raises(EvaluationError, match=words):
            prepare_walk(Walk(recording, walk.stances, TrajectoryTruth(t, path), walk.options))


def test_a_truth_in_feet_is_remarked_on():
    found = solution(T, PATH)
    assert not evaluate(found, TrajectoryTruth(T, PATH)).notes
    notes = evaluate(found, TrajectoryTruth(T, 3.28 * PATH)).notes
    assert notes == ("the truth is 3.3 times as large as the path: check its unit, and that it is of this walk",)
    with pytest.raises(EvaluationError, match="divide by 1000"):
        compare(found, TrajectoryTruth(T, 1000.0 * PATH))
