"""A seed is one walk to the last bit, and another seed another one: person, sensor, path, field and noise."""

import numpy as np
import pytest

from fg_nav.lab.simulation import SCENARIOS, Choices, simulate

RATE_HZ = 41.0  # Quick for all scenarios, and fast enough that a lost sample leaves no gap.

LARGE = {"office", "office-open", "mall", "mall-open"}
"""Whose building takes seconds to draw; other scenarios have one too."""


def simulated(name, seed):
    walk = simulate(name, seed, Choices(rate_hz=RATE_HZ, field="homogeneous" if name in LARGE else None))
    return walk, walk.recording


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_seed_is_one_walk_and_another_seed_another(name):
    (walk, one), (_, again), (other_walk, other) = (simulated(name, seed) for seed in (5, 5, 6))
    # the same seed: all columns to the bit
    for column in ("t", "acc", "gyr", "mag"):
        np.testing.assert_array_equal(getattr(one, column), getattr(again, column))
    np.testing.assert_array_equal(one.truth.position, again.truth.position)
    np.testing.assert_array_equal(one.truth.nav_R_body, again.truth.nav_R_body)
    # another seed: noise, attitude of the sensor, biases
    n = min(len(one), len(other), 50)
    assert (one.gyr[:n] != other.gyr[:n]).any(axis=1).all()
    assert (one.acc[:n] != other.acc[:n]).any(axis=1).all()
    assert not np.allclose(one.truth.nav_R_body[0], other.truth.nav_R_body[0], atol=1e-4)
    assert walk.drawn != other_walk.drawn
    if len(walk.strides):
        # person and path
        k = min(len(walk.strides), len(other_walk.strides))
        assert (walk.strides.duration[:k] != other_walk.strides.duration[:k]).mean() > 0.9
        assert np.linalg.norm(walk.strides.footprint[1:k] - other_walk.strides.footprint[1:k], axis=1).min() > 1e-6
        assert np.abs(walk.strides.footprint[:k] - other_walk.strides.footprint[:k]).max() > 0.02


def test_another_seed_is_another_field():
    (one, _), (other, _) = (simulated("demo", seed) for seed in (5, 6))
    place = np.array([[0.5, 1.0, 0.1], [2.0, 3.0, 0.1], [-1.0, 5.0, 0.1]]) + one.origin
    assert np.linalg.norm(one.field.at(place) - other.field.at(place), axis=1).min() > 0.1
    np.testing.assert_array_equal(one.field.at(place), simulated("demo", 5)[0].field.at(place))
