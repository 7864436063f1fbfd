"""What a verdict says: passes, fails, or is none."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.magnetic import FieldVerdicts
from fg_nav.magnetic.quasi_static import DISTURBED, GATES, NO_GATE, QUASI_STATIC, UNKNOWN, apply_gate, count_needed
from tests.magnetic.fields import footfalls, still


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


@pytest.mark.parametrize("gate", GATES)
def test_a_verdict_needs_the_latest_footfalls_only(gate):
    """A walk in progress judges each footfall by these; in batch it is the same verdict."""
    rng, field = np.random.default_rng(0), footfalls(still(40), rate=np.arange(40) % 3)
    changes = np.where(rng.uniform(size=(40, 1)) < 0.3, 6.0, 0.1) * rng.standard_normal((40, 3))
    field = replace(field, body_field=np.where((np.arange(40) % 11 == 5)[:, None], np.nan, field.body_field + changes))
    batch, needed = apply_gate(field, gate), count_needed(gate)
    for k in range(len(field)):
        first = 0 if needed is None else max(0, k + 1 - needed)
        online = apply_gate(field.select(slice(first, k + 1)), gate)
        if needed is None or k + 1 >= needed:
            assert online.words[-1] == batch.words[k]
            assert online.reason[-1] == batch.reason[k]
    assert set(batch.words) >= {QUASI_STATIC, UNKNOWN}
    assert gate in (NO_GATE, "aiez-printed") or DISTURBED in batch.words
