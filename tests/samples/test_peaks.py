"""Peaks that a sensor cut, against what it would have read."""

import numpy as np
import pytest

from fg_nav.arrays import Floats
from fg_nav.samples.readings import MAX_RANGES, MAX_S, OFF_SHARE, rebuild_peaks

RATE_HZ = 200.0
LIMIT = 8.7


def swings(rng: np.random.Generator, count: int = 30, pointed: float = 2.0) -> Floats:
    """Pitch rate (N, 3) of swings with peaks of 8 to 12 rad/s either way, and a little about the other axes."""
    phase = np.linspace(0, 1, 60)[:, None]
    high = rng.uniform(8.0, 12.0, count) * np.where(np.arange(count) % 2, 1.0, -1.0)
    swing = high * np.sin(np.pi * phase) ** pointed
    pitch = np.concatenate([swing, np.zeros((60, count))]).T.ravel()
    return np.stack([0.2 * pitch, pitch, -0.1 * pitch], axis=1) + 0.002 * rng.standard_normal((len(pitch), 3))


def pitch_cut(gyr: Floats, limit: float = LIMIT) -> Floats:
    """Clip the pitch rate (N, 3)."""
    return np.stack([gyr[:, 0], np.clip(gyr[:, 1], -limit, limit), gyr[:, 2]], axis=1)


def by_swing(rate: Floats) -> Floats:
    """Angle of each swing."""
    return np.asarray(rate.reshape(-1, 120).sum(axis=1) / RATE_HZ)


def test_most_of_what_was_cut_is_given_back() -> None:
    """On both sides, and of the angle of every peak; the other axes and all that was not cut stay as they are."""
    gyr = swings(np.random.default_rng(1))
    cut = pitch_cut(gyr)
    found = rebuild_peaks(cut, 1 / RATE_HZ)
    hidden, left = (by_swing((gyr - some)[:, 1]) for some in (cut, found.whole))
    deep = np.abs(hidden) > np.radians(1.0)
    assert deep.sum() > 10
    assert (np.abs(left) < 0.35 * np.abs(hidden))[deep].all()
    np.testing.assert_array_equal(found.whole[:, [0, 2]], gyr[:, [0, 2]])
    below = np.abs(gyr[:, 1]) < 0.97 * LIMIT
    np.testing.assert_array_equal(found.whole[below, 1], gyr[below, 1])
    assert not found.sigma[below].any()
    assert (np.abs(found.whole[:, 1]) >= np.abs(cut[:, 1])).all()
    # a sensor within its range is left alone
    found = rebuild_peaks(gyr, 1 / RATE_HZ)
    np.testing.assert_array_equal(found.whole, gyr)
    assert not found.sigma.any()
    assert not found.run.any()


def test_a_parabola_sampled_finely_is_found_but_for_what_the_range_forbids() -> None:
    """Slopes of its ends make it; a height H becomes H / (1 + H / (2 L))."""
    rate_hz, height, half_s = 500.0, 4.0, 0.05
    t = np.arange(-500, 500) / rate_hz
    curve = height / half_s**2
    gyr = np.zeros((len(t), 3))
    for middle in (-0.6, 0.0, 0.6):
        gyr[:, 2] += np.maximum(LIMIT + height - curve * (t - middle - 0.0013) ** 2, 0.0)
    cut = np.minimum(gyr, LIMIT) + 1e-6 * np.random.default_rng(4).standard_normal(gyr.shape)
    found = rebuild_peaks(cut, 1 / rate_hz)
    hidden = (gyr - cut)[:, 2]
    np.testing.assert_allclose(
        (found.whole - cut)[:, 2], hidden / (1 + height / (MAX_RANGES * LIMIT)), atol=0.07 * height
    )
    angle = hidden.sum() / 3 / rate_hz
    off_share = np.sqrt(np.sum(found.sigma[:, 2] ** 2) / 3) / rate_hz / angle
    assert OFF_SHARE < off_share < 1.2 * OFF_SHARE  # of a flank as steep throughout as where it is steepest


@pytest.mark.parametrize("share", [0.95, 0.85, 0.7])
def test_a_low_pass_behind_the_range_changes_little(share: float) -> None:
    """It bends the corners of the flat top: fewer samples reach the level, and the steps next to them are smaller."""
    gyr = swings(np.random.default_rng(7))
    cut = pitch_cut(gyr, share * 10.0)
    bent = np.apply_along_axis(np.convolve, 0, cut, [0.25, 0.5, 0.25], "same")
    sharp, smooth = (by_swing((rebuild_peaks(some, 1 / RATE_HZ).whole - some)[:, 1]) for some in (cut, bent))
    np.testing.assert_allclose(smooth, sharp, atol=0.35 * np.abs(sharp).max())
    assert np.abs(smooth).sum() > 0.8 * np.abs(sharp).sum()


@pytest.mark.parametrize("pointed", [0.5, 1.0, 2.0, 6.0])
@pytest.mark.parametrize("share", [0.95, 0.8, 0.6])
def test_what_is_left_of_an_angle_is_as_its_sigma_says(pointed: float, share: float) -> None:
    """Flat and pointed peaks, cut a little and deeply: the sigma of a whole peak, from those of its samples."""
    gyr = swings(np.random.default_rng(5), 60, pointed)
    cut = pitch_cut(gyr, share * 10.0)
    found = rebuild_peaks(cut, 1 / RATE_HZ)
    left = by_swing((gyr - found.whole)[:, 1])
    variance = by_swing(found.sigma[:, 1] ** 2) / RATE_HZ
    deep = np.abs(by_swing((gyr - cut)[:, 1])) > np.radians(0.5)
    assert deep.sum() > 15
    over_sigma = np.sqrt(np.mean(left[deep] ** 2 / variance[deep]))
    assert 0.02 < over_sigma < 1.5  # a peak that is nearly a parabola is found to a fiftieth of it


def test_one_error_of_a_run_is_the_larger_the_longer_the_run() -> None:
    """Run lengths are told; a deeper cut is doubted more, by more than in proportion."""
    gyr = swings(np.random.default_rng(6))
    shallow, deep = (rebuild_peaks(pitch_cut(gyr, limit), 1 / RATE_HZ) for limit in (7.5, 5.0))
    angles = [np.sqrt(np.sum(found.sigma[:, 1] ** 2)) / RATE_HZ for found in (shallow, deep)]
    assert angles[1] > 2 * angles[0]
    runs = np.unique(deep.run[:, 1])
    assert runs[0] == 0
    for length in runs[1:]:
        assert np.count_nonzero(deep.run[:, 1] == length) % length == 0


def test_without_flanks_a_run_stays_and_may_hide_as_much_as_it_shows() -> None:
    """Clipped for longer than a peak lasts; at an end, one flank is enough."""
    gyr = swings(np.random.default_rng(2))[60:]
    cut = np.clip(gyr, -LIMIT, LIMIT)
    long = slice(200, 201 + int(MAX_S * RATE_HZ))
    cut[long] = cut[:5] = cut[-5:] = LIMIT
    found = rebuild_peaks(cut, 1 / RATE_HZ)
    np.testing.assert_array_equal(found.whole[long], cut[long])
    angle = np.sqrt(np.sum(found.sigma[long] ** 2, axis=0)) / RATE_HZ
    np.testing.assert_allclose(angle, LIMIT * (long.stop - long.start) / RATE_HZ, rtol=1e-9)
    assert np.isfinite(found.whole).all()
    for end in (slice(0, 5), slice(-5, None)):
        assert (found.whole[end] > LIMIT).any()
    nothing_else = np.concatenate([cut[long], -cut[long]])
    np.testing.assert_array_equal(rebuild_peaks(nothing_else, 1 / RATE_HZ).whole, nothing_else)
