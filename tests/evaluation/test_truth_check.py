"""A truth that cannot be of a walk is refused in one sentence, before the walk is solved."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fg_nav.arrays import Floats
from fg_nav.errors import EvaluationError
from fg_nav.evaluation.comparison import compare, match_footprints
from fg_nav.evaluation.metrics import evaluate
from fg_nav.pipeline import prepare_walk
from fg_nav.recording import Recording
from fg_nav.truth import FootprintTruth, TrajectoryTruth, check_truth
from fg_nav.walk import Options, Walk
from tests.evaluation.walks import solution
from tests.io.samples import tilting

T = np.arange(0.0, 20.0, 0.1)
PATH = np.column_stack([1.3 * T, np.sin(T), 0.05 * np.sin(9.0 * T)])
STRIDES = np.arange(0, 16, 5)
PRINTS = np.column_stack([1.3 * STRIDES, np.sin(STRIDES)])


def with_jump(path: Floats) -> Floats:
    jumped = path.copy()
    jumped[70] += 500.0
    return jumped


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda path: 1000.0 * path, "faster than anyone runs: it seems to be in mm, divide by 1000"),
        (with_jump, "m/s from 6.000 s on, faster than anyone runs: correct that row"),
        (lambda path: 1e300 * path, "faster than anyone runs: correct that row"),
        (lambda path: 1e-5 * path + [11.5, 48.1, 500.0], "give places in m, not degrees"),
        (np.ones_like, "moves by 0 m over ground in the 19.9 s"),
    ],
    ids=["mm", "jump", "absurd", "degrees", "constant"],
)
def test_a_path_that_no_one_walks(change: Callable[[Floats], Floats], words: str) -> None:
    check_truth(TrajectoryTruth(T, PATH), T)
    with pytest.raises(EvaluationError, match=words):
        check_truth(TrajectoryTruth(T, change(PATH)), T)


def test_a_clock_in_ms_shows_in_the_time_that_both_share() -> None:
    often = np.arange(0.0, 20.0, 0.005)
    with pytest.raises(EvaluationError, match="stamps in s of the recording's clock"):
        check_truth(TrajectoryTruth(1000.0 * often, np.outer(often, [1.3, 0.0, 0.0])), T)


@pytest.mark.parametrize(
    ("stride", "xy", "count", "words"),
    [
        (STRIDES, 1000.0 * PRINTS, None, "farther than anyone runs: it seems to be in mm"),
        (STRIDES, 1e200 * PRINTS, None, "farther than anyone runs: correct that row"),
        (STRIDES, 1e-5 * PRINTS, None, "give their places in m, not degrees"),
        (100 * STRIDES, PRINTS, None, "counts 1500 strides, and in 19.9 s a foot makes at most 63"),
        (STRIDES, PRINTS, 10**9, "counts 1000000000 strides"),
    ],
    ids=["mm", "absurd", "degrees", "numbers", "count"],
)
def test_footprints_that_no_one_leaves(stride: Floats, xy: Floats, count: int | None, words: str) -> None:
    check_truth(FootprintTruth(STRIDES, PRINTS, 15), T)
    with pytest.raises(EvaluationError, match=words):
        check_truth(FootprintTruth(stride, xy, count), T)


def test_footprints_are_not_matched_over_a_hundred_strides() -> None:
    with pytest.raises(EvaluationError, match="counts 115 strides, and 15 were found, too many apart"):
        match_footprints(np.zeros((16, 2)), FootprintTruth(STRIDES, PRINTS, 115))


def test_a_named_truth_is_judged_before_the_walk_is_solved() -> None:
    recording = Recording.from_raw(tilting(np.random.default_rng(3), duration_s=3.0))
    path = np.column_stack([1000.0 * recording.t, recording.t, recording.t])
    walk = Walk.of(recording, Options(truth_path=Path("truth.tum")))
    for t, words in ((recording.t, "faster than anyone"), (recording.t + 1e9, "share no time")):
        with pytest.raises(EvaluationError, match=words):
            prepare_walk(Walk(recording, walk.stances, TrajectoryTruth(t, path), walk.options))


def test_a_truth_in_feet_is_remarked_on() -> None:
    found = solution(T, PATH)
    assert not evaluate(found, TrajectoryTruth(T, PATH)).notes
    notes = evaluate(found, TrajectoryTruth(T, 3.28 * PATH)).notes
    assert notes == ("the truth is 3.3 times as large as the path: check its unit, and that it is of this walk",)
    with pytest.raises(EvaluationError, match="divide by 1000"):
        compare(found, TrajectoryTruth(T, 1000.0 * PATH))
