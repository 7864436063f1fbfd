"""Length of a step by its opening and its duration: two legs, the walk ratio, and one constant by one distance."""

import numpy as np
import pytest

from fg_nav.errors import EstimationError
from fg_nav.pocket.dead_reckoning import (
    DEFAULT_CONSTANT_M,
    StepLength,
    calibrate_step_length,
    compute_chords,
    measure_steps,
    use_step_constant,
)
from fg_nav.pocket.steps import Steps

OPENINGS = np.radians([30.0, 45.0, 50.0, 60.0])


def make_steps(opening, took_s=0.53):
    """Steps of these openings (S,) rad, of one duration each."""
    number = np.arange(len(opening))
    took = np.broadcast_to(took_s, len(opening))
    return Steps(50 * number, 50 * number + 50, np.asarray(opening), took, number % 2 == 0, np.zeros(len(number), int))


STEPS = make_steps(OPENINGS)


def test_a_chord_is_the_distance_between_the_feet_of_two_straight_legs():
    leg = 0.87
    feet = leg * np.stack([np.sin(OPENINGS / 2), -np.cos(OPENINGS / 2)], axis=1)
    apart = np.linalg.norm(feet - feet * [-1, 1], axis=1)
    np.testing.assert_allclose(leg * compute_chords(OPENINGS), apart, rtol=1e-12)


def test_where_no_opening_is_seen_it_is_the_walk_ratio():
    steps = make_steps(np.full(3, np.nan), np.array([0.4, 0.5, 0.6]))
    cadence = 60.0 / steps.took  # steps/min
    np.testing.assert_allclose(StepLength().predict(steps), 0.0062 * cadence, rtol=1e-12)


def test_it_is_the_mean_of_both():
    by_cadence = measure_steps(make_steps(np.full(4, np.nan)))
    np.testing.assert_allclose(measure_steps(STEPS), 0.5 * (compute_chords(OPENINGS) + by_cadence), rtol=1e-12)


def test_a_usual_step_has_a_usual_length():
    length = StepLength().predict(make_steps(np.radians([46.0])))
    assert length[0] == pytest.approx(0.70, abs=0.02)
    assert DEFAULT_CONSTANT_M * compute_chords(np.radians([46.0]))[0] == pytest.approx(0.70, abs=0.01)


def test_a_known_distance_gives_back_the_constant():
    known = StepLength(0.77).predict(STEPS).sum()
    law = calibrate_step_length(STEPS, known)
    assert law.constant_m == pytest.approx(0.77)
    assert law.sigma < StepLength().sigma
    assert law.predict(STEPS).sum() == pytest.approx(known)


def test_chords_are_right_where_legs_do_not_open_or_open_wide():
    np.testing.assert_allclose(compute_chords(np.array([0.0, np.pi])), [0.0, 2.0])


@pytest.mark.parametrize("distance", [0.0, -3.0, np.nan, np.inf])
def test_no_distance_no_constant(distance):
    with pytest.raises(EstimationError, match="known distance"):
        calibrate_step_length(STEPS, distance)


def test_no_step_no_constant():
    with pytest.raises(EstimationError, match="no step"):
        calibrate_step_length(make_steps(np.zeros(0)), 10.0)


@pytest.mark.parametrize("constant", [0.1, 3.0, np.nan, -0.9])
def test_a_constant_that_is_no_persons_is_refused(constant):
    with pytest.raises(EstimationError, match=r"no person's"):
        use_step_constant(constant)
    with pytest.raises(EstimationError, match="known distance"):
        calibrate_step_length(STEPS, 1000.0)
