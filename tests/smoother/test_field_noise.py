"""Roughness of a field, measured on deviations of which it is known."""

import numpy as np
import pytest

from fg_nav.arrays import Floats
from fg_nav.smoother.roughness import (
    FEWEST,
    NOTHING_KNOWN_M,
    Roughness,
    robust_sigma,
    roughness_of,
    roughness_of_regions,
)

LEAST_UT = 0.2
STRIDE_M = 1.3
SEEDS = range(40)


def drawn(rng: np.random.Generator, sigma: float, length_m: float, distance_m: Floats) -> Floats:
    """(F,) a stationary process of this spread and correlation length at F places along a way."""
    x = np.empty(len(distance_m) + 1)
    x[0] = sigma * rng.standard_normal()
    for k, d in enumerate(distance_m):
        left = np.exp(-d / length_m)
        x[k + 1] = left * x[k] + sigma * np.sqrt(1 - left**2) * rng.standard_normal()
    return x


def strides(rng: np.random.Generator, count: int) -> Floats:
    return STRIDE_M * (1 + 0.1 * rng.uniform(-1, 1, count))


def found(seed: int, sigma: float, length_m: float, count: int = 400) -> Roughness:
    rng = np.random.default_rng(seed)
    distance = strides(rng, count)
    values = drawn(rng, sigma, length_m, distance)
    return roughness_of(values, np.ones(count + 1, dtype=bool), distance, LEAST_UT)


@pytest.mark.parametrize(("sigma", "length_m"), [(5.0, 0.8), (2.0, 3.0), (8.0, 10.0)])
def test_spread_and_length_of_a_process_are_found(sigma: float, length_m: float) -> None:
    all_found = [found(seed, sigma, length_m) for seed in SEEDS]
    # An estimate from N correlated values is worth N (1 - rho^2) / (1 + rho^2) of them for sigma^2, and the
    # correlation of neighbours has the variance (1 - rho^2) / N.
    rho = np.exp(-STRIDE_M / length_m)
    share = np.sqrt((1 + rho**2) / (2 * 400 * (1 - rho**2)))
    spread = np.array([one.sigma for one in all_found]) / sigma
    assert abs(spread.mean() - 1) < 3 * share / np.sqrt(len(SEEDS)) + share**2
    assert 0.6 * share < spread.std() < 1.5 * share
    correlation = np.array([np.exp(-STRIDE_M / one.length_m) for one in all_found])
    of_rho = np.sqrt((1 - rho**2) / 400)
    low = (1 + 4 * rho) / 400  # by which it comes out too small on the average (Kendall 1954)
    assert abs(correlation.mean() - rho) < 3 * of_rho / np.sqrt(len(SEEDS)) + low
    assert 0.6 * of_rho < correlation.std() < 1.5 * of_rho


def test_a_field_that_is_new_at_each_footfall_is_told_from_one_that_lasts() -> None:
    assert max(found(seed, 5.0, 0.05).length_m for seed in SEEDS) < 1.0
    assert min(found(seed, 5.0, 10.0).length_m for seed in SEEDS) > 4.0


def test_a_field_that_does_not_change_at_all_has_a_length_that_is_finite() -> None:
    one = roughness_of(np.full(50, 3.0), np.ones(50, dtype=bool), np.full(49, STRIDE_M), LEAST_UT)
    assert one.sigma == pytest.approx(3.0)
    assert 50.0 < one.length_m < 100.0


def test_a_field_that_swings_from_side_to_side_has_a_length_that_is_positive() -> None:
    values = 3.0 * (-1.0) ** np.arange(50)
    one = roughness_of(values, np.ones(50, dtype=bool), np.full(49, STRIDE_M), LEAST_UT)
    assert 0.0 < one.length_m < 0.5


def test_what_is_left_and_what_is_new_make_up_the_same_spread() -> None:
    one, distance = Roughness(4.0, 2.5), np.array([0.5, 1.3, 5.0, 100.0])
    np.testing.assert_allclose((one.left(distance) * one.sigma) ** 2 + one.innovation(distance) ** 2, 16.0)
    np.testing.assert_allclose(one.left(distance[:2]).prod(), one.left(distance[:2].sum()))


def test_a_magnet_on_the_way_does_not_set_the_scale() -> None:
    rng = np.random.default_rng(3)
    distance = strides(rng, 300)
    values = drawn(rng, 2.0, 1.0, distance)
    seen = np.ones(301, dtype=bool)
    clean = roughness_of(values, seen, distance, LEAST_UT)
    values[[20, 21, 150, 290]] = 500.0, -300.0, 1e4, -80.0
    beside_magnets = roughness_of(values, seen, distance, LEAST_UT)
    assert beside_magnets.sigma == pytest.approx(clean.sigma, rel=0.2)
    assert beside_magnets.length_m == pytest.approx(clean.length_m, rel=0.5)
    assert np.std(values) > 100 * clean.sigma


def test_a_foot_that_stands_on_one_spot_learns_nothing_new() -> None:
    one = Roughness(6.0, 1.0)
    new = one.innovation(np.array([0.0, 1.3]))
    assert 0.0 < new[0] < 0.02 * one.sigma
    assert new[1] > 0.9 * one.sigma
    assert one.left(np.zeros(1)) == 1.0


def test_standing_between_the_strides_does_not_lengthen_them() -> None:
    rng = np.random.default_rng(5)
    distance = strides(rng, 400)
    values = drawn(rng, 3.0, 1.5, distance)
    walked = roughness_of(values, np.ones(401, dtype=bool), distance, LEAST_UT)
    stood = np.repeat(values, 2)
    between = np.zeros(2 * 401 - 1)
    between[1::2] = distance
    paused = roughness_of(stood, np.ones(802, dtype=bool), between, LEAST_UT)
    assert paused.length_m == pytest.approx(walked.length_m, rel=1e-6)
    assert paused.sigma == pytest.approx(walked.sigma, rel=1e-6)


def test_footfalls_that_were_not_seen_are_left_out() -> None:
    rng = np.random.default_rng(6)
    distance = strides(rng, 2000)
    values = drawn(rng, 3.0, 4.0, distance)
    seen = np.arange(2001) % 5 > 0
    hidden = np.where(seen, values, 0.0)
    all_seen = roughness_of(values, np.ones(2001, dtype=bool), distance, LEAST_UT)
    partly = roughness_of(hidden, seen, distance, LEAST_UT)
    assert partly.sigma == pytest.approx(all_seen.sigma, rel=0.05)
    assert partly.length_m == pytest.approx(all_seen.length_m, rel=0.2)
    counted = roughness_of(hidden, np.ones(2001, dtype=bool), distance, LEAST_UT)
    assert counted.length_m < 0.7 * all_seen.length_m


@pytest.mark.parametrize("count", [0, 1, FEWEST - 1])
def test_too_few_strides_tell_a_spread_and_no_length(count: int) -> None:
    values = 5.0 * np.ones(count + 1)
    one = roughness_of(values, np.ones(count + 1, dtype=bool), np.full(count, STRIDE_M), LEAST_UT)
    assert one == Roughness(5.0, NOTHING_KNOWN_M)


def test_where_nothing_was_seen_the_spread_is_the_sensor_s() -> None:
    one = roughness_of(np.zeros(20), np.zeros(20, dtype=bool), np.full(19, STRIDE_M), LEAST_UT)
    assert one == Roughness(LEAST_UT, NOTHING_KNOWN_M)


def test_the_noise_of_the_sensor_is_no_roughness() -> None:
    rng = np.random.default_rng(0)
    one = roughness_of(0.05 * rng.standard_normal(100), np.ones(100, dtype=bool), strides(rng, 99), LEAST_UT)
    assert one == Roughness(LEAST_UT, NOTHING_KNOWN_M)


def test_the_robust_spread_is_that_of_a_normal_distribution() -> None:
    rng = np.random.default_rng(1)
    assert robust_sigma(3.0 * rng.standard_normal(20000)) == pytest.approx(3.0, rel=0.03)


ASSUMED = Roughness(5.0, 20.0)
WEIGHT = 5.0


def region_of(rng: np.random.Generator, sigma: float, own: float, own_m: float, count: int) -> Roughness:
    """What is measured of two components that deviate by region, and beside it from footfall to footfall."""
    distance = strides(rng, count)
    values = np.stack(
        [drawn(rng, sigma, ASSUMED.length_m, distance) + drawn(rng, own, own_m, distance) for _ in range(2)], axis=1
    )
    spread = np.full(2, np.hypot(sigma, own))
    return roughness_of_regions(values, spread, np.ones(count + 1, dtype=bool), distance, ASSUMED, own_m, WEIGHT)


@pytest.mark.parametrize("sigma", [0.5, 10.0])
def test_a_long_walk_learns_how_its_regions_deviate(sigma: float) -> None:
    """What is taken for the region is the mean of a piece as long as its length: 74 % of its variance."""
    measured = np.array([region_of(np.random.default_rng(s), sigma, 1.0, 0.5, 3000).sigma for s in range(6)])
    mean_of_piece = np.sqrt(2.0 / np.e) * sigma
    weighted = np.sqrt((WEIGHT * ASSUMED.sigma**2 + 195 * mean_of_piece**2) / (WEIGHT + 195))
    assert measured.mean() == pytest.approx(weighted, rel=0.15)
    assert abs(measured.mean() - sigma) < 0.6 * abs(ASSUMED.sigma - sigma)


def test_a_short_walk_keeps_to_what_was_assumed() -> None:
    for seed in range(10):
        assert region_of(np.random.default_rng(seed), 0.1, 1.0, 0.5, 12).sigma == pytest.approx(5.0, rel=0.15)


def test_rough_ground_is_not_taken_for_regions() -> None:
    """Deviations that last for a stride average out in a region, but not to nothing: 2.3 uT of 6."""
    rough = np.array([region_of(np.random.default_rng(s), 0.0, 6.0, 1.5, 3000).sigma for s in range(6)])
    assert rough.mean() < 1.6


def test_a_homogeneous_field_has_almost_no_regions() -> None:
    rng = np.random.default_rng(0)
    values = 0.05 * rng.standard_normal((200, 2))
    seen, distance = np.ones(200, dtype=bool), strides(rng, 199)
    across = roughness_of(values[:, 0], seen, distance, LEAST_UT)
    assumed = Roughness(across.sigma, 20.0)
    one = roughness_of_regions(values, np.full(2, LEAST_UT), seen, distance, assumed, across.length_m, WEIGHT)
    assert one.sigma <= LEAST_UT
    assert one.length_m == 20.0


def test_regions_far_apart_take_no_memory_between_them() -> None:
    values, seen, own = np.tile([[1.0, -1.0]], (4, 1)), np.ones(4, dtype=bool), np.full(2, 1.0)
    near, far = (
        roughness_of_regions(values, own, seen, np.array([1.0, apart, 1.0]), ASSUMED, 1.0, WEIGHT)
        for apart in (10.0 * ASSUMED.length_m, 1e30)
    )
    assert far == near


def test_a_magnet_makes_no_region() -> None:
    rng = np.random.default_rng(0)
    values = 0.5 * rng.standard_normal((400, 2))
    seen, distance = np.ones(400, dtype=bool), strides(rng, 399)
    own, assumed = np.full(2, 0.5), Roughness(0.5, 20.0)
    clean = roughness_of_regions(values, own, seen, distance, assumed, 0.5, WEIGHT)
    values[[100, 300]] = 800.0
    assert roughness_of_regions(values, own, seen, distance, assumed, 0.5, WEIGHT).sigma == pytest.approx(
        clean.sigma, rel=0.2
    )


@pytest.mark.parametrize("seen", [np.zeros(30, dtype=bool), np.arange(30) == 29], ids=["none", "the last"])
def test_where_nothing_was_seen_the_assumption_stands(seen: np.ndarray) -> None:
    one = roughness_of_regions(np.zeros((30, 2)), np.full(2, 1.0), seen, np.full(29, STRIDE_M), ASSUMED, 1.0, WEIGHT)
    expected = ASSUMED.sigma * np.sqrt(WEIGHT / (WEIGHT + seen.sum()))
    assert one == Roughness(pytest.approx(expected), ASSUMED.length_m)


def test_a_foot_that_only_stands_is_in_one_region() -> None:
    values = np.full((40, 2), 3.0)
    one = roughness_of_regions(values, np.full(2, 3.0), np.ones(40, dtype=bool), np.zeros(39), ASSUMED, 0.0, WEIGHT)
    assert one.sigma == pytest.approx(np.sqrt((WEIGHT * 25.0 + 9.0) / (WEIGHT + 1)))
