"""The tables of the papers: every row can be measured, and a reason is given only where it was looked at."""

import math

import pytest

from fg_nav.lab.campaign.methods import method_of
from fg_nav.lab.reproduce.munoz_diaz2017 import MEASURES, OWN
from fg_nav.lab.reproduce.munoz_diaz2017.walks import list_cases
from fg_nav.lab.reproduce.results import PAPERS, Line, Reason, Spread, Table, read_table


@pytest.mark.parametrize("paper", PAPERS)
def test_every_row_has_a_name_of_its_own_a_column_and_reasons_that_are_there(paper):
    table = read_table(paper)
    assert table.paper == paper
    used = set()
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


@pytest.mark.parametrize("paper", ["ma2018", "aiez2017"])
def test_every_method_is_one_of_the_campaigns(paper):
    for method in read_table(paper).methods:
        assert method_of(method).base


def test_a_row_of_the_pocket_is_read_off_a_case_that_its_judge_solves():
    by_name = {case.name: case for case in list_cases(quick=False)}
    quick = {case.name for case in list_cases(quick=True)}
    for planned in read_table("munoz-diaz2017").experiments:
        for line in planned.lines([""]):
            if line.measure[0] not in OWN:
                assert line.measure[0] in MEASURES
                assert line.judged in by_name[line.of].by
                assert line.paper is None or {line.of, line.over or line.of} <= quick


@pytest.mark.parametrize(
    ("field", "off", "why"),
    [("a", 2.0, "so"), ("a", -2.0, ""), ("b", 2.0, ""), ("a", math.inf, ""), ("c", -1.0, "too")],
)
def test_a_reason_is_given_where_it_was_looked_at_and_nowhere_else(field, off, why):
    reasons = (Reason("one", "above", "a"), Reason("two", field="c"))
    line = Line("figure", paper=10.0, judged="filter", level=field, reasons=reasons)
    table = Table("x", "", (), (), {"one": "so", "two": "too"})
    median = 10.0 + off
    assert table.judge(line, {"filter": Spread(median, median, median, 1)}).why == why
