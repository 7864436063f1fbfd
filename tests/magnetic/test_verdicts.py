"""What a verdict says: passes, fails, or is none."""

import numpy as np
import pytest

from fg_nav.magnetic import FieldVerdicts


def verdicts(*statistic):
    return FieldVerdicts("qsf", np.array(statistic, dtype=float), 7.0, tuple("x" for _ in statistic))


def test_below_one_the_field_passes_and_where_there_is_none_it_does_not():
    found = verdicts(np.nan, 0.0, 0.999, 1.0, 3.0)
    assert found.judged.tolist() == [False, True, True, True, True]
    assert found.quasi_static.tolist() == [False, True, True, False, False]
    assert found.words == ("none", "quasi-static", "quasi-static", "disturbed", "disturbed")
    assert len(found) == 5


def test_coverage_is_a_share_of_all_footfalls_judged_or_not():
    assert verdicts(np.nan, 0.5, 0.5, 2.0).coverage == pytest.approx(0.5)
    assert verdicts(np.nan, np.nan).coverage == 0.0
    assert verdicts().coverage == 0.0
