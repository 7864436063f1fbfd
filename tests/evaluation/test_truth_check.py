"""A truth that cannot be of a walk is refused in one sentence, before the walk is solved."""

from pathlib import Path

import numpy as np
import pytest

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
