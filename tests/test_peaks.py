"""Peaks that a gyroscope cut, against what it would have read."""

import numpy as np
import pytest

from fg_nav.arrays import Floats
from fg_nav.peaks import LONGEST_S, rebuilt

RATE_HZ = 200.0
LIMIT = 8.7


def swings(rng: np.random.Generator, count: int = 30) -> Floats:
    """Pitch rate (N, 3) of swings with peaks of 8 to 12 rad/s either way, and a little about the other axes."""
    phase = np.linspace(0, 1, 60)[:, None]
    high = rng.uniform(8.0, 12.0, count) * np.where(np.arange(count) % 2, 1.0, -1.0)
    swing = high * np.sin(np.pi * phase) ** 2
    pitch = np.concatenate([swing, np.zeros((60, count))]).T.ravel()
    return np.stack([0.2 * pitch, pitch, -0.1 * pitch], axis=1) + 0.002 * rng.standard_normal((len(pitch), 3))


def test_most_of_what_was_cut_is_given_back() -> None:
    """On both sides, and of the angle of every peak; the other axes and all that was not cut stay as they are."""
    gyr = swings(np.random.default_rng(1))
    cut = gyr.copy()
    cut[:, 1] = np.clip(gyr[:, 1], -LIMIT, LIMIT)
    found = rebuilt(cut, 1 / RATE_HZ)
    hidden, left = ((gyr - some)[:, 1].reshape(-1, 120).sum(axis=1) / RATE_HZ for some in (cut, found))
    deep = np.abs(hidden) > np.radians(1.0)
    assert deep.sum() > 10
    assert (np.abs(left) < 0.35 * np.abs(hidden))[deep].all()
    np.testing.assert_array_equal(found[:, [0, 2]], gyr[:, [0, 2]])
    below = np.abs(gyr[:, 1]) < 0.97 * LIMIT
    np.testing.assert_array_equal(found[below, 1], gyr[below, 1])
    assert (np.abs(found[:, 1]) >= np.abs(cut[:, 1])).all()


def test_a_parabola_is_found_exactly() -> None:
    t = np.arange(-400, 400) / RATE_HZ
    gyr = np.zeros((800, 3))
    for middle in (-1.2, -0.4, 0.4, 1.2):
        gyr[:, 2] += np.maximum(10.0 - 600.0 * (t - middle - 0.0013) ** 2, 0.0)
    cut = np.minimum(gyr, LIMIT) + 1e-6 * np.random.default_rng(4).standard_normal(gyr.shape)
    assert (np.abs(cut - gyr) > 0.1).sum() > 20
    np.testing.assert_allclose(rebuilt(cut, 1 / RATE_HZ), gyr, atol=1e-4)


@pytest.mark.parametrize("where", ["whole", "begin", "end"])
def test_without_flanks_a_run_stays(where: str) -> None:
    """A recording that is clipped for long, or that begins or ends so."""
    gyr = swings(np.random.default_rng(2))[60:]
    cut = np.clip(gyr, -LIMIT, LIMIT)
    some = slice(*{"whole": (200, 201 + int(LONGEST_S * RATE_HZ)), "begin": (0, 5), "end": (-5, None)}[where])
    cut[some] = LIMIT
    found = rebuilt(cut, 1 / RATE_HZ)
    np.testing.assert_array_equal(found[some], cut[some])
    assert np.isfinite(found).all()


def test_a_sensor_within_its_range_is_left_alone() -> None:
    gyr = swings(np.random.default_rng(3))
    np.testing.assert_array_equal(rebuilt(gyr, 1 / RATE_HZ), gyr)
