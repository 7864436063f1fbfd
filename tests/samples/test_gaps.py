"""Gaps in recordings of a foot that never steps twice alike: what is made of them, and whether the sigma is true."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Bools, Floats
from fg_nav.recording import Recording, find_extra_sigmas
from fg_nav.samples.gaps import MAX_S, REACH, WALKING, Gaps, fill_gaps, list_bridged
from fg_nav.samples.readings import rebuild_peaks

RATE_HZ = 100.0
STRIDE = 120  # Samples from one step to the next.


def strides(count: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Acc and gyr (N, 3): half of each stride at rest, half a swing of three harmonics, each of new amplitude."""
    phase = np.linspace(0, 1, STRIDE // 2)
    shapes = np.stack([np.sin(np.pi * k * phase) * np.sin(np.pi * phase) for k in (1, 2, 3)])
    mixed = rng.standard_normal((3, 6)) * np.repeat([30.0, 6.0], 3)
    swing = (shapes * (1 + 0.3 * rng.standard_normal((count, 3, 1)))).transpose(0, 2, 1) @ mixed
    still = np.zeros((count, STRIDE - STRIDE // 2, 6))
    values = np.concatenate([still, swing], axis=1).reshape(-1, 6)
    values += rng.standard_normal(values.shape) * np.repeat([0.01, 0.001], 3)
    return values[:, :3], values[:, 3:]


def without(samples: tuple[Floats, Floats], kept: Bools) -> Gaps:
    """Gaps of a recording of which only the samples `kept` (N,) are left."""
    acc, gyr = samples
    return fill_gaps(np.flatnonzero(kept) / RATE_HZ, acc[kept], gyr[kept])


def dropped(count: int, first: Floats, lost: int) -> Bools:
    """Which of `count` samples are kept where so many are lost from each of the samples `first` on."""
    kept = np.ones(count, dtype=np.bool_)
    kept[(first[:, None] + np.arange(lost)).ravel()] = False
    return kept


def between(samples: Floats, first: Floats, lost: int) -> Floats:
    """What was lost (G, 3): the means."""
    return np.stack([samples[i : i + lost].mean(axis=0) for i in first])


@pytest.mark.parametrize("lost", [1, 2, 4])
def test_a_swing_is_bridged_better_than_by_a_line_and_the_sigma_is_true(lost: int) -> None:
    rng = np.random.default_rng(1)
    acc, gyr = samples = strides(60, rng)
    first = np.sort(rng.permutation(np.arange(5, 400))[:60]) * 16 + rng.integers(5)
    gaps = without(samples, dropped(len(acc), first, lost))
    np.testing.assert_allclose(gaps.unseen_s, lost / RATE_HZ)
    swings = np.abs(gyr[first]).max(axis=1) > 0.1
    for values, found, sigma in ((acc, gaps.acc, gaps.acc_sigma), (gyr, gaps.gyr, gaps.gyr_sigma)):
        truth = between(values, first, lost)
        line = (values[first - 1] + values[first + lost]) / 2
        assert np.std(found - truth) < np.std(line - truth) / 4
        for some in (swings, ~swings):
            assert 0.5 < np.sqrt(np.mean(((found - truth) / sigma)[some] ** 2)) < 1.4


def test_what_is_seen_but_once_is_doubted() -> None:
    """A stumble in a walk: nothing like it elsewhere shows what its gap holds, and the sigma says so."""
    rng = np.random.default_rng(2)
    acc, gyr = strides(40, rng)
    middle = 20 * STRIDE + 3 * STRIDE // 4
    rough = slice(middle - 15, middle + 15)
    gyr[rough] += rng.standard_normal((30, 3)) * 5.0
    stumbled = without((acc, gyr), dropped(len(acc), np.array([middle]), 2))
    assert (stumbled.gyr_sigma > 1.0).all()
    assert (np.abs(stumbled.gyr - between(gyr, np.array([middle]), 2)) < 4 * stumbled.gyr_sigma).all()


def test_how_the_sensor_is_mounted_does_not_matter() -> None:
    acc, gyr = strides(20, np.random.default_rng(3))
    turn = Rotation.random(rng=np.random.default_rng(4)).as_matrix()
    kept = dropped(len(acc), np.array([330, 701]), 2)
    one, other = without((acc, gyr), kept), without((acc @ turn.T, gyr @ turn.T), kept)
    np.testing.assert_allclose(other.acc, one.acc @ turn.T, atol=1e-9)
    np.testing.assert_allclose(other.gyr, one.gyr @ turn.T, atol=1e-9)


@pytest.mark.parametrize("count", [5, 60, 2000])
def test_a_line_is_carried_on_however_short_the_recording(count: int) -> None:
    """And where there is too little to learn from, its sigma is the spread of all there is."""
    line = np.outer(np.arange(count), [0.1, -0.2, 0.3])
    kept = dropped(count, np.array([2]), 1)
    gaps = without((line, line), kept)
    np.testing.assert_allclose(gaps.gyr, line[[2]], rtol=1e-3)
    if count < 100:
        np.testing.assert_allclose(gaps.gyr_sigma, line[kept].std(axis=0)[None])


def test_gaps_side_by_side_and_at_either_end() -> None:
    acc, gyr = samples = strides(20, np.random.default_rng(5))
    first = np.array([1, 700, 702, 705, 2 * REACH + 706, len(acc) - 2])
    gaps = without(samples, dropped(len(acc), first, 1))
    np.testing.assert_array_equal(gaps.sample, first - 1 - np.arange(6))
    assert all(np.isfinite(found).all() for found in gaps[2:])
    assert (np.abs(gaps.gyr - gyr[first]) < 5 * gaps.gyr_sigma).all()
    late = np.arange(len(acc)) / RATE_HZ + np.arange(len(acc)) % 2 * 0.2 / RATE_HZ
    assert len(fill_gaps(late, acc, gyr).sample) == 0  # late stamps are none


def test_one_sample_between_two_gaps_does_not_hide_those_beyond() -> None:
    """In every other swing four samples are lost, one is not, and the next one is."""
    rng = np.random.default_rng(9)
    acc, gyr = samples = strides(60, rng)
    first = np.arange(5, 58, 2) * STRIDE + 3 * STRIDE // 4
    kept = dropped(len(acc), first, 4) & dropped(len(acc), first + 5, 1)
    gaps = without(samples, kept)
    truth = between(gyr, first, 4)
    line = (gyr[first - 1] + gyr[first + 4]) / 2
    assert np.std(gaps.gyr[::2] - truth) < np.std(line - truth) / 5
    assert 0.4 < np.sqrt(np.mean(((gaps.gyr[::2] - truth) / gaps.gyr_sigma[::2]) ** 2)) < 1.4


def test_a_hole_is_bridged_where_another_recording_went_on_throughout() -> None:
    t = np.arange(6000) / RATE_HZ
    is_missing, stops = ((t > 20) & (t < 25)) | ((t > 40) & (t < 45)), (t > 42) & (t < 45)
    np.testing.assert_allclose(list_bridged(t[~is_missing], t[~stops]), [[20, 25]])


def test_a_sample_is_doubted_for_its_unseen_share() -> None:
    """Held for three periods of which it saw one; the sample after a gap and all others not at all."""
    acc, gyr = strides(20, np.random.default_rng(7))
    kept = dropped(len(acc), np.array([700]), 2)
    recording = Recording(t=np.flatnonzero(kept) / RATE_HZ, acc=acc[kept], gyr=gyr[kept])
    for doubt, sigma in zip(find_extra_sigmas(recording, 0.0), recording.gaps[4:], strict=True):
        np.testing.assert_allclose(doubt[699], 2 / 3 * sigma[0])
        assert (sigma > 0).all()
        assert not np.delete(doubt, 699, axis=0).any()


def test_a_clipped_sample_is_doubted_for_what_it_may_hide() -> None:
    acc, gyr = strides(20, np.random.default_rng(8))
    limit = 0.8 * np.abs(gyr[:, 1]).max()
    clipped = replace(
        Recording(t=np.arange(len(acc)) / RATE_HZ, acc=acc, gyr=gyr),
        gyr=np.stack([gyr[:, 0], np.clip(gyr[:, 1], -limit, limit), gyr[:, 2]], axis=1),
    )
    _, doubt = find_extra_sigmas(clipped, 0.3)
    cut = np.abs(gyr[:, 1]) > limit
    peaks = rebuild_peaks(clipped.gyr, clipped.period_s)
    share = np.sqrt(doubt[cut, 1] ** 2 - peaks.sigma[cut, 1] ** 2) / limit
    np.testing.assert_allclose(share, 0.3 * np.sqrt(peaks.run[cut, 1]))
    assert not find_extra_sigmas(clipped, 0.0)[1].any()
    assert not doubt[np.abs(gyr[:, 1]) < 0.97 * limit].any()
    assert not doubt[:, [0, 2]].any()


def test_a_part_of_a_recording_has_the_gaps_and_the_motion_of_the_whole() -> None:
    rng = np.random.default_rng(5)
    t = np.delete(np.arange(400) / 100.0, [60, 150, 151, 300])
    whole = Recording(t, rng.normal(0, 3, (len(t), 3)), rng.normal(0, 2, (len(t), 3)))
    assert whole.gaps.sample.tolist() == [59, 148, 296]
    part = whole.slice(59, 297)
    assert part.gaps.sample.tolist() == [0, 89]  # the last sample has no next one in the part
    np.testing.assert_array_equal(part.gaps.gyr, whole.gaps.gyr[:2])
    np.testing.assert_array_equal(part.integrable[1], whole.integrable[1][59:297])


@pytest.mark.parametrize("lost", [3, 15, 160])
def test_who_stood_before_a_long_gap_may_have_walked_in_it(lost: int) -> None:
    """Nothing but rest is on record: the angle and the change of velocity unseen are still those of a walking foot."""
    rng = np.random.default_rng(3)
    acc, gyr = (size * rng.standard_normal((600, 3)) for size in (0.01, 0.001))
    gaps = without((acc, gyr), dropped(600, np.array([300]), lost))
    if lost / RATE_HZ > MAX_S:
        np.testing.assert_allclose(gaps.acc_sigma[0], WALKING[:3])
        np.testing.assert_allclose(gaps.gyr_sigma[0], WALKING[3:])
    else:  # no step fits into it
        assert lost == 3
        assert (gaps.acc_sigma < 0.05).all()
        assert (gaps.gyr_sigma < 0.005).all()


def test_the_angle_unseen_in_a_long_gap_is_within_its_sigma() -> None:
    """Windows of 0.2 to 1.5 s of a walk, cut out one at a time: not believed too much, nor twenty times too little."""
    acc, gyr = samples = strides(40, np.random.default_rng(4))
    for lost in (20, 60, 150):
        over = []
        for first in range(600, 4000, 331):
            gaps = without(samples, dropped(len(acc), np.array([first]), lost))
            over.append((gaps.gyr - between(gyr, np.array([first]), lost)) / gaps.gyr_sigma)
        assert 0.05 < np.sqrt(np.mean(np.square(over))) < 1.5
