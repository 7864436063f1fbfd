"""Roughness of a field, measured on deviations of which it is known."""

import numpy as np
import pytest

from fg_nav.arrays import Floats
from fg_nav.smoother.field_factors import (
    ASSUMED_SHARE,
    MIN_REGIONAL_UT,
    MIN_SIGMA_UT,
    POTENTIAL_PER_FIELD_M,
    REGIONAL_LENGTH_M,
    REGIONAL_SHARE,
    FieldRoughness,
    Roughness,
    deviate_along,
    measure_roughness,
    split_potential,
)

STRIDE_M = 1.3
SEEDS = range(20)


def draw(rng: np.random.Generator, sigma: float, length_m: float, distance_m: Floats) -> Floats:
    """(F,) a stationary process of this spread and correlation length at F places along a way."""
    x = np.empty(len(distance_m) + 1)
    x[0] = sigma * rng.standard_normal()
    for k, d in enumerate(distance_m):
        left = np.exp(-d / length_m)
        x[k + 1] = left * x[k] + sigma * np.sqrt(1 - left**2) * rng.standard_normal()
    return x


def draw_field(
    seed: int, white_uT: float, across: Roughness, regional_uT: float, count: int = 4000
) -> tuple[Floats, Floats]:
    """Deviations at footfalls, and the strides between them."""
    rng = np.random.default_rng(seed)
    distance = STRIDE_M * (1 + 0.1 * rng.uniform(-1, 1, count))
    own = white_uT * rng.standard_normal(count + 1)
    alike = draw(rng, across.sigma, across.length_m, distance)
    return own + alike + draw(rng, regional_uT, REGIONAL_LENGTH_M, distance), distance


def measure(deviation: Floats, distance_m: Floats) -> FieldRoughness:
    return measure_roughness(deviation, np.ones(len(deviation), dtype=np.bool_), distance_m)


@pytest.mark.parametrize(
    ("white_uT", "across", "regional_uT"),
    [
        (5.0, Roughness(4.0, 3.0), 2.0),
        (2.0, Roughness(2.0, 2.0), 2.0),
        (0.0, Roughness(5.0, 1.5), 0.0),
        (0.0, Roughness(5.0, 6.0), 0.0),
        (5.0, Roughness(0.0, 3.0), 0.0),
        (5.0, Roughness(0.0, 3.0), 2.0),
    ],
)
def test_spread_length_and_regional_part_of_a_process_are_found(
    white_uT: float, across: Roughness, regional_uT: float
) -> None:
    """A walk of 5 km: the mean over seeds to a tenth of the whole spread, one alone to a third."""
    found = [measure(*draw_field(seed, white_uT, across, regional_uT)) for seed in SEEDS]
    parts = np.array([[one.white_uT, one.across.sigma, one.regional.sigma] for one in found])
    expected = np.array([white_uT, across.sigma, regional_uT])
    whole = np.linalg.norm(expected)
    np.testing.assert_allclose((parts**2).mean(axis=0), expected**2, atol=0.1 * whole**2)
    np.testing.assert_allclose(parts**2, np.tile(expected**2, (len(parts), 1)), atol=0.33 * whole**2)
    np.testing.assert_allclose([one.potential.sigma for one in found], POTENTIAL_PER_FIELD_M * whole, rtol=0.1)
    if across.sigma > 0.3 * whole:
        assert np.mean([one.across.length_m for one in found]) == pytest.approx(across.length_m, rel=0.15)


def test_a_magnet_on_the_way_does_not_set_the_scale() -> None:
    deviation, distance = draw_field(3, 1.0, Roughness(2.0, 3.0), 0.5, 300)
    clean = measure(deviation, distance)
    deviation[[20, 21, 150, 290]] = 500.0, -300.0, 1e4, -80.0
    found = measure(deviation, distance)
    assert found.potential.sigma == pytest.approx(clean.potential.sigma, rel=0.2)
    assert found.across.sigma == pytest.approx(clean.across.sigma, rel=0.25)
    assert found.white_uT < 2.0
    assert np.std(deviation) > 100 * found.white_uT


def test_footfalls_that_were_not_seen_are_left_out() -> None:
    deviation, distance = draw_field(6, 1.0, Roughness(3.0, 4.0), 1.0)
    seen = np.arange(len(deviation)) % 5 > 0
    found, hidden = (measure_roughness(np.where(seen, deviation, value), seen, distance) for value in (np.nan, 1e3))
    assert found == hidden
    whole = measure(deviation, distance)
    assert found.across.sigma == pytest.approx(whole.across.sigma, rel=0.1)
    assert found.across.length_m == pytest.approx(whole.across.length_m, rel=0.25)
    assert found.white_uT == pytest.approx(whole.white_uT, abs=0.3)


def test_a_short_walk_keeps_to_what_was_assumed() -> None:
    """Eight strides, of which each deviates for itself or all alike."""
    for across in (Roughness(0.0, 3.0), Roughness(4.0, 300.0)):
        found = [measure(*draw_field(seed, 5.0 - across.sigma, across, 0.0, 8)) for seed in SEEDS]
        whole = np.array([one.potential.sigma / POTENTIAL_PER_FIELD_M for one in found])
        shares = np.array([[one.across.sigma, one.regional.sigma] for one in found]) ** 2 / whole[:, None] ** 2
        np.testing.assert_allclose(shares.mean(axis=0), [ASSUMED_SHARE, REGIONAL_SHARE], atol=0.15)


@pytest.mark.parametrize("seen", [np.zeros(30, dtype=np.bool_), np.arange(30) == 29], ids=["none", "the last"])
def test_where_nothing_was_seen_the_spread_is_the_sensor_s(seen: np.ndarray) -> None:
    found = measure_roughness(np.zeros(30), seen, np.full(29, STRIDE_M))
    assert found.potential.sigma == pytest.approx(POTENTIAL_PER_FIELD_M * MIN_SIGMA_UT)
    assert found.across.sigma == found.regional.sigma == MIN_REGIONAL_UT
    assert found.white_uT < 0.02


def test_the_changes_of_a_potential_keep_their_variance_where_a_share_of_it_is_lost() -> None:
    one, distance = Roughness(6.0, 12.0), np.array([0.0, 1.3, 40.0])
    for share in (0.0, 0.3, 0.9):
        telescoping, noise = split_potential(one, share, distance)
        changes = 2.0 * telescoping.sigma**2 * (1.0 - telescoping.correlation(distance)) + noise**2
        np.testing.assert_allclose(changes, 2.0 * one.sigma**2 * (1.0 - one.correlation(distance)))


def test_a_deviation_along_the_field_hardly_hangs_on_the_heading() -> None:
    """A turn by a degree moves that across by 0.35 uT, and that along by a hundredth of it; its median is none."""
    rng = np.random.default_rng(2)
    field, reference = np.array([6.0, 19.0, -43.0]) + rng.standard_normal((99, 3)), np.tile([6.0, 19.0], (99, 1))
    turn = np.radians(1.0)
    turned = field.copy()
    turned[:, :2] = field[:, :2] @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    along, same = deviate_along(field, reference), deviate_along(turned, reference)
    np.testing.assert_allclose(along, same, atol=0.07)
    expected = field[:, :2] @ reference[0] / np.hypot(6.0, 19.0)
    np.testing.assert_allclose(along, expected - np.median(expected))
