"""Length of a step by its opening: the geometry of two legs, and one constant by one distance."""

import numpy as np
import pytest

from fg_nav.errors import EstimationError
from fg_nav.pocket.dead_reckoning import StepLength, calibrate_step_length, compute_chords, use_step_constant

OPENINGS = np.radians([30.0, 45.0, 50.0, 60.0])


def test_it_is_the_distance_between_the_feet_of_two_straight_legs():
    leg = 0.87
    feet = leg * np.stack([np.sin(OPENINGS / 2), -np.cos(OPENINGS / 2)], axis=1)
    apart = np.linalg.norm(feet - feet * [-1, 1], axis=1)
    np.testing.assert_allclose(StepLength(leg).predict(OPENINGS), apart, rtol=1e-12)


def test_a_usual_step_has_a_usual_length():
    assert 0.65 < StepLength().predict(np.radians([46.0]))[0] < 0.75


def test_a_known_distance_gives_back_the_constant():
    known = StepLength(0.77).predict(OPENINGS).sum()
    law = calibrate_step_length(OPENINGS, known)
    assert law.constant_m == pytest.approx(0.77)
    assert law.sigma < StepLength().sigma
    assert law.predict(OPENINGS).sum() == pytest.approx(known)


def test_chords_are_right_where_legs_do_not_open_or_open_wide():
    np.testing.assert_allclose(compute_chords(np.array([0.0, np.pi])), [0.0, 2.0])


@pytest.mark.parametrize("distance", [0.0, -3.0, np.nan, np.inf])
def test_no_distance_no_constant(distance):
    with pytest.raises(EstimationError, match="known distance"):
        calibrate_step_length(OPENINGS, distance)


def test_no_step_no_constant():
    with pytest.raises(EstimationError, match="no step"):
        calibrate_step_length(np.zeros(0), 10.0)


@pytest.mark.parametrize("constant", [0.1, 3.0, np.nan, -0.9])
def test_a_constant_that_is_no_persons_is_refused(constant):
    with pytest.raises(EstimationError, match=r"no person's"):
        use_step_constant(constant)
    with pytest.raises(EstimationError, match="known distance"):
        calibrate_step_length(OPENINGS, 1000.0)
