"""Verdicts and spreads: what the words must mean."""

import math

import pytest

from fg_nav.lab.reproduce.results import Row, Spread, format_note, format_printed, format_spread, spread_of


def row(median, paper=1.0, **more):
    more = {"good": -1, **more}
    return Row("figure", "m", "1", {"filter": Spread(median, median, median, 5)}, paper, "filter", **more)


@pytest.mark.parametrize(
    ("median", "more", "verdict"),
    [
        (1.39, {}, "reproduced"),
        (0.5, {}, "better"),
        (0.5, {"good": 0}, "missed"),
        (0.5, {"good": 0, "why": "kinder"}, "missed (explained)"),
        (1.5, {"why": "rougher"}, "missed (explained)"),
        (1.5, {}, "missed"),
        (1.0, {"bound": 1}, "reproduced"),
        (1.01, {"bound": 1}, "missed"),
        (0.99, {"bound": -1, "good": 1}, "missed"),
        (1.2, {"whose": "input"}, "put in"),
        (1.6, {"whose": "input", "why": "drawn"}, "missed (explained)"),
        (0.9, {"bound": 1, "whose": "asked"}, "as asked"),
        (1.1, {"bound": 1, "whose": "asked"}, "short"),
        (math.nan, {"why": "none"}, ""),
    ],
)
def test_a_verdict_is_what_its_word_says(median, more, verdict):
    assert row(median, **more).verdict == verdict


def test_a_reason_stands_beside_a_difference_only():
    assert format_note(row(1.5, why="rougher")) == "rougher"
    assert format_note(row(1.0, why="rougher")) == ""


def test_a_tolerance_of_its_own_is_shown_beside_the_printed_figure():
    assert format_printed(row(1.0)) == "1"
    assert format_printed(row(1.0, tolerance=0.15)) == "1 (within 15 %)"
    assert format_printed(row(1.0, tolerance=0.15, bound=1)) == "1"
    assert format_printed(row(1.0, paper=None, tolerance=0.15)) == "1"


@pytest.mark.parametrize("more", [{}, {"bound": -1}, {"bound": -1, "good": 1}, {"good": 1}])
def test_a_method_that_failed_reproduces_nothing_and_is_not_better(more):
    assert row(math.inf, **more).verdict == "missed"


def test_of_walks_of_which_half_failed_the_median_failed():
    assert spread_of([1.0, math.inf]).median == math.inf
    assert spread_of([1.0, 2.0, math.inf]).median == 2.0
    assert spread_of([1.0, 2.0, 3.0]).median == 2.0
    assert spread_of([3.0, math.inf, 1.0, 2.0]) == Spread(3.0, 1.0, math.inf, 4)
    assert math.isnan(spread_of([]).median)


def test_how_many_values_there_were_is_shown_where_they_are_not_the_walks():
    one = Row("figure", "m", "1", {"filter": Spread(2.0, 2.0, 2.0, 10)})
    assert format_spread(one, "filter", 50) == "2.00 (n 10)"
    assert format_spread(one, "filter", 10) == "2.00"
