"""The person between two feet, whose paths are given."""

import numpy as np
import pytest

from fg_nav.feet import Side
from fg_nav.feet.person import trace_person
from fg_nav.solution import Solution, StanceTable
from tests.feet.walks import truth_of

SPEED = 1.3
HOLE = (20.0, 35.0)


def true_foot(side: Side, kept: tuple[tuple[float, float], ...]) -> Solution:
    """A foot that was recorded during some spans, and is where it is; a footfall each second."""
    truth = truth_of(side)
    rows = np.flatnonzero(np.any([(truth.t >= begin) & (truth.t <= end) for begin, end in kept], axis=0))
    t, position = truth.t[rows], truth.position[rows]
    velocity = np.gradient(truth.position, truth.t, axis=0)[rows]
    sample = np.arange(0, len(t), 200)
    count = len(sample)
    table = StanceTable(
        sample, t[sample], position[sample], np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3)),
        np.tile(np.eye(3), (count, 1, 1)), np.ones(count), np.zeros((count, 3)), ("none",) * count, ("",) * count,
    )  # fmt: skip
    return Solution("smoother", t, position, velocity, np.tile(np.eye(3), (len(t), 1, 1)), table, 0.0)


Spans = tuple[tuple[float, float], ...]
WHOLE: Spans = ((0.0, 60.0),)
BROKEN: Spans = ((0.0, HOLE[0]), (HOLE[1], 60.0))


def trace(left: Spans, right: Spans) -> Solution:
    feet = true_foot("right", right), true_foot("left", left)
    return trace_person(*feet, np.zeros(1), 4.0 * np.eye(4)[None])


@pytest.mark.parametrize(("left", "right"), [(WHOLE, BROKEN), (BROKEN, WHOLE)])
def test_in_a_hole_of_one_foot_the_person_goes_on_as_the_other_one(left: Spans, right: Spans) -> None:
    whole, person = trace(WHOLE, WHOLE), trace(left, right)
    assert np.diff(person.t).max() < 0.02
    outside = (person.t < HOLE[0]) | (person.t > HOLE[1])
    same = np.stack([np.interp(person.t, whole.t, column) for column in whole.position.T], axis=1)
    apart = np.linalg.norm(person.position - same, axis=1)
    assert apart[outside].max() < 1e-6
    assert 0.05 < apart[~outside].max() < 0.6  # a foot is ahead of the person, or behind, by half a step
    assert apart[~outside].mean() < 0.3
    # and moves as the foot that was recorded
    moved = np.linalg.norm(np.diff(person.position[~outside][:, :2], axis=0), axis=1).sum()
    assert moved == pytest.approx(SPEED * (HOLE[1] - HOLE[0]), rel=0.25)
    # with the footfalls of that one, as uncertain as it and half of what both differ by
    assert np.diff(person.stances.t).max() < 1.5
    np.testing.assert_allclose(person.stances.pose_cov, np.tile(2.0 * np.eye(4), (len(person.stances), 1, 1)))


def test_what_the_feet_differ_by_is_known_between_the_times_it_is_given_for_in_any_order() -> None:
    feet = true_foot("right", WHOLE), true_foot("left", WHOLE)
    t, size = np.array([10.0, 50.0, 30.0]), np.array([1.0, 1.0, 5.0])
    person = trace_person(*feet, t, size[:, None, None] * np.eye(4))
    expected = 1.0 + 0.25 * np.interp(person.stances.t, [10.0, 30.0, 50.0], [1.0, 5.0, 1.0])
    np.testing.assert_allclose(person.stances.position_cov[:, 2, 2], expected)


def test_where_neither_was_recorded_nothing_is_made_up() -> None:
    person = trace(BROKEN, BROKEN)
    assert np.diff(person.t).max() == pytest.approx(HOLE[1] - HOLE[0], abs=0.02)
