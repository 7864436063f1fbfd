"""Tables of the papers, verdicts, spreads, and the file: what the words must mean."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from pydantic import TypeAdapter

from fg_nav.errors import OutputError
from fg_nav.lab.campaign.methods import method_of
from fg_nav.lab.reproduce.munoz_diaz2017 import OWN, read_run_figure
from fg_nav.lab.reproduce.munoz_diaz2017.walks import list_cases
from fg_nav.lab.reproduce.results import (
    PAPERS,
    Line,
    Reason,
    Row,
    Spread,
    Table,
    describe_counts,
    format_note,
    format_printed,
    format_seeds,
    format_spread,
    read_reproduction,
    read_table,
    spread_of,
    write_reproduction,
)
from fg_nav.lab.store.results import Number, encode_number
from tests.lab.reproduce.made import reproduction
from tests.lab.reproduce.stored_walks import run_with, setting_with

INF = math.inf


def row(median, paper=1.0, **more):
    more = {"good": -1, **more}
    return Row("figure", "m", "1", {"filter": Spread(median, median, median, 5)}, paper, "filter", **more)


VERDICTS = [
    (1.39, {}, "reproduced"),
    (0.5, {}, "better"),
    (0.5, {"good": 0}, "missed"),
    (0.5, {"good": 0, "why": "kinder"}, "missed (explained)"),
    (1.5, {"why": "rougher"}, "missed (explained)"),
    (1.41, {}, "missed"),
    (1.5, {"good": 1}, "better"),
    (1.0, {"bound": 1}, "reproduced"),
    (1.01, {"bound": 1}, "missed"),
    (0.99, {"bound": -1, "good": 1}, "missed"),
    (1.2, {"whose": "input"}, "put in"),
    (1.6, {"whose": "input", "why": "drawn"}, "missed (explained)"),
    (0.9, {"bound": 1, "whose": "asked"}, "as asked"),
    (1.1, {"bound": 1, "whose": "asked"}, "short"),
    (math.nan, {"why": "none"}, ""),
    # A method that failed reproduces nothing and is not better.
    *((INF, more, "missed") for more in ({}, {"bound": -1}, {"bound": -1, "good": 1}, {"good": 1})),
]


def test_a_verdict_is_what_its_word_says():
    for median, more, verdict in VERDICTS:
        assert row(median, **more).verdict == verdict, (median, more)
    assert row(1.0, paper=None).verdict == ""


def test_reasons_and_tolerances_stand_where_they_say_something():
    assert format_note(row(1.5, why="rougher")) == "rougher"
    assert format_note(row(1.0, why="rougher")) == ""
    for more, words in (
        ({}, "1"),
        ({"tolerance": 0.15}, "1 (within 15 %)"),
        ({"tolerance": 0.15, "bound": 1}, "1"),
        ({"tolerance": 0.15, "paper": None}, "1"),
    ):
        assert format_printed(row(1.0, **more)) == words


def test_medians_and_spreads_with_what_failed_and_how_many_there_were():
    assert spread_of([1.0, INF]).median == INF
    assert spread_of([1.0, 2.0, INF]).median == 2.0
    assert spread_of([3.0, INF, 1.0, 2.0]) == Spread(3.0, 1.0, INF, 4)
    assert spread_of([*range(101)]) == Spread(50.0, 5.0, 95.0, 101)
    assert math.isnan(spread_of([]).median)
    spreads = {
        "one": Spread(2.0, 2.0, 2.0, 10),
        "a": spread_of([1.0, INF, INF]),
        "b": spread_of([1.0, 2.0]),
        "c": spread_of([]),
    }
    shown = Row("figure", "min", "1", spreads)
    assert [format_spread(shown, "one", walks) for walks in (50, 10)] == ["2.00 (n 10)", "2.00"]
    assert format_spread(shown, "a", 3) == "never (1.00 to never)"
    assert format_spread(shown, "b", 3) == "1.50 (1.05 to 1.95, n 2)"
    assert format_spread(shown, "c", 3) == format_spread(shown, "none", 3) == "-"
    assert format_spread(replace(shown, unit="m"), "a", 3) == "failed (1.00 to failed)"
    assert format_spread(replace(shown, unit=""), "a", 3) == "infinite (1.00 to infinite)"


def test_seeds_and_counts_are_shown(tmp_path):
    found = reproduction(tmp_path)
    assert format_seeds(found) == "101 to 103"
    assert format_seeds(replace(found, seeds=(101, 104))) == "101, 104"
    assert describe_counts(replace(found, experiments=())) == "0 figures compared: none compared."
    put_in = replace(found.experiments[0], rows=(row(1.0, whose="input"), row(1.0)))
    said = describe_counts(replace(found, experiments=(put_in,)))
    assert said == "1 figures compared: 1 reproduced. Beside these, 1 put in."


# --- the file --------------------------------------------------------------------------------------------------------


def test_the_file_comes_back_as_it_was(tmp_path):
    found = reproduction(tmp_path)
    (tmp_path / "a.json").write_text(write_reproduction(found))
    again = read_reproduction(tmp_path / "a.json")
    lists = str.maketrans({"[": "(", "]": ")", ",": None})
    assert repr(again).translate(lists) == repr(found).translate(lists)  # NaN is NaN, and a list is a tuple
    assert write_reproduction(again) == write_reproduction(found)
    never = again.experiments[0].rows[4].ours["filter"]
    assert (never.median, never.low) == (INF, 10.0)
    verdicts = [one["verdict"] for one in json.loads(write_reproduction(found))["experiments"][0]["rows"]]
    assert verdicts == [one.verdict for one in found.experiments[0].rows]
    for value in (1.5, -INF, INF, math.nan):
        text = json.dumps(encode_number(value), allow_nan=False)
        assert repr(TypeAdapter(Number).validate_python(json.loads(text))) == repr(value)


def test_what_is_no_result_is_refused_in_one_sentence(tmp_path):
    for text in ("", "[]", "{}", '{"form": 0}', '{"form": 2, "seeds": [1]}'):
        (tmp_path / "a.json").write_text(text)
        with pytest.raises(OutputError, match="is no result of"):
            read_reproduction(tmp_path / "a.json")


# --- the tables of the papers ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("paper", PAPERS)
def test_every_row_has_a_name_of_its_own_a_column_and_reasons_that_are_there(paper):
    table, used = read_table(paper), set()
    assert table.paper == paper
    assert all(method_of(method).base for method in table.methods)
    for planned in table.experiments:
        lines = planned.lines(table.fields)
        assert len({line.quantity for line in lines}) == len(lines)
        for line in lines:
            assert line.judged in planned.columns
            assert line.paper is None or line.printed
            assert not planned.scenario or not line.of or set(table.filters[line.of]) <= set(planned.columns)
            used |= {one.because for one in line.reasons}
            assert {one.field for one in line.reasons} <= {"", *table.fields}
    assert used == set(table.reasons)


def test_a_row_of_the_pocket_is_read_off_a_case_that_its_judge_solves():
    by_name = {case.name: case for case in list_cases(quick=False)}
    quick = {case.name for case in list_cases(quick=True)}
    run = run_with(range(61))
    setting = setting_with(run, legs=np.zeros(1, int))
    for planned in read_table("munoz-diaz2017").experiments:
        for line in planned.lines([""]):
            what, *given = line.measure
            if what not in OWN:
                numbers = ["xyz".index(one) if isinstance(one, str) else one for one in given]
                assert isinstance(read_run_figure(what, run, setting, *numbers), float)
                assert line.judged in by_name[line.of].by
                assert line.paper is None or {line.of, line.over or line.of} <= quick


def test_a_reason_is_given_where_it_was_looked_at_and_nowhere_else():
    reasons = (Reason("one", "above", "a"), Reason("two", field="c"))
    table = Table("x", "", (), (), {"one": "so", "two": "too"})
    for level, off, why in (("a", 2.0, "so"), ("a", -2.0, ""), ("b", 2.0, ""), ("a", INF, ""), ("c", -1.0, "too")):
        line = Line("figure", paper=10.0, judged="filter", level=level, reasons=reasons)
        median = 10.0 + off
        assert table.judge(line, {"filter": Spread(median, median, median, 1)}).why == why
