"""What a verdict says: passes, fails, or is none."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.ekf.presets import find_parameters
from fg_nav.errors import MagneticError
from fg_nav.magnetic import DETECTORS, FieldVerdicts
from fg_nav.magnetic.detectors import (
    DISTURBED,
    GATES,
    HARD,
    NO_GATE,
    PRIOR_COUNT,
    QUASI_STATIC,
    UNKNOWN,
    apply_gate,
    count_needed,
    find_gate,
    weigh_statistic,
)
from tests.magnetic.fields import footfalls, still


def verdicts(*statistic):
    return FieldVerdicts("qsf", np.array(statistic, dtype=float), 7.0, tuple("x" for _ in statistic))


def test_below_one_the_field_passes_and_where_there_is_none_it_does_not():
    found = verdicts(np.nan, 0.0, 0.999, 1.0, 3.0)
    assert found.judged.tolist() == [False, True, True, True, True]
    assert found.quasi_static.tolist() == [False, True, True, False, False]
    assert found.words == ("none", "quasi-static", "quasi-static", "disturbed", "disturbed")
    assert found.coverage == pytest.approx(2 / 5)  # of all footfalls, judged or not
    assert verdicts(np.nan, np.nan).coverage == verdicts().coverage == 0.0


@pytest.mark.parametrize("gate", GATES)
def test_a_verdict_needs_the_latest_footfalls_only(gate):
    """A walk in progress judges each footfall by these; in batch it is the same verdict."""
    rng, field = np.random.default_rng(0), footfalls(still(40), rate=np.arange(40) % 3)
    changes = np.where(rng.uniform(size=(40, 1)) < 0.3, 20.0, 0.1) * rng.standard_normal((40, 3))
    field = replace(field, body_field=np.where((np.arange(40) % 11 == 5)[:, None], np.nan, field.body_field + changes))
    batch, needed = apply_gate(field, gate), count_needed(gate)
    for k in range(len(field)):
        first = 0 if needed is None else max(0, k + 1 - needed)
        online = apply_gate(field.select(slice(first, k + 1)), gate)
        if needed is None or k + 1 >= needed:
            assert online.words[-1] == batch.words[k]
            assert online.reason[-1] == batch.reason[k]
    assert set(batch.words) >= {QUASI_STATIC, UNKNOWN}
    assert gate == NO_GATE or DISTURBED in batch.words


SOFT = [gate for gate in GATES if gate in DETECTORS]


@pytest.mark.parametrize("gate", SOFT)
def test_the_variance_grows_with_the_statistic_from_footfall_to_footfall_and_without_a_step(gate):
    """It is the walk's at the median, in whatever unit; never none; and the walk's where nothing was judged."""
    statistic = np.linspace(0.0, 4.0, 401)
    weight = weigh_statistic(verdicts(*statistic), gate)
    np.testing.assert_allclose(weigh_statistic(verdicts(*40.0 * statistic), gate), weight)
    assert weight[200] == pytest.approx(1.0)
    steps = np.diff(weight)
    assert (steps > 0.0).all()
    np.testing.assert_allclose(steps, steps[0])
    count = find_gate(gate).window * len(find_gate(gate).channels)
    assert weight[0] == pytest.approx(PRIOR_COUNT / (PRIOR_COUNT + count))
    assert weigh_statistic(verdicts(np.nan, 1.0, 2.0, 3.0), gate)[[0, 2]].tolist() == [1.0, 1.0]
    for none in (verdicts(), verdicts(np.nan, np.nan), verdicts(0.0, 0.0, 0.0)):
        assert weigh_statistic(none, gate).tolist() == [1.0] * len(none)


def test_a_statistic_of_few_changes_says_less_than_one_of_many():
    found = verdicts(1.0, 1.0, 1.0, 9.0)
    stance, curve = (weigh_statistic(found, gate)[-1] for gate in ("qsf-stance", "iqsf"))
    assert 1.0 < stance < curve < 9.0


def test_a_hard_gate_uses_the_compass_at_its_full_weight_or_not_at_all_and_no_gate_all_of_it():
    for name in DETECTORS:
        weight = weigh_statistic(verdicts(np.nan, 0.2, 0.999, 1.0, 50.0), name + HARD)
        assert weight.tolist() == [np.inf, 1.0, 1.0, np.inf, np.inf]
    assert weigh_statistic(apply_gate(footfalls(still(5)), NO_GATE), NO_GATE).tolist() == [1.0] * 5
    assert weigh_statistic(verdicts(np.nan, 0.1, 7.0), NO_GATE).tolist() == [1.0] * 3


def test_a_gate_is_the_detector_of_the_filter_of_its_name():
    for name in ("qsf", "iqsf", "ma2018", "aiez", "qsf-stance"):
        assert find_gate(name) == find_gate(name + HARD) == find_parameters(name, "tuned").detector
    for gate in (NO_GATE, HARD, "no such gate", "no such gate" + HARD):
        with pytest.raises(MagneticError, match="there is no detector"):
            find_gate(gate)
