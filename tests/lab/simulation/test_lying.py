"""A sensor on a table: it goes nowhere, and everything it reads is the Earth's or its own."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.errors import SimulationError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.lab.simulation import SCENARIOS, Choices, simulate
from fg_nav.lab.simulation.plan import Stand

MINUTE = replace(SCENARIOS["at-rest"], route=lambda rng: [Stand(40.0), Stand(20.0)])


def test_an_ideal_sensor_reads_gravity_and_the_field_in_one_attitude():
    walk = simulate(MINUTE, 1, Choices(sensor="ideal"))
    recording, truth = walk.recording, walk.recording.truth
    assert recording.duration_s == pytest.approx(60.0, abs=0.01)
    np.testing.assert_array_equal(recording.gyr, 0.0)
    np.testing.assert_array_equal(truth.position, 0.0)
    np.testing.assert_allclose(
        truth.nav_R_body @ recording.acc[0], np.tile([0, 0, GRAVITY_M_S2], (len(truth.t), 1)), atol=1e-12
    )
    assert 0.0 < np.degrees(np.arccos(truth.nav_R_body[0, 2, 2])) < 3.0
    assert len(walk.strides) == 0
    assert walk.flat is None


def test_each_seed_lies_on_a_table_of_its_own():
    one, other = (simulate(MINUTE, seed, Choices(sensor="ideal")).recording.acc[0] for seed in (1, 2))
    assert np.abs(one - other).max() > 1e-3


def test_a_table_that_walks_is_refused():
    with pytest.raises(SimulationError, match="on a table goes nowhere"):
        simulate("demo", 1, Choices(worn="table"))


def test_a_foot_at_rest_all_the_time_is_no_walk():
    with pytest.raises(SimulationError, match="no strides"):
        simulate("at-rest", 1, Choices(worn="heel"))
