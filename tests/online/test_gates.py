"""Every gate of the field judges while the walk goes on as it does in batch on the same footfalls, and weighs by it."""

import numpy as np
import pytest

from fg_nav.detection.causal import join_footfalls
from fg_nav.magnetic.detectors import GATES, HARD, NO_GATE, QUASI_STATIC, apply_gate
from fg_nav.online import OnlineNavigator
from fg_nav.online.buffer import OnlineOptions, rows_of
from fg_nav.online.resolve import measure_online_field
from fg_nav.smoother.parameters import FieldParameters, SmootherParameters
from tests.online.walks import push, short_walk


@pytest.mark.parametrize("gate", GATES)
def test_a_gate_judges_a_walk_in_progress(gate):
    parameters = SmootherParameters(magnetic=FieldParameters(gate=gate))
    navigator = OnlineNavigator(OnlineOptions(heading_rad=0.0, parameters=parameters))
    push(navigator, rows_of(short_walk(8)))
    navigator.close()
    found = navigator.finish()
    assert np.isfinite(found.stances.position).all()
    # on the same footfalls, with the attitudes of the batch
    recording = navigator.recording()
    stances = join_footfalls(navigator.footfalls, len(recording))
    field = measure_online_field(recording, stances, navigator.options).field
    assert field is not None
    passed = np.array([word == QUASI_STATIC for word in found.stances.field])
    expected = np.array([word == QUASI_STATIC for word in apply_gate(field, gate).words])
    assert (passed == expected[: len(passed)]).mean() > 0.75
    assert passed.any()
    assert passed.all() or gate != NO_GATE
    weight = found.stances.compass_weight
    assert weight is not None
    assert ((weight >= 0.0) & (weight <= 1.0)).all()
    if gate == NO_GATE or gate.endswith(HARD):
        np.testing.assert_allclose(weight, passed, atol=1e-9)  # all alike, or the papers' switch
    else:
        assert (weight > 0.0).sum() >= passed.sum()
