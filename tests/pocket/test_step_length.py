"""Length of a step by its opening and its duration: two legs, the walk ratio, and one constant by one distance."""

import numpy as np
import pytest

from fg_nav.errors import EstimationError
from fg_nav.pocket.dead_reckoning import (
    StepLength,
    calibrate_step_length,
    compute_chords,
    measure_steps,
    use_step_constant,
)
from fg_nav.pocket.steps import Steps

OPENINGS = np.radians([0.0, 30.0, 45.0, 50.0, 60.0, 180.0])


def make_steps(opening, took_s=0.53):
    """Steps of these openings (S,) rad, of one duration each."""
    number = np.arange(len(opening))
    took = np.broadcast_to(took_s, len(opening))
    return Steps(50 * number, 50 * number + 50, np.asarray(opening), took, number % 2 == 0, np.zeros(len(number), int))


STEPS = make_steps(OPENINGS)


def test_a_length_is_the_mean_of_the_chord_of_two_straight_legs_and_the_walk_ratio():
    feet = np.stack([np.sin(OPENINGS / 2), -np.cos(OPENINGS / 2)], axis=1)
    apart = np.linalg.norm(feet - feet * [-1, 1], axis=1)
    np.testing.assert_allclose(compute_chords(OPENINGS), apart, rtol=1e-12)
    unseen = make_steps(np.full(3, np.nan), np.array([0.4, 0.5, 0.6]))
    np.testing.assert_allclose(StepLength().predict(unseen), 0.0062 * 60.0 / unseen.took, rtol=1e-12)
    by_cadence = measure_steps(make_steps(np.full(len(OPENINGS), np.nan)))
    np.testing.assert_allclose(measure_steps(STEPS), 0.5 * (apart + by_cadence), rtol=1e-12)
    assert StepLength().predict(make_steps(np.radians([46.0])))[0] == pytest.approx(0.70, abs=0.02)  # a usual step


def test_a_known_distance_gives_back_the_constant():
    known = StepLength(0.77).predict(STEPS).sum()
    law = calibrate_step_length(STEPS, known)
    assert law.constant_m == pytest.approx(0.77)
    assert law.sigma < StepLength().sigma
    assert law.predict(STEPS).sum() == pytest.approx(known)


def test_what_no_person_walks_is_refused():
    for distance in (0.0, -3.0, np.nan, np.inf, 1000.0):
        with pytest.raises(EstimationError, match="known distance"):
            calibrate_step_length(STEPS, distance)
    with pytest.raises(EstimationError, match="no step"):
        calibrate_step_length(make_steps(np.zeros(0)), 10.0)
    for constant in (0.1, 3.0, np.nan):
        with pytest.raises(EstimationError, match="no person's"):
            use_step_constant(constant)
